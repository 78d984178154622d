"""The command line: arguments and printing only."""

from __future__ import annotations

import argparse
import gc
import inspect
import json
import logging
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.base.files import is_file
from fmu_didim.base.imports import NO_CODE
from fmu_didim.base.terminal import json_shown, printable, quoted, unforeseen
from fmu_didim.base.version import __version__
from fmu_didim.cli.campaign import add_campaign
from fmu_didim.cli.compare import add_compare, compare_results
from fmu_didim.cli.console import CurrentStderr, Display, begin, is_terminal, show, since_start
from fmu_didim.cli.excite import add_excite_options, run_excite
from fmu_didim.cli.memory import end_at_once, keep_freed_memory, loading
from fmu_didim.cli.name_controller import add_name_controller_options, run_name_controller
from fmu_didim.cli.numbers import at_least_one, at_least_two, not_negative, positive
from fmu_didim.cli.prepare import add_prepare_verbs
from fmu_didim.cli.printed_by_fmus import LastLines, kept_apart
from fmu_didim.cli.watch import add_watch, run_watch

if TYPE_CHECKING:
    from fmu_didim.workflow.output.discovered import Discovered
    from fmu_didim.workflow.output.result import Result

_Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
EXIT_ERROR, EXIT_USAGE, EXIT_INTERRUPTED = 1, 2, 130
GARBAGE = 50_000
"""[objects] New ones, after which cycles of what is needed no more are looked for: Python's 700 are reached hundreds of
times by imports alone, and cost a tenth of their time."""
FIGURES = "write the charts of the page as PNG and SVG, too, for a paper"


def main(arguments: list[str] | None = None) -> int:
    """Entry point of ``fmu-didim``: 0 success, 1 error or refusal, 2 wrong usage, 3 not settled, 4 doubtful, 5
    changed."""
    begin()
    gc.set_threshold(GARBAGE, *gc.get_threshold()[1:])
    keep_freed_memory()
    end_at_once()
    with kept_apart() as last_lines, printable():
        typed = sys.argv[1:] if arguments is None else arguments
        return _run(command_parser().parse_args(typed), typed, last_lines)


