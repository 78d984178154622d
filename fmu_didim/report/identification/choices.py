"""A virtual controller: what other choices than the one that was made do to each value."""

from __future__ import annotations

from fmu_didim.report import experiments
from fmu_didim.report.numbers import MISSING, rounding
from fmu_didim.report.sections import Block, Section, Table, Text, note, numbers, words
from fmu_didim.results.result import ResultDocument


def choice_sections(document: ResultDocument) -> list[Section]:
    """Shifts by other choices beside the standard deviation of the noise alone; empty where the controller is known."""
    found = document.choices
    if found is None:
        return []
    names = list(found.noise_std)
    listed = [document.parameters[name] for name in names]
    digits = {name: rounding(p.value, p.std) for name, p in zip(names, listed, strict=True)}
    columns = [
        words("parameter", names),
        numbers("value", [digits[name].text(p.value) for name, p in zip(names, listed, strict=True)]),
        numbers("σ noise", [digits[name].deviation(found.noise_std[name] or 0.0) for name in names]),
        *(
            numbers(other.removeprefix("a "), [_shift(shift[name], found.noise_std[name]) for name in names])
            for other, shift in found.shifts.items()
        ),
        numbers("σ", [digits[name].deviation(p.std) for name, p in zip(names, listed, strict=True)]),
        words("unit", [experiments.shown_unit(p) or MISSING for p in listed]),
    ]
    blocks: list[Block] = [
        Text(f"Chosen: {found.chosen}."),
        Table(columns),
        *(Text(f"Not known: {other}. {why}") for other, why in found.failed.items()),
        note(
            "A virtual controller follows the measured positions. σ noise: as if the choice was right. Then: by how "
            "many of these another choice moves the value, by one step. σ contains them: each as half the width of a "
            "rectangular distribution, d²/3."
        ),
    ]
    return [Section("What the virtual controller costs", blocks, anchor="choices", has_title=True)]


def _shift(shift: float | None, deviation: float | None) -> str:
    return MISSING if shift is None or not deviation else f"{shift / deviation:+.1f}"
