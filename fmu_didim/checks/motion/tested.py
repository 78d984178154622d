"""All that is asked of a residual torque and the motion, the cheapest first, up to the first answer.

Functions of the motion, signatures of the catalogue beside them, then ripples, stops and bumps: what the earlier
ones tell of costs no simulations of the later ones. Where a copy of this process can look for ripples, stops and bumps,
it does so while the signatures are made, and is left if they have an answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.tall import ROWS
from fmu_didim.checks.motion.dependence import (
    JointResidual,
    dependence_of_fit,
    motion_diagnostics,
    residuals_of_fit,
    samples_of,
    tested_rows,
    with_misfits,
)
from fmu_didim.checks.motion.misfits import FittedMotions, Misfits, fitted_motions
from fmu_didim.checks.motion.searched import searched_of_fit
from fmu_didim.fit.fit import Fit
from fmu_didim.model.workers import Beside


@dataclass(frozen=True)
class MotionTests:
    """What was found.

    Attributes:
        diagnostics: the joints whose residual depends on the motion, or is untested.
        misfits: whose signatures were looked for, without their motions; none if there was an answer before.
        is_searched: whether ripples, stops or bumps are the answer, which are no misfits of the catalogue.
        joints: what was looked at beside the signatures; of a long log, whose tables are large, nothing is kept.
    """

    diagnostics: list[Diagnostic]
    misfits: Misfits
    is_searched: bool = False
    joints: Sequence[JointResidual] | None = None

    @classmethod
    def of(cls, fit: Fit) -> MotionTests:
        """At the point of a fit."""
        rows = tested_rows(fit)
        is_short = sum(own.size for own in rows.values()) <= ROWS
        joints = residuals_of_fit(fit, rows) if is_short else None
        for left in (one.left for one in joints or () if one.room > 0 and one.left.shows):
            _ = left.colours  # each of the tests asks for them
        first = Beside(lambda: motion_diagnostics(dependence_of_fit(fit, joints=joints)), fit.model.threads)
        motions = None if first.is_done else fitted_motions(fit)  # which are wanted with any answer
        if found := first.result():
            return cls(found, replace(Misfits.along(motions), motions=None))  # of a long log, large
        motions = motions or fitted_motions(fit)
        search = partial(_searched, motions, joints)
        at_once = fit.model.threads if is_short else 1
        searched = Beside(search, at_once, at_once=False)
        misfits = replace(Misfits.along(motions), motions=None)
        beside = None if joints is None else with_misfits(joints, misfits, samples_of(fit, rows))
        workers = fit.model.threads - (at_once > 1 and not searched.is_done)  # beside the copy that searches
        if found := motion_diagnostics(dependence_of_fit(fit, misfits, beside, workers=workers)):
            searched.leave()
            return cls(found, misfits)
        found = searched.result()
        return cls(found, misfits, is_searched=bool(found), joints=beside)


def _searched(motions: FittedMotions | None, joints: Sequence[JointResidual] | None) -> list[Diagnostic]:
    """The joints whose residual follows ripples, stops or bumps; none where there is no motion."""
    return [] if motions is None else motion_diagnostics(searched_of_fit(motions, joints))
