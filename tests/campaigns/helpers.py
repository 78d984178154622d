"""Small campaigns on the SCARA with simulated data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fmu_didim.campaigns.campaign import Campaign, study
from fmu_didim.campaigns.planning.document import CampaignDocument
from fmu_didim.campaigns.planning.plan import Plan
from tests.helpers import ROOT

CASE = ROOT / "examples/scara/identify_200hz.yaml"
MOTION = {"train.reference.duration_s": [4.0]}
LAWS = [f"../../controllers/scara_{law}.yaml" for law in ("pd", "pid", "cascade", "computed_torque")]


def plan_of(**entries: Any) -> Plan:
    """A plan on the SCARA."""
    content = {"name": "test", "case": str(CASE), "noise": {"relative": 0.05}, **entries}
    return Plan(CampaignDocument.model_validate(content), Path())


def small(out: Path, **entries: Any) -> Campaign:
    """Identifications of a fifth of a second each."""
    entries = {"vary": {"train.torque.rate_hz": [20, 10]}, "seeds": 3, "noise": {"relative": 0.05}, **entries}
    return study(CASE, out=out, name="small", **entries)


REFERENCE = {
    "kind": "fourier", "fundamental_hz": 0.5, "duration_s": 4,
    "joints": [{"cosine": [0.1, 0.02, 0.01], "sine": [0.05, 0.03, -0.02]}],
}  # fmt: skip


def sledge_case(controller: str, **of_fmu: Any) -> dict[str, Any]:
    """A mass with friction whose controller is an FMU with one input and one output; further keys of its entry."""
    joint = {"type": "prismatic", "effects": ["viscous"], "parameters": {"M": 2.0, "Fv": 60.0}}
    return {
        "name": "sledge",
        "robot": {"name": "sledge", "gravity": [0, 0, 0], "joints": [joint]},
        "controller": {
            "source": controller, "inputs": {"q_ref1 - q1": "u"}, "outputs": {"command1": "y"},
            "parameters": {"d": 4000.0}, "rate_hz": 200, **of_fmu,
        },
        "loop": {"rate_hz": 200},
        "train": {"reference": REFERENCE, "torque": {"file": "none.csv", "rate_hz": 50}},
    }  # fmt: skip
