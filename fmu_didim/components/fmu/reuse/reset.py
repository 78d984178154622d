"""How an FMU is run again: found out once for its content, then kept.

Not every FMU is as new after ``fmiXReset``, so a reset is used only where it has been seen to work, with the values of
all parameters changed before: then comes the state saved right after the instantiation, then a new instance, and where
that differs from the first one a new process. An FMU that crashed or hung in a trial of what is done with it runs in a
process of its own from then on; a way to run it again that crashed is just not taken.
"""

from __future__ import annotations

import hashlib
import json
import logging
import threading
import time as clock
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from fmu_didim.base.cache import cache_directory, cache_file, is_trusted
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.isolation.process import ProcessEndedError, run_in_fresh_process
from fmu_didim.components.fmu.reuse import trials
from fmu_didim.components.fmu.reuse.trials import RESTORES
from fmu_didim.components.fmu.settings import AGAIN, AUTO, PROCESS, RESET, STATE, FmuSettings, Rerun
from fmu_didim.data.signals import Array

QUICK = 0.1
"""[1] Fraction of the time limit of a trial that a single instance may take, so that the time limit of the trial with
two of them is no fault of a busy machine."""

OWN_TOOL = "fmu_didim "
"""How ``generationTool`` of the FMUs exported by this package begins; the tests prove that their reset is exact."""
TIME_LIMIT = 30.0
"""Seconds for each question put to an FMU."""
Kept = TypeVar("Kept")
TOGETHER = "several instances in one process"
"""The trial in which an FMU crashed, if each of the ways to run it again works alone."""
ONLY_QUIET = "with pseudo-random inputs, while it does with its inputs at their start values"
"""How the failure of an FMU begins whose inputs may not be anything."""
ONE_AFTER_THE_OTHER = "one instance after the other in one process"
"""The same, where a process bears a single one."""
_FORMAT = 5
_log = logging.getLogger(__name__)
_lock = threading.Lock()
_known: dict[Path, Rerun] = {}
_told: set[Path] = set()


@dataclass(frozen=True)
class Facts:
    """What runs of an FMU have shown.

    Attributes:
        failure: why it does not run; empty if it does; crashed: the trials that took their process with them.
        first, second: trajectories of two new instances in one process.
        reproducible: whether a new process gives the same as the first.
        reset, new_state: ``restores``, ``does not restore``, or why it could not be tried.
        took_s: time that a single instance took.
        single: whether a second instance in its process, one after the other, was fatal, hung or was refused.
        unfinished: the trials that did not come to their end: they took too long, or their process was killed or did
            not start. A busy machine may be the reason, so what follows from them is not kept for later runs.
    """

    failure: str = ""
    crashed: frozenset[str] = frozenset()
    first: Array | None = None
    second: Array | None = None
    deterministic: bool = False
    reproducible: bool = False
    reset: str = ""
    new_state: str = ""
    single: bool = False
    took_s: float = 0.0
    unfinished: tuple[str, ...] = ()

    @property
    def may_be_kept(self) -> bool:
        """Whether all was measured to its end; what kept an FMU from running may be gone the next time."""
        return not self.failure and not self.unfinished


def known_rerun(component: FmuSettings) -> Rerun | None:
    """How to run it again, None if that has not been found out yet."""
    if component.rerun != AUTO:
        return Rerun(component.rerun, "as asked for", component.rerun == PROCESS)
    if component.fmu.tool.startswith(OWN_TOOL):
        return Rerun(RESET, "exported by this package, whose reset is exact")
    path = _path(component)
    if path not in _known:
        found = read_kept(path, Rerun)
        if found is None:
            return None
        _known[path] = found
    return _known[path]


def find_rerun(component: FmuSettings) -> Rerun:
    """How to run it again; asks the FMU, in other processes, the first time."""
    with _lock:
        known = known_rerun(component)
        if known is not None:
            return known
        facts = ask_facts(component, step_of(component), TIME_LIMIT)
        return remember_rerun(component, choose(facts), facts)


