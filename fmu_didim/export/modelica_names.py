"""Variables of a Modelica model in the C code of the compiler: names that it does not use itself, and circles."""

from __future__ import annotations

import re
from collections.abc import Iterable

SUFFIX = "_of_the_model"
"""Behind a name while the model is compiled; the description of the FMU has the name as it was."""
C_WORDS = frozenset(re.findall(
    r"\w+",
    """auto bool break case char complex const continue default do double else enum extern false float for goto if
    inline int long register restrict return short signed sizeof static struct switch true typedef union unsigned void
    volatile while I errno NULL EOF NAN INFINITY""",
))  # fmt: skip
"""Keywords of C, and what its headers define as macros."""
SKELETON = """model FmuDidimSkeleton
  parameter Real fmu_didim_p = 1;
  input Real fmu_didim_u;
  output Real fmu_didim_y;
  Real fmu_didim_x(start = 0);
equation
  der(fmu_didim_x) = fmu_didim_p*fmu_didim_u;
  fmu_didim_y = fmu_didim_x;
end FmuDidimSkeleton;
"""
"""A model whose C code has no names but those of the compiler."""
_TOKENS = re.compile(r"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'|[A-Za-z_]\w*|==|<=|>=|.""", re.DOTALL)


def taken(code: Iterable[str]) -> frozenset[str]:
    """The names that C code, such as that of :data:`SKELETON`, uses itself."""
    return C_WORDS.union(*(re.findall(r"[A-Za-z_]\w*", text) for text in code))


def set_aside(text: str, names: Iterable[str]) -> str:
    """A Modelica text with :data:`SUFFIX` behind these variables; comments, texts and members of others stay.

    A name before ``=`` in parentheses is that of a modification (``Motor m(c = 1)``) or of an argument, and stays, too.
    """
    wanted, made, depth, before = frozenset(names), list[str](), 0, ""
    tokens = _TOKENS.findall(text)
    for i, token in enumerate(tokens):
        depth += {"(": 1, ")": -1}.get(token, 0)
        after = next((t for t in tokens[i + 1 :] if not t.isspace()), "") if token in wanted else ""
        is_other = before == "." or (depth > 0 and after == "=")
        made.append(f"{token}{SUFFIX}" if token in wanted and not is_other else token)
        if not token.isspace():
            before = token
    return "".join(made)


def restored(text: str) -> str:
    """A description with the names as they were."""
    return re.sub(rf"(?<=\w){SUFFIX}\b", "", text)


def circular(code: str) -> list[str]:
    """Variables that C code of rumoca computes from each other, as ``a = b; b = a``."""
    body = re.search(r"static void compute_algebraics\([^;{]*\)\s*\{.*?\n\}", code, re.DOTALL)
    assigned = re.findall(r"^\s*([A-Za-z_]\w*) = ([^;]*);", body[0], re.MULTILINE) if body else []
    needs: dict[str, set[str]] = {name: set() for name, _ in assigned}
    for name, expression in assigned:
        needs[name] |= needs.keys() & set(re.findall(r"[A-Za-z_]\w*", expression))
    while free := [name for name, others in needs.items() if not others]:
        for name in free:
            del needs[name]
        for others in needs.values():
            others.difference_update(free)
    return list(needs)
