"""The identified parameters: base parameters of a robot, or named parameters of any plant.

DIDIM needs a regressor, which the robot's model gives; estimators that differentiate the closed loop
(``clie``) need nothing but names.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import BaseParameters
from fmu_didim.dynamics.physical_set import FRICTION, MOTOR_INERTIA
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.dynamics.robot.observed_states import NO_STARTS, observed_along

POSITIVE = 1e-9
"""[1] Smallest eigenvalue of the scaled inertia matrix that counts as positive: above rounding."""

SIGNIFICANCE = 4.0
"""A friction parameter this many standard deviations below zero is non-physical, not only uncertain."""


class Parameters(ABC):
    """The p identified parameters theta and how they enter the plant.

    Attributes:
        names, units: (p,) shown to the user; plant_names: (p,) names in the plant.
        torque_units: (n,) unit of the torque of each joint.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    plant_names: tuple[str, ...]
    torque_units: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of parameters p."""
        return len(self.names)

    @property
    def joint_count(self) -> int:
        """Number of joints n."""
        return len(self.torque_units)

    @abstractmethod
    def values(self, theta: Array) -> dict[str, float]:
        """Parameters of the plant, by name, for theta (p,)."""

    @abstractmethod
    def nominal(self) -> Array:
        """Values of the description of the plant, (p,)."""

    def relations(self) -> list[str]:
        """Lines of text, one for each parameter into which others are regrouped."""
        return []

    def checks(self) -> list[str]:
        """The physical checks of an answer, in words."""
        return []

    def shape_values(self) -> dict[str, float]:
        """Constants of the model that are not identified, by name."""
        return {}

    @property
    def has_regressor(self) -> bool:
        """Whether :meth:`regressor` can be called."""
        return False

    @property
    def is_probed(self) -> bool:
        """Whether the regressor is measured on the running plant (see :mod:`fmu_didim.model.numerical_regressor`)."""
        return False

    @property
    def observed(self) -> tuple[str, ...]:
        """Outputs of the plant, beyond the motion, that the regressor depends on: states of effects, time, loads."""
        return ()

    @property
    def observes_load(self) -> bool:
        """Whether they include transmitted torques, which follow from the parameters."""
        return False

    def observed_along(
        self, time: Array, q: Array, dq: Array, ddq: Array, theta: Array | None = None, *,
        starts: Mapping[str, float] = NO_STARTS,
    ) -> Array:  # fmt: skip
        """Values (N, no) of :attr:`observed` along a motion (N, n) that was not simulated.

        Args:
            theta: (p,) parameters from which loads follow; zero without them.
            starts: of measured states, by the names of the plant's parameters; see :meth:`Experiment.plant_start`.
        """
        return np.zeros((time.size, 0))

    def regressor(
        self, q: Array, dq: Array, ddq: Array, *, sharp: bool = False, observed: Array | None = None
    ) -> tuple[Array, Array]:
        """Regressor (N, n, p) and torque of all that is known (N, n) on a motion (N, n).

        Args:
            sharp: take sign(dq) for the smoothed step of Coulomb friction.
            observed: (N, no) values of :attr:`observed`.

        Raises:
            InputError: the plant has no inverse model.
        """
        raise InputError(
            "Only a robot description gives a regressor.",
            next_step="Use the estimator clie, which differentiates the closed loop, or give robot: in the case.",
        )

    def inertia_problem(self, q: Array, theta: Array) -> str:
        """Why the plant cannot be simulated with theta along positions (N, n), or an empty string."""
        return "" if np.isfinite(theta).all() else "a parameter is not a finite number"

    def physical_problem(self, theta: Array, deviation: Array) -> str:
        """Why theta ± deviation is physically impossible; an empty string if it is possible."""
        return ""

    def limits(self) -> tuple[Array, Array]:
        """Lowest and highest values of theta, (p,) each; infinite where there are none."""
        return np.full(self.count, -np.inf), np.full(self.count, np.inf)

    def substeps(self, theta: Array, starts: Mapping[str, float], step: float) -> int | None:
        """Integration substeps of the plant in a control period; None if unknown."""
        return None

    def described(self, theta: Array) -> RobotDescription | None:
        """The plant's description with the values theta (p,); None if it has none."""
        return None


