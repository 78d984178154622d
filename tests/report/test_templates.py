"""Compiled templates that are kept between runs: the same pages, also where they are damaged or cannot be kept."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from fmu_didim.base import cache
from fmu_didim.base.cache import entries
from fmu_didim.report import page, write_report
from tests.report.test_report import document, saved


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache of its own, which a new process looks at."""
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    page.environment.cache_clear()
    yield tmp_path / "cache"
    page.environment.cache_clear()


def written(folder: Path) -> bytes:
    """The page as a new process writes it."""
    page.environment.cache_clear()
    cache._compared.clear()
    return write_report(saved(folder, document())).read_bytes()


def test_kept_templates_make_the_same_page(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as alone:
        alone.setattr(page, "cached_folder", refused)
        plain = written(tmp_path / "plain")
    assert not list(entries())
    assert written(tmp_path / "first") == plain
    (kept,) = entries()
    assert kept.kind == "templates"
    compiled = sorted((kept.path / "content").iterdir())
    assert len(compiled) == len(page.environment().list_templates(page._ENDINGS))
    with monkeypatch.context() as without:
        without.setattr(page.Environment, "compile", None)  # which nobody needs then
        assert written(tmp_path / "again") == plain
    for file in compiled:
        file.write_bytes(file.read_bytes()[:-9])
    assert written(tmp_path / "damaged") == plain
    assert next(entries()).path == kept.path


def refused(*_: object) -> Path:
    raise cache.InputError("The cache cannot be written.", next_step="Make room.")


def test_where_nothing_can_be_kept_the_page_is_made_all_the_same(place: Path, tmp_path: Path) -> None:
    place.write_text("a file where the folder should be", encoding="utf-8")
    assert b"</html>" in written(tmp_path / "page")
    assert place.is_file()


def test_templates_that_have_changed_are_compiled_anew(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    written(tmp_path / "first")
    monkeypatch.setattr(page.jinja2, "__version__", "0")
    with caplog.at_level(logging.INFO):
        written(tmp_path / "again")
    assert len(list(entries())) == 2
    assert not caplog.records
