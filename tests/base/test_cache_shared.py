"""One cache of several users: who reads, writes, is trusted; and where nothing can be written."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from fmu_didim.base import cache, files
from fmu_didim.base.cache import cache_directory, cached_folder
from fmu_didim.base.errors import InputError
from fmu_didim.base.files import whole_file
from fmu_didim.campaigns.running.store import unwritable
from fmu_didim.cli.main import main
from fmu_didim.workflow.output import result_folder

OWNERS = pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows has no such owners and permissions")
ROOT = Path(__file__).parents[2]
FIRST, SECOND, GROUP, OTHER_GROUP = 54321, 54322, 54300, 54301
"""Numbers of users and groups that no machine has."""


@pytest.fixture(autouse=True)
def _by_a_new_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "_compared", set())


def fill(folder: Path) -> None:
    (folder / "inner").mkdir()
    (folder / "inner" / "data").write_text("content", encoding="utf-8")
    (folder / "program").write_text("code", encoding="utf-8")
    (folder / "program").chmod(0o700)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


# ---- permissions -----------------------------------------------------------------------------------


@OWNERS
@pytest.mark.parametrize(
    ("of_folder", "folders", "file", "program"),
    [
        (0o700, 0o700, 0o600, 0o700),
        (0o755, 0o755, 0o644, 0o755),
        (0o775, 0o755, 0o644, 0o755),  # a group that nobody has made sharing
        (0o2775, 0o2775, 0o664, 0o775),
        (0o2770, 0o2770, 0o660, 0o770),
        (0o1777, 0o755, 0o644, 0o755),
    ],
)
@pytest.mark.parametrize("umask", [0o022, 0o077, 0o000])
def test_entries_follow_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, of_folder: int, folders: int, file: int, program: int, umask: int
) -> None:
    root = tmp_path / "cache"
    root.mkdir()
    root.chmod(of_folder)
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(root))
    before = os.umask(umask)
    try:
        content = cached_folder("loop", "key", fill)
        with cache.cache_file(root / "reruns" / "one.json") as temporary:
            temporary.write_text("{}", encoding="utf-8")
    finally:
        os.umask(before)
    entry = content.parent
    found = {mode(path) for path in (entry.parent, entry, content, content / "inner", root / "reruns")}
    assert found == {folders}
    assert {mode(p) for p in (entry / "files.json", content / "inner" / "data", root / "reruns" / "one.json")} == {file}
    assert mode(content / "program") == program


@OWNERS
@pytest.mark.parametrize(("umask", "wanted"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_file_follows_the_umask(tmp_path: Path, umask: int, wanted: int) -> None:
    before = os.umask(umask)
    try:
        with whole_file(tmp_path / "result.json") as temporary:
            assert temporary.suffix == ".json"
            temporary.write_text("{}", encoding="utf-8")
    finally:
        os.umask(before)
    assert mode(tmp_path / "result.json") == wanted
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


# ---- entries of others, told by what the system says of them ------------------------------------------


@pytest.fixture
def entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An entry of the cache."""
    (tmp_path / "cache").mkdir()
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))
    return cached_folder("loop", "key", fill).parent


def give(monkeypatch: pytest.MonkeyPatch, path: Path, user: int, *, readable: bool = True) -> None:
    """Have the system say that a file belongs to another user."""
    real, real_access = Path.lstat, os.access

    def lstat(self: Path) -> object:
        found = real(self)
        if self != path:
            return found
        return SimpleNamespace(st_uid=user, st_gid=found.st_gid, st_mode=found.st_mode, st_mtime=found.st_mtime)

    def access(asked: Path, how: int) -> bool:
        return (readable or Path(asked) != path) and real_access(asked, how)

    monkeypatch.setattr(cache, "HAS_OWNERS", True)
    monkeypatch.setattr(os, "getuid", lambda: FIRST, raising=False)
    monkeypatch.setattr(Path, "lstat", lstat)
    monkeypatch.setattr(os, "access", access)
    monkeypatch.setattr(cache, "owner", lambda path: f"user {user}")


