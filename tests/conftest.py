"""Fixtures shared by all tests."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fmu_didim.case.files import DATA_VARIABLE, data_folder

ROOT = Path(__file__).parent.parent


@pytest.fixture(autouse=True)
def _in_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths in the tests are relative to the project."""
    monkeypatch.chdir(ROOT)


EMPS_FILES = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")
GET_EMPS = (
    f"the EMPS data are not shipped: get {' and '.join(EMPS_FILES)} from nonlinearbenchmark.org, put them into a "
    f"folder emps, and set {DATA_VARIABLE} to the folder that holds it"
)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
GET_CHROMIUM = "needs Chromium, which is not on the path: on Debian, apt install chromium"


def has_emps() -> bool:
    """Whether the EMPS data are at hand."""
    return all((data_folder(ROOT) / "emps" / name).is_file() for name in EMPS_FILES)


def package(name: str, load: Callable[[Any], object] = bool) -> Any:
    """A package of tests or of an option; what asks for it is skipped where it is not installed or does not load.

    Args:
        load: loads what the package itself loads later, such as a library of its own.
    """
    try:
        module = importlib.import_module(name)
        load(module)
        return module
    except ModuleNotFoundError as error:
        reason = f"needs {error.name}, which is not installed: pip install 'fmu_didim[test]'"
    except (ImportError, OSError) as error:
        reason = f"needs {name}, which does not load: {error}. Install the library of the system that it names"
    pytest.skip(reason, allow_module_level=True)


needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason=GET_CHROMIUM)
needs_emps = pytest.mark.data


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests marked ``data`` are skipped where the data are absent, with how to get them."""
    if not has_emps():
        for item in items:
            if item.get_closest_marker("data"):
                item.add_marker(pytest.mark.skip(reason=GET_EMPS))


def pytest_report_header() -> str:
    if has_emps():
        return f"EMPS data: found in {data_folder(ROOT)}"
    return f"Tests on EMPS are skipped: {GET_EMPS}"
