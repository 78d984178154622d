"""How an FMU behaves: can it be run again, do instances get in each other's way, what acts on what.

Every question is put in a process of its own, so that an FMU that crashes or hangs there answers with just that.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.cache import cache_directory
from fmu_didim.components.fmu import questions
from fmu_didim.components.fmu.component import FmuComponent
from fmu_didim.components.fmu.isolate import run_in_fresh_process
from fmu_didim.components.fmu.questions import AFTER_A_STEP, AT_ONCE, LATER, NEVER, RESTORES, STEPS, same
from fmu_didim.errors import FmuDidimError

RESET, STATE, AGAIN, PROCESS = "reset", "state", "re-instantiate", "fresh process"
_FORMAT = 1


@dataclass(frozen=True)
class FmuProbe:
    """What :func:`probe_fmu` found.

    Attributes:
        file, digest, interface: what was probed; step_size: in s.
        failure: why the FMU does not run at all; empty if it does. Then nothing else was probed.
        deterministic: two new instances, one after the other in one process, give the same trajectory.
        reproducible: so do two new processes.
        independent: two instances side by side run as if alone; None if it allows only one.
        reset, state: ``restores``, ``does not restore``, or why it could not be tried.
        response: output -> when it first follows a change of the inputs: ``at once`` (between set and get),
            ``after a step``, ``later`` or ``never`` (within the probe).
        not_finite: outputs that became NaN or infinite.
        acting, without_effect, refused: parameters by what a change of 1 % (or 1e-3) did.
        strategy: how to run it again: ``reset``, ``state``, ``re-instantiate`` or ``fresh process``; reason: why.
    """

    file: str
    digest: str
    interface: str
    step_size: float
    failure: str = ""
    deterministic: bool = False
    reproducible: bool = False
    independent: bool | None = None
    reset: str = ""
    state: str = ""
    response: tuple[tuple[str, str], ...] = ()
    not_finite: tuple[str, ...] = ()
    acting: tuple[str, ...] = ()
    without_effect: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    strategy: str = PROCESS
    reason: str = ""

    def lines(self) -> tuple[str, ...]:
        """The result as text, one finding a line."""
        head = f"{self.file}, {self.interface}, {STEPS} steps of {self.step_size:g} s"
        if self.failure:
            return (head, f"does not run: {self.failure}", f"run it again by: {self.strategy} ({self.reason})")
        side = {True: "run as if alone", False: "DISTURB each other", None: "not allowed by the FMU"}[self.independent]
        alike = "the same" if self.deterministic else "DIFFERENT"
        found = [
            head,
            f"new instances one after the other: {alike} trajectories",
            f"new processes: {'the same' if self.reproducible else 'DIFFERENT'} trajectories",
            f"instances side by side: {side}",
            f"reset: {self.reset}",
            f"saved state: {self.state}",
        ]
        for when in (AT_ONCE, AFTER_A_STEP, LATER, NEVER):
            names = [name for name, answer in self.response if answer == when]
            if names:
                found.append(f"outputs that follow the inputs {when}: {', '.join(names)}")
        groups = (
            ("outputs that are NaN or infinite", self.not_finite),
            ("parameters that act", self.acting),
            ("parameters WITHOUT EFFECT here", self.without_effect),
            ("parameters whose change is refused", self.refused),
        )
        found += [f"{title}: {', '.join(names)}" for title, names in groups if names]
        return (*found, f"run it again by: {self.strategy} ({self.reason})")


def probe_fmu(
    component: FmuComponent, *, step_size: float | None = None, time_limit_s: float = 60.0, fresh: bool = False
) -> FmuProbe:
    """Try out how an FMU behaves, by runs of 50 steps with pseudo-random held inputs.

    The answer is kept in the cache under the content of the FMU and the values of its parameters.

    Args:
        step_size: in s; default: sample time of the component, step of the FMU's default experiment, or 1 ms.
        time_limit_s: for each of the questions.
        fresh: ask again even if the answer is known.
    """
    component = replace(component, isolated=False)
    h = step_size or component.sample_time or component.fmu.experiment.step or 1e-3
    path = cache_directory() / "probes" / f"{_key(component, h)}.json"
    if not fresh and path.is_file():
        known = _read(path)
        if known is not None:
            return replace(known, file=component.path.name)
    found = _probe(component, h, time_limit_s)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, partial = tempfile.mkstemp(prefix=".partial-", dir=path.parent)
    with os.fdopen(handle, "w", encoding="utf-8") as stream:
        json.dump(asdict(found), stream)
    Path(partial).replace(path)
    return found


def _key(component: FmuComponent, h: float) -> str:
    values = [component.parameter_values(), dict(component.options), component.solver, component.substeps, h]
    text = json.dumps([_FORMAT, component.digest, component.interface.kind, values], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _read(path: Path) -> FmuProbe | None:
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
        return FmuProbe(**{k: _frozen(v) for k, v in known.items()})
    except (ValueError, TypeError):
        return None  # from another version: ask again


def _frozen(value: Any) -> Any:
    return tuple(_frozen(v) for v in value) if isinstance(value, list) else value


def _probe(component: FmuComponent, h: float, limit: float) -> FmuProbe:
    def ask(question: Callable[..., Any]) -> Any:
        return run_in_fresh_process(question, component, h, where=str(component.path), time_limit=limit)

    def ask_safely(question: Callable[..., Any]) -> Any:
        try:
            return ask(question)
        except FmuDidimError as error:
            return error.what.rstrip(".") + (f" ({error.got})" if error.got else "")

    blank = FmuProbe(component.path.name, component.digest, component.interface.kind, h)
    try:
        first, second = ask(questions.two_in_turn)
        other = ask(questions.once)
    except FmuDidimError as error:
        failure = " ".join(str(error).split())
        return replace(blank, failure=failure, reason="it does not run here")
    reproducible = bool(same(first, other))
    once = component.interface.once_per_process
    side_by_side = None if once else ask_safely(questions.side_by_side)
    steady = bool(same(first, second))
    parameters = ask_safely(questions.parameters) if steady else ((), (), ())
    acting, idle, refused = parameters if isinstance(parameters, tuple) else ((), (), (parameters,))
    response = ask_safely(questions.response)
    found = replace(
        blank,
        deterministic=steady,
        reproducible=reproducible,
        independent=None if once else side_by_side is True,
        reset=ask_safely(questions.reset),
        state=ask_safely(questions.state),
        response=response if isinstance(response, tuple) else (),
        not_finite=tuple(v.name for v, c in zip(component.outputs, first.T, strict=True) if not np.isfinite(c).all()),
        acting=acting,
        without_effect=idle,
        refused=refused,
    )
    strategy, reason = _strategy(found)
    return replace(found, strategy=strategy, reason=reason)


def _strategy(found: FmuProbe) -> tuple[str, str]:
    if not found.deterministic:
        if found.reproducible:
            return PROCESS, "a second instance in one process differs from the first"
        return AGAIN, "its runs differ even in new processes: it is not deterministic"
    if found.reset == RESTORES:
        alone = "; only one instance of it at a time in a process" if found.independent is False else ""
        return RESET, f"after a reset it runs as a new instance{alone}"
    if found.state == RESTORES:
        return STATE, f"its reset is not to be relied on ({found.reset}), but its saved state is restored"
    return AGAIN, f"neither its reset ({found.reset}) nor its saved state ({found.state}) is to be relied on"
