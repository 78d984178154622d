"""Effects of drive, sensor, structure and measurement: what they say of themselves and what they do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

import fmu_didim
from fmu_didim import identify
from fmu_didim.base.errors import InputError
from fmu_didim.case import load_case
from fmu_didim.components import ModelComponent, load_fmu
from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.components.inserted import inserted_component
from fmu_didim.cosim import Connection, System, insert_effect, logged_torque, simulate
from fmu_didim.data.signals import Trajectory, trajectory, write_csv
from fmu_didim.data.units import parse_unit
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.effects import EFFECTS, Effect, InsertedEffect, NonlinearEffect, StructureEffect
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot, write_robot
from fmu_didim.dynamics.robot.tilt import horizontal_axes
from fmu_didim.estimators import Didim
from fmu_didim.export import build_fmu
from fmu_didim.fit.estimate import Status
from fmu_didim.model.parameters import RobotParameters
from tests.helpers import PERIOD, ROOT, drive, law_block, loop, model_on, reference, scara, scara_pd, with_torque

NONLINEAR: dict[str, NonlinearEffect] = {n: e for n, e in EFFECTS.items() if isinstance(e, NonlinearEffect)}
INSERTED: dict[str, InsertedEffect] = {n: e for n, e in NONLINEAR.items() if isinstance(e, InsertedEffect)}
STRUCTURE: dict[str, StructureEffect] = {n: e for n, e in NONLINEAR.items() if isinstance(e, StructureEffect)}
KINDS = ("revolute", "prismatic")
MOTION = reference(1.5)


def variables(effect: Effect, kind: Any) -> dict[str, Any]:
    return {v.name: v for v in (*effect.parameters(kind), *effect.shapes(kind))}


def arm(**by_joint: Mapping[str, Any]) -> RobotDescription:
    """The vertical arm with more effects: ``joint2={"effects": [...], "K": 220}``."""
    content = read_robot(ROOT / "fmus/arm2r/robot.yaml").model_dump(by_alias=True)
    joints = [dict(joint) for joint in content["joints"]]
    for name, change in by_joint.items():
        joint = joints[int(name[-1]) - 1]
        own = {key: value for key, value in change.items() if key not in ("effects", "only")}
        joint["effects"] = [*change.get("only", joint["effects"]), *change["effects"]]
        joint["parameters"] = {**joint["parameters"], **own}
    return RobotDescription.model_validate({**content, "joints": joints})


class TestWhatTheySay:
    @pytest.mark.parametrize("name", NONLINEAR)
    def test_metadata_is_complete(self, name: str) -> None:
        effect = NONLINEAR[name]
        for text in (effect.title, effect.equation, effect.class_name, effect.signature, effect.experiment):
            assert text.strip()
        assert effect.source.strip()
        assert effect.__doc__
        assert set(effect.confounded_with) <= set(EFFECTS)
        assert name not in effect.confounded_with
        assert effect.place in ("controller", "drive", "sensor", "structure", "measurement")

    @pytest.mark.parametrize("kind", KINDS)
    @pytest.mark.parametrize("name", NONLINEAR)
    def test_parameters_have_units_limits_and_a_search(self, name: str, kind: Any) -> None:
        effect = NONLINEAR[name]
        known = variables(effect, kind)
        assert set(effect.neutral) <= set(known)
        assert {v.name for v in effect.parameters(kind)} & set(effect.search(kind))
        assert set(effect.search(kind)) <= set(known)
        for variable in known.values():
            assert parse_unit(variable.unit) is not None
            assert variable.description
            low, high = effect.limits[variable.name]
            assert low <= variable.start <= high
            assert (low <= 0) == (variable.name in effect.signed) or effect.place not in ("structure", "measurement")
        for parameter, search in effect.search(kind).items():
            low, high = effect.limits[parameter]
            assert low <= search.lowest < search.highest <= high
            assert search.count >= 2
            assert search.lowest > 0 or not search.logarithmic

    @pytest.mark.parametrize("kind", KINDS)
    def test_names_are_free_in_a_joint_with_any_other_effect(self, kind: Any) -> None:
        for name in NONLINEAR:
            for other in EFFECTS:
                if name != other:
                    mine, theirs = variables(NONLINEAR[name], kind), variables(EFFECTS[other], kind)
                    assert all(mine[key] == theirs[key] for key in set(mine) & set(theirs)), (name, other)


class TestNeutralValues:
    @pytest.mark.parametrize("compiled", [None, False])
    @pytest.mark.parametrize("name", INSERTED)
    def test_of_drives_and_sensors_change_no_bit(self, name: str, compiled: bool | None) -> None:
        system = loop(load_fmu(build_fmu(scara().block())), load_fmu(build_fmu(scara_pd())), MOTION)
        before = simulate(system, MOTION, compiled=compiled)
        after = simulate(insert_effect(system, INSERTED[name], 2, "revolute"), MOTION, compiled=compiled)
        assert after.compiled == (compiled is None)
        assert np.array_equal(before.applied["plant.ddq2"], after.applied["plant.ddq2"])

    def test_of_gears_is_the_limit_of_a_stiff_one(self) -> None:
        rigid, errors = closed(arm())[:, 1], []
        for stiffness in (2e4, 1.6e6):
            given = arm(joint2={"effects": ["joint_elasticity"], "K": stiffness, "D": 20.0})
            errors.append(float(np.sqrt(np.mean((closed(given)[:, 1] - rigid)[100:] ** 2))))
        assert errors[1] < 1e-4 * np.ptp(rigid)
        assert errors[0] > 20 * errors[1]  # 80 times stiffer

    def test_no_gap_is_elasticity_alone(self) -> None:
        first = closed(arm(joint2={"effects": ["backlash"], "K": 800.0, "D": 1.0, "gap": 0.0}))
        second = closed(arm(joint2={"effects": ["joint_elasticity"], "K": 800.0, "D": 1.0}))
        assert np.abs(first - second).max() < 1e-9

    @pytest.mark.parametrize("gear", ["joint_elasticity", "backlash"])
    def test_no_hardening_is_the_gear_without_it_to_the_bit(self, gear: str) -> None:
        values = {"K": 800.0, "D": 1.0, **({"gap": 0.01} if gear == "backlash" else {})}
        first = closed(arm(joint2={"effects": [gear, "gear_hardening"], **values, "K_cubic": 0.0}))
        assert np.array_equal(first, closed(arm(joint2={"effects": [gear], **values})))

    def test_no_tilt_is_the_level_base(self) -> None:
        assert np.abs(closed(arm(joint1={"effects": ["base_tilt"]})) - closed(arm())).max() < 1e-9


SPEED = 2 * np.cos(0.13 * np.arange(120))
"""Of the joint, where an effect depends on it."""
EQUATIONS: Mapping[str, tuple[Mapping[str, float], Callable[[np.ndarray], np.ndarray]]] = {
    "dead_zone": ({"dead_zone": 0.4}, lambda u: np.sign(u) * np.maximum(0, np.abs(u) - 0.4)),
    "torque_saturation": ({"limit": 0.7}, lambda u: np.clip(u, -0.7, 0.7)),
    # Driving, braking as a generator up to 1.9 times the stall torque, and beyond the no-load speed.
    "voltage_limit": (
        {"stall": 0.9, "no_load_speed": 1.8},
        lambda u: np.clip(u, -0.9 * (1 + SPEED / 1.8), 0.9 * (1 - SPEED / 1.8)),
    ),
    "drive_gain": ({"drive_gain": 1.3}, lambda u: 1.3 * u),
    "controller_gain": ({"controller_gain": 0.6}, lambda u: 0.6 * u),
    "encoder_eccentricity": (
        {"eccentricity_cosine": 0.02, "eccentricity_sine": -0.03, "eccentricity_number": 4.0},
        lambda u: u + np.hypot(0.02, 0.03) * np.cos(4 * u - np.arctan2(-0.03, 0.02)),
    ),
    "delay": ({"delay": 1.6 * PERIOD}, lambda u: np.interp(np.arange(u.size) - 1.6, np.arange(u.size), u)),
    "actuator_lag": ({"T": 0.004}, lambda u: lagged(u, 0.004)),
}


def lagged(u: np.ndarray, lag: float) -> np.ndarray:
    """Means over the periods of T dtau/dt + tau = u by a Runge-Kutta integration of tau and of its integral."""
    tau, means = u[0], []
    for force in u:
        found = solve_ivp(
            lambda _, y, force=force: [(force - y[0]) / lag, y[0]], (0, PERIOD), [tau, 0.0], rtol=1e-10, atol=1e-12
        )
        tau = found.y[0, -1]
        means.append(found.y[1, -1] / PERIOD)
    return np.array(means)


class TestEquationsOfDrivesAndSensors:
    def test_all_are_there(self) -> None:
        assert set(EQUATIONS) == set(INSERTED)

    @pytest.mark.parametrize("name", EQUATIONS)
    def test_the_block_follows_its_equation(self, name: str) -> None:
        values, equation = EQUATIONS[name]
        u = 1.5 * np.sin(0.2 * np.arange(120)) + 0.5 * np.random.default_rng(7).normal(size=120)
        part = inserted_component(INSERTED[name], "revolute", PERIOD, values)
        assert part.twin is not None
        source = trajectory(np.arange(u.size) * PERIOD, {"u": u, "dq": SPEED})
        wires = tuple(Connection(f"reference.{v.name}", f"it.{v.name}") for v in part.inputs)
        system = System({"it": part}, wires, ("it",), PERIOD)
        recorded = simulate(system, source)
        assert recorded.compiled
        rounded = 0.06 * 0.4 if name == "dead_zone" else 1e-8  # its corners, over 5 % of the width
        assert np.abs(recorded.applied["it.y"] - equation(u)).max() < rounded
        assert np.abs(equation(u) - u).max() > 0.01

    @pytest.mark.parametrize("name", EQUATIONS)
    def test_its_fmu_is_valid_and_one_for_all_joints(self, name: str) -> None:
        block = INSERTED[name].block("revolute", PERIOD)
        assert validate_fmu(str(build_fmu(block))) == []
        assert block.digest() == INSERTED[name].block("revolute", PERIOD).digest()


def closed(robot: RobotDescription, motion: Trajectory = MOTION) -> np.ndarray:
    """(K, 2) torque of the arm's loop."""
    controller = law_block(law="pd", joints=["revolute"] * 2, Kp=[3300, 450], Kd=[150, 20])
    plant = with_compiled_twin(ModelComponent(RobotModel(robot).block()))
    system = loop(plant, with_compiled_twin(ModelComponent(controller)), motion)
    recorded = simulate(system, motion)
    return np.column_stack([recorded.inputs[f"plant.tau{j}"] for j in (1, 2)])


