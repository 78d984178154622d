"""Many cases: every effect with every seed at every torque rate, under names that say nothing."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from tests.tools.blind.simulator.make import make_plant, write_cases

PAIRS = (
    "stribeck+joint_elasticity", "asymmetric_viscous+backlash", "load_dependent_friction+torque_ripple",
    "actuator_lag+presliding", "torque_offset+quadratic_viscous", "thermal_friction_drift+dead_zone",
)  # fmt: skip
"""Two effects at once."""


@dataclass(frozen=True)
class Order:
    """One plant to make: its effects (none: clean), its seed, and a folder and a torque rate for each log."""

    effects: tuple[str, ...]
    seed: int
    clutter: bool
    folders: tuple[tuple[Path, int], ...]
    level: float
    robots: str


def make_order(order: Order) -> None:
    """Make the folders of one plant; the same order gives the same files."""
    rng = np.random.default_rng([order.seed, zlib.crc32("+".join(order.effects).encode())])
    plant, motion, deviation = make_plant(
        order.effects, rng, level=order.level, robots=order.robots, clutter=order.clutter
    )  # fmt: skip
    write_cases(order.folders, plant, motion, deviation, rng)


def make_campaign(
    folder: Path,
    effects: Sequence[str],
    *,
    seeds: Iterable[int],
    rates: Sequence[int],
    level: float,
    clean: int = 0,
    robots: str = "varied",
    jobs: int = 1,
) -> int:
    """Make all cases below ``folder``; returns how many.

    Args:
        effects: names, or two joined by ``+``. level: gap in noise deviations. clean: plants that hide nothing.
    """
    seeds = list(seeds)
    first = seeds[0] if seeds else 1
    kinds = [(tuple(name.split("+")), seed, True) for name in effects for seed in seeds]
    kinds += [((), first + i, i % 2 == 0) for i in range(clean)]
    # Shuffled, so that the number of a case says nothing about what it hides.
    numbers = np.random.default_rng(first).permutation(len(kinds)) + 1
    orders = [
        Order(what, seed, clutter, tuple((folder / f"b{number:04d}_{rate}hz", rate) for rate in rates), level, robots)
        for (what, seed, clutter), number in zip(kinds, numbers, strict=True)
    ]
    if jobs == 1:
        for order in orders:
            make_order(order)
    else:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            list(pool.map(make_order, orders))
    return len(orders) * len(rates)
