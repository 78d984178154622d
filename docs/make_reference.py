"""Writes docs/reference: every key, effect, code, command and public name, from the models of the package themselves.

    python docs/make_reference.py

The tables of docs/examples.md come from examples/index.toml. The build of the documentation runs it, and a test says
when what is committed is not what it writes.
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel

import fmu_didim
from fmu_didim.base import docstrings
from fmu_didim.base.diagnostics import Severity
from fmu_didim.campaigns.planning.document import CampaignDocument
from fmu_didim.case.document import CaseDocument
from fmu_didim.cli.examples import examples
from fmu_didim.cli.main import command_parser
from fmu_didim.controllers import LAWS
from fmu_didim.dynamics.effects import DEFAULT_EFFECTS, EFFECTS, Effect, Parameter
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.estimators import ESTIMATORS
from fmu_didim.results.comparison import ComparisonDocument
from fmu_didim.results.findings import FindingsDocument
from fmu_didim.results.result import ResultDocument
from fmu_didim.results.watch import WatchDocument
from fmu_didim.workflow.reference.codes import all_codes

FOLDER = Path(__file__).parent / "reference"
NOTE = "<!-- Written by docs/make_reference.py from the package itself: change it there. -->"
BEGIN = "<!-- From examples/index.toml, by docs/make_reference.py: change it there. -->"
END = "<!-- Written by hand again. -->"
PLACES = {
    "torque balance": "In the torque balance of a joint, a column of the regressor and a term of the direct model.",
    "controller": "In the controller: factors of parameters that it has. At no joint: see `gains:` of a run.",
    "drive": "Between controller and plant, a component of its own in the wiring: a black-box plant gains it, too.",
    "sensor": "Between plant and controller, a component of its own in the wiring.",
    "structure": "In the structure of the robot: further states, or another frame.",
    "measurement": "In the log; the loop runs as without it. At no joint: see `torque: {log_shift_s: ...}`.",
}
SEVERITIES = {
    Severity.PROBLEM: "Nothing can be identified before it is fixed: the case is refused.",
    Severity.DOUBT: "The answer may be wrong, or less certain than it says: the verdict is *doubtful*.",
    Severity.REMARK: "To be known; the answer stands.",
}


def main() -> list[Path]:
    """Write all pages; returns those that have changed."""
    FOLDER.mkdir(exist_ok=True)
    changed = []
    for name, text in pages().items():
        path = FOLDER / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            changed.append(path)
    return changed


def pages() -> dict[str, str]:
    """Name of each file -> its content."""
    models = "A key without a default must be given, unless another one stands for it."
    result = "What `identify` writes beside its report. `result_schema()` gives it as JSON Schema."
    findings = "What `discover` writes beside its report. `findings_schema()` gives it as JSON Schema."
    history = "What `watch` writes beside its page. `watch_schema()` gives it as JSON Schema."
    comparison = "What `compare` writes beside its page. `comparison_schema()` gives it as JSON Schema."
    return {
        "case.md": _page("Keys of a case", models, *_model(CaseDocument)),
        "robot.md": _page("Keys of a robot description", models, *_model(RobotDescription)),
        "controller.md": _page("Keys of a controller description", models, *_laws()),
        "campaign.md": _page("Keys of a campaign", models, *_model(CampaignDocument)),
        "estimators.md": _page("Estimators and their options", *_estimators()),
        "effects.md": _page("Effects", *_effects()),
        "codes.md": _page("Codes of diagnostics", *_codes()),
        "result.md": _page("Keys of result.json", result, *_model(ResultDocument)),
        "findings.md": _page("Keys of findings.json", findings, *_model(FindingsDocument)),
        "compare.md": _page("Keys of compare.json", comparison, *_model(ComparisonDocument)),
        "watch.md": _page("Keys of watch.json", history, *_model(WatchDocument)),
        "commands.md": _page("Commands", *_commands(command_parser())),
        "api.md": _page("Python", *_api()),
        "../examples.md": _examples(),
    }


def _examples() -> str:
    """docs/examples.md with its tables anew."""
    parts = []
    for example in examples().values():
        rows = [
            (f"`{run.command}`", f"{run.shows}; needs {markdown(run.needs)}" if run.needs else run.shows)
            for run in example.runs
        ]
        needs = f" It needs {markdown(example.needs)}." if example.needs else ""
        parts.append(f"## {example.name}\n\n{example.sentence}.{needs}\n\n{_table(('command', 'what it shows'), rows)}")
    before, begin, rest = (FOLDER.parent / "examples.md").read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    return "\n\n".join([before + begin, *parts, end + after])


def _page(title: str, *parts: str) -> str:
    return "\n\n".join([f"# {title}", NOTE, *(part for part in parts if part)]) + "\n"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of markdown texts; nothing without rows."""
    lines = ["| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) + " |" for row in rows]
    return "\n".join([f"| {' | '.join(heads)} |", "|" + "---|" * len(heads), *lines]) if lines else ""


def markdown(text: str) -> str:
    """A docstring's text as markdown: roles and double backquotes as code, all else as it stands."""
    text = re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"``\1``", text)
    parts = re.split(r"(``.+?``|`[^`]+`)", text)
    return "".join(f"`{p.strip('`')}`" if k % 2 else re.sub(r"([*<\[\]])", r"\\\1", p) for k, p in enumerate(parts))


