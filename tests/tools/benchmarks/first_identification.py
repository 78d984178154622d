"""The first identification ever on a machine: nothing in the cache, in a process of its own.

python -m tests.tools.benchmarks.first_identification
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

from tests.helpers import ROOT
from tests.tools.benchmarks.figure import Figure, Settings

EXAMPLE = ROOT / "examples/scara/identify.yaml"


class _Stopwatch:
    """Sums the time spent in some functions; a function inside another one counts for the inner one only."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._inner = [0.0]

    def watched(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            self._inner.append(0.0)
            begin = time.perf_counter()
            try:
                return function(*arguments, **options)
            finally:
                spent = time.perf_counter() - begin
                self.seconds[name] = self.seconds.get(name, 0.0) + spent - self._inner.pop()
                self._inner[-1] += spent

        return call


def _measure() -> dict[str, float]:
    """Seconds by phase in this process."""
    begin = time.perf_counter()
    import fmu_didim.export.build as build
    import fmu_didim.export.fmu as export
    import fmu_didim.model.loop_model as loop_model
    import fmu_didim.report as report
    import fmu_didim.workflow.output.result_folder as result_folder

    workflow = importlib.import_module("fmu_didim.workflow.identify")  # not the verb of the same name

    watch = _Stopwatch()
    watch.seconds["imports"] = time.perf_counter() - begin
    targets = [
        ("compile", build, "run_compiler"), ("code generation", export, "generate_c"),
        ("simulation", loop_model, "simulate"), ("report", report, "write_report"),
        ("reading and building the case", result_folder, "case_of"),
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as out:
        patches = [
            patch.object(module, name, watch.watched(key, getattr(module, name))) for key, module, name in targets
        ]
        for one in patches:
            one.start()
        watch.watched("the rest", workflow.identify)(EXAMPLE, out=out)
        for one in patches:
            one.stop()
    return watch.seconds


def run(settings: Settings) -> list[Figure]:
    """Reported: the whole process from its start, and where the time goes."""
    raw: dict[str, float] = {}
    for label, empty in (("first", True), ("second", False)):
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, **({"FMU_DIDIM_CACHE": folder} if empty else {})}
            if not empty:
                subprocess.run(_COMMAND, cwd=ROOT, env=environment, check=True, capture_output=True)
            begin = time.perf_counter()
            done = subprocess.run(_COMMAND, cwd=ROOT, env=environment, check=True, capture_output=True, text=True)
            raw[f"{label}_s"] = time.perf_counter() - begin
        phases = json.loads(done.stdout.splitlines()[-1])
        raw |= {f"{label}_{name.replace(' ', '_')}_s": value for name, value in phases.items()}
    return [
        Figure(
            "first identification, nothing cached / the next one", raw["first_s"] / raw["second_s"], None, "at most",
            raw,
            "the SCARA example with its report, a process each; compile: the C compiler; simulation: calls of simulate",
        )
    ]  # fmt: skip


_COMMAND = [sys.executable, "-m", "tests.tools.benchmarks.first_identification"]

if __name__ == "__main__":
    assert Path(EXAMPLE).is_file()
    print(json.dumps(_measure()))
