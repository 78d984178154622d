"""The command line: arguments and printing only."""

from __future__ import annotations

import argparse
import logging
import math
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from fmu_didim.campaigns.commands import add_campaign
from fmu_didim.errors import FmuDidimError, InputError
from fmu_didim.files import is_file
from fmu_didim.imports import NO_CODE
from fmu_didim.terminal import printable, unforeseen
from fmu_didim.version import __version__

if TYPE_CHECKING:
    from fmu_didim.prediction.iteration import Iteration
    from fmu_didim.workflow import Discovered, Outcome

_Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
EXIT_ERROR, EXIT_INTERRUPTED = 1, 130


FIGURES = "write the charts of the page as PNG and SVG, too, for a paper"


def main(arguments: list[str] | None = None) -> int:
    """Entry point of ``fmu-didim``: 0 success, 1 error or refusal, 2 wrong usage, 3 not settled, 4 doubtful."""
    with printable():
        options = _parser().parse_args(arguments)
        return _run(options)


def _run(options: argparse.Namespace) -> int:
    try:
        with _told(quiet=getattr(options, "quiet", False)), _code_allowed(not getattr(options, "no_code", False)):
            _check_current_folder()
            return int(options.run(options))
    except KeyboardInterrupt:
        print("\nfmu-didim: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except Exception as error:  # noqa: BLE001 - the last resort: a line and a log, no traceback
        if getattr(options, "debug", False):
            traceback.print_exception(error)
        told = error if isinstance(error, FmuDidimError) else unforeseen(error)
        print(f"\nfmu-didim: {told}", file=sys.stderr)
        return EXIT_ERROR


@contextmanager
def _code_allowed(allowed: bool) -> Iterator[None]:
    """Whether Python that a case names is run; an environment in which it is not stays as it is."""
    before = os.environ.get(NO_CODE)
    if not allowed:
        os.environ[NO_CODE] = "1"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(NO_CODE, None)


def _check_current_folder() -> None:
    try:
        os.getcwd()  # noqa: PTH109 - Path.cwd() is the same
    except OSError as error:
        raise InputError(
            "The current folder does not exist any more.", got=str(error), next_step="Change to another folder."
        ) from error


@contextmanager
def _told(*, quiet: bool) -> Iterator[None]:
    """What the package logs stands on standard error: what takes long the first time, and what to know of an FMU."""
    logger, handler = logging.getLogger("fmu_didim"), logging.StreamHandler(sys.stderr)
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.WARNING if quiet else logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fmu-didim",
        description="Identify the dynamic parameters of robots and drives from motor torque alone (DIDIM).",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    parser.add_argument("--debug", action="store_true", help=_DEBUG)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_case_verbs(commands)
    _add_export(commands)
    _add_fmu(commands)
    _add_cache(commands)
    add_campaign(commands, _say)
    return parser


_DEBUG = "show the traceback of an error"


def _add_common(verb: argparse.ArgumentParser, *, code: bool = False) -> None:
    """The options of all verbs, and of those that read cases or descriptions."""
    verb.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help=_DEBUG)
    if code:
        help_ = "run no Python that the case or a description names; FMUs, which are programs too, do run"
        verb.add_argument("--no-code", action="store_true", help=help_)


