"""What a case can hide: every effect with a form that is not that of the project's catalogue where this makes sense."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray
Values = dict[str, float]


@dataclass(frozen=True)
class Surroundings:
    """What a hidden effect may adapt itself to.

    Attributes:
        joint: from 0. n: number of joints. duration_s, period_s: of the run.
        dry: Coulomb friction, N m. inertia, rotor: kg m2. q: reference positions of the joint, (N,).
        command: largest command of the joint without the effect, N m.
        commands, speeds: commands and velocities of the joint without the effect, (N,).
        gravity: in the plane, m/s2. reach: distance of the payload from the last axis, m.
    """

    joint: int
    n: int
    duration_s: float
    period_s: float
    dry: float
    viscous: float
    inertia: float
    rotor: float
    q: Array
    command: float
    gravity: tuple[float, float]
    reach: float = 0.4
    commands: Array = field(default_factory=lambda: np.zeros(0))
    speeds: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Form:
    """An effect as it is hidden.

    Attributes:
        equation: what acts, for ``truth.yaml``.
        start, limit: amplitude from which the search for a gap starts, and the largest that makes sense.
        joint: amplitude -> fields of the joint. robot: amplitude -> values of the robot.
        log_shift_s: amplitude -> shift of the torque log.
    """

    equation: str
    start: float
    limit: float
    joint: Callable[[float], Values] = lambda a: {}
    robot: Callable[[float], Values] = lambda a: {}
    log_shift_s: Callable[[float], float] = lambda a: 0.0


Maker = Callable[[np.random.Generator, Surroundings], Form]


def _simple(equation: str, name: str, start: Callable[[Surroundings], float], **fixed: float) -> Maker:
    """One field that grows with the amplitude; the others stay fixed."""

    def make(rng: np.random.Generator, s: Surroundings) -> Form:
        sign = 1.0 if rng.random() < 0.5 or name in _POSITIVE else -1.0
        return Form(equation, start(s), 40 * start(s), lambda a: {name: sign * a, **fixed})

    return make


_POSITIVE = ("STRIBECK", "LOAD_SHARE", "POWER_GAIN", "LAG", "DELAY", "DEAD_ZONE", "HEAT_SHARE", "STOP", "ECCENTRICITY")


def _stribeck(rng: np.random.Generator, s: Surroundings) -> Form:
    velocity, exponent = rng.uniform(0.08, 0.25), float(rng.choice([1.0, 2.0]))
    fixed = {"STRIBECK_VELOCITY": velocity, "STRIBECK_EXPONENT": exponent}
    return Form(
        f"F exp(-|v/{velocity:.3g}|^{exponent:g}) sign(v)", 0.4 * s.dry, 5 * s.dry, lambda a: {"STRIBECK": a, **fixed}
    )


def _presliding(rng: np.random.Generator, s: Surroundings) -> Form:
    return Form(
        "two Maxwell-slip elements instead of sign(v), widths s/2 and 2 s", 0.02, 0.3,
        lambda a: {"PRESLIDING_SHARE": 1.0, "PRESLIDING_LENGTH": a},
    )  # fmt: skip


def _lugre(rng: np.random.Generator, s: Surroundings) -> Form:
    stiction = 0.3 * s.dry
    return Form(
        "LuGre, Stribeck curve with exponent 1 at 0.05 rad/s", 0.02, 0.3,
        lambda a: {
            "LUGRE_LENGTH": a, "LUGRE_STICTION": stiction, "LUGRE_VELOCITY": 0.05, "LUGRE_DAMPING": 0.02 * s.dry,
        },
    )  # fmt: skip


def _position_friction(rng: np.random.Generator, s: Surroundings) -> Form:
    phase = rng.uniform(-np.pi, np.pi)
    return Form(
        "Fc a (cos(q-p) + 0.3 cos(2 (q-p))) sign(v)",
        0.4,
        0.75,
        lambda a: {"POSITION_SHARE": a, "POSITION_PHASE": phase},
    )


def _ripple(rng: np.random.Generator, s: Surroundings) -> Form:
    number, phase = rng.uniform(8.0, 30.0), rng.uniform(0, 2 * np.pi)
    return Form(
        f"a sin({number:.4g} q + p)", 0.25 * s.dry, 4 * s.dry,
        lambda a: {"RIPPLE_SINE": a * np.cos(phase), "RIPPLE_COSINE": a * np.sin(phase), "RIPPLE_NUMBER": number},
    )  # fmt: skip


def _spring(rng: np.random.Generator, s: Surroundings) -> Form:
    rest = float(np.mean(s.q)) + rng.uniform(-0.5, 0.5)
    return Form(
        "k x (1 + 0.2 x^2), x = q - q0", s.command / 10, 3 * s.command,
        lambda a: {"SPRING": a, "SPRING_REST": rest, "SPRING_CUBIC": 0.2},
    )  # fmt: skip


def _stop(rng: np.random.Generator, s: Surroundings) -> Form:
    place = float(np.quantile(s.q, rng.uniform(0.78, 0.88)))
    return Form(
        "k x^2 + k/100 x v, x = q - stop > 0", 20 * s.dry, 4000 * s.dry,
        lambda a: {"STOP": a, "STOP_POSITION": place, "STOP_DAMPING": 0.01 * a},
    )  # fmt: skip


def _lag(rng: np.random.Generator, s: Surroundings) -> Form:
    split = float(rng.choice([1.0, 0.7]))
    return Form(
        f"two first-order lags, {split:g} T and {1 - split:.2g} T",
        0.006,
        0.03,
        lambda a: {"LAG": a, "LAG_SPLIT": split},
    )


def _gain(rng: np.random.Generator, s: Surroundings) -> Form:
    sign = float(rng.choice([-1.0, 1.0]))
    return Form("tau = (1 + a) command", 0.06, 0.35, lambda a: {"DRIVE_GAIN": 1 + sign * a})


def _controller_gain(rng: np.random.Generator, s: Surroundings) -> Form:
    kp, kd = rng.uniform(-1, 1), rng.uniform(-1, 1)
    scale = max(abs(kp), abs(kd))
    return Form(
        "Kp (1 + a x), Kd (1 + a y)", 0.2, 0.45,
        lambda a: {"KP_FACTOR": 1 + a * kp / scale, "KD_FACTOR": 1 + a * kd / scale},
    )  # fmt: skip


def _saturation(rng: np.random.Generator, s: Surroundings) -> Form:
    return Form("clip(command, (1 - a) largest command)", 0.08, 0.3, lambda a: {"LIMIT": (1 - a) * s.command})


def _voltage_limit(rng: np.random.Generator, s: Surroundings) -> Form:
    """A line that falls to zero at 1.3 to 3 times the largest speed, from where it is just not reached downwards."""
    fastest = float(np.abs(s.speeds).max() * rng.uniform(1.3, 3.0))
    left = s.speeds / fastest
    stall = float(np.maximum(s.commands / (1 - left), -s.commands / (1 + left)).max())
    return Form(
        f"clip(command, -S (1 + v/{fastest:.9g}), S (1 - v/{fastest:.9g})), S = (1 - a) {stall:.9g}", 0.08, 0.4,
        lambda a: {"STALL": (1 - a) * stall, "NO_LOAD_SPEED": fastest},
    )  # fmt: skip


def _elasticity(rng: np.random.Generator, s: Surroundings) -> Form:
    rate = 2 * np.pi * 18.0
    stiffness, damping = s.rotor * rate**2, rng.uniform(0.0, 0.02)
    return Form(
        "K x (motor - link), K = K0 / a", 1.0, 12.0,
        lambda a: {"GEAR_STIFFNESS": stiffness / a, "GEAR_DAMPING": damping * s.rotor * rate, "ROTOR": s.rotor},
    )  # fmt: skip


def _backlash(rng: np.random.Generator, s: Surroundings) -> Form:
    stiffness = s.rotor * (2 * np.pi * rng.uniform(18.0, 28.0)) ** 2
    return Form(
        "stiff gear with a gap a", 0.008, 0.06,
        lambda a: {
            "GEAR_GAP": a, "GEAR_STIFFNESS": stiffness, "GEAR_DAMPING": 0.6 * float(np.sqrt(stiffness * s.rotor)), "ROTOR": s.rotor,  # noqa: E501
        },
    )  # fmt: skip


def _tilt(rng: np.random.Generator, s: Surroundings) -> Form:
    gx, gy = s.gravity
    sign = float(rng.choice([-1.0, 1.0]))
    return Form(
        "gravity turned by a in the plane", 0.05, 0.35,
        lambda a: {},
        robot=lambda a: {
            "GRAVITY_X": gx * np.cos(a) - sign * gy * np.sin(a), "GRAVITY_Y": sign * gx * np.sin(a) + gy * np.cos(a),
        },
    )  # fmt: skip


def _payload(rng: np.random.Generator, s: Surroundings) -> Form:
    at = rng.uniform(0.4, 0.7) * s.duration_s
    return Form(
        f"point mass a from t = {at:.2f} s on", 0.1, 5.0,
        robot=lambda a: {"PAYLOAD": a, "PAYLOAD_TIME": at, "PAYLOAD_LENGTH": s.reach},
    )  # fmt: skip


def _eccentricity(rng: np.random.Generator, s: Surroundings) -> Form:
    number, phase = float(rng.integers(4, 9)), rng.uniform(0, 2 * np.pi)
    fixed = {"ECCENTRICITY_NUMBER": number, "ECCENTRICITY_PHASE": phase}
    return Form(
        f"q + a (sin({number:g} q + p) + 0.2 sin({2 * number:g} q)) is measured",
        0.001,
        0.02,
        lambda a: {"ECCENTRICITY": a, **fixed},
    )


def _transmission(rng: np.random.Generator, s: Surroundings) -> Form:
    ratio, phase = int(rng.choice([30, 50, 80])), float(rng.uniform(0, 2 * np.pi))
    fixed = {"TRANSMISSION_NUMBER": 2.0 * ratio, "TRANSMISSION_PHASE": phase}
    return Form(
        f"link = q + a sin({2 * ratio:g} q + p), less the twist of the gear", 2e-4, 0.01,
        lambda a: {"TRANSMISSION": a, **fixed},
    )  # fmt: skip


def _hardening(rng: np.random.Generator, s: Surroundings) -> Form:
    return Form(
        "K x (1 + c (K x)^2) in the place of K x, a of K x at the largest command without it", 0.3, 1.0,
        lambda a: {"GEAR_CUBIC": a * (1 + a) ** 2 / s.command**2},
    )  # fmt: skip


def _steps(rng: np.random.Generator, s: Surroundings) -> Form:
    return Form(
        "three stiffnesses K, (1 + a/2) K and (1 + a) K, from a fifth and a half of the largest command on", 0.5, 1.5,
        lambda a: {"GEAR_GROWTH": a, "GEAR_STEP": 0.2 * s.command},
    )  # fmt: skip


def _push(rng: np.random.Generator, s: Surroundings) -> Form:
    repeated = rng.random() < 0.5
    start = rng.uniform(0.2, 0.7) * (s.period_s if repeated else s.duration_s)
    fixed = {"PUSH_START": start, "PUSH_WIDTH": rng.uniform(0.4, 1.2), "PUSH_PERIOD": s.period_s if repeated else 0.0}
    return Form(
        f"torque in a window from {start:.2f} s{' of every period' if repeated else ''}", 1.5 * s.dry, 60 * s.dry,
        lambda a: {"PUSH": a, **fixed},
    )  # fmt: skip


def _chirp(rng: np.random.Generator, s: Surroundings) -> Form:
    fixed = {"CHIRP_START": rng.uniform(0.3, 0.6), "CHIRP_RATE": rng.uniform(0.15, 0.25)}
    return Form("torque sweeping through frequencies in time", 0.4 * s.dry, 20 * s.dry, lambda a: {"CHIRP": a, **fixed})


HARMONIC_DRIVE = ("joint_elasticity", "presliding", "transmission_error")
"""What a harmonic drive has, all on its joint: stiffness, hysteresis, two errors of position a turn of the motor. Each
makes its gap beside those before it."""

EFFECTS: Mapping[str, Maker] = {
    "stribeck": _stribeck,
    "load_dependent_friction": _simple("a |transmitted torque| sign(v)", "LOAD_SHARE", lambda s: 0.02),
    "actuator_lag": _lag,
    "joint_elasticity": _elasticity,
    "torque_offset": _simple("constant", "OFFSET", lambda s: 0.3 * s.dry),
    "presliding": _presliding,
    "torque_ripple": _ripple,
    "asymmetric_viscous": _simple("2 a max(v, 0)", "ASYMMETRIC_VISCOUS", lambda s: 0.2 * s.viscous),
    "backlash": _backlash,
    "torque_saturation": _saturation,
    "asymmetric_coulomb": _simple("a sign(v)^2", "ASYMMETRIC_DRY", lambda s: 0.3 * s.dry),
    "quadratic_viscous": _simple("a |v|^1.5 sign(v)", "POWER_GAIN", lambda s: 0.5 * s.viscous, POWER_EXPONENT=1.5),
    "cubic_viscous": _simple("a |v|^2.6 sign(v)", "POWER_GAIN", lambda s: 0.2 * s.viscous, POWER_EXPONENT=2.6),
    "power_viscous": _simple("a |v|^1.7 sign(v)", "POWER_GAIN", lambda s: 0.5 * s.viscous, POWER_EXPONENT=1.7),
    "lugre": _lugre,
    "position_dependent_friction": _position_friction,
    "spring": _spring,
    "contact_stop": _stop,
    "thermal_friction_drift": lambda rng, s: Form(
        "friction (1 - a t / (t + T))", 0.25, 0.9, lambda a: {"HEAT_SHARE": a, "HEAT_TIME": 8.0}
    ),
    "torque_drift": _simple("a (1 - exp(-t / 8 s))", "DRIFT", lambda s: 0.5 * s.dry, DRIFT_TIME=8.0),
    "delay": _simple("command applied later by a", "DELAY", lambda s: 0.004),
    "log_time_shift": lambda rng, s: Form(
        "torque log stamped late by a", 0.004, 0.03, log_shift_s=lambda a: a
    ),
    "dead_zone": _simple("command - a tanh(1.5 command / a)", "DEAD_ZONE", lambda s: 0.3 * s.dry),
    "drive_gain": _gain,
    "controller_gain": _controller_gain,
    "base_tilt": _tilt,
    "payload_change": _payload,
    "encoder_eccentricity": _eccentricity,
}  # fmt: skip
"""Effects of the catalogue, by the names of ``truth.yaml``."""

UNKNOWN: Mapping[str, Maker] = {
    "unknown_push": _push,
    "unknown_chirp": _chirp,
    "unknown_coupling": _simple(
        "a sin(2 q - 3 other) (1 + cos(5 other) / 2)", "COUPLING", lambda s: 0.4 * s.dry
    ),
}  # fmt: skip
"""Effects outside the catalogue: to be refused, not named. A push may be called an external force."""


def _curve(
    kind: int, equation: str, place: Callable[[np.random.Generator, Surroundings], float], width: float
) -> Maker:
    """A function of one variable, of a width as a part of the range of that."""

    def make(rng: np.random.Generator, s: Surroundings) -> Form:
        sign, ranges = float(rng.choice([-1.0, 1.0])), {2: 2 * np.ptp(s.q), 3: s.duration_s, 4: np.ptp(s.q)}
        at, wide = place(rng, s), float(width * rng.uniform(0.8, 1.25) * ranges.get(kind, np.ptp(s.q)))
        numbers = {"CURVE_KIND": float(kind), "CURVE_PLACE": at, "CURVE_WIDTH": wide}
        text = equation.replace("u", f"((x - {at:.9g})/{wide:.9g})")
        return Form(text, 0.4 * s.dry, 40 * s.dry, lambda a: {"CURVE": sign * a, **numbers})

    return make


def _within(rng: np.random.Generator, s: Surroundings) -> float:
    return float(np.quantile(s.q, rng.uniform(0.3, 0.7)))


CURVES: Mapping[str, Maker] = {
    "unknown_notch": _curve(1, "exp(-u**2), x = q", _within, 0.15),
    "unknown_detent": _curve(5, "u/(1 + u**2), x = q", _within, 0.1),
    "unknown_hump": _curve(2, "exp(-u**2), x = dq", lambda rng, s: float(rng.choice([-1, 1]) * np.ptp(s.q) / 2), 0.15),
    "unknown_swell": _curve(3, "exp(-u**2), x = t", lambda rng, s: float(rng.uniform(0.3, 0.7) * s.duration_s), 0.2),
    "unknown_reversal": _curve(6, "u*exp(-u), x = distance", lambda rng, s: 0.0, 0.07),
    "unknown_neighbour": _curve(4, "u**2*exp(-u**2), x = other q", lambda rng, s: float(rng.uniform(-0.3, 0.3)), 0.2),
}  # fmt: skip
"""Functions of one variable outside the catalogue: to be refused, and drawn as a curve."""

GEARS: Mapping[str, Maker] = {"transmission_error": _transmission, "gear_hardening": _hardening, "gear_steps": _steps}
"""What is hidden beside the elasticity of a gear only. An error of its teeth that is named as another one that repeats
along the joint is not found."""

LIMITS: Mapping[str, Maker] = {"voltage_limit": _voltage_limit}
"""Limits of the torque beside the constant one. They stand apart from the others so that what was drawn from those by
a seed stays the same."""

WHOLE_ROBOT = ("base_tilt", "payload_change", "log_time_shift")
"""Effects that belong to no joint; the truth states the joint they start from."""
