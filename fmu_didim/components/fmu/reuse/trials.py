"""The trials of an FMU: functions (component, step size in s, ...) -> answer, which run in other processes.

A trial runs the FMU for some steps with pseudo-random held inputs, and raises what goes wrong in it.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from typing import Any

import numpy as np

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.binding import EndedError
from fmu_didim.components.fmu.description import FLOAT_TYPES
from fmu_didim.components.fmu.settings import RESET, STATE, FmuSettings
from fmu_didim.data.signals import Array

STEPS, FEWEST_STEPS = 50, 8
PART_OF_EXPERIMENT = 0.8
"""[1] Largest part of the FMU's default experiment that a trial simulates."""
SEED = 20240131
SAME = 1e-9
"""[1] Trajectories that differ by less than this fraction of their largest value are the same."""
RESTORES, DIFFERS = "restores", "does not restore"
AT_ONCE, AFTER_A_STEP, LATER, NEVER = "at once", "after a step", "later", "never"
ACTS, NO_EFFECT, REFUSED, NOT_TRIED = "acts", "no effect", "refused", "not tried"
Change = tuple[str, float]
"""The output that changes most, empty if there are no outputs, and the change as a fraction of its largest value."""


def same(a: Array, b: Array) -> bool:
    """Whether two trajectories are the same to rounding, with NaN and infinity at the same places."""
    if a.shape != b.shape or (np.isfinite(a) != np.isfinite(b)).any():
        return False
    largest = np.abs(a[np.isfinite(a)]).max(initial=0.0)
    return bool((np.abs(np.nan_to_num(a - b, posinf=0.0, neginf=0.0)) <= SAME * largest).all())


def in_words(error: FmuDidimError) -> str:
    """Why a trial gave no answer."""
    return error.what.rstrip(".") + (f" ({error.got})" if error.got else "")


def step_count(component: FmuSettings, h: float) -> int:
    """Steps of a trial: fewer where the FMU's default experiment ends before, as the FMU may end itself then."""
    stop = component.fmu.experiment.stop
    return STEPS if not stop or stop <= 0 else max(min(STEPS, int(PART_OF_EXPERIMENT * stop / h)), FEWEST_STEPS)


def once(component: FmuSettings, h: float) -> Array:
    """One trajectory (steps, outputs)."""
    return _run(component, _inputs(component, h), h)


def once_timed(component: FmuSettings, h: float) -> tuple[Array, float]:
    """One trajectory and the time in s that it took, without the start of the process."""
    start = clock.monotonic()
    return once(component, h), clock.monotonic() - start


def quiet(component: FmuSettings, h: float) -> Array:
    """One trajectory with the inputs at their start values: others may be beyond what the model supports."""
    starts = np.array([v.start for v in component.inputs])
    return _run(component, np.tile(starts, (step_count(component, h), 1)), h)


def two_in_turn(component: FmuSettings, h: float) -> tuple[Array, Array]:
    """The trajectories of two new instances, one after the other."""
    return once(component, h), once(component, h)


def runs_again(component: FmuSettings, h: float) -> tuple[Array, Array, str, str]:
    """:func:`two_in_turn`, :func:`reset` and :func:`new_state` in one process."""
    first, second = two_in_turn(component, h)
    answers = []
    for trial in (reset, new_state):
        try:
            answers.append(trial(component, h, first))
        except FmuDidimError as error:
            answers.append(in_words(error))
    return first, second, answers[0], answers[1]


def reset(component: FmuSettings, h: float, wanted: Array) -> str:
    """Whether an instance that was reset gives the trajectory of a new one, though all parameters were changed."""
    return _restarted(component, h, wanted, RESET)


def new_state(component: FmuSettings, h: float, wanted: Array) -> str:
    """As :func:`reset`, by restoring the state saved right after the instantiation."""
    return _restarted(component, h, wanted, STATE)


def _restarted(component: FmuSettings, h: float, wanted: Array, strategy: str) -> str:
    u = _inputs(component, h)
    values = {**component.start_values, **component.parameter_values()}
    changed = component.with_parameters({name: _other(value) for name, value in values.items()})
    for before in (changed, component):
        with closing(before.instantiate_in_process(keep_new_state=strategy == STATE)) as instance:
            try:
                _initialise(instance, before)
                _advance(instance, u, h)
            except FmuDidimError:
                if before is component:
                    raise
                continue  # it fails with the changed values, so the trial keeps its own
            instance.restart_by(strategy, component)
            _initialise(instance, component)
            return RESTORES if same(wanted, _advance(instance, u, h)) else DIFFERS
    return DIFFERS


def side_by_side(component: FmuSettings, h: float) -> bool:
    """Whether two instances at the same time, with opposite inputs, give the same as each alone."""
    u = _inputs(component, h)
    inputs = (u, u * [-1.0 if kind in FLOAT_TYPES else 1.0 for kind in component.input_types])
    alone = [_run(component, rows, h) for rows in inputs]
    found: list[list[Array]] = [[], []]
    with _initialised(component) as first, _initialised(component) as second:
        for k in range(len(u)):
            for instance, rows, outputs in zip((first, second), inputs, found, strict=True):
                outputs.append(_advance(instance, rows[k : k + 1], h, k)[0])
    return all(same(np.array(a), b) for a, b in zip(found, alone, strict=True))


def saved_state(component: FmuSettings, h: float) -> str:
    """Whether a state restored in a run goes on as after it was saved."""
    u, half = _inputs(component, h), step_count(component, h) // 2
    with _initialised(component) as instance:
        _advance(instance, u[:half], h)
        saved = instance.save_state()
        first = _advance(instance, u[half:], h, half)
        instance.restore_state(saved)
        return RESTORES if same(first, _advance(instance, u[half:], h, half)) else DIFFERS