@OWNERS
def test_an_entry_of_a_stranger_is_not_run(entry: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    give(monkeypatch, entry, SECOND)
    with pytest.raises(InputError, match=rf"would run as you[\s\S]*belongs to user {SECOND}[\s\S]*FMU_DIDIM_CACHE"):
        cached_folder("loop", "key", fill)
    assert not cache.is_trusted(entry)


@OWNERS
def test_the_folder_of_a_kind_counts_too(entry: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who owns it can put another entry in the place of one that is right."""
    give(monkeypatch, entry.parent, SECOND)
    with pytest.raises(InputError, match="would run as you"):
        cached_folder("loop", "key", fill)


@OWNERS
@pytest.mark.parametrize(
    ("root", "kind", "own", "trusted"),
    [
        (0o2775, 0o2775, 0o2775, True),
        (0o2770, 0o2770, 0o2770, True),
        (0o775, 0o775, 0o775, False),
        (0o2777, 0o2775, 0o2775, False),
        (0o3777, 0o2775, 0o2775, False),
        (0o2775, 0o2777, 0o2775, False),
        (0o2775, 0o2775, 0o2777, False),
    ],
)
def test_a_group_that_shares_the_folder_is_trusted(
    entry: Path, monkeypatch: pytest.MonkeyPatch, root: int, kind: int, own: int, trusted: bool
) -> None:
    """Where everybody may write, whatever is written has the group of the folder."""
    for place, permissions in zip((entry.parents[1], entry.parent, entry), (root, kind, own), strict=True):
        place.chmod(permissions)
    give(monkeypatch, entry, SECOND)
    assert cache.is_trusted(entry) is trusted


@OWNERS
def test_an_entry_that_cannot_be_read_is_no_damaged_one(
    entry: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    entry.parents[1].chmod(0o2775)
    give(monkeypatch, entry, SECOND, readable=False)
    with pytest.raises(InputError, match=rf"cannot be read[\s\S]*belongs to user {SECOND}[\s\S]*chmod -R g\+rwX"):
        cached_folder("loop", "key", fill)
    assert "damaged" not in caplog.text


def refusing(monkeypatch: pytest.MonkeyPatch, name: str, error: OSError) -> None:
    """Have the system refuse to move what has this name."""
    real = Path.rename

    def rename(self: Path, target: Path) -> Path:
        if self.name == name:
            raise error
        return real(self, target)

    monkeypatch.setattr(Path, "rename", rename)


def windows_error(code: int, name: str = "") -> OSError:
    """An error as Windows raises it, on any system."""
    number = {2: errno.ENOENT, 3: errno.ENOENT, 206: errno.ENOENT}.get(code, errno.EACCES)
    error = OSError(number, f"[WinError {code}]", name or None)
    error.winerror = code  # type: ignore[attr-defined, unused-ignore]
    return error


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (PermissionError(errno.EACCES, "Permission denied"), "Permission denied"),
        (windows_error(5), "in use by a program that runs"),
        (windows_error(32), "in use by a program that runs"),
    ],
)
def test_cache_clear_removes_what_it_may_and_says_what_not(
    entry: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: OSError, why: str
) -> None:
    """On Windows a library that is loaded cannot be removed."""
    other = cached_folder("loop", "other", fill).parent
    refusing(monkeypatch, entry.name, error)
    assert main(["cache", "clear"]) == 1
    said = capsys.readouterr()
    assert "1 entries removed" in said.out and f"1 entries kept ({why}), such as {entry}" in said.out
    assert "unexpected error" not in said.err
    assert not other.exists() and (entry / "content" / "program").is_file()
    assert [path.name for path in entry.parent.iterdir()] == [entry.name]


# ---- what Windows refuses for a moment -------------------------------------------------------------


@pytest.fixture
def waited(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The pauses that were made, without making them."""
    pauses: list[float] = []
    monkeypatch.setattr(files.time, "sleep", pauses.append)
    return pauses


@pytest.mark.parametrize("operation", ["rename", "replace"])
@pytest.mark.parametrize("code", files.HELD)
def test_a_fresh_file_is_moved_once_it_is_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waited: list[float], operation: str, code: int
) -> None:
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))
    real, refused = getattr(Path, operation), []

    def held(self: Path, target: Path) -> Path:
        if len(refused) < 3:
            refused.append(self)
            raise windows_error(code)
        return real(self, target)

    monkeypatch.setattr(Path, operation, held)
    if operation == "rename":
        assert (cached_folder("loop", "key", fill) / "program").is_file()
    else:
        with whole_file(tmp_path / "file") as temporary:
            temporary.write_text("content", encoding="utf-8")
        assert (tmp_path / "file").read_text(encoding="utf-8") == "content"
    assert waited == list(files.WAITS[:3])


def test_who_never_lets_go_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waited: list[float]) -> None:
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))

    def held(self: Path, target: Path) -> Path:
        raise windows_error(32)

    monkeypatch.setattr(Path, "rename", held)
    with pytest.raises(InputError, match=r"cannot be written[\s\S]*WinError 32"):
        cached_folder("loop", "key", fill)
    assert waited == list(files.WAITS)
    assert not list((tmp_path / "cache" / "loop").iterdir())


