"""Mistakes as they happen at a machine, with sizes drawn at random, and what must be suspected first.

``python -m tests.tools.wrong --physical 3`` runs each of them three times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.tools.wrong.place import HARMLESS, TOLD, Files, Said, outcome

Table = np.ndarray
FIT = (
    "residual-depends-on-motion", "residual-above-noise", "residual-slow", "worse-on-held-out", "not-physical",
    "friction-negative", "mass-matrix-indefinite",
)  # fmt: skip
"""Codes of a model that does not explain its data."""
CLOCK = ("clock-late", "clock-early", "command-delay", "sampling-kind")


@dataclass(frozen=True)
class Mistake:
    """One of them.

    Attributes:
        make: changes the files, with random numbers.
        first: codes of which one must be the first reason; words of which one must stand in a refusal before any work.
        may_be_harmless: whether a valid answer with right values will do, with a remark of these codes or none.
    """

    make: Callable[[np.random.Generator, Files], None]
    first: tuple[str, ...]
    words: tuple[str, ...] = ()
    may_be_harmless: bool = False

    def suspects(self, said: Said, expected: Mapping[str, tuple[float, float]]) -> bool:
        """Whether the right thing is suspected first."""
        found = outcome(said, expected)
        if found == HARMLESS:
            return self.may_be_harmless
        if not said.suspects:  # refused before any judgement
            return found == TOLD and any(word in said.text for word in self.words)
        return found == TOLD and said.suspects[0] in self.first


def log(
    change: Callable[[np.random.Generator, Table], Table], *names: str
) -> Callable[[np.random.Generator, Files], None]:
    """A change of tables of numbers, the first column of which is the time; the torque log by default."""

    def make(rng: np.random.Generator, made: Files) -> None:
        for name in names or ("train.csv",):
            rows = made.tables[name]
            changed = change(rng, np.array(rows[1:], dtype=float))
            made.tables[name] = [rows[0], *([f"{value:.9g}" for value in row] for row in changed)]

    return make


def torques(
    change: Callable[[np.random.Generator, Table], Table], *, both: bool = False
) -> Callable[[np.random.Generator, Files], None]:
    """A change of the torques (N, n) of the log that is fitted, or of both."""

    def whole(rng: np.random.Generator, table: Table) -> Table:
        return np.column_stack([table[:, 0], change(rng, table[:, 1:].copy())])

    return log(whole, *(("train.csv", "validation.csv") if both else ()))


def document(name: str, change: Callable[[np.random.Generator, Any], object]) -> Callable[..., None]:
    def make(rng: np.random.Generator, made: Files) -> None:
        change(rng, made.documents[name])

    return make


def _amperes(rng: np.random.Generator, made: Files) -> None:
    """Of motors with gears; of both logs alike."""
    factors = rng.uniform(4.0, 60.0, size=2)
    torques(lambda _, torque: torque / factors, both=True)(rng, made)


def _one_joint(rng: np.random.Generator, torque: Table) -> Table:
    torque[:, int(rng.integers(2))] *= rng.choice([-1.0])
    return torque


def _outlier(rng: np.random.Generator, torque: Table) -> Table:
    torque[int(rng.integers(20, len(torque) - 20)), int(rng.integers(2))] += rng.uniform(5, 50) * np.ptp(torque)
    return torque


def _spikes(rng: np.random.Generator, torque: Table) -> Table:
    at = rng.choice(np.arange(10, len(torque) - 10), size=len(torque) // 100, replace=False)
    torque[at, int(rng.integers(2))] += rng.uniform(3, 9) * np.ptp(torque) * rng.choice([-1, 1], size=at.size)
    return torque


def _stuck(rng: np.random.Generator, torque: Table) -> Table:
    """The logger repeats its last row: of all joints, or of one."""
    begin = int(len(torque) * rng.uniform(0.6, 0.9))
    joints = slice(None) if rng.random() < 0.5 else slice(int(rng.integers(2)), None)
    torque[begin:, joints] = torque[begin, joints]
    return torque


def _clipped(rng: np.random.Generator, torque: Table) -> Table:
    j = int(rng.integers(2))
    limit = rng.uniform(0.5, 0.75) * np.abs(torque[:, j]).max()
    torque[:, j] = torque[:, j].clip(-limit, limit)
    return torque


def _coarse(rng: np.random.Generator, torque: Table) -> Table:
    step = np.ptp(torque, axis=0) / rng.integers(8, 14)
    return np.asarray(np.rint(torque / step) * step)


def _held(rng: np.random.Generator, torque: Table) -> Table:
    count = int(rng.integers(4, 8))
    return np.repeat(torque[::count], count, axis=0)[: len(torque)]


def _constant(rng: np.random.Generator, torque: Table) -> Table:
    torque[:, int(rng.integers(2))] = rng.uniform(-1, 1)
    return torque


def _later(low: float, high: float) -> Callable[[np.random.Generator, Table], Table]:
    def change(rng: np.random.Generator, table: Table) -> Table:
        table[:, 0] += rng.choice([-1, 1]) * rng.uniform(low, high)
        return table[table[:, 0] >= 0]

    return change


def _jitter(rng: np.random.Generator, table: Table) -> Table:
    step = table[1, 0]
    table[1:-1, 0] += step * rng.uniform(-0.3, 0.3, size=len(table) - 2)
    return table


def _degrees(rng: np.random.Generator, table: Table) -> Table:
    table[:, 1:] = np.degrees(table[:, 1:])
    return table


def _velocity(rng: np.random.Generator, made: Files) -> None:
    """In degrees, turned round, or nothing."""
    factor = rng.choice([np.degrees(1.0), -1.0, 0.0])
    at = [k for k, name in enumerate(made.tables["train_reference.csv"][0]) if name.startswith("dq")]

    def change(_: np.random.Generator, table: Table) -> Table:
        table[:, at] *= factor
        return table

    log(change, "train_reference.csv")(rng, made)


def _milliseconds(rng: np.random.Generator, table: Table) -> Table:
    table[:, 0] *= 1000.0
    return table


def _exchanged(*names: str) -> Callable[[np.random.Generator, Files], None]:
    """The first file holds what the second one holds."""

    def make(rng: np.random.Generator, made: Files) -> None:
        made.tables[names[0]] = [list(row) for row in made.tables[names[1]]]

    return make


def _delay(rng: np.random.Generator, case: Any) -> None:
    case["loop"]["delay_samples"] = int(rng.integers(2, 4))


def _single(rng: np.random.Generator, law: Any) -> None:
    law.update(joints=["revolute"], Kp=law["Kp"][:1], Kd=law["Kd"][:1])


def _joint(key: str, low: float, high: float) -> Callable[[np.random.Generator, Any], None]:
    """A length or a gain of the second joint is off by a factor, up or down."""

    def change(rng: np.random.Generator, content: Any) -> None:
        factor = rng.uniform(low, high) ** rng.choice([-1, 1])
        if key == "a":
            content["joints"][1]["a"] = float(factor * content["joints"][1]["a"])
        else:
            content[key] = [content[key][0], float(content[key][1] * factor)]

    return change


def _no_friction(rng: np.random.Generator, robot: Any) -> None:
    j = int(rng.integers(2))
    robot["joints"][j]["effects"].remove("coulomb")
    for key in ("Fc", "v0"):
        del robot["joints"][j]["parameters"][key]
    del robot["identified"][f"Fc{j + 1}"]


def _no_gravity(rng: np.random.Generator, robot: Any) -> None:
    robot["gravity"] = [0.0, 0.0, 0.0]
    robot["identified"] = "computed"


def _averaged(rng: np.random.Generator, made: Files) -> None:
    """A log at a quarter of its rate that holds means of four samples, stamped with the first or the last of them."""
    late = int(rng.choice([0, 3]))

    def change(_: np.random.Generator, table: Table) -> Table:
        whole = table[: len(table) // 4 * 4].reshape(-1, 4, table.shape[1])
        return np.column_stack([whole[:, late, 0], whole[:, :, 1:].mean(axis=1)])

    log(change)(rng, made)
    made.documents["case.yaml"]["train"]["torque"]["rate_hz"] = 25


UNIT = ("drive-gain", "torque-unit", "torque-scale")
PHYSICAL: Mapping[str, Mistake] = {
    "amperes for N.m": Mistake(_amperes, UNIT),
    "mN.m for N.m": Mistake(torques(lambda rng, t: t * rng.choice([1e3, 1e-3]), both=True), UNIT),
    "scale of one joint": Mistake(torques(lambda rng, t: t * [1.0, rng.uniform(1.5, 4) ** rng.choice([-1, 1])]), UNIT),
    "sign of one joint": Mistake(torques(_one_joint), ("torque-sign",)),
    "joints exchanged": Mistake(torques(lambda rng, t: t[:, ::-1]), ("joint-order",)),
    "one outlier": Mistake(torques(_outlier), ("log-outliers", "few-outliers"), may_be_harmless=True),
    "spikes": Mistake(torques(_spikes), ("log-outliers",)),
    "a stuck tail": Mistake(torques(_stuck), ("log-constant",)),
    "a dead channel": Mistake(torques(_constant), ("log-constant",)),
    "a log that is no log": Mistake(torques(lambda rng, t: np.full_like(t, rng.uniform(-1, 1))), ("log-constant",)),
    "clipped": Mistake(torques(_clipped), ("log-saturated",)),
    "coarse": Mistake(torques(_coarse), ("log-coarse",)),
    "held samples": Mistake(torques(_held), ("log-upsampled",)),
    "a late or early clock": Mistake(log(_later(0.015, 0.06)), CLOCK, ("Check the clock",)),
    "a wrong delay": Mistake(document("case.yaml", _delay), CLOCK, ("Correct the delay of the loop",)),
    "averages": Mistake(_averaged, CLOCK),
    "jittered stamps": Mistake(log(_jitter), ("stamps-jitter",)),
    "time in ms": Mistake(log(_milliseconds), ("time-unit",), ("time-unit",)),
    "reference in ms": Mistake(
        log(_milliseconds, "train_reference.csv"), ("time-unit", "reference-rate"), ("time-unit",)
    ),
    "degrees for rad": Mistake(log(_degrees, "train_reference.csv"), ("reference-unit",)),
    "a wrong velocity": Mistake(_velocity, ("reference-derivative",)),
    "the reference of another run": Mistake(
        _exchanged("train_reference.csv", "validation_reference.csv"), ("reference-foreign",)
    ),
    "held out by the same log": Mistake(
        lambda rng, made: (
            [_exchanged(f"validation{k}", f"train{k}")(rng, made) for k in (".csv", "_reference.csv")] and None
        ),
        ("validation-copied",),
    ),
    "a controller of one joint": Mistake(document("controller.yaml", _single), (), ("controller",)),
    "a wrong gain": Mistake(document("controller.yaml", _joint("Kp", 1.5, 3.0)), (*FIT, *CLOCK, *UNIT)),
    "a wrong length": Mistake(document("robot.yaml", _joint("a", 1.2, 1.8)), ("link-length",)),
    "no gravity": Mistake(document("robot.yaml", _no_gravity), ("gravity",)),
    "no friction": Mistake(document("robot.yaml", _no_friction), FIT),
}
