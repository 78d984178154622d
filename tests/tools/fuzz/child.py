"""Reads inputs one after the other and prints what became of each; run in a process of its own, which may die."""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import time
import traceback
import warnings
from pathlib import Path

from fmu_didim.base.errors import FmuDidimError
from tests.tools.fuzz.targets import KINDS, forget, make

MEMORY = 2 * 2**30
LONGEST = 20_000
"""Characters of a message."""


def outcome(kind: str, path: Path) -> tuple[str, str]:
    """``taken``, ``refused`` or ``wrong``, and why."""
    try:
        KINDS[kind].read(path)
    except FmuDidimError as error:
        text = str(error)
        if not error.what or len(text) > LONGEST:
            return "wrong", f"a message of {len(text)} characters: {text[:300]}"
        return "refused", ""
    except BaseException:  # noqa: BLE001 - whatever it is, it is told
        return "wrong", traceback.format_exc(limit=-12)
    return "taken", ""


def main() -> None:
    """Arguments: kind, seed, first number, number after the last, folder, seconds of the processor for one input."""
    kind, folder, seconds = sys.argv[1], Path(sys.argv[5]), float(sys.argv[6])
    seed, first, end = map(int, sys.argv[2:5])
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print is none of them
    path = folder / f"input{KINDS[kind].suffix}"
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    for number in range(first, end):
        path.write_bytes(make(kind, seed, number))
        print(json.dumps({"begun": number}), file=answers, flush=True)
        before = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, seconds)
        what, why = outcome(kind, path)
        signal.setitimer(signal.ITIMER_PROF, 0)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        told = {"number": number, "what": what, "why": why, "seconds": time.process_time() - before, "peak_gb": peak}
        print(json.dumps(told), file=answers, flush=True)
        if number % 100 == 0:
            forget()


if __name__ == "__main__":
    main()
