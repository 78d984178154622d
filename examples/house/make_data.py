"""The data of this folder: a room by SciPy, without this project's simulation, and noise of 0.1 K.

The weather changes slowly: within a row of ten minutes hardly, beside a time constant of seven hours.
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

HERE = Path(__file__).parent
R1, R2, C, START, NOISE = 0.02, 0.01, 4e6, 20.0, 0.1
ROWS, STEP = 865, 600.0


def true(outside: np.ndarray, beside: np.ndarray, time: np.ndarray) -> np.ndarray:
    """(N,) temperature of the room."""

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        return ((np.interp(t, time, outside) - x) / R1 + (np.interp(t, time, beside) - x) / R2) / C

    return solve_ivp(slope, (0, time[-1]), [START], t_eval=time, max_step=STEP, rtol=1e-9, atol=1e-9).y[0]


def main() -> None:
    for seed, (end, mean) in enumerate((("", 4.0), ("_2", 9.0))):
        random, time = np.random.default_rng(seed), STEP * np.arange(ROWS)
        day = 2 * np.pi * time / 86400
        slow = np.cumsum(random.standard_normal(ROWS)) * 0.08
        outside = np.round(mean + 5 * np.sin(day - 2) + slow, 2)
        beside = np.round(20.5 + 1.5 * np.sin(day - 1 + np.sin(day / 3)), 2)
        room = true(outside, beside, time)
        measured = room + NOISE * random.standard_normal(ROWS)
        for name, header, columns in (
            ("weather", "t,T_out,T_beside", (outside, beside)), ("room", "t,T", (measured,)),
        ):  # fmt: skip
            table = np.column_stack([time, *columns])
            np.savetxt(HERE / f"{name}{end}.csv", table, fmt="%.7g", delimiter=",", header=header, comments="")


if __name__ == "__main__":
    main()
