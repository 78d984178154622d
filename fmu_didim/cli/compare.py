"""The command line of the verb compare."""

from __future__ import annotations

import argparse
from pathlib import Path

from fmu_didim.base.errors import InputError
from fmu_didim.base.terminal import json_shown
from fmu_didim.cli.console import Display, show, since_start
from fmu_didim.cli.watch import add_folder_options, watch_logs


def add_compare(verb: argparse.ArgumentParser) -> None:
    """Add its arguments."""
    help_ = (
        "a case, which is identified; or result.json of fmu-didim identify, or its folder; with --case a folder of logs"
    )
    verb.add_argument("before", type=Path, metavar="BEFORE", help=help_)
    help_ = "the same of a later log; with --case of later logs, or left out: BEFORE has them all"
    verb.add_argument("after", type=Path, nargs="?", metavar="AFTER", help=help_)
    help_ = "the case whose log those of folders stand for, in turn: all of BEFORE are the reference"
    verb.add_argument("--case", type=Path, metavar="CASE.yaml", help=help_)
    add_folder_options(verb)
    help_ = "compare the values of cases or logs only, which is faster: effects that the model lacks are not looked for"
    verb.add_argument("--no-effects", dest="effects", action="store_const", const=False, help=help_)
    help_ = "folder for compare.json and compare.html (results/<before>-<after>); of folders as of watch"
    verb.add_argument("--out", type=Path, metavar="DIR", help=help_)
    shown = verb.add_mutually_exclusive_group()
    shown.add_argument("--quiet", action="store_true", help="print the table only")
    shown.add_argument("--json", action="store_true", help="print the comparison as JSON and nothing else")


def compare_results(options: argparse.Namespace) -> int:
    """Say whether the machine has changed between two logs, which values moved, and which cause explains that.

    The exit code is 0 where nothing has changed, 5 where something has, 4 where that nothing has is doubtful. Folders
    of logs are compared as by fmu-didim watch.
    """
    if options.case is not None or options.after is None:
        return _folders(options)
    _refuse_options(options, ("reference", "until", "by_time"), "folders of logs", "Give the folders and --case.")
    out = options.out or Path("results") / "-".join(_name(path) for path in (options.before, options.after))
    with Display(quiet=options.quiet or options.json) as display:
        display.say(f"reading {options.before} and {options.after}")
        from fmu_didim.workflow.compare import Compared, compare

        def shown(found: Compared) -> None:
            display.close()
            if not options.json:
                show(f"\n{found.summary()}")

        found = compare(
            options.before, options.after, out, effects=options.effects, progress=display.say, show=shown
        )  # fmt: skip
    if options.json:
        show(json_shown(found.document.model_dump_json(indent=1)))
    elif not options.quiet:
        show(f"\nPage: {out / 'compare.html'}   Comparison: {out / 'compare.json'}   ({since_start():.1f} s)")
    return found.exit_code


def _folders(options: argparse.Namespace) -> int:
    """Of one folder of logs, or of two."""
    if options.case is None and not options.before.is_dir():
        raise InputError(
            "One result is compared with another.", where=str(options.before), got="no AFTER",
            next_step="Give the result, or the case, of a later log, too.",
        )  # fmt: skip
    if options.after is not None:
        _refuse_options(
            options, ("reference", "until"), "one folder", "Leave it out: all logs of BEFORE are the reference."
        )
    return watch_logs(options, options.before, options.after)


def _refuse_options(options: argparse.Namespace, names: tuple[str, ...], of: str, step: str) -> None:
    given = [name for name in names if getattr(options, name) not in (None, False)]
    if given:
        raise InputError(
            f"This option is for {of}.", where=", ".join(f"--{n.replace('_', '-')}" for n in given),
            next_step=step,
        )  # fmt: skip


def _name(path: Path) -> str:
    """What a result or a case is called in the name of the folder."""
    if path.suffix == ".json":
        path = path.parent
    return path.stem if path.suffix in (".yaml", ".yml") else path.resolve().name
