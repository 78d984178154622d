"""The contest of causes: which of them alone, or which two together, explain the change of the values.

Each form of a cause says along which columns A(x) (p, k) the values move, where x (s,) may be the place of a payload.
Its fit minimises T_A (:mod:`fmu_didim.discovery.change.difference`) over x. A form explains the change where what it
leaves is noise, or beyond that a small part of the change: no form is exact. Among those that do, the criterion

    BIC = T_A + (k + s) log N,       N: samples of both logs

decides as in the discovery of effects: causes that are nearer to the best than its margin are named with it. A cause
that contains another one, as friction of each joint contains that of one, has to be better by that margin: else it is
no rival of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from fmu_didim.data.signals import Array
from fmu_didim.discovery.change.difference import CHANGED, Difference
from fmu_didim.discovery.selection.decide import BIC, NEAR

LACK = 0.001
"""[1] Probability of as large a rest by noise, below which a form leaves more than noise."""
PAIRED = 12
"""[forms] That explain most alone, each of which is tried with all others where none explains the change alone."""
SAME_SPAN = 1e-6
"""[1] Part of a direction outside the directions of another cause, below which it is one of them: rounding."""
LARGEST_SET = 3
"""[parameters] That are tried together where it is asked which of them alone explain the change."""
MOST_SETS = 40_000
"""[sets] Of one size, tried at most: some seconds."""


@dataclass(frozen=True)
class Form:
    """A form of a cause: how the values move by it.

    Attributes:
        kind: of the cause, such as ``friction``; joint: whose, 0: of none; title: in words.
        names, units: (k + s,) of its amounts, then of x.
        columns: x (s,) -> A (p, k); starts: (m, s) values of x from which its fit begins, (1, 0) of a linear form.
        same_as: name of a parameter whose change alone is the same.
        scales: joints whose drives give more, or less, than they say, where it is that, in whatever form.
    """

    kind: str
    joint: int
    title: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: Callable[[Array], Array]
    starts: Array = field(default_factory=lambda: np.zeros((1, 0)))
    same_as: str = ""
    scales: frozenset[int] = frozenset()

    @property
    def cause(self) -> tuple[str, int, str]:
        """What it is a form of."""
        return self.kind, self.joint, self.title

    @property
    def cost(self) -> int:
        """Values that are fitted."""
        return len(self.names)


@dataclass(frozen=True)
class Lack:
    """An effect that both logs have and the model lacks.

    Attributes:
        kind, joint: of the effect, 0 of none; title: in words; names: of its values, which are compared, too.
        is_sure: whether each of the logs shows it by itself; else one does, and the other may have as much of it.
        stiff: names of its stiffnesses, which are compared as compliances.
    """

    kind: str
    joint: int
    title: str
    names: tuple[str, ...]
    is_sure: bool = True
    stiff: frozenset[str] = frozenset()


@dataclass(frozen=True, eq=False)
class World:
    """What is taken for given while the values are compared: that both logs are of the model as it is, or that an
    effect has come, gone or grown.

    Attributes:
        difference: of the values.
        fixed: causes that are part of it, with their amounts and deviations.
        gain: chi-square by which the logs are explained better than by the model as it is; cost: values for that.
        lacks: the effects that both logs have and the model lacks.
        residual: (2, n) standard deviations of what is left of each log; None: as it is without an effect.
    """

    difference: Difference
    fixed: tuple[Form, ...] = ()
    amounts: tuple[Array, ...] = ()
    deviations: tuple[Array, ...] = ()
    gain: float = 0.0
    cost: float = 0.0
    lacks: tuple[Lack, ...] = ()
    residual: Array | None = None


@dataclass(frozen=True, eq=False)
class Explanation:
    """What one form, or two together, make of the change.

    Attributes:
        world: in which; forms: these, those of the world first; amounts, deviations: of each its values, in its units.
        left: T_A; count: values that are left; p_value: of as large a rest by noise; bic: the criterion.
        share: of T, and what the logs are explained better, that is explained.
        explains: whether the rest is noise, which by itself is one for each value that is left, or beyond that a small
            part.
        basis: (p, k + s) orthonormal, of all directions of W d that the fit can follow.
    """

    world: World
    forms: tuple[Form, ...]
    amounts: tuple[Array, ...]
    deviations: tuple[Array, ...]
    left: float
    count: int
    p_value: float
    bic: float
    share: float
    explains: bool
    basis: Array

    @property
    def leaves_more_than_noise(self) -> bool:
        """Whether something else may have changed, too."""
        return self.p_value < LACK

    @property
    def values(self) -> int:
        """That are fitted."""
        return sum(form.cost for form in self.forms)

    @property
    def unexplained(self) -> float:
        """Chi-square of the values, less what the logs are explained better."""
        return self.left - self.world.gain

    def contains(self, other: Explanation) -> bool:
        """Whether all that another can explain this one can, too."""
        if set(other.causes) <= set(self.causes) or self._scales_as(other):
            return True
        mine, theirs = ({form.cause for form in e.world.fixed} for e in (self, other))
        if not theirs <= mine:
            return False
        basis = other.basis if other.world is self.world else _moved_to(basis_of=other, to=self.world.difference)
        if basis is None:
            return False
        outside = basis - self.basis @ (self.basis.T @ basis)
        return bool(np.linalg.norm(outside, axis=0).max(initial=0.0) < SAME_SPAN)

    def may_be_in_both(self, other: Explanation) -> bool:
        """Whether another one says the same, but that both logs have an effect, or more, that is new or gone here: what
        one log shows and the other one does not exclude is no change."""
        lacks, own = ({(lack.kind, lack.joint) for lack in e.world.lacks} for e in (other, self))
        fixed, theirs = {form.cause for form in self.world.fixed}, set(other.causes)
        more = set(self.causes) - theirs
        return theirs < set(self.causes) and more <= fixed and all(cause[:2] in lacks - own for cause in more)

    def _scales_as(self, other: Explanation) -> bool:
        """Whether it says all of another one, with gains of drives that amount to those of the other."""
        rest, theirs = ({f.cause for f in e.forms if not f.scales} for e in (self, other))
        mine, wanted = ([f.scales for f in e.forms if f.scales] for e in (self, other))
        if not (mine and wanted and theirs <= rest):
            return False
        joints = sorted(frozenset().union(*mine, *wanted))
        table, right = (np.array([[float(j in own) for own in each] for j in joints]) for each in (mine, wanted))
        return bool(np.abs(right - table @ np.linalg.lstsq(table, right, rcond=None)[0]).max() < SAME_SPAN)

    @property
    def causes(self) -> tuple[tuple[str, int, str], ...]:
        """Of what they are forms."""
        return tuple(form.cause for form in self.forms)


def _moved_to(*, basis_of: Explanation, to: Difference) -> Array | None:
    """Directions of an explanation in units of the noise of another world; None where they move values that are not
    compared there."""
    own = basis_of.world.difference
    moved = np.linalg.solve(own.root, basis_of.basis)
    absent = [i for i, name in enumerate(own.names) if name not in to.names]
    if np.abs(moved[absent] / own.deviation[absent, None]).max(initial=0.0) > SAME_SPAN:
        return None
    placed = np.zeros((len(to.names), moved.shape[1]))
    for i, name in enumerate(to.names):
        if name in own.names:
            placed[i] = moved[own.names.index(name)]
    basis = to.root @ placed
    return np.asarray(basis / np.linalg.norm(basis, axis=0))


@dataclass(frozen=True)
class Contest:
    """The answer: the causes that explain the change, the best first; empty where none does.

    Attributes:
        is_changed: whether anything has.
        named: the best of each cause that the data cannot tell from the best; others: what the other causes leave.
        sets: the smallest sets of parameters whose change alone explains it, with what each leaves.
        further: the best cause and the second one that explains most of what it leaves, where that is more than noise
            and too small a part of the whole to be named.
        lacks: what both logs have and the model lacks, where that is the answer.
        in_part: where nothing has changed, what would explain far more, but leaves values that differ.
    """

    is_changed: bool = False
    named: tuple[Explanation, ...] = ()
    others: tuple[Explanation, ...] = ()
    sets: tuple[tuple[tuple[str, ...], float], ...] = ()
    further: Explanation | None = None
    lacks: tuple[Lack, ...] = ()
    in_part: Explanation | None = None


def contest(worlds: Sequence[World], forms_in: Callable[[World], Sequence[Form]]) -> Contest:
    """Whether anything has changed, and what explains it.

    Args:
        worlds: the first one without effects; forms_in: what may move the values in each.
    """
    first = worlds[0]
    nothing = [_explanation(world, (), first) for world in worlds]
    still = min((e for e in nothing if not e.forms and e.p_value >= CHANGED), key=_bic, default=None)
    if len(worlds) == 1 and still is not None:
        return Contest()
    able = {
        id(world): [form for form in forms_in(world) if form.cost < max(len(world.difference.names), 2)]
        for world in worlds
    }
    alone = [_explanation(world, (form,), first) for world in worlds for form in able[id(world)]]
    of_first = [e for e in alone if e.world is first]
    tried = [e for e in (*nothing, *alone) if e.forms and (e.world is not first or nothing[0].p_value < CHANGED)]
    if still is None and not any(e.explains for e in of_first):
        tried += _pairs(sorted(of_first, key=_bic)[:PAIRED], able[id(first)], first)
    found, beyond = _named(tried, first)
    if still is not None and not (found and still.bic - found[0].bic > BIC):
        most = min(tried, key=_bic, default=None)
        in_part = most if most is not None and still.bic - most.bic > BIC else None
        return Contest(lacks=still.world.lacks, others=tuple(sorted(_best_of_each(tried), key=_bic)), in_part=in_part)
    further = None
    if found and found[0].world is first and len(found[0].forms) == 1 and found[0].leaves_more_than_noise:
        further = min(_pairs(found[:1], able[id(first)], first), key=_bic, default=None)
        if further is not None and found[0].bic - further.bic < BIC:
            further = None
    if found and further is None:
        further = min((e for e in beyond if set(found[0].causes) < set(e.causes)), key=_bic, default=None)
    others = sorted((e for e in _best_of_each(tried) if e not in found), key=_bic)
    sets = smallest_sets(first.difference) if still is None else []
    return Contest(
        True, tuple(found), tuple(others), tuple(sets), further, found[0].world.lacks if found else ()
    )  # fmt: skip


def _bic(found: Explanation) -> float:
    return found.bic


def _pairs(chosen: Sequence[Explanation], able: Sequence[Form], first: World) -> list[Explanation]:
    """Each of these with all others."""
    pairs = [
        pair for each in chosen for form in able
        if (pair := (each.forms[0], form))[0].cause != form.cause
        and sum(f.cost for f in pair) < len(first.difference.names)
    ]  # fmt: skip
    return [_explanation(first, pair, first) for pair in _distinct(pairs)]


def _distinct(pairs: Sequence[tuple[Form, Form]]) -> Iterator[tuple[Form, Form]]:
    seen = set[frozenset[int]]()
    for pair in pairs:
        if (key := frozenset(map(id, pair))) not in seen:
            seen.add(key)
            yield pair


def _best_of_each(tried: Sequence[Explanation]) -> list[Explanation]:
    """The form of each cause that explains it, or else leaves least by the criterion."""
    found: dict[frozenset[tuple[str, int, str]], Explanation] = {}
    for each in sorted(tried, key=lambda e: (not e.explains, e.bic)):
        found.setdefault(frozenset(each.causes), each)
    return list(found.values())


def _named(tried: Sequence[Explanation], first: World) -> tuple[list[Explanation], list[Explanation]]:
    """The causes that explain the change and are as near to the best as the data cannot tell, the best first; and
    those that are better than one of these by a small part of the change, of which they are a larger form."""
    every = sorted((e for e in _best_of_each(tried) if e.explains), key=lambda e: (e.values, e.bic))
    every = [e for e in every if not any(e.may_be_in_both(other) and other.bic - e.bic < BIC for other in every)]
    if not every:
        return [], []
    near = max(BIC, NEAR * (first.difference.total - min(every, key=_bic).unexplained))
    able, beyond = list[Explanation](), list[Explanation]()
    for each in every:
        smaller = [e for e in able if each.contains(e) and e.bic - each.bic < _margin(e, each, near)]
        if not smaller:
            able.append(each)
        elif max(e.bic for e in smaller) - each.bic > BIC:
            beyond.append(each)
    able = sorted(able, key=_bic)
    return [e for e in able if e.bic - able[0].bic < near], beyond


def _margin(smaller: Explanation, larger: Explanation, near: float) -> float:
    """By how much a larger explanation has to be better: no form of a cause is exact, and one more effect in a log may
    be what the form of the first one leaves of what it explains there."""
    more = {form.cause for form in larger.world.fixed} > {form.cause for form in smaller.world.fixed}
    return max(BIC, NEAR * smaller.world.gain) if more else near


def _explanation(world: World, forms: tuple[Form, ...], first: World) -> Explanation:
    """The fit of these forms together in a world.

    Args:
        first: the world without effects, with which all are compared.
    """
    difference = world.difference
    best: tuple[float, Array] | None = None
    for start in _starts(forms):
        x = start
        if start.size:
            x = least_squares(lambda x: _rest(difference, forms, x), start, method="lm").x
        rest = _rest(difference, forms, x)
        if best is None or float(rest @ rest) < best[0]:
            best = float(rest @ rest), x
    assert best is not None
    left, x = best
    cost = sum(form.cost for form in forms)
    count, p_value = len(difference.names) - cost, 1.0
    if count > 0:
        p_value = difference.chance(left, count)
    whole = first.difference.total + world.gain
    gained = whole - left
    amounts, deviations, basis = _amounts(difference, forms, x)
    bic = left - world.gain + (cost + world.cost) * float(np.log(first.difference.samples))
    return Explanation(
        world, (*world.fixed, *forms), (*world.amounts, *amounts), (*world.deviations, *deviations), left, count,
        p_value, bic, gained / whole if whole > 0 else 0.0, p_value >= LACK or left - count <= NEAR * gained, basis,
    )  # fmt: skip


def _starts(forms: tuple[Form, ...]) -> Iterator[Array]:
    """Values of x of all forms, one below the other."""
    if not forms:
        yield np.zeros(0)
        return
    first, *others = forms
    for start in first.starts:
        yield from (np.append(start, rest) for rest in _starts(tuple(others))) if others else (start,)


def _parts(forms: tuple[Form, ...], x: Array) -> list[Array]:
    """x of each form."""
    if not forms:
        return []
    return np.split(x, np.cumsum([form.starts.shape[1] for form in forms])[:-1])


def _table(difference: Difference, forms: tuple[Form, ...], x: Array) -> Array:
    """(p, k) W A, columns of all forms."""
    none = np.zeros((len(difference.names), 0))
    columns = [none, *(form.columns(part) for form, part in zip(forms, _parts(forms, x), strict=True))]
    return np.asarray(difference.root @ np.hstack(columns))


def _rest(difference: Difference, forms: tuple[Form, ...], x: Array) -> Array:
    """(p,) what is left of W d."""
    table, right = _table(difference, forms, x), difference.whitened
    size = np.maximum(np.linalg.norm(table, axis=0), np.finfo(float).tiny)
    found: Array = right - table / size @ np.linalg.lstsq(table / size, right, rcond=None)[0]
    return found


def _amounts(
    difference: Difference, forms: tuple[Form, ...], x: Array
) -> tuple[tuple[Array, ...], tuple[Array, ...], Array]:
    """Amounts and x of each form, their standard deviations, and the directions in which both move W d."""
    if not forms:
        return (), (), np.zeros((len(difference.names), 0))
    table = _table(difference, forms, x)
    size = np.maximum(np.linalg.norm(table, axis=0), np.finfo(float).tiny)
    amount = np.linalg.lstsq(table / size, difference.whitened, rcond=None)[0] / size
    slopes = [
        (_table(difference, forms, x + h) - _table(difference, forms, x - h)) @ amount / (2 * STEP)
        for h in STEP * np.eye(x.size)
    ]
    whole = np.column_stack([table, *slopes])
    size = np.maximum(np.linalg.norm(whole, axis=0), np.finfo(float).tiny)
    spread = np.sqrt(np.diag(np.linalg.pinv((whole / size).T @ (whole / size), hermitian=True))) / size
    widths = [form.cost - form.starts.shape[1] for form in forms]
    cuts = np.cumsum(widths)[:-1]
    own = zip(np.split(amount, cuts), _parts(forms, x), strict=True)
    errors = zip(np.split(spread[: amount.size], cuts), _parts(forms, spread[amount.size :]), strict=True)
    basis, sizes, _ = np.linalg.svd(whole / size, full_matrices=False)
    return (
        tuple(np.concatenate(pair) for pair in own), tuple(np.concatenate(pair) for pair in errors),
        basis[:, sizes > SAME_SPAN * sizes[0]],
    )  # fmt: skip


STEP = 1e-6
"""[m] Of the differences by the place of a payload: its moments are polynomials of it."""


def smallest_sets(difference: Difference) -> list[tuple[tuple[str, ...], float]]:
    """The smallest sets of parameters, of equal size, whose change alone explains that of all, the best first; empty
    where no three do.

    Returns:
        Names of each, and the p value of what it leaves.
    """
    inverse = difference.root.T @ difference.root
    right, total, count = inverse @ difference.change, difference.total, len(difference.names)
    for size in range(1, min(LARGEST_SET, count - 1) + 1 if count > 1 else 2):
        sets = np.array(list(combinations(range(count), size)))
        if len(sets) > MOST_SETS:
            return []
        own = right[sets]
        gained = np.einsum(
            "ni,ni->n", own, np.linalg.solve(inverse[sets[:, :, None], sets[:, None]], own[..., None])[..., 0]
        )
        left = total - gained
        order = [k for k in np.argsort(left) if difference.chance(left[k], count - size) >= LACK]
        if order:
            near = [k for k in order if left[k] - left[order[0]] < BIC]
            return [
                (tuple(difference.names[i] for i in sets[k]), difference.chance(left[k], count - size)) for k in near
            ]
    return []
