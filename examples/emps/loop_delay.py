"""What a delay in the loop does to the EMPS parameters, and the delay that the data ask for.

python examples/emps/loop_delay.py
"""

from __future__ import annotations

from pathlib import Path

from fmu_didim.case import load_case
from fmu_didim.checks.validation import validate_on
from fmu_didim.estimators import Didim
from fmu_didim.fit.estimate import Estimate

HERE = Path(__file__).parent
DELAYS = (0.0, 0.5, 1.0)


def rows() -> list[tuple[str, Estimate, float, float]]:
    """For each delay in samples, and for the estimated one: estimate, errors on estimation and validation set."""
    case = load_case(HERE / "identify.yaml")
    model = case.model
    assert model is not None
    result = []
    for delay in (*DELAYS, None):
        there = model.with_delay(delay or 0.0)
        estimate = Didim(estimate_delay=delay is None).estimate(there)
        if delay is None:
            there = model.with_delay(float(estimate.value[-1]))
        direct, cross = (validate_on(there, estimate.base_value, label) for label in ("estimation", "validation"))
        result.append(
            ("estimated" if delay is None else f"{delay:g}", estimate, direct.total_percent, cross.total_percent)
        )
    return result


def main() -> None:
    """Print the table."""
    print("EMPS, force at 100 Hz: parameters ± standard deviation and force error by the delay of the loop\n")
    print(
        f"{'delay, samples':>15}{'M, kg':>18}{'Fv, N.s/m':>18}{'Fc, N':>18}{'offset, N':>18}{'est. %':>8}{'val. %':>8}"
    )
    for label, estimate, direct, cross in rows():
        cells = [f"{v:.4g} ± {s:.2g}" for v, s in zip(estimate.value, estimate.standard_deviation, strict=True)]
        shown = f"{cells[4]}" if label == "estimated" else label
        print(f"{shown:>15}" + "".join(f"{c:>18}" for c in cells[:4]) + f"{direct:8.2f}{cross:8.2f}")


if __name__ == "__main__":
    main()
