"""The linearly implicit step: order, stability, energy, and the same step in every kind of component."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from fmu_didim.base.documents import validate
from fmu_didim.components import Component, Instance, ModelComponent, block_as_control, load_fmu
from fmu_didim.dynamics.block import SUBSTEP_RATE, Block
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from fmu_didim.dynamics.robot.equations import EquationsOfMotion
from fmu_didim.export import build_fmu
from tests.helpers import ROOT

Joint = tuple[tuple[str, ...], dict[str, float]]
"""Effects of a joint and their values."""


def robot(
    effects: Sequence[str], parameters: Mapping[str, float], second: Joint | None = None, *, gravity: float = -9.81
) -> Block:
    """A vertical arm of two joints, the same effects in both, or others in the second."""
    link = {"ZZ": 1.2, "MX": 1.5, "M": 3.0}
    effects_2, parameters_2 = second or (effects, parameters)
    joints: list[Mapping[str, Any]] = [
        {"type": "revolute", "alpha": np.pi / 2, "effects": list(effects), "parameters": {**link, **parameters}},
        {"type": "revolute", "a": 0.4, "effects": list(effects_2), "parameters": {**link, **parameters_2}},
    ]
    content = {"name": "arm", "gravity": [0, 0, gravity], "joints": joints}
    return RobotModel(validate(RobotDescription, content, where="robot.yaml")).block()


GEAR: Joint = (
    ("coulomb", "motor_inertia", "joint_elasticity"),
    {"Fc": 1.5, "v0": 0.05, "Ia": 0.5, "K": 2e3, "D": 5.0},
)
BY_LOAD: Joint = (("coulomb", "load_dependent_friction"), {"Fc": 1.5, "Fl": 0.2, "v0": 0.05})
BY_DIRECTION: Joint = (("coulomb", "directional_efficiency"), {"Fc": 1.5, "Fldrive": 0.3, "Flback": 0.1, "v0": 0.05})
STEEP: Mapping[str, tuple[Any, ...]] = {
    "coulomb": (("viscous", "coulomb"), {"Fv": 2.0, "Fc": 1.5, "v0": 0.05}),
    "stribeck": (("coulomb", "stribeck"), {"Fc": 1.5, "Fs": 0.8, "v0": 0.05, "vs": 0.2}),
    "presliding": (("coulomb", "presliding"), {"Fc": 1.5, "Fd": 1.0, "v0": 0.05, "zs": 0.02}),
    "lugre": (("viscous", "lugre"), {"Fv": 1.0, "Fz": 1.5, "Fzs": 0.5, "zs": 0.02}),
    "load": BY_LOAD,
    "efficiency": BY_DIRECTION,
    "elastic": GEAR,
    "elastic, then load": (*GEAR, BY_LOAD),
    "load, then elastic": (*BY_LOAD, GEAR),
    "efficiency, then elastic": (*BY_DIRECTION, GEAR),
    "load of both": ((*GEAR[0], "load_dependent_friction"), {**GEAR[1], "Fl": 0.2}, BY_LOAD),
    "backlash": (
        ("coulomb", "motor_inertia", "backlash"),
        {"Fc": 1.5, "v0": 0.05, "Ia": 0.5, "gap": 0.02, "K": 2e3, "D": 5.0},
    ),
}


TORQUE = np.array([2.0, -1.0])


def end(
    block: Block, steps: int, *, seconds: float = 0.2, start: Mapping[str, float] | None = None,
    torque: np.ndarray = TORQUE,
) -> np.ndarray:  # fmt: skip
    """State after some time under a constant torque."""
    assert block.implicit is not None
    block = block.with_parameters(dict(start or {"q_start1": 0.3, "dq_start1": 0.4, "dq_start2": -0.2}))
    u, p = torque, block.parameter_values
    step = block.implicit.step()
    x, m = block.start(u, p), np.zeros(block.implicit.memory)
    for _ in range(steps):
        x, m = step(x, m, u, p, seconds / steps)
    return np.asarray(x.full()).ravel()


@pytest.mark.gate
@pytest.mark.parametrize("name", STEEP)
def test_the_order_is_two(name: str) -> None:
    """Errors fall by four with each halving, towards the answer of a solver of high order."""
    block = robot(*STEEP[name])
    start = block.with_parameters({"q_start1": 0.3, "dq_start1": 0.4, "dq_start2": -0.2})
    u, p, x = np.array([2.0, -1.0]), start.parameter_values, ca.MX.sym("x", len(block.states))
    options = {"abstol": 1e-12, "reltol": 1e-12, "max_num_steps": 100000}
    solver = ca.integrator("exact", "cvodes", {"x": x, "ode": block.update(x, u, p)}, 0.0, 0.2, options)
    exact = np.asarray(solver(x0=start.start(u, p))["xf"].full()).ravel()
    errors = [np.abs(end(block, count) - exact).max() for count in (800, 1600, 3200)]
    assert 3.0 <= errors[0] / errors[1] <= 5.5
    assert 3.0 <= errors[1] / errors[2] <= 5.5
    assert errors[2] <= 1e-5


@pytest.mark.gate
def test_the_order_holds_for_slopes_that_are_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """A method of W type: slopes decide about stability, not about what it converges to."""
    exact = end(robot(*STEEP["coulomb"]), 25600)
    right = EquationsOfMotion.stiff_balance
    assert right.fget is not None
    known = right.fget
    monkeypatch.setattr(
        EquationsOfMotion, "stiff_balance", property(lambda own: replace(known(own), friction=3 * known(own).friction))
    )
    wrong = robot(*STEEP["coulomb"])
    errors = [np.abs(end(wrong, count) - exact).max() for count in (800, 1600, 3200)]
    assert 3.0 <= errors[0] / errors[1] <= 5.5 and 3.0 <= errors[1] / errors[2] <= 5.5


@pytest.mark.parametrize("width", [0.05, 1e-3, 1e-5])
def test_friction_by_the_load_beside_a_gear_holds_its_joint_however_steep_it_is(width: float) -> None:
    """A link that is thrown by its neighbour, whose gear gives way, comes to rest: without its slope in the step it
    moves at 500 times that speed."""
    held: Joint = (("coulomb", "load_dependent_friction"), {"Fc": 0.1, "Fl": 0.3, "v0": width})
    block, torque = robot(*GEAR, held), np.array([-40.0, -12.5])
    place = [v.name for v in block.states].index("x_dq2")
    coarse, fine = (end(block, steps, start={"dq_start1": 0.5}, torque=torque) for steps in (400, 6400))
    assert abs(coarse[place]) <= 2 * width and abs(fine[place]) <= 2 * width
    assert np.abs(coarse - fine).max() <= 0.01 * np.abs(fine).max()


@pytest.mark.gate
@pytest.mark.parametrize(("slope", "times"), [(1e6, 30), (1e6, 100), (1e6, 1000), (1e6, 1e5), (1e5, 100), (1e5, 1e4)])
def test_stable_however_steep_friction_is(slope: float, times: float) -> None:
    """h rate = 1 000 and more: the joints stick, as they should, where RK4 overflows."""
    width = 100.0 / slope
    block = robot(("coulomb",), {"Fc": 100.0, "v0": width})
    rate = float(block.rate_bound(block.start(np.zeros(2), block.parameter_values), block.parameter_values))
    steps = max(20, round(0.2 * rate / times))
    start = {"q_start1": 0.3, "dq_start1": 0.01, "dq_start2": -0.01}
    sticking = end(block, steps, start=start)
    assert np.abs(sticking[2:4]).max() <= width
    assert np.abs(sticking[:2] - [0.3, 0.0]).max() <= 1e-3
    if times < 1000:
        return
    explicit = ModelComponent(replace(block.with_parameters(start), implicit=None), steps).instantiate()
    explicit.begin_initialisation(0.0)
    explicit.end_initialisation()
    explicit.step(0.0, 0.2)
    explicit.get()
    assert not np.abs(explicit.outputs[:4]).max() <= 1e-2


@pytest.mark.parametrize("slope", [0.0, 1e-9])
def test_an_arm_without_friction_keeps_its_energy(slope: float) -> None:
    """Without gravity and torque, what is lost falls with the cube of the step or faster; nothing is damped away."""
    block = robot(("coulomb",), {"Fc": slope, "v0": 0.05}, gravity=0.0)
    model = RobotModel(read_robot(ROOT / "fmus/arm2r/robot.yaml"))  # only for its size
    assert model.joint_count == 2
    assert block.implicit is not None
    block = block.with_parameters({"q_start2": 0.5, "dq_start1": 1.0, "dq_start2": -2.0})
    p, u = block.parameter_values, np.zeros(2)
    step = block.implicit.step()

    def energy(x: np.ndarray) -> float:
        """dq' M dq / 2, M from the accelerations by unit torques."""
        free = np.asarray(block.update(x, u, p).full()).ravel()[2:4]
        columns = [np.asarray(block.update(x, e, p).full()).ravel()[2:4] - free for e in np.eye(2)]
        return float(x[2:4] @ np.linalg.solve(np.column_stack(columns), x[2:4]) / 2)

    lost = []
    for count in (500, 1000):
        x, m = block.start(u, p), np.zeros(block.implicit.memory)
        before = energy(np.asarray(x.full()).ravel())
        for _ in range(count):
            x, m = step(x, m, u, p, 2.0 / count)
        lost.append(abs(energy(np.asarray(x.full()).ravel()) / before - 1))
    assert lost[0] <= 1e-4 and lost[1] <= lost[0] / 3


