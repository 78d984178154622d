"""Other entries for a case that was read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypedDict

from fmu_didim.base.errors import InputError
from fmu_didim.case.document import CaseDocument
from fmu_didim.case.memory import OF_THE_FILE, InMemory, Whole, pair


class CaseChanges(TypedDict, total=False):
    """The entries of a case that :meth:`~fmu_didim.case.Case.with_` changes; see the case document for each of them."""

    name: str
    description: str
    robot: Any
    identify: Mapping[str, Any] | None
    plant: Any
    controller: Any
    components: Mapping[str, Any] | None
    connections: Mapping[str, str]
    system: Mapping[str, Any] | str | None
    loop: Mapping[str, Any]
    experiments: Mapping[str, Any]
    train: Any
    validation: Any
    estimator: Mapping[str, Any]
    torque_std: Sequence[float] | None
    joint_weights: str
    low_pass: Mapping[str, Any] | None


def merged(content: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a case with these changes.

    Mappings are merged with what is there, all else replaces it, and None takes an entry out. Start values, and a
    reference or an estimator of another kind, replace the former ones as a whole.
    """
    result = dict(content)
    for key, value in changes.items():
        old = result.get(key)
        if value is None:
            result.pop(key, None)
        elif isinstance(value, Whole):
            result[key] = dict(value)
        elif isinstance(value, InMemory) and isinstance(old, Mapping) and "file" in old:
            result[key] = {k: v for k, v in old.items() if k not in OF_THE_FILE} | value
        elif isinstance(value, Mapping) and isinstance(old, Mapping) and not _is_another(key, old, value):
            result[key] = merged(old, value)
        else:
            result[key] = value
    return result


def _is_another(key: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Whether a mapping stands for another thing than the old one, whose entries mean nothing to it."""
    if key == "start":
        return True
    other_kind = "kind" in new and new["kind"] != old.get("kind")
    return key in ("reference", "estimator") and (other_kind or ("file" in new and "file" not in old))


@dataclass(frozen=True)
class CaseObjects:
    """What a verb takes beside a case, or in the place of one.

    Attributes:
        robot, plant, controller, loop: entries of a case; log, reference: of its experiment for the estimation.
        validation: log and reference of its held-out experiment.
    """

    robot: Any = None
    plant: Any = None
    controller: Any = None
    log: Any = None
    reference: Any = None
    validation: Any = None
    loop: Mapping[str, Any] | None = None

    @property
    def given(self) -> bool:
        """Whether there is any."""
        return any(getattr(self, entry.name) is not None for entry in fields(self))

    def changes(self, document: CaseDocument | None) -> dict[str, Any]:
        """The entries of a case that they are.

        Args:
            document: of the case that they change; None: they are the whole case.

        Raises:
            InputError: the case has several experiments that may be meant, or the objects are no whole case.
        """
        entries = {name: getattr(self, name) for name in ("robot", "plant", "controller", "loop")}
        found = {name: value for name, value in entries.items() if value is not None}
        run = {name: v for name, v in (("torque", self.log), ("reference", self.reference)) if v is not None}
        if document is None:
            self._check_whole()
            found = {"name": "case in memory", **found}
        if run:
            _add(found, document, "estimation", run)
        if self.validation is not None:
            _add(found, document, "validation", self.validation)
        return found

    def _check_whole(self) -> None:
        needed = ("robot", "controller", "reference")
        lacking = [name for name in needed if getattr(self, name) is None]
        if lacking:
            raise InputError(
                "There is no case, and what was given is not a whole one.", got=f"no {', '.join(lacking)}",
                valid="a case, or robot, controller, log and reference",
                next_step="identify(robot=..., controller=..., log=Log(t, tau), reference=Reference(t, q)), or "
                "identify('case.yaml').",
            )  # fmt: skip


def _add(found: dict[str, Any], document: CaseDocument | None, role: str, run: Any) -> None:
    """Add the entry of the one experiment of a role."""
    if document is None or not document.experiments:
        found["train" if role == "estimation" else role] = run
        return
    labels = [label for label, source in document.runs.items() if source.role == role] or [role]
    if len(labels) > 1:
        raise InputError(
            "The case has several experiments that may be meant.", where="log, reference, validation", got=role,
            valid=labels, next_step="Name it: case.with_(experiments={'LABEL': {'torque': Log(t, tau)}}).",
        )  # fmt: skip
    run = pair(run, labels[0]) if isinstance(run, tuple | list) else run
    found.setdefault("experiments", {})[labels[0]] = {"role": role, **run}