def _run(options: argparse.Namespace, typed: Sequence[str], last_lines: LastLines) -> int:
    try:
        with _logged(quiet=getattr(options, "quiet", False)), _code_allowed(not getattr(options, "no_code", False)):
            _check_names(typed)
            return int(options.run(options))
    except KeyboardInterrupt:
        print("\nfmu-didim: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except Exception as error:  # noqa: BLE001 - the last resort: a line and a log, no traceback
        if getattr(options, "debug", False):
            traceback.print_exception(error)
        told = _with_line(error, options) if isinstance(error, FmuDidimError) else unforeseen(error)
        if getattr(options, "json", False):
            what, where, step = (getattr(told, name, "") for name in ("what", "where", "next_step"))
            print(json.dumps({"error": what or str(told), "where": where, "next_step": step}, indent=1))
        show(f"\nfmu-didim: {told}", stream=sys.stderr)
        if printed := last_lines():
            show("\nThe last lines that FMUs printed:\n" + "\n".join(printed), stream=sys.stderr)
        return EXIT_ERROR


def _with_line(error: FmuDidimError, options: argparse.Namespace) -> FmuDidimError:
    """The error with the line of the case, where it names a key of it."""
    case, key = getattr(options, "case", None), re.match(r"[a-z_]\w*(\.\w+)*", error.where)
    if isinstance(case, Path) and is_file(case) and key is not None:
        from fmu_didim.base.documents import Lines

        if line := Lines(case).of(key[0].split("."), whole=True):
            error.locate(f"{case}, {line}")
    return error


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


def _check_names(typed: Sequence[str]) -> None:
    """Raise InputError where the current folder is gone, or a name cannot be written into any result or FMU."""
    try:
        folder = os.getcwd()  # noqa: PTH109 - as the system gives it
    except OSError as error:
        raise InputError(
            "The current folder does not exist any more.", got=str(error), next_step="Change to another folder."
        ) from error
    places = [os.environ.get(name, "") for name in ("HOME", "TMPDIR", "XDG_CACHE_HOME", "FMU_DIDIM_CACHE")]
    for name in (*typed, folder, *places):
        try:
            name.encode("utf-8")
        except UnicodeEncodeError as error:
            raise InputError(
                "The name of a file or folder is not text in the encoding of this shell.", where=name,
                got=f"encoding {sys.getfilesystemencoding()}",
                next_step="Set PYTHONUTF8=1, or LC_ALL to a UTF-8 locale such as C.UTF-8; or rename it.",
            ) from error  # fmt: skip


@contextmanager
def _logged(*, quiet: bool) -> Iterator[None]:
    """Write what the package logs to standard error: work that takes long the first time, and warnings."""
    logger, handler = logging.getLogger("fmu_didim"), CurrentStderr()
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.WARNING if quiet else logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


def command_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fmu-didim",
        description="Identify the dynamic parameters of robots and drives from motor torque alone (DIDIM),\n"
        "or those of any FMU from recorded inputs and measured outputs.",
        epilog=_BEGIN,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    parser.add_argument("--debug", action="store_true", help=_DEBUG)

    def no_command(_: argparse.Namespace) -> int:
        parser.print_help(sys.stderr)
        return EXIT_USAGE

    parser.set_defaults(run=no_command)
    commands = parser.add_subparsers(metavar="COMMAND")
    for verb in add_prepare_verbs(commands, parser=parser):
        _add_common(verb, code=True)
    _add_case_verbs(commands)
    add_compare(_verb(commands, "compare", compare_results, "say what has changed between two logs"))
    add_watch(_verb(commands, "watch", run_watch, "say which logs of a folder show a changed machine, and since when"))
    _add_export(commands)
    _add_fmu(commands)
    _add_cache(commands)
    add_campaign(commands, partial(print, flush=True))
    return parser


_BEGIN = """begin with an example that ships with the package:
  fmu-didim example

examples:
  fmu-didim init log.csv
  fmu-didim init house.fmu weather.csv room.csv
  fmu-didim validate case.yaml
  fmu-didim identify case.yaml"""
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
    help_ = "intervals of all parameters by the profile of the misfit, too (profile: in the case)"
    one.add_argument("--profile", action="store_true", default=None, help=help_)
    help_ = "which parameters the data do not need, and the model without them (robot_essential.yaml), too"
    one.add_argument("--essential", action="store_true", help=help_)
    one.add_argument("--figures", action="store_true", help=FIGURES)
    _add_output(one, "the result")
    checked = _case_verb(commands, "check", _check, "check a case before any long work", optional=True)
    checked.add_argument("--codes", action="store_true", help="print all codes of diagnostics instead")
    checked.add_argument("--json", action="store_true", help="print what was found as JSON")
    help_ = "which parameters matter between their bounds, too (pip install 'fmu_didim[sensitivity]')"
    checked.add_argument("--sensitivity", choices=("morris", "sobol"), help=help_)
    help_ = "of --sensitivity: trajectories of Morris (20), base points of Sobol (64)"
    checked.add_argument("--samples", type=at_least_two, metavar="N", help=help_)
    checked.add_argument("--seed", type=not_negative, default=0, metavar="N", help="of --sensitivity (0)")
    checked.add_argument("--figure", type=Path, metavar="FILE.svg", help="draw --sensitivity, as .svg, .png or .pdf")
    two = _case_verb(commands, "simulate", _simulate, "simulate the closed loop of a case, or its model")
    two.add_argument(
        "--out", type=Path, metavar="FILE.csv", help="table of torque and motion, or outputs (results/<case>.csv)"
    )
    two.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="value of a parameter that is identified"
    )
    two.add_argument("--experiment", metavar="LABEL", help="whose reference or inputs: estimation (the first), ...")
    help_ = "design the motion that tells most of the parameters, before anyone measures"
    add_excite_options(_case_verb(commands, "excite", _excite, help_))
    help_ = "name the law of a controller that nobody knows, and find its gains"
    add_name_controller_options(_case_verb(commands, "name-controller", _name_controller, help_))
    help_ = "find, name and add the physical effects that the model lacks"
    found = _case_verb(commands, "discover", _discover, help_, case="the case file; its validation is held out")
    found.add_argument("--out", type=Path, metavar="DIR", help="folder for findings.json and all else (results/<case>)")
    found.add_argument("--forbid", action="append", default=[], metavar="EFFECT", help="never propose this effect")
    found.add_argument("--prefer", action="append", default=[], metavar="EFFECT", help="take it first where it fits")
    found.add_argument("--effect", action="append", default=[], metavar="MODULE:NAME", help="also this: my.py:MyEffect")
    found.add_argument("--rounds", type=not_negative, default=5, metavar="N", help="largest number of effects (5)")
    found.add_argument("--seed", type=not_negative, default=0, metavar="N", help="of the bootstrap (0)")
    found.add_argument(
        "--time-limit",
        type=positive,
        metavar="SECONDS",
        help="end with the best answer so far; the exit code is 3 then",
    )
    found.add_argument("--figures", action="store_true", help=FIGURES)
    _add_output(found, "the findings")