class Arm:
    """The vertical arm with gears that give way, its equations by hand: lengths 0.5 m, friction at the motors."""

    def __init__(
        self,
        p: Mapping[str, float],
        soft: Mapping[int, Callable[[float, float], float]],
        teeth: Mapping[int, tuple[float, float, float]] | None = None,
    ) -> None:
        """``soft``: joint from 0 -> torque of its gear from twist and twist rate; p also has ``rotor1``, ``rotor2``.
        ``teeth``: joint from 0 -> a, phase and N of its gear's error a sin(N q + phase)."""
        self.p, self.soft, self.teeth = p, soft, teeth or {}

    def rates(self, tau: np.ndarray, y: np.ndarray) -> np.ndarray:
        """y = link q (2), link dq (2), motor q (2), motor dq (2); those of a rigid joint's motor are its link's."""
        p, q, v = self.p, y[:2], y[2:4]
        m, w = y[4:6].copy(), y[6:8].copy()
        for j in range(2):
            if j not in self.soft:
                m[j], w[j] = q[j], v[j]
        a = 0.5 * (p["MX2"] * np.cos(q[1]) - p["MY2"] * np.sin(q[1]))
        b = 0.5 * (p["MX2"] * np.sin(q[1]) + p["MY2"] * np.cos(q[1]))
        mass = np.array([[p["ZZ1"] + p["ZZ2"] + 2 * a, p["ZZ2"] + a], [p["ZZ2"] + a, p["ZZ2"] + p["Ia2"]]])
        g2 = 9.81 * (p["MX2"] * np.cos(q[0] + q[1]) - p["MY2"] * np.sin(q[0] + q[1]))
        g1 = 9.81 * (p["MX1"] * np.cos(q[0]) - p["MY1"] * np.sin(q[0])) + g2
        h = np.array([g1 - b * (2 * v[0] * v[1] + v[1] ** 2), g2 + b * v[0] ** 2])
        friction = np.array([p[f"Fv{j}"] * w[j - 1] + p[f"Fc{j}"] * np.tanh(w[j - 1] / 0.02) for j in (1, 2)])
        right, motor = tau - friction, np.zeros(2)
        for j, gear in self.soft.items():
            size, phase, number = self.teeth.get(j, (0.0, 0.0, 0.0))
            ahead, turn = size * np.sin(number * m[j] + phase), 1 + size * number * np.cos(number * m[j] + phase)
            through, rotor = gear(m[j] + ahead - q[j], turn * w[j] - v[j]), p[f"rotor{j + 1}"]
            mass[j, j] -= rotor
            motor[j] = (right[j] - turn * through) / rotor  # by virtual work
            right[j] = through
        return np.concatenate([v, np.linalg.solve(mass, right - h), w, motor])

    def run(self, tau: np.ndarray) -> np.ndarray:
        """(K, 8) states at the beginning of each period of a held torque (K, 2), from rest."""
        y, table = np.zeros(8), []
        for row in tau:
            table.append(y)
            y = solve_ivp(lambda _, x, row=row: self.rates(row, x), (0, PERIOD), y, rtol=1e-9, atol=1e-11).y[:, -1]
        return np.array(table)


