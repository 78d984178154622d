"""Discovery on a drive whose FMU gives the velocity alone, with Coulomb friction that its model lacks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_didim import discover
from fmu_didim.discovery.untried import INTEGRATED
from tests.discovery.drive import drive_case

FRICTION = 0.08
"""Coulomb friction that the data have, N.m: about a tenth of the torque."""


@pytest.mark.gate
@pytest.mark.parametrize("known", [False, True], ids=["not in the plant", "declared"])
def test_coulomb_friction_of_a_drive_is_named(tmp_path: Path, known: bool) -> None:
    """Where the plant has a parameter for it and the case says so, that parameter is what is found."""
    found = discover(drive_case(tmp_path, friction=FRICTION, known=known), tmp_path / "out")
    assert [(f.effect, f.joint) for f in found.findings] == [("coulomb", 1)]
    value = next(v for v in found.findings[0].parameters if v.name == "Fc1")
    assert abs(value.value - FRICTION) <= 3.5 * value.std
    assert value.std < 0.1 * FRICTION
    final = found.found.discovery.final.model
    assert ("coulomb1" in final.loop.systems[final.first].components) is not known
    assert INTEGRATED.format("q1") in found.document.notes
    truth = {"J": 0.02, "d": 0.03}
    for v in found.document.base_parameters:
        assert abs(v.value - truth[v.name]) <= 3.5 * v.std


@pytest.mark.gate
def test_a_drive_without_friction_is_given_none(tmp_path: Path) -> None:
    found = discover(drive_case(tmp_path, friction=0.0), tmp_path / "out")
    assert found.findings == []
    assert np.isfinite(found.document.seconds)
