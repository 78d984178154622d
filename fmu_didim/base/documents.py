"""YAML documents: read, validate against a pydantic model, report all problems at once."""

from __future__ import annotations

import difflib
import math
import re
import reprlib
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetJsonSchemaHandler, ValidationError
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema
from yaml.composer import Composer, ComposerError
from yaml.constructor import ConstructorError, SafeConstructor
from yaml.parser import Parser
from yaml.reader import Reader, ReaderError
from yaml.resolver import Resolver
from yaml.scanner import Scanner

from fmu_didim.base.docstrings import about, key_texts
from fmu_didim.base.entry_words import KEY, details_of, in_words
from fmu_didim.base.errors import InputError
from fmu_didim.base.files import is_file

MAXIMUM_BYTES = 256 * 2**10
MAXIMUM_VALUES = 50_000
MAXIMUM_DEPTH = 50
"""Bounds of a YAML file, values and depth with all aliases written out: more than a campaign of some thousand settings
has. What is beyond them is not read to its end."""
MOST_PROBLEMS = 20
"""Problems of one file that are reported at most."""
LONGEST_REASON = 500
"""Characters of the reason why a saved document cannot be read."""
LONGEST = 60
"""Characters of a value or a key that are shown."""
OF_PYDANTIC = re.compile(r"function-.*|constrained-\w+|(dict|list|tuple|union)\[.*\]")
"""Parts of pydantic's path of an entry that are none of the document: which of its alternatives was tried."""
_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = LONGEST
_REPR.maxlevel = 3
Model = TypeVar("Model", bound=BaseModel)
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
NotNegative = Annotated[int, Field(ge=0)]


class Strict(BaseModel):
    """Base of the document models: unknown keys are errors, values do not change, numbers are finite.

    The JSON Schema describes each key as the docstring of the class does.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = handler(core)
        own = handler.resolve_ref_schema(schema)
        own["description"] = about(cls)
        keys = {name: info.alias or name for name, info in cls.model_fields.items()}
        texts = key_texts(cls, {*keys, *keys.values()}) | {"schema_version": "Number of this form of the document."}
        for name, key in keys.items():
            if text := texts.get(name, texts.get(key)):
                own["properties"][key].setdefault("description", text)
        return schema


class Saved(Strict):
    """Base of the models of results, which may say that something is not known."""

    model_config = ConfigDict(allow_inf_nan=True)


@dataclass(frozen=True)
class AlsoWritten:
    """Marks a type that a validator makes of a short form, too, so that its JSON Schema says so.

    Attributes:
        types: of JSON that the short form has.
    """

    types: tuple[str, ...]

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [*({"type": name} for name in self.types), handler(core)]}


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


Angle = Annotated[float, BeforeValidator(_angle), AlsoWritten(("string",))]
"""An angle in rad: a number, or a fraction of pi such as ``-pi/2``."""


def load_yaml(path: Path | str) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
        InputError: it is missing, no mapping, not UTF-8, larger, deeper or by its aliases longer than any description
            is, or a key occurs twice in it.
    """
    path = Path(path)
    if not is_file(path):
        raise InputError("The file does not exist.", where=str(path), next_step="Check the path.")
    try:
        size = path.stat().st_size
        raw = path.read_bytes() if size <= MAXIMUM_BYTES else b""
    except OSError as error:
        raise InputError(
            "The file cannot be read.", where=str(path), got=str(error),
            next_step="Make it readable for you, or give another path.",
        ) from error  # fmt: skip
    if size > MAXIMUM_BYTES:
        raise InputError(
            "The file is too large for a description.", where=str(path), got=f"{size} bytes",
            valid=f"at most {MAXIMUM_BYTES}", next_step="Put signals into CSV, MAT or Parquet files.",
        )  # fmt: skip
    try:
        content = parse_yaml(raw.decode("utf-8"))
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(
            "The file is not UTF-8.", where=f"{path}, line {line}", got=repr(raw[error.start : error.end]),
            next_step="Save it as UTF-8.",
        ) from error  # fmt: skip
    except yaml.YAMLError as error:
        raise InputError(
            "The file is not valid YAML.", where=str(path), got=str(error)[:1000],
            next_step="Correct that line: indent with spaces, a space after each colon, quotes and brackets closed.",
        ) from error  # fmt: skip
    if not isinstance(content, dict):
        raise InputError(
            "The file holds no mapping.", where=str(path), got=type(content).__name__, valid="key: value",
            next_step="Write it as keys with values; fmu-didim init writes a case to start from.",
        )  # fmt: skip
    return content


def parse_yaml(text: str, loader: type[Any] | None = None) -> Any:
    """The content of a YAML text; raises YAMLError, which quotes the line.

    Args:
        loader: :class:`PythonLoader`, or by default :data:`LOADER`, the fastest that PyYAML has here.
    """
    try:
        return (loader or LOADER)(text).get_single_data()
    except ReaderError as error:
        error.name = "the file"
        raise
    except yaml.MarkedYAMLError as error:
        for name in ("context_mark", "problem_mark"):
            if mark := getattr(error, name):
                setattr(error, name, yaml.Mark("the file", mark.index, mark.line, mark.column, f"{text}\0", mark.index))
        raise


