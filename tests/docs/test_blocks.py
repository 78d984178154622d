"""Every block of the documentation runs, and prints what stands below it.

``sh`` and ``python`` blocks of a page run one after another in a folder with the examples; a ``text`` block right
below one is a part of what it prints, ``...`` standing for anything. A ``yaml`` block whose first line is a comment
with a path is written there; all others must be valid parts of a case, an experiment, a robot or a controller. What
is not run stands in NOT_RUN with its reason; its commands must be those that there are. Any other block is refused.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import BaseModel, TypeAdapter

from fmu_didim.campaigns.document import CampaignDocument
from fmu_didim.case.document import CaseDocument
from fmu_didim.case.sources import ComponentSource, ExperimentSource
from fmu_didim.cli import _parser
from fmu_didim.controllers import LAWS
from fmu_didim.robot import RobotDescription
from tests.conftest import ROOT
from tests.workflow import test_init

README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").rglob("*.md"))]
COPIED = ("examples", "fmus", "controllers")
BLOCK = re.compile(r"^```(\S+)\n(.*?)^```$", re.M | re.S)
SETUP = re.compile(r"^python3 -m venv \.venv && \.venv/bin/pip install -q \. && \.venv/bin/(?=fmu-didim)")
"""How the first block of the README begins: the gate and ``fresh-clone`` run it whole, the tests what follows."""
NOT_RUN: Mapping[tuple[str, str], str] = {
    ("README", 'python3 -m venv .venv && .venv/bin/pip install -q -e ".[test]" && .venv/bin/python -m pytest'): (
        "these tests themselves, which the gate runs by this line"
    ),
    ("tutorial", "$ git clone <this repository> fmu_didim && cd fmu_didim"): "as the first block of the README",
    ("add-an-effect", "$ fmu-didim discover case.yaml --effect my_effects:RootFriction"): (
        "takes minutes; tests/discovery/test_new_effect.py finds two effects of this kind"
    ),
    ("modelica", 'loadModel(Modelica); loadFile("Drive.mo");'): "needs OpenModelica",
    ("discovery", "python -m tests.blind make DIR --seeds 20 --rates 100 20 --level 1.5 --clean 20"): (
        "takes days; tests/blind/test_blind.py runs the three commands with few cases"
    ),
}
"""Page and first line of blocks that are not run -> why."""
GENERATED = "reference"
"""Folder of the pages that ``docs/make_reference.py`` writes: their blocks are signatures, usages and equations."""
DIRECTIVES = ("{toctree}",)
"""Blocks that are for Sphinx, whose build is tested in test_build.py."""
PARTS: tuple[type[BaseModel], ...] = (CaseDocument, ExperimentSource, RobotDescription, ComponentSource)


@dataclass(frozen=True)
class Block:
    """A fenced block; ``shown`` is the text block right below it."""

    kind: str
    text: str
    shown: str = ""

    @property
    def first(self) -> str:
        """Its first line."""
        return self.text.partition("\n")[0]


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found: list[Block] = []
    end = 0
    for match in BLOCK.finditer(text):
        is_shown = match[1] == "text" and found and not text[end : match.start()].strip()
        if is_shown and found[-1].kind in ("sh", "python"):
            found[-1] = Block(found[-1].kind, found[-1].text, match[2])
        else:
            found.append(Block(match[1], match[2]))
        end = match.end()
    return found


def is_run(page: Path, block: Block) -> bool:
    return block.kind in ("sh", "python") and page.parent.name != GENERATED and (page.stem, block.first) not in NOT_RUN


SBATCH = """#!/bin/sh
# A queue of one place: the first job runs at once, all others wait for ever.
if mkdir running 2> /dev/null; then
    setsid sh "$1" > job.log 2>&1 &
    echo "Submitted batch job $!"
else
    echo "Submitted batch job 999999999"
fi
"""
SCANCEL = """#!/bin/sh
for job in "$@"; do kill -TERM -- "-$job" 2> /dev/null; done
exit 0
"""
"""The two commands of Slurm that ``dask-jobqueue`` calls, on this machine."""


MODULES = {"fmu-didim": "fmu_didim.cli", "dask": "dask"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with the examples, where fmu-didim is on the path."""
    for name in COPIED:
        shutil.copytree(ROOT / name, tmp_path / name)
    (tmp_path / "bin").mkdir()
    programs = {name: f'#!/bin/sh\nexec "{sys.executable}" -m {module} "$@"\n' for name, module in MODULES.items()}
    for name, text in (programs | {"sbatch": SBATCH, "scancel": SCANCEL}).items():
        program = tmp_path / "bin" / name
        program.write_text(text)
        program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("my_effects", None)


BUSY = dict.fromkeys(("campaigns", "cluster", "discovery", "modelica"), pytest.mark.slow)
"""Pages that are not run at the gate: on a busy machine Dask's own processes may not come or go in time, discoveries on
six joints take minutes, and the campaign and the Modelica example of the README are enough there."""


