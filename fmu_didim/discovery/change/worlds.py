"""Effects that have come, gone or grown between two logs, each as a world in which the values are compared.

With the values v1 and the covariance C1 of the log before, an effect in the log after lowers to first order

    |r - S d - C e|^2 + |W1 (v2 + d - v1)|^2,       W1' W1 = C1^-1

over d (p,) and e, with the residual r, the sensitivity S and the signature C of the effect in units of the noise: an
effect that the values could absorb shows, too, because they have to be those of before. Where the values have changed
beside it, it shows without the second term. The best of both are fitted in the closed loop of both logs, with all
values free, and compared by the contest of causes. What the best one leaves of its log is screened once more in the
same way: so two that came, or went, together are found.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.change.causes import Machine, constant, forms_of
from fmu_didim.discovery.change.contest import Form, Lack, World
from fmu_didim.discovery.change.difference import Difference
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.competition import Competition, fitted_proposal
from fmu_didim.discovery.selection.decide import BIC
from fmu_didim.discovery.selection.plausible import implausible
from fmu_didim.dynamics.effects import Effect
from fmu_didim.dynamics.effects.inserted import InsertedEffect
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.fit.gap import bic_gain
from fmu_didim.fit.log_noise import residual_noise
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.free_parameter import FreeParameter, plain_name
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel

FITTED = 6
"""[effects] That promise most in a log, with the values of the other log or with free ones, which are fitted in the
closed loop of both."""
PROMISING = 0.25
"""[1] Of the largest promise, below which an effect is not fitted: as in the screening of a discovery."""
SPURIOUS = 2.0
"""[1] Times the logarithm of the number of effects that were tried, which each has to gain more: the best of a hundred
that are not there gains about so much by noise."""
SOFTER = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003)
"""[1] Of the stiffness that the slope of a stiff gear promises, tried as starts of the fit."""
LEFT_OVER = 1e-6
"""[1] Of a signature, below which the values absorb it whole."""
SECOND = 3
"""[effects] That promise most of what the best one leaves, which are fitted with it."""
UPDATES = 3
"""[sensitivities] Taken anew in the fit of an effect: the first ones are those of values that may be far off."""
SETTLED = 12
"""[sensitivities] At most, taken anew in the fit of the best effect: play in a gear needs six to ten."""
COMMON = 3
"""[searches] At most, each beside the effects that both logs showed in those before."""
BASE_FIT = Stopping(exact=True)
DECIDE = ("FITTED", "PROMISING", "SPURIOUS", "SECOND", "COMMON", "UPDATES", "SETTLED", "SOFTER")
"""Those of these numbers on which an answer depends."""


@dataclass(frozen=True)
class LogFit:
    """A log with the model that was identified from it, fitted.

    Attributes:
        fit: of the torque; builder: of the model with effects.
    """

    fit: Fit
    builder: LoopModelBuilder

    @staticmethod
    def of(model: LoopModel, description: RobotDescription | None, effects: Mapping[str, Effect]) -> LogFit:
        """From a model with the identified values as its start."""
        model = model.torque_alone
        spread = np.maximum(np.std(model.measured, axis=0), np.finfo(float).tiny)
        fit = minimise(model, Noise(spread, np.zeros(spread.size), "residual"), stopping=BASE_FIT)
        fit = minimise(model.with_values(fit.values), residual_noise(fit), stopping=BASE_FIT, outputs=fit.outputs)
        return LogFit(fit, LoopModelBuilder(fit.model, description, effects))

    @cached_property
    def competition(self) -> Competition:
        """With one more effect."""
        return Competition(self.builder, self.fit)

    def candidates(self) -> list[EffectAtJoint]:
        """Effects that the model lacks."""
        names = [name for name, effect in self.builder.effects.items() if effect.is_proposed]
        found = (EffectAtJoint(name, j) for name in names for j in self.builder.joints(name))
        added = self.fit.model.added_effects
        free = (a for a in found if not self.builder.at(a).is_present and a not in added)
        return [a for a in free if self.builder.has_place(a, added)]


@dataclass(frozen=True)
class Known:
    """What is known of the values of one log: names, (p,) values and (p, p) covariance of those that are compared."""

    names: tuple[str, ...]
    value: Array
    covariance: Array


def worlds_of(
    before: LogFit,
    after: LogFit,
    difference: Difference,
    known: tuple[Known, Known],
    progress: Progress,
    *,
    covered: frozenset[tuple[str, int]] = frozenset(),
    between: Array | None = None,
) -> list[World]:
    """The worlds in which an effect has come, gone or grown, or is there in both logs; beside the one without.

    Args:
        difference: the change of the values without effects; known: those of the log before and after.
        covered: effects at joints for which a cause of the values stands, which are not looked for a second time.
        between: (p, p) covariance of the values between logs of one state, which is in that of ``known`` before.
    """
    found, ground = list[World](), _Ground((before, after), difference, known, between)
    for _ in range(COMMON):
        search = _Search(ground, difference.samples, covered, progress)
        found += search.worlds()
        if (grown := search.with_common()) is None:
            return [*found, *search.with_second()]
        ground = grown
    return found


@dataclass(frozen=True)
class _Ground:
    """What worlds are built on: both logs, with the effects that both show.

    Attributes:
        sides: the logs; difference: of their values, with those of these effects; known: these of each log.
        between: covariance of the first of these values between logs of one state, beside their noise.
        gain: chi-square by which these effects explain both logs better; cost: values for that; lacks: these effects.
    """

    sides: tuple[LogFit, LogFit]
    difference: Difference
    known: tuple[Known, Known]
    between: Array | None = None
    gain: float = 0.0
    cost: float = 0.0
    lacks: tuple[Lack, ...] = ()

    def known_of(self, k: int, fit: Fit, names: Sequence[str]) -> Known:
        """What the fit of a log says of the machine: of that before, which stands for a state, with its spread."""
        found = _known(fit, names)
        if k == 0 and self.between is not None:
            count = len(self.between)
            found.covariance[:count, :count] += self.between
        return found


@dataclass(frozen=True)
class _Tried:
    """An effect, or two, fitted to each log, beside what both show; None where that is not a machine."""

    effects: tuple[EffectAtJoint, ...]
    fits: tuple[Fit | None, Fit | None]


def _fitted(side: LogFit, effect_at: EffectAtJoint, proposal: Proposal) -> Fit | None:
    """A log with an effect; None where it cannot be simulated, is no machine's, or does nothing to this log."""
    neutral = side.builder.effect(effect_at).neutral
    stiff = [name for name in proposal.values if np.isinf(neutral.get(name, 0.0))]
    if stiff:  # a soft gear is far from what the slope of a stiff one says
        softer = [
            replace(proposal, values={n: v * (part if n in stiff else 1.0) for n, v in proposal.values.items()})
            for part in SOFTER
        ]
        proposal = (side.competition.nearest(softer) or [proposal])[0]
    found = side.competition.refit(proposal, updates=UPDATES)
    if found is None or found.given_up or not np.abs(found.jacobian).max(axis=(0, 1)).all():
        return None
    return None if side.competition.assess(effect_at, found).implausible else found


