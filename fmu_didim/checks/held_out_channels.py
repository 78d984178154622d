"""Whether what was measured beside the torque is predicted in held-out experiments as well as in the fitted ones.

A channel that was fitted is judged as the torque of a joint is (:mod:`fmu_didim.checks.held_out`): its held-out
residual, with the effect of the uncertainty of the values on it, against that of the fit. One that was not fitted is
compared with the noise that the case states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.channels import CHANNEL_NOISE, LARGER, like_a_wrong_sensor
from fmu_didim.checks.held_out import HELD_OUT_RATIO, WORSE_HELD_OUT, Residual, worse_than_fitted
from fmu_didim.checks.validation import ChannelValidation
from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.model.loop_model import LoopModel

MOSTLY = 0.5
"""[1] Share of the squared held-out residual that an offset, a scale or a late clock explains, from which it is named
beside it: a model that is wrong there shows a part of each, too."""

NOT_JUDGED = CATALOGUE(
    "held-out-channel-not-judged", REMARK, rank=91,
    meaning="A signal was measured in a held-out experiment alone, and the case does not state its noise: its error is "
    "shown, but nothing says how large it may be.",
    next_step="State its std:, or give the signal in a fitted experiment, too.",
)  # fmt: skip

ROUNDING_PERCENT = 1e-4
"""[%] Of the motion, below which an error is rounding of a table with seven digits, whatever the fit leaves."""

Channels = Mapping[str, ChannelValidation]


def held_out_channel_diagnostics(
    model: LoopModel, covariance: Array, fitted: Sequence[Channels], held: Mapping[str, Channels]
) -> list[Diagnostic]:
    """Whether the channels of held-out experiments contradict the values of a model, known with a covariance (p, p).

    Args:
        fitted: channels of each fitted experiment, by name; held: label -> those of each held-out one.
    """
    names = (*model.loop.output_names, *model.experiments.channels)
    outputs = model.joint_count + len(model.experiments.channels)
    before = {
        name: _residual([channels[name] for channels in fitted if name in channels])
        for name in names if any(name in channels for channels in fitted)
    }  # fmt: skip
    found = []
    for label, channels in held.items():
        uncertain = _Uncertain(model, covariance, label)
        for name, channel in channels.items():
            if name in before:
                share = covariance.shape[0] / outputs
                found += _against_fit(before[name], channel, uncertain, name, count=share, among=len(channels))
            else:
                found += _against_noise(channel, uncertain, name)
    return found


@dataclass(frozen=True)
class _Uncertain:
    """The mean variance of the channels of a held-out experiment by the uncertainty of the values."""

    model: LoopModel
    covariance: Array
    label: str

    def size(self, channel: ChannelValidation) -> str:
        """The error of a channel, beside what it moves."""
        return _size(channel, "its motion" if self.model.loop.shows_torque else "what it moves")

    @cached_property
    def by_name(self) -> dict[str, float]:
        """Of each channel; zero where the experiment cannot be simulated near the values."""
        alone = self.model.on(self.label)
        experiments, names = alone.experiments, (*alone.loop.output_names, *alone.experiments.channels)
        try:
            table = sensitivity(alone, alone.start, alone.outputs(alone.start))
        except SimulationError:
            return dict.fromkeys(names, 0.0)
        own = experiments[self.label]
        log = table[own.row_of(own.time)] if experiments.channels else table
        columns = {name: log[:, j] for j, name in enumerate(alone.loop.output_names)}
        columns |= experiments.channels_of(self.label, table)
        return {name: float(np.einsum("kp,pq,kq->", c, self.covariance, c) / c.shape[0]) for name, c in columns.items()}


def _size(channel: ChannelValidation, moves: str) -> str:
    percent = channel.relative_error_percent
    of_motion = "" if not np.isfinite(percent) else f" ({percent:.2g} % of {moves})"
    return f"{channel.rms:.2g} {channel.unit}{of_motion}"


def _residual(channels: Sequence[ChannelValidation]) -> Residual:
    """Of one channel in several experiments; each moves about its own mean."""
    moved = np.concatenate([channel.measured - channel.measured.mean() for channel in channels])
    size = max(float(np.sqrt(np.mean(moved**2))), TINY)
    return Residual(np.concatenate([channel.residual for channel in channels])[:, None], np.array([size]))


def _against_fit(
    fitted: Residual, channel: ChannelValidation, uncertain: _Uncertain, name: str, *, count: float, among: int
) -> list[Diagnostic]:
    held = _residual([channel])
    if channel.relative_error_percent < ROUNDING_PERCENT:
        return []
    if not worse_than_fitted(fitted, held, count=count, among=among).size:
        return []
    extra = uncertain.by_name[name]
    if not worse_than_fitted(fitted, held, count=count, among=among, extra=extra).size:
        return []
    ratio = float(np.sqrt(held.variance[0] / fitted.variance[0]))
    text = (
        f"The error of {name} is {uncertain.size(channel)} against {np.sqrt(fitted.variance[0]):.2g} {channel.unit} in "
        f"the fit, {ratio:.3g} times as large{_as_a_sensor(channel)}."
    )
    return [Diagnostic(WORSE_HELD_OUT, text, f"{uncertain.label}: {name}", ratio, HELD_OUT_RATIO, "1")]


def _against_noise(channel: ChannelValidation, uncertain: _Uncertain, name: str) -> list[Diagnostic]:
    place, bound = f"{uncertain.label}: {name}", channel.deviation
    if bound is None:
        text = f"The error of {name} is {uncertain.size(channel)}{_as_a_sensor(channel)}; its noise is not stated."
        return [Diagnostic(NOT_JUDGED, text, place, channel.rms, unit=channel.unit)]
    if channel.rms <= LARGER * bound or channel.rms <= LARGER * np.sqrt(bound**2 + uncertain.by_name[name]):
        return []
    text = (
        f"The error of {name}, which was not fitted, is {uncertain.size(channel)}, {channel.rms / bound:.1f} times the "
        f"stated noise{_as_a_sensor(channel)}."
    )
    return [Diagnostic(CHANNEL_NOISE, text, place, channel.rms, bound, channel.unit)]


def _as_a_sensor(channel: ChannelValidation) -> str:
    told = like_a_wrong_sensor(channel, share=MOSTLY)
    return f"; it {told}, as a sensor that is off or a model that is wrong there" if told else ""
