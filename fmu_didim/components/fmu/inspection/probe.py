"""How an FMU behaves: can it be run again, do instances get in each other's way, what acts on what.

The questions are put in other processes, so that an FMU that crashes or hangs there answers with just that: the first
ones, which tell what instances do to each other, in one each; the others in one that they share, where instances do no
harm to those after them.
"""

from __future__ import annotations

import hashlib
import json
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmu_didim.base.cache import cache_directory
from fmu_didim.base.errors import SimulationError
from fmu_didim.components.fmu.component import FmuComponent
from fmu_didim.components.fmu.isolation.process import ProcessEndedError, Reused
from fmu_didim.components.fmu.reuse import trials
from fmu_didim.components.fmu.reuse.reset import (
    Facts,
    ask_facts,
    choose,
    keep,
    read_kept,
    remember_rerun,
    said,
    step_of,
    trial_name,
)
from fmu_didim.components.fmu.reuse.trials import AFTER_A_STEP, AT_ONCE, LATER, NEVER, SAME, STEPS
from fmu_didim.components.fmu.settings import PROCESS, RESET, STATE

HALF_STEP = 0.02
"""[1] Change of an output by half the communication step, as a fraction of its largest value, above which the FMU is
said to compute something else: what one step of a coarse solver more or less does stays below it."""

_FORMAT = 8
FIRST_QUESTIONS = 4
"""Questions about running again at most, among which the time for all is divided."""
SHORTEST_LIMIT = 10.0
"""Seconds that such a question gets at least."""


@dataclass(frozen=True)
class FmuProbe:
    """What :func:`probe_fmu` found.

    Attributes:
        file, digest, interface: what was probed; step_size: in s; steps: of a run.
        failure: why the FMU does not run at all; empty if it does. Then nothing else was probed.
        single: a second instance in one process, after the first, is fatal or hangs.
        deterministic: two new instances, one after the other in one process, give the same trajectory.
        reproducible: so do two new processes.
        independent: two instances side by side run as if alone; None if it allows only one.
        reset, new_state: whether a reset, or the state saved right after the instantiation, gives a new instance,
            parameters changed in between included; state: whether a state saved in a run is restored:
            ``restores``, ``does not restore``, or why it could not be tried.
        response: output -> when it first follows a change of the inputs: ``at once`` (between set and get),
            ``after a step``, ``later`` or ``never`` (within the probe).
        not_finite: outputs that became NaN or infinite.
        half_step: the output that half the step changes most, and by which fraction of its largest value; None where
            that could not be tried; half_step_said: why.
        reading: the output that changes most where outputs are read between inputs and step, too, and by which
            fraction.
        undeclared: outputs that follow the inputs at once, though the FMU's ModelStructure says that they do not.
        outputs: their number; with none, nothing can be seen of a parameter.
        acting, without_effect, refused: parameters by what a change of 1 % (or 1e-3) before the run did; left: those
            that were not tried, because the time was up.
        idle_in_a_run, refused_in_a_run: tunable parameters that act, but not when they are changed in a run, and those
            whose change is refused then.
        strategy: how to run it again: ``reset``, ``state``, ``re-instantiate`` or ``fresh process``; reason: why.
    """

    file: str
    digest: str
    interface: str
    step_size: float
    steps: int = STEPS
    failure: str = ""
    deterministic: bool = False
    reproducible: bool = False
    independent: bool | None = None
    reset: str = ""
    new_state: str = ""
    state: str = ""
    response: tuple[tuple[str, str], ...] = ()
    not_finite: tuple[str, ...] = ()
    half_step: tuple[str, float] | None = None
    half_step_said: str = ""
    reading: tuple[str, float] | None = None
    undeclared: tuple[str, ...] = ()
    outputs: int = 0
    single: bool = False
    acting: tuple[str, ...] = ()
    without_effect: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    idle_in_a_run: tuple[str, ...] = ()
    refused_in_a_run: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    strategy: str = PROCESS
    reason: str = ""

    def lines(self) -> tuple[str, ...]:
        """The result as text, one finding a line."""
        head = f"{self.file}, {self.interface}, {self.steps} steps of {self.step_size:g} s"
        if self.failure:
            return (head, f"does not run: {self.failure}", f"run it again by: {self.strategy} ({self.reason})")
        side = {True: "run as if alone", False: "DISTURB each other", None: "not allowed by the FMU"}[self.independent]
        alike = "FATAL" if self.single else "the same trajectories" if self.deterministic else "DIFFERENT trajectories"
        found = [
            head,
            f"new instances one after the other: {alike}",
            f"new processes: {'the same' if self.reproducible else 'DIFFERENT'} trajectories",
            f"instances side by side: {'FATAL' if self.single else side}",
            f"reset: {self.reset}",
            f"state of a new instance: {self.new_state}",
            f"saved state: {self.state}",
            f"half the step: {self._half_step()}",
        ]
        if self.reading is not None and self.reading[1] > SAME:
            name, change = self.reading
            found.append(
                f"outputs read between inputs and step: CHANGE WHAT FOLLOWS, {name} by {100 * change:.2g} %: take them "
                "after the step (outputs_after_step) where the loop needs them at once"
            )
        if not self.outputs:
            found.append("nothing to observe: the FMU has no outputs that are numbers")
        if self.single:
            found.append("parameters: not tried, as a process bears one instance only")
        for when in (AT_ONCE, AFTER_A_STEP, LATER, NEVER):
            names = [name for name, answer in self.response if answer == when]
            if names:
                found.append(f"outputs that follow the inputs {when}: {', '.join(names)}")
        groups = (
            ("outputs that are NaN or infinite", self.not_finite),
            (
                "outputs that follow the inputs AT ONCE AGAINST THE FMU'S OWN DESCRIPTION, by which a loop reads them "
                "after each step only",
                self.undeclared,
            ),
            ("parameters that act", self.acting),
            ("parameters WITHOUT EFFECT here", self.without_effect),
            ("parameters whose change is refused", self.refused),
            ("tunable parameters WITHOUT EFFECT in a run", self.idle_in_a_run),
            ("tunable parameters whose change is refused in a run", self.refused_in_a_run),
            ("parameters NOT TRIED, the time was up", self.left),
        )
        found += [f"{title}: {', '.join(names)}" for title, names in groups if names]
        return (*found, f"run it again by: {self.strategy} ({self.reason})")

    def _half_step(self) -> str:
        if self.half_step is None:
            return self.half_step_said or "not tried"
        name, change = self.half_step
        if change > HALF_STEP:
            return f"ANOTHER RESULT, {name} by {100 * change:.2g} %: keep the step that its maker states"
        return f"outputs change by {100 * change:.2g} % at most" if name else "nothing to observe"