class _Loader(Composer, SafeConstructor, Resolver):
    """Plain values only, within bounds, and no key twice; a subclass makes the events."""

    def __init__(self) -> None:
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self._depth = self._count = 0
        self._measured: dict[yaml.Node, tuple[int, int]] = {}  # values in it and its depth, aliases written out

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: yaml.Event = self.peek_event()  # type: ignore[attr-defined]
        self._depth += 1
        self._count += 1
        self._bound(self._count, self._depth, event.start_mark)
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        if isinstance(event, yaml.AliasEvent):
            if node not in self._measured:
                raise _refusal("an alias stands in what it stands for", event.start_mark)
        elif node is not None:
            inner = [self._measured[part] for part in _parts(node)]
            measure = 1 + sum(count for count, _ in inner), 1 + max((depth for _, depth in inner), default=0)
            self._bound(*measure, event.start_mark)
            self._measured[node] = measure
        return node

    def _bound(self, count: int, depth: int, mark: Any) -> None:
        if depth > MAXIMUM_DEPTH:
            raise _refusal(f"it is nested more than {MAXIMUM_DEPTH} deep", mark)
        if count > MAXIMUM_VALUES:
            raise _refusal(f"it holds more than {MAXIMUM_VALUES} values, aliases written out", mark)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: dict[Any, Any] = {}
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue  # its keys are meant to be overruled
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, Hashable) and key in seen:
                what = f"the key {_short(key)} occurs twice"
                raise ConstructorError("first", seen[key], what, key_node.start_mark)
            if isinstance(key, Hashable):
                seen[key] = key_node.start_mark
        return super().construct_mapping(node, deep=deep)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            found = super().construct_object(node, deep=deep)
            if isinstance(found, str):
                found.encode("utf-8")  # half of a character, written as an escape, is invalid
            return found
        except (ValueError, OverflowError, LookupError, TypeError, AttributeError) as error:
            # Such as the 30th of February, five thousand digits, or a tag that its text does not fit: !!int ''.
            raise ConstructorError(None, None, f"{_short(node.value)}: {error}", node.start_mark) from error


class PythonLoader(_Loader, Reader, Scanner, Parser):
    """Events of PyYAML's own parser."""

    def __init__(self, text: str) -> None:
        Reader.__init__(self, text)
        Scanner.__init__(self)
        Parser.__init__(self)
        _Loader.__init__(self)


LOADER: type[Any] = PythonLoader
if yaml.__with_libyaml__:
    from yaml.cyaml import CParser  # type: ignore[attr-defined]

    class _CLoader(_Loader, CParser):
        """Events of libyaml, in a fifth of the time."""

        def __init__(self, text: str) -> None:
            CParser.__init__(self, text)
            _Loader.__init__(self)

    LOADER = _CLoader


def _refusal(problem: str, mark: Any) -> ComposerError:
    return ComposerError(None, None, problem, mark)


