"""What happens to a signal on its way into a model, or from there to its sensor.

The inputs u of a model alone are recorded, and nothing is fed back to them: they are changed before a simulation, and
its outputs y after it. Free parameters of the owners ``INPUT`` and ``OUTPUT`` say by how much, by the keys
``signal:parameter``. In this order, s being the signal and t_0 where the simulation starts,

    delay         s(t - delay)
    lag           lag s' + s_new = s,  s_new(t_0) = s(t_0)
    scale         scale s
    offset        s + offset
    drift         s + drift (t - t_0)
    transient     s + transient exp(-(t - t_0)/fades)
    upper, lower  no more than upper, no less than lower

Before t_0 a signal keeps its first value. After the end an input keeps its last one, and an output goes on straight, so
that one that comes early does not look like one that has come to a limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fmu_didim.cosim import Columns, Recording
from fmu_didim.data.signals import Array, Trajectory

INPUT, OUTPUT = "input signal", "output signal"
"""Owners of free parameters of signals; see :class:`~fmu_didim.model.free_parameter.FreeParameter`."""
DELAY, LAG, SCALE, OFFSET, DRIFT = "delay", "lag", "scale", "offset", "drift"
TRANSIENT, FADES, UPPER, LOWER = "transient", "fades", "upper limit", "lower limit"
"""Parameters of a signal."""
STRAIGHT = frozenset({SCALE, OFFSET, DRIFT})
"""Those after which a signal that goes straight from tick to tick still does."""


def signal_key(signal: str, parameter: str) -> str:
    """The key of a parameter of a signal."""
    return f"{signal}:{parameter}"


def by_signal(values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Signal -> parameter -> value, of the values by their keys."""
    found = dict[str, dict[str, float]]()
    for key, value in values.items():
        signal, _, parameter = key.rpartition(":")
        found.setdefault(signal, {})[parameter] = value
    return found


def changed_inputs(reference: Trajectory, ramps: Set[str], values: Mapping[str, float]) -> Trajectory:
    """Inputs as they act.

    Args:
        reference: inputs at the ticks, (T, m); ramps: names of those that go straight, the others are held.
        values: of the parameters by their keys.
    """
    table = reference.values.copy()
    for name, own in by_signal(values).items():
        place = reference.names.index(name)
        table[:, place] = changed(reference.time, table[:, place], own, is_held=name not in ramps)
    return replace(reference, values=table)


def changed_outputs(
    recording: Recording, ticks: NDArray[np.int64], values: Mapping[str, float], component: str
) -> Recording:
    """Some ticks of an experiment, from the recording of all of them, with the outputs of a component as their sensors
    show them."""
    found = recording.at(recording.ticks[ticks])
    shown = [Columns(columns.places, columns.table.copy()) for columns in (found.applied, found.sampled)]
    for name, own in by_signal(values).items():
        signal = f"{component}.{name}"
        for columns, whole in zip(shown, (recording.applied, recording.sampled), strict=True):
            if signal in whole:
                columns[signal][:] = changed(recording.time, whole[signal], own, goes_on=True)[ticks]
    return replace(found, applied=shown[0], sampled=shown[1])


def changed(
    time: Array, signal: Array, values: Mapping[str, float], *, is_held: bool = False, goes_on: bool = False
) -> Array:
    """(T,) a signal after what the values of its parameters do to it.

    Args:
        time, signal: (T,) at the ticks; is_held: whether it keeps its value from tick to tick; else it goes straight.
            What is held and comes late then has its mean over each step.
        goes_on: whether it goes on straight after the end, where it comes early.
    """
    found = signal
    if delay := values.get(DELAY, 0.0):
        found = _held_late(time, found, delay) if is_held else _late(time, found, delay, goes_on=goes_on)
    if (lag := values.get(LAG, 0.0)) > 0:
        found = _lagging(time, found, lag, is_held=is_held)
    since = time - time[0]
    found = values.get(SCALE, 1.0) * found + values.get(OFFSET, 0.0) + values.get(DRIFT, 0.0) * since
    if (size := values.get(TRANSIENT, 0.0)) and (constant := values.get(FADES, 0.0)) > 0:
        found = found + size * np.exp(-since / constant)
    return np.asarray(np.clip(found, values.get(LOWER, -np.inf), values.get(UPPER, np.inf)))


def _late(time: Array, signal: Array, delay: float, *, goes_on: bool) -> Array:
    """A signal that goes straight from tick to tick and comes late; what the model computes, on a cubic instead, so
    that it changes smoothly with the delay where that passes a tick."""
    if not goes_on:
        return np.asarray(np.interp(time - delay, time, signal))
    asked = np.maximum(time - delay, time[0])
    slopes, step = np.gradient(signal, time), np.diff(time)
    row = np.clip(np.searchsorted(time, asked, side="right") - 1, 0, step.size - 1)
    h = step[row]
    x = np.clip((asked - time[row]) / h, 0.0, 1.0)
    cubic = (
        (1 - x) ** 2 * ((1 + 2 * x) * signal[row] + x * h * slopes[row])
        + x**2 * ((3 - 2 * x) * signal[row + 1] - (1 - x) * h * slopes[row + 1])
    )  # fmt: skip
    return np.asarray(cubic + slopes[-1] * np.maximum(asked - time[-1], 0.0))


def _held_late(time: Array, signal: Array, delay: float) -> Array:
    """The mean over each step of a signal that is held and comes late, so that it changes smoothly with the delay."""
    room = abs(delay) + float(np.ptp(time)) + 1.0
    places = np.concatenate([[time[0] - room], time, [time[-1] + room]])
    steps = np.concatenate([[signal[0]], signal]) * np.diff(places)
    total = np.concatenate([[0.0], np.cumsum(steps)])
    ends = np.append(time, 2 * time[-1] - time[-2]) - delay
    return np.asarray(np.diff(np.interp(ends, places, total)) / np.diff(ends))


def _lagging(time: Array, signal: Array, lag: float, *, is_held: bool) -> Array:
    """A signal after a lag of first order, exactly at the ticks; of one that is held the mean over each step."""
    steps = np.diff(time)
    decay = np.exp(-steps / lag)
    # Where the signal goes straight, so does what the state comes to, as far behind as the slope times the lag.
    behind = np.zeros(steps.size) if is_held else np.diff(signal) / steps * lag
    first = signal[:-1] - behind
    last = first if is_held else signal[1:] - behind
    state = float(signal[0])
    found = [state]
    for begin, end, factor in zip(first.tolist(), last.tolist(), decay.tolist(), strict=True):
        state = end + (state - begin) * factor
        found.append(state)
    if not is_held:
        return np.array(found)
    part = (1 - decay) * lag / steps
    return np.asarray(signal + (np.array(found) - signal) * np.append(part, part[-1]))
