"""The mistakes in a case of a ``model:``: its names against the model, its columns against the files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from fmu_didim.base.documents import TO_FILL_IN
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.case.files import table_and_time
from fmu_didim.case.parts import component_of, controller_block
from fmu_didim.case.sources import ComponentSource, ExperimentSource, InputsFile, MeasuredFile, SignalFile
from fmu_didim.components import Component, FmuComponent
from fmu_didim.components.fmu.chosen import visible
from fmu_didim.components.variable_names import START, unknown, unknown_parameter
from fmu_didim.data.tables import Column, selected


def mistakes_of_a_model(
    content: Mapping[str, Any], runs: Mapping[str, ExperimentSource], folder: Path
) -> Iterator[tuple[FmuDidimError, str]]:
    """Each mistake that is not one of form, and where it is.

    Args:
        content: of the case file; runs: label -> each experiment that can be understood.
    """
    try:
        model = _component(content["model"], folder)
    except FmuDidimError as error:
        model = None
        yield error, "model"
    names = content.get("identify")
    if isinstance(names, Mapping) and model is not None:
        for name, entry in names.items():
            yield from _of_parameter(str(name), entry, model)
    for label, run in runs.items():
        parts: list[InputsFile | MeasuredFile] = [*run.measured_files, *([run.inputs] if run.inputs else [])]
        for part in parts:
            is_input = isinstance(part, InputsFile)
            offered = None if model is None else _inputs_of(model) if is_input else _outputs_of(model)
            where = f"{label}: {'inputs' if is_input else 'measured'}: {part.file}"
            yield from ((error, where) for error in _of_file(part, offered, folder, where))


def _component(given: Any, folder: Path) -> Component | None:
    """The model; None where its entry is reported with the case."""
    try:
        source = ComponentSource.model_validate({"source": given} if isinstance(given, str) else given)
    except ValidationError:
        return None
    if source.source is None or source.source == TO_FILL_IN:
        return None
    return component_of(source, folder, controller_block, si_units=False)


def _of_parameter(name: str, entry: Any, model: Component) -> Iterator[tuple[FmuDidimError, str]]:
    own = entry.get("parameter") if isinstance(entry, Mapping) else None
    meant, offered = str(own or name), [v.name for v in model.parameters]
    is_start = meant.endswith(START) and meant.removesuffix(START) in _outputs_of(model)
    if meant != TO_FILL_IN and meant not in offered and not is_start:
        yield unknown_parameter(model, meant, where=f"identify.{name}"), "identify"


def _inputs_of(model: Component) -> dict[str, str]:
    """Name of each input -> its unit."""
    return {v.name: v.unit for v in model.inputs}


def _outputs_of(model: Component) -> dict[str, str]:
    """Name of all that can be measured -> its unit: outputs, and any other variable that an FMU computes."""
    others = {n: v.unit for n, v in visible(model).items()} if isinstance(model, FmuComponent) else {}
    return others | {v.name: v.unit for v in model.outputs}


def _of_file(part: SignalFile, offered: Mapping[str, str] | None, folder: Path, where: str) -> Iterator[FmuDidimError]:
    kind = "input" if isinstance(part, InputsFile) else "output"
    names = dict.fromkeys([*part.columns, *getattr(part, "signals", ()), *getattr(part, "std", ())])
    for name in names:
        if offered is not None and name not in offered and name != TO_FILL_IN:
            yield unknown(f"{kind} of the model", name, offered, where=where)
    try:
        table, time = table_and_time(part, folder)
    except FmuDidimError as error:
        yield error
        return
    found = [n for n in offered or {} if table.find(n) is not None] if kind == "input" or not names else []
    columns = {n: Column(name=n) for n in found} | {n: part.columns.get(n, Column(name=n)) for n in names}
    for name, column in columns.items():
        unit = None if offered is None else offered.get(name)
        try:
            selected(table, time=time, columns={name: column}, units={} if unit is None else {name: unit},
                     others=False, sparse=True)  # fmt: skip
        except FmuDidimError as error:
            yield error


def runs_of(content: Mapping[str, Any]) -> Iterator[tuple[str, ExperimentSource]]:
    """The experiments that can be understood; what is wrong with the others is reported with the case."""
    given = {key: content[key] for key in ("train", "validation") if isinstance(content.get(key), dict)}
    if own := {key: content[key] for key in ("inputs", "measured") if key in content and "model" in content}:
        given["estimation"] = own
    experiments = content.get("experiments")
    given |= experiments if isinstance(experiments, dict) else {}
    for label, value in given.items():
        try:
            yield label, TypeAdapter(ExperimentSource).validate_python(value)
        except ValidationError:
            continue