ARM = dict(
    ZZ1=2.0, MX1=3.0, MY1=0.2, ZZ2=0.35, MX2=0.9, MY2=0.1, Ia2=0.15, Fv1=2.0, Fc1=3.0, Fv2=0.8, Fc2=1.0,
    rotor1=0.8, rotor2=0.15,
)  # fmt: skip


def spring(k: float, d: float = 0.0) -> Callable[[float, float], float]:
    return lambda x, v: k * x + d * v


def play(k: float, d: float, gap: float) -> Callable[[float, float], float]:
    """Outside the gap a spring; hyperbolas of radius gap/40 for its corners."""

    def gear(x: float, v: float) -> float:
        right, left = np.hypot(x - gap / 2, gap / 40), np.hypot(x + gap / 2, gap / 40)
        contact = 1 + ((x - gap / 2) / right - (x + gap / 2) / left) / 2
        return float(k * (x + (right - left) / 2) + d * contact * v)

    return gear


def hardening(k: float, cubic: float, d: float = 0.0, gap: float = 0.0) -> Callable[[float, float], float]:
    """A spring outside the gap, or without one, and the cube of its deflection."""
    linear = play(1.0, 0.0, gap) if gap else spring(1.0)
    damped = play(0.0, d, gap) if gap else spring(0.0, d)
    return lambda x, v: k * linear(x, 0.0) + cubic * linear(x, 0.0) ** 3 + damped(x, v)


