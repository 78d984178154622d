"""Whether another robot explains a log better: another length of a link, a torque that is scaled against the others,
gravity that pulls elsewhere than the description says, as where it has none, or frames in the other convention.

Along one simulated motion near the measured one, the base parameters are fitted anew for each of them:

    length     W(q, dq, ddq; a (1 + x)) theta
    scale      exp(x) times the rows of one joint; all joints together only scale theta
    gravity    W(q, dq, ddq; g along an axis of the base) theta, with the base parameters of that robot
    frames     likewise, with the table of frames read in the classical convention

so that only what base parameters cannot absorb counts.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from threading import get_ident

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.checks.data.expected import Expected, fitted_by
from fmu_didim.checks.data.linear_fit import Explanation, FittedMotion, Ticks
from fmu_didim.checks.data.timing import SHIFT_SIGMAS
from fmu_didim.checks.data.torque_channel import EXPLAINS
from fmu_didim.dynamics.base_parameters import all_parameters, base_parameters
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.dynamics.robot.description import before_axis, modified_joints
from fmu_didim.estimators.starts.reference_start import whole_reference
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.parameters import RobotParameters

KEPT = 16
"""[robots] Whose models are kept: a process that identifies one robot many times asks for the same seven each time."""
LARGEST_LENGTH = 20.0
"""[m] Of a link, beyond which millimetres are suspected: no robot is as long."""
LEAST_SCALE = 0.05
"""[1] Relative change of a scale or a length from which it is reported."""
LARGEST_SCALE = 4.0
"""[1] Largest scale that is tried, up and down."""
LARGEST_CHANGE = 0.6
"""[1] Largest relative change of a length that is tried."""
SHORT_LINK = 0.2
"""[1] Of the longest length, below which a length hardly shows and is not tested."""
STANDARD_GRAVITY = 9.81
"""[m/s2] That is tried along each axis of the base."""
SAME_GRAVITY = 1.0
"""[m/s2] By which a gravity must differ from the one of the description to be another one: 6 degrees."""
GRAVITY_LEAVES = 0.5
"""[1] Of the mean square residual, at most, that another gravity leaves. First moments act by inertia, too, so that a
gravity that is not there leaves many times as much; joints that it does not turn keep all that they have. The same of
frames in the other convention: axes that point elsewhere."""

LINK_TOO_LONG = CATALOGUE(
    "length-unit", DOUBT, rank=4,
    meaning="A link is longer than that of any robot: its length seems to be in millimetres.",
    next_step="Give a and d of the robot description in m, angles in rad.",
)  # fmt: skip
LINK_LENGTH = CATALOGUE(
    "link-length", DOUBT, rank=21,
    meaning="Another length of a link explains the log clearly better than the one of the robot description.",
    next_step="Measure the distance of the joint axes, and correct a or d of the robot description.",
)  # fmt: skip
TORQUE_SCALE = CATALOGUE(
    "torque-scale", DOUBT, rank=21,
    meaning="The torques of the joints do not fit each other, or all of them do not fit the loop: coupling, gravity "
    "and the gains of the controller show that they are scaled.",
    next_step="Check gain, gear ratio and unit of the torque of each joint.",
)  # fmt: skip
GRAVITY = CATALOGUE(
    "gravity", DOUBT, rank=21,
    meaning="Another size or direction of gravity explains the log clearly better than that of the robot description, "
    "or the base is tilted.",
    next_step="Check how the base stands, and gravity: in the robot description: m/s2 along the axes of the base, such "
    "as [0, 0, -9.81] where z points up.",
)  # fmt: skip
FRAMES = CATALOGUE(
    "frames-convention", DOUBT, rank=21,
    meaning="The table of frames explains the log clearly better when it is read in the classical convention of "
    "Denavit and Hartenberg: alpha and a behind the axis of their joint, not before it.",
    next_step="If the table is one of a textbook or a data sheet in that convention, write frames: standard in the "
    "robot description; fmu-didim robot FILE shows where the axes are.",
)  # fmt: skip
FRAMES_BROUGHT = CATALOGUE(
    "frames-brought", REMARK, rank=90,
    meaning="The robot description was given in the classical convention of Denavit and Hartenberg, and brought to "
    "modified frames, in which inertial parameters are named and identified.",
    next_step="Take values of links from the result, or from fmu-didim robot FILE --out robot.yaml, not from the "
    "description as it was written.",
)  # fmt: skip
DISTANCES = ("a", "d")
Vector = tuple[float, ...]
"""Along x, y, z of the base."""


def length_unit_diagnostics(model: LoopModel) -> list[Diagnostic]:
    """Links of the robot description that are longer than those of any machine."""
    robot = _description(model)
    return [
        Diagnostic(
            LINK_TOO_LONG, f"{name} is {length:g} m: is it in millimetres?", f"robot: joint {j}", abs(length),
            LARGEST_LENGTH, "m",
        )
        for j, name, length in ([] if robot is None else _lengths(robot))
        if abs(length) > LARGEST_LENGTH
    ]  # fmt: skip


def frames_diagnostics(model: LoopModel) -> list[Diagnostic]:
    """That names of parameters mean other frames than those of the file."""
    robot = _description(model)
    if robot is None or robot.original_frames == "modified":
        return []
    text = (
        "The description was read in the classical Denavit-Hartenberg convention: first moments and inertias of the "
        "links, and the centre of a load, are in modified frames here, not in those of the file."
    )
    return [Diagnostic(FRAMES_BROUGHT, text, f"robot: {robot.name}")]


def another_robot(fitted: FittedMotion) -> Iterator[Explanation]:
    """Other scales, lengths, directions of gravity and frames that explain a log better, one at a time."""
    yield from _scales(fitted)
    yield from _link_lengths(fitted)
    yield from _other_descriptions(fitted)


def _scales(fitted: FittedMotion) -> Iterator[Explanation]:
    n = fitted.run.model.joint_count
    if n < 2:
        return
    by_scales = fitted.misfit_by_scales()
    for j in range(n):

        def misfit(x: float, j: int = j) -> float:
            return by_scales(np.where(np.arange(n) == j, math.exp(x), 1.0))

        for x, deviation, least in _clear(fitted, misfit, math.log(LARGEST_SCALE)):
            text = (
                f"Against the other joints the torque seems to be {math.exp(x):.3g} times (± {100 * deviation:.1g} %) "
                f"what it should be: corrected, the residual falls to {100 * math.sqrt(least):.0f} % of its size."
            )
            bound = math.exp(math.copysign(max(SHIFT_SIGMAS * deviation, LEAST_SCALE), x))
            diagnostic = Diagnostic(TORQUE_SCALE, text, f"{fitted.run.label}: joint {j + 1}", math.exp(x), bound, "1")
            yield Explanation(least, fitted.gain(least), diagnostic)


def _link_lengths(fitted: FittedMotion) -> Iterator[Explanation]:
    robot, parameters = _description(fitted.run.model), fitted.run.model.parameters
    if robot is None or not isinstance(parameters, RobotParameters):
        return
    lengths = _lengths(robot)
    longest = max((abs(length) for _, _, length in lengths), default=0.0)
    for j, name, length in lengths:
        if abs(length) < SHORT_LINK * longest or not length:
            continue

        def misfit(x: float, j: int = j, name: str = name, length: float = length) -> float:
            joints = list(robot.joints)
            joints[j - 1] = joints[j - 1].model_copy(update={name: length * (1 + x)})
            longer_robot = parameters.model.like(robot.model_copy(update={"joints": tuple(joints)}))
            other = RobotParameters(longer_robot, parameters.base)

            def longer(ticks: Ticks) -> tuple[np.ndarray, np.ndarray]:
                return fitted.along.columns(other, ticks), fitted.along(ticks)[1]

            return fitted.misfit_of(replace(fitted, changed=longer))

        for x, deviation, least in _clear(fitted, misfit, LARGEST_CHANGE):
            text = (
                f"{name} = {length:g} m seems to be {length * (1 + x):.3g} ± {abs(length) * deviation:.1g} m: "
                f"with that, the residual of the base parameters falls to {100 * math.sqrt(least):.0f} %."
            )
            diagnostic = Diagnostic(LINK_LENGTH, text, f"robot: joint {j}", length * (1 + x), length, "m")
            yield Explanation(least, fitted.gain(least), diagnostic)


def _other_descriptions(fitted: FittedMotion) -> Iterator[Explanation]:
    own = len(fitted.run.model.parameters.names)
    for robot, other in _misread(fitted.run.model):

        def of_it(ticks: Ticks, other: RobotParameters = other) -> tuple[np.ndarray, np.ndarray]:
            return fitted.along.columns(other, ticks), fitted.along(ticks)[1]

        if fitted.is_above(GRAVITY_LEAVES, fitted.experiment.operator, of_it):
            continue
        least = fitted.misfit_of(replace(fitted, changed=of_it))
        if least > GRAVITY_LEAVES:
            continue
        diagnostic = _misread_diagnostic(fitted.run, [(robot, math.sqrt(least))], 1.0)
        count = len(base_parameters(RobotModel(robot)).names)
        yield Explanation(least, fitted.gain(least, 1.0 + max(count - own, 0)), diagnostic)


def misread_diagnostics(run: Simulation, given: Expected) -> list[Diagnostic]:
    """Gravity or frames that explain a log along its reference, where no base parameters of the description do: a
    simulated motion of such a robot comes nowhere near."""
    if given.fitted is None or (left := given.error(given.fitted)) <= EXPLAINS:
        return []
    motion, found = whole_reference(run), []
    known = np.zeros_like(given.measured) if given.known is None else given.known
    for robot, other in _misread(run.model):
        experiment = run.experiment
        observed = other.observed_along(experiment.reference.time, *motion, starts=experiment.measured_starts)
        ticks = run.operator.ticks
        columns = other.regressor(*(signal[ticks] for signal in motion), observed=observed[ticks])[0]
        rest = given.error(fitted_by(given.kept(run.sampled(columns)), given.measured, known, given.size))
        if rest <= EXPLAINS and rest**2 <= GRAVITY_LEAVES * left**2:
            found.append((robot, rest))
    return [_misread_diagnostic(run, sorted(found, key=lambda one: one[1]), left)] if found else []


def _misread(model: LoopModel) -> Iterator[tuple[RobotDescription, RobotParameters]]:
    """Robots that may have been meant, with all their parameters: gravity along an axis of the base where the
    description has another one, and its table of frames in the classical convention."""
    robot = _description(model)
    if robot is None:
        return
    others = list[RobotDescription]()
    for axis, sign in itertools.product(range(3), (-1, 1)):
        gravity = tuple(sign * STANDARD_GRAVITY if i == axis else 0.0 for i in range(3))
        if math.dist(gravity, robot.gravity) >= SAME_GRAVITY:
            others.append(robot.model_copy(update={"gravity": gravity, "identified": "computed"}))
    turned = modified_joints(robot.joints)
    if robot.original_frames == "modified" and any(
        before_axis(one) != before_axis(other) for one, other in zip(robot.joints, turned, strict=True)
    ):
        others.append(
            robot.model_copy(update={"joints": turned, "original_frames": "standard", "identified": "computed"})
        )
    assert isinstance(model.parameters, RobotParameters)
    for other in others:
        yield other, _parameters_of(_Same(other.model_dump_json(), get_ident(), other, model.parameters.model))


@dataclass(frozen=True)
class _Same:
    """A robot by its content, in one thread: two at once must not make functions of the same symbols; ``own``: that of
    the description."""

    content: str
    thread: int
    robot: RobotDescription = field(compare=False)
    own: RobotModel = field(compare=False)


@lru_cache(maxsize=KEPT)
def _parameters_of(same: _Same) -> RobotParameters:
    model = same.own.like(same.robot)
    return RobotParameters(model, all_parameters(model))


def _misread_diagnostic(run: Simulation, found: Sequence[tuple[RobotDescription, float]], left: float) -> Diagnostic:
    """Args: found: robots and what they leave, the best first; left: what the one of the description leaves."""
    robot = _description(run.model)
    assert robot is not None
    (best, rest), *others = found
    also = [f"; {_meant(other)} leaves {100 * error / left:.0f} %" for other, error in others[:1]]
    falls = f"with that, the residual of the base parameters falls to {100 * rest / left:.0f} %{''.join(also)}."
    if best.original_frames == robot.original_frames:
        code, text = GRAVITY, f"gravity = {_vector(robot.gravity)} m/s2 seems to be {_vector(best.gravity)} m/s2"
    else:
        code, text = FRAMES, "The table of frames seems to be in the classical convention (frames: standard)"
    return Diagnostic(code, f"{text}: {falls}", run.label, 100 * rest / left, 100 * math.sqrt(GRAVITY_LEAVES), "%")


def _meant(robot: RobotDescription) -> str:
    """The robot that may have been meant, in words."""
    return "frames: standard" if robot.original_frames == "standard" else _vector(robot.gravity)


def _vector(values: Sequence[float]) -> str:
    return f"({', '.join(f'{value:.3g}' for value in values)})"


def _clear(
    fitted: FittedMotion, misfit: Callable[[float], float], bound: float
) -> Iterator[tuple[float, float, float]]:
    """The least misfit, if it lies clearly away from 0 within the bound."""
    found = fitted.least(misfit, LEAST_SCALE, bound)
    if found is not None and abs(found[0]) > max(SHIFT_SIGMAS * found[1], LEAST_SCALE):
        yield found


def _description(model: LoopModel) -> RobotDescription | None:
    robot = getattr(model.parameters, "model", None)
    return robot.description if isinstance(robot, RobotModel) else None


def _lengths(robot: RobotDescription) -> list[tuple[int, str, float]]:
    return [
        (j, name, float(getattr(joint, name))) for j, joint in enumerate(robot.joints, start=1) for name in DISTANCES
    ]
