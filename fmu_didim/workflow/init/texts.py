"""How the files of ``init`` are written: templates, paths and values in one line."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined

from fmu_didim.base.documents import TO_FILL_IN
from fmu_didim.case.files import DATA_PREFIX, data_folder
from fmu_didim.data.tables.clock import stamp_columns
from fmu_didim.workflow.init.data_file import DataFile

CASE_FILE = "case.yaml"


def named_from(out: Path, path: Path) -> str:
    """A path as a case in that folder names it: in the data folder, relative to the case, else absolute."""
    root, own = data_folder(Path(out)).resolve(), path.resolve()
    if own.is_relative_to(root):
        return f"{DATA_PREFIX}{own.relative_to(root).as_posix()}"
    return Path(os.path.relpath(own, out.resolve())).as_posix()


def time_entry(data: DataFile, *roles: str) -> dict[str, Any]:
    """The entry of the time column where a file does not say all of it, with what it lacks."""
    if clock := data.clock(*roles):
        if unit := data.time_unit(clock):
            return {"time": {"name": clock, "unit": unit}, "time_note": "the file says no unit, its velocities tell it"}
        return {}
    stamps = stamp_columns(data.table)
    if len(stamps) == 1:
        return {"time": {"name": stamps[0], "unit": TO_FILL_IN}, "time_note": "s, ms, us, ns: the file does not say"}
    asked = f"which of {', '.join(stamps)}" if stamps else "no column is known as the time"
    return {"time": {"name": TO_FILL_IN, "unit": "s"}, "time_note": f"{asked}; without one: {{rate_hz: ...}}"}


def flow(value: Any) -> str:
    """A value in one line of YAML."""
    text: str = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=10_000)
    return text.strip().removesuffix("\n...").strip()


def rendered(template: str, **values: Any) -> str:
    """The text of a template of this folder."""
    return _environment().get_template(template).render(**values)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("fmu_didim.workflow.init", "."), undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True, autoescape=False,
    )  # fmt: skip
    environment.filters["yaml"] = flow
    return environment
