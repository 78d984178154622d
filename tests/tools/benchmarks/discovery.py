"""How long it takes to find what a two-joint arm lacks: 20 s of torque at 100 Hz, everything compiled before."""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path

from tests.tools.benchmarks.figure import Figure, Settings
from tests.tools.blind.campaign import Order, make_order
from tests.tools.blind.translate import translate

GOAL_S = 10.0
EFFECT, LEVEL, SEED = "stribeck", 1.5, 1


def run(settings: Settings) -> list[Figure]:
    """Seconds of a discovery over the goal of ten, without and with all that it writes; not a ratio of two times."""
    from fmu_didim import discover

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_order(Order((EFFECT,), SEED, True, ((folder / "blind", 100),), LEVEL, "development"))
        case = translate(folder / "blind", folder / "case")
        found: list[str] = []

        def once(out: Path | None) -> float:
            begin = time.perf_counter()
            document = discover(case, out)
            found[:] = [f"{f.effect} on joint {f.joint}" for f in document.findings]
            return time.perf_counter() - begin

        first = once(folder / "first")
        rounds = settings.size(settings.repeats, 1)
        alone = statistics.median(once(None) for _ in range(rounds))
        whole = statistics.median(once(folder / "out") for _ in range(rounds))
    medians = {"first_s": first, "alone_s": alone, "with_report_s": whole}
    return [
        Figure(
            "discovery of a two-joint case, with its report: seconds / 10 s", whole / GOAL_S, 1.0, "at most", medians,
            f"{EFFECT} hidden, found: {', '.join(found) or 'nothing'}; the first run may have compiled",
        )
    ]  # fmt: skip


__all__ = ["run"]
