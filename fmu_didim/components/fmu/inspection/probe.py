"""How an FMU behaves: can it be run again, do instances disturb each other, what acts on what.

The trials run in other processes, so that a crash or a hang of the FMU is an answer: those of running it again in a
process each, the others in one that they share, unless instances disturb those after them.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.component import FmuComponent
from fmu_didim.components.fmu.reuse import trials
from fmu_didim.components.fmu.reuse.reset import TIME_LIMIT, Facts, TrialRunner, find_facts, remember_rerun, step_of
from fmu_didim.components.fmu.reuse.trials import ACTS, AT_ONCE, NO_EFFECT, NOT_TRIED, REFUSED, SAME, WHEN, Change
from fmu_didim.components.fmu.settings import RESET, STATE, Rerun

HALF_STEP = 0.02
"""[1] Change of an output by half the communication step, as a fraction of its largest value, above which the FMU is
reported to compute something else: one step of a coarse solver more or less changes less."""
_IN_EVERY_RUN = {"side by side", "response", "parameters", "tunable"}
"""Trials that do what runs do; no run saves a state on its way or takes half the step."""


@dataclass(frozen=True)
class FmuProbe:
    """How an FMU behaves, by :func:`probe_fmu`.

    Attributes:
        file, interface: of the FMU; step_size: in s; steps: of a run; outputs: their number.
        facts: how it runs again; with a failure, nothing else was tried.
        rerun: how it is run again, and why.
        failed: further trial -> why it gave no answer.
        side_by_side: two instances at the same time run as if alone; None if that was not tried.
        saved_state: whether a state saved in a run is restored: ``restores`` or ``does not restore``.
        response: output -> when it first follows a change of the inputs: ``at once`` (between set and get),
            ``after a step``, ``later`` or ``never`` (within the probe).
        undeclared: outputs that follow the inputs at once, though the FMU's ModelStructure says that they do not.
        half_step: change by half the step; reading: by reading outputs between inputs and step as well.
        parameters: name -> effect of a change by 1 % (or 1e-3) before the run: ``acts``, ``no effect``, ``refused`` or
            ``not tried``, because the time was up; tunable: the same for tunable parameters, changed in a run.
    """

    file: str
    interface: str
    step_size: float
    steps: int
    outputs: int
    facts: Facts
    rerun: Rerun
    failed: Mapping[str, str] = field(default_factory=dict)
    side_by_side: bool | None = None
    saved_state: str = ""
    response: Mapping[str, str] = field(default_factory=dict)
    undeclared: tuple[str, ...] = ()
    half_step: Change | None = None
    reading: Change | None = None
    parameters: Mapping[str, str] = field(default_factory=dict)
    tunable: Mapping[str, str] = field(default_factory=dict)

    def lines(self) -> tuple[str, ...]:
        """The result as text, one finding a line."""
        head = f"{self.file}, {self.interface}, {self.steps} steps of {self.step_size:g} s"
        last = f"run it again by: {self.rerun.strategy} ({self.rerun.reason})"
        if self.facts.failure:
            return (head, f"does not run: {self.facts.failure}", last)
        return (head, *self._running(), *self._changing(), *self._parameter_effects(), last)

    def _running(self) -> Iterator[str]:
        facts = self.facts
        in_turn = "the same trajectories" if facts.deterministic else "DIFFERENT trajectories"
        yield f"new instances one after the other: {'FATAL' if facts.single else in_turn}"
        yield f"new processes: {'the same' if facts.reproducible else 'DIFFERENT'} trajectories"
        if self.side_by_side is not None:
            yield f"instances side by side: {'run as if alone' if self.side_by_side else 'DISTURB each other'}"
        yield f"reset: {facts.reset}"
        yield f"state of a new instance: {facts.new_state}"
        if self.saved_state:
            yield f"saved state: {self.saved_state}"
        yield from (f"{trial}: NOT KNOWN, {why}" for trial, why in self.failed.items())

    def _changing(self) -> Iterator[str]:
        if not self.outputs:
            yield "nothing to observe: the FMU has no outputs that are numbers"
            return
        if self.half_step:
            name, change = self.half_step
            size = f"{100 * change:.2g} %"
            other = f"ANOTHER RESULT, {name} by {size}: keep the step that its maker states"
            yield f"half the step: {other if change > HALF_STEP else f'changes outputs by {size} at most'}"
        if self.reading and self.reading[1] > SAME:
            name, change = self.reading
            yield (
                f"outputs read between inputs and step: CHANGE WHAT FOLLOWS, {name} by {100 * change:.2g} %: a case "
                "takes those after the last step, or must say (outputs_after_step) where it needs one that follows "
                "at once"
            )

    def _parameter_effects(self) -> Iterator[str]:
        if self.facts.single:
            yield "parameters: not tried, as a process can hold one instance only"
        against = "AT ONCE AGAINST THE FMU'S OWN DESCRIPTION, by which a loop reads them after each step only"
        acting = {name: self.tunable.get(name) for name, effect in self.parameters.items() if effect == ACTS}
        for title, answers, wanted in (
            *((f"outputs that follow the inputs {when}", self.response, when) for when in WHEN),
            ("outputs that are NaN or infinite", dict.fromkeys(self.facts.not_finite), None),
            (f"outputs that follow the inputs {against}", dict.fromkeys(self.undeclared), None),
            ("parameters that act", self.parameters, ACTS),
            ("parameters WITHOUT EFFECT here", self.parameters, NO_EFFECT),
            ("parameters whose change is refused", self.parameters, REFUSED),
            ("tunable parameters WITHOUT EFFECT in a run", acting, NO_EFFECT),
            ("tunable parameters whose change is refused in a run", self.tunable, REFUSED),
            ("parameters NOT TRIED, the time was up", {**self.parameters, **self.tunable}, NOT_TRIED),
        ):
            if names := [name for name, answer in answers.items() if answer == wanted]:
                yield f"{title}: {', '.join(names)}"


def probe_fmu(
    component: FmuComponent,
    *,
    step_size: float | None = None,
    time_limit_s: float = 60.0,
    whole_s: float = 120.0,
    say: Callable[[str], None] = lambda text: None,
) -> FmuProbe:
    """Try out how an FMU behaves, by runs of 50 steps with pseudo-random held inputs.

    How it is run again is remembered for later runs.

    Args:
        step_size: in s; default: sample time of the component, step of the FMU's default experiment, or 1 ms.
        time_limit_s: for each trial; whole_s: for all of them, of which those of running it again are done in any case
            and the others are left out when the time is up.
        say: called with the name of each trial before it starts.
    """
    component, ends = replace(component, isolated=False), clock.monotonic() + whole_s
    h = step_size or step_of(component)
    say("whether it can be run again")
    with closing(TrialRunner(component, h, min(time_limit_s, TIME_LIMIT))) as run:
        facts, found = find_facts(run), {}
        if not facts.failure:
            run.shared = facts.deterministic
            run.unfinished.clear()
            found = _further_trials(run, facts, time_limit_s, ends, say)
            more = [name for name in (*run.crashed, *run.unfinished) if name in _IN_EVERY_RUN]
            facts = replace(facts, crashed=(*facts.crashed, *more), unfinished=(*facts.unfinished, *run.unfinished))
    rerun = remember_rerun(component, facts)
    is_disturbed = "side by side" in found.get("failed", ()) or found.get("side_by_side") is False
    if is_disturbed and rerun.strategy in (RESET, STATE):
        rerun = replace(rerun, reason=f"{rerun.reason}; only one instance of it at a time in a process")
    steps, outputs = trials.step_count(component, h), len(component.outputs)
    return FmuProbe(component.path.name, component.interface.kind, h, steps, outputs, facts, rerun, **found)


def _further_trials(
    run: TrialRunner, facts: Facts, limit_s: float, ends: float, say: Callable[[str], None]
) -> dict[str, Any]:
    """Attribute of the probe -> answer."""
    component = run.component
    has_effects = facts.deterministic and bool(component.outputs)
    possible: dict[Callable[..., Any], bool] = {
        trials.side_by_side: not (facts.single or component.interface.once_per_process),
        trials.parameters: has_effects,
        trials.tunable: has_effects,
        trials.response: not facts.single,
        trials.half_step: not facts.single,
        trials.reading: facts.deterministic,
        trials.saved_state: True,
    }
    found: dict[str, Any] = {}
    failed: dict[str, str] = {}
    for trial in (trial for trial, is_possible in possible.items() if is_possible):
        title, run.limit_s = trials.title(trial), min(limit_s, ends - clock.monotonic())
        if run.limit_s <= 0:
            run.unfinished.append(title)
            failed[title] = "the time was up"
            continue
        say(title)
        own_limit = [run.limit_s / 2] * (trial in (trials.parameters, trials.tunable))  # by which they end themselves
        answer = run(trial, *own_limit)
        if isinstance(answer, FmuDidimError):
            failed[title] = trials.in_words(answer)
        else:
            found[trial.__name__] = answer
    if (stated := component.feedthrough()) is not None:
        declared = {output for output, _ in stated}
        at_once = [name for name, when in found.get("response", {}).items() if when == AT_ONCE]
        found["undeclared"] = tuple(name for name in at_once if name not in declared)
    return {**found, "failed": failed}
