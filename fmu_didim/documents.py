"""YAML documents: read, validate against a pydantic model, report all problems at once."""

from __future__ import annotations

import difflib
import math
import re
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from fmu_didim.errors import InputError

Model = TypeVar("Model", bound=BaseModel)
Positive = Annotated[float, Field(gt=0)]


class Strict(BaseModel):
    """Base of the document models: unknown keys are errors, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _finite_or_none(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Number = Annotated[float | None, BeforeValidator(_finite_or_none)]
"""A number of a saved result; null where it is not defined (NaN and infinity have no place in JSON)."""
_ANGLE = re.compile(
    r"^\s*(?P<sign>[+-]?)\s*(?:(?P<factor>\d+(?:\.\d+)?)\s*\*\s*)?pi\s*(?:/\s*(?P<divisor>\d+(?:\.\d+)?))?\s*$"
)


def _angle(value: object) -> object:
    if isinstance(value, str):
        match = _ANGLE.match(value)
        if match is None:
            raise ValueError(f"'{value}' is neither a number nor of the form -pi/2")
        number = math.pi * float(match["factor"] or 1) / float(match["divisor"] or 1)
        return -number if match["sign"] == "-" else number
    return value


Angle = Annotated[float, BeforeValidator(_angle)]
"""An angle in rad: a number, or a fraction of pi such as ``-pi/2``."""


def load_yaml(path: Path | str) -> dict[str, Any]:
    """The mapping in a YAML file; raises InputError when it is missing or not a mapping."""
    path = Path(path)
    if not path.is_file():
        raise InputError("The file does not exist.", where=str(path), next_step="Check the path.")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise InputError("The file is not valid YAML.", where=str(path), got=str(error)) from error
    if not isinstance(content, dict):
        raise InputError("The file holds no mapping.", where=str(path), got=type(content).__name__, valid="key: value")
    return content


def validate(model: type[Model], content: dict[str, Any], *, where: str) -> Model:
    """``content`` as a ``model``; raises one InputError that lists every problem with its path."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        problems = [_problem(detail, model) for detail in error.errors()]
        count = "a problem" if len(problems) == 1 else f"{len(problems)} problems"
        raise InputError(
            f"{Path(where).name} has {count}:\n" + "\n".join(f"  - {p}" for p in problems), where=where
        ) from error


def read_document(model: type[Model], path: Path | str) -> Model:
    """Load and validate a YAML file."""
    return validate(model, load_yaml(path), where=str(path))


def _problem(detail: Any, model: type[BaseModel]) -> str:
    location = [part for part in detail["loc"] if not (isinstance(part, str) and part.startswith("function-"))]
    path = ".".join(str(part) for part in location)
    if detail["type"] == "extra_forbidden":
        names = _fields_at(model, location[:-1])
        near = difflib.get_close_matches(str(location[-1]), names, n=1)
        hint = f" Did you mean '{near[0]}'?" if near else ""
        return f"{path}: unknown key.{hint} Valid keys: {', '.join(names)}"
    if detail["type"] == "missing":
        return f"{path}: this key is required"
    message = str(detail["msg"]).removeprefix("Value error, ")
    if not path:  # of the document as a whole
        return message
    got = repr(detail.get("input"))
    return f"{path}: {message} (got {got[:60]})"


def _fields_at(model: type[BaseModel], location: list[Any]) -> list[str]:
    """Names of the fields of the nested model at ``location``, as far as they can be followed."""
    current: type[BaseModel] | None = model
    for part in location:
        if isinstance(part, int) or current is None:
            continue
        info = current.model_fields.get(str(part))
        models = _models_in(info.annotation) if info is not None else []
        if info is None:
            continue  # the tag of a union
        current = models[0] if models else None
    return [info.alias or name for name, info in current.model_fields.items()] if current is not None else []


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for argument in getattr(annotation, "__args__", ()) for m in _models_in(argument)]
