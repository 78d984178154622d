"""All that is wrong with a campaign, found before its first run."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from fmu_didim.campaigns import thresholds as limits
from fmu_didim.campaigns.document import CampaignDocument
from fmu_didim.campaigns.execute import Task
from fmu_didim.campaigns.fields import written
from fmu_didim.campaigns.plan import Plan, Setting
from fmu_didim.campaigns.truth import on_simulated
from fmu_didim.case.document import CaseDocument
from fmu_didim.controllers import read_controller
from fmu_didim.documents import problems
from fmu_didim.errors import InputError
from fmu_didim.robot import read_robot

Try = Callable[[Sequence[Task]], list[list[str]]]
"""Loads cases where runs will be; what hinders each."""


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
    if place[0] == "name":
        content["name"] = "campaign"


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
    found: dict[str, None] = {}
    good: list[tuple[Setting, ...]] = []
    with tempfile.TemporaryDirectory() as scratch:
        first = _best(plan, Path(scratch))
        variants = list(plan.variants(first))
        common = variants[0] if variants else ()
        for settings in variants:
            told = _of_form(plan, settings, Path(scratch))
            found |= {_placed(text, settings, common): None for text in told if text not in "\n".join(found)}
            if not told:
                good.append(settings)
    tried = good[: limits.TRIED]
    if attempt is not None and tried:
        tasks = [_task(plan, settings) for settings in tried]
        for settings, told in zip(tried, attempt(tasks), strict=True):
            known = "\n".join(found)
            found |= {_placed(text, settings, common): None for text in told if text.splitlines()[0] not in known}
    return list(found), len(tried)


def _task(plan: Plan, settings: tuple[Setting, ...]) -> Task:
    run = next(plan.identities.runs(settings))
    return Task(run.id, run.design, run.data, run.seed, plan.document.verb, plan.content(settings))


def _placed(text: str, settings: Sequence[Setting], common: Sequence[Setting]) -> str:
    """A problem with what differs from the case with the first values of all fields."""
    own = [s for s in settings if s not in common]
    place = ", ".join(f"{s.path} = {s.label}" for s in own[:3])
    return f"{place or 'case'}: {text}".replace("\n", "\n    ")


def _best(plan: Plan, scratch: Path) -> list[int]:
    """For each block a combination with few problems, so that a wrong value does not hide what is wrong with others."""
    chosen = [0] * len(plan.blocks)
    fewest = len(_of_form(plan, _at(plan, chosen), scratch))
    for i, block in enumerate(plan.blocks):
        for k in range(1, min(len(block), limits.TRIED)):
            if not fewest:
                return chosen
            other = [*chosen[:i], k, *chosen[i + 1 :]]
            count = len(_of_form(plan, _at(plan, other), scratch))
            if count < fewest:
                chosen, fewest = other, count
    return chosen


def _at(plan: Plan, chosen: Sequence[int]) -> tuple[Setting, ...]:
    return tuple(s for block, k in zip(plan.blocks, chosen, strict=True) for s in block[k])


def _of_form(plan: Plan, settings: tuple[Setting, ...], scratch: Path) -> list[str]:
    """What is wrong with the form of a case, the descriptions and files that it names."""
    try:
        content = plan.content(settings)
    except InputError as error:
        return [str(error)]
    folder, found = Path(content.folder), list[str]()
    parts = (
        [("", content.case)] if content.truth is None else [("", on_simulated(content.case)), ("truth.", content.truth)]
    )
    for place, part in parts:
        found += [f"{place}{text}" for text in _of_case(part, folder, scratch) if text not in found]
        plan.references.absent.clear()
        try:
            plan.references.canonical(part if content.truth is None else _without(part), folder)
        except InputError as error:
            found += [str(error)] if str(error) not in found else []
        found += [f"{place}the file {name} does not exist" for name in sorted(plan.references.absent)]
    return found


def _of_case(part: Mapping[str, Any], folder: Path, scratch: Path) -> Iterator[str]:
    case = written(part, scratch)
    try:
        CaseDocument.model_validate(case)
    except ValidationError as error:
        yield from problems(error, CaseDocument)
    controller = case.get("controller")
    described: list[tuple[Any, Callable[[Path], Any]]] = [(case.get("robot"), read_robot)]
    described.append((controller.get("source") if isinstance(controller, Mapping) else None, read_controller))
    for name, read in described:
        if isinstance(name, str) and name.endswith((".yaml", ".yml")) and (folder / name).is_file():
            try:
                read(folder / name)
            except InputError as error:
                yield str(error)


def _without(part: Mapping[str, Any]) -> dict[str, Any]:
    """A simulated case without its logs, which nobody reads."""
    bare = on_simulated(part)
    for run in (bare.get("train"), bare.get("validation"), *(bare.get("experiments") or {}).values()):
        if isinstance(run, dict):
            run.pop("torque", None)
            run.pop("positions", None)
    return bare
