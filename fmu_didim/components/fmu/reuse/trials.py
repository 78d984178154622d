"""The questions that a probe puts to an FMU; each runs in a new process, see ``probe``.

A question is a function (component, step size in s) -> answer; it raises what the FMU does wrong.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Iterator
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
"""Of the default experiment of an FMU that a run takes at most."""
SEED = 20240131
SAME = 1e-9
"""Trajectories that differ by less than this fraction of their largest value are the same."""
RESTORES, DIFFERS = "restores", "does not restore"
AT_ONCE, AFTER_A_STEP, LATER, NEVER = "at once", "after a step", "later", "never"


def same(a: Array, b: Array) -> bool:
    """Whether two trajectories are the same to rounding, NaN and infinity at the same places."""
    if a.shape != b.shape or (np.isfinite(a) != np.isfinite(b)).any():
        return False
    largest = np.abs(a[np.isfinite(a)]).max(initial=0.0)
    return bool((np.abs(np.nan_to_num(a - b, posinf=0.0, neginf=0.0)) <= SAME * largest).all())


def step_count(component: FmuSettings, h: float) -> int:
    """Steps of a run: fewer where the FMU's default experiment ends before, as it may end itself then."""
    stop = component.fmu.experiment.stop
    return STEPS if not stop or stop <= 0 else max(min(STEPS, int(PART_OF_EXPERIMENT * stop / h)), FEWEST_STEPS)


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
            rows[:, i] = variable.start  # which other integers mean something, nobody says
    return rows


@contextmanager
def _begun(component: FmuSettings) -> Iterator[Any]:
    """A new instance that is initialised, for a while."""
    with closing(component.instantiate_here()) as instance:
        _begin(instance, component)
        yield instance


def _begin(instance: Any, component: FmuSettings) -> None:
    """Initialise with the inputs' start values: others may lead an initial state that the FMU cannot solve for."""
    instance.begin_initialisation(0.0)
    instance.inputs[:] = [v.start for v in component.inputs]
    instance.set()
    instance.get()
    instance.end_initialisation()


def _advance(instance: Any, rows: Array, h: float, start: int = 0, *, read_between: bool = False) -> Array:
    found = np.zeros((len(rows), instance.outputs.size))
    with suppress(EndedError):  # that is as far as it goes
        for k, row in enumerate(rows):
            instance.inputs[:] = row
            instance.set()
            if read_between:
                instance.get()
            instance.step((start + k) * h, h)
            instance.get()
            found[k] = instance.outputs
    return found


def _run(component: FmuSettings, u: Array, h: float) -> Array:
    with _begun(component) as instance:
        return _advance(instance, u, h)


def once(component: FmuSettings, h: float) -> Array:
    """One trajectory."""
    return _run(component, _inputs(component, h), h)


def quiet(component: FmuSettings, h: float) -> Array:
    """One trajectory with the inputs at their start values: others may be beyond what the model stands."""
    starts = np.array([v.start for v in component.inputs])
    return _run(component, np.tile(starts, (step_count(component, h), 1)), h)


def two_in_turn(component: FmuSettings, h: float) -> tuple[Array, Array]:
    """Two new instances, one after the other."""
    return once(component, h), once(component, h)


def side_by_side(component: FmuSettings, h: float) -> bool:
    """Whether two instances at the same time, with opposite inputs, run as each alone."""
    u = _inputs(component, h)
    inputs = (u, u * [-1.0 if kind in FLOAT_TYPES else 1.0 for kind in component.input_types])
    alone = [_run(component, rows, h) for rows in inputs]
    found: list[list[Array]] = [[], []]
    with _begun(component) as first, _begun(component) as second:
        for k in range(len(u)):
            for instance, rows, kept in zip((first, second), inputs, found, strict=True):
                kept.append(_advance(instance, rows[k : k + 1], h, k)[0])
    return all(same(np.array(a), b) for a, b in zip(found, alone, strict=True))


def in_words(error: FmuDidimError) -> str:
    """Why there is no answer to a question."""
    return error.what.rstrip(".") + (f" ({error.got})" if error.got else "")


def runs_again(component: FmuSettings, h: float) -> tuple[Array, Array, str, str]:
    """Two new instances in turn, and whether reset and the state of a new instance give a new instance."""
    found = []
    first, second = two_in_turn(component, h)
    for strategy in (RESET, STATE):
        try:
            found.append(restarted(component, h, strategy))
        except FmuDidimError as error:
            found.append(in_words(error))
    return first, second, found[0], found[1]


def restarted(component: FmuSettings, h: float, strategy: str, wanted: Array | None = None) -> str:
    """Whether an instance that was reset, or got back the state saved before anything was set, runs as a new one,
    although all parameters had other values before.

    Args:
        wanted: the trajectory of a new one, where there is none beside this in the process.
    """
    u = _inputs(component, h)
    wanted = once(component, h) if wanted is None else wanted
    values = {**component.start_values, **component.parameter_values()}
    changed = component.with_parameters({name: _other(value) for name, value in values.items()})
    for before in (changed, component):
        with closing(before.instantiate_here(keep_new_state=strategy == STATE)) as instance:
            try:
                _begin(instance, before)
                _advance(instance, u, h)
            except FmuDidimError:
                if before is component:
                    raise
                continue  # it fails with these values; so with its own ones
            instance.restart_by(strategy, component)
            _begin(instance, component)
            return RESTORES if same(wanted, _advance(instance, u, h)) else DIFFERS
    return DIFFERS


