"""All that is wrong with a campaign, found before its first run."""

from __future__ import annotations

import logging
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from fmu_didim.base.documents import problems
from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.planning.document import CampaignDocument, Noise, Options
from fmu_didim.campaigns.planning.fields import written
from fmu_didim.campaigns.planning.plan import Plan, Setting
from fmu_didim.campaigns.planning.truth import on_simulated
from fmu_didim.campaigns.running.execute import Task, Trial
from fmu_didim.campaigns.running.fmu_slots import sources_of
from fmu_didim.case.document import CaseDocument
from fmu_didim.controllers import read_controller
from fmu_didim.dynamics.robot import read_robot

TRIED = 64
"""[cases] Most cases that are loaded before the first run; further values are checked by their form only."""
LOOKED_AT = 1000
"""[cases] Most cases whose form is checked before the first run: two seconds."""

Try = Callable[[Sequence[Task]], list[Trial]]
"""Loads cases where runs will be; what hinders each."""
_log = logging.getLogger(__name__)


def read_campaign(content: Mapping[str, Any], folder: Path) -> tuple[Plan | None, list[str]]:
    """The plan of a campaign, and what is wrong with its file; what is wrong is left out of the plan.

    Returns:
        None where too little is left to plan anything.
    """
    left, found = dict(content), list[str]()
    for _ in range(len(content) + 1):
        try:
            return Plan(CampaignDocument.model_validate(left), folder), found
        except ValidationError as error:
            told = problems(error, CampaignDocument)
            if isinstance(content.get("vary"), Mapping):
                told = [text.replace("vary.0.grid.", "vary.") for text in told]
            found += [text for text in told if text not in found]
            before = dict(left)
            for detail, text in zip(error.errors(include_url=False), told, strict=True):
                _leave_out(left, [str(part) for part in detail["loc"]] or [text.partition(":")[0]])
            if left == before:
                return None, found
    return None, found


def _leave_out(content: dict[str, Any], place: list[str]) -> None:
    """Leave out the smallest part of a campaign that holds what is wrong: a field that varies, or an entry."""
    vary = content.get("vary")
    if place[0] == "vary" and isinstance(vary, Mapping):
        wrong = [path for path in vary if path in place]
        if wrong:
            content["vary"] = {path: values for path, values in vary.items() if path not in wrong}
            return
    content.pop(place[0], None)
    left: dict[str, Any] = {"name": "campaign", "noise": {}}
    if place[0] in left:
        content[place[0]] = left[place[0]]


