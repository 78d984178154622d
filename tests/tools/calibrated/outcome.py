"""A trial as a new user does it: ``init``, some edits, ``identify``; and how far its answer is from the reference."""

from __future__ import annotations

import csv
import difflib
import json
import os
import shutil
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from fmu_didim import identify
from fmu_didim.data.signals import Array
from tests.tools.benchmarks.command_start import command
from tests.tools.calibrated.reference import Reference, data, reference
from tests.tools.calibrated.trials import Trial

TIME_LIMIT_S = 600.0
"""[s] For one command."""


@dataclass(frozen=True)
class Outcome:
    """What came out of a trial.

    Attributes:
        lines: of YAML in the case, comments apart; edits: lines of what ``init`` wrote that the user changed.
        verdict: of the identification, or its error.
        apart: largest difference from the optimum of scipy, in its standard deviations; NaN without values.
        ratio: (least, largest) ratio of the standard deviations, ours over scipy's.
        seconds: of ``identify``, with the start of the program and the page; cpu_s: of the processor for it.
    """

    lines: int
    edits: int
    verdict: str
    apart: float = float("nan")
    ratio: tuple[float, float] = (float("nan"), float("nan"))
    seconds: float = float("nan")
    cpu_s: float = float("nan")


def written(path: Path, columns: Mapping[str, Array], instants: Array) -> None:
    """A CSV of columns over time, to the last bit."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *columns])
        writer.writerows(np.column_stack([instants, *columns.values()]).tolist())


def edited(made: str, trial: Trial) -> str:
    """The case that ``init`` made, after its user has stated the noise and what is sought."""
    case = yaml.safe_load(made)
    noise = ", ".join(f"{name}: {{std: {std:g}}}" for name, std in trial.outputs.items())
    sought = [
        f"  {name}: {{start: {trial.starts[name]:g}}}" if name in trial.starts else f"  {name}: {{}}"
        for name in trial.truth
    ]
    lines = []
    for line in made.splitlines():
        if line.startswith("measured:"):
            line = f"measured: {{file: {case['measured']}, columns: {{{noise}}}}}"
        elif line.lstrip("# ").split(":")[0] in (*trial.truth, *case["identify"]) and line.startswith("  "):
            continue
        lines.append(line)
    at = next(i for i, line in enumerate(lines) if line.startswith("identify:")) + 1
    return "\n".join([*lines[:at], *sought, *lines[at:], *trial.settings]) + "\n"


def counted(made: str, text: str) -> tuple[int, int]:
    """Lines of YAML, and lines that are in ``text`` and not in ``made``; what stands behind a # does not count."""

    def plain(whole: str) -> list[str]:
        return [kept for line in whole.splitlines() if (kept := line.split("#")[0].strip())]

    changed = difflib.SequenceMatcher(a=plain(made), b=plain(text), autojunk=False).get_opcodes()
    return len(plain(text)), sum(max(b2 - b1, a2 - a1) for tag, a1, a2, b1, b2 in changed if tag != "equal")


def prepared(trial: Trial, fmu: Path, folder: Path, seed: int) -> tuple[int, int, Mapping[str, Array]]:
    """The case in a folder: its lines, its edits, and what was measured."""
    folder.mkdir(parents=True)
    shutil.copy(fmu, folder / "model.fmu")
    measured = data(fmu, trial, seed)
    files = []
    if trial.driven():
        written(folder / "inputs.csv", trial.driven(), trial.instants)
        files.append("inputs.csv")
    written(folder / "measured.csv", measured, trial.instants)
    _command(folder, "init", *files, "measured.csv", "--model", "model.fmu")
    case = folder / "case.yaml"
    made = case.read_text(encoding="utf-8")
    case.write_text(edited(made, trial), encoding="utf-8")
    return *counted(made, case.read_text(encoding="utf-8")), measured


def tried(trial: Trial, fmu: Path, folder: Path, seed: int) -> Outcome:
    """One trial; without any error of ours it ends in an outcome."""
    lines, edits, measured = prepared(trial, fmu, folder, seed)
    done = _command(folder, "identify", "case.yaml", "--out", "result", "--json", check=False)
    if not done.stdout.strip():
        return Outcome(lines, edits, done.stderr.strip().splitlines()[-1][:200] if done.stderr.strip() else "no answer")
    result = json.loads(done.stdout)
    found = result["parameters"]
    wanted = reference(fmu, trial, measured, {name: trial.starts.get(name, trial.truth[name]) for name in trial.truth})
    ratios = [found[name]["std"] / wanted.deviations[name] for name in trial.truth]
    distance, ratio = apart(found, wanted), (min(ratios), max(ratios))
    return Outcome(lines, edits, result["verdict"], distance, ratio, done.seconds, done.cpu_s)


def discovered(folder: Path) -> tuple[float, float]:
    """Seconds of ``discover`` on the case of a trial that was tried, and those of the processor for it."""
    done = _command(folder, "discover", "case.yaml", "--out", "discovered", check=False)
    return done.seconds, done.cpu_s


def apart(found: Mapping[str, Mapping[str, float]], wanted: Reference) -> float:
    """The largest distance from the reference, in its standard deviations."""
    return max(abs(found[n]["value"] - value) / wanted.deviations[n] for n, value in wanted.values.items())


def covered(trial: Trial, fmu: Path, folder: Path, draws: int, seed: int) -> tuple[float, int]:
    """Share of the true values within their 95 % intervals over draws of the noise, and how many draws were valid."""
    prepared(trial, fmu, folder, seed)
    inside, valid = [], 0
    for draw in range(draws):
        written(folder / "measured.csv", data(fmu, trial, seed + 1 + draw), trial.instants)
        found = identify(folder / "case.yaml")
        valid += found.verdict == "valid"
        for name, true in trial.truth.items():
            low, high = found.parameters[name].interval
            inside.append(low <= true <= high)
    return float(np.mean(inside)), valid


@dataclass(frozen=True)
class _Done:
    stdout: str
    stderr: str
    seconds: float
    cpu_s: float


def _cpu_of_commands() -> float:
    """Seconds of the processor of all commands so far."""
    used = os.times()
    return used.children_user + used.children_system


def _command(folder: Path, *arguments: str, check: bool = True) -> _Done:
    begin, cpu_s = time.perf_counter(), _cpu_of_commands()
    done = subprocess.run(
        [*command(), *arguments], cwd=folder, capture_output=True, text=True,
        timeout=TIME_LIMIT_S, check=False,
    )  # fmt: skip
    if check and done.returncode:
        raise RuntimeError(f"fmu-didim {' '.join(arguments)}: {done.stdout}{done.stderr}")
    return _Done(done.stdout, done.stderr, time.perf_counter() - begin, _cpu_of_commands() - cpu_s)
