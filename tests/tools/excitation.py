"""Designed motions beside random ones, and predicted standard deviations beside those of many identifications.

    python -m tests.tools.excitation run FOLDER --robots tx40                  one JSON file a robot
    python -m tests.tools.excitation run FOLDER --robots ur10e --urdf ur10e.urdf
    python -m tests.tools.excitation publish FOLDER --figures docs/figures/excitation.json

``excite`` designs a Fourier series and moves from point to point by the mean of the relative standard deviations. Fifty
Fourier series are drawn at random, each as large as the same limits allow, and simulated in the same loop; unlike
designed ones they need not keep the limits there. The designed series has more harmonics, with which random ones are
worse: fifty of these are drawn, too. Noise is drawn for the log of the designed series, and the robot
identified, again and again.

The UR10e is that of shamilmamedov/dynamic_calibration (URe/urdf/ur10e.urdf), which is not shipped; its URDF has
no friction and no rotors, so that shares of the largest torque of each joint stand for them.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim import Case, excite, load_case
from fmu_didim.checks.data.expected_accuracy import ExpectedAccuracy
from fmu_didim.data.excitation import Fourier
from fmu_didim.data.signals import Array
from fmu_didim.discovery.excitation.optimum import Problem
from fmu_didim.discovery.excitation.series import Series
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot, write_robot
from fmu_didim.estimators import Didim
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.workflow.excitation.excited import Excited
from fmu_didim.workflow.excitation.planned import Peaks, Plan, Prediction, mean_percent, predict
from tests.figures import command_of, table, write_figures
from tests.helpers import ROOT, with_torque

RANDOM, STARTS = 50, 6
"""[motions], [starts of the design]"""
HARMONICS, USUAL = 8, 5
"""[1] Of the designed series, and of those at random."""
DRAWS = 300
"""[identifications] By which a deviation is known to 4 %."""
WITHIN = 0.1
"""[1] Of one, within which a deviation that is found is as predicted."""
CONTROL_HZ, BANDWIDTH = 200.0, 40.0
"""[Hz], [rad/s] Of the PD controllers of the robots of six joints: Kp = M w^2, Kd = 2 M w, M the inertia felt."""
NOISE, COULOMB, VISCOUS, ROTOR = 0.005, 0.04, 0.04, 0.005
"""[1], [1], [s/rad], [s2/rad] Times the largest torque of a joint: the noise of its log, and, of the UR10e, its
friction and the inertia of its rotor."""


@dataclass(frozen=True)
class Machine:
    """A robot, how it moves and how it is logged.

    Attributes:
        limits: of the motion; rate_hz: of the log; period_s, periods: of the motion; moves: from point to point.
    """

    title: str
    limits: Mapping[str, Any]
    rate_hz: float
    period_s: float
    periods: int
    moves: int


MACHINES: Mapping[str, Machine] = {
    "scara": Machine(
        "SCARA",
        {"position": [[-1.5, 1.5], [-2, 2]], "velocity": [3, 4], "acceleration": [10, 20], "torque": [40, 3]},
        10.0, 10.0, 1, 12,
    ),
    "tx40": Machine(
        "TX40",
        {
            "position": [[-2, 2], [-1.5, 1.5], [-2, 2], [-2, 2], [-1.8, 1.8], [-3, 3]], "velocity": [3, 3, 4, 4, 4, 6],
            "acceleration": [12, 12, 15, 20, 20, 30], "torque": [100, 100, 50, 20, 20, 10],
        },
        50.0, 5.0, 2, 6,
    ),
    "ur10e": Machine(
        "UR10e",
        {
            "position": [[-2, 2], [-2.6, -0.5], [-2.2, 2.2], [-2, 2], [-2, 2], [-2.5, 2.5]],
            "velocity": [2, 2, 2, 3, 3, 3], "acceleration": [5, 5, 8, 10, 10, 10],
            "torque": [330, 330, 150, 54, 54, 54],
        },
        50.0, 5.0, 2, 6,
    ),
}  # fmt: skip


def noise(machine: Machine) -> Array:
    """(n,) standard deviation of the noise of the torque."""
    return NOISE * np.array(machine.limits["torque"], dtype=float)


def of_urdf(path: Path, torque: Sequence[float]) -> RobotDescription:
    """The robot of a URDF with rotors and friction, as shares of the largest torque of each joint."""
    robot = read_robot(path)
    joints = []
    for joint, most in zip(robot.joints, torque, strict=True):
        own = {"Ia": ROTOR * most, "Fv": VISCOUS * most, "Fc": COULOMB * most, "v0": 0.01}
        update = {"effects": ("motor_inertia", "viscous", "coulomb"), "parameters": {**joint.parameters, **own}}
        joints.append(joint.model_copy(update=update))
    return robot.model_copy(update={"joints": tuple(joints)})


def felt(robot: RobotDescription, position: Array) -> Array:
    """(n,) mean diagonal of the inertia matrix at random positions within ranges (n, 2), kg.m2."""
    model, n = RobotModel(robot), len(robot.joints)
    q = np.random.default_rng(0).uniform(position[:, 0], position[:, 1], size=(50, n))
    matrices = model.at_points("mass_matrix", q.T, model.parameter_values).reshape(-1, n, n)
    return np.asarray(np.diagonal(matrices, axis1=1, axis2=2).mean(axis=0))


def case_of(name: str, folder: Path, urdf: Path | None) -> Case:
    """The case that is planned, with its files in a folder."""
    machine = MACHINES[name]
    if name == "scara":
        return load_case(ROOT / "examples/scara/identify.yaml", require_torque=False).with_(validation=None)
    if name == "ur10e" and urdf is None:
        raise SystemExit("The UR10e needs its URDF: --urdf ur10e.urdf (URe/urdf of shamilmamedov/dynamic_calibration).")
    robot = read_robot(ROOT / "fmus/tx40/robot.yaml") if urdf is None else of_urdf(urdf, machine.limits["torque"])
    write_robot(robot, folder / "robot.yaml")
    inertia, n = felt(robot, np.array(machine.limits["position"], dtype=float)), len(robot.joints)
    controller = {
        "schema": 1, "law": "pd", "name": "pd", "joints": ["revolute"] * n, "rate_hz": CONTROL_HZ,
        "Kp": (BANDWIDTH**2 * inertia).tolist(), "Kd": (2 * BANDWIDTH * inertia).tolist(),
    }  # fmt: skip
    (folder / "pd.yaml").write_text(yaml.safe_dump(controller), encoding="utf-8")
    middle = [sum(pair) / 2 for pair in machine.limits["position"]]
    joints = [{"offset": q, "cosine": [0.0, 0.1], "sine": [0.1, 0.0]} for q in middle]
    content = {
        "schema": 1, "name": machine.title, "robot": "robot.yaml", "plant": {"kind": "model"},
        "controller": {"kind": "model", "source": "pd.yaml"},
        "train": {
            "reference": {"kind": "fourier", "fundamental_hz": 0.2, "duration_s": 10, "joints": joints},
            "torque": {"file": "planned.csv", "rate_hz": machine.rate_hz},
        },
    }  # fmt: skip
    return load_case(content, folder=folder, require_torque=False)


def designed(case: Case, machine: Machine, **kind: Any) -> Excited:
    """The motion of ``excite``."""
    return excite(
        case, limits=machine.limits, torque_std=noise(machine).tolist(), criterion="mean", starts=STARTS,
        period_s=machine.period_s, periods=machine.periods, rate_hz=machine.rate_hz, progress=said, **kind,
    )  # fmt: skip


def said(text: str) -> None:
    """Progress."""
    print(text, file=sys.stderr, flush=True)


def plan_of(case: Case, machine: Machine) -> Plan:
    """How motions of a case are logged."""
    return Plan(case, "estimation", machine.rate_hz, noise(machine), case.parameters.nominal())


def random_ones(case: Case, machine: Machine, made: Excited, harmonics: int) -> list[Prediction]:
    """What the logs of series at random would tell, as large as the limits allow."""
    robot, plan = case.parameters, plan_of(case, machine)
    assert isinstance(robot, RobotParameters)
    basis = Series(1 / machine.period_s, machine.periods, robot.joint_count, harmonics=harmonics)
    instants = plan.times(basis.excitation(np.zeros((basis.count, basis.joints))).trajectory(1 / case.step_size))
    problem = Problem(robot.model, robot.base, robot.nominal(), plan.deviation, basis, instants, range(robot.count))
    found = []
    for i in range(RANDOM):
        z = problem.random(np.random.default_rng([99, i]), made.bounds)
        found.append(predict(plan, basis.excitation(z).trajectory(1 / case.step_size), robot.names))
    return found


def identified(case: Case, machine: Machine, motion: Fourier, draws: int) -> tuple[Array, Array]:
    """(draws, p) values that are identified from the log of a motion with noise drawn anew: those that the data alone
    ask for, and the nearest ones that a machine can have."""
    model = plan_of(case, machine).model_on(motion.trajectory(1 / case.step_size))
    clean, rng = model.torque(model.start), np.random.default_rng(5)
    found = [
        Didim(start="description").estimate(with_torque(model, clean + rng.normal(size=clean.shape) * noise(machine)))
        for _ in range(draws)
    ]
    alone = [one.value if one.unlimited is None else one.unlimited for one in found]
    return np.array(alone), np.array([one.value for one in found])


def prospect_of(made: Excited) -> ExpectedAccuracy:
    """What is predicted of a designed motion, whose loop must run."""
    prospect = made.prediction.prospect
    if prospect is None:
        raise SystemExit(f"{made.name}: the designed motion does not run in its loop.")
    return prospect


def measured(name: str, urdf: Path | None, draws: int = DRAWS) -> dict[str, Any]:
    """All of a robot."""
    machine, began = MACHINES[name], time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        case = case_of(name, Path(folder), urdf)
        options: Mapping[str, Mapping[str, Any]] = {
            "fourier": {"harmonics": HARMONICS}, "moves": {"kind": "point_to_point", "moves": machine.moves}
        }  # fmt: skip
        made, seconds = {}, {}
        for kind, option in options.items():
            start = time.process_time()
            made[kind] = designed(case, machine, **option)
            seconds[kind] = time.process_time() - start
        said("random motions")
        others, same = (random_ones(case, machine, made["fourier"], count) for count in (USUAL, HARMONICS))
        said("identifications")
        series = made["fourier"].excitation
        assert isinstance(series, Fourier)
        alone, values = identified(case, machine, series, draws)
    names, in_mean = made["fourier"].asked, made["fourier"].in_mean
    random_mean = [mean_percent(one.prospect, in_mean) for one in others]
    best = others[int(np.nanargmin(random_mean))].prospect
    assert best is not None
    own = {kind: prospect_of(one) for kind, one in made.items()}
    row: dict[str, Any] = {
        "robot": name,
        "parameters": len(names),
        "harmonics": HARMONICS,
        "starts": STARTS,
        "in_mean": list(in_mean),
        "random_percent": random_mean,
        "random_same_percent": [mean_percent(one.prospect, in_mean) for one in same],
    }
    for kind, one in made.items():
        row[f"{kind}_percent"] = mean_percent(own[kind], in_mean)
        row[f"{kind}_of_best"] = (own[kind].deviation / best.deviation).tolist()
        row[f"{kind}_seconds"] = seconds[kind]
        row[f"{kind}_excess"] = Peaks.of(one.prediction.loop, one.deviation.size).excess(one.bounds)
        row[f"{kind}_codes"] = [d.code.name for d in one.diagnostics]
    predicted = own["fourier"].deviation
    for key, table_of in (("found", alone), ("as_machine", values)):
        row[f"{key}_over_predicted"] = (np.std(table_of, axis=0, ddof=1) / predicted).tolist()
        row[f"{key}_off"] = float(np.abs((table_of.mean(axis=0) - own["fourier"].values) / predicted).max())
    return row | {"names": list(names), "draws": draws, "seconds": time.process_time() - began}


HEADS = (
    "robot", "parameters in the mean", "best of the random ones", "of those with as many harmonics as the design",
    "harmonics of the design, starts", "designed: Fourier series", "designed: moves", "seconds of a design",
    "σ over that of the best random one, geometric mean", "draws", "σ found / predicted", "of what is reported",
)  # fmt: skip


def texts(rows: Sequence[Mapping[str, Any]]) -> dict[str, str | list[str]]:
    """What the page shows."""
    lines = []
    for row in rows:
        best, one, other = min(row["random_percent"]), row["fourier_percent"], row["moves_percent"]
        # Rows of an earlier run, that did not measure all, are shown as far as they go.
        seconds = [f"{row[f'{kind}_seconds']:.0f}" for kind in ("fourier", "moves") if f"{kind}_seconds" in row]
        same = row.get("random_same_percent")
        shares = " and ".join(f"{geometric(row[f'{kind}_of_best']):.2f}" for kind in ("fourier", "moves"))
        count = f"{len(row['in_mean'])} of {row['parameters']}"
        lines.append(
            (MACHINES[row["robot"]].title, count, f"{best:.3g} %", f"{min(same):.3g} %" if same else "–",
             f"{row.get('harmonics', '–')}, {row.get('starts', '–')}", f"{one:.3g} % ({one / best:.2f})",
             f"{other:.3g} % ({other / best:.2f})", " and ".join(seconds) or "–", shares, str(row["draws"]),
             scatter(row.get("found_over_predicted", [])), scatter(row["as_machine_over_predicted"]))
        )  # fmt: skip
    numbers = {"random": RANDOM, "usual": USUAL}
    return {
        "table": table(HEADS, lines),
        **{key: str(value) for key, value in numbers.items()},
        "noise": f"{100 * NOISE:g} %",
    }


def scatter(ratios: Sequence[float]) -> str:
    """Deviations that are found over those predicted, in words."""
    if not ratios:
        return "–"
    found = np.array(ratios)
    within = int(np.sum(np.abs(found - 1) <= WITHIN))
    return f"{found.min():.2f} to {found.max():.2f}, RMS {np.sqrt(np.mean(found**2)):.2f}, {within} of {found.size}"


def geometric(values: Sequence[float]) -> float:
    """Geometric mean."""
    return float(np.exp(np.mean(np.log(values))))


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.excitation", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("what", choices=("run", "publish"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robots", nargs="+", choices=tuple(MACHINES), default=tuple(MACHINES))
    parser.add_argument("--draws", type=int, default=DRAWS, help=f"identifications of a robot ({DRAWS})")
    parser.add_argument("--urdf", type=Path, help="of the UR10e")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    if options.what == "run":
        options.folder.mkdir(parents=True, exist_ok=True)
        for name in options.robots:
            row = measured(name, options.urdf if name == "ur10e" else None, options.draws)
            (options.folder / f"{name}.json").write_text(json.dumps(row, indent=1) + "\n", encoding="utf-8")
            print("\n".join(texts([row])["table"]))
        return 0
    files = [options.folder / f"{name}.json" for name in options.robots]
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    found = texts(rows)
    print("\n".join(found["table"]))
    if options.figures:
        write_figures(options.figures, command_of("tests.tools.excitation", given), found, data=rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
