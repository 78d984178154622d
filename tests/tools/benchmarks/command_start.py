"""How long ``fmu-didim --help`` takes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.tools.benchmarks.figure import Figure, Settings, interleaved


def command() -> list[str]:
    """``fmu-didim`` of this environment."""
    found = [p for name in ("fmu-didim", "fmu-didim.exe") if (p := Path(sys.executable).parent / name).is_file()]
    return [str(found[0])] if found else [sys.executable, "-c", "from fmu_didim.cli.main import main; main()"]


def run(settings: Settings) -> list[Figure]:
    """Wall time against ``python -c pass``, both in fresh processes."""

    def call(arguments: list[str]) -> None:
        subprocess.run(arguments, check=True, capture_output=True)

    times = interleaved(
        {"help": lambda: call([*command(), "--help"]), "nothing": lambda: call([sys.executable, "-c", "pass"])},
        repeats=2 * settings.repeats,
    )
    return [
        Figure(
            "fmu-didim --help / python -c pass", times.ratio("help", "nothing"), 8, "at most",
            {"help_ms": 1e3 * times.median("help"), "python_ms": 1e3 * times.median("nothing")},
        )
    ]  # fmt: skip
