"""What was fitted beside the torque: whether it agrees with the torque, and what its residual looks like.

A channel whose noise is not stated counts by what it leaves, so that nothing fails where a sensor is wrong: it would
only count less. Hence its residual is compared with what wrong sensors show: an offset, a scale, a late clock,

    r = offset + scale * (y_s - mean(y_s)) - late * dy_s/dt.
"""

from __future__ import annotations

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.checks.data.linear_fit import motion_with_regressor
from fmu_didim.checks.validation import ChannelValidation, validated_channels
from fmu_didim.fit.estimate import Estimate, JointFit
from fmu_didim.fit.noise.shared import remembered_s

DISAGREEMENT = 0.001
"""[1] Probability of differences as large by noise alone, over all parameters, below which torque and the other
channels disagree."""
FAR = 3.0
"""[standard deviations] Of the difference, from which a parameter is named; else that which is farthest apart."""
EXPLAINED = 0.1
"""[1] Fraction of the squared residual of a channel that an offset, a scale or a late clock explains, from which it is
told: less changes no value."""
CERTAIN = 4.0
"""[standard deviations] By which it differs from none, with the memory of the residual."""
COLOURED = 1.5
"""[1] Inflation of standard deviations by the colour of a residual, from which it is reported: half more than by white
noise."""
POSITIONS_APART = 5.0
"""[standard deviations] Of the difference of values by positions alone and by the torque along the motion that they
give, from which it is doubted: the noise of the torque has a colour that is known to some parts only."""
LARGER = 2.0
"""[1] Residual over the stated noise of a channel, from which the statement or the model is wrong."""

CHANNELS_DISAGREE = CATALOGUE(
    "channels-disagree", DOUBT, rank=44,
    meaning="The torque alone and the torque with what was measured beside it give different values: the model, a "
    "drive gain or a sensor is wrong, and the joint values are a compromise.",
    next_step="Compare both answers in the report; check gains, units and clocks of torque and positions; see "
    "fmu-didim discover CASE.yaml, which names what the model lacks.",
)  # fmt: skip
CHANNEL_OFF = CATALOGUE(
    "channel-off", DOUBT, rank=43,
    meaning="What was measured beside the torque differs from the simulation as a sensor with an offset, a wrong scale "
    "or a late clock does.",
    next_step="Give zero:, scale: or unit: of the column, or offset_s: of the file, if the sensor is to blame; leave "
    "the channel out of measured: else.",
)  # fmt: skip
CHANNEL_COLOURED = CATALOGUE(
    "channel-coloured", REMARK, rank=66,
    meaning="The residual of a channel beside the torque is not white: it holds model error, or noise with a memory, "
    "and counts by its colour.",
    next_step="Nothing, unless the torque is doubted, too.",
)  # fmt: skip
MOTION_UNEXPLAINED = CATALOGUE(
    "motion-unexplained", DOUBT, rank=52,
    meaning="In an open loop the residual of a measured signal is not white: the model does not explain the motion.",
    next_step="Check the unit and the clock of torque and positions, the delay of the drive and where the motion "
    "begins; else the robot description lacks something.",
)  # fmt: skip
CHANNEL_NOISE = CATALOGUE(
    "channel-beyond-noise", DOUBT, rank=44,
    meaning="A channel differs from its simulation by more than the noise that the case states: what is left is model "
    "error, which counts as precise measurement where the channel was fitted.",
    next_step="State the std: that the sensor really has, or none; or find out what the model lacks: fmu-didim "
    "discover CASE.yaml.",
)  # fmt: skip


def channel_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """What is wrong with the channels that were fitted beside the torque."""
    joint = estimate.joint
    if joint is None:
        return []
    is_open = estimate.model.loop.torque_is_given
    return [*_disagreement(joint, estimate), *_beyond_noise(joint), *_off(estimate), *_coloured(joint, is_open)]


def position_fit_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """Whether values that were fitted to positions alone are those of the torque along the motion that they give.

    A late clock of the positions or a wrong gain of the drive hides in viscous friction, and leaves no residual there.
    """
    model, found = estimate.model, list[Diagnostic]()
    if (
        estimate.fit is not None
        or not model.parameters.has_regressor
        or model.experiments[model.first].positions is None
    ):
        return []
    count = model.linear_count
    for label in model.estimation_labels:
        motion = motion_with_regressor(model.on(label).simulation(model.start))
        values, deviation = motion.values()
        apart = (estimate.value[:count] - values) / np.hypot(deviation, estimate.standard_deviation[:count])
        i = int(np.argmax(np.abs(apart)))
        if abs(apart[i]) > POSITIONS_APART:
            text = (
                f"Positions and torque do not agree: {estimate.names[i]} = {estimate.value[i]:.4g} {estimate.units[i]} "
                f"by the positions, {values[i]:.4g} by the torque along that motion ({abs(apart[i]):.1f} sigma of the "
                "difference)."
            )
            found.append(Diagnostic(CHANNELS_DISAGREE, text, label, abs(float(apart[i])), POSITIONS_APART, "1"))
    return found


