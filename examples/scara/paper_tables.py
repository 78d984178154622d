"""Tables 1, 2 and 3 of the DIDIM paper beside what this framework identifies from simulated data.

The truth of the data is the IDIM LS column of Table 1; the torque noise is 5 % of the RMS torque.

    python examples/scara/paper_tables.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmu_didim.case import load_case
from fmu_didim.estimators import Didim
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.statistics import relative_deviation_percent

HERE = Path(__file__).parent
TRUTH = {"ZZ1R": 3.43, "Fv1": 0.03, "Fc1": 0.82, "ZZ2": 0.063, "MX2": 0.241, "MY2": 0.014, "Fv2": 0.013, "Fc2": 0.137}
# DIDIM columns of the paper: values and %sigma, in the order of TRUTH.
PAPER = {
    "Table 1: start at the optimum, 200 Hz": (
        (3.45, 0.04, 0.82, 0.061, 0.248, 0.014, 0.014, 0.133),
        (0.52, 40.0, 3.0, 0.49, 0.52, 3.5, 30.0, 3.0),
    ),
    "Table 2: inertias divided by 100, all else 0, 200 Hz": (
        (3.45, 0.02, 0.85, 0.061, 0.248, 0.017, 0.01, 0.132),
        (0.2, 15, 1.0, 0.1, 0.1, 2.0, 10, 0.3),
    ),
    "Table 3: bad start, 10 Hz": (
        (3.46, 0.04, 0.81, 0.062, 0.249, 0.016, 0.01, 0.13),
        (0.52, 30, 3.0, 0.49, 0.52, 4.0, 25, 3.0),
    ),
    "Beyond the paper: inertias divided by 1000, all else 0, 200 Hz": None,
}
STARTS = (
    TRUTH,
    {"ZZ1R": 3.43e-2, "ZZ2": 6.3e-4},
    {"ZZ1R": 3.4e-2, "Fv1": 1e-4, "Fc1": 8e-3, "ZZ2": 6e-4, "MX2": 2.41e-3, "MY2": 1e-2, "Fv2": 1e-2, "Fc2": 1e-3},
    {"ZZ1R": 3.43e-3, "ZZ2": 6.3e-5},
)
CASES = ("identify_200hz.yaml", "identify_200hz.yaml", "identify.yaml", "identify_200hz.yaml")


def reproduce() -> dict[str, Estimate]:
    """The estimate for each table."""
    found = {}
    for title, start, case in zip(PAPER, STARTS, CASES, strict=True):
        model = load_case(HERE / case).model
        assert model is not None
        found[title] = Didim(start=start).estimate(model)
    return found


def table(title: str, estimate: Estimate) -> str:
    """One table as text."""
    didim = estimate.stages["didim"]
    error = 100 * np.linalg.norm(estimate.residual) / np.linalg.norm(estimate.measured)
    paper = PAPER[title]
    lines = [
        f"{title}: {estimate.iteration_count} iterations, torque error {error:.2f} %",
        f"{'':6}{'truth':>8}{'start':>10} | {'paper':>7}{'%σ':>6} | {'DIDIM':>8}{'%σ':>7}{'%σ eq.8':>9} |"
        f"{'finish':>8}{'%σ':>7}{'error/σ':>9}",
    ]
    start = STARTS[list(PAPER).index(title)]
    by_paper = relative_deviation_percent(didim.value, didim.formulas["paper"])
    corrected = relative_deviation_percent(didim.value, didim.standard_deviation)
    for i, (name, truth) in enumerate(TRUTH.items()):
        printed = f"{paper[0][i]:7.3f}{paper[1][i]:6.1f}" if paper else f"{'–':>7}{'–':>6}"
        away = (estimate.value[i] - truth) / estimate.standard_deviation[i]
        lines.append(
            f"{name:6}{truth:8.3f}{start.get(name, 0.0):10.2g} | {printed} | {didim.value[i]:8.4f}{corrected[i]:7.2f}"
            f"{by_paper[i]:9.2f} |{estimate.value[i]:8.4f}{estimate.relative_deviation_percent[i]:7.2f}{away:9.2f}"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the tables."""
    for title, estimate in reproduce().items():
        print(table(title, estimate), end="\n\n")


if __name__ == "__main__":
    main()
