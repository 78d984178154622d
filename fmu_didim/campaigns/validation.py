"""All errors of a campaign, found before its first run."""

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
from fmu_didim.base.entry_words import details_of
from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.planning.document import CampaignDocument, Noise, Options
from fmu_didim.campaigns.planning.fields import with_written_descriptions
from fmu_didim.campaigns.planning.plan import Plan, Setting
from fmu_didim.campaigns.planning.truth import with_simulated_logs
from fmu_didim.campaigns.running.execute import Task, Trial
from fmu_didim.campaigns.running.fmu_slots import sources_of
from fmu_didim.case.document import CaseDocument
from fmu_didim.controllers import read_controller
from fmu_didim.dynamics.robot import read_robot

LOADED_CASES = 64
"""[cases] Most cases that are loaded before the first run; of further values only the form is checked."""
CHECKED_CASES = 1000
"""[cases] Most cases whose form is checked before the first run, which takes two seconds."""

LoadCases = Callable[[Sequence[Task]], list[Trial]]
"""Loads cases in the workers and returns the outcome of each."""
_log = logging.getLogger(__name__)


def read_campaign(content: Mapping[str, Any], folder: Path) -> tuple[Plan | None, list[str]]:
    """The plan of a campaign, and the errors of its file; erroneous entries are left out of the plan.

    Returns:
        None in place of the plan where too little is left to plan anything.
    """
    left, found = dict(content), list[str]()
    for _ in range(len(content) + 1):
        try:
            return Plan(CampaignDocument.model_validate(left), folder), found
        except ValidationError as error:
            messages = problems(error, CampaignDocument)
            if isinstance(content.get("vary"), Mapping):
                messages = [text.replace("vary.0.grid.", "vary.") for text in messages]
            found += [text for text in messages if text not in found]
            before = dict(left)
            for detail, text in zip(details_of(error), messages, strict=True):
                _leave_out(left, [str(part) for part in detail["loc"]] or [text.partition(":")[0]])
            if left == before:
                return None, found
    return None, found


def _leave_out(content: dict[str, Any], place: list[str]) -> None:
    """Leave out the smallest part of a campaign that holds an error: a field that varies, or an entry."""
    vary = content.get("vary")
    if place[0] == "vary" and isinstance(vary, Mapping):
        wrong = [path for path in vary if path in place]
        if wrong:
            content["vary"] = {path: values for path, values in vary.items() if path not in wrong}
            return
    content.pop(place[0], None)
    content |= {key: value for key, value in (("name", "campaign"), ("noise", {})) if key == place[0]}


