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
import os
import tempfile
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from fmu_didim.cache import cache_directory
from fmu_didim.components.fmu import questions
from fmu_didim.components.fmu.process import ProcessEndedError, run_in_fresh_process
from fmu_didim.components.fmu.questions import RESTORES
from fmu_didim.components.fmu.settings import AGAIN, AUTO, PROCESS, RESET, STATE, FmuSettings, Rerun
from fmu_didim.errors import FmuDidimError
from fmu_didim.signals import Array

OWN_TOOL = "fmu_didim "
"""How ``generationTool`` of the FMUs exported by this package begins; the tests prove that their reset is exact."""
TIME_LIMIT = 30.0
"""Seconds for each question put to an FMU."""
Kept = TypeVar("Kept")
TOGETHER = "several instances in one process"
"""The trial in which an FMU crashed, if each of the ways to run it again works alone."""
_FORMAT = 2
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
    """

    failure: str = ""
    crashed: frozenset[str] = frozenset()
    first: Array | None = None
    second: Array | None = None
    deterministic: bool = False
    reproducible: bool = False
    reset: str = ""
    new_state: str = ""


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
        return keep_rerun(component, choose(ask_facts(component, step_of(component), TIME_LIMIT)))


def keep_rerun(component: FmuSettings, found: Rerun) -> Rerun:
    """Remember how to run it again."""
    path = _path(component)
    keep(path, found)
    _known[path] = found
    return found


def _path(component: FmuSettings) -> Path:
    """Its place in the cache, by content and interface but not by values: an identification changes those."""
    what = [_FORMAT, component.digest, component.interface.kind, component.solver, component.event_mode]
    key = hashlib.sha256(json.dumps(what).encode()).hexdigest()
    return cache_directory() / "reruns" / f"{key}.json"


def read_kept(path: Path, kind: Callable[..., Kept]) -> Kept | None:
    """What :func:`keep` has written; None if it is not there or from another version: then it is asked again."""
    try:
        return kind(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def keep(path: Path, found: Any) -> None:
    """Write a dataclass to a file as a whole; several processes may do so at the same time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, partial = tempfile.mkstemp(prefix=".partial-", dir=path.parent)
    with os.fdopen(handle, "w", encoding="utf-8") as stream:
        json.dump(asdict(found), stream)
    Path(partial).replace(path)


def step_of(component: FmuSettings) -> float:
    """Step in s to try an FMU with: its sample time, the one of its default experiment, or 1 ms."""
    return component.sample_time or component.fmu.experiment.step or 1e-3


def ask_facts(component: FmuSettings, h: float, limit: float) -> Facts:
    """Try an FMU out: all in one process if it stands that, else one process for each question."""

    def ask(question: Callable[..., Any]) -> Any:
        return run_in_fresh_process(question, component, h, where=str(component.path), time_limit=limit)

    crashed: frozenset[str] = frozenset()
    try:
        first, second, reset, state = ask(questions.runs_again)
    except ProcessEndedError:
        try:
            first, second = ask(questions.two_in_turn)
        except FmuDidimError as error:
            return Facts(failure=" ".join(str(error).split()), crashed=frozenset({"runs"}))
        ended: list[str] = []
        reset, state = (_said_alone(ask, way, ended) for way in (RESET, STATE))
        crashed = frozenset(ended or [TOGETHER])
    except FmuDidimError as error:
        return Facts(failure=" ".join(str(error).split()))
    alike = questions.same(first, second)
    try:
        reproducible = questions.same(first, ask(questions.once))
    except FmuDidimError:
        reproducible = False
    return Facts("", crashed, first, second, alike, reproducible, reset, state)


def _said_alone(ask: Callable[..., Any], way: str, ended: list[str]) -> Any:
    try:
        return ask(partial(questions.restarted, strategy=way))
    except FmuDidimError as error:
        ended += [way] if isinstance(error, ProcessEndedError) else []
        return questions.in_words(error)


def said(ask: Callable[..., Any], question: Callable[..., Any]) -> Any:
    """The answer to a question, or in words why there is none."""
    try:
        return ask(question)
    except FmuDidimError as error:
        return questions.in_words(error)


def choose(facts: Facts) -> Rerun:
    """The cheapest way that has been seen to give the same as a new instance."""
    if facts.failure:
        if facts.crashed:
            return Rerun(PROCESS, "it crashed or hung when it was tried", isolated=True)
        return Rerun(AGAIN, "it could not be tried: it does not run here")
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


def tell_isolation(component: FmuSettings, rerun: Rerun) -> None:
    """Log, once in a process, that an FMU was found to need a process of its own, what that costs, and the remedy."""
    path = _path(component)
    if path in _told:
        return
    _told.add(path)
    cost = "a new process, some seconds, for each run" if rerun.strategy == PROCESS else "a message for each step"
    _log.warning(
        "%s runs in a process of its own, by '%s': %s. That costs %s, which can make it tens of times slower. "
        "If you know better, say how to run it again: 'rerun' of the source in the case, or of load_fmu.",
        component.path.name, rerun.strategy, rerun.reason, cost,
    )  # fmt: skip
