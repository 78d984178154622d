"""The verb ``name_controller``: a case whose controller nobody knows in; its law, gains and their intervals out.

case -> logs: reference, positions, torque at the control ticks
     -> contest: each law of the catalogue at each joint, by regression with noise in both logs
     -> verdict: the law, those that tie with it, or a refusal; gains with deviations
     -> controller.yaml, its FMU and law.json
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.case import Case
from fmu_didim.checks.judgement import judgement
from fmu_didim.model.workers import one_blas_thread
from fmu_didim.results.provenance import made_by
from fmu_didim.workflow.case_files import case_files
from fmu_didim.workflow.naming.catalogue import Candidate
from fmu_didim.workflow.naming.confirm import confirmed
from fmu_didim.workflow.naming.contest import Contest, Entry
from fmu_didim.workflow.naming.findings import FROM_SLOW_POSITIONS
from fmu_didim.workflow.naming.in_loop import LoopContest, LoopEntry
from fmu_didim.workflow.naming.logs import Logs, logs_of
from fmu_didim.workflow.naming.named import Member, NamedController, Ranked, gains_of
from fmu_didim.workflow.naming.regression import JointProblem
from fmu_didim.workflow.naming.verdict import (
    deviations,
    excess,
    of_integrator,
    of_the_law,
    refusal,
    refusal_in_loop,
    scale_of,
    tied,
)

POSITIONS = "reference, positions and torque at the control ticks, whatever the plant is"
CLOSED_LOOP = "in the closed loop with the robot of the case, which was fitted, too"
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
        InputError: the case is wrong, positions are missing, or logs are uneven.
    """
    logs = logs_of(case)
    if not logs.joints:
        raise InputError(
            "The law of a controller is named from measured positions, and a run has none.",
            where=", ".join(logs.labels),
            next_step="Log the positions, too, and give them under positions: of the run. Of a law that is known, "
            "gains can be identified from the torque alone (identify: {Kp1: {of: controller}}).",
        )  # fmt: skip
    found = _at_ticks(logs, progress) if logs.every_tick else _in_loop(logs, progress)
    if out is not None:
        found.save(out)
    return found


def _at_ticks(logs: Logs, progress: Callable[[str], None]) -> NamedController:
    """By regression: positions show what the controller saw."""
    stated = logs.case.document.torque_std
    problems = [
        JointProblem.of(runs, None if stated is None else stated[j]) for j, runs in enumerate(logs.joints)
    ]  # fmt: skip
    contest = Contest(problems, progress=progress)
    entries = contest.run()
    best, others = entries[0], tied(entries)
    excesses = [excess(problem, fit) for problem, fit in zip(contest.problems, best.joints, strict=True)]
    members, way = tuple(_member(contest, entry) for entry in others), POSITIONS
    told = refusal(contest, best, excesses)
    if not told:
        second = confirmed(logs, others, members, progress)
        members = second.members
        if second.in_loop:
            way = f"{CLOSED_LOOP}; the law by {POSITIONS}"
        told = [*second.told, *_told(logs, members), *of_integrator(contest, best)]

    def left(entry: Entry) -> float:
        pairs = zip(contest.problems, entry.joints, strict=True)
        return float(np.sqrt(max(excess(problem, fit)[0] for problem, fit in pairs)))

    return _named(
        logs, members, told, way=way, leaves=[ratio**0.5 for ratio, _ in excesses],
        ranked=[(e.candidate, e.bic - best.bic, left(e)) for e in entries if np.isfinite(e.bic)],
    )  # fmt: skip


def _in_loop(logs: Logs, progress: Callable[[str], None]) -> NamedController:
    """By closed-loop simulation, the robot being fitted, too: positions are too slow to show what the controller
    saw."""
    contest = LoopContest(logs, progress=progress)
    entries = contest.run()
    if not entries:
        raise InputError(
            "No law of the catalogue could be simulated with the robot of the case.", where=logs.case.name,
            got="; ".join(dict.fromkeys(contest.failed.values())),
            next_step="Check the robot description and its values (fmu-didim check), or log positions at the control "
            "rate.",
        )  # fmt: skip
    told = refusal_in_loop(entries[0])
    members = tuple(contest.settled(entry) for entry in (entries[:1] if told else tied(entries)))
    if not told:
        slow = "The positions do not show each tick: the law was named in the loop with the robot of the case."
        told = [Diagnostic(FROM_SLOW_POSITIONS, slow, "controller"), *_told(logs, members)]
    least = np.maximum(entries[0].fit.deviation, np.finfo(float).tiny)

    def left(entry: LoopEntry) -> float:
        counts = entry.fit.model.output_counts
        return float(np.max(np.sqrt(np.nansum(entry.fit.residual**2, axis=0) / counts) / least))

    return _named(
        logs, members, told,
        ranked=[(entry.candidate, entry.bic - entries[0].bic, left(entry)) for entry in entries],
        leaves=[1.0] * len(logs.joints), way=CLOSED_LOOP,
    )  # fmt: skip


def _member(contest: Contest, entry: Entry) -> Member:
    pairs = zip(contest.problems, entry.joints, strict=True)
    return Member(
        entry.candidate,
        gains_of([fit.values for fit in entry.joints], [deviations(problem, fit) for problem, fit in pairs]),
    )


def _told(logs: Logs, members: Sequence[Member]) -> list[Diagnostic]:
    return [*of_the_law(logs, members), *scale_of(members[0].gains, _guessed(logs))]


def _named(
    logs: Logs, members: tuple[Member, ...], told: Sequence[Diagnostic], *,
    ranked: Sequence[tuple[Candidate, float, float]], leaves: Sequence[float], way: str,
) -> NamedController:  # fmt: skip
    best, values = members[0].candidate, members[0].values
    delays = [v["delay"] / logs.step for v in values if "delay" in v]
    return NamedController(
        name=logs.case.name, members=members,
        ranked=tuple(Ranked(one.law.name, one.words, float(bic), float(left)) for one, bic, left in ranked),
        leaves=tuple(map(float, leaves)),
        controller=best.description(
            values, name="named_controller", joints=logs.kinds, rate_hz=1 / logs.step, unit="N.m"
        ),
        delay_samples=float(np.mean(delays)) if delays else 0.0, judgement=judgement(told), way=way,
        provenance=_provenance(logs.case),
    )  # fmt: skip


def _guessed(logs: Logs) -> dict[str, float]:
    """Gains of the controller that the case has, where it is a description of the same gains."""
    controller = logs.case.controller
    if controller is None or logs.case.document.controller is None or logs.is_unknown:
        return {}
    return {v.name: v.start for v in controller.parameters}


def _provenance(case: Case) -> dict[str, Any]:
    return {**made_by(PACKAGES), "files": case_files(case)}
