"""A saved discovery as one HTML file that needs no network: what was found, and the residual before and after."""

from __future__ import annotations

from functools import partial
from pathlib import Path, PurePosixPath
from urllib.parse import quote

from markupsafe import Markup
from plotly.offline import get_plotlyjs

from fmu_didim.discovery.findings import FindingResult, FindingsDocument, ValueFound, load_findings
from fmu_didim.report import discovery_figures as figures
from fmu_didim.report import discovery_words as words
from fmu_didim.report.discovery_regions import regions_by_joint
from fmu_didim.report.discovery_verdict import verdict_of
from fmu_didim.report.figures import Plots, points_per_trace, signals_note
from fmu_didim.report.numbers import MISSING, at, joint_unit, pretty_unit, significant
from fmu_didim.report.tables import Table, table
from fmu_didim.report.templates import write_page
from fmu_didim.tables import read_trajectory

DISCOVERY_FILE = "discovery.html"
TEMPLATE = "discovery.html.j2"
TRACES_PER_JOINT = 2


def write_discovery_report(folder: Path | str) -> Path:
    """Write ``discovery.html`` beside the ``findings.json`` of a folder and return its path.

    Raises:
        InputError: there is no saved discovery, or a table of torques that it names is missing.
    """
    folder = Path(folder)
    document = load_findings(folder)
    return write_page(
        folder / DISCOVERY_FILE,
        TEMPLATE,
        document=document,
        verdict=verdict_of(document),
        cards=_headline(document),
        gap_figure=figures.gap_figure(document) if document.gap and document.torque_unit else None,
        words=words,
        facts=partial(_facts, document),
        values=_values,
        link=_link,
        rounds=_rounds(document),
        candidates=_candidates(document),
        plots=_plots(document, folder),
        places=regions_by_joint(document),
        regions=_regions(document),
        noise=_noise(document),
        plotly=Markup(get_plotlyjs()),
    )


def _headline(document: FindingsDocument) -> list[tuple[str, str]]:
    """The figures at the top: a head and a value each."""
    changed = bool(document.findings)
    cards = [("effects named", str(len(document.findings)))]
    for label, pair in document.gap.items():
        cards.append((f"gap / noise, {words.experiment_name(document, label)}", words.step_text(pair, changed=changed)))
    if document.ratio_interval is not None:
        cards.append(("held-out RMS over the base model's, 95 %", words.interval_text(document.ratio_interval)))
    for label, errors in document.error_percent.items():
        cards.append(
            (f"torque error, {words.experiment_name(document, label)}", words.error_text(*errors, changed=changed))
        )
    cards.append(("time taken", f"{significant(document.seconds)} s"))
    return cards


def _facts(document: FindingsDocument, finding: FindingResult) -> list[tuple[str, str]]:
    """What a finding is worth: a head and a value each."""
    facts = [("share of the gap", words.share_text(finding.share_of_gap))]
    for label, pair in finding.gap.items():
        facts.append((f"gap, {words.experiment_name(document, label)}", words.step_text(pair)))
    facts.append(("held-out RMS ratio, 95 %", words.interval_text(finding.ratio_interval)))
    facts.append(("gain in BIC", significant(finding.delta_bic)))
    return facts


def _values(values: list[ValueFound]) -> Table | None:
    rows = [(t.name, t.value, t.std, t.percent, *t.interval, t.unit or MISSING) for t in map(words.value_text, values)]
    return table(("parameter", "value", "± σ", "σ / |value| (%)", "95 % from", "to", "unit"), rows, (0, 6))


def _rounds(document: FindingsDocument) -> Table | None:
    """Round by round, the gap of each experiment before and after; last, base against final model."""
    labels = list(document.gap)
    if not document.findings:
        return None
    heads = ["round", "added", "share of the gap", "gain in BIC"]
    heads += [f"gap, {words.experiment_name(document, label)}" for label in labels] + ["held-out RMS ratio, 95 %"]
    rows = [
        (
            str(number), words.named(f),
            words.share_text(f.share_of_gap), significant(f.delta_bic),
            *(words.step_text(f.gap.get(label)) for label in labels), words.interval_text(f.ratio_interval),
        )
        for number, f in enumerate(document.findings, start=1)
    ]  # fmt: skip
    rows.append(
        ("all", "base → final model", "", "", *(words.step_text(document.gap[label]) for label in labels),
         words.interval_text(document.ratio_interval))
    )  # fmt: skip
    return table(heads, rows, (0, 1), is_aligned=False)


def _candidates(document: FindingsDocument) -> Table | None:
    rows = [
        (
            str(c.round),
            words.placed(c.effect, c.joint),
            c.outcome,
            MISSING if c.delta_bic is None else significant(c.delta_bic),
        )
        for c in document.candidates
    ]
    return table(("round", "candidate", "outcome", "gain in BIC"), rows, (0, 1, 2))


def _plots(document: FindingsDocument, folder: Path) -> list[Plots]:
    units = document.torque_unit
    names = {key: name for key, name in document.files.items() if key.startswith(words.SIGNALS)}
    limit = points_per_trace(TRACES_PER_JOINT * len(units) * len(names))
    plots: list[Plots] = []
    for key, name in names.items():
        signals = read_trajectory(folder / name)
        joints = figures.drawn_joints(signals, len(units))
        if not joints:
            continue
        over_time = figures.residual_figure(signals, units, document.noise.std, limit=limit)
        panels = [
            figures.binned_figure(signals, j, quantity, units[j - 1])
            for j in (joints if not plots else ())  # once, for the data in which the regions were found
            for quantity in figures.panel_quantities(document, signals, j)
        ]
        name = words.experiment_name(document, key.removeprefix(words.SIGNALS))
        note = signals_note(signals.time, limit)
        plots.append(Plots(name, note, over_time, panels))
    return plots


def _regions(document: FindingsDocument) -> Table | None:
    rows = [
        (
            f"joint {r.joint}", r.quantity, significant(r.low), significant(r.high), pretty_unit(r.unit) or MISSING,
            significant(r.mean), joint_unit(document.torque_unit, r.joint - 1) or MISSING,
            significant(100 * r.share_of_gap), significant(r.p_value, 2) if r.p_value > 0 else "< 1e-300",
        )
        for r in document.regions
    ]  # fmt: skip
    heads = ("", "quantity", "from", "to", "unit", "mean residual", "unit", "share of the quantity (%)", "p-value")
    return table(heads, rows, (0, 1, 4, 6, 8))


def _noise(document: FindingsDocument) -> Table | None:
    noise = document.noise
    rows = [
        (
            f"joint {j + 1}", significant(std, 2), joint_unit(document.torque_unit, j) or MISSING,
            significant(at(noise.correlation, j), 2),
        )
        for j, std in enumerate(noise.std)
    ]  # fmt: skip
    return table(("", "noise σ", "unit", "correlation of neighbouring samples"), rows, (0, 2))


def _link(name: str) -> str | None:
    """A link to a file beside the page; none to a place elsewhere."""
    path = PurePosixPath(name)
    return None if path.is_absolute() or ".." in path.parts or ":" in name else f"./{quote(name)}"
