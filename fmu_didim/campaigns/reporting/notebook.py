"""The results of a campaign as a small piece of HTML for notebooks."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from fmu_didim.campaigns.reporting.status import Status
from fmu_didim.campaigns.reporting.texts import group_columns
from fmu_didim.report.html.templates import rendered
from fmu_didim.report.notebook import TEMPLATE
from fmu_didim.report.verdict import Banner


def banner(status: Status) -> Banner:
    """Whether the campaign is complete; of its answers the tables speak."""
    text = "\n".join(status.lines())
    if status.open:
        return Banner("doubtful", "NOT COMPLETE", text)
    failed = sum(status.failures.values())
    return Banner("doubtful" if failed else "good", "COMPLETE" + (", WITH FAILURES" if failed else ""), text)


def results_html(status: Status, groups: pd.DataFrame, paths: Sequence[str], remarks: Sequence[str]) -> str:
    """How far it is, a row for each group by the fields of ``paths``, and what to have in mind with its figures."""
    columns = group_columns(groups, paths)
    return rendered(
        TEMPLATE,
        name=status.name,
        verdict=banner(status),
        heads=tuple(columns),
        words=range(len(paths)),
        groups=[("", list(zip(*columns.values(), strict=True)))],
        notes=remarks,
        figures=(),
    )
