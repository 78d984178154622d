"""Whatever the machine's encoding is: files are UTF-8, every verb names the encoding of each file, and prints."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.discovery.helpers import arm_case
from tests.helpers import ROOT
from tests.workflow.naming.machine import HIDDEN, logged

DRIVER = r"""
import atexit, shlex, sys, sysconfig, traceback, warnings
from pathlib import Path
folders = [str(Path(sysconfig.get_path(name))) for name in ("stdlib", "purelib", "platlib")]
others = [folder for folder in folders[1:] if folder != folders[0]]
unsaid, real = set(), warnings.showwarning

def opener():
    # the file that opens another one by way of Python's library and NumPy's; none while modules are imported
    for frame in reversed(traceback.extract_stack()[:-2]):
        if frame.filename.startswith("<frozen importlib"):
            return None
        of_numpy = any(frame.filename.startswith(str(Path(folder) / "numpy")) for folder in others)
        of_python = frame.filename.startswith(folders[0]) and not any(map(frame.filename.startswith, others))
        if not (of_numpy or of_python or frame.filename.startswith("<")):
            return frame
    return None

def note(message, category, *place):
    if not issubclass(category, EncodingWarning):
        return real(message, category, *place)
    frame = opener()
    if frame is not None and not any(map(frame.filename.startswith, others)):
        unsaid.add(f"UNSAID {frame.filename}:{frame.lineno}")

warnings.showwarning = note
warnings.simplefilter("always", EncodingWarning)
from fmu_didim.cli.main import main
for line in sys.stdin.read().splitlines():
    code = main(shlex.split(line))
    print(f"ENDED {code} {line}", file=sys.stderr)
print("\n".join(sorted(unsaid)), file=sys.stderr)
"""
"""Runs verbs, one a line of standard input, and tells where a file is opened without an encoding."""


def run(lines: list[str], folder: Path, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """The driver in a process of its own, in a folder."""
    known = {name: value for name, value in os.environ.items() if not name.startswith(("LC_", "PYTHON", "LANG"))}
    known |= {"PYTHONPATH": str(ROOT), **environment}
    command = [sys.executable, "-X", "warn_default_encoding", "-c", DRIVER]
    return subprocess.run(
        command, input="\n".join(lines).encode(), capture_output=True, cwd=folder, env=known, check=False
    )


def written(path: Path, content: Any) -> Path:
    path.write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case, a campaign and a controller, whose names are not of ASCII letters."""
    folder = tmp_path_factory.mktemp("files")
    arm_case(folder, {"quadratic_viscous": {"Fq": 0.3}})
    case = yaml.safe_load((folder / "case.yaml").read_text(encoding="utf-8"))
    written(folder / "case.yaml", case | {"name": "Prüfstand σ", "description": "größer als – ²"})
    written(folder / "limits.yaml", {"velocity": [2], "acceleration": [8], "torque": [60]})
    scara = ROOT / "examples" / "scara" / "identify_200hz.yaml"
    rows = np.loadtxt(folder / "train_torque.csv", delimiter=",", skiprows=1)
    (folder / "logs").mkdir()
    for day in (1, 2):
        table = np.column_stack([rows[:, 0], rows[:, 1:] + 0.01 * day])
        np.savetxt(folder / "logs" / f"2024-05-0{day}.csv", table, delimiter=",", header="t,tau1", comments="")
    written(folder / "law.yaml", logged(folder, HIDDEN["cascade"], 3))
    written(folder / "campaign.yaml", {
        "name": "Läufe τ", "case": str(scara), "noise": {"relative": 0.05}, "seeds": 2,
        "vary": {"train.torque.rate_hz": [20]},
    })  # fmt: skip
    return folder


VERBS = [
    "validate case.yaml",
    "check case.yaml",
    "identify case.yaml --out identified --figures",
    "discover case.yaml --out discovered --rounds 1",
    "compare identified identified --out compared",
    "watch logs --case case.yaml --reference 1 --out watched",
    "name-controller law.yaml --out law",
    "excite case.yaml --torque-std 0.1 --limits limits.yaml --period 5 --periods 1 --starts 1 --out motion",
    "simulate case.yaml --out simulated.csv",
    f"export {ROOT}/controllers/scara_pd.yaml --out fmus",
    "fmu info fmus/scara_pd.fmu",
    "fmu check fmus/scara_pd.fmu",
    "init simulated.csv --out begun.yaml",
    "effects",
    "effects coulomb",
    "schema case",
    f"robot {ROOT}/fmus/scara/robot.yaml",
    "completion bash",
    "campaign run campaign.yaml --out campaign --workers 1",
    "campaign retry campaign",
    "campaign status campaign",
    "campaign report campaign",
    "campaign show campaign",
    "cache show",
    "cache clear fmus/scara_pd.fmu",
]
"""One of each verb; what does not end with 0 says so."""


def verbs_of_the_reference() -> set[str]:
    text = (ROOT / "docs/reference/commands.md").read_text(encoding="utf-8")
    return set(re.findall(r"^## fmu-didim (.+)$", text, re.MULTILINE))


def test_all_verbs_are_tried() -> None:
    missing = {verb for verb in verbs_of_the_reference() if not any(line.startswith(verb) for line in VERBS)}
    assert not missing - {"example"}  # it copies bytes


@pytest.mark.slow
def test_every_verb_names_the_encoding_of_its_files_and_prints_in_any(folder: Path) -> None:
    """On a machine that knows the letters of ASCII alone."""
    done = run(VERBS, folder, LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    told = done.stderr.decode("utf-8", "replace")
    assert "UNSAID" not in told
    assert "unexpected error" not in told and "Traceback" not in told, told
    ended = {line: code for code, line in re.findall(r"^ENDED (\d+) (.*?)\r?$", told, re.MULTILINE)}
    assert set(ended) == set(VERBS), told
    refused = {line for line, code in ended.items() if code not in "034"}
    assert refused == {line for line in VERBS if line.startswith("compare")}, told  # a log with itself
    page = (folder / "identified" / "report.html").read_text(encoding="utf-8")
    assert "Prüfstand σ" in page
    assert sys.platform != "linux" or done.stdout.isascii()
