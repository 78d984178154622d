"""All that is asked of a residual torque and the motion, the cheapest first, up to the first answer.

Functions of the motion, signatures of the catalogue beside them, then ripples, stops and bumps: what the earlier
ones tell of costs no simulations of the later ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.checks.motion.dependence import dependence_of_fit, motion_diagnostics
from fmu_didim.checks.motion.misfits import Misfits
from fmu_didim.checks.motion.searched import searched_of_fit
from fmu_didim.fit.fit import Fit


@dataclass(frozen=True)
class MotionTests:
    """What was found.

    Attributes:
        diagnostics: the joints whose residual depends on the motion, or is untested.
        misfits: whose signatures were looked for, without their motions; none if there was an answer before.
        is_searched: whether ripples, stops or bumps are the answer, which are no misfits of the catalogue.
    """

    diagnostics: list[Diagnostic]
    misfits: Misfits
    is_searched: bool = False

    @classmethod
    def of(cls, fit: Fit) -> MotionTests:
        """At the point of a fit."""
        if found := motion_diagnostics(dependence_of_fit(fit)):
            return cls(found, Misfits())
        misfits = Misfits.of(fit)
        without = replace(misfits, motions=None)  # of a long log, large
        if found := motion_diagnostics(dependence_of_fit(fit, misfits)):
            return cls(found, without)
        if misfits.motions is None:
            return cls([], without)
        found = motion_diagnostics(searched_of_fit(misfits.motions))
        return cls(found, without, is_searched=bool(found))