def _promised(
    side: LogFit, other: Known, covered: frozenset[tuple[str, int]], progress: Progress
) -> tuple[list[tuple[EffectAtJoint, float, Proposal]], list[tuple[EffectAtJoint, float, Proposal]]]:
    """What each effect lowers the misfit of a log to first order, the best first: with the values of the other log as
    they are known, and with all values free, as where they have changed, too."""
    fit = side.fit
    places = [fit.model.names.index(name) for name in other.names]
    sizes, vectors = np.linalg.eigh(other.covariance)
    root = np.zeros((len(places), len(fit.model.names)))
    root[:, places] = (vectors / np.sqrt(np.maximum(sizes, np.finfo(float).tiny))).T
    weight = 1 / fit.deviation[:, None]
    table = (fit.jacobian * weight).reshape(-1, fit.values.size)
    residual = (fit.residual / fit.deviation).ravel()
    free = _Rows.of(table, residual)
    tied = _Rows.of(
        np.vstack([table, root]), np.append(residual, root[:, places] @ (other.value - fit.values[places]))
    )  # fmt: skip
    best: tuple[dict[EffectAtJoint, tuple[float, Proposal]], ...] = ({}, {})
    candidates = [a for a in side.candidates() if (a.effect, a.joint) not in covered]
    for signature in SignatureCatalogue(side.builder, fit, candidates=candidates, progress=progress):
        rows = (signature.columns * weight).reshape(-1, signature.columns.shape[2])
        cost = side.builder.at(signature.effect_at).cost * float(np.log(residual.size))
        for own, kind in zip(best, (tied, free), strict=True):
            promise = kind.gain(rows)
            if promise is None:
                continue
            gain, amounts = promise[0] - cost, promise[1]
            if signature.effect_at not in own or gain > own[signature.effect_at][0]:
                own[signature.effect_at] = gain, signature.proposal(amounts)
    first, second = (
        sorted(((a, gain, proposal) for a, (gain, proposal) in own.items()), key=lambda each: -each[1]) for own in best
    )
    return first, second


