"""How low may the torque rate be? Standard deviations against the rate, and the rate at which it breaks.

The 200 Hz log of the example is thinned to rates from 200 Hz to 0.5 Hz, and the robot is identified from the
bad start of the paper's Table 3. The paper puts the limit near 4 Hz.

    python examples/scara/rate_sweep.py [--out results/scara_rate_sweep.html]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from fmu_didim.prediction.problem import Problem

from fmu_didim.case import load_case
from fmu_didim.errors import FmuDidimError
from fmu_didim.estimators import Didim
from fmu_didim.master import decimated_times, sample_operator

HERE = Path(__file__).parent
RATES_HZ = (200, 100, 50, 20, 10, 8, 6, 5, 4, 3, 2.5, 2, 1.5, 1, 0.7, 0.5)
START = {"ZZ1R": 3.4e-2, "Fv1": 1e-4, "Fc1": 8e-3, "ZZ2": 6e-4, "MX2": 2.41e-3, "MY2": 1e-2, "Fv2": 1e-2, "Fc2": 1e-3}
MAIN = ("ZZ1R", "Fc1", "ZZ2", "MX2", "Fc2")
LIMIT_PERCENT = 10.0
"""A rate counts as broken when it is refused, or a main parameter has a larger standard deviation."""


@dataclass(frozen=True)
class Point:
    """One rate: %sigma by parameter, or why there is none."""

    rate_hz: float
    percent: dict[str, float]
    iterations: int
    refusal: str = ""

    @property
    def broken(self) -> bool:
        """Whether the rate is too low."""
        return bool(self.refusal) or max(self.percent[name] for name in MAIN) > LIMIT_PERCENT


def thinned(problem: Problem, rate_hz: float) -> Problem:
    """The same problem with the torque log at a lower rate, divisor or not."""
    experiment, step = problem.experiment, problem.system.step_size
    times = decimated_times(experiment.time, rate_hz)
    operator = sample_operator(times, start=0.0, step=step, tick_count=experiment.reference.time.size)
    torque = experiment.torque[operator.ticks]
    return problem.on(replace(experiment, time=times, torque=torque, operator=operator))


def sweep() -> list[Point]:
    """Identify at each rate."""
    problem = load_case(HERE / "identify_200hz.yaml").problem
    assert problem is not None
    truth = problem.parameters.nominal()
    points = []
    for rate in RATES_HZ:
        try:
            estimate = Didim(start=START).estimate(thinned(problem, rate))
            percent = 100 * estimate.standard_deviation / np.abs(truth)
            points.append(Point(rate, dict(zip(estimate.names, percent, strict=True)), estimate.iteration_count))
        except FmuDidimError as error:
            points.append(Point(rate, {}, 0, error.what))
    return points


def main() -> None:
    """Print the table and write the figure."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("results/scara_rate_sweep.html"))
    options = parser.parse_args()
    points = sweep()
    names = list(points[0].percent)
    print("standard deviation in % of the truth, by torque rate\n")
    print(f"{'Hz':>6} {'it.':>3} " + "".join(f"{name:>9}" for name in names))
    for point in points:
        cells = "".join(f"{point.percent[name]:9.2f}" for name in names) if point.percent else f"  {point.refusal}"
        print(f"{point.rate_hz:6g} {point.iterations:3} {cells}{'   broken' if point.broken else ''}")
    broken = [point.rate_hz for point in points if point.broken]
    print(f"\nBreaks at {max(broken):g} Hz" if broken else "\nDoes not break", "(the paper: close to 4 Hz)")
    _figure(points, names, options.out)
    print(options.out)


def _figure(points: list[Point], names: list[str], out: Path) -> None:
    import plotly.graph_objects as go

    figure = go.Figure()
    good = [p for p in points if p.percent]
    for name in names:
        figure.add_scatter(
            x=[p.rate_hz for p in good], y=[p.percent[name] for p in good], name=name, mode="lines+markers"
        )
    figure.add_vline(x=4, line_dash="dash", annotation_text="limit in the paper, 4 Hz")
    figure.update_xaxes(type="log", title="torque rate, Hz")
    figure.update_yaxes(type="log", title="standard deviation, % of the truth")
    figure.update_layout(title="SCARA: standard deviation against the torque rate", template="plotly_white")
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.write_html(out, include_plotlyjs=True)


if __name__ == "__main__":
    main()