def noise_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """What further outputs of a model leave, beside the noise that the case states for them."""
    joint = estimate.joint
    return [] if joint is None else [*_beyond_noise(joint), *_coloured(joint, is_open=False)]


def _coloured(joint: JointFit, is_open: bool) -> list[Diagnostic]:
    """Residuals that are not white; in an open loop nothing else shows that the model is wrong."""
    code = MOTION_UNEXPLAINED if is_open else CHANNEL_COLOURED
    return [
        Diagnostic(
            code,
            f"{c.name}: the residual of {c.rms:.2g} {c.unit} is not white (neighbouring samples correlate by "
            f"{c.lag_one:.2f}): standard deviations that come from it are some {c.inflation:.2g} times those with "
            "white noise.", c.name, c.inflation, COLOURED, "1",
        )
        for c in joint.channels if c.inflation > COLOURED
    ]  # fmt: skip


def _disagreement(joint: JointFit, estimate: Estimate) -> list[Diagnostic]:
    if joint.alone is None or joint.p_value >= DISAGREEMENT:
        return []
    farthest = int(np.argmax(np.abs(joint.apart)))
    named = [i for i in np.argsort(-np.abs(joint.apart)) if abs(joint.apart[i]) >= FAR] or [farthest]
    values = ", ".join(
        f"{estimate.names[i]} = {joint.alone[i]:.4g} by the torque alone, {estimate.value[i]:.4g} {estimate.units[i]} "
        f"with {_names(joint)} ({abs(joint.apart[i]):.1f} sigma of the difference)" for i in named
    )  # fmt: skip
    text = f"Torque and {_names(joint)} do not agree (p = {joint.p_value:.1e}): {values}."
    return [Diagnostic(CHANNELS_DISAGREE, text, estimate.names[farthest], joint.p_value, DISAGREEMENT, "1")]


def _names(joint: JointFit) -> str:
    return ", ".join(channel.name for channel in joint.channels)


def _beyond_noise(joint: JointFit) -> list[Diagnostic]:
    return [
        Diagnostic(
            CHANNEL_NOISE,
            f"{c.name}: the residual of {c.rms:.3g} {c.unit} is {c.rms / c.deviation:.1f} times the stated noise.",
            c.name, c.rms, c.deviation, c.unit,
        )
        for c in joint.channels if c.is_stated and c.rms > LARGER * c.deviation
    ]  # fmt: skip


def _off(estimate: Estimate) -> list[Diagnostic]:
    """Offsets, scales and late clocks that the residuals of the channels show."""
    found = []
    for label in estimate.model.estimation_labels:
        shown = validated_channels(estimate.model.simulation(estimate.value, label))
        for name in estimate.model.experiments.channels:
            if name in shown and (told := like_a_wrong_sensor(shown[name])):
                found.append(Diagnostic(CHANNEL_OFF, f"{label}: {name} {told}.", name))
    return found


def like_a_wrong_sensor(channel: ChannelValidation, *, share: float = EXPLAINED) -> str:
    """What of an offset, a scale and a late clock a channel shows, in words; or nothing.

    Args:
        share: of the squared residual that one of them must explain.
    """
    time, simulated, residual, unit = channel.time, channel.simulated, channel.residual, channel.unit
    shapes = np.column_stack([np.ones(time.size), simulated - simulated.mean(), -np.gradient(simulated, time)])
    size = np.linalg.norm(shapes, axis=0)
    shapes, size = shapes[:, size > 0], size[size > 0]
    found, *_ = np.linalg.lstsq(shapes / size, residual, rcond=None)
    rest = residual - shapes / size @ found
    memory = remembered_s(rest, time) / float(np.median(np.diff(time)))
    inverse = np.linalg.inv((shapes / size).T @ (shapes / size))
    deviation = np.sqrt(np.diag(inverse) * float(rest @ rest) / time.size * max(memory, 1.0))
    # By how much the squares grow without one of them.
    explained = found**2 / np.diag(inverse) / float(residual @ residual)
    texts = []
    for k, value in enumerate(found):
        if explained[k] < share or abs(value) < CERTAIN * deviation[k]:
            continue
        amount = float(value / size[k])
        texts.append(
            (f"shows {amount:.3g} {unit} more than the simulation", f"moves {100 * amount:+.2g} % more than it",
             f"is {1e3 * abs(amount):.3g} ms {'later' if amount > 0 else 'earlier'} than it")[k]
        )  # fmt: skip
    return " and ".join(texts)
