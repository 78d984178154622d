"""The experiments and the systems of a case of a ``model:``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.case.calibration.errors import Recorded, with_errors
from fmu_didim.case.calibration.inputs import check_covered, read_inputs
from fmu_didim.case.calibration.model import interface_told, whole_numbers
from fmu_didim.case.calibration.ticks import Ticks, ticks_of, together
from fmu_didim.case.document import MODEL, CaseDocument
from fmu_didim.case.files import NONE_GIVEN
from fmu_didim.case.runs.measured import Samples, channel_of, output_operator, read_measured
from fmu_didim.components import Component, FmuComponent
from fmu_didim.cosim import Connection, System
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.model.experiment import Experiment, InitialState


@dataclass(frozen=True)
class CalibrationData:
    """The data of all experiments of a case of a ``model:``.

    Attributes:
        runs, ticks: label -> its data, and its ticks; step: nominal step of the simulation, s.
        together: outputs that were measured at the same instants in all fitted experiments: the columns of the log. The
            others are channels, each with instants of its own.
    """

    runs: Mapping[str, Recorded]
    ticks: Mapping[str, Ticks]
    step: float
    together: tuple[str, ...]

    @property
    def units(self) -> tuple[str, ...]:
        """(n,) of the columns of the log."""
        outputs = next(run.outputs for run in self.runs.values() if run.source.role == "estimation")
        return tuple(outputs[name].unit for name in self.together)

    @property
    def at_instants(self) -> bool:
        """Whether the ticks have no common step."""
        return any(one.step is None for one in self.ticks.values())

    def reference(self, label: str) -> Trajectory:
        """The inputs of an experiment at its ticks."""
        return self.runs[label].inputs.along(self.ticks[label].time)


def read_calibration(
    document: CaseDocument, folder: Path, model: Component, signals: Mapping[str, Trajectory] = NONE_GIVEN
) -> CalibrationData:
    """The data of the experiments of a case.

    Raises:
        InputError, UnknownNameError: a file or column is missing, or the inputs do not cover what was measured.
    """
    inputs, outputs = ({v.name: v for v in group} for group in (model.inputs, model.outputs))
    runs, found = dict[str, Recorded](), dict[str, Ticks]()
    step = None if document.loop.rate_hz is None else 1.0 / document.loop.rate_hz
    if step is None and isinstance(model, FmuComponent) and not model.takes_any_step:
        step = model.fmu.experiment.step
    chosen = interface_told(document, model)
    for label, source in document.runs.items():
        driven = read_inputs(source.inputs, folder, inputs, held=whole_numbers(model), signals=signals)
        measured, told = read_measured(source, folder, outputs, label=label, is_any=True, signals=signals)
        runs[label] = Recorded(source, driven, measured, (*(() if runs else chosen), *driven.told, *told))
        found[label] = _ticks(runs[label], label, step)
    runs = with_errors(runs)
    ticks, nominal = together(list(found.values()))
    return CalibrationData(runs, dict(zip(runs, ticks, strict=True)), nominal, _together(runs))


def _ticks(run: Recorded, label: str, step: float | None) -> Ticks:
    samples = np.unique(np.concatenate([one.time for one in run.outputs.values()]))
    rows = run.inputs.rows
    start = run.source.start_s
    if start is None:
        start = float(rows[0]) if rows.size else min(0.0, float(samples[0]))
        start = min(start, float(samples[0]))
    if samples[0] < start:
        raise InputError(
            "Samples lie before the start of the simulation.", where=f"{label}: start_s", got=f"t = {samples[0]:g} s",
            valid=f"t >= {start:g} s", next_step="Start it earlier (start_s), or cut the samples: from_s.",
        )  # fmt: skip
    check_covered(run.inputs, run.source.inputs, start, float(samples[-1]), label)
    within = rows[(rows > start) & (rows < samples[-1])]
    return ticks_of(start, np.union1d(samples, within), step=step)


def _together(runs: Mapping[str, Recorded]) -> tuple[str, ...]:
    """The largest group of outputs that are measured at the same instants wherever they are fitted, in all fitted
    experiments, and whose noise is stated for all or for none; of groups of one size that with most samples."""
    fitted = [run.outputs for run in runs.values() if run.source.role == "estimation"]
    everywhere = [name for name in fitted[0] if all(name in outputs for outputs in fitted)]
    if not everywhere:
        raise InputError(
            "No output was measured in all experiments that are fitted.", where="measured",
            got="; ".join(", ".join(outputs) for outputs in fitted),
            next_step="Fit experiments that have an output in common, or each in a case of its own.",
        )  # fmt: skip
    keys = {
        name: (fitted[0][name].errors.stated is None, *(outputs[name].time.tobytes() for outputs in fitted))
        for name in everywhere
    }
    groups = Counter(keys.values())
    samples = {name: sum(outputs[name].time.size for outputs in fitted) for name in everywhere}
    best = max(everywhere, key=lambda name: (groups[keys[name]], samples[name]))
    return tuple(name for name in everywhere if keys[name] == keys[best])


def model_system(model: Component, data: CalibrationData, label: str) -> System:
    """The system of a model alone in an experiment: its inputs come from the columns of the reference, those that are
    linear between their rows on straight lines."""
    inputs = data.runs[label].inputs.by_name
    return System(
        components={MODEL: model},
        connections=tuple(Connection(f"{REFERENCE}.{name}", f"{MODEL}.{name}") for name in inputs),
        order=(MODEL,),
        step_size=data.step,
        at_instants=data.at_instants,
        ramps=frozenset(name for name, one in inputs.items() if one.is_linear),
    )


def calibration_experiment(data: CalibrationData, label: str, system: System, reference: Trajectory) -> Experiment:
    """The experiment of a run.

    Raises:
        InputError: a held-out run lacks an output of the log.
    """
    run = data.runs[label]
    if any(name not in run.outputs for name in data.together):
        raise InputError(
            "A held-out experiment lacks outputs that are fitted.", where=label, got=", ".join(run.outputs),
            valid=", ".join(data.together), next_step="Measure them there, too, or take the experiment out.",
        )  # fmt: skip
    columns = [run.outputs[name] for name in data.together]
    time, values = _same_instants(columns, label)
    channels = [channel_of(one, reference, system, MODEL) for name, one in run.outputs.items()
                if name not in data.together]  # fmt: skip
    errors = tuple(one.errors for one in columns)
    plain = all(model.is_plain for model in errors)
    scale = None if plain else np.column_stack([m.scale(v) for m, v in zip(errors, values.T, strict=True)])
    return Experiment(
        reference, time, values, output_operator(time, reference, system), None, label, run.source.role, stamps=time,
        told=run.told, initial_state=InitialState("reference"), channels=tuple(channels), errors=errors, scale=scale,
    )  # fmt: skip


def _same_instants(columns: list[Samples], label: str) -> tuple[Array, Array]:
    """(N,) instants at which all of these outputs have a sample, and these samples (N, n)."""
    time = columns[0].time
    for one in columns[1:]:
        time = np.intersect1d(time, one.time)
    if time.size < 2:
        raise InputError(
            "The outputs of a held-out experiment have hardly an instant in common.", where=label,
            got=f"{time.size} instants of {', '.join(one.name for one in columns)}",
            next_step="Give them in one file, a row an instant.",
        )  # fmt: skip
    return time, np.column_stack([one.values[np.searchsorted(one.time, time)] for one in columns])