def _paragraphs(text: str) -> str:
    """Paragraphs as markdown; those that are indented are code, those whose lines begin with a star are lists."""
    return "\n\n".join(_paragraph(block) for block in re.split(r"\n\n+", text) if block.strip())


def _paragraph(block: str) -> str:
    if block.startswith("    "):
        return f"```text\n{inspect.cleandoc(block)}\n```"
    if block.startswith("* "):
        return "\n".join(f"- {markdown(' '.join(item.split()))}" for item in re.split(r"(?:^|\n)\* ", block)[1:])
    return markdown(" ".join(block.split()))


def _model(model: type[BaseModel], level: int = 2) -> list[str]:
    """A document and all parts that it holds, a table of keys each."""
    schema = model.model_json_schema(by_alias=True)
    parts = {model.__name__: schema, **schema.get("$defs", {})}
    return [_keys(name, part, level) for name, part in parts.items() if "properties" in part]


def _keys(name: str, part: Mapping[str, Any], level: int) -> str:
    required = part.get("required", [])
    rows = [
        (f"`{key}`", _type(entry), "" if key in required else _default(entry), markdown(entry.get("description", "")))
        for key, entry in part["properties"].items()
    ]
    head = f"{'#' * level} {name}\n\n{_paragraphs(part.get('description', ''))}"
    return f"{head}\n\n{_table(('key', 'value', 'default', 'meaning'), rows)}"


def _default(entry: Mapping[str, Any]) -> str:
    if "default" not in entry or entry["default"] is None or entry["default"] in ({}, [], ""):
        return "–"
    return f"`{entry['default']}`" if not isinstance(entry["default"], dict) else "its own defaults"


def _type(entry: Mapping[str, Any]) -> str:
    """What a value may be, in words."""
    if "$ref" in entry:
        name = entry["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    for key in ("anyOf", "oneOf", "allOf"):
        if key in entry:
            return " or ".join(dict.fromkeys(_type(e) for e in entry[key] if e.get("type") != "null"))
    if "const" in entry or "enum" in entry:
        return ", ".join(f"`{value}`" for value in entry.get("enum", [entry.get("const")]))
    return _TYPES.get(entry.get("type", ""), lambda entry: "anything")(entry)


def _number(entry: Mapping[str, Any]) -> str:
    low, high = entry.get("minimum"), entry.get("maximum")
    word = "whole number" if entry["type"] == "integer" else "number"
    if "exclusiveMinimum" in entry:
        return f"{word} > {entry['exclusiveMinimum']:g}"
    if low is not None and high is not None:
        return f"{word}, {low:g} to {high:g}"
    return f"{word} ≥ {low:g}" if low is not None else word


def _list(entry: Mapping[str, Any]) -> str:
    if "prefixItems" in entry:
        return f"({', '.join(_type(e) for e in entry['prefixItems'])})"
    return f"list: {_type(entry.get('items', {}))}"


def _mapping(entry: Mapping[str, Any]) -> str:
    inner = entry.get("additionalProperties")
    return f"name → {_type(inner)}" if isinstance(inner, dict) else "mapping"


_TYPES: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "number": _number, "integer": _number, "array": _list, "object": _mapping,
    "string": lambda entry: "text", "boolean": lambda entry: "`true`, `false`", "null": lambda entry: "nothing",
}  # fmt: skip