def _add_output(verb: argparse.ArgumentParser, what: str) -> None:
    shown = verb.add_mutually_exclusive_group()
    shown.add_argument("--quiet", action="store_true", help="print the table only")
    shown.add_argument("--json", action="store_true", help=f"print {what} as JSON and nothing else")


def _case_verb(
    commands: _Commands,
    name: str,
    run: Callable[[argparse.Namespace], int],
    help_: str,
    case: str = "the case file",
    *,
    optional: bool = False,
) -> argparse.ArgumentParser:
    verb = _verb(commands, name, run, help_)
    verb.add_argument("case", type=Path, metavar="CASE.yaml", help=case, nargs="?" if optional else None)
    return verb


def _verb(
    commands: _Commands, name: str, run: Callable[[argparse.Namespace], int], help_: str, key: str = ""
) -> argparse.ArgumentParser:
    """A verb whose help ends with examples."""
    examples = "\n".join(f"  {line}" for line in EXAMPLES[key or name])
    verb = commands.add_parser(
        name, help=help_, description=inspect.getdoc(run), epilog=f"examples:\n{examples}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    verb.set_defaults(run=run)
    _add_common(verb, code=not key)  # FMUs and the cache name no Python
    return verb


EXAMPLES: Mapping[str, Sequence[str]] = {
    "identify": (
        "fmu-didim identify examples/scara/identify.yaml",
        "fmu-didim identify case.yaml --out results/first --quiet",
        "fmu-didim identify case.yaml --profile --essential",
        "fmu-didim identify case.yaml --json | jq .parameters",
    ),
    "check": (
        "fmu-didim check case.yaml",
        "fmu-didim check case.yaml --sensitivity morris --figure effects.svg",
        "fmu-didim check --codes",
    ),
    "simulate": (
        "fmu-didim simulate case.yaml --out loop.csv",
        "fmu-didim simulate case.yaml --set Fc1=0.5 --set Fv1=0 --experiment validation",
    ),
    "excite": (
        "fmu-didim excite case.yaml --torque-std 0.2,0.05",
        "fmu-didim excite case.yaml --limits limits.yaml --period 5 --periods 2 --only ZZ2,MX2",
        "fmu-didim excite gains.yaml --limits limits.yaml --weigh 0.5,1,2 --at=0.12,-0.03,0 --at=0.3,0,0",
    ),
    "name-controller": (
        "fmu-didim name-controller case.yaml",
        "fmu-didim name-controller case.yaml --json | jq .gains",
    ),
    "discover": (
        "fmu-didim discover examples/arm2r/discover.yaml",
        "fmu-didim discover case.yaml --forbid backlash --time-limit 60",
        "fmu-didim discover case.yaml --effect my_module:Grease",
    ),
    "compare": (
        "fmu-didim compare results/spring results/autumn",
        "fmu-didim compare spring.yaml autumn.yaml --out results/compared",
        "fmu-didim compare results/spring results/autumn --json | jq .causes",
    ),
    "watch": (
        "fmu-didim watch logs --case case.yaml",
        "fmu-didim watch logs --case case.yaml --until 2024-05-31 --out results/axis1",
        "fmu-didim watch logs --case case.yaml --json | jq -r 'select(.state == \"changed\") | .name'",
    ),
    "export": (
        "fmu-didim export robot.yaml --out fmus",
        "fmu-didim export robot.yaml --fmi 3.0 --platform windows-x86_64 --platform linux-x86_64",
        "fmu-didim export case.yaml --ssp loop.ssp --result results/first/result.json",
        "fmu-didim export case.yaml --robot identified.urdf --result results/first/result.json --draws 20",
    ),
    "fmu info": ("fmu-didim fmu info vendor.fmu",),
    "fmu check": ("fmu-didim fmu check vendor.fmu", "fmu-didim fmu check vendor.fmu --step 0.001"),
    "cache show": ("fmu-didim cache show",),
    "cache clear": ("fmu-didim cache clear", "fmu-didim cache clear vendor.fmu"),
}


def _add_export(commands: _Commands) -> None:
    help_ = "build the FMU of a description, or write the loop of a case as SSP, or its robot as URDF or MJCF"
    three = _verb(commands, "export", _export, help_)
    help_ = "a robot, a controller or a Modelica file; with --ssp or --robot a case"
    three.add_argument("description", type=Path, metavar="DESCRIPTION.yaml", help=help_)
    help_ = "write the closed loop of a case, its FMUs and values"
    three.add_argument("--ssp", type=Path, metavar="FILE.ssp", help=help_)
    help_ = "write the robot of a case as .urdf, .xml (MJCF) or .yaml, with links that exist"
    three.add_argument("--robot", type=Path, metavar="FILE", help=help_)
    help_ = "with --robot: so many more, drawn from the covariance of the result"
    three.add_argument("--draws", type=at_least_one, metavar="N", help=help_)
    three.add_argument("--seed", type=int, default=0, metavar="N", help="with --draws: of the random numbers (0)")
    help_ = "with --ssp or --robot: the identified values instead of the robot's"
    three.add_argument("--result", type=Path, metavar="result.json", help=help_)
    three.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="folder for the FMU (this folder)")
    three.add_argument("--fmi", metavar="VERSION", help="version of the standard, such as 3.0")
    names = "linux-x86_64, linux-arm64, windows-x86_64, macos-x86_64, macos-arm64"
    help_ = f"machine to build for, may be repeated: {names} (this one)"
    three.add_argument("--platform", action="append", metavar="NAME", help=help_)