def probe_fmu(
    component: FmuComponent,
    *,
    step_size: float | None = None,
    time_limit_s: float = 60.0,
    whole_s: float = 120.0,
    fresh: bool = False,
    say: Callable[[str], None] = lambda text: None,
) -> FmuProbe:
    """Try out how an FMU behaves, by runs of 50 steps with pseudo-random held inputs.

    The answer is kept in the cache under the content of the FMU and the values of its parameters.

    Args:
        step_size: in s; default: sample time of the component, step of the FMU's default experiment, or 1 ms.
        time_limit_s: for each of the questions; whole_s: for all of them: what is left then is not asked, and said so.
        fresh: ask again even if the answer is known.
        say: called with each question before it is put.
    """
    component = replace(component, isolated=False)
    h = step_size or step_of(component)
    path = cache_directory() / "probes" / f"{component.digest}-{_key(component, h)}.json"
    known = None if fresh else read_kept(path, _frozen)
    if known is not None:
        return replace(known, file=component.path.name)
    found, may_be_kept = _probe(component, h, _Asking(component, h, time_limit_s, whole_s, say))
    if may_be_kept:
        keep(path, found)
    return found


def _key(component: FmuComponent, h: float) -> str:
    values = [
        component.parameter_values(),
        dict(component.options),
        component.solver,
        component.substeps,
        h,
        component.tolerance,
    ]
    text = json.dumps([_FORMAT, component.digest, component.interface.kind, values], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _frozen(response: Any = (), **known: Any) -> FmuProbe:
    """A probe of what JSON has kept, tuples as lists."""
    rest: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in known.items()}
    return FmuProbe(response=tuple(tuple(pair) for pair in response), **rest)


class _Asking:
    """Puts the questions, all within a time.

    Attributes:
        ended, unfinished: the questions in which the FMU ended its process, and that did not come to their end.
        fresh: whether each question gets a process of its own.
    """

    def __init__(
        self, component: FmuComponent, h: float, limit: float, whole: float, say: Callable[[str], None]
    ) -> None:
        self._component, self._h, self._limit, self._say = component, h, limit, say
        self._first = min(limit, max(whole / FIRST_QUESTIONS, SHORTEST_LIMIT))
        self._ends = clock.monotonic() + whole
        self._process = Reused(str(component.path))
        self.ended: list[str] = []
        self.unfinished: list[str] = []
        self.fresh = False

    @property
    def left_s(self) -> float:
        """Seconds for the next question."""
        return min(self._limit, self._ends - clock.monotonic())

    def facts(self) -> Facts:
        """How it is run again."""
        self._say("whether it can be run again")
        return ask_facts(self._component, self._h, self._first)

    def __call__(self, question: Callable[..., Any], *arguments: Any) -> Any:
        name = trial_name(question)
        if self.left_s <= 0:
            self.unfinished.append(name)
            raise SimulationError("Not asked: the time was up.")
        self._say(name)
        if self.fresh:
            self._process.close()
        try:
            return self._process.run(question, self._component, self._h, *arguments, time_limit=self.left_s)
        except ProcessEndedError as error:
            (self.ended if error.by_fmu else self.unfinished).append(name)
            raise

    def close(self) -> None:
        self._process.close()


