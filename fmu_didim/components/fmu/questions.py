"""The questions that a probe puts to an FMU; each runs in a new process, see ``probe``.

A question is a function (component, step size in s) -> answer; it raises what the FMU does wrong.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fmu_didim.components.fmu.component import FmuComponent
from fmu_didim.errors import FmuDidimError
from fmu_didim.signals import Array

STEPS = 50
SEED = 20240131
SAME = 1e-9
"""Trajectories that differ by less than this part of their largest value are the same."""
RESTORES, DIFFERS = "restores", "does not restore"
AT_ONCE, AFTER_A_STEP, LATER, NEVER = "at once", "after a step", "later", "never"


def same(a: Array, b: Array) -> bool:
    """Whether two trajectories are the same to rounding, NaN and infinity at the same places."""
    if a.shape != b.shape or (np.isfinite(a) != np.isfinite(b)).any():
        return False
    largest = np.abs(a[np.isfinite(a)]).max(initial=0.0)
    return bool((np.abs(np.nan_to_num(a - b, posinf=0.0, neginf=0.0)) <= SAME * largest).all())


def _inputs(component: FmuComponent) -> Array:
    """Held inputs (STEPS, nu), pseudo-random, growing from 1 % to all of their usual size: limits come late."""
    scale = np.array([max(abs(v.start), 1.0) for v in component.inputs])
    rows: Array = np.random.default_rng(SEED).uniform(-1, 1, (STEPS, scale.size)) * scale
    return rows * np.geomspace(0.01, 1.0, STEPS)[:, None]


def _begin(instance: Any, component: FmuComponent) -> None:
    """Initialise with the inputs' start values: others may lead an initial state that the FMU cannot solve for."""
    instance.begin_initialisation(0.0)
    instance.inputs[:] = [v.start for v in component.inputs]
    instance.set()
    instance.get()
    instance.end_initialisation()


def _advance(instance: Any, rows: Array, h: float, start: int = 0) -> Array:
    found = np.zeros((len(rows), instance.outputs.size))
    for k, row in enumerate(rows):
        instance.inputs[:] = row
        instance.set()
        instance.step((start + k) * h, h)
        instance.get()
        found[k] = instance.outputs
    return found


def _run(component: FmuComponent, u: Array, h: float) -> Array:
    instance = component.instantiate()
    try:
        _begin(instance, component)
        return _advance(instance, u, h)
    finally:
        instance.close()


def once(component: FmuComponent, h: float) -> Array:
    """One trajectory."""
    return _run(component, _inputs(component), h)


def two_in_turn(component: FmuComponent, h: float) -> tuple[Array, Array]:
    """Two new instances, one after the other."""
    return once(component, h), once(component, h)


def side_by_side(component: FmuComponent, h: float) -> bool:
    """Whether two instances at the same time, with opposite inputs, run as each alone."""
    u = _inputs(component)
    alone = [_run(component, row, h) for row in (u, -u)]
    pair = [component.instantiate() for _ in alone]
    found: list[list[Array]] = [[], []]
    try:
        for instance in pair:
            _begin(instance, component)
        for k in range(STEPS):
            for instance, rows, kept in zip(pair, (u, -u), found, strict=True):
                kept.append(_advance(instance, rows[k : k + 1], h, k)[0])
    finally:
        for instance in pair:
            instance.close()
    return all(same(np.array(a), b) for a, b in zip(found, alone, strict=True))


def reset(component: FmuComponent, h: float) -> str:
    """Whether a reset instance runs as before."""
    u, instance = _inputs(component), component.instantiate()
    try:
        _begin(instance, component)
        first = _advance(instance, u, h)
        instance.reset()  # type: ignore[attr-defined]
        _begin(instance, component)
        return RESTORES if same(first, _advance(instance, u, h)) else DIFFERS
    finally:
        instance.close()


def state(component: FmuComponent, h: float) -> str:
    """Whether a restored state goes on as after it was saved."""
    u, instance, half = _inputs(component), component.instantiate(), STEPS // 2
    try:
        _begin(instance, component)
        _advance(instance, u[:half], h)
        saved = instance.save_state()
        first = _advance(instance, u[half:], h, half)
        instance.restore_state(saved)
        return RESTORES if same(first, _advance(instance, u[half:], h, half)) else DIFFERS
    finally:
        instance.close()


def response(component: FmuComponent, h: float) -> tuple[tuple[str, str], ...]:
    """When each output first follows a change of all inputs after three steps."""
    u, lead = _inputs(component), 3
    other = u.copy()
    other[lead:] *= np.linspace(1.3, 1.9, u.shape[1])  # not by the same amount: a controller may see a difference
    at_once, trajectories = [], []
    for rows in (u, other):
        instance = component.instantiate()
        try:
            _begin(instance, component)
            _advance(instance, rows[:lead], h)
            instance.inputs[:] = rows[lead]
            instance.set()
            instance.get()
            at_once.append(instance.outputs.copy())
            trajectories.append(_advance(instance, rows[lead:], h, lead))
        finally:
            instance.close()
    now = at_once[0] != at_once[1]
    changed = trajectories[0] != trajectories[1]

    def answer(i: int) -> str:
        if now[i]:
            return AT_ONCE
        return AFTER_A_STEP if changed[0, i] else LATER if changed[:, i].any() else NEVER

    return tuple((v.name, answer(i)) for i, v in enumerate(component.outputs))


def parameters(component: FmuComponent, h: float) -> tuple[tuple[str, ...], ...]:
    """Parameters that act, that do not, and that refuse another value."""
    base = once(component, h)
    acting: list[str] = []
    idle: list[str] = []
    refused: list[str] = []
    for name, value in component.parameter_values().items():
        changed = component.with_parameters({name: value * 1.01 if value else 1e-3})
        try:
            equal = np.array_equal(base, once(changed, h), equal_nan=True)
        except FmuDidimError:
            refused.append(name)
        else:
            (idle if equal else acting).append(name)
    return tuple(acting), tuple(idle), tuple(refused)
