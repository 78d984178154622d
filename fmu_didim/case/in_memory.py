"""Objects in a case, where a case file names other files: arrays, robots and components.

The document of a case holds names only, so that it can be saved and compared. An object stands in it under a name in
angle brackets, ``<log of estimation>``, and is kept beside the document in :class:`Memory`.
"""

from __future__ import annotations

import inspect
import json
import marshal
import pickle
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.documents import validate
from fmu_didim.base.errors import InputError
from fmu_didim.base.imports import is_reference
from fmu_didim.case.arrays import Inputs, Log, Measured, Reference
from fmu_didim.components import Component, is_control
from fmu_didim.data.excitation import Excitation
from fmu_didim.data.signals import Trajectory
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.robot import RobotDescription, RobotModel

OF_THE_FILE = ("columns", "time", "csv", "obtain")
"""Entries of a data file that say how it is written; they do not hold for arrays in its place."""
RUNS = ("train", "validation")
_ADDRESS = re.compile(" at 0x[0-9a-fA-F]+")
"""In the ``repr`` of an object: another one in each session."""


def is_in_memory(name: str) -> bool:
    """Whether a name of a document stands for an object."""
    return re.fullmatch(r"<[^<>]+>", name) is not None


def check_at_hand(name: str) -> None:
    """Raise InputError where a name of a document that was saved stands for an object, which is not there any more."""
    if is_in_memory(name):
        raise InputError(
            "The case names an object that was in memory when it was saved.", where="case", got=name,
            next_step="Give it again, as in identify(case, controller=...), or name a file in its place.",
        )  # fmt: skip


@dataclass(frozen=True)
class Memory:
    """The objects of a case, by the names that its document has for them.

    Attributes:
        signals: in place of data files; objects: robot descriptions, components, python-control systems, control laws.
        widths: number of joints of the logs and references that were given as arrays.
    """

    signals: Mapping[str, Trajectory] = field(default_factory=dict)
    objects: Mapping[str, Any] = field(default_factory=dict)
    widths: Mapping[str, int] = field(default_factory=dict)

    def __or__(self, other: Memory) -> Memory:
        """Both; what the other one has counts."""
        return Memory(
            {**self.signals, **other.signals}, {**self.objects, **other.objects}, {**self.widths, **other.widths}
        )

    def of(self, names: Sequence[str]) -> Memory:
        """The objects under these names; signals of files stay."""
        return Memory(
            {name: s for name, s in self.signals.items() if name in names or not is_in_memory(name)},
            {name: o for name, o in self.objects.items() if name in names},
            {name: width for name, width in self.widths.items() if name in names},
        )

    def check_joints(self, count: int) -> None:
        """Raise InputError where arrays have another number of columns than the plant has joints."""
        for name, width in self.widths.items():
            if width != count:
                raise InputError(
                    "The arrays have another number of columns than the plant has joints.", where=name,
                    got=f"{width} columns", valid=f"{count} columns, one a joint from the base to the tip",
                    next_step="Give the columns of all joints and no others; transpose it if its rows are the joints.",
                )  # fmt: skip

    def digests(self) -> dict[str, str]:
        """SHA-256 of each, for the provenance."""
        found = {name: signals.digest() for name, signals in self.signals.items()}
        return found | {name: digest(value) for name, value in self.objects.items()}


