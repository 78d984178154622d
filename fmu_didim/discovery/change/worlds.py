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

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.change.causes import Machine, constant, forms_of
from fmu_didim.discovery.change.contest import Form, Lack, World
from fmu_didim.discovery.change.difference import Difference
from fmu_didim.discovery.change.log_fit import (
    Known,
    LogFit,
    Promise,
    absent,
    at_best_minimum,
    fitted,
    gain,
    in_common,
    known,
    louder,
    promised,
    settled,
    shared,
)
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection.competition import fitted_proposal
from fmu_didim.discovery.selection.decide import BIC
from fmu_didim.discovery.selection.plausible import UNTOLD, ZERO, chance_of_none
from fmu_didim.dynamics.effects import Effect
from fmu_didim.dynamics.effects.inserted import InsertedEffect
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.model.free_parameter import FreeParameter, plain_name
from fmu_didim.model.loop_model import EffectAtJoint

FITTED = 6
"""[effects] That promise most in a log, with the values of the other log or with free ones, which are fitted in the
closed loop of both."""
PROMISING = 0.25
"""[1] Of the largest promise, below which an effect is not fitted: as in the screening of a discovery."""
SPURIOUS = 2.0
"""[1] Times the logarithm of the number of effects that were tried, which each has to gain more: the best of a hundred
that are not there gains about so much by noise."""
SECOND = 3
"""[effects] That promise most of what the best one leaves, which are fitted with it."""
COMMON = 3
"""[searches] At most, each beside the effects that both logs showed in those before."""
DECIDE = ("FITTED", "PROMISING", "SPURIOUS", "SECOND", "COMMON")
"""Those of these numbers on which an answer depends."""


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
        stiff: names of the stiffnesses among these values, which the difference has as compliances.
    """

    sides: tuple[LogFit, LogFit]
    difference: Difference
    known: tuple[Known, Known]
    between: Array | None = None
    stiff: frozenset[str] = frozenset()
    gain: float = 0.0
    cost: float = 0.0
    lacks: tuple[Lack, ...] = ()

    def known_of(self, k: int, fit: Fit, names: Sequence[str]) -> Known:
        """What the fit of a log says of the machine: of that before, which stands for a state, with its spread."""
        found = known(fit, names)
        if k == 0 and self.between is not None:
            count = len(self.between)
            found.covariance[:count, :count] += self.between
        return found


@dataclass(frozen=True)
class _Tried:
    """An effect, or two, fitted to each log, beside what both show; None where that is not a machine.

    Attributes:
        through: of one of two effects alone, through which what both explain is counted.
    """

    effects: tuple[EffectAtJoint, ...]
    fits: tuple[Fit | None, Fit | None]
    through: tuple[Fit | None, Fit | None] = (None, None)


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
        promises = [self._promised(k) for k in (0, 1)]
        count = max(len(every) for own in promises for every in own)
        self.penalty = SPURIOUS * float(np.log(max(count, 1))) / float(np.log(self.samples))
        wanted: dict[EffectAtJoint, Promise] = {}
        for every in (*promises[1], *promises[0]):
            for promise in every[:FITTED]:
                if promise.gain > max(PROMISING * every[0].gain, 0.0):
                    wanted.setdefault(promise.effect_at, promise)
        shown = [{p.effect_at for every in own for p in every if p.gain > 0} for own in promises]
        for effect_at, promise in wanted.items():
            self._try(promise, [effect_at in own for own in shown])
        loud = louder(self.ground.sides)
        for promise in self._of_many_minima(promises, loud):
            self._try(promise, [promise.effect_at.joint in joints for joints in loud])
        self._try_gears(promises)
        self.tried = [self._at_best_minima(tried, loud) for tried in self.tried]
        self._try_gears(promises)  # an elastic one, for which play at its best minimum may stand
        return [world for tried in self.tried for world in self._of(tried)]

    def _of_many_minima(
        self, promises: Sequence[Sequence[Sequence[Promise]]], loud: tuple[set[int], set[int]]
    ) -> list[Promise]:
        """The effects of many minima that nobody tried, on joints whose residual is larger in one log: their slope
        tells nothing of what they explain."""
        builder, asked = self.ground.sides[0].builder, {tried.effects[0] for tried in self.tried}
        found: dict[EffectAtJoint, Promise] = {}
        for every, joints in zip(promises, loud, strict=True):
            for promise in (each for own in every for each in own):
                effect_at = promise.effect_at
                if effect_at.joint in joints and effect_at not in asked and builder.effect(effect_at).has_minima:
                    found.setdefault(effect_at, promise)
        return list(found.values())

    def _at_best_minima(self, tried: _Tried, loud: tuple[set[int], set[int]]) -> _Tried:
        """An effect that explains a log, or whose joint has a larger residual there, at the best of its minima, where
        it has many: at another one it leaves something, and a second effect is found for that."""
        (effect_at,), fits = tried.effects, list(tried.fits)
        for k, found in enumerate(fits):
            if found is not None and shared(found):
                continue
            explains = found is not None and self._beyond(k, found, tried.effects) >= BIC
            if explains or effect_at.joint in loud[k]:
                fits[k] = at_best_minimum(self.ground.sides[k], found, effect_at, self.progress)
        return replace(tried, fits=(fits[0], fits[1]))

    def _promised(self, k: int, side: LogFit | None = None, but: Sequence[EffectAtJoint] = ()) -> list[list[Promise]]:
        """What each effect promises in a log, or beside what is fitted to it there already."""
        covered = self.covered | {(a.effect, a.joint) for a in but}
        return list(promised(side or self.ground.sides[k], self.ground.known[1 - k], covered, self.progress))

    def _try(self, promise: Promise, shows: Sequence[bool], *, if_nearer: bool = False) -> None:
        """Fit an effect to the logs that show it, and to the other one if these do; ``if_nearer`` as of ``fitted``."""
        effect_at, sides = promise.effect_at, self.ground.sides
        self.progress.say(f"fitting {effect_at.effect} on joint {effect_at.joint}")
        fits = [
            fitted(side, promise.starts, if_nearer=if_nearer) if own else None
            for side, own in zip(sides, shows, strict=True)
        ]
        self.tried.append(self._completed((effect_at,), fits, sides))

    def _try_gears(self, promises: Sequence[Sequence[Sequence[Promise]]]) -> None:
        """Fit the gears for which what explains a log may stand, and those for which these may."""
        while rivals := self._gears_beside(promises):
            for promise, shows in rivals:
                self._try(promise, shows, if_nearer=True)

    def _gears_beside(self, promises: Sequence[Sequence[Sequence[Promise]]]) -> list[tuple[Promise, list[bool]]]:
        """The gears that nobody tried, and that may be what an effect that explains a log stands for, with the logs
        to fit them to."""
        builder = self.ground.sides[0].builder
        asked = {tried.effects[0] for tried in self.tried}
        shows = [
            [t.effects[0] for t in self.tried if (f := t.fits[k]) and self._beyond(k, f, t.effects) >= BIC]
            for k in (0, 1)
        ]
        found: dict[EffectAtJoint, tuple[Promise, list[bool]]] = {}
        for k, every in enumerate(promises):
            for promise in (each for own in every for each in own if each.effect_at not in asked):
                if any(may_be_gear(builder, promise.effect_at, shown) for shown in shows[k]):
                    found.setdefault(promise.effect_at, (promise, [False, False]))[1][k] = True
        return list(found.values())

    def _completed(
        self, effects: tuple[EffectAtJoint, ...], fits: Sequence[Fit | None], sides: Sequence[LogFit],
        through: tuple[Fit | None, Fit | None] = (None, None),
    ) -> _Tried:  # fmt: skip
        """With the last of these effects in the log that does not promise it, too, where the other one shows it:
        what one log shows and the other one does not exclude is no change. Where that log by itself does not tell its
        values, they are those of the other one, as far as these are known."""
        found = list(fits)
        for k in (0, 1):
            other = found[1 - k]
            if found[k] is None and other is not None and self._beyond(1 - k, other, effects, through[1 - k]) > 0:
                start = fitted_proposal(other, effects[-1])
                found[k] = fitted(sides[k], [start]) or in_common(sides[k], other, effects[-1])
        return _Tried(effects, (found[0], found[1]), through)

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

    def _beyond(self, k: int, found: Fit, effects: Sequence[EffectAtJoint], through: Fit | None = None) -> float:
        """Chi-square by which a log is explained better beyond what so many values cost."""
        return gain(self.ground.sides[k], found, through) - self._cost(effects) * float(np.log(self.samples))

    def _in_one(self, k: int, when: str, tried: _Tried) -> World | None:
        """Effects in one of the logs."""
        found, ground = tried.fits[k], self.ground
        if found is None or shared(found):
            return None
        own = ground.known_of(k, found, ground.known[0].names)
        pair = (ground.known[0], own) if k == 1 else (own, ground.known[1])
        if not all(_is_told(ground.sides[k], found, effect_at) for effect_at in tried.effects):
            return None
        forms, amounts, deviations = zip(*(_form(ground.sides[k], found, a, when) for a in tried.effects), strict=True)
        fits = [side.fit for side in ground.sides]
        fits[k] = found
        return World(
            difference_of(ground.difference, *pair, stiff=ground.stiff), forms, amounts, deviations,
            ground.gain + gain(ground.sides[k], found, tried.through[k]), ground.cost + self._cost(tried.effects),
            ground.lacks, residual=_residual(*fits),
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
        first, second = self._as_known(tried)
        ground = self.ground
        if first is None or second is None:
            return None
        gained = sum(gain(*each) for each in zip(ground.sides, (first, second), tried.through, strict=True))
        if gained - self._cost(tried.effects) * float(np.log(self.samples)) < BIC:
            return None
        surely = all(
            self._beyond(k, f, tried.effects, tried.through[k]) >= BIC for k, f in enumerate((first, second))
        )  # fmt: skip
        one = shared(first) | shared(second)
        parts, lacks = zip(*(self._lack(first, a, one, is_sure=surely) for a in tried.effects), strict=True)
        free = [p for own in parts for p in own]
        names, stiff = (*ground.known[0].names, *(p.name for p in free)), ground.stiff.union(*(x.stiff for x in lacks))
        values = ground.known_of(0, first, names), ground.known_of(1, second, names)
        return _Ground(
            (LogFit(first, ground.sides[0].builder), LogFit(second, ground.sides[1].builder)),
            difference_of(ground.difference, *values, units=[p.unit for p in free], stiff=stiff), values,
            ground.between, stiff, ground.gain + gained, ground.cost + self._cost(tried.effects),
            (*ground.lacks, *lacks),
        )  # fmt: skip

    def _as_known(self, tried: _Tried) -> tuple[Fit | None, Fit | None]:
        """The fits of an effect, in a log that does not show it by itself with the values by which the other one knows
        it: whether it may be there is a question to that log, not to what a free fit makes of it, which may be none."""
        first, second = tried.fits
        if first is None or second is None or shared(first) or shared(second) or len(tried.effects) > 1:
            return first, second
        (effect_at,), shows = tried.effects, [self._shows(k, f, tried.effects) for k, f in enumerate((first, second))]
        if shows == [True, False]:
            second = in_common(self.ground.sides[1], first, effect_at)
        elif shows == [False, True]:
            first = in_common(self.ground.sides[0], second, effect_at)
        return first, second

    def _shows(self, k: int, found: Fit | None, effects: Sequence[EffectAtJoint]) -> bool:
        """Whether a log shows effects by itself."""
        return found is not None and self._beyond(k, found, effects) >= BIC

    def with_common(self) -> _Ground | None:
        """With the effect that both logs show most clearly; None where they show none."""
        best: tuple[float, _Ground] | None = None
        for tried in self.tried:
            if any(
                f is None or shared(f) or self._beyond(k, f, tried.effects) < BIC for k, f in enumerate(tried.fits)
            ):  # fmt: skip
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
        """The worlds of the best effect of each log, and of the gears for which it may stand, each fitted to its end,
        and of these with a second one: what a fit has not reached yet is no second effect."""
        builder = self.ground.sides[0].builder
        for k in (0, 1):
            alone = [
                (self._beyond(k, f, t.effects), t) for t in self.tried if (f := t.fits[k]) is not None and not shared(f)
            ]  # fmt: skip
            most, best = max(alone, key=lambda each: each[0], default=(0.0, None))
            if best is None or most <= BIC:
                continue
            gears = [
                t for own, t in alone if own >= BIC and may_be_gear(builder, t.effects[0], best.effects[0])
            ]  # fmt: skip
            for first in (best, *gears):
                fits = [None if f is None or shared(f) else settled(f) for f in first.fits]
                whole = self._completed(first.effects, fits, self.ground.sides)
                yield from self._of(whole)
                yield from self._seconds(k, whole)

    def _seconds(self, k: int, first: _Tried) -> Iterator[World]:
        own = first.fits[k]
        if own is None:
            return
        sides = [
            side if fit is None else LogFit(fit, side.builder)
            for side, fit in zip(self.ground.sides, first.fits, strict=True)
        ]
        promises = self._promised(k, sides[k], first.effects)
        wanted = {p.effect_at: p for every in promises for p in every[:SECOND] if p.gain > 0}
        waiting = [(promise, False) for promise in wanted.values()]
        least = BIC + self._beyond(k, own, first.effects)
        while waiting:
            promise, if_nearer = waiting.pop(0)
            second, effects = promise.effect_at, (*first.effects, promise.effect_at)
            self.progress.say(f"fitting {second.effect} on joint {second.joint} beside {first.effects[0].effect}")
            found = self._together(k, sides[k], first, promise, if_nearer=if_nearer)
            if found is None or self._beyond(k, found, effects, own) < least:
                continue
            for gear in (each for every in promises for each in every if each.effect_at not in wanted):
                if may_be_gear(sides[k].builder, gear.effect_at, second):
                    wanted[gear.effect_at] = gear
                    waiting.append((gear, True))
            if (gone := absent(sides[k], found, first.effects)) is not None:
                yield from self._in_place_of(gone, k, found, second)
                continue
            fits = [found, None] if k == 0 else [None, found]
            yield from self._of(
                _Tried(effects, (fits[0], fits[1]), first.fits) if first.fits[1 - k] is None
                else self._completed(effects, fits, sides, first.fits)
            )  # fmt: skip
            with suppress(FmuDidimError, np.linalg.LinAlgError):  # values that one log does not determine with it
                if (both := self._grown(first)) is not None:
                    yield from replace(self, ground=both)._of(_Tried((second,), (fits[0], fits[1])))
            with suppress(FmuDidimError, np.linalg.LinAlgError):
                yield from self._beside(k, found, first, second)

    def _together(
        self, k: int, side: LogFit, first: _Tried, promise: Promise, *, if_nearer: bool = False
    ) -> Fit | None:  # fmt: skip
        """A log with a second effect: it beside the first, or the first beside it where it explains the log alone, too,
        whichever ends nearer to the log, because each alone stands for a part of the other. ``if_nearer`` as of
        ``fitted``."""
        found, own = [fitted(side, promise.starts, if_nearer=if_nearer)], first.fits[k]
        second = (promise.effect_at,)
        alone = next((t.fits[k] for t in self.tried if t.effects == second), None)
        if alone is not None and own is not None and self._beyond(k, alone, second) >= BIC:
            found.append(fitted(LogFit(alone, side.builder), [fitted_proposal(own, first.effects[0])]))
        return min((fit for fit in found if fit is not None), key=lambda fit: fit.chi_square, default=None)

    def _in_place_of(self, gone: EffectAtJoint, k: int, found: Fit, second: EffectAtJoint) -> Iterator[World]:
        """A second effect with each that the first one is confounded with, where the first, which alone has stood for
        both, may be absent beside the second."""
        side, old = self.ground.sides[k], fitted_proposal(found, gone).values
        alone = fitted(side, [fitted_proposal(found, second)])
        if alone is None:
            return
        for name in side.builder.effect(gone).confounded_with:
            rival = EffectAtJoint(name, gone.joint)
            if name not in side.builder.effects or rival in found.model.added_effects:
                continue
            place = side.builder.at(rival)
            shared = {v.name for v in (*place.amplitudes, *place.shapes)} & old.keys()
            if place.is_present or not shared:
                continue
            self.progress.say(f"fitting {name} on joint {rival.joint} beside {second.effect}")
            start = Proposal(rival, {key: old[key] for key in shared})
            other = fitted(LogFit(alone, side.builder), [start])
            effects = (rival, second)
            if other is not None and self._beyond(k, other, effects, alone) >= BIC:
                pairs = [(f, None) if k == 0 else (None, f) for f in (other, alone)]
                yield from self._of(_Tried(effects, *pairs))

    def _beside(self, k: int, found: Fit, first: _Tried, second: EffectAtJoint) -> Iterator[World]:
        """Effects in one of the logs, beside a second one that both have: it shows in the one only once the first are
        there."""
        ground = self.ground
        other = fitted(ground.sides[1 - k], [fitted_proposal(found, second)])
        is_sure = self._shows(1 - k, other, [second])
        if not is_sure:
            other = in_common(ground.sides[1 - k], found, second)
        if other is None:
            return
        pair = (found, other) if k == 0 else (other, found)
        free, lack = self._lack(other, second, shared(other), is_sure=is_sure)
        names, when = (*ground.known[0].names, *(p.name for p in free)), "gone" if k == 0 else "new"
        stiff = ground.stiff | lack.stiff
        values = ground.known_of(0, pair[0], names), ground.known_of(1, pair[1], names)
        forms, amounts, deviations = zip(*(_form(ground.sides[k], found, a, when) for a in first.effects), strict=True)
        moved = difference_of(ground.difference, *values, units=[p.unit for p in free], stiff=stiff)
        yield World(
            moved, forms, amounts, deviations,
            ground.gain + gain(ground.sides[k], found, first.fits[k]) + gain(ground.sides[1 - k], other),
            ground.cost + self._cost((*first.effects, second)), (*ground.lacks, lack), residual=_residual(*pair),
        )  # fmt: skip

    def _lack(
        self, fit: Fit, effect_at: EffectAtJoint, one: Collection[str], *, is_sure: bool
    ) -> tuple[list[FreeParameter], Lack]:
        """An effect of a fit as one that both logs have, with its free parameters but for those that are ``one`` in
        both."""
        index, effect = fit.model.added_effects.index(effect_at), self.ground.sides[0].builder.effect(effect_at)
        free = [p for p in fit.model.free_parameters if p.effect == index and p.name not in one]
        stiff = [p.name for p in free if np.isinf(effect.neutral.get(plain_name(p.key, effect_at.joint), 0.0))]
        title, joint = _place(effect, effect_at), _joint(effect, effect_at)
        names = tuple(compared_as(p.name, stiff) for p in free)
        return free, Lack(effect_at.effect, joint, title, names, is_sure, frozenset(stiff))


def may_be_gear(builder: LoopModelBuilder, gear: EffectAtJoint, shown: EffectAtJoint) -> bool:
    """Whether an effect is a gear for which another one, that explains a log, may stand: what a gear of one joint does
    shows on others, and as what it is confounded with, but hardly in its own slope."""
    effect, other = builder.effect(gear), builder.effect(shown)
    if not effect.elastic or gear == shown:
        return False
    if gear.joint != shown.joint:
        return gear.effect == shown.effect
    return shown.effect in effect.confounded_with or gear.effect in other.confounded_with


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


def compared_as(name: str, stiff: Collection[str]) -> str:
    """A stiffness is compared as a compliance: that of a gear that hardly gives way is known, its stiffness is not."""
    return f"1/{name}" if name in stiff else name


def difference_of(
    base: Difference, first: Known, second: Known, units: Sequence[str] = (), stiff: Collection[str] = ()
) -> Difference:
    """The change between two logs.

    Args:
        base: without effects; units: of the values that effects add; stiff: names of stiffnesses among these.

    Raises:
        InputError: the covariances do not tell how far the values may be apart.
    """
    names = first.names
    is_stiff = np.array([name in stiff for name in names])
    added = zip(names[len(names) - len(units) :], units, strict=True)
    every = (*base.units, *(f"1/({unit})" if name in stiff else unit for name, unit in added))
    sides = [_as_compliances(each, is_stiff) for each in (first, second)]
    found = replace(
        base, names=tuple(compared_as(name, stiff) for name in names), units=every,
        before=sides[0].value, after=sides[1].value, covariance=sides[0].covariance + sides[1].covariance,
    )  # fmt: skip
    _ = found.total  # raises
    return found


def _as_compliances(known_of: Known, is_stiff: NDArray[np.bool_]) -> Known:
    """With the inverse of some of the values, and its covariance to first order."""
    value = np.where(is_stiff, 1 / np.where(is_stiff, known_of.value, 1.0), known_of.value)
    slope = np.where(is_stiff, -(value**2), 1.0)
    return replace(known_of, value=value, covariance=known_of.covariance * np.outer(slope, slope))


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


def _is_told(side: LogFit, fit: Fit, effect_at: EffectAtJoint) -> bool:
    """Whether the log, with the noise that its residual shows, tells the values of an effect: not a limit of its form,
    and not none; the shapes of none count."""
    neutral, index = side.builder.effect(effect_at).neutral, fit.model.added_effects.index(effect_at)
    own = [i for i, p in enumerate(fit.model.free_parameters) if p.effect == index and not p.is_shape]
    if not own:
        return True
    names = [plain_name(fit.model.free_parameters[i].key, effect_at.joint) for i in own]
    absent = np.array([neutral.get(name, 0.0) for name in names])
    values, covariance = fit.values[own], fit_uncertainty(fit).covariance[np.ix_(own, own)]
    if chance_of_none(values, covariance, absent) > ZERO:
        return False
    return bool((np.sqrt(np.diag(covariance)) <= UNTOLD * np.abs(values - absent)).any())


def forms_in(world: World, base: Sequence[str], machine: Machine | None) -> list[Form]:
    """What may move the values in a world: causes, and that what both logs have has grown.

    Args:
        base: names of the values that are compared without effects.
    """
    names = world.difference.names
    found = [f for f in forms_of(names, world.difference.units, machine) if f.kind != "parameter" or f.names[0] in base]
    for lack in (each for each in world.lacks if each.is_sure and each.names):  # else it is new, or gone
        table = np.eye(len(names))[:, [names.index(name) for name in lack.names]]
        units = tuple(world.difference.units[names.index(name)] for name in lack.names)
        found.append(Form(lack.kind, lack.joint, f"{lack.title}, changed", lack.names, units, constant(table)))
    return found
