"""A report as one self-contained HTML page, which needs no network, and as a small piece of HTML for notebooks."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache, partial
from hashlib import sha256
from importlib.resources import files
from itertools import accumulate
from pathlib import Path

import jinja2
from jinja2 import Environment, FileSystemBytecodeCache, PackageLoader, StrictUndefined

from fmu_didim.base.cache import cached_folder
from fmu_didim.base.errors import InputError
from fmu_didim.report.drawing.charts import chart_json, limited, points_per_trace
from fmu_didim.report.sections import Report, Table
from fmu_didim.report.verdict import reason_text

PAGE = "page.html.j2"
_PACKAGE = "fmu_didim.report.html"
_ENDINGS = ("j2", "css", "js")
"""Of the templates, and of what they take in."""


def write_page(report: Report, path: Path) -> Path:
    """Write the page of a report and return its path."""
    path.write_text(page_text(report), encoding="utf-8")
    return path


def page_text(report: Report) -> str:
    """The page of a report; all texts are escaped."""
    template = environment().get_template(PAGE)
    return template.render(report=report, sections=report.on("page"), points=points_per_trace(report.charts))


def notebook_html(report: Report) -> str:
    """Verdict and brief sections of a report, without scripts."""
    template = environment().get_template("notebook.html.j2")
    return template.render(report=report, sections=report.on("terminal"))


@cache
def environment() -> Environment:
    environment = Environment(
        loader=PackageLoader(_PACKAGE, "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"chart_json": chart_json, "limited": limited, "reason_text": reason_text, "rows": _rows}
    with suppress(InputError):  # where the cache cannot be written, they are compiled each time
        environment.bytecode_cache = FileSystemBytecodeCache(str(_compiled(environment)))
    return environment


def _compiled(environment: Environment) -> Path:
    """The folder of the cache with the compiled templates: to compile those of a page takes as long as to fill them
    in."""
    names = environment.list_templates(_ENDINGS)
    sources = [files(_PACKAGE).joinpath(name).read_bytes() for name in names]
    found_by = f"{jinja2.__version__} {sys.implementation.cache_tag} {files(_PACKAGE)}".encode()
    key = sha256(b"\0".join([found_by, *sources])).hexdigest()
    return cached_folder("templates", key, partial(_compile, environment))


def _compile(environment: Environment, folder: Path) -> None:
    """Fill a folder with the compiled templates."""
    overlay = environment.overlay(bytecode_cache=FileSystemBytecodeCache(str(folder)))
    for name in environment.list_templates(_ENDINGS):
        overlay.get_template(name)


def _rows(table: Table) -> Iterator[tuple[int, bool, str, str]]:
    """Index, whether it is chosen, anchor, and the head of a group that begins with the row."""
    begins = accumulate((count for _, count in table.groups), initial=0)
    heads = dict(zip(begins, (head for head, _ in table.groups), strict=False))
    for row in range(len(table.columns[0].texts)):
        anchor = table.anchors[row] if table.anchors else ""
        yield row, row in table.chosen, anchor, heads.get(row, "")
