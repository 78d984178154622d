"""Blocks exported as FMUs: what the files say, and what the C code computes."""

from __future__ import annotations

import ctypes
import itertools
import multiprocessing
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

from fmu_didim.base.cache import COMPILER, own_folder
from fmu_didim.base.errors import BuildError, InputError
from fmu_didim.components import load_fmu
from fmu_didim.data.signals import Variable
from fmu_didim.data.units import parse_unit
from fmu_didim.dynamics.block import MAXIMUM_SUBSTEPS, choose_substeps
from fmu_didim.export import build_fmu, compile_shared_library, generate_c, layout
from tests.export.helpers import PARAMETERS, PERIOD, Sampled, controller, gain, measured, pendulum, torque
from tests.patience import patience


@pytest.fixture(scope="session")
def plant_fmu() -> Path:
    return build_fmu(pendulum())


@pytest.fixture(scope="session")
def controller_fmu() -> Path:
    return build_fmu(controller())


class Runner:
    """FMPy's instance of an exported FMU with names in place of value references; collects messages."""

    def __init__(self, path: Path, folder: Path, *, exchange: bool = False) -> None:
        description = fmpy.read_model_description(str(path))
        self.reference = {v.name: v.valueReference for v in description.modelVariables}
        kind = FMU2Model if exchange else FMU2Slave
        if not folder.exists():  # a library that is in use must not be overwritten
            fmpy.extract(str(path), unzipdir=str(folder))
        self.fmu = kind(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="test",
        )
        self.messages: list[str] = []
        callbacks = fmpy.fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(self._log)
        callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self.fmu.instantiate(callbacks=callbacks)

    def _log(self, _environment: Any, _name: bytes, _status: int, _category: bytes, message: bytes) -> None:
        self.messages.append(message.decode())

    def initialize(self, *, start: float = 0.0, **values: float) -> Runner:
        self.fmu.setupExperiment(startTime=start)
        self.fmu.enterInitializationMode()
        self.set(**values)
        self.fmu.exitInitializationMode()
        return self

    def set(self, **values: float) -> None:
        if "substeps" in values:
            self.fmu.setInteger([self.reference["substeps"]], [int(values.pop("substeps"))])
        self.fmu.setReal([self.reference[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        return list(self.fmu.getReal([self.reference[name] for name in names]))

    def step(self, time: float, step: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=step)

    def run(self, steps: int, *, first: int = 0, step: float = 0.01) -> list[list[float]]:
        """Outputs of the plant at the end of each step under a torque that changes every step."""
        table = []
        for k in range(first, first + steps):
            self.set(tau=torque(k * step))
            self.step(k * step, step)
            table.append(self.get("q", "dq", "ddq"))
        return table


@pytest.fixture
def run_plant(plant_fmu: Path, tmp_path: Path) -> Iterator[Callable[..., Runner]]:
    yield from _runners(plant_fmu, tmp_path)


@pytest.fixture
def run_controller(controller_fmu: Path, tmp_path: Path) -> Iterator[Callable[..., Runner]]:
    yield from _runners(controller_fmu, tmp_path)


def _runners(path: Path, folder: Path) -> Iterator[Callable[..., Runner]]:
    made: list[Runner] = []

    def make(**options: Any) -> Runner:
        made.append(Runner(path, folder / "extracted", **options))
        return made[-1]

    yield make
    for runner in made:
        runner.fmu.freeInstance()


def reference_motion(times: np.ndarray, **changed: float) -> np.ndarray:
    """(N, 2) angle and speed at the times by DOP853, the torque held between them."""
    p = PARAMETERS | changed

    def rate(_t: float, x: np.ndarray, tau: float) -> list[float]:
        friction = p["Fv"] * x[1] + p["Fc"] * np.tanh(x[1] / 0.05)
        return [x[1], (tau - friction - p["k"] * np.sin(x[0])) / p["J"]]

    rows = [np.array([p["q_start"], p["dq_start"]])]
    for begin, end in itertools.pairwise(times):
        options = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12, "args": (torque(begin),)}
        rows.append(solve_ivp(rate, (begin, end), rows[-1], **options).y[:, -1])
    return np.array(rows)


# ---- files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("fixture", ["plant_fmu", "controller_fmu"])
def test_description_is_valid(fixture: str, request: pytest.FixtureRequest) -> None:
    path = request.getfixturevalue(fixture)
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        assert {"modelDescription.xml", "sources/fmi2.c", "sources/block_equations.c"} <= set(archive.namelist())


def test_description_content(plant_fmu: Path, controller_fmu: Path) -> None:
    plant = fmpy.read_model_description(str(plant_fmu))
    variables = {v.name: v for v in plant.modelVariables}
    assert variables["J"].variability == "tunable"
    assert variables["q_start"].variability == "fixed"
    assert variables["der(speed)"].derivative is variables["speed"]
    assert variables["ddq"].unit == "rad/s2"
    dependencies = {u.variable.name: {d.name for d in u.dependencies} for u in plant.outputs}
    assert dependencies == {"q": {"angle"}, "dq": {"speed"}, "ddq": {"tau", "angle", "speed"}}
    initial = {u.variable.name: {d.name for d in u.dependencies} for u in plant.initialUnknowns}
    assert initial["angle"] == {"q_start"}
    assert initial["ddq"] == {"tau", *PARAMETERS}
    sampled = fmpy.read_model_description(str(controller_fmu))
    assert float(sampled.defaultExperiment.stepSize) == PERIOD
    assert sampled.numberOfContinuousStates == 0


def test_layout_is_contiguous() -> None:
    refs = layout(pendulum())
    groups = (refs.inputs, refs.outputs, refs.states, refs.parameters, refs.derivatives)
    assert [r for group in groups for r in group] == list(range(14))
    assert refs.substeps == 14
    assert layout(controller()).substeps is None


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("N.m.s/rad", ({"kg": 1, "m": 2, "s": -1, "rad": -1}, 1.0)),
        ("rad/s2", ({"rad": 1, "s": -2}, 1.0)),
        ("1/s", ({"s": -1}, 1.0)),
        ("W/(m2.K)", ({"kg": 1, "s": -3, "K": -1}, 1.0)),
        ("deg", ({"rad": 1}, np.pi / 180)),
        ("V", ({"kg": 1, "m": 2, "s": -3, "A": -1}, 1.0)),
        ("furlong", None),
        ("N/m.s", None),
    ],
)
def test_base_units(unit: str, expected: object) -> None:
    known = parse_unit(unit)
    assert (known and (known.powers, known.factor)) == expected


