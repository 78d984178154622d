"""Disturb runs and look at what they leave: ``python -m tests.tools.faults``, about half an hour.

Kills at random moments, disks that become full, folders that cannot be written, caches that are damaged, four processes
at once. Must hold: the next run is right and leaves what an undisturbed one leaves; no result looks complete that is
not; messages and exit codes instead of tracebacks. Small disks and read-only folders need a mount namespace (unshare).
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tests.tools.faults import checks
from tests.tools.faults.runs import Report

INSIDE = "FMU_DIDIM_FAULTS_INSIDE"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.faults", description=__doc__)
    parser.add_argument("--kills", type=int, default=60, metavar="N")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--only", metavar="NAMES", help="some of: kills, full, small, places, damages, once")
    options = parser.parse_args(arguments)
    _own_mounts()
    all_checks: dict[str, Callable[[checks.Place, Report], None]] = {
        "damages": checks.damages,
        "places": checks.places_to_write,
        "full": checks.full_disk,
        "small": checks.small_disk,
        "once": checks.at_once,
        "kills": lambda place, report: checks.kills(place, report, options.kills, options.seed),
    }
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="fmu_didim-faults-") as folder:
        place = checks.Place(Path(folder))
        for name in options.only.split(",") if options.only else all_checks:
            report, begun = Report(), time.monotonic()
            all_checks[name](place, report)
            wrong += len(report.wrong)
            seconds = time.monotonic() - begun
            print(f"{name:8} {report.tried:4} looked at, {len(report.wrong)} wrong, {seconds:.0f} s", flush=True)
            for what, count in sorted(report.seen.items()):
                print(f"         {count:4} {what}")
            for what in report.wrong:
                print(f"    WRONG {what}", flush=True)
    return 1 if wrong else 0


def _own_mounts() -> None:
    """Begin again where mounts are seen by nobody else, if the system lets us."""
    unshare = shutil.which("unshare")
    if os.environ.get(INSIDE) or unshare is None or sys.platform != "linux":
        return
    os.environ[INSIDE] = "1"
    ways = ([unshare, "--mount"], [unshare, "--map-root-user", "--mount"])
    for way in ways:
        if os.spawnvp(os.P_WAIT, way[0], [*way, "true"]) == 0:
            os.execvp(way[0], [*way, sys.executable, "-m", "tests.tools.faults", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