@pytest.mark.parametrize(("part_of_radian", "wanted"), [(1.0, 0.927), (0.5, 0.980), (0.25, 0.9948), (0.125, 0.9987)])
def test_a_coarse_step_lowers_the_resonance_of_a_gear_and_does_not_damp_it(
    part_of_radian: float, wanted: float
) -> None:
    """So that a gear is as a softer one, by 1 % of its stiffness with four steps in a radian."""
    values = {"Fc": 1e-9, "v0": 0.05, "Ia": 0.5, "K": 2e3, "MX": 0.0, "M": 0.0}
    block = robot(("coulomb", "motor_inertia", "joint_elasticity"), values, gravity=0.0)
    assert block.implicit is not None
    u, p, h = np.zeros(2), block.parameter_values, ca.SX.sym("h")
    x, m = ca.SX.sym("x", len(block.states)), ca.SX.sym("m", block.implicit.memory)
    still, rest = block.start(u, p), np.zeros(block.implicit.memory)

    def eigenvalues(matrix: ca.SX, *at: Any) -> np.ndarray:
        return np.linalg.eigvals(ca.Function("matrix", [x, m, h], [matrix])(still, rest, *at).full())

    resonance = float(np.abs(eigenvalues(ca.jacobian(block.update(x, u, p), x), 0.0).imag).max())
    step, after = part_of_radian / resonance, ca.vertcat(*block.implicit.step()(x, m, u, p, h))
    turned = eigenvalues(ca.jacobian(after, ca.vertcat(x, m)), step)
    ringing = np.log(turned[np.argmax(np.where(np.abs(turned) > 0.5, np.angle(turned), 0.0))]) / step
    assert ringing.imag / resonance == pytest.approx(wanted, abs=5e-4)
    assert abs(ringing.real) < 1e-6 * resonance
    # The substeps that resolve it are steps of about a radian.
    fewest = step / part_of_radian * float(block.implicit.resolution(still, p)) / SUBSTEP_RATE
    assert 0.8 <= fewest <= 1.1


