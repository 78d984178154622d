"""How the size of an effect is stated to a person who asks which size data would have shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

Joints = Literal["each", "last", "base", "all"]


@dataclass(frozen=True)
class StatedSize:
    """The unit in which the size of an effect is stated, and the values at which the effect is looked at.

    Without ``shares`` each parameter of the effect is a size of its own.

    Attributes:
        what: the effect in words, with its article.
        unit: of the size as it is shown.
        factor: of these units in one unit of a parameter, SI; NaN where the size is the largest torque of the effect
            along the motion, in per cent of that of its joint.
        largest: size up to which the change of the torque is one to first order; a larger one is not stated.
        shares: amplitude -> the parameter of the joint of which it is the same part as all others of the effect.
        in_log: shape, an instant -> its value, in parts of the log, 0 at its begin and 1 at its end.
        joints: at which it is stated: at each, at the last one, at the base, or of all joints at once.
        is_scale: whether it is one of the torque of its joint, as far as a log shows.
    """

    what: str
    unit: str
    factor: float = float("nan")
    largest: float = 30.0
    shares: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    in_log: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    joints: Joints = "each"
    is_scale: bool = False

    @property
    def is_of_peak(self) -> bool:
        """Whether the size is the largest torque of the effect over that of its joint."""
        return self.factor != self.factor


def of_peak(what: str) -> StatedSize:
    """Stated by the largest torque of the effect."""
    return StatedSize(what, "% of the peak torque")
