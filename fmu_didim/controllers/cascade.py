"""Cascade control of industrial drives: proportional position loop around a PI velocity loop."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import casadi as ca

from fmu_didim.controllers.base import ControlEquations, ControlLaw, VelocityKind


class CascadePPI(ControlLaw):
    """v_ref = Kv (q_ref - q) + feedforward dq_ref;  e_v = v_ref - dq;
    command = Kp e_v + Ki I, I[k+1] = I[k] + T e_v[k], I[0] = integral_start<j>, 0 by default.

    Attributes:
        Kv: gains of the position loop, 1/s.
        Kp, Ki: gains of the velocity loop.
        feedforward: share of the reference velocity added to v_ref, 0 to 1; one for all joints or one for each.
        velocity: ``measured`` (an input) or ``backward_difference`` of q.
    """

    Kv: tuple[float, ...]
    Kp: tuple[float, ...]
    Ki: tuple[float, ...]
    feedforward: float | tuple[float, ...] = 1.0
    velocity: VelocityKind = "measured"

    filters_velocity: ClassVar[bool] = True

    def commands(self, equations: ControlEquations, *, folder: Path) -> list[ca.SX]:
        result = []
        for j in range(1, len(self.joints) + 1):
            signals = self.error_signals(equations, j)
            dq = self.filtered(equations, j, self.velocity_signal(equations, j, self.velocity))
            kv = equations.parameter(f"Kv{j}", self.Kv[j - 1], "gain of the position loop")
            kp = equations.parameter(f"Kp{j}", self.Kp[j - 1], "proportional gain of the velocity loop")
            ki = equations.parameter(f"Ki{j}", self.Ki[j - 1], "integral gain of the velocity loop")
            share = self.feedforward[j - 1] if isinstance(self.feedforward, tuple) else self.feedforward
            forward = equations.parameter(f"feedforward{j}", share, "velocity feed-forward")
            error = kv * (signals["q_ref"] - signals["q"]) + forward * signals["dq_ref"] - dq
            integral = equations.integral(j, error, self.period)
            result.append(kp * error + ki * integral)
        return result
