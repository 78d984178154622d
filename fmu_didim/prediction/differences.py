"""Differences of closed-loop simulations, with steps that suit what is simulated."""

from __future__ import annotations

import numpy as np

from fmu_didim.errors import SimulationError
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.signals import Array

STEP = 1e-4
"""Step of the forward differences of a search, in units of a parameter's scale: our loops are smooth to 1e-10,
truncation rules."""
SMOOTH_STEP = 3e-7
"""Of the value at which a parameter alone would make up the whole torque. The simulations of our own plants are
smooth in the parameters, so that truncation and rounding both stay at some 1e-6 of the sensitivity."""
ROUGH_STEPS = (1e-4, 1e-3, 1e-2, 0.03, 0.1)
"""Relative steps tried on a loop whose integrator is not ours: with its own step control, torque jitters when a
parameter changes ever so little."""
ROUGHNESS = 0.1
"""A step is long enough when the second difference is this part of the first; otherwise jitter rules."""


def central(model: LoopModel, values: Array, label: str, torque: Array, i: int, size: float) -> Array:
    """Column (N, n) of a parameter by central differences: with the shortest step whose two sides agree; with the one
    whose sides agree best if none does.

    Args:
        torque: (N, n) at the values, of the experiment of this label; size: of the parameter.

    Raises:
        SimulationError: no step can be simulated.
    """
    best: tuple[float, Array] | None = None
    for relative in ROUGH_STEPS:
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
        if rough <= ROUGHNESS:
            break
    if best is None:
        raise SimulationError(
            f"The parameter '{model.names[i]}' cannot be varied.",
            got=f"no simulation succeeds near {values[i]:.6g}",
            next_step="Start from other values.",
        )
    return best[1]