def case_problems(plan: Plan, attempt: Try | None) -> tuple[list[str], int]:
    """What is wrong with the cases of a plan, each with the field and value that it came with; and how many were tried.

    Each value is looked at with one value of each other field: the form of its case, the files that it names; then the
    first of them are loaded where the runs will be, their FMUs instantiated, their machines simulated.
    """
    if all(s.path != "case" for block in plan.blocks for part in block for s in part):
        try:
            plan.base(())
        except InputError as error:
            return [f"case: {error.what} ({error.where})"], 0
    found: dict[str, str] = {}
    good: dict[tuple[int, ...], tuple[Setting, ...]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        look = _Form(plan, Path(scratch))
        variants = list(islice(plan.variants(), LOOKED_AT))
        for settings in variants:
            told = look.problems(settings)
            found |= {t: _placed(t, settings, variants[0]) for t in told if t not in found}
            rest = look.without_wrong(settings, told) if told else settings
            if rest is not None:
                good.setdefault(tuple(map(id, rest)), rest)
    if len(variants) < LOOKED_AT:
        found |= {name: look.not_named(name) for name in sorted(set(plan.document.limits.instances) - look.sources)}
    tried = list(good.values())[:TRIED]
    if attempt is not None and tried:
        tasks = [_task(plan, settings) for settings in tried]
        for settings, trial in zip(tried, attempt(tasks), strict=True):
            if trial.problem and trial.problem not in found:
                found[trial.problem] = _placed(trial.problem, settings, tried[0])
            if trial.doubt:
                _log.warning("Runs will fail at %s", _placed(trial.doubt, settings, tried[0]))
    return list(found.values()), len(tried)


def _task(plan: Plan, settings: tuple[Setting, ...]) -> Task:
    run = next(plan.identities.runs(settings))
    return Task(run.id, run.design, run.data, run.seed, plan.document.verb, plan.content(settings))


def _placed(text: str, settings: Sequence[Setting], common: Sequence[Setting]) -> str:
    """A problem with what differs from the case with the first values of all fields."""
    own = [s for s in settings if s not in common]
    place = ", ".join(f"{s.path} = {s.label}" for s in own[:3])
    return text if text.startswith("vary.") else f"{place or 'case'}: {text}".replace("\n", "\n    ")


class _Form:
    """What is wrong with the form of cases; each description is read once.

    Attributes:
        sources: what the cases seen so far name as sources.
    """

    def __init__(self, plan: Plan, scratch: Path) -> None:
        self._plan, self._scratch = plan, scratch
        self._read: dict[Path, list[str]] = {}
        self.sources: set[str] = set()

    def not_named(self, name: str) -> str:
        """That the limit of an FMU has no effect."""
        valid = ", ".join(sorted(self.sources)) or "none"
        return f"limits.instances: no case names '{name}' as a source (they name: {valid})"

    def without_wrong(self, settings: tuple[Setting, ...], told: list[str]) -> tuple[Setting, ...] | None:
        """The settings without those that are wrong, which hide what else is; None where the case itself is wrong."""
        rest = settings
        for setting in settings:
            fewer = tuple(s for s in rest if s is not setting)
            left = self.problems(fewer)
            if len(left) < len(told):
                rest, told = fewer, left
        return None if told else rest

    def problems(self, settings: tuple[Setting, ...]) -> list[str]:
        """What is wrong with a case: paths, entries, files, descriptions."""
        plan, found = self._plan, list[str]()
        try:
            content = plan.content(settings, skipped=found)
        except InputError as error:
            return [*found, str(error)]
        folder = Path(content.folder)
        parts: list[tuple[str, Mapping[str, Any]]] = [("", content.case)]
        if content.truth is not None:
            is_another = bool(plan.document.truth) or any(s.path.startswith("truth.") for s in settings)
            parts = [("", on_simulated(content.case)), ("truth." if is_another else "", content.truth)]
        for place, part in parts:
            found += [f"{place}{text}" for text in self._of_case(part, folder) if text not in found]
            plan.references.absent.clear()
            try:
                plan.references.canonical(part if content.truth is None else _without(part), folder)
            except InputError as error:
                found += [str(error)] if str(error) not in found else []
            absent = sorted(plan.references.absent.items())
            found += [f"the file {name} does not exist{f'. {step}' if step else ''}" for name, step in absent]
            self.sources |= sources_of(part)
        for section, model in (("noise", Noise), ("options", Options)):
            try:
                model.model_validate(getattr(content, section))
            except ValidationError as error:
                found += [f"{section}.{text}" for text in problems(error, model)]
        return list(dict.fromkeys(found))

    def _of_case(self, part: Mapping[str, Any], folder: Path) -> Iterator[str]:
        case = written(part, self._scratch)
        try:
            CaseDocument.model_validate(case)
        except ValidationError as error:
            yield from problems(error, CaseDocument)
        controller = case.get("controller")
        law = controller.get("source") if isinstance(controller, Mapping) else None
        described: list[tuple[str, Any, Callable[[Path], Any]]] = [("robot", case.get("robot"), read_robot)]
        for place, name, read in (*described, ("controller.source", law, read_controller)):
            if isinstance(name, str) and name.endswith((".yaml", ".yml")) and (folder / name).is_file():
                yield from self._of_description(place, folder / name, read)

    def _of_description(self, place: str, path: Path, read: Callable[[Path], Any]) -> list[str]:
        if path not in self._read:
            self._read[path] = []
            try:
                read(path)
            except InputError as error:
                listed = [line.removeprefix("  - ") for line in error.what.splitlines()[1:]]
                if path.parent == self._scratch:  # a copy, whose lines nobody has written
                    listed = [f"{place}.{re.sub(r'^line [0-9]+, ', '', line)}" for line in listed]
                else:
                    listed = [f"{place} ({path.name}): {line}" for line in listed]
                self._read[path] = listed or [f"{place}: {error}"]
        return self._read[path]


def _without(part: Mapping[str, Any]) -> dict[str, Any]:
    """A simulated case without its logs, which nobody reads."""
    bare = on_simulated(part)
    for run in (bare.get("train"), bare.get("validation"), *(bare.get("experiments") or {}).values()):
        if isinstance(run, dict):
            run.pop("torque", None)
            run.pop("positions", None)
    return bare
