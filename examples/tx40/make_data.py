"""Make the torque logs of the six-joint discovery examples: a TX40 with one effect that its model lacks.

    wrist  the motor friction that couples joints 5 and 6, with the published values of the TX40
    load   friction of the gear of joint 2 that grows with the torque it transmits

The robot is that of ``fmus/tx40/robot.yaml`` with the effect added; the simulation takes 40 substeps of RK4 in a
control period, the cases as few linearly implicit ones as their noise allows. The noise is 1.5 % of each joint's
torque, half of its variance white, half with a correlation time of 10 ms; its seeds stand here.

    python examples/tx40/make_data.py [--out FOLDER]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import yaml

from fmu_didim.case import load_case
from fmu_didim.dynamics.robot import RobotDescription, read_robot, write_robot

HERE = Path(__file__).parent
ROBOT = HERE / "../../fmus/tx40/robot.yaml"
HIDDEN = {
    "wrist": ("coupling_friction", 5, {"Fvm": 0.8, "Fcm": 1.6}),
    "load": ("load_dependent_friction", 2, {"Fl": 0.08}),
}
"""Effect, joint and parameters of each case."""
SUBSTEPS, TORQUE_HZ, NOISE = 40, 100, 0.015
SEEDS = {"train": 21, "validation": 22}


def truth(effect: str, joint: int, values: dict[str, float]) -> RobotDescription:
    """The TX40 with one more effect."""
    robot = read_robot(ROBOT)
    joints = list(robot.joints)
    own = joints[joint - 1]
    joints[joint - 1] = own.model_copy(
        update={"effects": (*own.effects, effect), "parameters": {**own.parameters, **values}}
    )
    return robot.model_copy(update={"joints": tuple(joints)})


def noise(torque: np.ndarray, seed: int) -> np.ndarray:
    """(N, n): half white, half with a correlation time of 10 ms."""
    rng = np.random.default_rng(seed)
    factor = np.exp(-1 / (TORQUE_HZ * 0.01))
    coloured = rng.normal(size=torque.shape)
    for k in range(1, torque.shape[0]):
        coloured[k] = factor * coloured[k - 1] + np.sqrt(1 - factor**2) * coloured[k]
    size = NOISE * np.sqrt(np.mean(torque**2, axis=0))
    return np.asarray(size * (coloured + rng.normal(size=torque.shape)) / np.sqrt(2))


def make(name: str, out: Path) -> None:
    """Write ``<name>_train.csv`` and ``<name>_validation.csv``."""
    case = yaml.safe_load((HERE / f"discover_{name}.yaml").read_text(encoding="utf-8"))
    write_robot(truth(*HIDDEN[name]), out / "truth.yaml")
    case |= {"robot": "truth.yaml", "plant": {"kind": "fmu", "substeps": SUBSTEPS}}
    case["controller"]["source"] = str((HERE / case["controller"]["source"]).resolve())
    header = ",".join(["t", *(f"tau{j}" for j in range(1, 7))])
    for label in SEEDS:
        time = np.arange(round(case[label]["reference"]["duration_s"] * TORQUE_HZ)) / TORQUE_HZ
        empty = np.column_stack([time, np.zeros((time.size, 6))])
        np.savetxt(out / f"{name}_{label}.csv", empty, "%.6g", ",", header=header, comments="")
    (out / "truth_case.yaml").write_text(yaml.safe_dump(case), encoding="utf-8")
    model = load_case(out / "truth_case.yaml").model
    assert model is not None
    for (label, experiment), (file, seed) in zip(model.experiments.items(), SEEDS.items(), strict=True):
        torque = model.torque(model.start, label)
        rows = np.column_stack([experiment.time, torque + noise(torque, seed)])
        np.savetxt(out / f"{name}_{file}.csv", rows, "%.5g", ",", header=header, comments="")
    (out / "truth.yaml").unlink()
    (out / "truth_case.yaml").unlink()


def main() -> None:
    """Write the torque tables of both cases."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE, help="folder, default the one of this script")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    for name in HIDDEN:
        make(name, out)


if __name__ == "__main__":
    main()
