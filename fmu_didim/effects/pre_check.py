"""How effects are looked for to which linear screening is blind."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PreCheck:
    """Values of the one parameter of an effect, tried in full simulations before all other effects.

    Attributes:
        parameter: its name; in N.m or N.
        quantiles: of the absolute measured torque of the joint, which are tried as its values.
    """

    parameter: str
    quantiles: tuple[float, ...]
