"""Plants with a ripple at a harmonic of a motor, or with none, and what a user states of the motor."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.tools.blind.simulator.hidden import Form, Maker, Surroundings
from tests.tools.blind.simulator.make import make_plant, write_cases
from tests.tools.blind.translate import translate

Motor = Mapping[str, float]
MOTORS: tuple[tuple[Motor, tuple[int, ...]], ...] = (
    ({"gear_ratio": 1, "pole_pairs": 8, "slots": 9}, (8, 48, 96, 144)),
    ({"gear_ratio": 20, "pole_pairs": 4, "slots": 12}, (40, 80, 160)),
    ({"gear_ratio": 50, "pole_pairs": 3, "slots": 9}, (50, 100, 150)),
    ({"gear_ratio": 5, "pole_pairs": 5, "slots": 12}, (10, 50, 150)),
)
"""Motors with their gears, and ripples in a turn of the joint that they have: a direct drive, a belt, a harmonic drive,
a planetary gear."""
WRONG = 0.9
"""[1] Times the gear ratio that is stated where it is stated wrongly."""
STATED = ("nothing", "right", "wrong")


OTHER_LEVEL = 2.0
"""[standard deviations] Gap of an effect that is no ripple."""


@dataclass(frozen=True)
class Drawn:
    """A plant: its seed, the gap of its ripple in standard deviations of the noise (0: none), the torque rate in Hz,
    and whether something else is hidden."""

    seed: int
    level: float
    rate: int
    other: bool = False

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{'o' if self.other else 'r'}{self.seed:03d}_{100 * self.level:03.0f}_{self.rate}hz"


def make_other(folder: Path, effect: str, seed: int, rates: tuple[int, ...]) -> None:
    """Write the folders of a plant that hides another effect than a ripple."""
    rng = np.random.default_rng([seed, zlib.crc32(effect.encode())])
    plant, motion, deviation = make_plant((effect,), rng, level=OTHER_LEVEL, clutter=bool(seed % 2))
    drawn = [Drawn(seed, 0.0, rate, other=True) for rate in rates]
    write_cases([(folder / d.name, d.rate) for d in drawn], plant, motion, deviation, rng)
    for d in drawn:
        known = {"motor": dict(MOTORS[seed % len(MOTORS)][0]), "hidden": []}
        (folder / d.name / "motor.json").write_text(json.dumps(known))


def make(folder: Path, seed: int, level: float, rates: tuple[int, ...]) -> None:
    """Write the folders of one plant, one for each torque rate; ``motor.json`` beside the truth has its motor."""
    rng = np.random.default_rng([seed, round(100 * level), zlib.crc32(b"known ripples")])
    motor, counts = MOTORS[seed % len(MOTORS)]
    count = int(rng.choice(counts))

    def ripple(rng: np.random.Generator, s: Surroundings) -> Form:
        phase = rng.uniform(0, 2 * np.pi)
        fixed = {"RIPPLE_NUMBER": float(count)}
        return Form(
            f"a sin({count} q + p)", 0.1 * s.dry, 20 * s.dry,
            lambda a: {"RIPPLE_SINE": a * np.cos(phase), "RIPPLE_COSINE": a * np.sin(phase), **fixed},
        )  # fmt: skip

    forms: Mapping[str, Maker] = {"torque_ripple": ripple}
    effects = ("torque_ripple",) if level else ()
    plant, motion, deviation = make_plant(effects, rng, level=level, forms=forms, clutter=bool(seed % 2))
    drawn = [Drawn(seed, level, rate) for rate in rates]
    write_cases([(folder / d.name, d.rate) for d in drawn], plant, motion, deviation, rng)
    hidden = [{"joint": h.joint + 1, "count": count} for h in plant.hidden]
    for d in drawn:
        (folder / d.name / "motor.json").write_text(json.dumps({"motor": dict(motor), "hidden": hidden}))


def stated(folder: Path, work: Path, what: str) -> Path:
    """The case of a folder for ``fmu-didim``; its description states nothing of the motors, or rightly, or wrongly."""
    case = translate(folder, work)
    if what != "nothing":
        motor = dict(json.loads((folder / "motor.json").read_text())["motor"])
        if what == "wrong":
            motor["gear_ratio"] *= WRONG
        robot: dict[str, Any] = yaml.safe_load((work / "robot.yaml").read_text())
        for joint in robot["joints"]:
            joint["motor"] = motor
        (work / "robot.yaml").write_text(yaml.safe_dump(robot, sort_keys=False))
    return case
