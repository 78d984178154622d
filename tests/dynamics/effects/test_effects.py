"""Every effect in the torque balance against its equation written down again, in simulation and identification."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline

import fmu_didim
from fmu_didim.base.documents import validate
from fmu_didim.base.errors import InputError
from fmu_didim.components import ModelComponent, load_fmu
from fmu_didim.data.signals import Variable
from fmu_didim.data.units import parse_unit
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.effects import EFFECTS, PAYLOAD, UNITS, JointTorque, Surroundings, TorqueEffect
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot, write_robot
from fmu_didim.dynamics.robot.observed_states import observed_along
from fmu_didim.estimators import Didim
from fmu_didim.export import build_fmu
from fmu_didim.fit.estimate import Status
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.model.prediction import predict
from tests.helpers import PERIOD, component, drive, law_block, loop, model_on, reference, with_torque

TORQUE = sorted(name for name, effect in EFFECTS.items() if isinstance(effect, TorqueEffect))
KINDS = ("revolute", "prismatic")


# ---- the equations once more ---------------------------------------------------------------------


@dataclass
class ProjectedMotion:
    """What the equations below see: (n,) motion and loads, j the effect's joint, p its parameters and shapes."""

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    j: int
    load: np.ndarray
    t: float
    z: float
    kind: str
    p: Mapping[str, float]
    moved_mass: Callable[[], np.ndarray]

    def s(self, speed: float | None = None) -> float:
        return float(np.tanh((self.dq[self.j] if speed is None else speed) / self.p["v0"]))


def stop(depth: float, width: float) -> float:
    if depth > width:
        return depth
    return 0.0 if depth < -width else (depth + width) ** 2 / (4 * width)


def step_at(t: float, at: float, width: float) -> float:
    return 1 / (1 + np.exp(-2 * (t - at) / width))


def lugre(x: ProjectedMotion) -> float:
    v = 5.0 if x.kind == "revolute" else 0.5
    w = v * np.tanh(x.dq[x.j] / v)
    zdot = w - abs(w) * x.z / x.p["zs"]
    force = x.p["Fz"] + x.p["Fzs"] * np.exp(-((x.dq[x.j] / x.p["vs"]) ** 2))
    return float(force * (x.z / x.p["zs"] + x.p["Tz"] * zdot / x.p["zs"]))


def efficiency(x: ProjectedMotion) -> float:
    """Away from the smoothed step: one factor while driving, another while driven."""
    load, s = x.load[x.j], x.s()
    driving, driven = 0.5 * (1 + s * np.sign(load)), 0.5 * (1 - s * np.sign(load))
    return float(abs(load) * s * (x.p["Fldrive"] * driving + x.p["Flback"] * driven))


def compensator(x: ProjectedMotion) -> float:
    """Force of the spring times d(length)/dq by differences."""
    foot, turn = x.p["Lc"], x.p["qc"]

    def length(q: float) -> float:
        if x.kind == "prismatic":
            return float(np.hypot(foot, q - turn))
        pin = x.p["rc"] * np.array([np.cos(q - turn), np.sin(q - turn)])
        return float(np.linalg.norm(pin + np.array([foot, 0.0])))

    rest = foot if x.kind == "prismatic" else float(np.hypot(foot, x.p["rc"]))
    q, h = float(x.q[x.j]), 1e-6
    return (x.p["Fgc"] + x.p["kgc"] * (length(q) - rest)) * (length(q + h) - length(q - h)) / (2 * h)


def curve(symbol: str, x: float, p: Mapping[str, float]) -> float:
    """By scipy: cubic splines on equally spaced knots, the first and the last one centred a knot beyond the ends."""
    low, high = p[f"{symbol}from"], p[f"{symbol}to"]
    step = (high - low) / 17
    knots = low + step * (np.arange(24) - 3)
    sizes = [p[f"c{symbol}{letter}"] for letter in "abcdefghijklmnopqrst"]
    return float(BSpline(knots, sizes, 3)(min(max(x, low), high - 1e-12)))


def since_reversal(x: ProjectedMotion) -> float:
    """Of a bristle of a quarter of the range, which has moved by d where 1 - 2 exp(-d/R) of it is bent."""
    length = x.p["rto"] / 4
    return float(-length * np.log(max((1 - x.s() * x.z / length) / 2, np.exp(-4.0))))


def both(value: float) -> np.ndarray:
    return np.array([value, value])


