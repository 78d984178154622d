"""FMI 2.0 co-simulation FMUs in the loop."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.cache import cached_folder, file_digest
from fmu_didim.components.base import Component, Instance, buffers, check_names
from fmu_didim.errors import FmuError, SimulationError
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
        references: name of a parameter -> value reference; input_references, output_references: in the
            order of the inputs and outputs, which may have been given other names.
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
    input_references: tuple[int, ...]
    output_references: tuple[int, ...]
    options: Mapping[str, int] = field(default_factory=dict)
    changed: frozenset[str] = frozenset()
    sample_time: float | None = None
    has_derivatives: bool = False

    def with_parameters(self, values: Mapping[str, float]) -> FmuComponent:
        check_names("parameter", values, self.parameters, where=str(self.path))
        parameters = tuple(replace(v, start=float(values.get(v.name, v.start))) for v in self.parameters)
        return replace(self, parameters=parameters, changed=self.changed | set(values))

    def with_names(self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]) -> FmuComponent:
        return replace(self, inputs=inputs, outputs=outputs)

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


def load_fmu(path: Path | str) -> FmuComponent:
    """Read an FMI 2.0 co-simulation FMU; all its real inputs, outputs and parameters keep their names.

    Raises:
        FmuError: the file is not such an FMU.
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
    reals = [v for v in description.modelVariables if v.type == "Real"]

    def group(causality: str) -> tuple[tuple[Variable, ...], tuple[int, ...]]:
        chosen = [v for v in reals if v.causality == causality]
        return tuple(_variable(v) for v in chosen), tuple(int(v.valueReference) for v in chosen)

    inputs, input_references = group("input")
    outputs, output_references = group("output")
    parameters, _ = group("parameter")
    settable = [v for v in description.modelVariables if v.causality == "parameter" and v.type in ("Real", "Integer")]
    return FmuComponent(
        path=path,
        folder=folder,
        digest=digest,
        guid=description.guid,
        identifier=description.coSimulation.modelIdentifier,
        inputs=inputs,
        outputs=outputs,
        parameters=parameters,
        references={v.name: int(v.valueReference) for v in settable},
        input_references=input_references,
        output_references=output_references,
        has_derivatives=bool(description.coSimulation.providesDirectionalDerivative),
    )


def _variable(own: Any) -> Variable:
    unit = own.unit or (own.declaredType.unit if own.declaredType else "") or ""
    return Variable(own.name, unit, own.causality, float(own.start or 0.0), own.description or "")


def _open(path: Path, digest: str) -> tuple[Any, Path]:
    """Model description and folder of an FMU, extracted once for each content."""
    import fmpy

    try:
        folder = cached_folder("extracted", digest, lambda target: _extract(path, target))
        # From the folder: FMPy leaves the .fmu file open when the description cannot be read.
        description = fmpy.read_model_description(str(folder), validate=False)
    except Exception as error:  # FMPy raises plain Exception, TypeError and lxml's SyntaxError
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


def _references(numbers: Sequence[int]) -> ctypes.Array[ctypes.c_uint]:
    return (ctypes.c_uint * len(numbers))(*numbers)


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
        self._states: list[ctypes.c_void_p] = []
        dll = self._slave.dll
        self._set_real, self._get_real, self._do_step = dll.fmi2SetReal, dll.fmi2GetReal, dll.fmi2DoStep
        self._input_references = _references(component.input_references)
        self._output_references = _references(component.output_references)
        self.input_names = tuple(v.name for v in component.inputs)
        self.output_names = tuple(v.name for v in component.outputs)
        self.bind(*buffers(component.inputs, component.outputs))

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
            references = _references([component.references[v.name] for v in changed])
            self._check(
                "fmi2SetReal",
                self._set_real(
                    self._c, references, len(changed), values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
                ),
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

    def set_parameters(self, values: Mapping[str, float]) -> None:
        references = _references([self._component.references[name] for name in values])
        numbers = (ctypes.c_double * len(values))(*values.values())
        self._check("fmi2SetReal of parameters", self._set_real(self._c, references, len(values), numbers))

    def derivatives(
        self, outputs: Sequence[int], inputs: Sequence[int], parameters: Mapping[str, float]
    ) -> tuple[Array, Array]:
        if not self._component.has_derivatives:
            return super().derivatives(outputs, inputs, parameters)
        component = self._component
        unknown = _references([component.output_references[i] for i in outputs])
        known = [component.input_references[i] for i in inputs] + [component.references[p] for p in parameters]
        result = np.zeros((len(known), len(outputs)))
        seed, call = (ctypes.c_double * 1)(1.0), self._slave.dll.fmi2GetDirectionalDerivative
        for row, reference in zip(result, known, strict=True):
            target = row.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
            status = call(self._c, unknown, len(outputs), _references([reference]), 1, seed, target)
            self._check("fmi2GetDirectionalDerivative", status)
        return result[: len(inputs)].T, result[len(inputs) :].T

    def save_state(self) -> Any:
        state = ctypes.c_void_p()
        self._check("fmi2GetFMUstate", self._slave.dll.fmi2GetFMUstate(self._c, ctypes.byref(state)))
        self._states.append(state)
        return state

    def restore_state(self, state: Any) -> None:
        self._check("fmi2SetFMUstate", self._slave.dll.fmi2SetFMUstate(self._c, state))

    def close(self) -> None:
        if self._pointer:
            for state in self._states:
                self._slave.dll.fmi2FreeFMUstate(self._c, ctypes.byref(state))
            self._states.clear()
            self._slave.dll.fmi2FreeInstance(self._c)
            self._pointer = None

    def _check(self, call: str, status: int) -> None:
        if status > 1:
            raise SimulationError(
                f"{call} of the FMU returned {STATUS[status]}.", where=str(self._component.path.name), got=self._said()
            )

    def _said(self) -> str | None:
        return "; ".join(self._messages.lines[-3:]) or None
