"""Measured logs of public arms, identified as their users would: held-out error, links that exist, a peer beside.

    python -m tests.tools.public_arms FOLDER --figures docs/figures/public_arms.json

FOLDER holds the repositories of :mod:`tests.tools.public_arms.cases`, under their names. Cases, results and robots are
written into its folder ``identified``. The error of a torque is |measured - simulated| / |measured| over all joints and
samples of what was held out.

Least squares with Pinocchio (:mod:`tests.tools.public_arms.peer`), where it is installed, has the same runs of the
UR10e without the load, with the gains of the drives found here; both are compared while it moves. What it costs that
links exist is asked of least squares: the error of the fitted torque with and without.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim import IdimLs, Result, export_robot, identify, load_case, load_result
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.dynamics.standard_parameters import links_that_cannot_exist
from tests.figures import command_of, table, write_figures
from tests.tools.public_arms import cases, peer

PARTS: Mapping[str, float] = {"first two thirds": 2 / 3, "last two thirds": -2 / 3}
"""Of the Panda's log that is fitted: share of it, below zero from its end."""
MOVES = 0.02
"""[rad/s] Of any joint, from which the UR10e moves."""
END_S = 1.0
"""[s] At both ends of the motion that are not compared: the peer's friction knows no standstill."""
CUTOFF_HZ = 10.0
"""[Hz] Of the peer's motion: the motion has 0.5 Hz and less, rows come at some 95 Hz."""


@dataclass
class Row:
    """What came out of one case.

    Attributes:
        arm: and data; estimator: by which; verdict: and codes of its reasons.
        error: of the torque held out, per cent; joints: (n,) the same of each; rms: N.m.
        away: standard deviations from the values identified to links that exist; impossible: links that do not exist.
        limited, alone: error of the fitted torque by least squares with links that exist, and by the data alone, per
            cent; gains: of the drives; seconds: of the whole.
    """

    arm: str
    estimator: str
    verdict: str
    reasons: list[str]
    error: float
    joints: list[float]
    rms: float
    away: float
    impossible: list[int]
    seconds: float
    limited: float
    alone: float
    gains: dict[str, float] = field(default_factory=dict)


def row_of(arm: str, case: Path, held: str, squares: Callable[[Result], Path]) -> Row:
    """One case: identified, written as a URDF.

    Args:
        held: label of the run held out; squares: from the result, the case for least squares.
    """
    began = time.perf_counter()
    result = identify(case)
    seconds = time.perf_counter() - began
    result.save(case.parent / "result")
    robot = case.parent / "identified.urdf"
    robot.unlink(missing_ok=True)
    written = export_robot(case, robot, result=result)
    shown = result.validation(held)
    limited, alone = cost_of_links(squares(result))
    print(f"{arm}: {shown.total_percent:.2f} % held out, {seconds:.0f} s", file=sys.stderr, flush=True)
    return Row(
        arm, result.document.estimator, result.verdict, [reason.code for reason in result.reasons],
        float(shown.total_percent), [float(x) for x in shown.per_joint_percent],
        float(np.sqrt(np.mean((shown.measured - shown.simulated) ** 2))), written.away,
        links_that_cannot_exist(RobotModel(written.robot)), seconds, limited, alone, gains_of(result),
    )  # fmt: skip


def gains_of(result: Result) -> dict[str, float]:
    """Name -> gain of each drive."""
    return {name: value.value for name, value in result.parameters.items() if name.startswith("gain")}


def cost_of_links(case: Path) -> tuple[float, float]:
    """Error of the fitted torque by least squares with links that exist, and by the data alone, per cent."""
    loaded = load_case(case)
    model, estimator = loaded.model, loaded.estimator
    assert isinstance(estimator, IdimLs)
    found, rows = estimator.estimate(model), estimator.rows(model)
    size = float(np.linalg.norm(rows.target + rows.known))

    def error(values: Array) -> float:
        return 100 * float(np.linalg.norm(rows.target - rows.columns @ values)) / size

    values = found.value[: rows.columns.shape[2]]
    return error(values), error(values if found.unlimited is None else found.unlimited)


def moving(data: Array) -> slice:
    """The rows of a log of the UR10e between its first motion and its last, without a second at both ends."""
    rows = np.flatnonzero(np.abs(data[:, 7:13]).max(axis=1) > MOVES)
    first, last = np.searchsorted(data[:, 0], [data[rows[0], 0] + END_S, data[rows[-1], 0] - END_S])
    return slice(int(first), int(last))


