"""Error models of what was measured of a ``model:``: one an output, in all its experiments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.case.calibration.inputs import RecordedInputs
from fmu_didim.case.runs.measured import Samples
from fmu_didim.case.sources import ExperimentSource
from fmu_didim.model.signals.error_model import SMALLEST_SCALE, ErrorModel


@dataclass(frozen=True)
class Recorded:
    """What the files of an experiment hold.

    Attributes:
        source: its entry; inputs: what drove the model; outputs: name -> what was measured; told: of the files.
    """

    source: ExperimentSource
    inputs: RecordedInputs
    outputs: Mapping[str, Samples]
    told: tuple[Diagnostic, ...]


def with_errors(runs: Mapping[str, Recorded]) -> dict[str, Recorded]:
    """The runs with error models that fit together: an output that states another deviation in each of them is divided
    by its own.

    Raises:
        InputError: an output has noise of different kinds, or samples that its error model cannot have.
    """
    models: dict[str, dict[str, ErrorModel]] = {}
    for label, run in runs.items():
        for name, samples in run.outputs.items():
            _check(samples, label)
            models.setdefault(name, {})[label] = samples.errors
    own = {name for name, found in models.items() if _differ(name, found)}

    def with_relative(samples: Samples) -> Samples:
        return replace(samples, errors=replace(samples.errors, relative=samples.errors.relative or 0.0))

    return {
        label: replace(run, outputs={n: with_relative(s) if n in own else s for n, s in run.outputs.items()})
        for label, run in runs.items()
    }


def _differ(name: str, found: Mapping[str, ErrorModel]) -> bool:
    """Whether the experiments state other deviations of an output; raises InputError where more differs."""
    if len(set(found.values())) == 1:
        return False
    others = {replace(model, deviation=None) for model in found.values()}
    if len(others) > 1 or any(m.is_logarithmic or m.is_robust or m.deviation is None for m in found.values()):
        raise InputError(
            f"The noise of '{name}' is stated differently in some experiments.", where="measured",
            got="; ".join(f"{label}: {_words(model)}" for label, model in found.items()),
            valid="one error model for an output; only std: may have a value of its own in each experiment",
            next_step="State the noise of this output alike everywhere, or nowhere.",
        )  # fmt: skip
    return True


def _words(model: ErrorModel) -> str:
    told = [
        f"std {model.deviation:g}" if model.deviation is not None else "",
        f"relative_std {model.relative:g}" if model.relative is not None else "",
        "log_normal" if model.is_logarithmic else "", "robust" if model.is_robust else "",
    ]  # fmt: skip
    return ", ".join(filter(None, told)) or "not stated"


def _check(samples: Samples, label: str) -> None:
    """Raise InputError where samples cannot have such noise."""
    errors, values = samples.errors, samples.values
    if errors.is_logarithmic and (values <= 0).any():
        first = int(np.argmax(values <= 0))
        raise InputError(
            f"'{samples.name}' is not positive everywhere, so it has no logarithms.", where=f"{label}: {samples.where}",
            got=f"{int(np.sum(values <= 0))} samples, the first one {values[first]:g} at t = {samples.time[first]:g} s",
            next_step="Take log_normal: out, and state std: and relative_std: where the noise grows with the value.",
        )  # fmt: skip
    size = np.abs(values)
    if errors.relative and errors.deviation is None and (size < SMALLEST_SCALE * np.median(size)).any():
        raise InputError(
            f"'{samples.name}' comes close to zero, where noise that is relative alone would vanish.",
            where=f"{label}: {samples.where}", got=f"{size.min():.3g} with a median size of {np.median(size):.3g}",
            valid=f"no value below {SMALLEST_SCALE:g} of the median size",
            next_step="State the noise that is left at zero, too: {std: ..., relative_std: ...}.",
        )  # fmt: skip
