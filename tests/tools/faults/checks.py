"""The faults: each check takes a place to work in and tells in a report what was wrong."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import yaml

from tests.patience import patience
from tests.tools.faults.runs import (
    ROOT,
    Done,
    Report,
    Verb,
    content,
    emptied,
    finished,
    killed,
    processes_of,
    run,
    started,
    state,
)

SCARA = ROOT / "examples/scara/identify.yaml"
ARM = str(ROOT / "examples/arm2r/discover.yaml")


@dataclass
class Place:
    """A folder to work in, with the right results of all ways to call the verbs, and a warm cache."""

    folder: Path

    @cached_property
    def verbs(self) -> dict[str, Verb]:
        other = self.folder / "other.yaml"
        document = yaml.safe_load(SCARA.read_text(encoding="utf-8"))
        document["robot"] = str(SCARA.parent / document["robot"])
        document["controller"]["source"] = str(SCARA.parent / document["controller"]["source"])
        for name in ("train", "validation"):
            document[name]["torque"]["file"] = str(SCARA.parent / document[name]["torque"]["file"])
        document["train"]["torque"]["rate_hz"] = 5
        other.write_text(yaml.safe_dump(document), encoding="utf-8")
        return {
            "identify": Verb(
                "identify", "result.json", {"a": ["identify", str(SCARA)], "b": ["identify", str(other)]}
            ),
            "discover": Verb(
                "discover", "findings.json", {"a": ["discover", ARM], "b": ["discover", ARM, "--rounds", "1"]}
            ),
        }  # fmt: skip

    @property
    def cache(self) -> Path:
        return self.folder / "cache"

    def right(self, verb: Verb) -> Mapping[str, Mapping[str, str]]:
        """Label -> content of the results of runs that nothing disturbs, of which there are two for each."""
        if verb.name not in self._right:
            found: dict[str, Mapping[str, str]] = {}
            for label in verb.ways:
                out = emptied(self.folder / "right")
                for _ in range(2):
                    done = self.call(verb, label, out)
                    if done.code not in (0, 4) or found.get(label, content(out)) != content(out):
                        raise SystemExit(f"an undisturbed run of {verb.name} {label} is not right: {done}")
                    found[label] = content(out)
                    self.seconds[verb.name, label] = done.seconds
            self._right[verb.name] = found
        return self._right[verb.name]

    @cached_property
    def _right(self) -> dict[str, Mapping[str, Mapping[str, str]]]:
        return {}

    @cached_property
    def seconds(self) -> dict[tuple[str, str], float]:
        return {}

    def call(self, verb: Verb, label: str, out: Path, *, cache: Path | None = None, largest: int | None = None) -> Done:
        return run([*verb.ways[label], "--out", str(out)], cache or self.cache, largest=largest)

    def check_next(self, report: Report, what: str, verb: Verb, label: str, out: Path, cache: Path) -> None:
        """The next run is right and leaves what an undisturbed one leaves."""
        done = self.call(verb, label, out, cache=cache)
        report.check(f"{what}, next run", done.is_clean and done.code in (0, 4), done)
        found = state(verb, out, self.right(verb))
        report.check(f"{what}, next result", found == label, found)


def kills(place: Place, report: Report, count: int, seed: int) -> None:
    """SIGKILL at random moments, over an earlier result of another case; every third time with an empty cache."""
    rng = random.Random(seed)
    for i in range(count):
        verb = place.verbs["discover" if i % 3 == 2 else "identify"]
        right = place.right(verb)
        cold = i % 4 == 3
        cache = emptied(place.folder / "cold") if cold else place.cache
        out = place.folder / f"killed_{verb.name}"
        before = state(verb, out, right)
        label = "b" if before == "a" else "a"
        seconds = rng.uniform(0.0, 1.02) * (place.seconds[verb.name, label] + (4.0 if cold else 0.0))
        done = killed([*verb.ways[label], "--out", str(out)], cache, seconds)
        found = state(verb, out, right)
        what = f"kill {i} of {verb.name} {label} after {seconds:.2f} s{' (cold)' if cold else ''}, over {before}"
        report.saw(f"{verb.name}: {'ended before' if done.code >= 0 else found.partition(':')[0]}")
        report.check(what, found in ("none", "unfinished", before, label), found)
        if found == label and done.code < 0:
            report.saw("killed after the result was whole")
        deadline = time.monotonic() + patience(20)
        while (left := processes_of(cache)) and time.monotonic() < deadline:
            time.sleep(0.1)
        report.check(f"{what}, processes", not left, left)
        place.check_next(report, what, verb, label, out, cache)


def full_disk(place: Place, report: Report) -> None:
    """Each file in turn is too large for the disk, by a limit of the system; the earlier result stays whole."""
    verb = place.verbs["identify"]
    right = place.right(verb)
    out = emptied(place.folder / "limited")
    place.check_next(report, "before", verb, "a", out, place.cache)
    sizes = sorted({1, 512, 4096, *(p.stat().st_size - 1 for p in out.iterdir()), 2_000_000})
    for largest in sizes:
        before = state(verb, out, right)
        done = place.call(verb, "b", out, largest=largest)
        _check_limited(report, f"files of at most {largest} bytes", done, before, state(verb, out, right))
    for largest in (1, 4096, 100_000, 1_000_000):
        cache, before = emptied(place.folder / "limited_cache"), state(verb, out, right)
        done = place.call(verb, "b", out, cache=cache, largest=largest)
        what = f"files of at most {largest} bytes, cold"
        _check_limited(report, what, done, before, state(verb, out, right))
        place.check_next(report, what, verb, "a", out, cache)


def _check_limited(report: Report, what: str, done: Done, before: str, found: str) -> None:
    """All of the new result, or the reason why not and all of the earlier one."""
    told = done.code == 0 or (done.code == 1 and bool(done.errors.strip()))
    report.saw(f"exit code {done.code}")
    report.check(what, done.is_clean and told, done)
    report.check(f"{what}, result", found == ("b" if done.code == 0 else before), found)


def _mounted(options: str, folder: Path) -> bool:
    folder.mkdir(parents=True, exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    return subprocess.run(command, capture_output=True).returncode == 0


def _fill(folder: Path, leave: int) -> None:
    """Leave so many bytes of a disk free."""
    free = shutil.disk_usage(folder).free - leave
    with (folder / ".filler").open("wb") as stream:
        while free > 0:
            piece = min(free, 2**20)
            try:
                stream.write(bytes(piece))
                stream.flush()
            except OSError:
                break
            free -= piece


def small_disk(place: Place, report: Report) -> None:
    """A disk that becomes full in the middle of a run, and a cache on one that is small; needs a mount namespace."""
    verb = place.verbs["identify"]
    right = place.right(verb)
    disk = place.folder / "disk"
    if not _mounted("size=40m", disk):
        report.saw("no small disks: mounting is not allowed here")
        return
    out = disk / "out"
    place.check_next(report, "before", verb, "a", out, place.cache)
    for leave in (0, 4096, 20_000, 40_000, 200_000, 3_000_000, 4_800_000, 4_900_000, 8_000_000):
        begun = time.monotonic()
        with started([*verb.ways["b"], "--out", str(out)], place.cache) as process:
            assert process.stdout is not None
            for line in process.stdout:
                if "didim 2" in line:  # the looks at the disk are over
                    break
            _fill(disk, leave)
            done = finished(process, begun)
        (disk / ".filler").unlink()
        what, found = f"{leave} bytes left in the middle", state(verb, out, right)
        report.saw(f"exit code {done.code} with {leave} bytes left")
        report.check(what, done.is_clean and (done.code == 1) == ("cannot be written" in done.errors), done)
        report.check(f"{what}, table", "ZZ1R" in done.output, done.output[-500:])
        report.check(f"{what}, result", found == ("a" if done.code == 1 else "b"), found)
        place.check_next(report, what, verb, "a", out, place.cache)
    cache = place.folder / "small_cache"
    for kilobytes in (4, 64, 256, 600, 1000, 3000, 10_000):
        _mounted(f"size={kilobytes}k", cache)
        done = place.call(verb, "b", out, cache=cache)
        what = f"a cache of {kilobytes} kB"
        report.saw(f"exit code {done.code} with {what}")
        report.check(what, done.is_clean and (done.code == 0 or bool(done.errors.strip())), done)
        report.check(f"{what}, result", state(verb, out, right) == ("b" if done.code == 0 else "a"))
        subprocess.run(["mount", "-o", "remount,size=200m", str(cache)], check=True)
        place.check_next(report, what, verb, "a", out, cache)
        subprocess.run(["umount", str(cache)], check=True)
    subprocess.run(["umount", str(disk)], check=True)


def _is_told(done: Done) -> bool:
    return "cannot be written" in done.errors or "is a file" in done.errors


def places_to_write(place: Place, report: Report) -> None:
    """Folders that are missing, read-only, files, or parts of files: told before any work, exit code 1."""
    verb = place.verbs["identify"]
    right = place.right(verb)
    file = place.folder / "file"
    file.write_text("mine", encoding="utf-8")
    wrong = {"a file": file, "below a file": file / "out", "where nobody writes": Path("/proc/out")}
    read_only = place.folder / "read_only"
    if _mounted("size=1m,ro", read_only):
        wrong |= {"read-only": read_only, "below a read-only one": read_only / "deep" / "out"}
    for what, out in wrong.items():
        done = place.call(verb, "a", out)
        report.check(what, done.code == 1 and done.is_clean and _is_told(done), done)
        done = run(["identify", str(place.folder / "no_such_case.yaml"), "--out", str(out)], place.cache)
        report.check(f"{what}, before the case is read", done.code == 1 and _is_told(done), done)
        cached = place.call(verb, "a", place.folder / "unused", cache=out)
        told = "cache" in cached.errors and "FMU_DIDIM_CACHE" in cached.errors
        report.check(f"{what} as cache", cached.code == 1 and cached.is_clean and told, cached)
    report.check("a file stays", file.read_text(encoding="utf-8") == "mine")
    out = place.folder / "new" / "deep" / "out"
    place.check_next(report, "missing folders", verb, "a", out, place.folder / "new" / "cache")
    if read_only.is_mount():
        warm = place.folder / "warm_read_only"
        subprocess.run(["cp", "-a", str(place.cache), str(warm)], check=True)
        subprocess.run(["mount", "--bind", str(warm), str(warm)], check=True)
        subprocess.run(["mount", "-o", "remount,ro,bind", str(warm)], check=True)
        done = place.call(verb, "a", out, cache=warm)
        report.saw(f"exit code {done.code} with a cache that is warm and read-only")
        report.check("a warm cache that is read-only", done.is_clean and done.code in (0, 1), done)
        report.check("a warm cache that is read-only, result", state(verb, out, right) == "a")
        subprocess.run(["umount", str(warm)], check=True)
        subprocess.run(["umount", str(read_only)], check=True)


def _entries(cache: Path, kind: str) -> list[Path]:
    return sorted(p for p in (cache / kind).iterdir() if not p.name.startswith("."))


def _libraries(cache: Path) -> list[Path]:
    kinds = [cache / kind for kind in ("extracted", "loop", "variational") if (cache / kind).is_dir()]
    found = [p for kind in kinds for p in kind.rglob("*") if p.is_file()]
    return [p for p in found if p.suffix in (".so", ".dll", ".dylib", ".library")]


def _cut(path: Path, size: int) -> None:
    with path.open("r+b") as stream:
        stream.truncate(size)


def _flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(bytes(data))


def _replace_by_file(entry: Path) -> None:
    shutil.rmtree(entry)
    entry.write_bytes(b"x")


def _empty_content(cache: Path) -> None:
    for kind in ("exported", "extracted", "loop"):
        for entry in _entries(cache, kind):
            for path in entry.rglob("*"):
                if path.is_file() and path.name != "files.json":
                    path.unlink()


def _leave_partial(cache: Path) -> None:
    """Beside entries that have to be made anew: nothing is tidied up before."""
    for kind in ("exported", "extracted", "loop"):
        for entry in _entries(cache, kind):
            shutil.rmtree(entry)
        folder = cache / kind / ".partial-of-a-killed-run"
        folder.mkdir()
        (folder / "half").write_bytes(b"half")
        os.utime(folder, (0, 0))


DAMAGES: Mapping[str, Callable[[Path], object]] = {
    "libraries cut to half": lambda cache: [_cut(p, p.stat().st_size // 2) for p in _libraries(cache)],
    "libraries without content": lambda cache: [_cut(p, 0) for p in _libraries(cache)],
    "one byte of each library turned": lambda cache: [_flip(p) for p in _libraries(cache)],
    "exported FMUs cut short": lambda cache: [_cut(p, 100) for p in (cache / "exported").rglob("*.fmu")],
    "folders emptied": _empty_content,
    "lists of files gone": lambda cache: [p.unlink() for p in cache.glob("*/*/files.json")],
    "lists of files that are none": lambda cache: [p.write_bytes(b"[1, {") for p in cache.glob("*/*/files.json")],
    "sensitivities gone": lambda cache: shutil.rmtree(cache / "variational", ignore_errors=True),
    "files in place of folders": lambda cache: [_replace_by_file(e) for e in _entries(cache, "extracted")],
    "half of a killed run": _leave_partial,
}


def damages(place: Place, report: Report, names: tuple[str, ...] = tuple(DAMAGES)) -> None:
    """A cache that is damaged is made anew; nothing else shows it."""
    verb = place.verbs["identify"]
    place.right(verb)
    for name in names:
        cache = place.folder / "damaged"
        shutil.rmtree(cache, ignore_errors=True)
        shutil.copytree(place.cache, cache, symlinks=True)
        DAMAGES[name](cache)
        place.check_next(report, name, verb, "a", emptied(place.folder / "of_damaged"), cache)
        left = [str(p) for p in cache.glob("*/.partial-*")]
        report.check(f"{name}, partial folders", not left, left)


def at_once(place: Place, report: Report, count: int = 4) -> None:
    """Four processes at a time: with an empty cache, with a damaged one, and into one folder."""
    verb = place.verbs["identify"]
    right = place.right(verb)
    damaged = place.folder / "damaged_at_once"
    shutil.rmtree(damaged, ignore_errors=True)
    shutil.copytree(place.cache, damaged, symlinks=True)
    _empty_content(damaged)
    for what, cache in (("empty cache", emptied(place.folder / "once")), ("damaged cache", damaged), ("", place.cache)):
        same = not what
        outs = [place.folder / ("together" if same else f"once{k}") for k in range(count)]
        begun = time.monotonic()
        with ExitStack() as stack:
            ways = [verb.ways["ab"[k % 2] if same else "a"] for k in range(count)]
            running = [
                stack.enter_context(started([*way, "--out", str(out)], cache))
                for way, out in zip(ways, outs, strict=True)
            ]
            for process in running:
                done = finished(process, begun)
                report.check(f"{count} at once, {what or 'one folder'}", done.is_clean and done.code == 0, done)
        for out in set(outs):
            found = state(verb, out, right)
            report.check(f"{count} at once, {what or 'one folder'}, result", found in right, found)
