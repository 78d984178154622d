"""The folder of a run's results: all of a run is in it, or all of the one before.

A folder cannot be replaced as one everywhere (it may be the current one, a mount point, open in another program, or
hold files of the user), so the files are: all are written and brought to the disk in a hidden folder inside it, which
takes the place of nothing; only then are those of the earlier run moved aside and the new ones moved in, the one that
makes a result of them last. Where one cannot be moved, all go back. What a run has left is listed in a hidden file, so
that the next one takes away all of it and nothing else.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import Any

from fmu_didim.base.errors import InputError
from fmu_didim.base.files import advice, partial_folder, patiently, remove_stale, sync, whole_file
from fmu_didim.case import Case, CaseObjects, case_of
from fmu_didim.model.workers import MOST_WORKERS, side_by_side
from fmu_didim.workflow.case_files import paths_read

LEAST_FREE = 16 * 2**20
"""Bytes that must be free before a run begins: a page with its plots takes five million, its tables some more."""
_ADVICE = "Name another folder by --out, or make room; what an earlier run left there is as it was."


@dataclass(frozen=True)
class ResultFolder:
    """Where a verb writes its results.

    Attributes:
        verb: whose results; those of another verb in the same folder are left alone.
        head: the file without which the others are no result; fixed: others with names of their own.
        patterns: the names of all further ones.
        figures: whether the charts of the page are wanted as files, too.
        lists: key of ``head`` under which those of them are named that were written before there was a list of files.
    """

    folder: Path
    verb: str
    head: str
    fixed: tuple[str, ...]
    patterns: tuple[str, ...]
    lists: str
    figures: bool = False

    def check(self, *, reads: Iterable[Path] = ()) -> None:
        """Raise InputError, before any work, if the results could not be written.

        Args:
            reads: files that the run reads and that must not be replaced.
        """
        check_writable(self.folder)
        own = (self.head, *self.fixed, *self.patterns)
        for path in reads:
            if path.resolve().parent == self.folder.resolve() and any(fnmatch(path.name, name) for name in own):
                raise InputError(
                    "The case reads a file that its results would replace.", where=str(path),
                    next_step="Name another folder by --out.",
                )  # fmt: skip

    @contextmanager
    def written(self) -> Iterator[Path]:
        """A folder to write all results to, which then take the place of those of the earlier run.

        Raises:
            InputError: they could not be written; the earlier ones are as they were.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            remove_stale(self.folder)
            new = partial_folder(self.folder)
            try:
                yield new
                self._take_in(new)
            finally:
                shutil.rmtree(new, ignore_errors=True)
        except OSError as error:
            raise _unwritable(self.folder, error) from error

    def left(self) -> list[str]:
        """Names of the files that the last run left, beside its head."""
        return sorted(name for name in self._earlier() - {self.head} if (self.folder / name).is_file())

    def _take_in(self, new: Path) -> None:
        names = {path.name for path in new.iterdir()}
        side_by_side([partial(sync, new / name) for name in names], MOST_WORKERS)  # the disk takes them in one go
        known = self._earlier() | names
        self._write_list(known)
        aside = new / "replaced"
        aside.mkdir()
        moves = [(self.folder / name, aside / name) for name in self._head_first(known)]
        moves = [(old, place) for old, place in moves if old.is_file()]
        moves += [(new / name, self.folder / name) for name in reversed(self._head_first(names))]
        done: list[tuple[Path, Path]] = []
        try:
            for source, target in moves:
                patiently(partial(source.replace, target))
                done.append((source, target))
        except BaseException:  # Ctrl-C as well
            for source, target in reversed(done):
                with suppress(OSError):
                    target.replace(source)
            raise
        sync(self.folder)
        replaced = [partial(_remove, path) for path in aside.iterdir()]  # for each of which a disk may be waited for
        side_by_side([partial(self._write_list, names), *replaced], MOST_WORKERS)

    def _head_first(self, names: set[str]) -> list[str]:
        return sorted(names, key=lambda name: (name != self.head, name not in self.fixed, name))

    @property
    def _list(self) -> Path:
        return self.folder / f".fmu_didim_{self.verb}"

    def _write_list(self, names: set[str]) -> None:
        with whole_file(self._list) as temporary:
            temporary.write_text("\n".join(sorted(names)), encoding="utf-8")

    def _earlier(self) -> set[str]:
        """Names of the files that earlier runs have left, all of them in this folder."""
        names: list[str] = []
        try:
            names = self._list.read_text(encoding="utf-8").splitlines()
        except (OSError, ValueError):
            with suppress(OSError, ValueError, KeyError, AttributeError):
                listed = json.loads((self.folder / self.head).read_text(encoding="utf-8"))[self.lists]
                names = [str(name) for name in listed.values()]
        inside = {name for name in names if name not in ("", ".", "..") and not set(name) & set("/\\:\0")}
        return {self.head, *self.fixed, *inside}


def checked_case(
    case: Case | Path | str | Mapping[str, Any] | None, folder: ResultFolder | None, objects: CaseObjects
) -> Case:
    """The case with these objects, loaded once it is sure that its results can be written."""
    if folder is not None:
        folder.check()
    case = case_of(case, objects)
    if folder is not None:
        folder.check(reads=paths_read(case))
    return case


def _remove(path: Path) -> None:
    """Remove a file as far as it can be: what stays goes with its folder."""
    with suppress(OSError):
        path.unlink()


def check_writable(folder: Path) -> None:
    """Raise InputError if files could not be written to a folder, which is not made yet; nothing is left there."""
    try:
        path = folder.absolute()
        nearest = next(place for place in (path, *path.parents) if place.exists())
        if not nearest.is_dir():
            raise InputError(
                "The folder for the results is a file." if nearest == path else "A part of this path is a file.",
                where=str(folder), got=str(nearest), next_step="Name another folder by --out.",
            )  # fmt: skip
        with tempfile.TemporaryFile(dir=nearest):
            room = shutil.disk_usage(nearest)
    except OSError as error:
        raise _unwritable(folder, error) from error
    if room.total and room.free < LEAST_FREE:
        raise InputError(
            "The disk is full.", where=str(folder), got=f"{room.free / 2**20:.1f} MB free",
            valid=f"{LEAST_FREE / 2**20:.0f} MB and more", next_step="Make room, or name another folder by --out.",
        )  # fmt: skip


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` write a file, which takes the place of an earlier one as a whole; raises InputError if it fails."""
    with reported_unwritable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as temporary:
            write(temporary)


@contextmanager
def reported_unwritable(path: Path) -> Iterator[None]:
    """Report an error in writing a file or folder as an InputError."""
    try:
        yield
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(folder: Path, error: OSError) -> InputError:
    return InputError(
        "The results cannot be written.", where=str(folder), got=str(error), next_step=advice(error, _ADVICE)
    )
