"""What the terminal shows of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from fmu_didim.report.identification.table import column, joined
from fmu_didim.report.numbers import MISSING


def groups_text(summary: pd.DataFrame, names: Sequence[str]) -> str:
    """The groups by some fields, one a line."""
    found = group_columns(summary, names)
    return "\n".join(joined([column(head, texts, left=head in names) for head, texts in found.items()]))


def group_columns(summary: pd.DataFrame, names: Sequence[str]) -> dict[str, list[str]]:
    """What is shown of groups by some fields: head of a column -> a text a group."""
    columns = {name: [shown(v) for v in summary[name]] for name in names}
    others = [name for name in ("not_settled", "refused", "failed", "open") if summary[name].any()]
    columns |= {n.replace("_", " "): [str(v) for v in summary[n]] for n in ("runs", "valid", "doubtful", *others)}
    columns["torque error %"] = [f"{v:.2f}" for v in summary["error_percent"]]
    if "coverage" in summary:
        low, high = summary["coverage_low"], summary["coverage_high"]
        ranges = zip(summary["coverage"], low, high, strict=True)
        columns["coverage (95 % interval)"] = [f"{c:.3f} ({a:.2f} to {b:.2f})" for c, a, b in ranges]
        columns["with misses"] = [f"{v:.3f}" for v in summary["coverage_least"]]
        columns["largest bias/σ"] = [f"{v:.2f}" for v in summary["largest_bias_in_sigma"]]
    return columns


def duration(seconds: float) -> str:
    """A time for reading."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def shown(value: Any) -> str:
    """A value of a field that varies."""
    if value is None or value != value:
        return MISSING
    return f"{value:g}" if isinstance(value, float) else str(value)
