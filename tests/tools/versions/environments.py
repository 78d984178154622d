"""Fresh environments with the lowest versions that ``pyproject.toml`` states, or with the newest that there are."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[3]
CONSTRAINTS = ROOT / "constraints.txt"
EXTRAS = ("hdf5", "mf4", "ros", "cluster")
"""Extras of the package whose libraries the smoke suite uses."""
RUNNER = "pytest"
"""What the suite needs beside the package."""
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^\]]*\])?\s*([^;]*)")
_CONSTRAINT = re.compile(r"([A-Za-z0-9._-]+)==(\S+)")


class MissingToolError(Exception):
    """What makes the environments is not installed."""


def requirements(*extras: str, file: Path = ROOT / "pyproject.toml") -> dict[str, str]:
    """Name -> bounds, such as ``>=3.7,<4``, of what the package needs, and of what extras add.

    An extra that names others of the package (``fmu_didim[docs]``) has what these have.
    """
    project = tomllib.loads(file.read_text(encoding="utf-8"))["project"]
    lines = list(project["dependencies"])
    for extra in extras:
        lines += project["optional-dependencies"][extra]
    found: dict[str, str] = {}
    for line in lines:
        match = _REQUIREMENT.match(line)
        assert match is not None, line
        if normal(match[1]) == normal(project["name"]):
            found |= requirements(*re.findall(r"\w+", line.partition("[")[2]), file=file)
        else:
            found[normal(match[1])] = match[2].strip()
    return found


def normal(name: str) -> str:
    """The name of a package as all spellings of it are compared."""
    return re.sub(r"[-_.]+", "-", name).lower()


def lowest(bounds: Mapping[str, str]) -> list[str]:
    """The lower bounds as exact versions: ``casadi>=3.7,<4`` -> ``casadi==3.7``.

    Raises:
        ValueError: a package has no lower bound.
    """
    pins = []
    for name, bound in bounds.items():
        low = re.search(r"(?:>=|==)\s*([\w.]+)", bound)
        if low is None:
            raise ValueError(f"pyproject.toml states no lowest version of {name}.")
        pins.append(f"{name}=={low[1]}")
    return pins


def constraints(file: Path = CONSTRAINTS) -> dict[str, str]:
    """Name -> version of the file of tested versions."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return {normal(m[1]): m[2] for line in lines if (m := _CONSTRAINT.fullmatch(line))}


def uv(*arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
    """Run uv, which makes an environment in seconds.

    Raises:
        MissingToolError: it is not installed.
    """
    beside = str(Path(sys.executable).parent)
    program = shutil.which("uv", path=os.pathsep.join([beside, os.environ.get("PATH", "")]))
    if program is None:
        raise MissingToolError("This needs uv: pip install uv.")
    return subprocess.run([program, *arguments], check=check, text=True, capture_output=not check)


def fresh(folder: Path, packages: Iterable[str], *options: str) -> Path:
    """The Python of a new environment that holds this tree, its extras and further packages, all but it as wheels."""
    uv("venv", "--quiet", "--python", sys.executable, str(folder))
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    own = ["--editable", f"{ROOT}[{','.join(EXTRAS)}]"]
    wheels = ["--only-binary", ":all:", "--no-binary", "fmu_didim"]
    uv("pip", "install", "--quiet", "--python", str(python), *wheels, *options, *own, *packages)
    return python


def with_lowest(folder: Path) -> Path:
    """An environment of the lowest versions: those of ``pyproject.toml`` itself, so that each can be had."""
    runner = f"{RUNNER}{requirements('test')[RUNNER]}"
    return fresh(folder, lowest({**requirements(*EXTRAS), RUNNER: runner}))


def with_newest(folder: Path) -> Path:
    """An environment of the newest versions, those included that are not released yet."""
    return fresh(folder, [RUNNER], "--prerelease", "allow", "--upgrade")


def installed(python: Path | str, names: Sequence[str]) -> dict[str, str]:
    """Versions in an environment of those packages that are there."""
    code = "from importlib.metadata import distributions\nfor d in distributions(): print(d.name, d.version)"
    done = subprocess.run([str(python), "-c", code], check=True, text=True, capture_output=True)
    there = {normal(line.split()[0]): line.split()[1] for line in done.stdout.splitlines()}
    return {name: there[normal(name)] for name in names if normal(name) in there}
