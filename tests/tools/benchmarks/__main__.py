"""Command line of the benchmarks."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads of the linear algebra only disturb the measurement

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tests.tools.benchmarks import (
    calibration,
    campaign_start,
    campaigns,
    command_start,
    discovery,
    discovery_stages,
    first_identification,
    growth,
    master_overhead,
    processes,
    reruns,
    scara_identification,
    scara_loop,
    tx40_identification,
    tx40_simulation,
    whole_commands,
)
from tests.tools.benchmarks.figure import Figure, Settings
from tests.tools.benchmarks.publish import Conditions, publish, record

BENCHMARKS: Mapping[str, Callable[[Settings], list[Figure]]] = {
    "master_overhead": master_overhead.run,
    "scara_loop": scara_loop.run,
    "scara_identification": scara_identification.run,
    "tx40_simulation": tx40_simulation.run,
    "tx40_identification": tx40_identification.run,
    "calibration": calibration.run,
    "processes": processes.run,
    "campaigns": campaigns.run,
    "campaign_start": campaign_start.run,
    "reruns": reruns.run,
    "command_start": command_start.run,
    "whole_commands": whole_commands.run,
    "first_identification": first_identification.run,
    "growth": growth.run,
    "discovery": discovery.run,
    "discovery_stages": discovery_stages.run,
}


def table(figures: Sequence[Figure]) -> str:
    """The figures as text."""
    width = max(len(f.name) for f in figures)
    lines = [f"{'figure':{width}}  {'ratio':>9}  {'goal':>9}  met"]
    for f in figures:
        ratio = "-" if f.ratio is None else f"{f.ratio:.4g}"
        goal = "report" if f.goal is None else f"{'<=' if f.sense == 'at most' else '>='} {f.goal:g}"
        absent = f.ratio is None and f.goal is not None
        met = "absent" if absent else "" if f.met is None else "yes" if f.met else "NO"
        lines.append(f"{f.name:{width}}  {ratio:>9}  {goal:>9}  {met}")
        lines.append("    " + ", ".join(f"{name} {value:.4g}" for name, value in f.medians.items()))
        if f.note:
            lines.append(f"    {f.note}")
    return "\n".join(lines)


def measure(
    names: Sequence[str], settings: Settings, keep: Callable[[str, Sequence[Figure], Conditions], None]
) -> list[Figure]:
    """The figures of these benchmarks; progress goes to standard error.

    Args:
        keep: called after each with its name, its figures and how the machine was before it.
    """
    figures = []
    for name in names:
        print(f"{name} ...", file=sys.stderr, flush=True)
        before = Conditions.now()
        found = BENCHMARKS[name](settings)
        keep(name, found, before)
        figures += found
    return figures


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print the table, write the JSON file."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.benchmarks", description="Ratios against limits and others"
    )
    parser.add_argument("--json", type=Path, help="file for the figures")
    parser.add_argument(
        "--figures", type=Path, help="file of figures for docs/include.py; what is not run keeps what it gave before"
    )
    parser.add_argument("--only", action="append", choices=BENCHMARKS, help="may be given several times")
    parser.add_argument("--repeats", type=int, default=5, help="rounds of each measurement")
    parser.add_argument("--quick", action="store_true", help="small counts, only to see that it runs")
    parser.add_argument(
        "--full", action="store_true", help="1 000 identifications, repeated TX40 identifications, a second discovery"
    )
    options = parser.parse_args(arguments)
    if options.quick and options.figures:
        parser.error("--quick measures too little for --figures")
    settings = Settings(options.repeats, options.quick, options.full)

    def keep(name: str, found: Sequence[Figure], before: Conditions) -> None:
        if options.figures:
            publish(options.figures, {name: record(found, settings, before)}, list(BENCHMARKS))

    figures = measure(options.only or list(BENCHMARKS), settings, keep)
    print(table(figures))
    if options.json:
        options.json.write_text(json.dumps([f.content() for f in figures], indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
