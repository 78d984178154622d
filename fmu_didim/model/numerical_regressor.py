"""The regressor of a plant without inverse model, measured on the running plant.

With ddq = M(q)^-1 (tau - N(q, dq)) and a torque that is linear in the parameters p at a given motion,

    d ddq / d tau = M^-1,    d ddq / d p_i = -M^-1 (d M / d p_i ddq + d N / d p_i) = -M^-1 W_i,

so that W = -(d ddq / d tau)^-1 (d ddq / d p). Both derivatives are taken at each recorded tick from the plant
itself: directional derivatives where an FMU has them, else central differences.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmu_didim.base.errors import InputError, SimulationError
from fmu_didim.components import Instance
from fmu_didim.data.signals import Array
from fmu_didim.model.parameters import Parameters

LINEARITY_TOLERANCE = 1e-3
CHECKED_ROWS = 5
"""Ticks at which linearity is checked; one is enough for most plants, but the motion may be zero there."""
CHANGE = 0.2
"""Relative change of the parameters for that check."""


class RegressorProbe:
    """Observer of a simulation that fills ``columns`` (K, n, p); it can travel to another process.

    Args:
        plant: its name in the system.
        parameters: what is identified; theta: (p,) values that run; count: rows K that will be recorded.
    """

    def __init__(self, plant: str, parameters: Parameters, theta: Array, count: int) -> None:
        self._plant, self._theta = plant, theta
        self._names, self._own_names, self._joints = parameters.names, parameters.plant_names, parameters.joint_count
        self.columns = np.full((count, parameters.joint_count, parameters.count), np.nan)
        self.nonlinear: dict[str, float] = {}
        self._left = 0

    def check_linearity(self) -> RegressorProbe:
        """Also compare, at the first ticks, with the regressor for other parameters at the same motion."""
        self._left = CHECKED_ROWS
        return self

    def __call__(self, row: int, instances: Mapping[str, Instance]) -> None:
        instance = instances[self._plant]
        here = self._regressor(instance, self._theta)
        self.columns[row] = here
        if self._left > 0 and row > 0:
            self._left -= 1
            self._compare(instance, here)

    def _regressor(self, instance: Instance, theta: Array) -> Array:
        accelerations, torques = self._places(instance)
        by_torque, by_parameter = instance.derivatives(accelerations, torques, self._named(theta))
        try:
            return np.asarray(-np.linalg.solve(by_torque, by_parameter))
        except np.linalg.LinAlgError as error:
            raise SimulationError(
                "The plant's acceleration does not follow its torque at once.", where=self._plant,
                next_step="Use the estimator clie, or a plant whose accelerations are outputs with feed-through.",
            ) from error  # fmt: skip

    def _named(self, theta: Array) -> dict[str, float]:
        return dict(zip(self._own_names, map(float, theta), strict=True))

    def _places(self, instance: Instance) -> tuple[list[int], list[int]]:
        joints = range(1, self._joints + 1)
        outputs, inputs = instance.output_names, instance.input_names
        return [outputs.index(f"ddq{j}") for j in joints], [inputs.index(f"tau{j}") for j in joints]

    def _compare(self, instance: Instance, here: Array) -> None:
        """The regressor for theta changed by CHANGE, the torque adjusted so that the acceleration stays."""
        accelerations, torques = self._places(instance)
        before, wanted = instance.inputs.copy(), instance.outputs[accelerations].copy()
        other = self._theta * (1 + CHANGE)
        instance.set_parameters(self._named(other))
        instance.get()
        by_torque, _ = instance.derivatives(accelerations, torques, self._named(other))
        instance.inputs[torques] = before[torques] + np.linalg.solve(
            by_torque, wanted - instance.outputs[accelerations]
        )
        instance.set()
        instance.get()
        there = self._regressor(instance, other)
        instance.set_parameters(self._named(self._theta))
        instance.inputs[:] = before
        instance.set()
        instance.get()
        size = np.abs(here).max(axis=0)
        for i, name in enumerate(self._names):
            if size[i] > 0:
                change = float(np.abs(there[:, i] - here[:, i]).max() / size[i])
                self.nonlinear[name] = max(self.nonlinear.get(name, 0.0), change)

    def raise_if_nonlinear(self) -> None:
        """Raise InputError for parameters whose column changes with the parameters."""
        found = [f"{name} ({100 * v:.2g} %)" for name, v in self.nonlinear.items() if v > LINEARITY_TOLERANCE]
        if found:
            raise InputError(
                "Some parameters do not enter the torque linearly, as didim needs.", where="identify",
                got=f"{', '.join(found)}: change of the regressor when all parameters grow by {100 * CHANGE:.0f} %",
                next_step="Use the estimator clie for them.",
            )  # fmt: skip
