"""Control laws: block, python-control system and FMU against the stated law in plain numpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.components import to_control
from fmu_didim.controllers import LAWS, read_controller
from fmu_didim.dynamics.block import Block
from tests.helpers import KINDS, PERIOD, ROOT, component, drive, law_block

SAMPLES = 50
Signals = dict[str, np.ndarray]
"""Arrays (n,) of one instant: q_ref, dq_ref, ddq_ref, q, dq."""
Law = Callable[[list[Signals]], np.ndarray]


# ---- the laws again, as they are stated ------------------------------------------------------------


def velocity(history: list[Signals], kind: str) -> np.ndarray:
    """Measured, or the backward difference, whose first value is the velocity of the reference."""
    now = history[-1]
    if kind == "measured":
        return now["dq"]
    return now["dq_ref"] if len(history) == 1 else (now["q"] - history[-2]["q"]) / PERIOD


def pd(o: Mapping[str, Any]) -> Law:
    def law(h: list[Signals]) -> np.ndarray:
        s = h[-1]
        error = s["q_ref"] - s["q"]
        if o["velocity"] == "error_difference":
            before = h[-2] if len(h) > 1 else s
            rate = (error - (before["q_ref"] - before["q"])) / PERIOD
        else:
            rate = s["dq_ref"] - velocity(h, o["velocity"])
        return np.multiply(o["Kp"], error) + np.multiply(o["Kd"], rate)

    return law


def pid(o: Mapping[str, Any]) -> Law:
    def law(h: list[Signals]) -> np.ndarray:
        integral = PERIOD * sum((s["q_ref"] - s["q"] for s in h[:-1]), np.zeros(len(o["joints"])))
        return pd(o)(h) + np.multiply(o["Ki"], integral)

    return law


def cascade(o: Mapping[str, Any]) -> Law:
    def error(h: list[Signals]) -> np.ndarray:
        wanted = np.multiply(o["Kv"], h[-1]["q_ref"] - h[-1]["q"]) + o["feedforward"] * h[-1]["dq_ref"]
        return wanted - velocity(h, o["velocity"])

    def law(h: list[Signals]) -> np.ndarray:
        integral = PERIOD * sum((error(h[: k + 1]) for k in range(len(h) - 1)), np.zeros(len(o["joints"])))
        return np.multiply(o["Kp"], error(h)) + np.multiply(o["Ki"], integral)

    return law


def low_passed(history: list[np.ndarray], constants: Any) -> np.ndarray:
    """First-order low-pass of a signal, settled before its first value."""
    decay, y = np.exp(-PERIOD / np.array(constants)), history[0]
    for value in history:
        y = decay * y + (1 - decay) * value
    return np.asarray(y)


def with_extras(law: Callable[[Mapping[str, Any]], Law]) -> Callable[[Mapping[str, Any]], Law]:
    """A law with feed-forward of the acceleration and a lag of the command."""

    def options(o: Mapping[str, Any]) -> Law:
        def command(h: list[Signals]) -> np.ndarray:
            raw = [law(o)(h[: k + 1]) + np.multiply(o["acceleration"], h[k]["ddq_ref"]) for k in range(len(h))]
            return low_passed(raw, o["lag_s"])

        return command

    return options


def pid_filtered(o: Mapping[str, Any]) -> Law:
    """PID whose rate of the error is filtered."""

    def rate(h: list[Signals]) -> np.ndarray:
        before = h[-2] if len(h) > 1 else h[-1]
        change = (h[-1]["q_ref"] - h[-1]["q"]) - (before["q_ref"] - before["q"])
        return np.asarray(change / PERIOD)

    def law(h: list[Signals]) -> np.ndarray:
        filtered = low_passed([rate(h[: k + 1]) for k in range(len(h))], o["filter_s"])
        rest = pid({**o, "Kd": [0.0, 0.0]})(h)
        return rest + np.multiply(o["Kd"], filtered)

    return law


def cascade_filtered(o: Mapping[str, Any]) -> Law:
    """Cascade whose measured velocity is filtered, with a feed-forward for each joint."""

    def error(h: list[Signals]) -> np.ndarray:
        velocities = low_passed([s["dq"] for s in h], o["filter_s"])
        wanted = np.multiply(o["Kv"], h[-1]["q_ref"] - h[-1]["q"])
        return wanted + np.multiply(o["feedforward"], h[-1]["dq_ref"]) - velocities

    def law(h: list[Signals]) -> np.ndarray:
        integral = PERIOD * sum((error(h[: k + 1]) for k in range(len(h) - 1)), np.zeros(len(o["joints"])))
        return np.multiply(o["Kp"], error(h)) + np.multiply(o["Ki"], integral)

    return law


def scara_torque(q: np.ndarray, dq: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Closed form of the planar arm in fmus/scara/robot.yaml, Lagrange's equations by hand."""
    zz1, zz2, mx, my, length = 3.43, 0.063, 0.241, 0.014, 0.5
    fv, fc = np.array([0.03, 0.013]), np.array([0.82, 0.137])
    along = length * (mx * np.cos(q[1]) - my * np.sin(q[1]))
    across = length * (mx * np.sin(q[1]) + my * np.cos(q[1]))
    rigid = [
        (zz1 + zz2 + 2 * along) * a[0] + (zz2 + along) * a[1] - across * (2 * dq[0] * dq[1] + dq[1] ** 2),
        (zz2 + along) * a[0] + zz2 * a[1] + across * dq[0] ** 2,
    ]
    return np.array(rigid) + fv * dq + fc * np.tanh(dq / 0.02)