UNEVEN = {"gear_cosine": 0.003, "gear_sine": 0.004, "gear_number": 60.0}
SOFT: Mapping[str, tuple[RobotDescription, Mapping[int, Callable[[float, float], float]]]] = {
    "joint 2": (arm(joint2={"effects": ["joint_elasticity"], "K": 220.0, "D": 0.5}), {1: spring(220.0, 0.5)}),
    "joint 1, share of the link": (
        arm(joint1={"effects": ["joint_elasticity"], "K": 3000.0, "motor_share": 0.4}), {0: spring(3000.0)},
    ),
    "both": (
        arm(
            joint1={"effects": ["joint_elasticity"], "K": 3000.0, "motor_share": 0.4, "D": 2.0},
            joint2={"effects": ["joint_elasticity"], "K": 500.0},
        ),
        {0: spring(3000.0, 2.0), 1: spring(500.0)},
    ),
    "backlash": (
        arm(joint2={"effects": ["backlash"], "K": 2000.0, "D": 4.0, "gap": 0.02}), {1: play(2000.0, 4.0, 0.02)},
    ),
    "error of a gear": (
        arm(joint2={"effects": ["joint_elasticity", "transmission_error"], "K": 500.0, "D": 0.4, **UNEVEN}),
        {1: spring(500.0, 0.4)},
    ),
    "error of a gear with play": (
        arm(joint2={"effects": ["backlash", "transmission_error"], "K": 2000.0, "D": 4.0, "gap": 0.01, **UNEVEN}),
        {1: play(2000.0, 4.0, 0.01)},
    ),
    "hardening gear": (
        arm(joint2={"effects": ["joint_elasticity", "gear_hardening"], "K": 300.0, "D": 0.3, "K_cubic": 3e5}),
        {1: hardening(300.0, 3e5, 0.3)},
    ),
    "softening gear": (
        arm(joint2={"effects": ["joint_elasticity", "gear_hardening"], "K": 500.0, "D": 0.3, "K_cubic": -6e4}),
        {1: hardening(500.0, -6e4, 0.3)},
    ),
    "hardening gear with play": (
        arm(joint2={"effects": ["backlash", "gear_hardening"], "K": 1500.0, "D": 4.0, "gap": 0.02, "K_cubic": 3e7}),
        {1: hardening(1500.0, 3e7, 4.0, 0.02)},
    ),
    "error of a hardening gear": (
        arm(joint2={
            "effects": ["joint_elasticity", "transmission_error", "gear_hardening"],
            "K": 300.0, "D": 0.4, "K_cubic": 3e5, **UNEVEN,
        }),
        {1: hardening(300.0, 3e5, 0.4)},
    ),
}  # fmt: skip
TEETH: Mapping[str, Mapping[int, tuple[float, float, float]]] = {
    name: {1: (0.005, float(np.arctan2(0.003, 0.004)), 60.0)} for name in SOFT if name.startswith("error of a")
}
"""0.005 sin(60 q + phase) = 0.003 cos(60 q) + 0.004 sin(60 q)"""


def torque(count: int) -> np.ndarray:
    t = np.arange(count) * PERIOD
    return np.column_stack([40 * np.sin(5 * t) + 38, 9 * np.sin(8 * t) + 6])


