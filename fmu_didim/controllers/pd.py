"""Proportional-derivative control."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import casadi as ca

from fmu_didim.controllers.base import ControlEquations, ControlLaw, RateKind


class PD(ControlLaw):
    """command = Kp (q_ref - q) + Kd (dq_ref - dq), for each joint.

    Attributes:
        Kp, Kd: gains of each joint.
        velocity: ``measured`` (an input) or ``backward_difference`` of q; with ``error_difference`` the rate of the
            error is (e[k] - e[k-1]) / T instead, with T the period of ``rate_hz``.
    """

    Kp: tuple[float, ...]
    Kd: tuple[float, ...]
    velocity: RateKind = "measured"

    filters_velocity: ClassVar[bool] = True

    def commands(self, equations: ControlEquations, *, folder: Path) -> list[ca.SX]:
        result = []
        for j in range(1, len(self.joints) + 1):
            error, rate = self.error_and_rate(equations, j, self.velocity)
            rate = self.filtered(equations, j, rate)
            kp = equations.parameter(f"Kp{j}", self.Kp[j - 1], "proportional gain")
            kd = equations.parameter(f"Kd{j}", self.Kd[j - 1], "derivative gain")
            result.append(kp * error + kd * rate)
        return result
