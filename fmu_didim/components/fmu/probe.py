"""How an FMU behaves: can it be run again, do instances get in each other's way, what acts on what.

Every question is put in a process of its own, so that an FMU that crashes or hangs there answers with just that.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmu_didim.cache import cache_directory
from fmu_didim.components.fmu import questions
from fmu_didim.components.fmu.component import FmuComponent
from fmu_didim.components.fmu.process import ProcessEndedError, run_in_fresh_process
from fmu_didim.components.fmu.questions import AFTER_A_STEP, AT_ONCE, LATER, NEVER, STEPS
from fmu_didim.components.fmu.rerun import ask_facts, choose, keep, read_kept, remember_rerun, said, step_of, trial_name
from fmu_didim.components.fmu.settings import PROCESS, RESET, STATE

_FORMAT = 4


@dataclass(frozen=True)
class FmuProbe:
    """What :func:`probe_fmu` found.

    Attributes:
        file, digest, interface: what was probed; step_size: in s.
        failure: why the FMU does not run at all; empty if it does. Then nothing else was probed.
        deterministic: two new instances, one after the other in one process, give the same trajectory.
        reproducible: so do two new processes.
        independent: two instances side by side run as if alone; None if it allows only one.
        reset, new_state: whether a reset, or the state saved right after the instantiation, gives a new instance,
            parameters changed in between included; state: whether a state saved in a run is restored:
            ``restores``, ``does not restore``, or why it could not be tried.
        response: output -> when it first follows a change of the inputs: ``at once`` (between set and get),
            ``after a step``, ``later`` or ``never`` (within the probe).
        not_finite: outputs that became NaN or infinite.
        acting, without_effect, refused: parameters by what a change of 1 % (or 1e-3) before the run did.
        idle_in_a_run, refused_in_a_run: tunable parameters that act, but not when they are changed in a run, and those
            whose change is refused then.
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
    new_state: str = ""
    state: str = ""
    response: tuple[tuple[str, str], ...] = ()
    not_finite: tuple[str, ...] = ()
    acting: tuple[str, ...] = ()
    without_effect: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    idle_in_a_run: tuple[str, ...] = ()
    refused_in_a_run: tuple[str, ...] = ()
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
            f"state of a new instance: {self.new_state}",
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
            ("tunable parameters WITHOUT EFFECT in a run", self.idle_in_a_run),
            ("tunable parameters whose change is refused in a run", self.refused_in_a_run),
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
    h = step_size or step_of(component)
    path = cache_directory() / "probes" / f"{component.digest}-{_key(component, h)}.json"
    known = None if fresh else read_kept(path, _frozen)
    if known is not None:
        return replace(known, file=component.path.name)
    found, may_be_kept = _probe(component, h, time_limit_s)
    if may_be_kept:
        keep(path, found)
    return found


def _key(component: FmuComponent, h: float) -> str:
    values = [component.parameter_values(), dict(component.options), component.solver, component.substeps, h]
    text = json.dumps([_FORMAT, component.digest, component.interface.kind, values], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _frozen(response: Any = (), **known: Any) -> FmuProbe:
    """A probe of what JSON has kept, tuples as lists."""
    rest: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in known.items()}
    return FmuProbe(response=tuple(tuple(pair) for pair in response), **rest)


def _probe(component: FmuComponent, h: float, limit: float) -> tuple[FmuProbe, bool]:
    """What was found, and whether all of it was measured to its end."""
    ended: list[str] = []
    unfinished: list[str] = []

    def ask(question: Callable[..., Any]) -> Any:
        try:
            return run_in_fresh_process(question, component, h, where=str(component.path), time_limit=limit)
        except ProcessEndedError as error:
            (ended if error.by_fmu else unfinished).append(trial_name(question))
            raise

    facts = ask_facts(component, h, limit)
    blank = FmuProbe(component.path.name, component.digest, component.interface.kind, h)
    rerun = choose(facts)
    if facts.first is None:
        remember_rerun(component, rerun, facts)
        return replace(blank, failure=facts.failure, strategy=rerun.strategy, reason=rerun.reason), False
    once = component.interface.once_per_process
    side_by_side = None if once else said(ask, questions.side_by_side)
    nothing: tuple[tuple[str, ...], ...] = ((), (), ())
    acting, idle, refused = _three(said(ask, questions.parameters)) if facts.deterministic else nothing
    in_a_run = _three(said(ask, questions.tunable)) if facts.deterministic else nothing
    response = said(ask, questions.response)
    finite = [bool(np.isfinite(column).all()) for column in facts.first.T]
    found = replace(
        blank,
        deterministic=facts.deterministic,
        reproducible=facts.reproducible,
        independent=None if once else side_by_side is True,
        reset=facts.reset,
        new_state=facts.new_state,
        state=said(ask, questions.state),
        response=response if isinstance(response, tuple) else (),
        not_finite=tuple(v.name for v, fine in zip(component.outputs, finite, strict=True) if not fine),
        acting=acting,
        without_effect=idle,
        refused=refused,
        idle_in_a_run=tuple(name for name in in_a_run[1] if name in acting),
        refused_in_a_run=in_a_run[2],
    )
    of_a_run = {name for name in (*ended, *unfinished) if name != questions.state.__name__}  # that no run asks for
    facts = replace(facts, crashed=facts.crashed | of_a_run, unfinished=(*facts.unfinished, *unfinished))
    rerun = remember_rerun(component, choose(facts), facts)
    alone = found.independent is False and rerun.strategy in (RESET, STATE)
    reason = rerun.reason + ("; only one instance of it at a time in a process" if alone else "")
    return replace(found, strategy=rerun.strategy, reason=reason), facts.may_be_kept


def _three(answer: Any) -> tuple[tuple[str, ...], ...]:
    return answer if isinstance(answer, tuple) else ((), (), (answer,))
