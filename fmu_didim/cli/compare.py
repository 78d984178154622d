"""The command line of the verb compare."""

from __future__ import annotations

import argparse
from pathlib import Path

from fmu_didim.base.terminal import json_shown
from fmu_didim.cli.console import Display, show, since_start


def add_compare(verb: argparse.ArgumentParser) -> None:
    """Add its arguments."""
    help_ = "a case, which is identified; or result.json of fmu-didim identify, or its folder"
    verb.add_argument("before", type=Path, metavar="BEFORE", help=help_)
    verb.add_argument("after", type=Path, metavar="AFTER", help="the same of a later log")
    help_ = "compare the values of two cases only, which is faster: effects that the model lacks are not looked for"
    verb.add_argument("--no-effects", dest="effects", action="store_const", const=False, help=help_)
    help_ = "folder for compare.json and compare.html (results/<before>-<after>)"
    verb.add_argument("--out", type=Path, metavar="DIR", help=help_)
    shown = verb.add_mutually_exclusive_group()
    shown.add_argument("--quiet", action="store_true", help="print the table only")
    shown.add_argument("--json", action="store_true", help="print the comparison as JSON and nothing else")


def compare_results(options: argparse.Namespace) -> int:
    """Say whether the machine has changed between two logs, which values moved, and which cause explains that.

    The exit code is 0 where nothing has changed, 5 where something has, 4 where that nothing has is doubtful.
    """
    out = options.out or Path("results") / "-".join(_name(path) for path in (options.before, options.after))
    with Display(quiet=options.quiet or options.json) as display:
        display.say(f"reading {options.before} and {options.after}")
        from fmu_didim.workflow import Compared, compare

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


def _name(path: Path) -> str:
    """What a result or a case is called in the name of the folder."""
    if path.suffix == ".json":
        path = path.parent
    return path.stem if path.suffix in (".yaml", ".yml") else path.resolve().name