def _probe(component: FmuComponent, h: float, ask: _Asking) -> tuple[FmuProbe, bool]:
    """What was found, and whether all of it was measured to its end."""
    facts = ask.facts()
    steps = trials.step_count(component, h)
    blank = FmuProbe(component.path.name, component.digest, component.interface.kind, h, steps)
    rerun = choose(facts)
    if facts.first is None:
        remember_rerun(component, rerun, facts)
        return replace(blank, failure=facts.failure, strategy=rerun.strategy, reason=rerun.reason), False
    try:
        found = _answers(component, replace(blank, single=facts.single), facts, ask)
    finally:
        ask.close()
    of_a_run = {name for name in (*ask.ended, *ask.unfinished) if name in _OF_A_RUN}
    facts = replace(facts, crashed=facts.crashed | of_a_run, unfinished=(*facts.unfinished, *ask.unfinished))
    rerun = remember_rerun(component, choose(facts), facts)
    alone = found.independent is False and not facts.single and rerun.strategy in (RESET, STATE)
    reason = rerun.reason + ("; only one instance of it at a time in a process" if alone else "")
    return replace(found, strategy=rerun.strategy, reason=reason), facts.may_be_kept and not found.left


_OF_A_RUN = {trial_name(question) for question in (trials.side_by_side, trials.response)} | {
    trial_name(question) for question in (trials.parameters, trials.tunable)
}
"""Questions that do what runs do; no run asks for a saved state or for half the step."""


def _answers(component: FmuComponent, blank: FmuProbe, facts: Facts, ask: _Asking) -> FmuProbe:
    assert facts.first is not None
    ask.fresh = not facts.deterministic
    once = component.interface.once_per_process or facts.single
    side_by_side = None if once else said(ask, trials.side_by_side)
    seen = facts.deterministic and bool(component.outputs)
    nothing: tuple[tuple[str, ...], ...] = ((), (), (), ())
    acting, idle, refused, left = _four(said(_with_time(ask), trials.parameters)) if seen else nothing
    in_a_run = _four(said(_with_time(ask), trials.tunable)) if seen else nothing
    response = () if facts.single else said(ask, trials.response)
    response = response if isinstance(response, tuple) else ()
    half = None if facts.single else said(ask, trials.half_step)
    reading = None if facts.single or not facts.deterministic else said(ask, trials.reading)
    finite = [bool(np.isfinite(column).all()) for column in facts.first.T]
    return replace(
        blank,
        deterministic=facts.deterministic,
        reproducible=facts.reproducible,
        independent=None if component.interface.once_per_process else side_by_side is True,
        reset=facts.reset,
        new_state=facts.new_state,
        state=said(ask, trials.state),
        response=response,
        undeclared=_undeclared(response, component.feedthrough()),
        half_step=half if isinstance(half, tuple) else None,
        half_step_said=half if isinstance(half, str) else "",
        reading=reading if isinstance(reading, tuple) else None,
        outputs=len(component.outputs),
        not_finite=tuple(v.name for v, fine in zip(component.outputs, finite, strict=True) if not fine),
        acting=acting,
        without_effect=idle,
        refused=refused,
        idle_in_a_run=tuple(name for name in in_a_run[1] if name in acting),
        refused_in_a_run=in_a_run[2],
        left=tuple(dict.fromkeys((*left, *in_a_run[3]))),
    )


def _undeclared(response: tuple[tuple[str, str], ...], stated: frozenset[tuple[str, str]] | None) -> tuple[str, ...]:
    """Outputs that follow at once, though nothing of the kind is stated; none where nothing is stated at all."""
    if stated is None:
        return ()
    known = {output for output, _ in stated}
    return tuple(name for name, when in response if when == AT_ONCE and name not in known)


def _with_time(ask: _Asking) -> Callable[..., Any]:
    """Questions that end by themselves when half of their time is over."""
    return lambda question: ask(question, ask.left_s / 2)


def _four(answer: Any) -> tuple[tuple[str, ...], ...]:
    return answer if isinstance(answer, tuple) else ((), (), (answer,), ())
