"""The base fit begins where the loop can be simulated."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim import load_case, read_robot, write_robot
from fmu_didim.base.errors import IdentificationError, SimulationError
from fmu_didim.discovery import base_model
from fmu_didim.discovery.base_model import prepare
from tests.cases import SCARA
from tests.conftest import ROOT


def test_a_robot_of_which_nothing_is_known_starts_as_in_identification(tmp_path: Path) -> None:
    """Without a value of any inertia M(q) is singular; ``init`` writes such robots."""
    source = ROOT / "fmus/scara/robot.yaml"
    robot = read_robot(source)
    joints = tuple(joint.model_copy(update={"parameters": {}}) for joint in robot.joints)
    write_robot(robot.model_copy(update={"joints": joints}), tmp_path / "robot.yaml")
    content = load_case(SCARA).content | {"plant": {"kind": "model"}}
    known, unknown = (
        prepare(load_case(content | {"robot": str(path)}, folder=SCARA.parent).model)
        for path in (source, tmp_path / "robot.yaml")
    )
    assert unknown.notes[0].startswith("The search starts from the motion that the measured torque implies")
    assert not any("starts from" in note for note in known.notes)
    sigma = np.sqrt(np.diag(known.fit.covariance))
    assert np.abs((known.fit.values - unknown.fit.values) / sigma).max() < 0.05


class Stub:
    """A fit whose error is known."""

    def __init__(self, error: float) -> None:
        self.error = error


@pytest.mark.parametrize(
    ("errors", "lacks_base", "told"),
    [
        ((7.0,), False, ""),
        ((199.0,), False, ""),
        ((2370.0, 7.0), False, "the fit goes astray (2370 % of the torque)"),
        ((None, 7.0), False, "with the values of the description the loop fails"),
        ((2370.0, None, 400.0, 7.0), False, "the fit goes astray (2370 % of the torque)"),
        ((None, 400.0, 7.0), False, "with the values of the description the loop fails"),
        ((2370.0, 900.0, None, 400.0), True, ""),
        ((2370.0, 900.0, None, 400.0), False, IdentificationError),
        ((None, None, None, None), False, SimulationError),
    ],
)
def test_a_base_fit_that_goes_astray_begins_elsewhere_or_is_refused(
    monkeypatch: pytest.MonkeyPatch,
    errors: tuple[float | None, ...],
    lacks_base: bool,
    told: str | type[Exception],
) -> None:
    """A loop that swings of itself explains nothing: what it lacks would be named of that."""
    left = iter(errors)

    def from_start(model: Any) -> Any:
        if (error := next(left)) is None:
            raise SimulationError("It diverged.", next_step="Start elsewhere.")
        return base_model.Prepared(Stub(error))  # type: ignore[arg-type]

    model: Any = SimpleNamespace(estimation_labels=["estimation"], with_values=lambda values: model)
    monkeypatch.setattr(base_model, "_from_start", from_start)
    monkeypatch.setattr(base_model, "_error", lambda fit: fit.error)
    monkeypatch.setattr(base_model, "may_lack_base", lambda model: lacks_base)
    starts = ("description", "torque", "nominal", "reference")
    monkeypatch.setattr(base_model, "start_sequence", lambda model, start: starts)
    monkeypatch.setattr(base_model, "start_values", lambda model, kind: None)
    if isinstance(told, type):
        with pytest.raises(told):
            base_model._of_torque(model)
        return
    found: Any = base_model._of_torque(model)
    assert found.fit.error == (errors[0] if not told else errors[-1])
    assert [note for note in found.notes if told in note] == list(found.notes)
    assert bool(found.notes) == bool(told)


def test_which_plants_may_lack_base(tmp_path: Path) -> None:
    case = load_case(SCARA)
    assert not base_model.may_lack_base(case.model)
    robot = read_robot(ROOT / "fmus/scara/robot.yaml")
    first = robot.joints[0].model_copy(update={"effects": (), "parameters": {}})
    bare = robot.model_copy(update={"joints": (first, *robot.joints[1:]), "identified": "computed"})
    write_robot(bare, tmp_path / "robot.yaml")
    content = case.content | {"plant": {"kind": "model"}, "robot": str(tmp_path / "robot.yaml")}
    content["estimator"] = {"kind": "didim"}
    assert base_model.may_lack_base(load_case(content, folder=SCARA.parent).model)
