"""Every block of the documentation runs as its reader runs it, and prints what stands below it.

A page has a fresh folder like a clone, with ``fmu-didim`` and ``python`` on the path. Its blocks run there one after
another, each in a process of its own: ``sh`` and the lines of a ``console`` block that begin with ``$`` in the shell,
``python`` as a script (blocks that no command stands between are one script). A ``text`` block right below one is a
part of what it prints, ``...`` standing for anything; so are the other lines of a ``console`` block. A ``yaml`` or
``python`` block whose first line is a comment with a path is written there; all other ``yaml`` must be valid parts of a
case, an experiment, a robot or a controller. What is not run stands in NOT_RUN with its reason; its commands must be
those that there are. Any other block is refused.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydantic import BaseModel, TypeAdapter

from fmu_didim.campaigns.planning.document import CampaignDocument
from fmu_didim.case.document import CaseDocument
from fmu_didim.case.sources import ComponentSource, ExperimentSource
from fmu_didim.cli.main import command_parser
from fmu_didim.controllers import LAWS
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.workflow.excitation.limits import MotionLimits
from tests.conftest import ROOT
from tests.workflow import test_init

README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").rglob("*.md"))]
LEFT_OUT = (".*", "fmu_didim", "tests", "results", "build", "dist", "_build", "__pycache__", "*.egg-info", "*.fmu")
"""What the folder of a page lacks: the package itself, which is installed, its tests, and what git ignores, except"""
KEPT = ("house.fmu",)
"""what git has all the same."""
BLOCK = re.compile(r"^```(\S+)\n(.*?)^```$", re.M | re.S)
SETUP = re.compile(r"^python3 -m venv \.venv && \.venv/bin/pip install -q \. && \.venv/bin/(?=fmu-didim)")
"""How the first block of the README begins: the gate and ``fresh-clone`` run it whole, the tests what follows."""
NOT_RUN: Mapping[tuple[str, str], str] = {
    ("README", 'python3 -m venv .venv && .venv/bin/pip install -q -e ".[test]" && .venv/bin/python -m pytest'): (
        "these tests themselves, which the gate runs by this line"
    ),
    ("tutorial", "$ git clone <this repository> fmu_didim && cd fmu_didim"): (
        "the address is not known; the gate installs a clone by the first block of the README"
    ),
    ("modelica", 'loadModel(Modelica); loadFile("Drive.mo");'): "needs OpenModelica",
    (
        "discovery",
        "python -m tests.tools.blind make seeds401 --seeds 20 --first-seed 401 --rates 100 20 --level 1.5 --clean 20",
    ): ("takes hours; tests/tools/blind/test_blind.py runs the three commands with few cases"),
}
"""Page and first line of blocks that are not run -> why."""
GENERATED = "reference"
"""Folder of the pages that ``docs/make_reference.py`` writes: their blocks are signatures, usages and equations."""
DIRECTIVES = ("{toctree}",)
"""Blocks that are for Sphinx, whose build is tested in test_build.py."""
PARTS: tuple[type[BaseModel], ...] = (
    CaseDocument, ExperimentSource, RobotDescription, ComponentSource, MotionLimits,
)  # fmt: skip


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        shown: what it prints, from the text block right below it; typed: the commands of a console block.
    """

    kind: str
    text: str
    shown: str = ""
    typed: Sequence[str] = ()

    @property
    def first(self) -> str:
        """Its first line."""
        return self.text.partition("\n")[0]

    @property
    def path(self) -> str | None:
        """Of the file that it is."""
        place = re.match(r"# (\S+\.(?:yaml|py))\n", self.text)
        return place[1] if place and self.kind in ("yaml", "python") else None


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found: list[Block] = []
    end = 0
    for match in BLOCK.finditer(text):
        is_shown = match[1] == "text" and found and not text[end : match.start()].strip()
        if is_shown and found[-1].kind in ("sh", "python"):
            found[-1] = Block(found[-1].kind, found[-1].text, match[2])
        elif match[1] == "console":
            typed = re.findall(r"^\$ (.*)$", match[2], re.M)
            found.append(Block("console", match[2], re.sub(r"^\$ .*\n", "...\n", match[2], flags=re.M), typed))
        else:
            found.append(Block(match[1], match[2]))
        end = match.end()
    return found