def _add_fmu(commands: _Commands) -> None:
    four = commands.add_parser("fmu", help="what an FMU is and can (info), how it behaves (check)")
    tasks = four.add_subparsers(required=True, metavar="info|check")
    for name, run in (("info", _fmu_info), ("check", _fmu_check)):
        task = _verb(tasks, name, run, inspect.getdoc(run) or "", f"fmu {name}")
        task.add_argument("file", type=Path, metavar="FILE.fmu", help="the FMU, or a Modelica file (.mo)")
        if name == "check":
            task.add_argument("--interface", choices=("co-simulation", "model-exchange"), help="how it is run")
            task.add_argument("--step", type=positive, metavar="SECONDS", help="communication step")
            task.add_argument(
                "--time-limit", type=positive, default=120.0, metavar="SECONDS", help="for all questions (120)"
            )


def _add_cache(commands: _Commands) -> None:
    five = commands.add_parser("cache", help="what is kept between runs: show it, clear it, clear one FMU")
    tasks = five.add_subparsers(required=True, metavar="show|clear")
    _verb(tasks, "show", _cache_show, inspect.getdoc(_cache_show) or "", "cache show")
    clear = _verb(tasks, "clear", _cache_clear, inspect.getdoc(_cache_clear) or "", "cache clear")
    clear.add_argument("file", type=Path, metavar="FILE.fmu", nargs="?", help="only what is kept of this FMU")


