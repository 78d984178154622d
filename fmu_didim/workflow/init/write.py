"""Writing the files of ``init``."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fmu_didim.base.documents import TO_FILL_IN, Lines
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.controllers import LAWS
from fmu_didim.data.units import known_unit
from fmu_didim.workflow.init.data_file import TORQUES, DataFile
from fmu_didim.workflow.init.fmu_roles import FmuRole, mappings
from fmu_didim.workflow.init.inventory import Inventory, inventory, key_of
from fmu_didim.workflow.init.loop_time import LoopTime, begins_moving, control_rate_hz, loop_time
from fmu_didim.workflow.init.model_case import model_case
from fmu_didim.workflow.init.roles import Guess, Role, Side, chosen
from fmu_didim.workflow.init.runs import FilesOfRun, runs
from fmu_didim.workflow.init.texts import CASE_FILE, named_from, rendered, time_entry
from fmu_didim.workflow.reference.schema import schema

ROBOT_FILE, CONTROLLER_FILE, SCHEMA_FOLDER = "robot.yaml", "controller.yaml", "schemas"
SCHEMAS_WRITTEN = ("case", "robot", "controller")
_TORQUE_NOTES = {
    "rated": "rated: what 100 % is, in N.m (N; A of a current)",
    "torque_constant": "torque_constant: N.m/A, of the same kind of ampere",
    "gear_ratio": "gear_ratio: turns of the motor in one of a joint; 1 if this is the joint's torque",
}
_BY_ORDER = "nothing but the order of the files says that this reference belongs to this log: check it"
EFFECTS = "[motor_inertia, viscous, coulomb, torque_offset]"


@dataclass(frozen=True)
class Started:
    """The files that ``init`` wrote.

    Attributes:
        files: the files; found: (file, column, what it was taken for), one for each column used.
        to_fill_in: file -> (place, note) of what only the user knows.
    """

    files: tuple[Path, ...]
    found: tuple[tuple[str, str, str], ...]
    to_fill_in: dict[Path, list[tuple[str, str]]]


def start_case(
    files: Sequence[Path | str],
    out: Path | str = ".",
    *,
    law: str | None = None,
    plant: Path | str | None = None,
    controller: Path | str | None = None,
    model: Path | str | None = None,
) -> Started:
    """Write a case for these files: of a model alone, or of a robot, commented, with a robot description and a
    controller where none is among them.

    ``EDIT`` marks what the files do not say; nothing runs before each of these is filled in.

    Args:
        out: folder of the case; law: control law of the controller that is written, with its keys.
        plant, controller, model: FMU or Modelica file that is one, where its signals do not tell; among the files or
            not. A model is calibrated as it is, with neither robot nor controller.

    Raises:
        InputError: a file cannot be used, or one that would be written is there already.
        BuildError: a Modelica file cannot be compiled.
    """
    if law is not None and law not in LAWS:
        raise UnknownNameError("control law", law, LAWS, where="--law")
    said = _said(plant, controller, model, law)
    named = [*files, *(file for file in (plant, controller, model) if file is not None)]
    given = {Path(file).resolve(): Path(file) for file in named}
    own = None if model is None else Path(model).resolve()
    out, found = Path(out), inventory(list(given.values()), said, has_law=law is not None, model=own)
    if found.model is not None:
        return _started(out, *model_case(found, out), kinds=("case",))
    entries = _entries(found, out)
    follows = law is None and found.has_no_controller and found.plant_fmu is None and all(map(_is_followed, entries))
    texts = {CASE_FILE: _case(found, out, entries, follows=follows)}
    if found.robot is None and found.system is None and found.plant_fmu is None:
        texts[ROBOT_FILE] = rendered("robot.yaml.j2", joints=_joint_types(found), effects=EFFECTS, edit=TO_FILL_IN)
    if found.has_no_controller and not follows:
        texts[CONTROLLER_FILE] = _controller(found, law)
    return _started(out, texts, list(_guessed(found)))


def _started(
    out: Path, texts: Mapping[str, str], told: Sequence[tuple[str, str, str]], *, kinds: Sequence[str] = SCHEMAS_WRITTEN
) -> Started:
    """Write the files, and the schemas of these kinds; raises InputError where one is there already."""
    there = [str(out / name) for name in texts if (out / name).exists()]
    if there:
        raise InputError(
            "A file is there already; init replaces none.", where=there[0], next_step="Give another folder: --out DIR."
        )
    (out / SCHEMA_FOLDER).mkdir(parents=True, exist_ok=True)
    for kind in kinds:
        (out / SCHEMA_FOLDER / f"{kind}.json").write_text(json.dumps(schema(kind), indent=1) + "\n", encoding="utf-8")
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")
    written = tuple(out / name for name in texts)
    return Started(written, tuple(told), {path: Lines(path).unfilled() for path in written})


def _said(
    plant: Path | str | None, controller: Path | str | None, model: Path | str | None, law: str | None
) -> dict[Path, FmuRole]:
    """The roles in a loop that the user states; raises InputError for a file that would have both, or a model beside
    a loop."""
    if model is not None and (plant is not None or controller is not None or law is not None):
        raise InputError(
            "A model that is calibrated as it is has no plant and no controller beside it.", where="--model",
            got=str(model), next_step="Leave out --plant, --controller and --law, or --model.",
        )  # fmt: skip
    said: dict[Path, FmuRole] = {}
    roles = (("plant", plant), ("controller", controller), ("model", model))
    for role, file in roles:
        if file is None:
            continue
        if Path(file).suffix.lower() not in (".fmu", ".mo"):
            raise InputError(
                "Only an FMU or a Modelica file can be given a role.", where=f"--{role}", got=str(file),
                valid=(".fmu", ".mo"), next_step="Give any other file without the option.",
            )  # fmt: skip
        if Path(file).resolve() in said:
            raise InputError(
                "One FMU cannot be the plant and the controller.", where=f"--{role}", got=str(file),
                next_step="Give the other one its own file.",
            )  # fmt: skip
        if role != "model":
            said[Path(file).resolve()] = role  # type: ignore[assignment]
    return said


def _entries(found: Inventory, out: Path) -> list[dict[str, Any]]:
    """What is said of each run."""
    joints = found.joint_count
    return [
        {"label": run.label, "held_out": run.held_out, "file": run.torque.path.stem,
         **_experiment(found, run, joints, out)}
        for run in runs(found)
    ]  # fmt: skip


def _is_followed(entry: Mapping[str, Any]) -> bool:
    """Whether no position of a run is a set point, and all were measured."""
    columns = entry["reference"]["columns"]
    return entry["positions"] is not None and all(columns[name] == TO_FILL_IN for name in columns if name[0] == "q")


def _case(found: Inventory, out: Path, entries: list[dict[str, Any]], *, follows: bool) -> str:
    """The case; ``follows``: with a virtual controller that follows measured positions."""
    joints = found.joint_count
    short = len(entries) <= 2 and sum(not entry["held_out"] for entry in entries) == 1
    for entry in entries:
        entry["label"] = ("validation" if entry["held_out"] else "train") if short else entry["label"]
        alike = TO_FILL_IN in str(entry["torque"]) and entry["torque"]["columns"] == entries[0]["torque"]["columns"]
        entry["columns_again"] = alike and entry is not entries[0]
        entries[0]["columns_named"] |= entry["columns_again"]
    if any(entry["temperature"] is None for entry in entries):  # all runs state it, or none
        for entry in entries:
            entry["temperature"] = None
    command = any("quantity" in entry["torque"] for entry in entries)
    plant, controller = found.plant_fmu, found.controller_fmu
    own = controller.source if controller else found.controller
    ports = {
        f"{fmu.source.name} {kind}": [g.name for g in side]
        for fmu in found.fmus for kind, side in (("inputs", fmu.inputs), ("outputs", fmu.outputs))
    }  # fmt: skip
    tunable = [v for v in plant.fmu.variables if v.causality == "parameter"] if plant else []
    return rendered(
        "case.yaml.j2", entries=entries, short=short, joints=joints, edit=TO_FILL_IN, command=command,
        name=entries[0]["file"], robot=named_from(out, found.robot[0]) if found.robot else ROBOT_FILE,
        has_robot=found.robot is not None or plant is None, system=found.system and named_from(out, found.system),
        plant=plant and named_from(out, plant.source), plant_ports=plant and mappings(plant, "plant", joints),
        controller=named_from(out, own) if own else CONTROLLER_FILE,
        controller_ports=controller and mappings(controller, "controller", joints), ports=ports,
        rate=_control_rate(found), follows=follows,
        tracks=own is None and not follows and all(entry["positions"] for entry in entries),
        tunable=[v for v in tunable if v.start is not None][:30],
    )  # fmt: skip


def _experiment(found: Inventory, run: FilesOfRun, joints: int, out: Path) -> dict[str, Any]:
    torque, comment = _torque_columns(run.torque, joints)
    motion, notes = _motion_columns(run.reference, joints, torque)
    reference = {"file": named_from(out, run.reference.path), **time_entry(run.reference, "q")}
    log = {"file": named_from(out, run.torque.path), **time_entry(run.torque, *TORQUES), "columns": torque}
    used = {entry["name"] if isinstance(entry, dict) else entry for entry in torque.values()}
    if any(g.role == "command" and g.name in used for g in run.torque.guesses):
        log["quantity"] = "command"
    at = loop_time(found, run)
    named = [entry["name"] if isinstance(entry, dict) else entry for name, entry in motion.items() if name[0] == "q"]
    return {
        "instants": at and _instants(at, out), "instants_note": at and at.reason,
        "has_instants": bool(at and at.is_certain),
        "moves": begins_moving(run.reference, named),
        "reference": {**reference, "columns": motion}, "torque": log, "torque_note": comment,
        "reference_notes": [*([_BY_ORDER] if run.is_guess else []), *([notes] if notes else [])],
        "asked": _asked(run, joints), "columns_named": False, "positions": _positions(run, joints, out),
        "positions_note": _why_measured(run), "temperature": _temperature(found, run, joints, out),
        "reference_columns": ", ".join(run.reference.table.columns),
        "torque_columns": ", ".join(run.torque.table.columns),
    }  # fmt: skip


def _instants(at: LoopTime, out: Path) -> Any:
    """The entry of the instants of a controller: the file, with the column where it is not its time column."""
    file = named_from(out, at.data.path)
    if at.column is None:
        return file if at.data.clock() else {"file": file, "time": {"name": TO_FILL_IN, "unit": "s"}}
    unit = at.data.table.unit(at.column)
    return {"file": file, "time": {"name": at.column, **({"unit": unit} if unit else {})}}


def _motion_columns(data: DataFile, joints: int, torque: dict[str, Any]) -> tuple[dict[str, Any], str]:
    columns: dict[str, Any] = {}
    sides: set[Side] = set()
    for j in range(1, joints + 1):
        meant = chosen(data.guesses, ["q"], j, single=joints == 1, prefer="reference")
        columns[f"q{j}"] = _entry(meant)
        sides |= {g.side for g in meant[:1]}
    for signal in ("dq", "ddq"):
        each = [chosen(data.guesses, [signal], j, single=joints == 1, prefer="reference") for j in range(1, joints + 1)]  # type: ignore[list-item]
        if all(len(meant) == 1 and meant[0].side in sides for meant in each):
            columns |= {f"{signal}{j}": _entry(meant) for j, meant in enumerate(each, start=1)}
    unsure = "the names do not say whether these are set points or measured positions: they must be the set points"
    return columns, "" if sides == {"reference"} else unsure


def _positions(run: FilesOfRun, joints: int, out: Path) -> dict[str, Any] | None:
    """The entry of positions whose names say that they were measured, of all joints in one file; None without."""
    for data in (run.torque, run.reference):
        each = [chosen(data.guesses, ["q"], j, single=joints == 1, prefer="measured") for j in range(1, joints + 1)]
        if all(len(meant) == 1 and meant[0].side == "measured" for meant in each):
            return _in_one_line(data, out, "q", {f"q{j}": _entry(meant) for j, meant in enumerate(each, start=1)})
    return None


def _in_one_line(data: DataFile, out: Path, role: Role, columns: Mapping[str, Any]) -> dict[str, Any]:
    """The entry of a file where it stands in one line, with no place for a note."""
    entry = {"file": named_from(out, data.path), **time_entry(data, role), "columns": columns}
    entry.pop("time_note", None)
    return entry


def _temperature(found: Inventory, run: FilesOfRun, joints: int, out: Path) -> dict[str, Any] | None:
    """The entry of the temperatures of a run, of each joint or one for all; None where the files do not say which."""
    own = [data for data in found.data if data.is_temperature_log]
    own = [data for data in own if key_of(data.path) == run.label] or (own if len(own) == 1 else [])
    for data in (run.torque, run.reference, *own):
        each = [
            chosen(data.guesses, ["temperature"], j, single=joints == 1, prefer="measured")
            for j in range(1, joints + 1)
        ]
        names = {f"temperature{j}": _entry(meant) for j, meant in enumerate(each, start=1)}
        of_all = [g for g in data.guesses if g.role == "temperature"]
        if len(of_all) == 1 and of_all[0].joint is None:
            names = {"temperature": _entry(of_all)}
        elif any(len(meant) != 1 for meant in each):
            continue
        return _in_one_line(data, out, "temperature", names)
    return None


def _why_measured(run: FilesOfRun) -> str:
    """What says that positions were measured where their names do not."""
    found = [f"{g.name}: {g.why}" for g in run.reference.guesses if g.why]
    return f"; no name says so, but values do ({found[0]}): set points would go to reference:" if found else ""


def _torque_columns(data: DataFile, joints: int) -> tuple[dict[str, Any], str]:
    columns, note = {}, ""
    for j in range(1, joints + 1):
        meant = chosen(data.guesses, TORQUES, j, single=joints == 1, prefer="measured")
        columns[f"tau{j}"] = _entry(meant)
        if len(meant) != 1 or meant[0].role == "command":
            continue
        is_current, unit = meant[0].role == "current", meant[0].unit
        known = known_unit(unit) if unit else None
        in_parts = known is not None and not known.powers
        further = {
            **({"rated": TO_FILL_IN} if in_parts else {}), **({"torque_constant": TO_FILL_IN} if is_current else {}),
        }  # fmt: skip
        if further:
            known_as = {"name": meant[0].name, "unit": unit or "A"}
            columns[f"tau{j}"] = {**known_as, **further, "gear_ratio": TO_FILL_IN}
            note = "; ".join(_TORQUE_NOTES[key] for key in (*further, "gear_ratio"))
    return columns, note


def _asked(run: FilesOfRun, joints: int) -> dict[str, str]:
    """What is asked of each signal whose column is to be filled in."""
    asked: dict[str, str] = {}
    for j in range(1, joints + 1):
        signals: tuple[tuple[str, DataFile, Sequence[Role], Side], ...] = (
            ("q", run.reference, ["q"], "reference"), ("tau", run.torque, TORQUES, "measured"),
        )  # fmt: skip
        for signal, data, roles, side in signals:
            names = [g.name for g in chosen(data.guesses, roles, j, single=joints == 1, prefer=side)]
            asked[f"{signal}{j}"] = f"which of {', '.join(names)}" if names else "which of the columns"
    return asked


def _entry(meant: list[Guess]) -> Any:
    """A column of the case: its name, with its unit where that is not SI."""
    if len(meant) != 1:
        return TO_FILL_IN
    name, unit = meant[0].name, meant[0].unit
    known = known_unit(unit) if unit else None
    return name if known is None or (known.factor == 1 and unit != "1") else {"name": name, "unit": unit}


def _joint_types(found: Inventory) -> list[tuple[str, str]]:
    """Type of each joint, and why."""
    made = []
    for j in range(1, found.joint_count + 1):
        own = [g for d in found.data for g in d.guesses if g.joint in (j, None) and g.role in ("q", "tau")]
        units = [g.unit for g in own if g.unit]
        powers = [known.powers for unit in units if (known := known_unit(unit)) is not None]
        slides = {"m": 1} in powers or {"kg": 1, "m": 1, "s": -2} in powers
        turns = {"rad": 1} in powers or {"kg": 1, "m": 2, "s": -2} in powers
        kind = "prismatic" if slides and not turns else "revolute" if turns and not slides else TO_FILL_IN
        made.append((kind, f"by its unit {units[0]}" if kind != TO_FILL_IN else "revolute or prismatic"))
    return made


def _controller(found: Inventory, law: str | None) -> str:
    kinds = [j.type for j in found.robot[1].joints] if found.robot else [kind for kind, _ in _joint_types(found)]
    common = set(LAWS["pd"].model_fields) - {"Kp", "Kd", "velocity"}
    keys = {name: {k: f for k, f in form.model_fields.items() if k not in common} for name, form in LAWS.items()}
    return rendered(
        "controller.yaml.j2", law=law, laws=LAWS, keys=keys, kinds=kinds, edit=TO_FILL_IN,
        rate=_control_rate(found), summary={n: (f.__doc__ or "").split("\n\n")[0] for n, f in LAWS.items()},
    )  # fmt: skip


def _control_rate(found: Inventory) -> float | None:
    """Rate of the rows of the first reference."""
    return next((control_rate_hz(run.reference) for run in runs(found)), None)


def _guessed(found: Inventory) -> Iterator[tuple[str, str, str]]:
    for role, (ports, reason) in found.taken.items():
        yield ports.source.name, "", f"the {role}, {reason}"
    words = {"q": "position", "dq": "velocity", "ddq": "acceleration", "tau": "torque", "other": "not used"}
    for data in found.data:
        for clock in dict.fromkeys(data.table.times.values()) or [data.clock()]:
            rate = data.rate_hz() if clock and not data.table.times else None
            if clock:
                unit = f" in {known}, by its velocities" if (known := data.time_unit(clock)) else ""
                yield data.path.name, clock, f"time{unit}{f', {rate:g} Hz' if rate else ''}"
        for g in data.guesses:
            joint = f" of joint {g.joint}" if g.joint is not None and g.role != "other" else ""
            side = f" ({g.side}{': ' if g.why else ''}{g.why})" if g.side else ""
            yield data.path.name, g.name, f"{words.get(g.role, g.role)}{joint}{side}"
        if data.is_loop_log:
            yield data.path.name, "", "instants of the controller"
        for note in data.table.notes:
            yield data.path.name, "", note
    for run in runs(found):
        if run.reference is not run.torque:
            told = f"{'held out' if run.held_out else 'a run'}, with the reference {run.reference.path.name}"
            yield run.torque.path.name, "", f"{told}: {run.reason}"
