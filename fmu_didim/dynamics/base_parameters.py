"""Base parameters: the parameters that data determine, and how the others regroup into them.

Source: Gautier, "Numerical calculation of the base inertial parameters of robots", 1991. With W the
regressor on random motions, columns that depend on earlier ones, W_d = W_b K, add to their parameters:
chi_b := chi_b + K chi_d.

Of axes that a calibration found a little off a right angle, or a base that hardly leans, the grouping is that of the
machine as it was meant: what acts in its own way by a thousandth of its size no data tell apart, and what a parameter
that is held at zero leaves of the torque is as small.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.effects import DEFAULT_EFFECTS
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.dynamics.robot.body import nearest_right_angle

RANK_TOLERANCE = 1e-9
SEED = 20240229
AS_MEANT = 0.01
"""[rad] Of a right angle, or of the vertical, within which axes and bases are meant to be there: calibrations find some
1e-3, and no machine is made half a degree off."""


@dataclass(frozen=True)
class BaseParameters:
    """The identified parameters and their place in the standard parameters chi (ns,).

    Attributes:
        names: (b,) names shown to the user.
        standard: (b,) name of the standard parameter that carries each.
        units: (b,) FMI unit strings.
        index: (b,) positions in chi.
        dependent: (d,) positions of the parameters that are regrouped and so held at zero.
        regrouping: (b, d) matrix K.
        known: (ns,) values of all other parameters; zero at ``index`` and ``dependent``.
        standard_names: (ns,) names of chi.
        held: names of those that act on the torque, are not identified, and are not stated as known either.
        left_out: (l,) positions of base parameters that a reduced model does without: they are zero.
    """

    names: tuple[str, ...]
    standard: tuple[str, ...]
    units: tuple[str, ...]
    index: NDArray[np.int64]
    dependent: NDArray[np.int64]
    regrouping: Array
    known: Array
    standard_names: tuple[str, ...]
    held: tuple[str, ...] = ()
    left_out: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def count(self) -> int:
        """Number of base parameters b."""
        return len(self.names)

    def without(self, names: Collection[str]) -> BaseParameters:
        """The base parameters of a reduced model: those of these names are zero."""
        kept = np.array([name not in names for name in self.names], dtype=bool)

        def of_kept(all_of_them: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(one for one, is_kept in zip(all_of_them, kept, strict=True) if is_kept)

        return replace(
            self, names=of_kept(self.names), standard=of_kept(self.standard), units=of_kept(self.units),
            index=self.index[kept], regrouping=self.regrouping[kept],
            left_out=np.concatenate([self.left_out, self.index[~kept]]),
        )  # fmt: skip

    def expand(self, base: Array) -> Array:
        """Standard parameters (ns,) with the base parameters in their places: the plant to simulate."""
        chi = self.known.copy()
        chi[self.index] = base
        return chi

    def reduce(self, chi: Array) -> Array:
        """Base parameters (b,) of standard values chi (ns,): chi_b + K chi_d."""
        return np.asarray(chi[self.index] + self.regrouping @ chi[self.dependent])

    def relations(self) -> list[str]:
        """One line a regrouped parameter, such as ``ZZ1R = ZZ1 + Ia1 + 0.25 M2``."""
        lines = []
        for i, name in enumerate(self.names):
            terms = [self.standard_names[self.index[i]]]
            for k, value in zip(self.dependent, self.regrouping[i], strict=True):
                if value:
                    factor = "" if abs(abs(value) - 1) < 1e-12 else f"{abs(value):.6g} "
                    terms.append(f"{'-' if value < 0 else '+'} {factor}{self.standard_names[k]}")
            if len(terms) > 1:
                lines.append(f"{name} = {' '.join(terms)}")
        return lines


def base_parameters(model: RobotModel) -> BaseParameters:
    """The base parameters that the robot description asks for.

    Raises:
        InputError: parameters named as identified depend on each other, or nothing is left to identify.
    """
    description = model.description
    names = [v.name for v in model.parameters]
    rows = _random_rows(as_meant(model) if description.identified == "computed" else model)
    active = [i for i in model.active if np.abs(rows[:, i]).max() > RANK_TOLERANCE * np.abs(rows).max()]
    known = {model.parameter_index(name) for name in description.known}
    shown: Mapping[str, str] | None = None
    if isinstance(description.identified, str):
        candidates = [i for i in active if i not in known]
        kept, dependent = _independent(rows, candidates) if candidates else ([], [])
    else:
        shown = description.identified
        kept = [model.parameter_index(standard) for standard in shown.values()]
        _check_independent(rows, kept, list(shown))
        dependent = [i for i in active if i not in kept and i not in known and _depends(rows, kept, i)]
    if not kept:
        raise InputError(
            "No parameter is left to identify.", where=f"robot '{description.name}'",
            next_step="Take a parameter out of known:, or name one in identify:.",
        )  # fmt: skip
    regrouping = _solve(rows, kept, dependent)
    values = model.parameter_values
    fixed = values.copy()
    fixed[[*kept, *dependent]] = 0.0
    stated = {*kept, *dependent, *known}
    regrouped = [bool(row.any()) for row in regrouping]
    labels = list(shown) if shown is not None else [names[i] + "R" * r for i, r in zip(kept, regrouped, strict=True)]
    return BaseParameters(
        names=tuple(labels),
        standard=tuple(names[i] for i in kept),
        units=tuple(model.parameters[i].unit for i in kept),
        index=np.array(kept, dtype=np.int64),
        dependent=np.array(dependent, dtype=np.int64),
        regrouping=regrouping,
        known=fixed,
        standard_names=tuple(names),
        held=tuple(names[i] for i in active if i not in stated),
    )


def as_meant(model: RobotModel) -> RobotModel:
    """The model with axes at right angles, parallel, and upright where they nearly are; itself where nothing is off."""
    robot = model.description
    joints = tuple(
        joint.model_copy(update={
            "alpha": _meant(joint.alpha, nearest_right_angle(joint.alpha)), "beta": _meant(joint.beta, 0.0),
        })
        for joint in robot.joints
    )  # fmt: skip
    size = float(np.linalg.norm(robot.gravity))
    gravity = tuple(0.0 if abs(g) < AS_MEANT * size else g for g in robot.gravity)
    if joints == robot.joints and gravity == robot.gravity:
        return model
    return RobotModel(robot.model_copy(update={"joints": joints, "gravity": gravity}))


def _meant(angle: float, exact: float) -> float:
    """The exact angle that one in rad is meant to be, or the angle."""
    return exact if abs(angle - exact) < AS_MEANT else angle


def all_parameters(model: RobotModel) -> BaseParameters:
    """Each parameter that acts and is not known, by itself: what they explain together is what the base parameters do,
    which need not be found for that. Their columns depend on each other."""
    known = {model.parameter_index(name) for name in model.description.known}
    index = [i for i in model.active if i not in known]
    names = tuple(v.name for v in model.parameters)
    own = tuple(names[i] for i in index)
    return BaseParameters(
        names=own, standard=own, units=tuple(model.parameters[i].unit for i in index),
        index=np.array(index, dtype=np.int64), dependent=np.zeros(0, dtype=np.int64),
        regrouping=np.zeros((len(index), 0)), known=np.zeros(len(names)), standard_names=names, held=(),
    )  # fmt: skip


def _random_rows(model: RobotModel) -> Array:
    """Regressor on random motions with columns of comparable size, ((N n), ns)."""
    count = 40 + 4 * len(model.parameters)
    rng = np.random.default_rng(SEED)
    q, dq, ddq = rng.uniform(-np.pi, np.pi, size=(3, count, model.joint_count))
    rows = model.regressor_rows(q, dq, ddq, observed=_random_observed(model, rng, count))
    effects = {name for joint in model.description.joints for name in joint.effects}
    if not effects <= set(DEFAULT_EFFECTS):
        # Some effects show at small speeds only, where a smoothed step is not yet a sign.
        slow = dq * 10.0 ** rng.uniform(-4, 0, size=dq.shape)
        more = model.regressor_rows(q, slow, ddq, observed=_random_observed(model, rng, count))
        rows = np.concatenate([rows, more])
    return rows.reshape(-1, rows.shape[2])


def _random_observed(model: RobotModel, rng: np.random.Generator, count: int) -> Array | None:
    """Random states, loads and times, (N, no); loads and times lie where something happens by the shapes in N.m, N and
    s."""
    if not model.observed:
        return None
    values = rng.uniform(-1, 1, size=(count, len(model.observed)))
    names = [v.name for v in model.observed]
    if "clock" in names:
        scales = [v.start for v in model.shapes if v.unit == "s" and v.start > 0] or [1.0]
        values[:, names.index("clock")] = rng.choice(scales, count) * rng.uniform(0, 3, count)
    if sizes := [abs(v.start) for v in model.shapes if v.unit in ("N.m", "N")]:
        values[:, [name.startswith("load") for name in names]] *= max(sizes)
    return np.asarray(values)


def _scaled(rows: Array, index: list[int]) -> Array:
    columns = rows[:, index]
    return np.asarray(columns / np.linalg.norm(columns, axis=0))


def _independent(rows: Array, candidates: list[int]) -> tuple[list[int], list[int]]:
    """Split the candidates into independent ones, kept in their order, and those that depend on them.

    The number of independent ones is the rank by pivoted QR; QR in the natural order finds which.
    """
    scaled = _scaled(rows, candidates)
    diagonal = np.abs(np.diag(qr(scaled, mode="r", pivoting=True)[0]))
    rank = int((diagonal > RANK_TOLERANCE * diagonal[0]).sum())
    kept: list[int] = []
    basis = np.zeros((scaled.shape[0], 0))
    for k in range(scaled.shape[1]):
        rest = scaled[:, k] - basis @ (basis.T @ scaled[:, k])
        rest -= basis @ (basis.T @ rest)
        size = np.linalg.norm(rest)
        if size > 1e-7:
            basis = np.column_stack([basis, rest / size])
            kept.append(candidates[k])
    if len(kept) != rank:
        raise InputError(
            "The number of base parameters is ambiguous.",
            got=f"rank {rank} by pivoted QR, {len(kept)} in the natural order",
            next_step="Name the base parameters in the robot description (identified: {...}).",
        )
    return kept, [i for i in candidates if i not in kept]


def _depends(rows: Array, kept: list[int], i: int) -> bool:
    basis, column = _scaled(rows, kept), rows[:, i] / np.linalg.norm(rows[:, i])
    return bool(np.linalg.norm(column - basis @ np.linalg.lstsq(basis, column, rcond=None)[0]) < 1e-7)


def _check_independent(rows: Array, kept: list[int], shown: list[str]) -> None:
    norms = np.linalg.norm(rows[:, kept], axis=0)
    for i, norm in enumerate(norms):
        if norm <= RANK_TOLERANCE * np.linalg.norm(rows, axis=0).max():
            raise InputError(
                f"The parameter '{shown[i]}' has no effect on any torque.", where="robot description, identified",
                next_step="Remove it from the list.",
            )  # fmt: skip
    for i in range(1, len(kept)):
        if _depends(rows, kept[:i], kept[i]):
            scaled = _scaled(rows, kept[:i])
            weights = np.linalg.lstsq(scaled, rows[:, kept[i]] / norms[i], rcond=None)[0]
            partners = [shown[k] for k in np.flatnonzero(np.abs(weights) > 1e-6)]
            raise InputError(
                f"The parameter '{shown[i]}' cannot be told apart from {', '.join(partners)}.",
                where="robot description, identified",
                next_step="Keep one of them (it stands for the group), or use identified: computed.",
            )


def _solve(rows: Array, kept: list[int], dependent: list[int]) -> Array:
    if not dependent:
        return np.zeros((len(kept), 0))
    matrix = np.linalg.lstsq(rows[:, kept], rows[:, dependent], rcond=None)[0]
    matrix[np.abs(matrix) < 1e-9 * np.abs(matrix).max()] = 0.0
    # Sums of exact geometry come out within rounding of short decimals.
    short = np.round(matrix, 9)
    return np.where(np.abs(matrix - short) < 1e-11 * np.maximum(1.0, np.abs(matrix)), short, matrix)
