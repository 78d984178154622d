"""Many cases: every effect with every seed at every torque rate, under names that say nothing."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from tests.tools.blind.score import CLASSES
from tests.tools.blind.simulator.hidden import EFFECTS
from tests.tools.blind.simulator.make import make_plant, write_cases
from tests.tools.blind.simulator.native import SimulationFailedError

PAIRS = (
    "stribeck+joint_elasticity", "asymmetric_viscous+backlash", "load_dependent_friction+torque_ripple",
    "actuator_lag+presliding", "torque_offset+quadratic_viscous", "thermal_friction_drift+dead_zone",
)  # fmt: skip
"""Two effects at once."""
EXCLUSIVE: tuple[frozenset[str], ...] = (
    *CLASSES,
    frozenset({"joint_elasticity", "backlash"}),
    frozenset({"stribeck", "presliding", "lugre"}),
    frozenset({"drive_gain", "controller_gain"}),
)
"""Of each only one is drawn into a case: what counts as one effect, the two forms of a gear, the forms of friction near
rest, and two gains of one path."""


DRAWS = 10
"""[plants] Of one order, drawn until one can be simulated."""


def drawn_together(count: int, number: int, *, first_seed: int) -> list[tuple[str, ...]]:
    """As many sets of ``number`` different effects, each effect as likely, none of them :data:`EXCLUSIVE`."""
    rng = np.random.default_rng([first_seed, number])
    found: list[tuple[str, ...]] = []
    while len(found) < count:
        drawn = tuple(sorted(rng.choice(list(EFFECTS), number, replace=False).tolist()))
        if not any(len(group & set(drawn)) > 1 for group in EXCLUSIVE):
            found.append(drawn)
    return found


@dataclass(frozen=True)
class Order:
    """One plant to make: its effects (none: clean), its seed, a folder and a torque rate for each log, whether all
    effects act on one joint, and times the limit of an effect up to which it may grow."""

    effects: tuple[str, ...]
    seed: int
    clutter: bool
    folders: tuple[tuple[Path, int], ...]
    level: float
    robots: str
    one_joint: bool = False
    reach: float = 1.0


def make_order(order: Order) -> None:
    """Make the folders of one plant; the same order gives the same files. A plant that its effects make unstable, so
    that nothing can be logged of it, or that rings, is drawn anew."""
    rng = np.random.default_rng([order.seed, zlib.crc32("+".join(order.effects).encode())])
    for _ in range(DRAWS):
        with suppress(SimulationFailedError):
            plant, motion, deviation = make_plant(
                order.effects, rng, level=order.level, robots=order.robots, clutter=order.clutter,
                one_joint=order.one_joint, reach=order.reach,
            )  # fmt: skip
            return write_cases(order.folders, plant, motion, deviation, rng)
    raise SimulationFailedError(f"no plant of {DRAWS} with {', '.join(order.effects)} could be simulated")


def make_campaign(
    folder: Path,
    effects: Sequence[str],
    *,
    seeds: range,
    rates: Sequence[int],
    level: float,
    clean: int = 0,
    triples: int = 0,
    robots: str = "varied",
    one_joint: bool = False,
    reach: float = 1.0,
    jobs: int = 1,
) -> int:
    """Make all cases below ``folder``; returns how many.

    Args:
        effects: names, or several joined by ``+``. seeds: of each effect; clean plants and triples count on from the
            first one, even where the range is empty. level: gap in noise deviations.
        clean: plants that hide nothing. triples: plants that hide three effects, drawn from all of the catalogue.
        one_joint: whether the effects of a plant act on one joint. reach: times the limit of an effect up to which it
            may grow.

    Raises:
        SimulationFailedError: no plant of one of these orders could be simulated; all others have been made.
    """
    first = seeds.start
    kinds = [(tuple(name.split("+")), seed, True) for name in effects for seed in seeds]
    kinds += [((), first + i, i % 2 == 0) for i in range(clean)]
    kinds += [(what, first + i, True) for i, what in enumerate(drawn_together(triples, 3, first_seed=first))]
    # Shuffled, so that the number of a case says nothing about what it hides.
    numbers = np.random.default_rng(first).permutation(len(kinds)) + 1
    orders = [
        Order(
            what,
            seed,
            clutter,
            tuple((folder / f"b{number:04d}_{rate}hz", rate) for rate in rates),
            level,
            robots,
            one_joint,
            reach,
        )
        for (what, seed, clutter), number in zip(kinds, numbers, strict=True)
    ]
    if jobs == 1:
        failed = list(map(_failure_of, orders))
    else:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            failed = list(pool.map(_failure_of, orders))
    if any(failed):  # all others are there
        raise SimulationFailedError("; ".join(filter(None, failed)))
    return len(orders) * len(rates)


def _failure_of(order: Order) -> str:
    """What failed in the making of a plant, or an empty string: a delay and an elastic gear on one joint may not have a
    stable loop."""
    try:
        make_order(order)
    except SimulationFailedError as error:
        return f"{order.folders[0][0].name}: {error}"
    return ""
