"""No module or folder imports itself by way of others: imports for type checking and inside functions count too."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import grimp
import pytest

from tests.conftest import ROOT


def cycles(package: str) -> list[str]:
    """The shortest circle of imports through each import that is part of one, as ``a -> b -> a``."""
    graph = grimp.build_graph(package, exclude_type_checking_imports=False, cache_dir=None)
    found = set()
    for importer in graph.modules:
        for imported in graph.find_modules_directly_imported_by(importer):
            way_back = graph.find_shortest_chain(importer=imported, imported=importer)
            if way_back is not None:
                first = way_back.index(min(way_back))  # the same circle, wherever it was entered
                circle = (*way_back[first:], *way_back[:first])
                found.add(" -> ".join((*circle, circle[0])))
    return sorted(found)


def test_the_package_has_no_import_cycles() -> None:
    assert cycles("fmu_didim") == []


@pytest.mark.parametrize(
    ("line_of_a", "line_of_b"),
    [
        ("from {0}.b import y", "from {0}.a import x"),
        ("from {0} import b", "def f():\n    from {0} import a"),
        ("import {0}.b", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from {0}.a import x"),
    ],
)
def test_cycles_are_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line_of_a: str, line_of_b: str) -> None:
    name = package(tmp_path, monkeypatch, {"a": line_of_a, "b": line_of_b})
    assert cycles(name) == [f"{name}.a -> {name}.b -> {name}.a"]


def test_longer_cycles_are_seen_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = {"a": "from {0} import b", "b": "from {0} import c", "c": "from {0} import a", "d": "from {0} import a"}
    name = package(tmp_path, monkeypatch, lines)
    assert cycles(name) == [f"{name}.a -> {name}.b -> {name}.c -> {name}.a"]


def test_a_package_may_import_its_modules_but_not_be_imported_by_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = {"__init__": "from {0}.a import x", "a": "from {0}.b import y", "b": "y = 1"}
    assert cycles(package(tmp_path / "good", monkeypatch, good)) == []
    name = package(tmp_path / "bad", monkeypatch, {**good, "b": "from {0} import x"})
    assert cycles(name) == [f"{name} -> {name}.a -> {name}.b -> {name}"]


def contracts_are_kept(config: Path) -> bool:
    """Whether import-linter finds all contracts of a configuration kept; what is broken is printed. In a process of its
    own: it turns off all loggers of that in which it runs."""
    lint = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(sys.argv[1], no_cache=True))"
    command = [sys.executable, "-c", lint, str(config)]
    return subprocess.run(command, env=os.environ | {"PYTHONPATH": str(config.parent)}, check=False).returncode == 0


def test_layers_and_sibling_folders_have_no_import_cycles() -> None:
    """What the command ``lint-imports`` says of the contracts in pyproject.toml."""
    assert contracts_are_kept(ROOT / "pyproject.toml")


@pytest.mark.parametrize("way_back", [True, False])
def test_cycles_of_folders_are_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way_back: bool) -> None:
    """No module imports itself here: a.one -> b.two, b.three -> a.four."""
    place = tmp_path / f"made_folders_{way_back}"
    back = "from {0}.a import four" if way_back else ""
    lines = {"a/one": "from {0}.b import two", "b/two": "", "b/three": back, "a/four": ""}
    for module, text in {"__init__": "", "a/__init__": "", "b/__init__": "", **lines}.items():
        (place / module).parent.mkdir(parents=True, exist_ok=True)
        (place / f"{module}.py").write_text(text.format(place.name) + "\n", encoding="utf-8")
    config = tmp_path / "config.toml"
    config.write_text(
        f"""[tool.importlinter]
        root_package = "{place.name}"
        [[tool.importlinter.contracts]]
        name = "cycles"
        type = "acyclic_siblings"
        ancestors = ["{place.name}"]
        """,
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert cycles(place.name) == []
    assert contracts_are_kept(config) is not way_back


def package(folder: Path, monkeypatch: pytest.MonkeyPatch, modules: dict[str, str]) -> str:
    """Write a package, whose name stands for ``{0}`` in the text of its modules; returns the name."""
    name = f"made_{folder.name.replace('-', '_')}"
    place = folder / name
    place.mkdir(parents=True)
    for module, text in {"__init__": "", **modules}.items():
        (place / f"{module}.py").write_text(text.format(name) + "\n", encoding="utf-8")
    monkeypatch.syspath_prepend(folder)
    return name


def test_contributing_lists_the_layers_that_are_kept() -> None:
    """The list of CONTRIBUTING is that of the contract of import-linter, row by row."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    kept = next(c["layers"] for c in project["tool"]["importlinter"]["contracts"] if c["type"] == "layers")
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Layers")[2]
    rows = re.findall(r"^ {4}(\w+(?: \| \w+)*)", text.partition("\nThe engine")[0], re.M)
    assert rows == [layer.replace("fmu_didim.", "") for layer in kept]