def _identify(options: argparse.Namespace) -> int:
    """Identify the parameters of a case, print the table, save result.json and report.html."""
    out = options.out or Path("results") / _stem(options.case)
    with Display(quiet=options.quiet or options.json) as display:
        display.say(f"Reading {options.case} and building its FMUs (the first time takes some seconds) ...")
        with loading():  # what takes a second to import comes after the first line
            from fmu_didim.case import load_case
            from fmu_didim.workflow.identify import identify
            from fmu_didim.workflow.output.result import (
                ESSENTIAL_ROBOT_FILE,
                OWN_ROBOT_FILE,
                ROBOT_FILE,
                result_folder,
            )
            from fmu_didim.workflow.output.values import SSV_FILE, VALUES_FILE

        result_folder(out).check()
        case = load_case(options.case)
        display.say(f"Identifying {case.name} ...")
        outcome = identify(
            case,
            out=out,
            figures=options.figures,
            profile=options.profile,
            essential=options.essential,
            progress=display.iteration,
            show=_summary_on(display, options),
        )
    if options.json:
        print(json_shown(outcome.document.model_dump_json(indent=1, by_alias=True)))
        return outcome.exit_code
    if outcome.robot is not None:
        robot = out / ROBOT_FILE
        print(f"\nThe robot with these values: {robot}   (its FMU: fmu-didim export {quoted(robot)})")
        for label in outcome.robots:
            print(f"  with those of {label}: {out / OWN_ROBOT_FILE.format(label=label)}")
        if outcome.essential_robot is not None:
            print(f"  without what is not needed: {out / ESSENTIAL_ROBOT_FILE}")
        if outcome.outside_robot:
            print(f"  not in it, because not of the robot: {', '.join(outcome.outside_robot)}")
    if outcome.document.outputs and outcome.parameters:
        print(f"\nThe values, to set in the FMU: {out / SSV_FILE}   as an entry of a case: {out / VALUES_FILE}")
    print(f"\nReport: {out / 'report.html'}   Result: {out / 'result.json'}   ({since_start():.1f} s)")
    return outcome.exit_code


def _check(options: argparse.Namespace) -> int:
    """Check plant, parameters, data and start of a case; the exit code is 1 where something must be fixed."""
    with loading():
        from fmu_didim.workflow.check import check
    from fmu_didim.workflow.output.result_folder import check_writable, write_whole
    from fmu_didim.workflow.reference.codes import codes_text

    if options.codes:
        print(codes_text(), end="")
        return 0
    if options.figure is not None:
        if options.sensitivity is None or options.figure.suffix not in (".svg", ".png", ".pdf"):
            raise InputError(
                "--figure draws what --sensitivity finds.", where="--figure", got=options.figure,
                valid="a file .svg, .png or .pdf, with --sensitivity",
                next_step="Add --sensitivity morris, or take it out.",
            )  # fmt: skip
        check_writable(options.figure.parent)
    if options.case is None:
        raise InputError("check needs a case.", next_step="fmu-didim check CASE.yaml, or fmu-didim check --codes.")
    with Display(quiet=options.json or not is_terminal(sys.stdout)) as display:
        display.say(f"Checking {options.case} ...")
        found = check(
            options.case, sensitivity=options.sensitivity, samples=options.samples, seed=options.seed, say=display.say
        )  # fmt: skip
    if options.figure is not None:
        write_whole(options.figure, partial(found.plot().savefig, format=options.figure.suffix[1:]))
    if options.json:
        print(json.dumps(found.saved(str(options.case)), indent=1))
    else:
        show(found.summary().rstrip("\n"))
    return 0 if found.ok else EXIT_ERROR


