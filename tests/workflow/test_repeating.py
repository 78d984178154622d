"""The command on a page, pasted into a shell in the folder that the page names, repeats the run."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fmu_didim.case import load_case
from fmu_didim.cli.main import main
from fmu_didim.data.signals import trajectory
from fmu_didim.workflow.case_files import repeating
from tests.conftest import ROOT
from tests.docs.test_blocks import programs


@pytest.mark.gate
@pytest.mark.skipif(sys.platform == "win32", reason="pasted into a POSIX shell")
def test_the_command_of_the_page_repeats_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From a folder that is not that of the case; both have blanks and an umlaut in their names."""
    here = tmp_path / "my wörk"
    for name in ("examples/scara", "fmus", "controllers"):
        shutil.copytree(ROOT / name, here / "the cases" / name)
    monkeypatch.chdir(here)
    case = Path("the cases/examples/scara/identify.yaml")
    assert main(["identify", str(case), "--out", "the results/a", "--quiet"]) == 0
    result = here / "the results/a/result.json"
    first = json.loads(result.read_text(encoding="utf-8"))
    page = html.unescape((result.parent / "report.html").read_text(encoding="utf-8"))
    found = re.search(r"in the folder <code>(.*?)</code>:</p>\s*<pre class=\"command\">(.*?)</pre>", page)
    assert found is not None
    folder, command = found.groups()
    assert (folder, command) == (first["provenance"]["folder"], first["provenance"]["command"])
    shutil.rmtree(result.parent)
    path = f"{programs(tmp_path / 'bin')}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}
    subprocess.run(["sh", "-c", command], cwd=folder, env=environment, check=True, capture_output=True)
    again = json.loads(result.read_text(encoding="utf-8"))
    for one in (first, again):
        del one["provenance"]["made"]
    assert again == first


def test_options_of_a_discovery_are_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    case = load_case("examples/scara/identify.yaml")
    options = {
        "forbid": ["delay", "lag"],
        "effect": ["my folder/own.py:Root"],
        "rounds": 2,
        "time_limit": None,
    }
    record = repeating("discover", case, Path("my results"), options)
    assert record["folder"] == str(ROOT)
    assert record["command"] == (
        "fmu-didim discover examples/scara/identify.yaml --out 'my results' --forbid delay --forbid lag"
        " --effect 'my folder/own.py:Root' --rounds 2"
    )


def test_what_is_in_memory_has_no_such_command() -> None:
    """Nothing but the script that made it would repeat it."""
    case = load_case("examples/scara/identify.yaml")
    assert not repeating("identify", case.with_(torque_std=[0.1, 0.1]), None)
    assert repeating("identify", case, None)
    run = case.model.experiments["estimation"]
    log = trajectory(run.time, {f"tau{j}": run.torque[:, j - 1] for j in (1, 2)})
    assert not repeating("identify", case.with_signals({"train_10hz.csv": log}), None)
