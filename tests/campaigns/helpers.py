"""Small campaigns on the SCARA with simulated data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fmu_didim.campaigns.campaign import Campaign, study
from fmu_didim.campaigns.document import CampaignDocument
from fmu_didim.campaigns.plan import Plan
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