@dataclass(frozen=True)
class _Rows:
    """What is left of the rows of a linear problem beside the values of the model: an orthonormal basis (N, p) of what
    these can do, and the rest (N,) of the right side."""

    basis: Array
    rest: Array

    @staticmethod
    def of(table: Array, right: Array) -> _Rows:
        basis, _ = np.linalg.qr(table / np.maximum(np.linalg.norm(table, axis=0), np.finfo(float).tiny))
        return _Rows(basis, right - basis @ (basis.T @ right))

    def gain(self, rows: Array) -> tuple[float, Array] | None:
        """By how much columns (M, k), the first M of the rows, lower the sum of squares, and with which amounts; None
        where the values absorb one of them."""
        columns = np.vstack([rows, np.zeros((self.rest.size - len(rows), rows.shape[1]))])
        left = columns - self.basis @ (self.basis.T @ columns)
        if not (np.linalg.norm(left, axis=0) > LEFT_OVER * np.linalg.norm(columns, axis=0)).all():
            return None
        amounts = np.linalg.lstsq(left, self.rest, rcond=None)[0]
        return float(np.sum((left @ amounts) ** 2)), np.asarray(amounts)


def _gain(side: LogFit, found: Fit) -> float:
    """By how much a log is explained better, as a chi-square."""
    return bic_gain(side.fit, found, 0.0, side.fit.noise)


