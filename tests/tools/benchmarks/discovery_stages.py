"""Where the time of discovery goes on six joints: the stages on the TX40 of the examples, and what they simulate."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.helpers import ROOT
from tests.tools.benchmarks.counting import Run, runs_of_loops
from tests.tools.benchmarks.figure import Figure, Settings

STAGES: Mapping[str, str] = {
    "base model": "base_fit",
    "gap of the base model": "external_torques",
    "pre-check": "pre_check",
    "signatures of": "signatures",
    "competition": "selection",
}
"""How the line begins that discovery says when a stage begins -> name of the stage, which lasts until the next one."""
GOAL_S = 20.0
"""Within how many seconds an answer is wanted."""
CASES = ("load", "wrist")
"""Examples ``discover_<name>.yaml``; the second one only where time does not matter."""


@dataclass
class Stage:
    """What a stage took; where it was entered more than once, all together."""

    wall_s: float = 0.0
    cpu_s: float = 0.0
    runs: tuple[Run, ...] = ()


class _Watch:
    """Tells the stages apart by what discovery says, and takes their times."""

    def __init__(self, runs: Sequence[Run]) -> None:
        self.stages: dict[str, Stage] = {}
        self._runs = runs
        self._begin("reading")

    def _begin(self, name: str) -> None:
        self._name = name
        self._since = time.perf_counter(), time.process_time(), len(self._runs)
        self.stages.setdefault(name, Stage())

    def end(self) -> None:
        """The present stage ends."""
        wall, cpu, count = self._since
        stage = self.stages[self._name]
        stage.wall_s += time.perf_counter() - wall
        stage.cpu_s += time.process_time() - cpu
        stage.runs += tuple(self._runs[count:])

    def say(self, text: str) -> None:
        """The progress of discovery."""
        name = next((name for begin, name in STAGES.items() if text.startswith(begin)), None)
        if name is not None:
            self.end()
            self._begin(name)


def staged(case: Path, *, forbid: Sequence[str] = ()) -> tuple[dict[str, Stage], list[str]]:
    """The stages of a discovery by name, in the order in which they began, and what it found."""
    from fmu_didim import discover

    with runs_of_loops() as runs:
        progress = _Watch(runs)
        found = discover(case, progress=progress.say, forbid=forbid)
        progress.end()
    return progress.stages, [f"{f.effect} on joint {f.joint}" for f in found.findings]


def run(settings: Settings) -> list[Figure]:
    """Three figures a case: its time, the part of the signatures, and what those of each effect simulate."""
    from fmu_didim.dynamics.effects import EFFECTS

    forbid = [name for name, effect in EFFECTS.items() if not effect.is_linear] if settings.quick else []
    figures = []
    for name in CASES[: settings.size(1, 1, 2)]:
        case = ROOT / f"examples/tx40/discover_{name}.yaml"
        begin = time.perf_counter()
        stages, found = staged(case, forbid=forbid)
        first = time.perf_counter() - begin
        if not settings.quick:  # the first one may have compiled
            stages, found = staged(case, forbid=forbid)
        figures += _figures(name, stages, {"first_s": first}, found)
    return figures


def _figures(name: str, stages: Mapping[str, Stage], raw: Mapping[str, float], found: Sequence[str]) -> list[Figure]:
    whole_cpu = sum(stage.cpu_s for stage in stages.values())
    times = {"whole_s": sum(stage.wall_s for stage in stages.values()), "whole_cpu_s": whole_cpu}
    for key, stage in stages.items():
        times |= {f"{key}_s": stage.wall_s, f"{key}_cpu_s": stage.cpu_s, f"{key}_simulations": float(len(stage.runs))}
    signatures = stages["signatures"]
    simulated: dict[str, float] = {}
    for kind, count in Counter(_kind(run) for run in signatures.runs).most_common():
        simulated[f"{kind}_simulations"] = float(count)
        simulated[f"{kind}_cpu_s"] = sum(run.cpu_s for run in signatures.runs if _kind(run) == kind)
    return [
        Figure(f"discovery on six joints ({name}), warm, s", times["whole_s"], GOAL_S, "at most", {**raw, **times}),
        Figure(
            f"discovery on six joints ({name}): signatures / whole, time of the processor",
            signatures.cpu_s / whole_cpu, None, "at most", {}, f"found: {', '.join(found) or 'nothing'}",
        ),
        Figure(
            f"discovery on six joints ({name}): simulations / signatures, time of the processor",
            sum(run.cpu_s for run in signatures.runs) / signatures.cpu_s, None, "at most", simulated,
            "by the effect whose signature it is; the rest is building models, compiling and linear algebra",
        ),
    ]  # fmt: skip


def _kind(run: Run) -> str:
    """The effect that was simulated: several where one run has the derivatives of all."""
    kinds = set(run.effects)
    return kinds.pop() if len(kinds) == 1 else "several_by_derivatives" if kinds else "without_effect"


__all__ = ["run", "staged"]
