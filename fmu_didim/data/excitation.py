"""Reference trajectories: Fourier series, point-to-point moves, chirps.

Each is a document (it can stand in a YAML case) that gives a :class:`Trajectory` with the columns
``q<j>``, ``dq<j>`` and ``ddq<j>`` at a rate, one row a control period.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from fmu_didim.base.documents import Positive, Strict
from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array, Trajectory, trajectory

MOST_VALUES = 30_000_000
"""Values of a table of motion: 28 minutes of six joints at 1 kHz, a quarter of a gigabyte."""


class Excitation(Strict):
    """A reference trajectory given by a formula.

    Attributes:
        kind: which formula.
    """

    kind: str

    @property
    @abstractmethod
    def joint_count(self) -> int:
        """Number of joints."""

    @property
    @abstractmethod
    def length_s(self) -> float:
        """Duration in s."""

    @abstractmethod
    def motion(self, time: Array) -> tuple[Array, Array, Array]:
        """q, dq, ddq at (N,) instants from 0, (N, n) each."""

    def trajectory(self, rate_hz: float) -> Trajectory:
        """The trajectory sampled at a rate, both ends included; raises InputError if that is more than memory holds."""
        count = self.length_s * rate_hz * 3 * self.joint_count
        if not count <= MOST_VALUES:
            raise InputError(
                "The reference is too long for its rate.", where="reference",
                got=f"{self.length_s:g} s at {rate_hz:g} Hz, {self.joint_count} joints",
                valid=f"at most {MOST_VALUES} values of q, dq and ddq", next_step="Shorten it, or lower the rate.",
            )  # fmt: skip
        return self.at(np.arange(round(self.length_s * rate_hz) + 1) / rate_hz)

    def at(self, time: Array) -> Trajectory:
        """The trajectory at (N,) instants from 0, s."""
        parts = dict(zip(("q", "dq", "ddq"), self.motion(time), strict=True))
        joints = range(self.joint_count)
        return trajectory(time, {f"{name}{j + 1}": values[:, j] for j in joints for name, values in parts.items()})


class FourierJoint(Strict):
    """Coefficients of one joint: q = offset + sum_k cosine_k cos(k w t) + sine_k sin(k w t).

    Attributes:
        offset: rad or m.
        cosine, sine: one coefficient a harmonic, k = 1, 2, ..., in rad or m.
    """

    offset: float = 0.0
    cosine: tuple[float, ...]
    sine: tuple[float, ...]

    @model_validator(mode="after")
    def _same_length(self) -> FourierJoint:
        if len(self.cosine) != len(self.sine) or not self.cosine:
            raise ValueError(f"cosine has {len(self.cosine)} and sine {len(self.sine)} coefficients")
        return self


class Fourier(Excitation):
    """Periodic excitation by a finite Fourier series (Swevers et al. 1997), w = 2 pi fundamental_hz.

    Attributes:
        fundamental_hz: frequency of the first harmonic; duration_s: length of the motion.
        joints: coefficients of each joint.
    """

    kind: Literal["fourier"] = "fourier"
    fundamental_hz: Positive
    duration_s: Positive
    joints: tuple[FourierJoint, ...] = Field(min_length=1)

    @property
    def joint_count(self) -> int:
        return len(self.joints)

    @property
    def length_s(self) -> float:
        return self.duration_s

    def motion(self, time: Array) -> tuple[Array, Array, Array]:
        w = 2 * np.pi * self.fundamental_hz
        q, dq, ddq = (np.zeros((time.size, len(self.joints)), order="F") for _ in range(3))
        q[:] = [joint.offset for joint in self.joints]
        for k in range(1, max(len(joint.cosine) for joint in self.joints) + 1):
            c, s, f = np.cos(k * w * time), np.sin(k * w * time), k * w  # of all joints
            for j, joint in enumerate(self.joints):
                if k > len(joint.cosine):
                    continue
                a, b = joint.cosine[k - 1], joint.sine[k - 1]
                own = a * c + b * s
                q[:, j] += own
                dq[:, j] += f * (-a * s + b * c)
                ddq[:, j] -= f * f * own
        return q, dq, ddq


class PointToPoint(Excitation):
    """Rest-to-rest moves between points with the quintic polynomial 10 s^3 - 15 s^4 + 6 s^5.

    Attributes:
        points: positions (n,) to visit; the first one is the start.
        move_s: duration of each move; dwell_s: rest after each.
    """

    kind: Literal["point_to_point"] = "point_to_point"
    points: tuple[tuple[float, ...], ...] = Field(min_length=2)
    move_s: Positive
    dwell_s: float = Field(default=0.0, ge=0)

    @model_validator(mode="after")
    def _same_joints(self) -> PointToPoint:
        if len({len(p) for p in self.points}) != 1 or not self.points[0]:
            raise ValueError("all points need one value for each joint")
        return self

    @property
    def joint_count(self) -> int:
        return len(self.points[0])

    @property
    def length_s(self) -> float:
        return (len(self.points) - 1) * (self.move_s + self.dwell_s)

    def motion(self, time: Array) -> tuple[Array, Array, Array]:
        points = np.array(self.points)
        # 1e-9: an instant within rounding of the end of a move belongs to the next one.
        leg = np.floor(time / (self.move_s + self.dwell_s) + 1e-9).astype(int).clip(0, len(points) - 2)
        s = ((time - leg * (self.move_s + self.dwell_s)) / self.move_s).clip(0.0, 1.0)
        way = points[leg + 1] - points[leg]
        q = points[leg] + way * (s**3 * (10 - 15 * s + 6 * s**2))[:, None]
        dq = way * (30 * s**2 * (1 - s) ** 2 / self.move_s)[:, None]
        ddq = way * (60 * s * (1 - s) * (1 - 2 * s) / self.move_s**2)[:, None]
        return q, dq, ddq


class ChirpJoint(Strict):
    """One joint of a chirp: amplitude and centre of its oscillation.

    Attributes:
        amplitude, offset: rad or m.
    """

    amplitude: float
    offset: float = 0.0


class Chirp(Excitation):
    """q = offset + amplitude sin(phi(t)), the frequency phi'/(2 pi) rising linearly from start_hz to stop_hz.

    Attributes:
        start_hz, stop_hz: frequency at the start and at the end; duration_s: length of the motion.
        joints: amplitude and centre of each joint.
    """

    kind: Literal["chirp"] = "chirp"
    start_hz: Positive
    stop_hz: Positive
    duration_s: Positive
    joints: tuple[ChirpJoint, ...] = Field(min_length=1)

    @property
    def joint_count(self) -> int:
        return len(self.joints)

    @property
    def length_s(self) -> float:
        return self.duration_s

    def motion(self, time: Array) -> tuple[Array, Array, Array]:
        slope = 2 * np.pi * (self.stop_hz - self.start_hz) / self.duration_s
        phase = 2 * np.pi * self.start_hz * time + 0.5 * slope * time**2
        rate = 2 * np.pi * self.start_hz + slope * time
        amplitude = np.array([j.amplitude for j in self.joints])
        offset = np.array([j.offset for j in self.joints])
        sine, cosine = np.sin(phase)[:, None], np.cos(phase)[:, None]
        q = offset + amplitude * sine
        dq = amplitude * cosine * rate[:, None]
        ddq = amplitude * (cosine * slope - sine * (rate**2)[:, None])
        return q, dq, ddq


AnyExcitation = Annotated[Fourier | PointToPoint | Chirp, Field(discriminator="kind")]
