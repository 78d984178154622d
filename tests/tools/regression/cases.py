"""The cases that are recorded: the examples of the repository, and folders of blind cases."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from fmu_didim.base.cache import file_digest
from fmu_didim.case import Case
from fmu_didim.workflow.case_files import case_files
from tests.helpers import ROOT
from tests.tools.blind.campaign import PAIRS, make_campaign
from tests.tools.blind.harness import case_folders
from tests.tools.blind.simulator.hidden import EFFECTS, UNKNOWN

Verb = Literal["identify", "discover"]
EXAMPLES: tuple[tuple[Verb, str], ...] = (
    ("identify", "scara/identify"),
    ("identify", "scara/identify_200hz"),
    ("identify", "scara/identify_modelica"),
    ("identify", "scara/two_payloads"),
    ("identify", "double_pendulum/identify"),
    ("identify", "double_pendulum/prior"),
    ("identify", "batch/identify"),
    ("identify", "house/identify"),
    ("identify", "pendulum_modelica/identify"),
    ("identify", "emps/identify"),
    ("identify", "emps/identify_idim_ls"),
    ("discover", "arm2r/discover"),
    ("discover", "double_pendulum/discover"),
    ("discover", "emps/discover"),
    ("discover", "emps/discover_pulses"),
    ("discover", "tx40/discover_load"),
    ("discover", "tx40/discover_wrist"),
)
"""Verb, and case file below ``examples`` without its ending."""
FIXED_SEED = 1
"""Of every plant of the fixed cases; the clean ones count on from it."""
FIXED_RATES_HZ = (100, 20)
FIXED_LEVEL = 2.0
"""Gap after the base is refitted, in noise deviations."""
FIXED_CLEAN = 13
"""Plants that hide nothing, so that there are fifty plants with those that hide something."""


@dataclass(frozen=True)
class Job:
    """One case to run.

    Attributes:
        name: of its record; the same wherever the case lies.
        verb: what is run; path: the case file, or the folder of a blind case.
    """

    name: str
    verb: Verb
    path: Path

    @property
    def is_blind(self) -> bool:
        """Whether it is a blind case, which is translated before it is run."""
        return self.path.is_dir()


def example_jobs() -> list[Job]:
    """The examples."""
    return [Job(f"{verb} {name}", verb, ROOT / "examples" / f"{name}.yaml") for verb, name in EXAMPLES]


def blind_jobs(folders: Iterable[Path], *, every: int = 1) -> list[Job]:
    """The cases below folders of blind cases, each ``every``-th of a folder by name.

    Raises:
        FileNotFoundError: a folder holds no case.
    """
    found = [path for folder in folders for path in case_folders(folder)[::every]]
    return [Job(f"blind {path.name}", "discover", path.absolute()) for path in found]


def chosen(jobs: Sequence[Job], only: Sequence[str]) -> list[Job]:
    """The jobs whose names hold one of the texts, all without texts.

    Raises:
        ValueError: two have the same name, whose records would be one file, or there are none.
    """
    wanted = [job for job in jobs if not only or any(text in job.name for text in only)]
    names = [job.name for job in wanted]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"two cases have the name {', '.join(twice)}")
    if not wanted:
        raise ValueError(f"no case has {' or '.join(only)} in its name")
    return wanted


def make_fixed_cases(folder: Path, *, workers: int = 1) -> int:
    """Make the fixed blind cases below ``folder``; returns how many, which is a hundred.

    One plant for every effect that the generator can hide, for each of the unknown ones and for each of its pairs, all
    with seed 1, and 13 clean plants; each logged at 100 Hz and at 20 Hz. The same generator gives the same files.
    """
    return make_campaign(
        folder, [*EFFECTS, *UNKNOWN, *PAIRS], seeds=range(FIXED_SEED, FIXED_SEED + 1), rates=FIXED_RATES_HZ,
        level=FIXED_LEVEL, clean=FIXED_CLEAN, jobs=workers,
    )  # fmt: skip


def digests_of_case(path: Path, case: Case) -> Mapping[str, str]:
    """SHA-256 of a case file and of all files that it reads."""
    return {path.name: file_digest(path), **case_files(case)}


def digests_of_blind(folder: Path) -> Mapping[str, str]:
    """SHA-256 of what a blind case shows; its truth is not opened."""
    files = [folder / "case.yaml", *sorted(folder.glob("*.csv"))]
    return {path.name: file_digest(path) for path in files}
