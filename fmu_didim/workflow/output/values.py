"""The identified values of a model as files that other tools and this one take back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import yaml

from fmu_didim.results.result import ParameterResult, ResultDocument
from fmu_didim.ssp import ssv_text

SSV_FILE, OWN_SSV_FILE = "parameters.ssv", "parameters_{label}.ssv"
VALUES_FILE = "parameters.yaml"
"""The values by their names in the model: for tools of FMUs, and as an entry of a case."""


def write_values(document: ResultDocument, directory: Path) -> None:
    """Write the values of a model, those of each experiment that has some of its own in a file of theirs; nothing of a
    robot, whose description holds them."""
    if not document.outputs or not document.parameters:
        return
    shared = _in_model(document, None)
    (directory / SSV_FILE).write_text(ssv_text(document.name, _with_units(shared)), encoding="utf-8")
    for label in dict.fromkeys(p.experiment for p in document.parameters.values() if p.experiment is not None):
        text = ssv_text(f"{document.name}, {label}", _with_units({**shared, **_in_model(document, label)}))
        (directory / OWN_SSV_FILE.format(label=label)).write_text(text, encoding="utf-8")
    (directory / VALUES_FILE).write_text(_yaml(document, shared), encoding="utf-8")


def _in_model(document: ResultDocument, label: str | None) -> dict[str, ParameterResult]:
    """Name in the model -> value that all experiments share, or that one of them has of its own."""
    own = {name: p for name, p in document.parameters.items() if p.experiment == label and p.of == "model"}
    return {p.standard or name.partition("[")[0]: p for name, p in own.items()}


def _with_units(found: Mapping[str, ParameterResult]) -> dict[str, tuple[float, str]]:
    return {name: (p.value, p.unit) for name, p in found.items()}


def _yaml(document: ResultDocument, shared: Mapping[str, ParameterResult]) -> str:
    """The values as the entry of a case, and as a modification in Modelica."""
    values = {name: p.value for name, p in shared.items()}
    lines = [
        f"# {document.name}: {document.verdict}. Values with their standard deviations:",
        *(f"#   {name} = {p.value:.6g} ± {p.std:.2g} {p.unit}".rstrip() for name, p in shared.items()),
        f"# In Modelica: ({', '.join(f'{name} = {value!r}' for name, value in values.items())})",
        "# In a case, beside source: of its model:",
    ]
    return "\n".join(lines) + "\n" + yaml.safe_dump({"model": {"parameters": values}}, sort_keys=False)
