"""The command line of the verbs that come before a case runs: example, init, validate, robot, schema, effects,
completion."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TypeAlias

from fmu_didim.base.errors import InputError
from fmu_didim.base.terminal import json_shown, quoted
from fmu_didim.cli.examples import example_names, examples, write_example

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
SHELLS = ("bash", "zsh", "tcsh")
KINDS = ("case", "robot", "controller", "effect", "campaign")
_EXAMPLE = """examples:
  fmu-didim example                               which there are
  fmu-didim example scara                         written to the folder scara
  fmu-didim example arm2r my/arm"""
_INIT = """examples:
  fmu-didim init house.fmu weather.csv room.csv   a model, what drove it, and what was measured
  fmu-didim init log.csv                          reference and torque in one file
  fmu-didim init ref.csv torque.csv ref_test.csv torque_test.csv --out mycase
  fmu-didim init log.mf4 vendor_controller.fmu robot.yaml
  fmu-didim init log.csv --controller pid.fmu     where its signals do not tell what it is
  fmu-didim init log.mat --law cascade_ppi        with the keys of that controller"""
_VALIDATE = """examples:
  fmu-didim validate case.yaml
  fmu-didim validate case.yaml --json"""
_SCHEMA = """examples:
  fmu-didim schema case > case.schema.json
in an editor, as the first line of a file:
  # yaml-language-server: $schema=case.schema.json"""
_EFFECTS = """examples:
  fmu-didim effects                               all of them
  fmu-didim effects stribeck                      equation, signature, parameters, plot
  fmu-didim effects my_module:Grease              one of your own
  fmu-didim effects stribeck --json"""
_ROBOT = """examples:
  fmu-didim robot robot.yaml                      frames, masses, base parameters
  fmu-didim robot ur10e.urdf --out robot.yaml     a URDF, as a description to which effects can be added
  fmu-didim robot ur10e.urdf --page ur10e.html    the robot drawn: turn it, move its joints, see its masses
  fmu-didim robot panda.urdf --tip panda_link8    an arm whose gripper does not move"""
_COMPLETION = """examples:
  eval "$(fmu-didim completion bash)"             in this shell; in ~/.bashrc for all
  fmu-didim completion zsh > ~/.zfunc/_fmu-didim"""