EQUATIONS: Mapping[str, Callable[[ProjectedMotion], float | np.ndarray]] = {
    "motor_inertia": lambda x: x.p["Ia"] * x.ddq[x.j],
    "viscous": lambda x: x.p["Fv"] * x.dq[x.j],
    "coulomb": lambda x: x.p["Fc"] * x.s(),
    "torque_offset": lambda x: x.p["offset"],
    "asymmetric_coulomb": lambda x: x.p["Fca"] * x.s() ** 2,
    "asymmetric_viscous": lambda x: x.p["Fva"] * abs(x.dq[x.j]),
    "quadratic_viscous": lambda x: x.p["Fq"] * np.sign(x.dq[x.j]) * x.dq[x.j] ** 2,
    "cubic_viscous": lambda x: x.p["Fcube"] * x.dq[x.j] ** 3,
    "power_viscous": lambda x: x.p["Fp"] * x.dq[x.j] * np.hypot(x.dq[x.j], x.p["v0"]) ** (x.p["alpha"] - 1),
    "stribeck": lambda x: x.p["Fs"] * x.s() * np.exp(-((x.dq[x.j] / x.p["vs"]) ** 2)),
    "presliding": lambda x: x.p["Fd"] * (x.z / x.p["zs"] - x.s()),
    "lugre": lugre,
    "load_dependent_friction": lambda x: x.p["Fl"] * abs(x.load[x.j]) * x.s(),
    "directional_efficiency": efficiency,
    "position_dependent_friction": lambda x: (
        (
            x.p["Fcos"] * np.cos(2 * np.pi * x.q[x.j] / x.p["lp"])
            + x.p["Fsin"] * np.sin(2 * np.pi * x.q[x.j] / x.p["lp"])
        )
        * x.s()
    ),
    "coupling_friction": lambda x: x.p["Fvm"] * x.dq[::-1] + x.p["Fcm"] * np.tanh(x.dq[::-1] / x.p["v0"]),
    "wrist_friction": lambda x: both(x.p["Fvw"] * x.dq.sum() + x.p["Fcw"] * x.s(x.dq.sum())),
    "coupled_inertia": lambda x: x.p["Iam"] * x.ddq[::-1],
    "spring": lambda x: x.p["k"] * x.q[x.j],
    "cubic_spring": lambda x: x.p["kcube"] * x.q[x.j] ** 3,
    "gravity_compensator": compensator,
    "torque_ripple": lambda x: x.p["Rsin"] * np.sin(x.p["nr"] * x.q[x.j]) + x.p["Rcos"] * np.cos(x.p["nr"] * x.q[x.j]),
    "current_ripple": lambda x: (
        x.load[x.j] * (x.p["Ksin"] * np.sin(x.p["nr"] * x.q[x.j]) + x.p["Kcos"] * np.cos(x.p["nr"] * x.q[x.j]))
    ),
    "contact_stop": lambda x: x.p["kupper"] * stop(x.q[x.j] - x.p["qupper"], x.p["wstop"]),
    "contact_stop_lower": lambda x: -x.p["klower"] * stop(x.p["qlower"] - x.q[x.j], x.p["wstop"]),
    "thermal_friction_drift": lambda x: (
        (1 - np.exp(-x.t / x.p["Theat"])) * (x.p["Fvt"] * x.dq[x.j] + x.p["Fct"] * x.s())
    ),
    "temperature_dependent_friction": lambda x: (x.z - 293.15) * (x.p["FvK"] * x.dq[x.j] + x.p["FcK"] * x.s()),
    "torque_drift": lambda x: x.p["drift"] * x.t,
    "torque_settling": lambda x: x.p["settled"] * (1 - np.exp(-x.t / x.p["Tsettle"])),
    "external_force": lambda x: (
        x.p["Fext"] * (step_at(x.t, x.p["t_on"], x.p["w_edge"]) - step_at(x.t, x.p["t_off"], x.p["w_edge"]))
    ),
    "curve_of_position": lambda x: curve("x", x.q[x.j], x.p),
    "curve_of_velocity": lambda x: curve("v", x.dq[x.j], x.p),
    "curve_of_load": lambda x: curve("l", x.load[x.j], x.p),
    "curve_of_time": lambda x: curve("t", x.t, x.p),
    "curve_of_reversal": lambda x: x.s() * curve("r", since_reversal(x), x.p),
    "curve_of_neighbour": lambda x: curve("n", x.q[x.j - 1], x.p),
    "payload_change": lambda x: step_at(x.t, x.p["t_load"], x.p["w_load"]) * x.moved_mass(),
}
FIRST_OF_TWO = ("coupling_friction", "wrist_friction", "coupled_inertia")
SHAPES = {
    "v0": 0.1,
    "vs": 0.4,
    "zs": 0.01,
    "qupper": 0.2,
    "qlower": 0.1,
    "wstop": 0.05,
    "nr": 3.0,
    "lp": 1.7,
    "Tz": 0.01,
    "lfrom": -19.0,  # splines 2.2 N.m apart: the gains 0.3 to 0.9 of neighbours make a slope that a joint may have
    "lto": 19.0,
}
"""Values with which the random motions below meet every part of the equations."""
SMALL = ("Fl", "Fldrive", "Flback", "Ksin", "Kcos")


