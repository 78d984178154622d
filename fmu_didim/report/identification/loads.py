"""What the last link carried: mass, centre and inertia."""

from __future__ import annotations

from fmu_didim.report.numbers import MISSING, pretty_unit, rounding
from fmu_didim.report.sections import Block, Section, Table, Text, note, numbers, words
from fmu_didim.results.result import LoadResult, QuantityResult, ResultDocument

STATED = "stated"


def load_sections(document: ResultDocument) -> list[Section]:
    """A table for each load; empty where no experiment carried one."""
    blocks: list[Block] = []
    for label, load in document.loads.items():
        blocks += _of_one(", ".join([label, *load.also]), load)
    if not blocks:
        return []
    blocks.append(note(
        "Centre of mass in the frame of the last link, inertia about that centre with the axes of that frame; "
        "standard deviations to first order from those of the parameters. A load is what its run carries more than "
        "the runs without one."
    ))  # fmt: skip
    return [Section("What the robot carries", blocks, anchor="load", has_title=True)]


def _of_one(label: str, load: LoadResult) -> list[Block]:
    shown = list(load.body.items())
    blocks: list[Block] = []
    if shown:
        blocks.append(Table([
            words(f"load of {label}", [name for name, _ in shown]),
            numbers("value", [rounding(q.value, q.std).text(q.value) if q.std else f"{q.value:.6g}" for _, q in shown]),
            numbers("\u03c3", [_deviation(q) for _, q in shown]),
            words("unit", [pretty_unit(q.unit) or MISSING for _, q in shown]),
        ]))  # fmt: skip
    if load.unseen:
        blocks.append(Text(f"Not seen by any torque of this robot: {', '.join(load.unseen)} of the load."))
    return blocks


def _deviation(quantity: QuantityResult) -> str:
    return rounding(quantity.value, quantity.std).deviation(quantity.std) if quantity.std else STATED