@dataclass(frozen=True)
class RobotParameters(Parameters):
    """The base parameters of a robot.

    Attributes:
        model: its model; base: which parameters, and what regroups into them.
    """

    model: RobotModel
    base: BaseParameters

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        return self.base.names

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        return self.base.units

    @property
    def plant_names(self) -> tuple[str, ...]:  # type: ignore[override]
        return self.base.standard

    @property
    def torque_units(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple("N.m" if joint.type == "revolute" else "N" for joint in self.model.description.joints)

    def values(self, theta: Array) -> dict[str, float]:
        """All active standard parameters; those that are regrouped are zero."""
        chi, names = self.base.expand(theta).tolist(), self.base.standard_names
        return {names[i]: chi[i] for i in self.model.active}

    def nominal(self) -> Array:
        return self.base.reduce(self.model.parameter_values)

    def relations(self) -> list[str]:
        return self.base.relations()

    def checks(self) -> list[str]:
        return ["M(q) positive definite"]

    def shape_values(self) -> dict[str, float]:
        return {v.name: v.start for v in self.model.shapes}

    @property
    def has_regressor(self) -> bool:
        return True

    @property
    def observed(self) -> tuple[str, ...]:
        return tuple(v.name for v in self.model.observed)

    @property
    def observes_load(self) -> bool:
        return len(self.model.observed) > len(self.model.extra)

    def observed_along(
        self, time: Array, q: Array, dq: Array, ddq: Array, theta: Array | None = None, *,
        starts: Mapping[str, float] = NO_STARTS,
    ) -> Array:  # fmt: skip
        chi = None if theta is None else self.base.expand(theta)
        return observed_along(self.model, time, q, dq, ddq, chi, starts=starts)

    def regressor(
        self, q: Array, dq: Array, ddq: Array, *, sharp: bool = False, observed: Array | None = None
    ) -> tuple[Array, Array]:
        shapes = self.model.shape_values
        if sharp:
            shapes = shapes * np.where([v.name.startswith("v0_") for v in self.model.shapes], 1e-9, 1.0)
        (given,), count = np.nonzero(self.base.known), len(self.names)
        columns, known = np.empty((*q.shape, count)), np.empty(q.shape)
        asked = [*self.base.index.tolist(), *given.tolist()]
        for part, block in self.model.regressor_blocks(q, dq, ddq, asked, shapes, observed):
            columns[part] = block[:count].transpose(2, 1, 0)
            known[part] = np.tensordot(self.base.known[given], block[count:], 1).T
        return columns, known

    def inertia_problem(self, q: Array, theta: Array) -> str:
        reason = super().inertia_problem(q, theta)
        if reason:
            return reason
        chi = self.base.expand(theta)
        if self.model.inertia_is_positive(q, chi, POSITIVE):
            return ""
        along = self.model.inertia_along(q, chi)
        worst = int(np.argmin(along))
        if along[worst] > POSITIVE:
            return ""
        joint, name, _ = self.weakest(q[worst], theta)
        value, unit = theta[self.names.index(name)], self.units[self.names.index(name)]
        return (
            f"the inertia matrix is not positive definite (smallest scaled eigenvalue {along[worst]:.3g}, "
            f"joint {joint}, most of it by {name} = {value:.3g} {unit})"
        )

    def weakest(self, position: Array, theta: Array) -> tuple[int, str, Array]:
        """Cause of the smallest eigenvalue of the inertia matrix at a position (n,): the joint, from 1, that moves most
        in its direction, the parameter that lowers it most, and its slopes (p,)."""
        columns = self.model.inertia_columns(position[None])[0]
        mass = columns @ self.base.expand(theta)
        diagonal = np.diag(mass)
        scale = np.sqrt(np.maximum(np.abs(diagonal), np.finfo(float).tiny))
        if (diagonal <= 0).any():
            joint = int(np.argmin(diagonal))
            weight = np.eye(diagonal.size)[joint]
        else:
            vector = np.linalg.eigh(mass / np.outer(scale, scale))[1][:, 0]
            joint, weight = int(np.argmax(np.abs(vector))), vector / scale
        slopes = np.einsum("i,ijk,j->k", weight, columns, weight)[self.base.index]
        return joint + 1, self.names[int(np.argmin(slopes * theta))], slopes

    def physical_problem(self, theta: Array, deviation: Array) -> str:
        found = []
        for i, standard in enumerate(self.base.standard):
            if standard.rstrip("0123456789") in FRICTION and theta[i] < -SIGNIFICANCE * deviation[i] - 1e-12:
                found.append(f"{self.names[i]} = {theta[i]:.4g} ± {deviation[i]:.2g}")
        return f"friction is negative: {', '.join(found)}" if found else ""

    def described(self, theta: Array) -> RobotDescription:
        chi = self.base.expand(theta)
        # Regrouped parameters and those that are left out become zero, all else keeps its value.
        touched = [*self.base.index, *self.base.dependent, *self.base.left_out]
        robot = self.model.description.with_values({self.base.standard_names[i]: float(chi[i]) for i in touched})
        if not self.base.left_out.size:
            return robot
        return robot.model_copy(update={"identified": dict(zip(self.base.names, self.base.standard, strict=True))})

    def is_rotor(self, place: int) -> bool:
        """Whether the inertia of a rotor carries the parameter of this place: every motor has some."""
        return self.base.standard[place].rstrip("0123456789") == MOTOR_INERTIA

    def without(self, names: Collection[str]) -> RobotParameters:
        """The parameters of a reduced model, in which the base parameters of these names are zero."""
        return replace(self, base=self.base.without(names))

    def substeps(self, theta: Array, starts: Mapping[str, float], step: float) -> int:
        block = self.model.block(self.values(theta))
        offered = {v.name for v in block.parameters}
        block = block.with_parameters({name: value for name, value in starts.items() if name in offered})
        return block.automatic_substeps(step)


@dataclass(frozen=True)
class NamedParameters(Parameters):
    """Parameters of a plant, by name, that enter it in any way.

    Attributes:
        names, units, plant_names: (p,); torque_units: (n,).
        start: (p,) values of the plant's description.
        lowest, highest: (p,) limits; minus and plus infinity where there are none.
        probed: whether a regressor is measured on the running plant, for parameters linear in its torque.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    plant_names: tuple[str, ...]
    torque_units: tuple[str, ...]
    start: tuple[float, ...]
    lowest: tuple[float, ...]
    highest: tuple[float, ...]
    probed: bool = False

    @property
    def is_probed(self) -> bool:
        return self.probed

    def values(self, theta: Array) -> dict[str, float]:
        return {name: float(value) for name, value in zip(self.plant_names, theta, strict=True)}

    def nominal(self) -> Array:
        return np.array(self.start)

    def limits(self) -> tuple[Array, Array]:
        return np.array(self.lowest), np.array(self.highest)
