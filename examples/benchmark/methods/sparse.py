"""SINDy on the residual: a library of terms of a joint, and sequentially thresholded least squares of ``pysindy``.

S. Brunton, J. Proctor and J. N. Kutz, PNAS 113 (2016). What the base parameters can change is projected out of residual
and library first; of the thresholds tried that of least BIC is taken, as information criteria choose among sparse
models in N. Mangan et al., Proc. R. Soc. A 473 (2017).
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from examples.benchmark.answer import Answer, Name, named
from examples.benchmark.base import STRONG, Base
from fmu_didim.data.signals import Array

VELOCITIES = (0.05, 0.1, 0.2)
"""[rad/s] Of Stribeck terms."""
RIPPLES = range(5, 31)
"""[1/rad] Of terms that repeat with the position."""
THRESHOLDS = np.geomspace(0.01, 1.0, 15)
"""[1] Tried, as parts of the residual that a term explains: columns and residual have the norm 1, which suits the ridge
that pysindy has by itself."""


def answer(case: Path) -> Answer:
    """The terms that are left, the largest first, by the effects that they mean."""
    base = Base.of(case)
    terms = library(base)
    table = np.column_stack([column for _, column in terms])
    own = table - base.basis @ (base.basis.T @ table)
    size, target = np.linalg.norm(own, axis=0), base.target - base.basis @ (base.basis.T @ base.target)
    norm = float(np.linalg.norm(target))
    found = _sparse(own / np.where(size > 0, size, 1), target / norm)
    strength: dict[tuple[str, int], float] = {}
    for (place, _), coefficient in zip(terms, found, strict=True):
        if coefficient:
            strength[place] = max(strength.get(place, 0.0), abs(float(coefficient)))
    ordered = sorted(strength, key=lambda place: -strength[place])
    return named([Name(effect, joint) for effect, joint in ordered])


def _sparse(table: Array, target: Array) -> Array:
    """(m,) coefficients of least BIC over the thresholds; zeros where none gains ``STRONG``."""
    from pysindy import STLSQ

    rows, best = len(target), np.zeros(table.shape[1])
    least = rows * np.log(float(target @ target) / rows) - STRONG
    for threshold in THRESHOLDS:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that nothing is left, which the BIC sees
            coefficients = np.asarray(STLSQ(threshold=threshold).fit(table, target[:, None]).coef_).reshape(-1)
        rest = target - table @ coefficients
        bic = rows * np.log(float(rest @ rest) / rows) + np.count_nonzero(coefficients) * np.log(rows)
        if bic < least:
            least, best = bic, coefficients
    return best


def library(base: Base) -> list[tuple[tuple[str, int], Array]]:
    """(effect, joint) that a term means, and its column (N n,): all joints, each with its own position, velocity, load,
    logged torque and time."""
    m, found = base.motion, []
    for joint in range(m.joint_count):
        q, v, load, torque = (getattr(m, name)[:, joint] for name in ("q", "dq", "load", "torque"))
        s, t = np.sign(v), m.time - m.time[0]
        terms = [
            ("torque_offset", np.ones_like(q)), ("asymmetric_viscous", np.abs(v)), ("asymmetric_viscous", v**2),
            ("quadratic_viscous", v * np.abs(v)), ("cubic_viscous", v**3),
            ("load_dependent_friction", np.abs(load) * s), ("position_dependent_friction", np.cos(q) * s),
            ("position_dependent_friction", np.sin(q) * s), ("spring", q), ("spring", q**2), ("spring", q**3),
            ("actuator_lag", np.gradient(torque, t)), ("drive_gain", torque), ("torque_drift", t),
            ("thermal_friction_drift", t * s),
        ]  # fmt: skip
        terms += [("stribeck", np.exp(-np.abs(v / vs)) * s) for vs in VELOCITIES]
        terms += [("torque_ripple", wave(k * q)) for k in RIPPLES for wave in (np.sin, np.cos)]
        found += [((effect, joint + 1), base.on_joint(joint, column[:, None])[:, 0]) for effect, column in terms]
    return found