def computed_torque(o: Mapping[str, Any]) -> Law:
    def law(h: list[Signals]) -> np.ndarray:
        s, dq = h[-1], velocity(h, o["velocity"])
        return scara_torque(s["q"], dq, s["ddq_ref"] + o["Kd"] * (s["dq_ref"] - dq) + o["Kp"] * (s["q_ref"] - s["q"]))

    return law


def emps(o: Mapping[str, Any]) -> Law:
    def law(h: list[Signals]) -> np.ndarray:
        q = [h[0]["q"]] * 2 + [s["q"] for s in h]  # at rest before the start
        filtered = [(q[-1] + q[-2]) / 2, (q[-2] + q[-3]) / 2]
        return np.multiply(o["kv"], np.multiply(o["kp"], h[-1]["q_ref"] - q[-1]) - (filtered[0] - filtered[1]) / PERIOD)

    return law


# ---- the cases -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """Options of a law, the law in plain numpy, and whether its equations are linear."""

    label: str
    options: Mapping[str, Any]
    law: Callable[[Mapping[str, Any]], Law]
    linear: bool


TWO: Mapping[str, Any] = {"joints": ["revolute", "prismatic"]}
ARM: Mapping[str, Any] = {"joints": ["revolute", "revolute"]}
DIFFERENCE = {"velocity": "backward_difference"}
OF_ERROR = {"velocity": "error_difference"}
MEASURED = {"velocity": "measured"}
PD_OPTIONS = {"law": "pd", **TWO, "Kp": [30.0, 7.0], "Kd": [2.0, 0.5]}
PID_OPTIONS = {"law": "pid", **TWO, "Kp": [30.0, 7.0], "Ki": [90.0, 50.0], "Kd": [2.0, 0.5]}
CASCADE_OPTIONS = {"law": "cascade_ppi", **TWO, "Kv": [9.0, 4.0], "Kp": [3.0, 2.0], "Ki": [40.0, 10.0]}
CT_OPTIONS = {"law": "computed_torque", **ARM, "robot": "fmus/scara/robot.yaml"}
CT_OPTIONS |= {"Kp": [100.0, 150.0], "Kd": [20.0, 25.0]}
EMPS_OPTIONS = {"law": "emps", **TWO, "kp": [12.0, 5.0], "kv": [2.0, 1.5]}
LAGGED = {"acceleration": [0.4, 0.7], "lag_s": [0.004, 0.011]}
FILTERED = {"filter_s": [0.008, 0.003]}
SHARES = {"feedforward": [0.6, 0.9]}
CASES = (
    Case("pd", PD_OPTIONS | MEASURED, pd, True),
    Case("pd_difference", PD_OPTIONS | DIFFERENCE, pd, True),
    Case("pd_error_difference", PD_OPTIONS | OF_ERROR, pd, True),
    Case("pd_saturated", PD_OPTIONS | MEASURED | {"saturation": [20.0, 3.0]}, pd, False),
    Case("pid", PID_OPTIONS | MEASURED, pid, True),
    Case("pid_difference_saturated", PID_OPTIONS | DIFFERENCE | {"saturation": [100.0, 40.0]}, pid, False),
    Case("pid_error_difference", PID_OPTIONS | OF_ERROR, pid, True),
    Case("cascade", CASCADE_OPTIONS | MEASURED | {"feedforward": 0.6}, cascade, True),
    Case("cascade_difference", CASCADE_OPTIONS | DIFFERENCE | {"feedforward": 1.0}, cascade, True),
    Case("pd_acceleration_lag", PD_OPTIONS | MEASURED | LAGGED, with_extras(pd), True),
    Case("pid_filtered", PID_OPTIONS | OF_ERROR | FILTERED, pid_filtered, True),
    Case("cascade_filtered", CASCADE_OPTIONS | MEASURED | FILTERED | SHARES, cascade_filtered, True),
    Case("computed_torque", CT_OPTIONS | MEASURED, computed_torque, False),
    Case("computed_torque_difference", CT_OPTIONS | DIFFERENCE, computed_torque, False),
    Case("emps", EMPS_OPTIONS, emps, True),
    Case("emps_saturated", EMPS_OPTIONS | {"saturation": [300.0, 200.0]}, emps, False),
)
each_case = pytest.mark.parametrize("case", CASES, ids=[case.label for case in CASES])


