"""How an FMU is run again: tried out once for its content, then remembered.

Not every FMU is as new after ``fmiXReset``. So a reset is used only if a trial has shown that it works, with the values
of all parameters changed before; else the state saved right after the instantiation; else a new instance; and if that
differs from the first one, a new process. An FMU that crashes or hangs in an ordinary run gets a process of its own; a
way to run it again that crashes is not used.
"""

from __future__ import annotations

import hashlib
import json
import logging
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.cache import cache_directory, read_record, write_record
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.isolation.process import START_LIMIT, ProcessEndedError, Worker, hold, run_held
from fmu_didim.components.fmu.reuse import trials
from fmu_didim.components.fmu.reuse.trials import RESTORES
from fmu_didim.components.fmu.settings import AGAIN, AUTO, PROCESS, RESET, STATE, FmuSettings, Rerun

QUICK = 0.1
"""[1] Fraction of the time limit within which a single instance must run, so that the timeout of a trial with two of
them is not the fault of a busy machine."""
TIME_LIMIT = 30.0
"""[s] For each trial: far more than 50 steps of any sensible model take."""
TOGETHER = "several instances in one process"
"""The trial in which an FMU crashed, if each of the ways to run it again works alone."""
_FORMAT = 5
_log = logging.getLogger(__name__)
_lock = threading.Lock()
_known: dict[Path, Rerun] = {}


class TrialRunner:
    """Runs trials of an FMU in other processes.

    Attributes:
        limit_s: for each trial; shared: whether the trials share a process, as long as it lives.
        crashed: the trials in which the FMU ended its process.
        unfinished: the trials that took too long, or whose process was killed or did not start. A busy machine may be
            the reason, so what follows from them is not kept for later runs.
    """

    def __init__(self, component: FmuSettings, h: float, limit_s: float) -> None:
        self.component, self.h, self.limit_s, self.shared = component, h, limit_s, False
        self._worker: Worker | None = None
        self.crashed: list[str] = []
        self.unfinished: list[str] = []

    def __call__(self, trial: Callable[..., Any], *arguments: Any) -> Any:
        """Run a trial; returns its value, or the FmuDidimError that ended it."""
        try:
            self._worker = self._worker or Worker(str(self.component.path), self.limit_s)
            held = trial, (self.component, self.h, *arguments)
            self._worker.request("start", hold, *held, limit=max(self.limit_s, START_LIMIT))
            return self._worker.request("the run", run_held, limit=self.limit_s)
        except FmuDidimError as error:
            if isinstance(error, ProcessEndedError):
                self.close()
                (self.crashed if error.by_fmu else self.unfinished).append(trials.title(trial))
            return error
        finally:
            if not self.shared:
                self.close()

    def close(self) -> None:
        """End the process; the next trial starts a new one."""
        if self._worker is not None:
            self._worker.close()
            self._worker = None


@dataclass(frozen=True)
class Facts:
    """How an FMU runs again, by trials.

    Attributes:
        failure: why it does not run; empty if it does; crashed: the trials that ended their process.
        not_finite: outputs that became NaN or infinite.
        deterministic: a second new instance in its process gives the same trajectory; reproducible: one in a new
            process does.
        reset, new_state: ``restores``, ``does not restore``, or why that could not be tried: whether a reset, or the
            state saved right after the instantiation, gives a new instance, changed parameters included.
        single: a second instance in its process, after the first, was fatal, hung or was refused.
        unfinished: as for :class:`TrialRunner`.
    """

    failure: str = ""
    crashed: tuple[str, ...] = ()
    not_finite: tuple[str, ...] = ()
    deterministic: bool = False
    reproducible: bool = False
    reset: str = ""
    new_state: str = ""
    single: bool = False
    unfinished: tuple[str, ...] = ()