def robot(kind: str, effect: str | None, **options: Any) -> RobotDescription:
    """Two joints under gravity, the effect at the second one (the first one of a pair)."""
    rng = np.random.default_rng(sum(map(ord, effect or "")))
    joints: list[dict[str, Any]] = []
    for j in range(2):
        links = {"XX": 0.5, "YY": 0.6, "ZZ": 0.4, "XY": 0.03, "MX": 0.4, "MY": 0.1, "MZ": -0.05, "M": 1.5}
        own: list[str] = []
        if effect is not None and j == place(effect):
            found = EFFECTS[effect]
            own = [effect]
            for v in found.parameters(kind):  # type: ignore[arg-type]
                links[v.name] = float(rng.uniform(0.1, 0.4) if v.name in SMALL else rng.uniform(0.3, 0.9))
            links |= {v.name: SHAPES[v.name] for v in found.shapes(kind) if v.name in SHAPES}  # type: ignore[arg-type]
        joints.append({"type": kind, "alpha": 0.9 * j, "a": 0.4 * j, "effects": own, "parameters": links})
    content = {"name": "arm", "gravity": (1.0, -9.0, 3.0), "joints": joints, **options}
    return validate(RobotDescription, content, where="robot.yaml")


def place(effect: str) -> int:
    return 0 if effect in FIRST_OF_TWO else 1


def extra_of(model: RobotModel, t: float, z: float) -> list[np.ndarray]:
    """The argument e, if the model takes one."""
    return [np.array([t if v.name == "clock" else z for v in model.extra])] if model.extra else []


def test_every_effect_has_its_equation_here() -> None:
    assert sorted(EQUATIONS) == TORQUE


@pytest.mark.gate
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", TORQUE)
def test_acceleration_changes_as_the_equation_says(name: str, kind: str) -> None:
    """M (ddq - ddq without the effect) = -tau_e(ddq), for random states and torques."""
    model, plain = RobotModel(robot(kind, name)), RobotModel(robot(kind, None))
    described, j = model.description.joints[place(name)], place(name)
    p = {
        v.name: described.parameters.get(v.name, v.start) for v in (*described.linear_parameters(), *described.shapes())
    }
    rng = np.random.default_rng(7)
    met = 0.0
    for _ in range(40):
        q, dq, tau = (
            rng.uniform(-1, 1, 2),
            rng.normal(size=2) * 10 ** rng.uniform(-2, 0.3),
            rng.normal(scale=20, size=2),
        )
        t, z = rng.uniform(0, 4), rng.uniform(-0.01, 0.01)
        chi, s = plain.parameter_values, plain.shape_values
        ddq = (
            model.direct(q, dq, tau, model.parameter_values, model.shape_values, *extra_of(model, t, z)).full().ravel()
        )
        load = plain.inverse(q, dq, ddq, chi, s).full().ravel()
        mass = plain.mass_matrix(q, chi).full()

        def moved_mass(
            q: np.ndarray = q, dq: np.ndarray = dq, ddq: np.ndarray = ddq, load: np.ndarray = load
        ) -> np.ndarray:
            heavier = plain.parameter_values
            for key in ("M", "MX", "MY", "MZ"):
                heavier[plain.parameter_index(f"{key}2")] += p[f"d{key}"]
            return plain.inverse(q, dq, ddq, heavier, plain.shape_values).full().ravel() - load

        motion_projection = ProjectedMotion(q, dq, ddq, j, load, float(t), float(z), kind, p, moved_mass)
        value = EQUATIONS[name](motion_projection)
        expected = np.asarray(value, dtype=float) if np.ndim(value) else np.eye(2)[j] * value
        got = mass @ (plain.direct(q, dq, tau, chi, s).full().ravel() - ddq)
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-7 * (1 + np.abs(expected).max()))
        met = max(met, float(np.abs(expected).max()))
    assert met > 0.05  # the effect was seen at all


@pytest.mark.gate
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", TORQUE)
def test_models_agree_with_each_other(name: str, kind: str) -> None:
    """direct after inverse is the identity to 1e-9, and the regressor rebuilds the torque."""
    model = RobotModel(robot(kind, name))
    rng = np.random.default_rng(8)
    chi, s = model.parameter_values, model.shape_values
    for _ in range(100):
        q, dq, ddq = rng.uniform(-1, 1, 2), rng.normal(size=2), rng.normal(scale=10, size=2)
        e = extra_of(model, rng.uniform(0, 4), rng.uniform(-0.01, 0.01))
        torque = model.inverse(q, dq, ddq, chi, s, *e).full().ravel()
        back = model.direct(q, dq, torque, chi, s, *e).full().ravel()
        assert np.abs(back - ddq).max() <= 1e-9 * (1 + np.abs(ddq).max())
        loads = model.transmitted(q, dq, ddq, chi).full().ravel()
        joints = [int(v.name.removeprefix("load")) - 1 for v in model.observed[len(model.extra) :]]
        observed = np.concatenate([*e, loads[joints]])[None, :] if model.observed else None
        rows = model.regressor_rows(q[None], dq[None], ddq[None], observed=observed)
        np.testing.assert_allclose(rows[0] @ chi, torque, rtol=0, atol=1e-11 * (1 + np.abs(torque).max()))


