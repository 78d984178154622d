"""What is taken on trust: parameters that are not identified, and whose errors the identified ones make up for.

With the sensitivities S of these and the slope c of the outputs over such a parameter, an error a of it moves the
values by -a S^+ c, and a |c - S S^+ c|, in standard deviations of the noise, is all that shows. The error that is asked
about is a tenth of the parameter; where it is zero, one that moves an output by a tenth of how far it moves anyhow; and
no larger than what would not show. Slopes are central differences: what is curved would look like something that shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.checks.judgement import CONDITIONAL
from fmu_didim.checks.motion.colour import orthonormal, rest_of
from fmu_didim.checks.motion.dependence import independent
from fmu_didim.checks.outputs.residuals import OutputResiduals
from fmu_didim.checks.outputs.suspects import SMALL, held_parameters, moved_parameter, with_unit
from fmu_didim.checks.power.statement import MovedResult
from fmu_didim.data.signals import Array
from fmu_didim.model.free_parameter import FreeParameter
from fmu_didim.model.workers import side_by_side

TENTH = 0.1
"""[1] Error of a held parameter that is asked about: what data sheets and drawings leave open, and no more."""
TRIED = 100
"""[parameters] At most, a simulation each, a second one of those that do something: library models have hundreds. Those
beyond are counted."""
UNSEEN = 4.0
"""[standard deviations] Of all that shows of such an error, below which the data do not tell it."""
MOVES = 1.0
"""[standard deviations] By which it moves a value, from which that is said."""
ALIKE = 5.0
"""[1] Ratio to a tenth, up to which a step over a parameter that is zero is taken for one of that size,"""
NEARER = 0.8
"""[1] Of the logarithm of that ratio, to which each further step must bring it: jitter does not follow the step."""
ROUNDS = 8
"""[steps] so many of which are tried: the first one may be ten thousand times too small or too large."""
TOLD = 5
"""[parameters] That have a remark of their own; further ones are named in the last."""
RESTED_ON = 3
"""[parameters] That a valid verdict names below its line; further ones are counted."""

TAKEN_ON_TRUST = CATALOGUE(
    "parameter-on-trust", REMARK, rank=66,
    meaning="An error of a parameter that is not identified would move the identified ones by more than their standard "
    "deviations, and the data would not show it: the values are as right as that parameter. The error is a tenth of "
    "it, or what would just show; of a parameter that is zero, what moves an output by a tenth of its own movement.",
    next_step="Know it, or measure something that shows it.",
)  # fmt: skip


@dataclass(frozen=True)
class Trusted:
    """A held parameter on which values rest.

    Attributes:
        name: of it; held: its value, with its unit; error: the size of its error, in words.
        moves: the values that it moves noticeably, the one that it moves most first; empty where none is.
    """

    name: str
    held: str
    error: str
    moves: tuple[MovedResult, ...]

    @property
    def deviations(self) -> float:
        """By which it moves a value at most, in standard deviations of that."""
        return abs(self.moves[0].deviations)


def trusted_diagnostics(found: OutputResiduals, deviation: Array) -> list[Diagnostic]:
    """Held parameters on whose values the identified ones rest; ``deviation``: (p,) of these."""
    held = held_parameters(found.model, most=None)
    tasks = [partial(_trusted, found, free, deviation) for free in held[:TRIED]]
    told = side_by_side(tasks, found.model.allowed_workers(found.values))
    return said([one for one in told if one is not None], untried=max(len(held) - TRIED, 0))


def said(told: Sequence[Trusted], *, untried: int = 0) -> list[Diagnostic]:
    """The remarks, with what a valid verdict rests on; ``untried``: number of those that were not looked at."""
    ordered = sorted((one for one in told if one.moves), key=lambda one: -one.deviations)
    found = []
    for k, one in enumerate(ordered[:TOLD]):
        moves = ", ".join(each.text for each in one.moves)
        text = f"{one.held} is taken on trust: an error of {one.error} would not show, but move {moves}."
        if k == TOLD - 1 and ordered[TOLD:]:
            text += f" So would errors of {len(ordered) - TOLD} more: {', '.join(o.name for o in ordered[TOLD:])}."
        found.append(
            Diagnostic(
                TAKEN_ON_TRUST, text, one.name, one.deviations, MOVES, "standard deviations",
                weight=one.deviations, condition="" if k else condition(ordered),
            )
        )  # fmt: skip
    if untried:
        found.append(Diagnostic(TAKEN_ON_TRUST, f"{untried} further parameters are taken on trust and were not tried."))
    return found


def condition(ordered: Sequence[Trusted]) -> str:
    """What a valid verdict rests on, the worst first; empty where nothing moves a value so far."""
    far = [one for one in ordered if one.deviations > CONDITIONAL]
    if not far:
        return ""
    texts = [
        f"{'one' if k else 'an error'} of {one.error} of {one.name} ({one.held}), which would move {one.moves[0].text}"
        for k, one in enumerate(far[:RESTED_ON])
    ]
    texts += [f"one of {len(far) - RESTED_ON} more"] if far[RESTED_ON:] else []
    return f"the data do not hide {', nor '.join(texts)}"


def size_of_error(value: float, share: float, shows: float) -> float:
    """The error of a held parameter that is asked about: a tenth of its value, and no more than would not show.

    Args:
        share: of its own movement, by which an error of one moves an output at most; it counts where the value is zero.
        shows: standard deviations of all that shows of an error of one.
    """
    asked = TENTH * abs(value) if value else TENTH / share
    return min(asked, UNSEEN / shows) if shows > 0 else asked


def _trusted(found: OutputResiduals, free: FreeParameter, deviation: Array) -> Trusted | None:
    """What an error of a held parameter does; None where it does nothing."""
    slope = _slope(found, free, SMALL * free.scale) if free.value else _slope_at_zero(found, free)
    if slope is None or not slope.any():
        return None
    share = _share(found, slope)
    table, column = found.whitened(found.jacobian), found.whitened(slope)
    shows = float(np.linalg.norm(rest_of(column, orthonormal(independent(table)))))
    size = size_of_error(free.value, share, shows)
    moves: Array = -size * np.asarray(np.linalg.lstsq(table, column, rcond=None)[0], dtype=np.float64)
    percent = f"{100 * size / abs(free.value):.2g} %" if free.value else with_unit(f"{size:.2g}", free.unit)
    return Trusted(
        free.key, with_unit(f"{free.value:.4g}", free.unit), percent, moved(found.model.names, found.values, moves,
                                                                          deviation, size),
    )  # fmt: skip


def moved(names: Sequence[str], values: Array, moves: Array, deviation: Array, size: float) -> tuple[MovedResult, ...]:
    """Those values (p,) that moves (p,) take noticeably far beside their standard deviations, the farthest first."""
    by = moves / deviation
    return tuple(
        MovedResult(
            size=size, parameter=names[i], deviations=float(by[i]),
            percent=float(100 * moves[i] / abs(values[i])) if values[i] else None,
        )
        for i in np.argsort(-np.abs(by)) if abs(by[i]) > MOVES
    )  # fmt: skip


def _share(found: OutputResiduals, slope: Array) -> float:
    """The largest movement of an output by an error of one, over how far it moves anyhow; one where none moves."""
    rows = [found.rows(k) for k in range(len(found.names))]
    sizes = [(float(np.std(found.outputs[own, k])), float(np.sqrt(np.mean(slope[own, k] ** 2))))
             for k, own in enumerate(rows)]  # fmt: skip
    return max((by / size for size, by in sizes if size > 0 and by > 0), default=1.0)


def _slope_at_zero(found: OutputResiduals, free: FreeParameter) -> Array | None:
    """The slope over a held parameter that is zero, whose size nobody knows, by a step that moves an output by a tenth
    of its own movement; None where no step is found that does, such as where all is the jitter of a solver."""
    step, before = SMALL * free.scale, np.inf
    for _ in range(ROUNDS):
        slope = _slope(found, free, step)
        if slope is None or not slope.any():
            return None
        away = _share(found, slope) * step / TENTH
        if 1 / ALIKE < away < ALIKE:
            return slope
        if abs(np.log(away)) > NEARER * before:
            return None
        before = abs(np.log(away))
        step /= np.sqrt(away)  # which comes nearer for a power of the step up to three
    return None


def _slope(found: OutputResiduals, free: FreeParameter, step: float) -> Array | None:
    """(M, m) of the outputs over a held parameter, by a central difference where both sides can be simulated; None
    where none can."""
    move, sides = moved_parameter(free), []
    for side in (step, -step):
        try:
            change = move(found, side) / side
        except FmuDidimError:
            continue
        if not change.any():
            return change
        if np.isfinite(change).all():
            sides.append(change)
    return np.mean(sides, axis=0) if sides else None
