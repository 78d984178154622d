"""The verb ``name-controller`` on the command line: its options and what it prints."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

from fmu_didim.base.terminal import json_shown, quoted
from fmu_didim.cli.console import Display, show, since_start


def add_name_controller_options(verb: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    help_ = "folder for law.json, controller.yaml and its FMU (results/<case>_controller)"
    verb.add_argument("--out", type=Path, metavar="DIR", help=help_)
    shown = verb.add_mutually_exclusive_group()
    shown.add_argument("--quiet", action="store_true", help="print the tables only")
    shown.add_argument("--json", action="store_true", help="print law.json and nothing else")


def run_name_controller(options: argparse.Namespace, stem: Callable[[Path], str]) -> int:
    """Name the control law of a case whose controller nobody knows, from reference, torque and positions; find its
    gains with their intervals, and write it as a description and an FMU.

    The exit code is 0, 4 with doubts, 1 where no law of the catalogue explains the torque.
    """
    out = options.out or Path("results") / f"{stem(options.case)}_controller"
    with Display(quiet=options.quiet or options.json) as display:
        display.say(f"reading {options.case}")
        from fmu_didim.workflow import name_controller
        from fmu_didim.workflow.output.result_folder import check_writable

        check_writable(out)
        found = name_controller(options.case, progress=display.say)
        display.close()
        if not options.json:
            show(f"\n{found.summary()}")
        written = found.save(out)
    if options.json:
        print(json_shown(json.dumps(found.saved(), indent=1, ensure_ascii=False)))
        return found.exit_code
    print("\n".join(str(path) for path in written))
    if found.ok:
        entry = f"controller: {{source: {written[1]}}}"
        print(f"In the case: {entry}   ({since_start():.1f} s)   FMU: {quoted(written[2])}")
    return found.exit_code
