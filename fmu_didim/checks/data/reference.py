"""Derivatives of a reference that contradict it."""

from __future__ import annotations

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, PROBLEM, Diagnostic
from fmu_didim.checks.data.expected import Expected
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import Simulation

CONTRADICTION = 0.05
"""[1] Difference of a signal and the integral of its derivative, as a fraction of their variation, that is reported:
far beyond the error of the trapezoidal rule at control rates."""
STANDSTILL = 1e-9
"""[SI] Variation below which a signal counts as constant."""

REFERENCE_DERIVATIVE = CATALOGUE(
    "reference-derivative", PROBLEM, rank=5,
    meaning="A velocity or acceleration of the reference is not the derivative of its position or velocity: zero, in "
    "another unit, turned round or of another joint. The controller and the start of the plant would use it.",
    next_step="Correct the column, or leave out all columns dq<j> (or ddq<j>): they are then computed.",
)  # fmt: skip


def reference_diagnostics(run: Simulation, _: Expected | None = None) -> list[Diagnostic]:
    """Columns ``dq<j>`` and ``ddq<j>`` that contradict the column that they are the derivative of.

    The integral of the derivative is compared with the signal, both without their means: a ratio of standard
    deviations, which quantisation hardly moves.
    """
    reference, found = run.experiment.reference, list[Diagnostic]()
    for signal, derivative in (("q", "dq"), ("dq", "ddq")):
        for j in range(1, run.model.joint_count + 1):
            if not {f"{signal}{j}", f"{derivative}{j}"} <= set(reference.names):
                continue
            values, rate = reference.column(f"{signal}{j}"), reference.column(f"{derivative}{j}")
            off = contradiction(reference.time, values, rate)
            if off > CONTRADICTION:
                what = "zero" if not rate.any() else "not its derivative"
                text = (
                    f"The reference contradicts itself: {derivative}{j} is {what} where {signal}{j} varies by "
                    f"{np.ptp(values):.4g} (its integral differs by {100 * off:.0f} % of the variation)."
                )
                found.append(Diagnostic(REFERENCE_DERIVATIVE, text, f"{run.label}: joint {j}", off, CONTRADICTION, "1"))
    return found


def contradiction(time: Array, signal: Array, rate: Array) -> float:
    """Difference of a signal (N,) and the integral of its rate (N,), relative to the larger deviation; 0 at rest."""
    integral = np.concatenate([[0.0], np.cumsum(np.diff(time) * (rate[1:] + rate[:-1]) / 2)])
    rest = (signal - signal.mean()) - (integral - integral.mean())
    size = max(float(signal.std()), float(integral.std()))
    return float(rest.std()) / size if size > STANDSTILL else 0.0
