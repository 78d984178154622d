"""How an FMU behaves: can it be run again, do instances disturb each other, what acts on what.

The trials run in other processes, so that an FMU that crashes or hangs gives just that as the answer: those of running
it again in a process each, the others in one that they share, unless instances disturb those after them.
"""

from __future__ import annotations

import hashlib
import json
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from fmu_didim.base.cache import cache_directory, read_record, write_record
from fmu_didim.components.fmu.component import FmuComponent
from fmu_didim.components.fmu.reuse import trials
from fmu_didim.components.fmu.reuse.reset import Facts, TrialRunner, choose, find_facts, remember_rerun, step_of
from fmu_didim.components.fmu.reuse.trials import (
    ACTS,
    AFTER_A_STEP,
    AT_ONCE,
    LATER,
    NEVER,
    NO_EFFECT,
    NOT_TRIED,
    REFUSED,
    SAME,
    STEPS,
    Change,
)
from fmu_didim.components.fmu.settings import RESET, STATE, Rerun

HALF_STEP = 0.02
"""[1] Change of an output by half the communication step, as a fraction of its largest value, above which the FMU is
reported to compute something else: one step of a coarse solver more or less changes less."""
FIRST_TRIALS = 4
"""[1] Trials of running again at most, among which the time for all is divided."""
SHORTEST_LIMIT = 10.0
"""[s] For such a trial at least, as a process takes seconds to start on a busy machine."""
_FORMAT = 9
_IN_EVERY_RUN = {"side by side", "response", "parameters", "tunable"}
"""Trials that do what runs do; no run saves a state on its way or takes half the step."""


@dataclass(frozen=True)
class FmuProbe:
    """What :func:`probe_fmu` found.

    Attributes:
        file, digest, interface: of the FMU; step_size: in s; steps: of a run.
        facts: what trials of running it again have shown; with a failure, nothing else was tried.
        rerun: how it is run again, and why.
        independent: two instances side by side run as if alone; None if it allows only one.
        state: whether a state saved in a run is restored: ``restores``, ``does not restore``, or why it is unknown.
        response: output -> when it first follows a change of the inputs: ``at once`` (between set and get),
            ``after a step``, ``later`` or ``never`` (within the probe).
        undeclared: outputs that follow the inputs at once, though the FMU's ModelStructure says that they do not.
        half_step: what half the step changes, or why that is unknown.
        reading: what changes if outputs are read between inputs and step as well, or why that is unknown.
        outputs: their number; without outputs, parameters have nothing to act on.
        parameters: name -> what a change of 1 % (or 1e-3) before the run does: ``acts``, ``no effect``, ``refused`` or
            ``not tried``, because the time was up; or why nothing is known; tunable: the same for tunable parameters,
            changed in a run.
    """

    file: str
    digest: str
    interface: str
    step_size: float
    facts: Facts
    rerun: Rerun
    steps: int = STEPS
    independent: bool | None = None
    state: str = ""
    response: Mapping[str, str] = field(default_factory=dict)
    undeclared: tuple[str, ...] = ()
    half_step: Change | str = "not tried"
    reading: Change | str = "not tried"
    outputs: int = 0
    parameters: Mapping[str, str] | str = field(default_factory=dict)
    tunable: Mapping[str, str] | str = field(default_factory=dict)

    def lines(self) -> tuple[str, ...]:
        """The result as text, one finding a line."""
        facts = self.facts
        head = f"{self.file}, {self.interface}, {self.steps} steps of {self.step_size:g} s"
        last = f"run it again by: {self.rerun.strategy} ({self.rerun.reason})"
        if facts.failure:
            return (head, f"does not run: {facts.failure}", last)
        side = {True: "run as if alone", False: "DISTURB each other", None: "not allowed by the FMU"}[self.independent]
        in_turn = "the same trajectories" if facts.deterministic else "DIFFERENT trajectories"
        found = [
            head,
            f"new instances one after the other: {'FATAL' if facts.single else in_turn}",
            f"new processes: {'the same' if facts.reproducible else 'DIFFERENT'} trajectories",
            f"instances side by side: {'FATAL' if facts.single else side}",
            f"reset: {facts.reset}",
            f"state of a new instance: {facts.new_state}",
            f"saved state: {self.state}",
            f"half the step: {_half_step(self.half_step)}",
        ]
        if not isinstance(self.reading, str) and self.reading[1] > SAME:
            name, change = self.reading
            found.append(
                f"outputs read between inputs and step: CHANGE WHAT FOLLOWS, {name} by {100 * change:.2g} %: take them "
                "after the step (outputs_after_step) where the loop needs them at once"
            )
        if not self.outputs:
            found.append("nothing to observe: the FMU has no outputs that are numbers")
        if facts.single:
            found.append("parameters: not tried, as a process can hold one instance only")
        failed = {"parameters": self.parameters, "tunable parameters in a run": self.tunable}
        found += [f"{title}: NOT TRIED, {why}" for title, why in failed.items() if isinstance(why, str)]
        found += [f"{title}: {', '.join(names)}" for title, names in self._groups().items() if names]
        return (*found, last)

    def _groups(self) -> dict[str, list[str]]:
        """Title -> outputs or parameters."""
        follow = {f"outputs that follow the inputs {when}": when for when in (AT_ONCE, AFTER_A_STEP, LATER, NEVER)}
        against = (
            "outputs that follow the inputs AT ONCE AGAINST THE FMU'S OWN DESCRIPTION, by which a loop reads them "
            "after each step only"
        )
        idle = [name for name in _having(self.tunable, NO_EFFECT) if name in _having(self.parameters, ACTS)]
        left = (*_having(self.parameters, NOT_TRIED), *_having(self.tunable, NOT_TRIED))
        return {
            **{title: _having(self.response, when) for title, when in follow.items()},
            "outputs that are NaN or infinite": list(self.facts.not_finite),
            against: list(self.undeclared),
            "parameters that act": _having(self.parameters, ACTS),
            "parameters WITHOUT EFFECT here": _having(self.parameters, NO_EFFECT),
            "parameters whose change is refused": _having(self.parameters, REFUSED),
            "tunable parameters WITHOUT EFFECT in a run": idle,
            "tunable parameters whose change is refused in a run": _having(self.tunable, REFUSED),
            "parameters NOT TRIED, the time was up": list(dict.fromkeys(left)),
        }


