"""FMI 2.0 co-simulation FMUs in the loop."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from fmu_didim.cache import cached_folder, file_digest
from fmu_didim.components.base import Component, Instance, buffers, check_names
from fmu_didim.errors import FmuError, SimulationError, UnknownNameError
from fmu_didim.signals import Array, Variable

STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
SUBSTEPS = "substeps"
"""Integer parameter of the FMUs that this framework exports; 0 means chosen automatically."""
RESET_STRATEGY = "a new instance for every run"


@dataclass(frozen=True)
class FmuComponent(Component):
    """An FMU as a component; made by :func:`load_fmu`.

    Attributes:
        path: the ``.fmu`` file; folder: where it is extracted.
        references: FMI name -> value reference; names: role in the loop -> FMI name.
        options: values of Integer parameters set before initialisation.
        changed: names of the parameters whose values were set, in addition to the FMU's own start values.
    """

    path: Path
    folder: Path
    digest: str
    guid: str
    identifier: str
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    references: Mapping[str, int]
    names: Mapping[str, str]
    options: Mapping[str, int] = field(default_factory=dict)
    changed: frozenset[str] = frozenset()
    sample_time: float | None = None

    def with_parameters(self, values: Mapping[str, float]) -> FmuComponent:
        check_names("parameter", values, self.parameters, where=str(self.path))
        parameters = tuple(replace(v, start=float(values.get(v.name, v.start))) for v in self.parameters)
        return replace(self, parameters=parameters, changed=self.changed | set(values))

    def with_substeps(self, count: int) -> FmuComponent | None:
        if SUBSTEPS not in self.references:
            return None
        return replace(self, options={**self.options, SUBSTEPS: count})

    def instantiate(self) -> Instance:
        return _FmuInstance(self)

    def describe(self) -> dict[str, Any]:
        return {
            "kind": "fmu",
            "file": self.path.name,
            "sha256": self.digest,
            "guid": self.guid,
            "reset": RESET_STRATEGY,
            "options": dict(self.options),
        }


def load_fmu(
    path: Path | str,
    *,
    inputs: Mapping[str, str] | None = None,
    outputs: Mapping[str, str] | None = None,
    options: Mapping[str, int] | None = None,
) -> FmuComponent:
    """Read an FMI 2.0 co-simulation FMU.

    Args:
        path: the ``.fmu`` file.
        inputs, outputs: role in the loop (``tau1``, ``q1``, ...) -> name in the FMU; by default every
            real input and output under its own name.
        options: values of Integer parameters.

    Raises:
        FmuError: the file is not such an FMU; UnknownNameError: a name in the mapping does not exist.
    """
    path = Path(path)
    if not path.is_file():
        raise FmuError("The FMU does not exist.", where=str(path))
    digest = file_digest(path)
    description, folder = _open(path, digest)
    if not description.fmiVersion.startswith("2."):
        raise FmuError("This FMI version is not supported.", where=str(path), got=description.fmiVersion, valid="2.0")
    if description.coSimulation is None:
        raise FmuError("The FMU has no co-simulation interface.", where=str(path), valid="co-simulation")
    variables = {v.name: v for v in description.modelVariables if v.type == "Real"}
    units = {name: v.unit or (v.declaredType.unit if v.declaredType else "") or "" for name, v in variables.items()}

    def group(causality: str, mapping: Mapping[str, str] | None) -> dict[str, Variable]:
        own = {name: name for name, v in variables.items() if v.causality == causality}
        result = {}
        for role, name in (mapping or own).items():
            if name not in own:
                raise UnknownNameError(causality, name, own, where=str(path))
            start = variables[name].start
            result[role] = Variable(role, units[name], causality, float(start) if start is not None else 0.0)
        return result

    chosen_inputs, chosen_outputs = group("input", inputs), group("output", outputs)
    integers = {v.name: v for v in description.modelVariables if v.type in ("Integer", "Enumeration")}
    for name in options or {}:
        if name not in integers:
            raise UnknownNameError("Integer parameter", name, integers, where=str(path))
    names = {**{r: r for r in variables}, **dict(inputs or {}), **dict(outputs or {})}
    return FmuComponent(
        path=path,
        folder=folder,
        digest=digest,
        guid=description.guid,
        identifier=description.coSimulation.modelIdentifier,
        inputs=tuple(chosen_inputs.values()),
        outputs=tuple(chosen_outputs.values()),
        parameters=tuple(
            Variable(name, units[name], "parameter", float(v.start or 0.0), v.description or "")
            for name, v in variables.items()
            if v.causality == "parameter"
        ),
        references={name: int(v.valueReference) for name, v in {**variables, **integers}.items()},
        names=names,
        options=dict(options or {}),
    )


def _open(path: Path, digest: str) -> tuple[Any, Path]:
    """Model description and folder of an FMU, extracted once for each content."""
    import fmpy

    try:
        description = fmpy.read_model_description(str(path), validate=False)
        folder = cached_folder("extracted", digest, lambda target: _extract(path, target))
    except (BadZipFile, KeyError, OSError, ValueError) as error:
        raise FmuError("The file is not a readable FMU.", where=str(path), got=str(error)) from error
    return description, folder


def _extract(path: Path, target: Path) -> None:
    import fmpy

    fmpy.extract(str(path), unzipdir=str(target))


class _Messages:
    """What an FMU writes to its logger, kept for error messages."""

    def __init__(self) -> None:
        from fmpy import calloc, fmi2, free

        self.lines: list[str] = []
        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._log)
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
        self.callbacks = callbacks

    def _log(self, environment: Any, name: bytes, status: int, category: bytes, message: bytes) -> None:
        if message:
            self.lines.append(message.decode("utf-8", "replace"))
            del self.lines[:-20]


@lru_cache(maxsize=64)
def _library(folder: Path, guid: str, identifier: str) -> Any:
    """The loaded shared library of an FMU; kept, because loading it again costs more than a short run."""
    from fmpy import fmi2

    here = Path.cwd()
    try:
        return fmi2.FMU2Slave(
            guid=guid, unzipDirectory=str(folder), modelIdentifier=identifier, instanceName=identifier
        )
    except Exception as error:  # FMPy raises nothing more specific
        os.chdir(here)  # where FMPy does not go back to after a failure
        raise FmuError(
            "The shared library of the FMU cannot be loaded.",
            where=identifier,
            got=str(error),
            next_step="Check that the FMU holds a binary for this platform (fmpy info FILE).",
        ) from error


class _FmuInstance(Instance):
    def __init__(self, component: FmuComponent) -> None:
        self._component = component
        self._slave = _library(component.folder, component.guid, component.identifier)
        self._messages = _Messages()
        self._pointer: int | None = self._slave.fmi2Instantiate(
            component.identifier.encode(),
            1,
            component.guid.encode(),
            (component.folder / "resources").resolve().as_uri().encode(),
            ctypes.byref(self._messages.callbacks),
            0,
            0,
        )
        if not self._pointer:
            raise FmuError("The FMU cannot be instantiated.", where=str(component.path), got=self._said())
        self._c = ctypes.c_void_p(self._pointer)
        dll = self._slave.dll
        self._set_real, self._get_real, self._do_step = dll.fmi2SetReal, dll.fmi2GetReal, dll.fmi2DoStep
        self._input_references = self._references([v.name for v in component.inputs])
        self._output_references = self._references([v.name for v in component.outputs])
        self.bind(*buffers(component.inputs, component.outputs))

    def _references(self, roles: list[str]) -> ctypes.Array[ctypes.c_uint]:
        component = self._component
        numbers = [component.references[component.names[role]] for role in roles]
        return (ctypes.c_uint * len(numbers))(*numbers)

    def bind(self, inputs: Array, outputs: Array) -> None:
        super().bind(inputs, outputs)
        double = ctypes.POINTER(ctypes.c_double)
        self._set_arguments = (self._c, self._input_references, inputs.size, inputs.ctypes.data_as(double))
        self._get_arguments = (self._c, self._output_references, outputs.size, outputs.ctypes.data_as(double))

    def begin_initialisation(self, time: float) -> None:
        component = self._component
        changed = [v for v in component.parameters if v.name in component.changed]
        if changed:
            values = np.array([v.start for v in changed])
            references = self._references([v.name for v in changed])
            self._check(
                "fmi2SetReal",
                self._set_real(self._c, references, len(changed), values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))),
            )
        for name, value in component.options.items():
            number = (ctypes.c_int * 1)(value)
            reference = (ctypes.c_uint * 1)(component.references[name])
            self._check("fmi2SetInteger", self._slave.dll.fmi2SetInteger(self._c, reference, 1, number))
        self._check("fmi2SetupExperiment", self._slave.dll.fmi2SetupExperiment(self._c, 0, 0.0, time, 0, 0.0))
        self._check("fmi2EnterInitializationMode", self._slave.dll.fmi2EnterInitializationMode(self._c))

    def end_initialisation(self) -> None:
        self._check("fmi2ExitInitializationMode", self._slave.dll.fmi2ExitInitializationMode(self._c))

    def set(self) -> None:
        status = self._set_real(*self._set_arguments)
        if status > 1:
            self._check("fmi2SetReal", status)

    def get(self) -> None:
        status = self._get_real(*self._get_arguments)
        if status > 1:
            self._check("fmi2GetReal", status)

    def step(self, time: float, size: float) -> None:
        status = self._do_step(self._c, time, size, 1)
        if status > 1:
            self._check(f"fmi2DoStep at t = {time:.6g} s", status)

    def save_state(self) -> Any:
        state = ctypes.c_void_p()
        self._check("fmi2GetFMUstate", self._slave.dll.fmi2GetFMUstate(self._c, ctypes.byref(state)))
        return state

    def restore_state(self, state: Any) -> None:
        self._check("fmi2SetFMUstate", self._slave.dll.fmi2SetFMUstate(self._c, state))

    def close(self) -> None:
        if self._pointer:
            self._slave.dll.fmi2FreeInstance(self._c)
            self._pointer = None

    def _check(self, call: str, status: int) -> None:
        if status > 1:
            raise SimulationError(
                f"{call} of the FMU returned {STATUS[status]}.", where=str(self._component.path.name), got=self._said()
            )

    def _said(self) -> str | None:
        return "; ".join(self._messages.lines[-3:]) or None