def errors_of(measured: Array, left: Array) -> tuple[float, list[float]]:
    """Error of a torque (N, n) of which ``left`` is not explained, per cent, and that of each joint."""
    each = 100 * np.linalg.norm(left, axis=0) / np.linalg.norm(measured, axis=0)
    return float(100 * np.linalg.norm(left) / np.linalg.norm(measured)), each.tolist()


def beside_peer(folder: Path, gains: Mapping[str, float]) -> dict[str, tuple[float, list[float]]]:
    """Errors of the held-out run of the UR10e while it moves: of the result that was saved, and of least squares with
    Pinocchio, where that is installed."""
    root, runs = folder / cases.UR10E, dict[str, tuple[Array, Array]]()
    found = load_result(folder / "identified/ur10e/result").validation("held")
    logs = {label: read_log(root / f"{cases.UR10E_LOGS}{log}.csv") for label, log in cases.UR10E_RUNS.items()}
    time = logs["held"][moving(logs["held"]), 0]
    part = (found.time >= time[0]) & (found.time <= time[-1])
    scale = np.array([gains[f"gain{j}"] for j in range(1, 7)])
    errors = {"ours": errors_of(found.measured[part], (found.measured - found.simulated)[part])}
    if find_spec("pinocchio") is None:
        return errors
    for label, data in logs.items():
        if label != "loaded":
            table = peer.rows_of(root / "URe/urdf/ur10e.urdf", data[:, 0] - data[0, 0], data[:, 1:7], CUTOFF_HZ)
            runs[label] = table[moving(data)], (data[:, 13:19] * scale)[moving(data)]
    rows, torque = runs.pop("held")
    return errors | {"peer": errors_of(torque, torque - rows @ peer.values_of(list(runs.values())))}


def read_log(path: Path) -> Array:
    """(N, 31) time, positions, velocities, currents and what else the UR10e logs."""
    return np.loadtxt(path, delimiter=",", usecols=range(31), max_rows=6000)


def commit(folder: Path) -> str:
    """Of a repository."""
    found = subprocess.run(["git", "rev-parse", "HEAD"], cwd=folder, capture_output=True, text=True, check=False)
    return found.stdout.strip()[:8]


HEADS = (
    "arm", "estimator", "verdict", "held out", "of each joint", "links that exist", "fitted torque by least squares: "
    "with links that exist / by the data alone", "seconds",
)  # fmt: skip


def texts(rows: Sequence[Row], beside: Mapping[str, tuple[float, list[float]]]) -> dict[str, str | list[str]]:
    """What the page shows."""
    lines = []
    for row in rows:
        each = " ".join(f"{x:.1f}" for x in row.joints)
        links = "all" if not row.impossible else f"not {', '.join(map(str, row.impossible))}"
        cost = f"{row.limited:.2f} / {row.alone:.2f} %"
        held = f"{row.error:.2f} %, {row.rms:.2f} N.m"
        lines.append((row.arm, row.estimator, row.verdict, held, each, links, cost, f"{row.seconds:.0f}"))
    found: dict[str, str | list[str]] = {"table": table(HEADS, lines)}
    found["growth"] = f"{max(100 * (row.limited / row.alone - 1) for row in rows):.1f} %"
    gains = next((row.gains for row in rows if row.gains), {})
    found["gains"] = ", ".join(f"{value:.1f}" for value in gains.values())
    for name, (whole, each_joint) in beside.items():
        found[name] = f"{whole:.2f} %"
        found[f"{name}.joints"] = " ".join(f"{x:.1f}" for x in each_joint)
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.public_arms", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="with the repositories")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    folder: Path = options.folder
    out = folder / "identified"

    def ur10e_squares(result: Result) -> Path:
        return cases.ur10e(folder, out / "ur10e_squares", gains_of(result))

    rows = [row_of("UR10e", cases.ur10e(folder, out / "ur10e"), "held", ur10e_squares)]
    for name, part in PARTS.items():
        case = cases.panda(folder, out / f"panda_{name.split()[0]}", part)
        rows.append(row_of(f"Panda, {name} fitted", case, "validation", lambda _, case=case: case))  # type: ignore[misc]
    tx40 = cases.tx40(folder, out / "tx40_squares", by_least_squares=True)
    rows.append(row_of("TX40", cases.tx40(folder, out / "tx40"), "validation", lambda _: tx40))
    beside = beside_peer(folder, rows[0].gains)
    found = texts(rows, beside)
    print("\n".join(found["table"]))
    if options.figures:
        commits = {name: commit(folder / name) for name in (cases.UR10E, cases.PANDA, cases.TX40)}
        data: dict[str, Any] = {"commits": commits, "rows": [vars(row) for row in rows], "beside": beside}
        write_figures(options.figures, command_of("tests.tools.public_arms", given), found, data=data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
