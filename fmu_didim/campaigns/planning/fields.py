"""Fields of a case by their path, and descriptions written into a case in place of their file name."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from fmu_didim.base.documents import load_yaml
from fmu_didim.base.errors import InputError
from fmu_didim.base.imports import located
from fmu_didim.case import Inputs, Log, Measured, Reference
from fmu_didim.case.in_memory import Memory
from fmu_didim.components import Component, is_control
from fmu_didim.data.excitation import Excitation
from fmu_didim.data.signals import Trajectory
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.robot import RobotDescription, RobotModel

DESCRIPTIONS = (("robot",), ("plant", "source"), ("controller", "source"))
"""Entries of a case that name the file of a description."""
Label = str | float | int | bool
FILE_SUFFIXES = (".yaml", ".yml", ".fmu", ".csv")
"""Of names of files, which labels show without their folders."""
SHORT = 60
"""[characters] A label as YAML is cut there: a column of a table."""


def plain(content: Any, memory: Memory, place: str = "campaign") -> Any:
    """The content of a campaign as values that other processes can read: robots and formulas become mappings.

    Args:
        memory: what the names in angle brackets of a loaded case stand for; place: of the content, for messages.

    Raises:
        InputError: an object is among them that only this process has.
    """
    if isinstance(content, str):
        content = {**memory.signals, **memory.objects}.get(content, content)
    if isinstance(content, RobotModel):
        content = content.description
    if isinstance(content, RobotDescription | Excitation):
        content = content.model_dump(mode="json", by_alias=True)
    if isinstance(content, Mapping):
        return {key: plain(value, memory, f"{place}.{key}") for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [plain(value, memory, place) for value in content]
    is_data = isinstance(content, Log | Reference | Inputs | Measured | Trajectory)
    if is_data or callable(content) or isinstance(content, Component | Block) or is_control(content):
        raise InputError(
            "A campaign cannot take an object in memory: its runs are processes of their own, which read files.",
            where=place, got=getattr(content, "__name__", type(content).__name__),
            next_step="Write the signals to a file (write_csv) and name it, {file: ...}." if is_data else
            "Put it into a file of its own and name it there: file.py:Name.",
        )  # fmt: skip
    return content


def with_value(content: Any, path: str, value: Any, folder: Path) -> Any:
    """The content with another value at a path; all else is shared with the old content.

    Names of mappings and indices of lists, joined by dots. Below the name of a YAML file the path continues in its
    content, which then replaces the name. None removes an entry.

    Raises:
        InputError: there is no such element of a list, or a value where the path continues.
    """
    head, _, rest = path.partition(".")
    if isinstance(content, str) and content.endswith((".yaml", ".yml")):
        content = _description(folder / content)
    if isinstance(content, Mapping) or content is None:
        new: Any = dict(content or {})
        if value is None and not rest:
            new.pop(head, None)
        else:
            new[head] = with_value(new.get(head), rest, value, folder) if rest else value
        return new
    if isinstance(content, Sequence) and not isinstance(content, str):
        new = list(content)
        if not head.isdigit() or int(head) >= len(new):
            raise InputError(
                "The list has no such element.", where=path, got=head, valid=f"0 to {len(new) - 1}",
                next_step="Take a number of an element; the first one is 0.",
            )  # fmt: skip
        new[int(head)] = with_value(new[int(head)], rest, value, folder) if rest else value
        return new
    raise InputError(
        "The path continues below a value.", where=path, got=repr(content)[:60],
        next_step="Shorten the path to the key that holds this value.",
    )  # fmt: skip


def _description(path: Path) -> dict[str, Any]:
    """The content of a description, its own references made absolute; read once as long as the file stays as it is."""
    try:
        known = path.stat()
    except OSError:
        return _read(path, 0, 0)  # raises the error
    return _read(path, known.st_mtime_ns, known.st_size)


@lru_cache(maxsize=64)
def _read(path: Path, changed_ns: int, size: int) -> dict[str, Any]:
    content = load_yaml(path)
    if isinstance(content.get("robot"), str):
        content["robot"] = str((path.parent / content["robot"]).resolve())
    for joint in content.get("joints") or ():
        if isinstance(joint, dict) and isinstance(joint.get("effects"), list):
            joint["effects"] = [located(e, path.parent) if isinstance(e, str) else e for e in joint["effects"]]
    return content


def with_written_descriptions(content: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The case with its inline descriptions written to files of a folder, named by digests of their content."""
    from hashlib import sha256

    result = dict(content)
    for root, *below in DESCRIPTIONS:
        value = result.get(root)
        inner = value.get(below[0]) if below and isinstance(value, Mapping) else None if below else value
        if not isinstance(inner, Mapping):
            continue
        text = json.dumps(inner, sort_keys=True, default=str)
        path = folder / f"{root}_{sha256(text.encode()).hexdigest()[:12]}.yaml"
        if not path.is_file():
            path.write_text(yaml.safe_dump(dict(inner), sort_keys=False), encoding="utf-8")
        result[root] = {**value, below[0]: str(path)} if below and isinstance(value, Mapping) else str(path)
    return result


def labels(values: Sequence[Any]) -> list[Label]:
    """Values as tables show them; unlike values have unlike labels.

    Numbers and booleans are unchanged; of the name of a file stands as much, from its end, as tells it from the others;
    all else is short YAML, in full where others begin alike.
    """
    candidates = [_candidates(value) for value in values]
    chosen = [0] * len(values)
    while True:
        found = [names[i] for names, i in zip(candidates, chosen, strict=True)]
        owners: dict[Label, set[str]] = {}
        for name, value in zip(found, values, strict=True):
            owners.setdefault(name, set()).add(repr(value))
        longer = [k for k, name in enumerate(found) if len(owners[name]) > 1 and chosen[k] + 1 < len(candidates[k])]
        if not longer:
            return found
        for k in longer:
            chosen[k] += 1


def _candidates(value: Any) -> list[Label]:
    """Labels of a value from the shortest to one that tells all."""
    if isinstance(value, bool | int | float):
        return [value]
    if isinstance(value, str) and value.endswith(FILE_SUFFIXES):
        parts = value.split("/")
        tails = ["/".join(parts[-n:]) for n in range(1, len(parts) + 1)]
        return [*(tail.rpartition(".")[0] or tail for tail in tails), value]
    if isinstance(value, str):
        return [value]
    text = yaml.safe_dump(value, default_flow_style=True, width=1000).strip().removesuffix("\n...")
    return [text] if len(text) <= SHORT else [text[: SHORT - 3] + "...", text]
