"""What says where a variable of an FMU starts: tried out once, then remembered.

A start value that can be set need not act: one with ``initial = "calculated"`` may be overwritten by the
initialisation, and some tools keep what is set and start elsewhere. So it is set, and the variable is read when the
initialisation is over. In model exchange the state itself can be set then.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

from fmu_didim.base.cache import cache_directory, read_record, write_record
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.reuse import trials
from fmu_didim.components.fmu.reuse.reset import TIME_LIMIT, TrialRunner
from fmu_didim.components.fmu.settings import FmuSettings

_FORMAT = 1
FOLLOWS = 1e-6
"""[1] Relative difference between where a variable starts and the start value that was set, up to which that acts:
ten times what is lost in single precision."""


@dataclass(frozen=True)
class Start:
    """Where a variable starts by itself, and whether a start value that is set acts; why not, in words."""

    value: float
    acts: bool
    reason: str = ""


def initial_values(component: FmuSettings, h: float, settings: tuple[Mapping[str, float], ...]) -> list[object]:
    """The outputs right after the initialisation with each of these settings, by name; or the error."""
    found: list[object] = []
    for values in settings:
        try:
            with closing(component.with_parameters(values).instantiate_in_process()) as instance:
                trials.initialise(instance, component)
                instance.get()
                found.append(dict(zip(instance.output_names, instance.outputs.tolist(), strict=True)))
        except FmuDidimError as error:
            found.append(trials.in_words(error))
    return found


def find_start(component: FmuSettings, name: str, *, can_be_set: bool) -> Start:
    """How a variable starts, which is among the outputs; ``can_be_set``: whether it is among the start values.

    Raises:
        FmuDidimError: the FMU cannot be initialised.
    """
    path = _path(component, name, can_be_set)
    record = read_record(path)
    if record is not None and set(record) == {"value", "acts", "reason"}:
        return Start(**record)
    found = _tried(component, name, can_be_set)
    write_record(path, asdict(found))
    return found


def _tried(component: FmuSettings, name: str, can_be_set: bool) -> Start:
    value = component.start_values[name] if can_be_set else 0.0
    other = trials.changed_value(value)
    settings: tuple[Mapping[str, float], ...] = ({}, {name: other}) if can_be_set else ({},)
    with closing(TrialRunner(component, 1.0, TIME_LIMIT)) as run:
        answers = run(initial_values, settings)
    if isinstance(answers, FmuDidimError):
        raise answers
    own, *changed = answers
    if isinstance(own, str):
        raise FmuDidimError(
            "The FMU cannot be initialised.", where=component.path.name, got=own,
            next_step="fmu-didim fmu check FILE tries it alone.",
        )  # fmt: skip
    if not changed:
        return Start(own[name], False, "it has no start value that can be set")
    if isinstance(changed[0], str):
        return Start(own[name], False, f"the FMU refuses another start value: {changed[0]}")
    there = changed[0][name]
    if abs(there - other) <= FOLLOWS * max(abs(other), abs(own[name] - value)):
        return Start(own[name], True)
    return Start(
        own[name], False, f"after the initialisation it is {there:.6g}, whether {value:.6g} or {other:.6g} was set"
        if there == own[name] else f"after the initialisation it is {there:.6g} where {other:.6g} was set",
    )  # fmt: skip


def _path(component: FmuSettings, name: str, can_be_set: bool) -> Path:
    what = [_FORMAT, component.digest, component.interface.kind, name, can_be_set]
    key = hashlib.sha256(json.dumps(what).encode()).hexdigest()
    return cache_directory() / "starts" / f"{component.digest}-{key[:16]}.json"
