"""The cases: made by the simulator of ``tests/tools/blind``, whose plant, friction and integrator are its own."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from fmu_didim.base.errors import InputError
from tests.tools.blind.campaign import make_campaign
from tests.tools.blind.harness import case_folders

KINDS = (
    "stribeck", "load_dependent_friction", "torque_offset", "asymmetric_viscous", "quadratic_viscous", "presliding",
    "position_dependent_friction", "torque_ripple", "spring", "actuator_lag", "joint_elasticity", "backlash",
)  # fmt: skip
"""Effects that are hidden, each alone."""
OUTSIDE = ("unknown_chirp", "unknown_coupling")
"""What no catalogue of the methods holds: to be refused."""
FIRST_SEED = 7101
"""Of the published figures; nothing was tuned on it or on the seeds after it, as was since 7001 to 7003."""
SEEDS = 3
CLEAN = 4
"""Plants that hide nothing, every second one without the small planted effects."""
RATE_HZ = 100
LEVEL = 1.5
"""[noise deviations] Gap of what is hidden, after the base parameters took what they can: that of docs/discovery.md."""
ORDER = "benchmark.json"


@dataclass(frozen=True)
class Order:
    """Which cases: the same order gives the same files."""

    kinds: tuple[str, ...] = (*KINDS, *OUTSIDE)
    first_seed: int = FIRST_SEED
    seeds: int = SEEDS
    clean: int = CLEAN
    rate_hz: int = RATE_HZ
    level: float = LEVEL


def made(out: Path, order: Order, *, jobs: int = 1) -> list[Path]:
    """The folders of the cases of an order below ``out``, made where they are not there yet.

    Raises:
        InputError: ``out`` holds the cases of another order.
    """
    written = out / ORDER
    if written.exists():
        _check_same(written, order)
    elif (out / "cases").exists():
        raise InputError(
            "The making of these cases was cut short: nobody knows which are there.", where=str(out / "cases"),
            next_step="Delete that folder, or give another one.",
        )  # fmt: skip
    else:
        make_campaign(
            out / "cases", order.kinds, seeds=range(order.first_seed, order.first_seed + order.seeds),
            rates=[order.rate_hz], level=order.level, clean=order.clean, jobs=jobs,
        )  # fmt: skip
        written.write_text(json.dumps(asdict(order), indent=1) + "\n", encoding="utf-8")  # last: then all are there
    return case_folders(out / "cases")


def _check_same(written: Path, order: Order) -> None:
    held, wanted = json.loads(written.read_text(encoding="utf-8")), json.loads(json.dumps(asdict(order)))
    different = [name for name, value in wanted.items() if held.get(name) != value]
    if different:
        raise InputError(
            "This folder holds the cases of another order.",
            where=str(written),
            got=_told(held, different),
            valid=_told(wanted, different),
            next_step="Give another folder, or the same kinds, seeds and clean plants.",
        )


def _told(values: dict[str, object], names: Sequence[str]) -> str:
    return ", ".join(f"{name} {values.get(name)}" for name in names)
