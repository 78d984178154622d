"""The contest of causes: which of them alone, or which two together, explain the change of the values.

Each form of a cause says along which columns A(x) (p, k) the values move, where x (s,) may be the place of a payload.
Its fit minimises T_A (:mod:`fmu_didim.discovery.change.difference`) over x. A form explains the change where what it
leaves is noise, or a small part of the change: no form is exact. Among those that do, the criterion

    BIC = T_A + (k + s) log N,       N: samples of both logs

decides as in the discovery of effects: causes that are nearer to the best than its margin are named with it. A cause
that contains a better one, as friction of each joint contains that of one, is no rival of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from fmu_didim.data.signals import Array
from fmu_didim.discovery.change.difference import Difference
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
    """

    kind: str
    joint: int
    title: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: Callable[[Array], Array]
    starts: Array = field(default_factory=lambda: np.zeros((1, 0)))
    same_as: str = ""

    @property
    def cause(self) -> tuple[str, int, str]:
        """What it is a form of."""
        return self.kind, self.joint, self.title

    @property
    def cost(self) -> int:
        """Values that are fitted."""
        return len(self.names)


@dataclass(frozen=True)
class Explanation:
    """What one form, or two together, make of the change.

    Attributes:
        forms: these; amounts, deviations: of each its values, in its units.
        left: T_A; count: values that are left; p_value: of as large a rest by noise; bic: the criterion.
        share: of T that is explained; explains: whether the rest is noise, or a small part.
        basis: (p, k + s) orthonormal, of all directions of W d that the fit can follow.
    """

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

    def contains(self, other: Explanation) -> bool:
        """Whether all that another can explain this one can, too."""
        outside = other.basis - self.basis @ (self.basis.T @ other.basis)
        return bool(np.linalg.norm(outside, axis=0).max(initial=0.0) < SAME_SPAN)

    @property
    def causes(self) -> tuple[tuple[str, int, str], ...]:
        """Of what they are forms."""
        return tuple(form.cause for form in self.forms)


@dataclass(frozen=True)
class Contest:
    """The answer: the causes that explain the change, the best first; empty where none does.

    Attributes:
        named: the best of each cause that the data cannot tell from the best; others: what the other causes leave.
        sets: the smallest sets of parameters whose change alone explains it, with what each leaves.
        further: the best cause and the second one that explains most of what it leaves, where that is more than noise.
    """

    named: tuple[Explanation, ...]
    others: tuple[Explanation, ...]
    sets: tuple[tuple[tuple[str, ...], float], ...]
    further: Explanation | None = None


def contest(difference: Difference, forms: Sequence[Form]) -> Contest:
    """Which forms explain a change."""
    able = [form for form in forms if form.cost < max(len(difference.names), 2)]
    alone = [explanation(difference, (form,)) for form in able]
    tried, found = alone, _named(difference, alone)
    if not found:
        tried = _pairs(difference, sorted(alone, key=lambda e: e.bic)[:PAIRED], able)
        found = _named(difference, tried)
    further = None
    if found and len(found[0].forms) == 1 and found[0].leaves_more_than_noise:
        further = min(_pairs(difference, found[:1], able), key=lambda e: e.bic, default=None)
        if further is not None and found[0].bic - further.bic < BIC:
            further = None
    best_of_each = _best_of_each(tried)
    others = sorted((e for e in best_of_each if e not in found), key=lambda e: e.bic)
    return Contest(tuple(found), tuple(others), tuple(smallest_sets(difference)), further)


def _pairs(difference: Difference, first: Sequence[Explanation], able: Sequence[Form]) -> list[Explanation]:
    """Each of these with all others."""
    pairs = [
        pair for each in first for form in able
        if (pair := (each.forms[0], form))[0].cause != form.cause
        and sum(f.cost for f in pair) < len(difference.names)
    ]  # fmt: skip
    return [explanation(difference, pair) for pair in _distinct(pairs)]


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


def _named(difference: Difference, tried: Sequence[Explanation]) -> list[Explanation]:
    """The causes that explain the change and are as near to the best as the data cannot tell, the best first."""
    able = sorted((e for e in _best_of_each(tried) if e.explains), key=lambda e: e.bic)
    if not able:
        return []
    near = max(BIC, NEAR * (difference.total - able[0].left))
    found = list[Explanation]()
    for each in able:
        if each.bic - able[0].bic < near and not any(each.contains(better) for better in found):
            found.append(each)
    return found


def explanation(difference: Difference, forms: tuple[Form, ...]) -> Explanation:
    """The fit of these forms together."""
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
    gained = difference.total - left
    amounts, deviations, basis = _amounts(difference, forms, x)
    return Explanation(
        forms, amounts, deviations, left, count, p_value, left + cost * float(np.log(difference.samples)),
        gained / difference.total if difference.total > 0 else 0.0,
        p_value >= LACK or left <= NEAR * gained, basis,
    )  # fmt: skip


def _starts(forms: tuple[Form, ...]) -> Iterator[Array]:
    """Values of x of all forms, one below the other."""
    first, *others = forms
    for start in first.starts:
        yield from (np.append(start, rest) for rest in _starts(tuple(others))) if others else (start,)


def _parts(forms: tuple[Form, ...], x: Array) -> list[Array]:
    """x of each form."""
    return np.split(x, np.cumsum([form.starts.shape[1] for form in forms])[:-1])


def _table(difference: Difference, forms: tuple[Form, ...], x: Array) -> Array:
    """(p, k) W A, columns of all forms."""
    columns = [form.columns(part) for form, part in zip(forms, _parts(forms, x), strict=True)]
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
