"""A plant given apart from the robot description: does it agree, do its parameters act, what are they called."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
import yaml

from fmu_didim import identify, simulate
from fmu_didim.base.errors import InputError, SimulationError, UnknownNameError
from fmu_didim.case import load_case
from fmu_didim.checks.plant.consistency import Consistency, check_consistency
from fmu_didim.checks.plant.influence import check_parameter_influence
from fmu_didim.checks.plant.start import start_diagnostics
from fmu_didim.components import FmuComponent, ModelComponent, block_as_control, load_fmu, wrap_control
from fmu_didim.components.parameter_names import name_parameters
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.export import build_fmu
from fmu_didim.fit.estimate import RefusedError
from fmu_didim.report import result_table, write_report
from fmu_didim.results.result import read_result
from tests.awkward.build import awkward_fmu
from tests.cases import SCARA, plant_case, scara_case
from tests.helpers import NEAR, drive, model_of, with_component

ROBOT = Path("fmus/scara/robot.yaml")
VENDOR = {
    "ZZ1": "axis[1].J", "Fv1": "axis[1].friction.d", "Fc1": "axis[1].friction.c", "ZZ2": "axis[2].J", "MX2": "arm.mx",
    "MY2": "arm.my", "Fv2": "axis[2].friction.d", "Fc2": "axis[2].friction.c", "Ia1": "motor[1].J", "M2": "arm.m",
    "q_start1": "axis[1].phi.start", "q_start2": "axis[2].phi.start", "dq_start1": "axis[1].w.start",
    "dq_start2": "axis[2].w.start",
}  # fmt: skip


def block(**changes: Any) -> Block:
    """The SCARA with another description."""
    return RobotModel(read_robot(ROBOT).model_copy(update=changes)).block()


def longer_link() -> Block:
    first, second = read_robot(ROBOT).joints
    return block(joints=(first, second.model_copy(update={"a": 0.55})))


def renamed(own: Block, names: dict[str, str]) -> Block:
    """The block with other names of its parameters: a vendor's plant."""

    def new(name: str) -> str:
        return names.get(name, name)

    return replace(
        own, name="vendor", parameters=tuple(replace(v, name=new(v.name)) for v in own.parameters),
        fixed=frozenset(new(name) for name in own.fixed),
    )  # fmt: skip


def with_fixed(own: Block, names: set[str]) -> Block:
    """The block with parameters that cannot be changed in a run."""
    return replace(own, fixed=own.fixed | names)


def without_effect(own: Block, *names: str) -> Block:
    """The block whose parameters of these names are there but stay at their start values in the equations."""
    import casadi as ca

    p = ca.SX.sym("p", len(own.parameters))
    used = ca.vertcat(*(v.start if v.name in names else p[i] for i, v in enumerate(own.parameters)))
    x, u = ca.SX.sym("x", len(own.states)), ca.SX.sym("u", len(own.inputs))
    return replace(
        own, update=ca.Function("update", [x, u, p], [own.update(x, u, used)]),
        output=ca.Function("output", [x, u, p], [own.output(x, u, used)]), balance=None, implicit=None,
    )  # fmt: skip


def case_with(folder: Path, own: Block, **plant: Any) -> Path:
    """The SCARA example whose plant is the FMU of this block."""
    return scara_case(folder, plant={"kind": "fmu", "source": str(build_fmu(own, directory=folder)), **plant})


def compared(path: Path) -> Consistency:
    return check_consistency(model_of(path))


# Consistency


@pytest.mark.gate
@pytest.mark.parametrize(
    "options", [{}, {"interface": "model-exchange", "substeps": 8}], ids=["co-simulation", "model exchange"]
)
def test_fmu_of_the_same_robot_agrees(tmp_path: Path, options: dict[str, Any]) -> None:
    found = compared(case_with(tmp_path, block(), **options))
    assert found.warnings() == []
    assert found.points == 20
    assert found.method == "probed"
    assert found.columns is not None
    assert list(found.columns) == ["ZZ1R", "Fv1", "Fc1", "ZZ2", "MX2", "MY2", "Fv2", "Fc2"]
    assert found.worst < 1e-6


