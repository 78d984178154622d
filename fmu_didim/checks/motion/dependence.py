"""Whether the residual torque still depends on the motion: then it is not noise, whatever its size.

The residual r of a joint is compared with functions f of the simulated motion that the model does not have, beside its
sensitivities S, which the fit has used up:

    r = S a + f_1 b_1 + ... + f_k b_k + e.

Both sides have a noise with a colour of their own: the criterion C of the noise that S alone leaves, and that of what S
and k functions leave (:mod:`fmu_didim.checks.motion.colour`), of orders that are no higher. If there are no functions
in the residual,

    L = C(S) - C(S, f) <= n log(1 + k F / nu),      F from Fisher's distribution with k and nu degrees of freedom,

because the order that is chosen beside f is one of those that C(S) is the least of. A misfit does not widen its own
bound: the larger it is, the more a colour costs that takes it for noise, while it adds nothing to C(S, f). So the power
does not fall with the size of a misfit that the functions follow. Slow noise is allowed for by C(S).

That is asked of the function that explains most, and of it and the one that then explains most, once as if the noise
was white and once with its colour; and of all m functions, with the colour that S alone leaves: all together would
leave none of the frequencies of the motion in a log of some periods, and what noise has there could not be known. Each
p value is multiplied by the number of ways to choose k of the m functions, the smallest one by the number of those that
are tried (Bonferroni). Neither a known noise nor periods that repeat are needed. Noise that is loud in places is
allowed for: what the functions explain is compared with the variance of the noise where they are large, too (White,
Econometrica 48 (1980)).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import compress
from math import comb
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.distributions import f_sf
from fmu_didim.base.errors import SimulationError
from fmu_didim.base.tall import ROWS, in_blocks, with_rows
from fmu_didim.checks.data.timing import CLOCK_EARLY, CLOCK_LATE, CLOCK_SLIGHTLY_OFF
from fmu_didim.checks.judgement import MATTERS
from fmu_didim.checks.motion.colour import (
    Beside,
    Colour,
    Columns,
    Logs,
    as_slice,
    asked_twice,
    less,
    orthonormal,
    rest_of,
    triangle,
    triangle_of_blocks,
)
from fmu_didim.checks.motion.functions import SIGNATURE, TORQUE_RATE, functions_of_motion, joint_by_joint, looks_like
from fmu_didim.checks.motion.misfits import Misfit
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.fit_uncertainty import moved_by
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.uncertainty import stretches
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.workers import apart

MOTION_CHANCE = 1e-3
"""[1] Probability, for all joints together, with which noise alone may be said to depend on the motion."""
BAND = 1.8
"""[samples] Of filtered data in a period of the cut-off frequency that are tested: the output of a Butterworth filter
of order 4, forwards and backwards, is white at that rate, to a tenth."""
ENDS = 1
"""[samples] Of those at each end of a log that are left out: there the filter extrapolates."""
FUNCTIONS = 2
"""[functions] Of the motion at most that a residual is compared with at a time: what a model
lacks looks like one or two of them, and a third one tells of nothing more."""
SAMPLES_A_FUNCTION = 8.0
"""[samples] At least, beside what the fit has used up, for each function that is tried: of a short log only the most
significant ones, so that their number does not hide them."""
FOLLOWED = 0.95
"""[1] Of the squares of a signature of the catalogue, by two functions of the motion, from which it is not looked for
itself. What is not followed grows with a misfit, and lets a large one pass for coloured noise: a payload that changes
on a SCARA is followed to 0.45 to 0.7, and was told at twice, not at five and ten times the size where it shows."""
FAINT = 0.1
"""[1] Of the strength of a misfit in the joint where it shows most, from which it is looked for in another one."""
AS_WELL = 0.8
"""[1] Of the squares that one function explains, from which another one explains them as well."""
CLOCK_ALONE = 0.8
"""[1] Share in the explained part of a residual from which the rate of the torque is the only cause: a clock 5 ms late
gives 0.9 and more, steeper friction or other gains less than 0.6."""
ALIKE = 3.0
"""[standard deviations] Between the clocks that two joints of a log tell, from which it is none."""
SIGNIFICANT = 2.0
"""[standard deviations] From which a value is different from zero."""
OWN_PART = 1e-6
"""[1] Least fraction of a column that is independent of the others."""
LARGEST_GAIN = 100.0
"""[1] Of the criterion over the samples that is distinguished from an infinite one."""

Signature = NDArray[np.float32]
"""(N,) of a misfit at a joint."""

DEPENDS_ON_MOTION = CATALOGUE(
    "residual-depends-on-motion", DOUBT, rank=60,
    meaning="The residual torque depends on the motion, which noise does not: some physics, the controller's gains or "
    "the clock of the log differ from the model. The identified values absorb a part of it.",
    next_step="Run fmu-didim discover CASE.yaml, which names what is missing; check the controller and the delay.",
)  # fmt: skip

UNTESTED = CATALOGUE(
    "motion-untested", DOUBT, rank=62,
    meaning="There are too few samples to test whether the residual torque depends on the motion: missing physics, a "
    "wrong clock or a wrong controller would go unnoticed.",
    next_step="Measure for longer or log at a higher rate; with low_pass, raise its cut-off frequency.",
)  # fmt: skip


@dataclass(frozen=True)
class Dependence:
    """How the residual of a joint depends on the motion.

    Attributes:
        joint: from 1; p_value: of as much by noise alone; share: of the sum of squares that the motion explains.
        most: the function of the motion that explains most by itself; most_share: its share in the explained part.
        slope, deviation: of the residual over that function, with its standard deviation.
        as_well: other functions that explain nearly as much.
        samples: their number where they are too few for a test.
        moved: standard deviations by which a clock of the log that is off by the slope, of which all joints tell the
            same, moves a value at most; infinite where that is not known.
    """

    joint: int
    p_value: float
    share: float
    most: str
    most_share: float
    slope: float = 0.0
    deviation: float = 0.0
    as_well: tuple[str, ...] = ()
    samples: int | None = None
    moved: float = np.inf

    @property
    def is_clock(self) -> bool:
        """Whether the rate of the torque is the only cause of what follows the motion."""
        return self.most == TORQUE_RATE and self.most_share > CLOCK_ALONE

    @staticmethod
    def untested(joint: int, samples: int) -> Dependence:
        return Dependence(joint, 1.0, 0.0, "", 0.0, samples=samples)

    @property
    def follows(self) -> str:
        """With which function of the motion, in words."""
        return "as in the catalogue of effects" if self.most.startswith(SIGNATURE) else f"with the {self.most}"

    @property
    def looks(self) -> str:
        """What a model may lack that would look like it, in words."""
        words = (looks_like(name).split(" or ") for name in (self.most, *self.as_well))
        return " or ".join(dict.fromkeys(word for several in words for word in several))


def motion_diagnostics(found: Sequence[Dependence]) -> list[Diagnostic]:
    """The joints whose residual depends on the motion beyond chance, by another clock or otherwise, or is untested."""
    level = MOTION_CHANCE / max(len(found), 1)
    clock = [d for d in found if d.p_value < level and d.is_clock]
    return [_clock(d) for d in clock] + [
        Diagnostic(
            DEPENDS_ON_MOTION,
            f"{100 * d.share:.2g} % of the squared residual follows the motion (p = {max(d.p_value, TINY):.1e}), most "
            f"{d.follows}, as {d.looks} would.",
            place=f"joint {d.joint}", value=d.p_value, bound=level, unit="1",
        )
        for d in found
        if d.p_value < level and d not in clock
    ] + [
        Diagnostic(UNTESTED, f"{d.samples} sample{' is' if d.samples == 1 else 's are'} too few.", f"joint {d.joint}")
        for d in found if d.samples is not None
    ]  # fmt: skip


def _clock(found: Dependence) -> Diagnostic:
    late, deviation = -1000 * found.slope, 1000 * found.deviation  # r = tau(t - late) - tau(t)
    text = f"The log is {abs(late):.3g} ± {deviation:.1g} ms {'late' if late > 0 else 'early'}, or the loop is."
    if found.moved <= MATTERS:
        text += f" That moves no value by more than {found.moved:.2g} standard deviations."
        return Diagnostic(CLOCK_SLIGHTLY_OFF, text, f"joint {found.joint}", found.moved, MATTERS, "standard deviations")
    bound = SIGNIFICANT * deviation
    return Diagnostic(CLOCK_LATE if late > 0 else CLOCK_EARLY, text, f"joint {found.joint}", late, bound, "ms")


@dataclass(frozen=True)
class Left:
    """The residual of a joint beside its sensitivities, at the samples (N,) of all fitted logs.

    Attributes:
        residual: (N,) of its torque; nuisance: (N, p) its sensitivities.
        logs: where its samples are.
    """

    residual: Array
    nuisance: Array
    logs: Logs

    @cached_property
    def basis(self) -> Array:
        """(N, r) of the sensitivities."""
        return orthonormal(independent(self.nuisance))

    @cached_property
    def squares(self) -> float:
        """Of what they leave of the residual."""
        return float(np.sum(rest_of(self.residual, self.basis) ** 2))

    @property
    def shows(self) -> bool:
        """Whether they leave anything."""
        return float(np.sqrt(self.squares)) > TINY

    @cached_property
    def used(self) -> Columns:
        """Its sensitivities, as columns of the logs."""
        return Columns(self.logs, self.basis)

    @cached_property
    def colours(self) -> OwnColours:
        """It, beside no functions."""
        return OwnColours.of(self.residual, self.used)


@dataclass(frozen=True)
class JointResidual:
    """What the test of a joint looks at, at the samples (N,) of all fitted logs.

    Attributes:
        joint: from 1; left: its residual beside its sensitivities.
        motion: (N, m) functions of the motion, the most significant ones first; names: of these, and of
            signatures: (N,) each, of misfits beside them.
    """

    joint: int
    left: Left
    motion: Array
    names: Sequence[str]
    signatures: tuple[Signature, ...] = ()

    @property
    def residual(self) -> Array:
        """(N,) of its torque."""
        return self.left.residual

    @property
    def basis(self) -> Array:
        """(N, r) of the sensitivities."""
        return self.left.basis

    @property
    def room(self) -> int:
        """The number of functions that the samples allow."""
        return int((self.residual.size - self.basis.shape[1]) / SAMPLES_A_FUNCTION)

    def beside(self, names: Sequence[str], signatures: Iterable[Signature]) -> JointResidual:
        """With the signatures (N,) of misfits beside the functions."""
        names = [*self.names, *(SIGNATURE + name for name in names)]
        return replace(self, names=names, signatures=(*self.signatures, *signatures))

    @cached_property
    def tested(self) -> OwnColours:
        """It beside as many of the first functions as the samples allow."""
        further = self.signatures[: max(self.room - self.motion.shape[1], 0)]
        return self.left.colours.with_functions(self.motion[:, : self.room]).with_signatures(further)

    def slope(self, name: str) -> tuple[float, float]:
        """Of the residual over one function of the motion, beside the sensitivities, and its standard deviation as if
        the noise was white; no slope, of infinite deviation, where nothing of the function is left."""
        function = rest_of(self.motion[:, self.names.index(name)], self.basis)
        power, rest = float(function @ function), rest_of(self.residual, self.basis)
        if not power > 0:
            return 0.0, np.inf
        slope = float(function @ rest) / power
        left, freedom = rest - slope * function, max(rest.size - self.basis.shape[1] - 1, 1)
        return slope, float(np.sqrt(left @ left / freedom / power))

    def dependence(self) -> Dependence:
        """How it depends on the motion; as many of the first functions are used as the samples allow."""
        if self.room < 1:
            return Dependence.untested(self.joint, max(self.residual.size - self.basis.shape[1], 0))
        steps = self.tested.steps() if self.left.shows else []
        if not steps:
            return Dependence(self.joint, 1.0, 0.0, "", 0.0)
        return told(min(steps, key=lambda step: step.p_value), len(steps), self.names, self.joint)


def motion_dependence(
    model: LoopModel,
    values: Array,
    residuals: Mapping[str, Array],
    sensitivities: Mapping[str, Array],
    rows: Mapping[str, Indices] = MappingProxyType({}),
) -> list[Dependence]:
    """How the residual of each joint depends on the simulated motion; nothing where the simulation fails.

    Args:
        residuals, sensitivities: label of each fitted experiment -> (N, n) and (N, n, p).
        rows: label -> those samples of the log, where residuals and sensitivities are of some of them.
    """
    return [one.dependence() for one in joint_residuals(model, values, residuals, sensitivities, rows)]


def joint_residuals(
    model: LoopModel,
    values: Array,
    residuals: Mapping[str, Array],
    sensitivities: Mapping[str, Array],
    rows: Mapping[str, Indices],
) -> list[JointResidual]:
    """What the test of each joint looks at; nothing where the simulation fails. Arguments as above."""
    try:
        tables = [joint_by_joint(model.simulation(values, label)) for label in residuals]
    except SimulationError:  # after the last sample of a log
        return []
    times = [model.experiments[label].time[rows.get(label, slice(None))] for label in residuals]
    logs, found = Logs(tuple(stretches(times))), []
    for j, of_logs in enumerate(zip(*tables, strict=True)):
        names = [name for name in of_logs[0] if all(name in one for one in of_logs)]
        motion = np.empty((sum(time.size for time in times), len(names)), order="F")
        for k, name in enumerate(names):
            parts = zip(of_logs, residuals, strict=True)
            np.concatenate([one.pop(name)[rows.get(label, slice(None))] for one, label in parts], out=motion[:, k])
        residual = np.concatenate([one[:, j] for one in residuals.values()])
        nuisance = [sensitivities[label][:, j] for label in residuals]
        one = nuisance[0] if len(nuisance) == 1 else np.concatenate(nuisance)
        found.append(JointResidual(j + 1, Left(residual, one, logs), motion, names))
    return found


def dependence_of_fit(
    fit: Fit,
    misfits: Iterable[Misfit] = (),
    joints: Sequence[JointResidual] | None = None,
    *,
    workers: int | None = None,
) -> list[Dependence]:
    """How the residual of each joint depends on the motion at a point of the closed loop.

    Args:
        misfits: whose signatures are looked for, too.
        joints: what is looked at, where it is known.
        workers: processes at the same time; None: as many as the model has threads.
    """
    rows = tested_rows(fit)
    if fit.model.experiments.low_pass is not None:
        for own in rows.values():
            if own.size * fit.model.joint_count < 2 * fit.values.size:
                return [Dependence.untested(j + 1, own.size) for j in range(fit.model.joint_count)]
    joints = residuals_of_fit(fit, rows, misfits) if joints is None else joints
    return [
        replace(found, moved=_moved_by_clock(fit, found, joints)) if found.is_clock else found
        for found in apart([one.dependence for one in joints], workers or fit.model.threads)
    ]


def _moved_by_clock(fit: Fit, found: Dependence, joints: Sequence[JointResidual]) -> float:
    """Standard deviations by which a clock that is off as a joint tells moves a value at most, by one linear step;
    infinite where another joint tells otherwise: then it is no clock."""
    for one in joints:
        slope, deviation = one.slope(TORQUE_RATE)
        if abs(slope - found.slope) > ALIKE * np.hypot(deviation, found.deviation):
            return np.inf
    parts, n = fit.model.experiments.rows, fit.model.joint_count
    error = np.zeros_like(fit.residual)
    for label, rows in parts.items():
        tables = functions_of_motion(fit.simulation(label))
        error[rows, :n] = found.slope * np.column_stack([one[TORQUE_RATE] for one in tables])
    return float(np.max(moved_by(fit, error)))


def residuals_of_fit(fit: Fit, rows: Mapping[str, Indices], misfits: Iterable[Misfit] = ()) -> list[JointResidual]:
    """What the test of each joint looks at, at these samples of each fitted log; nothing where a simulation fails.

    Args:
        misfits: whose signatures are looked for, where no two functions of the motion follow them.
    """
    parts = fit.model.experiments.rows
    found = joint_residuals(
        fit.model, fit.values, {label: fit.residual[parts[label]][as_slice(own)] for label, own in rows.items()},
        {label: fit.jacobian[parts[label]][as_slice(own)] for label, own in rows.items()}, rows,
    )  # fmt: skip
    return with_misfits(found, misfits, samples_of(fit, rows))


def with_misfits(found: list[JointResidual], misfits: Iterable[Misfit], places: slice | Indices) -> list[JointResidual]:
    """The same with the signatures of misfits, by the places of the samples in the tables of the fit."""
    misfits = list(misfits)
    if not misfits or not found:
        return found
    both = [_followed(joint, misfits, places) for joint in found]
    sizes, part = np.array([one[0] for one in both]), np.array([one[1] for one in both])
    added = (sizes >= FAINT * sizes.max(axis=0)) & (part < FOLLOWED)
    return [
        joint.beside([m.what for m in new], signatures_of(new, places, joint.joint))
        for joint, new in ((joint, list(compress(misfits, own))) for joint, own in zip(found, added, strict=True))
    ]


def signatures_of(misfits: Sequence[Misfit], places: slice | Indices, joint: int) -> list[Signature]:
    """(N,) what samples of a joint, from 1, show of each of misfits."""
    return [misfit.signature[places, joint - 1] for misfit in misfits]


def _followed(joint: JointResidual, misfits: Sequence[Misfit], places: slice | Indices) -> tuple[Array, Array]:
    """(s,) squares of what the sensitivities of a joint leave of misfits, over those of what they leave of its
    residual, and the part of them that two functions of the motion follow."""
    columns, first = [*joint.motion.T, *signatures_of(misfits, places, joint.joint)], joint.motion.shape[1]

    def blocks() -> Iterator[Array]:
        for at in range(0, joint.residual.size, ROWS):
            yield np.column_stack([column[at : at + ROWS] for column in columns]).astype(float, copy=False)

    products = Beside.of(joint.basis, blocks, len(columns)).products
    sizes = products.diagonal()[first:]
    return sizes / max(joint.left.squares, TINY), followed(products[:first, :first], products[:first, first:], sizes)


def samples_of(fit: Fit, rows: Mapping[str, Indices]) -> slice | Indices:
    """Places of samples of the fitted logs in the tables of the fit."""
    parts = fit.model.experiments.rows
    return as_slice(np.concatenate([parts[label].start + own for label, own in rows.items()]))


def tested_rows(fit: Fit) -> dict[str, Indices]:
    """Label of each fitted experiment -> the samples of its log that are tested: all; of a filtered log as many as its
    band holds, without its ends."""
    found, low_pass = {}, fit.model.experiments.low_pass
    for label in fit.model.experiments.rows:
        experiment = fit.model.experiments[label]
        found[label] = np.arange(experiment.time.size)
        if low_pass is not None:
            every = max(round(experiment.rate_hz / (BAND * low_pass.cutoff_hz)), 1)
            found[label] = np.flatnonzero(experiment.places % every == 0)[ENDS:-ENDS]
    return found


def dependence(
    residual: Array, nuisance: Array, motion: Array, names: Sequence[str], *, joint: int, logs: Logs | None = None
) -> Dependence:
    """How a residual (N,) depends on functions (N, m) of the motion, beside nuisances (N, p).

    As many of the first functions are used as the samples allow.

    Args:
        logs: where the samples are; None: their noise is white.
    """
    left = Left(residual, nuisance, logs or Logs.white(residual.size))
    return JointResidual(joint, left, motion, names).dependence()


@dataclass(frozen=True)
class Step:
    """Some functions beside the sensitivities: the p value of what they explain, corrected for the ways to choose
    them; squares that are left without them, and that they explain; variance of the noise; and of each function alone
    (m,): its slope, and the squares of its independent part and those it explains."""

    p_value: float
    total: float
    explained: float
    variance: float
    slope: Array
    power: Array
    squares: Array
    functions: int


@dataclass(frozen=True)
class OwnColours:
    """A residual and m functions of the motion beside sensitivities, as columns of logs in this order: the
    sensitivities that are given (N, r), the residual, the functions; and the colour that the sensitivities alone
    leave."""

    columns: Columns
    given: Array
    alone: Colour

    _bases: dict[tuple[object, ...], Array] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, residual: Array, used: Columns) -> OwnColours:
        """Of a residual (N,), without functions, beside sensitivities that are orthonormal."""
        count, columns = used.count, used.beside(residual[:, None])
        lags = columns.colour(count, range(count)).orders
        columns = columns.with_lags(lags)  # a longer past would cost a log its begin
        return cls(columns, used.table.astype(float, copy=False), columns.colour(count, range(count)))

    def with_functions(self, motion: Array | Signature) -> OwnColours:
        """The same residual beside functions (N, m), too."""
        return replace(self, columns=self.columns.beside(motion))

    def with_signatures(self, signatures: Sequence[Signature]) -> OwnColours:
        """The same beside signatures (N,), too: of a long log they stay where they are."""
        if signatures and len(self.given) <= ROWS:
            return self.with_functions(np.column_stack(signatures))
        found = self
        for signature in signatures:
            found = found.with_functions(signature[:, None])
        return found

    @property
    def used(self) -> int:
        """Number of the sensitivities."""
        return int(self.given.shape[1])

    @property
    def places(self) -> range:
        """Of the functions among the columns."""
        return range(self.used + 1, self.columns.count)

    def basis(self, colour: Colour) -> Array:
        """(n, r) of the sensitivities when they have been whitened by a colour; that of the colours which are asked for
        again is kept."""
        if colour.key in self._bases:
            return self._bases[colour.key]
        if self.columns.logs.samples == len(self.given) and colour.key == self.white.key:
            return self.given
        found = orthonormal(self.columns.whitened(colour, range(self.used)))
        if colour.key in {self.alone.key, self.white.key}:
            self._bases[colour.key] = found
        return found

    @property
    def white(self) -> Colour:
        """That of white noise in these logs."""
        return Colour.white(len(self.alone.orders))

    @cached_property
    def whitened(self) -> Whitened:
        """What the sensitivities leave, by the colour that they alone leave."""
        return Whitened.by(self, self.alone)

    def whitened_by(self, colour: Colour) -> Whitened:
        """The same by another colour."""
        return self.whitened if colour.key == self.alone.key else Whitened.by(self, colour)

    def beside(self, chosen: Sequence[int], enough: float = -np.inf) -> Colour:
        """The colour that functions leave, too; ``enough``: see :meth:`Columns.colour`."""
        places = [*range(self.used), *(self.used + 1 + k for k in chosen)]
        return self.columns.colour(self.used, places, self.alone.orders, enough)

    def steps(self) -> list[Step]:
        """What is asked."""
        alone = self.whitened
        if not alone.power.any():
            return []
        found: dict[tuple[int, ...], Step] = {(): alone.step(np.flatnonzero(alone.power).tolist(), np.inf)}
        colours: dict[tuple[int, ...], Colour] = {}
        for start in (self.white, self.alone):
            chosen, colour = tuple[int, ...](), start
            while len(chosen) < min(FUNCTIONS, alone.power.size):
                best = self.whitened_by(colour).next_to(chosen)
                if best is None:
                    break
                chosen = tuple(sorted((*chosen, best)))
                if chosen not in found:
                    own = colours[chosen] = self.beside(chosen)
                    found[chosen] = self.whitened_by(own).step(chosen, self.alone.criterion - own.criterion)
                if start is self.alone:
                    colour = colours[chosen]
        return list(found.values())


@dataclass(frozen=True)
class Whitened:
    """What the sensitivities leave of the residual and of m functions of the motion, all whitened by a colour.

    Attributes:
        columns: sensitivities, residual and functions; colour: by which they are whitened.
        basis: (n, r) of the sensitivities; along: (r, 1 + m) of residual and functions along it.
        products: (m, m) of what is left of the functions with each other; product: (m,) with that of the residual.
        power: (m,) squares that are left of those functions of which something is, none of the others.
        freedom: degrees of freedom of the residual.
    """

    columns: Columns
    colour: Colour
    basis: Array
    along: Array
    products: Array
    product: Array
    power: Array
    freedom: int

    @classmethod
    def by(cls, tested: OwnColours, colour: Colour) -> Whitened:
        basis, columns = tested.basis(colour), range(tested.used, tested.columns.count)
        found = Beside.of(basis, partial(tested.columns.blocks, colour, columns), len(columns))
        power = found.products.diagonal()[1:]
        power = np.where(power > OWN_PART**2 * found.squares[1:], power, 0.0)
        freedom = basis.shape[0] - tested.used - max(colour.orders, default=0)
        return cls(
            tested.columns, colour, basis, found.along, found.products[1:, 1:], found.products[0, 1:], power, freedom
        )

    @cached_property
    def rest(self) -> Array:
        """(n,) left of the residual."""
        return self._left([self.basis.shape[1]], self.along[:, :1])[:, 0]

    def places(self, chosen: Sequence[int]) -> list[int]:
        """Of functions among the columns."""
        return [self.basis.shape[1] + 1 + k for k in chosen]

    def own(self, chosen: Sequence[int]) -> Array:
        """(n, k) left of functions, by their places."""
        return self._left(self.places(chosen), self.along[:, 1:][:, list(chosen)])

    def _left(self, columns: Sequence[int], along: Array) -> Array:
        table = self.columns.whitened(self.colour, columns)
        for basis, left in with_rows(self.basis, in_blocks(table)):
            left[:] = less(left, basis, along)
        return table

    def next_to(self, chosen: Sequence[int]) -> int | None:
        """The function that explains most beside those that are chosen; None where nothing is left of any."""
        product, power = self.product, self.power
        if chosen:
            at = list(chosen)
            beside = np.linalg.solve(self.products[np.ix_(at, at)], self.products[at])
            left = self.products.diagonal() - np.einsum("ij,ij->j", beside, self.products[at])
            power = np.where(left > OWN_PART**2 * power, left, 0.0)
            power[at] = 0.0
            product = product - beside.T @ product[at]
        return int(np.argmax(_squares(product, power))) if power.any() else None

    def step(self, chosen: Sequence[int], gain: float, ways: int | None = None) -> Step:
        """What the chosen functions explain together.

        Args:
            gain: of the criterion, infinite where only what they explain with this colour counts.
            ways: to choose them; None: as many of these functions.
        """
        along, loudness = self._explained(chosen)
        total, explained = float(self.rest @ self.rest), float(along @ along)
        first, count, samples = along.size, int(np.count_nonzero(self.power)), self.rest.size
        second = max(self.freedom - first, 1)
        variance = max(total - explained, TINY) / second
        loud = float(along @ np.linalg.lstsq(loudness, along, rcond=None)[0]) * second / samples
        likely = second * np.expm1(min(max(gain, 0.0) / samples, LARGEST_GAIN))
        by_chance = f_sf(min(explained / variance, likely, loud) / first, first, second)
        return Step(
            float(by_chance * (comb(count, len(chosen)) if ways is None else ways)), total, explained, variance,
            np.divide(self.product, self.power, out=np.zeros_like(self.product), where=self.power > 0), self.power,
            _squares(self.product, self.power), first,
        )  # fmt: skip

    def _explained(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """What the residual has along an orthonormal basis B (n, k) of functions, (k,), and (k, k) B' diag(e^2) B, by
        what they leave of it, e: where the noise is loud the functions may be large."""
        blocks = asked_twice(partial(self._own_blocks, chosen), self.rest.size)
        kept, length = independent_of(triangle_of_blocks(blocks, len(chosen)))
        inverse = np.diag(1 / length)
        for _ in range(2):  # as :func:`fmu_didim.checks.motion.colour.orthonormal`
            r = triangle_of_blocks(partial(_combined, blocks, kept, inverse), kept.size)
            inverse = inverse @ np.linalg.inv(r)
        along, loudness = np.zeros(kept.size), np.zeros((kept.size, kept.size))
        for rest, basis in with_rows(self.rest, _combined(blocks, kept, inverse)):
            along += basis.T @ rest
        for rest, basis in with_rows(self.rest, _combined(blocks, kept, inverse)):
            basis *= (rest - basis @ along)[:, None]
            loudness += basis.T @ basis
        return along, loudness

    def _own_blocks(self, chosen: Sequence[int]) -> Iterator[Array]:
        """(b, k) left of functions, some samples at a time."""
        along = self.along[:, 1:][:, list(chosen)]
        blocks = self.columns.blocks(self.colour, self.places(chosen))
        for basis, block in with_rows(self.basis, blocks):
            yield less(block, basis, along)


def _combined(blocks: Callable[[], Iterable[Array]], kept: Indices, by: Array) -> Iterator[Array]:
    """Blocks (b, k) of some columns, combined by a matrix (k, k)."""
    return (block[:, kept] @ by for block in blocks())


def _squares(product: Array, power: Array) -> Array:
    """(m,) squares that functions explain; none of those with no power."""
    return np.divide(product**2, power, out=np.zeros_like(product), where=power > 0)


def told(step: Step, tried: int, names: Sequence[str], joint: int) -> Dependence:
    """What the step with the smallest p value says, out of so many."""
    most = int(np.argmax(step.squares))
    beyond = max(step.explained - step.functions * step.variance, step.variance)
    as_well = np.flatnonzero(step.squares > AS_WELL * step.squares[most])
    return Dependence(
        joint, min(tried * step.p_value, 1.0), beyond / step.total, names[most],
        most_share=float(min(max(step.squares[most] - step.variance, 0.0) / beyond, 1.0)),
        slope=float(step.slope[most]), deviation=float(np.sqrt(step.variance / step.power[most])),
        as_well=tuple(names[int(i)] for i in as_well if i != most),
    )  # fmt: skip


def followed(products: Array, along: Array, squares: Array) -> Array:
    """(s,) part of the squares (s,) of signatures that functions of the motion explain: that which explains most, and
    it with the one that then explains most, as the test takes them.

    Args:
        products: (m, m) of the functions with each other; along: (m, s) with the signatures.
    """
    explained = [sum(part for _, part in most_one_by_one(products, one, OWN_PART)) for one in along.T]
    return np.asarray(np.array(explained) / np.maximum(squares, TINY))


def most_one_by_one(products: Array, along: Array, part: float) -> list[tuple[int, float]]:
    """The place of the function that explains most of a signal, of that which then explains most beside it, and so on,
    with the squares that each adds; up to ``FUNCTIONS``.

    Args:
        products: (m, m) of the functions with each other; along: (m,) with the signal.
        part: of the squares of a function, that those before it must leave of it.
    """
    table, found, least = products, list[tuple[int, float]](), part * np.maximum(np.diag(products), TINY)
    for _ in range(min(FUNCTIONS, along.size)):
        left = np.diag(table)
        squares = _squares(along, np.where(left > least, left, 0.0))
        best = int(np.argmax(squares))
        if not squares[best] > 0:
            break
        found.append((best, float(squares[best])))
        beside = table[:, best] / left[best]
        along, table = along - beside * along[best], table - np.outer(beside, table[best])
    return found


def independent(columns: Array) -> Array:
    """(N, r) of the columns (N, m) those that do not depend on others, of length one."""
    if not len(columns):
        return np.zeros((0, 0))
    kept, length = independent_of(triangle(columns))
    found = np.empty((len(columns), kept.size), order="F")
    for k, place in enumerate(kept):
        np.divide(columns[:, place], length[k], out=found[:, k])
    return found


def independent_of(upper: Array) -> tuple[Indices, Array]:
    """Places (r,) of the columns that do not depend on others, and their lengths, by the triangle (m, m) of all."""
    length = np.sqrt(np.einsum("ij,ij->j", upper, upper))
    (there,) = np.nonzero(length > TINY)
    if not there.size:
        return there, np.zeros(0)
    r, order = linalg.qr(upper[:, there] / length[there], mode="r", pivoting=True)
    size = np.abs(np.diag(r[: there.size]))
    kept = there[order[: int(np.sum(size > OWN_PART * size[0]))]]
    return kept, length[kept]
