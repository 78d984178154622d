"""Whether sizes that a valid verdict says it would have doubted with 95 % are doubted nearly as often.

    python -m tests.tools.verdict.power --robots scara arm --draws 50

Each draw has a motion and a noise. The right model gives the sizes that its verdict states; then the machine gets each
effect at its stated size, at one joint after the other, and logs with another noise, which the model is identified
with and judged by.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from fmu_didim.campaigns.planning.truth import unit_noise
from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.checks.identification import Checks, checked
from fmu_didim.checks.power.statement import PowerResult, StatedResult
from fmu_didim.checks.validation import validate_on
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.estimators import Didim
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from tests.checks.data.right import MEMORY_S, RATES, loaded, logged, motion
from tests.tools.verdict.catalogue import NOISE, _robot
from tests.tools.verdict.run import answer, named

DOUBTED = 0.9
"""[1] Share of the draws that must be doubted: the formula is one of first order, and knows the noise by one draw."""


@dataclass(frozen=True)
class Drawn:
    """A machine with an effect of the stated size: whether it is doubted, by which reasons, and the worst value."""

    robot: str
    effect: str
    joint: int
    place: str
    seed: int
    size: float
    unit: str
    verdict: str
    codes: tuple[str, ...]
    farthest: float

    @property
    def is_doubted(self) -> bool:
        return self.verdict != "valid"


@cache
def builder(robot: str) -> LoopModelBuilder:
    return LoopModelBuilder(loaded(robot), _robot(robot))


def along(robot: str, seed: int) -> LoopModel:
    """The loop along the motions of a draw, its logs still empty."""
    model = loaded(robot)
    for label in model.experiments:
        model = logged(model, label, motion(robot, seed, label), RATES[robot])
    return model


def with_logs(model: LoopModel, torques: Mapping[str, Array], seed: int, noise: float) -> LoopModel:
    """The model with these torques and noise as its logs."""
    rng = np.random.default_rng([seed, 11])
    for label, torque in torques.items():
        experiment = model.experiments[label]
        errors = (
            noise
            * torque.std(axis=0)
            * unit_noise(rng, experiment.time, torque.shape[1], coloured=0.0, memory_s=MEMORY_S)
        )
        model = model.with_experiment(label, replace(experiment, torque=torque + errors))
    return model


def judged(model: LoopModel) -> Checks:
    """The checks of the answer that ``didim`` gives."""
    before = data_diagnostics(model)
    estimate = Didim(start="torque").estimate(model)
    validations = [validate_on(estimate.model, estimate.value, label) for label in estimate.model.experiments]
    return checked(estimate, validations, before=before)


def machine(robot: str, model: LoopModel, stated: StatedResult, times: float = 1.0) -> LoopModel:
    """The loop with an effect, of the stated size or a multiple of it."""
    effect = builder(robot).effects[stated.effect]
    kind = builder(robot).loop.joint_type(stated.joint)
    amplitudes = {v.name for v in effect.parameters(kind)}
    values = {
        name: effect.neutral.get(name, 0.0) + times * value if name in amplitudes else value
        for name, value in stated.parameters.items()
    }
    return builder(robot).build(model, [Proposal(EffectAtJoint(stated.effect, stated.joint), values)])


def stated_power(robot: str, seed: int, noise: float = NOISE) -> tuple[LoopModel, PowerResult | None]:
    """The loop along the motion of a draw, and what the verdict on right data states; None if that is not valid."""
    model = along(robot, seed)
    torques = {label: model.torque(model.start, label) for label in model.experiments}
    return model, judged(with_logs(model, torques, seed, noise)).power


def draws(robot: str, seed: int, effects: set[str], times: float = 1.0, noise: float = NOISE) -> Iterator[Drawn]:
    """The machine of a draw with each effect, at a joint that changes with the seed."""
    model, power = stated_power(robot, seed, noise)
    if power is None:
        print(f"{robot}, {seed}: the right model is not valid", flush=True)
        return
    by_effect = defaultdict(list)
    for stated in power.stated:
        if stated.size is not None and (not effects or stated.effect in effects):
            by_effect[stated.effect].append(stated)
    for effect, found in by_effect.items():
        stated = found[seed % len(found)]
        real = machine(robot, model, stated, times)
        torques = {label: real.torque(real.start, label) for label in real.experiments}
        told = answer(with_logs(model, torques, seed + 100_000, noise), named(loaded(robot)))
        assert stated.size is not None
        yield Drawn(
            robot, effect, stated.joint, stated.place, seed, stated.size, stated.unit, told.verdict, told.codes,
            told.farthest,
        )  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.verdict.power", description=__doc__.split("\n")[0])
    parser.add_argument("--robots", nargs="+", default=["scara", "arm"])
    parser.add_argument("--draws", type=int, default=50)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--effects", nargs="*", default=[], help="all that are stated by default")
    parser.add_argument("--times", type=float, default=1.0, help="of the stated size")
    parser.add_argument("--noise", type=float, default=NOISE, help="standard deviation, of that of the torque")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    found: list[Drawn] = []
    for robot in options.robots:
        for seed in range(options.first, options.first + options.draws):
            begin = time.monotonic()
            own = list(draws(robot, seed, set(options.effects), options.times, options.noise))
            found += own
            missed = ", ".join(f"{d.effect} {d.place}" for d in own if not d.is_doubted)
            print(f"{robot}, {seed}: {time.monotonic() - begin:.1f} s; not doubted: {missed or 'none'}", flush=True)
            if options.json:
                options.json.write_text(json.dumps([asdict(d) for d in found], indent=1), encoding="utf-8")
    holds = [_line(group) for group in grouped(found)]
    return 0 if all(holds) else 1


def grouped(found: list[Drawn]) -> list[list[Drawn]]:
    """The draws of each robot and effect."""
    groups: dict[tuple[str, str], list[Drawn]] = defaultdict(list)
    for one in found:
        groups[one.robot, one.effect].append(one)
    return list(groups.values())


def _line(group: list[Drawn]) -> bool:
    """Prints a row, and says whether it holds."""
    share = float(np.mean([d.is_doubted for d in group]))
    sizes = np.array([d.size for d in group])
    codes = defaultdict(int)
    for drawn in group:
        for code in drawn.codes[:1]:
            codes[code] += 1
    first = ", ".join(f"{code} {n}" for code, n in sorted(codes.items(), key=lambda item: -item[1])[:3])
    print(f"{group[0].robot:6} {group[0].effect:24} {100 * share:3.0f} % of {len(group)} doubted; size "
          f"{np.median(sizes):.3g} ({sizes.min():.2g} to {sizes.max():.2g}) {group[0].unit}; worst value of the valid "
          f"ones {max((d.farthest for d in group if not d.is_doubted), default=0.0):.1f} sigma; first: {first}",
          flush=True)  # fmt: skip
    return share >= DOUBTED


if __name__ == "__main__":
    sys.exit(main())