@pytest.mark.gate
def test_python_control_plant_agrees(tmp_path: Path) -> None:
    path = scara_case(tmp_path, plant={"kind": "control", "source": "mine.py:plant"})
    (tmp_path / "mine.py").write_text(
        "from fmu_didim import read_robot, to_control\nfrom fmu_didim.dynamics.robot import RobotModel\n"
        f"plant = to_control(RobotModel(read_robot({str(ROBOT.resolve())!r})).block())\n",
        encoding="utf-8",
    )
    found = compared(path)
    assert found.warnings() == []
    assert found.worst < 1e-6


@pytest.mark.gate
def test_parameters_fixed_in_a_run_are_compared_by_simulating_again(tmp_path: Path) -> None:
    """An FMU without derivatives, whose parameters act from the initialisation only."""

    def again(own: Block) -> Consistency:
        model = model_of(case_with(tmp_path, with_fixed(own, {v.name for v in own.parameters})))
        assert isinstance(model.loop.plant, FmuComponent)
        return check_consistency(with_component(model, "plant", replace(model.loop.plant, has_derivatives=False)))

    found = again(block())
    assert found.method == "simulated again"
    assert found.warnings() == []
    assert found.worst < 1e-6
    assert found.columns is not None
    assert len(found.columns) == 8
    longer = again(longer_link())
    assert any(line.startswith("MX2: the column differs most at joint 1") for line in longer.warnings())
    assert any(
        line == "Fc2: it has no effect in the plant" for line in again(without_effect(block(), "Fc2")).warnings()
    )


@pytest.mark.gate
def test_longer_link_is_told_by_parameter_and_joint(tmp_path: Path) -> None:
    found = compared(case_with(tmp_path, longer_link()))
    text = "\n".join(found.warnings())
    assert "MX2: the column differs most at joint 1" in text
    assert "MY2: the column differs most at joint 1" in text
    assert "torque: differs by" in text
    assert "at joint 1" in text
    assert found.columns is not None
    assert found.columns["MX2"].size == pytest.approx(1.1, abs=0.05)
    for same in ("ZZ1R", "Fv1", "Fc1", "ZZ2", "Fv2", "Fc2"):
        assert found.columns[same].difference < 1e-6


@pytest.mark.gate
def test_other_gravity_is_told(tmp_path: Path) -> None:
    found = compared(case_with(tmp_path, block(gravity=(0.0, 2.0, 0.0))))
    assert found.warnings()[-1] == "gravity: (0, 2, 0) m/s2 in the plant would explain the torque"


@pytest.mark.gate
def test_constant_that_is_not_identified_is_told(tmp_path: Path) -> None:
    """A second mass hidden in the plant: its inertia is neither in the description nor set by it."""
    own = renamed(block(), {"Ia1": "motor"}).with_parameters({"motor": 0.7})
    text = "\n".join(compared(case_with(tmp_path, own)).warnings())
    assert "torque: differs by" in text
    assert "Ia1: 0.7 instead of 0 would explain the torque" in text


@pytest.mark.gate
def test_parameter_without_effect_is_told(tmp_path: Path) -> None:
    text = "\n".join(compared(case_with(tmp_path, without_effect(block(), "Fc2"))).warnings())
    assert "Fc2: it has no effect in the plant" in text


def test_without_accelerations_the_torque_is_compared_by_differences(tmp_path: Path) -> None:
    outputs = {"outputs": {"a1": "ddq1", "a2": "ddq2"}}
    found = compared(case_with(tmp_path, block(), **outputs))
    assert found.by_differences
    assert found.warnings() == []
    assert 1e-6 < found.worst < 5e-2
    assert any("MX2" in line for line in compared(case_with(tmp_path, longer_link(), **outputs)).warnings())


