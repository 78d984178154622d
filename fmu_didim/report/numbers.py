"""Numbers and words as all reports show them.

A standard deviation is rounded to two significant digits and its value to the same decimal place
(JCGM 100:2008, 7.2.6).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from fmu_didim.results.result import ParameterResult, ResultDocument

T = TypeVar("T")
MISSING = "–"
SIGNIFICANT_DIGITS = 10
"""[digits] Most digits of a value, however small its standard deviation (data without noise)."""
SMALL, LARGE = 1e-4, 1e7
"""Outside this range a number is written with a power of ten."""
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Rounding:
    """The last digit of a value, its standard deviation and its interval.

    Attributes:
        place: the last digit has the weight 10**place; None shows six significant digits.
        exponent: of the power of ten behind the number.
    """

    place: int | None
    exponent: int = 0

    def text(self, number: float) -> str:
        """The number, rounded."""
        if self.place is None or not math.isfinite(number):
            return f"{number:.6g}"
        decimals = max(self.exponent - self.place, 0)
        unit = 10.0 ** max(self.place - self.exponent, 0)
        mantissa = f"{round(number / 10.0**self.exponent / unit, decimals) * unit:.{decimals}f}"
        if mantissa.startswith("-") and not mantissa.strip("-0."):
            mantissa = mantissa[1:]
        return f"{mantissa}e{self.exponent:+03d}" if self.exponent else mantissa

    def deviation(self, std: float) -> str:
        """The standard deviation; as a power of ten if it is far below the last digit."""
        cut = self.place is not None and 0 < std < 10.0**self.place
        return f"{std:.1e}" if cut else self.text(std)


def _exponent(number: float, digits: int) -> int:
    """Power of ten of the first digit, after rounding (0.0996 has 0.10, not 0.100)."""
    return int(f"{abs(number):.{digits - 1}e}".partition("e")[2])


def rounding(value: float, std: float) -> Rounding:
    """Two significant digits of the standard deviation; without one, six of the value."""
    if not (math.isfinite(value) and math.isfinite(std) and std > 0):
        return Rounding(None)
    place = _exponent(std, 2) - 1
    if value:
        place = max(place, _exponent(value, SIGNIFICANT_DIGITS) - SIGNIFICANT_DIGITS + 1)
    size = max(abs(value), std)
    return Rounding(place, 0 if SMALL <= size < LARGE else _exponent(size, 2))


@dataclass(frozen=True)
class ParameterText:
    """The texts of a parameter; ``insignificant``: its interval contains zero."""

    name: str
    value: str
    std: str
    percent: str
    unit: str
    interval: tuple[str, str]
    insignificant: bool


def aligned_parameters(rows: Sequence[ParameterText]) -> list[ParameterText]:
    """The same with decimal points below each other."""
    columns = zip(*((row.value, row.std, row.percent, *row.interval) for row in rows), strict=True)
    cells = zip(*(decimal_aligned(column) for column in columns), strict=True)
    return [
        replace(row, value=value, std=std, percent=percent, interval=(low, high))
        for row, (value, std, percent, low, high) in zip(rows, cells, strict=True)
    ]


def parameter_text(name: str, parameter: ParameterResult, unit: str) -> ParameterText:
    """The texts of a parameter under a name and in a unit."""
    digits = rounding(parameter.value, parameter.std)
    low, high = parameter.interval
    return ParameterText(
        name=name, value=digits.text(parameter.value), std=digits.deviation(parameter.std),
        percent=percent_std(parameter.rel_std_percent), unit=unit, interval=(digits.text(low), digits.text(high)),
        insignificant=low <= 0.0 <= high,
    )  # fmt: skip


def percent_std(percent: float | None) -> str:
    """A relative standard deviation in percent; above 999 the digits have no meaning."""
    return ">999" if percent is not None and percent > 999 else significant(percent, 2)


def significant(number: float | None, digits: int = 3) -> str:
    """A number with that many significant digits, trailing zeros kept."""
    if number is None or not math.isfinite(number):
        return MISSING
    if number == 0:
        return "0"
    exponent = _exponent(number, digits)
    if not -4 <= exponent < 7:
        return f"{number:.{digits - 1}e}"
    decimals = digits - 1 - exponent
    return f"{number:.{decimals}f}" if decimals >= 0 else f"{round(number, decimals):.0f}"


def percentage(number: float | None) -> str:
    """A percentage with three significant digits."""
    return MISSING if number is None else f"{significant(number)} %"


def item_or_none(values: Sequence[T], index: int) -> T | None:
    """The value at an index, None beyond the end."""
    return values[index] if index < len(values) else None


def capitalised(text: str) -> str:
    """A text with a capital first letter and the rest unchanged."""
    return text[:1].upper() + text[1:]


def joint_unit(units: Sequence[str], joint: int) -> str:
    """The unit of torque of a joint, counted from 0, for reading; empty if unknown."""
    return pretty_unit(item_or_none(units, joint) or "")


def noise_text(stds: Sequence[float | None], units: Sequence[str], labels: Sequence[str] = ()) -> str:
    """The noise of each joint, or output of these labels; empty if unknown."""
    names = labels or [f"joint {j + 1}" for j in range(len(stds))]
    texts = [f"{names[j]} {significant(std, 2)} {joint_unit(units, j)}".rstrip() for j, std in enumerate(stds)]
    return ", ".join(texts)


def pretty_unit(unit: str) -> str:
    """An FMI unit for reading: ``kg.m2`` becomes kg·m², ``degC`` °C; empty for the unit 1."""
    if unit in ("", "1"):
        return ""
    unit = re.sub(r"(?<![A-Za-z])deg(?=[CF](?![A-Za-z]))", "°", unit)
    return re.sub(r"(?<=[A-Za-z])-?\d+", lambda m: m.group().translate(_SUPERSCRIPT), unit).replace(".", "·")


def with_unit(name: str, unit: str) -> str:
    """A name with its unit behind it, if it has one: for axes."""
    return f"{name} ({unit})" if unit else name


def decimal_aligned(texts: Sequence[str]) -> list[str]:
    """The texts padded with spaces to one width, decimal points below each other."""
    heads = [text.partition(".")[0] if re.fullmatch(r"[-+.\de]+", text) else text for text in texts]
    left = max((len(head) for head in heads), default=0)
    moved = [" " * (left - len(head)) + text for head, text in zip(heads, texts, strict=True)]
    width = max((len(text) for text in moved), default=0)
    return [text.ljust(width) for text in moved]


def iteration_count(document: ResultDocument) -> str:
    """Iterations of the main stage, and of the efficient finish if there was one."""
    finish = document.finish_iterations
    return f"{document.iterations} + {finish}" if finish else str(document.iterations)


def consistency_line(document: ResultDocument) -> str:
    """Whether the plant agrees with the robot description, in words; empty if one is built from the other."""
    found = document.consistency
    if found is None:
        return ""
    if not found.points:
        return "the plant was not compared with the robot description"
    worst = significant(found.worst, 2)
    if found.agrees:
        return f"the plant agrees with the robot description to {worst} ({found.points} instants)"
    return f"the plant differs from the robot description, by up to {worst} ({found.points} instants)"


def component_words(described: Mapping[str, Any]) -> list[str]:
    """Source, kind and way of execution of a component of a loop."""
    source = next((str(described[key]) for key in ("source", "origin", "file", "name") if described.get(key)), "")
    law = f" ({described['law']})" if described.get("law") else ""
    kinds = {"control": "python-control", "model": "CasADi model"}
    kinds["fmu"] = f"FMI {described.get('fmi_version')} {described.get('interface')}"
    kind = str(described.get("kind"))
    archive = f" in {described['archive']}" if described.get("archive") else ""
    parts = [source.rpartition("/")[2] + law + archive, kinds.get(kind, kind)]
    if kind == "fmu":
        if described.get("solver"):
            parts.append(f"integrated by {described['solver']}")
        parts.append(f"run again by {described['reset']}" if described.get("reset", "auto") != "auto" else "")
    return [part for part in parts if part]


def loop_lines(loop: Mapping[str, Any]) -> list[str]:
    """A loop in words: a line a component in the order of execution, and one for rate, order and delay."""
    components = loop.get("components")
    if not isinstance(components, Mapping):
        return []
    lines = [f"{name}: {', '.join(component_words(components[name]))}" for name in loop.get("order", components)]
    step = loop.get("step_size_s")
    delays = {name: samples for name, samples in dict(loop.get("delay_samples") or {}).items() if samples}
    delay = ", ".join(f"{name} {samples:.6g} samples" for name, samples in delays.items()) or "none"
    if list(components) == ["model"]:
        return [*lines, f"a step every {step:.6g} s, inputs and samples at their instants"]
    rate = f"{1 / step:.6g} Hz, " if isinstance(step, int | float) else ""
    return [*lines, f"{rate}{loop.get('algorithm', '')}, delay: {delay}".strip(", ")]
