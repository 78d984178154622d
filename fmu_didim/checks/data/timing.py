"""The timing of a log: its clock, points or averages, a delay of the command that the model lacks.

All are judged along one simulated motion near the measured one, with base parameters fitted for each:

    clock      y(t) = tau(t - d), d by the least misfit, with its interval from the curvature there
    averages   y_k = mean of tau over the sample period before, around or after the stamp
    delay      the command acts one control period later: one more simulation
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.data.linear_fit import (
    CLEARLY,
    WORTH_IT,
    Explanation,
    FittedMotion,
    fitted_motion,
    motion_with_regressor,
)
from fmu_didim.checks.judgement import MATTERS
from fmu_didim.checks.sampling_kind import other_ways, way_text
from fmu_didim.cosim import SampleOperator
from fmu_didim.cosim.sampling import Kind, Window
from fmu_didim.data.spectrum import power_density
from fmu_didim.fit.noise.noise import SEGMENT, SEGMENTS, TINY
from fmu_didim.fit.solver.bounded import least_between
from fmu_didim.model.experiment import Experiment

SHIFTS_S = (0.002, 0.006, 0.018, 0.054, 0.16, 0.5)
"""[s] Shifts of a log that are tried, late and early, before the least misfit is searched near the best one."""
SHIFT_PASSES = 4
"""[fits] Of the motion with the shift that was found, until that settles."""
SHIFT_ACCURACY = 0.02
"""[control periods] To which the least misfit is searched."""
IN_A_WINDOW = 10
"""[ticks] Of a window over which a log may be an average, at which the torque is taken to see whether it is."""
HALF_AN_AMPLITUDE = 0.25
"""[1] Of the power of a log lower down, at the cut-off of its filter."""
CURVATURE = 0.5
"""[control periods] Beside the least misfit at which its curvature is taken."""
SHIFT_SIGMAS = 4.0
"""[standard deviations] Of a shift from which it is reported,"""
LEAST_SHIFT = 0.3
"""[control periods] and its size: less is how a command is held."""

CLOCK_LATE = CATALOGUE(
    "clock-late", DOUBT, rank=21,
    meaning="The log is stamped later than the torque that it shows.",
    next_step="Align the clocks, or give torque: {log_shift_s: ...}; to estimate it: identify: {clock: {of: log}}.",
)  # fmt: skip
CLOCK_EARLY = CATALOGUE(
    "clock-early", DOUBT, rank=21,
    meaning="The log is stamped earlier than the torque that it shows.",
    next_step="Align the clocks, or give torque: {log_shift_s: ...}; to estimate it: identify: {clock: {of: log}}.",
)  # fmt: skip
CLOCK_SLIGHTLY_OFF = CATALOGUE(
    "clock-slightly-off", REMARK, rank=21,
    meaning="The log is stamped later or earlier than the torque that it shows, by too little to move the values.",
    next_step="",
)  # fmt: skip
TIMING_SLIGHTLY_OFF = CATALOGUE(
    "timing-slightly-off", REMARK, rank=21,
    meaning="The log seems to show averages where the case says points, or vice versa, or the command to act later "
    "than in the model, by too little to move the values.",
    next_step="",
)  # fmt: skip
COMMAND_DELAY = CATALOGUE(
    "command-delay", DOUBT, rank=21,
    meaning="The command seems to act later than in the model, by a control period.",
    next_step="Give loop: {delay_samples: ...}, or estimate it: estimator: {estimate_delay: true}.",
)  # fmt: skip
SAMPLING_KIND = CATALOGUE(
    "sampling-kind", DOUBT, rank=21,
    meaning="The log seems to show averages where the case says points, or vice versa.",
    next_step="Find out how the logger samples; give torque: {sampling: ..., window: ...}.",
)  # fmt: skip

LOG_FILTERED = CATALOGUE(
    "log-filtered", REMARK, rank=21,
    meaning="The log shows next to nothing below half of its rate, as behind a filter against aliasing, while the case "
    "takes its samples for those of instants: what is simulated is not filtered, and what it has higher up, such as "
    "noise of the positions that a virtual controller follows, folds into what is compared.",
    next_step="Give torque: {sampling: filtered, cutoff_hz: ...}; or the log as it was recorded, with rate_hz beside.",
)  # fmt: skip
FILTERED = 1e-3
"""[1] Power of a log next to half of its rate over that lower down, below which it is behind a filter: friction's steps
leave a tenth, white noise all of it."""
NEXT_TO_HALF = 0.92
"""[1] Of half of the rate, from where on that power is taken,"""
LOWER_DOWN = (0.25, 0.5)
"""[1] and between which that lower down is."""
FEWEST_FILTERED = 192
"""[samples] With fewer of which a spectrum does not tell."""


def filtered_diagnostics(experiment: Experiment, label: str) -> list[Diagnostic]:
    """Whether a log of instants is behind a filter that the case does not state."""
    count, rate = experiment.time.size, experiment.rate_hz
    if experiment.operator.positions is None or count < FEWEST_FILTERED or experiment.is_unsigned:
        return []
    segment = int(np.clip(count // SEGMENTS, *SEGMENT))
    lines = [power_density(column, rate, segment, median=True) for column in experiment.torque.T if np.ptp(column) > 0]
    if not lines:
        return []
    share = 2 * lines[0][0] / rate
    level = [np.median(power[(share > LOWER_DOWN[0]) & (share < LOWER_DOWN[1])]) for _, power in lines]
    powers = np.array([power / max(float(low), TINY) for (_, power), low in zip(lines, level, strict=True)])
    top = float(np.median(powers[:, (share >= NEXT_TO_HALF) & (share < 1.0)], axis=1).max())
    if top >= FILTERED:
        return []
    passed = share[np.exp(np.mean(np.log(np.maximum(powers, TINY)), axis=0)) >= HALF_AN_AMPLITUDE]
    cutoff = float(passed.max(initial=0.0)) * rate / 2
    text = (
        f"Next to half of its rate, {rate / 2:.3g} Hz, the log has {top:.1g} of the power that it has lower down; it "
        f"falls to a quarter at about {cutoff:.2g} Hz."
    )
    advice = f"If so: torque: {{sampling: filtered, cutoff_hz: {cutoff:.2g}}}; better the log as it was recorded, with "
    return [Diagnostic(LOG_FILTERED, text, label, top, FILTERED, "1", f"{advice}rate_hz: {rate:.4g} beside.")]


def timings(fitted: FittedMotion, *, clock_alone: bool = False) -> list[Callable[[], Iterator[Explanation]]]:
    """Other timings that may explain a log better, each to be called; of held-out data, whose logger and loop are
    known, the clock alone."""
    ways = [_clock]
    if not clock_alone:
        ways += [_kinds] if fitted.run.model.loop.is_virtual else [_kinds, _delay]
    return [partial(way, fitted) for way in ways]


def _clock(fitted: FittedMotion) -> Iterator[Explanation]:
    """The shift of the log, with a motion fitted again for it, because a late log moves that, too."""
    experiment, step = fitted.experiment, fitted.run.step_size
    late, deviation, shifted = 0.0, np.inf, fitted
    for _ in range(SHIFT_PASSES):
        further, deviation = _least_misfit(shifted)
        late += further
        bound = max(SHIFT_SIGMAS * deviation, LEAST_SHIFT * step)
        if abs(further) < bound:
            break
        operator = experiment.operator.stamped_later(late / step, experiment.reference.time.size)
        aligned = fitted_motion(fitted.run.on(replace(experiment, operator=operator)).model)
        if aligned is None:
            return
        shifted = aligned
    if abs(late) > bound:
        yield _of_clock(fitted, shifted, late, deviation, bound)


def _of_clock(fitted: FittedMotion, aligned: FittedMotion, late: float, deviation: float, bound: float) -> Explanation:
    """The explanation by a log that is so late in s, with the motion that is fitted once it is aligned."""
    operator, least = fitted.experiment.operator, fitted.misfit_of(aligned)
    moved = float(aligned.moved_by(operator).max(initial=0.0))
    again = fitted_motion(fitted.run.model, aligned.run.values)
    # What a motion gains that is fitted once more is not the merit of the clock.
    gain = fitted.gain(least / (1.0 if again is None else min(fitted.misfit_of(again), 1.0)))
    text = (
        f"The log seems to be stamped {1000 * abs(late):.3g} ± {1000 * deviation:.2g} ms "
        f"{'late' if late > 0 else 'early'}: aligned, the residual of the base parameters falls to "
        f"{100 * np.sqrt(least):.0f} %."
    )
    if moved <= MATTERS:
        text += f" That moves no value by more than {moved:.2g} standard deviations."
        return Explanation(least, gain, Diagnostic(CLOCK_SLIGHTLY_OFF, text, fitted.run.label, moved, MATTERS, "1"))
    advice = f"Align the clocks, or give torque: {{log_shift_s: {operator.lag * fitted.run.step_size + late:.4g}}}; "
    advice += "to estimate it: identify: {clock: {of: log}}."
    limit, code = float(np.copysign(1000 * bound, late)), CLOCK_LATE if late > 0 else CLOCK_EARLY
    return Explanation(least, gain, Diagnostic(code, text, fitted.run.label, 1000 * late, limit, "ms", advice))


def _least_misfit(fitted: FittedMotion) -> tuple[float, float]:
    """The shift in s with the least misfit, and its standard deviation; infinite where the misfit has no minimum."""
    experiment, step = fitted.experiment, fitted.run.step_size
    count = experiment.reference.time.size

    def stamped(late_s: float) -> SampleOperator:
        return experiment.operator.stamped_later(late_s / step, count, between=True)

    def misfit(late_s: float) -> float:
        return fitted.misfit(stamped(late_s))

    grid = np.array([0.0, *SHIFTS_S])
    grid = np.unique(np.concatenate([-grid, grid]))
    place, best = grid.size // 2, misfit(0.0)
    for near in np.argsort(np.abs(grid), kind="stable")[1:]:
        if not fitted.is_above(best, stamped(grid[near])) and (found := misfit(grid[near])) < best:
            place, best = int(near), found
    if place in (0, grid.size - 1):
        return 0.0, np.inf
    shift, least = least_between(misfit, grid[place - 1], grid[place + 1], accuracy=SHIFT_ACCURACY * step)
    return shift, fitted.deviation(misfit, shift, least, CURVATURE * step)


def kind_is_clear(fitted: FittedMotion) -> bool:
    """Whether a log shows what the case says: every other kind of sampling explains it clearly worse along a motion."""
    return all(fitted.gain(misfit, 0.0) < -CLEARLY for misfit, *_ in _other_kinds(fitted))


def _other_kinds(fitted: FittedMotion, bound: float = np.inf) -> list[tuple[float, Kind, Window, SampleOperator]]:
    """Other kinds of sampling with their windows, without those whose misfit is above a bound for sure: the misfit of
    each along a motion first."""
    label, found = fitted.run.label, []
    for kind, window, operators in other_ways({label: fitted.run}):
        some = operators[label].thinned(IN_A_WINDOW)
        if not fitted.is_above(bound, some):
            found.append((fitted.misfit(some), kind, window, operators[label]))
    return found


def _kinds(fitted: FittedMotion) -> Iterator[Explanation]:
    label = fitted.run.label
    if not (ways := _other_kinds(fitted, WORTH_IT)):
        return
    misfit, kind, window, operator = min(ways, key=lambda way: way[0])
    sampled = fitted.run.on(replace(fitted.experiment, operator=operator))
    near = _brought_near(fitted, replace(fitted, run=sampled), misfit)
    shows, entry = way_text(kind, window, 1000 / fitted.experiment.rate_hz)
    text = (
        f"The log seems to show {shows}: with that, the residual of the base parameters falls to "
        f"{100 * np.sqrt(near.misfit):.0f} %."
    )
    advice = f"Find out how the logger samples; if so: torque: {{{entry}}}."
    yield from near.explanations(fitted, Diagnostic(SAMPLING_KIND, text, label, near.misfit, WORTH_IT, "1", advice))


def _delay(fitted: FittedMotion) -> Iterator[Explanation]:
    label, model = fitted.run.label, fitted.run.model
    system = model.loop.systems[label]
    samples = float(system.delays.get(model.loop.plant_name, 0.0)) + 1
    delayed = model.with_loop(systems={label: system.with_delay(model.loop.plant_name, samples)})
    later = replace(fitted.run, model=delayed)
    try:
        along = motion_with_regressor(later)
        near = _brought_near(fitted, along, fitted.misfit_of(along))
    except SimulationError:
        return
    text = (
        f"The command seems to act {1000 * system.step_size:.4g} ms later than in the model: with that, the "
        f"residual of the base parameters falls to {100 * np.sqrt(near.misfit):.0f} %."
    )
    advice = f"Give loop: {{delay_samples: {samples:g}}}, or estimate it: estimator: {{estimate_delay: true}}."
    yield from near.explanations(fitted, Diagnostic(COMMAND_DELAY, text, label, near.misfit, WORTH_IT, "1", advice))


@dataclass(frozen=True)
class _Near:
    """Another timing with the motion that comes nearest to the log with it, and its misfit."""

    motion: FittedMotion
    misfit: float

    def explanations(self, fitted: FittedMotion, doubt: Diagnostic) -> Iterator[Explanation]:
        """The explanation by it, if it leaves less: a doubt, or a remark where the values stay."""
        if self.misfit >= WORTH_IT:
            return
        moved = float(fitted.apart(self.motion).max(initial=0.0))
        if moved <= MATTERS:
            text = f"{doubt.text} That moves no value by more than {moved:.2g} standard deviations."
            doubt = Diagnostic(TIMING_SLIGHTLY_OFF, text, doubt.place, moved, MATTERS, "standard deviations")
        yield Explanation(self.misfit, fitted.gain(self.misfit, 0.0), doubt)


def _brought_near(fitted: FittedMotion, other: FittedMotion, misfit: float) -> _Near:
    """Another timing, with a motion of its own where it promises anything along this one."""
    own = None if misfit >= WORTH_IT else fitted_motion(other.run.model)
    if own is None or fitted.misfit_of(own) >= misfit:
        return _Near(other, misfit)
    return _Near(own, fitted.misfit_of(own))
