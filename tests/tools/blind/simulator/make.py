"""Case folders with a hidden effect, laid out like those the method was developed on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml

from tests.tools.blind.simulator.describe import case_document, truth_document
from tests.tools.blind.simulator.design import Design, Motion, development_design, random_motion, varied_design
from tests.tools.blind.simulator.equations import after_refit, base_columns, root_mean_square
from tests.tools.blind.simulator.hidden import (
    CURVES,
    EFFECTS,
    GEARS,
    HARMONIC_DRIVE,
    LIMITS,
    UNKNOWN,
    Form,
    Maker,
    Surroundings,
)
from tests.tools.blind.simulator.native import Run, SimulationFailedError, run

Array = np.ndarray
NOISE = 0.014
"""Standard deviation of the torque noise, as a part of the RMS torque of its joint."""
COLOURED, CORRELATION_S = 0.75, 0.011
"""Share of the variance that an AR(1) process carries, and its correlation time; the rest is white."""
LOUDEST = 2.0
"""[times the gap that is asked for] A plant that no amplitude brings below this is refused: a gear that rings with the
sampled controller leaves a hundred deviations of the noise, however stiff it is, and says nothing of the effect."""


@dataclass(frozen=True)
class Hidden:
    """A form at an amplitude on a joint (from 0)."""

    effect: str
    joint: int
    form: Form
    amplitude: float


@dataclass(frozen=True)
class Plant:
    """A design with what is hidden in it.

    Attributes:
        clutter: whether the small planted effects act.
    """

    design: Design
    hidden: tuple[Hidden, ...] = ()
    clutter: bool = True

    def simulate(self, motion: Motion, *, quantised: bool = True) -> tuple[Run, Array]:
        """A run at the control rate, and the logged torque (N, n) without noise.

        Raises:
            SimulationFailedError: the loop diverged.
        """
        d = self.design
        time = instants(d)
        step = d.encoder_step if quantised else 0.0
        robot = {**d.counter_clockwise(), "LENGTH": d.length}
        robot |= {"GRAVITY_X": d.plane_gravity[0], "GRAVITY_Y": d.plane_gravity[1]}
        joints, shift = [self._own(j) for j in range(d.count)], np.zeros(d.count)
        for item in self.hidden:
            joints[item.joint] |= item.form.joint(item.amplitude)
            robot |= item.form.robot(item.amplitude)
            shift += item.form.log_shift_s(item.amplitude)  # a log has one clock
        found = run(
            motion.at(time), period_s=1 / d.rate_hz, sign=d.sign, robot=robot, joints=tuple(joints),
            gains=np.array([[kp, kd, step] for kp, kd in zip(d.Kp, d.Kd, strict=True)]),
        )  # fmt: skip
        logged = found.command
        if shift.any():
            logged = np.column_stack([np.interp(time - s, time, c) for s, c in zip(shift, logged.T, strict=True)])
        return found, logged

    def _own(self, j: int) -> dict[str, float]:
        true = self.design.true
        dry = true[f"Fc{j + 1}"]
        fields = {"FV": true[f"Fv{j + 1}"], "FC": dry, "ROTOR": true.get(f"Ia{j + 1}", 0.0)}
        if self.clutter:
            fields |= {"CLUTTER_RIPPLE": 0.06 * dry, "CLUTTER_NUMBER": (17.0, 23.0)[j]}
            fields |= {"CLUTTER_STRIBECK": 0.05 * dry, "CLUTTER_DRIFT": 0.03 / 20}
        return fields


@dataclass(frozen=True)
class Gap:
    """Size of the hidden effects in the noise's standard deviation, each (n,).

    Attributes:
        plain: RMS of the difference of the noise-free logs with and without them.
        refitted: the same after the base parameters absorbed what they can.
    """

    plain: Array
    refitted: Array


def instants(design: Design) -> Array:
    """Times of the control ticks, s."""
    count = round(design.period_s * design.periods * design.rate_hz)
    return np.arange(count) / design.rate_hz


def gap(plant: Plant, motion: Motion, deviation: Array, others: tuple[Hidden, ...] = ()) -> Gap:
    """How far the hidden effects move the torque of a run, beside others of them that act in both."""
    d = plant.design
    without, bare = replace(plant, hidden=others).simulate(motion, quantised=False)
    _, logged = plant.simulate(motion, quantised=False)
    difference = logged - bare
    turned = [d.sign * x for x in (without.q, without.dq, without.ddq)]
    columns = base_columns(*turned, length=d.length, gravity=d.plane_gravity)
    left = after_refit(difference * d.sign, columns, deviation)
    return Gap(root_mean_square(difference / deviation), root_mean_square(left))


def beside(plant: Plant, motion: Motion, deviation: Array) -> list[float]:
    """The gap that each hidden effect makes beside the others after refitting the base, at its worst joint: what alone
    meets a limit may not do so where others act. Infinite where the others alone cannot be simulated."""
    sizes = []
    for item in plant.hidden:
        others = tuple(other for other in plant.hidden if other is not item)
        try:
            sizes.append(float(gap(plant, motion, deviation, others).refitted.max()))
        except SimulationFailedError:
            sizes.append(float("inf"))
    return sizes


def tuned(plant: Plant, item: Hidden, motion: Motion, deviation: Array, level: float) -> tuple[Hidden, float]:
    """The effect at the amplitude whose refitted gap beside what the plant hides, at its worst joint, is ``level`` (or
    at its limit), and that gap: infinite where no amplitude could be simulated."""
    best, reached, distance, amplitude, limit = item, np.inf, np.inf, item.amplitude, item.form.limit
    below: tuple[float, float] | None = None
    above: tuple[float, float] | None = None
    for _ in range(12):
        try:
            trial = replace(plant, hidden=(*plant.hidden, replace(item, amplitude=amplitude)))
            size = max(float(gap(trial, motion, deviation, plant.hidden).refitted.max()), 1e-9)
        except SimulationFailedError:
            limit = 0.8 * amplitude
            amplitude *= 0.6
            continue
        error = abs(np.log(size / level))
        if error < distance:
            best, reached, distance = replace(item, amplitude=amplitude), size, error
        if error < 0.05 or (size < level and amplitude >= limit):
            break
        if size < level:
            below = (amplitude, size)
        else:
            above = (amplitude, size)
        if below is not None and above is not None:
            # Between the two, on a straight line of the logarithms.
            part = np.log(level / below[1]) / np.log(above[1] / below[1])
            amplitude = below[0] * (above[0] / below[0]) ** float(np.clip(part, 0.1, 0.9))
        else:
            amplitude = min(amplitude * float(np.clip(level / size, 0.3, 4.0)), limit)
    return best, reached


def _surroundings(plant: Plant, motion: Motion, joint: int, rng: np.random.Generator) -> Surroundings:
    d = plant.design
    found, _ = plant.simulate(motion)
    true = d.true
    inertia = true["ZZ1R"] if joint == 0 else true["ZZ2"] + true["Ia2"]
    return Surroundings(
        joint=joint, n=d.count, duration_s=d.period_s * d.periods, period_s=d.period_s,
        dry=true[f"Fc{joint + 1}"], viscous=true[f"Fv{joint + 1}"], inertia=inertia,
        rotor=rng.uniform(0.25, 0.45) * inertia if joint == 0 else true["Ia2"],
        q=motion.at(instants(d))[0][:, joint], command=float(np.abs(found.command[:, joint]).max()),
        gravity=d.plane_gravity, commands=found.command[:, joint], speeds=found.dq[:, joint],
    )  # fmt: skip


def make_plant(
    effects: Sequence[str], rng: np.random.Generator, *, level: float, robots: str = "varied", clutter: bool = True,
    one_joint: bool = False, reach: float = 1.0, forms: Mapping[str, Maker] = MappingProxyType({}),
) -> tuple[Plant, Motion, Array]:  # fmt: skip
    """A plant that hides these effects at a gap, its training motion, and the noise's standard deviation (n,).

    Args:
        one_joint: whether all act on one joint, as those of a harmonic drive do; the gap of each is then that beside
            those before it. Else they go to one joint after the other.
        reach: times the limit of an effect up to which it may grow: the gap of a gain that is off by less than a half
            is mostly below what is judged.
        forms: effect -> another form of it than that of the catalogue of the simulator.

    Raises:
        SimulationFailedError: no amplitude of an effect brings its gap near that level (:data:`LOUDEST`).
    """
    plant, motion = _steady(rng, effects, robots, clutter)
    design = plant.design
    deviation = NOISE * root_mean_square(plant.simulate(motion)[1])
    makers = {**EFFECTS, **UNKNOWN, **CURVES, **GEARS, **LIMITS, **forms}
    order, one_joint = rng.permutation(design.count), one_joint or tuple(effects) == HARMONIC_DRIVE
    items: list[Hidden] = []
    for i, effect in enumerate(effects):
        joint = int(order[0 if one_joint else i % design.count])
        form = makers[effect](rng, _surroundings(plant, motion, joint, rng))
        form = replace(form, limit=reach * form.limit)
        present = replace(plant, hidden=tuple(items) if one_joint else ())
        item, size = tuned(present, Hidden(effect, joint, form, form.start), motion, deviation, level)
        if size > LOUDEST * level:
            raise SimulationFailedError(
                f"no amplitude of {effect} brings its gap near {level:g} deviations of the noise"
            )
        items.append(item)
    return replace(plant, hidden=tuple(items)), motion, deviation


def _steady(rng: np.random.Generator, effects: Sequence[str], robots: str, clutter: bool) -> tuple[Plant, Motion]:
    """A design whose sampled loop is well damped: its tracking error is small, and its command calm."""
    while True:
        design = development_design(rng) if robots == "development" else varied_design(rng, joints=_needed(effects))
        motion = random_motion(rng, design)
        plant = Plant(design, clutter=clutter)
        try:
            found, _ = plant.simulate(motion)
        except SimulationFailedError:
            continue
        error = np.abs(found.q - motion.at(instants(design))[0]).max()
        rough = root_mean_square(np.diff(found.command, n=2, axis=0)) / root_mean_square(found.command)
        if error < 0.15 and rough.max() < 0.1 * 200 / design.rate_hz:
            return plant, motion


def _needed(effects: Sequence[str]) -> int | None:
    """Two joints, for what one joint cannot show."""
    coupled = {"base_tilt", "drive_gain", "unknown_coupling", "unknown_neighbour"} & set(effects)
    return 2 if coupled or len(effects) > 1 else None


def noise(rng: np.random.Generator, design: Design, deviation: Array) -> Array:
    """Coloured noise (N, n) at the control rate: AR(1) plus white."""
    count = instants(design).size
    factor = float(np.exp(-1 / (design.rate_hz * CORRELATION_S)))
    drive = rng.normal(size=(count, deviation.size)) * np.sqrt(1 - factor**2)
    coloured = np.empty_like(drive)
    last = rng.normal(size=deviation.size)
    for k in range(count):
        last = factor * last + drive[k]
        coloured[k] = last
    white = rng.normal(size=drive.shape)
    return deviation * (np.sqrt(COLOURED) * coloured + np.sqrt(1 - COLOURED) * white)


def _run(plant: Plant, path: Motion, rng: np.random.Generator) -> tuple[Motion, Array]:
    """A motion on which the plant can be simulated, this one or another, and its logged torque (N, n)."""
    for _ in range(20):
        try:
            return path, plant.simulate(path)[1]
        except SimulationFailedError:
            path = random_motion(rng, plant.design)
    raise SimulationFailedError("no motion of twenty could be simulated")


def write_cases(
    folders: Sequence[tuple[Path, int]], plant: Plant, motion: Motion, deviation: Array, rng: np.random.Generator
) -> None:
    """One folder for each torque rate, from the same training and test runs.

    Args:
        folders: path and torque rate in Hz, which divides the control rate.
    """
    design, time = plant.design, instants(plant.design)
    gaps: dict[str, Gap] = {}
    own_gaps: list[float] = []
    for run_name in ("train", "test"):
        path, logged = _run(plant, motion if run_name == "train" else random_motion(rng, design), rng)
        noisy = logged + noise(rng, design, deviation)
        gaps[run_name] = gap(plant, path, deviation)
        if run_name == "train":
            own_gaps = beside(plant, path, deviation)
        for folder, rate in folders:
            if design.rate_hz % rate:
                raise ValueError(f"{rate} Hz does not divide the control rate {design.rate_hz} Hz")
            folder.mkdir(parents=True, exist_ok=True)
            joints = range(1, design.count + 1)
            _table(
                folder / f"{run_name}_reference.csv", np.column_stack([time, *path.at(time)]),
                ["t", *(f"q{j}" for j in joints), *(f"dq{j}" for j in joints)], "%.9g",
            )  # fmt: skip
            every = design.rate_hz // rate
            torque = np.column_stack([time, noisy])[::every]
            _table(folder / f"{run_name}_torque.csv", torque, ["t", *(f"tau{j}" for j in joints)], "%.7g")
    for folder, rate in folders:
        _document(folder / "case.yaml", case_document(design, rate))
        hidden = [
            (h.effect, h.joint, h.form.equation, h.amplitude, own)
            for h, own in zip(plant.hidden, own_gaps, strict=True)
        ]
        sizes = {name: {run_name: getattr(g, name) for run_name, g in gaps.items()} for name in ("plain", "refitted")}
        truth = truth_document(folder.name, design, hidden, sizes, clutter=plant.clutter)
        _document(folder / "truth.yaml", truth)


def _table(path: Path, values: Array, names: list[str], form: str) -> None:
    np.savetxt(path, values, delimiter=",", header=",".join(names), comments="", fmt=form)


def _document(path: Path, content: dict[str, Any]) -> None:
    path.write_text(yaml.safe_dump(content, sort_keys=False, width=100), encoding="utf-8")