def _having(answers: Mapping[str, str] | str, answer: str) -> list[str]:
    return [] if isinstance(answers, str) else [name for name, given in answers.items() if given == answer]


def _half_step(found: Change | str) -> str:
    if isinstance(found, str):
        return found
    name, change = found
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
        time_limit_s: for each trial; whole_s: for all of them: what is left then is not tried, and reported so.
        fresh: try again even if the answer is known.
        say: called with the name of each trial before it starts.
    """
    component = replace(component, isolated=False)
    h = step_size or step_of(component)
    path = cache_directory() / "probes" / f"{component.digest}-{_key(component, h)}.json"
    try:
        known = None if fresh else _from_record(read_record(path) or {})
    except (KeyError, TypeError):  # not known, or written by another version
        known = None
    if known is not None:
        return replace(known, file=component.path.name)
    found, is_final = _probe(component, h, time_limit_s, whole_s, say)
    if is_final:
        write_record(path, asdict(found))
    return found


def _key(component: FmuComponent, h: float) -> str:
    values = (component.parameter_values(), dict(component.options), component.solver, component.substeps)
    content = [_FORMAT, component.digest, component.interface.kind, [*values, h, component.tolerance]]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def _from_record(record: Mapping[str, Any]) -> FmuProbe:
    def tuples(values: Mapping[str, Any]) -> dict[str, Any]:
        return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}

    facts, rerun = Facts(**tuples(record["facts"])), Rerun(**record["rerun"])
    return FmuProbe(**{**tuples(record), "facts": facts, "rerun": rerun})


def _probe(
    component: FmuComponent, h: float, limit_s: float, whole_s: float, say: Callable[[str], None]
) -> tuple[FmuProbe, bool]:
    """What was found, and whether every trial came to its end."""
    ends = clock.monotonic() + whole_s
    say("whether it can be run again")
    facts = find_facts(TrialRunner(component, h, min(limit_s, max(whole_s / FIRST_TRIALS, SHORTEST_LIMIT))))
    steps = trials.step_count(component, h)
    found = FmuProbe(component.path.name, component.digest, component.interface.kind, h, facts, choose(facts), steps)
    if facts.failure:
        remember_rerun(component, found.rerun, facts)
        return found, False
    run = TrialRunner(component, h, limit_s, ends - clock.monotonic(), shared=facts.deterministic, progress=say)
    try:
        found = _further_trials(component, found, run)
    finally:
        run.close()
    more = [name for name in (*run.crashed, *run.unfinished) if name in _IN_EVERY_RUN]
    facts = replace(facts, crashed=(*facts.crashed, *more), unfinished=(*facts.unfinished, *run.unfinished))
    rerun = remember_rerun(component, choose(facts), facts)
    if found.independent is False and not facts.single and rerun.strategy in (RESET, STATE):
        rerun = replace(rerun, reason=f"{rerun.reason}; only one instance of it at a time in a process")
    is_complete = not (_having(found.parameters, NOT_TRIED) or _having(found.tunable, NOT_TRIED))
    return replace(found, facts=facts, rerun=rerun), facts.is_final and is_complete


def _further_trials(component: FmuComponent, found: FmuProbe, run: TrialRunner) -> FmuProbe:
    facts = found.facts
    one_only = component.interface.once_per_process
    side_by_side = not (one_only or facts.single) and run(trials.side_by_side).value is True
    parameters, tunable, response = found.parameters, found.tunable, found.response
    half_step = reading = found.half_step
    if facts.deterministic and component.outputs:
        # these end by themselves when half of their time is over
        parameters = run(trials.parameters, run.left_s / 2).in_words
        tunable = run(trials.tunable, run.left_s / 2).in_words
    if not facts.single:
        response = run(trials.response).value or response
        half_step = run(trials.half_step).in_words
    if facts.deterministic:
        reading = run(trials.reading).in_words
    stated = component.feedthrough()
    declared = None if stated is None else {output for output, _ in stated}
    undeclared = [name for name, when in response.items() if when == AT_ONCE and name not in (declared or ())]
    return replace(
        found, independent=None if one_only else side_by_side, state=run(trials.saved_state).in_words,
        response=response, undeclared=() if declared is None else tuple(undeclared), half_step=half_step,
        reading=reading, outputs=len(component.outputs), parameters=parameters, tunable=tunable,
    )  # fmt: skip
