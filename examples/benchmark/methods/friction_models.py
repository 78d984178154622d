"""Best of six friction models, joint by joint: Coulomb to quadratic load dependence.

The ladder is that of M. Duclusaud, G. Passault, V. Padois and O. Ly, *Extended Friction Models for the Physics
Simulation of Servo Actuators*, ICRA 2025 (arXiv:2410.08650), in equations of our own that are linear in their
amplitudes; they are fitted to the residual by least squares, with the base parameters free beside them, instead of in
simulations by a global search. With s = sign(v), E = exp(-|v/vs|^a), F the torque that the links ask of the joint, and
D = 1 where they drive the motion (F v < 0), else 0:

    M1  (base)                                 Coulomb and viscous
    M2  E s                                    Stribeck
    M3  |F| s                                  load-dependent
    M4  E s, |F| s, E |F| s                    Stribeck and load-dependent
    M5  E s, {|F| s, E |F| s} x {D, 1-D}       ... with other friction where the load drives
    M6  M5, E F^2 s x {D, 1-D}                 ... and with the square of the load
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np

from examples.benchmark.answer import Answer, Name, named
from examples.benchmark.base import STRONG, Base
from fmu_didim.data.signals import Array

STRIBECK_VELOCITIES = np.geomspace(0.02, 0.5, 9)
"""[rad/s] Tried for vs."""
EXPONENTS = (1.0, 2.0)
"""[1] Tried for a."""
MEANS = {
    "M2": ("stribeck",),
    "M3": ("load_dependent_friction",),
    "M4": ("load_dependent_friction", "stribeck"),
    "M5": ("directional_efficiency", "stribeck"),
    "M6": ("directional_efficiency", "stribeck"),
}
"""What a model says is there beside Coulomb and viscous friction."""


def answer(case: Path) -> Answer:
    """The model of least BIC on each joint; the joint that gains most comes first."""
    base = Base.of(case)
    names, tables, gains = list[Name](), list[Array](), list[float]()
    plain = base.bic(np.empty((len(base.target), 0)))
    for joint in range(base.motion.joint_count):
        tried = sorted(((base.bic(table), model, table) for model, table in models(base, joint)), key=lambda t: t[0])
        bic, model, table = tried[0]
        if plain - bic < STRONG:
            continue
        near = {effect for other, name, _ in tried if other < bic + STRONG for effect in MEANS[name]}
        first = MEANS[model][0] if len(MEANS[model]) == 1 else _first(base, joint, MEANS[model])
        for effect in sorted(MEANS[model], key=lambda e: e != first):
            names.append(Name(effect, joint + 1, tuple(sorted(near - {effect}))))
            gains.append(plain - bic)
        tables.append(table)
    order = sorted(range(len(names)), key=lambda i: -gains[i])
    columns = np.column_stack([np.empty((len(base.target), 0)), *tables])
    return named([names[i] for i in order], base.parameters(columns))


def models(base: Base, joint: int) -> Iterator[tuple[str, Array]]:
    """M2 to M6 of a joint, from 0, at all shapes: name and columns (N n, m)."""
    v, load = base.motion.dq[:, joint], base.motion.load[:, joint]
    s, size = np.sign(v), np.abs(load)
    driven = load * v < 0  # what the links ask for acts against the motion: the load drives
    yield "M3", base.on_joint(joint, (size * s)[:, None])
    for vs, power in product(STRIBECK_VELOCITIES, EXPONENTS):
        e = np.exp(-(np.abs(v / vs) ** power))
        split = [f * d for f in (size * s, e * size * s) for d in (driven, ~driven)]
        square = [e * size**2 * s * d for d in (driven, ~driven)]
        yield "M2", base.on_joint(joint, (e * s)[:, None])
        yield "M4", base.on_joint(joint, np.column_stack([e * s, size * s, e * size * s]))
        yield "M5", base.on_joint(joint, np.column_stack([e * s, *split]))
        yield "M6", base.on_joint(joint, np.column_stack([e * s, *split, *square]))


def _first(base: Base, joint: int, effects: tuple[str, ...]) -> str:
    """Which of the two of a model explains more alone: Stribeck, or what goes with the load."""
    alone = {"M2": np.inf, "M3": np.inf}
    for model, table in models(base, joint):
        if model in alone:
            alone[model] = min(alone[model], base.bic(table))
    return "stribeck" if alone["M2"] < alone["M3"] else effects[0]
