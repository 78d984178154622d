"""Torques from outside, written down as a finding and as windows of time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.document import gap_pair, values_found
from fmu_didim.discovery.external_torques.fit import FittedExternalTorques
from fmu_didim.dynamics.effects import EFFECTS, Effect
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.statistics import confidence_interval
from fmu_didim.model.external_torque import EXTERNAL_TORQUE
from fmu_didim.model.free_parameter import FreeParameter
from fmu_didim.results.findings import FindingResult, GapPair, Rival, ValueFound, WindowResult

LISTED = 3
"""[external torques] Up to which all are listed as parameters; the windows list them in any case."""
SMALLEST_DEVIATION = 1e-12
"""[N.m or N] By which a torque is divided for its score."""


def external_torque_finding(
    fitted_torques: FittedExternalTorques, base: Fit, free: Fit, effect: Effect
) -> FindingResult:
    """The finding: times and torques of the external torques with their intervals."""
    first, *others = free.model.experiments[fitted_torques.label].external_torques
    where = " It was added to the command, so that the torque log shows it." if first.is_logged else ""
    return FindingResult(
        effect=effect.name,
        title=effect.title,
        class_=effect.class_name,
        joint=first.joint,
        place="command" if first.is_logged else effect.place,
        equation=f"F[i] from t_on[i] to t_off[i], i = 1 to {1 + len(others)}, positive along the joint.{where}",
        parameters=_summary(free),
        share_of_gap=fitted_torques.share,
        delta_bic=fitted_torques.delta_bic,
        ambiguous=[
            Rival(effect=name, title=EFFECTS[name].title, joint=first.joint, bic_behind=None)
            for name in effect.confounded_with
        ],
        experiment=effect.experiment,
        gap=_gaps(base, fitted_torques.fit),
        ratio_interval=None,
    )


def external_torque_windows(free: Fit, label: str) -> list[WindowResult]:
    """One window for each external torque; its score is its torque in standard deviations."""
    deviation = {v.name: v.std for v in values_found(free, _is_external_torque)}
    return [
        WindowResult(
            joint=p.joint, begin_s=p.begin_s, end_s=p.end_s, torque=p.torque, experiment=label,
            score=abs(p.torque) / max(deviation.get(f"F[{i}]") or 0.0, SMALLEST_DEVIATION),
        )
        for i, p in enumerate(free.simulation(label).external_torques, start=1)
    ]  # fmt: skip


def _is_external_torque(parameter: FreeParameter) -> bool:
    return parameter.owner == EXTERNAL_TORQUE


def _summary(free: Fit) -> list[ValueFound]:
    """All of a few external torques; of many the mean with its spread, and the times of the first."""
    values = values_found(free, _is_external_torque)
    torques = np.array([v.value for v in values if v.name.startswith("F[")])
    if torques.size <= LISTED:
        return values
    mean, std = float(torques.mean()), float(torques.std(ddof=1) / np.sqrt(torques.size))
    unit = next(v.unit for v in values if v.name.startswith("F["))
    low, high = confidence_interval(np.array([mean]), np.array([std]), torques.size - 1.0)[0]
    both = ValueFound(name="F[mean]", unit=unit, value=mean, std=std, interval=(float(low), float(high)))
    return [both, *(v for v in values if v.name in ("t_on[1]", "t_off[1]"))]


def _gaps(before: Fit, after: Fit) -> Mapping[str, GapPair]:
    """The gaps before and after of each experiment that both models can simulate."""
    result = {}
    for label in before.model.experiments:
        try:
            pair = [f.residual_in(label) for f in (before, after)]
        except SimulationError:
            continue
        result[label] = gap_pair(pair[0], pair[1], after.noise)
    return result
