"""Conformance: everything that runs in the loop keeps the same promises, whatever it is made of."""

from __future__ import annotations

import dataclasses
import gc
import pickle
import warnings
import zipfile
from functools import cache
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.linalg import expm

from fmu_didim.base.errors import FmuError, InputError, SimulationError, UnknownNameError
from fmu_didim.components import Component, ModelComponent, block_as_control, load_fmu, to_control, wrap_control
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu
from fmu_didim.export.versions import VERSIONS
from tests.helpers import PERIOD, advance, begin, component, drive, scara, scara_cascade, scara_pd, sledge

STEPS = 40
BLOCKS = ("scara", "cascade", "pd", "sledge")
"""A nonlinear and a linear plant, a controller with states and one without."""
FMUS = tuple(f"fmu {version}" for version in VERSIONS)
KINDS = ("model", "control", *FMUS)


@cache
def block(name: str) -> Block:
    if name == "scara":
        return scara().block({"q_start1": 0.3, "dq_start2": -0.4})
    return {"cascade": scara_cascade, "pd": scara_pd, "sledge": lambda: sledge(3.0).block()}[name]()


@cache
def part(kind: str, name: str) -> Component:
    word, _, version = kind.partition(" ")
    return load_fmu(build_fmu(block(name), fmi_version=version)) if version else component(word, block(name))


def rows(name: str, count: int = STEPS) -> np.ndarray:
    """Smooth inputs of different sizes."""
    width = len(block(name).inputs)
    t = np.arange(count)[:, None] * PERIOD
    return np.sin(7 * t + np.arange(width)) * np.linspace(1.0, 0.2, width)


each_part = pytest.mark.parametrize(("kind", "name"), [(k, n) for n in BLOCKS for k in KINDS])


# ---- every kind, plants and controllers ------------------------------------------------------------


@pytest.mark.gate
@each_part
def test_variables_and_buffers(kind: str, name: str) -> None:
    made, source = part(kind, name), block(name)
    for group in ("inputs", "outputs", "parameters"):
        got, wanted = getattr(made, group), getattr(source, group)
        assert [(v.name, v.unit, v.causality, v.start) for v in got] == [
            (v.name, v.unit, v.causality, v.start) for v in wanted
        ]
    instance = made.instantiate()
    assert instance.inputs.shape == (len(source.inputs),)
    assert instance.outputs.shape == (len(source.outputs),)
    assert instance.inputs.dtype == instance.outputs.dtype == float
    instance.close()
    assert made.describe()["kind"] == kind.split()[0]


@each_part
def test_all_kinds_compute_the_same(kind: str, name: str) -> None:
    wanted = drive(part("model", name), rows(name), PERIOD, 0.2)
    got = drive(part(kind, name), rows(name), PERIOD, 0.2)
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())
    assert np.ptp(wanted, axis=0).min() > 1e-5


@pytest.mark.gate
@each_part
def test_buffers_may_be_replaced_by_views(kind: str, name: str) -> None:
    wanted = drive(part(kind, name), rows(name), PERIOD)
    memory = np.full(50, np.nan)
    instance = part(kind, name).instantiate()
    width, height = instance.inputs.size, instance.outputs.size
    instance.bind(memory[3 : 3 + width], memory[20 : 20 + height])
    begin(instance, rows(name)[0])
    got = []
    for k, row in enumerate(rows(name)):
        advance(instance, row, k * PERIOD, PERIOD)
        instance.get()
        got.append(memory[20 : 20 + height].copy())
    instance.close()
    assert np.isnan(np.delete(memory, [*range(3, 3 + width), *range(20, 20 + height)])).all()
    # Outputs after a step, inputs still held: the state part of the next row.
    states = [i for i, v in enumerate(block(name).outputs) if v.name.startswith(("q", "dq"))]
    np.testing.assert_array_equal(np.array(got)[:-1, states], wanted[1:, states])