@pytest.mark.parametrize("seed", range(5))
def test_loads_of_three_joints_are_solved_for(seed: int) -> None:
    """Newton's steps settle the signs of three coupled loads, for any state."""
    rng = np.random.default_rng(seed)
    links = {"XX": 0.3, "YY": 0.3, "ZZ": 0.2, "MX": 0.3, "MY": 0.1, "M": 1.5, "Ia": 0.2, "Fl": 0.25, "Fc": 1.0}
    joints = [
        {"type": "revolute", "alpha": rng.uniform(-2, 2), "a": 0.4, "parameters": links,
         "effects": ["motor_inertia", "coulomb", "load_dependent_friction"]}
        for _ in range(3)
    ]  # fmt: skip
    model = RobotModel(validate(RobotDescription, {"name": "arm", "joints": joints}, where="robot.yaml"))
    chi, s = model.parameter_values, model.shape_values
    for _ in range(200):
        q, dq, ddq = rng.uniform(-3, 3, 3), rng.normal(size=3), rng.normal(scale=10, size=3)
        torque = model.inverse(q, dq, ddq, chi, s)
        assert np.abs(model.direct(q, dq, torque, chi, s).full().ravel() - ddq).max() <= 1e-9 * (1 + np.abs(ddq).max())


# ---- what each effect says of itself -------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_metadata_is_complete(name: str) -> None:
    effect = EFFECTS[name]
    for text in (effect.title, effect.equation, effect.class_name, effect.signature, effect.experiment, effect.source):
        assert text.strip()
    assert effect.name == name
    assert effect.place in ("torque balance", "controller", "drive", "sensor", "structure", "measurement")
    assert set(effect.confounded_with) <= set(EFFECTS) - {name}
    for kind in KINDS:
        variables = (*effect.parameters(kind), *effect.shapes(kind))  # type: ignore[arg-type]
        assert len({v.name for v in variables}) == len(variables)
        assert all(v.description and parse_unit(v.unit) is not None for v in variables)
        assert all(not v.name[-1].isdigit() for v in effect.parameters(kind))  # type: ignore[arg-type]
        for shape, search in effect.search(kind).items():  # type: ignore[arg-type]
            assert shape in {v.name for v in variables}
            assert search.lowest < search.highest
            assert search.count > 1
            assert search.lowest > 0 or not search.logarithmic


WORDS = {"delay", "motor_inertia"}
"""Names of effects that are words of the loop or of a prior as well."""


def test_no_effect_is_named_outside_its_own_folder() -> None:
    """What other modules do with an effect follows from what it says of itself."""
    package = Path(fmu_didim.__file__).parent
    found = [
        f"{path.relative_to(package)}:{node.lineno} {node.value}"
        for path in sorted(package.rglob("*.py"))
        if path.parent.name != "effects"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in set(EFFECTS) - WORDS
    ]
    assert found == []


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_what_an_effect_says_to_discovery_fits_together(name: str) -> None:
    effect = EFFECTS[name]
    assert effect.is_linear == (effect.place == "torque balance")
    assert effect.first_order is None or not effect.is_linear, "columns say it of an effect in the torque balance"
    for kind in KINDS:
        amplitudes = [v.name for v in effect.parameters(kind)]  # type: ignore[arg-type]
        shapes = [v.name for v in effect.shapes(kind)]  # type: ignore[arg-type]
        assert effect.is_linear or set(amplitudes) <= set(effect.neutral)
        check = effect.pre_check
        assert check is None or amplitudes == [name for name in (check.parameter, check.speed) if name]
        assert effect.distance in ("", *shapes)
        assert effect.allows({v.name: v.start for v in effect.shapes(kind)})  # type: ignore[arg-type]
    if effect.first_order is not None:
        t = np.linspace(0.0, 1.0, 50)
        column = effect.first_order.column(JointTorque(np.sin(5 * t), np.cos(4 * t), float(t[1])))
        assert column.shape == t.shape and np.abs(column).max() > 0


def torque_unit(v: Variable, kind: str, name: str) -> str:
    """Unit of amplitude times column, the column's unit written out by hand."""
    length, torque = ("rad", "N.m") if kind == "revolute" else ("m", "N")
    column = {
        **dict.fromkeys(("Ia", "Iam"), f"{length}/s2"),
        "Fq": f"{length}2/s2", "Fcube": f"{length}3/s3", "kcube": f"{length}3", "drift": "s",
        **dict.fromkeys(("Fv", "Fva", "Fvm", "Fvw", "Fvt"), f"{length}/s"),
        "FvK": f"{length}.K/s", "FcK": "K",
        **dict.fromkeys(("k", "kupper", "klower"), length),
        **dict.fromkeys(("Fl", "Fldrive", "Flback", "Ksin", "Kcos"), torque),
    }  # fmt: skip
    return f"{v.unit}|{column.get(v.name, '1')}"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", [n for n in TORQUE if n not in ("gravity_compensator", "payload_change")])
