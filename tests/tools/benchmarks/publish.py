"""The file of figures for the page on speed: what each benchmark gave when it was last run, and the table of it."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.figures import command_of, machine, table, today, write_figures
from tests.tools.benchmarks.figure import EXPONENT, OFF, OVER, PARAMETERS, Figure, Settings

Records = Mapping[str, Mapping[str, Any]]


STARTS = 9
"""[processes] That do nothing, whose median start says how fast the machine is at that time."""


@dataclass(frozen=True)
class Conditions:
    """How a machine was when a benchmark began.

    Attributes:
        load: how many processes ran or waited for a core in the last minute; not a number where the system does not
            say it.
        python_ms: how long ``python -c pass`` took: the cores that are lent to a virtual machine are now faster and now
            slower, by half and more.
    """

    load: float
    python_ms: float

    @staticmethod
    def now() -> Conditions:
        """Those of this moment."""
        busy = round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else float("nan")
        times = []
        for _ in range(STARTS):
            begin = time.perf_counter()
            subprocess.run([sys.executable, "-c", "pass"], check=True)
            times.append(time.perf_counter() - begin)
        return Conditions(busy, round(1e3 * statistics.median(times), 1))


def record(figures: Sequence[Figure], settings: Settings, before: Conditions) -> dict[str, Any]:
    """What is kept of a benchmark."""
    return {
        "date": today(), "machine": machine(), "load_before": before.load, "python_ms": before.python_ms,
        "rounds": settings.repeats, "figures": [figure.content() for figure in figures],
    }  # fmt: skip


def publish(path: Path, measured: Records, order: Sequence[str]) -> None:
    """Put what was measured into the file, beside what other benchmarks gave before, and the last figure of a
    competitor that is absent this time, with its date.

    Args:
        order: names of all benchmarks, as the table has them; what is none any more is dropped.
    """
    before = json.loads(path.read_text(encoding="utf-8"))["data"] if path.is_file() else {}
    kept = {**before, **{name: _with_last(entry, before.get(name)) for name, entry in measured.items()}}
    records = {name: kept[name] for name in order if name in kept}
    write_figures(
        path, command_of("tests.tools.benchmarks", ["--figures", str(path)]), texts(records, order), data=records
    )


def _with_last(entry: Mapping[str, Any], before: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """What was measured, the last figure in the place of one that is absent."""
    if before is None:
        return entry
    known = {one["name"]: one for one in before["figures"] if one["ratio"] is not None}
    last = {name: {**one, "last": one.get("last", _when(before))} for name, one in known.items()}
    figures = [
        {**last[one["name"]], "note": one["note"]} if one["ratio"] is None and one["name"] in last else one
        for one in entry["figures"]
    ]
    return {**entry, "figures": figures}


def _when(entry: Mapping[str, Any]) -> str:
    known = f", {entry['python_ms']:.0f} ms" if "python_ms" in entry else ""
    return f"{entry['date']}, {entry['load_before']:g}{known}"


def texts(records: Records, order: Sequence[str]) -> dict[str, str | list[str]]:
    """The table, and what pages say of it.

    Args:
        order: as of :func:`publish`; those that were never run are told.
    """
    rows, peers, missed, count = [], [], [], 0
    grown: dict[tuple[str, str], dict[str, str]] = {}
    for entry in records.values():
        for figure in entry["figures"]:
            when = f"{figure['last']}; not here on {entry['date']}" if "last" in figure else _when(entry)
            if OFF in figure["medians"]:
                peers.append((*figure["name"].split(OVER), *_beside(figure["medians"]), when))
            if figure["name"].endswith(EXPONENT):
                for name, value in figure["medians"].items():
                    number, of, unit = name.split()
                    shown = f"{value:.3g}" if value < 1000 else f"{value:.0f}"
                    grown.setdefault((of, number), {"when": when})[unit] = shown
            rows.append((figure["name"], _goal(figure), _measured(figure), _met(figure), when))
            count += figure["goal"] is not None
            missed += [figure["name"]] if figure["met"] is False else []
    machines = sorted({entry["machine"] for entry in records.values()})
    return {
        "table": table(("figure", "goal", "measured", "met", "date, load and Python before"), rows),
        "peers": table(
            ("task", "beside", "its s", "ours s", "its values off ours, σ", "date, load and Python before"), peers
        ),
        "growth": table(
            ("number", "of", "parameters", "s", "MB", "date, load and Python before"),
            [
                (number, of, *(v.get(k, "") for k in (PARAMETERS, "s", "MB", "when")))
                for (of, number), v in grown.items()
            ],
        ),
        "machines": "; ".join(machines),
        "missed": "; ".join([*missed, f"{len(missed) or 'none'} of {count} that were measured"]),
        "not_run": ", ".join(name for name in order if name not in records) or "none",
    }


def _beside(medians: Mapping[str, float]) -> tuple[str, str, str]:
    """Seconds of another tool, ours, and how far its values are off."""
    return f"{medians['theirs s']:.2g}", f"{medians['ours s']:.2g}", f"{medians[OFF]:.2g}"


def _goal(figure: Mapping[str, Any]) -> str:
    if figure["goal"] is None:
        return "reported"
    return f"{'≤' if figure['sense'] == 'at most' else '≥'} {figure['goal']:g}"


def _measured(figure: Mapping[str, Any]) -> str:
    return "absent" if figure["ratio"] is None else f"{figure['ratio']:.3g}"


def _met(figure: Mapping[str, Any]) -> str:
    return "" if figure["met"] is None else "yes" if figure["met"] else "**no**"