def add_prepare_verbs(commands: Commands, *, parser: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    """Add these verbs; returns them.

    Args:
        parser: of all verbs, whose options are completed.
    """
    example, init = _add_example(commands), _add_init(commands)
    validate = _verb(
        commands, "validate", "find all mistakes in a case and in the files that it names, at once", _VALIDATE
    )
    validate.add_argument("case", type=Path, metavar="CASE.yaml", help="the case file")
    validate.add_argument("--json", action="store_true", help="print them as JSON")
    validate.set_defaults(run=_validate)
    effects = _verb(commands, "effects", "list the physical effects, or explain one", _EFFECTS)
    effects.add_argument("name", nargs="?", metavar="NAME", help="an effect, or my.py:Name of one of your own")
    effects.add_argument("--json", action="store_true", help="print the entry, or all of them, as JSON")
    effects.set_defaults(run=_effects)
    help_ = "print the JSON Schema of a case, robot, controller or campaign file, or of an effect"
    schema = _verb(commands, "schema", help_, _SCHEMA)
    schema.add_argument("kind", choices=KINDS, help=", ".join(KINDS))
    schema.set_defaults(run=_schema)
    robot = _verb(
        commands, "robot", "show what a robot description, a URDF or an MJCF file says, and write it as YAML", _ROBOT
    )
    robot.add_argument("file", type=Path, metavar="FILE", help="robot description, .yaml, .urdf or .xml (MJCF)")
    robot.add_argument(
        "--tip", default="", metavar="LINK", help="the link of a URDF or MJCF file at which the robot ends"
    )
    robot.add_argument("--out", type=Path, metavar="FILE.yaml", help="write the description there")
    robot.add_argument("--page", type=Path, metavar="FILE.html", help="write a page with the robot drawn there")
    robot.set_defaults(run=_robot)
    shell = _verb(commands, "completion", "print the completion of commands and options for a shell", _COMPLETION)
    shell.add_argument("shell", choices=SHELLS, help=", ".join(SHELLS))
    shell.set_defaults(run=_completion, parser=parser)
    return [example, init, validate, effects, schema, robot, shell]


def _verb(commands: Commands, name: str, help_: str, examples: str) -> argparse.ArgumentParser:
    return commands.add_parser(
        name, help=help_, description=f"{help_[0].upper()}{help_[1:]}.", epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip


def _add_example(commands: Commands) -> argparse.ArgumentParser:
    verb = _verb(commands, "example", "list the examples that ship with the package, or write one out", _EXAMPLE)
    names = example_names()
    verb.add_argument(
        "name", nargs="?", choices=names or None, metavar="NAME", help=f"which one to write: {', '.join(names)}"
    )
    verb.add_argument(
        "folder", nargs="?", type=Path, metavar="FOLDER", help="where to, a new or empty folder (NAME in this one)"
    )
    verb.set_defaults(run=_example)
    return verb


def _add_init(commands: Commands) -> argparse.ArgumentParser:
    verb = _verb(
        commands,
        "init",
        "write a case for the files that you have: of a model, or of a robot with its controller",
        _INIT,
    )
    verb.add_argument(
        "files", type=Path, nargs="*", metavar="FILE", help="logs, FMUs, .mo files, robot and controller descriptions"
    )
    verb.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="folder of the case (this folder)")
    verb.add_argument(
        "--law", metavar="NAME", help="control law of the controller that is written: pd, pid, cascade_ppi ..."
    )
    verb.add_argument("--plant", type=Path, metavar="FILE", help="the FMU or .mo file that is the plant")
    verb.add_argument("--controller", type=Path, metavar="FILE", help="the FMU or .mo file that is the controller")
    help_ = "the FMU or .mo file that is calibrated as it is, with neither robot nor controller"
    verb.add_argument("--model", type=Path, metavar="FILE", help=help_)
    verb.set_defaults(run=_init)
    return verb


def _example(options: argparse.Namespace) -> int:
    from fmu_didim.report.terminal import entries, wrapped

    if options.name is None:
        print("fmu-didim example NAME writes one of these to a folder, ready to run:\n")
        print("\n".join(entries([(e.name, f"{e.sentence}.{_needed(e.needs)}") for e in examples().values()], "  ")))
        return 0
    written = write_example(options.name, options.folder or Path(options.name))
    example = written.example
    print(f"{len(written.files)} files written to {written.folder}")
    print("\n".join(wrapped(f"{example.sentence}.{_needed(example.needs)}")))
    print("\nNext:")
    if written.folder.resolve() != Path.cwd():
        print(f"  cd {quoted(written.folder)}")
    for run in example.runs:
        print(f"  {run.command}")
        print("\n".join(wrapped(f"{run.shows}{f'; needs {run.needs}' if run.needs else ''}", "      ")))
    return 0


def _needed(what: str) -> str:
    return f" Needs {what}." if what else ""


def _init(options: argparse.Namespace) -> int:
    if not options.files and options.model is None:
        raise InputError(
            "init needs the files that you have.", valid="logs, FMUs, robot and controller descriptions",
            next_step="fmu-didim init LOG.csv; without files of your own: fmu-didim example.",
        )  # fmt: skip
    from fmu_didim.report.terminal import wrapped
    from fmu_didim.workflow.init import start_case

    made = start_case(
        options.files, options.out, law=options.law, plant=options.plant, controller=options.controller,
        model=options.model,
    )  # fmt: skip
    width = max((len(f"{file}: {column}") for file, column, _ in made.found), default=0)
    print("Found, by names and units (correct it in the case where it is wrong):")
    for file, column, taken in made.found:
        place = f"{file}: {column}" if column else file
        print(f"  {place:{min(width, 50)}}  {taken}")
    for path in made.files:
        open_ = made.to_fill_in[path]
        print(f"\n{path}: {f'{len(open_)} places to be filled in' if open_ else 'nothing to be filled in'}")
        for place, note in open_:
            print("\n".join(wrapped(f"{place}{note}", "  ", "    ")))
    print(f"\nThen: fmu-didim validate {quoted(made.files[0])}")
    return 0


def _validate(options: argparse.Namespace) -> int:
    from fmu_didim.workflow.validate import mistakes

    found = mistakes(options.case)
    if options.json:
        print(json.dumps([{"where": m.where, "text": m.text} for m in found], indent=1))
    else:
        for mistake in found:
            print(f"{mistake.text}\n")
        count = len(found)
        told = f"{count} of the files or entries have mistakes" if count > 1 else "one file or entry has mistakes"
        print(told if found else f"No mistakes. Next: fmu-didim check {quoted(options.case)}")
    return 1 if found else 0


def _effects(options: argparse.Namespace) -> int:
    from fmu_didim.workflow.reference.effects import effect_entries, effect_entry, effect_text, effects_text

    if options.json:
        entries = [effect_entry(options.name)] if options.name else effect_entries()
        shown = [entry.model_dump(mode="json") for entry in entries]
        print(json_shown(json.dumps(shown[0] if options.name else shown, indent=1, ensure_ascii=False)))
    else:
        print(effect_text(options.name) if options.name else effects_text(), end="")
    return 0


def _schema(options: argparse.Namespace) -> int:
    from fmu_didim.campaigns.planning.document import CampaignDocument
    from fmu_didim.workflow.reference.schema import DIALECT, schema

    is_campaign = options.kind == "campaign"
    made = {"$schema": DIALECT, **CampaignDocument.model_json_schema()} if is_campaign else schema(options.kind)
    print(json_shown(json.dumps(made, indent=1, ensure_ascii=False)))
    return 0


def _robot(options: argparse.Namespace) -> int:
    from fmu_didim import read_robot
    from fmu_didim.workflow.robot_file import robot_lines, write_as_yaml, write_picture

    robot = read_robot(options.file, tip=options.tip)
    print("\n".join(robot_lines(robot)))
    if options.out is not None:
        write_as_yaml(robot, options.out)
        print(f"\nWritten: {options.out}")
    if options.page is not None:
        print(f"\nPage: {write_picture(robot, options.page)}")
    return 0


def _completion(options: argparse.Namespace) -> int:
    try:
        import shtab
    except ImportError as error:
        raise InputError("Shell completion needs shtab.", next_step="pip install shtab") from error
    print(shtab.complete(options.parser, shell=options.shell))
    return 0
