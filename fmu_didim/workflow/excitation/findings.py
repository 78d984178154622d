"""What is said of a designed motion: where it may mislead."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, REMARK, Diagnostic
from fmu_didim.checks.data.expected_accuracy import accuracy_diagnostics
from fmu_didim.discovery.excitation.basis import Basis
from fmu_didim.discovery.excitation.limits import Bounds
from fmu_didim.dynamics.load import PREFIX
from fmu_didim.dynamics.space.space import Box
from fmu_didim.workflow.excitation.planned import BEYOND, FOLLOWED, Peaks, Plan, Prediction
from fmu_didim.workflow.excitation.space import LINES, Compared, nearest, positions

UNEXCITED = CATALOGUE(
    "excitation-unexcited", PROBLEM, rank=42,
    meaning="Some parameters do nothing to the torque along the designed motion, or along any motion of this robot, as "
    "the gravity torque of an axis that is vertical; or they are held at a limit.",
    next_step="Leave them out of what is identified, or mount the robot so that they act.",
)  # fmt: skip
ALIKE = CATALOGUE(
    "excitation-confounded", PROBLEM, rank=43,
    meaning="Even on the designed motion the log does not tell some parameters apart.",
    next_step="Leave one of them out, widen the limits, or log something else, too.",
)  # fmt: skip
BEYOND_LIMITS = CATALOGUE(
    "excitation-beyond-limits", PROBLEM, rank=44,
    meaning="The reference keeps the limits, but the simulated loop does not: it overshoots, or its torque is larger "
    "than that of the inverse model. No reference is written.",
    next_step="Widen the limit if the machine allows it, or ask for a slower motion (--period, --harmonics, --moves).",
)  # fmt: skip
TOO_NEAR = CATALOGUE(
    "excitation-collision", PROBLEM, rank=44,
    meaning="Links come too near to each other or to a box along the simulated motion, what lies between two of its "
    "instants counted. No reference is written.",
    next_step="Give a start: with more room about it, a narrower range of position, or a slower motion (--period).",
)  # fmt: skip
SHAPE_UNREAD = CATALOGUE(
    "excitation-shape-unread", DOUBT, rank=46,
    meaning="Collision geometry of the URDF could not be read, so that the design knows nothing of these pieces: they "
    "may collide.",
    next_step="Put the STL meshes beside the URDF, or give capsules: among the limits.",
)  # fmt: skip
SHAPE_PARTIAL = CATALOGUE(
    "excitation-shape-partial", DOUBT, rank=46,
    meaning="Boxes were given, but not the shape of all links: lines between the origins of the frames stand for them, "
    "without thickness and without what lies beyond the last origin, or some links are not compared at all.",
    next_step="Give capsules: among the limits, for each link and the tool on the last one, or a larger clearance:.",
)  # fmt: skip
PAIRS_LEFT = CATALOGUE(
    "excitation-pairs-left-out", REMARK, rank=73,
    meaning="Links that are no neighbours overlap in each posture drawn, and are not compared: usual in a wrist, "
    "else a sign of capsules that are too thick, or in mm.",
    next_step="Look at them; give thinner capsules: among the limits, in m.",
)  # fmt: skip
SPACE_UNSEEN = CATALOGUE(
    "excitation-space-unverified", DOUBT, rank=46,
    meaning="The simulated loop does not show where the links are: its plant has no positions, or gears give way. "
    "Clearances hold for the reference, or for where the motors are.",
    next_step="Watch the first run, and give a clearance: for the deviation.",
)  # fmt: skip
ABOVE_LOG = CATALOGUE(
    "excitation-above-log", DOUBT, rank=45,
    meaning="The highest harmonic of the motion, or the acceleration of its moves, lies above half the rate of the "
    "log, which shows it at another one.",
    next_step="Ask for fewer harmonics or moves or a longer period, or log faster.",
)  # fmt: skip
NOT_FOLLOWED = CATALOGUE(
    "excitation-not-followed", DOUBT, rank=46,
    meaning="The simulated loop does not follow the designed reference: its highest harmonics, or its moves, are "
    "faster than the controller. The design assumes that it follows; the predicted deviations hold for the "
    "simulated motion.",
    next_step="Ask for fewer harmonics or moves, or a longer period.",
)  # fmt: skip
STARTS_FAILED = CATALOGUE(
    "excitation-starts-failed", REMARK, rank=70,
    meaning="From some random starts the optimisation failed, and they were left out.",
    next_step="Nothing, where others have settled; else more --starts, or wider limits.",
)  # fmt: skip
NOT_SETTLED = CATALOGUE(
    "excitation-not-settled", REMARK, rank=71,
    meaning="The optimisation of the best motion was ended before it had settled: the motion keeps its limits, and a "
    "better one may exist near it.",
    next_step="Ask for more --starts.",
)  # fmt: skip
NO_TORQUE_LIMIT = CATALOGUE(
    "excitation-no-torque-limit", REMARK, rank=72,
    meaning="No limit of the torque was given, so that the motion may ask for more than the drives have.",
    next_step="Compare the largest torques of the table with the drives, and give limits: torque.",
)  # fmt: skip
NO_BETTER = CATALOGUE(
    "excitation-no-better", REMARK, rank=73,
    meaning="The reference that the case has tells as much of the parameters as the designed motion, or more; it may "
    "break limits that the designed one keeps.",
    next_step="Compare both columns of the table; more --starts may find a better motion.",
)  # fmt: skip


UNKNOWN_LOOP = CATALOGUE(
    "excitation-controller-unknown", REMARK, rank=72,
    meaning="The controller of the case is not known: the simulated loop follows the motion as a virtual one does, "
    "nearly without error. Where the real one overshoots, limits may be exceeded that are kept here; and what noise "
    "and low-pass of measured positions will do to the values is not predicted.",
    next_step="Give reference.csv to the robot's controller, watch the first run, and log torque and positions.",
)  # fmt: skip
WITH_LOADS = (
    "The case has a run with a load: excite it together with the one without, by --weigh 0.5,1,2 (kg), which also says "
    "which weight tells most."
)
"""The next step where parameters of a load are those that a single run does not excite."""


def findings(
    plan: Plan, basis: Basis, bounds: Bounds, found: Prediction, now: Prediction | None, asked: Sequence[str], *,
    failed: int, starts: int, settled: bool, around: Compared | None = None,
) -> list[Diagnostic]:  # fmt: skip
    """All that a user must know before the motion is run."""
    n = plan.case.parameters.joint_count
    told = []
    if found.unexcited:
        text = f"The motion does not excite {', '.join(found.unexcited)}."
        step = WITH_LOADS if _of_loads(found.unexcited) and not plan.beside else ""
        told.append(Diagnostic(UNEXCITED, text, value=float(len(found.unexcited)), unit="parameters", next_step=step))
    if found.alike:
        text = f"The log will not tell {', '.join(found.alike)} apart."
        told.append(Diagnostic(ALIKE, text, next_step=WITH_LOADS if _of_loads(found.alike) and not plan.beside else ""))
    told += _of_loop(bounds, found, n)
    if around is not None:
        told += _of_space(around, found)
    (what, highest), half = basis.fastest, plan.rate_hz / 2
    if highest > half:
        text = f"{what} is at {highest:.4g} Hz; the log shows motions up to {half:.4g} Hz."
        told.append(Diagnostic(ABOVE_LOG, text, value=highest, bound=half, unit="Hz"))
    if failed:
        text = f"From {failed} of {starts} starts the optimisation failed."
        told.append(Diagnostic(STARTS_FAILED, text, value=float(failed), unit="starts"))
    if not settled:
        told.append(Diagnostic(NOT_SETTLED, "The optimisation of this motion had not settled."))
    if plan.case.tracking is not None:
        told.append(Diagnostic(UNKNOWN_LOOP, "The real controller is not simulated: nobody knows it."))
    if not np.isfinite(bounds.torque).all():
        told.append(Diagnostic(NO_TORQUE_LIMIT, "The torque has no limit."))
    if now is not None and now.criterion_in(found.length_s, len(asked)) >= found.criterion:
        text = f"In {found.length_s:g} s the reference of the case would tell as much of the parameters asked for."
        told.append(Diagnostic(NO_BETTER, text))
    return told + (accuracy_diagnostics(found.prospect) if found.prospect is not None else [])


def _of_loads(names: Sequence[str]) -> bool:
    return any(name.startswith(PREFIX) for name in names)


def _of_loop(bounds: Bounds, found: Prediction, n: int) -> list[Diagnostic]:
    told = []
    excess = Peaks.of(found.loop, n).excess(bounds)
    if excess > BEYOND:
        text = f"The simulated loop exceeds a limit by {100 * excess:.2g} % of its size."
        told.append(Diagnostic(BEYOND_LIMITS, text, value=100 * excess, bound=100 * BEYOND, unit="%"))
    for j, lag in enumerate(found.lag(n)):
        if lag > FOLLOWED:
            text = f"The velocity deviates by {100 * lag:.2g} % from that of the reference."
            told.append(Diagnostic(NOT_FOLLOWED, text, f"joint {j + 1}", 100 * lag, 100 * FOLLOWED, "%"))
    return told


def _of_space(around: Compared, found: Prediction) -> list[Diagnostic]:
    """What is said of links and boxes."""
    told, short = [], -around.space.least
    for one in nearest(around.space, found.loop, found.part_s):
        if one.clearance + short < 0:
            text = f"A clearance of {1000 * one.clearance:.3g} mm at t = {one.time:.4g} s."
            told.append(Diagnostic(TOO_NEAR, text, one.name, 1000 * one.clearance, 1000 * around.space.least, "mm"))
    told += [Diagnostic(SHAPE_UNREAD, f"Not read: {text}.") for text in around.unread]
    if around.odd:
        text = f"Not compared, since they overlap in each posture drawn: {'; '.join(around.odd)}."
        told.append(Diagnostic(PAIRS_LEFT, text, value=float(len(around.odd)), unit="pairs"))
    with_boxes = any(isinstance(check.other, Box) for check in around.space.checks)
    if with_boxes and around.shape == LINES:
        told.append(Diagnostic(SHAPE_PARTIAL, "Lines between the origins of the frames stand for the links."))
    elif around.shape and around.bare:
        numbers = ", ".join(map(str, around.bare))
        told.append(Diagnostic(SHAPE_PARTIAL, f"No shape is known of link {numbers}: it is compared with nothing."))
    if around.space.checks and (around.is_elastic or positions(around.space, found.loop) is None):
        what = "gears give way" if around.is_elastic else "no positions"
        told.append(Diagnostic(SPACE_UNSEEN, f"Clearances were not seen where the links are: {what}."))
    return told
