"""A saved discovery as one HTML file that needs no network: what was found, and the residual before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path, PurePosixPath
from urllib.parse import quote

from fmu_didim.report.discovery import words
from fmu_didim.report.discovery.charts import drawn_experiments, friction_charts
from fmu_didim.report.discovery.regions import regions_by_joint
from fmu_didim.report.discovery.verdict import verdict_of
from fmu_didim.report.drawing.charts import limited, points_per_trace
from fmu_didim.report.drawing.diagram import loop_diagram
from fmu_didim.report.html.templates import write_page
from fmu_didim.report.identification.tables import Table, table
from fmu_didim.report.numbers import MISSING, at, joint_unit, loop_lines, pretty_unit, rounding, significant
from fmu_didim.results.findings import CandidateResult, FindingResult, FindingsDocument, ValueFound, load_findings

DISCOVERY_FILE = "discovery.html"
TEMPLATE = "discovery.html.j2"


def write_discovery_report(folder: Path | str) -> Path:
    """Write ``discovery.html`` beside the ``findings.json`` of a folder and return its path.

    Raises:
        InputError: there is no saved discovery, or a table of torques that it names is missing.
    """
    folder = Path(folder)
    document = load_findings(folder)
    found = drawn_experiments(document, folder)
    points = points_per_trace([chart for part in found for chart in part.charts])
    loop = document.provenance.get("loop", {})
    return write_page(
        folder / DISCOVERY_FILE,
        TEMPLATE,
        document=document,
        verdict=verdict_of(document),
        cards=_headline(document),
        gaps=gap_bars(document),
        words=words,
        facts=partial(_facts, document),
        values=_values,
        link=_link,
        rounds=_rounds(document),
        contests=_contests(document),
        parts=[part.limited(points) for part in found],
        friction=[limited(chart, points) for chart in friction_charts(document)],
        places=regions_by_joint(document),
        regions=_regions(document),
        noise=_noise(document),
        parameters=_parameters(document),
        diagram=loop_diagram(loop),
        loop_summary=loop_lines(loop),
    )


@dataclass(frozen=True)
class Bar:
    """One gap: what it is of, its text, and its length in percent of the longest one; ``style``: base or final."""

    name: str
    model: str
    text: str
    length: float
    style: str


def gap_bars(document: FindingsDocument) -> list[tuple[str, list[Bar]]]:
    """Title of each experiment -> gaps of base and final model, over all joints and of each one."""
    several = len(document.torque_unit) > 1
    heads = ["all joints", *(f"joint {j + 1}" for j in range(len(document.torque_unit)))] if several else ["joint 1"]
    models = ("base model", "final model") if document.findings else ("base model",)
    rows: dict[str, list[tuple[str, str, float | None]]] = {}
    for label, pair in document.gap.items():
        before = [*([pair.before] if several else []), *pair.before_per_joint] or [pair.before]
        after = [*([pair.after] if several else []), *pair.after_per_joint] or [pair.after]
        pairs = {"base model": before, "final model": after}
        rows[label] = [(head, model, at(pairs[model], k)) for k, head in enumerate(heads) for model in models]
    longest = max((v for row in rows.values() for *_, v in row if v is not None), default=0.0) or 1.0
    return [
        (
            words.experiment_name(document, label),
            [
                Bar(head, model, words.gap_text(v), round(100 * (v or 0.0) / longest, 1), model.split()[0])
                for head, model, v in row
            ],
        )
        for label, row in rows.items()
    ]


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


def _parameters(document: FindingsDocument) -> Table | None:
    """The parameters of the base model: fitted without the effects, and with them."""
    former = {value.name: value for value in document.base_fit}
    rows = []
    for value in document.base_parameters:
        text, old = words.value_text(value), former.get(value.name)
        before = MISSING if old is None else rounding(old.value, old.std or 0.0).text(old.value)
        moved = MISSING if old is None or not value.std else significant((value.value - old.value) / value.std, 2)
        rows.append((text.name, before, text.value, text.std, *text.interval, moved, text.unit or MISSING))
    heads = ("parameter", "base model", "final model", "± σ", "95 % from", "to", "moved by (σ)", "unit")
    return table(heads, rows, (0, 7))


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


def _contests(document: FindingsDocument) -> list[tuple[int, Table, list[int]]]:
    """Number of each round, its candidates with the best first, and the rows of those that were added."""
    why = {(effect, joint): reason for effect, joint, reason in document.refused}
    found = []
    for number, group in groupby(document.candidates, key=lambda c: c.round):
        ranked = sorted(group, key=lambda c: (not c.accepted, c.delta_bic is None, -(c.delta_bic or 0.0)))
        is_last = number == document.candidates[-1].round
        rows = [_candidate(c, ranked, why.get((c.effect, c.joint), "") if is_last else "") for c in ranked]
        heads = ("candidate", "outcome", "gain in BIC", "behind", "parameters", "share of the gap", "remark")
        made = table(heads, rows, (0, 1, 6))
        if made is not None:
            found.append((number, made, [k for k, c in enumerate(ranked) if c.accepted]))
    return found


def _candidate(candidate: CandidateResult, ranked: Sequence[CandidateResult], reason: str) -> tuple[str, ...]:
    best = max((c.delta_bic for c in ranked if c.delta_bic is not None), default=None)
    gain = candidate.delta_bic
    behind = MISSING if gain is None or best is None else significant(best - gain)
    return (
        words.placed(candidate.effect, candidate.joint), "added" if candidate.accepted else candidate.outcome,
        MISSING if gain is None else significant(gain), behind,
        MISSING if candidate.parameters is None else f"{candidate.parameters:g}",
        words.share_text(candidate.share_of_gap), candidate.implausible or reason,
    )  # fmt: skip


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
