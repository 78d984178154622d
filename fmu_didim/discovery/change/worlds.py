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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.change.causes import Machine, forms_of
from fmu_didim.discovery.change.contest import Form, World
from fmu_didim.discovery.change.difference import Difference
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import BIC
from fmu_didim.dynamics.effects import Effect
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.fit.gap import bic_gain
from fmu_didim.fit.log_noise import residual_noise
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.free_parameter import plain_name
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel

FITTED = 6
"""[effects] That promise most in a log, with the values of the other log or with free ones, which are fitted in the
closed loop of both."""
PROMISING = 0.25
"""[1] Of the largest promise, below which an effect is not fitted: as in the screening of a discovery."""
SPURIOUS = 2.0
"""[1] Times the logarithm of the number of effects that were tried, which each has to gain more: the best of a hundred
that are not there gains about so much by noise."""
LEFT_OVER = 1e-6
"""[1] Of a signature, below which the values absorb it whole."""
SECOND = 3
"""[effects] That promise most of what the best one leaves, which are fitted with it."""
UPDATES = 3
"""[sensitivities] Taken anew in the fit of an effect: the first ones are those of values that may be far off."""
BASE_FIT = Stopping(exact=True)


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
        return [a for a in found if not self.builder.at(a).is_present and a not in added]


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
) -> list[World]:
    """The worlds in which an effect has come, gone or grown, or is there in both logs; beside the one without.

    Args:
        difference: the change of the values without effects; known: those of the log before and after.
        covered: effects at joints for which a cause of the values stands, which are not looked for a second time.
    """
    found: list[World] = []
    sides = (before, after)
    promised = [_promised(sides[k], known[1 - k], covered, progress) for k in (0, 1)]
    tried = max(len(every) for own in promised for every in own)
    wanted: dict[EffectAtJoint, Proposal] = {}
    for every in (*promised[1], *promised[0]):
        for effect_at, gain, proposal in every[:FITTED]:
            if gain > max(PROMISING * every[0][1], 0.0):
                wanted.setdefault(effect_at, proposal)
    penalty = SPURIOUS * float(np.log(max(tried, 1))) / float(np.log(difference.samples))
    promising = [{a for every in own for a, gain, _ in every if gain > 0} for own in promised]
    alone = _Alone(sides, difference, known, penalty, covered, progress)
    for effect_at, proposal in wanted.items():
        progress.say(f"fitting {effect_at.effect} on joint {effect_at.joint}")
        fits = [
            _fitted(side, effect_at, proposal) if effect_at in own else None
            for side, own in zip(sides, promising, strict=True)
        ]
        for make in (partial(_in_one, 1, "new"), partial(_in_one, 0, "gone"), _in_both):
            try:
                if (world := make(sides, fits, effect_at, difference, known, penalty)) is not None:
                    found.append(world)
            except (FmuDidimError, np.linalg.LinAlgError):  # values that one log does not determine with it
                continue
        alone.fitted(effect_at, fits)
    return [*found, *alone.with_second()]


def _fitted(side: LogFit, effect_at: EffectAtJoint, proposal: Proposal) -> Fit | None:
    """A log with an effect; None where it cannot be simulated, is no machine's, or does nothing to this log."""
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


def _in_one(
    k: int, when: str, sides: tuple[LogFit, LogFit], fitted: Sequence[Fit | None], effect_at: EffectAtJoint,
    difference: Difference, known: tuple[Known, Known], penalty: float,
) -> World | None:  # fmt: skip
    """The effect in one of the logs."""
    found = fitted[k]
    if found is None:
        return None
    own = _known(found, difference.names)
    pair = (known[0], own) if k == 1 else (own, known[1])
    form, amounts, deviations = _form(sides[k], found, effect_at, when)
    fits = [side.fit for side in sides]
    fits[k] = found
    return World(
        _difference(difference, *pair), (form,), (amounts,), (deviations,), _gain(sides[k], found),
        sides[k].builder.at(effect_at).cost + penalty, residual=_residual(*fits),
    )  # fmt: skip


