"""The file of figures for the page on speed: what each benchmark gave when it was last run, and the table of it."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.figures import command_of, machine, table, today, write_figures
from tests.tools.benchmarks.figure import Figure, Settings

Records = Mapping[str, Mapping[str, Any]]


def load() -> float:
    """How many processes ran or waited for a core in the last minute; not a number where the system does not say it."""
    return round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else float("nan")


def record(figures: Sequence[Figure], settings: Settings, load_before: float) -> dict[str, Any]:
    """What is kept of a benchmark."""
    return {
        "date": today(), "machine": machine(), "load_before": load_before, "rounds": settings.repeats,
        "figures": [figure.content() for figure in figures],
    }  # fmt: skip


def publish(path: Path, measured: Records, order: Sequence[str]) -> None:
    """Put what was measured into the file, beside what other benchmarks gave before.

    Args:
        order: names of all benchmarks, as the table has them; what is none any more is dropped.
    """
    before = json.loads(path.read_text(encoding="utf-8"))["data"] if path.is_file() else {}
    kept = {**before, **measured}
    records = {name: kept[name] for name in order if name in kept}
    write_figures(
        path, command_of("tests.tools.benchmarks", ["--figures", str(path)]), texts(records, order), data=records
    )


def texts(records: Records, order: Sequence[str]) -> dict[str, str | list[str]]:
    """The table, and what pages say of it.

    Args:
        order: as of :func:`publish`; those that were never run are told.
    """
    rows, missed, count = [], [], 0
    for entry in records.values():
        when = f"{entry['date']}, {entry['load_before']:g}"
        for figure in entry["figures"]:
            rows.append((figure["name"], _goal(figure), _measured(figure), _met(figure), when))
            count += figure["goal"] is not None
            missed += [figure["name"]] if figure["met"] is False else []
    machines = sorted({entry["machine"] for entry in records.values()})
    return {
        "table": table(("figure", "goal", "measured", "met", "date, load before"), rows),
        "machines": "; ".join(machines),
        "missed": "; ".join([*missed, f"{len(missed) or 'none'} of {count} that were measured"]),
        "not_run": ", ".join(name for name in order if name not in records) or "none",
    }


def _goal(figure: Mapping[str, Any]) -> str:
    if figure["goal"] is None:
        return "reported"
    return f"{'≤' if figure['sense'] == 'at most' else '≥'} {figure['goal']:g}"


def _measured(figure: Mapping[str, Any]) -> str:
    return "absent" if figure["ratio"] is None else f"{figure['ratio']:.3g}"


def _met(figure: Mapping[str, Any]) -> str:
    return "" if figure["met"] is None else "yes" if figure["met"] else "**no**"
