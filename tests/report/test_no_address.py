"""The pages ask for no address and send nothing: by what is written in them, and by what a browser does with them."""

from __future__ import annotations

import re
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from fmu_didim.report import write_report
from fmu_didim.report.discovery.sections import write_discovery_report
from tests.conftest import CHROMIUM, needs_chromium
from tests.patience import patience
from tests.report import test_discovery, test_report

POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">')
ASKS = re.compile(
    r"""\b(?:src|action|formaction|data|poster|srcset)\s*=|@import|url\(|\bfetch\(|XMLHttp|import\(|//\w"""
)
LINK = re.compile(r"""href="([^"]*)\"""")


def pages(folder: Path) -> dict[str, str]:
    """An identification and a discovery, with all figures that they may have."""
    (folder / "identify").mkdir()
    (folder / "discover").mkdir()
    files = {
        "identify": write_report(test_report.saved(folder / "identify", test_report.document())),
        "discover": write_discovery_report(test_discovery.saved(folder / "discover", test_discovery.document())),
    }
    return {name: file.read_text(encoding="utf-8") for name, file in files.items()}


@pytest.mark.gate
def test_nothing_is_written_that_asks_for_an_address(tmp_path: Path) -> None:
    for page in pages(tmp_path).values():
        own = re.sub(r'(<script type="application/json"[^>]*>).*?(</script>)', r"\1\2", page, flags=re.S)  # mere data
        assert not ASKS.search(own), ASKS.search(own)
        beside = [target for target in LINK.findall(page) if not re.fullmatch(r"#\w+|(\./)?[\w.%-]+", target)]
        assert not beside, beside  # all others are places of the page, or files in its folder
        (policy,) = POLICY.findall(page)
        rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
        assert rules["default-src"] == rules["form-action"] == rules["base-uri"] == "'none'"
        assert not any(re.search(r"http|\*|'self'|//", rule) for rule in rules.values())
        assert page.index("Content-Security-Policy") < min(page.index("<style>"), page.index("<script"))


@contextmanager
def proxy() -> Iterator[tuple[str, list[str]]]:
    """Address of a proxy that answers nothing, and what it was asked for."""
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_error(404)

        do_POST = do_CONNECT = do_HEAD = do_OPTIONS = do_GET

        def log_message(self, format: str, *arguments: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"127.0.0.1:{server.server_address[1]}", asked
    finally:
        server.shutdown()
        server.server_close()


CLICKS = """<script>setTimeout(() => {
  document.querySelectorAll("details").forEach(d => { d.open = true; });
  dispatchEvent(new Event("beforeprint"));
  dispatchEvent(new Event("afterprint"));
  const buttons = [...document.querySelectorAll("button")];
  const names = [...new Set(buttons.map(b => b.textContent))].sort();
  const figures = document.querySelectorAll(".chart svg[role=img]").length;
  buttons.forEach(b => b.click());
  document.querySelectorAll("a[href^='#']").forEach(a => a.click());
  document.title = "done: " + names.join(", ") + "; figures " + figures;
}, 1000);</script>"""
LEAKS = """<script>setTimeout(() => {
  new Image().src = "http://image.example/";
  fetch("http://fetch.example/").catch(() => {});
  const form = document.createElement("form");
  Object.assign(form, {action: "http://form.example/", method: "post"});
  document.body.append(form);
  form.submit();
}, 500);</script>"""


def in_browser(page: str, folder: Path, *, script: str = "") -> tuple[str, set[str]]:
    """The page after all scripts have run, a further one too, and the hosts that were asked for."""
    assert CHROMIUM is not None
    file = folder / "page.html"
    file.write_text(page.replace("</body>", script + "</body>"), encoding="utf-8")
    with proxy() as (address, asked):
        shown = subprocess.run(
            [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
             "--disable-background-networking", "--disable-component-update", "--disable-sync",
             "--disable-default-apps", "--disable-extensions", "--window-size=1200,900",
             f"--user-data-dir={folder / 'profile'}", f"--proxy-server=http://{address}",
             "--proxy-bypass-list=<-loopback>", "--virtual-time-budget=20000", "--dump-dom", file.as_uri()],
            capture_output=True, text=True, timeout=patience(120), errors="replace",
        )  # fmt: skip
        hosts = {re.sub(r"^\w+://|[:/].*$", "", path) for path in asked}
    return shown.stdout, hosts


OWN = re.compile(r"(^|\.)(google|googleapis|gstatic|gvt1|chromium)\.(com|org)$")
"""Whom browsers themselves ask in spite of all flags."""


@pytest.mark.gate
@needs_chromium
@pytest.mark.parametrize(("name", "policy"), [("identify", True), ("identify", False), ("discover", False)])
def test_a_browser_asks_for_no_address(tmp_path: Path, name: str, policy: bool) -> None:
    """By itself, too, and not only because the policy makes the browser refuse it."""
    page = pages(tmp_path)[name]
    page = page if policy else POLICY.sub("", page)
    shown, hosts = in_browser(page, tmp_path, script=CLICKS)
    told = re.search(r"<title>(done: [^<]*)</title>", shown)
    assert told is not None, shown[-2000:]
    assert "Share" not in told[1]
    assert "measured" in told[1]
    assert int(told[1].rpartition(" ")[2]) > 2
    assert not {host for host in hosts if not OWN.search(host)}


@pytest.mark.gate
@needs_chromium
def test_the_policy_forbids_what_the_proxy_would_see(tmp_path: Path) -> None:
    page = pages(tmp_path)["identify"]
    leaks = {"image.example", "fetch.example", "form.example"}
    assert not leaks & in_browser(page, tmp_path, script=LEAKS)[1]
    assert leaks <= in_browser(POLICY.sub("", page), tmp_path, script=LEAKS)[1]
