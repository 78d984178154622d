"""Builders for the tests of discovery: small arms, their cases, noise of known colour, blind cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import yaml
from scipy.signal import lfilter

from fmu_didim.case import load_case
from fmu_didim.cosim import sample_operator
from fmu_didim.data.signals import Trajectory, Variable, trajectory, write_csv
from fmu_didim.discovery.base_model import prepare
from fmu_didim.dynamics.effects import JointType, Surroundings, TorqueEffect
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.external_torque import ExternalTorque
from fmu_didim.model.loop_model import LoopModel
from tests.tools.blind.campaign import Order, make_order
from tests.tools.blind.translate import translate

Array = np.ndarray
RATE = 200
FREQUENCIES = np.array([1.0, 2.0, 3.0, 5.0])
AMPLITUDES = (np.array([0.5, -0.25, 0.12, 0.05]), np.array([-0.4, 0.3, 0.15, -0.06]))
PHASES = (np.array([0.3, 1.1, 2.0, -0.5]), np.array([0.9, -0.4, 0.2, 1.7]))
TRUTH = (
    {"ZZ": 1.2, "MX": 0.8, "MY": 0.1, "Fv": 1.5, "Fc": 2.0, "v0": 0.02},
    {"ZZ": 0.35, "MX": 0.35, "MY": -0.1, "Fv": 0.6, "Fc": 0.9, "v0": 0.02},
)
"""Standard parameters of the arm's joints."""
GAINS = ((3000.0, 150.0), (400.0, 20.0))
"""Kp and Kd of the joints."""


def sines(seconds: float, *, joints: int = 1, period_s: float = 4.0, rate_hz: float = RATE) -> Trajectory:
    """A periodic sum of sines with its exact derivatives; it starts neither at zero nor at rest."""
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    w = 2 * np.pi * FREQUENCIES / period_s
    columns = {}
    for order, name in enumerate(("q", "dq", "ddq")):
        for j in range(joints):
            angle = time[:, None] * w + PHASES[j] + order * np.pi / 2
            columns[f"{name}{j + 1}"] = (AMPLITUDES[j] * w**order * np.sin(angle)).sum(axis=1)
    return trajectory(time, columns)


