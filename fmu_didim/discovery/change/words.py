"""Causes of a change in words."""

from __future__ import annotations

from fmu_didim.discovery.change.contest import Explanation


def cause_text(found: Explanation) -> str:
    """A cause, or two, with how much."""
    parts = []
    for form, amounts, spread in zip(found.forms, found.amounts, found.deviations, strict=True):
        shown = [
            f"{name} {100 * v:+.3g} ± {100 * s:.2g} %" if unit == "1" else f"{name} {v:+.3g} ± {s:.2g} {unit}".rstrip()
            for name, unit, v, s in zip(form.names, form.units, amounts, spread, strict=True)
        ]  # fmt: skip
        same = f", or {form.same_as} alone, which is the same" if form.same_as else ""
        listed = "" if form.names[0].startswith("direction") else f" ({', '.join(shown)}{same})"
        parts.append(form.title + listed)
    return " and ".join(parts)
