"""Monte Carlo of the SCARA identification: coverage of the intervals and efficiency.

    python -m tests.monte_carlo --rate 10 --seeds 1000 --json monte_carlo_10hz.json

For each seed, normal noise of 5 % of each joint's RMS torque is added to the simulated torque of the truth,
and the robot is identified. Three kinds of 95 % intervals are counted: those of the estimate (after the
efficient finish), those of DIDIM by the corrected formula, and those of DIDIM by the paper's eq. (8).
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy import stats

from fmu_didim.estimators import Didim
from fmu_didim.prediction.fit import point
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.weighting import NoiseOfResidual
from tests.helpers import ROOT, model_of, with_torque

CASES = {10: "identify.yaml", 200: "identify_200hz.yaml"}
NOISE = 0.05


@dataclass(frozen=True)
class DesignContext:
    """The model with noise-free torque, the truth, the noise and the Cramer-Rao bound of the parameters."""

    model: LoopModel
    truth: np.ndarray
    torque: np.ndarray
    noise: np.ndarray
    bound: np.ndarray


@lru_cache
def context(rate_hz: int) -> DesignContext:
    """The SCARA example with torque at ``rate_hz``."""
    model = model_of(ROOT / "examples/scara" / CASES[rate_hz])
    torque = model.torque(model.start)
    noise = NOISE * np.sqrt((torque**2).mean(axis=0))
    clean = with_torque(model, torque)
    known = replace(clean, torque_deviation=noise)
    bound = point(known, NoiseOfResidual(known)).bound
    return DesignContext(clean, model.start, torque, noise, np.sqrt(np.diag(bound)))


def one_seed(rate_hz: int, seed: int) -> dict[str, list[float]]:
    """Values and standard deviations of one identification."""
    here = context(rate_hz)
    measured = here.torque + here.noise * np.random.default_rng(seed).normal(size=here.torque.shape)
    estimate = Didim(start="reference", tolerance=1e-5).estimate(with_torque(here.model, measured))
    didim = estimate.stages["didim"]
    return {
        "value": estimate.value.tolist(),
        "std": estimate.standard_deviation.tolist(),
        "didim_value": didim.value.tolist(),
        "didim_std": didim.standard_deviation.tolist(),
        "freedom": [estimate.freedom],
        "paper_std": didim.formulas["paper"].tolist(),
    }


@dataclass(frozen=True)
class Summary:
    """Coverage in percent of each parameter's interval, and empirical over predicted standard deviation."""

    names: tuple[str, ...]
    coverage: np.ndarray
    coverage_didim: np.ndarray
    coverage_paper: np.ndarray
    efficiency: np.ndarray
    efficiency_didim: np.ndarray

    def text(self) -> str:
        """A table."""
        lines = ["              coverage of the 95 % interval, %         empirical std / Cramer-Rao bound"]
        lines += ["parameter     estimate   DIDIM   DIDIM, eq. (8)        estimate   DIDIM"]
        for i, name in enumerate(self.names):
            lines.append(
                f"{name:12} {self.coverage[i]:9.1f} {self.coverage_didim[i]:7.1f} {self.coverage_paper[i]:12.1f}"
                f" {self.efficiency[i]:18.3f} {self.efficiency_didim[i]:9.3f}"
            )
        lines.append(
            f"{'pooled':12} {self.coverage.mean():9.1f} {self.coverage_didim.mean():7.1f} "
            f"{self.coverage_paper.mean():12.1f} {np.sqrt((self.efficiency**2).mean()):18.3f}"
            f" {np.sqrt((self.efficiency_didim**2).mean()):9.3f}"
        )
        return "\n".join(lines)


def summarise(rate_hz: int, runs: list[dict[str, list[float]]]) -> Summary:
    """Coverage and efficiency over the seeds."""
    here = context(rate_hz)
    table = {key: np.array([run[key] for run in runs]) for key in runs[0]}
    half = stats.t.ppf(0.975, runs[0]["freedom"][0])

    def coverage(value: str, std: str) -> np.ndarray:
        return 100 * (np.abs(table[value] - here.truth) <= half * table[std]).mean(axis=0)

    return Summary(
        names=here.model.names,
        coverage=coverage("value", "std"),
        coverage_didim=coverage("didim_value", "didim_std"),
        coverage_paper=coverage("didim_value", "paper_std"),
        efficiency=table["value"].std(axis=0, ddof=1) / here.bound,
        efficiency_didim=table["didim_value"].std(axis=0, ddof=1) / here.bound,
    )


def run(rate_hz: int, seeds: int, *, processes: int = 1) -> Summary:
    """Identify once for each seed 0 ... seeds - 1."""
    context(rate_hz)
    work = [(rate_hz, seed) for seed in range(seeds)]
    if processes == 1:
        return summarise(rate_hz, [one_seed(*item) for item in work])
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        return summarise(rate_hz, pool.starmap(one_seed, work, chunksize=10))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Coverage and efficiency of the SCARA identification")
    parser.add_argument("--rate", type=int, choices=CASES, default=10, help="torque rate in Hz")
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    summary = run(options.rate, options.seeds, processes=options.processes)
    print(f"SCARA, torque at {options.rate} Hz, {options.seeds} seeds\n{summary.text()}")
    if options.json:
        content = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(summary).items()}
        options.json.write_text(json.dumps({"rate_hz": options.rate, "seeds": options.seeds, **content}, indent=1))


if __name__ == "__main__":
    main()
