"""What may act on a signal of a model that its case does not have: the catalogue of discovery for models alone.

Each kind says what it does to a signal (:mod:`fmu_didim.model.signals.path`), the values from which it is fitted, and
what would tell it from others. A further one is a row of ``KINDS`` and a line of that module.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fmu_didim.model.signals.path import DELAY, DRIFT, FADES, LAG, LOWER, OFFSET, SCALE, TRANSIENT, UPPER

Side = Literal["input", "output", "parameter"]
"""Where something acts: on an input, on what the sensor of an output shows, or in the model itself."""
Values = Mapping[str, float]
"""Parameter of a signal -> value."""

LAGS = (0.5, 1.5, 5.0, 15.0, 50.0)
"""[samples] Time constants of lags from which fits start: each reaches to the next,"""
DELAYS = (1.0, 4.0, 15.0)
"""[samples] delays, to either side: as far as signals move on straight,"""
FADING = (2.0, 8.0, 30.0, 100.0)
"""[samples] and time constants of transients."""
LONGEST = 0.5
"""[1] Of the length of an experiment, up to which such times are tried: what is slower is a drift."""
ROOM = 0.1
"""[1] Of the range of a signal, by which a limit may lie beyond it: there it changes nothing any more."""
LEVELS = (0.97, 0.9, 0.75, 0.5)
"""[1] Places of a limit in the sorted values of a signal from which fits start."""


@dataclass(frozen=True)
class Measures:
    """Sizes of a signal in the data.

    Attributes:
        levels: (L,) sorted values that it takes; span: of them; step_s: median time between samples; length_s: of the
            longest experiment.
    """

    levels: Sequence[float]
    span: float
    step_s: float
    length_s: float

    def times(self, samples: Sequence[float]) -> list[float]:
        """Times in s from numbers of samples, as far as an experiment is long enough for them."""
        longest = LONGEST * self.length_s
        return [n * self.step_s for n in samples if n * self.step_s <= longest] or [min(self.step_s, longest)]


@dataclass(frozen=True)
class SignalParameter:
    """A parameter of a kind.

    Attributes:
        name: as of :mod:`fmu_didim.model.signals.path`; words: with ``{}`` for the signal, shown to the user.
        unit: from the unit of the signal; neutral: with which nothing changes; None of a shape.
        scale: size of a noticeable change; lowest, highest: limits.
    """

    name: str
    words: str
    unit: Callable[[str], str]
    neutral: float | None
    scale: Callable[[Measures], float]
    lowest: Callable[[Measures], float] = lambda _: -np.inf
    highest: Callable[[Measures], float] = lambda _: np.inf


@dataclass(frozen=True)
class Kind:
    """Something that may act on a signal.

    Attributes:
        name: in results; title: in words, for a user.
        equations: side -> what it does, in one line, with ``{}`` for the signal; the sides are where it is looked for.
        parameters: the amplitude first; starts: from the sizes of a signal to the values from which it is fitted.
        is_scaled: whether what it changes grows with its amplitude, so that its size follows from one simulation.
        moving: whether it shows only where the signal moves.
        of_start: whether it belongs to the start of each experiment, of which others tell nothing.
        experiment: what would tell it from others.
    """

    name: str
    title: str
    equations: Mapping[Side, str]
    parameters: tuple[SignalParameter, ...]
    starts: Callable[[Measures], list[dict[str, float]]]
    experiment: str
    is_scaled: bool = False
    moving: bool = False
    of_start: bool = False


def _same(unit: str) -> str:
    """The unit of a difference of two values."""
    return {"degC": "K", "degF": "degF"}.get(unit, unit)


def _span(measures: Measures) -> float:
    return measures.span


def _unity(_: Measures) -> float:
    return 1.0


def _step(measures: Measures) -> float:
    return measures.step_s


def _zero(_: Measures) -> float:
    return 0.0


def _least(measures: Measures) -> float:
    return measures.levels[0] - ROOM * measures.span


def _most(measures: Measures) -> float:
    return measures.levels[-1] + ROOM * measures.span


def _longest(measures: Measures) -> float:
    return LONGEST * measures.length_s


def _limits(measures: Measures, name: str, places: Sequence[float]) -> list[dict[str, float]]:
    levels = np.asarray(measures.levels)
    found = dict.fromkeys(float(np.quantile(levels, place)) for place in places)
    return [{name: level} for level in found if levels[0] < level < levels[-1]]


MOVE = "Move the inputs one at a time, by steps of different sizes, and let the outputs settle in between."
REST = "Record a stretch in which nothing moves, at two levels of each signal."

KINDS: tuple[Kind, ...] = (
    Kind(
        SCALE, "Scale",
        {"input": "{} acts scale times as recorded", "output": "the sensor shows scale times {}"},
        (SignalParameter(SCALE, "scale of {}", lambda unit: "1", 1.0, _unity),),
        lambda m: [{SCALE: 1.0}], MOVE, is_scaled=True, moving=True,
    ),
    Kind(
        OFFSET, "Offset",
        {"input": "{} acts as recorded plus the offset", "output": "the sensor shows {} plus the offset"},
        (SignalParameter(OFFSET, "offset of {}", _same, 0.0, _span),),
        lambda m: [{OFFSET: 0.0}], REST, is_scaled=True,
    ),
    Kind(
        LAG, "Lag of first order",
        {"input": "lag du/dt + u = {} as recorded", "output": "lag dy/dt + y = {}, y being shown"},
        (SignalParameter(LAG, "lag of {}", lambda unit: "s", 0.0, _step, _zero, _longest),),
        lambda m: [{LAG: t} for t in m.times(LAGS)], MOVE, moving=True,
    ),
    Kind(
        DELAY, "Delay",
        {"input": "{} acts the delay later than recorded", "output": "{} is shown the delay later"},
        (SignalParameter(DELAY, "delay of {}", lambda unit: "s", 0.0, _step),),
        lambda m: [{DELAY: sign * t} for t in m.times(DELAYS) for sign in (1, -1)],
        "Compare the clocks of the files; move the inputs one at a time, by steps.", moving=True,
    ),
    Kind(
        DRIFT, "Drift in time",
        {"input": "{} acts as recorded plus drift (t - t_0)", "output": "the sensor shows {} plus drift (t - t_0)"},
        (SignalParameter(DRIFT, "drift of {}", lambda unit: f"{_same(unit)}/s" if unit not in ("", "1") else "1/s", 0.0,
                         lambda m: m.span / m.length_s),),
        lambda m: [{DRIFT: 0.0}], "Come back to the same inputs at the end of an experiment.", is_scaled=True,
    ),
    Kind(
        UPPER, "Saturation above",
        {"input": "{} acts as recorded up to the limit", "output": "the sensor shows no more than the limit of {}"},
        (SignalParameter(UPPER, "upper limit of {}", lambda unit: unit, None, _span, _least, _most),),
        lambda m: _limits(m, UPPER, LEVELS), "Go farther up, and stay there for a while.", moving=True,
    ),
    Kind(
        LOWER, "Saturation below",
        {"input": "{} acts as recorded down to the limit", "output": "the sensor shows no less than the limit of {}"},
        (SignalParameter(LOWER, "lower limit of {}", lambda unit: unit, None, _span, _least, _most),),
        lambda m: _limits(m, LOWER, [1 - place for place in LEVELS]), "Go farther down, and stay there for a while.",
        moving=True,
    ),
    Kind(
        TRANSIENT, "Initial transient",
        {"output": "{} starts off by the transient, which fades as exp(-(t - t_0)/time constant)"},
        (
            SignalParameter(TRANSIENT, "transient of {}", _same, 0.0, _span),
            SignalParameter(
                FADES, "time constant of the transient of {}", lambda unit: "s", None, _step, _zero, _longest
            ),
        ),
        lambda m: [{TRANSIENT: 0.0, FADES: t} for t in m.times(FADING)],
        "Start from rest, or identify the initial state: identify: {name of the state.start: {}}.",
        is_scaled=True, of_start=True,
    ),
)  # fmt: skip
"""What is looked for on the signals of a model."""

PARAMETER = Kind(
    "parameter", "Value of the parameter",
    {"parameter": "{} has another value than the model gives it"}, (), lambda m: [{}],
    "Know the parameter from elsewhere, or identify it with data that tell it from the others.",
)  # fmt: skip
"""A parameter of the model that is not identified: it may do what something on a signal would."""

SIGNAL_KINDS = (*(kind.name for kind in KINDS), PARAMETER.name)
"""Names of all that is looked for."""