@dataclass
class _Search:
    """The effects that either log shows beside what both do.

    Attributes:
        ground: what is built on; samples: of both logs; covered, progress: as of :func:`worlds_of`.
        penalty: values that an effect costs more, because so many were tried; tried: what was fitted.
    """

    ground: _Ground
    samples: int
    covered: frozenset[tuple[str, int]]
    progress: Progress
    penalty: float = 0.0
    tried: list[_Tried] = field(default_factory=list)

    def worlds(self) -> list[World]:
        """Those of one effect."""
        sides, known = self.ground.sides, self.ground.known
        promised = [_promised(sides[k], known[1 - k], self.covered, self.progress) for k in (0, 1)]
        count = max(len(every) for own in promised for every in own)
        self.penalty = SPURIOUS * float(np.log(max(count, 1))) / float(np.log(self.samples))
        wanted: dict[EffectAtJoint, Proposal] = {}
        for every in (*promised[1], *promised[0]):
            for effect_at, gain, proposal in every[:FITTED]:
                if gain > max(PROMISING * every[0][1], 0.0):
                    wanted.setdefault(effect_at, proposal)
        shown = [{a for every in own for a, gain, _ in every if gain > 0} for own in promised]
        for effect_at, proposal in wanted.items():
            self.progress.say(f"fitting {effect_at.effect} on joint {effect_at.joint}")
            fits = [
                _fitted(side, effect_at, proposal) if effect_at in own else None
                for side, own in zip(sides, shown, strict=True)
            ]
            self.tried.append(self._completed((effect_at,), fits, sides))
        return [world for tried in self.tried for world in self._of(tried)]

    def _completed(
        self, effects: tuple[EffectAtJoint, ...], fits: Sequence[Fit | None], sides: Sequence[LogFit]
    ) -> _Tried:
        """With the last of these effects in the log that does not promise it, too, where the other one shows it:
        what one log shows and the other one does not exclude is no change."""
        found = list(fits)
        for k in (0, 1):
            other = found[1 - k]
            if found[k] is None and other is not None and self._beyond(1 - k, other, effects) > 0:
                found[k] = _fitted(sides[k], effects[-1], fitted_proposal(other, effects[-1]))
        return _Tried(effects, (found[0], found[1]))

    def _of(self, tried: _Tried) -> Iterator[World]:
        """The worlds in which effects are in one log, or in both."""
        for make in (partial(self._in_one, 1, "new"), partial(self._in_one, 0, "gone"), self._in_both):
            try:
                if (world := make(tried)) is not None:
                    yield world
            except (FmuDidimError, np.linalg.LinAlgError):  # values that one log does not determine with it
                continue

    def _cost(self, effects: Sequence[EffectAtJoint]) -> float:
        return sum(self.ground.sides[0].builder.at(a).cost + self.penalty for a in effects)

    def _beyond(self, k: int, found: Fit, effects: Sequence[EffectAtJoint]) -> float:
        """Chi-square by which a log is explained better beyond what so many values cost."""
        return _gain(self.ground.sides[k], found) - self._cost(effects) * float(np.log(self.samples))

    def _in_one(self, k: int, when: str, tried: _Tried) -> World | None:
        """Effects in one of the logs."""
        found, ground = tried.fits[k], self.ground
        if found is None:
            return None
        own = ground.known_of(k, found, ground.difference.names)
        pair = (ground.known[0], own) if k == 1 else (own, ground.known[1])
        forms, amounts, deviations = zip(*(_form(ground.sides[k], found, a, when) for a in tried.effects), strict=True)
        fits = [side.fit for side in ground.sides]
        fits[k] = found
        return World(
            _difference(ground.difference, *pair), forms, amounts, deviations,
            ground.gain + _gain(ground.sides[k], found), ground.cost + self._cost(tried.effects), ground.lacks,
            residual=_residual(*fits),
        )  # fmt: skip

    def _in_both(self, tried: _Tried) -> World | None:
        """Effects in both logs, their values among those that are compared."""
        grown = self._grown(tried)
        if grown is None:
            return None
        return World(
            grown.difference, gain=grown.gain, cost=grown.cost, lacks=grown.lacks,
            residual=_residual(*(side.fit for side in grown.sides)),
        )  # fmt: skip

    def _grown(self, tried: _Tried) -> _Ground | None:
        """Both logs with these effects; None where they do not explain both together better."""
        first, second = tried.fits
        ground = self.ground
        if first is None or second is None:
            return None
        gain = sum(_gain(*pair) for pair in zip(ground.sides, (first, second), strict=True))
        if gain - self._cost(tried.effects) * float(np.log(self.samples)) < BIC:
            return None
        surely = all(self._beyond(k, f, tried.effects) >= BIC for k, f in enumerate((first, second)))
        parts, lacks = zip(*(self._lack(first, a, is_sure=surely) for a in tried.effects), strict=True)
        free = [p for own in parts for p in own]
        names = (*ground.known[0].names, *(p.name for p in free))
        known = ground.known_of(0, first, names), ground.known_of(1, second, names)
        return _Ground(
            (LogFit(first, ground.sides[0].builder), LogFit(second, ground.sides[1].builder)),
            _difference(ground.difference, *known, units=[p.unit for p in free]), known, ground.between,
            ground.gain + gain, ground.cost + self._cost(tried.effects), (*ground.lacks, *lacks),
        )  # fmt: skip

    def with_common(self) -> _Ground | None:
        """With the effect that both logs show most clearly; None where they show none."""
        best: tuple[float, _Ground] | None = None
        for tried in self.tried:
            if any(f is None or self._beyond(k, f, tried.effects) < BIC for k, f in enumerate(tried.fits)):
                continue
            try:
                grown = self._grown(tried)
            except (FmuDidimError, np.linalg.LinAlgError):
                continue
            if grown is not None:
                value = grown.gain - grown.cost * float(np.log(self.samples))
                if best is None or value > best[0]:
                    best = value, grown
        return None if best is None else best[1]

    def with_second(self) -> Iterator[World]:
        """The worlds of the best effect of each log, fitted to its end, and of that with a second one: what its fit
        has not reached yet is no second effect."""
        for k in (0, 1):
            alone = [(self._beyond(k, f, t.effects), t) for t in self.tried if (f := t.fits[k]) is not None]
            gain, first = max(alone, key=lambda each: each[0], default=(0.0, None))
            if first is None or gain <= BIC:
                continue
            first = _Tried(first.effects, (_settled(first.fits[0]), _settled(first.fits[1])))
            yield from self._of(first)
            yield from self._seconds(k, first)

    def _seconds(self, k: int, first: _Tried) -> Iterator[World]:
        sides = [
            side if fit is None else LogFit(fit, side.builder)
            for side, fit in zip(self.ground.sides, first.fits, strict=True)
        ]
        covered = self.covered | {(a.effect, a.joint) for a in first.effects}
        promised = _promised(sides[k], self.ground.known[1 - k], covered, self.progress)
        wanted = {a: p for every in promised for a, gain, p in every[:SECOND] if gain > 0}
        own = first.fits[k]
        least = BIC + (0.0 if own is None else self._beyond(k, own, first.effects))
        for effect_at, proposal in wanted.items():
            self.progress.say(f"fitting {effect_at.effect} on joint {effect_at.joint} beside {first.effects[0].effect}")
            found, effects = _fitted(sides[k], effect_at, proposal), (*first.effects, effect_at)
            if found is None or self._beyond(k, found, effects) < least:
                continue
            if absent := _absent(sides[k], found, first.effects):
                yield from self._in_place_of(absent, k, found, effect_at)
                continue
            fits = [found, None] if k == 0 else [None, found]
            alone = first.fits[1 - k] is None
            yield from self._of(_Tried(effects, (fits[0], fits[1])) if alone else self._completed(effects, fits, sides))
            with suppress(FmuDidimError, np.linalg.LinAlgError):  # values that one log does not determine with it
                yield from self._beside(k, found, first.effects, effect_at)

    def _in_place_of(self, absent: EffectAtJoint, k: int, found: Fit, second: EffectAtJoint) -> Iterator[World]:
        """A second effect with each that the first one is confounded with, where the first, which alone has stood for
        both, may be absent beside the second."""
        side, old = self.ground.sides[k], fitted_proposal(found, absent).values
        alone = _fitted(side, second, fitted_proposal(found, second))
        if alone is None:
            return
        for name in side.builder.effect(absent).confounded_with:
            rival = EffectAtJoint(name, absent.joint)
            if name not in side.builder.effects or rival in found.model.added_effects:
                continue
            place = side.builder.at(rival)
            shared = {v.name for v in (*place.amplitudes, *place.shapes)} & old.keys()
            if place.is_present or not shared:
                continue
            self.progress.say(f"fitting {name} on joint {rival.joint} beside {second.effect}")
            start = Proposal(rival, {key: old[key] for key in shared})
            other = _fitted(LogFit(alone, side.builder), rival, start)
            effects = (rival, second)
            if other is not None and self._beyond(k, other, effects) >= BIC:
                yield from self._of(_Tried(effects, (other, None) if k == 0 else (None, other)))

    def _beside(self, k: int, found: Fit, effects: tuple[EffectAtJoint, ...], second: EffectAtJoint) -> Iterator[World]:
        """Effects in one of the logs, beside a second one that both have: it shows in the one only once the first are
        there."""
        ground = self.ground
        other = _fitted(ground.sides[1 - k], second, fitted_proposal(found, second))
        if other is None:
            return
        pair = (found, other) if k == 0 else (other, found)
        free, lack = self._lack(other, second, is_sure=self._beyond(1 - k, other, [second]) >= BIC)
        names, when = (*ground.known[0].names, *lack.names), "gone" if k == 0 else "new"
        known = ground.known_of(0, pair[0], names), ground.known_of(1, pair[1], names)
        forms, amounts, deviations = zip(*(_form(ground.sides[k], found, a, when) for a in effects), strict=True)
        yield World(
            _difference(ground.difference, *known, units=[p.unit for p in free]), forms, amounts, deviations,
            ground.gain + _gain(ground.sides[k], found) + _gain(ground.sides[1 - k], other),
            ground.cost + self._cost((*effects, second)), (*ground.lacks, lack), residual=_residual(*pair),
        )  # fmt: skip

    def _lack(self, fit: Fit, effect_at: EffectAtJoint, *, is_sure: bool) -> tuple[list[FreeParameter], Lack]:
        """An effect of a fit as one that both logs have, with its free parameters."""
        index, effect = fit.model.added_effects.index(effect_at), self.ground.sides[0].builder.effect(effect_at)
        free = [p for p in fit.model.free_parameters if p.effect == index]
        names = tuple(p.name for p in free)
        title, joint = _place(effect, effect_at), _joint(effect, effect_at)
        return free, Lack(effect_at.effect, joint, title, names, is_sure=is_sure)


