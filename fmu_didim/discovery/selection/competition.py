"""The competition: every candidate is screened by its signature, the best are fitted in the closed loop.

Screening projects the base out of each signature: only the part that the present model cannot absorb counts.

    gain = |Q_c' r|^2 - cost log(N f),   Q_c = orthonormal basis of (I - Q Q') C,   Q of the sensitivities of the model

There samples count by the colour of r. An effect that is missing may be most of r and as slow as the motion, so that
hardly a sample counts: what the best candidates leave is looked at, too, and its colour taken
(:func:`~fmu_didim.fit.gap.bic_difference`).
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.harmonics import origin
from fmu_didim.discovery.progress import Progress, Say
from fmu_didim.discovery.screening.catalogue import Signature, SignatureCatalogue
from fmu_didim.discovery.selection.candidates import (
    Comparison,
    FittedCandidate,
    Fruitless,
    Outcome,
    ScreenedCandidate,
    TriedCandidate,
)
from fmu_didim.discovery.selection.plausible import implausible, unusual
from fmu_didim.dynamics.effects import Search
from fmu_didim.fit.base_projection import BLOCK, BaseProjection
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import bic_difference, bic_gain, explained_gap, joint_gaps
from fmu_didim.fit.noise.noise import effective_fraction
from fmu_didim.fit.solver.accuracy import with_fitting_substeps
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.free_parameter import PLANT, plain_name
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.model.workers import side_by_side

SURVIVING = 5e-3
"""[1] Fraction of a signature that must survive the projection; below, the base parameters absorb it whole."""
IDLE = 1e-7
"""[1] Fraction of the largest column of an effect below which another one is rounding."""
DEPENDENT = 1e-8
"""[1] Singular value of columns, relative to the largest, below which one tells nothing more."""
SHORTLIST = 6
"""[candidates] Fitted in the closed loop, beside the best of each class near them."""
WORTH = 0.25
"""[1] Fraction of the best gain of the screening below which a candidate is not fitted: it would have to explain four
times as much as its signature."""
FORESEEN = 3
"""[candidates] Fitted in any case where they explain most by the colour of what they leave: on a measured TX40 the
friction of a coupled wrist explains 69 % of chi-square, of which the colour of the residual before it leaves 3 % to
count."""
USUAL = 0.8
"""[1] Fraction of the gain of its best shapes from which others are taken, where machines have its amplitudes there: a
power of the velocity below one, and a drag that falls with one above it, are nearly alike beside viscous friction."""
LEADING = 0.75
"""[1] Fraction of the best gain from which a candidate leads, and further shapes of it are nearly as good."""
FURTHER = 3
"""[shapes] Largest number of those further shapes."""
REACH = 4.0
"""[1] A candidate in the torque balance lowers chi-square at most by so many times what its signature explains to first
order beside the base: if that does not reach the best fit so far, it is not fitted."""
SIZES = (0.5, 1.0, 2.0)
"""[1] Tried of an effect outside the torque balance, as multiples of that of its signature: gears rattle."""
ABREAST = 4
"""[candidates] Fitted against the same best so far, so that it does not matter which of them ends first."""
STARTS = 2
"""[starts] Number of those sizes and shapes from which it is fitted."""
SMALLER = (1.0, 0.3, 0.03)
"""[1] Fractions of the proposal from which a fit starts, one after the other, until one can be simulated and ends no
worse than the model without the effect."""
KEPT = 0.75
"""[1] Fraction of what an effect promises to first order that its fit must keep, or it starts with less of the effect:
beside a base that is tilted an offset kept 0.53 from its whole proposal, 0.97 from a thirtieth of it."""
HELD_FIRST = (0.0, 0.5, 1.0)
"""[1] Places in the range of a shape at which it is held while all else is fitted."""
HELD_UPDATES = 3
"""[sensitivities] Taken anew at most while it is held, and when it is released: the first ones are those of a base that
may be far off."""
GROWN = 1.5
"""[1] Times what a candidate promised when its fit was led astray, or in vain, that it must promise to be fitted again
while others are: on a measured TX40 a payload was fitted from three starts in each of five rounds, and never gained
anything, and friction that drifts with the temperature in three, each time to a negative BIC difference."""
LEAST = 5.0
"""[chi-square] By which a candidate must promise to lower it for its fit to be completed: less is no BIC difference
of 10."""


@dataclass(frozen=True)
class Competition:
    """The candidates for the next effect beside the present model.

    Attributes:
        builder: builds the loops with them; fit: of the present model.
        fruitless: candidates whose fit has brought nothing in a round before.
    """

    builder: LoopModelBuilder
    fit: Fit
    fruitless: Fruitless = field(default_factory=Fruitless)

    @cached_property
    def base(self) -> BaseProjection:
        """The projection of what the present model can absorb."""
        return BaseProjection.of_fit(self.fit)

    @cached_property
    def _white(self) -> BaseProjection:
        """The same in units of the noise, in which fits are compared."""
        return BaseProjection.of(self.fit.jacobian, 1 / self.fit.deviation)

    def screen(self, catalogue: SignatureCatalogue) -> list[ScreenedCandidate]:
        """All candidates that are not in the model yet, each at its best shapes, the best first."""
        builder, fit, base = self.builder, self.fit, self.base
        residual = base.rest_of(base.weighted(fit.residual))
        blocks = [own for _, own in fit.model.experiments.blocks(fit.residual)]
        count = sum(float(np.sum(effective_fraction(own)) * own.shape[0]) for own in blocks)
        # A class is named once on a joint: a second member would only correct the form of the first.
        named = {(builder.effect(a).class_name, a.joint) for a in fit.model.added_effects}
        asked = [s for s in catalogue if (builder.effect(s.effect_at).class_name, s.effect_at.joint) not in named]
        parts = [asked[first : first + BLOCK] for first in range(0, len(asked), BLOCK)]
        screened = side_by_side([partial(self._screened, p, residual, count) for p in parts], fit.model.workers)
        found: dict[EffectAtJoint, list[ScreenedCandidate]] = {}
        for candidate in chain.from_iterable(screened):
            found.setdefault(candidate.effect_at, []).append(candidate)
        best = [self._best(shapes) for shapes in found.values()]
        predicted = side_by_side([partial(self._predicted, s) for s in best], fit.model.workers)
        found_best = (replace(s, predicted=value) for s, value in zip(best, predicted, strict=True))
        return sorted(found_best, key=lambda s: -s.gain)

    def _screened(self, signatures: Sequence[Signature], residual: Array, count: float) -> list[ScreenedCandidate]:
        """Signatures that survive the projection, with what they explain of a weighted residual (N n,) of which so many
        samples count."""
        found = []
        rests = self.base.rests_of(signature.columns for signature in signatures)
        for signature, (table, rest) in zip(signatures, rests, strict=True):
            size = float(np.linalg.norm(table))
            surviving = float(np.linalg.norm(rest)) / size if size > 0 else 0.0
            if surviving < SURVIVING:
                continue
            coefficients = _coefficients(rest, residual)
            cost = self.builder.at(signature.effect_at).cost_with(signature.shapes) - _idle(table)
            gain = float(np.sum((rest @ coefficients) ** 2)) - cost * np.log(count)
            found.append(ScreenedCandidate(signature, coefficients, gain, surviving))
        return found

    def _predicted(self, candidate: ScreenedCandidate) -> float:
        """BIC difference of the fit to first order, with the base refitted."""
        fit, white = self.fit, self._white
        left = white.rest_of(white.weighted(fit.residual))
        rest = white.rest_of(white.weighted(candidate.signature.columns))
        before, after = (
            r.reshape(fit.residual.shape) * fit.deviation for r in (left, left - rest @ _coefficients(rest, left))
        )
        placed, shapes = self.builder.at(candidate.effect_at), candidate.signature.shapes
        cost = placed.cost_with(shapes) - _idle(candidate.signature.columns)
        return bic_difference(fit.model.experiments, before, after, cost, fit.noise)

    def _best(self, shapes: Sequence[ScreenedCandidate]) -> ScreenedCandidate:
        """A candidate at its best shapes, those first with which its amplitudes are as machines have them; one outside
        the torque balance with others."""
        ordered = sorted(shapes, key=lambda s: -s.gain)
        best = next((s for s in ordered if s.gain >= USUAL * ordered[0].gain and self._is_usual(s)), ordered[0])
        if (known := self._at_harmonic(ordered, best)) is not None:
            best = replace(best, of_motor=known)
        if self.builder.effect(best.effect_at).is_linear:
            return best
        near = [s for s in ordered if s is not best][:FURTHER]
        return replace(best, others=tuple(s for s in near if s.gain > LEADING * best.gain))

    def _at_harmonic(self, ordered: Sequence[ScreenedCandidate], best: ScreenedCandidate) -> ScreenedCandidate | None:
        """The first of the shapes of a candidate at a harmonic of the motor; None where its best shapes are at one, or
        where no motor is stated."""
        placed = self.builder.at(best.effect_at)
        known = [s for s in ordered if placed.cost_with(s.signature.shapes) < placed.cost]
        return known[0] if known and best not in known else None

    def at_harmonic(self, candidate: ScreenedCandidate) -> FittedCandidate | None:
        """A candidate fitted from the best harmonic of its motor; None where there is none, or none can be simulated.

        A larger ripple at another frequency, too small for a name itself, hides one of the motor.
        """
        found = None if candidate.of_motor is None else self.refit(candidate.of_motor.start)
        return None if found is None else self.assess(candidate.effect_at, found)

    def may_be(self, candidate: FittedCandidate, other: FittedCandidate) -> bool:
        """Whether two ripples may be one: of one class on one joint, less than a period apart over the range."""
        first, second = candidate.effect_at, other.effect_at
        builder = self.builder
        one_class = builder.effect(first).class_name == builder.effect(second).class_name
        if not one_class or first.joint != second.joint:
            return False
        own, theirs = (builder.shapes_in(c.fit, c.effect_at)[0] for c in (candidate, other))
        drift = builder.loop.ranges[first.joint - 1].drift
        return any(drift(own[n], theirs[n]) < 1 for n in builder.at(first).harmonics if n in own and n in theirs)

    def _is_usual(self, candidate: ScreenedCandidate) -> bool:
        """Whether its amplitudes are possible, and such as machines have."""
        effect, values = self.builder.effect(candidate.effect_at), dict(candidate.start.values)
        sure = dict.fromkeys(values, 0.0)
        return not (effect.impossible(values, sure, {}) or effect.unusual(values, sure))

    def shortlist(self, screened: Sequence[ScreenedCandidate], *, size: int = SHORTLIST) -> list[ScreenedCandidate]:
        """The candidates to fit: the best, the best of each class near them, a gear on all joints, and what every base
        model has but a black box lacks, whose signature tells little where the base has gone astray without it."""
        promising = [s for s in screened if s.gain > max(WORTH * screened[0].gain, 0.0)]
        chosen, classes = [], set()
        for place, s in enumerate(promising):
            key = (self.builder.effect(s.effect_at).class_name, s.effect_at.joint)
            if place < size or key not in classes:
                chosen.append(s)
                classes.add(key)
        # What a gear of one joint does shows on its neighbours too, and no signature tells whose gear it is.
        gears = {s.effect_at.effect for s in chosen if self.builder.effect(s.effect_at).shows_on_neighbours}
        more = [s for s in screened if (s.effect_at.effect in gears and s.gain > 0) or self._is_missing_base(s)]
        more += foreseen(screened)
        return [*chosen, *(s for i, s in enumerate(more) if s not in chosen and s not in more[:i])]

    def _is_missing_base(self, candidate: ScreenedCandidate) -> bool:
        """Whether every base model has this effect, and this one, a black box, lacks it."""
        return bool(self.builder.effect(candidate.effect_at).is_base)

    def compare(self, chosen: Sequence[ScreenedCandidate], *, progress: Progress, reach: float = REACH) -> Comparison:
        """Closed-loop fits of the chosen candidates, first those that explain most to first order, then on the joint
        with the largest gap.

        A candidate is not ranked if it cannot be simulated, cannot catch up with the best plausible one of the groups
        before it, or is not fitted when the time is up.

        Args:
            reach: see ``REACH``.
        """
        fit, chosen = self.fit, self._largest_gap_first(chosen)
        best = fit.chi_square - LEAST
        leading = LEADING * max((s.gain for s in chosen), default=0.0)
        report = progress.counted("fitting candidate", len(chosen))
        results, workers = list[FittedCandidate | Outcome](), fit.model.allowed_workers(fit.values)
        foretold = max((s.predicted for s in chosen), default=0.0)
        hopeful = [c.effect_at for c in chosen if not self._is_hopeless(c, best, reach, foretold)]
        self.builder.expect([(*fit.model.added_effects, a) for a in hopeful])
        for first in range(0, len(chosen), ABREAST):
            group = chosen[first : first + ABREAST]
            hopeless = [self._is_hopeless(candidate, best, reach, foretold) for candidate in group]
            wanted = [c.effect_at for c, is_left in zip(group, hopeless, strict=True) if not is_left]
            self.builder.prepare([(*fit.model.added_effects, a) for a in wanted], progress=progress, workers=workers)
            tasks = [
                partial(
                    self._outcome, candidate, best, is_left=is_left, scan=candidate.gain >= leading, progress=progress,
                    report=report,
                )
                for candidate, is_left in zip(group, hopeless, strict=True)
            ]  # fmt: skip
            results += side_by_side(tasks, workers)
            fitted = [c for c in results if not isinstance(c, Outcome) and not c.implausible]
            best = min([best, *(c.fit.chi_square for c in fitted)])
        self.builder.expect(())
        found = sorted((c for c in results if not isinstance(c, Outcome)), key=lambda c: -c.delta_bic)
        pairs = list(zip(chosen, results, strict=True))
        unfitted = tuple(candidate for candidate, result in pairs if result is Outcome.LEFT_EARLY)
        lost = {c.effect_at for c in found if fit.chi_square - c.fit.chi_square < LEAST}
        vain = {c.effect_at for c in found if c.delta_bic < 0 and not c.fit.given_up} - lost
        promised = {c.effect_at: self._promised(c) for c in chosen if c.effect_at in lost | vain}
        known = {effect_at: most for effect_at, most in promised.items() if np.isfinite(most)}
        return Comparison(
            tuple(found), tuple(_tried(c.effect_at, r) for c, r in pairs), unfitted,
            Fruitless(*({a: most for a, most in known.items() if a in those} for those in (lost, vain))),
        )  # fmt: skip

    def _is_hopeless(self, candidate: ScreenedCandidate, best: float, reach: float, foretold: float) -> bool:
        """Whether a candidate is not fitted while others are: it cannot reach the best, or it promises hardly more than
        before, when its fit was led astray, or was in vain and the best BIC difference foretold is far above its
        own."""
        if self._is_missing_base(candidate) or not np.isfinite(reach):
            return False
        promised, effect_at = self._promised(candidate), candidate.effect_at
        was_astray = promised <= GROWN * self.fruitless.astray.get(effect_at, 0.0)
        was_vain = promised <= GROWN * self.fruitless.vain.get(effect_at, 0.0) and candidate.predicted < WORTH * max(
            foretold, 0.0
        )
        return was_astray or was_vain or self.fit.chi_square - reach * promised > best

    def _outcome(
        self, candidate: ScreenedCandidate, best: float, *, is_left: bool, scan: bool, progress: Progress, report: Say
    ) -> FittedCandidate | Outcome:
        """A candidate fitted, or why it is not.

        Args:
            best: chi-square above which a fit is given up; is_left: whether it is not fitted at all.
            scan: whether sizes and shapes are tried in the loop first, where it lies outside the torque balance.
        """
        if progress.is_time_up:
            return Outcome.NOT_TRIED
        name = f"{candidate.effect_at.effect} on joint {candidate.effect_at.joint}"
        if is_left:
            report(f"{name} is left: out of reach of the best, or it gained nothing before")
            return Outcome.LEFT_EARLY
        starts = [candidate.start]
        if candidate.others is not None and scan:
            starts = self._scanned(candidate)
        found, promised = None, self._promised(candidate) if candidate.others is None else 0.0
        for start in starts:
            fitted = self.refit(start, give_up_above=best, until=progress.ends, promised=promised)
            if progress.is_time_up and (fitted is None or fitted.given_up):
                return Outcome.NOT_TRIED
            if fitted is not None and (found is None or fitted.chi_square < found.chi_square):
                found = fitted
                best = min(best, found.chi_square)
        found = self._shapes_held_first(candidate, found, until=progress.ends)
        if found is None:
            report(f"{name} cannot be simulated")
            return Outcome.NOT_SIMULABLE
        result = self.assess(candidate.effect_at, found)
        report(f"{name}, BIC difference {result.delta_bic:.0f}")
        return result

    def _largest_gap_first(self, chosen: Sequence[ScreenedCandidate]) -> list[ScreenedCandidate]:
        """Candidates by the gap of their joint, those of no joint in particular first; before all those that explain
        most to first order, so that what stays behind them is not fitted."""
        torque = self.fit.torque_alone
        gaps = joint_gaps(torque.residual, torque.noise)

        def gap(candidate: ScreenedCandidate) -> float:
            effect_at = candidate.effect_at
            own = len(self.builder.joints(effect_at.effect)) == gaps.size
            return float(gaps[effect_at.joint - 1] if own else gaps.max())

        first = [s.effect_at for s in foreseen(chosen)]
        return sorted(chosen, key=lambda s: (s.effect_at not in first, -gap(s)))

    def _promised(self, candidate: ScreenedCandidate) -> float:
        """By how much a candidate lowers chi-square to first order, with the base refitted; infinite outside the
        torque balance, where a signature is no slope."""
        if candidate.others is not None:
            return np.inf
        white = self._white
        rest = white.rest_of(white.weighted(candidate.signature.columns))
        return float(np.sum((rest @ _coefficients(rest, white.weighted(self.fit.residual))) ** 2))

    def finished(self, candidate: FittedCandidate) -> FittedCandidate:
        """A candidate whose fit was given up, fitted to its minimum: only there can held-out data judge it."""
        if not candidate.fit.given_up:
            return candidate
        found = minimise(
            candidate.fit.model, self.fit.noise, stopping=Stopping(updates=1, check_all=False),
            jacobian=candidate.fit.jacobian, outputs=candidate.fit.outputs,
        )  # fmt: skip
        return self.assess(candidate.effect_at, found)

    def with_shapes_held(self, candidate: ScreenedCandidate) -> Iterator[FittedCandidate]:
        """A candidate outside the torque balance fitted with its shapes held at those screened, the best first.

        Where the form of an effect is not quite right, free shapes compensate along one motion and fail on another.
        """
        for screened in (candidate, *(candidate.others or ())):
            fitted = self.refit(screened.start, hold=True)
            if fitted is not None:
                yield self.assess(candidate.effect_at, fitted)

    def _shapes_held_first(self, candidate: ScreenedCandidate, found: Fit | None, *, until: float) -> Fit | None:
        """The fit of a candidate, or a better one whose shapes are held until all else is fitted.

        Where a black box lacks an effect of every base model, the fit of the base may have gone astray, an inertia
        standing for friction: the slopes there lead the shapes away, to friction that is far too steep. So it starts
        from the values of the case, too.
        """
        effect_at, builder = candidate.effect_at, self.builder
        placed = builder.at(effect_at)
        if not (self._is_missing_base(candidate) and placed.shapes):
            return found
        proposal = candidate.start
        free = {p.name: p for p in placed.free_parameters(proposal, len(self.fit.model.added_effects))}
        begins = [None, *([] if self.fit.model.added_effects else [self._start_of_case])]
        for begin in begins:
            held = list[Fit]()
            for place in HELD_FIRST:
                shapes = {v.name: _at_place(placed.search[v.name], place) for v in placed.shapes}
                at_place = replace(proposal, values={**proposal.values, **shapes})
                fitted = self.refit(at_place, begin=begin, until=until, hold=True, updates=HELD_UPDATES)
                held += [fitted] if fitted is not None else []
            if not held:
                continue
            best = min(held, key=lambda fit: fit.chi_square)
            model = best.model.with_free(
                replace(p, lowest=free[p.name].lowest, highest=free[p.name].highest, value=float(value))
                if p.name in free
                else replace(p, value=float(value))
                for p, value in zip(best.model.free_parameters, best.values, strict=True)
            )
            stopping = Stopping(updates=HELD_UPDATES, until=until, check_all=False)
            released = minimise(model, self.fit.noise, stopping=stopping, outputs=best.outputs)
            found = released if found is None or released.chi_square < found.chi_square else found
        return found

    @property
    def _start_of_case(self) -> Array:
        """The present model with what is identified at the values of the case, where the loop may run with the effect
        alone."""
        model, start = self.fit.model, self.builder.start
        return np.array([start.get(name, value) for name, value in zip(model.names, self.fit.values, strict=True)])

    def _scanned(self, candidate: ScreenedCandidate) -> list[Proposal]:
        """Starts of a candidate outside the torque balance, the best first: sizes and shapes tried in the loop, with
        the base refitted to first order."""
        found = self.nearest([
            screened.signature.proposal(size * screened.coefficients)
            for screened in (candidate, *(candidate.others or ())) for size in SIZES
        ])  # fmt: skip
        return found or [candidate.start]  # a fit tries smaller ones

    def nearest(self, proposals: Sequence[Proposal]) -> list[Proposal]:
        """Those from which the loop, with the base refitted to first order, is nearest to the log, the best first;
        without those that cannot be simulated."""
        tried = [(self.misfit(proposal), place, proposal) for place, proposal in enumerate(proposals)]
        return [proposal for cost, _, proposal in sorted(tried)[:STARTS] if np.isfinite(cost)]

    def misfit(self, *proposals: Proposal, most_steps: float = np.inf) -> float:
        """Of the loop, with further effects or without, with the base refitted to first order; infinite where it cannot
        be simulated, or not with so many steps of the integration."""
        residual = self.fit.residual
        if proposals:
            model = self.builder.build(self.fit.model, proposals)
            values = np.clip(model.start, *model.free_parameters.limits)
            try:
                if np.isfinite(most_steps) and model.integration_steps(values) > most_steps:
                    return np.inf
                residual = model.output_residual(values)
            except SimulationError:
                return np.inf
        return float(np.sum(self.base.rest_of(self.base.weighted(residual)) ** 2))

    def assess(self, effect_at: EffectAtJoint, found: Fit) -> FittedCandidate:
        """The figures by which a fit with one more effect is judged."""
        builder, fit = self.builder, self.fit
        index = found.model.added_effects.index(effect_at)
        own = [i for i, p in enumerate(found.model.free_parameters) if p.effect == index and not p.is_shape]
        absent = len(builder.at(effect_at).amplitudes) - len(own)
        cost = builder.cost_in(found, effect_at) - absent - _idle(found.jacobian[:, :, own])
        gain = bic_gain(fit, found, cost, fit.noise)
        size, share = explained_gap(fit, found, fit.noise)
        raw = self.change_without(effect_at, found)
        whole = replace(found, model=replace(found.model, workers=fit.model.workers))
        effect, is_known = builder.effect(effect_at), bool(origin(builder, found, effect_at))
        why = implausible(whole, index, effect, builder.link_values(effect_at.joint))
        odd = unusual(whole, index, effect, builder.effects)
        return FittedCandidate(
            effect_at, whole, gain, size, share, raw, cost, why, odd, has_minima=effect.has_minima,
            is_measured=bool(effect.given_states), is_known=is_known,
            bends_gear=effect.needs_elastic and not effect.frequency,
        )  # fmt: skip

    def change_without(self, effect_at: EffectAtJoint, found: Fit, *, held_out: bool = False) -> float:
        """Largest RMS change of an output, such as the torque of a joint, in units of its noise, when an effect is
        taken out and nothing else changes; infinite if the loop cannot be run."""
        without = self.builder.without(found.model, found.model.added_effects.index(effect_at))
        try:
            if held_out:
                labels = found.model.experiments.validation_labels
                outputs = np.concatenate([found.simulation(label).outputs() for label in labels])
                change = outputs - np.concatenate(
                    [without.simulation(without.start, label).outputs() for label in labels]
                )
            else:
                labels = found.model.experiments.estimation_labels
                change = found.outputs - without.outputs(without.start)
        except SimulationError:
            return np.inf
        squares = (change / found.noise.deviation) ** 2
        if not found.model.experiments.channels:
            return float(np.sqrt(np.mean(squares, axis=0)).max())
        counts = np.maximum(found.model.experiments.output_counts_in(labels), 1.0)
        return float(np.sqrt(squares.sum(axis=0) / counts).max())

    def refit(
        self,
        proposal: Proposal,
        *,
        begin: Array | None = None,
        give_up_above: float = np.inf,
        until: float = np.inf,
        hold: bool = False,
        updates: int = 1,
        promised: float = 0.0,
    ) -> Fit | None:
        """The present model with one more effect, fitted; None if no start of it can be simulated.

        The present model is one of it, with nothing of the effect: a fit that ends above it was led astray, as where a
        drive at its limit makes the loop anything but linear, and starts again with less of the effect. So does one
        that ends well above what was promised, unless it was given up.

        Args:
            begin: values of the present model, where its fit does not begin from them.
            give_up_above, until, updates: see :func:`~fmu_didim.fit.solver.least_squares.minimise`.
            hold: whether its shapes stay as they are proposed.
            promised: by how much it lowers chi-square to first order.
        """

        def enough(found: Fit) -> float:
            return self.fit.chi_square - (0.0 if found.given_up else KEPT * promised)

        found: Fit | None = None
        for part in SMALLER:
            model = self._started(proposal, part, begin=begin, hold=hold)
            if model is None:
                return None
            fitted = self._fitted(model, begin is None, Stopping(
                updates=updates, give_up_above=give_up_above, until=until, check_all=False
            ))  # fmt: skip
            if fitted is not None and (found is None or fitted.chi_square < found.chi_square):
                found = fitted
            if found is not None and (found.chi_square <= enough(found) or clock.perf_counter() >= until):
                break
        return found

    def _started(self, proposal: Proposal, part: float, *, begin: Array | None, hold: bool) -> LoopModel | None:
        """The present model with one more effect at a part of its proposed size; None if all its parameters belong to
        effects that are there already. Arguments as of :meth:`refit`."""
        builder, fit = self.builder, self.fit
        present = fit.model if begin is None else fit.model.with_values(begin)
        neutral = builder.effect(proposal.effect_at).neutral
        values = dict(proposal.values)
        for name in (v.name for v in builder.at(proposal.effect_at).amplitudes if v.name in values):
            off = neutral.get(name, 0.0)
            if np.isfinite(off):
                values[name] = off + part * (values[name] - off)
            else:  # a stiffness, with nothing there when it is infinite
                values[name] = values[name] / part
        model = builder.build(present, [Proposal(proposal.effect_at, values, proposal.scales)])
        known = len(fit.model.free_parameters)
        if len(model.free_parameters) == known:
            return None
        low, high = model.free_parameters.limits
        start = np.clip(model.start, low, high)
        model = _shapes_held(model.with_values(start), known) if hold else model
        return replace(model.with_values(start), workers=1)  # several candidates are fitted side by side

    def _fitted(self, model: LoopModel, from_fit: bool, stopping: Stopping) -> Fit | None:
        """A model with one more effect fitted from its start; None if it cannot be simulated there.

        Args:
            from_fit: whether it starts where the fit of the present model ended, whose sensitivities are known there.
        """
        fit, start = self.fit, model.start
        if model.loop.own_states > fit.model.loop.own_states:  # they may be faster than what the base resolves
            model = with_fitting_substeps(model, start, fit.noise.deviation)
        known = len(fit.model.free_parameters) if from_fit else 0
        try:
            outputs = model.outputs(start)
            only = list(range(known, len(model.free_parameters)))
            slopes = sensitivity(model, start, outputs, only=only, exact=False, whole=False)
        except SimulationError:
            return None
        jacobian = np.concatenate([fit.jacobian[:, :, :known], slopes], axis=2)
        return minimise(model, fit.noise, stopping=stopping, jacobian=jacobian, outputs=outputs)


def foreseen(screened: Sequence[ScreenedCandidate]) -> list[ScreenedCandidate]:
    """The candidates that explain most by the colour of what they leave, the best first."""
    ordered = sorted((s for s in screened if s.predicted > 0), key=lambda s: -s.predicted)
    return [s for s in ordered[:FORESEEN] if s.predicted > WORTH * ordered[0].predicted]


def _tried(effect_at: EffectAtJoint, result: FittedCandidate | Outcome) -> TriedCandidate:
    if isinstance(result, Outcome):
        return TriedCandidate(effect_at, result)
    if result.fit.given_up:
        return TriedCandidate(effect_at, Outcome.LEFT_EARLY, result.delta_bic)
    return TriedCandidate(effect_at, Outcome.FITTED, result.delta_bic, result.share, result.cost, result.implausible)


def _coefficients(columns: Array, residual: Array) -> Array:
    """(m,) least squares of a residual (N n,) on columns (N n, m)."""
    if columns.shape[1] == 1:  # most are so, and a factorisation takes ten times as long
        return np.asarray(columns.T @ residual / np.sum(columns**2))
    return np.asarray(np.linalg.lstsq(columns, residual, rcond=DEPENDENT)[0], dtype=float)


def _idle(columns: Array) -> int:
    """Number of columns (..., m) that are rounding beside the largest."""
    if columns.shape[-1] == 1:
        return 0
    sizes = np.linalg.norm(columns.reshape(-1, columns.shape[-1]), axis=0)
    return int(np.sum(sizes <= IDLE * sizes.max(initial=0.0)))


def _at_place(search: Search, place: float) -> float:
    """The value at a place between the lowest, 0, and the highest of a grid, 1."""
    if search.logarithmic:
        return float(search.lowest * (search.highest / search.lowest) ** place)
    return float(search.lowest + place * (search.highest - search.lowest))


def _shapes_held(model: LoopModel, first: int) -> LoopModel:
    return model.with_free(p.held() if i >= first and p.is_shape else p for i, p in enumerate(model.free_parameters))


def proposal_of(found: FittedCandidate) -> Proposal:
    """The effect of a candidate with its fitted values, by their plain names."""
    return fitted_proposal(found.fit, found.effect_at)


def fitted_proposal(fit: Fit, effect_at: EffectAtJoint) -> Proposal:
    """An effect with the values that were fitted, by their plain names."""
    index = fit.model.added_effects.index(effect_at)
    values = {
        plain_name(parameter.key, effect_at.joint) if parameter.owner == PLANT else parameter.key: float(value)
        for parameter, value in zip(fit.model.free_parameters, fit.values, strict=True)
        if parameter.effect == index
    }
    return Proposal(effect_at, values)
