"""The documentation builds without a warning and without a network, and all its links and the README's resolve."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from functools import cache
from html import unescape
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

from tests.conftest import ROOT

pytestmark = pytest.mark.gate

DOCS = ROOT / "docs"
NO_NETWORK = {"http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9"}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages as HTML."""
    out = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-E",
        "-d",
        str(out / "trees"),
        str(DOCS),
        str(out / "html"),
    ]
    environment = {**os.environ, **NO_NETWORK, "PYTHONPATH": str(ROOT)}
    built = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment, check=False)
    assert built.returncode == 0, built.stderr
    return out / "html"


@cache
def identifiers(page: Path) -> frozenset[str]:
    return frozenset(re.findall(r'\sid="([^"]+)"', page.read_text(encoding="utf-8")))


@pytest.mark.gate
def test_every_link_of_the_site_resolves(site: Path) -> None:
    broken = []
    for page in site.rglob("*.html"):
        for link in re.findall(
            r'<(?:a|link|script|img)\s[^>]*?(?:href|src)="([^"]+)"', page.read_text(encoding="utf-8")
        ):
            address, anchor = urldefrag(unescape(link))
            if re.match(r"[a-z]+:", address):
                continue
            target = page if not address else (page.parent / unquote(address.partition("?")[0])).resolve()
            known = target.is_file() and (
                not anchor or target.suffix != ".html" or unquote(anchor) in identifiers(target)
            )
            if not known:
                broken.append(f"{page.name}: {link}")
    assert not broken


def test_no_page_of_the_site_asks_a_server(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r'<(?:script|img|iframe|link)\s[^>]*?(?:src|href)="(?:https?:)?//[^"]*"', text), page


def test_formulas_are_mathml(site: Path) -> None:
    assert "<math" in (site / "theory" / "didim.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "path", [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))], ids=lambda p: p.name
)
def test_links_resolve_where_the_files_are_read_as_they_are(path: Path) -> None:
    """On a forge, without a build."""
    links = re.findall(r"\]\(([^)\s]+)\)", re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.S))
    broken = []
    for link in links:
        address, anchor = urldefrag(link)
        if re.match(r"[a-z]+:", address):
            continue
        target = (path.parent / address).resolve() if address else path
        if not target.exists() or (anchor and anchor not in slugs(target)):
            broken.append(link)
    assert not broken


@cache
def slugs(page: Path) -> frozenset[str]:
    """The anchors of the headings of a page."""
    found: list[str] = []
    for head in re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.M):
        slug = re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-")
        found.append(slug if slug not in found else f"{slug}-{found.count(slug)}")
    return frozenset(found)


def test_reference_is_what_the_package_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DOCS))
    import make_reference

    for name, text in make_reference.pages().items():
        shipped = (make_reference.FOLDER / name).read_text(encoding="utf-8")
        assert shipped == text, f"docs/reference/{name} is not what the package says: run python docs/make_reference.py"
