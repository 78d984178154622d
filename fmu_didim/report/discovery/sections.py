"""A saved discovery as a report."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path, PurePosixPath
from string import ascii_lowercase
from urllib.parse import quote

from fmu_didim.report.discovery import texts
from fmu_didim.report.discovery.charts import friction_charts, saved_charts
from fmu_didim.report.discovery.curves import curve_sections
from fmu_didim.report.discovery.regions import regions_by_joint
from fmu_didim.report.discovery.verdict import verdict_of
from fmu_didim.report.drawing.diagram import loop_diagram
from fmu_didim.report.experiment_charts import ExperimentCharts, residual_sections, torque_sections
from fmu_didim.report.numbers import (
    MISSING,
    item_or_none,
    joint_unit,
    loop_lines,
    noise_text,
    pretty_unit,
    rounding,
    significant,
)
from fmu_didim.report.page import notebook_html, write_page
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
    Link,
    Report,
    Section,
    Table,
    Text,
    note,
    numbers,
    words,
)
from fmu_didim.report.terminal import report_text
from fmu_didim.results.findings import (
    CandidateResult,
    FindingResult,
    FindingsDocument,
    GapPair,
    ValueFound,
    load_findings,
    next_rung,
)

DISCOVERY_FILE = "discovery.html"
FILES = {
    "robot": "robot description with the effects", "plant_fmu": "plant with the effects, FMU",
    "reference_next": "proposed next experiment", "experiment_next": "next experiment, lines of a case",
}  # fmt: skip
"""Key of a file -> what it is."""
OF_CURVES = {
    "curve_robot_": "robot description with the curve of joint ", "curve_fmu_": "plant with the curve, FMU, joint ",
    "curve_": "curve with its interval, joint ",
}  # fmt: skip
"""Begin of the key of a file, before the number of the joint -> what it is."""
NAME_WIDTH = 36
"""[characters] Of an effect in the table of gaps; two experiments then have room beside it."""
SHOWN = 6
"""[items] Most windows, refused and untried candidates that the terminal lists."""


def discovery_table(document: FindingsDocument) -> str:
    """The text shown after a discovery; begins with what is missing in the model."""
    return report_text(discovery_report(document))


def discovery_html(document: FindingsDocument) -> str:
    """Verdict, findings and gaps of a discovery, for notebooks."""
    return notebook_html(discovery_report(document))


def write_discovery_report(folder: Path | str) -> Path:
    """Write ``discovery.html`` beside the ``findings.json`` of a folder and return its path.

    Raises:
        InputError: there is no saved discovery, or a table of torques that it names is missing.
    """
    folder = Path(folder)
    document = load_findings(folder)
    return write_page(discovery_report(document, saved_charts(document, folder)), folder / DISCOVERY_FILE)


def discovery_report(document: FindingsDocument, parts: Sequence[ExperimentCharts] = ()) -> Report:
    """All that is shown of a discovery, with the charts of its experiments."""
    changed = bool(document.findings)
    heading = ("Outputs" if document.outputs else "Torque") + " and residual" + (" before and after" if changed else "")
    sections = [
        Section("Findings", [], anchor="findings"),
        *(_finding(document, number, finding) for number, finding in enumerate(document.findings, start=1)),
        *curve_sections(document),
        _gap(document),
        *([] if document.outputs else [_friction(document)]),
        Section(heading, [], anchor="outputs" if document.outputs else "torque"),
        *torque_sections(parts),
        *residual_sections(parts, "What the models leave"),
        *([_windows(document)] if document.outputs else _places(document)),
        _noise(document),
        *_competition(document),
        *_parameters(document),
        *([] if document.outputs else power_sections(document.verdict, document.power)),
        Section("Notes", [Items(document.notes)], anchor="notes", has_title=True),
        _loop(document),
        _files(document),
    ]
    return Report(
        document.name, document.name, verdict_of(document), sections, what="discovery", verdict_first=True,
        subtitles=["Where simulation and measurement disagree, and what the model lacks"], cards=_cards(document),
        provenance=document.provenance,
    )  # fmt: skip


def _cards(document: FindingsDocument) -> list[tuple[str, str]]:
    """The figures at the top: a head and a value each."""
    changed = bool(document.findings)
    cards = [("effects named", str(sum(f.effect != "undecided" for f in document.findings)))]
    for label, pair in document.gap.items():
        title = texts.experiment_name(document, label)
        cards.append((f"gap / noise, {title}", texts.step_text(pair, changed=changed)))
    if document.ratio_interval is not None:
        cards.append(("held-out RMS over the base model's, 95 %", texts.interval_text(document.ratio_interval)))
    for label, errors in document.error_percent.items():
        title = texts.experiment_name(document, label)
        cards.append((f"{_what(document).lower()} error, {title}", texts.error_text(*errors, changed=changed)))
    return [*cards, ("time taken", f"{significant(document.seconds)} s")]


def _what(document: FindingsDocument) -> str:
    """What is compared, in a word."""
    return "Output" if document.outputs else "Torque"


def _finding(document: FindingsDocument, number: int, finding: FindingResult) -> Section:
    """One named effect: values, how much of the gap it closes, what it cannot be told from."""
    facts = [Fact(p.name, texts.value_line(p), shown="terminal") for p in finding.parameters]
    if finding.origin:
        facts.append(Fact("of the motor", finding.origin))
    if finding.part_of:
        facts.append(Fact("may be part of", finding.part_of))
    facts.append(Fact("share of the gap", texts.share_text(finding.share_of_gap)))
    for label, pair in finding.gap.items():
        facts.append(Fact(f"gap, {texts.experiment_name(document, label)}", texts.step_text(pair), shown="page"))
    for label, channels in finding.channels.items():
        title = texts.experiment_name(document, label)
        facts += [Fact(f"gap of {name}, {title}", texts.step_text(pair)) for name, pair in channels.items()]
    if finding.ratio_interval is not None:
        interval = texts.interval_text(finding.ratio_interval)
        facts.append(Fact("held-out RMS", f"{interval} of what it was, 95 % interval"))
    facts.append(Fact("gain in BIC", significant(finding.delta_bic), shown="page"))
    rivals = []
    for r in finding.ambiguous:
        values = "".join(f", {p.name} = {texts.value_line(p)}" for p in r.parameters)
        rivals.append(f"{texts.finding_title(r)} ({texts.behind_text(r, finding)}{values})")
    if finding.effect == "undecided":
        facts += [Fact(f"{number}{letter}", rival) for letter, rival in zip(ascii_lowercase, rivals, strict=False)]
    else:
        facts.append(Fact("cannot be told from", "; ".join(rivals) or "nothing in the catalogue"))
    facts.append(Fact("to split them" if rivals else "to confirm it", finding.experiment))
    facts += _evidence(finding)
    blocks: list[Block] = [Text(finding.equation, "code", "page"), _values(finding.parameters), Facts(facts)]
    if finding.ladder:
        blocks += [Text("Evidence", shown="page"), _ladder(finding)]
    heading = f"{number}  {texts.finding_title(finding)} ({finding.place})"
    return Section(heading, blocks, has_title=True, is_brief=True, is_framed=True)


def _evidence(finding: FindingResult) -> list[Fact]:
    """The ladder as the terminal shows it: the rungs that were reached with their figures, the open ones by name, and
    what would climb the lowest of them."""
    told = [rung for rung in finding.ladder if rung.state != "open" or rung.evidence]
    facts = [
        Fact(texts.rung_title(rung), f"{texts.STATES[rung.state]}: {rung.text}", shown="terminal") for rung in told
    ]
    if left := [texts.rung_title(rung) for rung in finding.ladder if rung not in told]:
        facts.append(Fact("not tried by these data", ", ".join(left), shown="terminal"))
    if rung := next_rung(finding.ladder):
        facts.append(Fact("to say more", rung.next_step, shown="terminal"))
    return facts


def _ladder(finding: FindingResult) -> Table:
    """The rungs of the evidence ladder, the lowest first."""
    rungs = finding.ladder
    return Table([
        words("rung", [texts.rung_title(rung) for rung in rungs]),
        words("seen", [texts.STATES[rung.state] for rung in rungs]),
        words("why", [rung.text for rung in rungs]), words("what would climb it", [rung.next_step for rung in rungs]),
    ], shown="page")  # fmt: skip


def _values(values: Sequence[ValueFound]) -> Table:
    shown = [texts.value_text(value) for value in values]
    columns = [
        words("parameter", [t.name for t in shown]), numbers("value", [t.value for t in shown]),
        numbers("± σ", [t.std for t in shown]), numbers("σ / |value| (%)", [t.percent for t in shown]),
        numbers("95 % from", [t.interval[0] for t in shown]), numbers("to", [t.interval[1] for t in shown]),
        words("unit", [t.unit or MISSING for t in shown]),
    ]  # fmt: skip
    return Table(columns, shown="page")


def _gap(document: FindingsDocument) -> Section:
    """Round by round, then base against final model: over all joints and of each one."""
    labels = list(document.gap)
    changed = bool(document.findings)
    final = [document.gap[label] for label in labels]
    found = document.findings
    rows: list[tuple[str, list[GapPair | None]]] = [
        (f"{number}  {texts.finding_title(f)}", [f.gap.get(label) for label in labels])
        for number, f in enumerate(found, start=1)
    ]
    rows.append(("base → final model" if changed else "base model", list(final)))
    joints = len(document.torque_unit) if len(document.torque_unit) > 1 else 0
    for j in range(joints):
        own = [(item_or_none(pair.before_per_joint, j), item_or_none(pair.after_per_joint, j)) for pair in final]
        steps = [GapPair(before=b, after=a, before_per_joint=[b], after_per_joint=[a]) for b, a in own]
        rows.append((f"   {texts.output_title(document, j)}", list(steps)))
    sizes = [v for _, pairs in rows for p in pairs if p for v in (p.before, p.after) if v is not None]
    longest = max(sizes, default=0.0)
    columns = [words("Gap, in times the noise".ljust(NAME_WIDTH), [name for name, _ in rows], limit=NAME_WIDTH)]
    for k, label in enumerate(labels):
        pairs = [pairs[k] for _, pairs in rows]
        shown = [texts.step_text(pair, changed=changed) for pair in pairs]
        columns.append(Column(label, shown, bars=[_bar(pair, longest) for pair in pairs]))
    if changed:
        rest = [""] * joints
        shares = [*(texts.share_text(f.share_of_gap) for f in found), "", *rest]
        gains = [*(significant(f.delta_bic) for f in found), "", *rest]
        ratios = [*(texts.interval_text(f.ratio_interval) for f in found), texts.interval_text(document.ratio_interval)]
        columns += [Column("share of the gap", shares, shown="page"), Column("gain in BIC", gains, shown="page"),
                    Column("held-out RMS ratio, 95 %", [*ratios, *rest], shown="page")]  # fmt: skip
    blocks: list[Block] = [Table(columns)] if labels else []
    if changed:
        blocks.append(Text("█ what remains, ░ what was closed", shown="terminal"))
    blocks.append(note(
        "Model error in times the noise: √(mean residual² / σ² − 1). 1: an error as large as the noise. Bars: what "
        "remains is full, what was closed is hatched. Each round adds one effect and fits all parameters again. A "
        "held-out RMS ratio below 1 says that the effect helps on data that it was not fitted to."
    ))  # fmt: skip
    return Section("Gap", blocks if labels else [], anchor="gap")


def _bar(pair: GapPair | None, longest: float) -> Bar | None:
    """What remains, and up to what it was, against the longest one."""
    if pair is None or pair.after is None or longest <= 0:
        return None
    before = pair.after if pair.before is None else pair.before
    return Bar("final", 100 * pair.after / longest, 100 * before / longest)


def _friction(document: FindingsDocument) -> Section:
    text = ("All of the joint that depends on its velocity alone, over the velocities of the motion; the band is the "
            "95 % interval of the final model.")  # fmt: skip
    return Section("Friction", [note(text), Charts(friction_charts(document), in_grid=True)], anchor="friction")


def _places(document: FindingsDocument) -> list[Section]:
    """Where and when the base model disagrees."""
    regions = document.regions
    table = Table([
        words("", [f"joint {r.joint}" for r in regions]), words("quantity", [r.quantity for r in regions]),
        numbers("from", [significant(r.low) for r in regions]), numbers("to", [significant(r.high) for r in regions]),
        words("unit", [pretty_unit(r.unit) or MISSING for r in regions]),
        numbers("mean residual", [significant(r.mean) for r in regions]),
        words("unit", [joint_unit(document.torque_unit, r.joint - 1) or MISSING for r in regions]),
        numbers("share of the quantity (%)", [significant(100 * r.share_of_gap) for r in regions]),
        words("p-value", [significant(r.p_value, 2) if r.p_value > 0 else "< 1e-300" for r in regions]),
    ])  # fmt: skip
    text = (
        "All regions: bins whose mean residual is not noise, with the false-discovery rate controlled over all bins of "
        "all joints. Share: part of the model error of the joint that the means of all bins of the quantity explain."
    )
    where = Items(regions_by_joint(document), empty="No region with a mean residual of its own.")
    return [
        Section("Where the base model disagrees", [where, Folded("All regions", table), note(text)], anchor="where",
                has_title=True),
        _windows(document),
    ]  # fmt: skip


def _windows(document: FindingsDocument) -> Section:
    """When something acted that the final model does not have."""
    units = {**{name: joint_unit(document.torque_unit, j) for j, name in enumerate(document.outputs)},
             **{name: pretty_unit(channel.unit) for name, channel in document.channels.items()}}  # fmt: skip
    windows = [
        f"{w.signal or f'joint {w.joint}'}: {texts.edge(w.begin_s, w.begin_interval)} to "
        f"{texts.edge(w.end_s, w.end_interval)}, {significant(w.torque, 2)} "
        f"{units[w.signal] if w.signal else joint_unit(document.torque_unit, w.joint - 1)} "
        f"({significant(w.score, 2)} standard deviations), {w.experiment}"
        for w in document.windows
    ]
    title = "Windows of time " + ("in which an output is off" if document.outputs else "with a torque of their own")
    after = "In what the final model leaves." + (texts.OUTPUT_WINDOWS if document.outputs else "")
    return Section(
        title, [Items(windows, limit=SHOWN, empty="None."), *([note(after)] if windows else [])], has_title=True
    )


def _noise(document: FindingsDocument) -> Section:
    """Noise, errors and time, a line each."""
    noise, changed = document.noise, bool(document.findings)
    facts = []
    if noise.std:
        source = {"residual": "residual above the frequencies of the motion"}.get(noise.source, noise.source)
        if noise.source == "periods" and noise.period_s is not None:
            source = f"difference of {noise.periods} periods of {significant(noise.period_s)} s"
        facts.append(Fact("Noise σ", f"{noise_text(noise.std, document.torque_unit, document.outputs)} ({source})"))
    if noise.correlation:
        correlations = [f"joint {j} {significant(value, 2)}" for j, value in enumerate(noise.correlation, start=1)]
        facts.append(Fact("Correlation of neighbouring samples", ", ".join(correlations), shown="page"))
    for name, channel in document.channels.items():
        sigma = f"noise σ {significant(channel.std, 2)} {pretty_unit(channel.unit)}"
        steps = [
            f"{texts.experiment_name(document, label)} {texts.step_text(pair, changed=changed)}"
            for label, pair in channel.gap.items()
        ]
        facts.append(Fact(name, f"{sigma}; gap / noise {', '.join(steps)}"))
    errors = [
        f"{texts.experiment_name(document, label)} {texts.error_text(*pair, changed=changed)}"
        for label, pair in document.error_percent.items()
    ]
    if errors:
        facts.append(Fact(f"{_what(document)} error", ", ".join(errors)))
    if document.ratio_interval is not None:
        interval = texts.interval_text(document.ratio_interval)
        facts.append(Fact("Held-out RMS", f"{interval} of the base model's, 95 % interval"))
    facts.append(Fact("Time taken", f"{significant(document.seconds)} s"))
    return Section("Noise and errors", [Facts(facts)], anchor="noise")


def _competition(document: FindingsDocument) -> list[Section]:
    """The candidates of each round with the best first, and those that were not added or not tried."""
    why = {(effect, joint): reason for effect, joint, reason in document.refused}
    where = "beside all that is identified" if document.outputs else "in the closed loop"
    text = (
        f"The candidates that were fitted {where}, round by round. A fit was left early when it could not "
        "reach the best of its round; its gain is that of the point where it was left. Behind: BIC difference to the "
        "best; within 10 the data cannot decide."
    )
    found = [Section("Competition", [note(text)] if document.candidates else [], anchor="competition")]
    for number, group in groupby(document.candidates, key=lambda c: c.round):
        ranked = sorted(group, key=lambda c: (not c.accepted, c.delta_bic is None, -(c.delta_bic or 0.0)))
        is_last = number == document.candidates[-1].round
        found.append(Section(f"Round {number}", [_round(ranked, why if is_last else {})]))
    untried = document.unfinished.untried if document.unfinished is not None else []
    refused = [f"{texts.candidate_title(effect, joint)}: {reason}" for effect, joint, reason in document.refused]
    return [
        *found,
        Section("Not accepted", [Items(refused, limit=SHOWN)], has_title=True),
        Section("Not tried", [Items([texts.candidate_title(*at) for at in untried], limit=SHOWN)], has_title=True),
    ]


def _round(ranked: Sequence[CandidateResult], why: dict[tuple[str, int], str]) -> Table:
    gains = [c.delta_bic for c in ranked]
    best = max((gain for gain in gains if gain is not None), default=0.0)
    behind = [MISSING if gain is None else significant(best - gain) for gain in gains]
    columns = [
        words("candidate", [texts.candidate_title(c.effect, c.joint, c.signal) for c in ranked]),
        words("outcome", ["added" if c.accepted else c.outcome for c in ranked]),
        numbers("gain in BIC", [significant(gain) for gain in gains]), numbers("behind", behind),
        numbers("parameters", [MISSING if c.parameters is None else f"{c.parameters:g}" for c in ranked]),
        numbers("share of the gap", [texts.share_text(c.share_of_gap) for c in ranked]),
        words("remark", [c.implausible or why.get((c.effect, c.joint), "") for c in ranked]),
    ]  # fmt: skip
    return Table(columns, shown="page", chosen=[k for k, c in enumerate(ranked) if c.accepted])


def _parameters(document: FindingsDocument) -> list[Section]:
    """The parameters of the base model: fitted without the effects, and with them."""
    former = {value.name: value for value in document.base_fit}
    values = document.base_parameters
    before, moved = [], []
    for value in values:
        old = former.get(value.name)
        before.append(MISSING if old is None else rounding(old.value, old.std or 0.0).text(old.value))
        moved.append(MISSING if old is None or not value.std else significant((value.value - old.value) / value.std, 2))
    shown = [texts.value_text(value) for value in values]
    columns = [
        words("parameter", [t.name for t in shown]), numbers("base model", before),
        numbers("final model", [t.value for t in shown]), numbers("± σ", [t.std for t in shown]),
        numbers("95 % from", [t.interval[0] for t in shown]), numbers("to", [t.interval[1] for t in shown]),
        numbers("moved by (σ)", moved), words("unit", [t.unit or MISSING for t in shown]),
    ]  # fmt: skip
    text = (
        "Fitted without the effects, and with them. A parameter that moved by many σ had made up for a missing effect."
    )
    regrouping = Items(document.regrouping if values else [], is_code=True, shown="page")
    return [
        Section("Parameters of the base model", [note(text), Table(columns, shown="page")], anchor="parameters"),
        Section("Regrouping", [regrouping]),
    ]


def _loop(document: FindingsDocument) -> Section:
    loop = {} if document.outputs else document.provenance.get("loop", {})
    drawn = loop_diagram(loop)
    blocks: list[Block] = [Drawing(drawn), Items(loop_lines(loop), shown="page")] if drawn is not None else []
    return Section("Loop of the base model", blocks, anchor="loop")


def _files(document: FindingsDocument) -> Section:
    kinds = {texts.SIGNALS: "torques, ", texts.SIMULATED: "simulated torques, every control period, "}
    if document.outputs:
        kinds = {texts.SIGNALS: "outputs, ", texts.SIMULATED: "simulated outputs, every step, "}
    kinds |= OF_CURVES
    titles = [
        next((f"{kinds[k]}{key.removeprefix(k)}" for k in kinds if key.startswith(k)), FILES.get(key, key))
        for key in document.files
    ]
    links = [Link(name, _target(name)) for name in document.files.values()]
    return Section("Files", [Items(titles, links)], anchor="files", has_title=True)


def _target(name: str) -> str:
    """The address of a file beside the page; empty for a place elsewhere."""
    path = PurePosixPath(name)
    return "" if path.is_absolute() or ".." in path.parts or ":" in name else f"./{quote(name)}"
