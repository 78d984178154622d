"""The reduced model of a robot: without the base parameters that the data do not need.

answer of the full model -> F-test (:mod:`fmu_didim.fit.exploration.essential`) -> what may be left out
-> the others fitted anew -> held-out residual of both models -> the reduced model; where it is worse there, with
   the quarter of what was left out that helps most put back, and so on
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import IdentificationError, InputError, SimulationError
from fmu_didim.fit.estimate import Estimate, Status
from fmu_didim.fit.exploration.essential import WORSE, Elimination, Essential, as_if_zero, eliminated, without
from fmu_didim.fit.gap import Ratio, block_in, rms_ratio
from fmu_didim.fit.noise.noise import TINY, Noise
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.fit.statistics import error_percent
from fmu_didim.model.free_parameter import BASE
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters

Refit = Callable[[LoopModel, Mapping[str, float]], Estimate]
"""The estimate of a reduced model from values by name; raises what an estimator raises."""
PUT_BACK = 4
"""[1] Of what was left out a quarter comes back at once: each time is a fit."""
NOT_SETTLED = "the values of the full model did not settle"
WORSE_ANSWER = "without them the held-out residual{} would be {:.4g} ({:.4g} to {:.4g}) times that of the full model"
NO_ANSWER = "without them there is no answer: {}"


def check_reducible(model: LoopModel) -> None:
    """Raise InputError, before any work, where no parameter of a model could be said to be unneeded."""
    where, step = "essential", "Leave --essential out, or give the robot of the case as a description (robot:)."
    if not isinstance(model.parameters, RobotParameters):
        raise InputError(
            "Only of the base parameters of a robot description is it known that zero means without them.",
            where=where, got="a plant without one", next_step=step,
        )  # fmt: skip
    if model.prior is not None:
        raise InputError(
            "Beside a prior the data alone do not say which parameters are needed.", where=where,
            got="a prior of the case, or a load with mass_std:",
            next_step="Leave --essential out, or take prior: or mass_std: out of the case.",
        )  # fmt: skip
    if any(experiment.is_unsigned for experiment in model.experiments.values()):
        raise InputError(
            "Of a log without signs the reduced model would choose other signs than the full one.", where=where,
            got="torque: {unsigned: true}", next_step="Leave --essential out, or log the torque with its sign.",
        )  # fmt: skip


def with_essential(found: Estimate, model: LoopModel, refit: Refit) -> Estimate:
    """The estimate with its reduced model.

    Args:
        model: as it was given to the estimator, which may have freed more.
        refit: the same estimator on a reduced model.
    """
    if found.status is not Status.CONVERGED:
        return replace(found, essential=Essential(because=NOT_SETTLED))
    of_full = found.value, found.covariance, found.freedom
    first = eliminated(*of_full, candidates(model), lambda values: mass_matrix_problem(found.model, values))
    now, because = first, ""
    while now.left_out:
        try:
            return replace(found, essential=_reduced(found, model, now, refit, first, because))
        except _NotReducedError as failed:
            because = because or failed.why
            now = without(*of_full, _without_the_dearest(found, now.left_out), first.needed)
    return replace(found, essential=_told(found, first, now, because))


def candidates(model: LoopModel) -> list[int]:
    """Places of the base parameters that a reduced model can do without: those that all experiments share, and no load
    moves; rotors always have inertia."""
    parameters, free = model.parameters, model.free_parameters
    assert isinstance(parameters, RobotParameters)
    own = {k.key for k in free if k.owner == BASE and k.experiment is not None and not k.is_load}
    return [
        i for i, name in enumerate(parameters.names)
        if not parameters.is_rotor(i) and name not in own and not any(load.moves(i) for load in model.loads.values())
    ]  # fmt: skip


class _NotReducedError(Exception):
    """The data hold something against a reduced model."""

    def __init__(self, why: str) -> None:
        self.why = why
        super().__init__(why)


def _told(found: Estimate, first: Elimination, now: Elimination, because: str) -> Essential:
    """What is said of a reduced model before its own values."""

    def names(places: Iterable[int]) -> tuple[str, ...]:
        return tuple(found.names[i] for i in places)

    return Essential(
        names(now.left_out), now.f, now.limit, now.p_value, {found.names[i]: why for i, why in now.needed.items()},
        put_back=names(i for i in first.left_out if i not in now.left_out), because=because,
    )  # fmt: skip


def _reduced(
    found: Estimate, model: LoopModel, now: Elimination, refit: Refit, first: Elimination, because: str
) -> Essential:
    """The reduced model; raises _NotReducedError where it explains held-out data worse, or has no answer.

    Args:
        first: what the F-test would leave out; because: why not all of it goes.
    """
    told, loop = _told(found, first, now, because), model.loop
    start = {name: float(v) for name, v in zip(found.names, now.values, strict=True) if name not in told.left_out}
    try:
        other = refit(model.without(told.left_out), start)
    except (IdentificationError, SimulationError) as error:
        raise _NotReducedError(NO_ANSWER.format(error.what)) from error
    ratios = held_out(found, other)
    if why := worse(ratios):
        raise _NotReducedError(why)
    return replace(
        told, model=other.model, covariance=other.covariance,
        error_percent=error_percent(loop, other.measured, other.simulated)[0],
        full_percent=error_percent(loop, found.measured, found.simulated)[0], held_out=ratios,
    )  # fmt: skip


def _without_the_dearest(found: Estimate, places: Sequence[int]) -> list[int]:
    """Places without a quarter of them: those with each of which, put back alone, the held-out residual is least; the
    last ones without held-out data."""

    def residual(place: int) -> float:
        values = as_if_zero(found.value, found.covariance, [i for i in places if i != place])[0]
        try:
            rows = [found.validated_model.residual(values, label) for label in labels]
        except SimulationError:
            return np.inf
        return float(np.sum((np.concatenate(rows) / found.noise) ** 2)) if rows else -float(places.index(place))

    labels = found.model.experiments.validation_labels
    least_first = sorted(places, key=residual)
    back = least_first[: max(len(places) // PUT_BACK, 1)]
    return [i for i in places if i not in back]


def held_out(before: Estimate, after: Estimate) -> tuple[Ratio, ...]:
    """Ratio of the held-out torque residuals of two estimates, over all joints, each in units of that of the first
    estimate, and that of each joint; empty without held-out data, infinite where the second cannot be run there."""
    labels, joints = before.model.experiments.validation_labels, before.model.joint_count
    if not labels:
        return ()
    try:
        first, second = (
            np.concatenate([e.validated_model.residual(e.value, label) for label in labels]) for e in (before, after)
        )
    except SimulationError:
        return (Ratio(np.inf, np.inf, np.inf),) * (1 + joints)
    noise = Noise(np.sqrt(np.mean(first**2, axis=0)) + TINY, np.zeros(joints), "residual")
    block = block_in(before.model.torque_alone, labels[0])
    parts = [slice(0, joints), *(slice(j, j + 1) for j in range(joints))]
    return tuple(rms_ratio(first[:, part], second[:, part], noise.of(part), block=block) for part in parts)


def worse(ratios: Sequence[Ratio]) -> str:
    """Of which joint, or of all, the held-out residual is surely larger, and by more than matters, in words; empty
    where of none."""
    for j, ratio in enumerate(ratios):
        if ratio.low > 1 and ratio.value > WORSE:
            return WORSE_ANSWER.format(f" of joint {j}" if j else "", ratio.value, ratio.low, ratio.high)
    return ""