def _absent(side: LogFit, found: Fit, effects: Sequence[EffectAtJoint]) -> EffectAtJoint | None:
    """The first of these effects whose values in a fit say that it may be absent, or is no machine's; None of none."""
    for effect_at in effects:
        index, builder = found.model.added_effects.index(effect_at), side.builder
        if implausible(found, index, builder.effect(effect_at), builder.link_values(effect_at.joint)):
            return effect_at
    return None


def _settled(fit: Fit | None) -> Fit | None:
    """A fit that has come to its end."""
    if fit is None:
        return None
    stopping = Stopping(updates=SETTLED, check_all=False)
    return minimise(fit.model, fit.noise, stopping=stopping, jacobian=fit.jacobian, outputs=fit.outputs)


def _residual(first: Fit, second: Fit) -> Array:
    """(2, n) root mean square of what two fits leave."""
    return np.array([np.sqrt(np.mean(fit.residual**2, axis=0)) for fit in (first, second)])


def _place(effect: Effect, effect_at: EffectAtJoint) -> str:
    """An effect and its joint, where it is of one, in words."""
    joint = _joint(effect, effect_at)
    return f"{effect.title.lower()}{f' on joint {joint}' if joint else ''}"


def _is_gain_of_drive(effect: Effect) -> bool:
    """Whether an effect is one factor behind what the log shows."""
    is_behind = isinstance(effect, InsertedEffect) and effect.logged == "before"
    return is_behind and [p.unit for p in effect.own_parameters] == ["1"]