def find_facts(run: TrialRunner) -> Facts:
    """Try an FMU out: in one process if that goes well, else in one process for each trial."""
    found = run(trials.in_turn, 2, (RESET, STATE))
    has_crashed = isinstance(found, ProcessEndedError)
    if has_crashed:
        found = run(trials.in_turn, 2)
    if isinstance(found, FmuDidimError):
        found = run(trials.in_turn, 1)
    if isinstance(found, FmuDidimError):
        failure = " ".join(str(found).split())
        if not isinstance(run(trials.quiet), FmuDidimError):  # pseudo-random inputs may be more than the model supports
            failure = f"with pseudo-random inputs, while it does with its inputs at their start values: {failure}"
        return Facts(failure, ("runs",) * has_crashed, unfinished=tuple(run.unfinished))
    (first, *second), answers, took = found
    crashed: tuple[str, ...] = ()
    if not answers:
        tried = {way: run(trials.restarted, first, way) for way in (RESET, STATE)}
        answers = [trials.in_words(answer) for answer in tried.values()]
        crashed = ("one instance after the other in one process",) * has_crashed
        if second:
            crashed = tuple(way for way, a in tried.items() if isinstance(a, ProcessEndedError)) or (TOGETHER,)
    is_finite, repeated = np.isfinite(first).all(axis=0), run(trials.once)
    # An FMU that is quick alone hung with two instances, and no busy machine was to blame.
    unfinished = () if not second and took < QUICK * run.limit_s else tuple(dict.fromkeys(run.unfinished))
    return Facts(
        crashed=crashed,
        not_finite=tuple(v.name for v, finite in zip(run.component.outputs, is_finite, strict=True) if not finite),
        deterministic=bool(second) and trials.same(first, second[0]),
        reproducible=not isinstance(repeated, FmuDidimError) and trials.same(first, repeated),
        reset=answers[0], new_state=answers[1], single=not second, unfinished=unfinished,
    )  # fmt: skip


def choose(facts: Facts) -> Rerun:
    """The cheapest way to run the FMU again that gives the same as a new instance."""
    if facts.failure:
        if facts.crashed:
            return Rerun(PROCESS, "it crashed or hung when it was tried", isolated=True)
        return Rerun(AGAIN, "it could not be tried: it does not run here")
    way = RESET if facts.reset == RESTORES else STATE if facts.new_state == RESTORES else ""
    if facts.single:
        why = f"a second instance in one process is {'fatal or hangs' if facts.crashed else 'refused'}"
        if way and facts.reproducible:
            return Rerun(way, f"{why}, but the one runs as new after '{way}'", isolated=True)
        return Rerun(PROCESS, f"{why}, and neither reset nor state makes the one as new", isolated=True)
    isolated = bool({*facts.crashed} - {RESET, STATE})  # a crash in one of these matters only if it is used
    note = f"; it crashed or hung when it was tried: {', '.join(sorted(facts.crashed))}" if isolated else ""
    if not facts.deterministic:
        if facts.reproducible:
            return Rerun(PROCESS, "a second instance in one process differs from the first", isolated=True)
        return Rerun(AGAIN, f"its runs differ even in new processes: it is not deterministic{note}", isolated)
    reason = {
        RESET: "after a reset it runs as a new instance",
        STATE: f"its reset is not reliable ({facts.reset}), but its saved state is restored",
    }.get(way, f"neither its reset ({facts.reset}) nor its saved state ({facts.new_state}) is reliable")
    return Rerun(way or AGAIN, reason + note, isolated)


_OWN = Rerun(RESET, "exported by this package, whose reset is exact")


def known_rerun(component: FmuSettings) -> Rerun | None:
    """How to run it again; None if no trial has shown that yet."""
    if component.rerun != AUTO:
        return Rerun(component.rerun, "as asked for", component.rerun == PROCESS)
    if component.is_own:
        return _OWN
    path = _path(component)
    if path not in _known:
        try:
            _known[path] = Rerun(**(read_record(path) or {}))
        except TypeError:  # not known, or written by another version
            return None
    return _known[path]


def find_rerun(component: FmuSettings) -> Rerun:
    """How to run it again; tries the FMU out, in other processes, the first time."""
    with _lock:
        known = known_rerun(component)
        if known is not None:
            return known
        facts = find_facts(TrialRunner(component, step_of(component), TIME_LIMIT))
        return remember_rerun(component, facts)


def remember_rerun(component: FmuSettings, facts: Facts) -> Rerun:
    """Choose how to run it again, and remember that: in this process, and for later ones if all trials ended."""
    path, found = _path(component), choose(facts)
    if facts.unfinished:
        _log.warning(
            "%s: a trial of it did not end (%s), so the next run tries it again. On a machine that is not "
            "busy, say how to run it again: 'rerun' of the source in the case, or of load_fmu.",
            component.path.name, ", ".join(facts.unfinished),
        )  # fmt: skip
    elif not facts.failure:  # a library or licence that is missing may be there the next time
        write_record(path, asdict(found))
    _known[path] = found
    return found


def _path(component: FmuSettings) -> Path:
    """Its place in the cache, by content and interface but not by values, as an identification changes those."""
    what = [_FORMAT, component.digest, component.interface.kind, component.solver, component.event_mode]
    key = hashlib.sha256(json.dumps(what).encode()).hexdigest()
    return cache_directory() / "reruns" / f"{component.digest}-{key[:16]}.json"


def step_of(component: FmuSettings) -> float:
    """Step of the trials in s: its sample time, the step of its default experiment, or 1 ms."""
    return component.sample_time or component.fmu.experiment.step or 1e-3