def kinds(block: Block, version: str) -> list[Component]:
    return [ModelComponent(block), block_as_control(block), load_fmu(build_fmu(block, fmi_version=version))]


def started(component: Component) -> Instance:
    running = component.instantiate()
    running.inputs[:] = [2.0, -1.0]
    running.begin_initialisation(0.0)
    running.set()
    running.end_initialisation()
    return running


def stepped(running: Instance, ticks: range) -> np.ndarray:
    for tick in ticks:
        running.set()
        running.step(tick * 0.005, 0.005)
    running.get()
    return running.outputs.copy()


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("name", ["presliding", "load", "load, then elastic"])
def test_every_kind_of_component_makes_the_same_step(version: str, name: str) -> None:
    block = robot(*STEEP[name]).with_parameters({"dq_start1": 0.4})
    found = []
    for component in kinds(block, version):
        running = started(component)
        found.append(stepped(running, range(20)))
        running.close()
    np.testing.assert_allclose(found[1], found[0], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found[2], found[0], rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_what_a_step_remembers_is_saved_with_the_state(version: str) -> None:
    """A master that goes back and on again gets the same, to the last bit; so does a run after another one."""
    block = robot(*STEEP["presliding"]).with_parameters({"dq_start1": 0.4})
    for component in kinds(block, version):
        running = started(component)
        stepped(running, range(3))
        saved = running.save_state()
        once = stepped(running, range(3, 6))
        running.restore_state(saved)
        np.testing.assert_array_equal(stepped(running, range(3, 6)), once)
        again = started(component)
        np.testing.assert_array_equal(stepped(again, range(6)), once)
        if running.restart(component):
            running.inputs[:] = [2.0, -1.0]
            running.begin_initialisation(0.0)
            running.set()
            running.end_initialisation()
            np.testing.assert_array_equal(stepped(running, range(6)), once)
        running.close()
        again.close()


def test_what_is_not_steep_is_left_to_runge_kutta() -> None:
    """Constant damping and springs of gears: the explicit method of fourth order is better there."""
    assert robot(("viscous",), {"Fv": 2.0}).implicit is None
    assert (
        robot(("viscous", "motor_inertia", "joint_elasticity"), {"Fv": 2.0, "Ia": 0.5, "K": 2e3, "D": 5.0}).implicit
        is None
    )
    loaded = robot(("viscous", "curve_of_load"), {"Fv": 2.0})  # solved by Newton's method, but not steep
    assert loaded.implicit is None
