"""JSON Schema of the documents that a user writes, for completion and checks in an editor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pydantic import TypeAdapter

from fmu_didim.base.docstrings import about, key_texts
from fmu_didim.case import CaseDocument
from fmu_didim.case.document import DEFAULT_ESTIMATOR
from fmu_didim.controllers import LAWS
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.estimators import ESTIMATORS
from fmu_didim.workflow.reference.effects import EffectEntry

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]


def schema(kind: str) -> Schema:
    """The JSON Schema of a case, robot or controller file, or of what ``effects NAME --json`` prints.

    Args:
        kind: a key of :data:`SCHEMAS`.
    """
    return {"$schema": DIALECT, **SCHEMAS[kind]()}


def _case() -> Schema:
    made = CaseDocument.model_json_schema()
    forms = {name: _estimator(form) for name, form in ESTIMATORS.items()}
    made["properties"]["estimator"] |= {
        **_one_of(made, "kind", forms, default=DEFAULT_ESTIMATOR), "default": {"kind": DEFAULT_ESTIMATOR},
    }  # fmt: skip
    return made


def _estimator(form: type) -> Schema:
    """The options of an estimator, with what its docstring says of them."""
    made = TypeAdapter(form).json_schema()
    texts = key_texts(form, made.get("properties", {}))
    for name, option in made.get("properties", {}).items():
        option["description"] = texts[name]
    return {**made, "description": about(form)}


def _robot() -> Schema:
    made = RobotDescription.model_json_schema()
    named = [{"const": name, "description": f"{e.title}: {e.equation}"} for name, e in EFFECTS.items()]
    own = {"type": "string", "pattern": ":", "description": "an effect of your own, package.module:Name"}
    made["$defs"]["Joint"]["properties"]["effects"]["items"] = {"anyOf": [*named, own]}
    return made


def _controller() -> Schema:
    made: Schema = {"title": "Controller"}
    return {**_one_of(made, "law", {name: law.model_json_schema() for name, law in LAWS.items()}), **made}


def _one_of(root: Schema, key: str, forms: Mapping[str, Schema], *, default: str = "") -> Schema:
    """One of several objects, told apart by the value of a key; their definitions go to the root.

    Args:
        default: the value that the key has where it is left out.
    """
    found = []
    for name, form in forms.items():
        root.setdefault("$defs", {}).update(form.pop("$defs", {}))
        which = {"const": name, "description": str(form["description"]).partition("\n\n")[0]}
        properties = {key: which, **{k: v for k, v in form.get("properties", {}).items() if k != key}}
        required = [*([] if name == default else [key]), *(k for k in form.get("required", []) if k != key)]
        found.append({**form, "properties": properties, "required": required, "additionalProperties": False})
    return {"oneOf": found}


SCHEMAS: Mapping[str, Callable[[], Schema]] = {
    "case": _case,
    "robot": _robot,
    "controller": _controller,
    "effect": EffectEntry.model_json_schema,
}