def test_no_permission_is_not_waited_for(tmp_path: Path, waited: list[float]) -> None:
    def refused() -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    with pytest.raises(PermissionError):
        files.patiently(refused)
    assert waited == []


@pytest.mark.parametrize(
    ("error", "too_long"),
    [
        (windows_error(206), True),
        (windows_error(3, "C:\\" + "x" * 250), True),
        (windows_error(3, "C:\\short"), False),
        (windows_error(5, "C:\\" + "x" * 250), False),
        (FileNotFoundError(errno.ENOENT, "No such file", "/" + "x" * 250), False),
    ],
)
def test_a_path_too_long_for_windows_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: OSError, too_long: bool
) -> None:
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path))

    def refused(folder: Path) -> None:
        raise error

    with pytest.raises(InputError) as caught:
        cached_folder("loop", "key", refused)
    short = "too long for Windows (260 characters): name another folder by FMU_DIDIM_CACHE with a short path"
    assert (short in str(caught.value)) is too_long
    with pytest.raises(InputError) as of_results, result_folder.reported_unwritable(tmp_path):
        raise error
    told = str(unwritable(tmp_path, error)), str(of_results.value)
    assert ["short path" in text for text in told] == [too_long] * 2


# ---- no place to write ---------------------------------------------------------------------------------


@pytest.fixture
def homeless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user whose cache folder cannot be written; the folder for temporary files."""
    (tmp_path / "file").write_text("", encoding="utf-8")
    (tmp_path / "temporary").mkdir()
    monkeypatch.delenv("FMU_DIDIM_CACHE", raising=False)
    monkeypatch.setattr(cache.platformdirs, "user_cache_path", lambda name: tmp_path / "file" / name)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    yield tmp_path / "temporary"
    os.environ.pop("FMU_DIDIM_CACHE", None)


def test_a_home_that_cannot_be_written(homeless: Path, caplog: pytest.LogCaptureFixture) -> None:
    found = cache_directory()
    assert found.parent == homeless
    if hasattr(os, "getuid"):
        assert mode(found) == 0o700
    content = cached_folder("loop", "key", fill)
    assert content.is_relative_to(found)
    (told,) = caplog.messages
    assert str(found) in told and "FMU_DIDIM_CACHE" in told and "\n" not in told
    assert os.environ["FMU_DIDIM_CACHE"] == str(found)  # for the processes that this one starts


def test_a_home_in_which_nothing_may_be_written(
    homeless: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """As root sees a file system that is read only."""
    (tmp_path / "home").mkdir()
    monkeypatch.setattr(cache.platformdirs, "user_cache_path", lambda name: tmp_path / "home")
    monkeypatch.setattr(os, "access", lambda path, how: Path(path) != tmp_path / "home")
    assert cache_directory().parent == homeless
    assert len(caplog.messages) == 1


def test_what_is_kept_there_is_found_again(homeless: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = cache_directory()
    monkeypatch.delenv("FMU_DIDIM_CACHE")
    assert cache_directory() == found


@OWNERS
@pytest.mark.parametrize("how", ["open to others", "a link", "a file"])
def test_a_temporary_folder_that_another_has_prepared(homeless: Path, tmp_path: Path, how: str) -> None:
    place = homeless / f"fmu_didim-{os.getuid()}"
    if how == "a link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        place.symlink_to(tmp_path / "elsewhere")
    elif how == "a file":
        place.touch(0o600)
    else:
        place.mkdir()
        place.chmod(0o777)
    with pytest.raises(InputError, match=r"cannot be written[\s\S]*others may write there[\s\S]*FMU_DIDIM_CACHE"):
        cache_directory()


def test_a_folder_that_was_named_is_never_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(InputError, match="cannot be written"):
        cache_directory()


# ---- real users ----------------------------------------------------------------------------------------

AS_USER = """
import os, sys
from fmu_didim.base import cache
from fmu_didim.cli import main as cli
from fmu_didim.base.errors import InputError
from pathlib import Path
root, user, group, umask, code = sys.argv[1:]
os.environ["FMU_DIDIM_CACHE"] = root
import contextlib, io, fmu_didim.campaigns.running.fmu_slots
with contextlib.redirect_stdout(io.StringIO()):  # imports what it needs: the other user may not reach the packages
    cli.main(["cache", "show"])
def fill(folder):
    (folder / "inner").mkdir()
    (folder / "inner" / "data").write_text("content")
def never(folder):
    raise AssertionError("it is there already")
os.umask(int(umask, 8))
os.setgroups([int(group)])
os.setresgid(int(group), int(group), int(group))
os.setresuid(int(user), int(user), int(user))
try:
    exec(code)
