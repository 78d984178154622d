"""Make the torque logs of the discovery example: a vertical arm with two effects that its model lacks.

Hidden are Stribeck friction on joint 1 (with |v/vs| to the power 1, not the 2 of the catalogue) and a first-order
lag of the current loop of joint 2. The simulator shares no code with the package: the equations are written out by
hand and SciPy's DOP853 integrates between the instants of the 200 Hz PD controller. The noise is partly coloured; its
seeds stand here.

    python examples/arm2r/make_data.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from scipy.integrate import solve_ivp

HERE = Path(__file__).parent
RATE_HZ, TORQUE_HZ, L1, G, V0 = 200, 50, 0.5, 9.81, 0.005
SEEDS = {"train": 11, "validation": 12}
NOISE = np.array([0.4, 0.12])
"""Standard deviation in N.m; half of its variance has a correlation time of 10 ms."""
TRUTH = {
    "ZZ1R": 2.13, "MX1": 2.81, "MY1": 0.22, "ZZ2": 0.33, "MX2": 0.94, "MY2": 0.09, "Ia2": 0.16,
    "Fv1": 2.2, "Fc1": 2.8, "Fv2": 0.75, "Fc2": 1.1,
}  # fmt: skip
STRIBECK, STRIBECK_VELOCITY, LAG = 2.0, 0.15, 0.008
KP, KD = np.array([3300.0, 450.0]), np.array([150.0, 20.0])


def reference(series: dict, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of a Fourier series as it stands in the case file."""
    w = 2 * np.pi * series["fundamental_hz"]
    k = w * np.arange(1, 1 + len(series["joints"][0]["cosine"]))
    angle = np.outer(time, k)
    q = [j.get("offset", 0.0) + np.cos(angle) @ j["cosine"] + np.sin(angle) @ j["sine"] for j in series["joints"]]
    dq = [-np.sin(angle) @ (k * j["cosine"]) + np.cos(angle) @ (k * j["sine"]) for j in series["joints"]]
    return np.column_stack(q), np.column_stack(dq)


def friction(dq: np.ndarray) -> np.ndarray:
    """Viscous, Coulomb and, on joint 1, Stribeck friction."""
    p, sign = TRUTH, np.tanh(dq / V0)
    stribeck = STRIBECK * np.exp(-abs(dq[0]) / STRIBECK_VELOCITY) * sign[0]
    return np.array([p["Fv1"], p["Fv2"]]) * dq + np.array([p["Fc1"], p["Fc2"]]) * sign + np.array([stribeck, 0.0])


def derivative(x: np.ndarray, command: np.ndarray) -> np.ndarray:
    """Of (q1, q2, dq1, dq2, lagged torque of joint 2)."""
    p, q, dq = TRUTH, x[:2], x[2:4]
    a = L1 * (p["MX2"] * np.cos(q[1]) - p["MY2"] * np.sin(q[1]))
    b = L1 * (p["MX2"] * np.sin(q[1]) + p["MY2"] * np.cos(q[1]))
    mass = np.array([[p["ZZ1R"] + p["ZZ2"] + 2 * a, p["ZZ2"] + a], [p["ZZ2"] + a, p["ZZ2"] + p["Ia2"]]])
    gravity2 = G * (p["MX2"] * np.cos(q.sum()) - p["MY2"] * np.sin(q.sum()))
    gravity1 = G * (p["MX1"] * np.cos(q[0]) - p["MY1"] * np.sin(q[0])) + gravity2
    coriolis = np.array([-b * (2 * dq[0] * dq[1] + dq[1] ** 2), b * dq[0] ** 2])
    torque = np.array([command[0], x[4]])
    ddq = np.linalg.solve(mass, torque - coriolis - np.array([gravity1, gravity2]) - friction(dq))
    return np.concatenate([dq, ddq, [(command[1] - x[4]) / LAG]])


def closed_loop(series: dict) -> tuple[np.ndarray, np.ndarray]:
    """Time and torque command of the loop, one row a control period."""
    time = np.arange(round(series["duration_s"] * RATE_HZ) + 1) / RATE_HZ
    q_ref, dq_ref = reference(series, time)
    before = q_ref[0] - dq_ref[0] / RATE_HZ
    x = np.concatenate([q_ref[0], dq_ref[0], [0.0]])
    commands = np.zeros_like(q_ref)
    for i in range(time.size):
        speed = (x[:2] - before) * RATE_HZ
        commands[i] = command = KP * (q_ref[i] - x[:2]) + KD * (dq_ref[i] - speed)
        before = x[:2].copy()
        if i == 0:
            x[4] = command[1]
        x = solve_ivp(
            lambda t, x, u=command: derivative(x, u), (0, 1 / RATE_HZ), x, method="DOP853", rtol=1e-7, atol=1e-9
        ).y[:, -1]
    return time, commands


def noise(count: int, seed: int) -> np.ndarray:
    """(count, 2) at the control rate: half white, half with a correlation time of 10 ms."""
    rng = np.random.default_rng(seed)
    factor = np.exp(-1 / (RATE_HZ * 0.01))
    coloured = np.zeros((count, 2))
    for k in range(1, count):
        coloured[k] = factor * coloured[k - 1] + np.sqrt(1 - factor**2) * rng.normal(size=2)
    return NOISE * (coloured + rng.normal(size=(count, 2))) / np.sqrt(2)


def main() -> None:
    """Write the torque tables."""
    case = yaml.safe_load((HERE / "discover.yaml").read_text(encoding="utf-8"))
    for name, seed in SEEDS.items():
        time, torque = closed_loop(case[name]["reference"])
        rows = np.column_stack([time, torque + noise(time.size, seed)])[:: RATE_HZ // TORQUE_HZ]
        path = HERE / f"{name}_{TORQUE_HZ}hz.csv"
        np.savetxt(path, rows, fmt="%.6g", delimiter=",", header="t,tau1,tau2", comments="")


if __name__ == "__main__":
    main()
