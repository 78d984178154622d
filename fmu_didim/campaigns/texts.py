"""What the terminal shows of a campaign."""

from __future__ import annotations

import json

import pandas as pd

from fmu_didim.campaigns import thresholds as limits
from fmu_didim.campaigns.campaign import Campaign, DryRun
from fmu_didim.campaigns.page import shown
from fmu_didim.campaigns.results import Results
from fmu_didim.errors import UnknownNameError
from fmu_didim.report.table import column, joined, wrapped


def full_id(results: Results, begin: str) -> str:
    """The id of the planned run that begins so; raises UnknownNameError where there is none, or more than one."""
    known = results.store.planned()["id"].to_pylist()
    found = [id_ for id_ in known if id_.startswith(begin)]
    if len(found) != 1:
        raise UnknownNameError("run", begin, found or known[:10], where=str(results.folder))
    return str(found[0])


def run_lines(results: Results, begin: str) -> list[str]:
    """All that is known of a run, for the terminal."""
    frame = results.to_frame(parameters=False)
    row = frame[frame["id"] == full_id(results, begin)].iloc[0].to_dict()
    named = {**{path: row[path] for path in results.paths}, "seed": row["seed"]}
    lines = [f"run {row['id']}", *(f"  {path} = {value}" for path, value in named.items()), ""]
    shown = {k: v for k, v in row.items() if k not in (*named, "id") and v is not None and v == v and v != ""}
    lines += [f"{key}: {value}" for key, value in shown.items()]
    parameters = results.parameters()
    for p in parameters[parameters["id"] == row["id"]].to_dict("records") if not parameters.empty else []:
        true = f", true {p['true']:.6g}" if p["true"] == p["true"] else ""
        lines.append(f"  {p['parameter']} = {p['value']:.6g} ± {p['std']:.2g} {p['unit']}{true}")
    return [*lines, "", f"again: fmu-didim campaign retry {results.folder} --only {row['id']}"]


def dry_run_lines(found: DryRun, campaign: Campaign) -> list[str]:
    """What a campaign would do, for the terminal."""
    lines = [
        f"{campaign.plan.document.name}: {found.count} runs of {found.cases} cases; {found.tried} cases were loaded"
    ]
    if found.equal:
        lines.append(f"{found.equal} further runs equal others and are run and counted once")
    if found.known:
        lines.append(f"{found.known} are in {campaign.out} already")
    for number, run in enumerate(found.first, start=1):
        lines.append(f"  {number}. {json.dumps(run.labels, default=str)}, seed {run.seed}, id {run.id}")
    if found.seconds is not None:
        lines.append(
            f"about {duration(found.seconds)} with {found.workers} workers, by two trials; nothing was written"
        )
    return lines


def summary_text(results: Results) -> str:
    """Groups, what was named where effects were hidden, and what to have in mind, for the terminal."""
    whole = results.summary()
    apart = len(whole) > limits.GROUPS_PRINTED and len(results.paths) > 1
    groupings = [(path,) for path in results.paths] if apart else [tuple(results.paths)]
    blocks = [_table(results.summary(*names) if apart else whole, names) for names in groupings]
    confusion = results.confusion()
    if not confusion.empty:
        blocks.append("hidden effects (rows) against named ones, in runs\n" + confusion.to_string())
    if remarks := results.remarks():
        blocks.append("\n".join(line for remark in remarks for line in wrapped(remark, "- ", "  ")))
    return "\n\n".join(["\n".join(results.status().lines()[:2]), *blocks])


def _table(summary: pd.DataFrame, names: tuple[str, ...]) -> str:
    """The groups by some fields, one a line."""
    columns = [column(name, [shown(v) for v in summary[name]], left=True) for name in names]
    counts = [
        "runs",
        "valid",
        "doubtful",
        *(n for n in ("not_settled", "refused", "failed", "open") if summary[n].any()),
    ]
    columns += [column(n.replace("_", " "), [str(v) for v in summary[n]]) for n in counts]
    columns.append(column("torque error %", [f"{v:.2f}" for v in summary["error_percent"]]))
    if "coverage" in summary:
        low, high = summary["coverage_low"], summary["coverage_high"]
        ranges = zip(summary["coverage"], low, high, strict=True)
        columns.append(column("coverage (95 % interval)", [f"{c:.3f} ({a:.2f} to {b:.2f})" for c, a, b in ranges]))
        columns.append(column("with misses", [f"{v:.3f}" for v in summary["coverage_least"]]))
        columns.append(column("largest bias/σ", [f"{v:.2f}" for v in summary["largest_bias_in_sigma"]]))
    return "\n".join(joined(columns))


def duration(seconds: float) -> str:
    """A time for reading."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
