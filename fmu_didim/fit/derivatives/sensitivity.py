"""Sensitivity of the outputs of a loop to its free parameters: S = d y / d values, the torque first.

Three ways, the best one that a parameter allows:

* one run of the loop with its derivatives, where the equations of all components are known
  (:func:`fmu_didim.cosim.derivatives.with_derivatives`): exact for all parameters of all components at once;
* a forward difference, where the simulation is smooth in the parameter because the integrator of the plant is ours;
* a central difference with a step that is found, elsewhere (:mod:`fmu_didim.fit.derivatives.differences`): so that the
  columns err by little beside the smallest singular value of all of them, on which the deviations depend.

Where compiled code runs the loop, simulations run side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fmu_didim.base.errors import DivergedError, SimulationError
from fmu_didim.components.derivatives import derivative_name
from fmu_didim.cosim import System
from fmu_didim.cosim.derivatives import with_derivatives
from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives.differences import KEPT_STEP, STEP, Difference, Ladder, Steps
from fmu_didim.fit.derivatives.repetition import Beginning, change_of_outputs
from fmu_didim.model.external_torque import EXTERNAL_TORQUE
from fmu_didim.model.free_parameter import BASE, DELAY, LOG, PLANT, FreeParameter
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.prediction import Prediction
from fmu_didim.model.signals.path import INPUT, OUTPUT
from fmu_didim.model.workers import side_by_side

SHORTER_STEP = 30.0
"""[1] Where neither that step nor its opposite can be simulated, it is divided by this."""
SMOOTH_STEP = 3e-7
"""[1] Of the value at which a parameter alone would make up the whole torque. The simulations of our own plants are
smooth in the parameters, so that truncation and rounding both stay at some 1e-6 of the sensitivity."""
ROUGHNESS = 0.1
"""[1] Error of a column, relative to its norm, that a search among many models goes on with."""
SMOOTH = 1e-3
"""[1] The same in a fit, until the other columns are known, from which it has to be distinguished."""
SHARE_OF_SINGULAR = 0.02
"""[1] Errors of the columns, of length one, over the smallest singular value of all of them: no deviation is wrong by
a larger part. Shorter or longer steps are tried where it is more."""
COLUMNS_A_THREAD = 16
"""[columns] Columns of a sensitivity that make a run of their own pay: they cost about as much as the simulation
does."""

LONG = 15e6
"""[steps] Of the integration, times the square of the joints, for all columns of a search by differences, from which
the loop is run once with its derivatives: that takes a sixth to a twelfth of the time, and compiling it about as long
as so many steps."""


def sensitivity(
    model: LoopModel,
    values: Array,
    outputs: Array,
    *,
    only: Sequence[int] = (),
    sizes: Array | None = None,
    exact: bool = True,
    whole: bool = True,
    steps: Steps | None = None,
) -> Array:
    """d outputs / d values over all experiments that are fitted, (M, m, p) or of ``only`` some parameters.

    Columns of parameters that are held, their limits being one, are zero: they explain nothing.

    Args:
        outputs: (M, m) at the values; those without further channels are the torque (N, n).
        sizes: (b,) of the base parameters, see :func:`parameter_sizes`; their scales by default.
        exact: False where a search compares many models: forward differences are enough there, unless they take so
            long that compiling the derivatives of a model is soon made up for.
        whole: False where, if motion and torque repeat, parameters need be moved for the first period alone.
        steps: of central differences that are known already; new ones are added.
    """
    steps = {} if steps is None else steps
    chosen = list(only) if len(only) else list(range(len(model.free_parameters)))
    model = model.integrated_as(values)  # other steps of the integration would look like a change
    tables, tasks = {}, []
    for label, rows in model.experiments.output_rows.items():
        table = tables[label] = np.zeros((rows.stop - rows.start, outputs.shape[1], len(chosen)))
        acting = [k for k, i in enumerate(chosen) if model.free_parameters.acts(i, label)]
        missing = [k for k in acting if not model.free_parameters[chosen[k]].is_held]
        run = model.simulation(values, label)
        beginning = None if whole else Beginning.of(run, outputs[rows])
        if exact or _is_long(run, len(missing), beginning):
            varied = by_variation(run, [chosen[k] for k in missing], beginning)
            for k in [k for k in missing if chosen[k] in varied]:
                table[:, :, k] = varied[chosen[k]]
            missing = [k for k in missing if chosen[k] not in varied]
            del varied  # as large as the table
        one = _Experiment(run, outputs[rows], sizes, exact, beginning)
        tasks += [_Column(label, k, chosen[k], *one.way(chosen[k])) for k in missing]
    workers = model.allowed_workers(values) if len(tasks) > 1 else 1
    _fill(tables, tasks, steps, SMOOTH if exact else ROUGHNESS, workers)
    if exact and any(task.ladder for task in tasks):
        # Nearly collinear columns show only now.
        size = np.sqrt(np.mean(outputs**2, axis=0))
        smallest = smallest_singular_value(np.concatenate(list(tables.values())) / np.where(size > 0, size, 1)[:, None])
        wanted = SHARE_OF_SINGULAR * smallest / float(np.sqrt(len(chosen)))
        _fill(tables, [task for task in tasks if task.falls_short(steps, wanted)], steps, wanted, workers)
    return tables.popitem()[1] if len(tables) == 1 else np.concatenate(list(tables.values()))


def _is_long(run: Simulation, columns: int, beginning: Beginning | None) -> bool:
    """Whether differences of so many columns take longer than to compile the derivatives of the loop."""
    model = run.model
    if not model.can_refine:
        return False
    part = run if beginning is None else beginning.cut(run)
    return part.integration_steps * columns * model.joint_count**2 > LONG


def smallest_singular_value(table: Array) -> float:
    """Of columns (N, n, p) of length one; those that are zero are left out."""
    columns = table.reshape(-1, table.shape[2])
    length = np.linalg.norm(columns, axis=0)
    columns = columns[:, length > 0] / length[length > 0]
    return float(np.linalg.svd(columns, compute_uv=False)[-1]) if columns.size else 1.0


def parameter_sizes(model: LoopModel, values: Array, prediction: Prediction) -> Array:
    """(b,) size of each base parameter, never zero: the value at which it would make up the whole torque."""
    if prediction.regressor is not None:
        norms = np.linalg.norm(prediction.regressor, axis=(0, 1))
        return np.asarray(np.linalg.norm(prediction.torque) / np.where(norms > 0, norms, np.inf))
    size = np.maximum(np.abs(values), np.abs(model.start))[: model.linear_count]
    return np.where(size > 0, size, 1.0)


def step_size(model: LoopModel, i: int, sizes: Array | None) -> float:
    """The size of a parameter to which its steps are relative."""
    return float(sizes[i] if sizes is not None and i < sizes.size else model.free_parameters[i].scale)


def by_variation(
    run: Simulation, wanted: Sequence[int], beginning: Beginning | None = None, *, lasting: bool = False
) -> Mapping[int, Array]:
    """As :func:`_by_variation`; columns of a load are sums of those of the base parameters that it adds to."""
    free = run.model.free_parameters
    loads = {i: direction for i, direction in free.loads(run.label) if i in wanted}
    if not loads:
        return _by_variation(run, wanted, beginning, lasting=lasting)
    places = free.places(run.label)
    moved = [int(places[j]) for j in np.flatnonzero(np.any([d != 0 for d in loads.values()], axis=0))]
    asked = [i for i in wanted if i not in loads]
    found = dict(_by_variation(run, [*asked, *(i for i in moved if i not in asked)], beginning, lasting=lasting))
    if not set(moved) <= set(found):
        return {i: column for i, column in found.items() if i in wanted}
    for i, direction in loads.items():
        found[i] = sum((direction[list(places).index(k)] * found[k] for k in moved), np.zeros_like(found[moved[0]]))
    return {i: found[i] for i in wanted if i in found}


def _by_variation(
    run: Simulation, wanted: Sequence[int], beginning: Beginning | None = None, *, lasting: bool = False
) -> Mapping[int, Array]:
    """Columns (M, m) of those parameters that one run of the loop with its derivatives gives; none where it cannot.

    Args:
        beginning: of the experiment, where columns that repeat need not be followed to its end.
        lasting: whether all these parameters are known to act all the time.
    """
    model = run.model
    found = {i: place for i in wanted if (place := _place(run, model.free_parameters[i])) is not None}
    places = {i: (component, name) for i, (component, name, _) in found.items()}
    if not places or run.shown_as:  # sensors change the outputs of the model, which is what is differentiated
        return {}
    groups = _groups(list(places.values()), model.threads)
    measured = [run.signal_of(channel) for channel in run.experiment.channels]
    measured += [] if model.loop.shows_torque else list(model.loop.logged)
    tasks = [partial(with_derivatives, run.system, group, measured) for group in groups]
    varied = [found for found in side_by_side(tasks, model.threads) if found is not None]
    if len(varied) < len(groups):
        return {}
    systems = list(zip(varied, map(len, groups), strict=True))
    table = None
    late = not lasting and any(not _lasts(model.free_parameters[i]) for i in places)
    if beginning is not None and not late:
        first = _followed_all(beginning.cut(run), systems)
        table = None if first is None else beginning.repetition.continued(first)
    if table is None:
        table = _followed_all(run, systems)
    return {} if table is None else {i: found[i][2] * table[:, :, lane] for lane, i in enumerate(places)}


def _groups(places: list[tuple[str, str]], workers: int) -> list[list[tuple[str, str]]]:
    """The parameters in groups of equal size, one a thread, as long as each has enough to do beside the simulation."""
    count = max(1, min(workers, len(places) // COLUMNS_A_THREAD))
    size = -(-len(places) // count)
    return [places[first : first + size] for first in range(0, len(places), size)]


def _followed_all(run: Simulation, systems: Sequence[tuple[System, int]]) -> Array | None:
    """(M, m, p) derivatives of the outputs from systems with their counts, side by side; None where one of them gives
    none."""
    tables = side_by_side([partial(_followed, run, *system) for system in systems], run.model.threads)
    found = [table for table in tables if table is not None]
    if len(found) < len(systems):
        return None
    return found[0] if len(found) == 1 else np.concatenate(found, axis=2)


def _followed(run: Simulation, varied: System, count: int) -> Array | None:
    """(M, m, count) derivatives of the outputs at the samples; None where Python would run the loop, and where they
    grow beyond all bounds though the loop does not: of a motion that is chaotic, as one with play and a stiff gear may
    be, differences over steps that show in it say more."""
    names = [*run.model.loop.logged, *(run.signal_of(channel) for channel in run.experiment.channels)]
    lanes = [derivative_name(name, lane) for name in names for lane in range(count)]
    try:
        recording = run.record(system=varied, ticks=run.output_ticks, signals=lanes)
    except DivergedError:
        return None
    if not recording.compiled:
        return None

    loop, table = run.model.loop, None
    signals = recording.inputs if loop.shows_torque else recording.sampled
    for lane in range(count):

        def signal(name: str, lane: int = lane) -> Array:
            return recording.table([derivative_name(name, lane)], sampled=True)[:, 0]

        torque = np.column_stack([signals[derivative_name(name, lane)] for name in loop.logged])
        column = run.sampled_outputs(recording, torque, signal)
        table = np.empty((*column.shape, count)) if table is None else table
        table[:, :, lane] = column
    return table


def _lasts(parameter: FreeParameter) -> bool:
    """Whether a parameter acts all the time: one of an effect may begin late, of which the first period shows
    nothing."""
    return parameter.effect is None and parameter.owner != EXTERNAL_TORQUE


def _place(run: Simulation, parameter: FreeParameter) -> tuple[str, str, float] | None:
    """Component and parameter by which the loop is differentiated, and by how much that changes with one unit; None for
    what is no parameter of a component."""
    model = run.model
    if parameter.owner in (DELAY, LOG, EXTERNAL_TORQUE, INPUT, OUTPUT) or parameter.is_load:
        return None
    if parameter.owner == BASE:
        return model.loop.plant_name, model.parameters.plant_names[model.parameters.names.index(parameter.key)], 1.0
    if parameter.owner == PLANT:
        return model.loop.plant_name, parameter.key, 1.0
    return model.loop.multiplied(run.label, parameter.owner, parameter.key)


@dataclass(frozen=True)
class _Column:
    """A column to be simulated: ``k`` of the table of an experiment, of parameter ``i``, by a forward difference or by
    central ones."""

    label: str
    k: int
    i: int
    forward: Callable[[], Array] | None
    ladder: Ladder | None

    def simulated(self, steps: Steps, wanted: float) -> Difference:
        """With a step of the wanted error; a known one is kept while its error does not grow."""
        if self.ladder is None:
            assert self.forward is not None
            return Difference(self.forward())
        known = steps.get((self.label, self.i))
        if known is None:
            found = self.ladder.best(wanted)
            return replace(found, step=found.step and replace(found.step, sought=wanted))
        allowed = max(wanted, KEPT_STEP * known.error * known.curved) if known.is_sought(wanted) else wanted
        found = self.ladder.best(allowed, known.place)
        return replace(found, step=found.step and found.step.after(known, wanted))

    def falls_short(self, steps: Steps, wanted: float) -> bool:
        """Whether to search for a better step than the known one."""
        known = steps.get((self.label, self.i)) if self.ladder else None
        return known is not None and known.error > wanted and not known.is_sought(wanted)


def _fill(tables: Mapping[str, Array], columns: Sequence[_Column], steps: Steps, wanted: float, workers: int) -> None:
    """Simulate columns into the tables of their experiments."""
    found = side_by_side([partial(column.simulated, steps, wanted) for column in columns], workers)
    for column, difference in zip(columns, found, strict=True):
        tables[column.label][:, :, column.k] = difference.column
        if difference.step is not None:
            steps[column.label, column.i] = difference.step


class _Experiment:
    """Columns of one experiment by differences."""

    def __init__(
        self, run: Simulation, outputs: Array, sizes: Array | None, exact: bool, beginning: Beginning | None
    ) -> None:
        self._run, self._outputs, self._sizes, self._exact, self._beginning = run, outputs, sizes, exact, beginning
        self._smooth = run.model.can_refine or run.model.loop.plant.equations() is not None

    def way(self, i: int) -> tuple[Callable[[], Array] | None, Ladder | None]:
        """The function that simulates the column (M, m) of a parameter: a forward difference, or central ones."""
        parameter = self._run.model.free_parameters[i]
        timed = parameter.owner in (DELAY, LOG, EXTERNAL_TORQUE)
        if timed or (self._smooth and (not self._exact or parameter.owner == BASE)):
            return partial(self._forward, i, parameter), None
        return None, Ladder(self._run, self._outputs, i, step_size(self._run.model, i, self._sizes))

    def _forward(self, i: int, parameter: FreeParameter) -> Array:
        step = STEP * parameter.scale
        if self._exact and self._sizes is not None and i < self._sizes.size:
            step = SMOOTH_STEP * float(self._sizes[i])
        here = self._run.values[i]
        for size in (step, -step, step / SHORTER_STEP):
            there = here + size
            if not parameter.lowest <= there <= parameter.highest:
                continue
            beginning = self._beginning if _lasts(parameter) else None
            with suppress(SimulationError):
                change = change_of_outputs(self._run.moved(i, there), self._outputs, beginning)
                return np.asarray(change / (there - here))
        return np.zeros_like(self._outputs)  # a parameter that cannot be moved explains nothing
