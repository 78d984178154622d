"""The verb ``check``: diagnostics of a case before any long work."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, Diagnostic, Severity, by_weight
from fmu_didim.base.errors import FmuDidimError, InputError, SimulationError
from fmu_didim.case import Case, CaseObjects, case_of, with_objects
from fmu_didim.checks.data.expected_accuracy import (
    ExpectedAccuracy,
    accuracy_diagnostics,
    predict_accuracy,
    resonance_diagnostics,
)
from fmu_didim.checks.exploration.search import unsearchable
from fmu_didim.checks.exploration.sensitivities import idle_between_bounds
from fmu_didim.checks.judgement import diagnostic_result
from fmu_didim.checks.plant.consistency import Consistency
from fmu_didim.data.signals import Array
from fmu_didim.estimators.search import crew_of
from fmu_didim.estimators.search.screening import GlobalSensitivity, Method, screened
from fmu_didim.estimators.starts.start import start_sequence, start_text, start_values, with_free_delay
from fmu_didim.fit.exploration.local import LocalSensitivity
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.fit.statistics import error_percent
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.report.drawing.sensitivity_charts import sensitivity_chart
from fmu_didim.report.experiments import with_role
from fmu_didim.report.identification.expected_accuracy import expected_accuracy_lines
from fmu_didim.report.identification.sensitivities import global_lines, local_lines
from fmu_didim.report.numbers import loop_lines, significant
from fmu_didim.report.terminal import wrapped
from fmu_didim.results.searches import global_result
from fmu_didim.workflow.acknowledged import acknowledged
from fmu_didim.workflow.data import case_diagnostics, check_plant
from fmu_didim.workflow.output.loop import described_loop

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NO_START = CATALOGUE(
    "no-start", PROBLEM, rank=40,
    meaning="The torque cannot be simulated at any start: the loop diverges, or the inertia matrix is not positive "
    "definite.",
    next_step="Give start values near those of the machine, or check gains, signs and units of controller and "
    "reference.",
)  # fmt: skip
CONFOUNDED = CATALOGUE(
    "parameters-confounded", PROBLEM, rank=41,
    meaning="These data do not tell some parameters apart, as far as the start shows it.",
    next_step="Leave one of them out, or add data that separate them: another payload, gain or motion.",
)  # fmt: skip
KNOWN = (
    "Take one of them as known (out of identify:, its value into model: {parameters: {...}}), or add an experiment "
    "that separates them, with other inputs or another output."
)
"""The next step where they are of a model."""


@dataclass(frozen=True, repr=False)
class Checked:
    """The findings of :func:`check`.

    Attributes:
        name: of the case; parameters: (p,) names of what would be identified.
        experiments: label -> data; loop: a line a component, one for its timing.
        diagnostics: the most important first; problems must be fixed before an identification.
        confounded: parameters that these data cannot tell apart, as far as the start shows it.
        start: where the torque or the outputs were simulated from, in words; empty where it could not be simulated.
        error_percent: label -> relative error there, before anything is fitted.
        prospect: standard deviations that are predicted there; None where they cannot be.
        effects: what each parameter does to the outputs there; sensitivity: between the bounds, where it was asked for.
        begin: (p,) values there.
        consistency: of plant and robot description; None where one is built from the other.
        quantity: what is compared, in a word: torque, or output of a model.
        acknowledged: code -> sentence of the doubts that the case acknowledges.
    """

    name: str
    parameters: tuple[str, ...]
    experiments: Mapping[str, Experiment]
    loop: tuple[str, ...]
    diagnostics: tuple[Diagnostic, ...] = ()
    confounded: tuple[str, ...] = ()
    start: str = ""
    error_percent: Mapping[str, float] = field(default_factory=dict)
    prospect: ExpectedAccuracy | None = None
    effects: LocalSensitivity | None = None
    sensitivity: GlobalSensitivity | None = None
    begin: Array | None = None
    consistency: Consistency | None = None
    quantity: str = "torque"
    acknowledged: Mapping[str, str] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether nothing stands against an identification."""
        return not self.found(PROBLEM)

    def found(self, severity: Severity) -> tuple[Diagnostic, ...]:
        """The diagnostics of one severity."""
        return tuple(d for d in self.diagnostics if d.code.severity is severity)

    def _samples(self, experiment: Experiment) -> str:
        """How many samples an experiment has: of a model of each output that has instants of its own, too."""
        if self.quantity == "torque":
            return f"{experiment.time.size} samples at {experiment.rate_hz:.6g} Hz"
        others = "".join(f", {channel.time.size} of {channel.name}" for channel in experiment.channels)
        return f"{experiment.time.size} samples, one in {1 / experiment.rate_hz:.6g} s{others}"

    def saved(self, case: str = "") -> dict[str, Any]:
        """The diagnostics as JSON shows them.

        Args:
            case: file of the case, for the commands that they name.
        """
        diagnostics = [
            {"severity": d.code.severity.value, **diagnostic_result(d, case).model_dump(mode="json")}
            for d in self.diagnostics
        ]
        found = {"ready": self.ok, "diagnostics": diagnostics}
        if self.sensitivity is not None:
            found["sensitivity"] = global_result(self.sensitivity).model_dump(mode="json")
        return found

    def plot(self) -> Figure:
        """The sensitivities between the bounds as a Matplotlib figure.

        Raises:
            InputError: they were not asked for.
        """
        from fmu_didim.report.drawing.figures import matplotlib_figure

        if self.sensitivity is None:
            raise InputError(
                "There are no sensitivities to draw.", next_step="Ask for them: check(case, sensitivity='morris')."
            )
        return matplotlib_figure(sensitivity_chart(global_result(self.sensitivity)))

    def __repr__(self) -> str:
        counts = ", ".join(f"{severity.value}s: {len(self.found(severity))}" for severity in Severity)
        return f"Checked({self.name!r}, {counts})"

    def summary(self) -> str:
        """The findings, at most 100 columns wide; the verdict comes last."""
        entries = [
            ("Parameters", f"{len(self.parameters)}: {', '.join(self.parameters)}"),
            *(
                ("Experiment", f"{with_role(label, e.role)}: {self._samples(e)}")
                for label, e in self.experiments.items()
            ),
            *(("Loop" if self.quantity == "torque" else "Model", line) for line in self.loop),
        ]
        if self.error_percent:
            known = {label: v for label, v in self.error_percent.items() if np.isfinite(v)}
            errors = ", ".join(f"{significant(v)} % on {label}" for label, v in known.items()) or "not known"
            entries.append(("Start", f"{self.quantity} error {errors}, from {self.start}"))
        if self.consistency is not None and self.consistency.points and not self.consistency.warnings():
            worst = significant(self.consistency.worst, 2)
            entries.append(("Plant", f"it agrees with the robot description to {worst}"))
        lines = [*wrapped(self.name), ""]
        lines += [line for head, text in entries for line in wrapped(text, f"{head:12}", " " * 12)]
        lines.append("")
        if self.prospect is not None:
            lines += [f"Predicted from {self.start}, before any fit:", *expected_accuracy_lines(self.prospect), ""]
        if self.effects is not None:
            lines += [*local_lines(self.effects), ""]
        if self.sensitivity is not None:
            lines += [*global_lines(self.sensitivity), ""]
        for d in self.diagnostics:
            lines += wrapped(f"{d.code.severity.value.upper()} {d.code.name}: {d}", "", "  ")
            sentence = self.acknowledged.get(d.code.name, "")
            lines += wrapped(sentence, "  Acknowledged in the case: ", "    ") if sentence else []
            lines += wrapped(d.advice, "  Next: ", "    ") if d.advice and not sentence else []
        open_ = [d for d in self.found(DOUBT) if d.code.name not in self.acknowledged]
        verdict = "READY, with doubts" if open_ else "READY: nothing stands against an identification"
        return "\n".join([*lines, verdict if self.ok else "NOT READY: fix the problems above"]) + "\n"