def remember_rerun(component: FmuSettings, found: Rerun, facts: Facts) -> Rerun:
    """Remember how to run it again: in this process, and if all was measured to its end for later ones."""
    path = _path(component)
    if facts.may_be_kept:
        keep(path, found)
    elif facts.unfinished:
        _log.warning(
            "%s: a trial of it did not come to its end (%s), so the next run tries it again. On a machine that is not "
            "busy, say how to run it again: 'rerun' of the source in the case, or of load_fmu.",
            component.path.name, ", ".join(facts.unfinished),
        )  # fmt: skip
    _known[path] = found
    return found


def _path(component: FmuSettings) -> Path:
    """Its place in the cache, by content and interface but not by values: an identification changes those."""
    what = [_FORMAT, component.digest, component.interface.kind, component.solver, component.event_mode]
    key = hashlib.sha256(json.dumps(what).encode()).hexdigest()
    return cache_directory() / "reruns" / f"{component.digest}-{key[:16]}.json"


def read_kept(path: Path, kind: Callable[..., Kept]) -> Kept | None:
    """What :func:`keep` has written; None if it is not there, from another version or from a user who is not trusted:
    then it is asked again."""
    try:
        return kind(**json.loads(path.read_text(encoding="utf-8"))) if is_trusted(path) else None
    except (OSError, ValueError, TypeError):
        return None


def keep(path: Path, found: Any) -> None:
    """Write a dataclass to a file as a whole; several processes may do so at the same time."""
    with suppress(OSError), cache_file(path) as temporary:  # the disk is full, ...: it is found out again
        temporary.write_text(json.dumps(asdict(found)), encoding="utf-8")


def step_of(component: FmuSettings) -> float:
    """Step in s to try an FMU with: its sample time, the one of its default experiment, or 1 ms."""
    return component.sample_time or component.fmu.experiment.step or 1e-3


def ask_facts(component: FmuSettings, h: float, limit: float) -> Facts:
    """Try an FMU out: all in one process if it stands that, else one process for each question."""
    unfinished: dict[str, None] = {}

    def ask(question: Callable[..., Any]) -> Any:
        try:
            return run_in_fresh_process(question, component, h, where=str(component.path), time_limit=limit)
        except ProcessEndedError as error:
            if not error.by_fmu:
                unfinished[trial_name(question)] = None
            raise

    facts = _asked(ask)
    if facts.single and facts.took_s < QUICK * limit:
        unfinished = {}  # alone it is quick: it hung, and no busy machine was to blame
    return replace(facts, unfinished=tuple(unfinished))


def trial_name(question: Callable[..., Any]) -> str:
    """What is tried, in words."""
    if isinstance(question, partial):
        return str(question.keywords["strategy"])
    return question.__name__.replace("_", " ")


def _asked(ask: Callable[..., Any]) -> Facts:
    crashed: frozenset[str] = frozenset()
    try:
        first, second, reset, state = ask(trials.runs_again)
    except ProcessEndedError:
        try:
            first, second = ask(trials.two_in_turn)
        except FmuDidimError:
            return _asked_alone(ask, frozenset({ONE_AFTER_THE_OTHER}))
        ended: list[str] = []
        reset, state = (_said_alone(ask, way, ended) for way in (RESET, STATE))
        crashed = frozenset(ended or [TOGETHER])
    except FmuDidimError:  # of the first instance, or of the second one alone
        return _asked_alone(ask, frozenset())
    alike = trials.same(first, second)
    return Facts("", crashed, first, second, alike, _is_repeated(ask, first), reset, state)


def _is_repeated(ask: Callable[..., Any], first: Array) -> bool:
    """Whether a new process gives the same trajectory."""
    try:
        return trials.same(first, ask(trials.once))
    except FmuDidimError:
        return False


def _failed(ask: Callable[..., Any], error: FmuDidimError, crashed: frozenset[str]) -> Facts:
    """What an FMU is said to fail at; pseudo-random inputs may be more than its model stands."""
    failure = " ".join(str(error).split())
    try:
        ask(trials.quiet)
    except FmuDidimError:
        return Facts(failure=failure, crashed=crashed)
    return Facts(failure=f"{ONLY_QUIET}: {failure}", crashed=crashed)


