"""The search for what a model alone lacks: every candidate is fitted, the best one is added, until none helps.

With the residuals r of the outputs, each candidate is a few more free parameters of the same least squares. Its starts
are compared with all else refitted to first order, and the better ones are fitted to the minimum. What it gains is the
difference in the Bayesian information criterion, with the effective number of samples of the better residual. Of those
that gain as much as the best, but for what data of this size tell, none is preferred: they are an undecided set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import IdentificationError, SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection.candidates import Outcome
from fmu_didim.discovery.selection.competition import SURVIVING
from fmu_didim.discovery.selection.decide import Options, nearness
from fmu_didim.discovery.selection.held_out import held_out_objection
from fmu_didim.discovery.selection.plausible import ZERO, chance_of_none
from fmu_didim.discovery.signals.candidates import Candidate, candidates
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import bic_gain, explained_gap
from fmu_didim.fit.noise.noise import TINY, Noise
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.fit.solver.accuracy import with_fitting_substeps
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.loop_model import LoopModel

STARTS = 2
"""[starts] Of a candidate that are fitted to the minimum: the best ones with all else refitted to first order."""
LEAST = 5.0
"""[chi-square] By which a start must promise to lower it, where the promise is a slope or another one was fitted: less
is no BIC difference of 10."""
ITERATIONS = 25
"""[steps] Of such a fit at most; most take five."""
TOLERANCE = 1e-6
"""[1] Relative change of the values at which it is settled at the latest: data without noise."""
NEXT_STEP = 0.01
"""[standard deviations] A step that would be smaller is not made: invisible beside the noise."""
FEWEST_CLIPPED = 3
"""[samples] That a limit must change for it to be one: fewer are outliers."""
CLIPPED = 1e-9
"""[1] Of the largest output, by which a sample must change to count among them: above rounding."""
DEPENDENT = 1e-10
"""[1] Singular value of columns, relative to the largest, below which one tells nothing more: rounding."""
SECOND_DIFFERENCE = 6.0
"""[1] Variance of a second difference of white noise of variance one: 1 + 4 + 1."""

FIT = Stopping(iterations=ITERATIONS, tolerance=TOLERANCE, next_step=NEXT_STEP, updates=None, exact=True)
"""Each candidate is fitted to its minimum: a BIC difference between two that are not there says nothing."""
COARSER = 10.0
"""[1] Times the error by the length of its steps that a final fit may have, in a search: a tenth of the noise names
nothing, and takes a third of the steps."""


@dataclass(frozen=True)
class FittedSignal:
    """A candidate fitted beside all else.

    Attributes:
        candidate: what; fit: of the model with it; gain: in BIC over the model without; share: of the misfit.
        objection: why it is not accepted, or an empty string.
    """

    candidate: Candidate
    fit: Fit
    gain: float
    share: float
    objection: str = ""


@dataclass(frozen=True)
class TriedSignal:
    """A candidate of a round and its outcome; ``fitted``: where it was."""

    candidate: Candidate
    outcome: Outcome
    fitted: FittedSignal | None = None


@dataclass(frozen=True, eq=False)
class SignalStep:
    """What was added in a round.

    Attributes:
        chosen: the candidate that was added; rivals: those that explain the data as well, each fitted in its place.
        before: the fit without it; tried: all candidates of the round.
    """

    chosen: FittedSignal
    rivals: tuple[FittedSignal, ...]
    before: Fit
    tried: tuple[TriedSignal, ...]


@dataclass(frozen=True)
class SignalDiscovery:
    """The result of a search.

    Attributes:
        base, final: fits without and with what was added; steps: one for each addition.
        tried: the candidates of each round; absorbed: names of those that the identified parameters make up for whole.
        is_cut: whether the time was up before all were tried.
    """

    base: Fit
    final: Fit
    steps: tuple[SignalStep, ...] = ()
    tried: tuple[tuple[TriedSignal, ...], ...] = ()
    absorbed: tuple[str, ...] = ()
    is_cut: bool = False


@dataclass(frozen=True)
class SignalSearch:
    """A search beside a model.

    Attributes:
        options: how to discover; progress: is told of each piece of work, and says when the time is up.
    """

    options: Options
    progress: Progress

    def run(self, model: LoopModel) -> SignalDiscovery:
        """Add candidates to a model, from its values on, as long as the data support them.

        Raises:
            SimulationError: the model cannot be simulated.
        """
        base = fitted(model, until=float("inf"))
        found = SignalDiscovery(base, base)
        every = candidates(base.model, simulated_outputs(base), self.options.forbid)
        seen = set[str]()  # what was added, and maybe taken out again
        while len(found.steps) < self.options.rounds:
            step, tried, absorbed = self._round(found.final, [c for c in every if c.name not in seen])
            is_cut = any(t.outcome is Outcome.NOT_TRIED for t in tried)
            found = replace(
                found, tried=(*found.tried, tried), is_cut=is_cut, absorbed=found.absorbed if found.steps else absorbed
            )
            if step is None or is_cut:
                break
            self.progress.say(f"added: {step.chosen.candidate.title}")
            seen.add(step.chosen.candidate.name)
            found = self._backward(replace(found, final=step.chosen.fit, steps=(*found.steps, step)))
        return self._told_apart(found, every) if len(found.steps) > 1 and not found.is_cut else found

    def _round(
        self, fit: Fit, every: Sequence[Candidate]
    ) -> tuple[SignalStep | None, tuple[TriedSignal, ...], tuple[str, ...]]:
        """What to add to a fit, if anything; all candidates; and those that it makes up for."""
        noise, index = quick_noise(fit), 1 + max(_added(fit.model), default=-1)
        report, base = self.progress.counted("fitting candidate", len(every)), _projection(fit)
        tried, absorbed = [], []
        for candidate in every:
            if self.progress.is_time_up:
                tried.append(TriedSignal(candidate, Outcome.NOT_TRIED))
                continue
            starts, is_absorbed = _starts(fit, base, candidate, index)
            absorbed += [candidate.title] if is_absorbed else []
            one = self._fitted(fit, candidate, starts, noise) if starts else None
            outcome = Outcome.FITTED if one is not None else Outcome.LEFT_EARLY
            if one is None and self.progress.is_time_up and starts:
                outcome = Outcome.NOT_TRIED
            tried.append(TriedSignal(candidate, outcome, one))
            report(f"{candidate.name}, BIC difference {one.gain:.0f}" if one is not None else "")
        return self._decided(fit, tried), tuple(tried), tuple(absorbed)

    def _fitted(
        self, fit: Fit, candidate: Candidate, starts: Sequence[tuple[float, LoopModel]], noise: Noise
    ) -> FittedSignal | None:
        """A candidate at its best minimum; None where none is found."""
        best: FittedSignal | None = None
        is_slope = candidate.kind.is_scaled or candidate.known is not None  # so that the promise is that of its fit
        for promised, model in starts:
            if promised < LEAST and (is_slope or best is not None):
                continue
            try:
                other = fitted(model, until=self.progress.ends)
            except (SimulationError, IdentificationError):
                continue
            if other.given_up:
                continue
            gain = bic_gain(fit, other, candidate.cost, noise)
            if best is None or gain > best.gain:
                best = FittedSignal(candidate, other, gain, explained_gap(fit, other, noise)[1])
        return best

    def _decided(self, fit: Fit, tried: list[TriedSignal]) -> SignalStep | None:
        """The best candidate that is accepted, with those that are as good; why others are not goes to ``tried``."""
        ranked = sorted((t.fitted for t in tried if t.fitted is not None), key=lambda f: -f.gain)
        for place, one in enumerate(ranked):
            why = self.objection(fit, one)
            tried_at = next(k for k, t in enumerate(tried) if t.fitted is one)
            ranked[place] = replace(one, objection=why)
            tried[tried_at] = replace(tried[tried_at], fitted=ranked[place])
            if why:
                continue
            near = one.gain - nearness(one.gain, self.options)
            rivals = [f for f in ranked if f.candidate is not one.candidate and f.gain > near]
            chosen, others = preferred(ranked[place], rivals)
            return SignalStep(chosen, tuple(others), fit, tuple(tried))
        return None

    def objection(self, fit: Fit, one: FittedSignal) -> str:
        """Why a candidate is not accepted, or an empty string."""
        if one.gain < self.options.threshold:
            return f"BIC difference {one.gain:.1f} below {self.options.threshold:g}"
        if (why := not_there(one)) and not self.is_needed(one.candidate, one.fit):
            return why
        if one.candidate.kind.of_start:
            return ""
        return held_out_objection(fit, one.fit, seed=self.options.seed)

    def _told_apart(self, found: SignalDiscovery, every: Sequence[Candidate]) -> SignalDiscovery:
        """The same with what may stand in the place of each addition beside the others: while these were missing, and
        bent all values, what is as good now may have been told apart, and what is not may have been as good."""
        steps, final = list(found.steps), found.final
        added = {step.chosen.candidate.name for step in steps}
        for place, step in enumerate(steps):
            own, name = without(final, step.chosen.candidate), step.chosen.candidate.name
            if own is None:
                continue
            self.progress.say(f"in the place of: {step.chosen.candidate.title}")
            _, tried, _ = self._round(own, [c for c in every if c.name == name or c.name not in added])
            if any(t.outcome is Outcome.NOT_TRIED for t in tried):
                return replace(found, steps=tuple(steps), tried=(*found.tried, tried), is_cut=True)
            all_fitted = {t.candidate.name: t.fitted for t in tried if t.fitted is not None}
            again = all_fitted.pop(name, None)
            if again is None:
                continue
            near = again.gain - nearness(again.gain, self.options)
            chosen, others = preferred(again, [f for f in all_fitted.values() if f.gain > near])
            others += [] if chosen is again else [chosen]
            open_ = (f for f in step.rivals if f.candidate.name not in all_fitted)
            steps[place] = replace(step, rivals=(*others, *open_))
        return replace(found, steps=tuple(steps))

    def is_needed(self, candidate: Candidate, fit: Fit) -> bool:
        """Whether a fit is worse without a candidate of it, all else fitted anew from its values.

        Where two parameters do nearly the same, such as a lag that is as slow as the model, a covariance says that
        either may be absent; this asks the data.
        """
        other = without(fit, candidate)
        if other is None or candidate.kind.of_start:
            return False
        return bic_gain(other, fit, candidate.cost, quick_noise(fit)) >= self.options.threshold

    def _backward(self, found: SignalDiscovery) -> SignalDiscovery:
        """Take out what a later addition has made superfluous; and that one itself where all else, fitted from its
        minimum without it, explains as much: then it has only led there."""
        for step in found.steps:
            other = without(found.final, step.chosen.candidate)
            if other is None:
                continue
            noise = quick_noise(found.final)
            if bic_gain(other, found.final, step.chosen.candidate.cost, noise) < self.options.threshold:
                self.progress.say(f"taken out again: {step.chosen.candidate.title}")
                steps = tuple(s for s in found.steps if s is not step)
                found = replace(found, final=other, steps=steps)
        return found


def preferred(best: FittedSignal, rivals: Sequence[FittedSignal]) -> tuple[FittedSignal, list[FittedSignal]]:
    """The candidate that is added, and those that these data do not tell from it.

    A transient has any time constant; a parameter of the model that does the same with fewer says what it is.
    """
    rivals = list(rivals)
    is_start = best.candidate.kind.of_start
    simpler = [f for f in rivals if f.candidate.known is not None and f.candidate.cost < best.candidate.cost]
    if is_start and simpler:
        chosen = max(simpler, key=lambda f: f.gain)
        return chosen, [f for f in rivals if f is not chosen and not f.candidate.kind.of_start]
    if best.candidate.known is not None:
        rivals = [f for f in rivals if not (f.candidate.kind.of_start and f.candidate.cost > best.candidate.cost)]
    return best, rivals


def fitted(model: LoopModel, *, until: float) -> Fit:
    """A model at its minimum, with the weights of its own residual, and steps as short as what bends its inputs asks
    for; raises SimulationError, IdentificationError."""
    found = minimise(model, NoiseOfResidual(model), stopping=replace(FIT, until=until))
    if found.given_up or not model.divides_steps:
        return found
    allowed = COARSER * quick_noise(found).deviation
    divided = with_fitting_substeps(model.with_values(found.values), found.values, allowed)
    if divided.loop.subdivision <= model.loop.subdivision:
        return found
    return minimise(divided, NoiseOfResidual(divided), stopping=replace(FIT, until=until))


def without(fit: Fit, candidate: Candidate) -> Fit | None:
    """A fit without one of its additions; None where it cannot be simulated."""
    own = {p.name for p in candidate.free({}, 0)}
    model = fit.model.with_values(fit.values)
    try:
        return fitted(model.with_free(p for p in model.free_parameters if p.name not in own), until=float("inf"))
    except (SimulationError, IdentificationError):
        return None


def simulated_outputs(fit: Fit) -> dict[str, Array]:
    """Output -> (N,) its simulated values at the samples of all fitted experiments, in its unit."""
    experiments, labels = fit.model.experiments, fit.model.estimation_labels
    torque = experiments.unscaled(fit.torque)
    found = {name: torque[:, k] for k, name in enumerate(fit.model.loop.output_names)}
    for name in experiments.channels:
        rows = experiments.output_rows
        own = [experiments.channels_of(label, fit.outputs[rows[label]]) for label in labels]
        found[name] = np.concatenate([values[name] for values in own if name in values])
    return found


def quick_noise(fit: Fit) -> Noise:
    """The noise that neighbouring samples of a residual show: white noise whatever the model lacks, a lower bound of
    noise with a colour.

    sigma^2 = mean (r_(i-1) - 2 r_i + r_(i+1))^2 / 6
    """
    deviation = []
    for _, own in fit.model.experiments.blocks(fit.residual):
        second = np.diff(own, 2, axis=0)
        square = np.mean(second**2, axis=0) / SECOND_DIFFERENCE if second.size else np.mean(own**2, axis=0)
        deviation.append(np.sqrt(np.minimum(square, np.mean(own**2, axis=0))))
    found = np.maximum(np.concatenate(deviation), TINY)
    return Noise(found, np.zeros(found.size), "differences of neighbouring samples")


def not_there(one: FittedSignal) -> str:
    """Why the values of a candidate may be those with which nothing changes, or an empty string."""
    model, candidate = one.fit.model, one.candidate
    last = max(_added(model))
    places = [i for i, p in enumerate(model.free_parameters) if p.effect == last]
    neutral = [candidate.neutral(model.free_parameters[i]) for i in places]
    sized = [(i, off) for i, off in zip(places, neutral, strict=True) if off is not None]
    if not sized:  # a limit
        clipped = _clipped(one)
        return f"it changes {clipped} samples only" if clipped < FEWEST_CLIPPED else ""
    own = [i for i, _ in sized]
    covariance = one.fit.covariance[np.ix_(own, own)]
    chance = chance_of_none(one.fit.values[own], covariance, np.array([off for _, off in sized]))
    return f"may be absent (p = {chance:.2g})" if chance > ZERO else ""


def _clipped(one: FittedSignal) -> int:
    """Samples of the outputs that a limit changes."""
    model, names = one.fit.model, {p.name for p in one.candidate.free({}, 0)}
    open_ = model.with_values(one.fit.values)
    open_ = open_.with_free(p for p in open_.free_parameters if p.name not in names)
    change = np.abs(open_.outputs(open_.start) - one.fit.outputs)
    return int((change > TINY + CLIPPED * np.abs(one.fit.outputs).max(axis=0)).any(axis=1).sum())


def _added(model: LoopModel) -> list[int]:
    """Numbers of the additions of a model, one for each of their free parameters."""
    return [p.effect for p in model.free_parameters if p.effect is not None]


def _projection(fit: Fit) -> BaseProjection:
    return BaseProjection.of(fit.jacobian, 1 / fit.deviation)


def _starts(
    fit: Fit, base: BaseProjection, candidate: Candidate, index: int
) -> tuple[list[tuple[float, LoopModel]], bool]:
    """By how much each start promises to lower chi-square, and its model, the best first; and whether what is
    identified makes up for the candidate whole."""
    rest = base.rest_of(base.weighted(fit.residual))
    tried: list[tuple[float, int, LoopModel]] = []
    seen = False
    for values in candidate.starts:
        found = _tried(fit, base, candidate, dict(values), index, rest)
        if found is None:
            continue
        cost, surviving, model = found
        seen |= surviving > SURVIVING
        if surviving > SURVIVING:
            tried.append((cost, len(tried), model))
    if not tried:
        return [], not seen and bool(candidate.starts)
    own = float(rest @ rest)
    return [(own - cost, model) for cost, _, model in sorted(tried, key=lambda t: t[:2])[:STARTS]], False


def _tried(
    fit: Fit, base: BaseProjection, candidate: Candidate, values: dict[str, float], index: int, rest: Array
) -> tuple[float, float, LoopModel] | None:
    """Sum of squares that a start leaves with all else refitted to first order, the part of what it changes that
    survives this, and the model; None where it cannot be simulated or changes nothing."""
    model = fit.model.with_values(fit.values)
    free = candidate.free(values, index)
    model = model.with_free((*model.free_parameters, *free))
    own = range(len(fit.model.free_parameters), len(model.free_parameters))
    try:
        if candidate.kind.is_scaled or candidate.known is not None:
            amplitudes = [i for i in own if not model.free_parameters[i].is_shape]
            columns = _columns(model, fit.outputs, amplitudes)
        else:
            amplitudes, columns = [], (model.outputs(model.start) - fit.outputs)[:, :, None]
    except SimulationError:
        return None
    weighted = base.weighted(columns)
    size = float(np.linalg.norm(weighted))
    beside = base.rest_of(weighted)
    if not np.isfinite(size) or size <= TINY:
        return None
    surviving = float(np.linalg.norm(beside)) / size
    if not amplitudes:
        return float(np.sum((rest - beside[:, 0]) ** 2)), surviving, model
    sizes = np.asarray(np.linalg.lstsq(beside, rest, rcond=DEPENDENT)[0])
    start = model.start
    start[amplitudes] += sizes
    low, high = model.free_parameters.limits
    return float(np.sum((rest - beside @ sizes) ** 2)), surviving, model.with_values(np.clip(start, low, high))


def _columns(model: LoopModel, outputs: Array, places: Sequence[int]) -> Array:
    """(M, m, k) what a unit of these free parameters changes, by a difference as large as what is looked for."""
    return sensitivity(model, model.start, outputs, only=list(places), exact=False)
