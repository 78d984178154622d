"""Simulated outputs of a model, or of a robot beside its torque: at the instants of what was measured, with true values
of the parameters.

y = sampled output of the true model + s_i e,   e of variance one, as of :mod:`fmu_didim.campaigns.planning.truth`
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.planning.document import Noise
from fmu_didim.case import Case
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import Simulation

SHORT = {"model": "source", "inputs": "file", "measured": "file"}
"""Entries that are written short as a name alone -> the key of it, under which paths of a campaign go on."""
RUNS = ("train", "validation")


@dataclass(frozen=True)
class SimulatedOutput:
    """An output without noise: its instants (N,), s, and values (N,), its name in the model, and the standard deviation
    of its noise where the case states it."""

    name: str
    time: Array
    values: Array
    stated: float | None = None


def written_out(content: Mapping[str, Any]) -> dict[str, Any]:
    """A case with its short forms written out: ``model: {source: ...}``, ``inputs: {file: ...}``."""
    result = {key: _long(key, value) for key, value in content.items()} if "model" in content else dict(content)
    for name in RUNS:
        if "model" in content and isinstance(result.get(name), Mapping):
            result[name] = {key: _long(key, value) for key, value in result[name].items()}
    runs = result.get("experiments")
    if "model" in content and isinstance(runs, Mapping):
        result["experiments"] = {
            label: {key: _long(key, value) for key, value in run.items()} if isinstance(run, Mapping) else run
            for label, run in runs.items()
        }
    return result


def _long(key: str, value: Any) -> Any:
    if key not in SHORT:
        return value
    if key == "measured" and isinstance(value, list | tuple):
        return [_long(key, each) for each in value]
    return {SHORT[key]: value} if isinstance(value, str) else value


def simulated_outputs(case: Case) -> dict[str, list[SimulatedOutput]]:
    """Label -> what a model with the values of the case gives, for each output that was measured."""
    assert case.data is not None
    model, found = case.model, dict[str, list[SimulatedOutput]]()
    for label, experiment in model.experiments.items():
        log = model.torque(model.start, label)
        found[label] = [SimulatedOutput(n, experiment.time, log[:, j]) for j, n in enumerate(model.loop.labels)]
        if experiment.channels:
            found[label] += simulated_channels(model.simulation(model.start, label))
    return found


def simulated_channels(run: Simulation) -> list[SimulatedOutput]:
    """What a run gives for each signal that was measured beside what the log shows."""
    values = run.channels()
    return [SimulatedOutput(c.name, c.time, values[c.name], c.deviation) for c in run.experiment.channels]


def channel_deviation(one: SimulatedOutput, noise: Noise) -> float:
    """Standard deviation of the noise of a signal of a robot: as its case states it; else the campaign, of a position.

    Raises:
        InputError: neither does.
    """
    if one.stated is not None:
        return one.stated
    if one.name.startswith("q") and one.name[1:].isdigit():
        return noise.position_std
    raise InputError(
        "Nothing says how much noise a simulated signal has.", where=f"measured: {one.name}", got="no std",
        next_step=f"State it in the case: measured: {{..., std: {{{one.name}: ...}}}}.",
    )  # fmt: skip


def outputs_deviation(
    outputs: list[SimulatedOutput], *, relative: float | None, std: tuple[float, ...] | None
) -> list[float]:
    """Standard deviation of the noise of each output: as given, or a part of the deviation of the output itself.

    Raises:
        InputError: there are not as many as outputs.
    """
    if std is None:
        return [float((relative or 0.0) * np.std(one.values)) for one in outputs]
    if len(std) != len(outputs):
        raise InputError(
            "noise.std needs one value for each output.", got=len(std), valid=str(len(outputs)),
            next_step=f"Give a list of that length, in the order {', '.join(one.name for one in outputs)}.",
        )  # fmt: skip
    return list(std)


def output_file(label: str, name: str) -> str:
    """Name of the simulated file of an output of an experiment."""
    return f"measured_{label}_{name}.csv"


def with_simulated_outputs(content: Mapping[str, Any], outputs: Mapping[str, list[str]]) -> dict[str, Any]:
    """The content of a case that reads simulated outputs instead of its own; what it says of their noise stays.

    Args:
        outputs: label -> names of the outputs.
    """
    result = dict(content)
    for place, key, label in _places(result):
        run = place if key is None else dict(place[key])
        run["measured"] = simulated_files(label, outputs.get(label, ()), run.get("measured"))
        if key is not None:
            place[key] = run
    return result


def simulated_files(label: str, names: Sequence[str], measured: Any) -> list[dict[str, Any]]:
    """What stands under ``measured:`` of an experiment for its simulated outputs; what is there states their noise."""
    stated = _stated(measured)
    return [
        {"file": output_file(label, name), "columns": {name: name}}
        | ({"std": {name: stated[name]}} if name in stated else {})
        for name in names
    ]


def _places(result: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str | None, str]]:
    """Where each experiment stands: the mapping, its key in it (None: it is the mapping itself), and its label."""
    if "measured" in result:
        yield result, None, "estimation"
    for name in RUNS:
        if isinstance(result.get(name), Mapping):
            yield result, name, "estimation" if name == "train" else name
    if isinstance(result.get("experiments"), Mapping):
        result["experiments"] = dict(result["experiments"])
        yield from ((result["experiments"], label, label) for label in list(result["experiments"]))


def _stated(measured: Any) -> dict[str, float]:
    """The standard deviations of the noise that the files of an experiment state."""
    found: dict[str, float] = {}
    for file in measured if isinstance(measured, list | tuple) else [measured]:
        if isinstance(file, Mapping):
            columns = file.get("columns") or {}
            found |= {name: c["std"] for name, c in columns.items() if isinstance(c, Mapping) and "std" in c}
            found |= file.get("std") or {}
    return found