def _parts(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


FOLDER = "folder"
"""Key of pydantic's context: the folder of the file, to which names of other files are relative."""


def validate(
    model: type[Model], content: dict[str, Any], *, where: str, lines: Lines | None = None, folder: Path | None = None
) -> Model:
    """``content`` as a ``model``; raises one InputError that lists every problem with its path.

    Args:
        lines: of the file that the content is from; problems are then reported with theirs.
        folder: of that file; None: the working folder.
    """
    open_ = [] if lines is None else [f"{place}: still to be filled in{note}" for place, note in lines.unfilled()]
    try:
        made = model.model_validate(content, context={FOLDER: folder or Path()})
    except ValidationError as error:
        if other := _other_kind(content, model):
            raise InputError(f"This is {other}.", where=where, next_step=KINDS[other][1]) from error
        raise problems_error([*open_, *problems(error, model, lines)], where=where) from error
    if open_:
        raise problems_error(open_, where=where)
    return made


KINDS = {
    "a controller description": ("law", "Name it in a case, controller: {source: ...}; fmu-didim export makes an FMU."),
    "a campaign": ("vary", "fmu-didim campaign run takes it."),
    "a case": ("train", "fmu-didim identify, check and discover take it; with --ssp export does, too."),
    "a case of several experiments": ("experiments", "fmu-didim identify, check and discover take it."),
    "a case of a model": ("model", "fmu-didim identify, check and simulate take it; with --ssp export does, too."),
    "a robot description": ("joints", "Name it in a case, robot: ...; fmu-didim export makes an FMU."),
}
"""Kind of a file -> the key that identifies it, and its purpose."""


def _other_kind(content: dict[str, Any], model: type[BaseModel]) -> str:
    """Which kind a document is instead, by keys that this model has not; empty where it has one that the model has."""
    known = {info.alias or name for name, info in model.model_fields.items()}
    found = {kind: mark in known for kind, (mark, _) in KINDS.items() if mark in content}
    return "" if not found or any(found.values()) else next(iter(found))


def problems(error: ValidationError, model: type[BaseModel], lines: Lines | None = None) -> list[str]:
    """The problems of a document, each with its line, path and valid names, without those that are to be filled in."""
    details = [d for d in details_of(error) if lines is None or d.get("input") != TO_FILL_IN]
    return [("" if lines is None else lines.of(d["loc"])) + _problem(d, model) for d in details]


def why_unread(error: Exception, model: type[BaseModel]) -> str:
    """Why a saved document could not be read, in a line."""
    found = problems(error, model) if isinstance(error, ValidationError) else [str(error)]
    return "; ".join(found)[:LONGEST_REASON]


def problems_error(found: Sequence[str], *, where: str) -> InputError:
    """The error that lists problems of a file."""
    count = "a problem" if len(found) == 1 else f"{len(found)} problems"
    listed = [*found[:MOST_PROBLEMS], *(["and others"] if len(found) > MOST_PROBLEMS else [])]
    return InputError(
        f"{Path(where).name} has {count}:\n" + "\n".join(f"  - {p}" for p in listed), where=where,
        next_step="Correct these entries in the file; fmu-didim validate FILE checks it again.",
    )  # fmt: skip


def read_document(model: type[Model], path: Path | str) -> Model:
    """Load and validate a YAML file; problems are reported with their lines."""
    content = load_yaml(path)
    return validate(model, content, where=str(path), lines=Lines(Path(path)), folder=Path(path).parent)


TO_FILL_IN = "EDIT"
"""Placeholder in a generated file for what only the user knows."""


class Lines:
    """Where the entries of a YAML file stand, for messages; composed when it is first asked."""

    def __init__(self, path: Path) -> None:
        self._text = path.read_text(encoding="utf-8", errors="replace")

    @cached_property
    def _root(self) -> yaml.Node | None:
        try:
            return LOADER(self._text).get_single_node()  # type: ignore[no-any-return]
        except yaml.YAMLError:  # load_yaml reports it
            return None

    def of(self, location: Iterable[object], *, whole: bool = False) -> str:
        """``line 12, `` of the last part of a path that is found; parts that are no keys are skipped.

        Args:
            whole: whether it is empty unless all parts are found.
        """
        node, line = self._root, 0
        for part in location:
            if isinstance(node, yaml.MappingNode) and (
                found := next((pair for pair in node.value if pair[0].value == str(part)), None)
            ):
                node, line = found[1], found[0].start_mark.line + 1
            elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
                node = node.value[part]
                line = node.start_mark.line + 1
            elif whole:
                return ""
        return f"line {line}, " if line else ""

    def unfilled(self) -> list[tuple[str, str]]:
        """Place of each value that is still to be filled in, and the comment in its line."""
        if not re.search(rf"\b{TO_FILL_IN}\b", self._text):
            return []
        rows, found, seen = self._text.splitlines(), [], set[int]()
        for path, node in _scalars(self._root, ""):
            if node.value == TO_FILL_IN and id(node) not in seen:
                seen.add(id(node))  # once where it stands, not for each alias
                line = node.start_mark.line
                _, sign, note = rows[line].partition(" # ")
                found.append((f"line {line + 1}, {path}", f" ({note.strip()})" if sign else ""))
        return found


def _scalars(node: yaml.Node | None, path: str) -> Iterator[tuple[str, yaml.Node]]:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            yield from _scalars(value, f"{path}.{key.value}" if path else str(key.value))
    elif isinstance(node, yaml.SequenceNode):
        for i, value in enumerate(node.value):
            yield from _scalars(value, f"{path}.{i}")
    elif node is not None:
        yield path, node


def _problem(detail: Any, model: type[BaseModel]) -> str:
    location = [part for part in detail["loc"] if part != KEY and not OF_PYDANTIC.fullmatch(str(part))]
    path = ".".join(str(part)[:LONGEST] for part in location)
    if detail["type"] == "extra_forbidden":
        names = _fields_at(model, location[:-1])
        near = difflib.get_close_matches(str(location[-1])[:LONGEST], names, n=1)
        hint = f" Did you mean '{near[0]}'?" if near else ""
        return f"{path}: unknown key.{hint} Valid keys: {', '.join(names)}"
    message = in_words(detail)
    if detail["type"] == "missing":
        return f"{path}: {message}"
    if not path:  # of the document as a whole
        return message
    return f"{path}: {message} (got {_short(detail.get('input'))})"


def _short(value: object) -> str:
    """A value as text, without writing out more of it than is shown."""
    return _REPR.repr(value)[:LONGEST]


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
