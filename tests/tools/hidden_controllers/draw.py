"""Machines with a controller that nobody tells, drawn by seed, and the log that is left of each.

A case is (robot, law, rate of the log, seed). The controller runs at ``CONTROL_HZ``; torque and positions are logged at
the rate of the case with white noise, the motion is one of the shipped examples. Gains come from the inertia M_j that
joint j feels on the way, and from frequencies and times that are drawn for each joint:

    PID, PD   Kp = M w^2, Kd = 2 d M w, Ki = i w Kp
    P-PI      Kp = M v, Kv, Ki = i Kp, feed-forward
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
import yaml

from fmu_didim import Case, Trajectory, load_case, simulate, trajectory, write_csv
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.controllers import LAWS
from fmu_didim.controllers.base import ControlEquations
from fmu_didim.controllers.pd import PD
from fmu_didim.data.signals import Array
from tests.conftest import ROOT

Robot = Literal["scara", "tx40"]
Hidden = Literal["cascade", "pid", "pd", "outside"]

EXAMPLES: Mapping[str, Path] = {
    "scara": ROOT / "examples/scara/identify_200hz.yaml", "tx40": ROOT / "examples/tx40/discover_wrist.yaml",
}  # fmt: skip
"""Robot -> example whose motions it makes."""
TITLES: Mapping[str, str] = {
    "cascade": "P-PI cascade with feed-forward", "pid": "PID with filter", "pd": "PD, gains times 0.8, with lag",
    "outside": "no law of the catalogue",
}  # fmt: skip
CONTROL_HZ = 200.0
"""[Hz] At which all controllers run, so that a log at this rate shows what they saw."""
FASTER: Mapping[str, float] = {"scara": 1.0, "tx40": 1.5}
"""[1] Robot -> by which its loops are faster than those of the SCARA, and its filters and lags shorter: there is more
friction to overcome."""
SCALE = 0.8
"""[1] Of the drive of the PD law: its gains are this times those that the case guesses."""
POSITION_NOISE, TORQUE_NOISE = 2e-5, 0.01
"""[rad], [1] Deviations of the noise: of positions, and of each torque over its RMS."""
RATES = ("measured", "backward_difference")
SOFTNESS = 1.0
"""[1] Error at which the soft law fades, over the RMS of the error of the PD law with its gains."""
FOLLOWS = 0.4
"""[1] RMS of the error over that of the motion, above which a draw is no controller, and the next one is taken."""
DRAWS = 20
"""[1] Most draws of a seed."""
OUTSIDE = ("computed_torque", "soft")
"""Laws that no candidate has, in turn by seed: the inverse dynamics, and a PD law whose action fades with the error."""


class SoftPD(PD):
    """command = Kp s tanh(e / s) + Kd (dq_ref - dq), e = q_ref - q.

    Attributes:
        softness: s of each joint, rad.
    """

    softness: tuple[float, ...]

    filters_velocity: ClassVar[bool] = True

    def commands(self, equations: ControlEquations, *, folder: Path) -> list[ca.SX]:
        result = []
        for j, (kp, kd, soft) in enumerate(zip(self.Kp, self.Kd, self.softness, strict=True), start=1):
            error, rate = self.error_and_rate(equations, j, self.velocity)
            result.append(kp * soft * ca.tanh(error / soft) + kd * rate)
        return result


@dataclass(frozen=True)
class Drawn:
    """A machine and its log.

    Attributes:
        truth: options of the controller that ran, gains with those of the drive; guess: of the controller that the
            case names, None where it knows nothing.
        reference: of the case; log: torque and positions.
    """

    robot: str
    truth: Mapping[str, Any]
    guess: Mapping[str, Any] | None
    reference: Mapping[str, Any]
    log: Trajectory

    def write(self, folder: Path) -> Path:
        """The case as a person would write it, in a folder; returns its file."""
        write_csv(self.log, folder / "log.csv")
        controller: dict[str, Any] = {"kind": "tracking"}
        if self.guess is not None:
            _write(folder / "guess.yaml", {"schema": 1, **self.guess})
            controller = {"kind": "model", "source": "guess.yaml"}
        content = {
            "schema": 1, "name": "which law?", "robot": str(ROOT / f"fmus/{self.robot}/robot.yaml"),
            "controller": controller, "loop": {"rate_hz": CONTROL_HZ},
            "train": {"reference": dict(self.reference), "torque": {"file": "log.csv"},
                      "positions": {"file": "log.csv"}},
        }  # fmt: skip
        _write(folder / "case.yaml", content)
        return folder / "case.yaml"


def _write(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(yaml.safe_dump(dict(content), sort_keys=False), encoding="utf-8")


@cache
def _machine(robot: Robot) -> Case:
    """The example, with its plant as a model."""
    # Its logs are not read: they may be longer than the motion that is taken.
    case = load_case(EXAMPLES[robot], require_torque=False)
    return case.with_(plant={"kind": "model"}, loop={"rate_hz": CONTROL_HZ, "drive_gains": None})


def _motion(robot: Robot, seed: int) -> Mapping[str, Any]:
    """One of the two motions of the example."""
    content = _machine(robot).content
    return dict(content["train" if seed % 2 else "validation"]["reference"])


def _felt(robot: Robot) -> Array:
    """(n,) mean diagonal of the inertia matrix along the motion of the example, kg.m2."""
    case = _machine(robot)
    model, n = case.parameters.model, case.parameters.joint_count
    along = case.reference("estimation")
    q = along.select([f"q{j}" for j in range(1, n + 1)])[:: max(along.time.size // 50, 1)]
    matrices = model.at_points("mass_matrix", q.T, model.parameter_values).reshape(-1, n, n)
    return np.asarray(np.diagonal(matrices, axis1=1, axis2=2).mean(axis=0))


def _options(robot: Robot, hidden: Hidden, seed: int, rng: np.random.Generator) -> dict[str, Any]:
    """Of a controller, gains drawn."""
    inertia, faster = _felt(robot), FASTER[robot]
    n = inertia.size

    def each(low: float, high: float) -> Array:
        return rng.uniform(low, high, n)

    found: dict[str, Any] = {"name": "hidden", "rate_hz": CONTROL_HZ, "velocity": str(rng.choice(RATES))}
    found["joints"] = ["revolute"] * n
    if hidden == "cascade":
        kp = inertia * faster * each(30, 65)
        own = {"law": "cascade_ppi", "Kp": kp, "Kv": faster * each(8, 16), "Ki": faster * kp * each(2, 6)}
        own |= {"feedforward": each(0.5, 0.9)}
    else:
        w = faster * each(14, 26)
        kp, kd = inertia * w**2, 2 * each(0.8, 1.2) * inertia * w
        own = {"law": hidden, "Kp": kp, "Kd": kd}
        if hidden == "pid":
            own |= {"Ki": each(0.1, 0.3) * w * kp, "filter_s": each(0.004, 0.01) / faster}
        elif hidden == "pd":
            own |= {"lag_s": each(0.004, 0.01) / faster}
        elif OUTSIDE[seed % 2] == "soft":
            own = {"law": "soft", "Kp": kp, "Kd": kd, "softness": np.full(n, 1e3)}
        else:
            own = {"law": "computed_torque", "Kp": w**2, "Kd": 2 * w}
            found["robot"] = str(ROOT / f"fmus/{robot}/robot.yaml")
    return found | {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in own.items()}


def _times(options: Mapping[str, Any], gain: float) -> dict[str, Any]:
    """The same law behind a drive with another gain."""
    return {**options, **{name: [gain * value for value in options[name]] for name in ("Kp", "Kd")}}


def draw(robot: Robot, hidden: Hidden, log_hz: float, seed: int) -> Drawn:
    """A machine whose controller moves it along the motion, and its log."""
    rng = np.random.default_rng([seed, *hidden.encode(), *robot.encode()])
    for _ in range(DRAWS):
        options = _options(robot, hidden, seed, rng)
        truth = _times(options, SCALE) if hidden == "pd" else options
        found = _run(robot, seed, truth)
        if found is not None and truth["law"] == "soft":
            truth = {**truth, "softness": (SOFTNESS * found[1]).tolist()}
            found = _run(robot, seed, truth)
        if found is not None:
            break
    else:
        raise RuntimeError(f"no controller of {DRAWS} moves the machine: {robot}, {hidden}, seed {seed}")
    run, columns, every = found[0], {}, round(CONTROL_HZ / log_hz)
    for name in [f"{kind}{j}" for kind in ("tau", "q") for j in range(1, len(options["joints"]) + 1)]:
        own = run.column(name)
        std = POSITION_NOISE if name.startswith("q") else TORQUE_NOISE * float(np.sqrt(np.mean(own**2)))
        columns[name] = (own + std * rng.normal(size=own.size))[::every]
    log = trajectory(run.time[::every], columns)
    guess = {k: v for k, v in options.items() if k != "lag_s"} if hidden == "pd" else None
    return Drawn(robot, truth, guess, _motion(robot, seed), log)


def _run(robot: Robot, seed: int, options: Mapping[str, Any]) -> tuple[Trajectory, Array] | None:
    """The loop along the motion, and the RMS of its errors (n,), rad; None where it does not follow."""
    law = SoftPD if options["law"] == "soft" else LAWS[str(options["law"])]
    reference = dict(_motion(robot, seed))
    case = _machine(robot).with_(controller=law.model_validate(options).block(), train={"reference": reference})
    try:
        run = simulate(case)
    except FmuDidimError:
        return None
    wanted, names = case.reference("estimation"), [f"q{j}" for j in range(1, case.parameters.joint_count + 1)]
    error = np.sqrt(((run.select(names) - wanted.select(names)[: run.time.size]) ** 2).mean(axis=0))
    follows = np.all(error <= FOLLOWS * wanted.select(names).std(axis=0))  # not so where it is no number
    return (run, error) if follows else None
