"""The motion that climbs a rung of the evidence ladder: another one, or one at another speed, that shows the effect.

Candidates stay within position, speed and acceleration of the present reference. Of those that the rung counts, the one
is taken on which most is left of the effect when the base model is projected out, in units of the noise,

    x = max_j sqrt( mean_k |(I - P_W) C a|_jk^2 ) / sigma_j

as of :mod:`fmu_didim.discovery.next_experiment.separation`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.excitation import Fourier
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.excitation.limits import limits_of
from fmu_didim.discovery.ladder.facts import OTHER_SPEED
from fmu_didim.discovery.ladder.motions import MOSTLY_NEW, new_part
from fmu_didim.discovery.next_experiment.members import AmbiguousEffect, DesignContext, ProjectedMotion
from fmu_didim.discovery.next_experiment.motions import Space
from fmu_didim.discovery.next_experiment.programs import candidates
from fmu_didim.discovery.next_experiment.search import MOST_SAMPLES
from fmu_didim.discovery.selection.decide import SMALLEST_GAIN
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.estimators.starts.reference_start import reference_motion

SLOWER = (1.6, 2.5, 4.0)
"""[1] By which the present motion is stretched in time: more than what counts as another speed, and up to where a
motion of ten seconds takes most of a minute."""
Climbs = Literal["held_out", "speed"]
Excited = Callable[[Trajectory], float]


@dataclass(frozen=True)
class ClimbingMotion:
    """A motion that climbs a rung.

    Attributes:
        description: in words; reference: one row a control period; excitation: its formula, where it has one.
        excited_now, excited: what only the effect can make on the present and on this motion, in units of the noise;
            NaN where only the closed loop shows it.
        is_enough: whether that is as much as a run must show for the rung.
    """

    description: str
    reference: Trajectory
    excitation: Fourier | None
    excited_now: float
    excited: float

    @property
    def is_enough(self) -> bool:
        """Whether the effect shows there as much as it must, as far as that is known."""
        return not self.excited < SMALLEST_GAIN


def climbing_motion(
    rung: Climbs,
    present: Sequence[Trajectory],
    joints: int,
    *,
    joint: int | None,
    excited: Excited | None,
    seed: int = 0,
) -> ClimbingMotion | None:
    """The motion for a rung; None where none counts.

    Args:
        present: the references of the fitted runs, the first one first; joint: of the effect, from 1, None for all.
        excited: how much of the effect shows on a motion (:func:`excitation_of`); the first one that counts is taken
            without it. seed: of the candidates.
    """
    first = present[0]
    step = float(np.ptp(first.time)) / (first.time.size - 1)
    try:
        limits = limits_of(first, joints)
    except InputError:  # a joint stands still
        limits = None
    tried: list[tuple[str, Fourier | Trajectory]] = []
    if rung == "speed":
        tried += [(f"the present motion, {factor:g} times slower", slower(first, joints, factor)) for factor in SLOWER]
    if limits is not None:
        space = Space(limits, float(np.ptp(first.time)), step, np.full(joints, np.nan))
        tried += [(one.description, one.build(one.design)) for one in candidates(space, seed=seed)]
    found = []
    for words, motion in tried:
        reference = motion if isinstance(motion, Trajectory) else motion.trajectory(1 / step)
        if limits is not None and not limits.keeps(reference):
            continue
        if rung == "held_out" and min(new_part(reference, one, joints) for one in present) < MOSTLY_NEW:
            continue
        if rung == "speed" and not _is_other_speed(reference, first, joints, joint):
            continue
        shows = float("nan") if excited is None else excited(reference)
        found.append((shows, words, motion, reference))
        if excited is None:
            break
    if not found:
        return None
    now = float("nan") if excited is None else excited(first)
    shows, words, motion, reference = max(found, key=lambda one: one[0])
    return ClimbingMotion(words, reference, motion if isinstance(motion, Fourier) else None, now, shows)


def _is_other_speed(motion: Trajectory, first: Trajectory, joints: int, joint: int | None) -> bool:
    own, other = (np.sqrt(np.mean(reference_motion(one, joints)[1] ** 2, axis=0)) for one in (motion, first))
    places = slice(None) if joint is None else slice(joint - 1, joint)
    ratios = own[places][other[places] > 0] / other[places][other[places] > 0]
    ratio = float(np.exp(np.mean(np.log(ratios)))) if ratios.size and (ratios > 0).all() else 1.0
    return ratio >= OTHER_SPEED or ratio <= 1 / OTHER_SPEED


def slower(motion: Trajectory, joints: int, factor: float) -> Trajectory:
    """A motion stretched in time, q(t / factor), on the same control period."""
    step, begin = float(np.ptp(motion.time)) / (motion.time.size - 1), motion.time[0]
    time = np.arange(round(factor * (motion.time.size - 1)) + 1, dtype=np.float64) * step
    at = begin + time / factor
    columns = {}
    for order, (name, table) in enumerate(zip(("q", "dq", "ddq"), reference_motion(motion, joints), strict=True)):
        for j in range(joints):
            columns[f"{name}{j + 1}"] = np.interp(at, motion.time, table[:, j]) / factor**order
    return trajectory(time, columns)


def excitation_of(context: DesignContext, proposal: Proposal) -> Excited | None:
    """How much of an effect shows on a motion; None where only the closed loop shows it."""
    model = RobotModel(context.description)
    try:
        member = AmbiguousEffect(proposal, context, model)
    except InputError:
        return None
    theta = member.theta
    if theta is None:
        return None

    def excited(reference: Trajectory) -> float:
        projected = ProjectedMotion(context, model, reference, most=MOST_SAMPLES)
        columns = member.columns(projected, member.shapes)
        if columns is None:
            return 0.0
        rest = projected.per_joint(projected.base.rest_of(columns @ theta))
        return float(np.sqrt((rest / projected.samples).max()))

    return excited
