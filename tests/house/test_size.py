"""Functions fit on a page, and the plan of the package on a hand."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "fmu_didim"
LONGEST_FUNCTION = 60
"""Lines of code, without docstring, blank lines and comments."""
MOST_ROOMS, MOST_ARROWS, MOST_FILES = 20, 120, 15
"""Rooms are the folders of the package, arrows the imports between them, files those side by side in a folder."""
CATALOGUES = ("dynamics/effects",)
"""Folders of one file an item."""


def lines_of_code(text: str) -> dict[str, int]:
    """Name and first line of each function -> its lines of code."""
    lines, found = text.splitlines(), {}
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        assert node.end_lineno is not None
        said = node.body[0] if ast.get_docstring(node) is not None else None
        of_docstring = range(0) if said is None else range(said.lineno, (said.end_lineno or 0) + 1)
        own = [lines[i - 1].strip() for i in range(node.lineno, node.end_lineno + 1) if i not in of_docstring]
        found[f"{node.name}:{node.lineno}"] = sum(bool(line) and not line.startswith("#") for line in own)
    return found


FUNCTIONS = '''
def f(
    a,
):
    """One.

    Two."""
    # why

    return a  # it

async def g(): pass

class A:
    def f(self):
        def g():
            return 1
        return g
'''


def test_lines_of_code_are_counted() -> None:
    assert lines_of_code(FUNCTIONS) == {"f:2": 4, "g:12": 1, "f:15": 4, "g:16": 2}


@pytest.mark.parametrize("path", sorted(PACKAGE.iterdir()), ids=lambda path: path.name)
def test_no_function_is_longer_than_a_page(path: Path) -> None:
    modules = [path] if path.suffix == ".py" else sorted(path.rglob("*.py"))
    found = {
        f"{module.relative_to(PACKAGE)}:{name}": count
        for module in modules
        for name, count in lines_of_code(module.read_text(encoding="utf-8")).items()
    }
    assert {name: count for name, count in found.items() if count > LONGEST_FUNCTION} == {}


def imports() -> Iterator[tuple[str, str]]:
    """Pairs of rooms of which the first imports the second."""
    for path in PACKAGE.rglob("*.py"):
        room = path.relative_to(PACKAGE).parts[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("fmu_didim."):
                yield room, str(node.module).split(".")[1]


def test_the_plan_of_the_package_is_small() -> None:
    rooms = {path.name for path in PACKAGE.iterdir() if path.is_dir() and any(path.glob("*.py"))}
    assert len(rooms) <= MOST_ROOMS
    assert len({(a, b) for a, b in imports() if a != b}) <= MOST_ARROWS
    folders = {path.parent for path in PACKAGE.rglob("*.py")}
    files = {
        str(folder.relative_to(PACKAGE)): len([p for p in folder.glob("*.py") if p.name != "__init__.py"])
        for folder in folders
    }
    assert {name: n for name, n in files.items() if n > MOST_FILES and name not in CATALOGUES} == {}