def _asked_alone(ask: Callable[..., Any], crashed: frozenset[str]) -> Facts:
    """What can be asked where a process bears one instance only, or none; a second one crashed or was refused."""
    begin = clock.monotonic()
    try:
        first = ask(trials.once)
    except FmuDidimError as error:
        return _failed(ask, error, frozenset({"runs"}) if crashed else crashed)
    took = clock.monotonic() - begin
    reproducible = _is_repeated(ask, first)
    reset, state = (said(ask, partial(trials.restarted, strategy=way, wanted=first)) for way in (RESET, STATE))
    return Facts("", crashed, first, first, False, reproducible, reset, state, single=True, took_s=took)


def _said_alone(ask: Callable[..., Any], way: str, ended: list[str]) -> Any:
    try:
        return ask(partial(trials.restarted, strategy=way))
    except FmuDidimError as error:
        ended += [way] if isinstance(error, ProcessEndedError) else []
        return trials.in_words(error)


def said(ask: Callable[..., Any], question: Callable[..., Any]) -> Any:
    """The answer to a question, or in words why there is none."""
    try:
        return ask(question)
    except FmuDidimError as error:
        return trials.in_words(error)


def choose(facts: Facts) -> Rerun:
    """The cheapest way that has been seen to give the same as a new instance."""
    if facts.failure:
        if facts.crashed:
            return Rerun(PROCESS, "it crashed or hung when it was tried", isolated=True)
        return Rerun(AGAIN, "it could not be tried: it does not run here")
    if facts.single:
        return _choose_single(facts)
    apart = bool(facts.crashed - {RESET, STATE})  # one of these that crashed is not taken
    alone = f"; it crashed or hung when it was tried: {', '.join(sorted(facts.crashed))}" if apart else ""
    if not facts.deterministic:
        if facts.reproducible:
            return Rerun(PROCESS, "a second instance in one process differs from the first", isolated=True)
        return Rerun(AGAIN, f"its runs differ even in new processes: it is not deterministic{alone}", apart)
    if facts.reset == RESTORES:
        return Rerun(RESET, f"after a reset it runs as a new instance{alone}", apart)
    if facts.new_state == RESTORES:
        reason = f"its reset is not to be relied on ({facts.reset}), but its saved state is restored{alone}"
        return Rerun(STATE, reason, apart)
    reason = f"neither its reset ({facts.reset}) nor its saved state ({facts.new_state}) is to be relied on{alone}"
    return Rerun(AGAIN, reason, apart)


def _choose_single(facts: Facts) -> Rerun:
    """Of an FMU of which a process bears one instance."""
    why = f"a second instance in one process is {'fatal or hangs' if facts.crashed else 'refused'}"
    for way, answer in ((RESET, facts.reset), (STATE, facts.new_state)):
        if facts.reproducible and answer == RESTORES:
            return Rerun(way, f"{why}, but the one runs as new after '{way}'", isolated=True)
    return Rerun(PROCESS, f"{why}, and neither reset nor state makes the one as new", isolated=True)


def tell_isolation(component: FmuSettings, rerun: Rerun) -> None:
    """Log, once in a process, that an FMU was found to need a process of its own, what that costs, and the remedy."""
    cost = "a new process, about a second, for each run" if rerun.strategy == PROCESS else "a second to start"
    _tell(
        component, logging.WARNING,
        f"runs in a process of its own, by '{rerun.strategy}': {rerun.reason}. That costs {cost}. "
        "If you know better, say so beside its source: 'isolated: false', and 'rerun' for how to run it again.",
    )  # fmt: skip


def tell_unproven(component: FmuSettings) -> None:
    """Log, once in a process, that an FMU runs apart because nothing is known of it."""
    _tell(
        component, logging.INFO,
        "has not run on this machine before: its loop runs in a process of its own this time, which takes about a "
        "second to start ('isolated: false' beside its source, if you trust it).",
    )  # fmt: skip


def _tell(component: FmuSettings, level: int, text: str) -> None:
    path = _path(component)
    if path not in _told:
        _told.add(path)
        _log.log(level, "%s %s", component.path.name, text)
