"""The experiment that climbs the lowest open rung of a ladder, written as the lines of a case and its reference."""

from __future__ import annotations

import os
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.case import Case
from fmu_didim.data.signals import write_csv
from fmu_didim.discovery.next_experiment.climbing import ClimbingMotion, Climbs, climbing_motion, excitation_of
from fmu_didim.discovery.next_experiment.members import DesignContext
from fmu_didim.discovery.run import Found
from fmu_didim.discovery.selection.decide import Step
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.report.numbers import significant
from fmu_didim.results.findings import FindingsDocument, RungResult, next_rung
from fmu_didim.workflow.output.augmented_files import augmented_robot

LINES_FILE, MOTION_FILE, LOG_FILE = "experiment_next.yaml", "experiment_next.csv", "experiment_next_torque.csv"
LABEL = "next"
FILL_IN = "FILL IN"
ASKS = {
    "held_out": "another motion, held out", "speed": "another speed", "load": "another load", "gain": "other gains",
    "day": "another day", "unit": "another unit",
}  # fmt: skip


def write_next_run(
    case: Case, found: Found, document: FindingsDocument, out: Path, home: Path
) -> tuple[FindingsDocument, dict[str, str]]:
    """The document that says what was written, and the file; the first effect with an open rung counts, the lowest of
    its rungs.

    Args:
        out: where the files are written; home: where they will lie.
    """
    first = len(document.findings) - len(found.discovery.steps)
    for i, step in enumerate(found.discovery.steps, start=first):
        finding = document.findings[i]
        rung = next_rung(finding.ladder)
        if rung is None or rung.state != "open":
            continue
        motion = None
        if rung.rung in ("held_out", "speed"):
            with suppress(FmuDidimError):  # a reference without positions, or an effect that shows on no given motion
                motion = _motion(found, step, rung)
            if motion is None:
                continue
        content = _lines(case, rung, motion, home)
        text = _text(rung, motion)
        head = [f"{finding.title}, joint {finding.joint}: {ASKS[rung.rung]}", text, *_how(case, rung)]
        lines = yaml.safe_dump({"experiments": content}, sort_keys=False, allow_unicode=True)
        (out / LINES_FILE).write_text("".join(f"# {one}\n" for one in head) + lines, encoding="utf-8")
        if motion is not None and motion.excitation is None:
            write_csv(motion.reference, out / MOTION_FILE)
        told = rung.model_copy(update={"next_step": f"{text} Its lines for the case: {LINES_FILE}."})
        ladder = [told if one is rung else one for one in finding.ladder]
        findings = list(document.findings)
        findings[i] = finding.model_copy(update={"ladder": ladder})
        return document.model_copy(update={"findings": findings}), {"experiment_next": LINES_FILE}
    return document, {}


def _motion(found: Found, step: Step, rung: RungResult) -> ClimbingMotion | None:
    """The motion that a rung asks for."""
    final, builder = found.discovery.final, found.builder
    model, excited = final.model, None
    experiment = model.experiments[model.first]
    if builder.description is not None and step.members:
        without = builder.without(model, model.added_effects.index(step.effect_at))
        robot = augmented_robot(builder, replace(final, model=without, values=without.start))
        noise = final.torque_alone.noise
        context = DesignContext(robot, RobotModel(robot).parameter_values, noise, experiment.rate_hz, builder.effects)
        excited = excitation_of(context, step.members[0])
    present = [model.experiments[label].reference for label in model.estimation_labels]
    joint = None if builder.effect(step.effect_at).is_of_log else step.effect_at.joint
    asked: Climbs = "speed" if rung.rung == "speed" else "held_out"
    return climbing_motion(asked, present, model.joint_count, joint=joint, excited=excited)


def _text(rung: RungResult, motion: ClimbingMotion | None) -> str:
    """What to run, in words."""
    if motion is None:
        return rung.next_step
    seconds = significant(motion.reference.time[-1] - motion.reference.time[0])
    text = f"Run {motion.description}, {seconds} s, and hold it out."
    if motion.excited != motion.excited:
        return f"{text} How much of the effect shows there, only the closed loop tells."
    text += (
        f" What only the effect can make is then {significant(motion.excited, 2)} of the noise "
        f"({significant(motion.excited_now, 2)} on the present motion), if the robot follows."
    )
    return text if motion.is_enough else f"{text} That is too little: move further, if the robot can."


def _how(case: Case, rung: RungResult) -> list[str]:
    short = [name for name in ("train", "validation") if getattr(case.document, name) is not None]
    replaced = (
        f"in the place of {' and '.join(f'{name}:' for name in short)}" if short else "in the place of experiments:"
    )
    told = [
        f"These lines stand in the case {replaced}; log the torque as in the first run, and name the file there.",
        "Bring the robot to the first row at rest. Position, speed and acceleration stay within those of the first "
        "run; look whether the motion hits anything.",
    ]
    if case.signals:
        told.append(
            "The data of the other runs were given in memory, under the names that stand here: give them again."
        )
    if rung.rung in ("day", "unit"):
        told.append(f"State {'date' if rung.rung == 'day' else 'unit'}: of the other runs, too.")
    return told


def _lines(case: Case, rung: RungResult, motion: ClimbingMotion | None, home: Path) -> dict[str, Any]:
    """All experiments of the case, and the next one, seen from the folder of the case."""
    runs = case.document.runs
    content = {k: one.model_dump(mode="json", by_alias=True, exclude_unset=True) for k, one in runs.items()}
    label = LABEL
    while label in content:
        label += "_"
    first = next(iter(content.values()))
    like = {key: deepcopy(value) for key, value in first["torque"].items() if key not in ("file", "obtain")}
    if motion is None:
        reference = deepcopy(first["reference"])
    elif motion.excitation is not None:
        reference = motion.excitation.model_dump(mode="json")
    else:
        reference = {"file": os.path.relpath(home / MOTION_FILE, case.folder)}
    own: dict[str, Any] = {"reference": reference, "torque": {"file": LOG_FILE, **like}, "role": "validation"}
    if rung.rung in ("day", "unit"):
        own["date" if rung.rung == "day" else "unit"] = FILL_IN
    return {**content, label: own}