def _discover(options: argparse.Namespace) -> int:
    """Find where simulation and measurement disagree, name the missing effect, add it, show the gap shrink.

    The exit code is 0, 4 where the answer is doubtful, 3 where the time limit ended the search.
    """
    out = options.out or Path("results") / f"{_stem(options.case)}_discover"
    with Display(quiet=options.quiet or options.json) as display:
        display.say(f"reading {options.case}")
        with loading():
            from fmu_didim.workflow.discover import discover

        found = discover(
            options.case, out, forbid=options.forbid, prefer=options.prefer, effects=options.effect,
            rounds=options.rounds, seed=options.seed, time_limit=options.time_limit, progress=display.say,
            show=_summary_on(display, options), figures=options.figures,
        )  # fmt: skip
    if options.json:
        print(json_shown((out / "findings.json").read_text(encoding="utf-8")))
        return found.exit_code
    took = f"({since_start():.1f} s)"
    print(f"\nReport: {out / 'discovery.html'}   Findings: {out / 'findings.json'}   {took}")
    return found.exit_code


def _simulate(options: argparse.Namespace) -> int:
    """Simulate the closed loop of a case with the values of its robot description, or its model, write a CSV table."""
    from fmu_didim.data.signals import write_csv
    from fmu_didim.workflow.output.result_folder import check_writable, write_whole
    from fmu_didim.workflow.simulate import simulate

    out = options.out or Path("results") / f"{_stem(options.case)}.csv"
    check_writable(out.parent)
    table = simulate(options.case, parameters=_assignments(options.set), experiment=options.experiment)
    write_whole(out, partial(write_csv, table))
    print(f"{table.time.size} rows, columns t, {', '.join(table.names)}: {out}")
    return 0


def _excite(options: argparse.Namespace) -> int:
    return run_excite(options, _stem)


_excite.__doc__ = run_excite.__doc__


def _name_controller(options: argparse.Namespace) -> int:
    return run_name_controller(options, _stem)


_name_controller.__doc__ = run_name_controller.__doc__


def _export(options: argparse.Namespace) -> int:
    """Build the FMU of a robot or controller description; with --ssp write the loop of a case as an SSP archive, with
    --robot its robot."""
    from fmu_didim.workflow.export import export_fmu, export_ssp
    from fmu_didim.workflow.output.result_folder import check_writable, write_whole

    if options.ssp is not None:
        check_writable(options.ssp.parent)
        write_whole(options.ssp, partial(export_ssp, options.description, result=options.result))
        print(options.ssp)
        return 0
    if options.robot is not None:
        return _export_robot(options)
    for name in ("result", "draws"):
        if getattr(options, name) is not None:
            raise InputError(
                f"--{name} goes with --robot" + (" or --ssp." if name == "result" else "."),
                next_step="Give --robot FILE.urdf and a case.",
            )  # fmt: skip
    made = export_fmu(options.description, options.out, fmi_version=options.fmi, platforms=options.platform)
    print(made)
    return 0


def _export_robot(options: argparse.Namespace) -> int:
    """Write the robot of a case, and say what its reader must know."""
    from fmu_didim.report.terminal import wrapped
    from fmu_didim.workflow.export_robot import export_robot

    made = export_robot(
        options.description, options.robot, result=options.result, draws=options.draws or 0, seed=options.seed
    )
    files = f"{made.path}" + (f" and {made.draws[0].name} to {made.draws[-1].name}" if made.draws else "")
    print(files)
    for remark in made.remarks:
        print("\n".join(wrapped(remark, hanging="  ")))
    return 0


