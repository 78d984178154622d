"""Whether another robot explains a log better: another length of a link, or a torque that is scaled against the others.

Along one simulated motion near the measured one, the base parameters are fitted anew for each length and each scale:

    length     W(q, dq, ddq; a (1 + x)) theta
    scale      exp(x) times the rows of one joint; all joints together only scale theta

so that only what base parameters cannot absorb counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.checks.data.linear_fit import Explanation, FittedMotion, Ticks
from fmu_didim.checks.data.timing import SHIFT_SIGMAS
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters

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
DISTANCES = ("a", "d")


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


def another_robot(fitted: FittedMotion) -> Iterator[Explanation]:
    """Other scales and lengths that explain a log better, one at a time."""
    yield from _scales(fitted)
    yield from _link_lengths(fitted)


def _scales(fitted: FittedMotion) -> Iterator[Explanation]:
    n = fitted.run.model.joint_count
    for j in range(n if n > 1 else 0):
        rows = np.arange(n) == j

        def misfit(x: float, rows: np.ndarray = rows) -> float:
            scale = np.where(rows, math.exp(x), 1.0)

            def scaled(ticks: Ticks) -> tuple[np.ndarray, np.ndarray]:
                columns, known = fitted.along(ticks)
                return columns * scale[:, None], known * scale

            return fitted.misfit_of(replace(fitted, changed=scaled))

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
            other = RobotParameters(RobotModel(robot.model_copy(update={"joints": tuple(joints)})), parameters.base)

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