def case_problems(plan: Plan, attempt: LoadCases | None) -> tuple[list[str], int]:
    """The errors of the cases of a plan, each with its field and value; and how many cases were loaded.

    Each value is checked with one value of each other field: the form of its case, the files that it names. Then the
    first of these cases are loaded in the workers, their FMUs instantiated, their machines simulated.
    """
    if all(s.path != "case" for block in plan.blocks for part in block for s in part):
        try:
            plan.base(())
        except InputError as error:
            return [f"case: {error.what} ({error.where})"], 0
    found: dict[str, str] = {}
    good: dict[tuple[int, ...], tuple[Setting, ...]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        form = _Form(plan, Path(scratch))
        variants = list(islice(plan.variants(), CHECKED_CASES))
        for settings in variants:
            messages = form.problems(settings)
            found |= {t: _placed(t, settings, variants[0]) for t in messages if t not in found}
            rest = form.without_errors(settings, messages) if messages else settings
            if rest is not None:
                good.setdefault(tuple(map(id, rest)), rest)
    if len(variants) < CHECKED_CASES:
        valid = ", ".join(sorted(form.sources)) or "none"
        for name in sorted(set(plan.document.limits.instances) - form.sources):
            found[name] = f"limits.instances: no case names '{name}' as a source (they name: {valid})"
    tried = list(good.values())[:LOADED_CASES]
    if attempt is not None and tried:
        runs = [(next(plan.identities.runs(settings)), plan.content(settings)) for settings in tried]
        verb = plan.document.verb
        tasks = [Task(run.id, run.design, run.data, run.seed, verb, content) for run, content in runs]
        for settings, trial in zip(tried, attempt(tasks), strict=True):
            if trial.problem and trial.problem not in found:
                found[trial.problem] = _placed(trial.problem, settings, tried[0])
            if trial.doubt:
                _log.warning("Runs will fail at %s", _placed(trial.doubt, settings, tried[0]))
    return list(found.values()), len(tried)


def _placed(text: str, settings: Sequence[Setting], common: Sequence[Setting]) -> str:
    """An error with the fields in which its case differs from the first case."""
    own = [s for s in settings if s not in common]
    place = ", ".join(f"{s.path} = {s.label}" for s in own[:3])
    return text if text.startswith("vary.") else f"{place or 'case'}: {text}".replace("\n", "\n    ")


class _Form:
    """Errors in the form of cases; each description is read once.

    Attributes:
        sources: of the components of all cases checked so far.
    """

    def __init__(self, plan: Plan, scratch: Path) -> None:
        self._plan, self._scratch = plan, scratch
        self._read: dict[Path, list[str]] = {}
        self.sources: set[str] = set()

    def without_errors(self, settings: tuple[Setting, ...], messages: list[str]) -> tuple[Setting, ...] | None:
        """The settings without wrong ones, which hide further errors; None where the case itself has an error."""
        rest = settings
        for setting in settings:
            fewer = tuple(s for s in rest if s is not setting)
            left = self.problems(fewer)
            if len(left) < len(messages):
                rest, messages = fewer, left
        return None if messages else rest

    def problems(self, settings: tuple[Setting, ...]) -> list[str]:
        """The errors of a case: paths, entries, files, descriptions."""
        plan, found = self._plan, list[str]()
        try:
            content = plan.content(settings, skipped=found)
        except InputError as error:
            return [*found, str(error)]
        folder = Path(content.folder)
        parts: list[tuple[str, Mapping[str, Any]]] = [("", content.case)]
        if content.truth is not None:
            is_another = bool(plan.document.truth) or any(s.path.startswith("truth.") for s in settings)
            parts = [("", with_simulated_logs(content.case)), ("truth." if is_another else "", content.truth)]
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
        case = with_written_descriptions(part, self._scratch)
        try:
            CaseDocument.model_validate(case)
        except ValidationError as error:
            yield from problems(error, CaseDocument)
        controller = case.get("controller")
        law = controller.get("source") if isinstance(controller, Mapping) else None
        readers: tuple[tuple[str, Any, Callable[[Path], Any]], ...] = (
            ("robot", case.get("robot"), read_robot), ("controller.source", law, read_controller),
        )  # fmt: skip
        for place, name, read in readers:
            if not isinstance(name, str) or not name.endswith((".yaml", ".yml")) or not (folder / name).is_file():
                continue
            path = folder / name
            if path not in self._read:
                self._read[path] = []
                try:
                    read(path)
                except InputError as error:
                    listed = [line.removeprefix("  - ") for line in error.what.splitlines()[1:]]
                    if path.parent == self._scratch:  # a copy, whose line numbers mean nothing to the user
                        listed = [f"{place}.{re.sub(r'^line [0-9]+, ', '', line)}" for line in listed]
                    else:
                        listed = [f"{place} ({path.name}): {line}" for line in listed]
                    self._read[path] = listed or [f"{place}: {error}"]
            yield from self._read[path]


def _without(part: Mapping[str, Any]) -> dict[str, Any]:
    """A simulated case without its logs, which are not read."""
    bare = with_simulated_logs(part)
    for run in (bare.get("train"), bare.get("validation"), *(bare.get("experiments") or {}).values()):
        if isinstance(run, dict):
            run.pop("torque", None)
            run.pop("positions", None)
    return bare