def test_start_that_cannot_be_simulated_is_replaced_by_the_reference(tmp_path: Path) -> None:
    path = case_with(tmp_path, block())
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    robot = yaml.safe_load(ROBOT.read_text(encoding="utf-8"))
    robot["joints"][0]["parameters"]["ZZ"] = -1.0
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot), encoding="utf-8")
    content["robot"] = "robot.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    found = compared(path)
    assert found.points == 20
    assert found.warnings() == []


@pytest.mark.gate
def test_result_table_and_report_tell_it(tmp_path: Path) -> None:
    outcome = identify(case_with(tmp_path, block()), out=tmp_path / "out")
    assert outcome.document.consistency is not None
    assert outcome.document.consistency.agrees
    assert "the plant agrees with the robot description to " in result_table(outcome.document)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "The plant agrees with the robot description to " in page
    unlike = identify(case_with(tmp_path, longer_link()), out=tmp_path / "unlike").document
    assert unlike.status == "converged"  # a warning, no refusal
    assert unlike.consistency is not None
    text = result_table(unlike)
    assert "the plant differs from the robot description" in text
    assert "[plant-differs]" in text
    assert "\nDOUBTFUL: converged" in text
    assert "MX2: the column differs most at joint 1" in text
    assert max(map(len, text.splitlines())) <= 100
    page = write_report(tmp_path / "unlike").read_text(encoding="utf-8")
    assert "The plant differs from the robot description" in page
    assert "MX2: the column differs most at joint 1" in page


def test_refusal_says_that_the_plant_differs(tmp_path: Path) -> None:
    """A plant with a link of three metres cannot be identified with this description."""
    first, second = read_robot(ROBOT).joints
    heavy = second.model_copy(update={"a": -3.0})
    with pytest.raises(RefusedError, match=r"found before: plant: MX2: the column differs") as caught:
        identify(case_with(tmp_path, block(joints=(first, heavy))), out=tmp_path / "out")
    assert caught.value.iterations
    saved = read_result(tmp_path / "out")
    assert saved.status == "refused"
    assert saved.consistency is not None
    assert not saved.consistency.agrees


def test_plant_made_from_the_description_is_not_compared() -> None:
    assert identify(SCARA).document.consistency is None


# Names of a vendor


@pytest.mark.gate
@pytest.mark.parametrize("estimator", ["didim", "clie"])
def test_vendor_names_give_the_same_result(tmp_path: Path, estimator: str) -> None:
    vendor = renamed(block(), VENDOR)
    names = {name: own for name, own in VENDOR.items() if own in {v.name for v in vendor.parameters}}
    path = case_with(tmp_path, vendor, parameter_names=names)
    (tmp_path / "own").mkdir()
    for case in (path, same := case_with(tmp_path / "own", block())):
        content = yaml.safe_load(case.read_text(encoding="utf-8"))
        content["estimator"] = {"kind": estimator, "start": "reference"}
        case.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    outcome = identify(path)
    np.testing.assert_allclose(outcome.estimate.value, identify(same).estimate.value, rtol=1e-6)
    # Of a plant that is built from its description the equations are known, so nothing is a difference.
    known = identify(SCARA).estimate
    assert (np.abs(outcome.estimate.value - known.value) <= NEAR * known.standard_deviation).all()
    assert outcome.document.provenance["parameter_names"]["Fv1"] == "axis[1].friction.d"
    assert not [remark for remark in outcome.document.remarks if not remark.startswith("It would not show")]
    np.testing.assert_allclose(simulate(path).values, simulate(SCARA).values, rtol=0, atol=1e-9)


@pytest.mark.gate
def test_plant_without_the_names_is_refused_with_the_way_out(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"lacks parameters(.|\n)*parameter_names: \{Fv1: name in the plant"):
        load_case(case_with(tmp_path, renamed(block(), VENDOR)))


