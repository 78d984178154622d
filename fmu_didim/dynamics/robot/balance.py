"""The balance of torques that gives the accelerations of a robot with rigid joints."""

from __future__ import annotations

import casadi as ca

from fmu_didim.dynamics.block import Balance
from fmu_didim.dynamics.robot.equations import EquationsOfMotion


def plant_balance(equations: EquationsOfMotion, x: ca.SX, p: ca.SX, chi: ca.SX, shapes: ca.SX) -> Balance:
    """inverse(q, dq, a, chi, s) - tau = 0, with a = ddq.

    Args:
        equations: of the robot.
        x, p: symbols of the states (q, dq, e) and of the parameters of its plant.
        chi, shapes: standard and shape parameters as expressions of p.
    """
    a, count = equations.ddq, equations.ddq.numel()
    clock = [ca.SX(1)] if equations.uses_clock else []
    load = [equations.transmitted(a)[j] for j in equations.loaded]
    extra = x[2 * count :]
    residual, update, output, solution = ca.substitute(
        [
            equations.inverse - equations.tau,
            ca.vertcat(equations.dq, a, equations.rates, *clock),
            ca.vertcat(x[: 2 * count], a, extra, *load),
            equations.acceleration,
        ],
        [equations.chi, equations.s],
        [chi, shapes],
    )
    arguments = [x, a, equations.tau, p]
    return Balance(
        residual=ca.Function("residual", arguments, [ca.densify(residual)]),
        update=ca.Function("update", arguments, [ca.densify(update)]),
        output=ca.Function("output", arguments, [ca.densify(output)]),
        solution=ca.Function("solution", [x, equations.tau, p], [ca.densify(solution)]),
        symmetric=not equations.loaded,
    )
