"""Other entries for a case that was read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from inspect import Parameter, signature
from typing import Any, ParamSpec, TypedDict, TypeVar

from fmu_didim.base.errors import InputError
from fmu_didim.case.arrays import Inputs, Log, Measured, Reference
from fmu_didim.case.document import CaseDocument
from fmu_didim.case.in_memory import OF_THE_FILE, InMemory, Whole, pair
from fmu_didim.case.sources import TRACKING

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


class CaseChanges(TypedDict, total=False):
    """The entries of a case that :meth:`~fmu_didim.case.Case.with_` changes; see the case document for each of them."""

    name: str
    description: str
    model: Any
    inputs: Any
    measured: Any
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
    search: Mapping[str, Any] | None
    profile: bool | Sequence[str]
    torque_std: Sequence[float] | None
    joint_weights: str
    low_pass: Mapping[str, Any] | None
    prior: Mapping[str, Any] | None
    acknowledged: Mapping[str, str]


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
    if key == "controller" and TRACKING in (old.get("kind"), new.get("kind")):
        return other_kind or "source" in new
    return key in ("reference", "estimator") and (other_kind or ("file" in new and "file" not in old))


class CaseParts(TypedDict, total=False):
    """Objects that a verb takes beside a case, whose entries they replace.

    Attributes:
        robot, plant, controller, loop: entries of a case; log, reference: of its experiment for the estimation.
        validation: log and reference of its held-out experiment, or inputs and what was measured.
        model: an FMU, a Modelica file or a component that is calibrated as it is; inputs, measured: of its experiment
            for the estimation.
    """

    robot: Any
    plant: Any
    controller: Any
    log: Log | Any
    reference: Reference | Any
    validation: tuple[Log, Reference] | tuple[Inputs, Measured] | Any
    loop: Mapping[str, Any] | None
    model: Any
    inputs: Inputs | Any
    measured: Measured | Any


class CaseObjects(CaseParts, total=False):
    """The same with what is identified: with it they may stand in place of a case.

    Attributes:
        parameters: names of those of a model that are identified, or name -> start and limits.
    """

    parameters: Sequence[str] | Mapping[str, Any] | None


def with_objects(verb: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """A verb whose signature lists the keys of :class:`CaseObjects` in place of ``**objects``, and takes no others."""
    *own, _ = signature(verb).parameters.values()
    taken = signature(verb).parameters
    every = CaseObjects.__annotations__.items()
    keys = {name: annotation.__forward_arg__ for name, annotation in every if name not in taken}
    added = [Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=text) for name, text in keys.items()]
    first = sum(p.kind is not Parameter.KEYWORD_ONLY for p in own)
    shown = signature(verb).replace(parameters=[*own[:first], *added, *own[first:]])

    @wraps(verb)
    def checked(*arguments: _Arguments.args, **options: _Arguments.kwargs) -> _Result:
        shown.bind(*arguments, **options)  # raises TypeError
        return verb(*arguments, **options)

    checked.__signature__ = shown  # type: ignore[attr-defined]
    return checked


def changes_by(objects: CaseParts, document: CaseDocument | None) -> dict[str, Any]:
    """The entries of a case that objects replace.

    Args:
        document: of that case; None where the objects are the whole case.

    Raises:
        InputError: the case has several experiments that may be meant, or the objects are no whole case.
    """
    given: dict[str, Any] = {name: value for name, value in objects.items() if value is not None}
    entries = ("robot", "plant", "controller", "loop", "model")
    found: dict[str, Any] = {name: given[name] for name in entries if name in given}
    if "parameters" in given:
        found["identify"] = Whole(identified_entries(given["parameters"]))
    if document is None:
        _check_whole(given)
        found = {"name": "case in memory", **found}
    recorded: dict[str, Any] = {key: given[key] for key in ("inputs", "measured") if key in given}
    if recorded and (document is None or document.measured != ()):
        found |= recorded
    elif recorded:
        _add(found, document, "estimation", recorded)
    if run := {key: given[name] for key, name in (("torque", "log"), ("reference", "reference")) if name in given}:
        _add(found, document, "estimation", run)
    if "validation" in given:
        _add(found, document, "validation", given["validation"])
    return found


def _check_whole(given: Mapping[str, Any]) -> None:
    """Raise InputError where objects without a case are no whole case."""
    of_model = bool({"model", "inputs", "measured", "parameters"} & set(given))
    needed = ("model", "measured", "parameters") if of_model else ("robot", "controller", "reference")
    if lacking := [name for name in needed if name not in given]:
        example = (
            "identify(model='house.fmu', inputs=Inputs(t, u=...), measured=Measured(t, y=...), parameters=['R'])"
            if of_model
            else "identify(robot=..., controller=..., log=Log(t, tau), reference=Reference(t, q))"
        )
        raise InputError(
            "There is no case, and the objects are not a whole one.", got=f"no {', '.join(lacking)}",
            valid="a case; robot, controller, log and reference; or model, inputs, measured and parameters",
            next_step=f"{example}, or identify('case.yaml').",
        )  # fmt: skip


def identified_entries(given: Any) -> dict[str, Any]:
    """The entries of parameters: names alone, or name -> start, entries such as ``{"minimum": 0}``, or None."""
    if isinstance(given, str):
        return {given: {}}
    if not isinstance(given, Mapping):
        return {str(name): {} for name in given}
    return {
        name: {} if entry is None else dict(entry) if isinstance(entry, Mapping) else {"start": float(entry)}
        for name, entry in given.items()
    }


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
    found.setdefault("experiments", {}).setdefault(labels[0], {"role": role}).update(run)