@pytest.mark.parametrize(
    ("names", "error", "message"),
    [
        ({"Fc1": "friction"}, UnknownNameError, "no parameter named 'friction'"),
        ({"Fc1": "Fv1"}, InputError, "another parameter of this name already"),
        ({"Fc1": "Fv2", "Fv1": "Fv2"}, InputError, "A parameter is named twice"),
    ],
)
@pytest.mark.parametrize("kind", ["fmu", "model", "control"])
def test_wrong_names_are_refused(kind: str, names: dict[str, str], error: type[Exception], message: str) -> None:
    own = block()
    made = {"fmu": lambda: load_fmu(build_fmu(own)), "model": lambda: ModelComponent(own),
            "control": lambda: block_as_control(own)}[kind]()  # fmt: skip
    with pytest.raises(error, match=message):
        name_parameters(made, names)


@pytest.mark.parametrize("kind", ["fmu", "model", "control", "user"])
def test_names_can_be_exchanged(kind: str) -> None:
    """Two names swapped: no order of renaming one by one would do that."""
    own = block()
    made = {
        "fmu": lambda: load_fmu(build_fmu(own)), "model": lambda: ModelComponent(own),
        "control": lambda: block_as_control(own),
        "user": lambda: wrap_control(block_as_control(own).system, initial_state=(0.1, 0.2, 0.0, 0.0), substeps=8),
    }[kind]()  # fmt: skip
    swapped = name_parameters(made, {"Fc1": "Fv1", "Fv1": "Fc1"})
    inputs = np.tile([3.0, 0.4], (20, 1))
    expected = drive(made.with_parameters({"Fc1": 0.7, "Fv1": 0.2}), inputs, 0.005)
    np.testing.assert_array_equal(drive(swapped.with_parameters({"Fv1": 0.7, "Fc1": 0.2}), inputs, 0.005), expected)
    assert swapped.parameter_values()["Fv1"] == made.parameter_values()["Fc1"]


def test_start_value_of_a_state_gets_a_name(tmp_path: Path) -> None:
    fmu = load_fmu(awkward_fmu(tmp_path))
    assert isinstance(fmu, FmuComponent)
    named = name_parameters(fmu, {"q_start1": "internal", "decay": "a"})
    assert named.parameter_values()["q_start1"] == 0.0
    inputs = np.zeros((3, 1))
    there = drive(named.with_parameters({"q_start1": 1.5, "decay": 4.0}), inputs, 0.01)
    np.testing.assert_array_equal(there, drive(fmu.with_parameters({"internal": 1.5, "a": 4.0}), inputs, 0.01))
    assert there[0, 0] == 1.5
    instance = named.instantiate()
    instance.begin_initialisation(0.0)
    instance.end_initialisation()
    with pytest.raises(SimulationError, match="start value of the FMU cannot be changed"):
        instance.set_parameters({"q_start1": 1.0})
    instance.close()


@pytest.mark.gate
def test_plant_that_starts_elsewhere_is_told(tmp_path: Path) -> None:
    own = renamed(block(), {"q_start1": "phi", "dq_start2": "w"}).with_parameters({"phi": 0.1})
    warnings = start_diagnostics(model_of(case_with(tmp_path, own)))
    assert len(warnings) == 2
    first = float(load_case(SCARA).reference("estimation").values[0, 0])
    assert warnings[0].text.startswith(f"The plant starts at q1 = 0.1 while the reference starts at {first:.4g}.")
    assert "parameter_names: {q_start1: name in the plant}" in warnings[0].advice
    assert warnings[1].place == "plant: joint 2"
    assert (
        start_diagnostics(model_of(case_with(tmp_path, own, parameter_names={"q_start1": "phi", "dq_start2": "w"})))
        == []
    )


# Parameters that do not act


@pytest.mark.gate
@pytest.mark.parametrize("estimator", ["didim", "clie"])
def test_parameter_without_effect_is_refused_before_long_work(tmp_path: Path, estimator: str) -> None:
    idle = without_effect(block(), "Fc2")
    path = case_with(tmp_path, idle)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["estimator"] = {"kind": estimator}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    seen: list[Any] = []
    with pytest.raises(InputError, match=r"no effect in the plant: Fc2"):
        identify(path, progress=seen.append)
    assert seen == []


