"""Which wheels of the tested versions there are, for which system and Python: asked of the package index by uv."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.figures import FOLDER, table, write_figures
from tests.tools.versions.environments import EXTRAS, constraints, requirements, uv

FILE = FOLDER / "wheels.json"
SYSTEMS: Mapping[str, str] = {
    "Linux x64": "x86_64-manylinux_2_28", "Linux arm64": "aarch64-manylinux_2_28",
    "Windows x64": "x86_64-pc-windows-msvc", "Windows arm64": "aarch64-pc-windows-msvc",
    "macOS arm64": "aarch64-apple-darwin", "macOS x64": "x86_64-apple-darwin",
    "Linux x64, musl": "x86_64-unknown-linux-musl", "Linux arm64, musl": "aarch64-unknown-linux-musl",
}  # fmt: skip
"""Systems -> their names in uv."""
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
ALL = "all"


def missing(system: str, python: str, pins: Mapping[str, str]) -> list[str]:
    """Those of the packages that have no wheel for a system and a Python."""
    if _resolves(system, python, pins):
        return []
    return [name for name, version in pins.items() if not _resolves(system, python, {name: version})]


def _resolves(system: str, python: str, pins: Mapping[str, str]) -> bool:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "requirements.in"
        file.write_text("".join(f"{name}=={version}\n" for name, version in pins.items()), encoding="utf-8")
        target = ("--python-platform", SYSTEMS[system], "--python-version", python, "--only-binary", ":all:")
        command = ("pip", "compile", "--quiet", "--no-deps", "--python", sys.executable, *target, str(file))
        done = uv(*command, check=False)
    if done.returncode and not ("No solution found" in done.stderr and "wheels" in done.stderr):
        raise subprocess.CalledProcessError(done.returncode, command, stderr=done.stderr)  # no answer, and not a "no"
    return done.returncode == 0


def found() -> dict[str, dict[str, list[str]]]:
    """System -> Python -> packages without a wheel, of what the package and its extras need at the tested versions."""
    tested = constraints()
    pins = {name: tested[name] for name in requirements(*EXTRAS)}
    return {system: {python: missing(system, python, pins) for python in PYTHONS} for system in SYSTEMS}


def record(file: Path = FILE) -> dict[str, dict[str, list[str]]]:
    """Ask for all, and keep the answers for docs/platforms.md."""
    answers = found()
    rows = [
        [name, *(", ".join(f"no {package}" for package in row[python]) or ALL for python in PYTHONS)]
        for name, row in answers.items()
    ]
    figures = {"wheels": table(["system", *PYTHONS], rows)}
    write_figures(file, "python -m tests.tools.versions wheels", figures, data=answers)
    return answers
