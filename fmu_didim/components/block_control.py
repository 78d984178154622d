"""Blocks as python-control systems."""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import Any

import casadi as ca
import numpy as np

from fmu_didim.base.symbolic import jacobian
from fmu_didim.components.evaluator import Evaluator
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.block import Block


def to_control(block: Block) -> Any:
    """A block as a python-control system: ``StateSpace`` if its equations are linear, else ``NonlinearIOSystem``.

    The parameters of a nonlinear system are its ``params``; those of a linear one are fixed at their
    present values.
    """
    names: dict[str, Any] = {
        "inputs": [v.name for v in block.inputs],
        "outputs": [v.name for v in block.outputs],
        "states": [v.name for v in block.states],
        "name": block.name,
        "dt": block.sample_time if block.sample_time is not None else 0,
    }
    matrices = _linear_matrices(block)
    if matrices is not None:
        return state_space(*matrices, **names)
    import control

    update, output = (_NumpyFunction(f, block) for f in (block.update, block.output))
    parameters = {v.name: v.start for v in block.parameters}
    return control.nlsys(update, output, params=parameters, **names)


def state_space(a: Array, b: Array, c: Array, d: Array, **names: Any) -> Any:
    """A ``StateSpace`` of these matrices; ``names``: its signals, its name and ``dt``.

    python-control (0.10.2) makes one without states by setting the shape of arrays, which numpy 2.5 deprecates and will
    remove; so such a system is made with a state that does nothing, which python-control then takes away.
    """
    import control

    if a.size:
        return control.StateSpace(a, b, c, d, **names)
    none = np.zeros((1, 1)), np.zeros((1, d.shape[1])), np.zeros((d.shape[0], 1))
    return control.StateSpace(*none, d, **{**names, "states": 1}, remove_useless_states=True)


class _NumpyFunction:
    """A CasADi function (x, u, p) with the signature (t, x, u, params) of python-control."""

    def __init__(self, function: ca.Function, block: Block) -> None:
        self._function = function
        self._names = [v.name for v in block.parameters]
        self._prepare()

    def _prepare(self) -> None:
        function = self._function
        self._x, self._u, self._p = (np.zeros(function.numel_in(i)) for i in range(3))
        self._result = np.zeros(function.numel_out(0))
        self._run = Evaluator(function, [self._x, self._u, self._p], self._result)
        self._values = itemgetter(*self._names) if len(self._names) > 1 else None

    def __call__(self, t: float, x: Array, u: Array, params: Mapping[str, float]) -> Array:
        self._x[:] = x
        self._u[:] = u
        if self._values is not None:
            self._p[:] = self._values(params)
        elif self._names:
            self._p[0] = params[self._names[0]]
        self._run()
        return self._result.copy()

    def __getstate__(self) -> dict[str, Any]:
        return {"_function": self._function, "_names": self._names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._prepare()


def _linear_matrices(block: Block) -> tuple[Array, Array, Array, Array] | None:
    """A, B, C, D at the present parameters if update and output are linear in (x, u), else None."""
    nx, nu = len(block.states), len(block.inputs)
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u", nu)
    z = ca.vertcat(x, u)
    result = []
    for function in (block.update, block.output):
        value = function(x, u, ca.DM(block.parameter_values))
        slope = jacobian(value, z)
        offset = ca.substitute(value, z, ca.SX.zeros(nx + nu))
        if ca.depends_on(slope, z) or not bool(ca.simplify(offset).is_zero()):
            return None
        result.append(ca.evalf(slope).full())
    (ab, cd) = result
    return ab[:, :nx], ab[:, nx:], cd[:, :nx], cd[:, nx:]
