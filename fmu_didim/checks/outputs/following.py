"""Whether what a model leaves of its outputs still follows something: then it is no noise, whatever its size.

The residual of each output is compared with what the suspects (:mod:`fmu_didim.checks.outputs.suspects`) would change
and with plain functions of inputs, output and time, by the test of :mod:`fmu_didim.checks.motion.dependence`. Where it
follows them beyond chance, the suspects are ranked by what each explains of all outputs together, beside what is
identified; of the best ones the amount is found by a few further simulations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.distributions import DEVIATION_OF_MEDIAN, f_sf
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.checks.judgement import MATTERS
from fmu_didim.checks.motion.colour import orthonormal, rest_of
from fmu_didim.checks.motion.dependence import Dependence, dependence, independent
from fmu_didim.checks.outputs.outliers import KNOWN_FROM
from fmu_didim.checks.outputs.residuals import OutputResiduals
from fmu_didim.checks.outputs.suspects import MOST_INPUTS, Suspect, first_changes, of_inputs, of_outputs, of_parameters
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import TINY

CHANCE = 1e-3
"""[1] Probability, for all outputs together, with which noise alone may be said to follow something."""
LEAST = 0.005
"""[1] Share of the squared residual that follows something, from which it is doubted whatever it does to the values.
Less may be the rounding of a file, and is doubted where a likely suspect would move a value noticeably: in a log of N
samples a share f is sqrt(f N) standard deviations of a suspect."""
REFINED = 4
"""[suspects] The most promising ones, whose amounts are found by further simulations,"""
ROUNDS = 3
"""[simulations] so many each."""
AS_WELL = 0.9
"""[1] Of what the best suspect explains, from which another one is named beside it."""
MOSTLY = 0.6
"""[1] Share of what follows anything that a suspect must explain to be called the likely one."""
NAMED = 3
"""[suspects] At most that are named beside the best one."""
STEPS = (0.25, 0.5, 0.75)
"""[1] Of an experiment, after which a change is looked for."""

OWN_PART = 1e-12
"""[1] Of the squares of what a suspect changes, below which what is identified makes up for it."""
BEYOND = 0.03
"""[1] Of what one suspect explains, by how much two things must explain more to be named in its place,"""
BEYOND_NOISE = 25.0
"""[1] and in squares of standard deviations: five of them."""
FIRST = 5
"""[samples] In which a start that is off shows at least,"""
FAR_START = 5.0
"""[standard deviations] and by how much: noise of any colour is so far off once in a million samples."""
SETTLED = 0.3
"""[standard deviations] Change of an amount from which no further simulation looks for it."""
LESS = 1e-3
"""[1] By which a further simulation may explain less and still be the better one: the amounts are hardly apart."""
EXCHANGE = Suspect(
    "exchange", 1.0, lambda r, a: np.zeros(r.outputs.shape),
    lambda a, s: "an influence that was not recorded and that the model lacks, such as a further source, load, loss or "
    "neighbour which pulls the outputs towards a constant",
    lambda a: "Add to the model what acts there besides the inputs, record it, or give it a parameter that is "
    "identified; then check zero and scale of inputs and outputs.",
)  # fmt: skip
"""What neither an offset nor a scale explains alone."""

BY_DISCOVERY = "Or run fmu-didim discover CASE.yaml, which fits this and its rivals beside all that is identified."
OUTPUT_FOLLOWS = CATALOGUE(
    "residual-follows", DOUBT, rank=54,
    meaning="What a model leaves of an output follows its inputs, the output itself or time, which noise does not: "
    "inputs, sensors, clocks, the initial state or the model differ from what the case says. The values absorb a part.",
    next_step="Begin with the suspect that is named first.",
)  # fmt: skip


@dataclass(frozen=True)
class Explained:
    """What a suspect explains.

    Attributes:
        amount, deviation: of it; squares: that it explains of the residual in standard deviations.
    """

    suspect: Suspect
    amount: float
    deviation: float
    squares: float


def following_diagnostics(found: OutputResiduals, deviation: Array) -> list[Diagnostic]:
    """The outputs whose residual follows something, with the suspects, the likeliest first.

    Args:
        deviation: (p,) standard deviations of the values.
    """
    if not found.judged:
        return []
    tables = first_changes(found, _without_parameters(found))
    tests = {k: _test(found, k, tables) for k in found.judged}
    level = CHANCE / len(tests)
    tests = {k: d if d.p_value < level else _start_of(found, k, d) for k, d in tests.items()}
    told = {k: d for k, d in tests.items() if d.p_value < level}
    if not told:
        return []
    tables |= first_changes(found, of_parameters(found))
    best = ranked(found, tables)
    likely = [one for one in best if one.squares > AS_WELL * best[0].squares]
    moved = max((moved_by(found, one, deviation) for one in likely), default=0.0)
    return [_told(found, told, best, level)] if best and matters([d.share for d in told.values()], moved) else []


def matters(shares: Sequence[float], moved: float) -> bool:
    """Whether what follows something is doubted: shares of the squared residual of outputs, and standard deviations by
    which a likely suspect moves a value at most."""
    return max(shares) > LEAST or moved > MATTERS


def moved_by(found: OutputResiduals, one: Explained, deviation: Array) -> float:
    """Standard deviations (p,) by which a suspect moves a value at most, by one linear step; none where it cannot be
    simulated."""
    try:
        change = found.whitened(one.suspect.moved(found, one.amount))
    except FmuDidimError:
        return 0.0
    if not np.isfinite(change).all():
        return 0.0
    by = np.linalg.lstsq(found.whitened(found.jacobian), change, rcond=None)[0]
    return float(np.max(np.abs(by) / np.maximum(deviation, TINY), initial=0.0))


def _without_parameters(found: OutputResiduals) -> Iterator[Suspect]:
    yield from of_outputs(found)
    yield from of_inputs(found)


def _test(found: OutputResiduals, k: int, tables: Mapping[Suspect, Array]) -> Dependence:
    """How the residual of output ``k`` follows the suspects and functions of inputs, output and time."""
    rows = found.rows(k)
    columns = {s.name: table[rows, k] for s, table in tables.items()} | _functions(found, k)
    columns = {name: column for name, column in columns.items() if np.isfinite(column).all() and column.any()}
    scaled = [column / np.linalg.norm(column) for column in columns.values()]
    return dependence(
        found.residual[rows, k], found.jacobian[rows, k], np.column_stack(scaled), list(columns), joint=k + 1,
        logs=found.tables(k),
    )  # fmt: skip


def _start_of(found: OutputResiduals, k: int, before: Dependence) -> Dependence:
    """The same by the first samples alone, where a start that is off is forgotten soon: too few for the test above."""
    residual = found.residual[found.rows(k), k]
    spread = DEVIATION_OF_MEDIAN * float(np.median(np.abs(residual - np.median(residual))))
    freedom = KNOWN_FROM * max(residual.size - found.values.size, 1)
    p_value, squares = 1.0, 0.0
    for log in found.logs(k):
        first = found.residual[found.indices(log.rows)[:FIRST], k]
        if spread and np.abs(first).max() > FAR_START * spread:
            ratio = float(np.mean((first / spread) ** 2))
            chance = float(f_sf(ratio, first.size, freedom)) * len(found.logs(k))
            p_value, squares = min(p_value, chance), squares + float(first @ first)
    share = squares / max(float(residual @ residual), TINY)
    return replace(before, p_value=p_value, share=share) if p_value < before.p_value else before


def _functions(found: OutputResiduals, k: int) -> dict[str, Array]:
    """Further functions (N,) at the samples of output ``k``: of the output, the inputs and time."""
    rows, time = found.rows(k), found.times(k)
    own = found.outputs[rows, k] - found.outputs[rows, k].mean()
    rate = np.concatenate([np.gradient(found.outputs[found.indices(log.rows), k], log.time) for log in found.logs(k)])
    turned = 2 * (time - time.min()) / max(float(np.ptp(time)), TINY) - 1
    named = {
        "size of its rate": np.abs(rate),
        "its square": own**2,
        "its cube": own**3,
        "its rate and time": turned * rate,
    }
    for name in found.model.experiments[found.model.first].reference.names[:MOST_INPUTS]:
        driven, slope = [], []
        for log in found.logs(k):
            reference = found.model.experiments[log.label].reference
            u = reference.column(name)
            driven.append(np.interp(log.time, reference.time, u - u.mean()))
            slope.append(np.interp(log.time, reference.time, np.gradient(u, reference.time)))
        named |= {f"{name} at once": np.concatenate(driven), f"rate of {name}": np.concatenate(slope)}
    named |= {
        f"what changes after {100 * at:.0f} % of the time": np.where(turned > 2 * at - 1, 1.0, -1.0) for at in STEPS
    }
    return named | {"square of time": turned**2, "what it is and time": turned * own}


def ranked(found: OutputResiduals, tables: Mapping[Suspect, Array]) -> list[Explained]:
    """The most promising suspects by what they explain of all outputs, the best first."""
    basis = orthonormal(independent(found.whitened(found.jacobian)))
    rest = rest_of(found.whitened(found.residual), basis)
    first = [e for s, table in tables.items() if (e := _explained(s, s.first, found.whitened(table), rest, basis))]
    first = sorted(first, key=lambda e: -e.squares)[: 2 * REFINED]
    simulated = [e for e in first if not e.suspect.is_linear][:REFINED]
    refined = {e.suspect: _refined(found, e, rest, basis) for e in simulated}
    best = sorted((refined.get(e.suspect, e) for e in first), key=lambda e: -e.squares)
    if not best:
        return []
    # What decays from the start has any time constant; a parameter that does as well says what it is.
    named = [e for e in best if e.squares > AS_WELL * best[0].squares and e.suspect.name.startswith("parameter ")]
    if best[0].suspect.name.startswith("start of ") and named:
        best = [*named, *(e for e in best if e not in named)]
    exchange = _exchange(found, tables, rest, basis)
    if exchange is not None and exchange.squares - best[0].squares > max(BEYOND * best[0].squares, BEYOND_NOISE):
        best = [exchange, *best]
    return best


def _exchange(found: OutputResiduals, tables: Mapping[Suspect, Array], rest: Array, basis: Array) -> Explained | None:
    """What an exchange with surroundings that were not recorded explains: outputs that are pulled towards a constant,
    so that they move less, about another mean."""
    scales = [found.whitened(t) for s, t in tables.items() if s.name in {f"scale of {n}" for n in found.names}]
    pulls = [found.whitened(t) for s, t in tables.items() if s.name.startswith("offset of ") and not s.is_linear]
    most, best = 0.0, None
    for scale in scales:
        for pull in pulls:
            own = orthonormal(independent(rest_of(np.column_stack([pull, scale]), basis)))
            squares = float(np.sum((own.T @ rest) ** 2))
            if squares > most and own.shape[1] == 2:
                most, best = squares, Explained(EXCHANGE, 1.0, 0.0, squares)
    return best


def _explained(suspect: Suspect, amount: float, column: Array, rest: Array, basis: Array) -> Explained | None:
    """What a suspect explains by the amount whose change is this column."""
    beside = rest_of(column, basis)
    power = float(beside @ beside)
    if power <= OWN_PART * float(column @ column):
        return None
    along = float(beside @ rest)
    left = max(float(rest @ rest) - along**2 / power, TINY) / max(rest.size - basis.shape[1] - 1, 1)
    return Explained(suspect, amount * along / power, abs(amount) * float(np.sqrt(left / power)), along**2 / power)


def _refined(found: OutputResiduals, start: Explained, rest: Array, basis: Array) -> Explained:
    """The same with the amount that a few simulations find."""
    best = start
    for _ in range(ROUNDS):
        try:
            table = best.suspect.moved(found, best.amount)
        except FmuDidimError:
            break
        column = found.whitened(table)
        other = _explained(best.suspect, best.amount, column, rest, basis) if np.isfinite(column).all() else None
        if other is None or other.squares < best.squares * (1 - LESS):
            break
        settled = abs(other.amount - best.amount) < SETTLED * other.deviation
        best = other
        if settled:
            break
    return best


def _told(found: OutputResiduals, told: Mapping[int, Dependence], best: list[Explained], level: float) -> Diagnostic:
    """What is doubted of all outputs: the most certain one gives the figures."""
    first = max(told, key=lambda k: told[k].share)
    follows, likely = told[first], best[0]
    beside, kinds = [], {_kind(likely.suspect)}
    for other in best[1:]:
        if other.squares > AS_WELL * likely.squares and _kind(other.suspect) not in kinds:
            kinds.add(_kind(other.suspect))
            beside.append(other.suspect.text(other.amount, other.deviation))
    all_of_it = follows.share * float(np.sum(found.whitened(found.residual) ** 2)) / len(found.names)
    mostly = likely.squares > MOSTLY * all_of_it
    lead = "as would leave" if mostly else "and no single suspect explains most of it; the nearest is"
    share = f"{100 * follows.share:.2g} % of the squared residual is no noise (p = {max(follows.p_value, TINY):.1e}), "
    text = f"{share}{lead} {likely.suspect.text(likely.amount, likely.deviation)}."
    if beside:
        text += f" These data hardly tell that from {'; or '.join(beside[:NAMED])}."
    others = [f"{found.names[k]} ({100 * d.share:.2g} %)" for k, d in told.items() if k != first]
    text += f" So it is with {', '.join(others)}." if others else ""
    step = f"{likely.suspect.advice(likely.amount)} {BY_DISCOVERY}"
    return Diagnostic(OUTPUT_FOLLOWS, text, found.names[first], follows.p_value, level, "1", step)


def _kind(suspect: Suspect) -> str:
    """Suspects of one kind are named once."""
    return suspect.name.partition(",")[0]
