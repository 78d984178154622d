"""What the profiles of parameters say of an answer and its intervals."""

from __future__ import annotations

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.checks.exploration.one_start import LOWER_ELSEWHERE
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.profile import LOWER, Profile

PROFILE_OPEN = CATALOGUE(
    "profile-open", DOUBT, rank=42,
    meaning="The misfit hardly rises however far a parameter is moved, because others make up for it: the data bound "
    "it on one side only, or not at all, and its standard deviation means nothing.",
    next_step="Fix it or one that makes up for it (the profile in the report shows which), or record data that tell "
    "them apart.",
)  # fmt: skip
INTERVAL_BENT = CATALOGUE(
    "interval-not-linear", REMARK, rank=58,
    meaning="The interval by the profile of a parameter differs from the linear one by more than a third: the "
    "profile's is the one to use, and is shown.",
    next_step="Use the interval of the profile.",
)  # fmt: skip


def profile_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """What profiles have found; nothing where none were asked for."""
    found = []
    for one in estimate.profiles:
        name, unit = estimate.names[one.place], estimate.units[one.place]
        low, high = ("open" if np.isnan(end) else f"{end:.4g}" for end in one.interval)
        linear = f"{one.linear[0]:.4g} to {one.linear[1]:.4g}"
        interval = f"{low} to {high} {unit}".rstrip()
        if one.difference.min() < -LOWER:
            values = ", ".join(f"{n} = {v:.4g}" for n, v in zip(estimate.names, one.lowest, strict=True))
            gain = -float(one.difference.min())
            text = f"The profile of {name} has found a lower misfit: {values} (chi-square lower by {gain:.3g})."
            found.append(Diagnostic(LOWER_ELSEWHERE, text, name, gain, LOWER, "chi-square"))
        elif "open" in one.how:
            text = f"By its profile {name} lies in {interval} (linear {linear}){_made_up_by(one, estimate)}."
            found.append(Diagnostic(PROFILE_OPEN, text, name))
        elif one.is_bent:
            text = f"By its profile {name} lies in {interval}; the linear interval is {linear}."
            found.append(Diagnostic(INTERVAL_BENT, text, name))
    return found


def _made_up_by(one: Profile, estimate: Estimate) -> str:
    """Which parameter moves most along an open profile, in words."""
    moved = np.ptp(one.values, axis=0) / np.maximum(estimate.standard_deviation, np.finfo(float).tiny)
    moved[one.place] = 0.0
    other = int(np.argmax(moved))
    return f"; {estimate.names[other]} makes up for it" if moved[other] > 1 else ""
