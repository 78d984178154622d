"""Runs of the command line in processes of their own, and what they leave, compared with runs that went well."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tests.patience import patience

ROOT = Path(__file__).parents[3]
ENDS = {0, 1, 3, 4}
"""Exit codes of runs that end by themselves; a crash has another."""
_TIMES = re.compile(r"\d{4}-\d\d-\d\dT[\d:.+]+")
LIMITED = """import resource, sys
from fmu_didim.cli.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
sys.exit(main(sys.argv[2:]))"""
PLAIN = "import sys; from fmu_didim.cli.main import main; sys.exit(main())"


@dataclass(frozen=True)
class Verb:
    """A verb with two ways to call it, whose results differ.

    Attributes:
        head: the file without which there is no result; ways: label -> arguments but for ``--out``.
    """

    name: str
    head: str
    ways: Mapping[str, Sequence[str]]


@dataclass(frozen=True)
class Done:
    """How a run ended: exit code (negative: the signal), what it printed, and how long it took in s."""

    code: int
    output: str
    errors: str
    seconds: float

    @property
    def is_clean(self) -> bool:
        """Whether it ended by itself and showed no traceback."""
        told = self.output + self.errors
        return self.code in ENDS and not re.search("Traceback|unexpected error|Exception ignored", told)


@dataclass
class Report:
    """What was tried and what was wrong."""

    tried: int = 0
    wrong: list[str] = field(default_factory=list)
    seen: dict[str, int] = field(default_factory=dict)

    def check(self, what: str, holds: bool, why: object = "") -> None:
        self.tried += 1
        if not holds:
            self.wrong.append(f"{what}: {why}"[:2000])

    def saw(self, what: str) -> None:
        self.seen[what] = self.seen.get(what, 0) + 1


def environment(cache: Path) -> dict[str, str]:
    return os.environ | {"FMU_DIDIM_CACHE": str(cache), "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}


@contextmanager
def started(arguments: Sequence[str], cache: Path, *, largest: int | None = None) -> Iterator[subprocess.Popen[str]]:
    """A run that has begun; ``largest``: of the files that it can write, in bytes. Killed if it is left."""
    begin = [PLAIN] if largest is None else [LIMITED, str(largest)]
    command = [sys.executable, "-c", *begin, *arguments]
    with subprocess.Popen(
        command, cwd=ROOT, env=environment(cache), text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def finished(process: subprocess.Popen[str], begun: float) -> Done:
    output, errors = process.communicate(timeout=patience(600))
    return Done(process.returncode, output, errors, time.monotonic() - begun)


def run(arguments: Sequence[str], cache: Path, *, largest: int | None = None) -> Done:
    """A run from begin to end."""
    begun = time.monotonic()
    with started(arguments, cache, largest=largest) as process:
        return finished(process, begun)


def killed(arguments: Sequence[str], cache: Path, seconds: float) -> Done:
    """A run that is killed after so many seconds, unless it was faster."""
    begun = time.monotonic()
    with started(arguments, cache) as process:
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
        return finished(process, begun)


def content(folder: Path) -> dict[str, str]:
    """Name -> digest of all files of a folder, but hidden ones; times and the folder itself are left out of them."""
    if not folder.is_dir():
        return {}
    return {p.name: _digest(p) for p in sorted(folder.iterdir()) if p.is_file() and not p.name.startswith(".")}


def _digest(path: Path) -> str:
    data = path.read_bytes()
    if path.suffix in (".html", ".json"):
        text = _TIMES.sub("", data.decode()).replace(str(path.parent), "")
        data = re.sub(r"""("seconds": |seconds</\w+>\s*<\w+>)[\d.]+|\d+(\.\d+)? (s|min|h)\b""", "", text).encode()
    elif path.suffix == ".fmu":
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            data = b"".join(name.encode() + archive.read(name) for name in sorted(archive.namelist()))
    return hashlib.sha256(data).hexdigest()


def state(verb: Verb, folder: Path, right: Mapping[str, Mapping[str, str]]) -> str:
    """``none``, ``unfinished``, which of the right results is in a folder, or how it differs from all of them."""
    found = content(folder)
    if verb.head not in found:
        return "none"
    for label, wanted in right.items():
        if found == wanted:
            return label
    told = json.loads((folder / verb.head).read_text(encoding="utf-8"))
    if told.get("answer") == "unfinished":
        return "unfinished"
    differ = {
        label: sorted(n for n in {*found, *wanted} if found.get(n) != wanted.get(n)) for label, wanted in right.items()
    }
    return f"half: differs from the right ones in {differ}"


def processes_of(cache: Path) -> list[str]:
    """Command lines of processes that still work in a cache."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            with (entry / "environ").open("rb") as stream:
                if str(cache).encode() in stream.read():
                    found.append((entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")[:200])
        except OSError:
            continue
    return found


def emptied(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder
