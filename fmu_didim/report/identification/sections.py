"""A saved identification as a report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fmu_didim.checks.validation import Validation
from fmu_didim.report import experiments
from fmu_didim.report.drawing.diagram import loop_diagram
from fmu_didim.report.drawing.forest_chart import Expectation, forest_chart
from fmu_didim.report.drawing.torque_charts import history_chart
from fmu_didim.report.experiment_charts import ExperimentCharts, residual_sections, torque_sections
from fmu_didim.report.identification.charts import saved_charts
from fmu_didim.report.identification.choices import choice_sections
from fmu_didim.report.identification.display import shown_value
from fmu_didim.report.identification.essential import essential_sections
from fmu_didim.report.identification.joint import joint_sections
from fmu_didim.report.identification.loads import load_sections
from fmu_didim.report.identification.prior import prior_sections, share_text
from fmu_didim.report.identification.profiles import interval_texts, profile_sections
from fmu_didim.report.identification.search import search_sections
from fmu_didim.report.identification.sensitivities import sensitivity_sections
from fmu_didim.report.numbers import (
    MISSING,
    Rounding,
    aligned_parameters,
    capitalised,
    consistency_line,
    decimal_aligned,
    item_or_none,
    iteration_count,
    loop_lines,
    noise_text,
    percentage,
    pretty_unit,
    rounding,
    significant,
)
from fmu_didim.report.page import notebook_html, page_text, write_page
from fmu_didim.report.power import power_sections
from fmu_didim.report.sections import (
    Bar,
    Block,
    Charts,
    Column,
    Drawing,
    Fact,
    Facts,
    Folded,
    Items,
    Report,
    Section,
    Table,
    Text,
    Tree,
    matrix,
    note,
    numbers,
    words,
)
from fmu_didim.report.terminal import report_text
from fmu_didim.report.verdict import verdict
from fmu_didim.results.result import (
    REPORT_FILE,
    ParameterResult,
    ResultDocument,
    as_saved,
    read_result,
    saved_tables,
)

SHOWN_CORRELATIONS = 5
LABEL = 24
"""[characters] Of the name of an experiment that the terminal shows."""
BAR_RANGE = (0.1, 100.0)
"""[percent] Relative standard deviations that bars cover, logarithmically."""
GRADES = ((10.0, "good"), (30.0, "doubtful"))
"""[percent] Up to these relative standard deviations; beyond, the parameter is poorly known."""
BY_DESCRIPTION = " By description: the value of the robot description, from CAD for example, regrouped in the same way."
FORMULAS = {"paper": "σ, paper's formula", "cramer_rao": "Cramér-Rao bound"}


def result_table(document: ResultDocument) -> str:
    """The text shown after an identification; ends with the line that says whether it is valid."""
    return report_text(result_report(document))


def result_html(document: ResultDocument) -> str:
    """Verdict, parameters and torque errors of an identification, for notebooks."""
    return notebook_html(result_report(document))


def write_report(directory: Path, validations: Sequence[Validation] = ()) -> Path:
    """Write ``report.html`` beside the ``result.json`` of a directory and return its path.

    Args:
        validations: whose tables need not be read, because they were saved there just now.

    Raises:
        InputError: there is no result, or a table of torques that it names is missing.
    """
    document = read_result(directory)
    charts = saved_charts(document, directory, saved_tables(document, validations))
    return write_page(result_report(document, charts), directory / REPORT_FILE)


def result_page(document: ResultDocument, validations: Sequence[Validation]) -> str:
    """``report.html`` of a result as it is when it has been saved, of which nothing needs to be there yet.

    Args:
        validations: of all experiments that the result has tables of.
    """
    document = as_saved(document)
    return page_text(result_report(document, saved_charts(document, Path(), saved_tables(document, validations))))


def result_report(document: ResultDocument, parts: Sequence[ExperimentCharts] = ()) -> Report:
    """All that is shown of a result, with the charts of its experiments."""
    count = len(document.parameters)
    kind = f"{document.estimator}, {count} parameters" if count else document.estimator
    history = [] if document.status == "converged" else document.history
    notes = [f"{it.stage} {it.number}: {it.note}" for it in history if it.note]
    advice = "A shape says that the model lacks something; fmu-didim discover finds out what."
    sections = [
        _parameters(document),
        _experiments(document),
        _torque(document),
        *([] if document.outputs else power_sections(document.verdict, document.power)),
        *torque_sections(parts),
        *residual_sections(parts, "What the model leaves", advice),
        _model(document),
        *_regrouping(document),
        # Of interest where the iterations did not end well; the page has them in its table.
        Section("Notes of the iterations", [Items(notes, shown="terminal")], has_title=True),
        _plant(document),
        *joint_sections(document),
        *load_sections(document),
        *prior_sections(document),
        *choice_sections(document),
        *search_sections(document),
        *profile_sections(document),
        *essential_sections(document),
        *sensitivity_sections(document),
        *_correlations(document),
        _stages(document),
        *_iterations(document),
        _loop(document),
    ]  # fmt: skip
    return Report(
        document.name, f"{document.name} ({kind})", verdict(document), sections, description=document.description,
        subtitles=[f"Identified by {document.estimator}"], cards=_cards(document), remarks=document.remarks,
        provenance=document.provenance,
    )  # fmt: skip


def _cards(document: ResultDocument) -> list[tuple[str, str]]:
    shown = {label: values[0] for label, values in experiments.error_rows(document)}
    if experiments.ALL_FITTED in shown:  # the cards have no room for each of them
        fitted = [label for label, e in document.experiments.items() if e.role == "estimation"]
        shown = {label: shown[label] for label in (experiments.ALL_FITTED, *shown) if label not in fitted}
    titles = {label: experiments.experiment_title(document, label) for label in shown}
    cards = [(f"{document.quantity} error, {titles[label]}", percentage(error)) for label, error in shown.items()]
    if document.parameters:
        cards.append(("parameters", str(len(document.parameters))))
        cards.append(("condition number", significant(document.condition_number)))
    stages = ", main + finish" if document.finish_iterations else ""
    cards.append((f"iterations{stages}", iteration_count(document)))
    return cards


def _parameters(document: ResultDocument) -> Section:
    """The parameters; those of one experiment and those of the loop form groups."""
    groups = experiments.parameter_groups(document)
    listed = [(name, p) for group in groups for name, p in group.parameters.items()]
    bent = {name for name, one in document.profiles.items() if one.is_bent}
    texts = [experiments.shown_parameter(name, p) for name, p in listed]
    texts = [
        replace(text, interval=interval_texts(document, name)) if name in bent else text
        for text, (name, _) in zip(texts, listed, strict=True)
    ]
    shown = aligned_parameters(texts)
    marks = [" *" if text.insignificant else "" for text in texts]
    bars = [_bar(p.rel_std_percent) for _, p in listed]
    columns = [
        words("parameter", [text.name for text in texts], marks=marks, shrinks=True),
        Column("value", [text.value for text in shown]),
        Column("σ", [text.std for text in shown]),
        Column("%σ", [text.percent for text in shown], page_head="σ / |value| (%)"),
        words("", [""] * len(texts), bars=bars, shown="page"),
        words("unit", [text.unit or MISSING for text in texts]),
        *_as_displayed(document, listed),
        Column(
            "95 % interval",
            ["  ".join(text.interval) for text in shown],
            marks=[" !" if name in bent else "" for name, _ in listed] if bent else (),
        ),
        *_from_data(document, [name for name, _ in listed]),
        *_further_values(document, listed),
        words("carried by", [p.standard or p.of for _, p in listed], shown="page"),
    ]
    blocks: list[Block] = [Table(columns, [(group.head, len(group.parameters)) for group in groups])]
    if any(marks):
        blocks.append(Text("* not significantly different from zero"))
    if bent:
        blocks.append(Text("! by its profile, which differs from the linear interval by more than a third"))
    blocks += [Text(line) for line in experiments.delay_lines(document)]
    blocks.append(note(
        "σ: standard deviation, two significant digits. Bars: σ / |value| from 0.1 % to 100 %, logarithmic; full up to "
        "10 %, coarsely hatched up to 30 %, finely beyond. Start: where the iterations began."
        + ("" if document.outputs else BY_DESCRIPTION)
    ))  # fmt: skip
    described = {
        name: Expectation(p.value, p.std, p.described)
        for name, p in document.parameters.items()
        if p.described is not None
    }
    forest = forest_chart("forest", "Values beside those of the description", "the description", {"value": described})
    if forest is not None and not document.outputs:
        blocks += [note("How far each value is off that of the description, with its 95 % interval."), Charts([forest])]
    return Section("Parameters", blocks, anchor="parameters", is_brief=True)


def _as_displayed(document: ResultDocument, listed: Sequence[tuple[str, ParameterResult]]) -> list[Column]:
    """The values in the units in which the tool of the model shows them."""
    if not any(name in document.displays for name, _ in listed):
        return []
    texts = []
    for name, found in listed:
        unit = document.displays.get(name)
        if unit is None:
            texts.append("")
            continue
        value, std = shown_value(unit, found.value), abs(unit.factor) * found.std
        digits = rounding(value, std)
        texts.append(f"{digits.text(value)} ± {digits.text(std)} {pretty_unit(unit.name)}")
    return [words("in its display unit", texts, shown="page")]


def _from_data(document: ResultDocument, names: Sequence[str]) -> list[Column]:
    """How much of each value comes from the data, where there is a prior."""
    if document.prior is None:
        return []
    shares = [share_text(document.prior.parameters[name]) for name in names]
    return [Column("data %", shares)]


def _further_values(document: ResultDocument, listed: Sequence[tuple[str, ParameterResult]]) -> list[Column]:
    """The start values that led to the answer, and the values of the robot description."""
    columns: dict[str, dict[str, float | None]] = {}
    begins = [k for k in range(len(document.history)) if k == 0 or document.history[k - 1].restarts]
    if begins:
        columns["start"] = dict(document.history[begins[-1]].parameters)
    described = {name: p.described for name, p in document.parameters.items()}
    if any(described.values()) and not document.outputs:  # of which it is the start
        columns["by description"] = described
    return [
        numbers(
            head,
            [MISSING if (v := values.get(name)) is None else rounding(p.value, p.std).text(v) for name, p in listed],
            shown="page",
        )
        for head, values in columns.items()
    ]


def _bar(percent: float | None) -> Bar | None:
    if percent is None:
        return None
    low, high = BAR_RANGE
    length = 100.0 * math.log(min(max(percent, low), high) / low) / math.log(high / low)
    grade = next((grade for limit, grade in GRADES if percent <= limit), "refused")
    return Bar(grade, round(max(length, 2.0), 1))


def _experiments(document: ResultDocument) -> Section:
    """The experiments: data, agreement with the others, and why one could not be simulated."""
    found = document.experiments
    each = list(found.values())
    columns = [
        words("Experiment", list(found), limit=LABEL),
        words("role", [e.role for e in each]),
        Column("samples", [str(e.samples) for e in each]),
        numbers("every s", [f"{1 / e.rate_hz:.6g}" for e in each], page_head="mean interval (s)")
        if document.outputs
        else numbers("Hz", [f"{e.rate_hz:.6g}" for e in each], page_head="rate (Hz)"),
    ]
    for j, (name, unit) in enumerate(zip(document.labels, document.torque_unit, strict=True)):
        head = f"RMS residual, {name} ({pretty_unit(unit)})"
        columns.append(numbers(head, [significant(item_or_none(e.noise_std, j), 2) for e in each], shown="page"))
    notes = ["Estimation: the parameters are fitted to it; validation: it only judges them. RMS residual: root mean "
             f"square of measured − simulated {document.quantity}."]  # fmt: skip
    if any(e.agreement is not None for e in each):
        marks = ["" if e.agreement is None or e.agreement.agrees else " !" for e in each]
        texts = [MISSING if e.agreement is None else significant(e.agreement.p_value, 2) for e in each]
        columns.append(numbers("agreement p", texts, marks=marks, page_head="p-value of its agreement"))
        differences = [
            f"{a.differs_most}, by {a.change_in_std:.1f} σ" if (a := e.agreement) and a.differs_most else MISSING
            for e in each
        ]
        columns.append(words("would differ most", differences, shown="page"))
        notes.append("p-value: probability of as much disagreement with the other fitted experiments on shared "
                     "parameters, by noise alone. !: too small to be chance.")  # fmt: skip
    if any(e.own for e in each):
        own = [", ".join(name.removesuffix(f"[{label}]") for name in e.own) for label, e in found.items()]
        columns.append(words("own", own, shrinks=True, page_head="own parameters"))
    if any(e.initial_state.kind not in ("reference", "model") for e in each):
        columns.append(
            words("starts", [experiments.start_text(e) for e in each], shrinks=True, page_head="initial state")
        )
        notes.append("Initial state: given by the case, found by the first part of a held-out log, or free, then among "
                     f"the parameters; else that of the {'model' if document.outputs else 'reference'}.")  # fmt: skip
    if any(e.failure for e in each):
        columns.append(words("failure", [e.failure or MISSING for e in each], shown="page"))
    table = Table(columns, shown="page" if experiments.is_short_form(document) else "both")
    return Section("Experiments", [table, *map(note, notes)], anchor="experiments")


def _torque(document: ResultDocument) -> Section:
    """Relative errors and noise: a line a joint in the short form, else a line an experiment."""
    first = 1 if len(document.outputs) == 1 else 0  # of one output its own error says it all
    errors = [(label, values[first:]) for label, values in experiments.error_rows(document)]
    heads, head = ["total", *document.labels][first:], capitalised(document.quantity)
    noise = noise_text(document.noise_std, document.torque_unit, document.labels)
    blocks: list[Block] = []
    if experiments.is_short_form(document):
        columns = [numbers(f"{label} %", [significant(v) for v in values]) for label, values in errors]
        if noise:
            columns.append(_noise_column(document, [""][first:]))
        if columns:
            blocks.append(Table([words(head, heads), *columns]))
    elif errors:
        columns = [words(head, [label for label, _ in errors], limit=LABEL)]
        for j, name in enumerate(heads):
            columns.append(numbers(f"{name} %", [significant(values[j]) for _, values in errors]))
        blocks += [Table(columns), Text(f"noise σ: {noise}" if noise else "")]
    size = "|measured − its mean| in %" if document.outputs else "|measured| in %"
    blocks.append(note(f"Relative error 100 |measured − simulated| / {size}. Noise σ of the fit: the standard "
                       "deviation of its residual."))  # fmt: skip
    return Section("Outputs" if document.outputs else "Torque", blocks, anchor=document.quantity)


def _noise_column(document: ResultDocument, above: Sequence[str]) -> Column:
    joints = range(len(document.torque_unit))
    texts = decimal_aligned([*above, *(significant(item_or_none(document.noise_std, j), 2) for j in joints)])
    units = [*above, *(pretty_unit(unit) for unit in document.torque_unit)]
    width = max(map(len, units))
    return Column("noise σ", [f"{text} {unit:{width}}" for text, unit in zip(texts, units, strict=True)])


def _model(document: ResultDocument) -> Section:
    """The figures of the fit, a line each."""
    if document.status == "refused":
        return Section("Model", [], anchor="model")
    strong = document.correlations[:SHOWN_CORRELATIONS]
    pairs = ", ".join(f"{a}-{b} {value:+.3f}" for a, b, value in strong)
    hidden = len(document.correlations) - len(strong)
    facts = [
        Fact("Condition number", significant(document.condition_number)),
        Fact("Iterations", iteration_count(document) + (" (main + finish)" if document.finish_iterations else "")),
        Fact("Correlations > 0.9", (pairs or "none") + (f", {hidden} more in the report" if hidden else "")),
    ]
    notes = []
    if document.integration_error is not None:
        text = percentage(100 * document.integration_error) + f" of the {document.quantity}"
        if document.integration_shift is not None:
            text += f", {significant(document.integration_shift)} σ of a value"
        if document.integration is not None:
            text += f" ({document.integration.substeps} steps a tick)"
        facts.append(Fact("Integration error", text))
        method = f" Its method: {document.integration.method}." if document.integration is not None else ""
        whole = "model" if document.outputs else "plant"
        notes.append(note(f"Integration error: what halving the integration step of the {whole} changes.{method}"))
    if document.consistency is not None:
        facts.append(Fact("Plant's equations", consistency_line(document)))
    return Section("Model", [Facts(facts), *notes], anchor="model")


def _regrouping(document: ResultDocument) -> list[Section]:
    """What regroups into what; nothing of a model, whose parameters stand for themselves."""
    if document.outputs:
        return []
    items = Items(document.regrouping, is_code=True, empty="No parameters are regrouped.")
    return [Section("Regrouping", [items], has_title=True)]


def _plant(document: ResultDocument) -> Section:
    """How the plant differs from the robot description."""
    found = document.consistency
    if found is None:
        return Section("", [])
    columns = found.columns
    each = list(columns.values())
    table = Table([
        words("parameter", list(columns)), Column("difference", [significant(c.difference, 2) for c in each]),
        Column("cosine", [significant(c.cosine, 6) for c in each]),
        Column("size in the plant", [significant(c.size, 4) for c in each]),
        Column("joint", [str(c.joint) for c in each]),
    ])  # fmt: skip
    folded = Folded("Columns of the regressor, from the plant against from the description", table)
    warned = [] if found.agrees else [Items(found.warnings, shown="page")]
    said = Text(f"{capitalised(consistency_line(document))}.", shown="page")
    return Section("Plant and robot description", [said, *warned, folded])


def _correlations(document: ResultDocument) -> list[Section]:
    names = list(document.parameters)
    if len(document.correlation) != len(names) or len(names) < 2:
        return []
    drawn = matrix("Correlations", names, dict(zip(names, document.correlation, strict=True)), largest=1.0)
    text = ("Near +1 only the difference of two parameters is known, near −1 only their sum. Orange: positive, blue: "
            "negative.")  # fmt: skip
    pairs = [words("pair", [f"{a} – {b}" for a, b, _ in document.correlations]),
             Column("correlation", [f"{value:+.3f}" for *_, value in document.correlations])]  # fmt: skip
    strong = Table(pairs, shown="page") if document.correlations else Items([], empty="None.", shown="page")
    return [Section("Correlations", [note(text), drawn], anchor="correlations"), Section("Above 0.9", [strong])]


def _stages(document: ResultDocument) -> Section:
    """Value and standard deviations at the end of each stage."""
    names = list(document.parameters)
    columns = [words("parameter", names)]
    for stage, content in document.stages.items():
        digits = {name: rounding(v, content.std.get(name, 0.0)) for name, v in content.value.items()}
        values = [digits[n].text(content.value[n]) if n in digits else MISSING for n in names]
        columns.append(numbers(f"{stage}: value", values))
        kinds = {"σ, corrected formula" if content.formulas else "σ": content.std}
        kinds |= {FORMULAS.get(name, name): deviations for name, deviations in content.formulas.items()}
        for head, deviations in kinds.items():
            texts = [_deviation(digits.get(n), deviations.get(n)) for n in names]
            columns.append(numbers(f"{stage}: {head}", texts))
    columns.append(words("unit", [experiments.shown_unit(p) or MISSING for p in document.parameters.values()]))
    text = ("Values and standard deviations at the end of each stage; the Cramér-Rao bound is the smallest that an "
            "unbiased estimator can have with values and noise of that stage. A later stage estimates both anew "
            "and may attain the bound, so that its σ can be a little below the one that stands before it.")  # fmt: skip
    return Section("Stages", [note(text), Table(columns, shown="page")] if document.stages else [], anchor="stages")


def _deviation(digits: Rounding | None, std: float | None) -> str:
    return MISSING if digits is None or std is None else digits.deviation(std)


def _iterations(document: ResultDocument) -> list[Section]:
    """Errors, changes and notes of the iterations."""
    history = document.history
    if not history:
        return []
    labels = [f"{it.stage} {it.number}" for it in history]
    table = Table([
        words("iteration", labels),
        numbers(f"{document.quantity} error (%)", [significant(it.relative_error_percent, 5) for it in history]),
        numbers("relative change", [significant(it.change, 2) for it in history]),
        numbers("condition number", [significant(it.condition_number) for it in history]),
        words("note", [it.note for it in history]),
    ], shown="page")  # fmt: skip
    names = list(dict.fromkeys(name for it in history for name in it.parameters))
    columns = [words("parameter", names)]
    for label, it in zip(labels, history, strict=True):
        values = [it.parameters.get(name) for name in names]
        columns.append(Column(label, [MISSING if v is None else f"{v:.6g}" for v in values]))
    folded = Folded("Parameters simulated in each iteration", Table(columns))
    return [
        Section("Iterations", [Charts([history_chart(history, document.quantity)]), table, folded], anchor="iterations")
    ]


def _loop(document: ResultDocument) -> Section:
    blocks: list[Block] = [
        Drawing(loop_diagram(document.loop)), Items(loop_lines(document.loop), shown="page"),
        Folded("All of it", Tree(document.loop), is_printed=False),
    ]  # fmt: skip
    name = "Simulation" if document.outputs else "Loop"
    return Section(name, blocks, anchor=name.lower())