def test_units_of_the_amplitudes(name: str, kind: str) -> None:
    """Amplitude times column is a torque. (rad counts as 1.)"""
    for v in EFFECTS[name].parameters(kind):  # type: ignore[arg-type]
        assert v.start == 0.0
        exponents: dict[str, int] = {}
        for unit in torque_unit(v, kind, name).split("|"):
            known = parse_unit(unit)
            assert known is not None
            for base, power in known.powers.items():
                exponents[base] = exponents.get(base, 0) + power
        exponents.pop("rad", None)
        expected = {"kg": 1, "m": 2, "s": -2} if kind == "revolute" else {"kg": 1, "m": 1, "s": -2}
        assert {base: power for base, power in exponents.items() if power} == expected


def test_needs_are_what_the_columns_depend_on() -> None:
    for name in TORQUE:
        effect = EFFECTS[name]
        assert isinstance(effect, TorqueEffect)
        motion = [ca.SX.sym(letter, 2) for letter in ("q", "dq", "ddq")]
        load, time = ca.SX.sym("load"), ca.SX.sym("t")
        link = {key: ca.SX.sym(key, 2) for key in ("M", "MX", "MY", "MZ")}
        state = tuple(ca.SX.sym(v.name) for v in effect.states("revolute"))
        at = Surroundings(0, "revolute", *motion, load=load, time=time, state=state, link=link)
        columns = effect.columns(at, {v.name: ca.SX.sym(v.name) for v in effect.shapes("revolute")})
        entries = [e for c in columns for e in (c.values() if isinstance(c, Mapping) else [c])]
        whole = ca.vertcat(*entries)
        others = ca.vertcat(*(x[1] for x in motion), *link.values())
        found = {
            word
            for word, symbols in (("load", load), ("time", time), ("other joints", others))
            if ca.depends_on(whole, symbols)
        }
        assert found == effect.needs, name


def slopes(effect: TorqueEffect, kind: Any, q: float, load: float) -> np.ndarray:
    """Slopes of columns and rates by motion, load, states and shapes, at rest with this position and load."""
    motion = {letter: ca.SX.sym(letter, 2) for letter in ("q", "dq", "ddq")}
    states, shapes = effect.states(kind), effect.shapes(kind)
    state, shape = ca.SX.sym("z", len(states)), ca.SX.sym("s", len(shapes))
    torque, time = ca.SX.sym("load"), ca.SX.sym("t")
    link = dict.fromkeys(PAYLOAD, ca.SX(np.ones(2)))
    at = Surroundings(0, kind, *motion.values(), torque, time, tuple(ca.vertsplit(state)) if states else (), link)
    values = {v.name: shape[k] for k, v in enumerate(shapes)}
    entries = [e for c in effect.columns(at, values) for e in (c.values() if isinstance(c, Mapping) else [c])]
    by = ca.vertcat(*motion.values(), torque, state, shape)
    slope = ca.jacobian(ca.vertcat(*entries, *effect.rates(at, values)), by)
    at_rest = [q, q, *[0.0] * 4, load, *(v.start for v in states), *(v.start for v in shapes)]
    return np.asarray(ca.Function("slope", [by, time], [slope])(at_rest, 0.0).full())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", TORQUE)
def test_slopes_at_rest_are_finite(name: str, kind: str) -> None:
    """dq = 0, where sign(dq), |dq|^alpha and sqrt(dq^2) have none: the implicit integration of plants takes them."""
    effect = EFFECTS[name]
    assert isinstance(effect, TorqueEffect)
    for q, load in ((0.0, 0.0), (0.3, 2.0), (-0.3, -2.0)):
        assert np.isfinite(slopes(effect, kind, q, load)).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", TORQUE)
def test_description_is_written_and_read(name: str, kind: str, tmp_path: Path) -> None:
    described = robot(kind, name)
    write_robot(described, tmp_path / "robot.yaml")
    assert read_robot(tmp_path / "robot.yaml") == described


def test_shared_shapes_are_one_parameter() -> None:
    joint = {"type": "revolute", "effects": ["coulomb", "stribeck", "lugre", "presliding"]}
    described = validate(RobotDescription, {"name": "arm", "joints": [joint]}, where="robot.yaml")
    assert [v.name for v in described.shape_parameters()] == ["v0_1", "vs_1", "zs_1", "Tz_1"]


def test_wrong_effects_are_refused() -> None:
    joint = {"type": "revolute", "effects": ["viscos", "coulomb", "coulomb"]}
    with pytest.raises(InputError) as caught:
        validate(RobotDescription, {"name": "arm", "joints": [joint]}, where="robot.yaml")
    text = str(caught.value)
    assert "Did you mean 'viscous'?" in text
    assert "coulomb is listed twice" in text
    pair = {"type": "revolute", "effects": ["coupling_friction"]}
    with pytest.raises(InputError, match=r"coupling_friction at joint 1 needs 1 more joint"):
        validate(RobotDescription, {"name": "arm", "joints": [pair]}, where="robot.yaml")


