"""Pairs of logs of a machine, before and after something has happened to it, from the simulator of the blind cases.

It shares no code with the package. Robots are the SCARA and the vertical arm that ship, with other values each time.
Sizes are those at which somebody would look at the machine, whether a log shows them or not:

| cause | what changes | range | why |
|---|---|---|---|
| payload | point mass on the last link | 10 to 40 % of its moment of inertia about its axis | another tool |
| temperature | dry and viscous friction of all joints, two factors | 1.25 to 1.5 and 1.5 to 2.5 | a cold start |
| friction | both of one joint | 1.3 to 1.6 and 1.5 to 2.5 | a bearing that runs dry |
| backlash | a gap in the gear of a joint | 4 to 12 mrad | 14 to 41 arc minutes: gears are sold with 1 to 20 |
| belt | natural frequency of the motor on a belt that was stiff | 12 to 18 Hz | within what the loop follows |
| torque constant | torque of a drive over its command | 6 to 15 % less | magnets that were too hot lose as much |
| controller gain | both gains of a joint | 35 to 60 % up or down | somebody has set them anew |
| clock | stamps of the torque log are late | 6 to 20 ms | one to four ticks of the controller |

A quarter of the pairs are the other way round, as after a repair.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from tests.tools.blind.simulator.describe import case_document
from tests.tools.blind.simulator.design import SPREAD, Design, Motion, development_design, random_motion
from tests.tools.blind.simulator.equations import root_mean_square
from tests.tools.blind.simulator.hidden import Form
from tests.tools.blind.simulator.make import NOISE, Hidden, Plant, instants, noise

Array = np.ndarray
SCARA = {
    "ZZ1R": 3.43, "ZZ2": 0.043, "MX2": 0.241, "MY2": 0.014, "Ia2": 0.02, "Fv1": 0.3, "Fc1": 0.82, "Fv2": 0.013,
    "Fc2": 0.137,
}  # fmt: skip
"""Of its description; with a rotor of the second drive, without which a gear means nothing, and a viscous friction of
the first joint that a log shows."""
RATES = (20, 100)
OTHER_MOTION, CLUTTERED, REPAIRED = 0.4, 0.25, 0.25
"""[1] Share of pairs with another motion after, with small effects that no model has, and the other way round."""
STIFF_HZ = 60.0
"""[Hz] First natural frequency of a tight belt: beyond what logs at 20 and 100 Hz show."""


@dataclass(frozen=True)
class Change:
    """What has happened.

    Attributes:
        cause: a name of :data:`CAUSES`; joint: from 1, 0 of none; size: its figure, in words.
    """

    cause: str
    joint: int
    size: str


@dataclass(frozen=True)
class Pair:
    """Two logs.

    Attributes:
        robot: ``scara`` or ``arm``; rate_hz: of the torque; clutter, other_motion, repaired: as the shares say.
        changes: none, one or two. before, after: the machine; motions: of both.
    """

    number: int
    robot: str
    rate_hz: int
    clutter: bool
    other_motion: bool
    repaired: bool
    changes: tuple[Change, ...]
    before: Plant
    after: Plant
    motions: tuple[Motion, Motion]
    seed: int


Drawn = tuple[Plant, str]
Cause = Callable[[np.random.Generator, Plant, int], Drawn]


def _with(plant: Plant, **values: float) -> Plant:
    return replace(plant, design=replace(plant.design, true=plant.design.true | values))


def _hidden(plant: Plant, cause: str, joint: int, size: str, form: Form) -> Drawn:
    return replace(plant, hidden=(*plant.hidden, Hidden(cause, joint - 1, form, 1.0))), size


def _payload(rng: np.random.Generator, plant: Plant, joint: int) -> Drawn:
    true, length = plant.design.true, plant.design.length
    x, y = rng.uniform(0.1, 0.35), rng.uniform(-0.1, 0.1)
    mass = rng.uniform(0.1, 0.4) * true["ZZ2"] / (x * x + y * y)
    moved = {"ZZ1R": mass * length**2, "ZZ2": mass * (x * x + y * y), "MX2": mass * x, "MY2": mass * y}
    if "MX1" in true:
        moved["MX1"] = mass * length
    changed = _with(plant, **{name: true[name] + value for name, value in moved.items()})
    return changed, f"{mass:.2f} kg at ({x:.2f}, {y:.2f}) m"


def _rubbing(rng: np.random.Generator, plant: Plant, dry: float, viscous: float, *joints: int) -> Drawn:
    factor = {"Fc": dry, "Fv": viscous}
    true = plant.design.true
    moved = {f"{stem}{j}": true[f"{stem}{j}"] * f for stem, f in factor.items() for j in joints}
    return _with(plant, **moved), f"Fc x {dry:.2f}, Fv x {viscous:.2f}"


def _temperature(rng: np.random.Generator, plant: Plant, joint: int) -> Drawn:
    return _rubbing(rng, plant, rng.uniform(1.25, 1.5), rng.uniform(1.5, 2.5), *range(1, plant.design.count + 1))


def _friction(rng: np.random.Generator, plant: Plant, joint: int) -> Drawn:
    return _rubbing(rng, plant, rng.uniform(1.3, 1.6), rng.uniform(1.5, 2.5), joint)


def _rotor(plant: Plant, joint: int) -> float:
    """kg.m2, of the motor: of the first joint a third of all that it turns."""
    return plant.design.true["ZZ1R"] / 3 if joint == 1 else plant.design.true["Ia2"]


def _gear(plant: Plant, joint: int, hz: float, damping: float) -> dict[str, float]:
    rotor = _rotor(plant, joint)
    stiffness = rotor * (2 * np.pi * hz) ** 2
    return {"GEAR_STIFFNESS": stiffness, "GEAR_DAMPING": damping * float(np.sqrt(stiffness * rotor)), "ROTOR": rotor}


def _backlash(rng: np.random.Generator, plant: Plant, joint: int) -> Drawn:
    gap = rng.uniform(0.004, 0.012)
    fields = _gear(plant, joint, STIFF_HZ, 0.6) | {"GEAR_GAP": gap}
    return _hidden(plant, "backlash", joint, f"{1e3 * gap:.1f} mrad", Form("", 1.0, 1.0, lambda a: fields))


def _belt(rng: np.random.Generator, plant: Plant, joint: int) -> Drawn:
    hz, damping = rng.uniform(12.0, 18.0), rng.uniform(0.02, 0.1)
    fields = _gear(plant, joint, hz, damping)
    return _hidden(plant, "belt", joint, f"{hz:.1f} Hz", Form("", 1.0, 1.0, lambda a: fields))


def _torque_constant(rng: np.random.Generator, plant: Plant, joint: int) -> Drawn:
    gain = 1 - rng.uniform(0.06, 0.15)
    form = Form("", 1.0, 1.0, lambda a: {"DRIVE_GAIN": gain})
    return _hidden(plant, "torque constant", joint, f"x {gain:.3f}", form)


def _controller(rng: np.random.Generator, plant: Plant, joint: int) -> Drawn:
    gain = float(1 + rng.uniform(0.35, 0.6) * rng.choice([-1, 1]))
    form = Form("", 1.0, 1.0, lambda a: {"KP_FACTOR": gain, "KD_FACTOR": gain})
    return _hidden(plant, "controller gain", joint, f"x {gain:.2f}", form)


def _clock(rng: np.random.Generator, plant: Plant, joint: int) -> Drawn:
    late = rng.uniform(0.006, 0.02)
    form = Form("", 1.0, 1.0, log_shift_s=lambda a: late)
    return _hidden(plant, "clock", 1, f"{1e3 * late:.1f} ms", form)


CAUSES: Mapping[str, Cause] = {
    "payload": _payload, "temperature": _temperature, "friction": _friction, "backlash": _backlash, "belt": _belt,
    "torque constant": _torque_constant, "controller gain": _controller, "clock": _clock,
}  # fmt: skip
OF_MACHINE = ("payload", "temperature", "clock")
"""Those of no joint."""
APART = ({"temperature", "friction"}, {"backlash", "belt"})
"""Of which no two are drawn together: one is a part of the other, or takes its place."""
NOTHING, TWO = "nothing", "two"
PLAN = (NOTHING, *CAUSES, NOTHING, TWO, NOTHING, TWO, NOTHING, TWO, NOTHING, NOTHING, NOTHING)
"""What the pairs of one round are: seven of nothing, one of each cause, three of two causes."""


def draw(number: int, seed: int) -> Pair:
    """Pair of a number, counted from 0: the same each time with the same seed."""
    rng = np.random.default_rng([seed, number])
    wanted, rate = PLAN[number % len(PLAN)], RATES[(number + number // len(PLAN)) % len(RATES)]
    while True:
        robot = str(rng.choice(["scara", "arm"]))
        design = replace(scara(rng) if robot == "scara" else development_design(rng), periods=1)
        before = Plant(design, clutter=rng.random() < CLUTTERED)
        first = random_motion(rng, before.design)
        second = random_motion(rng, before.design) if rng.random() < OTHER_MOTION else first
        after, changes = before, list[Change]()
        for cause in _causes(rng, wanted):
            joint = 0 if cause in OF_MACHINE else int(rng.integers(1, before.design.count + 1))
            after, size = CAUSES[cause](rng, after, joint)
            changes.append(Change(cause, joint, size))
        repaired = bool(changes) and rng.random() < REPAIRED
        plants = (after, before) if repaired else (before, after)
        pair = Pair(
            number, robot, rate, before.clutter, second is not first, repaired, tuple(changes), *plants,
            (first, second), seed,
        )  # fmt: skip
        if is_calm(before, first) and is_calm(after, second):
            return pair


def _causes(rng: np.random.Generator, wanted: str) -> tuple[str, ...]:
    if wanted == NOTHING:
        return ()
    while wanted == TWO:
        both = tuple(str(cause) for cause in rng.choice(list(CAUSES), 2, replace=False))
        if not any(set(both) <= apart for apart in APART):
            return both
    return (wanted,)


def scara(rng: np.random.Generator) -> Design:
    true = {name: value * (1 + SPREAD * rng.uniform(-1, 1)) for name, value in SCARA.items()}
    return Design(0.5, (0.0, 0.0), (0.0, 0.0, 0.0), dict(SCARA), true, (3700.0, 62.0), (230.0, 4.0), encoder_bits=22)


def is_calm(plant: Plant, motion: Motion) -> bool:
    """Whether the loop follows its motion and its command does not rattle: else nobody would have kept the log."""
    found, _ = plant.simulate(motion)
    error = np.abs(found.q - motion.at(instants(plant.design))[0]).max()
    rough = root_mean_square(np.diff(found.command, n=2, axis=0)) / root_mean_square(found.command)
    return bool(error < 0.15 and rough.max() < 0.1)


def write(pair: Pair, folder: Path) -> None:
    """Both logs as blind cases in ``before`` and ``after``, and what is true in ``truth.json``."""
    rng = np.random.default_rng([pair.seed, pair.number, 1])
    deviation = None
    for place, plant, motion in (("before", pair.before, pair.motions[0]), ("after", pair.after, pair.motions[1])):
        logged = plant.simulate(motion)[1]
        deviation = NOISE * root_mean_square(logged) if deviation is None else deviation  # of one sensor
        write_log(folder / place, plant, motion, logged + noise(rng, plant.design, deviation), pair.rate_hz)
    truth = {
        key: getattr(pair, key) for key in ("number", "seed", "robot", "rate_hz", "clutter", "other_motion", "repaired")
    } | {"changes": [asdict(change) for change in pair.changes]}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")


REFERENCE, STILL, LATER = 8, 2, 2
"""[logs] Of a history: of the reference, of the same machine after it, and of the changed one."""
DAY_TO_DAY = 0.03
"""[1] Standard deviation of the dry friction of each joint from log to log: grease and room are not the same."""


def write_history(number: int, seed: int, folder: Path) -> None:
    """A pair as a history: logs by date along the first motion, and what is true in ``truth.json``."""
    pair = draw(number, seed)
    pair = replace(pair, motions=(pair.motions[0], pair.motions[0]), other_motion=False)
    write(pair, folder)
    rng = np.random.default_rng([seed, number, 2])
    deviation = NOISE * root_mean_square(pair.before.simulate(pair.motions[0])[1])
    (folder / "logs").mkdir()
    for day in range(REFERENCE + STILL + LATER):
        plant = pair.after if day >= REFERENCE + STILL else pair.before
        true = plant.design.true
        varied = {name: true[name] * (1 + DAY_TO_DAY * rng.normal()) for name in true if name.startswith("Fc")}
        plant = _with(plant, **varied)
        torque = plant.simulate(pair.motions[0])[1] + noise(rng, plant.design, deviation)
        write_torque(folder / "logs" / f"axes_2024-05-{day + 1:02d}.csv", plant, torque, pair.rate_hz)


def write_torque(path: Path, plant: Plant, torque: Array, rate_hz: int) -> None:
    """A table of the torque."""
    rows = np.column_stack([instants(plant.design), torque])[:: plant.design.rate_hz // rate_hz]
    table(path, rows, ["t", *(f"tau{j}" for j in range(1, plant.design.count + 1))])


def write_log(folder: Path, plant: Plant, motion: Motion, torque: Array, rate_hz: int) -> None:
    """A log as a blind case."""
    folder.mkdir(parents=True, exist_ok=True)
    design, time = plant.design, instants(plant.design)
    joints = range(1, design.count + 1)
    rows = np.column_stack([time, *motion.at(time)])
    table(folder / "train_reference.csv", rows, ["t", *(f"{s}{j}" for s in ("q", "dq") for j in joints)])
    write_torque(folder / "train_torque.csv", plant, torque, rate_hz)
    content = yaml.safe_dump(case_document(design, rate_hz), sort_keys=False)
    (folder / "case.yaml").write_text(content, encoding="utf-8")


def table(path: Path, values: Array, names: list[str]) -> None:
    """A file of columns."""
    np.savetxt(path, values, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