@cache
def block_of(label: str) -> Block:
    case = next(c for c in CASES if c.label == label)
    return law_block(**{**case.options, "name": label})


def samples(block: Block) -> tuple[list[Signals], np.ndarray]:
    """Random signals over the samples, and the same as rows of the block's inputs."""
    rng = np.random.default_rng(11)
    history = [{name: rng.normal(size=2) for name in ("q_ref", "dq_ref", "ddq_ref", "q", "dq")} for _ in range(SAMPLES)]
    names = [v.name for v in block.inputs]
    return history, np.array([[s[name[:-1]][int(name[-1]) - 1] for name in names] for s in history])


def expected(case: Case, history: list[Signals]) -> np.ndarray:
    """(N, 2) commands of the law in plain numpy, one instant after another."""
    raw = np.array([case.law(case.options)(history[: k + 1]) for k in range(SAMPLES)])
    limit = np.array(case.options.get("saturation", [np.inf, np.inf]))
    # The test is about saturation only if some commands are limited and others are not.
    share = (np.abs(raw) > limit).mean()
    assert (0.2 < share < 0.9) if "saturation" in case.options else share == 0
    return np.clip(raw, -limit, limit)


def close(got: np.ndarray, wanted: np.ndarray) -> None:
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


def test_every_law_has_a_case() -> None:
    assert {case.options["law"] for case in CASES} == set(LAWS)


@pytest.mark.gate
@each_case
@pytest.mark.parametrize("kind", KINDS)
def test_the_block_is_the_stated_law(case: Case, kind: str) -> None:
    block = block_of(case.label)
    history, rows = samples(block)
    wanted = expected(case, history)
    close(drive(component(kind, block), rows, PERIOD, start=0.7), wanted)
    assert [v.name for v in block.outputs] == ["command1", "command2"]


@each_case
def test_control_systems_are_linear_where_the_law_is(case: Case) -> None:
    """The system itself, simulated by python-control from the state that belongs to the first sample."""
    block = block_of(case.label)
    system = to_control(block)
    assert isinstance(system, control.StateSpace) == case.linear
    assert isinstance(system, control.NonlinearIOSystem)
    assert system.dt == PERIOD
    assert system.input_labels == [v.name for v in block.inputs]
    assert system.state_labels == [v.name for v in block.states]
    history, rows = samples(block)
    start = block.start(rows[0], block.parameter_values).full().ravel()
    response = control.input_output_response(system, np.arange(SAMPLES) * PERIOD, rows.T, start if start.size else 0)
    close(np.atleast_2d(response.outputs).T, expected(case, history))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("label", ["pid_difference_saturated", "computed_torque"])
def test_gains_are_parameters(label: str, kind: str) -> None:
    case = next(c for c in CASES if c.label == label)
    block = block_of(label)
    history, rows = samples(block)
    part = component(kind, block).with_parameters({"Kp2": 11.0, "Kd1": 0.25})
    options = {**case.options, "Kp": [case.options["Kp"][0], 11.0], "Kd": [0.25, case.options["Kd"][1]]}
    close(drive(part, rows, PERIOD), expected(Case(label, options, case.law, False), history))