def _joint(effect: Effect, effect_at: EffectAtJoint) -> int:
    """0 where it is of none."""
    return 0 if effect.is_of_log or effect.acts_on_base else effect_at.joint


def _known(fit: Fit, names: Sequence[str]) -> Known:
    places = [fit.model.names.index(name) for name in names]
    return Known(tuple(names), fit.values[places], fit_uncertainty(fit).covariance[np.ix_(places, places)])


def _difference(base: Difference, first: Known, second: Known, units: Sequence[str] = ()) -> Difference:
    found = replace(
        base, names=first.names, units=(*base.units, *units), before=first.value, after=second.value,
        covariance=first.covariance + second.covariance,
    )  # fmt: skip
    _ = found.total  # raises where the covariances do not tell it
    return found


def _form(side: LogFit, fit: Fit, effect_at: EffectAtJoint, when: str) -> tuple[Form, Array, Array]:
    """The effect as a cause, with its values."""
    effect, deviation = side.builder.effect(effect_at), fit_uncertainty(fit).deviation
    index = fit.model.added_effects.index(effect_at)
    own = [i for i, p in enumerate(fit.model.free_parameters) if p.effect == index]
    names = tuple(plain_name(fit.model.free_parameters[i].key, effect_at.joint) for i in own)
    units = tuple("" if (unit := fit.model.free_parameters[i].unit) == "1" else unit for i in own)
    title = f"{_place(effect, effect_at)}, {when}"
    none = np.zeros((len(fit.model.names), 0))
    joint = _joint(effect, effect_at)
    scales = frozenset({joint} if _is_gain_of_drive(effect) else ())
    form = Form(effect_at.effect, joint, title, names, units, lambda x: none, scales=scales)
    return form, fit.values[own], deviation[own]


def forms_in(world: World, base: Sequence[str], machine: Machine | None) -> list[Form]:
    """What may move the values in a world: causes, and that what both logs have has grown.

    Args:
        base: names of the values that are compared without effects.
    """
    names = world.difference.names
    found = [f for f in forms_of(names, world.difference.units, machine) if f.kind != "parameter" or f.names[0] in base]
    for lack in (each for each in world.lacks if each.is_sure):  # else it is new, or gone
        table = np.eye(len(names))[:, [names.index(name) for name in lack.names]]
        units = tuple(world.difference.units[names.index(name)] for name in lack.names)
        found.append(Form(lack.kind, lack.joint, f"{lack.title}, changed", lack.names, units, constant(table)))
    return found
