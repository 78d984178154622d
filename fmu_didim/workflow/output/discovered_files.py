"""The folder of a discovery: findings, signals, the augmented model, the next experiment and the page."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from fmu_didim.base.errors import InputError
from fmu_didim.case import Case
from fmu_didim.discovery.next_experiment.design import design_experiment
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.run import Found
from fmu_didim.discovery.signals.run import FoundOnSignals
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.results.findings import FINDINGS_FILE, FindingsDocument, save_findings
from fmu_didim.workflow.output.augmented_files import (
    CASE_FILE,
    ROBOT_FILE,
    SYSTEM_FILE,
    augmented_robot,
    move_case,
    write_augmented,
    write_curve,
    write_signals,
)
from fmu_didim.workflow.output.next_run import LINES_FILE, MOTION_FILE, write_next_run
from fmu_didim.workflow.output.result_folder import ResultFolder

NEXT_FILE = "reference_next.yaml"
NO_MOTION = "No motion within the limits of the present reference splits them better than the present one."


def result_folder(out: Path | str, *, figures: bool = False) -> ResultFolder:
    """The folder of the results of ``discover``."""
    from fmu_didim.report.discovery.sections import DISCOVERY_FILE

    fixed = (DISCOVERY_FILE, ROBOT_FILE, CASE_FILE, SYSTEM_FILE, NEXT_FILE, LINES_FILE, MOTION_FILE)
    patterns = ("signals_*.csv", "simulated_*.csv", "figure_*", "data_*.csv", "curve_*", "*.fmu", "reference_next.csv")
    return ResultFolder(Path(out), "discover", FINDINGS_FILE, fixed, patterns, "files", figures)


def write_found(
    case: Case, found: Found | FoundOnSignals, new: Path, home: Path, progress: Progress
) -> FindingsDocument:
    """Write all but the page to a folder whose files will lie in ``home``; returns the document, which names them."""
    if isinstance(found, FoundOnSignals):
        document = found.document.model_copy(update={"files": write_signals(found, new)})
        save_findings(document, new)
        return document
    files, notes = write_signals(found, new), list(found.document.notes)
    if found.discovery.final.model.added_effects or found.discovery.refitted:
        progress.say("writing the augmented model")
        augmented, note = write_augmented(case, found, found.builder.description, new, home)
        files |= augmented
        notes.append(note)
    for curve in found.curves:
        progress.say(f"writing the curve of joint {curve.tried.effect_at.joint}")
        files |= write_curve(found.builder, curve, new)
    document = found.document
    proposed: dict[str, str] = {}
    if found.builder.description is not None and not progress.is_time_up:
        document, proposed = _with_experiment(found, new, progress.say)
    if not progress.is_time_up and found.discovery.steps:
        progress.say("designing the experiment that says more of an effect")
        document, written = write_next_run(case, found, document, new, home)
        proposed |= written
    document = document.model_copy(update={"files": files | proposed, "notes": notes})
    save_findings(document, new)
    return document


def copy_saved(document: FindingsDocument, old: Path, new: Path, home: Path) -> None:
    """Write a discovery that was saved in the folder ``old`` to another one whose files will lie in ``home``.

    Raises:
        InputError: a file that the document names is missing.
    """
    for name in document.files.values():
        if not (old / name).is_file():
            raise InputError(
                "A file of the discovery is missing.", where=str(old), got=name, next_step="Run the discovery again."
            )
    names = {name for name in result_folder(old).left() if not name.startswith("figure_")} | {*document.files.values()}
    for name in names:
        shutil.copyfile(old / name, new / name)
    if CASE_FILE in names:
        move_case(old, new, home, names)
    save_findings(document, new)


def _with_experiment(found: Found, out: Path, say: Callable[[str], None]) -> tuple[FindingsDocument, dict[str, str]]:
    """The document with a motion that splits the first ambiguous set of fitted effects, and the file of that motion."""
    document, final = found.document, found.discovery.final
    first = len(document.findings) - len(found.discovery.steps)  # torques from outside come before
    for i, step in enumerate(found.discovery.steps, start=first):
        if len(step.members) < 2:
            continue
        say("designing the experiment that splits the ambiguous effects")
        without = found.builder.without(final.model, final.model.added_effects.index(step.effect_at))
        robot = augmented_robot(found.builder, replace(final, model=without, values=without.start))
        model = RobotModel(robot)
        experiment = final.model.experiments[final.model.first]
        try:
            plan = design_experiment(
                robot,
                model.parameter_values,
                step.members[:2],  # the nearest rival: with more of them the worst pair decides
                reference=experiment.reference,
                rate_hz=experiment.rate_hz,
                noise=final.torque_alone.noise,
                effects=found.builder.effects,
            )
        except InputError:
            continue  # two structures, say, have no columns to be compared by: the general advice stays
        advice = document.findings[i].experiment
        text = plan.description if plan.reference is not None else f"{advice} {NO_MOTION}"
        findings = list(document.findings)
        findings[i] = findings[i].model_copy(update={"experiment": text})
        document = document.model_copy(update={"findings": findings})
        if plan.reference is None:
            return document, {}
        return document, {"reference_next": plan.save(out / NEXT_FILE).name}
    return document, {}
