"""The verb ``name-controller`` on the command line: its options and what it prints."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fmu_didim.base.terminal import quoted
from fmu_didim.cli.console import since_start
from fmu_didim.cli.saved import show_and_save

if TYPE_CHECKING:
    from fmu_didim.workflow.naming.named import NamedController


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

    def make(progress: Callable[[str], None]) -> NamedController:
        from fmu_didim.workflow.naming.verb import name_controller

        return name_controller(options.case, progress=progress)

    def last(written: Sequence[Path]) -> str:
        entry = f"controller: {{source: {written[1]}}}"
        return f"In the case: {entry}   ({since_start():.1f} s)   FMU: {quoted(written[2])}"

    return show_and_save(options, out, make, last)
