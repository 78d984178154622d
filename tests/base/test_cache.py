"""The cache: whole, made anew where it is damaged, not too large, and cleared on request."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import fmu_didim
from fmu_didim.base import cache
from fmu_didim.base.cache import COMPILER, KINDS, cached_folder, entries, limit_size
from fmu_didim.base.errors import InputError
from fmu_didim.cli.main import main
from fmu_didim.components.fmu import load_fmu, probe_fmu
from fmu_didim.components.fmu.reuse import reset as rerun_module
from tests.awkward.build import awkward_fmu, library
from tests.components.fmu.helpers import ONES, H, slave_outputs
from tests.helpers import drive

FILES = {"a.txt": "first", "inner/b.txt": "second"}


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of its own, seen as by a new process."""
    for macros in ((), ("RESET_KEEPS_STATE",)):
        library("slave", *macros)  # compiled before
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "_compared", set())
    monkeypatch.setattr(rerun_module, "_known", {})
    return tmp_path / "cache"


def fill(folder: Path) -> None:
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)


def never(folder: Path) -> None:
    raise AssertionError("it is there already")


def content(folder: Path) -> dict[str, str]:
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}


def empty(entry: Path) -> None:
    shutil.rmtree(entry)
    entry.mkdir()


def as_file(entry: Path) -> None:
    shutil.rmtree(entry)
    entry.write_text("")


