"""Two FMUs that compute next to nothing, in a loop: what remains is the master."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import casadi as ca
import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

from fmu_didim.components import load_fmu
from fmu_didim.cosim import Connection, System
from fmu_didim.data.signals import Trajectory, Variable, trajectory
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu
from tests.tools.benchmarks.c_program import build, doubles

STEP_S = 0.001
GAINS = (0.9, -0.5, 1.1)
"""a.u = 0.9 reference, a.v = -0.5 b.y, b.u = 1.1 a.y."""


def _block(name: str, inputs: Sequence[str], output: ca.SX, following: ca.SX, symbols: tuple[ca.SX, ca.SX]) -> Block:
    x, u = symbols
    p = ca.SX.sym("p", 0)
    return Block(
        name=name,
        inputs=tuple(Variable(v, "", "input") for v in inputs),
        outputs=(Variable("y", "", "output"),),
        states=tuple(Variable(f"x{i}", "", "local") for i in range(x.numel())),
        parameters=(),
        update=ca.Function("update", [x, u, p], [ca.densify(following)]),
        output=ca.Function("output", [x, u, p], [ca.densify(output)]),
        start=ca.Function("start", [u, p], [ca.SX.zeros(x.numel())]),
        sample_time=STEP_S,
    )


@cache
def files() -> tuple[Path, Path]:
    """FMU a: y = u + x, x[k+1] = v. FMU b: y = u. So the loop has no algebraic part."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 2)
    none, w = ca.SX.sym("x", 0), ca.SX.sym("u")
    first = _block("cheap_a", ("u", "v"), u[0] + x, u[1], (x, u))
    second = _block("cheap_b", ("u",), w, none, (none, w))
    return build_fmu(first), build_fmu(second)


def system() -> System:
    """The loop, a before b."""
    a, b = (load_fmu(path) for path in files())
    wires = (("reference.r", "a.u"), ("b.y", "a.v"), ("a.y", "b.u"))
    connections = tuple(Connection(s, t, g) for (s, t), g in zip(wires, GAINS, strict=True))
    return System({"a": a, "b": b}, connections, ("a", "b"), STEP_S)


def reference(count: int) -> Trajectory:
    """A reference of so many ticks."""
    time = STEP_S * np.arange(count)
    return trajectory(time, {"r": np.sin(3.0 * time)})


class _Slave(ctypes.Structure):
    _fields_ = tuple((n, ctypes.c_void_p) for n in ("component", "set", "get", "step", "inputs", "outputs"))


class Slaves:
    """Both FMUs as FMPy loads them, initialised as the loop would: for FMPy's own loop and for that in C."""

    def __init__(self, count: int) -> None:
        self.table = np.ascontiguousarray(reference(count).values[:, 0])
        self.record = np.zeros((count, 6))
        self._loop = build("fmi_loop.c", {}).run
        self._gains = np.array(GAINS)
        self.slaves: list[FMU2Slave] = []
        for path in files():
            description = fmpy.read_model_description(str(path))
            identifier = description.coSimulation.modelIdentifier
            folder = fmpy.extract(str(path))
            slave = FMU2Slave(
                guid=description.guid, unzipDirectory=str(folder), modelIdentifier=identifier, instanceName=identifier
            )
            slave.instantiate()
            self.slaves.append(slave)
            names = {v.name: v.valueReference for v in description.modelVariables}
            inputs = [v.valueReference for v in description.modelVariables if v.causality == "input"]
            slave.input_references, slave.output_references = inputs, [names["y"]]
        self.start()

    def start(self) -> None:
        """Back to the beginning, both initialised with the first inputs."""
        a, b = self.slaves
        first = GAINS[0] * self.table[0]
        for slave in self.slaves:
            slave.reset()
            slave.setupExperiment(startTime=0.0)
            slave.enterInitializationMode()
        a.setReal(a.input_references, [first, 0.0])
        b.setReal(b.input_references, [GAINS[2] * first])
        a.setReal(a.input_references, [first, GAINS[1] * GAINS[2] * first])
        for slave in self.slaves:
            slave.exitInitializationMode()

    def by_c(self) -> np.ndarray:
        """The loop in C; (count, 6): reference, a.y, b.y, a.u, a.v, b.u."""
        self.start()
        built = []
        for slave in self.slaves:
            functions = [slave.dll.fmi2SetReal, slave.dll.fmi2GetReal, slave.dll.fmi2DoStep]
            addresses = [ctypes.cast(f, ctypes.c_void_p).value for f in functions]
            lists = [np.array(r, dtype=np.uint32) for r in (slave.input_references, slave.output_references)]
            built.append((_Slave(slave.component, *addresses, *(x.ctypes.data for x in lists)), lists))
        (a, _), (b, _) = built
        status = self._loop(
            ctypes.byref(a), ctypes.byref(b), ctypes.c_longlong(self.table.size), ctypes.c_double(0.0),
            ctypes.c_double(STEP_S), doubles(self.table), doubles(self._gains), doubles(self.record),
        )  # fmt: skip
        assert status == 0
        return self.record

    def by_fmpy(self, count: int) -> np.ndarray:
        """The same calls from Python through FMPy's class, (count, 3): reference, a.y, b.y."""
        self.start()
        a, b = self.slaves
        record = np.zeros((count, 3))
        g0, g1, g2 = GAINS
        yb = b.getReal(b.output_references)[0]
        for k in range(count):
            time = k * STEP_S
            r = self.table[k]
            a.setReal(a.input_references, [g0 * r, g1 * yb])
            ya = a.getReal(a.output_references)[0]
            b.setReal(b.input_references, [g2 * ya])
            yb = b.getReal(b.output_references)[0]
            record[k] = r, ya, yb
            a.doStep(currentCommunicationPoint=time, communicationStepSize=STEP_S)
            b.doStep(currentCommunicationPoint=time, communicationStepSize=STEP_S)
            yb = b.getReal(b.output_references)[0]
        return record

    def close(self) -> None:
        """Free the instances."""
        for slave in self.slaves:
            slave.freeInstance()
