"""Closed-loop input error: parameters that enter in any way, with and without a robot description."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import identify
from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.case import load_case
from fmu_didim.estimators import Clie, Didim
from fmu_didim.estimators.finish import unsettled_advice
from fmu_didim.fit.estimate import RefusedError, Status
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.solver.search import BEYOND_EDGE, NO_STEP
from tests.cases import ENTRIES, TRUTH, plant_case
from tests.helpers import NEAR, model_of


def test_same_minimum_as_the_finish_of_didim() -> None:
    model = model_of("examples/scara/identify.yaml")
    didim = Didim().estimate(model)
    clie = Clie(start="reference").estimate(model)
    assert clie.status is Status.CONVERGED
    assert (np.abs(clie.value - didim.value) <= NEAR * didim.standard_deviation).all()
    np.testing.assert_allclose(clie.standard_deviation, didim.standard_deviation, rtol=1e-4)


@pytest.mark.gate
def test_black_box_plant_is_identified_without_a_description(tmp_path: Path) -> None:
    outcome = identify(plant_case(tmp_path, ENTRIES))
    assert outcome.document.status == "converged"
    estimate = outcome.estimate
    assert estimate.names[0] == "inertia 1"
    assert outcome.document.parameters["inertia 1"].standard == "ZZ1"
    assert outcome.document.parameters["inertia 1"].unit == "kg.m2"
    assert (np.abs(estimate.value - TRUTH) <= 3 * estimate.standard_deviation).all()
    expected = identify("examples/scara/identify.yaml").estimate
    assert (np.abs(estimate.value - expected.value) <= NEAR * expected.standard_deviation).all()


def test_a_parameter_that_enters_nonlinearly_is_identified(tmp_path: Path) -> None:
    """The smoothing velocity of Coulomb friction, from torque at 200 Hz."""
    path = plant_case(tmp_path, {"Fc1": {"start": 0.7}, "v0": {"parameter": "v0_1", "start": 0.03, "minimum": 1e-3}})
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    for name in ("train", "validation"):
        content[name]["torque"]["file"] = content[name]["torque"]["file"].replace("_10hz", "_200hz")
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    estimate = identify(path).estimate
    assert (np.abs(estimate.value - [0.82, 0.02]) <= 3 * estimate.standard_deviation).all()
    assert estimate.standard_deviation[1] < 0.02


def test_result_at_a_limit_is_refused(tmp_path: Path) -> None:
    path = plant_case(tmp_path, {"Fc1": {"start": 0.7, "maximum": 0.75}})
    with pytest.raises(RefusedError, match="at a limit given in the case: Fc1"):
        identify(path)


def test_start_that_diverges_is_refused_with_advice(tmp_path: Path) -> None:
    path = plant_case(tmp_path, {"ZZ1": {"start": 0.0343}, "ZZ2": {"start": 0.00063}, "MX2": {"start": 0.0}})
    with pytest.raises(RefusedError, match="Start nearer to the truth"):
        identify(path)


@pytest.mark.parametrize(
    ("entries", "message"),
    [({"ZZ9": {}}, "no parameter of the plant named 'ZZ9'"), ({"ZZ1": {"minimun": 0}}, "Did you mean 'minimum'")],
)
def test_wrong_entries_are_refused(tmp_path: Path, entries: dict[str, Any], message: str) -> None:
    with pytest.raises(FmuDidimError, match=message):
        load_case(plant_case(tmp_path, entries))


def test_didim_without_a_description_points_to_clie(tmp_path: Path) -> None:
    """Without accelerations there is nothing to probe a regressor from."""
    path = plant_case(tmp_path, {"Fc1": {}})
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["estimator"] = {"kind": "didim"}
    content["plant"]["outputs"] = {"a1": "ddq1"}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    with pytest.raises(InputError, match="The plant lacks outputs that the regressor needs"):
        identify(path)


ITERATION = Iteration("clie", 40, np.zeros(1), 1.0)


@pytest.mark.parametrize(
    ("regressor", "refine", "note", "told"),
    [
        (True, True, "", None),
        (False, True, "", r"Increase maximum_iterations, start nearer to the truth(?!.*reference)"),
        (False, False, NO_STEP, r"No step lowers the error.*Start nearer(?!.*maximum_iterations)"),
        (True, True, NO_STEP, r"No step lowers the error.*more substeps"),
        (True, True, f"{BEYOND_EDGE}It diverged.", r"cannot be simulated \(It diverged\).*prior:(?!.*substeps)"),
    ],
)
def test_the_advice_fits_the_plant(regressor: bool, refine: bool, note: str, told: str | None) -> None:
    model: Any = SimpleNamespace(
        can_refine=refine, parameters=SimpleNamespace(has_regressor=regressor), first="a",
        loop=SimpleNamespace(
            shows_torque=True, whole="plant", quantity="torque", systems={"a": SimpleNamespace(components={})}
        ),
    )  # fmt: skip
    advice = unsettled_advice(model, [replace(ITERATION, note=note)])
    if told is None:
        assert advice == ""  # what the status says fits robots
    else:
        assert re.search(told, advice) and advice.startswith("The iterations did not settle")