def test_build_is_cached_and_copied(plant_fmu: Path, tmp_path: Path) -> None:
    stamp = plant_fmu.stat().st_mtime_ns
    copy = build_fmu(pendulum(), directory=tmp_path / "new")
    assert copy == tmp_path / "new" / "pendulum.fmu"
    assert copy.read_bytes() == plant_fmu.read_bytes()
    assert plant_fmu.stat().st_mtime_ns == stamp


def test_bad_blocks_are_refused() -> None:
    with pytest.raises(InputError, match="legal C name"):
        generate_c(replace(pendulum(), name="2-link"))
    with pytest.raises(InputError, match="substeps"):
        block = pendulum()
        generate_c(replace(block, inputs=(Variable("substeps", "", "input"),)))
    with pytest.raises(InputError, match="not a finite number"):
        generate_c(pendulum().with_parameters({"J": float("inf")}))


@pytest.mark.parametrize("compiler", ["no-such-compiler-here", "false"])
def test_bad_compiler(compiler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", compiler)
    with pytest.raises(BuildError, match="Unset CC"):
        build_fmu(controller())


def test_compiler_output_is_in_the_error(tmp_path: Path) -> None:
    (tmp_path / "broken.c").write_text("int f(void) { return unknown_name; }\n")
    with pytest.raises(BuildError, match="unknown_name"):
        compile_shared_library(tmp_path, tmp_path / "broken.so", main="broken.c")


def _build_static_gain(folder: Path, queue: Any) -> None:
    queue.put(str(build_fmu(gain(), directory=folder)))


@pytest.mark.gate
def test_two_processes_build_the_same_fmu(plant_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shared_zig = own_folder(COMPILER)  # so that only the FMU is built anew, not zig's own files
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(shared_zig))
    monkeypatch.setenv("ZIG_LOCAL_CACHE_DIR", str(shared_zig))
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    workers = [context.Process(target=_build_static_gain, args=(tmp_path / str(i), queue)) for i in range(2)]
    for worker in workers:
        worker.start()
    paths = [Path(queue.get(timeout=patience(120))) for _ in workers]
    for worker in workers:
        worker.join(timeout=patience(60))
        assert worker.exitcode == 0
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert len(list((tmp_path / "cache").glob("exported/*/content/*.fmu"))) == 1
    assert validate_fmu(str(paths[0])) == []
    result = fmpy.simulate_fmu(str(paths[0]), start_values={"u": 2.0}, stop_time=0.1, output=["y"])
    assert result["y"][-1] == 6.0


# ---- a continuous block --------------------------------------------------------------------------


def test_co_simulation_matches_an_independent_integrator(plant_fmu: Path) -> None:
    times = np.arange(101) * 0.01
    signals = np.array([(t, torque(t)) for t in times], dtype=[("time", float), ("tau", float)])
    result = fmpy.simulate_fmu(
        str(plant_fmu),
        fmi_type="CoSimulation",
        stop_time=1.0,
        output_interval=0.01,
        input=signals,
        output=["q", "dq", "ddq"],
        start_values={"J": 0.15},
    )
    expected = reference_motion(times, J=0.15)
    got = np.column_stack([result["q"], result["dq"]])
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("solver", "tolerance"), [("CVode", 1e-4), ("Euler", 2e-2)])
def test_model_exchange(plant_fmu: Path, solver: str, tolerance: float) -> None:
    options: dict[str, Any] = {"stop_time": 0.5, "output_interval": 0.01, "output": ["q", "dq"]}
    constant = {"tau": 1.5}
    expected = fmpy.simulate_fmu(str(plant_fmu), fmi_type="CoSimulation", start_values=constant, **options)
    step = {"step_size": 0.0005} if solver == "Euler" else {"relative_tolerance": 1e-7}
    got = fmpy.simulate_fmu(
        str(plant_fmu), fmi_type="ModelExchange", solver=solver, start_values=constant, **step, **options
    )
    np.testing.assert_allclose(np.interp(expected["time"], got["time"], got["q"]), expected["q"], atol=tolerance)