def _fill_in(folder: Path) -> None:
    """What no file says in the case that ``init`` has written from those of :func:`test_init.as_csv`."""
    drive = zip(test_init.CONSTANT, test_init.GEAR, strict=True)
    test_init.filled(folder / "mycase/case.yaml", *(f"{value:g}" for joint in drive for value in joint))
    test_init.filled(folder / "mycase/robot.yaml", *test_init.GEOMETRY)
    test_init.filled(folder / "mycase/controller.yaml", "3700", "62", "230", "4")


BEFORE: Mapping[str, Callable[[Path], object]] = {
    "fmu-didim init bahn_soll.csv bahn_strom.csv --law pd --out mycase": test_init.as_csv,
    "fmu-didim check mycase/case.yaml": _fill_in,
}
"""First line of a block -> what its reader has done before."""


@pytest.mark.parametrize(
    "page",
    [pytest.param(p, marks=BUSY.get(p.stem, ()), id=p.stem) for p in PAGES if any(is_run(p, b) for b in blocks(p))],
)
def test_blocks_of_a_page_run_and_print_what_it_says(page: Path, folder: Path) -> None:
    names: dict[str, Any] = {"__name__": "page"}
    for block in blocks(page):
        place = re.match(r"# (\S+\.yaml)\n", block.text)
        if block.kind == "yaml" and place:
            (folder / place[1]).parent.mkdir(exist_ok=True)
            (folder / place[1]).write_text(block.text, encoding="utf-8")
        if not is_run(page, block):
            continue
        BEFORE.get(block.first, lambda folder: None)(folder)
        printed = _shell(SETUP.sub("", block.text)) if block.kind == "sh" else _python(block.text, names)
        if block.shown:
            assert prints(printed, block.shown), f"{block.text}\nprints\n{printed}\nand not\n{block.shown}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_block_is_run_or_has_a_reason_not_to(page: Path) -> None:
    fences = re.findall(r"^\s*(?:```|~~~)", page.read_text(encoding="utf-8"), re.M)
    assert len(fences) == 2 * len(BLOCK.findall(page.read_text(encoding="utf-8"))), "a fence that is not understood"
    if page.parent.name == GENERATED:
        return
    outputs = [block.shown for other in PAGES for block in blocks(other) if block.shown and is_run(other, block)]
    for block in blocks(page):
        repeats = block.kind == "text" and any(block.text in shown for shown in outputs)
        known = is_run(page, block) or repeats or block.kind in ("yaml", *DIRECTIVES)
        assert known or (page.stem, block.first) in NOT_RUN, f"nobody runs this block:\n{block.text}"


def test_what_is_not_run_stands_there() -> None:
    assert set(NOT_RUN) <= {(page.stem, block.first) for page in PAGES for block in blocks(page)}


@pytest.mark.parametrize("page", [ROOT / "CONTRIBUTING.md", *PAGES], ids=lambda page: page.stem)
def test_every_command_that_is_named_is_one(page: Path) -> None:
    """Those in blocks that are not run, in running text and in tables: the verb and its options exist."""
    text = page.read_text(encoding="utf-8")
    shown = [b.text.replace("\\\n", " ") for b in blocks(page) if b.kind in ("sh", "console", "text")]
    found = [m[1] for part in shown for m in re.finditer(r"^ *(?:\$ )?fmu-didim ([^\n#|&]*)", part, re.M)]
    inline = re.findall(r"`fmu-didim ([^`|]*)`", BLOCK.sub("", text))
    wrong = [command for command in (*found, *inline) if not _exists(command)]
    assert not wrong


def _exists(command: str) -> bool:
    """Whether the parser knows the verb and the options of a command line."""
    parser = _parser()
    for word in shlex.split(command):
        verbs = next((a for a in parser._actions if isinstance(a, argparse._SubParsersAction)), None)
        if word.startswith("-"):
            if word.partition("=")[0] not in parser._option_string_actions:
                return False
        elif verbs is not None:
            if word not in verbs.choices:
                return False
            parser = verbs.choices[word]
    return True


@pytest.mark.parametrize(
    ("command", "known"),
    [("identify a.yaml --out b", True), ("campaign retry", True), ("--help", True), ("identify --wrong", False),
     ("campaign go", False), ("export a.yaml --ssp=b", True)],
)  # fmt: skip
def test_commands_are_told_from_what_is_none(command: str, known: bool) -> None:
    assert _exists(command) == known


FAILS = {
    "fmu-didim init bahn_soll.csv bahn_strom.csv --law pd --out mycase": 1,  # places are still to be filled in
    "fmu-didim check mycase/case.yaml": 4,  # the answer is doubtful
}
"""First line of a block -> the exit code that its last command has, as the page says."""


def _shell(text: str) -> str:
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", text], capture_output=True, text=True, check=False)
    assert done.returncode == FAILS.get(text.partition("\n")[0], 0), f"{text}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def _python(text: str, names: dict[str, Any]) -> str:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(text, "page", "exec"), names)
    return printed.getvalue()


def prints(printed: str, shown: str) -> bool:
    """Whether a text holds what a page shows of it, ``...`` standing for anything."""
    return bool(re.search(re.escape(shown.strip("\n")).replace(re.escape("..."), ".*?"), printed, re.S))


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


def test_dots_stand_for_anything() -> None:
    assert prints("x\na b c\nmore\nd.\n", "a ... c\n...\nd.\n")
    assert not prints("ab", "a b")
