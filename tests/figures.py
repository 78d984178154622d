"""Writes files of figures for the pages: what was measured, by which command, when, by which versions, on what.

``docs/include.py`` puts them into the pages. Python alone is enough, so that it also writes where nothing is installed.
"""

from __future__ import annotations

import json
import os
import platform
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from fmu_didim.base.version import __version__

FOLDER = Path(__file__).parents[1] / "docs" / "figures"
PACKAGES = ("numpy", "scipy", "casadi")


def command_of(module: str, arguments: Sequence[str]) -> str:
    """The command line that writes a file: ``python -m <module> <arguments>``."""
    return shlex.join(["python", "-m", module, *arguments])


def today() -> str:
    """The date in UTC, year-month-day."""
    return datetime.now(UTC).date().isoformat()


def versions() -> dict[str, str]:
    """Of the project, of Python and of the packages that compute, where they are installed."""
    found = {"fmu_didim": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def machine() -> str:
    """The kind of machine: cores, processor, system."""
    return f"{os.cpu_count()} cores, {_processor()}, {platform.system()}"


def _processor() -> str:
    """Its model where the system says it, else its kind."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()


def write_figures(path: Path, command: str, figures: Mapping[str, str | Sequence[str]], *, data: Any = None) -> None:
    """Write a file of figures.

    Args:
        figures: name -> text as pages show it, or lines of a block. data: what the texts were made of, if it is kept.
    """
    content: dict[str, Any] = {"command": command, "date": today(), "versions": versions(), "machine": machine()}
    content["figures"] = {name: value if isinstance(value, str) else list(value) for name, value in figures.items()}
    if data is not None:
        content["data"] = data
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a table."""
    return [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads), *(f"| {' | '.join(row)} |" for row in rows)]