def test_outputs_follow_inputs_and_parameters_at_once(run_plant: Callable[..., Runner]) -> None:
    plant = run_plant().initialize(tau=0.0)
    block = pendulum()
    for tau, inertia in ((1.0, 0.1), (2.0, 0.1), (2.0, 0.4)):
        plant.set(tau=tau, J=inertia)
        p = block.with_parameters({"J": inertia}).parameter_values
        expected = float(block.output([PARAMETERS["q_start"], PARAMETERS["dq_start"]], tau, p)[2])
        assert plant.get("ddq") == [pytest.approx(expected, rel=1e-14)]
    assert plant.get("der(speed)") == plant.get("ddq")


def test_start_state_follows_parameters_in_initialization(run_plant: Callable[..., Runner]) -> None:
    plant = run_plant()
    plant.fmu.setupExperiment(startTime=0.0)
    plant.fmu.enterInitializationMode()
    assert plant.get("q", "angle") == [0.5, 0.5]
    plant.set(q_start=1.25)
    assert plant.get("q", "angle") == [1.25, 1.25]


@pytest.mark.parametrize("changed", [{}, {"J": 0.01, "Fc": 0.5}, {"J": 50.0}])
def test_automatic_substeps(run_plant: Callable[..., Runner], changed: dict[str, float]) -> None:
    block = pendulum().with_parameters(changed)
    assert block.rate_bound is not None
    rate = float(block.rate_bound(block.start(0.0, block.parameter_values), block.parameter_values))
    count = choose_substeps(rate, 0.01)
    automatic = run_plant().initialize(**changed).run(50)
    assert automatic == run_plant().initialize(substeps=count, **changed).run(50)
    assert automatic != run_plant().initialize(substeps=2 * count, **changed).run(50)
    finer = np.array(run_plant().initialize(substeps=2 * count, **changed).run(50))
    np.testing.assert_allclose(np.array(automatic)[:, :2], finer[:, :2], rtol=0, atol=1e-6)


def test_too_many_substeps_are_refused(run_plant: Callable[..., Runner]) -> None:
    plant = run_plant().initialize(J=1e-9)
    with pytest.raises(fmpy.fmi1.FMICallException):
        plant.step(0.0, 0.01)
    assert "more than the largest number" in plant.messages[-1]
    other = run_plant()
    with pytest.raises(fmpy.fmi1.FMICallException):
        other.set(substeps=MAXIMUM_SUBSTEPS + 1)
    assert str(MAXIMUM_SUBSTEPS) in other.messages[-1]


