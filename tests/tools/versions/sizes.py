"""How much room the packages take that ``pip install .`` brings, and what the large ones are for."""

from __future__ import annotations

import re
from importlib.metadata import Distribution, distribution, requires
from pathlib import Path

from packaging.requirements import Requirement

from tests.figures import FOLDER, write_figures

COMMAND = "python -m tests.tools.versions sizes"
FILE = FOLDER / "sizes.json"
LARGE = 20e6
"""[bytes] Packages from this size on have a row of their own."""
PURPOSES = {
    "ziglang": "the C compiler that makes FMUs and loops; the same on every machine",
    "casadi": "equations of robots and their exact derivatives",
    "pyarrow": "tables of campaigns and data files as Parquet",
    "scipy": "integrators, statistics, splines, MAT files",
    "pandas": "tables of results",
    "numpy": "arrays",
    "matplotlib": "`plot()` and figures for papers",
    "cmake": "required by FMPy; not used here",
    "fonttools": "fonts of Matplotlib",
    "pillow": "pictures of Matplotlib",
}


def needed(name: str = "fmu_didim") -> dict[str, Distribution]:
    """The packages that are installed with one, and with those, without extras."""
    found: dict[str, Distribution] = {}
    waiting = [name]
    while waiting:
        for text in requires(waiting.pop()) or ():
            wanted = Requirement(text)
            key = re.sub(r"[-_.]+", "-", wanted.name).lower()
            if key in found or (wanted.marker is not None and not wanted.marker.evaluate({"extra": ""})):
                continue
            found[key] = distribution(wanted.name)
            waiting.append(wanted.name)
    return found


def size(package: Distribution) -> int:
    """Bytes of its files, as installed."""
    files = (Path(str(package.locate_file(file))) for file in package.files or ())
    return sum(file.stat().st_size for file in files if file.is_file())


def record(file: Path = FILE) -> None:
    """Measure this environment, and write the file of figures."""
    sizes = {name: size(package) for name, package in needed().items()}
    large = sorted((name for name, bytes_ in sizes.items() if bytes_ >= LARGE), key=lambda name: -sizes[name])
    rest = sum(sizes.values()) - sum(sizes[name] for name in large)
    rows = [f"| {name} | {sizes[name] / 1e6:.0f} | {PURPOSES[name]} |" for name in large]
    table = ["| package | MB | what for |", "|---|---|---|", *rows]
    table += [f"| {len(sizes) - len(large)} others | {rest / 1e6:.0f} | |"]
    write_figures(file, COMMAND, {"total": f"{sum(sizes.values()) / 1e9:.1f} GB", "table": table})
