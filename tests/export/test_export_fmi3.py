"""Blocks exported as FMI 3.0: valid files, and the same behaviour as the FMI 2.0 export."""

from __future__ import annotations

import ctypes
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Model, FMU3Slave
from fmpy.validation import validate_fmu

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import MAXIMUM_SUBSTEPS, Block
from fmu_didim.export import build_fmu, layout
from fmu_didim.export.versions import VERSIONS
from tests.export.helpers import PARAMETERS, PERIOD, Sampled, controller, gain, measured, pendulum, torque

BLOCKS: dict[str, Callable[[], Block]] = {"pendulum": pendulum, "controller": controller, "gain": gain}


class Runner:
    """FMPy's instance of an FMI 3.0 FMU with names in place of value references; collects messages."""

    def __init__(self, block: Block, folder: Path, *, exchange: bool = False, token: str = "") -> None:
        path = build_fmu(block, fmi_version="3.0")
        description = fmpy.read_model_description(str(path))
        self.reference = {v.name: v.valueReference for v in description.modelVariables}
        unzipped = folder / block.name
        if not unzipped.exists():  # a library that is in use must not be overwritten
            fmpy.extract(str(path), unzipdir=str(unzipped))
        kind = FMU3Model if exchange else FMU3Slave
        self.fmu = kind(
            guid=token or description.guid,
            unzipDirectory=str(unzipped),
            modelIdentifier=block.name,
            instanceName="test",
        )
        self.messages: list[str] = []

    def instantiate(self, **options: Any) -> Runner:
        self.fmu.instantiate(logMessage=self._log, **options)
        return self

    def _log(self, _environment: Any, _status: int, _category: bytes, message: bytes) -> None:
        self.messages.append(message.decode())

    def initialize(self, *, start: float = 0.0, **values: float) -> Runner:
        self.fmu.enterInitializationMode(startTime=start)
        self.set(**values)
        self.fmu.exitInitializationMode()
        return self

    def set(self, **values: float) -> None:
        if "substeps" in values:
            self.fmu.setInt32([self.reference["substeps"]], [int(values.pop("substeps"))])
        self.fmu.setFloat64([self.reference[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        return list(self.fmu.getFloat64([self.reference[name] for name in names]))

    def step(self, time: float, step: float) -> tuple[bool, bool, bool, float]:
        return tuple(self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=step))

    def run(self, steps: int, *, first: int = 0, step: float = 0.01) -> list[list[float]]:
        table = []
        for k in range(first, first + steps):
            self.set(tau=torque(k * step))
            self.step(k * step, step)
            table.append(self.get("q", "dq", "ddq"))
        return table


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Callable[..., Runner]]:
    """Instances of the pendulum, or of another block."""
    made: list[Runner] = []

    def new(block: Block | None = None, **options: Any) -> Runner:
        made.append(Runner(block or pendulum(), tmp_path, **options).instantiate())
        return made[-1]

    yield new
    for runner in made:
        runner.fmu.freeInstance()


# ---- files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BLOCKS)
def test_description_is_valid(name: str) -> None:
    path = build_fmu(BLOCKS[name](), fmi_version="3.0")
    assert path.name == f"{name}.fmu"
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        assert {"sources/fmi3.c", "sources/buildDescription.xml"} <= set(archive.namelist())
    build = fmpy.model_description.read_build_description(str(path))
    assert [list(s.sourceFiles) for c in build for s in c.sourceFileSets] == [["fmi3.c"]]


def test_description_content() -> None:
    plant = fmpy.read_model_description(str(build_fmu(pendulum(), fmi_version="3.0")))
    assert plant.fmiVersion == "3.0"
    variables = {v.name: v for v in plant.modelVariables}
    refs = layout(pendulum())
    assert variables["time"].causality == "independent"
    assert (variables["time"].valueReference, variables["substeps"].valueReference) == (refs.time, refs.substeps)
    assert (variables["substeps"].type, variables["substeps"].variability) == ("Int32", "fixed")
    assert (variables["J"].variability, variables["q_start"].variability) == ("tunable", "fixed")
    assert variables["der(speed)"].derivative is variables["speed"]
    assert variables["ddq"].unit == "rad/s2"
    dependencies = {u.variable.name: {d.name for d in u.dependencies} for u in plant.outputs}
    assert dependencies == {"q": {"angle"}, "dq": {"speed"}, "ddq": {"tau", "angle", "speed"}}
    derivatives = {u.variable.name: {d.name for d in u.dependencies} for u in plant.derivatives}
    assert derivatives == {"der(angle)": {"speed"}, "der(speed)": {"tau", "angle", "speed"}}
    initial = {u.variable.name: {d.name for d in u.dependencies} for u in plant.initialUnknowns}
    assert initial["angle"] == {"q_start"}
    assert initial["ddq"] == {"tau", *PARAMETERS}
    assert not plant.coSimulation.hasEventMode
    sampled = fmpy.read_model_description(str(build_fmu(controller(), fmi_version="3.0")))
    assert float(sampled.defaultExperiment.stepSize) == PERIOD
    assert sampled.numberOfContinuousStates == 0


def test_versions_have_files_and_identifiers_of_their_own(tmp_path: Path) -> None:
    two, three = (build_fmu(gain(), directory=tmp_path / v, fmi_version=v) for v in ("2.0", "3.0"))
    assert two.name == three.name == "gain.fmu"
    first, second = (fmpy.read_model_description(str(path)) for path in (two, three))
    assert (first.fmiVersion, second.fmiVersion) == ("2.0", "3.0")
    assert first.guid != second.guid
    with pytest.raises(InputError, match=r"valid: 2\.0, 3\.0"):
        build_fmu(gain(), fmi_version="1.0")


def test_the_name_of_the_time_is_taken() -> None:
    block = replace(gain(), inputs=(Variable("time", "s", "input"),))
    build_fmu(block)  # FMI 2.0 has no variable for the time
    with pytest.raises(InputError, match="got:   time"):
        build_fmu(block, fmi_version="3.0")


# ---- the same as FMI 2.0 ---------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["CVode", "Euler"])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
@pytest.mark.parametrize("name", ["pendulum", "controller"])
def test_simulates_as_fmi2(name: str, kind: str, solver: str) -> None:
    block = BLOCKS[name]()
    times = np.arange(101) * PERIOD
    signals = np.zeros(times.size, dtype=[("time", float), *((v.name, float) for v in block.inputs)])
    signals["time"] = times
    for index, variable in enumerate(block.inputs):
        signals[variable.name] = np.sin((3.0 + index) * times) + 0.5
    options: dict[str, Any] = {"step_size": PERIOD / 10} if solver == "Euler" else {"relative_tolerance": 1e-8}
    two, three = (
        fmpy.simulate_fmu(
            str(build_fmu(block, fmi_version=version)),
            fmi_type=kind,
            solver=solver,
            stop_time=float(times[-1]),
            output_interval=PERIOD,
            input=signals,
            output=[v.name for v in block.outputs],
            start_values={block.parameters[0].name: 0.15},
            **options,
        )
        for version in ("2.0", "3.0")
    )
    assert two.dtype == three.dtype
    for column in two.dtype.names:
        if kind == "CoSimulation":
            assert np.array_equal(two[column], three[column])
        np.testing.assert_allclose(three[column], two[column], rtol=0, atol=1e-6)


def test_outputs_follow_inputs_and_parameters_at_once(make: Callable[..., Runner]) -> None:
    plant = make().initialize(start=2.0, tau=0.0)
    block = pendulum()
    assert plant.get("time") == [2.0]
    for tau, inertia in ((1.0, 0.1), (2.0, 0.1), (2.0, 0.4)):
        plant.set(tau=tau, J=inertia)
        p = block.with_parameters({"J": inertia}).parameter_values
        expected = float(block.output([PARAMETERS["q_start"], PARAMETERS["dq_start"]], tau, p)[2])
        assert plant.get("ddq") == [pytest.approx(expected, rel=1e-14)]
    assert plant.get("der(speed)") == plant.get("ddq")


def test_what_a_step_returns(make: Callable[..., Runner]) -> None:
    plant = make().initialize()
    assert plant.step(0.0, 0.01) == (False, False, False, 0.01)
    assert plant.get("time") == [0.01]
    plant.set(tau=float("nan"))
    flags, last = [ctypes.c_bool(True) for _ in range(3)], ctypes.c_double()
    with pytest.raises(FMICallException):
        plant.fmu.fmi3DoStep(plant.fmu.component, 0.01, 0.01, False, *map(ctypes.byref, flags), ctypes.byref(last))
    assert ([flag.value for flag in flags], last.value) == ([False] * 3, 0.01)
    assert "state is not finite at t=0.02 s: 'angle'" in plant.messages[-1]


def test_outputs_of_a_sampled_block(make: Callable[..., Runner]) -> None:
    start, h = 2.0, PERIOD / 2
    fmu = make(controller()).initialize(start=start, r=1.0, q=0.2)
    law, held = Sampled(0.2), 0.0
    for k in range(101):
        for q in (0.1, measured(k * h)):  # live at a sample, held between two
            fmu.set(q=q)
            held = law.output(1.0, q) if k % 2 == 0 else held
            assert fmu.get("u") == [pytest.approx(held, rel=1e-12)]
        fmu.step(start + k * h, h)
        law.previous = q if k % 2 == 0 else law.previous


def test_each_sample_is_taken_once_in_model_exchange(make: Callable[..., Runner]) -> None:
    fmu = make(controller(), exchange=True).initialize(r=1.0, q=0.0)
    assert (fmu.fmu.getNumberOfContinuousStates(), fmu.fmu.getNumberOfEventIndicators()) == (0, 0)
    fmu.set(q=0.1)
    assert fmu.get("u") == [pytest.approx(9.0 - 10.0)]  # live until the sample is taken
    assert fmu.fmu.updateDiscreteStates() == (False, False, False, False, True, PERIOD)
    fmu.set(q=0.4)
    assert fmu.fmu.updateDiscreteStates()[4:] == (True, PERIOD)
    assert fmu.get("q_previous", "u") == [0.1, pytest.approx(-1.0)]
    fmu.fmu.enterContinuousTimeMode()
    fmu.fmu.setTime(PERIOD)
    assert fmu.get("u") == [pytest.approx(-1.0)]  # before the event
    fmu.fmu.enterEventMode()
    assert fmu.get("u") == [pytest.approx(6.0 - 0.5 * 0.3 / PERIOD)]
    assert fmu.fmu.updateDiscreteStates()[5] == pytest.approx(2 * PERIOD, rel=1e-15)


def test_reset_equals_fresh(make: Callable[..., Runner]) -> None:
    used = make()
    fresh = used.initialize(J=0.2, substeps=8).run(20)
    used.set(J=0.7, Fv=3.0)
    used.fmu.terminate()
    used.fmu.reset()
    assert used.get(*PARAMETERS) == list(PARAMETERS.values())
    assert used.fmu.getInt32([used.reference["substeps"]]) == [0]
    assert used.initialize(J=0.2, substeps=8).run(20) == fresh
    assert make().initialize(J=0.2, substeps=8).run(20) == fresh


def test_saved_states(make: Callable[..., Runner]) -> None:
    plant = make().initialize()
    plant.run(10)
    state = plant.fmu.getFMUState()
    expected = plant.run(10, first=10)
    plant.set(J=9.0)
    plant.fmu.setFMUState(state)
    assert plant.run(10, first=10) == expected
    data = plant.fmu.serializeFMUState(state)
    plant.fmu.freeFMUState(state)
    other = make()
    restored = other.fmu.deserializeFMUState(data)
    other.fmu.setFMUState(restored)
    assert other.run(10, first=10) == expected
    other.fmu.freeFMUState(restored)
    with pytest.raises(FMICallException):
        other.fmu.deserializeFMUState(b"x" * len(data))
    assert "not a state of the FMU" in other.messages[-1]


@pytest.mark.parametrize("exchange", [False, True])
def test_directional_derivatives(make: Callable[..., Runner], exchange: bool) -> None:
    plant = make(exchange=exchange).initialize(tau=0.7)
    unknowns = [plant.reference[name] for name in ("q", "dq", "ddq", "der(angle)", "der(speed)")]
    damping = PARAMETERS["Fv"] + PARAMETERS["Fc"] / 0.05 / np.cosh(PARAMETERS["dq_start"] / 0.05) ** 2
    slopes = np.array([-PARAMETERS["k"] * np.cos(PARAMETERS["q_start"]), -damping, 1.0]) / PARAMETERS["J"]
    expected = np.array([[1, 0, 0], [0, 1, 0], slopes, [0, 1, 0], slopes])
    for column, known in enumerate(("angle", "speed", "tau")):
        got = plant.fmu.getDirectionalDerivative(unknowns, [plant.reference[known]], [2.0])
        np.testing.assert_allclose(got, 2.0 * expected[:, column], rtol=1e-12)


@pytest.mark.parametrize("fmi_version", VERSIONS)
def test_casadi_imports_the_same_equations(fmi_version: str, tmp_path: Path) -> None:
    block = pendulum()
    folder = fmpy.extract(str(build_fmu(block, fmi_version=fmi_version)), unzipdir=str(tmp_path))
    imported = ca.DaeBuilder("imported", str(folder))
    function = imported.create("f", ["x", "u", "p"], ["ode", "y", "jac_ode_x"])
    tunable = [v.name for v in block.parameters if v.name not in block.fixed]
    assert imported.p() == tunable
    x, u, p = [0.7, -0.1], 1.5, block.parameter_values
    rates, outputs, jacobian = function(x, u, p[: len(tunable)])
    np.testing.assert_allclose(rates, block.update(x, u, p), rtol=1e-14)
    np.testing.assert_allclose(outputs, block.output(x, u, p), rtol=1e-14)
    symbol = ca.SX.sym("x", 2)
    slopes = ca.Function("slopes", [symbol], [ca.jacobian(block.update(symbol, u, p), symbol)])
    np.testing.assert_allclose(np.array(jacobian), np.array(slopes(x)), rtol=1e-12)


# ---- refusals ----------------------------------------------------------------------------------------


def test_refused_calls_say_why(make: Callable[..., Runner]) -> None:
    plant = make().initialize()
    fmu, refs = plant.fmu, plant.reference
    for attempt, text in (
        (lambda: plant.set(q_start=1.0), "'q_start'"),
        (lambda: plant.set(substeps=8), "'substeps' is fixed"),
        (lambda: plant.set(q=1.0), "'q' (value reference 1) is calculated"),
        (lambda: plant.set(time=1.0), "independent variable"),
        (lambda: fmu.getFloat64([77]), "value reference 77"),
        (lambda: fmu.getFloat64([refs["substeps"]]), "no floating-point variable"),
        (lambda: fmu.getInt32([3]), "no Int32 variable with value reference 3"),
        (lambda: fmu.getFloat64([0, 1], nValues=3), "2 references, 3 values"),
        (lambda: fmu.setFloat32([0], [1.0]), "no Float32 variables"),
        (lambda: fmu.getInt64([0]), "no Int64 variables"),
        (lambda: fmu.setBoolean([0], [True]), "no Boolean variables"),
        (lambda: fmu.getString([0]), "no String variables"),
        (lambda: fmu.getClock([0]), "no Clock variables"),
        (lambda: fmu.getAdjointDerivative([1], [0], [1.0]), "no adjoint derivatives"),
        (lambda: fmu.getDirectionalDerivative([1], [0], [1.0, 2.0]), "1 references, 2 values"),
        (lambda: fmu.getDirectionalDerivative([0], [0], [1.0]), "not an unknown"),
        (lambda: fmu.enterConfigurationMode(), "no configuration mode"),
        (lambda: fmu.enterStepMode(), "no event mode in co-simulation"),
        (lambda: fmu.enterEventMode(), "not allowed in step mode"),
        (lambda: fmu.enterInitializationMode(), "not allowed in step mode"),
        (lambda: fmu.updateDiscreteStates(), "not allowed in step mode"),
    ):
        with pytest.raises(FMICallException):
            attempt()
        assert text in plant.messages[-1]
    assert fmu.getFloat32([]) == [] and fmu.getString([]) == []
    plant.set(J=0.3)  # tunable
    plant.run(1)
    other = make()
    with pytest.raises(FMICallException):
        other.set(substeps=MAXIMUM_SUBSTEPS + 1)
    assert str(MAXIMUM_SUBSTEPS) in other.messages[-1]
    other.fmu.fmi3FreeInstance(None)  # as the standard allows


@pytest.mark.parametrize(
    ("options", "arguments", "text"),
    [({"token": "{wrong}"}, {}, "instantiation token is not"), ({}, {"eventModeUsed": True}, "no event mode")],
)
def test_refused_instances_say_why(
    tmp_path: Path, options: dict[str, Any], arguments: dict[str, Any], text: str
) -> None:
    runner = Runner(pendulum(), tmp_path, **options)
    with pytest.raises(Exception, match="instantiate"):
        runner.instantiate(**arguments)
    assert text in runner.messages[-1]
    runner.fmu.freeLibrary()
