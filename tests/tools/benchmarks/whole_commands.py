"""Seconds of a whole ``fmu-didim identify``, from the prompt to the report: what a user waits for."""

from __future__ import annotations

import statistics
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import yaml

from fmu_didim.data.excitation import Fourier
from tests.checks.data.right import CASES, RATES, loaded, logged
from tests.checks.data.right import NOISE as RIGHT_NOISE
from tests.helpers import ROOT
from tests.tools.benchmarks import tx40
from tests.tools.benchmarks.command_start import command
from tests.tools.benchmarks.figure import Figure, Settings
from tests.tools.benchmarks.tx40_simulation import LOG_HZ

EXAMPLES = {
    "SCARA, torque at 10 Hz": ("examples/scara/identify.yaml", 2.0),
    "double pendulum, measured, 30 s": ("examples/double_pendulum/identify.yaml", 3.0),
    "a model of a house, two parameters": ("examples/house/identify.yaml", 3.0),
    "a model of a batch, two replicates, four parameters": ("examples/batch/identify.yaml", 3.0),
}
"""Title -> case, and within how many seconds the answer is wanted."""
TX40_S = {5000: 5.0, 1000: 5.0}
"""Rate of the control in Hz -> the same for a TX40, held-out motion included."""
NOISE = 0.05
"""[N.m] Of its torque."""
PUMA, PUMA_S = "puma560", 3.0
"""A case of `tests.checks.data.right`, the control at 1 kHz, and within how many seconds the answer is wanted."""


def run(settings: Settings) -> list[Figure]:
    """Warm: what a first run builds is kept."""
    with tempfile.TemporaryDirectory() as name:
        return [_figure(*one, Path(name), settings) for one in _cases(Path(name), settings)]


def _cases(folder: Path, settings: Settings) -> Iterator[tuple[str, Path, float]]:
    """Title, case and goal of each."""
    for title, (path, goal) in EXAMPLES.items():
        yield title, ROOT / path, goal
    for rate_hz, goal in TX40_S.items():
        made = folder / str(rate_hz)
        made.mkdir()
        yield f"TX40, torque at 100 Hz, control at {rate_hz / 1000:g} kHz", _tx40(made, rate_hz, settings), goal
    yield "Puma 560, torque at 100 Hz, control at 1 kHz", _puma(folder), PUMA_S


def _puma(folder: Path) -> Path:
    """A case of a Puma along its own motions, with a held-out one, simulated by the loop and with noise of 3 %."""
    source, model = ROOT / CASES[PUMA], loaded(PUMA)
    content = yaml.safe_load(source.read_text(encoding="utf-8"))
    content["robot"] = str(source.parent / content["robot"])
    content["controller"]["source"] = str(source.parent / content["controller"]["source"])
    for seed, (section, label) in enumerate((("train", "estimation"), ("validation", "validation"))):
        logging = logged(model, label, model.experiments[label].reference, RATES[PUMA])
        torque = logging.torque(logging.start, label)
        torque += RIGHT_NOISE * torque.std(axis=0) * np.random.default_rng(seed).normal(size=torque.shape)
        tx40.write_log(folder / f"{section}.csv", logging.experiments[label].time, torque)
        content[section]["torque"] = {"file": str(folder / f"{section}.csv")}
    path = folder / "puma.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def _tx40(folder: Path, rate_hz: int, settings: Settings) -> Path:
    """A case of a TX40 with a held-out motion, simulated by the C program."""
    duration_s, controller = settings.size(10, 4), tx40.CONTROLLERS[rate_hz]
    ticks = np.arange(0, round(duration_s * rate_hz), rate_hz // LOG_HZ)
    substeps = tx40.SUBSTEPS * (tx40.RATE_HZ // rate_hz) ** 2

    def log(motion: Fourier, seed: int) -> np.ndarray:
        torque = tx40.program(motion, controller=controller, substeps=substeps).runner(ticks)()[:, :6]
        return torque + NOISE * np.random.default_rng(seed).normal(size=torque.shape)

    motions = [tx40.excitation(seed=seed, duration_s=duration_s) for seed in (1, 2)]
    tx40.write_log(folder / "held_out.csv", ticks / rate_hz, log(motions[1], 2))
    path = tx40.write_case(folder, motions[0], ticks / rate_hz, log(motions[0], 1), controller=controller)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["validation"] = {"reference": motions[1].model_dump(mode="json"), "torque": {"file": "held_out.csv"}}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def _figure(title: str, case: Path, goal: float, folder: Path, settings: Settings) -> Figure:
    """Of one case; a doubtful answer ends the command with another code, which is no failure here."""
    call = [*command(), "identify", str(case), "--out", str(folder / "result")]
    rounds = []
    for again in range(1 + settings.size(3, 1, settings.repeats)):
        begin = time.perf_counter()
        done = subprocess.run(call, capture_output=True, text=True)
        rounds += [time.perf_counter() - begin] if again else []  # the first one builds
        assert "Report: " in done.stdout, done.stderr[-2000:]
    raw = {"best_s": min(rounds), "longest_s": max(rounds)}
    return Figure(f"identify as a whole command, {title}, seconds", statistics.median(rounds), goal, "at most", raw)
