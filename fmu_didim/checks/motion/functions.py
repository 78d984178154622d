"""Functions of the motion of a joint that a residual torque may follow, each with what a model may lack where it does.

They are the direction of motion and of the torque, powers of velocity and position, sines and cosines of the angles of
the links, products of these with time, and what changes in the course of a log.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.cosim import Indices, Recording
from fmu_didim.data.filters import LowPass
from fmu_didim.data.signals import Array
from fmu_didim.fit.log_noise import STANDSTILL
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.model.loop_model import Simulation

TURNING = 0.05
"""[1] Fraction of the largest speed of a joint, or of its largest torque, over which its direction changes."""
CREEPING = 0.005
"""[1] The same near standstill, for steeper friction."""
SMOOTHER = 0.5
"""[1] Of the bandwidth up to which a virtual controller follows positions, below which their noise hardly shows in the
motion: of an acceleration a thirtieth of its power is left."""
STEPS = (0.25, 0.5, 0.75)
"""[1] Of a log, after which functions change: two of them follow a change at any time to two thirds and more."""

TORQUE_RATE = "rate of the torque"
"""The function of the motion by which a shifted clock of the log shows."""
SIGNATURE = "signature of "
"""Before the words for an effect of the catalogue, whose change of the logged torque is looked for as it is."""
RIPPLES = "position at "
"""Before the number of ripples with which a residual repeats along a joint."""
FRICTION = "direction of motion at "
"""The same where it turns with the direction of motion, too."""
BEYOND = "position "
"""Before the place beyond which a residual is on one side."""
NEAR = " near "
"""Between a quantity and the value near which a residual is of its own."""
LIKE_PLACES: Mapping[str, str] = {
    "position": "a detent or a worn place",
    "velocity": "friction with a peak or a resonance there",
    "load": "a gear that changes there",
    "time": "a push from outside",
}
"""Quantity -> what a model may lack that acts near a value of it."""
LIKE_NEIGHBOUR = "a cable or a hose across the joints"
"""The same of the position or velocity of a neighbour."""
LOOKS_LIKE: Mapping[str, str] = {
    TORQUE_RATE: "a wrong clock or a lag of the drive",
    "direction of motion": "other Coulomb friction",
    "square of the velocity": "friction that is quadratic in the velocity",
    "acceleration": "another inertia of the rotor",
    "velocity": "other viscous friction",
    "offset": "an offset of the torque",
    "torque": "another scale of the torque",
    "size of the torque": "a drive with another gain in one direction",
    "direction of the torque": "a dead zone of the drive",
    "friction by load": "friction that grows with the load",
    "velocity near standstill": "steeper friction at standstill",
    "time in the direction of motion": "friction that grows or falls with time",
    "time and velocity": "viscous friction that grows or falls with time",
    "size of the velocity": "friction that differs between the directions",
    "cube of the velocity": "friction that is cubic in the velocity",
    "kinetic energy": "the coupling of the links",
    "jerk": "an elastic joint or a wrong clock",
    "position": "a spring",
    "square of the position": "a spring that is not linear",
    "cube of the position": "a spring that is not linear",
    "time": "an offset that drifts",
    "cube of the torque": "a drive that saturates",
    "curvature of the torque": "averages of the torque, or a lag",
}
"""Function of the motion -> what a model may lack that would look like it."""
LIKE_GRAVITY = "a tilted base or other gravity"
"""The same of the sine or cosine of the angle of a link."""
LIKE_PAYLOAD = "a payload that changes on the way"
"""The same of torque and acceleration that change in the course."""


def looks_like(name: str) -> str:
    """What a model may lack where its residual follows this function."""
    if name.startswith(SIGNATURE):
        return name.removeprefix(SIGNATURE)
    if name.startswith(RIPPLES):
        return "a ripple of the torque"
    if name.startswith(FRICTION):
        return "friction that changes along the joint"
    if name.startswith((BEYOND + "above", BEYOND + "below")):
        return "a stop or a spring that begins there"
    quantity, is_near, _ = name.partition(NEAR)
    if is_near and name not in LOOKS_LIKE:
        return LIKE_PLACES.get(quantity, LIKE_NEIGHBOUR)
    return LOOKS_LIKE.get(name, LIKE_PAYLOAD if "which changes" in name else LIKE_GRAVITY)


def at_ripples(number: float, *, slides: bool, of_friction: bool = False) -> str:
    """The name of the functions of a ripple: so many in a turn, or rad/m."""
    own = (
        f"a ripple every {2000 * np.pi / number:.3g} mm" if slides else f"{number:g} ripple{'s' * (number != 1)} a turn"
    )
    return (FRICTION if of_friction else RIPPLES) + own


def beyond(place: float, *, above: bool, slides: bool) -> str:
    """The name of the functions of what acts above or below a place, in rad or m."""
    own = f"{1000 * place:.3g} mm" if slides else f"{place:.3g} rad"
    return f"{BEYOND}{'above' if above else 'below'} {own}"


def near(quantity: str, value: float, *, slides: bool, joint: int = 0) -> str:
    """The name of what acts near a value, SI, of a quantity of a joint, of its own if that is 0."""
    units = {"position": ("rad", "m"), "velocity": ("rad/s", "m/s"), "load": ("N.m", "N"), "time": ("s", "s")}
    whose = f" of joint {joint}" if joint else ""
    return f"{quantity}{whose}{NEAR}{value:.3g} {units[quantity][slides]}"


def direction(dq: Array, over: float = TURNING, *, fastest: float | None = None) -> Array:
    """(K,) of a motion of velocity (K,): it changes over so much of the largest speed; ``fastest``: of a longer motion,
    of which these are some instants."""
    largest = float(np.abs(dq).max()) if fastest is None else fastest
    return np.asarray(np.tanh(dq / (over * max(largest, STANDSTILL))))


def functions_of_motion(run: Simulation) -> list[dict[str, Array]]:
    """Functions (N,) of the simulated motion of each joint at the samples, by name, the most significant ones first.

    Velocities and positions are included as far as the plant gives them; raises SimulationError.
    """
    return list(joint_by_joint(run))


def joint_by_joint(run: Simulation) -> Iterator[dict[str, Array]]:
    """The same, of one joint after the other: of a long log they take the memory of many logs."""
    motion = _Motion.of(run, run.record(all_ticks=True)).at(run.operator.ticks)

    def of_joint(j: int) -> dict[str, Array]:
        return {name: run.sampled(column) for name, column in motion.functions(j)}

    return map(of_joint, range(run.model.joint_count))


@dataclass(frozen=True)
class _Motion:
    """A recorded motion at some or all of its ticks.

    Attributes:
        time: (K,) from the middle of the log, in halves of its length; torque: (K, n).
        rate, curvature: of the torque, its first and second derivative.
        velocity, acceleration, jerk, position: joint, from 0, -> (K,), as far as the plant gives them; the position
            from its mean.
        angle: the same of the link behind a joint, the sum of those up to it; empty where a joint slides.
        largest, fastest: (n,) torque and joint -> speed of the whole motion.
    """

    time: Array
    torque: Array
    rate: Array
    curvature: Array
    velocity: Mapping[int, Array]
    acceleration: Mapping[int, Array]
    jerk: Mapping[int, Array]
    position: Mapping[int, Array]
    angle: Mapping[int, Array]
    largest: Array
    fastest: Mapping[int, float]

    @classmethod
    def of(cls, run: Simulation, recording: Recording) -> _Motion:
        model, step = run.model, recording.spacing
        offered, n, plant = {v.name for v in model.loop.plant.outputs}, model.joint_count, model.loop.plant_name
        velocity, position = (
            {j: recording.table([f"{plant}.{s}{j + 1}"])[:, 0] for j in range(n) if f"{s}{j + 1}" in offered}
            for s in ("dq", "q")
        )
        turning = len(position) == n and all(unit == "N.m" for unit in model.parameters.torque_units)
        torque = run.logged_torque(recording)
        time = 2 * (recording.time - recording.time[0]) / np.ptp(recording.time) - 1
        if model.loop.follows_hz is not None:  # the noise of positions is in the motion and in the residual
            low = LowPass(SMOOTHER * model.loop.follows_hz)
            torque, rate_hz = low.apply(torque, 1 / run.step_size), 1 / run.step_size
            velocity, position = ({j: low.apply(v, rate_hz) for j, v in of.items()} for of in (velocity, position))
        rate, acceleration = np.gradient(torque, step, axis=0), {j: np.gradient(dq, step) for j, dq in velocity.items()}
        return cls(
            time=time, torque=torque, rate=rate, curvature=np.gradient(rate, step, axis=0), velocity=velocity,
            acceleration=acceleration, jerk={j: np.gradient(ddq, step) for j, ddq in acceleration.items()},
            position={j: q - q.mean() for j, q in position.items()},
            angle=dict(enumerate(np.cumsum([position[j] for j in range(n)], axis=0))) if turning else {},
            largest=np.abs(torque).max(axis=0), fastest={j: float(np.abs(dq).max()) for j, dq in velocity.items()},
        )  # fmt: skip

    def at(self, ticks: Indices) -> _Motion:
        """The same at some ticks: those at which a log is taken are often one in fifty."""
        velocity, acceleration, jerk, position, angle = (
            {j: column[ticks] for j, column in of.items()}
            for of in (self.velocity, self.acceleration, self.jerk, self.position, self.angle)
        )
        return replace(
            self, time=self.time[ticks], torque=self.torque[ticks], rate=self.rate[ticks],
            curvature=self.curvature[ticks], velocity=velocity, acceleration=acceleration, jerk=jerk,
            position=position, angle=angle,
        )  # fmt: skip

    def functions(self, j: int) -> Iterator[tuple[str, Array]]:
        """Name and values (K,) of the functions of a joint, from 0."""
        torque, moves = self.torque[:, j], j in self.velocity
        size = np.abs(torque)
        yield TORQUE_RATE, self.rate[:, j]
        if moves:
            dq, ddq, fastest = self.velocity[j], self.acceleration[j], self.fastest[j]
            way = direction(dq, fastest=fastest)
            yield "direction of motion", way
            yield "square of the velocity", dq * np.abs(dq)
            yield "acceleration", ddq
            yield "velocity", dq
        yield "offset", np.ones(torque.size)
        yield "torque", torque
        yield "size of the torque", size
        yield "direction of the torque", np.tanh(torque / (TURNING * max(float(self.largest[j]), TINY)))
        if moves:
            yield "friction by load", size * way
            yield "velocity near standstill", direction(dq, CREEPING, fastest=fastest)
            yield "time in the direction of motion", self.time * way
            yield "time and velocity", self.time * dq
            yield "size of the velocity", np.abs(dq)
            yield "cube of the velocity", dq**3
            yield "kinetic energy", dq**2
            yield "jerk", self.jerk[j]
        for link in range(j, min(j + 2, len(self.angle))):
            yield f"sine of the angle of link {link + 1}", np.sin(self.angle[link])
            yield f"cosine of the angle of link {link + 1}", np.cos(self.angle[link])
        if j in self.position:
            q = self.position[j]
            yield from (("position", q), ("square of the position", q**2), ("cube of the position", q**3))
        yield "time", self.time
        yield "cube of the torque", torque**3
        yield "curvature of the torque", self.curvature[:, j]
        for at in STEPS:
            later = np.where(self.time > 2 * at - 1, 1.0, -1.0)
            when = f", which changes after {100 * at:.0f} % of the log"
            yield f"torque{when}", later * torque
            if moves:
                yield f"acceleration{when}", later * ddq
