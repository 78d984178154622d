"""The command line of the verb watch."""

from __future__ import annotations

import argparse
from datetime import date
from pathlib import Path

from fmu_didim.base.errors import InputError
from fmu_didim.base.terminal import json_shown
from fmu_didim.cli.console import Display, show, since_start
from fmu_didim.cli.numbers import at_least_one


def add_watch(verb: argparse.ArgumentParser) -> None:
    """Add its arguments."""
    verb.add_argument("folder", type=Path, metavar="FOLDER", help="of the logs, each with a date in its name")
    help_ = "the case whose log those of the folder stand for, in turn"
    verb.add_argument("--case", type=Path, required=True, metavar="CASE.yaml", help=help_)
    add_folder_options(verb)
    help_ = "judge values only, which is faster: effects such as backlash are not looked for in logs that are far"
    verb.add_argument("--no-effects", dest="effects", action="store_const", const=False, help=help_)
    help_ = "folder for watch.json, watch.html and the results of the logs (results/<folder>-watch)"
    verb.add_argument("--out", type=Path, metavar="DIR", help=help_)
    shown = verb.add_mutually_exclusive_group()
    shown.add_argument("--quiet", action="store_true", help="print the table only")
    shown.add_argument("--json", action="store_true", help="print a line of JSON a log, the answer last")


def add_folder_options(verb: argparse.ArgumentParser) -> None:
    """Those that say which logs are the reference."""
    which = verb.add_mutually_exclusive_group()
    help_ = "how many logs, from the first, are the reference (10)"
    which.add_argument("--reference", type=at_least_one, metavar="N", help=help_)
    which.add_argument("--until", type=_day, metavar="DATE", help="the last day of the reference, such as 2024-05-31")
    help_ = "logs in order of the times of their files, not of the dates in their names"
    verb.add_argument("--by-time", action="store_true", help=help_)


def _day(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text} is no date such as 2024-05-31") from error


def run_watch(options: argparse.Namespace) -> int:
    """Say which logs of a folder show that the machine has changed, which values moved, why, and when it began.

    Logs are identified with the model of the case, in order of their dates, and judged by the first ones. What was
    identified before is not identified again. The exit code is 0 where no log is changed, 5 where one is, 4 where that
    none is is doubtful.
    """
    return watch_logs(options, options.folder, None)


def watch_logs(options: argparse.Namespace, folder: Path, after: Path | None) -> int:
    """As the command, of one folder or of two."""
    if options.case is None:
        raise InputError(
            "A folder of logs needs the case that they are identified with.", where=str(folder),
            next_step="Add --case CASE.yaml, whose log those of the folder stand for.",
        )  # fmt: skip
    out = options.out or Path("results") / f"{folder.resolve().name}-watch"
    with Display(quiet=options.quiet or options.json) as display:
        display.say(f"reading {folder}")
        from fmu_didim.workflow.watch import Watched, watch

        def shown(found: Watched) -> None:
            display.close()
            show("\n".join(map(json_shown, found.lines())) if options.json else f"\n{found.summary()}")

        found = watch(
            folder, options.case, out, after=after, reference=options.reference, until=options.until,
            by_time=options.by_time, effects=options.effects is not False, progress=display.say, show=shown,
        )  # fmt: skip
    if not options.quiet and not options.json:
        show(f"\nPage: {out / 'watch.html'}   History: {out / 'watch.json'}   ({since_start():.1f} s)")
    return found.exit_code
