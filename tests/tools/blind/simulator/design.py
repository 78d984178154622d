"""Robots, controllers and reference trajectories for made cases."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray
SPREAD = 0.15
"""True parameters lie within this part of the nominal ones."""

ARM = {
    "ZZ1R": 2.0, "MX1": 3.0, "MY1": 0.2, "ZZ2": 0.35, "MX2": 0.9, "MY2": 0.1, "Ia2": 0.15,
    "Fv1": 2.0, "Fc1": 3.0, "Fv2": 0.8, "Fc2": 1.0,
}  # fmt: skip
"""The nominal arm of the development cases."""


@dataclass(frozen=True)
class Design:
    """A robot with its controller, as a case states it.

    Attributes:
        length: distance of the two axes, m. alpha: of each joint, rad. gravity: in the base frame, m/s2.
        nominal, true: base parameters by name, in the convention of the case.
        Kp, Kd: gains. rate_hz: of the controller. encoder_bits: of a turn. period_s, periods: of the reference.
    """

    length: float
    alpha: tuple[float, ...]
    gravity: tuple[float, float, float]
    nominal: dict[str, float]
    true: dict[str, float]
    Kp: tuple[float, ...]
    Kd: tuple[float, ...]
    rate_hz: int = 200
    encoder_bits: int = 19
    period_s: float = 10.0
    periods: int = 2

    @property
    def count(self) -> int:
        """Number of joints."""
        return len(self.alpha)

    @property
    def encoder_step(self) -> float:
        """Smallest step of position, rad."""
        return float(2 * np.pi / 2**self.encoder_bits)

    @property
    def sign(self) -> Array:
        """+1, or -1 where a joint turns against the first one (its alpha is pi)."""
        return np.array([1.0, *(np.sign(np.cos(a)) for a in self.alpha[1:])])

    @property
    def plane_gravity(self) -> tuple[float, float]:
        """Gravity along x and y of the first link's frame at q = 0."""
        _, gy, gz = self.gravity
        return self.gravity[0], float(np.cos(self.alpha[0]) * gy + np.sin(self.alpha[0]) * gz)

    def counter_clockwise(self) -> dict[str, float]:
        """The true inertial parameters when every joint turns counter-clockwise."""
        found = {name: value for name, value in self.true.items() if name[:2] in ("ZZ", "MX", "MY")}
        if self.count > 1:
            found["MY2"] *= self.sign[1]
        return found


def development_design(rng: np.random.Generator) -> Design:
    """The arm of the development cases, with new true parameters."""
    true = {name: value * (1 + SPREAD * rng.uniform(-1, 1)) for name, value in ARM.items()}
    return Design(0.5, (0.0, 0.0), (0.0, -9.81, 0.0), dict(ARM), true, (3300.0, 450.0), (150.0, 20.0))


def varied_design(rng: np.random.Generator, *, joints: int | None = None) -> Design:
    """Another arm: geometry, mounting, directions of rotation, gains, control rate, encoder, period, joint count."""
    n = joints or (1 if rng.random() < 0.15 else 2)
    # The links keep their shape, or the mass matrix would not be that of a body: one factor for each link.
    scale = rng.uniform(0.7, 1.6, 2)
    size = {name: scale[int(name.rstrip("R")[-1]) - 1] for name in ARM}
    nominal = {
        name: round(float(value * size[name] * rng.uniform(0.9, 1.1)), 3)
        for name, value in ARM.items()
        if int(name.rstrip("R")[-1]) <= n
    }
    true = {name: value * (1 + SPREAD * rng.uniform(-1, 1)) for name, value in nominal.items()}
    length = round(rng.uniform(0.3, 0.6), 2) if n > 1 else 0.0
    mounting = int(rng.integers(3))
    tilt = rng.uniform(-0.5, 0.5)
    across, down = 9.81 * np.sin(tilt), -9.81 * np.cos(tilt)
    alpha1, gravity = (
        (0.0, (across, down, 0.0)), (float(np.pi), (across, -down, 0.0)), (float(np.pi / 2), (across, 0.0, down)),
    )[mounting]  # fmt: skip
    alpha = (alpha1, *((float(rng.choice([0.0, np.pi])),) if n > 1 else ()))
    if n > 1:
        # ZZ1R holds L^2 M2, and M2 > MX2^2 / ZZ2; twice that leaves room for the spread of the true values.
        least = round(2.2 * length**2 * nominal["MX2"] ** 2 / nominal["ZZ2"], 3)
        true["ZZ1R"] *= max(1.0, least / nominal["ZZ1R"])
        nominal["ZZ1R"] = max(nominal["ZZ1R"], least)
    inertia = [nominal["ZZ1R"] + (nominal["ZZ2"] + 2 * length * nominal["MX2"] if n > 1 else 0.0)]
    if n > 1:
        inertia.append(nominal["ZZ2"] + nominal["Ia2"])
    bandwidth = rng.uniform(25.0, 36.0)
    damping = rng.uniform(0.6, 0.9)
    Kp = tuple(float(f"{J * bandwidth**2:.3g}") for J in inertia)
    Kd = tuple(float(f"{2 * damping * J * bandwidth:.3g}") for J in inertia)
    rate = int(rng.choice([200, 200, 300, 400, 500]))
    # The jitter of a differentiated encoder, Kd * step * rate, stays as large as in the development cases.
    bits = int(np.ceil(np.log2(2 * np.pi * rate / 200 * Kd[0] / 150 / 1.2e-5)))
    period, periods = (10.0, 2) if rng.random() < 0.6 else (8.0, 3)
    rounded = tuple(float(round(g, 6)) for g in gravity)
    return Design(length, alpha, rounded, nominal, true, Kp, Kd, rate, bits, period, periods)


@dataclass(frozen=True)
class Motion:
    """A periodic reference q(t) = centre + sum_h c_h cos(h w t) + s_h sin(h w t), one row a joint."""

    centre: Array
    cosine: Array
    sine: Array
    period_s: float
    _order: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_order", 2 * np.pi / self.period_s * np.arange(1, self.cosine.shape[1] + 1))

    def at(self, time: Array) -> tuple[Array, Array]:
        """Positions and velocities, each (N, n)."""
        phase = time[:, None] * self._order
        q = np.cos(phase) @ self.cosine.T + np.sin(phase) @ self.sine.T + self.centre
        dq = (np.cos(phase) * self._order) @ self.sine.T - (np.sin(phase) * self._order) @ self.cosine.T
        return q, dq


def random_motion(rng: np.random.Generator, design: Design) -> Motion:
    """Six harmonics, scaled to a range of about 2.3 rad and at most 3 rad/s."""
    n, time = design.count, np.arange(0, design.period_s, 0.005)
    motion = Motion(np.zeros(n), rng.normal(size=(n, 6)), rng.normal(size=(n, 6)), design.period_s)
    q, dq = motion.at(time)
    limits = np.array([1.0, 1.2])[:n] * rng.uniform(0.85, 1.15, n)
    factor = np.minimum(limits / np.abs(q).max(axis=0), 3.0 / np.abs(dq).max(axis=0))[:, None]
    centre = np.array([0.5, 0.3])[:n] + rng.uniform(-0.2, 0.2, n)
    return Motion(centre, motion.cosine * factor, motion.sine * factor, design.period_s)