def _add_case_verbs(commands: _Commands) -> None:
    one = _case_verb(commands, "identify", _identify, "identify the parameters of a case")
    one.add_argument("--out", type=Path, metavar="DIR", help="folder for result.json and report.html (results/<case>)")
    one.add_argument("--figures", action="store_true", help=FIGURES)
    one.add_argument("--quiet", action="store_true", help="print the table only")
    checked = _case_verb(commands, "check", _check, "look at a case before any long work", optional=True)
    checked.add_argument("--codes", action="store_true", help="print all codes of diagnostics instead")
    two = _case_verb(commands, "simulate", _simulate, "simulate the closed loop of a case")
    two.add_argument("--out", type=Path, metavar="FILE.csv", help="table of torque and motion (results/<case>.csv)")
    two.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="value of a base parameter")
    two.add_argument("--experiment", metavar="LABEL", help="whose reference: estimation (the first), validation, ...")
    help_ = "find, name and add the physical effects that the model lacks"
    found = _case_verb(commands, "discover", _discover, help_, case="the case file; its validation is held out")
    found.add_argument("--out", type=Path, metavar="DIR", help="folder for findings.json and all else (results/<case>)")
    found.add_argument("--forbid", action="append", default=[], metavar="EFFECT", help="never propose this effect")
    found.add_argument("--prefer", action="append", default=[], metavar="EFFECT", help="take it first where it fits")
    found.add_argument("--effect", action="append", default=[], metavar="PACKAGE.MODULE:NAME", help="a further effect")
    found.add_argument("--rounds", type=int, default=5, metavar="N", help="largest number of effects (5)")
    found.add_argument("--seed", type=int, default=0, metavar="N", help="of the bootstrap (0)")
    found.add_argument(
        "--time-limit", type=float, metavar="SECONDS", help="end with the best answer so far; the exit code is 3 then"
    )
    found.add_argument("--figures", action="store_true", help=FIGURES)
    found.add_argument("--quiet", action="store_true", help="print the table only")


def _case_verb(
    commands: _Commands,
    name: str,
    run: Callable[[argparse.Namespace], int],
    help_: str,
    case: str = "the case file",
    *,
    optional: bool = False,
) -> argparse.ArgumentParser:
    verb = commands.add_parser(name, help=help_, description=run.__doc__)
    verb.add_argument("case", type=Path, metavar="CASE.yaml", help=case, nargs="?" if optional else None)
    verb.set_defaults(run=run)
    _add_common(verb, code=True)
    return verb


def _add_export(commands: _Commands) -> None:
    three = commands.add_parser(
        "export",
        help="build the FMU of a robot or controller description, or write the loop of a case as an SSP archive",
        description=_export.__doc__,
    )
    three.add_argument(
        "description", type=Path, metavar="DESCRIPTION.yaml", help="a robot or a controller; with --ssp a case"
    )
    three.add_argument(
        "--ssp", type=Path, metavar="FILE.ssp", help="write the closed loop of a case, its FMUs and values"
    )
    three.add_argument(
        "--result", type=Path, metavar="result.json", help="with --ssp: the identified values instead of the robot's"
    )
    three.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="folder for the FMU (this folder)")
    three.add_argument("--fmi", metavar="VERSION", help="version of the standard, such as 3.0")
    three.add_argument(
        "--platform",
        action="append",
        metavar="NAME",
        help="machine to build for, may be repeated: linux-x86_64, linux-arm64, windows-x86_64, macos-x86_64, "
        "macos-arm64 (this one)",
    )
    three.set_defaults(run=_export)
    _add_common(three, code=True)


def _add_fmu(commands: _Commands) -> None:
    four = commands.add_parser("fmu", help="what an FMU is and can (info), how it behaves (check)")
    tasks = four.add_subparsers(required=True, metavar="info|check")
    for name, run in (("info", _fmu_info), ("check", _fmu_check)):
        task = tasks.add_parser(name, help=run.__doc__, description=run.__doc__)
        task.add_argument("file", type=Path, metavar="FILE.fmu")
        task.set_defaults(run=run)
        _add_common(task)
        if name == "check":
            task.add_argument("--interface", choices=("co-simulation", "model-exchange"), help="how it is run")
            task.add_argument("--step", type=float, metavar="SECONDS", help="communication step")


def _add_cache(commands: _Commands) -> None:
    five = commands.add_parser("cache", help="what is kept between runs: show it, clear it, clear one FMU")
    tasks = five.add_subparsers(required=True, metavar="show|clear")
    show = tasks.add_parser("show", help=_cache_show.__doc__, description=_cache_show.__doc__)
    show.set_defaults(run=_cache_show)
    _add_common(show)
    clear = tasks.add_parser("clear", help=_cache_clear.__doc__, description=_cache_clear.__doc__)
    clear.add_argument("file", type=Path, metavar="FILE.fmu", nargs="?", help="only what is kept of this FMU")
    clear.set_defaults(run=_cache_clear)
    _add_common(clear)