def test_model_values_of_computed_torque_are_parameters() -> None:
    block = block_of("computed_torque")
    rows = np.zeros((1, len(block.inputs)))
    rows[0, [v.name for v in block.inputs].index("ddq_ref1")] = 1.0
    inertia = drive(component("model", block), rows, PERIOD)[0, 0]
    assert inertia == pytest.approx(3.43 + 0.063 + 0.241)
    heavier = component("model", block).with_parameters({"model_ZZ1": 4.43})
    assert drive(heavier, rows, PERIOD)[0, 0] == pytest.approx(inertia + 1.0)


def test_velocity_is_no_input_when_it_is_differentiated() -> None:
    names = {v.name for v in block_of("pd_difference").inputs}
    assert names == {"q_ref1", "dq_ref1", "q1", "q_ref2", "dq_ref2", "q2"}
    assert {v.name for v in block_of("emps").inputs} == {"q_ref1", "q1", "q_ref2", "q2"}


def test_units_follow_the_joints() -> None:
    units = {v.name: v.unit for v in law_block(**PD_OPTIONS, command_unit="V").inputs}
    assert (units["q1"], units["dq_ref1"], units["q2"], units["dq2"]) == ("rad", "rad/s", "m", "m/s")
    assert [v.unit for v in law_block(**PD_OPTIONS, command_unit="V").outputs] == ["V", "V"]


# ---- documents ------------------------------------------------------------------------------------


def document(tmp_path: Path, text: str) -> Path:
    (tmp_path / "controller.yaml").write_text(text)
    return tmp_path / "controller.yaml"


GOOD = "law: pd\nname: c\njoints: [revolute, revolute]\nrate_hz: 200\nKp: [1, 2]\nKd: [3, 4]\n"


def test_document_is_read(tmp_path: Path) -> None:
    block = read_controller(document(tmp_path, GOOD))
    assert block.sample_time == 0.005
    assert {v.name: v.start for v in block.parameters} == {"Kp1": 1, "Kp2": 2, "Kd1": 3, "Kd2": 4}


def test_robot_file_is_found_beside_the_document(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text((ROOT / "fmus/scara/robot.yaml").read_text())
    text = GOOD.replace("law: pd", "law: computed_torque\nrobot: arm.yaml")
    assert "model_ZZ1" in {v.name for v in read_controller(document(tmp_path, text)).parameters}


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("Kp: [1, 2]", "Kp: [1, 2, 3]"), "Kp has 3 values for 2 joints"),
        (("Kd: [3, 4]", "Kd: [3]"), "Kd has 1 values for 2 joints"),
        (("rate_hz: 200", "rate_hz: 200\nsaturation: [1]"), "saturation has 1 values for 2 joints"),
        (("rate_hz: 200", "rate_hz: 200\nsaturation: [1, -2]"), r"saturation\.1: .*greater than 0"),
        (("Kd: [3, 4]\n", ""), "Kd: this key is required"),
        (("Kd:", "Kdd:"), r"Kdd: unknown key\. Did you mean 'Kd'\?"),
        (("rate_hz: 200", "rate_hz: 0"), "rate_hz: .*greater than 0"),
        (("name: c", "name: 2c"), "name: "),
        (("revolute, revolute", "revolute, revolving"), r"joints\.1: "),
        (
            ("rate_hz: 200", "rate_hz: 200\nvelocity: guessed"),
            "velocity: .*'measured', 'backward_difference' or 'error_difference'",
        ),
    ],
)
def test_wrong_documents_name_the_key(tmp_path: Path, change: tuple[str, str], problem: str) -> None:
    with pytest.raises(InputError, match=problem) as caught:
        read_controller(document(tmp_path, GOOD.replace(*change)))
    assert "controller.yaml" in str(caught.value)


def test_all_problems_are_listed_at_once(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_controller(document(tmp_path, GOOD.replace("rate_hz", "rate").replace("Kd", "K_d")))
    for text in ("has 4 problems", "rate_hz: this key", "Kd: this key", "rate: unknown key", "K_d: unknown key"):
        assert text in str(caught.value)


@pytest.mark.parametrize(("law", "hint"), [("law: pdd", "Did you mean 'pd'"), ("", "pd, pid, cascade_ppi")])
def test_unknown_laws_are_refused(tmp_path: Path, law: str, hint: str) -> None:
    with pytest.raises(UnknownNameError, match="no control law named") as caught:
        read_controller(document(tmp_path, GOOD.replace("law: pd", law)))
    assert hint in str(caught.value)


def test_a_robot_of_other_size_is_refused() -> None:
    with pytest.raises(InputError):
        law_block(**{**CT_OPTIONS, "joints": ["revolute"], "Kp": [1.0], "Kd": [1.0]})
