"""Where the base model of a discovery disagrees with the measurement, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fmu_didim.report.discovery.texts import share_text
from fmu_didim.report.numbers import joint_unit, pretty_unit, significant
from fmu_didim.results.findings import FindingsDocument, RegionResult

PEAK_PART = 0.5
"""[1] Bins whose mean reaches this fraction of the largest mean of their quantity form the region."""
NEAR_ZERO = 0.25
"""[1] A region starts at zero if its inner end is below this fraction of its outer end."""


@dataclass(frozen=True)
class _Piece:
    """Neighbouring bins whose means have one sign."""

    low: float
    high: float
    mean: float
    bins: int

    def mirrors(self, other: _Piece) -> bool:
        """Whether the other piece is the same range with the opposite sign."""
        distance = abs(self.low + other.high) + abs(self.high + other.low)
        return distance <= 0.5 * (self.high - self.low + other.high - other.low)


def strongest_regions(document: FindingsDocument, *, joint: int | None = None, count: int = 3) -> list[str]:
    """Where the base model disagrees, a line a quantity, in order of the share that it explains.

    Args:
        joint: of this joint only, from 1; count: lines at most.
    """
    groups: dict[tuple[int, str], list[RegionResult]] = {}
    for region in document.regions:
        if joint is None or region.joint == joint:
            groups.setdefault((region.joint, region.quantity), []).append(region)
    ranked = sorted(groups.values(), key=lambda group: -max(r.share_of_gap for r in group))
    return [_region_line(group, document.torque_unit) for group in ranked[:count]]


def regions_by_joint(document: FindingsDocument) -> list[str]:
    """The strongest regions of each joint."""
    joints = sorted({region.joint for region in document.regions})
    return [line for j in joints for line in strongest_regions(document, joint=j)]


def _region_line(group: Sequence[RegionResult], units: Sequence[str]) -> str:
    first = group[0]
    where, sign = _where(first.quantity, pretty_unit(first.unit), pieces := _pieces(group))
    unit = joint_unit(units, first.joint - 1)
    mean = f"{sign[:1]}{significant(abs(pieces[0].mean), 2)} {unit}".rstrip()
    share = share_text(max(r.share_of_gap for r in group))
    explained = f"{share} of the gap goes with the {first.quantity}"
    return f"joint {first.joint}: {where}, mean residual {mean}{sign[1:]}; {explained}"


def _pieces(group: Sequence[RegionResult]) -> list[_Piece]:
    """The strong bins, joined to ranges, in order of strength."""
    peak = max(abs(r.mean) for r in group)
    pieces: list[_Piece] = []
    for r in sorted((r for r in group if abs(r.mean) >= PEAK_PART * peak), key=lambda r: r.low):
        last = pieces[-1] if pieces else None
        if last and math.isclose(last.high, r.low, rel_tol=1e-6, abs_tol=1e-12) and last.mean * r.mean > 0:
            mean = (last.mean * last.bins + r.mean) / (last.bins + 1)
            pieces[-1] = _Piece(last.low, r.high, mean, last.bins + 1)
        else:
            pieces.append(_Piece(r.low, r.high, r.mean, 1))
    return sorted(pieces, key=lambda p: -abs(p.mean) * p.bins)


def _where(quantity: str, unit: str, pieces: Sequence[_Piece]) -> tuple[str, str]:
    """The range in words; and the sign of the mean, followed by what it depends on."""
    top = pieces[0]
    sign = "+" if top.mean > 0 else "-"
    twin = next((p for p in pieces[1:] if top.mirrors(p)), None) if quantity in _SIGNED else None
    if twin is not None:
        inner = 0.5 * (min(abs(top.low), abs(top.high)) + min(abs(twin.low), abs(twin.high)))
        outer = 0.5 * (max(abs(top.low), abs(top.high)) + max(abs(twin.low), abs(twin.high)))
        if top.mean * twin.mean < 0:
            upper = top if top.low + top.high > 0 else twin
            sign = "±" + (f" (sign of the {quantity})" if upper.mean > 0 else f" (against the {quantity})")
        return _both_sides(quantity, unit, inner, outer), sign
    return _one_side(quantity, unit, top.low, top.high), sign


_SIGNED = {"velocity": "dq", "acceleration": "ddq", "torque": "torque"}


def _both_sides(quantity: str, unit: str, inner: float, outer: float) -> str:
    name = _SIGNED[quantity]
    size = "speed" if quantity == "velocity" else quantity
    if inner <= NEAR_ZERO * outer:
        return f"at low {size}, |{name}| < {significant(outer, 2)} {unit}"
    return f"at high {size}, |{name}| from {significant(inner, 2)} to {significant(outer, 2)} {unit}"


def _one_side(quantity: str, unit: str, low: float, high: float) -> str:
    span = f"{significant(low, 2)} to {significant(high, 2)} {unit}".rstrip()
    from_zero = abs(low) <= NEAR_ZERO * abs(high) and high > 0
    if quantity == "velocity":
        return f"{_speed(low, high)}, dq from {span}"
    if quantity.startswith("distance"):
        return (
            f"just after a reversal, within {significant(high, 2)} {unit}" if from_zero else f"{span} after a reversal"
        )
    if quantity == "load" and from_zero:
        return f"at low load, below {significant(high, 2)} {unit}"
    return f"{_PLURAL[quantity]} from {span}" if quantity in _PLURAL else f"{quantity} from {span}"


def _speed(low: float, high: float) -> str:
    """A range of velocity in words."""
    inner, outer = sorted((abs(low), abs(high)))
    way = "forward" if low + high > 0 else "backward"
    if low < 0 < high and inner > NEAR_ZERO * outer:
        return "at low speed"
    return f"at low speed {way}" if inner <= NEAR_ZERO * outer else f"moving {way}"


_PLURAL = {name: f"at {name}s" for name in ("position", "acceleration", "load", "torque", "time")}
