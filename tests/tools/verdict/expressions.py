"""Torques that nobody has a name for: products and sums of drawn functions of the motion of the robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from fmu_didim.dynamics.effects import OperatingRange, Parameter, Surroundings, TorqueEffect, Values
from fmu_didim.model.motion import Motion

Range = tuple[float, float]
FUNCTIONS = ("wave", "step", "power", "bump", "dent", "even power")
"""Kinds of functions of one quantity."""
QUANTITIES = ("q", "dq", "ddq", "load", "time", "other q", "other dq")
WEIGHTS = (4, 4, 1, 2, 1, 2, 1)
"""How often each quantity is drawn, in parts."""
TERMS = (0.6, 0.4)
"""Shares of expressions of one term and of two;"""
FACTORS = (0.5, 0.5)
"""of terms of one factor and of two."""
CORNER = 0.01
"""[1] Of the half range of a quantity, within which a corner is round."""
STILL = 1e-6
"""[1] Of its size, up to which a range is none."""


@dataclass(frozen=True)
class Factor:
    """A function of one quantity z in its range, by x = 2 (z - middle) / (high - low).

    Attributes:
        width, place: of the function, in x; sharpness: how often it turns, or its exponent.
    """

    quantity: str
    range: Range
    function: str
    place: float
    sharpness: float

    @staticmethod
    def drawn(rng: np.random.Generator, ranges: Mapping[str, Range]) -> Factor:
        names = [name for name in QUANTITIES if name in ranges]
        weights = np.array([WEIGHTS[QUANTITIES.index(name)] for name in names], dtype=float)
        quantity, function = str(rng.choice(names, p=weights / weights.sum())), str(rng.choice(FUNCTIONS))
        powers = (0.3, 3.0) if "power" in function else (1.0, 15.0)
        sharpness = float(np.exp(rng.uniform(*np.log(powers))))
        return Factor(quantity, ranges[quantity], function, float(rng.uniform(-0.7, 0.7)), sharpness)

    def of(self, at: Surroundings) -> ca.SX:
        """Its value."""
        low, high = self.range
        x = 2 * (self._quantity(at) - 0.5 * (low + high)) / max(high - low, 1e-12)
        if self.function == "wave":
            return ca.sin(self.sharpness * x + 7 * self.place)
        if self.function == "step":
            return ca.tanh(self.sharpness * (x - self.place))
        if self.function == "bump":
            return ca.exp(-((self.sharpness * (x - self.place)) ** 2))
        if self.function == "dent":
            return 1 / (1 + (self.sharpness * (x - self.place)) ** 2)
        size = ca.sqrt(x**2 + CORNER**2)
        return size**self.sharpness if self.function == "even power" else x * size ** (self.sharpness - 1)

    def _quantity(self, at: Surroundings) -> ca.SX:
        other = at.joint + 1 if at.joint + 1 < at.all_q.shape[0] else at.joint - 1
        return {
            "q": at.q, "dq": at.dq, "ddq": at.ddq, "load": at.load, "time": at.time, "other q": at.all_q[other],
            "other dq": at.all_dq[other],
        }[self.quantity]  # fmt: skip

    def __str__(self) -> str:
        return f"{self.function} of {self.quantity} (at {self.place:.2f}, {self.sharpness:.2g})"


def drawn_effect(rng: np.random.Generator, ranges: Mapping[str, Range]) -> type[TorqueEffect]:
    """An effect whose torque is a drawn expression of quantities in these ranges, times its amplitude."""
    terms = [
        [Factor.drawn(rng, ranges) for _ in range(1 + int(rng.choice(2, p=FACTORS)))]
        for _ in range(1 + int(rng.choice(2, p=TERMS)))
    ]
    weights = rng.uniform(0.3, 1, len(terms))
    return _effect(terms, weights.tolist())


def _effect(terms: Sequence[Sequence[Factor]], weights: Sequence[float]) -> type[TorqueEffect]:
    used = {factor.quantity for term in terms for factor in term}
    fastest = max(factor.sharpness * 2 / (factor.range[1] - factor.range[0]) for term in terms for factor in term)
    kinds = {"load": "load", "time": "time", "other q": "other joints", "other dq": "other joints"}

    class Drawn(TorqueEffect):
        name = "drawn"
        title = "Drawn expression"
        equation = " + ".join(" times ".join(map(str, term)) for term in terms)
        signature = experiment = source = ""
        needs = frozenset(kinds[quantity] for quantity in used if quantity in kinds)
        own_parameters = (Parameter("Fdrawn", "torque", "amplitude"),)

        def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
            found = ca.SX(0)
            for weight, term in zip(weights, terms, strict=True):
                product = ca.SX(weight)
                for factor in term:
                    product = product * factor.of(at)
                found = found + product
            return (found,)

        def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
            return ca.fabs(parameters["Fdrawn"]) * fastest

    return Drawn


def ranges_of(motion: Motion, joint: int) -> dict[str, Range]:
    """Quantity -> range along a motion, of a joint from 0; of those that move."""
    other = joint + 1 if joint + 1 < motion.joint_count else joint - 1
    signals = {
        "q": motion.q[:, joint], "dq": motion.dq[:, joint], "ddq": motion.ddq[:, joint], "load": motion.load[:, joint],
        "time": motion.time,
    }  # fmt: skip
    if other >= 0:
        signals |= {"other q": motion.q[:, other], "other dq": motion.dq[:, other]}
    ranges = {name: (float(signal.min()), float(signal.max())) for name, signal in signals.items()}
    return {name: (low, high) for name, (low, high) in ranges.items() if high - low > STILL * max(abs(low), abs(high))}
