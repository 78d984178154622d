"""All checks of an identification, and the judgement of its values."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.base.errors import UnknownNameError
from fmu_didim.checks.agreement import AgreementResult, agreement
from fmu_didim.checks.all_samples import with_all_samples
from fmu_didim.checks.channels import channel_diagnostics, position_fit_diagnostics
from fmu_didim.checks.data.checks import confirmed
from fmu_didim.checks.data.unsigned import signs_diagnostics
from fmu_didim.checks.exploration.one_start import one_start_diagnostics
from fmu_didim.checks.exploration.profiles import profile_diagnostics
from fmu_didim.checks.exploration.search import search_diagnostics
from fmu_didim.checks.held_out import WORSE_HELD_OUT, Residual, held_out_diagnostics, not_simulated
from fmu_didim.checks.held_out_channels import held_out_channel_diagnostics
from fmu_didim.checks.judgement import Judgement, judgement
from fmu_didim.checks.load import load_diagnostics
from fmu_didim.checks.motion.dependence import DEPENDS_ON_MOTION, JointResidual
from fmu_didim.checks.motion.misfits import Misfits
from fmu_didim.checks.motion.periods import repetition_diagnostics, repetition_of_fit
from fmu_didim.checks.motion.suspects import with_suspects
from fmu_didim.checks.motion.tested import MotionTests
from fmu_didim.checks.outputs.judged import output_diagnostics
from fmu_didim.checks.outputs.words import of_a_model
from fmu_didim.checks.physical import physical_diagnostics
from fmu_didim.checks.plant.temperature import temperature_diagnostics
from fmu_didim.checks.plant.unidentified import unidentified_diagnostics
from fmu_didim.checks.power.moves import with_power
from fmu_didim.checks.power.statement import PowerResult
from fmu_didim.checks.prior import prior_diagnostics
from fmu_didim.checks.residual import (
    RESIDUAL_ABOVE_NOISE,
    RESIDUAL_SLOW,
    NoiseResult,
    lack_of_fit,
    large_diagnostics,
    residual_diagnostics,
    slow_diagnostics,
)
from fmu_didim.checks.validation import TORQUE_ERROR_LARGE, Validation, error_diagnostics
from fmu_didim.checks.virtual import of_one_set, virtual_diagnostics
from fmu_didim.estimators.initial_states import OtherStart, contradicted_starts
from fmu_didim.fit.estimate import Estimate, Status
from fmu_didim.fit.noise.noise import TINY, motion_frequency
from fmu_didim.fit.solver.numerical_noise import Roughness, smoother_advice, smoother_after_step
from fmu_didim.model.free_parameter import DELAY
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.model.workers import Beside

NEAR_LIMIT = 0.01
"""[standard deviations] Distance from a limit within which a value lies at it: there the solver stops."""
VISIBLE_SHIFT = 0.2
"""[standard deviations] Move of a value by finer steps above which the integration is too coarse: a tenth of a 95 %
interval."""
SECOND_STEP = 0.1
"""[1] Change of a standard deviation by a second step of the sensitivities that is reported: 3-sigma then means 2.7."""
JITTER = 0.1
"""[standard deviations] Jitter of a simulated torque, in those of its residual, that is reported: the values scatter as
by noise, and the steps end up to half a deviation from the minimum."""

BY_LOAD = (
    "Friction that grows with the load, or a gear that was warmer, bends the load and gains of drives: add friction by "
    "load to that joint (fmu-didim effects), or let the run have friction of its own: own: [...]."
)
"""What to do where a run with a load does not agree with the others."""
MISFITS = {RESIDUAL_ABOVE_NOISE, RESIDUAL_SLOW, DEPENDS_ON_MOTION, WORSE_HELD_OUT, TORQUE_ERROR_LARGE}
"""What a parameter of the plant at a wrong value may be the cause of."""

AT_LIMIT = CATALOGUE(
    "at-limit", DOUBT, rank=40,
    meaning="A free parameter ended at one of its limits: the data favour a value beyond it, and the intervals of the "
    "others do not include this.",
    next_step="Widen the limits if the value may lie beyond; else look for what the model lacks: fmu-didim discover "
    "CASE.yaml.",
)  # fmt: skip
HELD = CATALOGUE(
    "parameters-held", REMARK, rank=65,
    meaning="Parameters that affect the torque are not identified but keep the values of the robot description: "
    "errors in them bias the identified ones.",
    next_step="List them under identified in the robot description, or under known if they are.",
)  # fmt: skip
DISAGREE = CATALOGUE(
    "experiments-disagree", DOUBT, rank=45,
    meaning="An experiment does not agree with the others on parameters that they share.",
    next_step="If something changed in between, give the experiment its own values: experiments: {...: {own: "
    "[...]}}.",
)  # fmt: skip
TOO_COARSE = CATALOGUE(
    "integration-too-coarse", DOUBT, rank=48,
    meaning="Finer integration steps would still change a value noticeably.",
    next_step="State more substeps: plant: {substeps: N}.",
)  # fmt: skip
ROUGH = CATALOGUE(
    "sensitivity-rough", DOUBT, rank=46,
    meaning="The step control inside a plant or controller limits how well the sensitivities are known, and with them "
    "the standard deviations, or makes the simulated torque jitter, so that the values scatter by more than noise.",
    next_step="Run the FMU with our integrator (interface: model-exchange), or with a smaller tolerance of its own one "
    "(tolerance: 1e-9, if the FMU uses it).",
)  # fmt: skip
TORQUE_GIVEN = CATALOGUE(
    "torque-given", REMARK, rank=70,
    meaning="The reference holds the torque itself: the values come from the motion, and the torque agrees whatever "
    "they are.",
    next_step="Look at the errors of the measured signals; hold a run out to judge them.",
)  # fmt: skip
OTHER_START = CATALOGUE(
    "initial-state", DOUBT, rank=2,
    meaning="The log does not begin in the initial state that the case gives: the transient from there, which the "
    "machine did not make, bends all values.",
    next_step="Correct initial_state, or leave it out: then it is looked for.",
)  # fmt: skip
OTHER_MINIMUM = CATALOGUE(
    "another-minimum", DOUBT, rank=47,
    meaning="The log is too slow for a resonance of the loop: another inertia of a light joint explains it nearly as "
    "well, and the data cannot decide between them.",
    next_step="Log the torque at more than twice the frequency of that resonance, or give the inertia (known: [...]).",
)  # fmt: skip


@dataclass(frozen=True)
class Checks:
    """The results of the checks of an estimate.

    Attributes:
        judgement: of its values; residual: the test of the residual of each joint.
        agreements: label -> how an experiment agrees with the others, where several were fitted.
        power: what a valid verdict excludes; None where it is not valid, or that is not known.
    """

    judgement: Judgement
    residual: tuple[NoiseResult, ...]
    agreements: Mapping[str, AgreementResult]
    power: PowerResult | None = None


def residual_tests(estimate: Estimate) -> tuple[NoiseResult, ...]:
    """The tests of the residual of each joint."""
    return lack_of_fit(estimate.colours, estimate.known_noise, stated=estimate.noise_is_stated)


def start_diagnostics(starts: Iterable[OtherStart]) -> list[Diagnostic]:
    """Initial states that are given and contradict their logs."""
    return [
        Diagnostic(
            OTHER_START,
            f"The log starts elsewhere than the case says (probability by chance {s.chance:.1g}): the start that "
            f"explains its first samples has {s.name} = {s.found:.4g} {s.unit} instead of {s.given:.4g}.",
            s.label, s.found, s.given, s.unit,
        )
        for s in starts
    ]  # fmt: skip


def checked(estimate: Estimate, validations: Sequence[Validation], *, before: Iterable[Diagnostic] = ()) -> Checks:
    """Run all checks of an estimate.

    Args:
        validations: of all experiments.
        before: diagnostics of the data and the plant; those that the fit has refuted are left out.
    """
    model = estimate.model
    if not model.loop.shows_torque:
        return _of_outputs(estimate, validations, before)
    if model.loop.torque_is_given:
        return _of_motion(estimate, validations, before)
    aside = Beside(partial(_aside, estimate, validations, before), _workers(estimate))
    of_motion = None if estimate.fit is None else MotionTests.of(estimate.fit)
    tests = residual_tests(estimate)
    agreements = {} if estimate.fit is None else agreement(estimate.fit)
    beside = aside.result()
    found = [
        *with_all_samples(estimate, validations, beside.still),
        *held_parameters(model),
        *temperature_diagnostics(model),
        *limit_diagnostics(estimate),
        *agreement_diagnostics(agreements, model.loads),
        *beside.held_out,
        *held_out_channels(estimate, validations),
    ]  # fmt: skip
    found += residual_diagnostics(tests)
    misfits, searched, joints = Misfits(), False, None
    if estimate.fit is not None and of_motion is not None:
        told = {d.place for d in found if d.code is RESIDUAL_ABOVE_NOISE}
        found += [d for d in beside.repetition if d.place not in told]
        misfits, searched, joints = of_motion.misfits, of_motion.is_searched, of_motion.joints
        found += of_motion.diagnostics
        found += beside.starts
    motion_hz, cutoff_hz = beside.bands
    found += [*slow_diagnostics(tests, motion_hz, cutoff_hz), *error_diagnostics(validations, motion_hz)]
    told = {d.place for d in found if d.code in MISFITS}
    errors = _relative_errors(estimate)
    found += [d for d in large_diagnostics(tests, errors, motion_hz, cutoff_hz) if d.place not in told]
    found += [*beside.of_any, *position_fit_diagnostics(estimate), *signs_diagnostics(estimate)]
    if estimate.fit is not None and MISFITS & {d.code for d in found}:
        if not searched:  # which no suspect follows
            found = with_suspects(estimate.fit, misfits if misfits.stated else Misfits.of(estimate.fit), found)
        found += unidentified_diagnostics(estimate.fit)
    found += rival_diagnostics(estimate)
    judged = judgement(of_one_set(found, model), settled=estimate.status is Status.CONVERGED)
    judged, power = _with_power(judged, estimate, misfits, joints)
    return Checks(judged, tests, agreements, power)


@dataclass(frozen=True)
class _Aside:
    """What the tests for the motion need not wait for.

    Attributes:
        still: what was found before and is still so; held_out: what held-out data say of the torque.
        of_any: as of :func:`of_any_output`; repetition: what repeats with the motion; starts: that logs contradict.
        bands: as of :func:`_bands`.
    """

    still: list[Diagnostic]
    held_out: list[Diagnostic]
    of_any: list[Diagnostic]
    repetition: list[Diagnostic]
    starts: list[Diagnostic]
    bands: tuple[float, float]


def _aside(estimate: Estimate, validations: Sequence[Validation], before: Iterable[Diagnostic]) -> _Aside:
    held = [v for v in validations if v.role == "validation"]
    held_out = held_out_diagnostics(
        estimate.model, estimate.covariance, Residual.of(estimate.measured, estimate.simulated),
        {v.label: Residual.of(v.measured, v.simulated) for v in held if not v.failure},
        {v.label: v.failure for v in validations if v.failure}, estimate.colours,
    )  # fmt: skip
    fit = estimate.fit
    return _Aside(
        still=confirmed(judged_model(estimate), before), held_out=held_out, of_any=of_any_output(estimate),
        repetition=[] if fit is None else repetition_diagnostics(repetition_of_fit(fit)),
        starts=[] if fit is None else start_diagnostics(contradicted_starts(fit)), bands=_bands(estimate.model),
    )  # fmt: skip


def _workers(estimate: Estimate) -> int:
    """How many processes may judge an estimate at once."""
    return 1 if estimate.fit is None else estimate.fit.model.allowed_workers(estimate.fit.values)


def judged_model(estimate: Estimate) -> LoopModel:
    """The model with the samples that are judged, integrated as it was fitted."""
    if estimate.all_samples is None or estimate.fit is None:
        return estimate.fitted_model
    return estimate.fit.model.with_values(estimate.fit.values)


def acknowledging(checks: Checks, estimate: Estimate, sentences: Mapping[str, str]) -> Checks:
    """The checks of an estimate where the user has checked doubts of some codes; ``sentences``: code -> what is said of
    it. A verdict that is valid by that rests on no less than another one."""
    judged = checks.judgement.acknowledging(sentences)
    if not judged.acknowledged:
        return replace(checks, judgement=judged)
    judged, power = _with_power(judged, estimate, Misfits())
    return replace(checks, judgement=judged, power=power)


def _with_power(
    judged: Judgement, estimate: Estimate, misfits: Misfits, joints: Sequence[JointResidual] | None = None
) -> tuple[Judgement, PowerResult | None]:
    """The judgement with what it rests on; beside further channels the torque alone is asked, with its own
    deviations."""
    own = estimate.joint is None
    return with_power(judged, estimate.fit, misfits, estimate.standard_deviation if own else None, joints)


def _relative_errors(estimate: Estimate) -> dict[int, float]:
    """Joint, from 1 -> size of its residual over that of its torque."""
    left, size = (np.sqrt((t**2).mean(axis=0)) for t in (estimate.measured - estimate.simulated, estimate.measured))
    return {j + 1: float(left[j] / max(size[j], TINY)) for j in range(estimate.model.joint_count)}


def of_any_output(estimate: Estimate) -> list[Diagnostic]:
    """What does not depend on which output was fitted: physics, integration, sensitivities, the channels beside the
    torque, and a prior."""
    model = estimate.model
    asked = model if estimate.unlimited is None else model.with_values(estimate.unlimited)
    found = physical_diagnostics(asked, estimate.covariance)
    if asked is not model:
        found = [replace(one, text=f"By the data alone: {one.text}") for one in found]
    found += coarse_diagnostics(estimate)
    return [*found, *roughness_diagnostics(estimate.roughness, model), *channel_diagnostics(estimate),
            *prior_diagnostics(estimate), *virtual_diagnostics(estimate), *search_diagnostics(estimate),
            *profile_diagnostics(estimate), *load_diagnostics(estimate)]  # fmt: skip


def coarse_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """Integration steps that a value still depends on."""
    shift = float(np.max(estimate.integration_shift))
    if not shift > VISIBLE_SHIFT:
        return []
    whole = estimate.model.loop.whole
    text = f"Twice the substeps of the {whole} would still move a value by {shift:.2g} of its standard deviation."
    return [Diagnostic(TOO_COARSE, text, value=shift, bound=VISIBLE_SHIFT, unit="standard deviations")]


def rival_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """Other minima that explain the data nearly as well."""
    return [
        Diagnostic(OTHER_MINIMUM, f"{name} = {value:.4g} explains the log nearly as well.", name, value)
        for name, value in estimate.rivals
    ]


def held_out_channels(estimate: Estimate, validations: Sequence[Validation]) -> list[Diagnostic]:
    """What held-out experiments say of the signals that were measured beside the torque."""
    fitted = [v.channels for v in validations if v.role == "estimation"]
    held = {v.label: v.channels for v in validations if v.role == "validation"}
    return held_out_channel_diagnostics(estimate.model, estimate.covariance, fitted, held)


def _of_motion(estimate: Estimate, validations: Sequence[Validation], before: Iterable[Diagnostic]) -> Checks:
    """The checks of an open loop, whose torque is no result."""
    found = [
        *before, *held_parameters(estimate.model), *limit_diagnostics(estimate), *of_any_output(estimate),
        *not_simulated({v.label: v.failure for v in validations if v.failure}),
        *held_out_channels(estimate, validations),
        Diagnostic(TORQUE_GIVEN, "The loop is open: the torque is given, and its error says nothing.", "connections"),
    ]  # fmt: skip
    return Checks(judgement(found, settled=estimate.status is Status.CONVERGED), (), {})


def _of_outputs(estimate: Estimate, validations: Sequence[Validation], before: Iterable[Diagnostic]) -> Checks:
    """The checks of a model without controller."""
    tests = residual_tests(estimate)
    agreements = {} if estimate.fit is None else agreement(estimate.fit)
    found = [
        *output_diagnostics(estimate, validations, tests, before), *limit_diagnostics(estimate),
        *agreement_diagnostics(agreements), *coarse_diagnostics(estimate),
        *roughness_diagnostics(estimate.roughness, estimate.model), *rival_diagnostics(estimate),
        *one_start_diagnostics(estimate, tests), *search_diagnostics(estimate), *profile_diagnostics(estimate),
    ]  # fmt: skip
    return Checks(judgement(of_a_model(found), settled=estimate.status is Status.CONVERGED), tests, agreements)


def _bands(model: LoopModel) -> tuple[float, float]:
    """Highest frequency of the fitted motions, infinite where a reference has none, and the low-pass cut-off, Hz."""
    references = [model.experiments[label].reference for label in model.estimation_labels]
    try:
        highest = max(motion_frequency(reference, model.joint_count) for reference in references)
    except UnknownNameError:
        highest = np.inf
    return highest, np.inf if model.experiments.low_pass is None else model.experiments.low_pass.cutoff_hz


def held_parameters(model: LoopModel) -> list[Diagnostic]:
    """Parameters of the robot that keep a nonzero value of the description without being listed as known."""
    if not isinstance(model.parameters, RobotParameters):
        return []
    base = model.parameters.base
    values = dict(zip(base.standard_names, base.known.tolist(), strict=True))
    held = [name for name in base.held if values[name]]
    if not held:
        return []
    text = ", ".join(f"{name} = {values[name]:.4g}" for name in held)
    return [Diagnostic(HELD, f"Not identified, but taken as the description has them: {text}.", "robot")]


def roughness_diagnostics(rough: Roughness | None, model: LoopModel) -> list[Diagnostic]:
    """Where the step control of a foreign plant or controller limits the answer, and of which one if that shows."""
    if rough is None:
        return []
    found = []
    if not rough.change <= SECOND_STEP:
        text = f"A second step of the sensitivities changes a standard deviation by {100 * rough.change:.0f} %."
        found.append(Diagnostic(ROUGH, text, rough.parameter, rough.change, SECOND_STEP, "1"))
    if rough.jitter > JITTER:
        text = (
            f"When a parameter changes ever so little, the simulated {model.loop.quantity} jitters by "
            f"{rough.jitter:.2g} standard deviations of its residual: the values scatter by it."
        )
        found.append(Diagnostic(ROUGH, text, "", rough.jitter, JITTER, "standard deviations"))
    cause = smoother_after_step(model) if found else ""
    if not cause:
        return [replace(d, next_step=smoother_advice(model)) for d in found]
    text = f" Where the {cause} gives its outputs after its step, nearly nothing is left of that."
    advice = f"If the {cause} computes its outputs after its step, state that: {cause}: {{outputs_after_step: true}}."
    return [replace(d, text=d.text + text, next_step=advice) for d in found]


def limit_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """Free parameters that ended at a limit."""
    found = []
    for parameter, deviation in zip(estimate.model.free_parameters, estimate.standard_deviation, strict=True):
        value = parameter.value
        is_delay = parameter.owner == DELAY  # whose lower limit, none at all, nobody has set
        for limit in (parameter.highest,) if is_delay else (parameter.lowest, parameter.highest):
            if abs(value - limit) <= NEAR_LIMIT * deviation:
                text = f"{parameter.name} = {value:.4g} {parameter.unit} lies at its limit."
                found.append(Diagnostic(AT_LIMIT, text, parameter.name, value, float(limit), parameter.unit))
                break
    return found


def agreement_diagnostics(found: Mapping[str, AgreementResult], loaded: Container[str] = ()) -> list[Diagnostic]:
    """Experiments that do not agree with the others.

    Args:
        loaded: labels of those that carry a load.
    """
    return [
        Diagnostic(
            DISAGREE,
            one.warning(label),
            label,
            one.change_in_std,
            unit="standard deviations",
            next_step=BY_LOAD if label in loaded else "",
        )
        for label, one in found.items()
        if not one.agrees
    ]