def change_list(text: str) -> Callable[[Path], object]:
    return lambda entry: (entry / "files.json").write_text(text)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "truncated": lambda entry: (entry / "content" / "a.txt").write_text("fir"),
    "emptied": lambda entry: (entry / "content" / "inner" / "b.txt").write_text(""),
    "another byte": lambda entry: (entry / "content" / "a.txt").write_text("fIrst"),
    "a file is missing": lambda entry: (entry / "content" / "a.txt").unlink(),
    "a folder is missing": lambda entry: shutil.rmtree(entry / "content" / "inner"),
    "all is missing": empty,
    "a file in its place": as_file,
    "no list": lambda entry: (entry / "files.json").unlink(),
    "half a list": change_list('{"a.txt": [5,'),
    "no mapping": change_list("[1, 2]"),
    "no pairs": change_list('{"a.txt": 5}'),
    "no text": lambda entry: (entry / "files.json").write_bytes(b"\xff\xfe\x00"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_what_is_damaged_is_made_anew(root: Path, monkeypatch: pytest.MonkeyPatch, damage: str) -> None:
    folder = cached_folder("loop", "key", fill)
    assert content(folder) == FILES
    assert cached_folder("loop", "key", never) == folder
    DAMAGES[damage](folder.parent)
    monkeypatch.setattr(cache, "_compared", set())  # as in another process
    assert cached_folder("loop", "key", fill) == folder
    assert content(folder) == FILES
    assert cached_folder("loop", "key", never) == folder
    assert [path.name for path in (root / "loop").iterdir()] == [folder.parent.name]


def test_files_that_have_come_are_no_damage() -> None:
    """Some FMUs write into their folder."""
    folder = cached_folder("loop", "key", fill)
    (folder / "log.txt").write_text("from the FMU")
    assert cached_folder("loop", "key", never) == folder


def test_a_filling_that_fails_leaves_nothing(root: Path) -> None:
    def half(folder: Path) -> None:
        fill(folder)
        raise OSError("No space left on device")

    with pytest.raises(InputError, match=r"cannot be written[\s\S]*No space left"):
        cached_folder("loop", "key", half)
    assert not list((root / "loop").iterdir())


def test_of_two_at_once_the_first_stays() -> None:
    def meanwhile(folder: Path) -> None:
        fill(folder)
        cached_folder("loop", "key", fill)
        (folder / "a.txt").write_text("later")

    assert content(cached_folder("loop", "key", meanwhile)) == FILES


def test_given_up_folders_are_removed(root: Path) -> None:
    cached_folder("loop", "key", fill)
    for name, age in ((".partial-old", 1e6), (".partial-new", 10.0)):
        (root / "loop" / name).mkdir()
        os.utime(root / "loop" / name, (time.time() - age,) * 2)
    cached_folder("loop", "other", fill)
    assert {path.name for path in (root / "loop").glob(".partial-*")} == {".partial-new"}


def test_the_oldest_leave_first(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sizes 100, 200, ... by age; those of the last week and those of the compiler stay in any case."""
    week, now = cache.IN_USE, time.time()
    ages = {"a": 5 * week, "b": 4 * week, "c": 3 * week, "d": 2 * week, "e": 0.5 * week}
    for number, name in enumerate(ages, start=1):
        cached_folder("loop" if number % 2 else "ssp", name, lambda folder, n=number: write(folder, n))
    (root / "zig").mkdir()
    (root / "zig" / "old").write_bytes(b"0" * 10_000)
    os.utime(root / "zig" / "old", (0, 0))
    sizes = {entry.path.name[0]: entry.size for entry in entries()}
    for name, age in ages.items():
        (path,) = root.glob(f"*/{name}.2")
        os.utime(path, (now - age,) * 2)

    def left(limit: float, checked: float = 0.0) -> str:
        monkeypatch.setattr(cache, "LIMIT", limit)
        os.utime(root / ".size_checked", (now - 1e5 * (1 - checked),) * 2)
        limit_size()
        return "".join(sorted(path.name[0] for path in root.glob("*/*.2")))

    total = sum(size for name, size in sizes.items() if name in ages)
    assert left(total) == "abcde"
    assert left(total - 1, checked=1.0) == "abcde"  # looked at a moment ago
    assert left(total - 1) == "bcde"
    cached_folder("ssp", "b", never)  # used: the youngest now
    assert left(total - sizes["a"] - 1) == "bde"
    assert left(0) == "be"
    assert (root / "zig" / "old").is_file()


def write(folder: Path, number: int) -> None:
    (folder / "data").write_bytes(b"0" * 100 * number)


def test_all_that_is_kept_is_known() -> None:
    """Whatever the package puts into the cache can be shown and cleared."""
    used: set[str] = set()
    for path in Path(fmu_didim.__file__).parent.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        used |= set(re.findall(r'cached_folder\(\s*"(\w+)"|cache_directory\(\) / "(\w+)"', text))
    assert {name for pair in used for name in pair if name} | {COMPILER} == set(KINDS)


# ---- FMUs ------------------------------------------------------------------------------------------


def test_a_truncated_library_of_an_fmu(tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Loading one as it is would end the process with a bus error."""
    path = awkward_fmu(tmp_path)
    drive(load_fmu(path, isolated=True, rerun="re-instantiate"), ONES, H)
    (binary,) = root.glob("extracted/*/content/binaries/*/*")
    binary.write_bytes(binary.read_bytes()[:4096])
    monkeypatch.setattr(cache, "_compared", set())
    np.testing.assert_allclose(drive(load_fmu(path), ONES, H), slave_outputs(ONES))


@pytest.mark.gate
def test_the_command_cache(tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, other = awkward_fmu(tmp_path), awkward_fmu(tmp_path, "RESET_KEEPS_STATE")
    for path in (one, other):
        probe_fmu(load_fmu(path))
    (root / "mine").mkdir()
    (root / "mine" / "notes.txt").write_text("not of the package")
    assert main(["cache", "show"]) == 0
    shown = capsys.readouterr().out
    assert str(root) in shown
    for kind, count in (("extracted", 2), ("reruns", 2), ("exported", 0), ("total", 4)):
        assert re.search(rf"^{kind} +{count} +\d+\.\d MB", shown, re.MULTILINE)
    assert main(["cache", "clear", str(one)]) == 0
    assert "2 entries removed" in capsys.readouterr().out
    assert {entry.kind for entry in entries()} == {"extracted", "reruns"}
    digest = hashlib.sha256(other.read_bytes()).hexdigest()
    assert all(entry.path.name.startswith(digest) for entry in entries())
    assert main(["cache", "clear"]) == 0
    assert "2 entries removed" in capsys.readouterr().out
    assert not list(entries())
    assert (root / "mine" / "notes.txt").is_file()
    assert main(["cache", "clear", str(tmp_path / "nowhere.fmu")]) == 1
    assert "does not exist" in capsys.readouterr().err
    drive(load_fmu(one), ONES, H)


@pytest.mark.gate
def test_who_asks_at_the_same_time_never_loses_what_another_has_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path))

    def fill(folder: Path) -> None:
        (folder / "file").write_text("content", encoding="utf-8")

    def ask(_: int) -> int:
        return sum(not (cached_folder("exported", f"{key:032x}", fill) / "file").is_file() for key in range(60))

    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(ask, range(8))) == 0
    assert not list((tmp_path / "exported").glob(".partial-*"))


def test_clear_takes_fmus_alone(tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of a case nothing is kept: "0 entries removed" would say that its FMUs are made anew."""
    case = tmp_path / "case.yaml"
    case.write_text("schema: 1")
    assert main(["cache", "clear", str(case)]) == 1
    told = capsys.readouterr().err
    assert "an FMU, or no file" in told
    assert "cache clear" in told
    assert "case.yaml" in told
