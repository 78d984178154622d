"""``fmu-didim campaign``: run, status, report, retry, show. What is printed goes through ``say``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmu_didim.cli.numbers import at_least_one

if TYPE_CHECKING:
    from fmu_didim.campaigns.campaign import Campaign
    from fmu_didim.campaigns.running.runner import Progress

Say = Callable[[str], None]
EXAMPLES: Mapping[str, tuple[str, ...]] = {
    "run": (
        "fmu-didim campaign run campaign.yaml --dry-run",
        "fmu-didim campaign run campaign.yaml --out results/study --workers 4",
    ),
    "retry": ("fmu-didim campaign retry results/study", "fmu-didim campaign retry results/study --only 3f2a"),
    "status": ("fmu-didim campaign status results/study", "fmu-didim campaign status results/study --json | jq .open"),
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
    one.add_argument("campaign", type=Path, metavar="CAMPAIGN.yaml", help="the campaign file")
    one.add_argument("--out", type=Path, metavar="RUN", help="folder of the results (results/<campaign>)")
    one.add_argument("--dry-run", action="store_true", help="check all, show count, first runs and time, by two trials")
    two = task("retry", _retry, "run again what has failed, or the runs named by --only")
    for each in (one, two):
        each.add_argument("--only", nargs="+", default=[], metavar="ID", help="only these runs, again if need be")
        each.add_argument(
            "--workers", type=at_least_one, metavar="N", help="processes on this machine (as many as cores)"
        )
        each.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster: tcp://..., or its scheduler file")
        each.add_argument("--quiet", action="store_true", help="print the end only")
    three = task("status", _status, "how many runs are done, failed and open")
    four = task("report", _report, "write report.html and the tables as CSV and Parquet")
    five = task("show", _show, "what one run is and gave, or which runs have failed")
    for each in (two, three, four, five):
        each.add_argument("folder", type=Path, metavar="RUN", help="folder of the results of a campaign")
    three.add_argument("--json", action="store_true", help="print it as JSON")
    five.add_argument("id", nargs="?", metavar="ID", help="a run, or the first digits of its id")
    five.add_argument("--files", type=Path, metavar="DIR", help="write its case and data there")


def _run(options: argparse.Namespace, say: Say) -> int:
    if not options.quiet:
        say(f"Reading {options.campaign} ...")
    from fmu_didim.campaigns.campaign import campaign

    found = campaign(options.campaign, options.out)
    if options.dry_run:
        for line in found.dry_run(workers=options.workers).lines():
            say(line)
        return 0
    return _reported(found, options, say)


def _retry(options: argparse.Namespace, say: Say) -> int:
    from fmu_didim.campaigns.campaign import opened

    found = opened(options.folder)
    options.only = options.only or found.failed()
    if not options.only:
        say("No run has failed.")
        return 0
    return _reported(found, options, say)


def _reported(found: Campaign, options: argparse.Namespace, say: Say) -> int:
    """Run, and report the progress."""
    from fmu_didim.campaigns.reporting.sections import duration

    def progress(now: Progress) -> None:
        for id_, status, verdict, message, _ in now.last:
            if status != "answered":
                say(f"  {id_} {verdict or status}: {message.splitlines()[0] if message else ''}")
                say(f"    again: fmu-didim campaign retry {found.out} --only {id_}")
        left = "" if now.left is None else f", {duration(now.left)} left"
        failed = f", {now.failed} failed" if now.failed else ""
        say(f"{now.known + now.done} of {now.known + now.count} runs{failed}{left}")

    results = found.run(
        workers=options.workers, scheduler=options.scheduler, only=options.only,
        progress=None if options.quiet else progress,
    )  # fmt: skip
    say("")
    say(results.summary())
    say(f"\nTables and page: fmu-didim campaign report {found.out}")
    status = results.status()
    return NOT_DONE if status.open or sum(status.failures.values()) else 0


def _status(options: argparse.Namespace, say: Say) -> int:
    from fmu_didim.campaigns.reporting.status import status_of
    from fmu_didim.campaigns.running.store import Store

    status = status_of(Store(options.folder))
    for line in [json.dumps(asdict(status), indent=1)] if options.json else status.lines():
        say(line)
    return NOT_DONE if status.open or sum(status.failures.values()) else 0


def _report(options: argparse.Namespace, say: Say) -> int:
    from fmu_didim.campaigns.reporting.page import write_campaign_report
    from fmu_didim.campaigns.reporting.results import Results
    from fmu_didim.campaigns.running.store import Store

    for path in write_campaign_report(Results(Store(options.folder))):
        say(str(path))
    return 0


def _show(options: argparse.Namespace, say: Say) -> int:
    from fmu_didim.campaigns.reporting.results import Results
    from fmu_didim.campaigns.running.store import Store

    results = Results(Store(options.folder))
    if options.id is None:
        frame = results.to_frame(parameters=False)
        bad = frame[~frame["verdict"].isin(("valid", "doubtful")) & (frame["status"] != "open")]
        for row in bad.to_dict("records"):
            word = row["verdict"] if isinstance(row["verdict"], str) else row["status"]
            say(f"{row['id']} {word}: {(row['message'] or '').partition(chr(10))[0]}")
        say(f"{len(bad)} runs without an answer that may be used")
        return 0
    for line in results.describe(options.id):
        say(line)
    if options.files is not None:
        from fmu_didim.campaigns.campaign import opened
        from fmu_didim.campaigns.running.single_run import write_single_run

        found = opened(options.folder)
        path = write_single_run(found.plan, found.plan.by_id[results.full_id(options.id)], options.files)
        say(f"\nfmu-didim {found.plan.document.verb} {path}")
    return 0