def _laws() -> list[str]:
    return [
        "A controller description names its law; what else it may hold depends on that.",
        *(
            part.replace(f"## {law.__name__}", f"## law: {name}", 1)
            for name, law in LAWS.items()
            for part in _model(law)
        ),
    ]


def _estimators() -> list[str]:
    parts = ["`estimator: {kind: didim, ...}` of a case takes these options."]
    for name, estimator in ESTIMATORS.items():
        options = [f for f in dataclasses.fields(estimator) if f.init]
        texts = docstrings.key_texts(estimator, [f.name for f in options])
        rows = [(f"`{f.name}`", f"`{f.default}`", markdown(texts.get(f.name, ""))) for f in options]
        module = inspect.getmodule(estimator)
        theory = _paragraphs(inspect.cleandoc(module.__doc__ or ""))
        parts.append(f"## kind: {name}\n\n{theory}\n\n{_table(('option', 'default', 'meaning'), rows)}")
    return parts


def _effects() -> list[str]:
    default = ", ".join(f"`{name}`" for name in DEFAULT_EFFECTS)
    parts = [
        "What a robot description may list at a joint (`effects: [motor_inertia, viscous, coulomb, stribeck]`), and "
        f"what `discover` looks for. A joint that lists none has {default}.",
        "In equations `q`, `dq`, `ddq` are position, velocity and acceleration of the joint, `load` is the torque that "
        "it transmits to its link, and all else is a parameter. Units stand for revolute, then for prismatic joints.",
        _table(
            ("effect", "name", "place"),
            ((f"[{e.title}](#{_slug(e)})", f"`{e.name}`", e.place) for e in EFFECTS.values()),
        ),
    ]
    for place, text in PLACES.items():
        found = [effect for effect in EFFECTS.values() if effect.place == place]
        parts += [f"## {place.capitalize()}", text, *(_effect(effect) for effect in found)]
    return parts


def _slug(effect: Effect) -> str:
    return re.sub(r"[^\w\- ]", "", effect.title.lower()).replace(" ", "-")


def _effect(effect: Effect) -> str:
    rows = [(f"`{p.name}`", _unit(p), markdown(p.description), _limits(p)) for p in _parameters(effect)]
    alike = [e.name for e in EFFECTS.values() if e.class_name == effect.class_name and e is not effect]
    names = dict.fromkeys([*alike, *effect.confounded_with])
    lines = [
        f"### {effect.title}",
        f"`{effect.name}`: `{effect.equation}`",
        _table(("parameter", "unit", "meaning", "bounds"), rows),
        f"**Shows as** {markdown(effect.signature[:1].lower() + effect.signature[1:])}",
        f"**Hard to tell from** {', '.join(f'`{n}`' for n in names) or 'nothing in the catalogue'}. "
        f"**What splits them:** {markdown(effect.experiment)}",
        f"**Source:** {markdown(effect.source)}",
    ]
    return "\n\n".join(line for line in lines if line)


def _parameters(effect: Effect) -> list[Parameter]:
    return [*effect.own_parameters, *effect.own_shapes]


def _unit(parameter: Parameter) -> str:
    units = [parameter(kind).unit for kind in ("revolute", "prismatic") if parameter.exists(kind)]
    return ", ".join(dict.fromkeys(unit or "1" for unit in units))


def _limits(parameter: Parameter) -> str:
    neutral = [] if parameter.neutral is None else [f"none at {parameter.neutral:g}"]
    limits = [] if parameter.limits is None else [f"{parameter.limits[0]:g} to {parameter.limits[1]:g}"]
    return ", ".join([*limits, *neutral])


def _codes() -> list[str]:
    parts = ["What `check`, `identify` and `discover` say under a stable name; scripts may rely on the names."]
    codes = all_codes()
    for severity, text in SEVERITIES.items():
        found = [code for code in codes if code.severity is severity]
        parts += [f"## {severity.value.capitalize()}s", text]
        for code in found:
            parts += [f"### {code.name}", markdown(code.meaning)]
            parts += [f"*Next:* {markdown(code.next_step)}"] if code.next_step else []
    return parts


