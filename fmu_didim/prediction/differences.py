"""Differences of closed-loop simulations, with steps that suit what is simulated."""

from __future__ import annotations

import numpy as np

from fmu_didim.errors import SimulationError
from fmu_didim.prediction import thresholds as limits
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.signals import Array


def central(model: LoopModel, values: Array, label: str, torque: Array, i: int, size: float) -> Array:
    """Column (N, n) of a parameter by central differences: with the shortest step whose two sides agree; with the one
    whose sides agree best if none does.

    Args:
        torque: (N, n) at the values, of the experiment of this label; size: of the parameter.

    Raises:
        SimulationError: no step can be simulated.
    """
    best: tuple[float, Array] | None = None
    for relative in limits.ROUGH_STEPS:
        up, down = values.copy(), values.copy()
        up[i] += relative * size
        down[i] -= relative * size
        try:
            above, below = model.torque(up, label), model.torque(down, label)
        except SimulationError:
            break  # a longer step leads still farther away
        first = np.linalg.norm(above - below)
        second = np.linalg.norm(above + below - 2 * torque)
        rough = float(second / first) if first > 0 else 0.0
        if best is None or rough < best[0]:
            best = rough, (above - below) / (2 * relative * size)
        if rough <= limits.ROUGHNESS:
            break
    if best is None:
        raise SimulationError(
            f"The parameter '{model.names[i]}' cannot be varied.",
            got=f"no simulation succeeds near {values[i]:.6g}",
            next_step="Start from other values.",
        )
    return best[1]
