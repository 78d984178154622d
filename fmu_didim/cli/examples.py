"""The examples that ship with the package: which there are, and one of them written into a folder, ready to run.

They are kept once, in ``examples``, ``fmus`` and ``controllers`` of the project; a wheel carries these three inside the
package. The files of an example are those that its commands name, those that these name, and so on. In the folder that
is written, robot and data lie beside the case; paths in the files and in the commands are adapted to that.
"""

from __future__ import annotations

import posixpath
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.base.files import is_file

TREES = ("examples", "fmus", "controllers")
"""The folders in which examples and what they need lie."""
INDEX = "examples/index.toml"
_PACKED = "shipped"
"""Folder of a wheel that holds the three, see pyproject.toml."""
_READ = (".yaml", ".py", ".mo")
"""Ends of files whose text may name others; tables are copied as they are."""
_NAME = re.compile(r"(?:\.\./)*[\w.-]*\w(?:/[\w.-]*\w)*")


@dataclass(frozen=True)
class ExampleCommand:
    """A command of an example.

    Attributes:
        command: as it is typed in a checkout; shows: what one sees.
        needs: what is not there at once; "" if nothing.
    """

    command: str
    shows: str
    needs: str = ""


@dataclass(frozen=True)
class Example:
    """An example.

    Attributes:
        sentence: what it is; runs: its commands, the one to begin with first.
        needs: what all of them need and is not shipped; "" if nothing.
    """

    name: str
    sentence: str
    runs: tuple[ExampleCommand, ...]
    needs: str = ""


@dataclass(frozen=True)
class Written:
    """An example in a folder of the user.

    Attributes:
        example: with the commands as they are typed in the folder; files: paths within it.
    """

    example: Example
    folder: Path
    files: tuple[PurePosixPath, ...]


def example_names() -> tuple[str, ...]:
    """Their names; none where this installation holds no examples."""
    try:
        return tuple(examples())
    except InputError:
        return ()


def examples() -> dict[str, Example]:
    """All examples by name, in the order in which they are shown.

    Raises:
        InputError: this installation holds none.
    """
    content = tomllib.loads((examples_root() / INDEX).read_text(encoding="utf-8"))
    return {
        name: Example(name, entry["is"], tuple(ExampleCommand(**run) for run in entry["run"]), entry.get("needs", ""))
        for name, entry in content.items()
    }


def write_example(name: str, folder: Path) -> Written:
    """Write an example into a folder, which is made if need be.

    Raises:
        InputError: there is no such example, the folder holds something already, or it cannot be written.
    """
    known = examples()
    if name not in known:
        raise UnknownNameError("example", name, known)
    example, adapted = known[name], _Adapted(examples_root())
    step = f"Name another folder: fmu-didim example {name} FOLDER."
    try:
        if folder.is_dir() and any(folder.iterdir()):
            raise InputError("The folder is not empty; nothing in it is touched.", where=str(folder), next_step=step)
        files = adapted.files(example)
        for place, content in files.items():
            path = folder / place
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("xb") as new:  # never over a file that appeared meanwhile
                new.write(content)
    except OSError as error:
        raise InputError("The example cannot be written.", where=str(folder), got=str(error), next_step=step) from error
    runs = tuple(replace(run, command=adapted.command(run.command)) for run in example.runs)
    return Written(replace(example, runs=runs), folder, tuple(files))


def examples_root() -> Path:
    """The folder that holds the three trees: inside an installed package, or the project around it."""
    package = Path(__file__).parents[1]
    for root in (package / _PACKED, package.parent):
        if is_file(root / INDEX):
            return root
    raise InputError(
        "This installation holds no examples.", where=str(package), next_step="Install the package anew from its wheel."
    )


class _Adapted:
    """Files and commands with the paths that they have in the folder that is written."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def command(self, text: str) -> str:
        """A command for a checkout as one for the folder."""
        return self._text(text, PurePosixPath())[0]

    def files(self, example: Example) -> Mapping[PurePosixPath, bytes]:
        """Content of each file by its place in the folder: what the commands name, what those name, and so on."""
        found: dict[PurePosixPath, bytes] = {}
        open_ = [file for run in example.runs for file in self._text(run.command, PurePosixPath())[1]]
        while open_:
            file = open_.pop(0)
            if (place := self._place(file)) in found:
                continue
            found[place] = (self._root / file).read_bytes()
            if file.suffix in _READ:
                text, named = self._text(found[place].decode("utf-8"), file.parent)
                found[place] = text.encode("utf-8")
                open_ += named
        return found

    def _text(self, text: str, folder: PurePosixPath) -> tuple[str, list[PurePosixPath]]:
        """A text of a file of this folder of the project, its paths adapted; and the files that it names."""
        named = []
        top = PurePosixPath()
        here = self._place(folder / "file").parent if folder != top else top

        def adapted(match: re.Match[str]) -> str:
            for start in (folder, top):  # relative to the file, or to the project
                file = PurePosixPath(posixpath.normpath(start / match[0]))
                if file.parts[0] in TREES and is_file(self._root / file):
                    named.append(file)
                    place = self._place(file)
                    return posixpath.relpath(place, here if start == folder else top)
            return match[0]

        return _NAME.sub(adapted, text), named

    def _place(self, file: PurePosixPath) -> PurePosixPath:
        """Where a file of the project goes: controllers keep their folder, all else lies at the top.

        Case and campaign must stay side by side: what a campaign varies are paths as the case has them.
        """
        return file if file.parts[0] == "controllers" else PurePosixPath(*file.parts[2:])
