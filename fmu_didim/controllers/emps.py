"""The control law of the EMPS benchmark."""

from __future__ import annotations

from pathlib import Path

import casadi as ca

from fmu_didim.controllers.base import ControlEquations, ControlLaw
from fmu_didim.dynamics.effects import UNITS


class Emps(ControlLaw):
    """command = sat( kv (kp (q_ref - q) - dq_f) ), a cascade P-P with filtered velocity:

        qf[k] = (q[k] + q[k-1]) / 2,   dq_f[k] = (qf[k] - qf[k-1]) / T

    The joint is at rest before the start: q[-1] = q[-2] = q[0]. Source: Janot, Gautier, Brunot,
    Data set and reference models of EMPS, 2019.

    Attributes:
        kp: gain of the position loop, 1/s.
        kv: gain of the velocity loop, V/(m/s).
    """

    kp: tuple[float, ...]
    kv: tuple[float, ...]

    def commands(self, equations: ControlEquations, *, folder: Path) -> list[ca.SX]:
        result = []
        for j in range(1, len(self.joints) + 1):
            unit = UNITS[self.joints[j - 1]].position
            q_ref, q = equations.input(f"q_ref{j}", unit), equations.input(f"q{j}", unit)
            last, before = ca.SX.sym(f"q_previous{j}"), ca.SX.sym(f"q_before{j}")
            equations.state(f"q_previous{j}", unit, last, q, q)
            equations.state(f"q_before{j}", unit, before, last, q)
            kp = equations.parameter(f"kp{j}", self.kp[j - 1], "gain of the position loop")
            kv = equations.parameter(f"kv{j}", self.kv[j - 1], "gain of the velocity loop")
            velocity = (0.5 * (q + last) - 0.5 * (last + before)) / self.period
            result.append(kv * (kp * (q_ref - q) - velocity))
        return result