except InputError as error:
    print(error)
"""


@pytest.fixture
def shared() -> Iterator[Path]:
    """A folder that all users reach."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0 or sys.platform != "linux":
        pytest.skip("only root on Linux can become other users")
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        (Path(name) / "cache").mkdir()
        os.chown(Path(name) / "cache", FIRST, GROUP)
        yield Path(name) / "cache"


def run_as(root: Path, user: int, code: str, *, group: int = GROUP, umask: str = "022") -> str:
    """What code prints that another user runs."""
    command = [sys.executable, "-c", AS_USER, str(root), str(user), str(group), umask, code]
    known = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, encoding="utf-8", env=known, check=False)
    assert done.returncode == 0, done.stderr
    assert "damaged" not in done.stderr
    return done.stdout


FILL = "print(cache.cached_folder('loop', 'key', fill))"
FOUND = "print((cache.cached_folder('loop', 'key', never) / 'inner' / 'data').read_text())"
CLEAR = "cli.main(['cache', 'clear'])"


@pytest.mark.gate
@pytest.mark.parametrize("umask", ["022", "077"])
def test_a_group_shares_a_cache(shared: Path, umask: str) -> None:
    shared.chmod(0o2775)
    run_as(shared, FIRST, FILL, umask=umask)
    assert run_as(shared, SECOND, FOUND) == "content\n"
    write = "with cache.cache_file(Path(root) / 'reruns' / 'x') as t: t.write_text('{}')"
    for user in (FIRST, SECOND):
        run_as(shared, user, write, umask=umask)
        slot = "with fmu_didim.campaigns.running.fmu_slots.fmu_slots({Path('a.fmu'): 1}, lambda: False): print('held')"
        assert run_as(shared, user, slot, umask=umask) == "held\n"
    assert "entries removed" in run_as(shared, SECOND, CLEAR) and not list((shared / "loop").iterdir())
    run_as(shared, SECOND, FILL, umask=umask)
    assert run_as(shared, FIRST, FOUND) == "content\n"


def test_each_has_a_compiler_of_its_own(shared: Path) -> None:
    """Zig gives what it keeps permissions of its own, which no group shares."""
    shared.chmod(0o2775)
    for user in (FIRST, SECOND):
        own = "print((cache.own_folder('zig') / 'kept').write_text('x'), cache.own_folder('zig').name)"
        assert run_as(shared, user, own) == f"1 {user}\n"
    shared.chmod(0o755)
    (shared / "zig").chmod(0o755)
    said = run_as(shared, SECOND + 1, "cache.own_folder('zig')", group=OTHER_GROUP)
    assert "cannot be written" in said and f"belongs to user {FIRST}" in said


def test_entries_of_earlier_versions_are_told(shared: Path) -> None:
    """They were readable for their owner alone."""
    shared.chmod(0o2775)
    run_as(shared, FIRST, FILL)
    (shared / "loop" / "key.2").chmod(0o700)
    said = run_as(shared, SECOND, FILL)
    assert "cannot be read" in said and f"user {FIRST}" in said and "chmod -R g+rwX" in said
    run_as(shared, SECOND, "cache.cached_folder('loop', 'other', fill)")
    said = run_as(shared, SECOND, CLEAR)
    assert "1 entries removed" in said and f"1 entries kept (belongs to user {FIRST})" in said


def test_a_folder_that_is_not_shared(shared: Path) -> None:
    shared.chmod(0o755)
    run_as(shared, FIRST, FILL)
    assert run_as(shared, SECOND, FOUND, group=OTHER_GROUP) == "content\n"  # who named the folder trusts its owner
    said = run_as(shared, SECOND, "cache.cached_folder('loop', 'other', fill)", group=OTHER_GROUP)
    assert "cannot be written" in said and f"belongs to user {FIRST}" in said and "FMU_DIDIM_CACHE" in said
    assert f"1 entries kept (belongs to user {FIRST})" in run_as(shared, SECOND, CLEAR, group=OTHER_GROUP)
    assert run_as(shared, FIRST, FOUND) == "content\n"


def test_a_folder_for_everybody(shared: Path) -> None:
    """As one below that for temporary files: what a stranger has put there is not run."""
    os.chown(shared, 0, 0)
    shared.chmod(0o1777)
    run_as(shared, FIRST, FILL)
    said = run_as(shared, SECOND, FOUND, group=OTHER_GROUP)
    assert "would run as you" in said and f"user {FIRST}" in said
    assert run_as(shared, FIRST, FOUND) == "content\n"
