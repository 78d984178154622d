"""Profiles of parameters: interval beside the linear one, and what moves along."""

from __future__ import annotations

from fmu_didim.report.drawing.profile_charts import profile_chart
from fmu_didim.report.numbers import MISSING, pretty_unit, rounding
from fmu_didim.report.sections import Block, Charts, Column, Section, Table, note, words
from fmu_didim.results.result import ResultDocument
from fmu_didim.results.searches import ProfileResult

ENDS = {
    "reached": "", "limit": "at its limit", "open": "open", "failed": "cannot be simulated beyond",
    "lower": "another minimum",
}  # fmt: skip


def profile_sections(document: ResultDocument) -> list[Section]:
    """The intervals by profiles, and their charts; empty where none were asked for."""
    found = {name: one for name, one in document.profiles.items() if name in document.parameters}
    if not found:
        return []
    listed = [(name, document.parameters[name], one) for name, one in found.items()]
    columns = [
        words("parameter", list(found), marks=[" !" if one.is_bent else "" for one in found.values()]),
        Column("linear 95 %", ["  ".join(map(rounding(p.value, p.std).text, one.linear)) for _, p, one in listed]),
        Column("profile 95 %", ["  ".join(interval_texts(document, name)) for name in found]),
        words("unit", [pretty_unit(p.unit) or MISSING for _, p, _ in listed]),
        words("ends", [_ends(one) or "–" for one in found.values()]),
    ]
    charts = [profile_chart(name, k, one, document.parameters) for k, (name, _, one) in enumerate(listed, start=1)]
    blocks: list[Block] = [
        Table(columns),
        Charts(charts, in_grid=True),
        note(
            "Chi-square: misfit above that of the answer with the parameter held there and all others fitted anew, in "
            "squares of the noise with its colour. Dotted: where the 95 % interval ends. Dashed: linear theory. A "
            "curve that stays low is a flat direction: the data do not bound the parameter there. !: differs from the "
            "linear interval by more than a third."
        ),
    ]
    return [Section("Profiles", blocks, anchor="profiles", has_title=True)]


def interval_texts(document: ResultDocument, name: str) -> tuple[str, str]:
    """The ends of the interval of a parameter: those of its profile where it has one."""
    p = document.parameters[name]
    low, high = document.profiles[name].interval if name in document.profiles else p.interval
    text = rounding(p.value, p.std).text
    return MISSING if low is None else text(low), MISSING if high is None else text(high)


def _ends(one: ProfileResult) -> str:
    said = [f"{side} {ENDS[end]}" for side, end in zip(("below", "above"), one.ends, strict=True) if ENDS[end]]
    return ", ".join(said)
