"""The experiments of a result in words and rows, and its parameters in groups."""

from __future__ import annotations

from dataclasses import dataclass

from fmu_didim.report.numbers import (
    ParameterText,
    item_or_none,
    parameter_text,
    pretty_unit,
    rounding,
)
from fmu_didim.results.result import ExperimentResult, ParameterResult, ResultDocument

DELAY = "delay"
"""Value of ``of`` for parameters that count control periods."""
OF_PLANT = ("plant", "model")
"""The same for parameters of the plant, or of a model without controller."""
ALL_FITTED = "all fitted"


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters that are shown together; the head is empty for the plant's shared parameters."""

    head: str
    parameters: dict[str, ParameterResult]


def parameter_groups(document: ResultDocument) -> list[ParameterGroup]:
    """Shared parameters of the plant, those that belong to one experiment, those of the loop."""
    plant = {name: p for name, p in document.parameters.items() if p.of in OF_PLANT}
    shared = {name: p for name, p in plant.items() if p.experiment is None}
    groups = [ParameterGroup("", shared)]
    for label in dict.fromkeys(p.experiment for p in plant.values() if p.experiment is not None):
        own = {name: p for name, p in plant.items() if p.experiment == label}
        groups.append(ParameterGroup(f"own to {label}", own))
    groups.append(ParameterGroup("the loop", {n: p for n, p in document.parameters.items() if p.of not in OF_PLANT}))
    return [group for group in groups if group.parameters]


def shown_unit(parameter: ParameterResult) -> str:
    """The unit for reading; a delay counts samples of the loop."""
    return "samples" if parameter.of == DELAY else pretty_unit(parameter.unit)


def shown_parameter(name: str, parameter: ParameterResult) -> ParameterText:
    """The texts of a parameter; the name of a component other than the plant is added: ``Kp1 (controller)``."""
    shown = name if parameter.of in (*OF_PLANT, DELAY, "log") else f"{name} ({parameter.of})"
    return parameter_text(shown, parameter, shown_unit(parameter))


def delay_lines(document: ResultDocument) -> list[str]:
    """Each identified delay in samples and in milliseconds."""
    step = document.loop.get("step_size_s")
    lines = []
    for name, parameter in document.parameters.items():
        if parameter.of != DELAY or not isinstance(step, int | float):
            continue
        shown, value, std = shown_parameter(name, parameter), 1e3 * step * parameter.value, 1e3 * step * parameter.std
        digits = rounding(value, std)
        lines.append(
            f"{name} = ({shown.value} ± {shown.std}) samples = ({digits.text(value)} ± {digits.deviation(std)}) ms "
            f"at a step of {1e3 * step:.6g} ms"
        )
    return lines


def is_short_form(document: ResultDocument) -> bool:
    """Whether there is one experiment for the estimation and at most one for the validation."""
    return set(document.experiments) <= {"estimation", "validation"}


def with_role(label: str, role: str | None) -> str:
    """An experiment with its role, if its label does not say it."""
    return label if role is None or label == role else f"{label} ({role})"


def experiment_title(document: ResultDocument, label: str) -> str:
    """An experiment of a result with its role, if its label does not say it."""
    found = document.experiments.get(label)
    return with_role(label, found.role if found is not None else None)


def start_text(experiment: ExperimentResult) -> str:
    """The initial state of an experiment: ``given: q1 = 0.61, integral1 = 0.002``."""
    state = experiment.initial_state
    values = ", ".join(f"{name} = {value:.4g}" for name, value in state.values.items())
    return f"{state.kind}: {values}" if values else state.kind


def error_rows(document: ResultDocument) -> list[tuple[str, list[float | None]]]:
    """Relative errors, in total and per joint, of each experiment, and of all fitted ones if there are several."""
    joints = range(len(document.torque_unit))
    found = dict(document.relative_error_percent)
    fitted = [e for e in document.experiments.values() if e.role == "estimation"]
    if len(fitted) > 1 and document.fitted_error_percent is not None:
        found[ALL_FITTED] = document.fitted_error_percent
    return [
        (label, [error.total, *(item_or_none(error.per_joint, j) for j in joints)]) for label, error in found.items()
    ]