@each_part
def test_unknown_parameters_are_refused(kind: str, name: str) -> None:
    known = block(name).parameters[0].name
    with pytest.raises(UnknownNameError, match=f"no parameter named '{known}x'") as caught:
        part(kind, name).with_parameters({known: 1.0, f"{known}x": 1.0})
    assert f"Did you mean '{known}'" in str(caught.value)


@pytest.mark.gate
@each_part
def test_components_are_picklable(kind: str, name: str) -> None:
    copy = pickle.loads(pickle.dumps(part(kind, name)))
    np.testing.assert_array_equal(drive(copy, rows(name), PERIOD), drive(part(kind, name), rows(name), PERIOD))
    assert copy.parameter_values() == part(kind, name).parameter_values()


PARAMETER = {"scara": {"ZZ1": 5.0, "Fv2": 0.3}, "cascade": {"Kp1": 5.0, "Kv2": 3.0}, "pd": {"Kp1": 5.0}}
PARAMETER["sledge"] = {"M1": 3.0, "q_start1": 0.3}


@pytest.mark.gate
@each_part
def test_other_parameters_act_and_leave_the_component_alone(kind: str, name: str) -> None:
    before = drive(part(kind, name), rows(name), PERIOD)
    changed = part(kind, name).with_parameters(PARAMETER[name])
    for key, value in PARAMETER[name].items():
        assert changed.parameter_values()[key] == value
        assert part(kind, name).parameter_values()[key] != value
    got = drive(changed, rows(name), PERIOD)
    wanted = drive(ModelComponent(block(name).with_parameters(PARAMETER[name])), rows(name), PERIOD)
    assert np.abs(wanted - before).max() > 1e-3
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())
    np.testing.assert_array_equal(drive(part(kind, name), rows(name), PERIOD), before)


@each_part
def test_components_cannot_be_changed(kind: str, name: str) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        part(kind, name).substeps = 3  # type: ignore[attr-defined]


@pytest.mark.gate
@each_part
def test_instances_are_independent(kind: str, name: str) -> None:
    made = part(kind, name)
    u = rows(name)
    alone = [drive(made, u, PERIOD), drive(made, 0.5 * u, PERIOD)]
    first, second = made.instantiate(), made.instantiate()
    begin(first, u[0])
    begin(second, 0.5 * u[0])
    for k in range(STEPS):
        np.testing.assert_array_equal(advance(first, u[k], k * PERIOD, PERIOD), alone[0][k])
        np.testing.assert_array_equal(advance(second, 0.5 * u[k], k * PERIOD, PERIOD), alone[1][k])
    first.close()
    second.close()


@pytest.mark.gate
@each_part
def test_a_restored_state_goes_on_bit_by_bit(kind: str, name: str) -> None:
    instance = part(kind, name).instantiate()
    u = rows(name, 3 * STEPS)
    begin(instance, u[0])
    for k in range(STEPS):
        advance(instance, u[k], k * PERIOD, PERIOD)
    state = instance.save_state()
    later = range(STEPS, 2 * STEPS)
    wanted = np.array([advance(instance, u[k], k * PERIOD, PERIOD) for k in later])
    for _ in range(2):  # a state may be used more than once
        advance(instance, 0 * u[0] + 9.0, 2 * STEPS * PERIOD, PERIOD)
        instance.restore_state(state)
        instance.get()
        got = np.array([advance(instance, u[k], k * PERIOD, PERIOD) for k in later])
        np.testing.assert_array_equal(got, wanted)
    instance.close()


@each_part
def test_outputs_follow_inputs_at_once(kind: str, name: str) -> None:
    """Between set and get no time passes: with another input, another output, and back."""
    instance = part(kind, name).instantiate()
    u = 1e-3 * rows(name)[1]  # small enough to stay inside the limits
    begin(instance, u)
    advance(instance, u, 0.0, PERIOD)
    seen = []
    for row in (u, u + 1e-4 * np.arange(1, u.size + 1), u):
        instance.inputs[:] = row
        instance.set()
        instance.get()
        seen.append(instance.outputs.copy())
    instance.close()
    assert (seen[0] != seen[1]).any()
    np.testing.assert_array_equal(seen[0], seen[2])


