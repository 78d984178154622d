"""Chromium, for the pages."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.conftest import CHROMIUM, GET_CHROMIUM, package


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless; tests that ask for it are skipped where there is none.

    Closed after each module: as long as it is open, nothing else in this process can run an event loop.
    """
    playwright = package("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip(GET_CHROMIUM)
    with playwright.sync_playwright() as running:
        found = running.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()