def test_reset_equals_fresh(run_plant: Callable[..., Runner]) -> None:
    used = run_plant()
    fresh = used.initialize(J=0.2).run(20)
    used.set(J=0.7, Fv=3.0)
    used.fmu.terminate()
    used.fmu.reset()
    assert used.get(*PARAMETERS) == list(PARAMETERS.values())
    assert used.initialize(J=0.2).run(20) == fresh
    assert run_plant().initialize(J=0.2).run(20) == fresh


def test_saved_states(run_plant: Callable[..., Runner]) -> None:
    plant = run_plant().initialize()
    plant.run(10)
    state = plant.fmu.getFMUstate()
    expected = plant.run(10, first=10)
    plant.set(J=9.0)
    plant.fmu.setFMUstate(state)
    assert plant.run(10, first=10) == expected
    data = plant.fmu.serializeFMUstate(state)
    plant.fmu.freeFMUstate(state)
    other = run_plant()
    restored = other.fmu.deSerializeFMUstate(data)
    other.fmu.setFMUstate(restored)
    assert other.run(10, first=10) == expected
    assert other.fmu.serializeFMUstate(restored) == data
    other.fmu.freeFMUstate(restored)
    with pytest.raises(fmpy.fmi1.FMICallException):
        other.fmu.deSerializeFMUstate(b"x" * len(data))
    assert "not a state of the FMU" in other.messages[-1]


def test_instances_are_independent(run_plant: Callable[..., Runner]) -> None:
    alone = run_plant().initialize(J=0.2).run(20)
    first, second = run_plant().initialize(J=0.2), run_plant().initialize(J=0.3)
    interleaved = [(first.run(1, first=k)[0], second.run(1, first=k)[0]) for k in range(20)]
    assert [a for a, _ in interleaved] == alone
    assert all(a != b for a, b in interleaved)


def test_fixed_parameters_and_bad_references(run_plant: Callable[..., Runner]) -> None:
    plant = run_plant().initialize()
    for attempt, text in (
        (lambda: plant.set(q_start=1.0), "'q_start'"),
        (lambda: plant.set(substeps=8), "'substeps' is fixed"),
        (lambda: plant.set(q=1.0), "'q' (value reference 1) is calculated"),
        (lambda: plant.fmu.getReal([77]), "value reference 77"),
        (lambda: plant.fmu.getInteger([3]), "value reference 3"),
        (lambda: plant.fmu.enterInitializationMode(), "not allowed in step mode"),
    ):
        with pytest.raises(fmpy.fmi1.FMICallException):
            attempt()
        assert text in plant.messages[-1]
    plant.set(J=0.3)  # tunable
    plant.run(1)
    plant.fmu.fmi2FreeInstance(None)  # as the standard allows


def test_not_a_number_is_reported(run_plant: Callable[..., Runner]) -> None:
    plant = run_plant().initialize()
    plant.run(3)
    plant.set(tau=float("nan"))
    with pytest.raises(fmpy.fmi1.FMICallException):
        plant.step(0.03, 0.01)
    assert "state is not finite at t=0.04 s: 'angle'" in plant.messages[-1]
    other = run_plant()
    with pytest.raises(fmpy.fmi1.FMICallException):
        other.initialize(q_start=float("nan"))
    assert "initial state is not finite" in other.messages[-1]


def test_wrong_guid(plant_fmu: Path, tmp_path: Path) -> None:
    fmu = FMU2Slave(
        guid="{wrong}",
        unzipDirectory=str(fmpy.extract(str(plant_fmu), unzipdir=str(tmp_path))),
        modelIdentifier="pendulum",
        instanceName="test",
    )
    with pytest.raises(Exception, match="instantiate"):
        fmu.instantiate()
    fmu.freeLibrary()


