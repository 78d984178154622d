"""Initial states: motions that do not begin at rest on their reference, and controllers that have been running.

The plant is simulated from the first row of the reference, and controllers from the state in which they are built. A
real plant that is moving there, or stands elsewhere, is not on it, an integral that holds a load is not zero, and the
loop takes a while to forget it. With the sensitivities S of the parameters and D of positions, velocities and states of
controllers at the start, and the whitened residual r, the start that the log shows is

    (d, z) = argmin |r - S d - D z|^2,      z' C_zz^-1 z ~ chi-square of the size of z, by chance,

where the covariance C counts the colour of the noise (the score test, C. R. Rao, Proceedings of the Cambridge
Philosophical Society 44, 1948). A start that chance does not explain is free: a nuisance of a fitted experiment,
identified with the parameters, whose standard deviations count it. Of a held-out experiment the first part gives the
start and the rest is judged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmu_didim.base.distributions import chi2_sf
from fmu_didim.base.errors import IdentificationError, SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.estimators.finish import Minimum
from fmu_didim.estimators.local_minima import HARDLY_WORSE, weighted_cost
from fmu_didim.estimators.starts.start import simulatable, start_values
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.fit import Fit, point, prior_rows
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.noise.weighting import NoiseOfResidual, noise_floor, whitened
from fmu_didim.fit.solver.accuracy import with_fitting_substeps
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.experiment import InitialState
from fmu_didim.model.free_parameter import PLANT, FreeParameter
from fmu_didim.model.loop import StartValue, state_name
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.motion import joint_reference

MOVING = 1e-3
"""[1] Speed of the reference in its first row, as a fraction of its largest one, from which a motion does not begin at
rest."""
CHANCE = 1e-6
"""[1] Probability with which chance may make a start on the reference look like another one: freed starts cost
certainty, and a log that shows one shows it clearly."""
STANDS_OUT = 2.0
"""[1] Residual of the samples in which a start acts over that of the later ones, from which it is looked at: a start
off the reference is a transient."""
FIRST_PART = 0.25
"""[1] Largest part of a log in which a start is looked for: the rest is there to judge by."""
FORGOTTEN = 0.01
"""[1] Effect of the start on the torque, as a fraction of its largest, below which it is forgotten."""
DETERMINED = 1.0
"""[1] Standard deviation of a start value, as a fraction of the range of its reference, up to which a log shows it."""
STEPS = 10
"""[steps] Of the fit of a held-out start, in which little is nonlinear."""
SETTLED = 1e-3
"""[1] Relative change of a held-out start, or of its standard deviation, at which that fit ends."""
PROBED = (1e-9, 1e-2)
"""[1] Change of the torque, over its range, from which the range of a state of a controller is reported: above
rounding, below what saturates."""
PROBE_FACTOR = 1e5
"""[1] By which a probe that is too short is longer, and one that is too long shorter, the next time."""
PROBES = 6
"""[probes] From 1e-20 to 1e20 of the unit of a state, both ways."""
NEARER = 0.5
"""[1] Of the error of a loop to which that without its delay must fall for the delay to be blamed."""
OTHER_VELOCITIES = "The minimum was found from a start with the velocities of the reference."
NOT_SHOWN = "{}: its initial state is asked for, but the log does not show it; the motion starts on its reference."
NOT_OFFERED = (
    "{}: {}. The states in which {} starts are not known: if it was running before the log began, name what sets them, "
    "initial_state: {{{}.parameter: value}}."
)


@dataclass(frozen=True)
class _Start:
    """The start of an experiment, before it is free.

    Attributes:
        parameters: m start values that the log shows; columns: (K, n, m) sensitivities of the first K samples.
        off: (m,) how far those values are from the reference.
    """

    parameters: tuple[FreeParameter, ...]
    columns: Array
    off: Array

    @property
    def count(self) -> int:
        """m."""
        return len(self.parameters)

    @property
    def samples(self) -> int:
        """K, after which the start is forgotten."""
        return int(self.columns.shape[0])


def with_starts(fit: Fit, starts: Sequence[FreeParameter], finish: Callable[[Fit], Minimum]) -> Minimum:
    """The minimum from a point, with the starts of fitted experiments free that :func:`free_starts` has found there,
    and those of held-out experiments that :func:`held_out_starts` finds then.

    Args:
        finish: minimises the torque error from a point.
    """
    model = _on_reference(fit.model, {start.experiment for start in starts})
    if starts or model is not fit.model:
        model = model.with_free((*model.free_parameters, *starts))
        fit = point(model, NoiseOfResidual(model))
    minimum = finish(fit)
    if starts:
        minimum = _lower(minimum, fit, starts, finish)
    kept = tuple(start for start in starts if start.experiment in _off_reference(minimum, starts))
    if len(kept) < len(starts):  # a delay or a gain that only the finish frees may have looked like a start
        minimum = finish(_without(minimum.fit, set(starts) - set(kept))).after(minimum)
        starts = kept
    model, held_out = held_out_starts(minimum.fit)
    remarks = (*minimum.remarks, *free_start_remarks(minimum.fit, starts), *held_out, *unknown_states(minimum.fit))
    return replace(minimum, fit=replace(minimum.fit, model=model), remarks=remarks)


def _lower(minimum: Minimum, before: Fit, starts: Sequence[FreeParameter], finish: Callable[[Fit], Minimum]) -> Minimum:
    """The same minimum, or a lower one that is reached from the same positions with the velocities of the reference: a
    fast transient that is sampled a few times looks much the same with others.

    Args:
        before: where the minimum was searched from, the starts free.
    """
    model, found = minimum.fit.model, before.values.copy()
    velocities = [start for start in starts if start.owner == PLANT and _name(start).startswith("dq")]
    if not velocities:
        return minimum
    for start in starts:
        place = model.names.index(start.name)
        found[place] = minimum.fit.values[place]
    for start in velocities:
        assert start.experiment is not None
        found[model.names.index(start.name)] = _on(model, start.experiment)[_name(start)]
    try:
        other = finish(point(before.model.with_values(found), NoiseOfResidual(before.model)))
    except (SimulationError, IdentificationError):
        return minimum
    here, there = (weighted_cost(one, minimum.fit.deviation) for one in (minimum.fit, other.fit))
    return other.after(minimum, OTHER_VELOCITIES) if there < here - HARDLY_WORSE else minimum


def _off_reference(minimum: Minimum, starts: Sequence[FreeParameter]) -> set[str | None]:
    """Labels of those experiments whose free starts are off the reference at a minimum, or were asked for."""
    model, found = minimum.fit.model, set[str | None]()
    for label in dict.fromkeys(start.experiment for start in starts):
        assert label is not None
        own = [start for start in starts if start.experiment == label]
        places = [model.names.index(start.name) for start in own]
        on = _on(model, label)
        off = minimum.fit.values[places] - [on[_name(start)] for start in own]
        distance = float(off @ np.linalg.solve(minimum.known.covariance[np.ix_(places, places)], off))
        if is_asked(minimum.fit, label) or chi2_sf(distance, len(own)) < CHANCE:
            found.add(label)
    return found


def _without(fit: Fit, starts: Set[FreeParameter]) -> Fit:
    """The point of the torque alone with these starts on the reference."""
    names = {start.name for start in starts}
    model = fit.model.torque_alone.with_values(fit.values)
    model = model.with_free(k for k in model.free_parameters if k.name not in names)
    for label in {start.experiment for start in starts}:
        assert label is not None
        model = _with_state(model, label, values={}, acts_s=0.0)
    return point(model, NoiseOfResidual(model))


def free_starts(fit: Fit) -> tuple[FreeParameter, ...]:
    """The start values that are unknown, of all fitted experiments: those that are asked for and those that the log
    shows to be off the reference."""
    found = list[FreeParameter]()
    for label in fit.model.estimation_labels:
        start = _start(fit, label)
        if start is not None and (is_asked(fit, label) or _chance(_beside(fit, label, start), start) < CHANCE):
            found += start.parameters
    return tuple(found)


def with_likely_starts(model: LoopModel) -> LoopModel:
    """The model with the starts of those fitted experiments that are not on their reference, as the first samples show
    them with the base parameters that the rest of the log gives along the reference; the same model where there are
    none. Iterations need them whose first samples are far off.
    """
    labels = [label for label in model.estimation_labels if _may_be_off(model, label)]
    if not labels:
        return model
    cut = model
    for label in labels:
        seconds = FIRST_PART * float(np.ptp(model.experiments[label].time))
        cut = _with_state(cut, label, acts_s=seconds)
    try:
        values, _ = simulatable(cut, start_values(cut, "reference"))
        torque = with_fitting_substeps(model, values).torque(values)
    except (SimulationError, IdentificationError):
        return model
    late = np.concatenate([cut.experiments[label].has_settled for label in model.estimation_labels])
    deviation = np.sqrt(np.mean((model.measured - torque)[late] ** 2, axis=0)) + noise_floor(model.measured)
    fit = Fit(
        model.with_values(values), values, torque, np.zeros((*torque.shape, 0)),
        Noise(deviation, np.zeros(deviation.size), "residual"), deviation, np.nan,
    )  # fmt: skip
    for label in labels:
        start = _start(fit, label)
        with suppress(SimulationError):
            if start is not None and (is_asked(fit, label) or _chance_alone(fit, label, start) < CHANCE):
                model = _with_state(model, label, values=_found(fit, label, start), acts_s=_seconds(fit, label, start))
    return model


def _with_state(model: LoopModel, label: str, **changes: Any) -> LoopModel:
    """The model with another initial state of an experiment."""
    experiment = model.experiments[label]
    state = replace(experiment.initial_state, **changes)
    return model.with_experiment(label, replace(experiment, initial_state=state))


def _on_reference(model: LoopModel, unknown: Set[str | None]) -> LoopModel:
    """The model with the starts on the reference that looked like others and are none."""
    for label in model.estimation_labels:
        if model.experiments[label].initial_state.acts_s > 0 and label not in unknown:
            model = _with_state(model, label, values={}, acts_s=0.0)
    return model


def _may_be_off(model: LoopModel, label: str) -> bool:
    """Whether an experiment may have another start than its reference: it moves there, or a controller may hold a
    load."""
    kind = model.experiments[label].initial_state.kind
    has_states = any(start.owner != PLANT for start in model.loop.starts)
    return kind == "free" or (kind == "detected" and (has_states or begins_moving(model, label)))


def is_asked(fit: Fit, label: str) -> bool:
    """Whether the case has the start of an experiment free."""
    return fit.model.experiments[label].initial_state.kind == "free"


def free_start_remarks(fit: Fit, starts: Sequence[FreeParameter]) -> list[str]:
    """What is said of starts that are free in a fit, and of those that should be and that the log does not show."""
    found = [
        NOT_SHOWN.format(label)
        for label in fit.model.estimation_labels
        if is_asked(fit, label) and label not in {start.experiment for start in starts}
    ]
    for label in dict.fromkeys(start.experiment for start in starts):
        assert label is not None
        values = {_name(k): fit.values[fit.model.names.index(k.name)] for k in starts if k.experiment == label}
        found.append(
            f"{label}: {_off(fit.model, values)}. The start is free "
            f"({_told(fit.model, label, values)}), and the standard deviations of all parameters count it."
        )
    return found


def with_forgotten_held(model: LoopModel, fit: Fit) -> LoopModel:
    """A model without those of its free starts that the logs of a fit of it do not show, as where their first samples
    were left out since: they are held where the model has them."""
    starts = [k for k in model.free_parameters if k.is_start]
    if not starts:
        return model
    places = [fit.model.names.index(start.name) for start in starts]
    columns = fit.jacobian[:, :, places] * np.array([start.scale for start in starts])
    kept = _shown(whitened(columns, fit.deviation))
    held = {start.name: start for i, start in enumerate(starts) if i not in kept}
    for start in held.values():
        assert start.experiment is not None
        values = model.experiments[start.experiment].initial_state.values
        value = float(model.start[model.names.index(start.name)])
        model = _with_state(model, start.experiment, values={**values, _name(start): value})
    return model.with_free(k for k in model.free_parameters if k.name not in held) if held else model


def held_out_starts(fit: Fit, *, asked_only: bool = False) -> tuple[LoopModel, list[str]]:
    """The model of a fit with the starts of held-out experiments as the first part of their logs shows them, which is
    then no longer judged; and what is said of them. Those alone that the case asks for, if they alone are wanted."""
    model, remarks, alone = fit.model, list[str](), fit.torque_alone
    for label in model.experiments.validation_labels:
        if asked_only and not is_asked(fit, label):
            continue
        try:
            found = _held_out(alone, label)
        except SimulationError:  # the judge says why
            continue
        if found is not None:
            state, seconds, text = found
            moved = replace(model.experiments[label], initial_state=state).after(seconds)
            model = model.with_experiment(label, moved)
            remarks.append(text)
        elif is_asked(fit, label):
            remarks.append(NOT_SHOWN.format(label))
    return model, remarks


@dataclass(frozen=True)
class OtherStart:
    """A state at the start of an experiment that its log shows elsewhere than the case gives it.

    Attributes:
        label: of the experiment; name: of the state; unit: of its values, the one that is given and the one that is
            found beside the other states; chance: probability by which noise alone moves the start as far.
    """

    label: str
    name: str
    unit: str
    given: float
    found: float
    chance: float


def start_advice(model: LoopModel) -> str:
    """What to do first about a loop that cannot be simulated: where its delay breaks it, or where its start is given or
    taken for granted."""
    delay = model.loop.systems[model.first].delays.get(model.loop.plant_name, 0.0)
    if delay > 0 and _error(model.with_delay(0.0)) < NEARER * _error(model):
        return f"Correct the delay of the loop: without its {delay:.4g} samples it comes much nearer to the log. "
    kinds = {label: model.experiments[label].initial_state.kind for label in model.estimation_labels}
    if "given" in kinds.values():
        return "Leave initial_state out, or correct it: the log may start elsewhere. "
    if any(kind == "detected" and not begins_moving(model, label) for label, kind in kinds.items()):
        return "Where the log begins before the machine stands on its reference, write initial_state: free. "
    return ""


def _error(model: LoopModel) -> float:
    """Error of the torque at the values of a model, in the size of the log; infinite where its loop does not run."""
    try:
        error = float(np.linalg.norm(model.measured - model.torque(model.start)))
    except SimulationError:
        return np.inf
    return error / float(np.linalg.norm(model.measured))


def contradicted_starts(fit: Fit) -> list[OtherStart]:
    """Of each fitted experiment whose start is given and not the one of its log, the state that is farthest off, to
    first order."""
    result = []
    for label in fit.model.torque_alone.estimation_labels:
        if fit.model.experiments[label].initial_state.kind != "given":
            continue
        freed = replace(fit.torque_alone, model=_with_state(fit.torque_alone.model, label, kind="free"))
        with suppress(SimulationError):
            start = _start(freed, label)
            if start is None:
                continue
            moved, covariance = _move(_beside(freed, label, start), start)
            chance = _by_chance(moved, covariance)
            if chance < CHANCE:
                far = int(np.argmax(np.abs(moved) / np.sqrt(np.diag(covariance))))
                state, found = start.parameters[far], start.parameters[far].value + float(moved[far])
                result.append(OtherStart(label, _name(state), state.unit, state.value, found, chance))
    return result


def unknown_states(fit: Fit) -> list[str]:
    """What is said of a loop with a controller whose states cannot be free, being an FMU of another tool: of logs whose
    first samples stand out at a minimum, and of those where the start of the plant may stand for its states."""
    unknown, found = fit.model.loop.with_unknown_states, list[str]()
    free = {parameter.experiment for parameter in fit.model.free_parameters if parameter.is_start}
    for label in fit.model.estimation_labels if unknown else ():
        squares = np.mean((_residual(fit, label) / fit.deviation) ** 2, axis=1)
        ratio = _first_over_later(squares, max(int(FIRST_PART * squares.size), 1))
        joints = fit.model.joint_count
        reason = ""
        if ratio > STANDS_OUT**2 and chi2_sf(joints * ratio, joints) < CHANCE:  # as if all were one sample
            reason = f"its first samples stand out, {np.sqrt(ratio):.3g} times the later residual"
        elif label in free:
            reason = f"the start that was found may stand for states of {' and '.join(unknown)}"
        if reason and fit.model.experiments[label].initial_state.kind not in ("reference", "given"):
            found.append(NOT_OFFERED.format(label, reason, " and ".join(unknown), unknown[0]))
    return found


def start_parameters(model: LoopModel, label: str) -> tuple[FreeParameter, ...]:
    """Positions, velocities and states of controllers at the start of an experiment, as free parameters, as far as its
    loop lets them be set. A motion that begins at rest, and whose start is not asked for, has those of controllers
    alone."""
    experiment, on = model.experiments[label], _on(model, label)
    found = []
    for start in _candidates(model, label):
        value = experiment.initial_state.values.get(start.name, on[start.name])
        if start.owner == PLANT:
            stem = start.name.rstrip("0123456789")
            motion = joint_reference(experiment.reference, int(start.name[len(stem) :]))
            scale = float(np.ptp(motion[("q", "dq").index(stem)]))
        else:
            scale = _range(model, label, start, value)
        if scale > 0:
            own = f"{start.label}[{label}]"
            free = FreeParameter(own, start.unit, start.owner, start.key, value, scale, experiment=label, is_start=True)
            found.append(free)
    return tuple(found)


def _candidates(model: LoopModel, label: str) -> list[StartValue]:
    """The states of a loop that may be free in an experiment."""
    experiment, on = model.experiments[label], _on(model, label)
    moves = experiment.initial_state.kind != "detected" or begins_moving(model, label)
    return [start for start in model.loop.starts if start.name in on and (start.owner != PLANT or moves)]


def _range(model: LoopModel, label: str, start: StartValue, value: float) -> float:
    """The change of a state of a controller at the start that changes the torque by its range; 0 where it does not
    act."""
    experiment = model.experiments[label]
    model = model.with_experiment(label, experiment.before(max(int(FIRST_PART * experiment.time.size), 1)))
    try:
        torque = model.torque(model.start, label)
    except SimulationError:
        return 0.0
    size, step = np.ptp(experiment.torque, axis=0) + noise_floor(experiment.torque), 1.0
    for _ in range(PROBES):
        moved = _with_state(model, label, values={**experiment.initial_state.values, start.name: value + step})
        try:
            change = float(np.max(np.abs(moved.torque(model.start, label) - torque) / size))
        except SimulationError:
            change = np.inf
        if PROBED[0] <= change <= PROBED[1]:
            return step / change
        step = step * PROBE_FACTOR if change < PROBED[0] else step / PROBE_FACTOR
    return 0.0


def begins_moving(model: LoopModel, label: str) -> bool:
    """Whether the reference of an experiment moves in its first row."""
    reference = model.experiments[label].reference
    speeds = [np.abs(joint_reference(reference, j)[1]) for j in range(1, model.joint_count + 1)]
    return any(speed[0] > MOVING * speed.max() for speed in speeds)


def _start(fit: Fit, label: str) -> _Start | None:
    """The start of an experiment that may have another one than its reference; None where it has not, or where its log
    does not show it."""
    model = fit.model
    if not _may_be_off(model, label):
        return None
    count = max(int(FIRST_PART * model.experiments[label].time.size), 1)
    is_certain = is_asked(fit, label) or model.experiments[label].initial_state.acts_s > 0
    residual = _residual(fit, label)
    squares = np.mean((residual / fit.deviation) ** 2, axis=1)
    if not is_certain and not _stands_out(squares, count):
        return None
    asked = start_parameters(model.with_values(fit.values), label)
    if not asked or any(k.name == asked[0].name for k in model.free_parameters):
        return None
    first = _with_start(fit, label, asked, count)
    torque, values = first.torque(first.start, label), first.start
    only = range(values.size - len(asked), values.size)
    columns = sensitivity(first, values, torque, only=only, exact=False)
    columns *= np.array([parameter.scale for parameter in asked])
    columns = columns[: _affected_samples(columns, [parameter.owner == PLANT for parameter in asked])]
    shown = _shown(whitened(columns, _later_deviation(residual, count, fit.deviation)))
    if not shown or not (is_certain or _stands_out(squares, columns.shape[0])):
        return None
    scale, on = np.array([asked[i].scale for i in shown]), _on(model, label)
    off = np.array([asked[i].value - on[_name(asked[i])] for i in shown])
    return _Start(tuple(asked[i] for i in shown), columns[:, :, shown] / scale, off)


def _affected_samples(columns: Array, of_plant: Sequence[bool]) -> int:
    """Number of first samples in which start values act, by their columns (K, n, m): those of the plant together,
    states of controllers, which may be forgotten later, each by itself."""
    effect, together = np.abs(columns).max(axis=1), np.array(of_plant)
    largest = effect.max(axis=0, initial=0.0)
    largest[together] = largest.max(where=together, initial=0.0)
    acts = np.any(effect > FORGOTTEN * largest, axis=1)
    return int(np.flatnonzero(acts)[-1]) + 1 if acts.any() else 0


def _later_deviation(residual: Array, count: int, deviation: Array) -> Array:
    """(n,) deviations (n,) of the noise without what a transient in the first samples of a residual (N, n) adds."""
    later = residual[count:]
    size = np.sqrt(np.mean(later**2, axis=0)) if later.size else np.zeros(deviation.size)
    return np.where(size > 0, np.minimum(deviation, size), deviation)


def _residual(fit: Fit, label: str) -> Array:
    """(N, n) residual of an experiment, held out or not."""
    rows = fit.model.experiments.rows
    return fit.residual[rows[label]] if label in rows else fit.residual_in(label)


def _stands_out(squares: Array, count: int) -> bool:
    """Whether the first samples of squared residuals (N,), up to ``count`` of them, are far larger than the later ones:
    a model that is wrong all the time does not show in its start."""
    return _first_over_later(squares, count) > STANDS_OUT**2


def _first_over_later(squares: Array, count: int) -> float:
    """Largest mean of the first samples of squares (N,), up to ``count`` of them, over that of the later ones; 0 where
    there are none."""
    later = squares[count:]
    sizes = {count, *(2**k for k in range(count.bit_length()))}
    first = max(float(squares[:size].mean()) for size in sizes if size <= count)
    return first / max(float(later.mean()), np.finfo(float).tiny) if later.size else 0.0


def _shown(columns: Array) -> list[int]:
    """Those of columns (r, m), of start values divided by their range, that have a standard deviation of a part of
    it; of the others the least certain one is left out until all have."""
    shown = [i for i, column in enumerate(columns.T) if np.linalg.norm(column) * DETERMINED > 1]
    while shown:
        deviation = np.sqrt(np.diag(np.linalg.pinv(columns[:, shown].T @ columns[:, shown], hermitian=True)))
        length = np.linalg.norm(columns[:, shown], axis=0)
        deviation = np.maximum(deviation, 1 / length)
        if deviation.max() <= DETERMINED:
            break
        del shown[int(np.argmax(deviation))]
    return shown


def _with_start(fit: Fit, label: str, start: tuple[FreeParameter, ...], count: int) -> LoopModel:
    """The model of the first samples of an experiment alone, its start free beside all else."""
    model = fit.model.with_values(fit.values).on(label).torque_alone
    model = model.with_free((*model.free_parameters, *start))
    return model.with_experiment(label, model.experiments[label].before(count))


def _beside(fit: Fit, label: str, start: _Start) -> Fit:
    """A fit with the start of a fitted experiment beside its own parameters, not moved there."""
    rows = fit.model.experiments.rows[label]
    further = np.zeros((*fit.torque.shape, len(start.parameters)))
    further[rows.start : rows.start + start.samples] = start.columns
    return replace(fit, jacobian=np.concatenate([fit.jacobian, further], axis=2))


def _chance(fit: Fit, start: _Start) -> float:
    """Probability that noise alone asks for as large a start off the reference, the last columns of a fit, to first
    order."""
    off, covariance = _move(fit, start)
    return _by_chance(off + start.off, covariance)


def _by_chance(off: Array, covariance: Array) -> float:
    """Probability of as large a distance (m,) with this covariance (m, m).

    In units of the deviations, and without directions of which nothing is known: nothing can be far off there.
    """
    deviation = np.sqrt(np.diag(covariance))
    distance = off / deviation
    correlation = covariance / np.outer(deviation, deviation)
    return float(chi2_sf(distance @ np.linalg.lstsq(correlation, distance, rcond=None)[0], off.size))


def _move(fit: Fit, start: _Start) -> tuple[Array, Array]:
    """By how much (m,) the log moves a start, the last columns of a fit, to first order, and the covariance of that.

    The noise is what the change leaves: a transient would pass for its colour.
    """
    table, residual = whitened(fit.jacobian, fit.deviation), whitened(fit.residual, fit.deviation)
    prior = prior_rows(fit.model.prior, fit.values)
    if prior is not None:
        table = fit.model.beside_prior(table)
        residual = np.concatenate([residual, prior[1]])
    change = np.linalg.lstsq(table, residual, rcond=None)[0]
    known = fit_uncertainty(replace(fit, outputs=fit.torque + fit.jacobian @ change))
    return np.asarray(change[-start.count :]), known.covariance[-start.count :, -start.count :]


def _chance_alone(fit: Fit, label: str, start: _Start) -> float:
    """The same by the first samples alone, all other values taken as known."""
    model = _start_only(fit, label, start)
    torque = model.torque(model.start, label)
    return _chance(replace(fit, model=model, values=model.start, outputs=torque, jacobian=start.columns), start)


def _held_out(fit: Fit, label: str) -> tuple[InitialState, float, str] | None:
    """The start of a held-out experiment that its log shows, how long it acts, s, and a text; None where it starts on
    its reference."""
    start = _start(fit, label)
    if start is None:
        return None
    chance = _chance_alone(fit, label, start)
    if chance >= CHANCE and not is_asked(fit, label):
        return None
    given, seconds = InitialState("found", _found(fit, label, start)), _seconds(fit, label, start)
    return (
        given,
        seconds,
        (
            f"{label}: {_off(fit.model, given.values)} (probability by chance {chance:.1g}). Its first "
            f"{seconds:.3g} s give the start ({_told(fit.model, label, given.values)}), and the rest is judged."
        ),
    )


def _found(fit: Fit, label: str, start: _Start) -> dict[str, float]:
    """Name of a state -> value at the start of an experiment, by its first samples and the values of a fit."""
    stopping = Stopping(STEPS, tolerance=SETTLED, updates=None, check_all=False)
    found = minimise(_start_only(fit, label, start), fit.noise, stopping=stopping)
    moved = found.values[-start.count :]
    return {_name(k): float(value) for k, value in zip(start.parameters, moved, strict=True)}


def _start_only(fit: Fit, label: str, start: _Start) -> LoopModel:
    """The model of the samples in which a start acts, with nothing free but that start."""
    held = tuple(replace(k, lowest=v, highest=v) for k, v in zip(fit.model.free_parameters, fit.values, strict=True))
    model = _with_start(fit, label, start.parameters, start.samples).with_free((*held, *start.parameters))
    return replace(model, prior=None)


def _seconds(fit: Fit, label: str, start: _Start) -> float:
    """How long a start acts, s."""
    experiment = fit.model.experiments[label]
    return float(experiment.time[start.samples] - experiment.reference.time[0])


def _name(start: FreeParameter) -> str:
    """``q1`` of ``q_start1[estimation]``, as an initial state has it."""
    return state_name(start.name.removesuffix(f"[{start.experiment}]"))


def _off(model: LoopModel, names: Iterable[str]) -> str:
    """What is not where it should be, in words."""
    of_plant = {start.name for start in model.loop.starts if start.owner == PLANT}
    if of_plant & set(names):
        return "its motion does not start on its reference"
    return "its controller does not start in the state in which it is built"


def _told(model: LoopModel, label: str, values: Mapping[str, float]) -> str:
    """Start values in words, with those of the reference."""
    on = _on(model, label)
    told = ", ".join(f"{name} = {value:.4g} instead of {on[name]:.4g}" for name, value in values.items())
    kept = [start.name for start in _candidates(model, label) if start.name not in values]
    return f"{told}; {', '.join(kept)} held, which the log does not show beside them" if kept else told


def _on(model: LoopModel, label: str) -> dict[str, float]:
    """Name -> start where an experiment starts on its reference, its controllers as they are built."""
    plant = model.loop.start_values(replace(model.experiments[label], initial_state=InitialState("reference")))
    known = {start.name: plant.get(start.key) if start.owner == PLANT else start.value for start in model.loop.starts}
    return {name: value for name, value in known.items() if value is not None}
