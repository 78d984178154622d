"""Pages of real runs in headless Chromium: SCARA, EMPS, a two-joint arm, six joints, and a campaign."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from fmu_didim import campaign, discover, identify
from fmu_didim.campaigns.reporting.page import write_campaign_report
from tests.conftest import ROOT, needs_emps
from tests.report.test_browser import VIEWS, check_paper, check_view

pytestmark = pytest.mark.slow


def _identified(case: str, out: Path) -> Path:
    identify(f"examples/{case}.yaml", out)
    return out / "report.html"


def _discovered(case: str, out: Path) -> Path:
    discover(f"examples/{case}.yaml", out)
    return out / "discovery.html"


def _campaign(name: str, out: Path) -> Path:
    return write_campaign_report(campaign(ROOT / "examples" / "campaigns" / f"{name}.yaml", out).run(workers=2))[0]


@pytest.mark.parametrize(
    "make",
    [
        pytest.param(partial(_identified, "scara/identify"), id="scara"),
        pytest.param(partial(_identified, "scara/two_payloads"), id="payloads"),
        pytest.param(partial(_identified, "emps/identify"), id="emps", marks=needs_emps),
        pytest.param(partial(_discovered, "emps/discover"), id="emps-discovery", marks=needs_emps),
        pytest.param(partial(_discovered, "arm2r/discover"), id="arm2r"),
        pytest.param(partial(_discovered, "tx40/discover_load"), id="tx40"),
        pytest.param(partial(_campaign, "scara_controllers"), id="campaign"),
    ],
)
def test_a_real_page(browser: Any, make: Callable[[Path], Path], tmp_path: Path) -> None:
    page = make(tmp_path / "out")
    for width, scheme in VIEWS:
        check_view(browser, page, width, scheme)
    _, told = check_paper(browser, page)
    assert not told
