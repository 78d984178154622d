"""What a step of the master costs beside the FMUs."""

from __future__ import annotations

import statistics

from fmu_didim.cosim import simulate
from tests.tools.benchmarks.cheap_fmus import Slaves, reference, system
from tests.tools.benchmarks.figure import Figure, Settings, interleaved
from tests.tools.benchmarks.other_masters import Batch, ecos, libcosim


def run(settings: Settings) -> list[Figure]:
    """Two cheap FMUs: ours against the same calls in C, FMPy's class in Python, ecos and libcosim."""
    count = settings.size(200_000, 2_000)
    few = settings.size(20_000, 500)
    loop, motion, slaves = system(), reference(count), Slaves(count)
    try:
        times = interleaved(
            {"ours": lambda: simulate(loop, motion), "c": slaves.by_c, "fmpy": lambda: slaves.by_fmpy(few)},
            repeats=settings.repeats,
        )
    finally:
        slaves.close()
    ours, c, fmpy = (1e6 * times.median(n) / k for n, k in (("ours", count), ("c", count), ("fmpy", few)))
    raw = {"ours_us_per_step": ours, "c_loop_us_per_step": c}
    figures = [
        Figure(
            "master step / C loop of the same calls", times.ratio("ours", "c"), 1.3, "at most", raw,
            f"{count} ticks, every one recorded; ours is the whole call of simulate",
        ),
        Figure(
            "FMPy's Python loop / master step", fmpy / ours, 50, "at least",
            {"fmpy_us_per_step": fmpy, "ours_us_per_step": ours}, f"FMPy: {few} ticks",
        ),
    ]  # fmt: skip
    for name, make, goal, steps in (
        ("ecos batch", ecos, 5, settings.size(100_000, 500)),
        ("libcosim", libcosim, 100, settings.size(5_000, 200)),
    ):
        figures.append(_against(name, make(), goal, steps, ours, settings))
    return figures


def _against(name: str, batch: Batch | str, goal: float, steps: int, ours: float, settings: Settings) -> Figure:
    title = f"{name} / master step"
    if isinstance(batch, str):
        return Figure(title, None, goal, "at least", {"ours_us_per_step": ours}, batch)
    batch(steps)
    theirs = statistics.median(1e6 * batch(steps) / steps for _ in range(settings.repeats))
    return Figure(
        title, theirs / ours, goal, "at least", {f"{name.split()[0]}_us_per_step": theirs, "ours_us_per_step": ours},
        f"batch of {steps} steps, nothing recorded there",
    )  # fmt: skip
