"""The documents of a made case: what its user is told, and what is hidden."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tests.tools.blind.simulator.design import Design
from tests.tools.blind.simulator.hidden import WHOLE_ROBOT

Array = np.ndarray
CLUTTER = (
    "small planted effects on each joint, naming one of them is not a false name: torque ripple at 17 rad^-1 (joint 1) "
    "and 23 rad^-1 (joint 2) of 6 % of Fc, Stribeck of 5 % of Fc at 0.1 rad/s, friction drift of 3 % of Fc over 20 s"
)


def case_document(design: Design, rate: int) -> dict[str, Any]:
    """What a user knows: ``case.yaml``."""
    n = design.count
    joints = [
        {"type": "revolute", "alpha": a, "a": design.length if j else 0.0, "d": 0.0} for j, a in enumerate(design.alpha)
    ]
    return {
        "robot": {
            "name": f"{n}R arm in a plane", "convention": "modified Denavit-Hartenberg (Khalil)", "joints": joints,
            "gravity_m_s2": list(design.gravity), "torque_equation": _equation(design),
            "nominal_parameters_within_15_percent": dict(design.nominal),
        },
        "controller": {
            "law": "tau[k]=Kp*(q_ref[k]-q[k])+Kd*(dq_ref[k]-dq[k]); dq[k]=(q[k]-q[k-1])/Ts; zero-order hold; no delay",
            "rate_hz": design.rate_hz, "Kp": list(design.Kp), "Kd": list(design.Kd),
            "encoder_step_rad": design.encoder_step,
            "initial_state": "moving with the reference: q=q_ref[0], dq=dq_ref[0]; the first dq estimate is exact",
        },
        "measurement": {
            "signal": "motor torque command", "unit": "N m", "rate_hz": rate,
            "sampling": "point samples at t, of the command applied from t on",
            "repeats": f"the trajectory is periodic, {design.periods} periods of {design.period_s:g} s",
            "noise": "coloured; level unknown to the user",
        },
    }  # fmt: skip


def _equation(design: Design) -> list[str]:
    gx, gy = design.plane_gravity
    if design.count == 1:
        return [
            f"gx={gx:.6g}, gy={gy:.6g}: gravity along x and y of frame 1 at q1=0",
            "tau1=ZZ1R*ddq1+gx*(MX1*sin q1+MY1*cos q1)-gy*(MX1*cos q1-MY1*sin q1)+Fv1*dq1+Fc1*sign(dq1)",
        ]
    return [
        f"gx={gx:.6g}, gy={gy:.6g}: gravity along x and y of frame 1 at q1=0; L1={design.length:g} m",
        f"s={design.sign[1]:g} (cos alpha2); p2=s*q2, m2=s*MY2",
        "A=L1*(MX2*cos p2-m2*sin p2), B=L1*(MX2*sin p2+m2*cos p2)",
        "g2=gx*(MX2*sin(q1+p2)+m2*cos(q1+p2))-gy*(MX2*cos(q1+p2)-m2*sin(q1+p2))",
        "g1=gx*(MX1*sin q1+MY1*cos q1)-gy*(MX1*cos q1-MY1*sin q1)+g2",
        "tau1=(ZZ1R+ZZ2+2A)*ddq1+(ZZ2+A)*ddp2-B*(2*dq1*dp2+dp2^2)+g1+Fv1*dq1+Fc1*sign(dq1)",
        "tau2=s*((ZZ2+A)*ddq1+(ZZ2+Ia2)*ddp2+B*dq1^2+g2)+Fv2*dq2+Fc2*sign(dq2)",
    ]


def truth_document(
    name: str,
    design: Design,
    hidden: Sequence[tuple[str, int, str, float, float]],
    gaps: Mapping[str, Mapping[str, Array]],
    *,
    clutter: bool,
) -> dict[str, Any]:
    """What is hidden: ``truth.yaml``; only the scoring reads it.

    Args:
        hidden: effect, joint from 0, equation, amplitude and the gap that it makes beside the others.
        gaps: ``plain`` and ``refitted``, by run.
    """
    content: dict[str, Any] = {
        "id": name,
        "truth": [
            {"effect": effect, "joint": joint + 1, "form": equation, "amplitude": float(amplitude)}
            | {"gap_beside_sigma": round(float(own), 3)}
            | ({"whole_robot": True} if effect in WHOLE_ROBOT else {})
            for effect, joint, equation, amplitude, own in hidden
        ],
        "parameters": {key: float(value) for key, value in design.true.items()},
    }
    for key, part in (("gap_sigma_rms_per_joint", "plain"), ("gap_after_refit_sigma_rms_per_joint", "refitted")):
        content[key] = {run: [round(float(x), 3) for x in values] for run, values in gaps[part].items()}
    content["clutter"] = CLUTTER if clutter else "none"
    return content
