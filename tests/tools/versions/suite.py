"""Runs a part of the tests in an environment, counts what came out, and keeps it as a row of docs/platforms.md."""

from __future__ import annotations

import json
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.figures import FOLDER, table, today, write_figures
from tests.tools.versions.environments import ROOT, installed

FILE = FOLDER / "platforms.json"
MAIN = ("numpy", "scipy", "casadi", "pandas", "pyarrow", "fmpy", "control", "ziglang")
"""Packages whose versions a row tells."""
SMOKE = ("-m", "smoke", "tests/smoke")
PLAIN = ("-o", "addopts=", "-q", "-ra")
"""Options in place of those of ``pyproject.toml``, which need pytest-xdist."""
COMPILERS = ("cc", "gcc", "clang", "cl")
COMMAND = "python -m tests.tools.versions here --record"
HEADS = ("system", "Python", "versions", "what was run", "user", "passed", "failed", "skipped", "date")

Row = dict[str, Any]


def run(python: Path | str, tests: Sequence[str], *, which: str) -> Row:
    """Run tests by the Python of an environment, with a cache of its own; their output is shown.

    Args:
        which: the versions in words, such as ``lowest``.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        environment = {**os.environ, "FMU_DIDIM_CACHE": str(Path(folder) / "cache")}
        command = [str(python), "-m", "pytest", *PLAIN, *tests, f"--junitxml={report}"]
        begin = time.monotonic()
        done = subprocess.run(command, cwd=ROOT, env=environment, check=False)
        counts = counted(report) if report.is_file() else {"passed": 0, "failed": 0, "skipped": 0}
        seconds = round(time.monotonic() - begin)
    what = shlex.join(["python", "-m", "pytest", *tests])
    return {**here(python), "which": which, "what": what, **counts, "exit": done.returncode, "seconds": seconds}


def counted(report: Path) -> dict[str, int]:
    """How many tests of a JUnit report passed, failed and were skipped."""
    suites = ET.parse(report).getroot().iter("testsuite")
    every = [{key: int(suite.get(key, "0")) for key in ("tests", "failures", "errors", "skipped")} for suite in suites]
    total = {key: sum(one[key] for one in every) for key in ("tests", "failures", "errors", "skipped")}
    failed = total["failures"] + total["errors"]
    return {"passed": total["tests"] - failed - total["skipped"], "failed": failed, "skipped": total["skipped"]}


def readme() -> Row:
    """The first block of the README, in a clone with nothing beside it."""
    block = (ROOT / "README.md").read_text(encoding="utf-8").split("```sh\n")[1].split("```")[0].strip()
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "alone" / "fmu_didim"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        environment = {k: v for k, v in os.environ.items() if not k.startswith("FMU_DIDIM") and k != "PYTHONPATH"}
        environment["FMU_DIDIM_CACHE"] = str(Path(folder) / "cache")
        done = subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=clone, env=environment, check=False)
        row = here(clone / ".venv/bin/python") if done.returncode == 0 else here(sys.executable)
    return row | {
        "which": "newest releases", "what": "README, first block", "exit": done.returncode,
        "passed": int(done.returncode == 0), "failed": int(done.returncode != 0), "skipped": 0,
        "seconds": round(time.monotonic() - begin),
    }  # fmt: skip


def here(python: Path | str) -> Row:
    """What system, compiler, user and Python these are, with the versions in its environment."""
    code = "import platform; print(platform.python_version())"
    version = subprocess.run([str(python), "-c", code], check=True, text=True, capture_output=True).stdout.strip()
    return {
        "platform": system(), "compiler": next((name for name in COMPILERS if shutil.which(name)), ""),
        "user": "root" if hasattr(os, "geteuid") and os.geteuid() == 0 else "not root", "python": version,
        "packages": installed(python, MAIN), "date": today(),
    }  # fmt: skip


def system() -> str:
    """System and processor: ``Debian GNU/Linux 13 (trixie), x86_64``."""
    try:
        name = platform.freedesktop_os_release()["PRETTY_NAME"]
    except OSError:
        name = f"{platform.system()} {platform.release()}"
    return f"{name}, {platform.machine()}"


def record(row: Row, file: Path = FILE) -> None:
    """Keep a row, in place of an earlier one of the same system, Python, versions, user and tests."""
    rows = json.loads(file.read_text(encoding="utf-8"))["data"] if file.is_file() else []
    rows = sorted([*(old for old in rows if _key(old) != _key(row)), row], key=_key)
    write_figures(file, COMMAND, {"runs": table(HEADS, [_cells(one) for one in rows])}, data=rows)


def _key(row: Row) -> tuple[str, ...]:
    return tuple(str(row[name]) for name in ("platform", "python", "which", "what", "user"))


def _cells(row: Row) -> list[str]:
    versions = ", ".join(f"{name} {version}" for name, version in row["packages"].items())
    system_ = row["platform"] + (f", {row['compiler']}" if row["compiler"] else ", no C compiler")
    counts = [str(row[name]) for name in ("passed", "failed", "skipped")]
    return [system_, row["python"], f"{row['which']}: {versions}", row["what"], row["user"], *counts, row["date"]]
