"""Fixtures shared by all tests."""

from __future__ import annotations

import os

# Two test processes share two cores: threads of the linear algebra only get into each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from pathlib import Path

import pytest

from fmu_didim.case.data import data_folder

ROOT = Path(__file__).parent.parent


@pytest.fixture(autouse=True)
def _in_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths in the tests are relative to the project."""
    monkeypatch.chdir(ROOT)


def has_emps() -> bool:
    """Whether the EMPS data are at hand."""
    return (data_folder(ROOT) / "emps" / "DATA_EMPS.mat").is_file()


needs_emps = pytest.mark.skipif(
    not has_emps(), reason="the EMPS data (nonlinearbenchmark.org) are not at hand: set FMU_DIDIM_DATA"
)


def pytest_report_header() -> str:
    where = os.environ.get("FMU_DIDIM_DATA", "../shared/data")
    return f"EMPS data: {'found' if has_emps() else 'absent, its tests are skipped'} ({where})"
