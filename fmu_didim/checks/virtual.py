"""What is to be said of an answer whose loop had a virtual controller that follows measured positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Code, Diagnostic
from fmu_didim.checks.data.robot import TORQUE_SCALE
from fmu_didim.checks.data.timing import CLOCK_EARLY, CLOCK_LATE, SAMPLING_KIND
from fmu_didim.checks.motion.dependence import DEPENDS_ON_MOTION
from fmu_didim.estimators.starts.gains import free_gains
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.choices import Choices
from fmu_didim.model.loop_model import LoopModel

FAR = 3.0
"""[standard deviations] By noise alone, by which another choice moves a value, from which the answer is doubted."""

TRACKING_CHOICE = CATALOGUE(
    "tracking-choice", DOUBT, rank=42,
    meaning="Values depend on how the virtual controller follows the measured positions: on its bandwidth, where their "
    "noise (twice the bandwidth) or what a low-pass takes off the motion (half of it) counts, or on how long the real "
    "controller held its torque.",
    next_step="Log positions at a higher rate and with less noise; state the control rate of the machine (loop: "
    "{rate_hz: ...}) if it is known, or another controller: {kind: tracking, bandwidth_hz: ...} that moves less.",
)  # fmt: skip
VIRTUAL_CONTROLLER = CATALOGUE(
    "virtual-controller", REMARK, rank=64,
    meaning="The loop was simulated with a virtual controller that follows the measured positions. Intervals contain "
    "what that choice does to the values.",
    next_step="",
)  # fmt: skip
TRACKING_UNTRIED = CATALOGUE(
    "tracking-untried", DOUBT, rank=43,
    meaning="Effects were looked for beside a virtual controller, with one choice of how it follows the measured "
    "positions. What their filter takes off, or their noise, may be in the values, and another choice was not tried.",
    next_step="Run fmu-didim discover again with controller: {kind: tracking, bandwidth_hz: ...} at half and at twice "
    "of it: what is an effect of the machine keeps its name and its values. If so, acknowledge this code in the case.",
)  # fmt: skip
ALIKE = (
    "Beside a virtual controller a real one that holds its torque longer or shorter, and a delay or a lag of the "
    "drive, look alike: state the control rate, loop: {rate_hz: ...}."
)
"""What to do about the timing of a log, beside its own advice."""
FOLLOWS = (
    "Check clocks and sampling of torque and positions, the control rate, and whether another bandwidth_hz leaves "
    "less; else name what is missing (fmu-didim discover)."
)
"""What to do where the residual follows the motion,"""
SCALE = "Check unit, gear ratio and torque constant of the log; noise of positions that is let in looks alike."
"""and where a torque seems to have another scale."""
RESTS = (
    "the log shows the torque at the joints{scale}, on the clock of the positions and without a lag or a delay of the "
    "drive, of which a virtual controller knows nothing"
)
"""What nobody can tell without the real controller,"""
SCALE_KNOWN = " in its right scale"
"""and what a load of known mass tells."""
HELD = "and that a torque is held for one control period of the case, in the middle of which it counts"
"""The same of an estimator that simulates no loop."""


def virtual_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """What the virtual controller costs; nothing of a loop with the real one."""
    if not estimate.model.loop.is_virtual:
        return []
    choices, model = estimate.choices, estimate.model
    rests = RESTS.format(scale="" if model.loads and len(free_gains(model)) == model.joint_count else SCALE_KNOWN)
    if choices is None:  # of the measured motion alone
        text = "No controller was simulated: the values come from the measured motion."
        return [Diagnostic(VIRTUAL_CONTROLLER, text, "controller", condition=f"{rests}, {HELD}")]
    text = f"The loop has a virtual controller ({choices.chosen}); the intervals contain that choice."
    told = [Diagnostic(VIRTUAL_CONTROLLER, text, "controller", condition=rests)]
    return [*told, *_moved(choices, estimate), *_failed(choices)]


def discovered_beside() -> list[Diagnostic]:
    """What is to be said of effects that were looked for beside a virtual controller."""
    text = "The loop has a virtual controller that follows the measured positions; no other choice of it was tried."
    rests = RESTS.format(scale=SCALE_KNOWN)
    return [
        Diagnostic(TRACKING_UNTRIED, text, "controller"),
        Diagnostic(VIRTUAL_CONTROLLER, text, "controller", condition=rests),
    ]


def of_one_set(found: Sequence[Diagnostic], model: LoopModel) -> list[Diagnostic]:
    """The diagnostics with advice that does not send to a controller that nobody knows: a late or early clock, another
    way of sampling, a delay or a lag of the drive, and how long the real controller holds its torque look alike."""
    if not model.loop.is_virtual:
        return list(found)
    advice: dict[Code, str] = dict.fromkeys((CLOCK_LATE, CLOCK_EARLY, SAMPLING_KIND), f"{{own}} {ALIKE}")
    advice |= {DEPENDS_ON_MOTION: FOLLOWS, TORQUE_SCALE: SCALE}
    return [
        replace(d, next_step=advice[d.code].replace("{own}", d.advice)) if d.code in advice else d for d in found
    ]  # fmt: skip


def _moved(choices: Choices, estimate: Estimate) -> list[Diagnostic]:
    """The values that another choice moves far, the farthest first."""
    found = []
    for words, shift in choices.shifts.items():
        far = np.abs(shift) / choices.noise_alone
        places = [int(i) for i in np.argsort(-far) if far[i] > FAR]
        if not places:
            continue
        moved = ", ".join(
            f"{estimate.names[i]} by {shift[i]:.2g} {estimate.units[i]} ({far[i]:.1f} sigma of noise)" for i in places
        )
        text = f"With {words} instead of {choices.chosen} values would move: {moved}."
        found.append(Diagnostic(TRACKING_CHOICE, text, estimate.names[places[0]], float(far[places[0]]), FAR, "1"))
    return found


def _failed(choices: Choices) -> list[Diagnostic]:
    return [
        Diagnostic(TRACKING_CHOICE, f"What {words} would do to the values is not known: {why}", "controller")
        for words, why in choices.failed.items()
    ]
