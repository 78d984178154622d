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
from fmu_didim.components.fmu.settings import STATE, FmuSettings
from fmu_didim.data.signals import Array

STEPS, FEWEST_STEPS = 50, 8
PART_OF_EXPERIMENT = 0.8
"""[1] Largest part of the FMU's default experiment that a trial simulates."""
SEED = 20240131
SAME = 1e-9
"""[1] Trajectories that differ by less than this fraction of their largest value are the same."""
RESTORES, DIFFERS = "restores", "does not restore"
WHEN = AT_ONCE, AFTER_A_STEP, LATER, NEVER = "at once", "after a step", "later", "never"
ACTS, NO_EFFECT, REFUSED, NOT_TRIED = "acts", "no effect", "refused", "not tried"
Change = tuple[str, float]
"""The output that changes most, empty if there are no outputs, and the change as a fraction of its largest value."""


def same(a: Array, b: Array) -> bool:
    """Whether two trajectories are the same to rounding, with NaN and infinity at the same places."""
    largest = np.abs(a[np.isfinite(a)]).max(initial=0.0)
    return a.shape == b.shape and np.allclose(a, b, rtol=0.0, atol=SAME * largest, equal_nan=True)


def title(trial: Callable[..., Any]) -> str:
    """The name of a trial in messages."""
    return trial.__name__.replace("_", " ")


def in_words(answer: Any) -> Any:
    """The answer of a trial, or why it failed."""
    if not isinstance(answer, FmuDidimError):
        return answer
    return answer.what.rstrip(".") + (f" ({answer.got})" if answer.got else "")


def step_count(component: FmuSettings, h: float) -> int:
    """Steps of a trial: fewer where the FMU's default experiment ends before, as the FMU may end itself then."""
    stop = component.fmu.experiment.stop
    return STEPS if not stop or stop <= 0 else max(min(STEPS, int(PART_OF_EXPERIMENT * stop / h)), FEWEST_STEPS)


def once(component: FmuSettings, h: float) -> Array:
    """One trajectory (steps, outputs)."""
    return _run(component, _inputs(component, h), h)


def quiet(component: FmuSettings, h: float) -> Array:
    """As :func:`once`, with the inputs at their start values: others may be beyond what the model supports."""
    return _run(component, np.array([[v.start for v in component.inputs]] * step_count(component, h)), h)


def in_turn(
    component: FmuSettings, h: float, count: int, strategies: tuple[str, ...] = ()
) -> tuple[list[Array], list[str], float]:
    """Trajectories of so many new instances, one after the other; answers of :func:`restarted`; time in s."""
    start = clock.monotonic()
    found, answers = [once(component, h) for _ in range(count)], []
    for strategy in strategies:
        try:
            answers.append(restarted(component, h, found[0], strategy))
        except FmuDidimError as error:
            answers.append(in_words(error))
    return found, answers, clock.monotonic() - start


def restarted(component: FmuSettings, h: float, wanted: Array, strategy: str) -> str:
    """Whether an instance that has run gives the trajectory of a new one, though all parameters were changed.

    Args:
        strategy: reset, or the state saved right after the instantiation.
    """
    u = _inputs(component, h)
    values = {**component.start_values, **component.parameter_values()}
    changed = component.with_parameters({name: changed_value(value) for name, value in values.items()})
    for before in (changed, component):
        with closing(before.instantiate_in_process(keep_new_state=strategy == STATE)) as instance:
            try:
                initialise(instance, before)
                _advance(instance, u, h)
            except FmuDidimError:
                if before is component:
                    raise
                continue  # it fails with the changed values: try its own
            instance.restart_by(strategy, component)
            initialise(instance, component)
            return RESTORES if same(wanted, _advance(instance, u, h)) else DIFFERS
    return DIFFERS