@pytest.mark.parametrize("exchange", [False, True])
def test_directional_derivatives(run_plant: Callable[..., Runner], exchange: bool) -> None:
    block = pendulum()
    plant = run_plant(exchange=exchange).initialize(tau=0.7)
    if not exchange:
        plant.run(3)
    x, u = plant.get("angle", "speed"), plant.get("tau")
    unknowns = ["q", "dq", "ddq", "der(angle)", "der(speed)"]
    knowns = ["angle", "speed", "tau", *PARAMETERS]
    jacobian = np.vstack([_jacobian(f, x, u, block.parameter_values) for f in (block.output, block.update)])
    refs = plant.reference
    for column, known in enumerate(knowns):
        got = plant.fmu.getDirectionalDerivative([refs[n] for n in unknowns], [refs[known]], [2.0])
        np.testing.assert_allclose(got, 2.0 * jacobian[:, column], rtol=1e-12, atol=1e-14)
    seed = np.linspace(-1, 1, len(knowns))
    got = plant.fmu.getDirectionalDerivative([refs[n] for n in unknowns], [refs[n] for n in knowns], list(seed))
    np.testing.assert_allclose(got, jacobian @ seed, rtol=1e-12)
    with pytest.raises(fmpy.fmi1.FMICallException):
        plant.fmu.getDirectionalDerivative([refs["tau"]], [refs["tau"]], [1.0])


def _jacobian(function: ca.Function, *arguments: Any) -> np.ndarray:
    symbols = [ca.SX.sym("s", function.numel_in(i)) for i in range(3)]
    jacobian = ca.Function("j", symbols, [ca.jacobian(function(*symbols), ca.vertcat(*symbols))])
    return np.array(jacobian(*arguments))


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_an_fmu_without_directional_derivatives_computes_the_same(version: str) -> None:
    """It says that it gives none, so that nobody asks for them."""
    whole, lean = (load_fmu(build_fmu(pendulum(), fmi_version=version, directional=d)) for d in (True, False))
    assert whole.interface.has_derivatives and not lean.interface.has_derivatives
    found = []
    for component in (whole, lean):
        running = component.instantiate()
        running.begin_initialisation(0.0)
        running.set()
        running.end_initialisation()
        for tick in range(20):
            running.set()
            running.step(tick * 0.005, 0.005)
        running.get()
        found.append(running.outputs.copy())
        running.close()
    np.testing.assert_array_equal(found[0], found[1])
    assert "directional" not in generate_c(pendulum(), directional=False)


def test_directional_derivative_while_initializing(run_plant: Callable[..., Runner]) -> None:
    plant = run_plant()
    plant.fmu.setupExperiment(startTime=0.0)
    plant.fmu.enterInitializationMode()
    refs = plant.reference
    got = plant.fmu.getDirectionalDerivative([refs["angle"], refs["q"], refs["ddq"]], [refs["q_start"]], [1.0])
    slope = -PARAMETERS["k"] * np.cos(PARAMETERS["q_start"]) / PARAMETERS["J"]
    np.testing.assert_allclose(got, [1.0, 1.0, slope], rtol=1e-12)


def test_matrix_expressions_compute_the_same(run_plant: Callable[..., Runner], tmp_path: Path) -> None:
    other = Runner(build_fmu(pendulum(ca.MX)), tmp_path / "matrix").initialize()
    expected = run_plant().initialize().run(20)
    np.testing.assert_allclose(other.run(20), expected, rtol=1e-12)
    other.fmu.freeInstance()


# ---- a sampled block -----------------------------------------------------------------------------


def test_outputs_of_a_sampled_block_are_live_at_its_samples(run_controller: Callable[..., Runner]) -> None:
    fmu = run_controller().initialize(r=0.0, q=measured(0.0))
    law = Sampled(measured(0.0))
    for k in range(1000):
        for r in (0.5, 1.0):
            fmu.set(r=r, q=measured(k * PERIOD))
            assert fmu.get("u") == [pytest.approx(law.output(r, measured(k * PERIOD)), rel=1e-12)]
        fmu.step(k * PERIOD, PERIOD)
        law.previous = measured(k * PERIOD)
        assert fmu.get("q_previous") == [law.previous]


def test_a_sampled_block_holds_between_its_samples(run_controller: Callable[..., Runner]) -> None:
    start, h = 2.0, PERIOD / 2
    fmu = run_controller().initialize(start=start, r=1.0, q=0.2)
    law, held = Sampled(0.2), 0.0
    for k in range(101):
        q = measured(k * h)
        fmu.set(q=q)
        if k % 2 == 0:
            held = law.output(1.0, q)
        assert fmu.get("u") == [pytest.approx(held, rel=1e-12)]
        fmu.step(start + k * h, h)
        if k % 2 == 0:
            law.previous = q