@pytest.mark.gate
@each_part
def test_the_last_inputs_of_the_initialisation_count(kind: str, name: str) -> None:
    u = rows(name)
    wanted = drive(part(kind, name), u, PERIOD)
    instance = part(kind, name).instantiate()
    instance.begin_initialisation(0.0)
    for row in (u[5] + 1, u[7] - 2, u[0]):
        instance.inputs[:] = row
        instance.set()
        instance.get()
    instance.end_initialisation()
    got = np.array([advance(instance, row, k * PERIOD, PERIOD) for k, row in enumerate(u)])
    instance.close()
    np.testing.assert_array_equal(got, wanted)


@pytest.mark.parametrize("name", ["cascade", "pd"])
@pytest.mark.parametrize("parts", [2, 5])
@pytest.mark.parametrize("start", [0.0, 0.1])
def test_sampled_components_hold_between_their_samples(name: str, parts: int, start: float) -> None:
    """Stepped with T / 2 or T / 5 they follow their inputs at t0 + n T only, and all kinds alike."""
    slow = rows(name, 20)
    fine = np.repeat(slow, parts, axis=0)
    fine[np.arange(len(fine)) % parts != 0] += 5.0  # seen by nobody
    wanted = np.repeat(drive(part("model", name), slow, PERIOD, start), parts, axis=0)
    for kind in KINDS:
        got = drive(part(kind, name), fine, PERIOD / parts, start)
        np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max(), err_msg=kind)


@pytest.mark.gate
@pytest.mark.parametrize("kind", KINDS)
def test_plants_take_a_chosen_number_of_substeps(kind: str) -> None:
    def run(made: Component | None) -> np.ndarray:
        assert made is not None
        return drive(made, rows("scara"), PERIOD)

    coarse, fine, finer = (run(part(kind, "scara").with_substeps(n)) for n in (4, 64, 128))
    assert np.abs(coarse - fine).max() > 100 * np.abs(fine - finer).max() > 0
    wanted = drive(ModelComponent(block("scara"), 64), rows("scara"), PERIOD)
    np.testing.assert_allclose(fine, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


@pytest.mark.parametrize("kind", KINDS)
def test_equations_too_stiff_are_refused(kind: str) -> None:
    """ZZ2 = 1e-7 kg.m2 under Coulomb friction has a rate of 7e7 / s."""
    stiff = part(kind, "scara").with_parameters({"ZZ2": 1e-7, "MX2": 0.0, "MY2": 0.0})
    with pytest.raises(SimulationError, match=r"too stiff|substeps"):
        drive(stiff, rows("scara"), PERIOD)


@pytest.mark.parametrize("kind", ["model", "control"])
def test_the_largest_number_of_substeps_is_allowed(kind: str) -> None:
    chosen = part(kind, "sledge").with_substeps(1024)
    assert chosen is not None
    drive(chosen, rows("sledge", 2), PERIOD)


# ---- FMUs -----------------------------------------------------------------------------------------


def test_missing_fmus_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"does not exist[\s\S]*nowhere\.fmu"):
        load_fmu(tmp_path / "nowhere.fmu")


def archive(path: Path, **files: str) -> Path:
    with zipfile.ZipFile(path, "w") as stream:
        for name, text in files.items():
            stream.writestr(name.replace("_", "."), text)
    return path


def description(**attributes: str) -> str:
    options = {"fmiVersion": "2.0", "modelName": "m", "guid": "g", **attributes}
    text = " ".join(f'{k}="{v}"' for k, v in options.items())
    inner = '<CoSimulation modelIdentifier="m"/><ModelVariables/><ModelStructure/>'
    return f"<fmiModelDescription {text}>{inner}</fmiModelDescription>"


def test_files_that_are_no_fmu_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "text.fmu"
    path.write_text("not a zip file")
    for bad in (path, archive(tmp_path / "empty.fmu", other_txt="x")):
        with pytest.raises(FmuError, match=r"not a readable FMU[\s\S]*\.fmu[\s\S]*got:"):
            load_fmu(bad)


