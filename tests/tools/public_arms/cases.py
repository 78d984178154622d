"""The cases of public arms: what is in a repository, and the YAML that a user would write for it.

shamilmamedov/dynamic_calibration        UR10e: URDF, logs of positions and currents at some 95 Hz, two with a load
marcocognetti/FrankaEmikaPandaDynModel   Panda: geometry, one log of positions and torques, read at its own pace
thanhndv212/figaroh-examples             TX40: URDF, logs of motor positions and torques at 5 kHz, coupled wrist
liuyurong129/figaroh_kinova              AIRBOT Play: URDF, logs of positions and torques at 100 Hz, two with a load
wissem01chiha/dynamic-identification     Kinova Gen3: URDF, logs of positions, currents and temperatures at 1 kHz
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.signal import decimate

from fmu_didim import read_robot, write_robot
from fmu_didim.data.signals import Array

UR10E, PANDA, TX40 = "dynamic_calibration", "FrankaEmikaPandaDynModel", "figaroh-examples"
AIRBOT = "figaroh_kinova"
"""Folders of the repositories."""
AIRBOT_FOLDER = "examples/airbot_play/data"
AIRBOT_HZ = 100.0
AIRBOT_LOAD = 0.48
"""[kg] Of the loaded run, by config/airbot_play_config.yaml."""
AIRBOT_BANDWIDTH_HZ = 20.4
"""[Hz] That the case states, as the error of one that leaves it open proposes: the loaded arm swings at 4 Hz, and the
noise of its positions would set a lower one."""
KINOVA = "dynamic-identification"
KINOVA_RUNS: Mapping[str, str] = {
    "cold": "RecordTrajectory_quadratic", "middle": "opti_traj_testing1",
    **{f"joint{j}": f"joint_{j}_trapez" for j in range(1, 8)},
}  # fmt: skip
"""Label -> log: all joints move in the first two, one in each of the others. Other logs of the repository last 2 s and
do not agree with these on gravity: a tool was perhaps another one."""
KINOVA_END_S = 4.7
"""[s] Of the run in between, whose last rows have no torque."""
KINOVA_HZ = 1000
LOAD = 2.805
"""[kg] Of the loaded runs, by the scripts of the repository."""
UR10E_LOGS = "dataset_ur10e/identification_data/ur-20_"
UR10E_RUNS: Mapping[str, str] = {
    "empty": "02_19_14harm50sec", "loaded": "02_19_14harm50secLoad", "fifteen": "02_19_15harm50sec",
    "fifty": "02_12-50sec_12harm", "forty": "02_12-40sec_12harm", "held": "02_10-30sec_12harm",
}  # fmt: skip
"""Label -> log; ``held`` is held out."""
PANDA_LOG = "matlab/data/Exciting_Traj/Trajectory_1/rbt_log/exciting_traj_"
PANDA_HZ = 1000
PANDA_JOINTS = (
    {"d": 0.333}, {"alpha": "-pi/2"}, {"alpha": "pi/2", "d": 0.316}, {"alpha": "pi/2", "a": 0.0825},
    {"alpha": "-pi/2", "a": -0.0825, "d": 0.384}, {"alpha": "pi/2"}, {"alpha": "pi/2", "a": 0.088},
)  # fmt: skip
"""Modified Denavit-Hartenberg parameters, m, of matlab/utils/Load_Franka_DH.m."""
TX40_FOLDER = "examples/staubli_TX40"
TX40_HZ = 5000.0
TX40_RATIOS = (32.0, 32.0, 45.0, -48.0, 45.0, 32.0)
"""[1] Motor turns per joint turn, of TX40_config.yaml; motor 6 turns with joint 5, too."""
TX40_ZEROS: Mapping[int, float] = {2: -np.pi / 2, 3: np.pi / 2}
"""[rad] Added to what the encoders of these joints read, by utils/staubli_tx40_tools.py: their zero is another posture
than that of the URDF. Without them links are in the wrong place: twice the error of joint 3."""
TX40_RESTS_S = 7.6
"""[s] From which it stands still to the end of the log, held by friction or brakes."""
TX40_POSITIONS_EVERY = 5
"""[rows] Of 5 kHz: positions and torque at 1 kHz."""
TX40_LOG: Mapping[str, Any] = {"rate_hz": 100, "sampling": "filtered", "cutoff_hz": 40}
"""The torque that is fitted: at 100 Hz behind a filter against aliasing, through which the simulated one goes as
well."""
TX40_BORDER = 50
"""[rows] A multiple of which is where the fitted part of the log ends: a sample of the torque at 100 Hz."""

Content = dict[str, Any]


def write(content: Content, path: Path) -> Path:
    """A case as a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def table(path: Path, columns: Mapping[str, Array]) -> str:
    """A CSV file; its name."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, np.column_stack(list(columns.values())), "%.10g", ",", header=",".join(columns), comments="")
    return path.name


def named(prefix: str, values: Array) -> dict[str, Array]:
    """``prefix1``, ... -> column."""
    return {f"{prefix}{j}": values[:, j - 1] for j in range(1, values.shape[1] + 1)}


def ur10e(folder: Path, out: Path, gains: Mapping[str, float] | None = None) -> Path:
    """Five fitted runs, one with a weighed load that gives the gains of the drives, and a held-out one.

    Args:
        gains: of the drives, where they are known: then the runs without the load, by least squares.
    """
    root = (folder / UR10E).resolve()

    def run(label: str, log: str) -> Content:
        file = {"file": str(root / f"{UR10E_LOGS}{log}.csv"), "time": {"name": "1"}}
        scales = {} if gains is None else {f"tau{j}": {"scale": gains[f"gain{j}"]} for j in range(1, 7)}
        torque = {f"tau{j}": {"name": str(13 + j), **scales.get(f"tau{j}", {})} for j in range(1, 7)}
        content: Content = {"torque": {**file, "columns": torque}}
        content["positions"] = {**file, "columns": {f"q{j}": str(1 + j) for j in range(1, 7)}}
        content |= {"load": {"mass": LOAD}} if label == "loaded" else {}
        return content | ({"role": "validation"} if label == "held" else {})

    runs = {label: run(label, log) for label, log in UR10E_RUNS.items() if gains is None or label != "loaded"}
    content: Content = {
        "schema": 1, "name": "UR10e", "robot": str(root / "URe/urdf/ur10e.urdf"), "controller": {"kind": "tracking"},
        "loop": {"rate_hz": 500}, "experiments": runs,
    }  # fmt: skip
    if gains is None:
        content["identify"] = {f"gain{j}": {"of": "drive", "joint": j} for j in range(1, 7)}
    else:
        content["estimator"] = {"kind": "idim_ls", "decimation": 1, "cutoff_hz": 10}
    return write(content, out / "case.yaml")


def panda(folder: Path, out: Path, share: float) -> Path:
    """One log, of which this share is fitted, from its beginning, or below zero from its end, and the rest held out."""

    def read(kind: str) -> Array:
        return np.loadtxt(folder / PANDA / f"{PANDA_LOG}{kind}.txt")

    time, q, tau = read("time"), read("positions").reshape(-1, 7), read("torques").reshape(-1, 7)
    clock = {"name": "t", "rate_hz": PANDA_HZ, "polled": [f"q{j}" for j in range(1, 8)]}
    robot: Content = {"schema": 1, "name": "panda", "gravity": [0, 0, -9.81]}
    robot["joints"] = [{"type": "revolute", **joint} for joint in PANDA_JOINTS]
    write(robot, out / "robot.yaml")
    content: Content = {
        "schema": 1, "name": "Panda", "robot": "robot.yaml", "controller": {"kind": "tracking"},
        "loop": {"rate_hz": PANDA_HZ}, "estimator": {"kind": "idim_ls", "decimation": 1},
    }  # fmt: skip
    log = table(out / "log.csv", {"t": time, **named("q", q), **named("tau", tau)})
    file, border = {"file": log, "time": clock}, round(float((share % 1) * time[-1]), 3)
    parts = ({"to_s": border}, {"from_s": border})
    for run, part in zip(("train", "validation"), parts if share > 0 else parts[::-1], strict=True):
        content[run] = {"torque": file, "positions": file, **part}
    return write(content, out / "case.yaml")


def columns_of(path: Path, names: Sequence[str]) -> Array:
    """(N, n) columns of a CSV file with a header."""
    titles = path.read_text(encoding="utf-8").split("\n", 1)[0].split(",")
    return np.loadtxt(path, delimiter=",", skiprows=1, usecols=[titles.index(name) for name in names], ndmin=2)


def _read(path: Path) -> Array:
    return np.loadtxt(path, delimiter=",", skiprows=1)


def tx40(folder: Path, out: Path, *, by_least_squares: bool = False) -> Path:
    """The first six tenths of one log fitted, the others held out; friction and inertia of the coupled wrist."""
    log, content = TX40_LOG, dict[str, Any]()
    if by_least_squares:  # which takes both in the same rows
        log, content = {}, {"estimator": {"kind": "idim_ls", "decimation": 1}}
    return _tx40(folder, out, content, ("wrist_friction", "coupled_inertia"), log=log)


def tx40_without_wrist(folder: Path, out: Path, *, share: float = 0.6, rests: bool = False) -> Path:
    """The same with a model that lacks the coupling, for ``discover``, in a loop at the rate of the positions.

    Args:
        share: fitted from the beginning, or below zero from the end; rests: whether the rest at the end is in it.
    """
    content: Content = {"loop": {"rate_hz": TX40_HZ / TX40_POSITIONS_EVERY}}
    return _tx40(folder, out, content, (), share=share, until_s=None if rests else TX40_RESTS_S)


def _tx40(
    folder: Path,
    out: Path,
    content: Content,
    wrist: tuple[str, ...],
    *,
    log: Mapping[str, Any] = TX40_LOG,
    share: float = 0.6,
    until_s: float | None = None,
) -> Path:
    root = folder / TX40 / TX40_FOLDER
    motors = np.diag(TX40_RATIOS)
    motors[5, 4] = TX40_RATIOS[5]  # motor 6 turns with joint 5
    end = None if until_s is None else round(until_s * TX40_HZ)
    q, tau = (_read(root / f"data/{name}.csv")[:end] for name in ("pos_read_data", "curr_data"))
    robot = read_robot(root / "urdf/tx40_mdh_modified.urdf")
    joints = list(robot.joints)
    for j, turn in TX40_ZEROS.items():
        joints[j - 1] = joints[j - 1].model_copy(update={"theta": float(joints[j - 1].theta) + turn})
    joints[4] = joints[4].model_copy(update={"effects": (*joints[4].effects, *wrist)})
    out.mkdir(parents=True, exist_ok=True)
    write_robot(robot.model_copy(update={"joints": tuple(joints)}), out / "robot.yaml")
    case: Content = {
        "schema": 1, "name": "TX40", "robot": "robot.yaml", "controller": {"kind": "tracking"},
        "loop": {"rate_hz": TX40_HZ}, **content,
    }  # fmt: skip
    border = round((share % 1) * q.shape[0] / TX40_BORDER) * TX40_BORDER
    parts = (slice(0, border), slice(border, None))
    for run, rows in zip(("train", "validation"), parts if share > 0 else parts[::-1], strict=True):
        torque = decimate(tau[rows], TX40_POSITIONS_EVERY, axis=0)
        seen = slice(None, None, TX40_POSITIONS_EVERY)
        time = np.arange(q[rows].shape[0])[seen] / TX40_HZ
        file = table(out / f"{run}_torque.csv", {"t": time, **named("tau", torque)})
        positions = table(out / f"{run}_positions.csv", {"t": time, **named("q", q[rows][seen])})
        turns = {"motors": motors.tolist()}
        case[run] = {"torque": {"file": file, **log, **turns}, "positions": {"file": positions, **turns}}
    return write(case, out / "case.yaml")


def airbot(folder: Path, out: Path) -> tuple[Path, Path, Path]:
    """One motion without a load and with one: a case of each, and one of both, in which the load is identified."""
    root = (folder / AIRBOT / AIRBOT_FOLDER).resolve()
    runs: dict[str, Content] = {}
    for label, ending in (("empty", ""), ("loaded", "_loaded")):
        q, tau = (
            _read(root / f"identification/chirp_motion/identification_{kind}_real{ending}.csv") for kind in ("q", "tau")
        )
        log = table(out / f"{label}.csv", {"t": np.arange(len(q)) / AIRBOT_HZ, **named("q", q), **named("tau", tau)})
        runs[label] = {"torque": {"file": log}, "positions": {"file": log}}
    head: Content = {
        "schema": 1, "robot": str(root / "urdf/airbot_play_v3_0_gripper.urdf"),
        "controller": {"kind": "tracking", "bandwidth_hz": AIRBOT_BANDWIDTH_HZ},
    }  # fmt: skip
    single = (write({**head, "name": label, "train": run}, out / f"{label}.yaml") for label, run in runs.items())
    both = {"empty": runs["empty"], "loaded": {**runs["loaded"], "load": {}}}
    return *single, write({**head, "name": "load", "experiments": both}, out / "load.yaml")  # type: ignore[return-value]


def kinova(folder: Path, out: Path) -> Path:
    """Nine runs of a cold and a warm arm, in which friction of each joint may follow its temperature.

    FOLDER/dynamic-identification holds the URDF and the logs side by side. A joint that stands still holds a torque of
    its own in each run, its dry friction: its offset is one of that run.
    """
    root = (folder / KINOVA).resolve()
    robot = read_robot(root / "kinovaGen3.urdf")
    follows = ("motor_inertia", "viscous", "coulomb", "torque_offset", "temperature_dependent_friction")
    joints = tuple(joint.model_copy(update={"effects": follows}) for joint in robot.joints)
    out.mkdir(parents=True, exist_ok=True)
    write_robot(robot.model_copy(update={"joints": joints}), out / "robot.yaml")

    def run(label: str, log: str) -> Content:
        file: Content = {"file": str(root / f"{log}.csv"), "time": {"name": "Time", "unit": "ms"}}
        columns = {
            "torque": ("tau", "TorqueCur"),
            "positions": ("q", "Position"),
            "temperature": ("temperature", "Temp"),
        }
        content: Content = {
            key: {**file, "columns": {f"{signal}{j}": f"{name}{j}" for j in range(1, 8)}}
            for key, (signal, name) in columns.items()
        }
        content["torque"]["rate_hz"] = 100
        content |= {"to_s": KINOVA_END_S} if label == "middle" else {}
        stands = [j for j in range(1, 8) if label.startswith("joint") and label != f"joint{j}"]
        return content | ({"own": [f"offset{j}" for j in stands]} if stands else {})

    content: Content = {
        "schema": 1, "name": "Kinova Gen3", "robot": "robot.yaml", "controller": {"kind": "tracking"},
        "loop": {"rate_hz": KINOVA_HZ}, "experiments": {label: run(label, log) for label, log in KINOVA_RUNS.items()},
    }  # fmt: skip
    return write(content, out / "case.yaml")
