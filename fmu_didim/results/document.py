"""The content of ``result.json``, from an estimate, its validations and its checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from fmu_didim.base.diagnostics import REMARK, Diagnostic, by_weight
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.checks.agreement import AgreementResult
from fmu_didim.checks.identification import Checks
from fmu_didim.checks.judgement import diagnostic_result
from fmu_didim.checks.load import carried
from fmu_didim.checks.plant.consistency import Consistency
from fmu_didim.checks.validation import Validation
from fmu_didim.data.signals import Array
from fmu_didim.fit.estimate import Estimate, RefusedError, Status
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.statistics import correlation, error_percent
from fmu_didim.model.free_parameter import BASE, PLANT
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.results.result import (
    ChannelErrorResult,
    ChannelResult,
    ChoicesResult,
    ConsistencyResult,
    DisplayResult,
    ErrorResult,
    ExperimentResult,
    GeometryResult,
    InitialStateResult,
    IntegrationResult,
    IterationResult,
    JointResult,
    LinkResult,
    LoadResult,
    ParameterResult,
    PriorParameterResult,
    PriorResult,
    QuantityResult,
    ResultDocument,
    StageResult,
    UnconstrainedResult,
)
from fmu_didim.results.searches import searches


def consistency_result(found: Consistency) -> ConsistencyResult:
    """The comparison of plant and robot description as it is saved."""
    warnings = found.warnings()
    return ConsistencyResult(
        agrees=not warnings, worst=found.worst, points=found.points, torque_difference=list(found.torque),
        columns=found.columns or {},
        method=found.method, warnings=warnings,
        acceleration="difference of velocities" if found.by_differences else "output of the plant",
    )  # fmt: skip


def _by_name(names: Sequence[str], values: Array) -> dict[str, float]:
    return {name: float(v) for name, v in zip(names, values, strict=False)}


def _history(names: Sequence[str], iterations: Sequence[Iteration]) -> list[IterationResult]:
    return [
        IterationResult(
            stage=it.stage, number=it.number, relative_error_percent=float(it.relative_error_percent),
            change=float(it.change), condition_number=float(it.condition_number),
            parameters=_by_name(names, it.parameters), note=it.note, restarts=it.restarts,
        )
        for it in iterations
    ]  # fmt: skip


def result_document(
    name: str, estimate: Estimate, validations: Sequence[Validation], *, checks: Checks, description: str = "",
    case: str = "",
) -> ResultDocument:  # fmt: skip
    """The document of an estimate, its validations and its checks.

    Args:
        case: file of the case, for the commands that reasons name.
    """
    model, judgement = estimate.model, checks.judgement
    notes = [str(remark) for remark in judgement.remarks]
    if model.parameters.has_regressor and not model.loop.gives_acceleration:
        notes.append("The plant gives no accelerations: differences of its velocities over a control period are used.")
    return ResultDocument(
        name=name,
        description=description,
        verdict=judgement.verdict,
        reasons=judgement.saved(case),
        acknowledged=judgement.saved_acknowledged(case),
        conditions=judgement.conditions,
        status="converged" if estimate.status is Status.CONVERGED else "maximum_iterations",
        advice=estimate.advice or estimate.status.value,
        estimator=estimate.estimator,
        iterations=estimate.iteration_count,
        finish_iterations=len(estimate.iterations) - estimate.iteration_count,
        parameters=_parameters(estimate),
        stages={
            name: StageResult(
                value=_by_name(estimate.names, stage.value), std=_by_name(estimate.names, stage.standard_deviation),
                formulas={formula: _by_name(estimate.names, v) for formula, v in stage.formulas.items()},
            )
            for name, stage in estimate.stages.items()
        },
        joint=_joint(estimate),
        prior=_prior(estimate),
        choices=_choices(estimate),
        loads=_loads(estimate),
        **searches(estimate),
        regrouping=model.parameters.relations(),
        correlations=estimate.correlations(),
        correlation=np.round(correlation(estimate.covariance), 4).tolist(),
        covariance=estimate.covariance.tolist(),
        condition_number=estimate.condition_number,
        noise_std=[float(v) for v in estimate.noise],
        noise=list(checks.residual),
        power=checks.power,
        torque_unit=list(model.parameters.torque_units),
        **_outputs_and_inputs(model),
        experiments={v.label: _experiment(model, v, checks.agreements.get(v.label)) for v in validations},
        relative_error_percent={v.label: _errors(v.total_percent, v.per_joint_percent) for v in validations},
        fitted_error_percent=_fitted_errors(model, validations),
        integration_error=float(estimate.integration_error),
        integration_shift=float(np.max(estimate.integration_shift)),
        integration=IntegrationResult(**asdict(estimate.integration)) if estimate.integration is not None else None,
        history=_history(estimate.names, estimate.iterations),
        loop=model.system(model.start).describe(),
        geometry=_geometry(model),
        signals={v.label: f"{model.loop.quantity}_{v.label}.csv" for v in validations if not v.failure},
        simulated={v.label: f"simulated_{v.label}.csv" for v in validations if v.every is not None},
        checks=model.parameters.checks(),
        remarks=[*judgement.acknowledged_remarks, *estimate.remarks, *notes],
        provenance=dict(estimate.provenance),
    )  # fmt: skip


def _outputs_and_inputs(model: LoopModel) -> dict[str, Any]:
    """The names of what a model without controller gives and takes; none of the loop of a robot."""
    if model.loop.shows_torque:
        return {}
    used = {name for experiment in model.experiments.values() for name in experiment.reference.names}
    inputs = {v.name: v.unit for v in model.loop.plant.inputs if v.name in used}
    outputs = list(model.loop.output_names)
    shown = (*outputs, *model.experiments.channels, *inputs)
    return {"outputs": outputs, "inputs": inputs, "displays": _displays(model, shown)}


def _displays(model: LoopModel, signals: Sequence[str]) -> dict[str, DisplayResult]:
    """In which units the tool that made an FMU shows what is identified and these signals."""
    plant = model.loop.plant
    own = {v.name: v.display for v in (*plant.parameters, *plant.outputs, *plant.inputs) if v.display is not None}
    found = {name: own[name] for name in signals if name in own}
    found |= {k.name: own[k.key] for k in model.free_parameters if k.owner in (BASE, PLANT) and k.key in own}
    return {name: DisplayResult(**asdict(unit)) for name, unit in found.items()}


def _joint(estimate: Estimate) -> JointResult | None:
    """What the channels beside the torque have added."""
    joint = estimate.joint
    if joint is None:
        return None
    channels = {
        c.name: ChannelResult(
            unit=c.unit, samples=c.samples, noise_std=c.deviation, noise_is_stated=c.is_stated, rms=c.rms,
            correlation=c.lag_one, inflation=c.inflation,
        )
        for c in joint.channels
    }  # fmt: skip
    alone = None
    if joint.alone is not None:
        value, std = (_by_name(estimate.names, v) for v in (joint.alone, joint.alone_deviation))
        alone = StageResult(value=value, std=std, formulas={})
    return JointResult(
        channels=channels, alone=alone, apart=_by_name(estimate.names, joint.apart), p_value=joint.p_value
    )  # fmt: skip


def _choices(estimate: Estimate) -> ChoicesResult | None:
    """What other choices of a virtual controller do to the values."""
    found = estimate.choices
    if found is None:
        return None
    return ChoicesResult(
        chosen=found.chosen,
        noise_std=_by_name(estimate.names, found.noise_alone),
        shifts={words: _by_name(estimate.names, shift) for words, shift in found.shifts.items()},
        failed=dict(found.failed),
    )


def _loads(estimate: Estimate) -> dict[str, LoadResult]:
    """What each experiment carried."""
    return {
        label: LoadResult(
            body={name: QuantityResult(value=v, std=s, unit=unit) for name, (v, s, unit) in found.body.items()},
            unseen=list(found.unseen), also=list(found.also),
        )
        for label, found in carried(estimate).items()
    }  # fmt: skip


def _prior(estimate: Estimate) -> PriorResult | None:
    """What of the values comes from a prior."""
    found = estimate.prior
    if found is None:
        return None
    columns = (found.data_share, found.mean, found.deviation, found.alone, found.alone_deviation, found.apart)
    keys = ("data_share", "prior", "prior_std", "alone", "alone_std", "apart")
    parameters = {
        name: PriorParameterResult(**dict(zip(keys, map(float, row), strict=True)))
        for name, row in zip(estimate.names, np.column_stack(columns), strict=True)
    }
    return PriorResult(source=found.source, parameters=parameters, p_value=found.p_value, tested=found.tested)


def _parameters(estimate: Estimate) -> dict[str, ParameterResult]:
    model, intervals = estimate.model, estimate.interval()
    standard = dict(zip(model.parameters.names, model.parameters.plant_names, strict=True))
    described = dict(zip(model.parameters.names, map(float, model.parameters.nominal()), strict=True))
    return {
        parameter.name: ParameterResult(
            value=float(estimate.value[i]),
            std=float(estimate.standard_deviation[i]),
            rel_std_percent=float(estimate.relative_deviation_percent[i]),
            interval=(float(intervals[i, 0]), float(intervals[i, 1])),
            unit=estimate.units[i],
            standard=standard.get(parameter.key, "") if parameter.owner == BASE else "",
            of=model.loop.whole if parameter.owner in (BASE, PLANT) else parameter.owner,
            experiment=parameter.experiment,
            described=described.get(parameter.key) if parameter.owner == BASE else None,
        )
        for i, parameter in enumerate(model.free_parameters)
    }


def _errors(total: float, per_joint: Array) -> ErrorResult:
    return ErrorResult(total=total, per_joint=[float(e) for e in per_joint])


def _fitted_errors(model: LoopModel, validations: Sequence[Validation]) -> ErrorResult:
    """The errors over all fitted experiments together."""
    fitted = [v for v in validations if v.role == "estimation"]
    measured, simulated = (np.concatenate([getattr(v, name) for v in fitted]) for name in ("measured", "simulated"))
    return _errors(*error_percent(model.loop, measured, simulated))


def _experiment(model: LoopModel, validation: Validation, agreement: AgreementResult | None) -> ExperimentResult:
    noise = np.sqrt(((validation.measured - validation.simulated) ** 2).mean(axis=0))
    found = dict(
        noise_std=[float(v) if np.isfinite(v) else None for v in noise],
        relative_error_percent=_errors(validation.total_percent, validation.per_joint_percent),
        agreement=agreement,
        failure=validation.failure,
        channels={
            name: ChannelErrorResult(
                unit=c.unit,
                samples=c.time.size,
                rms=c.rms,
                relative_error_percent=c.relative_error_percent,
                std=c.deviation,
                file=f"channel_{validation.label}_{k}.csv",
            )
            for k, (name, c) in enumerate(validation.channels.items(), start=1)
        },
    )
    return _data(model, validation.label).model_copy(update=found)


def _data(model: LoopModel, label: str) -> ExperimentResult:
    """The data of an experiment, without a result."""
    experiment = model.experiments[label]
    return ExperimentResult(
        role=experiment.role, samples=int(experiment.time.size), rate_hz=_rate(model, experiment.rate_hz), noise_std=[],
        relative_error_percent=ErrorResult(total=None, per_joint=[]),
        own=[p.name for p in model.free_parameters if p.experiment == label], agreement=None,
        initial_state=_initial_state(model, label),
    )  # fmt: skip


def _rate(model: LoopModel, rate_hz: float) -> float:
    """A rate without the rounding of stamps; those of slow models in all their digits."""
    return round(rate_hz, 6) if model.loop.shows_torque else float(f"{rate_hz:.9g}")


def _initial_state(model: LoopModel, label: str) -> InitialStateResult:
    if any(k.is_start and k.experiment == label for k in model.free_parameters):
        return InitialStateResult(kind="free")
    state = model.experiments[label].initial_state
    if not state.values:
        return InitialStateResult(kind="reference" if model.loop.shows_torque else "model")
    values = {name: float(value) for name, value in state.values.items()}
    return InitialStateResult(kind="found" if state.kind == "found" else "given", values=values)


def _geometry(model: LoopModel) -> GeometryResult | None:
    """The links of a robot; None of a plant without a description."""
    if not isinstance(model.parameters, RobotParameters):
        return None
    robot = model.parameters.model.description
    links = [LinkResult(**{key: getattr(joint, key) for key in LinkResult.model_fields}) for joint in robot.joints]
    x, y, z = robot.gravity
    return GeometryResult(links=links, gravity=(x, y, z))


def refused_document(
    name: str, model: LoopModel, estimator: str, error: FmuDidimError, provenance: Mapping[str, Any], *,
    known: Sequence[Diagnostic] = (),
) -> ResultDocument:  # fmt: skip
    """The document of a refusal: the reason and the iterations, but no answer.

    Args:
        known: diagnostics of data and plant.
    """
    iterations = error.iterations if isinstance(error, RefusedError) else ()
    return ResultDocument(
        name=name,
        verdict="refused",
        reasons=[diagnostic_result(found) for found in by_weight(known) if found.code.severity is not REMARK],
        status="refused",
        advice=str(error),
        estimator=estimator,
        iterations=len(iterations),
        finish_iterations=0,
        parameters={},
        unconstrained=_unconstrained(model, error),
        stages={},
        regrouping=model.parameters.relations(),
        correlations=[],
        condition_number=None,
        noise_std=[],
        torque_unit=list(model.parameters.torque_units),
        **_outputs_and_inputs(model),
        experiments={label: _data(model, label) for label in model.experiments},
        relative_error_percent={},
        integration_error=None,
        history=_history(model.names, iterations),
        loop=model.loop.systems[model.first].describe(),
        signals={},
        remarks=[str(found) for found in by_weight(known) if found.code.severity is REMARK],
        provenance=dict(provenance),
    )


def _unconstrained(model: LoopModel, error: FmuDidimError) -> dict[str, UnconstrainedResult]:
    if not isinstance(error, RefusedError) or error.values is None or not np.isfinite(error.values).all():
        return {}
    deviation = np.full(error.values.size, np.nan) if error.deviation is None else error.deviation
    return {
        k.name: UnconstrainedResult(value=float(value), std=float(sigma), unit=k.unit)
        for k, value, sigma in zip(model.free_parameters, error.values, deviation, strict=False)
    }