@pytest.mark.parametrize(
    "text",
    ["<broken", '<fmiModelDescription fmiVersion="1.0" modelName="m" guid="g" modelIdentifier="m"/>'],
    ids=["broken XML", "FMI 1.0"],
)
def test_descriptions_that_cannot_be_read_are_refused(tmp_path: Path, text: str) -> None:
    path = archive(tmp_path / "bad.fmu", modelDescription_xml=text)
    try:
        with pytest.raises(FmuError, match=r"not a readable FMU|version is not supported"):
            load_fmu(path)
    except (SyntaxError, TypeError) as error:  # from lxml and FMPy, which then leave the file open
        kind = type(error).__name__
    else:
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()
    pytest.fail(f"{kind} instead of FmuError")


def test_fmus_without_a_binary_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))
    path = archive(tmp_path / "bare.fmu", modelDescription_xml=description())
    here = Path.cwd()
    with pytest.raises(FmuError, match=r"cannot be loaded[\s\S]*binary for this platform"):
        load_fmu(path).instantiate()
    assert Path.cwd() == here


def test_fmu_without_binary_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))
    text = description().replace("CoSimulation", "ModelExchange")
    with pytest.raises(FmuError, match="no co-simulation interface"):
        load_fmu(archive(tmp_path / "me.fmu", modelDescription_xml=text))


@pytest.mark.parametrize("kind", FMUS)
def test_an_error_of_the_fmu_is_passed_on_with_its_message(kind: str) -> None:
    instance = part(kind, "scara").instantiate()
    begin(instance, np.zeros(2))
    instance.inputs[:] = [np.nan, 0.0]
    instance.set()
    with pytest.raises(SimulationError, match=r"fmi\dDoStep at t = 0\.25 s of the FMU returned Error[\s\S]*not finite"):
        instance.step(0.25, PERIOD)
    instance.close()
    instance.close()  # once more does no harm


@pytest.mark.parametrize("kind", FMUS)
def test_a_singular_plant_is_refused_by_the_fmu(kind: str) -> None:
    """Without any inertia the acceleration is not defined."""
    massless = part(kind, "sledge").with_parameters({"M1": 0.0})
    with pytest.raises(SimulationError, match=r"of the FMU returned Error[\s\S]*got:"):
        drive(massless, np.ones((2, 1)), PERIOD)


def test_fmus_are_known_by_their_content(tmp_path: Path) -> None:
    first = load_fmu(build_fmu(block("sledge")))
    copy = load_fmu(build_fmu(block("sledge"), directory=tmp_path))
    other = load_fmu(build_fmu(block("scara")))
    assert first.describe()["sha256"] == copy.describe()["sha256"] != other.describe()["sha256"]


# ---- the user's own python-control systems ---------------------------------------------------------

A, B, C, D = np.array([[0.0, 1.0], [-20.0, -3.0]]), np.array([[0.0], [4.0]]), np.array([[1.0, 0.0]]), np.array([[0.5]])
PULSES = np.array([[1.0], [1.0], [-2.0], [0.5], [0.0], [0.0], [3.0], [-1.0]] * 5)
STEP = 0.01


