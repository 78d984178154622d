"""Fuzz everything that is read: ``python -m tests.tools.fuzz --count 10000``.

Must hold for every input: it is taken, or refused by an error of the project; within 10 s of an idle processor, without
a crash, within 2 GB. What breaks that is kept in the folder of --out with its traceback; ``--seed``, the kind and the
number make the same input again.
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.patience import patience
from tests.tools.fuzz.targets import KINDS, ROOT, make

SECONDS = 10.0
"""Of the processor, for one input; then the system ends the process. More on a machine that is slower or busy."""
WAIT = 120.0
"""Seconds for one input, also where it does nothing."""


@dataclass
class Result:
    """Of the inputs of one kind: how many were taken, refused, wrong; what was wrong; slowest (s) and peak (GB)."""

    kind: str
    counts: Counter[str] = field(default_factory=Counter)
    wrong: dict[int, str] = field(default_factory=dict)
    seconds: float = 0.0
    peak_gb: float = 0.0

    def add(self, number: int, told: dict[str, Any]) -> None:
        self.counts[told["what"]] += 1
        self.seconds = max(self.seconds, told["seconds"])
        self.peak_gb = max(self.peak_gb, told["peak_gb"])
        if told["what"] == "wrong":
            self.wrong[number] = told["why"]

    def line(self) -> str:
        c = self.counts
        return (
            f"{self.kind:12} {sum(c.values()):6} {c['taken']:7} {c['refused']:8} {c['wrong']:6} "
            f"{self.seconds:9.1f} {self.peak_gb:9.2f}"
        )


HEAD = f"{'kind':12} {'inputs':>6} {'taken':>7} {'refused':>8} {'wrong':>6} {'slowest s':>9} {'peak GB':>9}"


def fuzz(kind: str, seed: int, count: int, folder: Path) -> Result:
    """Read the inputs 0 to count - 1 of a kind."""
    result, number = Result(kind), 0
    while number < count:
        number = _one_process(kind, seed, number, count, folder, result)
    return result


def _one_process(kind: str, seed: int, first: int, end: int, folder: Path, result: Result) -> int:
    """Read inputs until the process ends; returns the number of the next one."""
    environment = os.environ | {
        "FMU_DIDIM_CACHE": str(folder / "cache"), "FMU_DIDIM_FUZZ": str(folder), "OPENBLAS_NUM_THREADS": "1"
    }  # fmt: skip
    command = [sys.executable, "-m", "tests.tools.fuzz.child", kind, str(seed), str(first), str(end), str(folder),
               str(patience(SECONDS))]  # fmt: skip
    with (folder / "errors.txt").open("w+", encoding="utf-8", errors="replace") as errors:
        begun, done = first - 1, first - 1
        with subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=errors, text=True, encoding="utf-8"
        ) as child:
            for line in _lines(child):
                told = json.loads(line)
                if "begun" in told:
                    begun = told["begun"]
                else:
                    done = told["number"]
                    result.add(done, told)
        code = child.returncode
        if code == 0 and done == end - 1:
            return end
        errors.seek(0)
        if begun == done:
            raise SystemExit(f"the process that reads {kind} ended ({code}) by itself:\n{errors.read()[-3000:]}")
        why = {-27: f"{SECONDS:g} s of the processor were not enough", -9: "it was killed: no end, or no memory"}.get(
            code
        )
        why = f"{why or f'crash, exit status {code}'}\n{errors.read()[-2000:]}"
        result.add(begun, {"what": "wrong", "why": why, "seconds": 0.0, "peak_gb": 0.0})
        return begun + 1


def _lines(child: subprocess.Popen[str]) -> Iterator[str]:
    """What the process prints; where nothing comes for long it is ended."""
    lines: queue.Queue[str] = queue.Queue()

    def pass_on() -> None:
        assert child.stdout is not None
        for line in child.stdout:
            lines.put(line)
        lines.put("")

    thread = threading.Thread(target=pass_on)
    thread.start()
    try:
        while line := lines.get(timeout=patience(WAIT)):
            yield line
    except queue.Empty:
        child.kill()
    thread.join()


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.fuzz", description=__doc__)
    parser.add_argument("--count", type=int, default=900, help="inputs in all (900)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"of {', '.join(KINDS)}")
    parser.add_argument(
        "--out", type=Path, default=Path("results/fuzz"), help="folder for what is wrong (results/fuzz)"
    )
    options = parser.parse_args(arguments)
    kinds, wrong = options.kinds.split(","), 0
    print(HEAD)
    for kind in kinds:
        with tempfile.TemporaryDirectory(prefix="fmu_didim-fuzz-") as folder:
            os.environ["FMU_DIDIM_FUZZ"] = folder
            result = fuzz(kind, options.seed, -(-options.count // len(kinds)), Path(folder))
            print(result.line(), flush=True)
            wrong += len(result.wrong)
            for number, why in result.wrong.items():
                options.out.mkdir(parents=True, exist_ok=True)
                name = f"{kind}-{options.seed}-{number}"
                (options.out / f"{name}{KINDS[kind].suffix}").write_bytes(make(kind, options.seed, number))
                (options.out / f"{name}.txt").write_text(why, encoding="utf-8")
                print(f"    {name}: {why.strip().splitlines()[-1][:150] if why.strip() else ''}")
    print("nothing wrong" if not wrong else f"{wrong} inputs: see {options.out}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
