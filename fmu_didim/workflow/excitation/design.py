"""The design of one motion: random starts, the optimiser, the closed loop, and limits that it keeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from fmu_didim.base.diagnostics import by_weight
from fmu_didim.base.errors import InputError, SimulationError, UnknownNameError
from fmu_didim.case import Case
from fmu_didim.case.runs.torque_log import read_torque_log
from fmu_didim.data.excitation import Fourier, PointToPoint
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.discovery.excitation.basis import Basis
from fmu_didim.discovery.excitation.limits import Bounds
from fmu_didim.discovery.excitation.optimum import ITERATIONS, Criterion, Problem, Solution
from fmu_didim.discovery.excitation.points import MOVES, Points
from fmu_didim.discovery.excitation.runs import Runs
from fmu_didim.discovery.excitation.series import HARMONICS, Series
from fmu_didim.dynamics.space.space import Space
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.results.provenance import made_by
from fmu_didim.workflow.case_files import case_files
from fmu_didim.workflow.excitation.excited import Excited, Trial
from fmu_didim.workflow.excitation.findings import findings
from fmu_didim.workflow.excitation.limits import MotionLimits, bounds_of
from fmu_didim.workflow.excitation.planned import BEYOND, Peaks, Plan, Prediction, predict
from fmu_didim.workflow.excitation.space import compared, shortfall
from fmu_didim.workflow.simulate import named_values

Kind = Literal["fourier", "point_to_point"]
"""Of the motion."""
STARTS = 6
"""[motions] Random ones from which the optimisation begins: the best of six is within some percent of that of many."""
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
ROUGH = 60
"""[iterations] Of IPOPT where weights are compared roughly, from the best start alone: most is gained by then."""
PACKAGES = ("fmu_didim", "casadi", "numpy", "scipy")


@dataclass(frozen=True)
class Request:
    """What a motion is designed for; the attributes are those of :func:`~fmu_didim.excite`.

    Attributes:
        progress: told of each start; is_rough: whether a motion is wanted that is good enough to compare weights: from
            the best start alone, with fewer iterations, and made smaller where the loop exceeds limits.
    """

    limits: MotionLimits
    only: tuple[str, ...] = ()
    criterion: Criterion = "determinant"
    kind: Kind = "fourier"
    harmonics: int | None = None
    moves: int | None = None
    dwell_s: float | None = None
    period_s: float | None = None
    periods: int | None = None
    rate_hz: float | None = None
    torque_std: Sequence[float] | None = None
    starts: int = STARTS
    seed: int = 0
    parameters: Mapping[str, float] = field(default_factory=dict)
    progress: Callable[[str], None] = lambda text: None
    is_rough: bool = False


def designed(
    case: Case, labels: Sequence[str], request: Request, carried: Mapping[str, float] | None = None
) -> Excited:
    """The motion on which the logs of these experiments, with the same motion in each, tell most.

    Args:
        carried: values of the parameters of loads, by name.

    Raises:
        InputError, UnknownNameError, SimulationError: as of :func:`~fmu_didim.excite`.
    """
    robot, label = robot_of(case), labels[0]
    reference = _reference(case, labels)
    found = bounds_of(case, reference, request.limits)
    around = compared(case, request.limits, found.bounds)
    bounds = replace(found.bounds, clearance=np.full(len(around.space.checks), around.space.least))
    basis = _basis(case, label, reference, bounds, request)
    rate, noise = _rate(case, label, reference, request.rate_hz), _noise(case, request.torque_std)
    plan = Plan(case, label, rate, noise, np.zeros(0), tuple(labels[1:]))
    model = plan.model_on(still(case, basis))
    values = named_values(model, {**(carried or {}), **request.parameters})
    _check_values(model, values, request)
    plan = plan.at(values, model)
    asked = request.only or model.names
    problem, drawn, in_mean = _begun(plan, robot, model, basis, bounds, asked, request, around.space)
    wanted = in_mean if request.criterion == "mean" else asked
    its_own = None if request.is_rough or not _is_same(case, labels) else reference
    now = _predicted(plan, its_own, wanted, request.criterion)
    trials, solutions = _solved(problem, bounds, drawn, request)
    best, settled = _best(plan, problem, bounds, solutions, wanted, request)
    told = findings(
        plan, basis, bounds, best[1], now, wanted, failed=sum(t.criterion is None for t in trials),
        starts=request.starts, settled=settled, around=around,
    )  # fmt: skip
    seen = {name for i, name in enumerate(_looked_at(plan, robot, model)) if i not in problem.idle}
    return Excited(
        case.name, best[0], best[1], now, bounds, found.origin, tuple(trials), tuple(by_weight(told)), tuple(asked),
        in_mean, request.criterion, tuple(name for name in model.names if name not in seen), plan.rate_hz,
        plan.deviation, request.seed, _provenance(case), around,
    )  # fmt: skip


def _is_same(case: Case, labels: Sequence[str]) -> bool:
    """Whether the experiments have one motion."""
    runs = [case.document.runs[label] for label in labels]
    return len(runs) == 1 or (case.tracking is None and all(run.reference == runs[0].reference for run in runs))


def _reference(case: Case, labels: Sequence[str]) -> Trajectory | None:
    """The motion that the first experiment has; None where it has none yet."""
    if case.tracking is not None and case.tracking.is_planned:
        return None
    return case.reference(labels[0])


def still(case: Case, basis: Basis) -> Trajectory:
    """The motion of a family that stands still, a row a control period."""
    return basis.excitation(np.zeros((basis.count, basis.joints))).trajectory(1 / case.step_size)


def _check_values(model: LoopModel, values: Array, request: Request) -> None:
    """Raise InputError for values that cannot be simulated, UnknownNameError for names that are not identified."""
    if reason := mass_matrix_problem(model, values):
        raise InputError(
            f"These parameters cannot be simulated: {reason}.", where="parameters", got=dict(request.parameters),
            next_step="Give values for which every mass and inertia is positive.",
        )  # fmt: skip
    for name in request.only:
        if name not in model.names:
            raise UnknownNameError("parameter that is identified", name, model.names, where="only")


def robot_of(case: Case) -> RobotParameters:
    """The parameters of the robot of a case; raises InputError where it has none."""
    if not isinstance(case.parameters, RobotParameters):
        raise InputError(
            "excite needs the equations of a robot.", where=case.name, got="a plant or model without robot description",
            next_step="Give robot: in the case; motions of other models: docs/howto/choose-a-motion.md.",
        )  # fmt: skip
    return case.parameters


def _rate(case: Case, label: str, reference: Trajectory | None, given: float | None) -> float:
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
        if reference is None:
            raise InputError("There is no log.", next_step="Give its rate.")
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


def _family(request: Request) -> Family:
    """The motions that are asked for; raises InputError for an option of the other kind."""
    kind, harmonics, moves, dwell_s = request.kind, request.harmonics, request.moves, request.dwell_s
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


def _basis(case: Case, label: str, reference: Trajectory | None, bounds: Bounds, request: Request) -> Basis:
    family, own = _family(request), case.document.runs[label].reference
    period, count = request.period_s, request.periods
    if reference is None:
        if period is None:
            raise InputError(
                "The length of the motion is not known: the case has none yet.", where="period_s",
                next_step="Give it: --period SECONDS, and --periods where there are several.",
            )  # fmt: skip
        count = count or 1
    else:
        length = float(np.ptp(reference.time))
        period = period or (1 / own.fundamental_hz if isinstance(own, Fourier) else length)
        count = count or max(1, round(length / period))
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


def _is_compared(plan: Plan, model: LoopModel) -> bool:
    """Whether the motion is that of several runs, or of one with a load beside an earlier result without it."""
    return bool(plan.beside) or (model.prior is not None and plan.label in model.loads)


def _looked_at(plan: Plan, robot: RobotParameters, model: LoopModel) -> tuple[str, ...]:
    """Names of the parameters of the design: of a single run the base parameters."""
    return model.names if _is_compared(plan, model) else robot.names


def _begun(
    plan: Plan, robot: RobotParameters, model: LoopModel, basis: Basis, bounds: Bounds, asked: Sequence[str],
    request: Request, space: Space,
) -> tuple[Problem, list[Array], tuple[str, ...]]:  # fmt: skip
    """The problem, the random motions from which it begins, and those of the parameters asked for whose relative
    deviations have a meaning: that a log of one of these motions would show, were all others known."""
    instants, known = plan.times(still(plan.case, basis)), _looked_at(plan, robot, model)
    compares = _is_compared(plan, model)
    of = Runs.of(model, plan.values, plan.labels) if compares else Runs.alone(model.theta(plan.values))

    def problem_of(names: Sequence[str]) -> Problem:
        places = [known.index(name) for name in names if name in known]
        return Problem(robot.model, robot.base, of, plan.deviation, basis, instants, places, request.criterion, space)

    problem = problem_of(asked)
    seeds = [[request.seed, i] for i in range(1, request.starts + 1)]
    drawn = [problem.random(np.random.default_rng(seed), bounds) for seed in seeds]
    shows = np.any([problem.shows(z) for z in drawn], axis=0)
    kept = tuple(name for name in asked if name not in known or shows[known.index(name)])
    return (problem_of(kept) if request.criterion == "mean" else problem), drawn, kept


def _predicted(plan: Plan, reference: Trajectory | None, asked: Sequence[str], kind: Criterion) -> Prediction | None:
    """What the log of the reference that the case has would tell; None where there is none, or it cannot be simulated
    or logged."""
    if reference is None:
        return None
    try:
        return predict(plan, reference, asked, kind)
    except (InputError, SimulationError):
        return None


def _solved(
    problem: Problem, bounds: Bounds, drawn: Sequence[Array], request: Request
) -> tuple[list[Trial], list[Solution]]:
    """All starts, and the solutions of those that did not fail, the best first; roughly the first one that does not
    fail, from the best start on."""
    trials, solutions, starts, progress = [], list[Solution](), len(drawn), request.progress
    if request.is_rough:
        drawn = sorted(drawn, key=problem.criterion, reverse=True)
    for i, start in enumerate(drawn, start=1):
        if request.is_rough and solutions:
            break
        try:
            found = problem.solved(start, bounds, iterations=ROUGH if request.is_rough else ITERATIONS)
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
    plan: Plan, problem: Problem, bounds: Bounds, solutions: Sequence[Solution], asked: Sequence[str], request: Request
) -> tuple[tuple[Fourier | PointToPoint, Prediction], bool]:
    """The motion whose log tells most in the simulated loop, whose limits it keeps as far as possible."""
    found: list[tuple[Fourier | PointToPoint, Prediction, bool]] = []
    failure: SimulationError | None = None
    progress = request.progress
    for solution in solutions[:SIMULATED]:
        progress(f"simulating motion {len(found) + 1} of {min(SIMULATED, len(solutions))}")
        try:
            found.append(_within(plan, problem, bounds, solution, asked, request))
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
    plan: Plan, problem: Problem, bounds: Bounds, solution: Solution, asked: Sequence[str], request: Request
) -> tuple[Fourier | PointToPoint, Prediction, bool]:
    """A solution in the simulated loop; where that exceeds limits, solved again with tighter ones, or made smaller."""
    n, own, kind, progress = plan.deviation.size, bounds, request.criterion, request.progress
    for remaining in reversed(range(SHRINKS if request.is_rough else ROUNDS + SHRINKS)):
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