class TestEquationsOfTheStructure:
    @pytest.mark.gate
    @pytest.mark.parametrize("case", SOFT)
    def test_motion_follows_the_equations_by_hand(self, case: str) -> None:
        (robot, soft), tolerance = SOFT[case], 1e-6
        tau = torque(160)
        plant = ModelComponent(RobotModel(robot).block(), substeps=128)  # so that integration plays no part
        names = [v.name for v in plant.outputs]
        by_hand = Arm(ARM, soft, TEETH.get(case))
        ours, theirs = drive(plant, tau, PERIOD), by_hand.run(tau)
        for j in range(2):
            place = 4 if j in soft else 0
            assert np.abs(ours[:, names.index(f"q{j + 1}")] - theirs[:, place + j]).max() < tolerance
            if j in soft:
                assert np.abs(ours[:, names.index(f"q_link{j + 1}")] - theirs[:, j]).max() < tolerance
                twist = theirs[:, 4 + j] - theirs[:, j]
                assert np.ptp(twist) > 3 * tolerance  # else nothing was tested
                accelerations = [by_hand.rates(row, y) for row, y in zip(tau, theirs, strict=True)]
                wanted = np.array(accelerations)[:, 6 + j]
                assert np.abs(ours[:, names.index(f"ddq{j + 1}")] - wanted).max() < 1e-3 * np.ptp(wanted)

    @pytest.mark.parametrize("case", SOFT)
    def test_the_regressor_fits_the_plant_to_rounding(self, case: str) -> None:
        """tau = W(motors, links) chi on simulated states, and the inverse model undoes the direct one."""
        model = RobotModel(SOFT[case][0])
        tau = torque(100)
        plant = ModelComponent(model.block())
        table = dict(zip([v.name for v in plant.outputs], drive(plant, tau, PERIOD).T, strict=True))
        motion = [np.column_stack([table[f"{name}{j}"] for j in (1, 2)]) for name in ("q", "dq", "ddq")]
        observed = np.column_stack([table[v.name] for v in model.observed])
        rows = model.regressor_rows(*motion, observed=observed)
        assert np.abs(rows @ model.parameter_values - tau).max() < 1e-9
        extra = observed[:, : len(model.extra)]
        for k in (0, 30, 99):
            back = model.inverse(*(m[k] for m in motion), model.parameter_values, model.shape_values, extra[k])
            assert np.abs(back.full().ravel() - tau[k]).max() < 1e-9

    def test_the_corners_of_backlash_are_rounded_but_slightly(self) -> None:
        model = RobotModel(arm(joint2={"effects": ["backlash"], "K": 2000.0, "gap": 0.02}))
        for twist in (-0.03, -0.011, -0.01, -0.005, 0.0, 0.009, 0.012, 0.02):
            state = [0.0, 0.3 + twist], [0.0, 0.0], [0.0, 0.0], model.parameter_values, model.shape_values, [0.3, 0.0]
            through = -0.15 * model.direct(*state).full().ravel()[1]
            sharp = 2000.0 * np.sign(twist) * max(abs(twist) - 0.01, 0.0)
            assert abs(through - sharp) < 2000.0 * 0.5 * 0.05 * 0.01

    def test_load_friction_takes_the_torque_of_the_gear(self) -> None:
        """At the soft joint what the gear transmits, at the rigid one what its link does."""
        friction = {"effects": ["load_dependent_friction"], "Fl": 0.3}
        soft = {"effects": ["load_dependent_friction", "joint_elasticity"], "Fl": 0.3, "K": 220.0, "D": 0.2}
        model = RobotModel(arm(joint1=friction, joint2=soft))
        tau = torque(100)
        plant = ModelComponent(model.block())
        table = dict(zip([v.name for v in plant.outputs], drive(plant, tau, PERIOD).T, strict=True))
        gear = 220.0 * (table["q2"] - table["q_link2"]) + 0.2 * (table["dq2"] - table["dq_link2"])
        assert np.abs(table["load2"] - gear).max() < 1e-9
        friction2 = 0.8 * table["dq2"] + (1.0 + 0.3 * np.abs(gear)) * np.tanh(table["dq2"] / 0.02)
        assert np.abs(0.15 * table["ddq2"] + friction2 + gear - tau[:, 1]).max() < 1e-9
        load1 = tau[:, 0] - 2.0 * table["dq1"] - 3.0 * np.tanh(table["dq1"] / 0.02)
        load1 = load1 / (1 + 0.3 * np.tanh(table["dq1"] / 0.02) * np.sign(table["load1"]))
        assert np.abs(table["load1"] - load1).max() < 1e-6

    def test_springs_and_payloads_pull_at_the_link(self) -> None:
        spring_at_link = {"effects": ["spring", "joint_elasticity"], "K": 100.0, "ks": 30.0}
        names = {v.name for v in EFFECTS["spring"].parameters("revolute")}
        stiffness = "ks" if "ks" in names else sorted(names)[0]
        spring_at_link[stiffness] = spring_at_link.pop("ks")
        model = RobotModel(arm(joint2=spring_at_link))
        q_link, q = 0.4, np.array([0.0, 0.1])
        e = np.array([q_link, 0.0])
        first = model.direct(q, [0, 0], [0, 0], model.parameter_values, model.shape_values, e).full().ravel()
        without = RobotModel(arm(joint2={"effects": ["joint_elasticity"], "K": 100.0}))
        second = without.direct(q, [0, 0], [0, 0], without.parameter_values, without.shape_values, e).full().ravel()
        assert first[1] == pytest.approx(second[1], abs=1e-12)  # the motor does not feel it at once
        assert abs(first[0] - second[0]) > 0.1  # the rigid joint does, through the link

    def test_tilt_turns_gravity(self) -> None:
        x, y = 0.2, -0.3
        about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
        about_z = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
        tilted = arm(joint1={"effects": ["base_tilt"], "tilt_x": x, "tilt_y": y})
        turned = arm().model_copy(update={"gravity": tuple(about_x @ about_z @ np.array([0, -9.81, 0]))})
        assert np.abs(closed(tilted) - closed(turned)).max() < 1e-9
        assert np.abs(closed(tilted) - closed(arm())).max() > 0.5

    def test_a_base_tilts_about_horizontal_axes(self) -> None:
        first, second = horizontal_axes(np.array([0.0, 0.0, -9.81]))
        assert first == pytest.approx([1, 0, 0]) and second == pytest.approx([0, 1, 0])
        gravity = np.array([2.4, -9.4, 0.0])  # an arm in a vertical plane tilts in it about z
        first, second = horizontal_axes(gravity)
        assert first == pytest.approx([0, 0, 1])
        assert second @ gravity == pytest.approx(0, abs=1e-12) and second @ first == 0

    def test_the_error_of_a_gear_is_felt(self) -> None:
        """Else the cases above would say nothing of it."""
        name, tau = "error of a gear", torque(160)
        soft = SOFT[name][1]
        moved = Arm(ARM, soft, TEETH[name]).run(tau) - Arm(ARM, soft).run(tau)
        assert np.ptp(moved[:, 1]) > 0.005

    @pytest.mark.parametrize("case", ["hardening gear", "hardening gear with play", "softening gear"])
    def test_hardening_is_felt(self, case: str) -> None:
        """A fifth of the torque of the gear at its largest twist at least; else the cases above would say little."""
        robot, _ = SOFT[case]
        plant = ModelComponent(RobotModel(robot).block())
        found = dict(zip([v.name for v in plant.outputs], drive(plant, torque(160), PERIOD).T, strict=True))
        own = robot.joints[1].parameters
        twist = max(float(np.abs(found["q2"] - found["q_link2"]).max()) - own.get("gap", 0.0) / 2, 0.0)
        assert abs(own["K_cubic"]) * twist**2 > 0.2 * own["K"] / (1.2 if own["K_cubic"] < 0 else 1)

    @pytest.mark.parametrize("cubic", [3e5, -3e4])
    def test_a_gear_without_damping_keeps_the_energy(self, cubic: float) -> None:
        """Of two inertias on one cubic spring, K z^2 / 2 + K_cubic z^4 / 4: there is nothing else in the arm."""
        still = {"MX": 0.0, "MY": 0.0, "Fv": 0.0, "Fc": 0.0}
        gear = {"effects": ["joint_elasticity", "gear_hardening"], "K": 300.0, "K_cubic": cubic}
        robot = arm(joint1={"effects": [], **still}, joint2={**still, **gear})
        model = RobotModel(robot)
        plant = ModelComponent(model.block(), substeps=32)
        tau = np.zeros((400, 2))
        tau[:8, 1] = 12.0
        found = dict(zip([v.name for v in plant.outputs], drive(plant, tau, PERIOD).T, strict=True))
        twist = found["q2"] - found["q_link2"]
        links = np.column_stack([found["dq1"], found["dq_link2"]])
        zz1, zz2, rotor = (
            dict(zip((v.name for v in model.parameters), model.parameter_values, strict=True))[n]
            for n in ("ZZ1", "ZZ2", "Ia2")
        )
        mass = np.array([[zz1 + zz2, zz2], [zz2, zz2]])
        kinetic = 0.5 * np.einsum("ki,ij,kj->k", links, mass, links) + 0.5 * rotor * found["dq2"] ** 2
        stored = 0.5 * 300.0 * twist**2 + 0.25 * cubic * twist**4
        free = slice(25, None)
        assert np.ptp(stored[free]) > 0.02 * kinetic[free].max()
        assert np.abs(0.25 * cubic * twist**4)[free].max() > 0.02 * stored[free].max()
        assert np.ptp((kinetic + stored)[free]) < 1e-4 * np.ptp(stored[free])

    @pytest.mark.parametrize(
        "case", ["both", "backlash", "error of a gear", "hardening gear", "hardening gear with play"]
    )
    def test_the_augmented_fmu_is_valid_and_equals_the_model(self, case: str) -> None:
        block = RobotModel(SOFT[case][0]).block()
        path = build_fmu(block)
        assert validate_fmu(str(path)) == []
        tau = torque(120)
        first, second = (drive(part, tau, PERIOD) for part in (load_fmu(path), ModelComponent(block)))
        assert np.abs(first - second).max() < 1e-9 * np.abs(second).max()

    def test_substeps_follow_the_resonance(self) -> None:
        """The bound covers sqrt(K (1/Im + 1/J)): here 1/J is that of the free link alone."""
        block = RobotModel(arm(joint2={"effects": ["joint_elasticity"], "K": 1e6})).block()
        assert block.rate_bound is not None
        inertia = np.linalg.inv([[2.35 + 0.9, 0.35 + 0.45], [0.35 + 0.45, 0.35]])[1, 1]
        start = block.start(np.zeros(2), block.parameter_values)
        assert float(block.rate_bound(start, block.parameter_values)) > np.sqrt(1e6 * (1 / 0.15 + inertia))

    def test_substeps_follow_a_gear_that_hardens_at_its_load(self) -> None:
        """At the twist by what link 2 weighs, stretched out, and takes at nominal accelerations."""
        load = 9.81 * (0.9 + 0.1) + 10 * ((0.35 + 0.45) + 0.35)
        wanted, found = [], []
        for stiffness, cubic in ((800.0, 0.0), (800.0, 2e4), (800.0, 3e7), (800.0, -2e4)):
            roots = np.roots([max(cubic, 0.0), 0.0, stiffness, -load])
            (z,) = roots[np.abs(roots.imag) < 1e-9].real
            wanted.append(np.sqrt(stiffness + 3 * max(cubic, 0.0) * z**2))
            effects = ["joint_elasticity", "gear_hardening"]
            still = {"Fv": 0.0, "Fc": 0.0}
            gear = {"effects": effects, "K": stiffness, "K_cubic": cubic, **still}
            block = RobotModel(arm(joint1={"effects": [], **still}, joint2=gear)).block()
            assert block.rate_bound is not None
            values = block.parameter_values
            found.append(float(block.rate_bound(block.start(np.zeros(2), values), values)))
        assert np.array(found) / found[0] == pytest.approx(np.array(wanted) / wanted[0], rel=1e-6)


