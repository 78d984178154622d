"""What FMPy simulates, and what scipy's least squares with steps tuned by hand finds with it."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Model
from fmpy.model_description import ModelDescription
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from fmu_didim.data.signals import Array
from tests.tools.calibrated.trials import Trial, Values

TOLERANCE = 1e-10
"""[1] Relative, of CVode and DOP853: simulations then differ by far less than any noise."""
STEP = 1e-4
"""[1] Relative step of central differences: their error is its square, 1e-8 of a derivative."""
ROUNDS = 6
"""[rounds] Of Gauss-Newton steps with those differences from scipy's answer: the last moves nothing by 1e-6 sigma."""


@dataclass(frozen=True)
class Reference:
    """The optimum of the weighted squares.

    Attributes:
        values, deviations: name -> value and standard deviation, by the noise as it is stated.
    """

    values: Values
    deviations: Values


def simulated(path: Path, trial: Trial, values: Values) -> dict[str, Array]:
    """(N,) values of each output at the instants."""
    driven = trial.driven()
    start = {**trial.known, **values}
    if driven and trial.interface == "ModelExchange":
        return _integrated(path, trial, start)
    inputs = None
    if driven:
        inputs = np.zeros(trial.instants.size, dtype=[("time", float), *((name, float) for name in driven)])
        inputs["time"] = trial.instants
        for name, column in driven.items():
            inputs[name] = column
    own = {"step_size": trial.step_s} if trial.step_s is not None else {}
    result = fmpy.simulate_fmu(
        str(path), start_time=0.0, stop_time=float(trial.instants[-1]), fmi_type=trial.interface, solver="CVode",
        relative_tolerance=TOLERANCE, output_interval=trial.step_s or float(trial.instants[1] - trial.instants[0]),
        output=list(trial.outputs), input=inputs, start_values=start, **own,
    )  # fmt: skip
    return {name: np.interp(trial.instants, result["time"], result[name]) for name in trial.outputs}


def _integrated(path: Path, trial: Trial, start: Values) -> dict[str, Array]:
    """An FMU of FMI 2.0 without events, by scipy's DOP853 from row to row of its inputs.

    ``simulate_fmu`` sets inputs at its communication points alone; between them, here a line is followed.
    """
    description, folder = _unpacked(path)
    reference = {v.name: v.valueReference for v in description.modelVariables}
    driven, instants = trial.driven(), trial.instants
    rows, given = np.column_stack(list(driven.values())), [reference[name] for name in driven]
    asked = [reference[name] for name in trial.outputs]
    model = FMU2Model(
        guid=description.guid, unzipDirectory=folder, instanceName="reference",
        modelIdentifier=description.modelExchange.modelIdentifier,
    )  # fmt: skip
    model.instantiate()
    model.setupExperiment(startTime=0.0)
    model.setReal([reference[name] for name in start], list(start.values()))
    model.enterInitializationMode()
    model.setReal(given, list(rows[0]))
    model.exitInitializationMode()
    model.newDiscreteStates()
    model.enterContinuousTimeMode()
    size = description.numberOfContinuousStates
    pointer, found = ctypes.POINTER(ctypes.c_double), []
    state, slope = np.empty(size), np.empty(size)
    model.getContinuousStates(state.ctypes.data_as(pointer), size)

    def at(time: float, x: Array, row: Array) -> None:
        model.setTime(time)
        x = np.ascontiguousarray(x)
        model.setContinuousStates(x.ctypes.data_as(pointer), size)
        model.setReal(given, list(row))

    def derivative(time: float, x: Array, begin: int) -> Array:
        part = (time - instants[begin]) / (instants[begin + 1] - instants[begin])
        at(time, x, rows[begin] + part * (rows[begin + 1] - rows[begin]))
        model.getDerivatives(slope.ctypes.data_as(pointer), size)
        return slope.copy()

    for index, time in enumerate(instants):
        if index:
            state = solve_ivp(
                derivative, (instants[index - 1], time), state, method="DOP853", args=(index - 1,),
                rtol=TOLERANCE, atol=TOLERANCE,
            ).y[:, -1]  # fmt: skip
        at(float(time), state, rows[index])
        found.append(model.getReal(asked))
    model.terminate()
    model.freeInstance()
    return dict(zip(trial.outputs, np.array(found).T, strict=True))


@functools.cache
def _unpacked(path: Path) -> tuple[ModelDescription, str]:
    return fmpy.read_model_description(str(path)), fmpy.extract(str(path))


def data(path: Path, trial: Trial, seed: int) -> dict[str, Array]:
    """What FMPy simulates with the truth, and white noise, of its own for each trial."""
    rng = np.random.default_rng([seed, *trial.name.encode()])
    true = simulated(path, trial, trial.truth)
    return {name: true[name] + std * rng.normal(size=trial.instants.size) for name, std in trial.outputs.items()}


def reference(path: Path, trial: Trial, measured: Mapping[str, Array], start: Values) -> Reference:
    """The optimum by scipy from ``start``, ended by Gauss-Newton steps with central differences."""
    names, scale = list(trial.truth), np.array([abs(value) or 1.0 for value in trial.truth.values()])

    def residual(values: Array) -> Array:
        found = simulated(path, trial, dict(zip(names, values, strict=True)))
        return np.concatenate([(found[name] - measured[name]) / std for name, std in trial.outputs.items()])

    def jacobian(values: Array) -> Array:
        steps = np.diag(STEP * scale)
        return np.column_stack([(residual(values + d) - residual(values - d)) / (2 * d.sum()) for d in steps])

    begin = np.array([start[name] for name in names])
    values = least_squares(residual, begin, jac=jacobian, x_scale=scale).x
    for _ in range(ROUNDS):
        values = values - np.linalg.lstsq(jacobian(values), residual(values), rcond=None)[0]
    slopes = jacobian(values)
    deviations = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    return Reference(
        dict(zip(names, map(float, values), strict=True)), dict(zip(names, map(float, deviations), strict=True))
    )