def _commands(parser: argparse.ArgumentParser) -> list[str]:
    """A command and those below it."""
    parts = []
    actions = [a for a in parser._actions if not isinstance(a, argparse._HelpAction)]
    nested = [a for a in actions if isinstance(a, argparse._SubParsersAction)]
    plain = [a for a in actions if a not in nested]
    if not nested or plain:
        usage = " ".join([parser.prog, *(_usage(a) for a in plain if not a.option_strings)])
        head = f"## {parser.prog}\n\n{_paragraphs(parser.description or '')}"
        rows = [(f"`{_option(a)}`", markdown(a.help or "")) for a in plain]
        examples = f"```text\n{parser.epilog}\n```" if parser.epilog else ""
        table = _table(("argument", "meaning"), rows)
        parts.append("\n\n".join(filter(None, [head, f"```text\n{usage}\n```", table, examples])))
    for action in nested:
        for name in sorted(action.choices):
            parts += _commands(action.choices[name])
    return parts


def _usage(action: argparse.Action) -> str:
    return f"[{action.metavar}]" if action.nargs in ("?", "*") else str(action.metavar or action.dest)


def _option(action: argparse.Action) -> str:
    names = ", ".join(action.option_strings)
    value = (
        ""
        if action.nargs == 0
        else str(action.metavar or (action.option_strings and action.dest.upper()) or action.dest)
    )
    return f"{names} {value}".strip()


def _api() -> list[str]:
    parts = [f"`import fmu_didim`: {len(fmu_didim.__all__)} names, each imported when it is first used.", _names()]
    parts += [_documented(name, getattr(fmu_didim, name)) for name in sorted(fmu_didim.__all__)]
    return parts


def _names() -> str:
    rows = [
        (f"[{name}](#{name.lower()})", markdown(_first(getattr(fmu_didim, name)))) for name in sorted(fmu_didim.__all__)
    ]
    return _table(("name", "what it is"), rows)


def _first(documented: object) -> str:
    return " ".join(docstrings.about(documented).partition("\n\n")[0].split())


def _documented(name: str, documented: Any) -> str:
    parts = [f"## {name}", f"```python\n{_signature(name, documented)}\n```", _paragraphs(docstrings.about(documented))]
    for head in docstrings.SECTIONS:
        text = docstrings.section(documented, head)
        items = re.split(r"\n(?=\S)", text) if text else []
        parts += [f"**{head}**", "\n".join(f"- {markdown(' '.join(item.split()))}" for item in items)] if items else []
    if inspect.isclass(documented):
        parts.append(_table(("member", "what it is"), _members(documented)))
    return "\n\n".join(part for part in parts if part)


def _signature(name: str, documented: Any) -> str:
    """How it is called; the annotations as they stand in the source, so that they are the same on every Python."""
    if inspect.isclass(documented) and not dataclasses.is_dataclass(documented):
        return f"class {name}"
    signature = inspect.signature(documented)
    shown = [p for p in signature.parameters.values() if not p.name.startswith("_")]
    arguments = [_argument(p) for p in shown]
    keyword = next((k for k, p in enumerate(shown) if p.kind is p.KEYWORD_ONLY), None)
    if keyword is not None:
        arguments.insert(keyword, "*")
    kept = ",\n    ".join(arguments)
    ends = "" if inspect.isclass(documented) else f" -> {_annotation(signature.return_annotation)}"
    joined = f"{name}({', '.join(arguments)}){ends}"
    return joined if len(joined) <= 100 else f"{name}(\n    {kept},\n){ends}"


def _argument(parameter: inspect.Parameter) -> str:
    text = f"{parameter.name}: {_annotation(parameter.annotation)}"
    if parameter.default is inspect.Parameter.empty:
        return text
    shown = repr(parameter.default)
    return f"{text} = {'...' if '<' in shown or len(shown) > 40 else shown}"


def _annotation(annotation: Any) -> str:
    return annotation.strip("'") if isinstance(annotation, str) else inspect.formatannotation(annotation)


def _members(documented: type) -> list[tuple[str, str]]:
    own = [(n, m) for n, m in vars(documented).items() if not n.startswith("_")]
    rows = []
    for name, member in own:
        found = (
            member.fget
            if isinstance(member, property)
            else getattr(member, "func", getattr(member, "__func__", member))
        )
        if not inspect.isfunction(found):
            continue
        is_method = inspect.isfunction(member) or isinstance(member, classmethod | staticmethod)
        rows.append((f"`{name}()`" if is_method else f"`{name}`", markdown(_first(found))))
    return rows


if __name__ == "__main__":
    for written in main():
        print(written)
