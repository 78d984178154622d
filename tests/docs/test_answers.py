"""What a user must know for a first case of his own stands under a heading, at most two clicks from the README."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from urllib.parse import urldefrag

import pytest
from pydantic import BaseModel

from fmu_didim.case.sources import TorqueFile
from fmu_didim.data.tables.readers import READERS
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.dynamics.robot.description import Joint, RobotDescription
from fmu_didim.estimators.starts.start import KINDS
from tests.conftest import ROOT

MOST_CLICKS = 2


def keys(model: type[BaseModel]) -> tuple[str, ...]:
    return tuple(f"`{info.alias or name}`" for name, info in model.model_fields.items())


ANSWERS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "frames of a robot": ("robot.md", "Frames", ("`alpha`", "`a`", "`theta`", "`d`", "`gravity`", "rad", "before")),
    "keys of a robot": ("reference/robot.md", "RobotDescription", keys(RobotDescription)),
    "keys of a joint": ("reference/robot.md", "Joint", keys(Joint)),
    "parameters of a link": ("robot.md", "Parameters of a link", ("`M`", "`MX`", "`ZZ`", "`XY`", "kg.m2")),
    "effects": ("reference/effects.md", "Effects", tuple(f"`{name}`" for name in EFFECTS)),
    "effects of a joint": ("robot.md", "Effects of a joint", ("`effects`", "`motor_inertia`", "reference/effects.md")),
    "formats of data files": ("howto/own-data.md", "The torque log", tuple(reader.name for reader in READERS)),
    "formats of files of others": ("trust.md", "What to trust", tuple(reader.name for reader in READERS)),
    "units": ("case.md", "Units", ("rad, m, s, N.m, N, kg", "rate_hz", "unit: deg", "drive_gains")),
    "initial state": ("case.md", "Initial state", ("first row", "warm_up_s", "`initial_state`", "`q_start1`")),
    "start": ("case.md", "Start of the iterations", tuple(f"`{kind}`" for kind in KINDS)),
    "phases": (
        "case.md", "Rate, phase and kind of samples",
        tuple(set(TorqueFile.model_fields) & {"rate_hz", "phase_s", "sampling", "offset_s", "window", "log_shift_s"}),
    ),
}  # fmt: skip
"""Question -> page in docs, heading there, and what its answer must speak of."""


def links(page: Path) -> set[Path]:
    """The pages that a page links to."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    found = (urldefrag(link)[0] for link in re.findall(r"\]\(([^)\s]+)\)", text))
    return {(page.parent / f).resolve() for f in found if f.endswith(".md") and not re.match(r"[a-z]+:", f)}


@cache
def clicks() -> dict[Path, int]:
    """Page -> how many links away from the README it is."""
    found = {ROOT / "README.md": 0}
    for count in range(1, MOST_CLICKS + 1):
        reached = {link for page in found for link in links(page)}
        found |= dict.fromkeys(reached - set(found), count)
    return found


def section(page: Path, heading: str) -> str:
    """The text under a heading, up to the next one of its level or above."""
    text = page.read_text(encoding="utf-8")
    match = re.search(rf"^(#+) {re.escape(heading)}$(.*?)(?=^#{{1,6}} |\Z)", text, re.M | re.S)
    assert match is not None, f"{page.name} has no heading '{heading}'"
    return match[2]


@pytest.mark.parametrize("question", ANSWERS)
def test_each_answer_is_two_clicks_from_the_readme(question: str) -> None:
    name, heading, told = ANSWERS[question]
    page = ROOT / "docs" / name
    assert clicks().get(page, MOST_CLICKS + 1) <= MOST_CLICKS
    answer = section(page, heading)
    assert [word for word in told if word not in answer] == []


def test_every_page_is_two_clicks_from_the_readme() -> None:
    assert set((ROOT / "docs").rglob("*.md")) - set(clicks()) == set()
