"""The data of this folder: two replicates of a batch by SciPy, without this project's simulation, with noise.

Biomass is measured every six minutes, with 0.02 kg/m3 and 5 %; substrate every hour, with 0.2 kg/m3: the cells between
are empty. The replicates differ in how much biomass they began with.
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

HERE = Path(__file__).parent
MU_MAX, K_S, Y_XS, S0 = 0.45, 0.1, 0.55, 10.0
X0 = {"batch_1": 0.1, "batch_2": 0.14}
ROWS, STEP, EVERY = 101, 360.0, 10
NOISE_X, RELATIVE_X, NOISE_S = 0.02, 0.05, 0.2


def true(x0: float, time: np.ndarray, mu_max: float = MU_MAX, y_xs: float = Y_XS) -> np.ndarray:
    """(N, 2) biomass and substrate."""

    def slope(t: float, state: np.ndarray) -> list[float]:
        growth = mu_max / 3600 * state[1] / (K_S + state[1]) * state[0]
        return [growth, -growth / y_xs]

    found = solve_ivp(slope, (0, time[-1]), [x0, S0], t_eval=time, method="LSODA", rtol=1e-10, atol=1e-12)
    return found.y.T


def main() -> None:
    for seed, (name, x0) in enumerate(X0.items()):
        random, time = np.random.default_rng(seed), STEP * np.arange(ROWS)
        clean = true(x0, time)
        biomass = clean[:, 0] + np.hypot(NOISE_X, RELATIVE_X * clean[:, 0]) * random.standard_normal(ROWS)
        substrate = clean[:, 1] + NOISE_S * random.standard_normal(ROWS)
        lines = ["t,X,S"]
        for k in range(ROWS):
            sample = f"{substrate[k]:.4g}" if k % EVERY == 0 else ""
            lines.append(f"{time[k]:.6g},{biomass[k]:.5g},{sample}")
        (HERE / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
