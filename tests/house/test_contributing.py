"""CONTRIBUTING sends a newcomer to files that are there."""

from __future__ import annotations

import re

import pytest

from tests.conftest import ROOT

TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
PATHS = sorted(path for path in set(re.findall(r"`([\w./]+/[\w./]*)`", TEXT)) if not re.search(r"NAME|^python", path))
"""Files and folders that it names; those with ``<name>`` in them are still to be written."""


def test_it_names_many() -> None:
    assert len(PATHS) > 20


@pytest.mark.parametrize("path", PATHS)
def test_what_it_names_is_there(path: str) -> None:
    assert [folder for folder in ("", "fmu_didim", "tests") if (ROOT / folder / path).exists()]