def arm_document(
    joints: int, effects: Mapping[int, Sequence[str]] | None = None, gear: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """Arm in a vertical plane with viscous and Coulomb friction.

    Args:
        effects: joint from 1 -> further effects; gear: parameters of the elastic gear of joint 1, rigid without any.
    """
    inertial = [{k: v for k, v in TRUTH[j].items() if k not in ("Fv", "Fc", "v0")} for j in range(joints)]
    names = [f"{name}{j + 1}" for j in range(joints) for name in (*inertial[j], "Fv", "Fc")]
    gears = [["joint_elasticity"] if gear and j == 0 else [] for j in range(joints)]
    return {
        "schema": 1, "name": "arm", "gravity": [0.0, 0.0, -9.81],
        "joints": [
            {
                "type": "revolute", "alpha": 0.5 * np.pi if j == 0 else 0.0, "a": 0.0 if j == 0 else 0.4,
                "effects": ["viscous", "coulomb", *gears[j], *(effects or {}).get(j + 1, ())],
                "parameters": {**TRUTH[j], **((gear or {}) if j == 0 else {})},
            }
            for j in range(joints)
        ],
        "identified": {name: name for name in names},
    }  # fmt: skip


def arm_model(
    folder: Path,
    *,
    joints: int = 1,
    seconds: float = 8.0,
    rate_hz: float = 100.0,
    effects: Mapping[int, Sequence[str]] | None = None,
    values: Mapping[str, Mapping[str, float]] | None = None,
    second: Mapping[str, Mapping[str, float]] | None = None,
    gear: Mapping[str, float] | None = None,
    gain_factor: float = 1.0,
) -> LoopModel:
    """The arm in its loop at 200 Hz as a case on disk, loaded; its torque log is that of its own model, without noise.

    Args:
        values: effect -> its parameters on the first joint; second: the same of further effects on the second joint.
        gear: parameters of the elastic gear of the first joint, rigid without any.
        gain_factor: of all gains; large ones make the arm follow its reference closely.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_csv(sines(seconds, joints=joints), folder / "reference.csv")
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    write_csv(trajectory(time, {f"tau{j + 1}": np.zeros(time.size) for j in range(joints)}), folder / "torque.csv")
    controller = {
        "schema": 1, "law": "pd", "name": "arm_pd", "joints": ["revolute"] * joints, "rate_hz": float(RATE),
        "velocity": "measured",
        "Kp": [gain_factor * kp for kp, _ in GAINS[:joints]],
        "Kd": [float(np.sqrt(gain_factor)) * kd for _, kd in GAINS[:joints]],
    }  # fmt: skip
    case = {
        "schema": 1, "name": "arm", "robot": "robot.yaml", "plant": {"kind": "model"},
        "controller": {"kind": "model", "source": "controller.yaml"},
        "train": {"reference": {"file": "reference.csv"}, "torque": {"file": "torque.csv"}},
    }  # fmt: skip
    robot = arm_document(joints, {**(effects or {}), **({2: tuple(second)} if second else {})}, gear)
    for j, added in enumerate((values, second)):
        for own in (added or {}).values():
            robot["joints"][j]["parameters"] |= own
    for name, content in (("robot", robot), ("controller", controller), ("case", case)):
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    model = load_case(folder / "case.yaml").model
    assert model is not None
    return with_torque(model, model.torque(model.start))


def arm_case(
    folder: Path,
    added: Mapping[str, Mapping[str, float]] | None = None,
    *,
    joints: int = 1,
    second: Mapping[str, Mapping[str, float]] | None = None,
    rate_hz: float = 100.0,
    late_s: float = 0.0,
    sigma: float = 0.1,
    gear: Mapping[str, float] | None = None,
    held_out: bool = True,
    encoder: float | None = None,
    scale: float = 1.0,
) -> Path:
    """Case of the arm, whose plant has further effects on joint 1 that the robot description of the case lacks.

    Args:
        added: effect -> its parameters by plain name, shapes included; second: the same on joint 2.
        late_s: how late the torque log is stamped; its torque is interpolated between the ticks of the control.
        sigma: of the white noise on joint 1, a third of it on joint 2; held_out: whether there is a validation run.
        gear: parameters of the elastic gear of joint 1, which the description of the case has, too.
        encoder: noise of positions that are measured at 100 Hz, rad; None without; scale: of them, where it is wrong.
    """
    added = added or {}
    model = arm_model(
        folder, joints=joints, rate_hz=rate_hz, effects={1: tuple(added)}, values=added, second=second, gear=gear
    )
    experiment = data(model)
    deviation = sigma * np.array([1.0, 1 / 3][:joints])
    rng = np.random.default_rng(0)
    document = yaml.safe_load((folder / "case.yaml").read_text(encoding="utf-8"))
    for label, period_s in (("train", 4.0), ("validation", 4.4)):
        if label == "validation" and not held_out:
            continue
        motion = sines(8.0, joints=joints, period_s=period_s)
        write_csv(motion, folder / f"{label}_reference.csv")
        every = sample_operator(motion.time, start=0.0, step=1 / RATE, tick_count=motion.time.size)
        moved = model.with_experiment(model.first, replace(experiment, reference=motion, operator=every))
        run = moved.simulation(moved.start, moved.first)
        command = run.torque()
        noise = deviation * rng.normal(size=experiment.torque.shape)
        shown = experiment.time - late_s
        columns = {f"tau{j + 1}": np.interp(shown, motion.time, command[:, j]) + noise[:, j] for j in range(joints)}
        write_csv(trajectory(experiment.time, columns), folder / f"{label}_torque.csv")
        document[label] = {
            "reference": {"file": f"{label}_reference.csv"}, "torque": {"file": f"{label}_torque.csv"},
        }  # fmt: skip
        if encoder is not None:
            names = [f"q{j + 1}" for j in range(joints)]
            recording = run.record(all_ticks=True)
            at = recording.table([f"plant.{name}" for name in names], sampled=True)[::2]
            shown_at = scale * at + encoder * rng.normal(size=at.shape)
            encoders = trajectory(recording.time[::2], dict(zip(names, shown_at.T, strict=True)))
            write_csv(encoders, folder / f"{label}_encoders.csv", digits=9)
            document[label]["measured"] = {"file": f"{label}_encoders.csv"}
    robot = arm_document(joints, gear=gear)
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot, sort_keys=False), encoding="utf-8")
    (folder / "case.yaml").write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return folder / "case.yaml"


@dataclass(frozen=True)
class Run:
    """An experiment of the arm.

    Attributes:
        period_s: of its motion, which comes ``periods`` times; role: in the case; own: parameters of its own there.
        base: base parameters that the arm has in this run alone, such as with a payload; pushes: torques on the joint.
        has_effects: whether the plant has its further effects in this run.
    """

    period_s: float = 4.0
    periods: int = 2
    role: str = "estimation"
    own: tuple[str, ...] = ()
    base: Mapping[str, float] = field(default_factory=dict)
    pushes: tuple[ExternalTorque, ...] = ()
    has_effects: bool = True


def arm_experiments(
    folder: Path,
    runs: Mapping[str, Run],
    added: Mapping[str, Mapping[str, float]] | None = None,
    *,
    sigma: float = 0.1,
    rate_hz: float = 100.0,
) -> Path:
    """Case of an arm of one joint with several experiments, by label; its plant has effects that the case lacks."""
    added = added or {}
    plain = arm_model(folder / "plain")
    with_effects = arm_model(folder, effects={1: tuple(added)}, values=added)
    document = yaml.safe_load((folder / "case.yaml").read_text(encoding="utf-8"))
    del document["train"]
    document["experiments"] = {}
    rng = np.random.default_rng(0)
    for label, run in runs.items():
        motion = sines(run.periods * run.period_s, period_s=run.period_s)
        write_csv(motion, folder / f"{label}_reference.csv")
        time = np.arange(round(run.periods * run.period_s * rate_hz)) / rate_hz
        operator = sample_operator(time, start=0.0, step=1 / RATE, tick_count=motion.time.size)
        model = with_effects if run.has_effects else plain
        asked = Experiment(motion, time, np.zeros((time.size, 1)), operator)
        there = model.with_experiment(model.first, asked).pushed(model.first, run.pushes)
        values = np.array([run.base.get(name, v) for name, v in zip(model.names, model.start, strict=True)])
        torque = there.torque(values)[:, 0] + sigma * rng.normal(size=time.size)
        write_csv(trajectory(time, {"tau1": torque}), folder / f"{label}_torque.csv")
        document["experiments"][label] = {
            "reference": {"file": f"{label}_reference.csv"}, "torque": {"file": f"{label}_torque.csv"},
            "role": run.role, **({"own": list(run.own)} if run.own else {}),
        }  # fmt: skip
    for name, content in (("robot", arm_document(1)), ("case", document)):
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return folder / "case.yaml"


def base_of(case: Path | str) -> Fit:
    """The base model of a case, fitted with the noise of its data."""
    model = load_case(case).model
    assert model is not None
    return prepare(model).fit


def data(model: LoopModel) -> Experiment:
    """The first experiment."""
    return model.experiments[model.first]


def with_torque(model: LoopModel, torque: Array) -> LoopModel:
    """The same model with another log of the first experiment."""
    return model.with_experiment(model.first, replace(data(model), torque=torque))


def coloured(rng: np.random.Generator, shape: tuple[int, ...], rho: float, sigma: float | Array = 1.0) -> Array:
    """Stationary AR(1) noise along the first axis, of standard deviation sigma and lag-one correlation rho."""
    drive = rng.normal(size=shape)
    drive[1:] *= np.sqrt(1 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], drive, axis=0) * sigma)


def known_noise(sigma: float | Sequence[float], rho: float = 0.0) -> Noise:
    """Noise stated, not estimated."""
    deviation = np.atleast_1d(np.asarray(sigma, dtype=float))
    return Noise(deviation, np.full(deviation.size, rho), "periods")


class SwayTorque(TorqueEffect):
    """tau_e = Sw sin(3 q + 0.7): an effect from outside the tree."""

    name = "sway"
    title = "Sway"
    equation = "Sw*sin(3*q + 0.7)"
    class_name = "sway"
    signature = "Residual that depends on the position."
    experiment = "None."
    source = "made up for a test"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("Sw", "N.m", "parameter", 0.0, "amplitude"),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (ca.sin(3 * at.q + 0.7),)


def blind_case(
    folder: Path,
    effects: Sequence[str] = (),
    *,
    seed: int,
    level: float = 2.5,
    rate_hz: int = 100,
    clutter: bool = False,
    held_out: bool = True,
    robots: str = "development",
    one_joint: bool = False,
) -> Path:
    """Case made by the independent simulator and translated; what it hides is deleted, so that nothing can read it.

    Returns:
        The case file. What was hidden stands beside the folder, in ``<folder>.truth.yaml``.
    """
    make_order(Order(tuple(effects), seed, clutter, ((folder, rate_hz),), level, robots, one_joint))
    (folder / "truth.yaml").rename(folder.with_suffix(".truth.yaml"))
    if not held_out:
        (folder / "test_torque.csv").unlink()
    return translate(folder, folder / "input")


def hidden(folder: Path) -> list[tuple[str, int]]:
    """Effect and joint of what a blind case hides."""
    content = yaml.safe_load(folder.with_suffix(".truth.yaml").read_text(encoding="utf-8"))
    return [(item["effect"], int(item["joint"])) for item in content["truth"]]


def true_parameters(folder: Path) -> dict[str, float]:
    """The base parameters of the plant of a blind case."""
    content = yaml.safe_load(folder.with_suffix(".truth.yaml").read_text(encoding="utf-8"))
    return {name: float(value) for name, value in content["parameters"].items()}