@pytest.mark.parametrize("estimator", ["didim", "clie"])
def test_named_parameter_without_effect_is_refused(tmp_path: Path, estimator: str) -> None:
    path = plant_case(tmp_path, {"friction": {"parameter": "Fc2", "start": 0.1}, "ZZ1": {"start": 3.0}})
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["plant"]["source"] = str(build_fmu(without_effect(block(), "Fc2"), directory=tmp_path))
    content["estimator"] = {"kind": estimator}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    with pytest.raises(InputError, match=r"no effect(.|\n)*friction \(Fc2 in the plant\)"):
        identify(path)


@pytest.mark.gate
def test_fmu_that_accepts_a_parameter_and_ignores_it(tmp_path: Path) -> None:
    """The first-order FMU of the gallery under a proportional controller; its parameter 'unused' is only stored."""
    (tmp_path / "mine.py").write_text(
        "import control\ncontroller = control.ss([], [], [], [[2.0]], 0.01, inputs=['e'], outputs=['u'])\n",
        encoding="utf-8",
    )
    time = np.arange(401) * 0.01
    (tmp_path / "reference.csv").write_text("t,q1\n" + "\n".join(f"{t},{np.sin(t)}" for t in time), encoding="utf-8")
    content: dict[str, Any] = {
        "schema": 1, "name": "first order", "identify": {"a": {}, "useless": {"parameter": "unused"}},
        "plant": {"source": str(awkward_fmu(tmp_path)), "inputs": {"tau1": "u"}, "outputs": {"q1": "y"}},
        "controller": {"kind": "control", "source": "mine.py:controller", "inputs": {"q_ref1 - q1": "e"},
                       "outputs": {"command1": "u"}},
        "train": {"reference": {"file": "reference.csv"}, "torque": {"file": "torque.csv"}},
        "loop": {"algebraic_loops": "previous"}, "estimator": {"kind": "clie"},
    }  # fmt: skip
    path = tmp_path / "case.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    torque = simulate(path).select(["tau1"])[::5, 0]
    rows = "\n".join(f"{t},{v}" for t, v in zip(time[::5], torque, strict=True))
    (tmp_path / "torque.csv").write_text(f"t,tau1\n{rows}", encoding="utf-8")
    with pytest.raises(InputError, match=r"no effect in the plant: useless \(unused in the plant\)"):
        identify(path)


def test_all_parameters_of_a_good_plant_act(tmp_path: Path) -> None:
    check_parameter_influence(model_of(case_with(tmp_path, block())))


def test_parameter_that_acts_late_is_found_to_act(tmp_path: Path) -> None:
    """The second joint rests for longer than the short simulation lasts."""
    path = case_with(tmp_path, block())
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    del content["validation"]
    content["train"]["reference"] = {
        "kind": "point_to_point", "points": [[0, 0], [0.5, 0], [0, 0], [0.3, 0.8], [0, 0]],
        "move_s": 1.5, "dwell_s": 1.0,
    }  # fmt: skip
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    check_parameter_influence(model_of(path))


def test_user_system_keeps_its_order(tmp_path: Path) -> None:
    """A python-control plant of a user, by his own names of the parameters."""
    system = control.nlsys(
        lambda t, x, u, params: np.array([-params["b"] * x[0] + params["g"] * u[0]]),
        lambda t, x, u, params: x, inputs=["u"], outputs=["y"], states=1, params={"b": 2.0, "g": 3.0},
    )  # fmt: skip
    own = wrap_control(system)
    named = name_parameters(own, {"Fv1": "b"})
    assert [v.name for v in named.parameters] == ["Fv1", "g", "x_start1"]
    inputs = np.ones((5, 1))
    np.testing.assert_array_equal(
        drive(named.with_parameters({"Fv1": 5.0}), inputs, 0.01), drive(own.with_parameters({"b": 5.0}), inputs, 0.01)
    )