class Wind(TorqueEffect):
    """An effect outside the tree."""

    name, title, equation, class_name = "wind", "Wind", "Fw*sin(t)", "wind"
    signature = experiment = source = "this test"
    needs = frozenset({"time"})

    def parameters(self, joint_type: Any) -> tuple[Variable, ...]:
        return (Variable("Fw", UNITS[joint_type].torque, "parameter", 0.0, "wind"),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (ca.sin(at.time),)


class Root(Wind):
    """|dq|^(1/2): its slope at rest is infinite."""

    name = "root"

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (ca.sqrt(ca.fabs(at.dq)),)


def test_an_infinite_slope_at_rest_is_seen() -> None:
    assert not np.isfinite(slopes(Root(), "revolute", 0.3, 2.0)).all()


def test_effect_outside_the_tree() -> None:
    joint = {
        "type": "revolute",
        "effects": ["tests.dynamics.effects.test_effects:Wind"],
        "parameters": {"ZZ": 2.0, "Fw": 3.0},
    }
    described = validate(RobotDescription, {"name": "arm", "joints": [joint]}, where="robot.yaml")
    model = RobotModel(described)
    assert [v.name for v in model.extra] == ["clock"]
    got = model.direct([0.1], [0.2], [0.5], model.parameter_values, model.shape_values, [0.7])
    assert float(got) == pytest.approx((0.5 - 3 * np.sin(0.7)) / 2.0, rel=1e-14)
    joint["effects"] = ["tests.dynamics.effects.test_effects:ProjectedMotion"]
    with pytest.raises(InputError, match="cannot be listed at a joint: it is not an effect"):
        validate(RobotDescription, {"name": "arm", "joints": [joint]}, where="robot.yaml")


# ---- states and time -----------------------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize(("limited", "tolerance"), [(True, 5e-6), (False, 1e-3)])
@pytest.mark.parametrize("name", ["presliding", "lugre"])
def test_presliding_follows_dahl(name: str, limited: bool, tolerance: float) -> None:
    """A block of 0.5 kg.m2 rocked by a sine, against LSODA on our equation and on Dahl's, without limit of speed."""
    values = {
        "ZZ": 0.5,
        "Fv": 0.3,
        "Fc": 1.0,
        "zs": 0.01,
        "v0": 0.02,
        "vs": 0.2,
        "Tz": 0.01,
        "Fd": 1.0,
        "Fz": 1.0,
        "Fzs": 0.6,
    }
    own = ["viscous", "coulomb", "presliding"] if name == "presliding" else ["viscous", "lugre"]
    used = {"presliding": ("ZZ", "Fv", "Fc", "v0", "zs", "Fd"), "lugre": ("ZZ", "Fv", "zs", "vs", "Tz", "Fz", "Fzs")}[
        name
    ]
    joint = {"type": "revolute", "effects": own, "parameters": {k: values[k] for k in used}}
    content = {"name": "block", "gravity": (0, 0, 0), "joints": [joint]}
    model = RobotModel(validate(RobotDescription, content, where="robot.yaml"))
    period, ticks = 0.001, 3000
    torque = 1.6 * np.sin(2 * np.pi * 1.5 * period * np.arange(ticks))[:, None]
    table = drive(ModelComponent(model.block()), torque, period)
    names = [v.name for v in model.block().outputs]
    assert names == ["q1", "dq1", "ddq1", f"z_{name}1"]

    def right(t: float, x: np.ndarray, tau: float) -> list[float]:
        _, v, z = x
        w = 5 * np.tanh(v / 5) if limited else v
        rate = w - abs(w) * z / values["zs"]
        if name == "presliding":
            friction = values["Fd"] * z / values["zs"]
        else:
            friction = (
                (values["Fz"] + values["Fzs"] * np.exp(-((v / values["vs"]) ** 2)))
                * (z + values["Tz"] * rate)
                / values["zs"]
            )
        return [v, (tau - values["Fv"] * v - friction) / values["ZZ"], rate]

    x, states = np.zeros(3), []
    for k in range(ticks):
        solution = solve_ivp(right, (0, period), x, method="LSODA", args=(float(torque[k, 0]),), rtol=1e-10, atol=1e-13)
        states.append(x)
        x = solution.y[:, -1]
    expected = np.array(states)
    for column, place_ in ((0, 0), (1, 1), (3, 2)):
        size = np.abs(expected[:, place_]).max()
        assert np.abs(table[:, column] - expected[:, place_]).max() <= tolerance * size
    assert np.abs(expected[:, 2]).max() > 0.9 * values["zs"]  # it slid, not only stuck


def test_clock_starts_where_it_is_told() -> None:
    block = RobotModel(robot("revolute", "torque_drift")).block({"t_start": 3.0})
    outputs = [v.name for v in block.outputs]
    table = drive(ModelComponent(block), np.zeros((10, 2)), PERIOD)
    np.testing.assert_allclose(table[:, outputs.index("clock")], 3.0 + PERIOD * np.arange(10), rtol=1e-13)


EXPORTED = [
    "presliding", "thermal_friction_drift", "temperature_dependent_friction", "load_dependent_friction",
    "payload_change", "wrist_friction",
]  # fmt: skip


@pytest.mark.gate
@pytest.mark.parametrize("name", EXPORTED)
def test_fmu_equals_the_model(name: str) -> None:
    block = RobotModel(robot("revolute", name)).block()
    torque = 5 * np.sin(np.arange(60)[:, None] * np.array([0.11, 0.23]))
    inside = drive(ModelComponent(block), torque, PERIOD)
    outside = drive(load_fmu(build_fmu(block)), torque, PERIOD)
    np.testing.assert_allclose(outside, inside, rtol=1e-10, atol=1e-11)


# ---- identification ------------------------------------------------------------------------------


IDENTIFIED = {
    "presliding": {"Fd": 1.6, "zs": 0.02},
    "lugre": {"Fz": 1.5, "Fzs": 0.8, "zs": 0.02},
    "stribeck": {"Fs": 1.2, "vs": 0.3},
    "load_dependent_friction": {"Fl": 0.12},
    "directional_efficiency": {"Fldrive": 0.15, "Flback": 0.08},
    "thermal_friction_drift": {"Fvt": -0.4, "Fct": -0.6, "Theat": 2.0},
    "external_force": {"Fext": 2.0, "t_on": 1.0, "t_off": 1.6},
    "payload_change": {"dM": 0.5, "dMX": 0.15, "dMY": 0.04, "t_load": 1.5},
    "wrist_friction": {"Fvw": 0.5, "Fcw": 0.7},
    "temperature_dependent_friction": {"FvK": -0.01, "FcK": -0.02},
}
AT_46_DEGC = {"temperature_start1": 319.15, "warming_start1": 0.0}


def arm_model(name: str, kind: str = "model") -> tuple[LoopModel, np.ndarray]:
    """A vertical arm under PD control at 200 Hz, the effect at joint 1 (payload: 2), torque without noise at 50 Hz."""
    described = read_robot("fmus/arm2r/robot.yaml").model_copy(update={"identified": "computed"})
    joints = list(described.joints)
    at = 1 if name == "payload_change" else 0
    joints[at] = joints[at].model_copy(update={
        "effects": (*joints[at].effects, name), "parameters": {**joints[at].parameters, **IDENTIFIED[name]},
    })  # fmt: skip
    content = described.model_copy(update={"joints": tuple(joints)}).model_dump(mode="json", by_alias=True)
    robot_model = RobotModel(validate(RobotDescription, content, where="robot.yaml"))
    parameters = RobotParameters(robot_model, base_parameters(robot_model))
    motion = reference(3.0, start=0.0)
    gains = law_block(law="pd", joints=["revolute"] * 2, Kp=[4000, 900], Kd=[250, 50])
    system = loop(component(kind, robot_model.block()), component(kind, gains), motion)
    time = np.arange(0, 3.0, 0.02)
    empty, truth = model_on(system, parameters, motion, time), parameters.nominal()
    if EFFECTS[name].given_states:
        warming = {"temperature_start1": 293.15, "warming_start1": 5.0}
        for label, experiment in empty.experiments.items():
            empty = empty.with_experiment(label, replace(experiment, measured_starts=warming))
    return with_torque(empty, empty.torque(truth)), truth


@pytest.mark.gate
@pytest.mark.parametrize("name", sorted(IDENTIFIED))
def test_closed_loop_torque_is_regressor_times_parameters(name: str) -> None:
    model, truth = arm_model(name)
    prediction = predict(model, truth)
    assert prediction.regressor is not None
    assert prediction.known is not None
    rebuilt = prediction.regressor @ truth + prediction.known
    np.testing.assert_allclose(rebuilt, prediction.torque, rtol=0, atol=1e-11 * np.abs(prediction.torque).max())


@pytest.mark.gate
@pytest.mark.parametrize("name", sorted(IDENTIFIED))
def test_amplitudes_are_identified_from_the_reference(name: str) -> None:
    model, truth = arm_model(name)
    estimate = Didim(start="reference").estimate(model)
    assert estimate.status is Status.CONVERGED
    own = [v.name for v in EFFECTS[name].parameters("revolute") if v.name in IDENTIFIED[name]]
    at = 2 if name == "payload_change" else 1
    assert {f"{v}{at}" for v in own} <= {n.removesuffix("R") for n in estimate.names}
    np.testing.assert_allclose(estimate.value, truth, rtol=1e-4, atol=1e-5 * np.abs(truth).max())


def test_states_along_a_motion_are_those_of_the_simulation() -> None:
    """For the start of an estimation: states integrated along a table of positions and velocities."""
    model, truth = arm_model("presliding")
    recording = model.simulation(truth).record(all_ticks=True)
    assert recording.time.size == 601
    q, dq, ddq = (recording.table([f"plant.{n}{j}" for j in (1, 2)]) for n in ("q", "dq", "ddq"))
    assert isinstance(model.parameters, RobotParameters)
    got = observed_along(model.parameters.model, recording.time, q, dq, ddq)
    expected = recording.table(["plant.z_presliding1"])
    # Velocity is taken for a straight line between samples 5 ms apart.
    assert np.abs(got - expected).max() <= 0.02 * np.abs(expected).max()


def test_a_cable_that_wraps_is_an_efficiency_by_direction() -> None:
    """The torque of the drive is exp(mu phi) times that of the load, or exp(-mu phi) times it, away from standstill."""
    wrapped = 0.1 * np.pi
    joint = {"type": "revolute", "effects": ["directional_efficiency"], "parameters": {
        "MX": 4.0, "Fldrive": float(np.exp(wrapped) - 1), "Flback": float(1 - np.exp(-wrapped)), "v0": 1e-4,
    }}  # fmt: skip
    content = {"name": "hoist", "gravity": (0, -9.81, 0), "joints": [joint]}
    model = RobotModel(validate(RobotDescription, content, where="robot.yaml"))
    for q, dq in ((0.0, 1.0), (0.0, -1.0), (np.pi, 1.0), (np.pi, -1.0)):
        load = 4.0 * 9.81 * np.cos(q)
        expected = load * np.exp(wrapped * np.sign(load * dq))
        torque = model.inverse([q], [dq], [0.0], model.parameter_values, model.shape_values)
        assert float(torque) == pytest.approx(expected, rel=1e-6)


def test_a_measured_temperature_is_a_line_from_where_the_plant_is_told() -> None:
    name = "temperature_dependent_friction"
    j = place(name) + 1
    starts = {f"temperature_start{j}": 310.0, f"warming_start{j}": 0.5}
    block = RobotModel(robot("revolute", name)).block(starts)
    outputs = [v.name for v in block.outputs]
    table = drive(ModelComponent(block), np.zeros((10, 2)), PERIOD)
    found = table[:, outputs.index(f"temperature_{name}{j}")]
    np.testing.assert_allclose(found, 310.0 + 0.5 * PERIOD * np.arange(10), rtol=1e-13)
    units = {v.name: v.unit for v in block.parameters if v.name in block.fixed}
    assert [units[name] for name in starts] == ["K", "K/s"]


def test_a_warm_machine_moves_as_one_with_the_friction_that_it_has_then() -> None:
    """At 46 degC, 26 K above 20, each friction is what its coefficient makes of it; the compiled loop has it, too."""
    warm, cold = arm_model("temperature_dependent_friction"), arm_model("temperature_dependent_friction")
    (model, truth), (plain, values) = warm, cold
    names = [p.name for p in model.free_parameters]
    places = [names.index(name) for name in ("Fv1", "Fc1", "FvK1", "FcK1")]
    model = model.with_experiment("estimation", replace(model.experiments["estimation"], measured_starts=AT_46_DEGC))
    values = values.copy()
    values[places] = truth[places[0]] + 26 * truth[places[2]], truth[places[1]] + 26 * truth[places[3]], 0.0, 0.0
    peak = np.abs(plain.torque(values)).max()
    np.testing.assert_allclose(model.torque(truth), plain.torque(values), rtol=0, atol=1e-6 * peak)
    assert np.abs(model.torque(truth) - plain.torque(truth)).max() > 0.1


def test_offset_and_asymmetric_coulomb_are_two_parameters() -> None:
    """Distinct at small speeds only; the base parameters keep both."""
    joint = {
        "type": "revolute",
        "effects": ["coulomb", "torque_offset", "asymmetric_coulomb", "stribeck", "presliding"],
    }
    model = RobotModel(validate(RobotDescription, {"name": "arm", "joints": [joint]}, where="robot.yaml"))
    assert base_parameters(model).standard == ("ZZ1", "Fc1", "offset1", "Fca1", "Fs1", "Fd1")


@pytest.mark.parametrize("name", TORQUE)
def test_amplitudes_take_part_in_the_base_parameters(name: str) -> None:
    """Each amplitude is identified or regroups into another parameter; none is lost."""
    model = RobotModel(robot("revolute", name))
    base = base_parameters(model)
    joint, number = model.description.joints[place(name)], place(name) + 1
    amplitudes = {f"{v.name}{number}" for e in joint.effect_objects() for v in e.parameters(joint.type)}
    found = {base.standard_names[i] for i in (*base.index, *base.dependent)}
    assert amplitudes <= found
