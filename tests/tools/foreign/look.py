"""What becomes of one FMU or one system, in a process of its own: a program of another tool may crash or hang it.

python -m tests.tools.foreign.look FILE.fmu
python -m tests.tools.foreign.look FOLDER/SystemStructure.ssd
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu import FmuProbe, load_fmu, probe_fmu, read_description
from fmu_didim.components.fmu.inspection.probe import HALF_STEP
from fmu_didim.components.fmu.reuse.trials import SAME, Change
from fmu_didim.cosim import simulate
from fmu_didim.data.signals import trajectory
from fmu_didim.ssp import read_ssp
from tests.helpers import ROOT

PROBE_S, PEER_S, ALL_S = 120.0, 60.0, 300.0
"""Seconds for the check, for FMPy, and for a process."""
STEPS, STEP_S = 200, 0.01
"""Of the run of a system."""
RUNS, FAILS, REFUSED = "runs", "does not run", "refused"


def look(path: Path) -> dict[str, Any]:
    """The record of a file, from a process of its own."""
    begin = time.monotonic()
    command = [sys.executable, "-m", "tests.tools.foreign.look", str(path)]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=ALL_S, check=False)
    except subprocess.TimeoutExpired:
        return {"answer": FAILS, "says": f"the check itself did not end within {ALL_S:g} s", "seconds": ALL_S}
    told = done.stdout.splitlines()
    if done.returncode or not told:
        return {"answer": FAILS, "says": f"the check itself ended with {done.returncode}", "seconds": 0.0}
    return {**json.loads(told[-1]), "seconds": round(time.monotonic() - begin, 1)}


def fmu(path: Path) -> dict[str, Any]:
    """Who made an FMU, what the check says of it, and whether FMPy runs it where it does not run here."""
    facts: dict[str, Any] = {"made_by": "", "fmi": ""}
    try:
        description = read_description(path)
        facts = {"made_by": description.tool, "fmi": description.version}
        found = probe_fmu(load_fmu(path), whole_s=PROBE_S)
    except FmuDidimError as error:
        return {**facts, "answer": REFUSED, "says": _first(str(error)), "peer": peer(path)}
    if found.facts.failure:
        return {**facts, "answer": FAILS, "says": _first(found.facts.failure), "peer": peer(path)}
    return {**facts, "answer": RUNS, "says": "; ".join(_remarks(found))}


def _remarks(found: FmuProbe) -> list[str]:
    remarks: list[tuple[Any, str]] = [
        (True, f"again by {found.rerun.strategy}"),
        (found.facts.single, "one instance a process"),
        (_is_above(found.half_step, HALF_STEP), "another result at half the step"),
        (_is_above(found.reading, SAME), "reading its outputs changes what follows"),
        (found.undeclared, "outputs follow at once against its description"),
        (
            not (found.facts.deterministic and found.facts.reproducible) and not found.facts.single,
            "instances or processes differ",
        ),
        (not found.outputs, "no outputs"),
    ]
    return [text for holds, text in remarks if holds]


def _is_above(change: Change | None, limit: float) -> bool:
    return change is not None and change[1] > limit


def peer(path: Path) -> str:
    """Whether FMPy's ``simulate_fmu`` comes to an end: ``runs``, ``does not run`` or ``hangs``."""
    code = "import sys, fmpy; fmpy.simulate_fmu(sys.argv[1])"
    command = [sys.executable, "-c", code, str(path)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=PEER_S, check=False)
    except subprocess.TimeoutExpired:
        return "hangs"
    return RUNS if done.returncode == 0 else FAILS


def system(structure: Path) -> dict[str, Any]:
    """What happens to a folder with a ``SystemStructure.ssd``, zipped as it is, read and run."""
    with tempfile.TemporaryDirectory() as scratch:
        archive = Path(scratch) / "system.ssp"
        with zipfile.ZipFile(archive, "w") as zipped:
            for file in sorted(structure.parent.rglob("*")):
                if file.is_file():
                    zipped.write(file, file.relative_to(structure.parent))
        try:
            read = read_ssp(archive, step_size=STEP_S)
        except FmuDidimError as error:
            return {"answer": REFUSED, "says": _first(str(error))}
        try:
            simulate(read, trajectory(np.arange(STEPS + 1) * STEP_S, {}))
        except FmuDidimError as error:
            return {"answer": FAILS, "says": _first(str(error))}
    return {"answer": RUNS, "says": ""}


def _first(text: str) -> str:
    """What an error says first, without places of this machine."""
    line = text.strip().splitlines()[0] if text.strip() else ""
    words = [word for word in line.split(" ") if "/" not in word or (word.count("/") == 1 and not word.startswith("/"))]
    return " ".join(words)[:200]


def main() -> None:
    """Print the record as one line of JSON."""
    path = Path(sys.argv[1])
    kind: Callable[[Path], dict[str, Any]] = fmu if path.suffix == ".fmu" else system
    with contextlib.redirect_stdout(sys.stderr):  # what a program of another tool prints is no answer
        found = kind(path)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
