"""The verb ``check``: what can be said of a case before any long work."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.case import Case, load_case
from fmu_didim.diagnosis.acting import check_acting, start_warnings
from fmu_didim.diagnosis.confounding import confounded
from fmu_didim.diagnosis.consistency import Consistency, check_consistency
from fmu_didim.diagnosis.log_checks import check_log
from fmu_didim.errors import FmuDidimError, InputError, SimulationError
from fmu_didim.identification.start import start_sequence, start_text, start_values, with_free_delay
from fmu_didim.prediction.experiment import Experiment
from fmu_didim.prediction.guard import mass_matrix_problem
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.sensitivity import sensitivity
from fmu_didim.prediction.weighting import noise_floor, whitened
from fmu_didim.report.experiments import titled
from fmu_didim.report.numbers import loop_lines, significant
from fmu_didim.report.table import wrapped
from fmu_didim.signals import Array
from fmu_didim.statistics import relative_error_percent
from fmu_didim.workflow.loop import described_loop


@dataclass(frozen=True, repr=False)
class Checked:
    """What :func:`check` returns.

    Attributes:
        name: of the case; parameters: (p,) names of what would be identified.
        experiments: label -> data; loop: a line a component, one for its timing.
        problems: what must be mended before an identification can succeed; warnings: what should be looked at.
        confounded: parameters that these data cannot tell apart, as far as the start shows it.
        start: where the torque was simulated from, in words; empty where it could not be simulated.
        error_percent: label -> relative torque error there, before anything is fitted.
        consistency: of plant and robot description; None where one is built from the other.
    """

    name: str
    parameters: tuple[str, ...]
    experiments: Mapping[str, Experiment]
    loop: tuple[str, ...]
    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    confounded: tuple[str, ...] = ()
    start: str = ""
    error_percent: Mapping[str, float] = field(default_factory=dict)
    consistency: Consistency | None = None

    @property
    def ok(self) -> bool:
        """Whether nothing stands against an identification."""
        return not self.problems and not self.confounded

    def __repr__(self) -> str:
        problems = len(self.problems) + bool(self.confounded)
        return f"Checked({self.name!r}, problems: {problems}, warnings: {len(self.warnings)})"

    def summary(self) -> str:
        """What was found, at most 100 columns wide; the verdict comes last."""
        entries = [
            ("Parameters", f"{len(self.parameters)}: {', '.join(self.parameters)}"),
            *(
                ("Experiment", f"{titled(label, e.role)}: {e.time.size} samples at {e.rate_hz:.6g} Hz")
                for label, e in self.experiments.items()
            ),
            *(("Loop", line) for line in self.loop),
        ]
        if self.error_percent:
            errors = ", ".join(f"{significant(v)} % on {label}" for label, v in self.error_percent.items())
            entries.append(("Start", f"torque error {errors}, from {self.start}"))
        if self.consistency is not None and self.consistency.points and not self.consistency.warnings():
            worst = significant(self.consistency.worst, 2)
            entries.append(("Plant", f"it agrees with the robot description to {worst}"))
        lines = [*wrapped(self.name), "", *(line for head, text in entries for line in _entry(head, text)), ""]
        for problem in self.problems:
            lines += _message("PROBLEM", problem)
        if self.confounded:
            text = f"these data do not tell {', '.join(self.confounded)} apart: leave one of them out, or add data."
            lines += _message("PROBLEM", text)
        for warning in self.warnings:
            lines += _message("WARNING", warning)
        return "\n".join([*lines, self._verdict()]) + "\n"

    def _verdict(self) -> str:
        if not self.ok:
            return "NOT READY: mend the problems above"
        return "READY, with warnings" if self.warnings else "READY: nothing stands against an identification"


def check(case: Case | Path | str | Mapping[str, Any]) -> Checked:
    """Look at a case before any long work: its plant, its parameters, its torque logs and where it starts.

    It compares plant and robot description where both are given, asks whether each parameter acts, whether the logs
    can be those of this loop, and whether the data tell the parameters apart at the start. Takes a few simulations,
    and for components of other tools one more for each parameter.

    Args:
        case: a loaded case, the path of its file, or its content.

    Raises:
        InputError, FmuError, BuildError: the case cannot be loaded at all.
    """
    case = case if isinstance(case, Case) else load_case(case)
    model = with_free_delay(case.model) if getattr(case.estimator, "estimate_delay", False) else case.model
    consistency, problems, warnings = _of_the_plant(case, model)
    for label in model.experiments:
        try:
            warnings += check_log(model, label)
        except InputError as error:
            problems.append(str(error))
    found = Checked(
        name=case.name,
        parameters=model.names,
        experiments=model.experiments,
        loop=tuple(loop_lines(described_loop(case, model.systems[model.first].describe()))),
        problems=tuple(problems),
        warnings=tuple(warnings),
        consistency=consistency,
    )
    return _at_the_start(case, model, found)


def has_own_plant(case: Case) -> bool:
    """Whether the plant is given apart from the robot description, so that the two may differ."""
    return case.document.plant.source is not None or case.base is not None


def _of_the_plant(case: Case, model: LoopModel) -> tuple[Consistency | None, list[str], list[str]]:
    """What is found of a plant of its own: its comparison with the description, problems, and warnings."""
    if not has_own_plant(case):
        return None, [], []
    consistency = check_consistency(model) if model.parameters.has_regressor else None
    unlike = consistency.warnings() if consistency is not None else []
    problems = []
    try:
        check_acting(model)
    except InputError as error:
        problems.append(str(error))
    return consistency, problems, [*unlike, *start_warnings(model)]


def _at_the_start(case: Case, model: LoopModel, found: Checked) -> Checked:
    """The torque error where the estimator may start, and what the data cannot tell apart there."""
    reasons = []
    for start, place in _starts(case):
        try:
            values = model.limited(start_values(model, start))
            reason = mass_matrix_problem(model, values)
            if reason:
                raise SimulationError(reason)
            torque = {label: model.torque(values, label) for label in model.experiments}
        except FmuDidimError as error:
            reasons.append(f"{place}: {error.what}" + (f" ({error.got})" if error.got else ""))
            continue
        errors = {label: relative_error_percent(model.measured_in(label), t)[0] for label, t in torque.items()}
        fitted = np.concatenate([torque[label] for label in model.estimation_labels])
        return replace(found, start=place, error_percent=errors, confounded=_confounded(model, values, fitted))
    problem = "The torque cannot be simulated at any start:\n" + "\n".join(f"  from {reason}" for reason in reasons)
    return replace(found, problems=(*found.problems, problem))


def _starts(case: Case) -> Iterator[tuple[Any, str]]:
    """Where an identification may start, the most telling one first."""
    for start in start_sequence(case.model, "torque" if case.parameters.has_regressor else "description"):
        yield start, start_text(start)
    own = getattr(case.estimator, "start", None)
    if isinstance(own, Mapping):
        yield own, "the start of the case"


def _confounded(model: LoopModel, values: Array, torque: Array) -> tuple[str, ...]:
    """Parameters that the data cannot tell apart; the noise is what one linear step would leave of the residual."""
    try:
        columns, residual = sensitivity(model, values, torque), model.measured - torque
    except SimulationError:
        return ()  # so near to where the loop diverges nothing can be said
    flat = columns.reshape(-1, values.size)
    left = residual - columns @ np.linalg.lstsq(flat, residual.reshape(-1), rcond=1e-9)[0]
    deviation = model.torque_deviation
    if deviation is None:
        deviation = np.maximum(np.sqrt((left**2).mean(axis=0)), noise_floor(model.measured))
    size = float(np.linalg.norm(model.measured / deviation))
    return confounded(whitened(columns, deviation), values, model.names, torque=size)


def _entry(head: str, text: str) -> list[str]:
    return wrapped(text, f"{head:12}", " " * 12)


def _message(head: str, text: str) -> list[str]:
    first, *others = text.splitlines()
    return [
        *wrapped(f"{head}: {first}", "", "  "),
        *(line for o in others for line in wrapped(o.strip(), "  ", "    ")),
    ]