@dataclass
class _Alone:
    """Effects of one log alone, of which the best is fitted with a second one.

    Attributes:
        sides, difference, known, penalty, covered, progress: as of the search for the first one.
        best: by log, what is gained beyond the cost, the effect and its fit.
    """

    sides: tuple[LogFit, LogFit]
    difference: Difference
    known: tuple[Known, Known]
    penalty: float
    covered: frozenset[tuple[str, int]]
    progress: Progress
    best: dict[int, tuple[float, EffectAtJoint, Fit]] = field(default_factory=dict)

    def _beyond(self, k: int, found: Fit, effects: Sequence[EffectAtJoint]) -> float:
        """Chi-square that is gained beyond what so many values cost."""
        cost = sum(self.sides[k].builder.at(a).cost + self.penalty for a in effects)
        return _gain(self.sides[k], found) - cost * float(np.log(self.difference.samples))

    def fitted(self, effect_at: EffectAtJoint, fits: Sequence[Fit | None]) -> None:
        """Take note of an effect that was fitted in each log."""
        for k, found in enumerate(fits):
            if found is None:
                continue
            gain = self._beyond(k, found, [effect_at])
            if gain > max(BIC, self.best[k][0] if k in self.best else 0.0):
                self.best[k] = gain, effect_at, found

    def with_second(self) -> list[World]:
        """The worlds of the best effect of each log and a second one."""
        worlds = list[World]()
        for k, (first_gain, first, fit) in self.best.items():
            grown = LogFit(fit, self.sides[k].builder)
            covered = self.covered | {(first.effect, first.joint)}
            promised = _promised(grown, self.known[1 - k], covered, self.progress)
            wanted = {a: p for every in promised for a, gain, p in every[:SECOND] if gain > 0}
            for effect_at, proposal in wanted.items():
                self.progress.say(f"fitting {effect_at.effect} on joint {effect_at.joint} beside {first.effect}")
                found = _fitted(grown, effect_at, proposal)
                if found is None or self._beyond(k, found, [first, effect_at]) - first_gain < BIC:
                    continue
                try:
                    worlds.append(self._world(k, found, (first, effect_at)))
                except (FmuDidimError, np.linalg.LinAlgError):  # values that the log does not determine with both
                    continue
        return worlds

    def _world(self, k: int, found: Fit, effects: tuple[EffectAtJoint, EffectAtJoint]) -> World:
        """Both effects in one log."""
        own = _known(found, self.difference.names)
        pair = (self.known[0], own) if k == 1 else (own, self.known[1])
        forms, amounts, deviations = zip(
            *(_form(self.sides[k], found, a, "new" if k == 1 else "gone") for a in effects), strict=True
        )
        fits = [side.fit for side in self.sides]
        fits[k] = found
        cost = sum(self.sides[k].builder.at(a).cost + self.penalty for a in effects)
        return World(
            _difference(self.difference, *pair), forms, amounts, deviations, _gain(self.sides[k], found), cost,
            residual=_residual(*fits),
        )  # fmt: skip


def _in_both(
    sides: tuple[LogFit, LogFit], fitted: Sequence[Fit | None], effect_at: EffectAtJoint, difference: Difference,
    known: tuple[Known, Known], penalty: float,
) -> World | None:  # fmt: skip
    """The effect in both logs, its values among those that are compared."""
    first, second = fitted
    if first is None or second is None:
        return None
    gains = [_gain(*pair) for pair in zip(sides, (first, second), strict=True)]
    cost = sides[0].builder.at(effect_at).cost
    if min(gains) < BIC + cost * float(np.log(difference.samples)):
        return None  # what both logs lack shows in each of them
    own = [name for name, p in zip(first.model.names, first.model.free_parameters, strict=True) if p.effect is not None]
    names = (*difference.names, *own)
    pair = _known(first, names), _known(second, names)
    effect = sides[0].builder.effect(effect_at)
    return World(
        _difference(difference, *pair, units=[p.unit for p in first.model.free_parameters if p.name in own]),
        gain=sum(gains), cost=cost + penalty, lacks=_place(effect, effect_at), residual=_residual(first, second),
    )  # fmt: skip


def _residual(first: Fit, second: Fit) -> Array:
    """(2, n) root mean square of what two fits leave."""
    return np.array([np.sqrt(np.mean(fit.residual**2, axis=0)) for fit in (first, second)])


def _place(effect: Effect, effect_at: EffectAtJoint) -> str:
    """An effect and its joint, where it is of one, in words."""
    whole = effect.is_of_log or effect.acts_on_base
    return f"{effect.title.lower()}{'' if whole else f' on joint {effect_at.joint}'}"


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
    joint = 0 if effect.is_of_log or effect.acts_on_base else effect_at.joint
    title = f"{_place(effect, effect_at)}, {when}"
    none = np.zeros((len(fit.model.names), 0))
    form = Form(effect_at.effect, joint, title, names, units, lambda x: none)
    return form, fit.values[own], deviation[own]


def forms_in(world: World, base: Sequence[str], machine: Machine | None) -> list[Form]:
    """What may move the values in a world: causes, and that what both logs have has grown.

    Args:
        base: names of the values that are compared without effects.
    """
    names = world.difference.names
    own = [i for i, name in enumerate(names) if name not in base]
    found = [f for f in forms_of(names, world.difference.units, machine) if f.kind != "parameter" or f.names[0] in base]
    if own:
        table = np.eye(len(names))[:, own]
        units = tuple(world.difference.units[i] for i in own)
        title = f"{world.lacks}, changed"
        found.append(Form("grown", 0, title, tuple(names[i] for i in own), units, lambda x: table))
    return found
