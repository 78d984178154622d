"""A loop model with its logs, identified and judged as ``identify`` does it; and whether the verdict may be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.diagnostics import PROBLEM, REMARK
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.checks.identification import checked
from fmu_didim.checks.validation import Validation, validate_on
from fmu_didim.estimators import Didim
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.loop_model import LoopModel

SIGMA = 4.0
"""Standard deviations beyond which a true value must not lie where the verdict is valid."""
HELD_OUT = 1.5
"""Held-out error over that of the fit, in size and relative to the torque, that must not be exceeded there."""


@dataclass(frozen=True)
class Answer:
    """What is said of a model and its data.

    Attributes:
        verdict: of the judgement; codes: of its reasons, the weightiest first.
        farthest: the largest error of a value in its standard deviations; held_out: the largest ratio of a joint.
        conditions: what a valid verdict rests on.
        inside: how many true values lie in the 95 % intervals, out of ``compared``.
    """

    verdict: str
    codes: tuple[str, ...]
    farthest: float = 0.0
    held_out: float = 0.0
    inside: int = 0
    compared: int = 0
    conditions: tuple[str, ...] = ()

    @property
    def is_wrong(self) -> bool:
        """Whether values that are wrong, or predict another motion badly, are called valid."""
        return self.verdict == "valid" and (self.farthest > SIGMA or self.held_out > HELD_OUT)


def answer(model: LoopModel, truth: Mapping[str, float]) -> Answer:
    """The verdict on the values that ``didim`` gives.

    Args:
        truth: values by name; parameters that it lacks are not compared.
    """
    before = data_diagnostics(model)
    told = tuple(d.code.name for d in before if d.code.severity is not REMARK)
    if any(d.code.severity is PROBLEM for d in before):
        return Answer("refused", told)
    try:
        estimate = Didim(start="torque").estimate(model)
    except FmuDidimError:
        return Answer("refused", told)
    validations = [validate_on(estimate.model, estimate.value, label) for label in estimate.model.experiments]
    judgement = checked(estimate, validations, before=before).judgement
    codes = tuple(reason.code.name for reason in judgement.reasons)
    inside = _inside(estimate, truth)
    return Answer(
        judgement.verdict, codes, _farthest(estimate, truth), _ratio(validations), sum(inside), len(inside),
        tuple(judgement.conditions),
    )  # fmt: skip


def _farthest(estimate: Estimate, truth: Mapping[str, float]) -> float:
    pairs = zip(estimate.names, estimate.value, estimate.standard_deviation, strict=True)
    return max((abs(value - truth[name]) / sigma for name, value, sigma in pairs if name in truth), default=0.0)


def _inside(estimate: Estimate, truth: Mapping[str, float]) -> list[bool]:
    rows = zip(estimate.names, estimate.interval(), strict=True)
    return [bool(low <= truth[name] <= high) for name, (low, high) in rows if name in truth]


def _ratio(validations: list[Validation]) -> float:
    """Largest ratio of a held-out residual to that of the fit: in size or relative to the torque, the smaller one."""
    sizes = {v.role: np.sqrt(((v.measured - v.simulated) ** 2).mean(axis=0)) for v in validations}
    relative = {v.role: sizes[v.role] / np.sqrt((v.measured**2).mean(axis=0)) for v in validations}
    if "validation" not in sizes:
        return 0.0
    both = [one["validation"] / one["estimation"] for one in (sizes, relative)]
    return float(np.nan_to_num(np.minimum(*both), nan=np.inf).max())


def named(model: LoopModel) -> dict[str, float]:
    """The start values of a model by name."""
    return dict(zip(model.names, model.start.tolist(), strict=True))


def without_start(model: LoopModel, other: LoopModel) -> LoopModel:
    """``other`` with the logs of ``model``."""
    return replace(other, experiments=model.experiments)
