"""What was looked for beside the answer, as results hold it: other minima, profiles, a reduced model, sensitivities."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from fmu_didim.base.documents import Number, Saved
from fmu_didim.data.signals import Array
from fmu_didim.estimators.search.screening import GlobalSensitivity
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.essential import WORSE
from fmu_didim.fit.exploration.local import local_sensitivity


class MinimumResult(Saved):
    """A place where local fits ended.

    Attributes:
        value, std: name of each parameter -> its value, standard deviation.
    """

    value: dict[str, float]
    std: dict[str, Number]
    worse: float = Field(description="misfit above that of the best one, as a chi-square")
    error_percent: Number = Field(description="100 |y - y_s| / |y|")
    starts: int = Field(description="local fits that ended there")
    settled: bool = Field(description="whether one of them converged")


class SearchResult(Saved):
    """A search for other minima.

    Attributes:
        method: ``starts``, ``differential_evolution`` or ``cmaes``; seed: of its draws.
        failures: why local fits failed -> how many.
    """

    method: str
    seed: int
    starts: int = Field(description="local fits that were run")
    asked: int = Field(description="local fits that were asked for")
    searched: list[str] = Field(description="parameters with bounds; empty: nothing was searched")
    held: list[str] = Field(description="parameters without, which began where one start has them")
    minima: list[MinimumResult] = Field(description="the best first, which is the answer")
    alike: int = Field(description="others that the data do not exclude")
    failures: dict[str, int]
    evaluations: int = Field(description="simulations of the global search, without those of local fits")
    stopped: str = Field(description="why it ended early; empty where it did not")


class ProfileResult(Saved):
    """The profile of a parameter: its value held, all others fitted anew.

    Attributes:
        value: of the parameter at each point; others: name of each other parameter -> its value there.
    """

    value: list[float]
    chi_square: list[float] = Field(
        description="misfit above that of the answer at each point, in squares of the noise with its colour"
    )
    others: dict[str, list[float]]
    interval: tuple[Number, Number] = Field(description="95 % interval; null where an end is open")
    ends: tuple[str, str] = Field(
        description="how each side ends: reached, limit (of the parameter), open (far away the misfit is still too "
        "low), failed (nothing can be simulated beyond), lower (another minimum)"
    )
    linear: tuple[float, float] = Field(description="interval of the answer, by its standard deviation")
    height: float = Field(description="chi-square at the ends of the interval")
    is_bent: bool = Field(description="whether the interval differs from the linear one by more than a third")


def profile_results(estimate: Estimate) -> dict[str, ProfileResult]:
    """Name of each parameter that was profiled -> its profile."""
    names = estimate.names
    return {
        names[one.place]: ProfileResult(
            value=one.values[:, one.place].tolist(), chi_square=one.difference.tolist(),
            others={name: one.values[:, k].tolist() for k, name in enumerate(names) if k != one.place},
            interval=one.interval, ends=one.how, linear=one.linear, height=one.height, is_bent=one.is_bent,
        )
        for one in estimate.profiles
    }  # fmt: skip


class RatioResult(Saved):
    """Root mean square after over that before, on the same samples."""

    value: Number = Field(description="of all samples")
    low: Number = Field(description="lower end of its 95 % interval")
    high: Number = Field(description="upper end of its 95 % interval")


class EssentialValueResult(Saved):
    """A parameter of the reduced model."""

    value: float = Field(description="estimate, in the unit")
    std: float = Field(description="standard deviation, as if what is left out was zero")
    unit: str = Field(description="FMI unit string")
    moved: Number = Field(description="value minus that of the full model, in standard deviations there")


class EssentialResult(Saved):
    """The essential parameters: the reduced model, without those that the data do not need.

    Attributes:
        needed: name of each that the data do not need, but the model -> why.
        parameters: name of each that is left -> its value in the reduced model; empty where nothing is left out.
    """

    left_out: list[str] = Field(description="names of those that are not needed, in the order in which they went")
    f: Number = Field(description="F of the hypothesis that all of these are zero; null where nothing is left out")
    limit: Number = Field(description="95 % quantile of F; null where nothing is left out")
    p_value: Number = Field(description="probability of a larger F, were all of them zero")
    needed: dict[str, str]
    put_back: list[str] = Field(description="names of those that went by the F-test, and came back")
    because: str = Field(description="why these came back, or nothing was tried; empty where there is no reason")
    parameters: dict[str, EssentialValueResult]
    error_percent: Number = Field(description="relative error of the fitted torque of the reduced model")
    full_error_percent: Number = Field(description="the same of the full model")
    held_out: RatioResult | None = Field(
        description="held-out residual over that of the full model, all joints alike; null without held-out data"
    )
    held_out_joints: list[RatioResult] = Field(description="the same of each joint")
    confirmed: bool = Field(
        description=f"whether held-out data show the reduced model to serve as well: at most {WORSE:g} times the "
        "residual, at the end of its interval"
    )


def essential_result(estimate: Estimate) -> EssentialResult | None:
    """The reduced model as it is saved; None where it was not asked for."""
    found = estimate.essential
    if found is None:
        return None
    full = dict(zip(estimate.names, zip(estimate.value, estimate.standard_deviation, strict=True), strict=True))
    parameters = dict[str, EssentialValueResult]()
    if found.model is not None and found.covariance is not None:
        stds = np.sqrt(np.diag(found.covariance)).tolist()
        for k, value, std in zip(found.model.free_parameters, found.model.start.tolist(), stds, strict=True):
            before, size = full.get(k.name, (np.nan, np.nan))
            moved = (value - before) / size if size > 0 else np.nan
            parameters[k.name] = EssentialValueResult(value=value, std=std, unit=k.unit, moved=float(moved))
    ratios = [RatioResult(value=one.value, low=one.low, high=one.high) for one in found.held_out]
    return EssentialResult(
        left_out=list(found.left_out), f=found.f, limit=found.limit, p_value=found.p_value, needed=dict(found.needed),
        put_back=list(found.put_back), because=found.because, parameters=parameters, error_percent=found.error_percent,
        full_error_percent=found.full_percent,
        held_out=ratios[0] if ratios else None, held_out_joints=ratios[1:],
        confirmed=bool(found.held_out) and found.held_out[0].high <= WORSE,
    )  # fmt: skip


class RidgeResult(Saved):
    """A combination of parameters that the data hardly know."""

    parts: dict[str, float] = Field(description="relative change of each parameter along it, the largest 1")
    std: float = Field(description="relative standard deviation of the parameter with the largest change")
    text: str = Field(description="in words")


class LocalSensitivityResult(Saved):
    """What each parameter does to each output at the answer.

    Attributes:
        outputs: name -> unit.
    """

    outputs: dict[str, str]
    change: dict[str, list[Number]] = Field(
        description="name of each parameter -> rms change of each output by one per cent of it, in that output's unit"
    )
    ridges: list[RidgeResult] = Field(description="the least known combination first; empty where none is")


class GlobalSensitivityResult(Saved):
    """What each parameter does to the misfit between its bounds.

    Attributes:
        method: ``morris`` or ``sobol``; samples: trajectories or base points; simulations: that it took.
        outputs: name -> unit.
    """

    method: str
    samples: int
    simulations: int
    failed: int = Field(description="simulations that failed; what belongs to them is left out")
    held: list[str] = Field(description="parameters without bounds, which were held")
    outputs: dict[str, str]
    main: dict[str, list[Number]] = Field(
        description="name of each parameter -> for each output mu* (Morris, in its unit) or S1 (Sobol)"
    )
    total: dict[str, list[Number]] = Field(description="the same of mu* or ST")
    spread: dict[str, list[Number]] = Field(description="the same of sigma, or of half of the 95 % interval of ST")


def local_result(estimate: Estimate) -> LocalSensitivityResult | None:
    """The effects of the parameters at an answer; None where it has no sensitivity of its outputs."""
    fit = estimate.minimum
    if fit is None:
        return None
    found = local_sensitivity(fit.model, fit.values, fit.jacobian, estimate.covariance)
    return LocalSensitivityResult(
        outputs=dict(zip(found.outputs, found.units, strict=True)),
        change={name: row.tolist() for name, row in zip(found.names, found.change, strict=True)},
        ridges=[RidgeResult(parts=one.parts, std=one.std, text=one.text) for one in found.ridges],
    )


def global_result(found: GlobalSensitivity) -> GlobalSensitivityResult:
    """Sensitivities between bounds as they are saved."""

    def by_name(table: Array) -> dict[str, list[float | None]]:
        return {name: row.tolist() for name, row in zip(found.names, table, strict=True)}

    return GlobalSensitivityResult(
        method=found.method, samples=found.samples, simulations=found.simulations, failed=found.failed,
        held=list(found.held), outputs=dict(zip(found.outputs, found.units, strict=True)), main=by_name(found.main),
        total=by_name(found.total), spread=by_name(found.spread),
    )  # fmt: skip


def searches(estimate: Estimate) -> dict[str, Any]:
    """The entries of a result for all that was looked for beside its answer."""
    return {
        "search": search_result(estimate), "profiles": profile_results(estimate),
        "essential": essential_result(estimate), "sensitivity": local_result(estimate),
    }  # fmt: skip


def search_result(estimate: Estimate) -> SearchResult | None:
    """The search of an estimate as it is saved; None where there was none."""
    found = estimate.search
    if found is None:
        return None
    minima = [
        MinimumResult(
            value=dict(one.values), std=dict(one.deviation), worse=one.worse, error_percent=one.error_percent,
            starts=one.starts, settled=one.settled,
        )
        for one in found.minima
    ]  # fmt: skip
    return SearchResult(
        method=found.method, seed=found.seed, starts=found.starts, asked=found.asked, searched=list(found.searched),
        held=list(found.held), minima=minima, alike=found.alike, failures=dict(found.failures),
        evaluations=found.evaluations, stopped=found.stopped,
    )  # fmt: skip
