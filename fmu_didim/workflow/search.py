"""The estimate of a case: from one start, or by the search that it asks for, and with the profiles that it asks for."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fmu_didim.base.errors import IdentificationError, SimulationError, UnknownNameError
from fmu_didim.case import Case
from fmu_didim.data.signals import Array
from fmu_didim.estimators import Progress
from fmu_didim.estimators.long_logs import on_all_samples, part_to_judge
from fmu_didim.estimators.search import (
    check_minima,
    crew_of,
    from_values,
    profiled,
    searched,
    with_essential,
)
from fmu_didim.estimators.starts.signs import unfolded, unknown_signs
from fmu_didim.estimators.starts.start import with_free_delay
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.choices import choices_of
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.stretches import PartOfLogs

SIGNS_AGAIN = 5
"""[fits] After the first one, for a log without signs, until this is one with those of the simulated torque: two or
three."""
SAME_LOG = 0.05
"""[standard deviations] Of the noise, by which such a log may change at most without being fitted again."""


def profile_names(case: Case, asked: bool | Sequence[str] | None) -> tuple[str, ...] | None:
    """Names of the parameters that are to be profiled, none for all of them; None where none are.

    Args:
        asked: in the place of what the case says; None: what it says.

    Raises:
        InputError: the answer of the estimator is no minimum; UnknownNameError: no parameter of this name is free.
    """
    names: tuple[str, ...] | None
    if asked is None:
        names = case.document.profiled
    elif isinstance(asked, bool):
        names = () if asked else None
    else:
        names = tuple(asked) or None
    if names is None:
        return None
    check_minima(case.estimator, case.model, "profile")
    known = with_free_delay(case.model).names
    for name in names:
        if name not in known and "[" not in name:  # as of an initial state, which an estimator may free
            raise UnknownNameError("free parameter", name, case.model.names, where="profile")
    return names


def judged_part(case: Case, names: tuple[str, ...] | None, *, essential: bool) -> PartOfLogs | None:
    """The part of long logs that is judged; None where all samples are: also where profiles, a reduced model or a
    search for other minima is asked for, or the controller is a virtual one."""
    plain = case.document.search is None and case.tracking is None and case.data is None
    return part_to_judge(case.model, case.estimator) if plain and names is None and not essential else None


def estimated_by_part(case: Case, part: PartOfLogs, progress: Progress) -> Estimate | None:
    """The estimate of all samples of long logs by way of a part of them; None where that does not lead to it."""
    try:
        found = case.estimator.estimate(part.model, progress=progress)
        return on_all_samples(found, part, case.model, progress)
    except (IdentificationError, SimulationError):  # of all samples, it may be another one, or none
        return None


def estimated(
    case: Case, model: LoopModel, names: tuple[str, ...] | None, progress: Progress, *, essential: bool = False
) -> Estimate:
    """The estimate of a case, on a model of it, with the profiles of these parameters, and with its reduced model where
    that is asked for; raises what its estimator raises."""
    found, search = _beside_other_choices(case, _found(case, model, progress)), case.document.search
    if essential:
        found = with_essential(found, model, partial(_refitted, case, progress))
    if names is None:
        return found
    processes = None if search is None else search.processes
    return profiled(
        case.estimator, found, names, lambda of: crew_of(case.estimator, of, processes), progress=progress
    )  # fmt: skip


def _refitted(case: Case, progress: Progress, model: LoopModel, start: Mapping[str, float]) -> Estimate:
    """The estimate of a reduced model, from these values."""
    found = from_values(case.estimator, start).estimate(model, progress=progress)
    return _beside_other_choices(case, found, without=set(case.model.names) - set(model.names))


def _found(case: Case, model: LoopModel, progress: Progress) -> Estimate:
    """The estimate, with the signs of the torque that it simulates where a log has none."""
    found = _with_these_signs(case, model, progress)
    for _ in range(SIGNS_AGAIN if any(e.is_unsigned for e in model.experiments.values()) else 0):
        noise = found.noise[: model.joint_count]
        signed = unfolded(found.model, found.value, noise, model)
        if _change(found.model, signed, noise) <= SAME_LOG:
            kept = {label: found.model.experiments[label] for label in found.model.estimation_labels}
            fit = found.minimum or found.fit
            lost = 0.0 if fit is None else unknown_signs(fit)
            return replace(found, model=_given_logs(signed, kept), covariance=found.covariance + lost)
        found = _with_these_signs(case, _given_logs(model, signed.experiments), progress)
    return found


def _beside_other_choices(case: Case, found: Estimate, *, without: Collection[str] = ()) -> Estimate:
    """The estimate whose covariance contains the choice of a virtual controller; itself where the controller is
    known. ``without``: what a reduced model does without."""
    fit = found.minimum or found.fit
    if case.tracking is None or fit is None:
        return found
    models = {words: other.model for words, other in case.other_choices.items()}
    if without:
        models = {words: model.without(without) for words, model in models.items()}
    choices = choices_of(fit, case.tracking.chosen, models, found.standard_deviation)
    return replace(found, covariance=found.covariance + choices.covariance, choices=choices)


def _change(model: LoopModel, other: LoopModel, noise: Array) -> float:
    """The largest change between the fitted logs of two models, over the deviations of the noise (n,)."""
    pairs = [(model.experiments[k].torque, other.experiments[k].torque) for k in model.estimation_labels]
    return max(float(np.max(np.abs(a - b) / np.maximum(noise, TINY))) for a, b in pairs)


def _given_logs(model: LoopModel, logs: Mapping[str, Experiment]) -> LoopModel:
    """The model with the torque of these experiments."""
    for label, experiment in logs.items():
        model = model.with_experiment(label, replace(model.experiments[label], torque=experiment.torque))
    return model


def _with_these_signs(case: Case, model: LoopModel, progress: Progress) -> Estimate:
    search = case.document.search
    if search is None:
        return case.estimator.estimate(model, progress=progress)
    crew = crew_of(case.estimator, model, search.processes)
    try:
        return searched(case.estimator, model, search, crew, progress=progress)
    finally:
        crew.close()
