"""How low may the torque rate be? Standard deviations against the rate, and the rate at which it breaks.

The torque log of a case is thinned to lower and lower rates, and the machine is identified at each of them. Without a
case it is the 200 Hz log of the example, from the bad start of the paper's Table 3; the paper puts the limit near 4 Hz.

    python examples/scara/rate_sweep.py [CASE.yaml] [--out results/rate_sweep.svg]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.case import Case, load_case

EXAMPLE = Path(__file__).with_name("identify_200hz.yaml")
RATES_HZ = (200, 100, 50, 20, 10, 8, 6, 5, 4, 3, 2.5, 2, 1.5, 1, 0.7, 0.5)
START = {"ZZ1R": 3.4e-2, "Fv1": 1e-4, "Fc1": 8e-3, "ZZ2": 6e-4, "MX2": 2.41e-3, "MY2": 1e-2, "Fv2": 1e-2, "Fc2": 1e-3}
MAIN = ("ZZ1R", "Fc1", "ZZ2", "MX2", "Fc2")
PAPER_LIMIT_HZ = 4.0
LIMIT_PERCENT = 10.0
"""A rate counts as broken when it is refused, or a main parameter has a larger standard deviation."""


@dataclass(frozen=True)
class Point:
    """One rate: standard deviation in % of the value by parameter, or why there is none."""

    rate_hz: float
    percent: dict[str, float]
    iterations: int
    refusal: str = ""

    def is_broken(self, main: Sequence[str]) -> bool:
        """Whether the rate is too low for the parameters that matter."""
        return bool(self.refusal) or max((self.percent[name] for name in main), default=0.0) > LIMIT_PERCENT


def example() -> Case:
    """The example with the bad start of the paper's Table 3."""
    return load_case(EXAMPLE).with_(estimator={"kind": "didim", "start": START})


def rates(case: Case) -> list[float]:
    """The rate of the log that has the lowest one, and all lower ones."""
    own = min(case.model.experiments[label].rate_hz for label in case.model.estimation_labels)
    own = float(f"{own:.6g}")
    return [own, *(rate for rate in RATES_HZ if rate < own)]


def thinned(case: Case, rate_hz: float) -> Case:
    """The case with the torque logs of its estimation at a lower rate, divisor of theirs or not."""
    lower = {"torque": {"rate_hz": rate_hz}}
    if case.document.train is not None:
        return case.with_(train=lower)
    return case.with_(experiments=dict.fromkeys(case.model.estimation_labels, lower))


def sweep(case: Case, values: dict[str, float] | None = None) -> list[Point]:
    """Identify at each rate.

    Args:
        values: of which the standard deviations are percent; by default those that are found at the rate.
    """
    points = []
    for rate in rates(case):
        try:
            estimate = case.estimator.estimate(thinned(case, rate).model)
        except FmuDidimError as error:
            points.append(Point(rate, {}, 0, error.what))
            continue
        found = dict(zip(estimate.names, estimate.value, strict=True)) if values is None else values
        percent = {
            name: 100 * deviation / abs(found[name])
            for name, deviation in zip(estimate.names, estimate.standard_deviation, strict=True)
        }
        points.append(Point(rate, percent, estimate.iteration_count))
    return points


def main() -> None:
    """Print the table and write the figure."""
    parser = argparse.ArgumentParser()
    parser.add_argument("case", type=Path, nargs="?", metavar="CASE.yaml", help="a case of your own (the example)")
    parser.add_argument("--out", type=Path, help="the figure (results/scara_rate_sweep.svg, results/CASE_rates.svg)")
    options = parser.parse_args()
    own = options.case is not None
    case = load_case(options.case) if own else example()
    points = sweep(case, None if own else dict(zip(case.model.names, case.model.start, strict=True)))
    if points[0].refusal:
        raise SystemExit(f"Nothing is identified at the rate of the log, {points[0].rate_hz:g} Hz: {points[0].refusal}")
    names = list(points[0].percent)
    main_names = [name for name in names if points[0].percent[name] <= LIMIT_PERCENT] if own else list(MAIN)
    print(f"{case.name}: standard deviation in % of the {'value' if own else 'truth'}, by torque rate\n")
    width = max(9, *(len(name) + 2 for name in names))
    print(f"{'Hz':>6} {'it.':>3} " + "".join(f"{name:>{width}}" for name in names))
    for point in points:
        cells = (
            "".join(f"{point.percent[name]:{width}.2f}" for name in names) if point.percent else f"  {point.refusal}"
        )
        print(f"{point.rate_hz:6g} {point.iterations:3} {cells}{'   broken' if point.is_broken(main_names) else ''}")
    print(f"\nBroken: refused, or more than {LIMIT_PERCENT:g} % for one of {', '.join(main_names)}")
    broken = [point.rate_hz for point in points if point.is_broken(main_names)]
    told = f"Breaks at {max(broken):g} Hz" if broken else "Does not break"
    print(told if own else f"{told} (the paper: close to {PAPER_LIMIT_HZ:g} Hz)")
    out = options.out or Path("results") / (f"{options.case.stem}_rates.svg" if own else "scara_rate_sweep.svg")
    _figure(points, names, f"{case.name}: standard deviation against the torque rate", out, is_example=not own)
    print(out)


def _figure(points: list[Point], names: list[str], title: str, out: Path, *, is_example: bool) -> None:
    from matplotlib.figure import Figure

    figure = Figure(layout="constrained")
    axes = figure.subplots()
    good = [p for p in points if p.percent]
    for name in names:
        axes.loglog([p.rate_hz for p in good], [p.percent[name] for p in good], "o-", markersize=3, label=name)
    if is_example:
        axes.axvline(PAPER_LIMIT_HZ, color="grey", linestyle="--", label="limit in the paper")
    of = "truth" if is_example else "value"
    axes.set(title=title, xlabel="torque rate, Hz", ylabel=f"standard deviation, % of the {of}")
    axes.legend()
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out)


if __name__ == "__main__":
    main()
