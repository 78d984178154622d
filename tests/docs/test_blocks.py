"""Every block of the documentation runs, and prints what stands below it.

``sh`` and ``python`` blocks of a page run one after another in a folder with the examples; a ``text`` block right
below one is a part of what it prints, ``...`` standing for anything. A ``yaml`` block whose first line is a comment
with a path is written there; all others must be valid parts of a case, an experiment, a robot or a controller.
Other kinds are not run, nor the commands of the README, which set the project up.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from pydantic import BaseModel, TypeAdapter

from fmu_didim.campaigns.document import CampaignDocument
from fmu_didim.case.document import CaseDocument
from fmu_didim.case.sources import ComponentSource, ExperimentSource
from fmu_didim.controllers import LAWS
from fmu_didim.robot import RobotDescription
from tests.conftest import ROOT

README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").rglob("*.md"))]
COPIED = ("examples", "fmus", "controllers")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
PARTS: tuple[type[BaseModel], ...] = (CaseDocument, ExperimentSource, RobotDescription, ComponentSource)


@dataclass(frozen=True)
class Block:
    """A fenced block; ``shown`` is the text block right below it."""

    kind: str
    text: str
    shown: str = ""


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found: list[Block] = []
    end = 0
    for match in BLOCK.finditer(text):
        if match[1] == "text" and found and not text[end : match.start()].strip():
            found[-1] = Block(found[-1].kind, found[-1].text, match[2])
        elif match[1] != "text" and not (page == README and match[1] == "sh"):
            found.append(Block(match[1], match[2]))
        end = match.end()
    return found


def runs(page: Path) -> bool:
    """Whether it has blocks to be run; those of the discovery take hours, those of the reference are signatures."""
    kinds = {block.kind for block in blocks(page)}
    return bool(kinds & {"sh", "python"}) and page.name != "discovery.md" and page.parent.name != "reference"


def queue(**options: Any) -> Any:
    """Dask's cluster on this machine in the place of that of a queue."""
    from distributed import LocalCluster

    assert set(options) == {"cores", "processes", "memory", "walltime", "worker_extra_args"}
    made = LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None)
    made.scale = lambda jobs: None
    return made


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with the examples, where fmu-didim is on the path."""
    for name in COPIED:
        shutil.copytree(ROOT / name, tmp_path / name)
    (tmp_path / "bin").mkdir()
    for name, module in (("fmu-didim", "fmu_didim.cli"), ("dask", "dask")):
        program = tmp_path / "bin" / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m {module} "$@"\n')
        program.chmod(0o755)
    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=queue))  # type: ignore[arg-type]
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("my_effects", None)


BUSY = {"cluster": pytest.mark.slow}
"""Pages that are not run at the gate: on a busy machine Dask's own processes may not come or go in time."""


@pytest.mark.parametrize("page", [pytest.param(p, marks=BUSY.get(p.stem, ()), id=p.stem) for p in PAGES if runs(p)])
def test_blocks_of_a_page_run_and_print_what_it_says(page: Path, folder: Path) -> None:
    names: dict[str, Any] = {"__name__": "page"}
    for block in blocks(page):
        place = re.match(r"# (\S+\.yaml)\n", block.text)
        if block.kind == "yaml" and place:
            (folder / place[1]).parent.mkdir(exist_ok=True)
            (folder / place[1]).write_text(block.text, encoding="utf-8")
        printed = {"sh": _shell, "python": lambda text: _python(text, names)}.get(block.kind, lambda text: "")(
            block.text
        )
        if block.shown:
            assert re.search(_pattern(block.shown), printed, re.S), (
                f"{block.text}\nprints\n{printed}\nand not\n{block.shown}"
            )


def _shell(text: str) -> str:
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", text], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def _python(text: str, names: dict[str, Any]) -> str:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(text, "page", "exec"), names)
    return printed.getvalue()


def _pattern(shown: str) -> str:
    return re.escape(shown.strip("\n")).replace(re.escape("..."), ".*?")


@pytest.mark.parametrize(
    ("page", "text"),
    [(page.name, block.text) for page in PAGES for block in blocks(page) if block.kind == "yaml"],
)
def test_yaml_is_a_valid_part(page: str, text: str) -> None:
    content = yaml.safe_load(text)
    if "law" in content:
        LAWS[content["law"]].model_validate(content)
        return
    if "vary" in content:
        CampaignDocument.model_validate(content)
        return
    aliases = [{info.alias or name: info.annotation for name, info in part.model_fields.items()} for part in PARTS]
    known = next(fields for fields in aliases if set(content) <= set(fields))
    for key, value in content.items():
        TypeAdapter(known[key]).validate_python(value)
    if "joints" in content:
        RobotDescription.model_validate(content)


def test_pattern() -> None:
    assert re.search(_pattern("a ... c\n...\nd.\n"), "x\na b c\nmore\nd.\n", re.S)
    assert not re.search(_pattern("a b"), "ab")