@dataclass(frozen=True)
class _Named:
    """Collects the objects of a content on the way through it."""

    folder: Path
    signals: dict[str, Trajectory] = field(default_factory=dict)
    objects: dict[str, Any] = field(default_factory=dict)
    widths: dict[str, int] = field(default_factory=dict)

    def content(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """A content with names in the place of objects; what is no object stays as it is."""
        found = dict(given)
        for key, value in given.items():
            if key == "robot":
                found[key] = self._robot(value)
            elif key in ("plant", "controller", "model"):
                found[key] = self._part(value, key)
            elif key in ("inputs", "measured"):
                found[key] = self._recorded(value, f"{key} of estimation", Inputs if key == "inputs" else Measured)
            elif key == "components" and isinstance(value, Mapping):
                found[key] = {name: self._part(part, name) for name, part in value.items()}
            elif key in RUNS:
                found[key] = self._run(value, "estimation" if key == "train" else key)
            elif key == "experiments" and isinstance(value, Mapping):
                found[key] = {label: self._run(run, label) for label, run in value.items()}
        return found

    def _robot(self, value: Any) -> Any:
        if isinstance(value, Path):
            return str(value)
        if isinstance(value, Mapping):
            value = validate(RobotDescription, dict(value), where="robot", folder=self.folder)
        if isinstance(value, RobotModel):
            value = value.description
        if not isinstance(value, RobotDescription):
            return value
        self.objects["<robot>"] = value
        return "<robot>"

    def _part(self, value: Any, name: str) -> Any:
        """The entry of a component, which may be the object alone or a mapping with it as ``source``."""
        if isinstance(value, str | Path):
            return Whole({"source": str(value)} | ({"kind": "control"} if is_reference(str(value)) else {}))
        rest = dict(value) if isinstance(value, Mapping) else {}
        source = rest.pop("source", None) if isinstance(value, Mapping) else value
        if source is None or (isinstance(value, Mapping) and isinstance(source, str)):
            return value
        if not (isinstance(source, Component | Block) or callable(source) or is_control(source)):
            raise InputError(
                "This is nothing that runs in the loop.", where=name, got=type(source).__name__,
                valid="a path, a component (load_fmu), a python-control system, a block (read_controller), a function",
                next_step="Give the path of an FMU or a .mo file." if name == "model" else
                "A control law is a function of q_ref, dq_ref, q, dq that returns the (n,) commands.",
            )  # fmt: skip
        self.objects[f"<{name}>"] = source
        return Whole({"kind": "control", **rest, "source": f"<{name}>"})

    def _run(self, value: Any, label: str) -> Any:
        if isinstance(value, tuple | list):
            value = pair(value, label)
        if not isinstance(value, Mapping):
            return value
        found = dict(value)
        for key, kinds in (("reference", Reference), ("torque", Log), ("positions", Reference)):
            if key in found:
                found[key] = self._signals(found[key], f"{key} of {label}", kinds)
        for key, kind in (("inputs", Inputs), ("measured", Measured)):
            if key in found:
                found[key] = self._recorded(found[key], f"{key} of {label}", kind)
        if "instants" in found:
            found["instants"] = self._instants(found["instants"], f"instants of {label}")
        return found

    def _recorded(self, value: Any, what: str, kind: type[Inputs] | type[Measured]) -> Any:
        """The entry of inputs or of what was measured of a model: the object alone, a mapping with it as ``file``, or a
        list of them."""
        if isinstance(value, list | tuple):
            parts = [self._recorded(each, f"{what}, {i}", kind) for i, each in enumerate(value, 1)]
            return [one for part in parts for one in (part if isinstance(part, list) else [part])]
        rest = dict(value) if isinstance(value, Mapping) else {}
        source = rest.pop("file", None) if isinstance(value, Mapping) else value
        if isinstance(source, Path):
            return {"file": str(source), **rest}
        if source is None or isinstance(source, str):
            return value
        if isinstance(source, Trajectory):
            self.signals[f"<{what}>"] = source
            return InMemory({"file": f"<{what}>", **rest})
        if hasattr(source, "columns") and hasattr(source, "index"):  # a DataFrame
            source = kind(source)
        if not isinstance(source, kind):
            own = "Inputs(t, NAME=...)" if kind is Inputs else "Measured(t, NAME=...)"
            raise InputError(
                f"These are no {'inputs' if kind is Inputs else 'measurements'} of a model.", where=what,
                got=type(source).__name__, valid=f"{own}, a Trajectory or a path",
                next_step="Make one from your arrays or your DataFrame, or give the path of a file.",
            )  # fmt: skip
        made = []
        for i, part in enumerate(source.parts):
            name = f"<{what}>" if i == 0 else f"<{what}, part {i + 1}>"
            self.signals[name] = replace(part, source=name)
            made.append(InMemory({"file": name, **source.entry(part), **rest}))
        return made[0] if len(made) == 1 else made

    def _instants(self, value: Any, what: str) -> Any:
        """The entry of the instants of a controller, which may be an array (N,) or the log of the loop itself."""
        if isinstance(value, str | Path):
            return {"file": str(value)}
        time = value.signals.time if isinstance(value, Log | Reference) else getattr(value, "time", value)
        if isinstance(time, Mapping) or time is None:
            return value
        time = np.asarray(time, dtype=float)
        if time.ndim != 1:
            raise InputError(
                "Instants are an array of one dimension.", where=what, got=f"shape {time.shape}",
                next_step="Give instants.ravel(), or one column of it.",
            )  # fmt: skip
        self.signals[f"<{what}>"] = Trajectory(time, np.zeros((time.size, 0)), (), source=f"<{what}>")
        return InMemory({"file": f"<{what}>"})

    def _signals(self, value: Any, what: str, kind: type[Log] | type[Reference]) -> Any:
        """The entry of a data file, which may be the object alone or a mapping with it as ``file``."""
        if isinstance(value, Excitation):
            return value.model_dump(mode="json")
        if isinstance(value, str | Path):
            return {"file": str(value)}
        rest = dict(value) if isinstance(value, Mapping) else {}
        source = rest.pop("file", None) if isinstance(value, Mapping) else value
        if source is None or (isinstance(value, Mapping) and not isinstance(source, Log | Reference | Trajectory)):
            return value
        if not isinstance(source, kind | Trajectory):
            raise InputError(
                f"This is no {what.partition(' ')[0]}.", where=what, got=type(source).__name__,
                valid=f"{kind.__name__}({', '.join(('t', 'tau' if kind is Log else 'q'))}), a Trajectory or a path",
                next_step="Make one from your arrays, or give the path of a file.",
            )  # fmt: skip
        name = f"<{what}>"
        columns: Mapping[str, Any] = {}
        if isinstance(source, Trajectory):
            self.signals[name] = source
        else:
            self.signals[name], columns = replace(source.signals, source=name), source.columns
            stem = "tau" if kind is Log else "q"
            self.widths[name] = sum(re.fullmatch(rf"{stem}\d+", n) is not None for n in source.signals.names)
        columns = {**columns, **rest.pop("columns", {})}
        return InMemory({"file": name, **rest} | ({"columns": columns} if columns else {}))


def pair(values: Sequence[Any], label: str) -> dict[str, Any]:
    """The entry of an experiment from its log and its reference, or its inputs and what was measured, in any order."""
    keys = {Log: "torque", Reference: "reference", Inputs: "inputs", Measured: "measured"}
    found = {keys[type(value)]: value for value in values if type(value) in keys}
    if len(found) != len(values) or ({"torque", "reference"} & set(found) and {"inputs", "measured"} & set(found)):
        raise InputError(
            "An experiment is a log and a reference; of a model its inputs and what was measured.", where=label,
            got=", ".join(type(value).__name__ for value in values),
            valid="(Log(t, tau), Reference(t, q)) or (Inputs(t, u=...), Measured(t, y=...))",
            next_step="Give both for each experiment, in this order.",
        )  # fmt: skip
    return found


class InMemory(dict[str, Any]):
    """The entry of a data file whose signals are in memory: it replaces all that says how a file is written."""


class Whole(dict[str, Any]):
    """An entry that replaces another one as a whole: names and values of one component mean nothing to another."""


def named(content: Mapping[str, Any], folder: Path) -> tuple[dict[str, Any], Memory]:
    """A content of a case with names in the place of its objects, and these objects.

    Args:
        folder: to which the files of a robot given as a mapping are relative.

    Raises:
        InputError: something stands where it has no meaning.
    """
    found = _Named(folder)
    plain = found.content(content)
    return plain, Memory(found.signals, found.objects, found.widths)


def digest(value: Any) -> str:
    """SHA-256 of an object: a robot's description, the matrices or functions of a system, the source of code."""
    state = sha256()
    for part in _contents(value):
        state.update(part if isinstance(part, bytes) else str(part).encode())
        state.update(b"\0")
    return state.hexdigest()


def _contents(value: Any) -> list[Any]:
    if isinstance(value, RobotDescription):
        return [value.model_dump_json(by_alias=True)]
    if isinstance(value, Block):
        return [pickle.dumps(value)]
    if isinstance(value, Component):
        described = value.describe()
        own = [getattr(value, name) for name in ("block", "system") if getattr(value, name, None) is not None]
        what = described["sha256"] if "sha256" in described else json.dumps(described, default=str, sort_keys=True)
        names = [v.name for v in (*value.inputs, *value.outputs)]
        return [what, names, value.parameter_values(), *(part for each in own for part in _contents(each))]
    if is_control(value):
        matrices = [np.asarray(getattr(value, name)).tobytes() for name in "ABCD" if hasattr(value, name)]
        functions = [_code(getattr(value, name, None)) for name in ("updfcn", "outfcn")]
        polynomials = [repr(getattr(value, name)) for name in ("num_array", "den_array") if hasattr(value, name)]
        return [value.dt, value.input_labels, value.output_labels, getattr(value, "params", {}), *matrices, *functions,
                *polynomials]  # fmt: skip
    if isinstance(value, type):
        own = [part for name, part in sorted(vars(value).items()) if not name.startswith("__")]
        flat = [each for part in own for each in (part if isinstance(part, tuple) else (part,))]
        flat = [getattr(each, "fget", each) for each in flat]  # of a property
        return [value.__qualname__, *(_code(e) if inspect.isroutine(e) else _ADDRESS.sub("", repr(e)) for e in flat)]
    return [_code(value)]


def _code(function: Any) -> bytes:
    """Source and captured numbers of a function, or its compiled code where there is no source."""
    function = inspect.unwrap(function) if callable(function) else function
    code = getattr(function, "__code__", None) or getattr(type(function).__call__, "__code__", None)
    if code is None:
        return type(function).__qualname__.encode()
    try:
        text = inspect.getsource(code).encode()
    except (OSError, TypeError):
        text = marshal.dumps(code)
    captured = []
    for cell in getattr(function, "__closure__", None) or ():
        with suppress(ValueError):  # an empty cell
            captured.append(cell.cell_contents)
    values = [np.asarray(v).tobytes() for v in captured if isinstance(v, int | float | np.ndarray)]
    return b"\0".join([text, repr(getattr(function, "__defaults__", None)).encode(), *values])