@with_objects
def check(
    case: Case | Path | str | Mapping[str, Any] | None = None,
    *,
    sensitivity: Method | None = None,
    samples: int | None = None,
    seed: int = 0,
    say: Callable[[str], None] | None = None,
    **objects: Unpack[CaseObjects],
) -> Checked:
    """Check a case before any long work: its plant or model, its parameters, its data and its start.

    It compares plant and robot description where both are given; checks that each parameter acts, that the logs can be
    those of this loop, and that the data distinguish the parameters at the start. It takes a few simulations, and one
    more for each parameter with components of other tools.

    Args:
        case: a loaded case, the path of its file, or its content.
        robot, plant, controller, log, reference, validation, loop, model, inputs, measured, parameters: objects in the
            place of what the case has, as of
            :func:`~fmu_didim.identify`.
        sensitivity: ``morris`` or ``sobol``: which parameters matter between their bounds, too, by SALib.
        samples: of it: trajectories (20), or base points (64); seed: of its draws; say: told how long it takes.

    Raises:
        InputError, FmuError, BuildError: the case cannot be loaded at all; or sensitivities are asked for and SALib is
            not installed, or no parameter has bounds.
    """
    case = case_of(case, objects)
    sentences = acknowledged(case)
    model = with_free_delay(case.model) if getattr(case.estimator, "estimate_delay", False) else case.model
    consistency, diagnostics = check_plant(case, model)
    diagnostics += case_diagnostics(case)
    diagnostics += [] if case.document.search is None else unsearchable(model)
    found = Checked(
        name=case.name,
        parameters=model.names,
        experiments=model.experiments,
        loop=_lines_of_the_loop(case, model),
        diagnostics=tuple(diagnostics),
        consistency=consistency,
        quantity="torque" if model.loop.shows_torque else "output",
        acknowledged=sentences,
    )
    found = _at_the_start(case, model, found)
    if sensitivity is not None:
        found = _with_sensitivity(case, model, found, sensitivity, samples, seed, say or (lambda _: None))
    return replace(found, diagnostics=tuple(by_weight(found.diagnostics)))


