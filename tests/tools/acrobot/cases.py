"""Cases of the drives of a double pendulum from logs that are not shipped, and the pulses that these logs hold.

The repository is github.com/dfki-ric-underactuated-lab/double_pendulum, folder ``leaderboard`` (looked at: commit
1e8544e). Each run logs what the controller asked for (``tau_con``), what the drives measured (``tau_meas``) and, where
it was disturbed, the pulses that were added to the command (``tau_pert``), bells in time. The case knows the first two
only: two drives,

    lag_j dtau_j/dt + tau_j = gain_j u_j

so that what acted on a drive and is not in its command stands out of what the drive gave.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
import yaml

from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu

DISTURBED, UNDISTURBED = "real_hardware_perturbed_v2", "real_hardware_v2"
CONTROLLER = "ilqr_tvlqr_lqr"
"""The one under which both kinds of run were made."""
SHOWN = 0.1
"""[N.m] Of a logged pulse, above which it is one: two bells of a joint are a second apart."""


@dataclass(frozen=True)
class Pulse:
    """When a torque acted on a joint, from half to half of its largest value, and that value in N.m."""

    joint: int
    begin_s: float
    end_s: float
    torque: float


def runs_of(leaderboard: Path, robot: str) -> list[tuple[str, Path]]:
    """Name and file of each run, ``disturbed01`` and so on; raises FileNotFoundError where there are none."""
    found = [
        (f"{kind}{path.parent.name.removeprefix('experiment')}", path)
        for kind, folder in (("disturbed", DISTURBED), ("undisturbed", UNDISTURBED))
        for path in sorted((leaderboard / robot / folder / "src_data" / CONTROLLER).glob("*/trajectory.csv"))
    ]
    if not found:
        raise FileNotFoundError(
            f"no runs of {CONTROLLER} below {leaderboard / robot}: give the folder leaderboard of a checkout of "
            "github.com/dfki-ric-underactuated-lab/double_pendulum"
        )
    return found


def read(path: Path) -> dict[str, Array]:
    """Column -> values of a log."""
    with path.open(encoding="utf-8") as stream:
        names = stream.readline().strip().split(",")
        return dict(zip(names, np.loadtxt(stream, delimiter=",").T, strict=True))


def pulses(log: Mapping[str, Array], least: float) -> list[Pulse]:
    """The logged pulses of at least this size in N.m, none in a log without ``tau_pert``."""
    found = []
    for joint in (1, 2):
        torque = log.get(f"tau_pert{joint}", np.zeros(log["time"].size))
        edges = np.flatnonzero(np.diff(np.concatenate([[False], np.abs(torque) > SHOWN, [False]])))
        for first, after in zip(edges[::2], edges[1::2], strict=True):
            own = np.abs(torque[first:after])
            high = first + np.flatnonzero(own >= own.max() / 2)
            top = torque[first + int(np.argmax(own))]
            if abs(top) >= least:
                found.append(Pulse(joint, float(log["time"][high[0]]), float(log["time"][high[-1]]), float(top)))
    return found


def drives() -> Block:
    """The two drives: inputs ``u1`` and ``u2``, outputs ``tau1`` and ``tau2``, a gain and a lag each."""
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u", 2), ca.SX.sym("p", 4)
    gain, lag = p[:2], p[2:]
    return Block(
        "Drives",
        tuple(Variable(f"u{j}", "N.m") for j in (1, 2)),
        tuple(Variable(f"tau{j}", "N.m") for j in (1, 2)),
        tuple(Variable(f"x{j}", "N.m") for j in (1, 2)),
        (
            *(Variable(f"gain{j}", "1", start=1.0) for j in (1, 2)),
            *(Variable(f"lag{j}", "s", start=5e-3) for j in (1, 2)),
        ),
        ca.Function("update", [x, u, p], [(gain * u - x) / lag]),
        ca.Function("output", [x, u, p], [x]),
        ca.Function("start", [u, p], [ca.DM.zeros(2)]),
        rate_bound=ca.Function("rate", [x, p], [1 / ca.mmin(lag)]),
    )


def write_cases(runs: Iterable[tuple[str, Path]], folder: Path) -> int:
    """A folder with a case for each run, which holds nothing of ``tau_pert``; returns how many."""
    folder.mkdir(parents=True, exist_ok=True)
    fmu, count = build_fmu(drives(), directory=folder), 0
    limits: dict[str, dict[str, float]] = {"gain1": {"minimum": 0}, "gain2": {"minimum": 0}}
    limits |= {f"lag{j}": {"minimum": 0.001, "maximum": 0.05} for j in (1, 2)}
    for count, (name, path) in enumerate(runs, start=1):  # noqa: B007 - counted
        log, own = read(path), folder / name
        own.mkdir(exist_ok=True)
        _table(own / "inputs.csv", {"t": log["time"], "u1": log["tau_con1"], "u2": log["tau_con2"]})
        _table(own / "measured.csv", {"t": log["time"], "tau1": log["tau_meas1"], "tau2": log["tau_meas2"]})
        case = {
            "schema": 1, "name": name, "model": {"source": str(fmu.absolute())},
            "inputs": {"file": "inputs.csv", "interpolation": "held"}, "measured": "measured.csv", "identify": limits,
        }  # fmt: skip
        (own / "case.yaml").write_text(yaml.safe_dump(case, sort_keys=False), encoding="utf-8")
    return count


def _table(path: Path, columns: Mapping[str, Array]) -> None:
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="",
               fmt="%.9g")  # fmt: skip
