"""How often the intervals of calibrated models hold: draws of noise on what SciPy simulates, through the verb identify.

    python -m tests.tools.model_coverage --seeds 100 --figures docs/figures/models.json

Three models: the house of examples/house (recorded inputs, one output), the batch of examples/batch (two replicates
that share some values, two outputs at instants of their own, noise of two kinds), and the clutch of tests/clutch.py
(two outputs, no input).
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom

from fmu_didim import identify, load_case
from fmu_didim.case import Case
from fmu_didim.data.signals import Array, trajectory
from tests.clutch import NOISE, TIME, TRUTH, speeds
from tests.figures import command_of, table, write_figures
from tests.helpers import ROOT


@cache
def script(task: str) -> Mapping[str, Any]:
    """What the script of an example defines that makes its data."""
    import runpy

    return runpy.run_path(str(ROOT / "examples" / task / "make_data.py"))


@cache
def of_house() -> tuple[Array, Array]:
    """Instants and temperature without noise."""
    rows = np.loadtxt(ROOT / "examples/house/weather.csv", delimiter=",", skiprows=1)
    return rows[:, 0], script("house")["true"](rows[:, 1], rows[:, 2], rows[:, 0])


def house(rng: np.random.Generator) -> Case:
    """The house with white noise."""
    time, room = of_house()
    log = trajectory(time, {"T": room + script("house")["NOISE"] * rng.normal(size=time.size)})
    content = {
        "schema": 1, "name": "house", "model": "house.fmu", "inputs": "weather.csv", "measured": "log",
        "identify": {"R1": {"minimum": 0}, "R2": {"minimum": 0}},
    }  # fmt: skip
    return load_case(content, folder=ROOT / "examples/house", signals={"log": log})


def batch(rng: np.random.Generator, mu_max: Sequence[float] = (0.45, 0.45)) -> Case:
    """Two replicates of the batch with noise as its case states it; ``mu_max``: of each."""
    made, signals, experiments = script("batch"), {}, {}
    time, every = made["STEP"] * np.arange(made["ROWS"]), made["EVERY"]
    for (name, x0), rate in zip(made["X0"].items(), mu_max, strict=True):
        biomass, substrate = made["true"](x0, time, rate).T
        noise = np.hypot(made["NOISE_X"], made["RELATIVE_X"] * biomass) * rng.normal(size=time.size)
        rare = substrate[::every] + made["NOISE_S"] * rng.normal(size=time[::every].size)
        signals[f"X {name}"] = trajectory(time, {"X": biomass + noise})
        signals[f"S {name}"] = trajectory(time[::every], {"S": rare})
        stated = {"X": {"std": made["NOISE_X"], "relative_std": made["RELATIVE_X"]}, "S": {"std": made["NOISE_S"]}}
        measured = [{"file": f"{output} {name}", "columns": {output: stated[output]}} for output in "XS"]
        experiments[name] = {"measured": measured}
    experiments["batch_2"]["own"] = ["X0"]
    content = {
        "schema": 1, "name": "batch", "model": "batch.fmu", "experiments": experiments,
        "identify": {name: {"minimum": 0} for name in ("mu_max", "Y_XS", "X0")},
    }  # fmt: skip
    return load_case(content, folder=ROOT / "examples/batch", signals=signals)


def clutch(rng: np.random.Generator) -> Case:
    """The clutch with white noise."""
    found = speeds(TRUTH["freqHz"], TRUTH["T2"])
    found = found + NOISE * rng.normal(size=found.shape)
    content = {
        "schema": 1, "name": "clutch", "model": {"kind": "control", "source": "tests.clutch:clutch"}, "measured": "log",
        "identify": {"T2": {}, "freqHz": {"minimum": 0}},
    }  # fmt: skip
    return load_case(content, signals={"log": trajectory(TIME, {"w1": found[:, 0], "w2": found[:, 1]})})


MODELS: Mapping[str, tuple[Callable[[np.random.Generator], Case], Mapping[str, float]]] = {
    "house": (house, {"R1": 0.02, "R2": 0.01}),
    "batch": (batch, {"mu_max": 0.45, "Y_XS": 0.55, "X0": 0.1, "X0[batch_2]": 0.14}),
    "clutch": (clutch, TRUTH),
}


SEED = 38
"""In front of the number of a draw: by that number alone the noise would be what made the weather of the house."""


@dataclass(frozen=True)
class Draw:
    """One identification: whether each interval of 95 % holds, and the errors in standard deviations."""

    holds: tuple[bool, ...]
    errors: tuple[float, ...]
    verdict: str


def draw(name: str, seed: int) -> Draw:
    """One draw of a model."""
    make, truth = MODELS[name]
    found = identify(make(np.random.default_rng([SEED, seed])))
    values = [found.parameters[one] for one in truth]
    holds = tuple(p.interval[0] <= true <= p.interval[1] for p, true in zip(values, truth.values(), strict=True))
    errors = tuple((p.value - true) / p.std for p, true in zip(values, truth.values(), strict=True))
    return Draw(holds, errors, found.verdict)


def row(name: str, draws: Sequence[Draw]) -> tuple[str, ...]:
    """A row of the table: how often the intervals held, the scatter over the stated deviation, the verdicts."""
    holds, errors = (np.array([getattr(one, what) for one in draws]) for what in ("holds", "errors"))
    each = ", ".join(f"{p} {100 * held:.0f}" for p, held in zip(MODELS[name][1], holds.mean(axis=0), strict=True))
    valid = sum(one.verdict == "valid" for one in draws)
    scatter = np.sqrt(np.mean(errors**2))
    return name, f"{100 * holds.mean():.1f} ({each})", f"{scatter:.2f}", f"{valid} of {len(draws)}"


HEADS = ("model", "intervals of 95 % that held, %", "errors / stated σ, rms", "valid")


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.model_coverage", description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", action="append", choices=MODELS)
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    options = parser.parse_args(arguments)
    rows = []
    with multiprocessing.get_context("spawn").Pool(options.processes) as pool:
        for name in options.only or MODELS:
            rows.append(row(name, pool.map(partial(draw, name), range(options.seeds), chunksize=1)))
            print(*rows[-1], sep="; ", file=sys.stderr, flush=True)
    low, high = (100 * binom.ppf(q, options.seeds, 0.95) / options.seeds for q in (0.025, 0.975))
    if options.figures:
        command = command_of(
            "tests.tools.model_coverage", ["--seeds", str(options.seeds), "--figures", str(options.figures)]
        )
        texts = {"table": table(HEADS, rows), "seeds": str(options.seeds), "chance": f"{low:.0f} to {high:.0f}"}
        write_figures(options.figures, command, texts)


if __name__ == "__main__":
    main()
