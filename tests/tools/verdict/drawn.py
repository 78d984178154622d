"""Machines that have one or two effects of the catalogue which the model lacks, all drawn: effect, joint, shape, size.

    python -m tests.tools.verdict.drawn --robots scara arm --draws 60 --first 1 [--expressions]

With ``--expressions`` the torques themselves are drawn, in no catalogue: products and sums of functions of position,
velocity, acceleration, load, time, and a neighbour (:mod:`tests.tools.verdict.expressions`).

Sizes are drawn evenly in their logarithm, from what no data show to what anyone sees. Beside each answer stands what
the log could have shown: the chi square D = |r - S S+ r|^2 / sigma^2 of the change r of the torque beside the
sensitivities S at the true values, sigma being the noise; without the beginning, where a fit may free the start. An
answer is wrong where it is valid and a value lies beyond four sigma; it is one that the data could have shown where D
is at least ``SHOWN``, and so is what a fit of logs without noise leaves: a drive with half the gain is another machine
to the last bit, while S reaches not so far.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.checks.motion.colour import orthonormal, rest_of
from fmu_didim.checks.motion.dependence import independent
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.dynamics.effects import EFFECTS, Effect, TorqueEffect, effect_name
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.estimators import Didim
from fmu_didim.fit.derivatives.load_response import MEMORY_S
from fmu_didim.fit.fit import point
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.model.motion import simulated_motion
from tests.checks.data.right import loaded
from tests.figures import command_of, table, write_figures
from tests.tools.verdict.catalogue import NOISE
from tests.tools.verdict.expressions import drawn_effect, ranges_of
from tests.tools.verdict.power import along, builder, with_logs
from tests.tools.verdict.run import Answer, answer, named

SHOWN = 60.0
"""[1] Chi square from which a misfit is one that a log shows."""
BANDS = (SHOWN, 1e3, 1e4)
"""[1] Chi squares between which answers are counted."""
WRONG = 0.03
"""[1] Share of all draws that may be valid and wrong, none of them with so large a chi square."""
OF_PEAK = (0.003, 0.3)
"""[1] Of the peak torque of the joint: range of the largest change of the log by an effect of the torque balance."""
TRIAL = 1e-4
"""[1] Of the peak torque, or in SI units: amplitude from which that change is known, as it grows with it."""
OWN_NAME = 0.1
"""[1] Share of the squares of a torque without a name that parameters of the model must leave: friction with the 0.9th
power of the velocity is viscous friction, and its coefficient not what it was."""
TWO = 0.4
"""[1] Share of the draws with two effects."""
OWN = {"motor_inertia", "viscous", "coulomb"}
"""Effects that a model has, or that its parameters stand for."""
VALUES: Mapping[str, tuple[float, float]] = {
    "delay": (5e-4, 1e-2), "actuator_lag": (5e-4, 1e-2), "encoder_eccentricity": (1e-4, 1e-2), "backlash": (2e-4, 1e-2),
    "joint_elasticity": (1e3, 1e5), "base_tilt": (5e-3, 0.2), "log_time_shift": (5e-4, 2e-2),
}  # fmt: skip
"""Range of the first parameter of effects outside the torque balance, SI."""
RATIOS: Mapping[str, tuple[float, float]] = {"controller_gain": (0.01, 0.5), "drive_gain": (0.01, 0.5)}
"""The same of factors: how far they are off one, up or down."""
SHARES: Mapping[str, tuple[float, float]] = {"torque_saturation": (0.5, 0.95), "dead_zone": (1e-3, 0.1)}
"""The same of torques: as shares of the peak torque."""


@dataclass(frozen=True)
class Drawn:
    """An answer on a machine that was drawn: what it has, chi square of that, and what is said."""

    what: str
    chi_square: float
    answer: Answer

    @property
    def is_shown(self) -> bool:
        return self.chi_square >= SHOWN


def draw(robot: str, seed: int, *, expressions: bool = False) -> Drawn | None:
    """A machine, a motion and a noise; None where it cannot be simulated."""
    rng = np.random.default_rng([seed, 31])
    model = along(robot, seed)
    torques = {label: model.torque(model.start, label) for label in model.experiments}
    find = nameless if expressions else catalogued
    found = find(rng, model, torques["estimation"], robot)
    if found is None:
        return None
    what, real = found
    try:
        changed = {label: real.torque(real.start, label) for label in real.experiments}
    except FmuDidimError:
        return None
    fit = point(model := with_logs(model, torques, seed, NOISE).with_values(model.start), NoiseOfResidual(model))
    settled = model.experiments["estimation"].time > MEMORY_S
    chi_square = whole = 0.0
    for j in range(model.joint_count):
        change = (changed["estimation"] - torques["estimation"])[settled, j]
        left = rest_of(change, orthonormal(independent(fit.jacobian[settled, j])))
        variance = (NOISE * float(torques["estimation"][:, j].std())) ** 2
        chi_square += float(left @ left) / variance
        whole += float(change @ change) / variance
    if expressions and chi_square < OWN_NAME * whole:
        return None
    found = answer(with_logs(along(robot, seed), changed, seed, NOISE), named(loaded(robot)))
    if found.is_wrong and chi_square >= SHOWN:
        sizes = NOISE * torques["estimation"].std(axis=0)
        rest = Didim(start="torque").estimate(with_logs(along(robot, seed), changed, seed, 0.0)).residual
        chi_square = min(chi_square, float(np.sum((rest[settled] / sizes) ** 2)))
    return Drawn(what, chi_square, found)


def catalogued(rng: np.random.Generator, model: LoopModel, torque: Array, robot: str) -> tuple[str, LoopModel] | None:
    """What is drawn, and the machine that has it: one or two effects of the catalogue."""
    wanted = 1 + int(rng.uniform() < TWO)
    # Curves stand for anything, over a range that only a motion gives; what acts in an elastic gear has none here. An
    # effect that came later has no range either: what a seed draws stays the same.
    ranges = {**VALUES, **RATIOS, **SHARES}
    free = [
        n
        for n, effect in EFFECTS.items()
        if not (n in OWN or effect.is_form or effect.needs_elastic or effect.place == "controller")
        and (isinstance(effect, TorqueEffect) or n in ranges)
    ]
    names = rng.permutation(free)
    proposals = list[Proposal]()
    for name in names:
        if len(proposals) == wanted:
            break
        try:
            one = _proposal(rng, model, torque, builder(robot), str(name))
        except FmuDidimError:  # it cannot be simulated, or not in this loop
            continue
        proposals += [] if one is None else [one]
    try:
        return " and ".join(_words(one) for one in proposals), builder(robot).build(model, proposals)
    except FmuDidimError:
        return None


def nameless(rng: np.random.Generator, model: LoopModel, torque: Array, robot: str) -> tuple[str, LoopModel] | None:
    """The same of a torque at a joint that no catalogue has."""
    known, joint = builder(robot), int(rng.integers(1, model.joint_count + 1))
    motion = simulated_motion(model.simulation(model.start, "estimation"), RobotModel(known.description))
    effect = drawn_effect(rng, ranges_of(motion, joint - 1))
    name = effect_name(effect)
    own = LoopModelBuilder(known.base, known.description, {name: effect()})
    try:
        one = _proposal(rng, model, torque, own, name, joint)
        return None if one is None else (f"{effect.equation} at joint {joint}", own.build(model, [one]))
    except FmuDidimError:
        return None


def _proposal(
    rng: np.random.Generator, model: LoopModel, torque: Array, known: LoopModelBuilder, name: str, joint: int = 0
) -> Proposal | None:
    """An effect at a joint, which is drawn by default; None where the model has it, or it does nothing there."""
    effect = known.effects[name]
    joint = joint or (1 if effect.name == "base_tilt" else int(rng.integers(1, model.joint_count + 1)))
    kind, description = known.loop.joint_type(joint), known.description
    if effect.name in description.joints[joint - 1].effects or joint + getattr(effect, "reach", 0) > model.joint_count:
        return None
    shapes, peak = _shapes(rng, model, effect, joint), float(np.abs(torque[:, joint - 1]).max())
    names = [v.name for v in effect.parameters(kind)]
    at = EffectAtJoint(name, joint)
    if not isinstance(effect, TorqueEffect):
        return Proposal(at, shapes | {names[0]: _value(rng, effect, peak)})
    weights = dict(zip(names, rng.uniform(0, 1, len(names)), strict=True))
    trial = known.build(model, [Proposal(at, shapes | {n: TRIAL * peak * w for n, w in weights.items()})])
    change = float(np.abs(trial.torque(trial.start, "estimation")[:, joint - 1] - torque[:, joint - 1]).max())
    if change < 1e-3 * TRIAL * peak:
        return None
    size = _between(rng, OF_PEAK) * peak / change
    return Proposal(at, shapes | {name: size * TRIAL * peak * weight for name, weight in weights.items()})


def _shapes(rng: np.random.Generator, model: LoopModel, effect: Effect, joint: int) -> dict[str, float]:
    """Shapes of an effect: those that the model has, instants and stops along the motion, others about the usual."""
    known = {v.name: v.start for v in model.loop.plant.parameters}
    reference = model.experiments["estimation"].reference
    q, end = reference.column(f"q{joint}"), float(reference.time[-1])
    begin = rng.uniform(0.1, 0.8)
    own = {
        "t_load": begin * end, "t_on": begin * end, "t_off": rng.uniform(begin, 0.9) * end, "Theat": end,
        "qupper": 0.8 * float(q.max()), "qlower": 0.8 * float(q.min()), "nr": float(rng.integers(1, 13)),
    }  # fmt: skip
    kind = model.parameters.torque_units[joint - 1]
    shapes = effect.shapes("revolute" if kind == "N.m" else "prismatic")
    return {
        v.name: own.get(v.name, known.get(f"{v.name}_{joint}", v.start * float(np.exp(rng.uniform(-1, 1)))))
        for v in shapes
    }


def _value(rng: np.random.Generator, effect: Effect, peak: float) -> float:
    """The first parameter of an effect outside the torque balance."""
    if effect.name in RATIOS:
        return float(1 + rng.choice([-1, 1]) * _between(rng, RATIOS[effect.name]))
    if effect.name in SHARES:
        return peak * _between(rng, SHARES[effect.name])
    return _between(rng, VALUES[effect.name])


def _between(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(limits))))


def _words(one: Proposal) -> str:
    values = ", ".join(f"{name} = {value:.3g}" for name, value in one.values.items())
    return f"{one.effect_at.effect} at joint {one.effect_at.joint} ({values})"


def drawn(robots: list[str], seeds: range, *, expressions: bool = False) -> Iterator[tuple[str, int, Drawn]]:
    """All that can be simulated."""
    for robot in robots:
        for seed in seeds:
            one = draw(robot, seed, expressions=expressions)
            if one is not None:
                yield robot, seed, one


def figures(told: Sequence[Drawn]) -> dict[str, str | list[str]]:
    """What pages say of the answers: how many there are of each kind, by what the log could show."""
    rows = []
    for low, high in pairwise((0.0, *BANDS, np.inf)):
        band = [one.answer for one in told if low <= one.chi_square < high]
        valid = [one for one in band if one.verdict == "valid"]
        wrong = sum(one.is_wrong for one in valid)
        words = f"{low:g} and more" if np.isinf(high) else f"{low:g} to {high:g}"
        rows.append([words, str(len(band)), str(len(band) - len(valid)), str(len(valid) - wrong), str(wrong)])
    shown = [one for one in told if one.is_shown]
    wrong = sum(one.answer.is_wrong for one in shown)
    heads = ["chi square", "machines", "doubted or refused", "valid, near the truth", "valid and wrong"]
    return {"table": table(heads, rows), "count": str(len(told)), "shown": str(len(shown)), "wrong": str(wrong)}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.verdict.drawn", description=__doc__.split("\n")[0])
    parser.add_argument("--robots", nargs="+", default=["scara", "arm"])
    parser.add_argument("--draws", type=int, default=60)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--expressions", action="store_true", help="torques that are in no catalogue")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    options = parser.parse_args(arguments)
    seeds, told = range(options.first, options.first + options.draws), list[Drawn]()
    tally: Counter[str] = Counter()
    for robot, seed, one in drawn(options.robots, seeds, expressions=options.expressions):
        told.append(one)
        found = one.answer
        wrong, valid = found.is_wrong, found.verdict == "valid"
        tally.update(all=1, wrong=int(wrong), valid=int(valid), shown=int(wrong and one.is_shown))
        tally.update(silent=int(wrong and not found.conditions))
        print(f"{'WRONG' if wrong and one.is_shown else 'hidden' if wrong else 'ok':7}{robot}, {seed}: {one.what}: "
              f"D = {one.chi_square:.3g}; {found.verdict} {', '.join(found.codes[:3])} ({found.farthest:.1f} sigma, "
              f"held out {found.held_out:.2f}){''.join(f'; provided that {c}' for c in found.conditions)}",
              flush=True)  # fmt: skip
    print(f"{tally['all']} draws: {tally['valid']} valid, {tally['wrong']} valid and wrong, {tally['shown']} of them "
          f"with a chi square of {SHOWN:g} or more, {tally['silent']} without a condition")  # fmt: skip
    if options.figures:
        command = command_of(
            "tests.tools.verdict.drawn", [*(sys.argv[1:] if arguments is None else arguments)]
        )  # fmt: skip
        write_figures(options.figures, command, figures(told))
    return 0 if not tally["shown"] and tally["wrong"] <= WRONG * max(tally["all"], 1) else 1


if __name__ == "__main__":
    sys.exit(main())