def is_run(page: Path, block: Block) -> bool:
    return (
        block.kind in ("sh", "python", "console")
        and page.parent.name != GENERATED
        and (page.stem, block.first) not in NOT_RUN
    )


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


STARTER = """import sys
from {} import main
if __name__ == "__main__":
    sys.exit(main())
"""


def programs(folder: Path) -> Path:
    """A folder for the path with what an installation has there, and with the commands of a queue."""
    folder.mkdir()
    texts = {"sbatch": SBATCH, "scancel": SCANCEL}
    for name, module in (("fmu-didim", "fmu_didim.cli.main"), ("dask", "dask.__main__")):
        # As pip writes it: a script, so that the working folder is not on Python's import path.
        (folder / f"run_{name}.py").write_text(STARTER.format(module))
        texts[name] = f'#!/bin/sh\nexec "{sys.executable}" "{folder}/run_{name}.py" "$@"\n'
    for name in ("python", "python3"):
        texts[name] = f'#!/bin/sh\nexec "{sys.executable}" "$@"\n'
    for name, text in texts.items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    return folder


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as of a clone, where fmu-didim is on the path."""
    clone = tmp_path / "fmu_didim"
    left_out = shutil.ignore_patterns(*LEFT_OUT)
    shutil.copytree(ROOT, clone, ignore=lambda path, names: left_out(path, names) - set(KEPT))
    monkeypatch.setenv("PATH", f"{programs(tmp_path / 'bin')}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.chdir(clone)
    return clone


BUSY = dict.fromkeys(
    ("campaigns", "cluster", "discovery", "modelica", "swap-controller", "low-rate", "examples"), pytest.mark.slow
)
"""Pages that are not run at the gate: on a busy machine Dask's own processes may not come or go in time, discoveries on
six joints take minutes, and what the campaign and the Modelica example of the README and the page of foreign FMUs run
is enough there. The examples have tests of their own."""


def _fill_in(folder: Path) -> None:
    """What no file says in the case that ``init`` has written from those of :func:`test_init.as_csv`."""
    drive = zip(test_init.CONSTANT, test_init.GEAR, strict=True)
    test_init.filled(folder / "mycase/case.yaml", *(f"{value:g}" for joint in drive for value in joint))
    test_init.filled(folder / "mycase/robot.yaml", *test_init.GEOMETRY)
    test_init.filled(folder / "mycase/controller.yaml", "3700", "62", "230", "4")


def _drive(folder: Path) -> None:
    """A drive with the friction of the page, logged; the case, which lacks it, is in the working folder."""
    from fmu_didim import load_case, simulate, trajectory, write_csv

    moves = {"train": ([0.8, -0.3, 0.2], [0.5, 0.4, -0.2]), "validation": ([-0.5, 0.4, 0.1], [0.6, -0.3, 0.3])}
    content: dict[str, object] = {
        "name": "drive", "robot": "robot.yaml", "controller": {"source": "controller.yaml"},
        **{
            run: {
                "reference": {"kind": "fourier", "fundamental_hz": 0.2, "duration_s": 10,
                              "joints": [{"cosine": cosine, "sine": sine}]},
                "torque": {"file": f"{run}.csv"},
            }
            for run, (cosine, sine) in moves.items()
        },
    }  # fmt: skip
    joint = {"type": "revolute", "effects": ["viscous"], "parameters": {"ZZ": 0.1, "Fv": 0.05}}
    true = {"effects": ["viscous", "my_effects:RootFriction"], "parameters": {"ZZ": 0.1, "Fv": 0.05, "Fr": 0.5}}
    law = {"law": "pd", "name": "drive_pd", "joints": ["revolute"], "rate_hz": 200, "Kp": [40], "Kd": [4]}
    robot = {"name": "drive", "gravity": [0, 0, 0], "joints": [joint]}
    files = {"robot": robot, "true": robot | {"joints": [joint | true]}, "controller": law, "case": content}
    for name, text in files.items():
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(text), encoding="utf-8")
    case = load_case(content | {"robot": "true.yaml"}, folder=folder, require_torque=False)
    for seed, run in enumerate(moves):
        motion = simulate(case, experiment="estimation" if run == "train" else run)
        noise = np.random.default_rng(seed).normal(0.0, 0.01, motion.time[::4].size)
        torque = motion.column("tau1")[::4] + noise
        write_csv(trajectory(motion.time[::4], {"tau1": torque}), folder / f"{run}.csv")
    (folder / "true.yaml").unlink()


BEFORE: Mapping[str, Callable[[Path], object]] = {
    "fmu-didim discover case.yaml --effect my_effects:RootFriction --out results/drive --quiet": _drive,
    "fmu-didim init bahn_soll.csv bahn_strom.csv --law pd --out mycase": test_init.as_csv,
    "fmu-didim check mycase/case.yaml": _fill_in,
}
"""First line of a block -> what its reader has done before."""


@pytest.mark.gate
@pytest.mark.parametrize(
    "page",
    [pytest.param(p, marks=BUSY.get(p.stem, ()), id=p.stem) for p in PAGES if any(is_run(p, b) for b in blocks(p))],
)
def test_blocks_of_a_page_run_and_print_what_it_says(page: Path, folder: Path) -> None:
    script: list[Block] = []
    for block in blocks(page):
        if block.path is not None:
            _python(script, folder)
            (folder / block.path).parent.mkdir(exist_ok=True)
            (folder / block.path).write_text(block.text, encoding="utf-8")
        elif is_run(page, block):
            BEFORE.get(block.first, lambda folder: None)(folder)
            if block.kind == "python":
                script.append(block)
                continue
            _python(script, folder)
            text = "\n".join(block.typed) if block.kind == "console" else SETUP.sub("", block.text)
            _compare(block, _run(["bash", "-euo", "pipefail", "-c", text], FAILS.get(block.first, 0)))
    _python(script, folder)


END_OF_BLOCK = "\x1e"


def _python(script: list[Block], folder: Path) -> None:
    """Run blocks as one script, and empty the list."""
    if not script:
        return
    path = folder / "of_this_page.py"
    path.write_text("".join(f"{block.text}\nprint({END_OF_BLOCK!r})\n" for block in script), encoding="utf-8")
    printed = _run(["python", path.name], 0).split(END_OF_BLOCK)
    for block, part in zip(script, printed[:-1], strict=True):
        _compare(block, part)
    script.clear()


def _run(command: Sequence[str], status: int) -> str:
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    assert done.returncode == status, f"{command[-1]}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def _compare(block: Block, printed: str) -> None:
    if block.shown.strip("\n. "):
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


@pytest.mark.parametrize("page", [ROOT / "CONTRIBUTING.md", *PAGES], ids=lambda page: page.stem)
def test_every_python_program_that_is_named_is_there(page: Path) -> None:
    """``python script.py`` of a clone, and ``python -m module`` of it or of what its extras install."""
    named = re.findall(r"python3? (?:-m ([\w.]+)|([\w/.]+\.py))", page.read_text(encoding="utf-8"))
    absent = [module for module, _ in named if module and importlib.util.find_spec(module) is None]
    absent += [script for _, script in named if script and not (ROOT / script).is_file()]
    assert not absent


def _exists(command: str) -> bool:
    """Whether the parser knows the verb and the options of a command line."""
    parser = command_parser()
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
    if {"schema", "model"} <= set(content):
        CaseDocument.model_validate(content)
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