def test_a_sampled_block_catches_up_in_long_steps(run_controller: Callable[..., Runner]) -> None:
    fmu = run_controller().initialize(r=1.0, q=0.0)
    fmu.set(q=0.3)
    fmu.step(0.0, 2 * PERIOD)  # the samples at 0 and T, both with q = 0.3
    assert fmu.get("q_previous") == [0.3]
    assert fmu.get("u") == [pytest.approx(10.0 * 0.7)]  # the sample at 2 T, live
    fmu.set(q=0.5)
    assert fmu.get("u") == [pytest.approx(10.0 * 0.5 - 0.5 * 0.2 / PERIOD)]
    fmu.step(2 * PERIOD, 1.5 * PERIOD)  # the samples at 2 T and 3 T; 3.5 T holds the one at 3 T
    fmu.set(q=9.0)
    assert fmu.get("u") == [pytest.approx(10.0 * 0.5)]


def test_model_exchange_of_a_sampled_block_gives_the_same_sequence(
    controller_fmu: Path, run_controller: Callable[..., Runner]
) -> None:
    times = np.arange(41) * PERIOD
    # Constant over each period from half a period before the sample, so events and ramps do not meet.
    edges = np.concatenate([[0.0], (times[1:] - 0.5 * PERIOD).repeat(2), [times[-1] + PERIOD]])
    values = np.array([measured(t) for t in times]).repeat(2)
    signals = np.array(list(zip(edges, values, strict=True)), dtype=[("time", float), ("q", float)])
    result = fmpy.simulate_fmu(
        str(controller_fmu),
        fmi_type="ModelExchange",
        stop_time=float(times[-1]),
        step_size=PERIOD / 4,
        output_interval=PERIOD / 4,
        solver="Euler",
        input=signals,
        output=["u"],
        start_values={"r": 1.0},
        record_events=False,
    )
    fmu = run_controller().initialize(r=1.0, q=measured(0.0))
    expected = []
    for k, time in enumerate(times):
        fmu.set(q=measured(time))
        expected += fmu.get("u")
        fmu.step(k * PERIOD, PERIOD)
    after = np.searchsorted(result["time"], times[:-1] + 0.3 * PERIOD)
    np.testing.assert_allclose(result["u"][after], expected[:-1], rtol=1e-12)


def test_each_sample_is_taken_once_in_model_exchange(run_controller: Callable[..., Runner]) -> None:
    fmu = run_controller(exchange=True).initialize(r=1.0, q=0.0)
    fmu.set(q=0.1)
    assert fmu.get("u") == [pytest.approx(9.0 - 10.0)]  # live until the sample is taken
    assert fmu.fmu.newDiscreteStates()[4:] == (1, PERIOD)
    fmu.set(q=0.4)
    assert fmu.fmu.newDiscreteStates()[4:] == (1, PERIOD)
    assert fmu.get("q_previous", "u") == [0.1, pytest.approx(-1.0)]
    fmu.fmu.enterContinuousTimeMode()
    fmu.fmu.setTime(PERIOD)
    assert fmu.get("u") == [pytest.approx(-1.0)]  # before the event
    fmu.fmu.enterEventMode()
    assert fmu.get("u") == [pytest.approx(6.0 - 0.5 * 0.3 / PERIOD)]
    assert fmu.fmu.newDiscreteStates()[5] == pytest.approx(2 * PERIOD, rel=1e-15)


def test_saved_state_of_a_sampled_block(run_controller: Callable[..., Runner]) -> None:
    fmu = run_controller().initialize(r=1.0, q=0.0)
    fmu.set(q=0.3)
    fmu.step(0.0, 0.4 * PERIOD)
    state = fmu.fmu.getFMUstate()
    trace = []
    for _ in range(2):
        fmu.fmu.setFMUstate(state)
        values = fmu.get("u")
        for k in range(1, 6):
            fmu.set(q=0.1 * k)
            fmu.step(0.4 * PERIOD * k, 0.4 * PERIOD)
            values += fmu.get("u", "q_previous")
        trace.append(values)
    assert trace[0] == trace[1]
    fmu.fmu.freeFMUstate(state)


def test_functions_visible_in_the_library(plant_fmu: Path, tmp_path: Path) -> None:
    library = next(Path(str(fmpy.extract(str(plant_fmu), unzipdir=str(tmp_path)))).glob("binaries/*/pendulum.*"))
    loaded = ctypes.CDLL(str(library))
    assert hasattr(loaded, "fmi2DoStep")
    assert not hasattr(loaded, "block_update")
    assert not hasattr(loaded, "core_step")
