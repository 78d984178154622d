"""Make the measured torque of the SCARA example, with the paper's Table 1 (IDIM LS column) as the truth.

The simulator shares no code with the package: the torque equations are written out by hand and the motion
is integrated by SciPy's DOP853 between the instants of the 200 Hz PD controller. Noise of 5 % of the RMS
torque of each joint is added; its seed is written into the files' names and here.

    python examples/scara/make_data.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from scipy.integrate import solve_ivp

HERE = Path(__file__).parent
RATE_HZ, L1, V0, NOISE = 200, 0.5, 0.02, 0.05
SEEDS = {"train": 1, "validation": 2}
TRUTH = {"ZZ1R": 3.43, "Fv1": 0.03, "Fc1": 0.82, "ZZ2": 0.063, "MX2": 0.241, "MY2": 0.014, "Fv2": 0.013, "Fc2": 0.137}
PAYLOAD, AT = 0.15, 0.4  # kg, and m from the axis of joint 2, of the run payload_50hz.csv
KP, KD = np.array([3700.0, 62.0]), np.array([230.0, 4.0])


def duration(motion: dict) -> float:
    """Length of a motion as it stands in the case file, s."""
    if motion["kind"] == "fourier":
        return motion["duration_s"]
    return (len(motion["points"]) - 1) * (motion["move_s"] + motion["dwell_s"])


def moves(motion: dict, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of quintic moves from rest to rest."""
    points, length = np.array(motion["points"], dtype=float), motion["move_s"] + motion["dwell_s"]
    k = np.minimum((time / length).astype(int), len(points) - 2)
    s = np.clip((time - k * length) / motion["move_s"], 0, 1)[:, None]
    way = points[k + 1] - points[k]
    return points[k] + way * (10 * s**3 - 15 * s**4 + 6 * s**5), way * 30 * (s - s**2) ** 2 / motion["move_s"]


def reference(series: dict, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of a Fourier series as it stands in the case file, or of moves."""
    if series["kind"] == "point_to_point":
        return moves(series, time)
    w = 2 * np.pi * series["fundamental_hz"]
    k = w * np.arange(1, 1 + len(series["joints"][0]["cosine"]))
    angle = np.outer(time, k)
    q = [j.get("offset", 0.0) + np.cos(angle) @ j["cosine"] + np.sin(angle) @ j["sine"] for j in series["joints"]]
    dq = [-np.sin(angle) @ (k * j["cosine"]) + np.cos(angle) @ (k * j["sine"]) for j in series["joints"]]
    return np.column_stack(q), np.column_stack(dq)


def acceleration(p: dict, q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Direct model of the two-joint planar arm, in the paper's eight base parameters."""
    a = L1 * (p["MX2"] * np.cos(q[1]) - p["MY2"] * np.sin(q[1]))
    b = L1 * (p["MX2"] * np.sin(q[1]) + p["MY2"] * np.cos(q[1]))
    mass = np.array([[p["ZZ1R"] + p["ZZ2"] + 2 * a, p["ZZ2"] + a], [p["ZZ2"] + a, p["ZZ2"]]])
    other = np.array(
        [
            -b * (2 * dq[0] * dq[1] + dq[1] ** 2) + p["Fv1"] * dq[0] + p["Fc1"] * np.tanh(dq[0] / V0),
            b * dq[0] ** 2 + p["Fv2"] * dq[1] + p["Fc2"] * np.tanh(dq[1] / V0),
        ]
    )
    return np.linalg.solve(mass, tau - other)


def closed_loop(series: dict, p: dict = TRUTH) -> tuple[np.ndarray, np.ndarray]:
    """Time and torque command of the loop, one row a control period."""
    time = np.arange(round(duration(series) * RATE_HZ)) / RATE_HZ
    q_ref, dq_ref = reference(series, time)
    x = np.concatenate([q_ref[0], dq_ref[0]])
    torque = np.zeros_like(q_ref)
    for i in range(time.size):
        torque[i] = tau = KP * (q_ref[i] - x[:2]) + KD * (dq_ref[i] - x[2:])
        x = solve_ivp(
            lambda t, x, tau=tau: np.concatenate([x[2:], acceleration(p, x[:2], x[2:], tau)]),
            (0, 1 / RATE_HZ), x, method="DOP853", rtol=1e-9, atol=1e-11,
        ).y[:, -1]  # fmt: skip
    return time, torque


def with_payload(p: dict) -> dict:
    """The parameters with a point mass on the second link."""
    return p | {"ZZ1R": p["ZZ1R"] + PAYLOAD * L1**2, "ZZ2": p["ZZ2"] + PAYLOAD * AT**2, "MX2": p["MX2"] + PAYLOAD * AT}


def write(name: str, rate_hz: int, time: np.ndarray, torque: np.ndarray, seed: int) -> None:
    """A torque table with noise."""
    deviation = NOISE * np.sqrt((torque**2).mean(axis=0))
    measured = torque + deviation * np.random.default_rng(seed).normal(size=torque.shape)
    rows = np.column_stack([time, measured])[:: RATE_HZ // rate_hz]
    np.savetxt(HERE / f"{name}_{rate_hz}hz.csv", rows, fmt="%.6g", delimiter=",", header="t,tau1,tau2", comments="")


def main() -> None:
    """Write the torque tables."""
    case = yaml.safe_load((HERE / "identify.yaml").read_text(encoding="utf-8"))
    for name, seed in SEEDS.items():
        time, torque = closed_loop(case[name]["reference"])
        for rate in (200, 10):
            write(name, rate, time, torque, seed)
    write("empty", 50, *closed_loop(case["train"]["reference"]), seed=3)
    write("payload", 50, *closed_loop(case["validation"]["reference"], with_payload(TRUTH)), seed=4)
    case = yaml.safe_load((HERE / "identify_modelica.yaml").read_text(encoding="utf-8"))
    for run, seed in (("train", 5), ("validation", 6)):
        write(f"moves_{run}", 20, *closed_loop(case[run]["reference"]), seed=seed)


if __name__ == "__main__":
    main()
