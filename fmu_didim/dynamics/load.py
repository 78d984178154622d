"""A load on the last link: which of its parameters the base parameters show.

A body that is fixed to the last link adds its ten inertial parameters chi_L, in the frame of that link, to those of the
link, so that the base parameters of the loaded robot are

    b_L = b + D chi_L,    D (b, 10) = columns of [1 K] at the last link

Columns of D that depend on earlier ones regroup as those of a regressor do: D chi_L = D_k (chi_k + K_L chi_d). The body
exists if and only if its pseudo-inertia is positive semidefinite (:mod:`fmu_didim.dynamics.physical_set`). With the
inertia I about the frame and the first moments h = M c, that about its centre is

    I_c = I - M (c'c 1 - c c')

Source: Khalil, Gautier, Lemoine, "Identification of the payload inertial parameters of industrial manipulators", ICRA
2007.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import BaseParameters
from fmu_didim.dynamics.physical_set import ENTRIES, TRIANGLE, PhysicalSet
from fmu_didim.dynamics.robot.model import RobotModel

STEMS = ("M", "MX", "MY", "MZ", "XX", "YY", "ZZ", "XY", "XZ", "YZ")
"""Parameters of a load, in the order in which the earlier ones are kept: those that a scale tells first."""
SAME = 1e-8
"""[1] Of the length of a column, what others leave of it where it depends on them."""
PREFIX = "load_"
"""Before the names of the parameters of a load."""


def unit_of(stem: str) -> str:
    """FMI unit string of an inertial parameter."""
    return {"M": "kg", "MX": "kg.m", "MY": "kg.m", "MZ": "kg.m"}.get(stem, "kg.m2")


@dataclass(frozen=True)
class Load:
    """The parameters of a load that the base parameters of a robot show.

    Attributes:
        stems: (r,) those that are kept; regrouping: (r, 10) table that takes all ten, in the order of ``STEMS``, to
            those that are kept; zero for those that are known.
        directions: (b, r) by how much each moves each base parameter.
        known: value of those that are known; shift: (b,) by which these move the base parameters.
        scale: (10,) size of each for a load of 1 kg.
    """

    stems: tuple[str, ...]
    regrouping: Array
    directions: Array
    known: Mapping[str, float]
    shift: Array
    scale: Array

    @property
    def names(self) -> tuple[str, ...]:
        """(r,) names, with an R where others regroup into one."""
        return tuple(
            f"{PREFIX}{stem}{'R' if np.count_nonzero(row) > 1 else ''}"
            for stem, row in zip(self.stems, self.regrouping, strict=True)
        )

    def moves(self, place: int) -> bool:
        """Whether a load of this kind moves the base parameter of this place."""
        return bool(self.directions[place].any() or self.shift[place])

    def on(self, places: Sequence[int]) -> Load:
        """The load of a robot that has the base parameters of these places alone."""
        chosen = list(places)
        return replace(self, directions=self.directions[chosen], shift=self.shift[chosen])

    @property
    def alone(self) -> tuple[str, ...]:
        """Those that are seen by themselves, with nothing regrouped into them."""
        return tuple(stem for stem, row in zip(self.stems, self.regrouping, strict=True) if np.count_nonzero(row) == 1)

    @property
    def unseen(self) -> tuple[str, ...]:
        """Those that move no torque whatever the motion is."""
        shown = (self.regrouping != 0).sum(axis=0)
        return tuple(stem for k, stem in enumerate(STEMS) if not shown[k] and stem not in self.known)

    @property
    def physical(self) -> PhysicalSet:
        """The values (r,) that a body of positive mass can have."""
        kept, free = ([STEMS.index(stem) for stem in some] for some in (self.stems, self._free))
        table = np.zeros((len(TRIANGLE), len(STEMS)))
        for k, stem in enumerate(STEMS):
            for entry, factor in ENTRIES[stem].items():
                root = 1.0 if entry[0] == entry[1] else np.sqrt(2.0)
                table[TRIANGLE.index(entry), k] = factor * root
        fixed = np.array([self.known.get(stem, 0.0) for stem in STEMS]) / self.scale
        return PhysicalSet(
            rows=np.arange(len(kept)), row_scale=self.scale[kept], map=(self.regrouping * self.scale)[:, free],
            carriers=np.array([free.index(k) for k in kept], dtype=np.int64), table=table[:, free], fixed=table @ fixed,
            motors=(), friction=(), places=np.array(free), sizes=self.scale[free],
        )  # fmt: skip

    @property
    def _free(self) -> list[str]:
        """Parameters that are not known, seen or not."""
        return [stem for stem in STEMS if stem not in self.known]


def load_of(model: RobotModel, base: BaseParameters, known: Mapping[str, float] | None = None) -> Load:
    """The parameters of a load on the last link of a robot that its base parameters show.

    Args:
        known: those of its inertial parameters (``M``, ``MX``, ...) that are known, in the frame of the last link.

    Raises:
        InputError: no base parameter moves with a load.
    """
    joint = len(model.description.joints)
    table = np.zeros((base.count, len(STEMS)))
    for k, stem in enumerate(STEMS):
        if (name := f"{stem}{joint}") in base.standard_names:
            chi = np.zeros(len(base.standard_names))
            chi[base.standard_names.index(name)] = 1.0
            table[:, k] = base.reduce(chi)
    if not table.any():
        raise InputError(
            "No base parameter of this robot moves with a load on its last link.", where="load",
            next_step="Take parameters of the last links out of known:, or the load out of the case.",
        )  # fmt: skip
    known = known or {}
    is_known = np.array([stem in known for stem in STEMS])
    shift, table = table @ np.array([known.get(stem, 0.0) for stem in STEMS]), np.where(is_known, 0.0, table)
    size, kept = np.linalg.norm(table, axis=0), list[int]()
    for k in map(int, np.flatnonzero(size)):
        others = table[:, kept] / size[kept]
        column = table[:, k] / size[k]
        left = column - others @ np.linalg.lstsq(others, column, rcond=None)[0] if kept else column
        if np.linalg.norm(left) > SAME:
            kept.append(k)
    regrouping = np.zeros((len(kept), len(STEMS)))
    if kept:
        regrouping[:] = np.linalg.lstsq(table[:, kept], table, rcond=None)[0]
    regrouping[np.abs(regrouping) < SAME] = 0.0
    lengths = [abs(length) for one in model.description.joints for length in (one.a, one.d) if length]
    length = float(np.median(lengths)) if lengths else 1.0
    power = [0 if stem == "M" else 1 if stem[0] == "M" else 2 for stem in STEMS]
    scale = length ** np.array(power, dtype=float)
    return Load(tuple(STEMS[k] for k in kept), regrouping, table[:, kept], dict(known), shift, scale)


def unit_of_body(name: str) -> str:
    """FMI unit string of a quantity of :func:`body_of`."""
    return {"m": "kg", "c": "m", "I": "kg.m2"}[name[0]]


def body_of(load: Load, values: Array, covariance: Array) -> dict[str, tuple[float, float]]:
    """``mass``, centre ``cx``, ..., and inertia ``Ixx``, ... about it from values (r,) with covariance (r, r): value
    and standard deviation of each, to first order; kg, m, kg.m2.

    A quantity is given where all that it is made of is known or seen by itself.
    """
    seen = {stem: i for i, stem in enumerate(load.stems) if stem in load.alone}
    value_of = dict(load.known) | {stem: float(values[i]) for stem, i in seen.items()}
    found: dict[str, tuple[float, float]] = {}

    def told(name: str, value: float, slopes: Mapping[str, float]) -> None:
        row = np.zeros(values.size)
        for stem, slope in slopes.items():
            if stem in seen:
                row[seen[stem]] += slope
        found[name] = (value, float(np.sqrt(max(float(row @ covariance @ row), 0.0))))

    if "M" not in value_of:
        return found
    mass = value_of["M"]
    told("mass", mass, {"M": 1.0})
    if mass <= 0:
        return found
    first = {axis: value_of[f"M{axis}"] for axis in "XYZ" if f"M{axis}" in value_of}
    for axis, h in first.items():
        told(f"c{axis.lower()}", h / mass, {f"M{axis}": 1 / mass, "M": -h / mass**2})
    for one, two in ("XX", "YY", "ZZ", "XY", "XZ", "YZ"):
        stem = one + two
        needed = [axis for axis in "XYZ" if (axis != one if one == two else axis in stem)]
        if stem not in value_of or not set(needed) <= set(first):
            continue
        (a, b) = needed
        h, k = first[a], first[b]
        if one == two:  # I_c = I - (h_a^2 + h_b^2) / M
            value = value_of[stem] - (h * h + k * k) / mass
            slopes = {stem: 1.0, f"M{a}": -2 * h / mass, f"M{b}": -2 * k / mass, "M": (h * h + k * k) / mass**2}
        else:  # I_c = I + h_a h_b / M
            value = value_of[stem] + h * k / mass
            slopes = {stem: 1.0, f"M{a}": k / mass, f"M{b}": h / mass, "M": -h * k / mass**2}
        told(f"I{stem.lower()}", value, slopes)
    return found
