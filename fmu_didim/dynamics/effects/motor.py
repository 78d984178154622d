"""The motor and the gear of a joint, and how often what they do repeats along the joint.

With the turns N of the motor in one of the joint, p pole pairs and s slots, what repeats k times in a mechanical turn
of the motor has the spatial frequency k N along the joint, in 1 (rad/m of a slide), and

    mechanical, k in a turn of the motor           k N          gear, bearings, encoder of the motor
    electrical, k in an electrical turn            k p N        current sensors and commutation
    cogging, of slots and poles                    lcm(s, 2 p) N

Sources: Holtz and Springob, Identification and compensation of torque ripple in high-precision permanent magnet motor
drives, IEEE TIE 43 (1996), for the offset (k = 1) and the gain (k = 2) of current sensors and k = 6, 12 of flux and
commutation; Gieras, Permanent magnet motor technology, for cogging; Tuttle and Seering, A nonlinear model of a harmonic
drive gear transmission, IEEE TRA 12 (1996), for the two waves of a harmonic drive in a turn of the motor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from pydantic import model_validator

from fmu_didim.base.documents import Count, Positive, Strict

IN_A_TURN = (1, 2)
"""Orders of the errors of gears, bearings and encoders in a turn of the motor."""
IN_AN_ELECTRICAL_TURN = {
    1: "offset of a current sensor", 2: "gains of the current sensors", 6: "commutation", 12: "commutation",
}  # fmt: skip
"""Order of a ripple of the current or the flux in an electrical turn -> where it mostly comes from."""


@dataclass(frozen=True)
class Harmonic:
    """One of the spatial frequencies that a drive has.

    Attributes:
        frequency: in 1 (rad/m of a slide), along the joint; name: what it is of.
    """

    frequency: float
    name: str


class Motor(Strict):
    """The motor of a joint and its gear, as data sheets state them.

    Attributes:
        gear_ratio: turns of the motor in one of the joint, 1 of a direct drive; of a prismatic joint rad of the motor
            for 1 m. As the makers of gears count teeth: a ratio that is rounded by a percent is another one.
        pole_pairs: pairs of poles of a synchronous motor, electrical turns in one of the motor.
        slots: of its stator, for cogging, which repeats as often as slots and poles meet; not without ``pole_pairs``.
    """

    gear_ratio: Positive
    pole_pairs: Count | None = None
    slots: Count | None = None

    @model_validator(mode="after")
    def _poles_of_slots(self) -> Motor:
        if self.slots is not None and self.pole_pairs is None:
            raise ValueError(
                f"slots: {self.slots} tell nothing without pole_pairs: cogging repeats lcm(slots, 2*pole_pairs) times "
                "in a turn of the motor; add pole_pairs, or leave slots out"
            )
        return self

    def stated(self) -> str:
        """What is known, by the names of a robot description: ``gear_ratio: 100, pole_pairs: 4``."""
        return ", ".join(f"{name}: {value:g}" for name, value in self.model_dump(exclude_none=True).items())

    def mechanical(self, cause: str) -> list[Harmonic]:
        """Of a cause that repeats once or twice in a turn of the motor."""
        return [Harmonic(k * self.gear_ratio, f"{k} in a turn of the motor: {cause}") for k in IN_A_TURN]

    def electrical(self) -> list[Harmonic]:
        """Of current and flux; none where the poles are not known."""
        turns = self.gear_ratio * (self.pole_pairs or 0)
        return [
            Harmonic(k * turns, f"{k} in an electrical turn: {cause}")
            for k, cause in IN_AN_ELECTRICAL_TURN.items() if turns
        ]  # fmt: skip

    def cogging(self) -> list[Harmonic]:
        """Of slots and poles; none where these are not known."""
        if self.slots is None or self.pole_pairs is None:
            return []
        poles = 2 * self.pole_pairs
        count = math.lcm(self.slots, poles)
        return [
            Harmonic(count * self.gear_ratio, f"lcm({self.slots}, {poles}) = {count} in a turn of the motor: cogging")
        ]

    def ripples(self) -> tuple[Harmonic, ...]:
        """All that shows as a ripple of the torque."""
        return distinct([*self.mechanical("gear or bearings"), *self.electrical(), *self.cogging()])


def distinct(harmonics: Iterable[Harmonic]) -> tuple[Harmonic, ...]:
    """The harmonics by their frequencies, those of one frequency as one with the names of all."""
    names: dict[float, list[str]] = {}
    for one in harmonics:
        names.setdefault(one.frequency, []).append(one.name)
    return tuple(Harmonic(frequency, "; or ".join(own)) for frequency, own in sorted(names.items()))
