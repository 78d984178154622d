"""Monte Carlo of the SCARA identification: coverage of the intervals and efficiency.

    python -m tests.tools.monte_carlo --rate 10 --seeds 1000 --json monte_carlo_10hz.json
    python -m tests.tools.monte_carlo --rate 200 --noise half-coloured --low-pass 4 --out results/coloured
    python -m tests.tools.monte_carlo --figures docs/figures/monte_carlo.json

These run as campaigns; the tests call the estimator alone.

For each seed, normal noise of 5 % of each joint's RMS torque is added to the simulated torque of the truth,
and the robot is identified. The noise is white, or half of its power is a first-order autoregression of 50 ms.
Three kinds of 95 % intervals are counted: those of the estimate (after the efficient finish), those of DIDIM by the
corrected formula, and those of DIDIM by the paper's eq. (8).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy import optimize, stats

from fmu_didim.campaigns.campaign import study
from fmu_didim.campaigns.planning.truth import unit_noise
from fmu_didim.case import load_case
from fmu_didim.data.filters import LowPass
from fmu_didim.estimators import Didim
from fmu_didim.fit.fit import point
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.model.loop_model import LoopModel
from tests.figures import command_of, write_figures
from tests.helpers import ROOT, with_torque

RATES = (4, 10, 20, 50, 200)
CASE = ROOT / "examples/scara/identify_200hz.yaml"
NOISE = 0.05
MEMORY_S = 0.05


@dataclass(frozen=True)
class DesignContext:
    """The model with noise-free torque, the truth, the noise and the Cramer-Rao bound of the parameters."""

    model: LoopModel
    truth: np.ndarray
    torque: np.ndarray
    noise: np.ndarray
    bound: np.ndarray


@dataclass(frozen=True)
class Design:
    """What is varied: the rate of the log, the colour of its noise, the filter of the tool."""

    rate_hz: int
    coloured: bool = False
    low_pass_hz: float | None = None

    def __str__(self) -> str:
        filtered = f", low-pass filter at {self.low_pass_hz:g} Hz" if self.low_pass_hz else ""
        return f"torque at {self.rate_hz} Hz, {'half-coloured' if self.coloured else 'white'} noise{filtered}"


def half_coloured(rng: np.random.Generator, shape: tuple[int, int], rate_hz: float) -> np.ndarray:
    """Noise of variance one, half of it white and half a first-order autoregression with a memory of 50 ms."""
    return unit_noise(rng, np.arange(shape[0]) / rate_hz, shape[1], coloured=0.5, memory_s=MEMORY_S)


@lru_cache
def context(rate_hz: int) -> DesignContext:
    """The SCARA example with torque at ``rate_hz``."""
    case = load_case(CASE).with_(train={"torque": {"rate_hz": rate_hz}})
    model = case.model
    assert model is not None
    torque = model.torque(model.start)
    noise = NOISE * np.sqrt((torque**2).mean(axis=0))
    clean = with_torque(model, torque)
    known = replace(clean, torque_deviation=noise)
    bound = point(known, NoiseOfResidual(known)).covariance
    return DesignContext(clean, model.start, torque, noise, np.sqrt(np.diag(bound)))


def one_seed(design: Design, seed: int) -> dict[str, list[float]]:
    """Values and standard deviations of one identification."""
    here, rng = context(design.rate_hz), np.random.default_rng(seed)
    size = here.torque.shape
    noise = half_coloured(rng, size, design.rate_hz) if design.coloured else rng.normal(size=size)
    model = with_torque(here.model, here.torque + here.noise * noise)
    if design.low_pass_hz:
        model = model.with_low_pass(LowPass(design.low_pass_hz))
    estimate = Didim(start="reference", tolerance=1e-5).estimate(model)
    didim = estimate.stages["didim"]
    return {
        "value": estimate.value.tolist(),
        "std": estimate.standard_deviation.tolist(),
        "didim_value": didim.value.tolist(),
        "didim_std": didim.standard_deviation.tolist(),
        "half": (estimate.interval()[:, 1] - estimate.value).tolist(),
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
    stated: np.ndarray
    stated_paper: np.ndarray

    def text(self) -> str:
        """A table."""
        lines = ["              coverage of the 95 % interval, %         empirical std / Cramer-Rao bound   stated std"]
        lines += ["parameter     estimate   DIDIM   DIDIM, eq. (8)        estimate   DIDIM                / empirical"]
        for i, name in enumerate(self.names):
            lines.append(
                f"{name:12} {self.coverage[i]:9.1f} {self.coverage_didim[i]:7.1f} {self.coverage_paper[i]:12.1f}"
                f" {self.efficiency[i]:18.3f} {self.efficiency_didim[i]:9.3f}"
                f" {self.stated[i]:20.2f}"
            )
        lines.append(
            f"{'pooled':12} {self.coverage.mean():9.1f} {self.coverage_didim.mean():7.1f} "
            f"{self.coverage_paper.mean():12.1f} {np.sqrt((self.efficiency**2).mean()):18.3f}"
            f" {np.sqrt((self.efficiency_didim**2).mean()):9.3f} {self.stated.mean():20.2f}"
        )
        return "\n".join(lines)


def summarise(design: Design, runs: list[dict[str, list[float]]]) -> Summary:
    """Coverage and efficiency over the seeds; the bound is that of white noise."""
    here = context(design.rate_hz)
    table = {key: np.array([run[key] for run in runs]) for key in runs[0]}
    factor = stats.t.ppf(0.975, table["freedom"])
    scatter, scatter_didim = (table[key].std(axis=0, ddof=1) for key in ("value", "didim_value"))

    def root_mean_square(key: str) -> np.ndarray:
        return np.sqrt((table[key] ** 2).mean(axis=0))

    def coverage(value: str, half: np.ndarray) -> np.ndarray:
        return 100 * (np.abs(table[value] - here.truth) <= half).mean(axis=0)

    return Summary(
        names=here.model.names,
        coverage=coverage("value", table["half"]),
        coverage_didim=coverage("didim_value", factor * table["didim_std"]),
        coverage_paper=coverage("didim_value", factor * table["paper_std"]),
        efficiency=scatter / here.bound,
        efficiency_didim=scatter_didim / here.bound,
        stated=root_mean_square("std") / scatter,
        stated_paper=root_mean_square("paper_std") / scatter_didim,
    )


def run(design: Design, seeds: int) -> Summary:
    """Identify once for each seed 0 ... seeds - 1: the estimator alone, in this process."""
    return summarise(design, [one_seed(design, seed) for seed in range(seeds)])


def campaign(design: Design, seeds: int, out: Path, *, workers: int) -> Summary:
    """The same by the verb ``identify``, as a campaign that is resumed; raises where runs gave no values."""
    case = yaml.safe_load(CASE.read_text(encoding="utf-8"))
    case["train"]["torque"]["rate_hz"] = design.rate_hz
    del case["validation"]
    case["estimator"] = {"kind": "didim", "start": "reference", "tolerance": 1e-5}
    if design.low_pass_hz:
        case["low_pass"] = {"cutoff_hz": design.low_pass_hz}
    noise = {"relative": NOISE, "coloured": 0.5 if design.coloured else 0.0, "memory_s": MEMORY_S}
    found = study(case, vary={}, seeds=seeds, noise=noise, name="Monte Carlo", out=out, folder=CASE.parent)
    results = found.run(workers=workers)
    print(results.summary(), file=sys.stderr)
    table = results.parameters()
    assert table["id"].nunique() == seeds, "some runs gave no values: fmu-didim campaign show"
    runs = []
    for _, group in table.groupby("id", sort=False):
        run = {key: group[key].tolist() for key in ("value", "std", "didim_value", "didim_std", "paper_std")}
        half = (group["high"] - group["value"]).to_numpy()
        runs.append({**run, "half": half.tolist(), "freedom": [_freedom(half[0] / group["std"].iloc[0])]})
    return summarise(design, runs)


def _freedom(factor: float) -> float:
    """Degrees of freedom whose 95 % interval has this half width in standard deviations."""
    if factor <= stats.norm.ppf(0.975) * (1 + 1e-9):
        return 1e9
    return float(optimize.brentq(lambda nu: stats.t.ppf(0.975, nu) - factor, 1.0, 1e9))


PAGES = {"white": Design(10), "coloured": Design(200, coloured=True)}
"""Name of the figures on pages -> what they are measured with."""


def figures(summaries: Mapping[str, Summary], seeds: int) -> dict[str, str]:
    """What pages say of these designs: coverage and efficiency, all parameters together."""
    found = {"seeds": str(seeds)}
    for name, summary in summaries.items():
        found |= {
            f"{name}.coverage": f"{summary.coverage.mean():.0f}",
            f"{name}.coverage_paper": f"{summary.coverage_paper.mean():.0f}",
            f"{name}.efficiency": f"{np.sqrt((summary.efficiency**2).mean()):.2f}",
            f"{name}.efficiency_didim": f"{np.sqrt((summary.efficiency_didim**2).mean()):.2f}",
            f"{name}.stated_paper": f"{summary.stated_paper.min():.2f} to {summary.stated_paper.max():.2f}",
        }
    return found


def _content(design: Design, seeds: int, summary: Summary) -> dict[str, Any]:
    lists = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(summary).items()}
    return {**vars(design), "seeds": seeds, **lists}


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.monte_carlo", description="Coverage and efficiency of the SCARA identification"
    )
    parser.add_argument("--rate", type=int, choices=RATES, default=10, help="torque rate in Hz")
    parser.add_argument("--noise", choices=("white", "half-coloured"), default="white")
    parser.add_argument("--low-pass", type=float, help="cut-off in Hz of the filter of torque and regressor")
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, help="folder of the campaign, to be resumed (a temporary one)")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--figures", type=Path, help="run the designs that pages tell of, and write their figures")
    options = parser.parse_args(arguments)
    one = {"run": Design(options.rate, options.noise != "white", options.low_pass)}
    designs = PAGES if options.figures else one
    summaries = {}
    with tempfile.TemporaryDirectory() as scratch:
        for name, design in designs.items():
            out = (options.out or Path(scratch)) / name
            summaries[name] = campaign(design, options.seeds, out, workers=options.processes)
            print(f"SCARA, {design}, {options.seeds} seeds\n{summaries[name].text()}")
    contents = [_content(design, options.seeds, summaries[name]) for name, design in designs.items()]
    if options.json:
        options.json.write_text(json.dumps(contents[0], indent=1))
    if options.figures:
        command = command_of(
            "tests.tools.monte_carlo", ["--seeds", str(options.seeds), "--figures", str(options.figures)]
        )
        write_figures(options.figures, command, figures(summaries, options.seeds), data=contents)


if __name__ == "__main__":
    main()
