"""Memory and file handles after many runs of a loop, in a process of its own.

python -m tests.tools.benchmarks.reruns COUNT
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.helpers import ROOT
from tests.tools.benchmarks.figure import Figure, Settings

LIMIT_MB = 5.0


def _memory_mb() -> float:
    """Resident memory of this process, MB of 10^6 bytes."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    import resource

    return pages * resource.getpagesize() / 1e6


def _handles() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def _measure(count: int) -> dict[str, float]:
    """Run the SCARA loop ``count`` times, each with other parameters, after a tenth as many to warm up."""
    from tests.tools.benchmarks import scara
    from tests.tools.benchmarks.scara_loop import ours

    model = scara.model()
    ticks = np.arange(40, dtype=np.int64)

    def runs(number: int) -> None:
        for i in range(number):
            ours(model, model.start * (1 + 0.01 * np.sin(i)), ticks)

    runs(max(count // 10, 10))
    memory, handles = _memory_mb(), _handles()
    runs(count)
    return {
        "runs": float(count), "growth_mb": _memory_mb() - memory, "handles_left": float(_handles() - handles),
        "memory_before_mb": memory, "handles_before": float(handles),
    }  # fmt: skip


def run(settings: Settings) -> list[Figure]:
    """Growth of the resident memory over its limit, and handles that are left."""
    count = settings.size(10_000, 100)
    if not Path("/proc/self/statm").exists():
        return [Figure(f"memory after {count} runs", None, 1.0, note="only Linux tells a process its memory here")]
    done = subprocess.run(
        [sys.executable, "-m", "tests.tools.benchmarks.reruns", str(count)],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    found = json.loads(done.stdout.splitlines()[-1])
    return [
        Figure(f"memory after {count} runs / {LIMIT_MB:g} MB", found["growth_mb"] / LIMIT_MB, 1.0, "at most", found),
        Figure(f"file handles left after {count} runs", found["handles_left"], 0.0, "at most", found),
    ]


if __name__ == "__main__":
    print(json.dumps(_measure(int(sys.argv[1]))))
