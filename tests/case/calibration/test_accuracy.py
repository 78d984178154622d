"""Data without noise: standard deviations are those of the errors of the simulation, and that is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.components.fmu.component import solver_tolerance
from fmu_didim.components.fmu.cvode import CVODE_TOLERANCE
from fmu_didim.components.fmu.load import load_fmu
from fmu_didim.workflow.output.result import Result
from tests.checks.outputs.test_short_records import driven, exact
from tests.room import room_case, room_fmu, write_room

TOLD = "hardly more noise than the simulation errs by"


def told(found: Result) -> bool:
    return any(TOLD in remark for remark in found.document.remarks)


@pytest.mark.parametrize("count", [8, 12, 19, 40])
def test_values_of_data_without_noise_are_within_their_deviations(count: int) -> None:
    """The input is held over a 64th of each step: that is what the values are off by."""
    time = np.linspace(0, 1, count)
    found = identify(driven(time, exact(time)))
    assert found.verdict == "valid", found.reasons
    assert told(found)
    for name, true in (("a", -1.0), ("x0", 1.0)):
        off = abs(found.parameters[name].value - true)
        assert 0.02 * found.parameters[name].std < off < 2 * found.parameters[name].std


@pytest.mark.parametrize("interface", ["co-simulation", "model-exchange"])
def test_no_deviation_is_smaller_than_what_the_solver_leaves(tmp_path: Path, interface: str) -> None:
    write_room(tmp_path, noise=0.0, count=100)
    model = {"source": str(room_fmu()), "interface": interface}
    found = identify(room_case(tmp_path, model=model))
    assert found.verdict == "valid", found.reasons
    assert told(found)
    for name, true in (("R1", 0.1), ("R2", 0.25)):
        assert abs(found.parameters[name].value - true) < 2 * found.parameters[name].std < 1e-3 * true


def test_noise_that_is_larger_decides_alone(tmp_path: Path) -> None:
    write_room(tmp_path, noise=0.1, count=200)
    found = identify(room_case(tmp_path))
    assert not told(found)
    estimate = found.estimate
    assert (estimate.accuracy < 0.01 * estimate.noise).all()


def test_the_tolerance_of_a_solver() -> None:
    """Of CVode here; of FMUs that were built here the steps are known, where their equations are."""
    assert solver_tolerance(load_fmu(room_fmu(), interface="model-exchange", solver="cvode")) == CVODE_TOLERANCE
    assert solver_tolerance(load_fmu(room_fmu(), interface="model-exchange", solver="rk4")) == 0.0
    assert solver_tolerance(load_fmu(room_fmu(), interface="co-simulation")) == 1e-6
