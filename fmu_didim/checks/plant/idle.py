"""Parameters of a model that change nothing that was measured, and what would wake them."""

from __future__ import annotations

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.components import FmuComponent
from fmu_didim.components.fmu.chosen import visible, with_outputs_too
from fmu_didim.components.fmu.description import REAL_TYPES
from fmu_didim.components.variable_names import START
from fmu_didim.cosim import Recording, measured_output
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import LoopModel

CHANGE = 1e-2
"""[1] Relative change of a parameter by which its influence is measured: large against the jitter of integrators."""
SEEN_AT = 200
"""[ticks] At which the signals of an experiment are compared, spread over all of it."""
ASKED = 300
"""[variables] Of an FMU that are looked at beside what was measured: each costs a read at every tick."""
NAMED = 4
"""[names] That a message lists."""


def idle_parameters(model: LoopModel, values: Array, asked: list[int]) -> list[int]:
    """Those of these parameters that change nothing that was measured, in any experiment that is fitted.

    Raises:
        SimulationError: the values cannot be simulated.
    """
    before = {label: _recorded(model, values, label) for label in model.estimation_labels}
    return [i for i in asked if not any(_changed(model, values, i, label, run) for label, run in before.items())]


def awakening(model: LoopModel, values: Array, i: int) -> str:
    """What would wake a parameter that changes nothing that was measured, in words."""
    name = model.names[i]
    if others := _others_changed(model, values, i):
        shown = ", ".join(others[:NAMED])
        return f"it changes {shown}, which {'were' if len(others) > 1 else 'was'} not measured: measure {others[0]}"
    if starts := [own for own in model.names if own.endswith(START) and own != name]:
        return f"if it sets where a state starts, {', '.join(starts)} replaces it: identify one of both"
    if resting := _resting_inputs(model):
        return f"if it acts on an input, that has to move: {', '.join(resting)} never does"
    if not values[i]:
        return "it was tried near 0: if it acts by its size alone, give another start:"
    return "no equation of what was measured seems to use it, or the FMU reads it before it can be set"


def _recorded(model: LoopModel, values: Array, label: str) -> Recording:
    count = model.experiments[label].reference.time.size
    ticks = np.unique(np.linspace(0, count - 1, SEEN_AT).astype(np.int64))
    return model.simulation(values, label).record(ticks=ticks)


def with_change(values: Array, i: int, relative: float) -> Array:
    """Values (p,) with one of them changed by a part of itself, or by so much where it is zero."""
    other = values.copy()
    other[i] += relative * (abs(values[i]) or 1.0)
    return other


def _changed(model: LoopModel, values: Array, i: int, label: str, before: Recording) -> bool:
    if not model.free_parameters.acts(i, label):
        return False
    try:
        after = _recorded(model, with_change(values, i, CHANGE), label)
    except SimulationError:
        return True  # it acts, if only to the worse
    channels = [measured_output(model.loop.systems[label], c.signal) for c in model.experiments[label].channels]
    names = [*model.loop.logged, *channels]
    return not np.array_equal(before.table(names, sampled=True), after.table(names, sampled=True))


def _others_changed(model: LoopModel, values: Array, i: int) -> list[str]:
    """Variables of the model beside what was measured that a parameter changes."""
    plant = model.loop.plant
    if not isinstance(plant, FmuComponent):
        return []
    numbers = [name for name, v in visible(plant).items() if v.type in REAL_TYPES][:ASKED]
    seen = with_outputs_too(plant, numbers, si_units=False)
    whole = model.with_loop(plant=seen)
    label = next(label for label in model.estimation_labels if model.free_parameters.acts(i, label))
    try:
        before, after = (_recorded(whole, at, label) for at in (values, with_change(values, i, CHANGE)))
    except SimulationError:
        return []
    prefix, measured = f"{model.loop.plant_name}.", {*model.loop.logged, *_channels(model, label)}
    names = [f"{prefix}{v.name}" for v in seen.outputs if f"{prefix}{v.name}" not in measured]
    return [
        name.removeprefix(prefix) for name in names if not np.array_equal(before.sampled[name], after.sampled[name])
    ]


def _channels(model: LoopModel, label: str) -> list[str]:
    return [channel.signal for channel in model.experiments[label].channels]


def _resting_inputs(model: LoopModel) -> list[str]:
    """Inputs that are constant in all experiments, and those that nothing drives."""
    references = [model.experiments[label].reference for label in model.estimation_labels]
    return [
        v.name for v in model.loop.plant.inputs
        if not any(v.name in r.names and np.ptp(r.column(v.name)) > 0 for r in references)
    ]  # fmt: skip