def side_by_side(component: FmuSettings, h: float) -> bool:
    """Whether two instances at the same time, with opposite inputs, give the same as each alone."""
    u = _inputs(component, h)
    other = u * [-1.0 if kind in FLOAT_TYPES else 1.0 for kind in component.input_types]
    alone = np.hstack([_run(component, u, h), _run(component, other, h)])
    with _initialised(component) as a, _initialised(component) as b:
        rows = [(_advance(a, u[[k]], h, k), _advance(b, other[[k]], h, k)) for k in range(len(u))]
    return same(alone, np.vstack([np.hstack(row) for row in rows]))


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
    """The change by half the step, with the same held inputs."""
    u = _inputs(component, h)
    return _most_changed(component, _run(component, u, h), _run(component, np.repeat(u, 2, axis=0), h / 2)[1::2])


def reading(component: FmuSettings, h: float) -> Change:
    """The change after steps if all outputs are read between inputs and step as well."""
    u = _inputs(component, h)
    return _most_changed(component, _run(component, u, h), _run(component, u, h, between=[]))


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
    between: tuple[list[Array], list[Array]] = [], []
    first, second = (_run(component, rows, h, between=read) for rows, read in zip((u, other), between, strict=True))
    at_once, (after_a_step, *later) = between[0][lead] != between[1][lead], (first != second)[lead:]
    ever = np.any(later, axis=0)
    return {
        v.name: AT_ONCE if at_once[i] else AFTER_A_STEP if after_a_step[i] else LATER if ever[i] else NEVER
        for i, v in enumerate(component.outputs)
    }


def parameters(component: FmuSettings, h: float, seconds: float, *, in_run: bool = False) -> dict[str, str]:
    """Parameter -> effect of a change before a run; those left after so many seconds are not tried."""
    until, u = clock.monotonic() + seconds, _inputs(component, h)
    begin = len(u) // 2 if in_run else 0

    def rest(change: Mapping[str, float]) -> Array:
        with _initialised(component if in_run else component.with_parameters(change)) as instance:
            _advance(instance, u[:begin], h)
            if in_run:
                instance.set_parameters(change)
            return _advance(instance, u[begin:], h, begin)

    unchanged, found = rest({}), {}
    for name, value in component.parameter_values().items():
        if in_run and name in component.fixed:
            continue
        if clock.monotonic() > until:
            found[name] = NOT_TRIED
            continue
        try:
            other = rest({name: changed_value(value)})
            found[name] = NO_EFFECT if np.array_equal(unchanged, other, equal_nan=True) else ACTS
        except FmuDidimError:
            found[name] = REFUSED
    return found


def tunable(component: FmuSettings, h: float, seconds: float) -> dict[str, str]:
    """As :func:`parameters`, for a change of a tunable parameter in the middle of a run."""
    return parameters(component, h, seconds, in_run=True)


def changed_value(value: float) -> float:
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


def initialise(instance: Any, component: FmuSettings) -> None:
    """Initialise with the inputs' start values: others may lead to an initial state that the FMU cannot solve for."""
    instance.begin_initialisation(0.0)
    instance.inputs[:] = [v.start for v in component.inputs]
    instance.set()
    instance.get()
    instance.end_initialisation()


@contextmanager
def _initialised(component: FmuSettings) -> Iterator[Any]:
    with closing(component.instantiate_in_process()) as instance:
        initialise(instance, component)
        yield instance


def _run(component: FmuSettings, u: Array, h: float, *, between: list[Array] | None = None) -> Array:
    with _initialised(component) as instance:
        return _advance(instance, u, h, between=between)


def _advance(instance: Any, rows: Array, h: float, start: int = 0, *, between: list[Array] | None = None) -> Array:
    """Outputs after each step; those between inputs and step are read as well if they have a place."""
    found = np.zeros((len(rows), instance.outputs.size))
    with suppress(EndedError):  # the FMU may end its run before the last step
        for k, row in enumerate(rows):
            instance.inputs[:] = row
            instance.set()
            if between is not None:
                instance.get()
                between.append(instance.outputs.copy())
            instance.step((start + k) * h, h)
            instance.get()
            found[k] = instance.outputs
    return found
