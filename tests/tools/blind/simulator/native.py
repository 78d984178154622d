"""The compiled simulator: its fields, how it is built, and one run of it."""

from __future__ import annotations

import ctypes
import hashlib
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from fmu_didim.base.cache import cached_folder
from fmu_didim.export.build import compile_shared_library, find_compiler

Array = np.ndarray
SOURCES = tuple(Path(__file__).with_name(name) for name in ("plant.c", "effects.h"))
"""The first is compiled, and includes the others."""

GLOBALS = (
    "ZZ1R", "MX1", "MY1", "ZZ2", "MX2", "MY2", "LENGTH", "GRAVITY_X", "GRAVITY_Y",
    "PAYLOAD", "PAYLOAD_TIME", "PAYLOAD_LENGTH",
)  # fmt: skip
"""Values of the whole robot, in the simulator's counter-clockwise convention; SI units."""

FIELDS = (
    "FV", "FC", "ROTOR", "OFFSET", "ASYMMETRIC_DRY", "ASYMMETRIC_VISCOUS", "POWER_GAIN", "POWER_EXPONENT",
    "STRIBECK", "STRIBECK_VELOCITY", "STRIBECK_EXPONENT", "PRESLIDING_SHARE", "PRESLIDING_LENGTH",
    "PRESLIDING_SHARPNESS", "LUGRE_LENGTH", "LUGRE_STICTION", "LUGRE_VELOCITY", "LUGRE_DAMPING", "LOAD_SHARE",
    "POSITION_SHARE", "POSITION_PHASE", "RIPPLE_SINE", "RIPPLE_COSINE", "RIPPLE_NUMBER", "SPRING", "SPRING_REST",
    "SPRING_CUBIC", "STOP", "STOP_POSITION", "STOP_DAMPING", "HEAT_SHARE", "HEAT_TIME", "DRIFT", "DRIFT_TIME", "LAG",
    "LAG_SPLIT", "DELAY", "DEAD_ZONE", "DRIVE_GAIN", "LIMIT", "STALL", "NO_LOAD_SPEED", "GEAR_STIFFNESS",
    "GEAR_DAMPING", "GEAR_GAP", "GEAR_CUBIC", "GEAR_GROWTH", "GEAR_STEP",
    "TRANSMISSION", "TRANSMISSION_NUMBER", "TRANSMISSION_PHASE", "ENCODER_AT_LINK",
    "ECCENTRICITY", "ECCENTRICITY_NUMBER", "ECCENTRICITY_PHASE", "KP_FACTOR", "KD_FACTOR", "PUSH", "PUSH_START",
    "PUSH_WIDTH", "PUSH_PERIOD", "CHIRP", "CHIRP_START", "CHIRP_RATE", "COUPLING", "CURVE", "CURVE_KIND", "CURVE_PLACE",
    "CURVE_WIDTH", "CLUTTER_RIPPLE", "CLUTTER_NUMBER", "CLUTTER_STRIBECK", "CLUTTER_DRIFT",
)  # fmt: skip
"""Values of each joint, SI units; 0 where :data:`STARTS` says nothing, which leaves an effect out."""

STARTS = {
    "DRIVE_GAIN": 1.0, "KP_FACTOR": 1.0, "KD_FACTOR": 1.0, "STRIBECK_VELOCITY": 0.1, "STRIBECK_EXPONENT": 1.0,
    "POWER_EXPONENT": 1.0, "PRESLIDING_SHARPNESS": 8.0, "PRESLIDING_LENGTH": 0.02, "LUGRE_VELOCITY": 0.05,
    "HEAT_TIME": 8.0, "DRIFT_TIME": 8.0, "LAG_SPLIT": 0.5, "PUSH_WIDTH": 1.0,
    "CURVE_WIDTH": 1.0,
}  # fmt: skip


class SimulationFailedError(RuntimeError):
    """The loop diverged, or needed too many steps."""


@dataclass(frozen=True)
class Run:
    """What the simulator returns, every array (N, n) at the control rate.

    Attributes:
        command: torque command, N m; it holds from its instant on.
        q, dq, ddq: motion of the links; ddq just after the command was applied.
        steps: integration steps made.
    """

    command: Array
    q: Array
    dq: Array
    ddq: Array
    steps: int


@cache
def _library() -> ctypes.CDLL:
    header = "".join(
        f"enum {{ {', '.join(names)}, {count} }};\n"
        for names, count in ((GLOBALS, "GLOBAL_COUNT"), (FIELDS, "FIELD_COUNT"))
    )
    compiler = find_compiler()
    key = hashlib.sha256(("".join(p.read_text() for p in SOURCES) + header + repr(compiler)).encode()).hexdigest()[:32]

    def fill(folder: Path) -> None:
        for path in SOURCES:
            shutil.copy(path, folder / path.name)
        (folder / "fields.h").write_text(header)
        compile_shared_library(folder, folder / "plant.bin", main=SOURCES[0].name, compiler=compiler)

    return ctypes.CDLL(str(cached_folder("blind_simulator", key, fill) / "plant.bin"))


def run(
    reference: tuple[Array, Array],
    *,
    period_s: float,
    gains: Array,
    sign: Array,
    robot: Mapping[str, float],
    joints: tuple[Mapping[str, float], ...],
    start_s: float = 0.0,
    tolerance: float = 1e-8,
) -> Run:
    """One closed-loop run.

    Args:
        reference: positions and velocities, each (N, n), every ``period_s``.
        gains: (n, 3): Kp, Kd and the encoder step of each joint.
        sign: (n,): +1, or -1 where the joint turns clockwise.
        robot: values of :data:`GLOBALS`; joints: values of :data:`FIELDS`, one mapping a joint.
        tolerance: absolute and relative error allowed in a step.

    Raises:
        SimulationFailedError: the loop diverged. KeyError: a name is unknown.
    """
    qr, vr = (np.ascontiguousarray(x, dtype=float) for x in reference)
    count, n = qr.shape
    values = np.array([robot.get(name, 0.0) for name in GLOBALS], dtype=float)
    table = np.array([[STARTS.get(name, 0.0) for name in FIELDS]] * n, dtype=float)
    for row, given in zip(table, joints, strict=True):
        for name, value in given.items():
            row[_POSITIONS[name]] = value
    gains, sign = (np.ascontiguousarray(x, dtype=float) for x in (gains, sign))
    outputs = [np.zeros((count, n)) for _ in range(4)]
    steps = ctypes.c_long()

    def at(array: Array) -> ctypes.c_void_p:
        return ctypes.c_void_p(array.ctypes.data)

    status = _library().run(
        n, count, ctypes.c_double(period_s), ctypes.c_double(start_s), at(qr), at(vr), at(gains), at(sign), at(values),
        at(table), ctypes.c_double(tolerance), *(at(x) for x in outputs), ctypes.byref(steps),
    )  # fmt: skip
    if status != 0 or not np.isfinite(outputs[0]).all():
        raise SimulationFailedError(f"status {status} after {steps.value} steps")
    return Run(*outputs, steps=steps.value)


_POSITIONS = {name: i for i, name in enumerate(FIELDS)}
