"""Public FMUs of FMI 3.0, the Reference FMUs and those of tools, in the loop and in FMPy by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Slave

from fmu_didim.components import load_fmu
from fmu_didim.components.fmu import probe_fmu
from fmu_didim.cosim import Connection, System, simulate
from fmu_didim.data.signals import trajectory
from tests.foreign import external_fmu

TICKS = 40
STEPS = {
    "BouncingBall": 0.01, "Dahlquist": 0.1, "Feedthrough": 0.1, "Resource": 1.0, "Roberts": 0.01, "Stair": 0.2,
    "StateSpace": 1.0, "VanDerPol": 0.01, "sinewave_array": 0.01, "IO": 0.1, "SpringPendulumExtForce1D": 0.01,
    "SpringFrictionPendulumExtForce1D": 0.01,
}  # fmt: skip
"""[s] Communication step of each: a multiple of its own."""
PLACES = {
    "sinewave_array": "github.com/INTO-CPS-Association/maestro (Altair Activate)",
    **dict.fromkeys(
        ("IO", "SpringPendulumExtForce1D", "SpringFrictionPendulumExtForce1D"),
        "github.com/ThummeTo/FMIZoo.jl (models/bin/Dymola/2023x/3.0)",
    ),
}
"""Where those are that are not in a release of github.com/modelica/Reference-FMUs."""
VALUES: Mapping[str, Mapping[str, float]] = {
    "BouncingBall": {"e": 0.6}, "Dahlquist": {"k": 1.5}, "VanDerPol": {"mu": 1.3},
    "StateSpace": {"A[1,2]": 0.25, "A[1,1]": -0.5, "A[3,1]": 0.125, "B[2,3]": 0.5, "C[2,1]": -1.0, "D[1,3]": 2.0,
                   "x0[2]": 0.3, "A[2,2]": -0.75, "A[3,3]": -0.25},
}  # fmt: skip
"""Parameters by element that differ from their start values."""


def needs(name: str) -> Path:
    return external_fmu(name, PLACES.get(name, "a release of github.com/modelica/Reference-FMUs (FMI 3.0)"))


def given(path: Path, inputs: list[str]) -> np.ndarray:
    """(TICKS, inputs) numbers that each type holds: any of Float64, else 0 and 1, and 1 and 2 of an enumeration."""
    kinds = {v.name: v.type for v in fmpy.read_model_description(str(path), validate=False).modelVariables}
    rng = np.random.default_rng(len(path.stem))
    columns = [np.empty((TICKS, 0))]
    for name in inputs:
        kind = kinds[name.partition("[")[0]]
        real, whole = rng.normal(size=(TICKS, 1)), rng.integers(0, 2, (TICKS, 1)) + (kind == "Enumeration")
        columns.append(real if kind == "Float64" else whole.astype(float))
    return np.hstack(columns)


class ByHand:
    """FMPy's instance, of which elements of arrays are set and read by their names."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.described = fmpy.read_model_description(str(path), validate=False)
        fmpy.extract(str(path), unzipdir=str(folder))
        own = self.described.coSimulation.modelIdentifier
        self.fmu = FMU3Slave(
            guid=self.described.guid, unzipDirectory=str(folder), modelIdentifier=own, instanceName=own
        )
        self.by_name = {v.name: v for v in self.described.modelVariables}

    def _kind(self, name: str) -> tuple[Any, str, int]:
        variable = self.by_name[name]
        size = math.prod(int(d.start or d.variable.start) for d in variable.dimensions)
        kind = "Int64" if variable.type == "Enumeration" else variable.type
        return variable, kind, size

    def get(self, name: str) -> list[float]:
        variable, kind, size = self._kind(name)
        return [float(v) for v in getattr(self.fmu, f"get{kind}")([variable.valueReference], nValues=size)]

    def set(self, name: str, values: list[float]) -> None:
        variable, kind, _ = self._kind(name)
        own = values if kind.startswith("Float") else [int(v) for v in values]
        getattr(self.fmu, f"set{kind}")([variable.valueReference], own)

    def change(self, values: Mapping[str, float]) -> None:
        """Set elements: ``A[1,2]`` is that of row 1 and column 2."""
        for name, value in values.items():
            array, _, index = name.partition("[")
            whole = self.get(array)
            at = 0
            if index:
                shape = [int(d.start or d.variable.start) for d in self.by_name[array].dimensions]
                at = int(np.ravel_multi_index([int(i) - 1 for i in index.rstrip("]").split(",")], shape))
            whole[at] = value
            self.set(array, whole)

    def feed(self, names: list[str], row: np.ndarray) -> None:
        """Elements of an array follow one another."""
        whole: dict[str, list[float]] = {}
        for name, value in zip(names, row, strict=True):
            whole.setdefault(name.partition("[")[0], []).append(float(value))
        for name, values in whole.items():
            self.set(name, values)


def by_fmpy(name: str, folder: Path, inputs: list[str], outputs: list[str], rows: np.ndarray) -> np.ndarray:
    """(TICKS, outputs): inputs, then outputs, then a step."""
    one, arrays = ByHand(needs(name), folder), list(dict.fromkeys(o.partition("[")[0] for o in outputs))
    one.fmu.instantiate()
    one.fmu.enterInitializationMode()
    one.change(VALUES.get(name, {}))
    one.feed(inputs, rows[0])
    one.fmu.exitInitializationMode()
    found = []
    for k, row in enumerate(rows):
        one.feed(inputs, row)
        found.append([value for array in arrays for value in one.get(array)])
        one.fmu.doStep(k * STEPS[name], STEPS[name])
    one.fmu.terminate()
    one.fmu.freeInstance()
    return np.array(found)


@pytest.mark.gate
@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("name", STEPS)
def test_the_loop_is_that_of_fmpy(name: str, isolated: bool, tmp_path: Path) -> None:
    one = load_fmu(needs(name), isolated=isolated, si_units=False).with_parameters(VALUES.get(name, {}))
    inputs, outputs = [v.name for v in one.inputs], [v.name for v in one.outputs]
    rows = given(needs(name), inputs)
    wanted = by_fmpy(name, tmp_path, inputs, outputs, rows)
    time = STEPS[name] * np.arange(TICKS)
    motion = trajectory(time, {f"r{k}": column for k, column in enumerate(rows.T)} or {"r0": time})
    wires = tuple(Connection(f"reference.r{k}", f"it.{entry}") for k, entry in enumerate(inputs))
    system = System({"it": one}, wires, ("it",), STEPS[name])
    assert np.ptp(wanted, axis=0).max() > 0 or name == "Resource"
    for compiled in (None, False):
        found = simulate(system, motion, compiled=compiled).applied
        mine = np.column_stack([found[f"it.{output}"] for output in outputs])
        np.testing.assert_allclose(mine, wanted, rtol=1e-12, atol=1e-13)


@pytest.mark.gate
@pytest.mark.parametrize("name", STEPS)
def test_fmu_check_runs_it(name: str) -> None:
    found = probe_fmu(load_fmu(needs(name)), step_size=STEPS[name])
    assert not found.facts.failure