def _identify(options: argparse.Namespace) -> int:
    """Identify the parameters of a case, print the table, save result.json and report.html."""
    from fmu_didim.case import load_case
    from fmu_didim.workflow import identify
    from fmu_didim.workflow.identify import OWN_ROBOT_FILE, ROBOT_FILE, result_folder

    out = options.out or Path("results") / _stem(options.case)
    say = _silent if options.quiet else _say
    started = time.perf_counter()
    result_folder(out).check()
    say(f"Reading {options.case} and building its FMUs (the first time takes some seconds) ...")
    case = load_case(options.case)
    say(f"Ready after {time.perf_counter() - started:.1f} s. Identifying {case.name} ...")

    def progress(iteration: Iteration) -> None:
        say(_progress_line(iteration, time.perf_counter() - started))

    outcome = identify(case, out=out, figures=options.figures, progress=progress, show=_print_summary)
    if outcome.robot is not None:
        robot = out / ROBOT_FILE
        print(f"\nThe robot with these values: {robot}   (its FMU: fmu-didim export {robot})")
        for label in outcome.robots:
            print(f"  with those of {label}: {out / OWN_ROBOT_FILE.format(label=label)}")
        if outcome.outside_robot:
            print(f"  not in it, because not of the robot: {', '.join(outcome.outside_robot)}")
    print(f"\nReport: {out / 'report.html'}   Result: {out / 'result.json'}   ({time.perf_counter() - started:.1f} s)")
    return outcome.exit_code


def _check(options: argparse.Namespace) -> int:
    """Look at plant, parameters, data and start of a case; the exit code is 1 where something must be mended."""
    from fmu_didim.workflow import check
    from fmu_didim.workflow.codes import codes_text

    if options.codes:
        print(codes_text(), end="")
        return 0
    if options.case is None:
        raise InputError("check needs a case.", next_step="fmu-didim check CASE.yaml, or fmu-didim check --codes.")
    found = check(options.case)
    print(found.summary(), end="")
    return 0 if found.ok else EXIT_ERROR


def _discover(options: argparse.Namespace) -> int:
    """Find where simulation and measurement disagree, name the missing effect, add it, show the gap shrink.

    The exit code is 0, 4 where the answer is doubtful, 3 where the time limit ended the search.
    """
    from fmu_didim.workflow import discover

    out = options.out or Path("results") / f"{_stem(options.case)}_discover"
    started = time.perf_counter()

    def progress(text: str) -> None:
        _say(f"  {time.perf_counter() - started:6.1f} s  {text}")

    say = _silent if options.quiet else progress
    say(f"reading {options.case}")
    found = discover(
        options.case, out, forbid=options.forbid, prefer=options.prefer, effects=options.effect,
        rounds=options.rounds, seed=options.seed, time_limit=options.time_limit, progress=say,
        show=_print_summary, figures=options.figures,
    )  # fmt: skip
    took = f"({time.perf_counter() - started:.1f} s)"
    print(f"\nReport: {out / 'discovery.html'}   Findings: {out / 'findings.json'}   {took}")
    return found.exit_code


def _simulate(options: argparse.Namespace) -> int:
    """Simulate the closed loop of a case with the values of its robot description, write a CSV table."""
    from fmu_didim.signals import write_csv
    from fmu_didim.workflow import simulate
    from fmu_didim.workflow.result_folder import check_writable, write_whole

    out = options.out or Path("results") / f"{_stem(options.case)}.csv"
    check_writable(out.parent)
    table = simulate(options.case, parameters=_assignments(options.set), experiment=options.experiment)
    write_whole(out, partial(write_csv, table))
    print(f"{table.time.size} rows, columns t, {', '.join(table.names)}: {out}")
    return 0


