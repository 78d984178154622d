"""The data of this folder: the closed loop by SciPy, without this project's simulation, and noise.

At tick k the controller sees reference and motion of tick k; its torque is held until the next one.
"""

from pathlib import Path

import numpy as np
import yaml
from scipy.integrate import solve_ivp

HERE = Path(__file__).parent
J, C, KP, KD, STEP = 0.62, 1.43, 20.0, 4.0, 0.01


def reference(run: dict, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of rest-to-rest moves by the quintic 10 s^3 - 15 s^4 + 6 s^5."""
    points, move, leg = np.ravel(run["points"]), run["move_s"], run["move_s"] + run["dwell_s"]
    k = np.floor(time / leg + 1e-9).astype(int).clip(0, points.size - 2)
    s = ((time - k * leg) / move).clip(0, 1)
    way = points[k + 1] - points[k]
    return points[k] + way * s**3 * (10 - 15 * s + 6 * s**2), way * 30 * s**2 * (1 - s) ** 2 / move


def main() -> None:
    case = yaml.safe_load((HERE / "identify.yaml").read_text(encoding="utf-8"))
    for seed, name in enumerate(("train", "validation")):
        run = case[name]["reference"]
        length = (len(run["points"]) - 1) * (run["move_s"] + run["dwell_s"])
        time = STEP * np.arange(round(length / STEP) + 1)
        q, dq = reference(run, time)
        state, torque = np.zeros(2), np.zeros_like(time)
        for k in range(time.size):
            torque[k] = KP * (q[k] - state[0]) + KD * (dq[k] - state[1])
            motion = lambda t, x, u=torque[k]: [x[1], (u - C * np.sin(x[0])) / J]  # noqa: E731
            state = solve_ivp(motion, (0, STEP), state, rtol=1e-10, atol=1e-12).y[:, -1]
        noise = 0.02 * torque.std() * np.random.default_rng(seed).standard_normal(torque.size)
        table = np.column_stack([time, torque + noise])[::2]
        np.savetxt(HERE / f"{name}_50hz.csv", table, fmt="%.9g", delimiter=",", header="t,tau1", comments="")


if __name__ == "__main__":
    main()
