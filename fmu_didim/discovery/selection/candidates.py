"""The candidates of a round: screened by their signatures, fitted in the loop, and the outcome of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.screening.catalogue import Signature
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint


@dataclass(frozen=True)
class ScreenedCandidate:
    """A candidate at its best shapes.

    Attributes:
        signature: with the best shapes; coefficients: (m,) of its columns; gain: of the screening, cost deducted.
        surviving: part of the norm of the signature that the base cannot absorb.
        predicted: BIC difference of the fit to first order, with the colour of what the candidate leaves, not of what
            there is before it: a missing effect that moves as slowly as the joint colours the whole residual.
        others: the candidate at further shapes that are nearly as good, tried too if it leads; None in the torque
            balance, where the signature is the slope itself.
        of_motor: the candidate at the best harmonic of the motor that the description states, where another frequency
            is the best.
    """

    signature: Signature
    coefficients: Array
    gain: float
    surviving: float
    others: tuple[ScreenedCandidate, ...] | None = None
    predicted: float = -np.inf
    of_motor: ScreenedCandidate | None = None

    @property
    def effect_at(self) -> EffectAtJoint:
        return self.signature.effect_at

    @property
    def start(self) -> Proposal:
        """Where its fit starts."""
        return self.signature.proposal(self.coefficients)


@dataclass(frozen=True)
class FittedCandidate:
    """A candidate fitted in the closed loop.

    Attributes:
        effect_at: effect and joint; fit: of the model with it; delta_bic: over the model without.
        size: the part of the residual that only it can explain, in units of the noise; share: of the gap.
        change: of an output, such as a torque, by switching it off while nothing else changes, in units of the noise.
        cost: parameters that it counts as, without amplitudes that change nothing here, such as a mass on an axis.
        implausible: why its values are not significant or not possible, or an empty string.
        unusual: which of its values hardly any machine has, or an empty string.
        has_minima: whether its fit has many minima, as that of play has, which hits its flanks.
        is_measured: whether it follows what runs have measured, so that held-out ones may tell nothing of it.
        is_known: whether it repeats as the motor does that the description states.
        bends_gear: whether it bends the torque of a gear over its twist, so that the stiffness hangs on it, however
            small a part of what the whole gear explains it may be.
    """

    effect_at: EffectAtJoint
    fit: Fit
    delta_bic: float
    size: float
    share: float
    change: float
    cost: float
    implausible: str = ""
    unusual: str = ""
    has_minima: bool = False
    is_measured: bool = False
    is_known: bool = False
    bends_gear: bool = False


class Outcome(Enum):
    """The outcome of a shortlisted candidate."""

    FITTED = "fitted"
    LEFT_EARLY = "left early"
    """It could not reach the best, by its signature or in the course of its fit."""
    NOT_SIMULABLE = "cannot be simulated"
    NOT_TRIED = "not tried"
    """The time was up before, or in the middle of its fit."""


@dataclass(frozen=True)
class TriedCandidate:
    """A candidate of a round and its outcome.

    Attributes:
        delta_bic: over the model without it, where its fit ended; None without a fit.
        share, cost, implausible: as of :class:`FittedCandidate`, where it was fitted.
    """

    effect_at: EffectAtJoint
    outcome: Outcome
    delta_bic: float | None = None
    share: float | None = None
    cost: float | None = None
    implausible: str = ""


@dataclass(frozen=True)
class Fruitless:
    """What candidates promised whose fits have brought nothing, by which it is judged whether they are fitted again.

    Attributes:
        astray: of those in the torque balance whose fit ended hardly better than without them; vain: of those whose
            whole fit ended worse than without them by BIC.
    """

    astray: Mapping[EffectAtJoint, float] = field(default_factory=dict)
    vain: Mapping[EffectAtJoint, float] = field(default_factory=dict)

    def and_then(self, later: Fruitless) -> Fruitless:
        """Those of two rounds, of a candidate in both the later promise."""
        return Fruitless({**self.astray, **later.astray}, {**self.vain, **later.vain})


@dataclass(frozen=True)
class Comparison:
    """The fits of a round.

    Attributes:
        ranking: the fitted ones, the best first; tried: all candidates, in the order of the fits.
        unfitted: those left early by their signatures, or because they were led astray before.
        fruitless: those whose fit has brought nothing.
    """

    ranking: tuple[FittedCandidate, ...]
    tried: tuple[TriedCandidate, ...]
    unfitted: tuple[ScreenedCandidate, ...] = ()
    fruitless: Fruitless = field(default_factory=Fruitless)

    @property
    def is_cut(self) -> bool:
        """Whether the time was up before all candidates were tried."""
        return any(t.outcome is Outcome.NOT_TRIED for t in self.tried)