def _export(options: argparse.Namespace) -> int:
    """Build the FMU of a robot or controller description; with --ssp, write the loop of a case as an SSP archive."""
    from fmu_didim.workflow.result_folder import check_writable, told_unwritable, write_whole

    if options.ssp is not None:
        from fmu_didim.workflow import export_ssp

        check_writable(options.ssp.parent)
        write_whole(options.ssp, partial(export_ssp, options.description, result=options.result))
        print(options.ssp)
        return 0
    if options.result is not None:
        raise InputError("--result goes with --ssp.", next_step="Give --ssp FILE.ssp and a case.")
    from fmu_didim.controllers import read_controller
    from fmu_didim.documents import load_yaml
    from fmu_didim.export import build_fmu
    from fmu_didim.export.versions import DEFAULT_VERSION
    from fmu_didim.robot import RobotModel, read_robot

    is_controller = "law" in load_yaml(options.description)
    block = (
        read_controller(options.description) if is_controller else RobotModel(read_robot(options.description)).block()
    )
    check_writable(options.out)
    version = options.fmi or DEFAULT_VERSION
    with told_unwritable(options.out):
        print(build_fmu(block, directory=options.out, fmi_version=version, platforms=options.platform))
    return 0


def _fmu_info(options: argparse.Namespace) -> int:
    """Tell what an FMU is: version, interfaces, platforms, variables with units and start values."""
    from fmu_didim.components.fmu import info_lines, read_description

    print("\n".join(info_lines(read_description(options.file))))
    return 0


def _fmu_check(options: argparse.Namespace) -> int:
    """Try out how an FMU behaves: reset, saved state, feed-through, parameters; and how to run it again."""
    from fmu_didim.components.fmu import load_fmu, probe_fmu

    found = probe_fmu(load_fmu(options.file, interface=options.interface), step_size=options.step)
    print("\n".join(found.lines()))
    return EXIT_ERROR if found.failure else 0


def _cache_show(options: argparse.Namespace) -> int:
    """Tell where compiled and extracted files are kept, and how much of each kind."""
    from fmu_didim.cache import KINDS, LIMIT, cache_directory, entries

    found = list(entries())
    print(f"{cache_directory()}   (FMU_DIDIM_CACHE names another folder; at most about {LIMIT / 2**30:.0f} GB)")
    for kind, what in KINDS.items():
        sizes = [entry.size for entry in found if entry.kind == kind]
        print(f"{kind:12} {len(sizes):6} {sum(sizes) / 2**20:10.1f} MB   {what}")
    print(f"{'total':12} {len(found):6} {sum(entry.size for entry in found) / 2**20:10.1f} MB")
    return 0


def _cache_clear(options: argparse.Namespace) -> int:
    """Remove what is kept between runs, of one FMU or all; it is made anew when it is needed."""
    from fmu_didim.cache import entries, file_digest, remove_entry

    if options.file is not None and not is_file(options.file):
        raise InputError("The FMU does not exist.", where=str(options.file), next_step="Check the path.")
    found = list(entries(file_digest(options.file) if options.file is not None else ""))
    for entry in found:
        remove_entry(entry.path)
    print(f"{len(found)} entries removed, {sum(entry.size for entry in found) / 2**20:.1f} MB")
    return 0


def _assignments(texts: list[str]) -> dict[str, float]:
    values = {}
    for text in texts:
        name, separator, number = text.partition("=")
        try:
            values[name.strip()] = float(number)
        except ValueError:
            separator = ""
        if not separator:
            raise InputError("This is not an assignment.", where="--set", got=text, valid="NAME=VALUE, such as Fc1=0.8")
    return values


def _stem(case: Path) -> str:
    """A folder name that tells cases of one folder apart: ``scara-identify``."""
    return f"{case.resolve().parent.name}-{case.stem}"


def _print_summary(found: Outcome | Discovered) -> None:
    """The table, before anything is written: it is there even if the disk is full."""
    print(f"\n{found.summary()}", flush=True)


def _say(text: str) -> None:
    print(text, flush=True)


def _silent(text: str) -> None:
    pass


def _progress_line(iteration: Iteration, elapsed: float) -> str:
    error = iteration.relative_error_percent
    text = f"torque error {error:7.3f} %" if math.isfinite(error) else "no simulation       "
    change = f", change {iteration.change:.2e}" if math.isfinite(iteration.change) else ""
    note = f"  [{iteration.note}]" if iteration.note else ""
    return f"{elapsed:6.1f} s  {iteration.stage:>6} {iteration.number}: {text}{change}{note}"


if __name__ == "__main__":
    sys.exit(main())