class TestIdentification:
    @pytest.mark.parametrize(
        "inside",
        [{}, {"transmission_error": UNEVEN}, {"gear_hardening": {"K_cubic": 4e5}}],
        ids=["even", "uneven", "hardening"],
    )
    def test_didim_finds_the_parameters_of_an_elastic_arm(self, inside: Mapping[str, Mapping[str, float]]) -> None:
        own = {name: value for values in inside.values() for name, value in values.items()}
        truth = arm(joint2={"effects": ["joint_elasticity", *inside], "K": 400.0, "D": 1.0, **own})
        model = RobotModel(truth)
        motion = reference(4.0)
        plant = with_compiled_twin(ModelComponent(model.block()))
        rule = law_block(law="pd", joints=["revolute"] * 2, Kp=[3300, 450], Kd=[150, 20])
        system = loop(plant, with_compiled_twin(ModelComponent(rule)), motion)
        parameters = RobotParameters(model, base_parameters(model))
        wanted = parameters.nominal()
        empty = model_on(system, parameters, motion, motion.time[:-1:2])
        found = Didim(start="reference").estimate(with_torque(empty, empty.torque(wanted)))
        assert found.status is Status.CONVERGED
        assert np.abs(found.base_value - wanted).max() < 1e-4


class TestInARobotDescription:
    def lag_case(self, folder: Path, **drive_effects: float) -> tuple[Path, RobotDescription]:
        robot = read_robot(ROOT / "fmus/scara/robot.yaml").model_dump(by_alias=True)
        joints = [dict(joint) for joint in robot["joints"]]
        joints[1]["effects"] = [*joints[1]["effects"], *(("actuator_lag",) if drive_effects else ())]
        joints[1]["parameters"] = {**joints[1]["parameters"], **drive_effects}
        described = RobotDescription.model_validate({**robot, "joints": joints})
        write_robot(described, folder / "robot.yaml")
        assert read_robot(folder / "robot.yaml") == described
        content = yaml.safe_load((ROOT / "examples/scara/identify.yaml").read_text(encoding="utf-8"))
        content["robot"] = str(folder / "robot.yaml")
        content["controller"]["source"] = str(ROOT / "controllers/scara_pd.yaml")
        for name in ("train", "validation"):
            content[name]["torque"] = {"file": str(folder / f"{name}.csv")}
        path = folder / "case.yaml"
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        return path, described

    def test_a_case_simulates_the_lag_of_a_drive(self, tmp_path: Path) -> None:
        path, _ = self.lag_case(tmp_path, T=0.008)
        table = fmu_didim.simulate(path)
        plain, _ = self.lag_case(tmp_path)
        case = load_case(plain, require_torque=False)
        motion = case.reference("estimation")
        plant = {f"{n}_start{j}": motion.select([f"{n}{j}"])[0, 0] for n in ("q", "dq") for j in (1, 2)}
        system = case.system("estimation", motion)
        system = system.replace("plant", system.components["plant"].with_parameters(plant))
        system = insert_effect(system, EFFECTS["actuator_lag"], 2, "revolute", values={"T": 0.008})  # type: ignore[arg-type]
        recorded = simulate(system, motion)
        logged = recorded.inputs[logged_torque(system, 2)]
        assert np.abs(table.select(["tau2"])[:, 0] - logged).max() < 1e-12 * np.abs(logged).max()
        assert np.abs(recorded.inputs["plant.tau2"] - logged).max() > 0.01
        assert np.abs(table.values - fmu_didim.simulate(plain).values).max() > 1e-3

    @pytest.mark.gate
    def test_identification_with_a_known_lag_finds_the_truth(self, tmp_path: Path) -> None:
        """Data made with the lag: with it in the description the values are the true ones, without it they are not."""
        path, described = self.lag_case(tmp_path, T=0.02)
        for label, which in (("estimation", "train"), ("validation", "validation")):
            table = fmu_didim.simulate(path, experiment=label)
            picked = slice(0, None, 20)
            names = [n for n in table.names if n.startswith("tau")]
            write_csv(
                trajectory(table.time[picked], {n: table.select([n])[picked, 0] for n in names}),
                tmp_path / f"{which}.csv",
            )
        truth = RobotParameters(RobotModel(described), base_parameters(RobotModel(described))).nominal()
        found = identify(path).estimate
        assert np.abs(found.base_value - truth).max() < 1e-4
        plain, _ = self.lag_case(tmp_path)
        assert np.abs(identify(plain).estimate.base_value - truth).max() > 1e-3

    @pytest.mark.parametrize(
        ("joint", "change", "message"),
        [
            (2, {"effects": ["base_tilt"]}, "belongs to joint 1"),
            (2, {"effects": ["log_time_shift"]}, "log_shift_s"),
            (2, {"effects": ["actuator_lag"], "T": -0.1}, "T = -0.1 must lie in 0 to 1"),
            (2, {"effects": ["joint_elasticity"], "D": -1.0}, "D = -1 must lie"),
            (2, {"effects": ["joint_elasticity"], "motor_share": 0.3}, "unknown parameters motor_share"),
            (2, {"effects": ["actuator_leg"]}, "actuator_lag"),
            (
                2,
                {"effects": ["transmission_error"]},
                "gives way: list joint_elasticity or backlash",
            ),
            (2, {"effects": ["gear_hardening"]}, "gear_hardening acts in a gear that gives way"),
            (2, {"effects": ["joint_elasticity", "gear_hardening"], "K_cubic": 1e25}, r"K_cubic = 1e\+25 must lie"),
            (
                2,
                {"effects": ["joint_elasticity", "transmission_error"], "gear_number": 0.0},
                "gear_number must be greater than 0",
            ),
        ],
    )
    def test_what_cannot_be_is_refused(self, joint: int, change: dict[str, Any], message: str) -> None:
        with pytest.raises((InputError, ValueError), match=message):
            arm(**{f"joint{joint}": change})

    def test_values_go_by_joint(self) -> None:
        robot = arm(joint2={"effects": ["actuator_lag", "joint_elasticity"], "K": 500.0})
        changed = robot.with_values({"T_2": 0.01, "K_2": 300.0, "Ia2": 0.2})
        assert {"T": 0.01, "K": 300.0, "Ia": 0.2}.items() <= dict(changed.joints[1].parameters).items()
