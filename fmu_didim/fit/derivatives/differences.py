"""Central differences of closed-loop simulations, with the step that suits what is simulated.

The difference D(h) = (tau(+h) - tau(-h)) / 2h of a plant whose integrator is not ours errs by its truncation, which
grows with h^2, and by what rounding and the plant's own step control add to each simulation, which grows with 1/h. The
second difference tau(+h) + tau(-h) - 2 tau shows both at no cost: of errors of equal size in three simulations it
keeps sqrt(6), the first one sqrt(2), so that the first errs by 1/sqrt(3) of the second, or by less where the second is
curvature. A longer step H tells the two apart: curvature is (h/H)^2 of the second difference of H, what else there is
in that of h is error; and D(h) is truncated by (D(H) - D(h)) / ((H/h)^2 - 1). Without that, any curvature would count
as error, and shorter steps would look better, in which jitter counts ten times as much.

Step control that takes the same steps for very small changes makes a torque smooth in pieces, whose slopes need not be
that of the whole. So a short step is believed only if all longer ones agree with it, as well as they are known.

Source: J. J. More, S. M. Wild, "Estimating derivatives of noisy simulations", ACM TOMS 38 (2012).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import Simulation

STEP = 1e-4
"""[1] Step of the forward differences of a search, in units of a parameter's scale: our loops are smooth to 1e-10,
truncation rules."""
DIFFERENCE_STEPS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3)
"""[1] Relative steps tried on a loop whose integrator is not ours, from rounding to where no parameter acts linearly;
denser where the torque jitters that much."""
KEPT_STEP = 3.0
"""[1] A step is kept until the error of its column has grown by this factor."""
SHOWS_SOMETHING = 0.3
"""[1] A column with a larger error, relative to its norm, cannot confirm a shorter step."""
KNOWN_WITHIN = 3.0
"""[1] Columns of two steps agree if they differ by less than this many errors of the longer one."""
TRUNCATED = 0.1
"""[1] Part of a column beyond that by which a longer step may differ: its truncation, which second differences of
symmetric functions do not show."""

SIMULATIONS = 1 + 1 + 2**2
"""[simulations] Independent errors of equal size, of the two sides and of twice the middle, in the square of a second
difference."""
FIRST_STEP = DIFFERENCE_STEPS.index(STEP)


@dataclass(frozen=True)
class Step:
    """The step of a parameter.

    Attributes:
        place: in ``DIFFERENCE_STEPS``; error: of the column, relative to its norm.
        curved: how many times as much the second difference by itself would show, because of curvature.
        jitter: (n,) root mean square of what a simulation adds of its own to the torque of each joint, where second
            differences do not fall with the step as curvature does; empty where they fall.
        sought: error for which no better step was found, or needed.
    """

    place: int
    error: float
    jitter: tuple[float, ...] = ()
    sought: float = np.inf
    curved: float = 1.0

    def is_sought(self, wanted: float) -> bool:
        """Whether a step with this error was searched for already."""
        return self.sought <= KEPT_STEP * wanted

    def after(self, known: Step, wanted: float) -> Step:
        """This step, with what is known from the one before."""
        sought = min(wanted, known.sought)
        if known.place != self.place or self.curved > 1:
            return replace(self, sought=sought)
        return replace(self, error=self.error / known.curved, curved=known.curved, jitter=known.jitter, sought=sought)


Steps = dict[tuple[str, int], Step]
"""Known steps, by label of the experiment and number of the parameter."""


def jitter_in(steps: Steps, deviation: Array) -> float:
    """The largest jitter of a joint in any experiment, in units of deviations (n,); 0 where none was looked for."""
    found = [np.asarray(step.jitter) / deviation for step in steps.values() if step.jitter]
    return float(np.max(found)) if found else 0.0


@dataclass(frozen=True)
class Difference:
    """A column (N, n) of the sensitivity, and its step; None where its error is not in question."""

    column: Array
    step: Step | None = None


class Ladder:
    """Central differences of one parameter in one experiment, simulated as they are asked for.

    Args:
        run: the experiment at the values; outputs: (M, m) there; size: of the parameter, which steps are relative to.
    """

    def __init__(self, run: Simulation, outputs: Array, i: int, size: float) -> None:
        self._run, self._outputs, self._i, self._size = run, outputs, i, size
        self._tried: dict[int, Difference | None] = {}
        self._second: dict[int, Array] = {}

    def at(self, place: int) -> Difference | None:
        """The difference with the step of this place; None where it cannot be simulated."""
        if place not in self._tried:
            self._tried[place] = self._simulated(place)
        return self._tried[place]

    def _simulated(self, place: int) -> Difference | None:
        change = DIFFERENCE_STEPS[place] * self._size
        here = self._run.values[self._i]
        try:
            above, below = (self._run.moved(self._i, here + by).outputs() for by in (change, -change))
        except SimulationError:
            return None
        first, second = above - below, above + below - 2 * self._outputs
        norm = float(np.linalg.norm(first))
        error = float(np.linalg.norm(second)) / np.sqrt(3) / norm if norm > 0 else np.inf
        self._second[place] = second
        return Difference(first / (2 * change), Step(place, float(error), _jitter(second)))

    def best(self, wanted: float, begin: int = FIRST_STEP) -> Difference:
        """The first difference that errs by at most ``wanted`` of its norm, or else the one that errs least.

        Args:
            begin: place of the step that is tried first.

        Raises:
            SimulationError: no step can be simulated.
        """
        first = self.at(begin)
        if first is not None and _error(first) <= wanted:
            return _with_jitter(first, ())
        self._walk(begin, -1, wanted)
        if first is None or not self._is_found(wanted):
            self._walk(begin, 1, wanted)
        return self._best()

    def _walk(self, begin: int, way: int, wanted: float) -> None:
        """Shorter steps while they err less, or longer ones, which one rise does not end."""
        before, rises = _size_of_error(self.at(begin)), 0
        places = range(begin - 1, -1, -1) if way < 0 else range(begin + 1, len(DIFFERENCE_STEPS))
        for place in places:
            here = self.at(place)
            if here is None and way > 0:
                return  # a longer step leads still farther away
            if here is None:
                continue
            size = _size_of_error(here)
            rises = rises + 1 if size >= before else 0
            if self._is_found(wanted) or rises > (way > 0):
                return
            before = min(size, before)

    def _is_found(self, wanted: float) -> bool:
        """Whether a difference errs little enough, and longer steps that show something agree with it."""
        found = [one for one in self._known() if _error(one) <= SHOWS_SOMETHING]
        return len(found) > 1 and _error(self._best()) <= wanted

    def _known(self) -> list[Difference]:
        """Simulated differences, from the longest step to the shortest."""
        return [one for _, one in sorted(self._tried.items(), reverse=True) if one is not None]

    def _best(self) -> Difference:
        known = self._known()
        if not known:
            raise SimulationError(
                f"The parameter '{self._run.model.names[self._i]}' cannot be varied.",
                got=f"no simulation succeeds near {self._run.values[self._i]:.6g}",
                next_step="Start from other values.",
            )
        agreeing = [one for k, one in enumerate(known) if all(_agrees(one, longer) for longer in known[:k])]
        best = min(map(self._by_longer, agreeing), key=_size_of_error)
        return _with_jitter(best, self._jitter_beside(best))

    def _by_longer(self, one: Difference) -> Difference:
        """A difference with the error that the next longer step shows, where that is less."""
        assert one.step is not None
        place = one.step.place
        beyond = min((k for k, other in self._tried.items() if k > place and other is not None), default=None)
        if beyond is None or not np.isfinite(one.step.error):
            return one
        longer, step = self._tried[beyond], DIFFERENCE_STEPS[place] * self._size
        assert longer is not None
        square = (DIFFERENCE_STEPS[beyond] / DIFFERENCE_STEPS[place]) ** 2
        rest = self._second[place] - self._second[beyond] / square
        scattered = float(np.linalg.norm(rest)) / np.sqrt(3) / (2 * step)
        truncated = float(np.linalg.norm(longer.column - one.column)) / (square - 1)
        error = float(np.hypot(scattered, truncated) / np.linalg.norm(one.column))
        if not 0 < error < one.step.error:
            return one
        found = replace(one.step, error=error, curved=one.step.error / error, jitter=_jitter(rest))
        return replace(one, step=found)

    def _jitter_beside(self, best: Difference) -> tuple[float, ...]:
        """By the next shorter step."""
        assert best.step is not None
        shorter = self._tried.get(best.step.place - 1)
        if shorter is None:
            return ()
        shorter = self._by_longer(shorter)
        assert shorter.step is not None
        ratio = DIFFERENCE_STEPS[shorter.step.place] / DIFFERENCE_STEPS[best.step.place]
        return shorter.step.jitter if max(shorter.step.jitter) >= ratio * max(best.step.jitter) else ()


def _jitter(second: Array) -> tuple[float, ...]:
    """(n,) root mean square of the error of a simulation, by second differences (N, n)."""
    return tuple(np.sqrt(np.mean(second**2, axis=0) / SIMULATIONS).tolist())


def _with_jitter(one: Difference, jitter: tuple[float, ...]) -> Difference:
    assert one.step is not None
    return replace(one, step=replace(one.step, jitter=jitter))


def _error(one: Difference) -> float:
    """Of a column, relative to its norm."""
    assert one.step is not None
    return one.step.error


def _size_of_error(one: Difference | None) -> float:
    """Norm of the error of a column; infinite where the step changes nothing, or cannot be simulated."""
    if one is None or not np.isfinite(_error(one)):
        return np.inf
    return _error(one) * float(np.linalg.norm(one.column))


def _agrees(one: Difference, longer: Difference) -> bool:
    """Whether a difference is that of a longer step, as far as this one is known."""
    size = _size_of_error(longer)
    allowed = KNOWN_WITHIN * size + TRUNCATED * float(np.linalg.norm(longer.column))
    return not np.isfinite(size) or float(np.linalg.norm(one.column - longer.column)) <= allowed
