"""The templates of this folder, filled in."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from fmu_didim.report.drawing.charts import chart_json
from fmu_didim.report.numbers import capitalised
from fmu_didim.report.verdict import reason_text


def rendered(template: str, **values: Any) -> str:
    """The text that a template gives with these values; all of them are escaped unless marked as safe."""
    return _environment().get_template(template).render(**values)


def write_page(path: Path, template: str, **values: Any) -> Path:
    """Write the page that a template gives with these values, and return its path."""
    path.write_text(rendered(template, **values), encoding="utf-8")
    return path


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("fmu_didim.report.html", "."), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["chart_json"] = chart_json
    environment.filters["capitalised"] = capitalised
    environment.filters["reason_text"] = reason_text
    return environment