def _fmu_info(options: argparse.Namespace) -> int:
    """Describe an FMU: version, interfaces, platforms, variables with units and start values."""
    from fmu_didim.workflow.fmu import fmu_info

    print(fmu_info(options.file))
    return 0


def _fmu_check(options: argparse.Namespace) -> int:
    """Try out how an FMU behaves: reset, saved state, feed-through, parameters; and how to run it again."""
    from fmu_didim.workflow.fmu import fmu_check

    def say(question: str) -> None:
        print(f"  {question} ...", file=sys.stderr, flush=True)

    found = fmu_check(
        options.file, interface=options.interface, step_size=options.step, time_limit_s=options.time_limit, say=say
    )
    print("\n".join(found.lines()))
    return EXIT_ERROR if found.facts.failure else 0


def _cache_show(options: argparse.Namespace) -> int:
    """Show where compiled and extracted files are kept, and how much of each kind."""
    from fmu_didim.base.cache import KINDS, LIMIT, cache_directory, entries

    found = list(entries())
    print(f"{cache_directory()}   (FMU_DIDIM_CACHE names another folder; at most about {LIMIT / 2**30:.0f} GB)")
    for kind, what in KINDS.items():
        sizes = [entry.size for entry in found if entry.kind == kind]
        print(f"{kind:12} {len(sizes):6} {sum(sizes) / 2**20:10.1f} MB   {what}")
    print(f"{'total':12} {len(found):6} {sum(entry.size for entry in found) / 2**20:10.1f} MB")
    return 0


def _check_fmu(file: Path) -> None:
    """Raise InputError where a file is not there, or no FMU."""
    from zipfile import is_zipfile

    if not is_file(file):
        raise InputError("The FMU does not exist.", where=str(file), next_step="Check the path.")
    if not is_zipfile(file):
        raise InputError(
            "Only what is kept of an FMU can be cleared by a file, and this is none.", where=str(file),
            valid="an FMU, or no file: then all is removed",
            next_step="Name the FMU that the case uses, or run fmu-didim cache clear.",
        )  # fmt: skip


def _cache_clear(options: argparse.Namespace) -> int:
    """Remove what is kept between runs, of one FMU or all; it is made anew when it is needed."""
    from fmu_didim.base.cache import clear, entries, file_digest

    if options.file is not None:
        _check_fmu(options.file)
    removed, kept = clear(list(entries(file_digest(options.file) if options.file is not None else "")))
    print(f"{len(removed)} entries removed, {sum(entry.size for entry in removed) / 2**20:.1f} MB")
    for why, found in kept.items():
        print(f"{len(found)} entries kept ({why}), such as {found[0].path}")
    return EXIT_ERROR if kept else 0


def _assignments(texts: list[str]) -> dict[str, float]:
    values = {}
    for text in texts:
        name, separator, number = text.partition("=")
        try:
            values[name.strip()] = float(number)
        except ValueError:
            separator = ""
        if not separator:
            raise InputError(
                "This is not an assignment.", where="--set", got=text, valid="NAME=VALUE, such as Fc1=0.8",
                next_step="Write name and value with = between them and no spaces.",
            )  # fmt: skip
    return values


def _stem(case: Path) -> str:
    """A folder name that tells cases of one folder apart: ``scara-identify``."""
    return f"{case.resolve().parent.name}-{case.stem}"


def _summary_on(display: Display, options: argparse.Namespace) -> Callable[[Result | Discovered], None]:
    """A function that shows the table before anything is written: even if the disk is full."""

    def shown(found: Result | Discovered) -> None:
        display.close()
        if not options.json:
            show(f"\n{found.summary()}")

    return shown


if __name__ == "__main__":
    sys.exit(main())
