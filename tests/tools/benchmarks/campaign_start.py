"""How long somebody who starts a campaign waits for a first word, and for the first run that has been done."""

from __future__ import annotations

import re
import signal
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import yaml

from tests.tools.benchmarks.campaigns import CASE, WORKERS
from tests.tools.benchmarks.command_start import command
from tests.tools.benchmarks.figure import Figure, Settings

FIRST_WORD_S, FIRST_RUN_S = 1.0, 5.0
_PROGRESS = re.compile(r"\b(\d+) of \d+ runs")


def run(settings: Settings) -> list[Figure]:
    """Seconds from the prompt, warm, with as many workers as elsewhere; the campaign is ended after its first run."""
    words, runs = [], []
    with tempfile.TemporaryDirectory() as name:
        for place in range(settings.size(settings.repeats, 1) + 1):
            word, done = _started(Path(name), place, settings.size(100, 2))
            if place:  # the first one may have built what is kept
                words.append(word)
                runs.append(done)
    first, done = statistics.median(words), statistics.median(runs)
    return [
        Figure(
            "campaign of SCARA runs, first line on the screen, seconds", first, FIRST_WORD_S, "at most", {"s": first}
        ),
        Figure("campaign of SCARA runs, first run done, seconds", done, FIRST_RUN_S, "at most", {"s": done}),
    ]


def _started(folder: Path, place: int, count: int) -> tuple[float, float]:
    """Seconds to the first line and to the first run of a campaign of so many."""
    path = folder / f"{place}.yaml"
    vary = {"train.torque.rate_hz": [10], "validation.torque.rate_hz": [10]}
    content = {
        "schema": 1, "name": f"start {place}", "case": str(CASE), "vary": vary, "seeds": count,
        "noise": {"relative": 0.05},
    }  # fmt: skip
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    order = [*command(), "campaign", "run", str(path), "--out", str(folder / f"run{place}"), "--workers", str(WORKERS)]
    begin = time.perf_counter()
    process = subprocess.Popen(order, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert process.stdout is not None
    first = None
    try:
        for line in process.stdout:
            first = first or time.perf_counter() - begin
            found = _PROGRESS.search(line)
            if found and int(found[1]) > 0:
                return first, time.perf_counter() - begin
    finally:
        process.send_signal(signal.SIGINT)  # by which it ends its workers, too
        process.communicate(timeout=60)
    raise RuntimeError("The campaign ended without a run.")


__all__ = ["run"]