def _lines_of_the_loop(case: Case, model: LoopModel) -> tuple[str, ...]:
    """A line a component, and one for the timing; of a model for the steps of its simulation."""
    lines = loop_lines(described_loop(case, model.loop.systems[model.first].describe()))
    if case.data is None:
        return tuple(lines)
    steps = "at the rows of inputs and samples" if case.data.at_instants else f"of {case.step_size:g} s"
    return (*lines[:-1], f"steps {steps}")


def _at_the_start(case: Case, model: LoopModel, found: Checked) -> Checked:
    """The torque error where the estimator may start, and what the data cannot tell apart there."""
    reasons = []
    for start, place in _starts(case):
        try:
            values = model.free_parameters.limited(start_values(model, start))
            reason = mass_matrix_problem(model, values)
            if reason:
                raise SimulationError(reason, next_step="Start from other values.")
            torque = {label: model.torque(values, label) for label in model.experiments}
        except FmuDidimError as error:
            reasons.append(f"{place}: {error.what}" + (f" ({error.got})" if error.got else ""))
            continue
        errors = {
            label: error_percent(model.loop, model.experiments.measured_in(label), t)[0] for label, t in torque.items()
        }
        fitted = np.concatenate([torque[label] for label in model.estimation_labels])
        alike, ahead, effects = predict_accuracy(model, values, fitted)
        step = "" if model.loop.shows_torque else KNOWN
        text = f"These data do not tell {', '.join(alike)} apart."
        told = [Diagnostic(CONFOUNDED, text, next_step=step)] if alike else []
        told += accuracy_diagnostics(ahead) if ahead is not None else []
        told += resonance_diagnostics(model, values) if model.loop.shows_torque else []
        told = [*found.diagnostics, *told]
        return replace(
            found,
            start=place,
            error_percent=errors,
            confounded=alike,
            prospect=ahead,
            diagnostics=tuple(told),
            effects=effects,
            begin=values,
        )
    what = f"The {found.quantity} cannot be simulated at any start: "
    text = what + "; ".join(f"from {reason}" for reason in reasons)
    return replace(found, diagnostics=(*found.diagnostics, Diagnostic(NO_START, text)))


def _with_sensitivity(
    case: Case, model: LoopModel, found: Checked, method: Method, samples: int | None, seed: int,
    say: Callable[[str], None],
) -> Checked:  # fmt: skip
    """The findings with the sensitivities between the bounds."""
    begin = model.start if found.begin is None else found.begin
    crew = crew_of(case.estimator, model)
    try:
        made = screened(model, begin, method, crew, samples=samples, seed=seed, say=say)
    finally:
        crew.close()
    told = [*found.diagnostics, *idle_between_bounds(made)]
    return replace(found, sensitivity=made, diagnostics=tuple(told))


def _starts(case: Case) -> Iterator[tuple[Any, str]]:
    """Where an identification may start, the most telling one first."""
    for start in start_sequence(case.model, "torque" if case.parameters.has_regressor else "description"):
        yield start, start_text(start) if case.data is None else "its start values"
    own = getattr(case.estimator, "start", None)
    if isinstance(own, Mapping):
        yield own, "the start of the case"