def exact(a: np.ndarray, b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Outputs of the continuous system under held inputs, by the matrix exponential."""
    n = len(a)
    e = expm(np.block([[a, b], [np.zeros((1, n + 1))]]) * STEP)
    result = []
    for u in PULSES:
        result.append(C @ x + D @ u)
        x = e[:n, :n] @ x + e[:n, n:] @ u
    return np.array(result)


def test_continuous_state_space_against_the_exact_solution() -> None:
    got = drive(wrap_control(control.ss(A, B, C, D), initial_state=(0.3, -1.0)), PULSES, STEP)
    np.testing.assert_allclose(got, exact(A, B, np.array([0.3, -1.0])), rtol=0, atol=1e-9)


def test_the_exact_solution_is_approached_with_the_fourth_order() -> None:
    made = wrap_control(control.ss(A, B, C, D), substeps=1)
    wanted = exact(A, B, np.zeros(2))
    errors = [np.abs(drive(c, PULSES, STEP) - wanted).max() for c in (made, made.with_substeps(2))]
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.15)


def test_transfer_function_against_the_exact_solution() -> None:
    """0.5 + 4 / (s^2 + 3 s + 20)."""
    system = control.tf([0.5, 1.5, 14.0], [1.0, 3.0, 20.0])
    np.testing.assert_allclose(drive(wrap_control(system), PULSES, STEP), exact(A, B, np.zeros(2)), rtol=0, atol=1e-9)


def test_discrete_transfer_function() -> None:
    """y[k] = 0.9 y[k-1] + u[k] + 0.5 u[k-1]."""
    made = wrap_control(control.tf([1.0, 0.5], [1.0, -0.9], STEP), origin="filter")
    assert made.sample_time == STEP
    y, last, wanted = 0.0, 0.0, []
    for u in PULSES[:, 0]:
        y, last = 0.9 * y + u + 0.5 * last, u
        wanted.append(y)
    np.testing.assert_allclose(drive(made, PULSES, STEP)[:, 0], wanted, rtol=1e-12, atol=1e-12)


def test_discrete_state_space_with_several_signals() -> None:
    a, b = np.array([[0.5, 0.1], [0.0, 0.8]]), np.array([[1.0, 0.0], [0.3, -1.0]])
    system = control.ss(a, b, np.eye(2), 0.1 * b, STEP, inputs=["u1", "u2"], outputs=["y1", "y2"])
    made = wrap_control(system, initial_state=(1.0, 2.0))
    assert [v.name for v in made.inputs] == ["u1", "u2"]
    assert [v.name for v in made.outputs] == ["y1", "y2"]
    u, x, wanted = np.random.default_rng(1).normal(size=(30, 2)), np.array([1.0, 2.0]), []
    for row in u:
        wanted.append(x + 0.1 * b @ row)
        x = a @ x + b @ row
    np.testing.assert_allclose(drive(made, u, STEP), wanted, rtol=1e-12)


def rate_of(t: float, x: np.ndarray, u: np.ndarray, params: dict[str, float]) -> np.ndarray:
    return -params["a"] * x + t * u


def test_nonlinear_continuous_system_with_time_and_parameters() -> None:
    """dx/dt = -a x + t u under u = 1: x = t/a - 1/a^2 + (x0 + 1/a^2) exp(-a t)."""
    system = control.nlsys(rate_of, None, inputs=["u"], outputs=["x"], states=1, params={"a": 2.0})
    made = wrap_control(system, initial_state=(1.0,))
    times = np.arange(60) * STEP
    for a, c in ((2.0, made), (3.0, made.with_parameters({"a": 3.0}))):
        wanted = times / a - 1 / a**2 + (1 + 1 / a**2) * np.exp(-a * times)
        np.testing.assert_allclose(drive(c, np.ones((60, 1)), STEP)[:, 0], wanted, rtol=0, atol=1e-9)
    with pytest.raises(UnknownNameError, match="no parameter named 'b'"):
        made.with_parameters({"b": 1.0})


def test_nonlinear_discrete_system() -> None:
    """x[k+1] = r x (1 - x) + u, y = x^2."""
    system = control.nlsys(
        lambda t, x, u, p: p["r"] * x * (1 - x) + u, lambda t, x, u, p: x**2,
        inputs=1, outputs=1, states=1, dt=STEP, params={"r": 3.1},
    )  # fmt: skip
    x, wanted = 0.4, []
    for _ in range(30):
        wanted.append(x**2)
        x = 3.1 * x * (1 - x) + 0.01
    got = drive(wrap_control(system, initial_state=(0.4,)), np.full((30, 1), 0.01), STEP)
    np.testing.assert_allclose(got[:, 0], wanted, rtol=1e-12)


def test_static_gain() -> None:
    made = wrap_control(control.ss([], [], [], [[2.0, -1.0]]))
    np.testing.assert_allclose(drive(made, np.array([[1.0, 3.0], [2.0, 0.5]]), STEP), [[-1.0], [3.5]])


@pytest.mark.parametrize(
    ("system", "options", "problem"),
    [
        ("PD", {}, r"not a python-control system[\s\S]*where: mine[\s\S]*got:   str"),
        (control.frd([1, 2], [1, 2]), {}, "got:   FrequencyResponseData"),
        (control.ss([[1]], [[1]], [[1]], [[0]], True), {}, r"needs its sample time[\s\S]*dt = True"),
        (control.ss(A, B, C, D), {"initial_state": (1.0,)}, r"another size[\s\S]*got:   1[\s\S]*valid: 2"),
    ],
)
def test_other_objects_are_refused(system: Any, options: dict[str, Any], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        wrap_control(system, origin="mine", **options)


@pytest.mark.parametrize(
    "make",
    [lambda: control.tf([1, 0], [1]), lambda: control.nlsys(lambda t, x, u, p: -x, None)],
    ids=["improper", "sizes unknown"],
)
def test_systems_that_cannot_be_simulated_are_refused(make: Any) -> None:
    with pytest.raises(InputError):
        wrap_control(make(), origin="mine")


# ---- blocks as python-control systems --------------------------------------------------------------


def test_linear_plants_become_state_space() -> None:
    """dv/dt = (F - Fv v) / M with M = 2, Fv = 3."""
    system = to_control(block("sledge"))
    assert isinstance(system, control.StateSpace)
    np.testing.assert_allclose(system.A, [[0, 1], [0, -1.5]], atol=1e-15)
    np.testing.assert_allclose(system.B, [[0], [0.5]], atol=1e-15)
    np.testing.assert_allclose(system.D[2], [0.5], atol=1e-15)
    assert system.dt == 0
    assert not isinstance(to_control(block("scara")), control.StateSpace)


class OfLaterNumpy(np.ndarray):
    """An array whose shape cannot be set, as numpy 2.5 announces."""

    @property
    def shape(self) -> tuple[int, ...]:
        return self.view(np.ndarray).shape


def test_linear_blocks_without_states_set_no_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    """Made, changed and sent to another process, with arrays of which python-control cannot set the shape."""
    matrix = control.statesp._ssmatrix
    monkeypatch.setattr(control.statesp, "_ssmatrix", lambda *a, **o: matrix(*a, **o).view(OfLaterNumpy))
    with pytest.raises(AttributeError):
        matrix([[1.0]]).view(OfLaterNumpy).shape = (1,)
    system = to_control(scara_pd())
    assert isinstance(system, control.StateSpace)
    assert (system.nstates, system.A.shape, system.B.shape, system.C.shape) == (0, (0, 0), (0, 8), (2, 0))
    assert (system.state_labels, system.input_labels) == ([], [v.name for v in scara_pd().inputs])
    assert (system.dt, system.name) == (PERIOD, "pd_test")
    inputs = np.random.default_rng(1).normal(size=(4, 8))
    wanted = drive(ModelComponent(scara_pd()), inputs, PERIOD)
    made = block_as_control(scara_pd())
    for each in (made, made.with_parameters({}), pickle.loads(pickle.dumps(made))):
        np.testing.assert_allclose(drive(each, inputs, PERIOD), wanted, rtol=1e-14)


def test_nonlinear_plants_take_parameters_of_python_control() -> None:
    """The sources of a nonlinear system can be used with python-control alone."""
    system = to_control(block("scara"))
    values = dict(system.params)
    x, u = np.array([0.1, 0.2, 0.3, -0.4]), np.array([1.0, 0.5])
    model = scara()
    for inertia in (3.43, 6.0):
        chi = model.parameter_values
        chi[model.parameter_index("ZZ1")] = inertia
        wanted = model.direct(x[:2], x[2:], u, chi, model.shape_values).full().ravel()
        got = system.dynamics(0.0, x, u, params={**values, "ZZ1": inertia})
        np.testing.assert_allclose(got, [0.3, -0.4, *wanted], rtol=1e-13)


def test_block_components_name_their_origin() -> None:
    assert block_as_control(block("pd")).describe()["origin"] == f"block '{block('pd').name}'"