def half_step(component: FmuSettings, h: float) -> tuple[str, float]:
    """The output that half the step changes most, with the same held inputs, and by which fraction of its largest
    value; an empty name where there are no outputs."""
    u = _inputs(component, h)
    return _most_changed(component, _run(component, u, h), _run(component, np.repeat(u, 2, axis=0), h / 2)[1::2])


def reading(component: FmuSettings, h: float) -> tuple[str, float]:
    """The output that changes most after steps where all were read between inputs and step, too, and by which fraction
    of its largest value; an empty name where there are no outputs."""
    u = _inputs(component, h)
    with _begun(component) as instance:
        asked = _advance(instance, u, h, read_between=True)
    return _most_changed(component, _run(component, u, h), asked)


def _most_changed(component: FmuSettings, first: Array, second: Array) -> tuple[str, float]:
    """The output that differs most between two trajectories, and by which fraction of its largest value."""
    if not first.size:
        return "", 0.0
    apart = np.nan_to_num(np.abs(first - second)).max(axis=0)
    size = np.nan_to_num(np.maximum(np.abs(first), np.abs(second))).max(axis=0)
    change = apart / np.where(size > 0, size, 1.0)
    worst = int(np.argmax(change))
    return component.outputs[worst].name, float(change[worst])


def _other(value: float) -> float:
    return value * 1.01 if value else 1e-3


def state(component: FmuSettings, h: float) -> str:
    """Whether a restored state goes on as after it was saved."""
    u, half = _inputs(component, h), step_count(component, h) // 2
    with _begun(component) as instance:
        _advance(instance, u[:half], h)
        saved = instance.save_state()
        first = _advance(instance, u[half:], h, half)
        instance.restore_state(saved)
        return RESTORES if same(first, _advance(instance, u[half:], h, half)) else DIFFERS


def response(component: FmuSettings, h: float) -> tuple[tuple[str, str], ...]:
    """When each output first follows a change of all inputs after three steps."""
    u, lead = _inputs(component, h), 3
    other = u.copy()
    factors = np.linspace(1.3, 1.9, u.shape[1])  # not by the same amount: a controller may see a difference
    for i, kind in enumerate(component.input_types):
        if kind == "Boolean":
            other[lead:, i] = 1 - other[lead:, i]
        elif kind in FLOAT_TYPES:
            other[lead:, i] *= factors[i]
    at_once, trajectories = [], []
    for rows in (u, other):
        with _begun(component) as instance:
            _advance(instance, rows[:lead], h)
            instance.inputs[:] = rows[lead]
            instance.set()
            instance.get()
            at_once.append(instance.outputs.copy())
            trajectories.append(_advance(instance, rows[lead:], h, lead))
    now = at_once[0] != at_once[1]
    changed = trajectories[0] != trajectories[1]

    def answer(i: int) -> str:
        if now[i]:
            return AT_ONCE
        return AFTER_A_STEP if changed[0, i] else LATER if changed[:, i].any() else NEVER

    return tuple((v.name, answer(i)) for i, v in enumerate(component.outputs))


def parameters(component: FmuSettings, h: float, seconds: float = math.inf) -> tuple[tuple[str, ...], ...]:
    """Parameters that act, that do not, that refuse another value, and those not tried when this time was up."""
    begin, base = clock.monotonic(), once(component, h)
    groups: dict[str, list[str]] = {"acting": [], "idle": [], "refused": [], "left": []}
    for name, value in component.parameter_values().items():
        if clock.monotonic() - begin > seconds:
            groups["left"].append(name)
            continue
        changed = component.with_parameters({name: _other(value)})
        try:
            equal = np.array_equal(base, once(changed, h), equal_nan=True)
            groups["idle" if equal else "acting"].append(name)
        except FmuDidimError:
            groups["refused"].append(name)
    return tuple(tuple(names) for names in groups.values())


def tunable(component: FmuSettings, h: float, seconds: float = math.inf) -> tuple[tuple[str, ...], ...]:
    """Tunable parameters that act when they are changed in a run, that do not, whose change is refused then, and those
    not tried when this time was up."""
    begin, u, half = clock.monotonic(), _inputs(component, h), step_count(component, h) // 2
    base = once(component, h)[half:]
    groups: dict[str, list[str]] = {"acting": [], "idle": [], "refused": [], "left": []}
    for name, value in component.parameter_values().items():
        if name in component.fixed:
            continue
        if clock.monotonic() - begin > seconds:
            groups["left"].append(name)
            continue
        try:
            with _begun(component) as instance:
                _advance(instance, u[:half], h)
                instance.set_parameters({name: _other(value)})
                equal = np.array_equal(base, _advance(instance, u[half:], h, half), equal_nan=True)
            groups["idle" if equal else "acting"].append(name)
        except FmuDidimError:
            groups["refused"].append(name)
    return tuple(tuple(names) for names in groups.values())
