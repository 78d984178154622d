"""The search for the motion that separates members best: seeded candidates, the best of them improved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fmu_didim.data.excitation import Fourier
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.discovery.excitation.limits import Limits, limits_of
from fmu_didim.discovery.next_experiment.members import AmbiguousEffect, DesignContext, Follow, ProjectedMotion
from fmu_didim.discovery.next_experiment.motions import Space
from fmu_didim.discovery.next_experiment.programs import DRAWS, Candidate, candidates
from fmu_didim.discovery.next_experiment.separation import Pair, Table, amplitudes, separations
from fmu_didim.dynamics.robot import RobotModel

SAME = 1e-4
"""[1] Members are the same to first order if less than this fraction of a signature is left on every motion."""
MEAN_PART = 0.1
"""[1] Weight of the mean separation beside the smallest one."""
MOST_SAMPLES = 600
"""[samples] Used by the search; the result is computed with all."""
EVALUATIONS = 30
"""[motions] Tried to improve the best candidates."""
FIRST_MOVE = 0.35
"""[1] Of a design variable from 0 to 1, in the first simplex of that search;"""
TURNED = 0.6
"""[1] from this value of the variable on it goes down."""
MOTION_SETTLED = 0.01
"""[1] Change of design and of the logarithm of the score that ends it."""
SMALLEST_SCORE = 1e-12
"""[standard deviations] Least score for that logarithm."""


@dataclass(frozen=True)
class Search:
    """How the motion is searched for.

    Attributes:
        limits, duration_s: of the proposed motion; those of the present reference by default.
        follow: how the robot follows a reference, such as a closed-loop simulation; exactly by default.
        seed: of the candidates; draws: number of Fourier series.
        evaluations: motions tried to improve the best candidates.
    """

    limits: Limits | None = None
    duration_s: float | None = None
    follow: Follow | None = None
    seed: int = 0
    draws: int = DRAWS
    evaluations: int = EVALUATIONS


class MotionEvaluator:
    """Separates the members on candidate motions."""

    def __init__(
        self, context: DesignContext, model: RobotModel, members: list[AmbiguousEffect], reference: Trajectory,
        search: Search,
    ) -> None:  # fmt: skip
        n = model.joint_count
        self.context, self.model, self.members = context, model, members
        seconds, lengths = float(reference.time[-1] - reference.time[0]), np.full(n, np.nan)
        for member in members:
            lengths[member.joint] = np.fmin(lengths[member.joint], member.distance)
        step = seconds / (reference.time.size - 1)
        self.space = Space(search.limits or limits_of(reference, n), search.duration_s or seconds, step, lengths)
        self.candidates = candidates(self.space, seed=search.seed, draws=search.draws)
        motion_projection = ProjectedMotion(context, model, reference)
        self.theta = amplitudes(motion_projection, members)
        self.now = separations(motion_projection, members, self.theta)
        self.open = set(self.now)

    def reference(self, motion: Fourier | Trajectory) -> Trajectory:
        """One row a control period."""
        return motion if isinstance(motion, Trajectory) else motion.trajectory(1 / self.space.step)

    def table(self, motion: Fourier | Trajectory, *, quickly: bool = True) -> Table:
        """All separations on a motion; one that breaks the limits separates nothing."""
        reference = self.reference(motion)
        if not self.space.limits.keeps(reference):
            return {}
        motion_projection = ProjectedMotion(self.context, self.model, reference, most=MOST_SAMPLES if quickly else None)
        return separations(motion_projection, self.members, self.theta)

    def smallest(self, table: Table) -> float:
        """Smallest separation of the pairs that can be split."""
        return min((table[p].distance if p in table else 0.0 for p in self.open), default=0.0)

    def score(self, table: Table) -> float:
        """The smallest separation plus a small fraction of the mean: a member that hardly shows on any motion would
        otherwise hide that another one is split well."""
        found = [table[p].distance if p in table else 0.0 for p in self.open]
        return float(min(found) + MEAN_PART * np.mean(found)) if found else 0.0


def same_pairs(tables: Sequence[Table]) -> set[Pair]:
    """Pairs of which nothing is left on any motion: the same to first order."""
    found = set(tables[0])
    for table in tables:
        found -= {p for p, s in table.items() if s.distance**2 > SAME**2 * s.separable}
    return {p for p in found if (p[1], p[0]) in found}


def improved(
    evaluator: MotionEvaluator,
    best: Sequence[tuple[Candidate, Table]],
    evaluations: int,
    progress: Callable[[str], None],
) -> tuple[Candidate, Array]:
    """The best candidate and its design variables, improved within [0, 1] by the simplex search of Nelder and Mead."""
    from scipy.optimize import minimize

    winner = (best[0][0], best[0][0].design, best[0][1])
    for candidate, first in best:
        kept = [(candidate.design, first)]

        def cost(u: Array, candidate: Candidate = candidate, kept: list[tuple[Array, Table]] = kept) -> float:
            table = evaluator.table(candidate.build(u))
            if evaluator.score(table) > evaluator.score(kept[0][1]):
                kept[0] = (u.copy(), table)
            return -float(np.log(max(evaluator.score(table), SMALLEST_SCORE)))

        start, size = candidate.design, candidate.design.size
        moves = np.where(start < TURNED, FIRST_MOVE, -FIRST_MOVE)
        simplex = np.vstack([start, start + np.diag(moves)])
        settled = {"xatol": MOTION_SETTLED, "fatol": MOTION_SETTLED}
        options = {"maxfev": evaluations // len(best), "initial_simplex": simplex, **settled}
        minimize(cost, start, method="Nelder-Mead", bounds=[(0.0, 1.0)] * size, options=options)
        if evaluator.score(kept[0][1]) > evaluator.score(winner[2]):
            winner = (candidate, *kept[0])
        progress(f"{candidate.description}: score {evaluator.score(kept[0][1]):.3g}")
    return winner[:2]
