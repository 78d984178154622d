"""``fmu-didim campaign``: run, status, report, retry, show. What is printed goes through ``say``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmu_didim.errors import UnknownNameError

if TYPE_CHECKING:
    from fmu_didim.campaigns.campaign import Campaign, DryRun
    from fmu_didim.campaigns.results import Results
    from fmu_didim.campaigns.runner import Progress

Say = Callable[[str], None]
EXAMPLES: Mapping[str, tuple[str, ...]] = {
    "run": (
        "fmu-didim campaign run campaign.yaml --dry-run",
        "fmu-didim campaign run campaign.yaml --out results/study --workers 4",
    ),
    "retry": ("fmu-didim campaign retry results/study", "fmu-didim campaign retry results/study --only 3f2a"),
    "status": ("fmu-didim campaign status results/study",),
    "report": ("fmu-didim campaign report results/study",),
    "show": ("fmu-didim campaign show results/study", "fmu-didim campaign show results/study 3f2a --files run"),
}
NOT_DONE = 3
"""Exit code where runs have failed or are open."""


def add_campaign(commands: Any, say: Say) -> None:
    """Add the command to those of ``fmu-didim``."""
    parser = commands.add_parser("campaign", help="many cases from one: run, status, report, retry, show")
    tasks = parser.add_subparsers(required=True, metavar="run|status|report|retry|show")

    def task(name: str, run: Callable[[argparse.Namespace, Say], int], help_: str) -> argparse.ArgumentParser:
        found: argparse.ArgumentParser = tasks.add_parser(
            name, help=help_, description=help_, epilog="examples:\n" + "\n".join(f"  {e}" for e in EXAMPLES[name]),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip
        found.set_defaults(run=lambda options: run(options, say))
        return found

    one = task("run", _run, "run what is not in the folder yet; the exit code is 3 where runs have failed")
    one.add_argument("campaign", type=Path, metavar="CAMPAIGN.yaml")
    one.add_argument("--out", type=Path, metavar="RUN", help="folder of the results (results/<campaign>)")
    one.add_argument("--dry-run", action="store_true", help="check all, tell count, first runs and time, by two trials")
    two = task("retry", _retry, "run again what has failed, or the runs named by --only")
    for each in (one, two):
        each.add_argument("--only", nargs="+", default=[], metavar="ID", help="only these runs, again if need be")
        each.add_argument("--workers", type=int, metavar="N", help="processes on this machine (as many as cores)")
        each.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster: tcp://..., or its scheduler file")
        each.add_argument("--quiet", action="store_true", help="print the end only")
    three = task("status", _status, "how many runs are done, failed and open")
    four = task("report", _report, "write report.html and the tables as CSV and Parquet")
    five = task("show", _show, "what one run is and gave, or which runs have failed")
    for each in (two, three, four, five):
        each.add_argument("folder", type=Path, metavar="RUN", help="folder of the results of a campaign")
    five.add_argument("id", nargs="?", metavar="ID", help="a run, or the first digits of its id")
    five.add_argument("--files", type=Path, metavar="DIR", help="write its case and data there")


def _run(options: argparse.Namespace, say: Say) -> int:
    from fmu_didim.campaigns.campaign import campaign

    found = campaign(options.campaign, options.out)
    if options.dry_run:
        for line in dry_run_lines(found.dry_run(workers=options.workers), found):
            say(line)
        return 0
    return _told(found, options, say)


def _retry(options: argparse.Namespace, say: Say) -> int:
    from fmu_didim.campaigns.campaign import opened

    found = opened(options.folder)
    options.only = options.only or found.failed()
    if not options.only:
        say("No run has failed.")
        return 0
    return _told(found, options, say)


def _told(found: Campaign, options: argparse.Namespace, say: Say) -> int:
    """Run, and tell what happens."""

    def progress(now: Progress) -> None:
        for id_, status, verdict, message, _ in now.last:
            if status != "answered":
                say(f"  {id_} {verdict or status}: {message.splitlines()[0] if message else ''}")
                say(f"    again: fmu-didim campaign retry {found.out} --only {id_}")
        left = "" if now.left is None else f", {duration(now.left)} left"
        failed = f", {now.failed} failed" if now.failed else ""
        say(f"{now.known + now.done} of {now.known + now.count} runs{failed}{left}")

    silent = options.quiet
    results = found.run(
        workers=options.workers, scheduler=options.scheduler, only=options.only,
        progress=None if silent else progress,
    )  # fmt: skip
    say("")
    say(summary_text(results))
    say(f"\nTables and page: fmu-didim campaign report {found.out}")
    status = results.status()
    return NOT_DONE if status.open or sum(status.failures.values()) else 0


def _status(options: argparse.Namespace, say: Say) -> int:
    from fmu_didim.campaigns.results import Results
    from fmu_didim.campaigns.store import Store

    status = Results(Store(options.folder)).status()
    for line in status.lines():
        say(line)
    return NOT_DONE if status.open or sum(status.failures.values()) else 0


def _report(options: argparse.Namespace, say: Say) -> int:
    from fmu_didim.campaigns.page import write_campaign_report
    from fmu_didim.campaigns.results import Results
    from fmu_didim.campaigns.store import Store

    for path in write_campaign_report(Results(Store(options.folder))):
        say(str(path))
    return 0


def _show(options: argparse.Namespace, say: Say) -> int:
    from fmu_didim.campaigns.results import Results
    from fmu_didim.campaigns.store import Store

    results = Results(Store(options.folder))
    if options.id is None:
        frame = results.to_frame(parameters=False)
        bad = frame[~frame["verdict"].isin(("valid", "doubtful")) & (frame["status"] != "open")]
        for row in bad.to_dict("records"):
            word = row["verdict"] if isinstance(row["verdict"], str) else row["status"]
            say(f"{row['id']} {word}: {(row['message'] or '').partition(chr(10))[0]}")
        say(f"{len(bad)} runs without an answer that may be used")
        return 0
    for line in run_lines(results, options.id):
        say(line)
    if options.files is not None:
        from fmu_didim.campaigns.alone import write_alone
        from fmu_didim.campaigns.campaign import opened

        found = opened(options.folder)
        path = write_alone(found.plan, found.plan.by_id[_full_id(results, options.id)], options.files)
        say(f"\nfmu-didim {found.plan.document.verb} {path}")
    return 0


def _full_id(results: Results, begin: str) -> str:
    known = results.store.planned()["id"].to_pylist()
    found = [id_ for id_ in known if id_.startswith(begin)]
    if len(found) != 1:
        raise UnknownNameError("run", begin, found or known[:10], where=str(results.folder))
    return str(found[0])


def run_lines(results: Results, begin: str) -> list[str]:
    """All that is known of a run, for the terminal."""
    frame = results.to_frame(parameters=False)
    row = frame[frame["id"] == _full_id(results, begin)].iloc[0].to_dict()
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


def summary_text(results: Results, most: int = 40) -> str:
    """The groups and what to have in mind with them, for the terminal."""
    import pandas as pd

    table = results.summary()
    kept = [*results.paths, "runs", "valid", "doubtful"]
    kept += [n for n in ("not_settled", "refused", "failed", "open") if table[n].any()]
    kept += [n for n in ("error_percent", "coverage", "coverage_least", "largest_bias_in_sigma") if n in table]
    shown = table[kept].rename(columns=_HEADS)
    formats: Mapping[str, Any] = dict.fromkeys(_HEADS.values(), "{:.2f}".format)
    with pd.option_context("display.width", 200, "display.max_columns", 30):
        text = shown.head(most).to_string(index=False, formatters=formats, na_rep="-")
    more = [f"... and {len(table) - most} more groups"] if len(table) > most else []
    confusion = results.confusion()
    tables = [] if confusion.empty else ["", "hidden against named, runs", confusion.to_string()]
    remarks = [f"  - {remark}" for remark in results.remarks()]
    return "\n".join([*results.status().lines()[:2], "", text, *more, *tables, *(["", *remarks] if remarks else [])])


_HEADS = {
    "error_percent": "torque error %", "coverage": "coverage", "coverage_least": "with misses",
    "largest_bias_in_sigma": "largest bias/sigma",
}  # fmt: skip


def duration(seconds: float) -> str:
    """A time for reading."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
