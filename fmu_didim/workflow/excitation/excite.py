"""The verb ``excite``: the motion on which the torque log of a loop will tell most of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, Unpack

import numpy as np

from fmu_didim.base.diagnostics import by_weight
from fmu_didim.base.errors import InputError, SimulationError, UnknownNameError
from fmu_didim.case import Case, CaseParts, case_of, with_objects
from fmu_didim.case.torque_log import read_torque_log
from fmu_didim.data.excitation import Fourier, PointToPoint
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.discovery.excitation.basis import Basis
from fmu_didim.discovery.excitation.limits import Bounds
from fmu_didim.discovery.excitation.optimum import Criterion, Problem, Solution
from fmu_didim.discovery.excitation.points import MOVES, Points
from fmu_didim.discovery.excitation.series import HARMONICS, Series
from fmu_didim.dynamics.space.space import Space
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.results.provenance import made_by
from fmu_didim.workflow.case_files import case_files
from fmu_didim.workflow.excitation.excited import Excited, Trial
from fmu_didim.workflow.excitation.findings import findings
from fmu_didim.workflow.excitation.limits import MotionLimits, bounds_of, limits_document
from fmu_didim.workflow.excitation.planned import BEYOND, Peaks, Plan, Prediction, predict
from fmu_didim.workflow.excitation.space import compared, shortfall
from fmu_didim.workflow.simulate import model_without_data, named_values

STARTS = 6
"""[motions] Random ones from which the optimisation begins: the best of six is within some percent of that of many."""
Kind = Literal["fourier", "point_to_point"]
"""Of the motion."""
SIMULATED = 3
"""[motions] The best along the reference, which are simulated in the loop and ranked anew."""
ROUNDS = 3
"""[1] Of tightening limits until the simulated loop keeps them;"""
SHRINKS = 4
"""[1] of making the motion smaller by what it exceeds them, after these;"""
LEAST_SHRINK = 0.005
"""[1] at least by so much."""
CLEARER = 5e-4
"""[m] More than what the loop came too near is asked for: the loop of another motion deviates otherwise."""
PACKAGES = ("fmu_didim", "casadi", "numpy", "scipy")


@with_objects
def excite(
    case: Case | Path | str | Mapping[str, Any] | None = None,
    out: Path | str | None = None,
    *,
    limits: MotionLimits | Mapping[str, Any] | Path | str | None = None,
    only: Sequence[str] = (),
    criterion: Criterion = "determinant",
    kind: Kind = "fourier",
    harmonics: int | None = None,
    moves: int | None = None,
    dwell_s: float | None = None,
    period_s: float | None = None,
    periods: int | None = None,
    rate_hz: float | None = None,
    torque_std: Sequence[float] | None = None,
    starts: int = STARTS,
    seed: int = 0,
    parameters: Mapping[str, float] | None = None,
    experiment: str | None = None,
    progress: Callable[[str], None] = lambda text: None,
    **objects: Unpack[CaseParts],
) -> Excited:
    """Design the motion on which the torque log of a case will tell most of the parameters: the D-optimal Fourier
    series, or moves from point to point, that begins and ends at rest within limits, by CasADi and IPOPT from several
    random starts. The best ones are simulated in the closed loop, from whose sensitivities the standard deviations are
    predicted.

    Args:
        case: a loaded case, the path of its file, or its content; its torque log need not exist.
        out: folder for ``reference.yaml``, ``reference.csv`` and ``excite.json``; nothing is written by default.
        limits: a YAML file or a mapping with ``position``, ``velocity``, ``acceleration``, ``torque``, ``start``, and
            what the arm keeps clear of: ``inside``, ``boxes``, ``capsules``, ``clearance``; by default the range of the
            robot description, and else what the reference of the case uses.
        only: parameters to be known best, the others being unknown, too; all by default.
        criterion: ``determinant`` of their information, or ``mean`` of their relative standard deviations, without
            those of values so small that a log would not show them, were all others known.
        kind: a Fourier series, or moves of a fifth order polynomial ``point_to_point``.
        harmonics: of the series (5); moves: from point to point in a period (10), of equal duration; dwell_s: rest
            after each (0).
        period_s, periods: of the motion; by default those of the case's reference.
        rate_hz: of the torque log; by default that of the case. torque_std: (n,) standard deviations of its noise; by
            default those of the case.
        starts: random motions from which the optimisation begins; seed: of them.
        parameters: values by name; those of the robot description by default, for which the motion is the best.
        experiment: label of the experiment whose loop and log are meant; the first one by default.
        progress: told of each start.

    Raises:
        InputError, UnknownNameError: the case, a limit or a name is wrong, the noise or the rate is unknown, or no
            start succeeds; SimulationError: the loop diverges on each motion.
    """
    case = case_of(case, objects, require_torque=False)
    robot = _robot_of(case)
    label = experiment or next(iter(case.document.runs))
    reference = case.reference(label)
    document = limits_document(limits)
    found = bounds_of(case, reference, document)
    around = compared(case, document, found.bounds)
    bounds = replace(found.bounds, clearance=np.full(len(around.space.checks), around.space.least))
    family = _family(kind, harmonics, moves, dwell_s)
    values = named_values(model_without_data(case, label), parameters or {})
    plan = Plan(case, label, _rate(case, label, reference, rate_hz), _noise(case, torque_std), values)
    model = plan.model_on(reference)
    _check_values(model, values, only, parameters)
    asked = tuple(only) or model.names
    basis = _basis(case, label, reference, bounds, family, period_s, periods)
    problem, drawn, in_mean = _begun(
        plan, robot, model.theta(values), basis, bounds, asked, criterion, starts, seed, around.space
    )
    wanted = in_mean if criterion == "mean" else asked
    now = _predicted(plan, reference, wanted, criterion)
    trials, solutions = _solved(problem, bounds, drawn, progress)
    best, settled = _best(plan, problem, bounds, solutions, wanted, criterion, progress)
    told = findings(
        plan, basis, bounds, best[1], now, wanted, failed=sum(t.criterion is None for t in trials), starts=starts,
        settled=settled, around=around,
    )  # fmt: skip
    made = Excited(
        case.name, best[0], best[1], now, bounds, found.origin, tuple(trials), tuple(by_weight(told)), asked, in_mean,
        criterion,
        tuple(name for name in model.names if name not in robot.names or robot.names.index(name) in problem.idle),
        plan.rate_hz, plan.deviation, seed, _provenance(case), around,
    )  # fmt: skip
    if out is not None:
        made.save(out)
    return made


def _check_values(model: LoopModel, values: Array, only: Sequence[str], parameters: Mapping[str, float] | None) -> None:
    """Raise InputError for values that cannot be simulated, UnknownNameError for names that are not identified."""
    if reason := mass_matrix_problem(model, values):
        raise InputError(
            f"These parameters cannot be simulated: {reason}.", where="parameters", got=dict(parameters or {}),
            next_step="Give values for which every mass and inertia is positive.",
        )  # fmt: skip
    for name in only:
        if name not in model.names:
            raise UnknownNameError("parameter that is identified", name, model.names, where="only")


def _robot_of(case: Case) -> RobotParameters:
    if not isinstance(case.parameters, RobotParameters):
        raise InputError(
            "excite needs the equations of a robot.", where=case.name, got="a plant or model without robot description",
            next_step="Give robot: in the case; motions of other models: docs/howto/choose-a-motion.md.",
        )  # fmt: skip
    return case.parameters


def _rate(case: Case, label: str, reference: Trajectory, given: float | None) -> float:
    """Rate of the log in Hz: given, of the case, or of its log."""
    run = case.document.runs[label]
    if given is not None or (run.torque is not None and run.torque.rate_hz is not None):
        rate = given if given is not None else run.torque.rate_hz if run.torque is not None else None
        assert rate is not None
        if rate * case.step_size > 1 + 1e-9:
            raise InputError(
                "The log cannot be faster than the controller.", where="torque.rate_hz", got=f"{rate:g} Hz",
                valid=f"at most {1 / case.step_size:g} Hz", next_step="Give the rate of the torque log.",
            )  # fmt: skip
        return float(rate)
    try:
        log = read_torque_log(
            run, case.folder, reference, step=case.step_size, drive_gains=case.document.loop.drive_gains,
            torque_units=case.parameters.torque_units, label=label, signals=case.signals,
        )  # fmt: skip
    except InputError as error:
        raise InputError(
            "The rate of the torque log is not known.", where=f"{label}: torque.rate_hz",
            next_step="Give it: --rate HZ, or torque: {rate_hz: ...} in the case.",
        ) from error  # fmt: skip
    return float((log.times.size - 1) / np.ptp(log.times))


def _noise(case: Case, given: Sequence[float] | None) -> Array:
    """(n,) standard deviation of the noise of the torque."""
    n, stated = case.parameters.joint_count, case.document.torque_std if given is None else given
    if stated is None:
        raise InputError(
            "The noise of the torque log is not known, without which no standard deviation can be predicted.",
            where="torque_std",
            next_step="Give it: --torque-std 0.1,0.05 (N.m or N, one a joint), or torque_std: in the case.",
        )  # fmt: skip
    deviation = np.array(stated, dtype=float)
    if deviation.size != n or not (np.isfinite(deviation) & (deviation > 0)).all():
        raise InputError(
            "torque_std needs a positive value for each joint.", where="torque_std", got=list(stated),
            valid=f"{n} numbers > 0",
            next_step="Give the standard deviation of the noise of each joint's torque.",
        )  # fmt: skip
    return deviation


Family = Callable[[float, int, int, Array | None], Basis]
"""Fundamental frequency in Hz, periods, joints and start -> motions."""


def _family(kind: Kind, harmonics: int | None, moves: int | None, dwell_s: float | None) -> Family:
    """The motions that are asked for; raises InputError for an option of the other kind."""
    own: Mapping[str, Mapping[str, float | None]] = {
        "fourier": {"harmonics": harmonics}, "point_to_point": {"moves": moves, "dwell_s": dwell_s}
    }  # fmt: skip
    if kind not in own:
        raise UnknownNameError("kind of motion", kind, tuple(own), where="kind")
    for other, options in own.items():
        for name, value in options.items():
            if other != kind and value is not None:
                raise InputError(
                    f"{name} belongs to another kind of motion.", where=name, got=f"kind {kind}", valid=f"kind {other}",
                    next_step=f"Leave {name} out, or ask for kind {other}.",
                )  # fmt: skip
    if kind == "fourier":
        return partial(Series, harmonics=HARMONICS if harmonics is None else harmonics)
    return partial(Points, moves=MOVES if moves is None else moves, dwell_s=dwell_s or 0.0)


def _basis(
    case: Case, label: str, reference: Trajectory, bounds: Bounds, family: Family, period_s: float | None,
    periods: int | None,
) -> Basis:  # fmt: skip
    own, length = case.document.runs[label].reference, float(np.ptp(reference.time))
    usual = 1 / own.fundamental_hz if isinstance(own, Fourier) else length
    period = usual if period_s is None else period_s
    count = max(1, round(length / period)) if periods is None else periods
    # A whole number of control periods, so that the motion ends at rest on a row.
    period = max(round(period / case.step_size), 1) * case.step_size
    basis = family(1 / period, count, case.parameters.joint_count, bounds.start)
    (what, frequency), fastest = basis.fastest, 0.5 / case.step_size
    if frequency >= fastest:
        raise InputError(
            "The controller cannot show motions that fast.", where="period_s",
            got=f"{what.lower()} at {frequency:.4g} Hz", valid=f"below half the control rate, {fastest:g} Hz",
            next_step="Ask for fewer harmonics or moves, or a longer period.",
        )  # fmt: skip
    return basis


def _begun(
    plan: Plan, robot: RobotParameters, theta: Array, basis: Basis, bounds: Bounds, asked: Sequence[str],
    criterion: Criterion, starts: int, seed: int, space: Space,
) -> tuple[Problem, list[Array], tuple[str, ...]]:  # fmt: skip
    """The problem, the random motions from which it begins, and those of the parameters asked for whose relative
    deviations have a meaning: that a log of one of these motions would show, were all others known."""
    still = basis.excitation(np.zeros((basis.count, basis.joints)))
    instants = plan.times(still.trajectory(1 / plan.case.step_size))

    def problem_of(names: Sequence[str]) -> Problem:
        places = [robot.names.index(name) for name in names if name in robot.names]
        return Problem(robot.model, robot.base, theta, plan.deviation, basis, instants, places, criterion, space)

    problem = problem_of(asked)
    drawn = [problem.random(np.random.default_rng([seed, i]), bounds) for i in range(1, starts + 1)]
    shows = np.any([problem.shows(z) for z in drawn], axis=0)
    kept = tuple(name for name in asked if name not in robot.names or shows[robot.names.index(name)])
    return (problem_of(kept) if criterion == "mean" else problem), drawn, kept


def _predicted(plan: Plan, reference: Trajectory, asked: Sequence[str], kind: Criterion) -> Prediction | None:
    """What the log of the reference that the case has would tell; None where it cannot be simulated or logged."""
    try:
        return predict(plan, reference, asked, kind)
    except (InputError, SimulationError):
        return None


def _solved(
    problem: Problem, bounds: Bounds, drawn: Sequence[Array], progress: Callable[[str], None]
) -> tuple[list[Trial], list[Solution]]:
    """All starts, and the solutions of those that did not fail, the best first."""
    trials, solutions, starts = [], [], len(drawn)
    for i, start in enumerate(drawn, start=1):
        try:
            found = problem.solved(start, bounds)
        except RuntimeError as error:
            trials.append(Trial(i, f"skipped: {error}"))
            progress(f"start {i} of {starts}: skipped ({error})")
            continue
        trials.append(Trial(i, found.status, _finite(found.begun), _finite(found.criterion)))
        solutions.append(found)
        progress(
            f"start {i} of {starts}: criterion {found.begun:.4g} to {found.criterion:.4g}, {found.iterations} steps"
        )
    if not solutions:
        raise InputError(
            "The optimisation failed from each start.", where="excite", got="; ".join(t.status for t in trials),
            next_step="Widen the limits, or ask for more starts or another seed.",
        )  # fmt: skip
    return trials, sorted(solutions, key=lambda s: -s.criterion)


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _best(
    plan: Plan, problem: Problem, bounds: Bounds, solutions: Sequence[Solution], asked: Sequence[str],
    kind: Criterion, progress: Callable[[str], None],
) -> tuple[tuple[Fourier | PointToPoint, Prediction], bool]:  # fmt: skip
    """The motion whose log tells most in the simulated loop, whose limits it keeps as far as possible."""
    found: list[tuple[Fourier | PointToPoint, Prediction, bool]] = []
    failure: SimulationError | None = None
    for solution in solutions[:SIMULATED]:
        progress(f"simulating motion {len(found) + 1} of {min(SIMULATED, len(solutions))}")
        try:
            found.append(_within(plan, problem, bounds, solution, asked, kind, progress))
        except SimulationError as error:
            failure = error
    if not found:
        assert failure is not None
        raise failure
    n, space = plan.deviation.size, problem.space

    def keeps(one: Prediction) -> bool:
        short = None if space is None else shortfall(space, one.loop)
        return Peaks.of(one.loop, n).excess(bounds) <= BEYOND and (short is None or bool((short <= 0).all()))

    motion, prediction, settled = max(found, key=lambda one: (keeps(one[1]), one[1].criterion))
    progress(f"best motion: criterion {prediction.criterion:.4g} in the loop")
    return (motion, prediction), settled


def _within(
    plan: Plan, problem: Problem, bounds: Bounds, solution: Solution, asked: Sequence[str], kind: Criterion,
    progress: Callable[[str], None],
) -> tuple[Fourier | PointToPoint, Prediction, bool]:  # fmt: skip
    """A solution in the simulated loop; where that exceeds limits, solved again with tighter ones."""
    n, own = plan.deviation.size, bounds
    for remaining in reversed(range(ROUNDS + SHRINKS)):
        motion = problem.basis.excitation(solution.coefficients)
        prediction = predict(plan, motion.trajectory(1 / plan.case.step_size), asked, kind)
        peaks = Peaks.of(prediction.loop, n)
        excess = peaks.excess(bounds)
        short = np.zeros(0) if problem.space is None else shortfall(problem.space, prediction.loop)
        near = 0.0 if short is None else float(short.max(initial=0.0))
        if (excess <= BEYOND and near <= 0) or not remaining:
            break
        far = (
            f"exceeds a limit by {100 * excess:.2g} %" if excess > BEYOND else f"comes too near by {1000 * near:.2g} mm"
        )
        progress(f"the loop {far}: once more, with less room")
        smaller = problem.basis.smaller(solution.coefficients, 1 / (1 + max(excess, LEAST_SHRINK)))
        solution = replace(solution, coefficients=smaller, is_settled=remaining >= SHRINKS and solution.is_settled)
        if remaining < SHRINKS:
            continue
        try:
            own = _tighter(own, bounds, peaks, short)
            solution = problem.solved(smaller, own)
        except (RuntimeError, InputError):
            solution = replace(solution, is_settled=False)  # the smaller motion is tried
    return motion, prediction, solution.is_settled


def _tighter(own: Bounds, wanted: Bounds, peaks: Peaks, short: Array | None) -> Bounds:
    """The bounds of the reference ``own``, tightened by what the loop exceeds those that are wanted, and by what it
    comes too near (C,), m."""
    known = [np.where(np.isnan(v), other, v) for v, other in (
        (peaks.low, wanted.limits.low), (peaks.high, wanted.limits.high), (peaks.speed, wanted.limits.speed),
        (peaks.torque, wanted.torque))]  # fmt: skip
    step = wanted.tightened(*known)
    limits = replace(
        own.limits,
        low=own.limits.low + (step.limits.low - wanted.limits.low),
        high=own.limits.high + (step.limits.high - wanted.limits.high),
        speed=own.limits.speed * step.limits.speed / wanted.limits.speed,
    )
    with np.errstate(invalid="ignore"):
        torque = np.where(np.isfinite(own.torque), own.torque * step.torque / wanted.torque, np.inf)
    clearance = own.clearance
    if clearance is not None and short is not None:
        clearance = clearance + np.where(short > 0, short + CLEARER, 0.0)
    return replace(own, limits=limits, torque=torque, clearance=clearance)


def _provenance(case: Case) -> dict[str, Any]:
    return {**made_by(PACKAGES), "files": case_files(case)}
