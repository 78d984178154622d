"""The verb ``name_controller``: a case whose controller nobody knows in; its law, gains and their intervals out.

case -> logs: reference, positions, torque at the control ticks
     -> contest: each law of the catalogue at each joint, by regression with noise in both logs
     -> verdict: the law, those that tie with it, or a refusal; gains with deviations
     -> controller.yaml, its FMU and law.json
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.case import Case
from fmu_didim.checks.judgement import judgement
from fmu_didim.model.workers import one_blas_thread
from fmu_didim.workflow.case_files import case_files
from fmu_didim.workflow.naming.contest import Contest, Entry
from fmu_didim.workflow.naming.logs import Logs, logs_of
from fmu_didim.workflow.naming.named import NamedController, Ranked, gains_of
from fmu_didim.workflow.naming.regression import JointProblem
from fmu_didim.workflow.naming.verdict import (
    deviations,
    excess,
    of_integrator,
    of_the_law,
    refusal,
    scale_of,
    tied,
)

PACKAGES = ("fmu_didim", "casadi", "numpy", "scipy")


@one_blas_thread
def name_controller(
    case: Case | Path | str | Mapping[str, Any],
    out: Path | str | None = None,
    *,
    progress: Callable[[str], None] = lambda text: None,
) -> NamedController:
    """Name the control law of a case whose controller nobody knows, and find its gains.

    Args:
        case: a loaded case, the path of its file, or its content: with ``robot``, ``controller: {kind: tracking}`` or a
            guess, and runs with ``reference``, ``torque`` and ``positions``.
        out: folder for ``controller.yaml``, its FMU and ``law.json``; nothing is written by default.
        progress: told of each step.

    Raises:
        InputError: the case is wrong, or its logs are too slow or uneven.
    """
    logs = logs_of(case)
    if not logs.joints or not logs.every_tick:
        raise InputError(
            "The law of a controller is named from positions that were logged at each of its ticks.",
            where=", ".join(logs.labels), got=f"positions at {logs.positions_hz:g} Hz, control at {1 / logs.step:g} Hz"
            if logs.positions_hz else "no positions",
            next_step="Log positions at the control rate, and give them under positions: of the run.",
        )  # fmt: skip
    stated = logs.case.document.torque_std
    problems = [
        JointProblem.of(runs, None if stated is None else stated[j]) for j, runs in enumerate(logs.joints)
    ]  # fmt: skip
    contest = Contest(problems, progress=progress)
    entries = contest.run()
    found = _named(logs, contest, entries)
    if out is not None:
        found.save(out)
    return found


def _named(logs: Logs, contest: Contest, entries: list[Entry]) -> NamedController:
    best = entries[0]
    excesses = [excess(problem, fit) for problem, fit in zip(contest.problems, best.joints, strict=True)]
    deviation = [deviations(problem, fit) for problem, fit in zip(contest.problems, best.joints, strict=True)]
    values = [fit.values for fit in best.joints]
    gains = gains_of(values, deviation)
    others = tied(entries)
    told: list[Diagnostic] = refusal(contest, best, excesses)
    if not told:
        told = [*of_the_law(logs, best, others, gains), *of_integrator(contest, best)]
        told += scale_of(gains, _guessed(logs, best))
    delays = [v["delay"] / logs.step for v in values if "delay" in v]
    return NamedController(
        name=logs.case.name, candidate=best.candidate, gains=gains,
        tied=tuple(entry.candidate.words for entry in others),
        tied_laws=tuple(dict.fromkeys(entry.candidate.law.name for entry in others)),
        ranked=tuple(_ranked(contest, entry, best) for entry in entries),
        leaves=tuple(float(np.sqrt(ratio)) for ratio, _ in excesses),
        controller=best.candidate.description(
            values, name="named_controller", joints=logs.kinds, rate_hz=1 / logs.step, unit="N.m"
        ),
        delay_samples=float(np.mean(delays)) if delays else 0.0, judgement=judgement(told),
        way="from reference, positions and torque alone, whatever the plant is", provenance=_provenance(logs.case),
    )  # fmt: skip


def _ranked(contest: Contest, entry: Entry, best: Entry) -> Ranked:
    leaves = max(excess(p, fit)[0] for p, fit in zip(contest.problems, entry.joints, strict=True))
    candidate = entry.candidate
    return Ranked(candidate.law.name, candidate.words, float(entry.bic - best.bic), float(np.sqrt(leaves)))


def _guessed(logs: Logs, best: Entry) -> dict[str, float]:
    """Gains of the controller that the case has, where it is a description of the same gains."""
    controller = logs.case.controller
    if controller is None or logs.case.document.controller is None or logs.is_unknown:
        return {}
    return {v.name: v.start for v in controller.parameters}


def _provenance(case: Case) -> dict[str, Any]:
    return {
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
        "platform": f"{platform.system()} {platform.machine()}",
        "files": case_files(case),
    }
