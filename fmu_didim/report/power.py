"""What a valid verdict excludes, and what is taken on trust."""

from __future__ import annotations

from fmu_didim.checks.power.statement import PowerResult, StatedResult, TrustResult
from fmu_didim.report.numbers import significant
from fmu_didim.report.sections import Block, Column, Section, Table, Text, note, words

FEW = 4
"""[kinds] Of misfits that the terminal names: those that are bounded most closely."""


def power_sections(verdict: str, power: PowerResult | None) -> list[Section]:
    """What a valid verdict excludes, and what is taken on trust; empty where the verdict is another one."""
    if verdict != "valid":
        return []
    if power is None:
        text = "Not stated: the plant gives no velocities, or the residual is not that of a simulated torque."
        return [Section("What valid excludes", [Text(text, shown="page")], anchor="power")]
    brief = Text(_brief(power), shown="terminal")
    return [
        Section("What valid excludes", [brief, *_stated(power)], anchor="power", is_brief=True),
        Section("Taken on trust", _trusted(power), is_brief=True),
    ]  # fmt: skip


def _stated(power: PowerResult) -> list[Block]:
    listed = power.stated
    table = Table([
        words("the machine has", [s.what for s in listed], shrinks=True),
        words("where", [s.place or "whole machine" for s in listed]),
        Column("above", [_size(s.size, s.largest) for s in listed]),
        words("unit", [s.unit if s.size is not None else "" for s in listed]),
        words("at", [_values(s) for s in listed], shrinks=True),
        words("below it moves up to", [_moves(s) for s in listed], shrinks=True),
    ], shown="page")  # fmt: skip
    text = (
        f"A misfit of this size would have been doubted with a probability of about {100 * power.power:.0f} %; a "
        "smaller one may be there, and the values absorb it: the one that is moved most is named, by how many of its "
        "standard deviations (sigma) and by which part of the value. To first order, by the test of the residual for "
        "what follows the motion; other checks may see more. Of the peak torque: the largest torque of the effect over "
        "that of the joint."
    )
    return [note(text), table]


def _trusted(power: PowerResult) -> list[Block]:
    listed = power.trusted
    table = Table([
        words("what", [t.what for t in listed], shrinks=True),
        words("where", [t.place or "whole machine" for t in listed]),
        Column("seen above", [_seen(t) for t in listed]),
        words("moves up to", [_moves(t) for t in listed], shrinks=True),
        words("how to check it", [t.check for t in listed], shrinks=True),
    ], shown="page")  # fmt: skip
    text = (
        "The case says it, and the data do not show an error of it, or only one above this size; below it the value "
        "that is named may be off by so many of its standard deviations (sigma)."
    )
    return [note(text), table]


def _size(size: float | None, largest: float) -> str:
    return f"not up to {largest:g}" if size is None else significant(size, 2)


def _seen(one: TrustResult) -> str:
    return "not at all" if one.size is None else f"{significant(one.size, 2)} {one.unit}"


def _moves(one: StatedResult | TrustResult) -> str:
    """The value that is moved most, at the size from which it shows, or by one unit."""
    if one.moves is None:
        return ""
    return one.moves.text if one.size is not None else f"{one.moves.text} for each {one.unit}"


def _values(stated: StatedResult) -> str:
    """The parameters of an effect at its stated size."""
    if stated.size is None:
        return ""
    return ", ".join(f"{name} = {value:.3g}" for name, value in stated.parameters.items())


def _brief(power: PowerResult) -> str:
    """The kinds that are bounded most closely, each by its worst joint; with its place where others show nothing."""
    kinds: dict[str, list[StatedResult]] = {}
    for stated in power.stated:
        kinds.setdefault(stated.what, []).append(stated)
    found = []
    for group in kinds.values():
        seen = [(s.size, s) for s in group if s.size is not None]
        if seen:
            size, worst = max(seen, key=lambda pair: pair[0])
            where = f" ({worst.place})" if len(seen) < len(group) else ""
            text = f"{worst.what}{where} above {significant(size, 2)} {worst.unit}"
            found.append((size / worst.largest, text))
    texts = ", ".join(text for _, text in sorted(found)[:FEW])
    return f"Excluded with {100 * power.power:.0f} % power: {texts}; more in the report." if texts else ""