def half_step(component: FmuSettings, h: float) -> Change:
    """What half the step changes, with the same held inputs."""
    u = _inputs(component, h)
    return _most_changed(component, _run(component, u, h), _run(component, np.repeat(u, 2, axis=0), h / 2)[1::2])


def reading(component: FmuSettings, h: float) -> Change:
    """What changes after steps if all outputs are read between inputs and step as well."""
    u = _inputs(component, h)
    with _initialised(component) as instance:
        with_reading = _advance(instance, u, h, read_between=True)
    return _most_changed(component, _run(component, u, h), with_reading)


def _most_changed(component: FmuSettings, first: Array, second: Array) -> Change:
    if not first.size:
        return "", 0.0
    difference = np.nan_to_num(np.abs(first - second)).max(axis=0)
    size = np.nan_to_num(np.maximum(np.abs(first), np.abs(second))).max(axis=0)
    change = difference / np.where(size > 0, size, 1.0)
    worst = int(np.argmax(change))
    return component.outputs[worst].name, float(change[worst])


def response(component: FmuSettings, h: float) -> dict[str, str]:
    """Output -> when it first follows a change of all inputs after three steps."""
    u, lead = _inputs(component, h), 3
    other = u.copy()
    factors = np.linspace(1.3, 1.9, u.shape[1])  # unlike ones: a controller may take the difference of two inputs
    for i, kind in enumerate(component.input_types):
        if kind == "Boolean":
            other[lead:, i] = 1 - other[lead:, i]
        elif kind in FLOAT_TYPES:
            other[lead:, i] *= factors[i]
    at_once, trajectories = [], []
    for rows in (u, other):
        with _initialised(component) as instance:
            _advance(instance, rows[:lead], h)
            instance.inputs[:] = rows[lead]
            instance.set()
            instance.get()
            at_once.append(instance.outputs.copy())
            trajectories.append(_advance(instance, rows[lead:], h, lead))
    now, changed = at_once[0] != at_once[1], trajectories[0] != trajectories[1]
    after_a_step, ever = changed[0], changed.any(axis=0)
    return {
        v.name: AT_ONCE if now[i] else AFTER_A_STEP if after_a_step[i] else LATER if ever[i] else NEVER
        for i, v in enumerate(component.outputs)
    }


def parameters(component: FmuSettings, h: float, seconds: float) -> dict[str, str]:
    """Parameter -> what a change before the run does; those left after so many seconds are not tried."""
    until, base = clock.monotonic() + seconds, once(component, h)
    return _effects(component.parameter_values(), until, base, lambda value: once(component.with_parameters(value), h))


def tunable(component: FmuSettings, h: float, seconds: float) -> dict[str, str]:
    """As :func:`parameters`, for a change of a tunable parameter during the run."""
    until, u, half = clock.monotonic() + seconds, _inputs(component, h), step_count(component, h) // 2
    base = once(component, h)[half:]

    def changed(value: Mapping[str, float]) -> Array:
        with _initialised(component) as instance:
            _advance(instance, u[:half], h)
            instance.set_parameters(value)
            return _advance(instance, u[half:], h, half)

    values = {name: value for name, value in component.parameter_values().items() if name not in component.fixed}
    return _effects(values, until, base, changed)


def _effects(
    values: Mapping[str, float], until: float, base: Array, changed: Callable[[Mapping[str, float]], Array]
) -> dict[str, str]:
    found = {}
    for name, value in values.items():
        if clock.monotonic() > until:
            found[name] = NOT_TRIED
            continue
        try:
            equal = np.array_equal(base, changed({name: _other(value)}), equal_nan=True)
            found[name] = NO_EFFECT if equal else ACTS
        except FmuDidimError:
            found[name] = REFUSED
    return found


def _other(value: float) -> float:
    return value * 1.01 if value else 1e-3


def _inputs(component: FmuSettings, h: float) -> Array:
    """Held inputs (steps, nu), pseudo-random, growing from 1 % to all of their usual size: limits come late."""
    scale = np.array([max(abs(v.start), 1.0) for v in component.inputs])
    random, count = np.random.default_rng(SEED), step_count(component, h)
    rows: Array = random.uniform(-1, 1, (count, scale.size)) * scale
    rows *= np.geomspace(0.01, 1.0, count)[:, None]
    for i, (kind, variable) in enumerate(zip(component.input_types, component.inputs, strict=True)):
        if kind == "Boolean":
            rows[:, i] = random.integers(0, 2, count)
        elif kind not in FLOAT_TYPES:
            rows[:, i] = variable.start  # nothing states which other integers are meaningful
    return rows


@contextmanager
def _initialised(component: FmuSettings) -> Iterator[Any]:
    with closing(component.instantiate_in_process()) as instance:
        _initialise(instance, component)
        yield instance


def _initialise(instance: Any, component: FmuSettings) -> None:
    """Initialise with the inputs' start values: others may lead to an initial state that the FMU cannot solve for."""
    instance.begin_initialisation(0.0)
    instance.inputs[:] = [v.start for v in component.inputs]
    instance.set()
    instance.get()
    instance.end_initialisation()


def _run(component: FmuSettings, u: Array, h: float) -> Array:
    with _initialised(component) as instance:
        return _advance(instance, u, h)


def _advance(instance: Any, rows: Array, h: float, start: int = 0, *, read_between: bool = False) -> Array:
    found = np.zeros((len(rows), instance.outputs.size))
    with suppress(EndedError):  # the FMU may end its run before the last step
        for k, row in enumerate(rows):
            instance.inputs[:] = row
            instance.set()
            if read_between:
                instance.get()
            instance.step((start + k) * h, h)
            instance.get()
            found[k] = instance.outputs
    return found
