"""A report as one self-contained HTML page, which needs no network, and as a small piece of HTML for notebooks."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import accumulate
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from fmu_didim.report.drawing.charts import chart_json, limited, points_per_trace
from fmu_didim.report.sections import Report, Table
from fmu_didim.report.verdict import reason_text

PAGE, MACROS = "page.html.j2", "macros.html.j2"


def load_templates() -> None:
    """Compile the templates of a page ahead: that takes as long as to fill them in."""
    for name in (MACROS, PAGE):
        environment().get_template(name)


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
        loader=PackageLoader("fmu_didim.report.html", "."), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"chart_json": chart_json, "limited": limited, "reason_text": reason_text, "rows": _rows}
    return environment


def _rows(table: Table) -> Iterator[tuple[int, bool, str, str]]:
    """Index, whether it is chosen, anchor, and the head of a group that begins with the row."""
    begins = accumulate((count for _, count in table.groups), initial=0)
    heads = dict(zip(begins, (head for head, _ in table.groups), strict=False))
    for row in range(len(table.columns[0].texts)):
        anchor = table.anchors[row] if table.anchors else ""
        yield row, row in table.chosen, anchor, heads.get(row, "")
