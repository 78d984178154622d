"""The pages in headless Chromium: no error, no address, readable on a telephone, in the dark, on paper and by keys."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest

from fmu_didim import identify
from fmu_didim.campaigns.reporting.page import write_campaign_report
from fmu_didim.report import write_report
from fmu_didim.report.discovery.sections import write_discovery_report
from tests.campaigns import test_quality
from tests.campaigns.helpers import LAWS
from tests.conftest import package
from tests.helpers import ROOT
from tests.report import test_discovery, test_report
from tests.report.test_charts import LOOP

axe = package("axe_playwright_python")
PAGES = ("identify", "refused", "discover", "campaign")
LARGEST = 2_000_000
"""Bytes of a page."""
TEXT_ON_BOXES = """() => {
    const over = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
    const boxes = [...document.querySelectorAll('svg.loop rect.box')].map(e => e.getBoundingClientRect());
    const texts = [...document.querySelectorAll('svg.loop > text')];
    return texts.filter(t => boxes.some(b => over(t.getBoundingClientRect(), b))).map(t => t.textContent);
}"""
"""Texts of wires of the drawing of the loop that lie on a component."""
VIEWS = [
    (1200, "light"), (390, "dark"),
    *(pytest.param(*view, marks=pytest.mark.slow) for view in [(1200, "dark"), (390, "light")]),
]  # fmt: skip


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """An identification, a refusal, a discovery and a campaign, with all figures that they may have."""
    folder = tmp_path_factory.mktemp("pages")
    result = test_report.document(loop=LOOP, correlation=[[1.0, 0.4, -0.2], [0.4, 1.0, 0.0], [-0.2, 0.0, 1.0]])
    (folder / "refused").mkdir()
    vary = {"train.torque.rate_hz": [5, 20, 100], "controller.source": LAWS[:2]}
    runs = test_quality.results(
        folder / "campaign", ["valid", "doubtful", "refused", None] * 8, names=("ZZ1R", "Fv1", "MX2"), scatter=0.02,
        vary=vary, seeds=6,
    )  # fmt: skip
    found = test_discovery.document(
        provenance={"loop": LOOP, "command": "fmu-didim discover case.yaml", "folder": "/home/me"}
    )
    return {
        "identify": write_report(test_report.saved(folder / "identify", result)),
        "refused": write_report(test_report.saved(folder / "refused", test_report.refused())),
        "campaign": write_campaign_report(runs)[0],
        "discover": write_discovery_report(test_discovery.saved(_made(folder / "discover"), found, count=900)),
    }


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def opened(browser: Any, file: Path, *, width: int = 1200, scheme: str = "light") -> tuple[Any, list[str]]:
    """The page, and what went wrong on it: messages of the console, errors, addresses that it asked for."""
    told: list[str] = []
    page = browser.new_context(viewport={"width": width, "height": 800}, color_scheme=scheme).new_page()
    page.on("console", lambda message: told.append(message.text))
    page.on("pageerror", lambda error: told.append(str(error)))
    page.on("request", lambda request: None if request.url.startswith("file:") else told.append(request.url))
    page.goto(file.as_uri())
    page.wait_for_function(
        "document.querySelectorAll('.chart svg').length >= document.querySelectorAll('.chart').length"
    )
    return page, told


@pytest.mark.gate
@pytest.mark.parametrize(("width", "scheme"), VIEWS)
@pytest.mark.parametrize("name", PAGES)
def test_page_has_no_error_no_violation_and_fits(
    browser: Any, pages: dict[str, Path], name: str, width: int, scheme: str
) -> None:
    check_view(browser, pages[name], width, scheme)


def check_view(browser: Any, file: Path, width: int, scheme: str) -> None:
    """The console stays silent, no address is asked, nothing is wider than the window, no rule of axe is violated."""
    page, told = opened(browser, file, width=width, scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert file.stat().st_size <= LARGEST
    for legend in page.query_selector_all(".legend"):  # above its figure, never over it
        below = legend.evaluate("e => e.parentElement.querySelector('.canvas').getBoundingClientRect().top")
        assert legend.bounding_box()["y"] + legend.bounding_box()["height"] <= below + page.evaluate("scrollY") + 1
    assert page.evaluate(TEXT_ON_BOXES) == []
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(255, 255, 255)") == (scheme == "light")
    page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    page.evaluate(next(Path(axe.__file__).parent.rglob("axe.min.js")).read_text(encoding="utf-8"))
    found = page.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]
    assert not [(v["id"], v["nodes"][0]["html"][:200]) for v in found]
    assert not told


@pytest.mark.gate
def test_tables_of_values_beside_a_prior_fit_into_the_window(browser: Any, tmp_path: Path) -> None:
    """They have the most columns; at 1200 px none of them scrolls sideways."""
    identify(ROOT / "examples/double_pendulum/prior.yaml", out=tmp_path)
    page, _ = opened(browser, tmp_path / "report.html")
    widths = page.evaluate("[...document.querySelectorAll('.scroll')].map(e => [e.scrollWidth, e.clientWidth])")
    assert len(widths) > 5
    assert [needed for needed, there in widths if needed > there] == []


@pytest.mark.gate
def test_keys_read_zoom_and_show_all(browser: Any, pages: dict[str, Path]) -> None:
    page, told = opened(browser, pages["identify"])
    canvas = page.locator(".canvas").first
    ticks = "[...document.querySelector('.canvas').querySelectorAll('.tick')].map(t => t.textContent).join(' ')"
    whole = page.evaluate(ticks)
    canvas.focus()
    page.keyboard.press("ArrowRight")
    spoken = page.locator(".spoken").first
    assert re.search(r"Joint 1.*, time 0\.5\d*: measured \S+, simulated \S+", spoken.inner_text())
    page.keyboard.press("+")
    assert page.evaluate(ticks) != whole
    page.keyboard.press("0")
    assert page.evaluate(ticks) == whole
    page.keyboard.press("ArrowDown")
    assert "residual" in spoken.inner_text()
    assert not told


@pytest.mark.gate
def test_pointer_reads_the_values_that_were_saved_and_drags_a_zoom(browser: Any, pages: dict[str, Path]) -> None:
    page, _ = opened(browser, pages["identify"])
    page.locator(".chart .frame").first.scroll_into_view_if_needed()
    frame = page.locator(".chart .frame").first.bounding_box()
    page.mouse.move(frame["x"] + 0.503 * frame["width"], frame["y"] + frame["height"] / 2)
    reading = page.locator(".reading").first.inner_text().split()
    assert reading[:2] == ["time", "0.5025"]  # sample 100 of 0 to 199, the nearest one
    assert float(reading[reading.index("measured") + 1]) == pytest.approx(math.sin(7 * 100 / 199), abs=1e-4)
    page.mouse.down()
    page.mouse.move(frame["x"] + frame["width"] * 0.75, frame["y"] + 20)
    page.mouse.up()
    shown = page.locator(".canvas").first.locator(".tick").all_text_contents()
    times = [float(text) for text in shown[-4:]]
    assert 0.5 <= min(times) < max(times) <= 0.75


@pytest.mark.gate
def test_entries_of_the_legend_hide_their_lines(browser: Any, pages: dict[str, Path]) -> None:
    page, _ = opened(browser, pages["discover"])
    entry = page.locator('.entry[data-name="base model"]').first
    lines = page.locator(".chart").filter(has=entry).first.locator("path.line.base")
    assert lines.count() > 1  # its own picture in the entry is one of them
    entry.click()
    assert lines.count() == 1
    assert entry.get_attribute("aria-pressed") == "false"


@pytest.mark.gate
@pytest.mark.parametrize("name", PAGES)
def test_paper_shows_all_in_light_with_the_provenance_last(browser: Any, pages: dict[str, Path], name: str) -> None:
    page, told = check_paper(browser, pages[name])
    if name == "discover":  # on paper each joint is a picture of its own, so that no page cuts one
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
        assert page.locator(".chart.tall").first.locator("svg[role=img]").count() == 2
        page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert not told


def check_paper(browser: Any, file: Path) -> tuple[Any, list[str]]:
    """Printed from a dark window: light, all but provenance unfolded, provenance last. As of :func:`opened`."""
    page, told = opened(browser, file, scheme="dark")
    page.emulate_media(media="print", color_scheme="dark")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate("getComputedStyle(document.body).color") == "rgb(31, 41, 55)"
    closed = page.evaluate("[...document.querySelectorAll('details:not(.folded)')].filter(d => !d.open).length")
    assert closed == 0
    heads = page.locator("h2").all_inner_texts()
    assert heads[-1] == "Provenance"
    assert not page.locator("nav").first.is_visible()
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.pdf(prefer_css_page_size=True).startswith(b"%PDF")
    return page, told


@pytest.mark.gate
def test_zoomed_to_twice_its_size_nothing_is_cut_off(browser: Any, pages: dict[str, Path]) -> None:
    """A window of 1280 pixels at 400 % has 320 of them (WCAG 1.4.10)."""
    page, _ = opened(browser, pages["discover"], width=320)
    assert page.evaluate("document.documentElement.scrollWidth") <= 320
