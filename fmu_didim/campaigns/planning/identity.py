"""The identity of a run: a digest of everything that its result depends on."""

from __future__ import annotations

import importlib.util
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from contextlib import suppress
from modulefinder import ModuleFinder
from pathlib import Path
from typing import Any

from fmu_didim.base.cache import file_digest
from fmu_didim.base.documents import load_yaml
from fmu_didim.base.imports import is_reference, located
from fmu_didim.case.files import DATA_PREFIX, data_folder, how_to_get

NAMING = ("file", "source", "robot", "system")
"""Keys under which a case or a description names a file."""
PACKAGE = Path(__file__).parents[2]
REMARKS = ("description", "obtain")
"""Keys that change no result."""


class References:
    """The digests of files that cases name; each file is read once, so all runs of a plan see the same."""

    def __init__(self) -> None:
        # In ``absent``: names of missing files that canonical() met -> how to get them.
        self._known: dict[tuple[str, Path], Any] = {}
        self._missing: dict[tuple[str, Path], str] = {}
        self.absent: dict[str, str] = {}

    def canonical(self, value: Any, folder: Path, key: str = "", *, of_case: bool = True) -> Any:
        """A value in which numbers are floats, files are their digests, and descriptions their content.

        Args:
            folder: to which names of files are relative; key: under which the value stands.
            of_case: False in a description, whose ``source`` may be a book.
        """
        if isinstance(value, Mapping):
            kept = ((str(k), v) for k, v in value.items() if k not in REMARKS)
            of_case = of_case and key not in ("robot", "source")
            found = {k: self.canonical(v, folder, k, of_case=of_case) for k, v in kept}
            if (missing := self._missing.get((str(value.get("file")), folder))) in self.absent:
                self.absent[missing] = how_to_get(value["file"], str(value.get("obtain", "")))
            return found
        if isinstance(value, str):
            is_name = key in NAMING or is_reference(value)
            return self._reference(value, folder, required=of_case and key in NAMING) if is_name else value
        if isinstance(value, Sequence):
            return [self.canonical(v, folder, key, of_case=of_case) for v in value]
        return float(value) if isinstance(value, int) and not isinstance(value, bool) else value

    def _reference(self, name: str, folder: Path, *, required: bool) -> Any:
        known = (name, folder)
        if known not in self._known:
            self._known[known] = self._read(name, folder)
        if required and known in self._missing:
            self.absent.setdefault(self._missing[known], "")
        return self._known[known]

    def _read(self, name: str, folder: Path) -> Any:
        path = file_of(name, folder)
        if path is None or not path.is_file():
            self._missing[name, folder] = name if path is None else str(path)
            return name
        if path.suffix in (".yaml", ".yml"):
            return self.canonical(load_yaml(path), path.parent, of_case=False)
        content = [name.rpartition(":")[2] if path.suffix == ".py" else "", file_digest(path)]
        return content + [file_digest(p) for p in imported(path)] if path.suffix == ".py" else content


def imported(path: Path) -> list[Path]:
    """The Python files outside all installed packages that a Python file imports, also through one another."""
    installed = {Path(place).resolve() for place in sysconfig.get_paths().values()}
    own = [place for place in sys.path if not any(Path(place).resolve().is_relative_to(there) for there in installed)]
    finder = ModuleFinder(own, excludes=[PACKAGE.name])
    with suppress(SyntaxError, ValueError, OSError):  # loading the file reports these better
        finder.run_script(str(path))
    files = (getattr(module, "__file__", None) for name, module in sorted(finder.modules.items()) if name != "__main__")
    return [Path(file) for file in files if file]


def file_of(name: str, folder: Path) -> Path | None:
    """The file that a name in a case means: a path, one in the data folder, or that of a Python object."""
    if name.startswith(DATA_PREFIX):
        return data_folder(folder) / name.removeprefix(DATA_PREFIX)
    if not is_reference(name):
        return folder / name
    module = located(name, folder).rpartition(":")[0]
    if module.endswith(".py"):
        return folder / module
    with suppress(ImportError, ValueError):
        spec = importlib.util.find_spec(module)
        if spec is not None and spec.origin is not None:
            return Path(spec.origin)
    return None
