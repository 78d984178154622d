"""Base parameters: known relations, and the torque that must not change by regrouping."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.dynamics.base_parameters import BaseParameters, all_parameters, base_parameters
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from fmu_didim.model.parameters import RobotParameters
from tests.helpers import ROOT, random_robot, scara

RNG = np.random.default_rng
# Geometry of the Staubli TX40: TUM-ICS/BIRDy, Utils/SymbolicModelData/RobotDescriptionFiles/TX40.m (MIT).
HALF = np.pi / 2
TX40_ALPHA = (0, -HALF, 0, HALF, -HALF, HALF)
TX40_A = (0, 0, 0.225, 0, 0, 0)
TX40_D = (0, 0, 0.035, 0.225, 0, 0)
TX40_THETA = (0, -HALF, HALF, 0, 0, np.pi)


def described(joints: list[dict[str, Any]], **options: Any) -> RobotModel:
    return RobotModel(RobotDescription.model_validate({"name": "robot", "joints": joints, **options}))


def from_file(name: str, **changed: Any) -> RobotModel:
    return RobotModel(read_robot(ROOT / f"fmus/{name}/robot.yaml").model_copy(update=changed))


def torques(
    model: RobotModel, base: BaseParameters, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Torque of random standard parameters, of the base parameters that follow from them, and both regressors."""
    rng = np.random.default_rng(seed)
    count = 20 + len(model.parameters)
    rows = model.regressor_rows(*rng.normal(scale=2.0, size=(3, count, model.joint_count)))
    chi = rng.normal(size=len(model.parameters))
    free = np.concatenate([base.index, base.dependent])
    held = np.setdiff1d(np.arange(chi.size), free)
    chi[held] = base.known[held]
    columns, known = rows[..., base.index], rows @ base.known
    return rows @ chi, columns @ base.reduce(chi) + known, rows, columns


def relative(difference: np.ndarray, size: np.ndarray) -> float:
    return float(np.linalg.norm(difference) / np.linalg.norm(size))


# ---- known robots --------------------------------------------------------------------------------


def test_scara_relations() -> None:
    base = base_parameters(scara())
    assert base.names == ("ZZ1R", "Fv1", "Fc1", "ZZ2", "MX2", "MY2", "Fv2", "Fc2")
    assert base.relations() == ["ZZ1R = ZZ1 + Ia1 + 0.25 M2"]
    assert base.units[:3] == ("kg.m2", "N.m.s/rad", "N.m")
    values = scara().parameter_values
    np.testing.assert_allclose(base.reduce(values), [3.43, 0.03, 0.82, 0.063, 0.241, 0.014, 0.013, 0.137])
    values[scara().parameter_index("M2")] = 2.0
    values[scara().parameter_index("Ia1")] = 0.4
    assert base.reduce(values)[0] == pytest.approx(3.43 + 0.4 + 0.5, rel=1e-12)


def test_arm_relations() -> None:
    base = base_parameters(from_file("arm2r"))
    assert sorted(base.relations()) == ["MX1 = MX1 + 0.5 M2", "ZZ1R = ZZ1 + Ia1 + 0.25 M2"]
    assert base.count == 11


def test_emps_has_nothing_to_regroup() -> None:
    base = base_parameters(from_file("emps"))
    assert base.names == ("M", "Fv", "Fc", "offset")
    assert base.standard == ("M1", "Fv1", "Fc1", "offset1")
    assert base.relations() == []
    np.testing.assert_allclose(base.reduce(from_file("emps").parameter_values), [95.1089, 203.5034, 20.3935, -3.1648])


def test_computed_names_say_what_is_regrouped() -> None:
    base = base_parameters(from_file("arm2r", identified="computed"))
    assert set(base.relations()) == {"MX1R = MX1 + 0.5 M2", "ZZ1R = ZZ1 + Ia1 + 0.25 M2"}
    assert set(base.names) == {"ZZ1R", "MX1R", "MY1", "Fv1", "Fc1", "ZZ2", "MX2", "MY2", "Ia2", "Fv2", "Fc2"}


@pytest.mark.parametrize(("effects", "count"), [(["motor_inertia", "viscous", "coulomb"], 52), ([], 36)])
def test_tx40_has_the_published_number_of_base_parameters(effects: list[str], count: int) -> None:
    """36 of the rigid links, as for every arm of this kind; with friction 12 more, with rotors 4 more."""
    joints = [
        {"type": "revolute", "alpha": alpha, "a": a, "theta": theta, "d": d, "effects": effects}
        for alpha, a, theta, d in zip(TX40_ALPHA, TX40_A, TX40_THETA, TX40_D, strict=True)
    ]
    model = described(joints)
    base = base_parameters(model)
    rigid = [name for name in base.standard if not name.startswith(("Ia", "Fv", "Fc"))]
    assert base.count == count
    # The rotor inertias of joints 1 and 2 join ZZ1 and ZZ2; the four others are told apart.
    assert sum(name.startswith("Ia") for name in base.standard) == (4 if effects else 0)
    assert len(rigid) == 36


# ---- properties ----------------------------------------------------------------------------------


@pytest.mark.parametrize("count", range(1, 7))
@pytest.mark.parametrize("seed", range(3))
def test_regrouping_keeps_the_torque(count: int, seed: int) -> None:
    model = RobotModel(random_robot(count, seed))
    base = base_parameters(model)
    full, reduced, rows, columns = torques(model, base, seed)
    assert relative(full - reduced, full) < 1e-10
    # The parameters given to the simulated plant, with the dependent ones at zero, act alike.
    chi = np.random.default_rng(seed).normal(size=rows.shape[2])
    assert relative(rows @ base.expand(base.reduce(chi)) - rows @ chi, rows @ chi) < 1e-10
    # None is missing and none is superfluous, by a rank that is found in another way.
    flat = rows.reshape(-1, rows.shape[2])
    norms = np.linalg.norm(flat, axis=0)
    scaled = flat[:, norms > 1e-9 * norms.max()] / norms[norms > 1e-9 * norms.max()]
    assert base.count == np.linalg.matrix_rank(scaled, tol=1e-8)
    assert np.linalg.matrix_rank(columns.reshape(-1, base.count) / norms[base.index], tol=1e-8) == base.count


@pytest.mark.parametrize("name", ["scara", "arm2r", "emps"])
def test_named_parameters_keep_the_torque(name: str) -> None:
    model = from_file(name)
    full, reduced, _, _ = torques(model, base_parameters(model), 1)
    assert relative(full - reduced, full) < 1e-10


def test_known_parameters_are_left_alone() -> None:
    """With M2 known, nothing regroups into MX1, and its torque is subtracted."""
    joints = [{"type": "revolute"}, {"type": "revolute", "a": 0.5, "parameters": {"M": 3.0}}]
    model = described(joints, gravity=[0, -9.81, 0], known=["M2"])
    base = base_parameters(model)
    assert "M2" not in [base.standard_names[i] for i in (*base.index, *base.dependent)]
    assert base.relations() == ["ZZ1R = ZZ1 + Ia1"]
    full, reduced, rows, _ = torques(model, base, 2)
    assert relative(full - reduced, full) < 1e-10
    np.testing.assert_allclose(rows @ base.known, 3.0 * rows[..., model.parameter_index("M2")], rtol=1e-14)


@pytest.mark.parametrize("known", [[], ["M2"]])
def test_all_parameters_explain_what_the_base_parameters_do(known: list[str]) -> None:
    """No more and no less: which of them depend on others need not be known for that."""
    joints = [{"type": "revolute"}, {"type": "revolute", "a": 0.5, "parameters": {"M": 3.0}}]
    model = described(joints, gravity=[0, -9.81, 0], known=known)
    base, every = base_parameters(model), all_parameters(model)
    rows = model.regressor_rows(*RNG(3).normal(size=(3, 80, 2))).reshape(160, -1)
    both = [rows[:, one.index] for one in (base, every)]
    ranks = [np.linalg.matrix_rank(table) for table in (*both, np.column_stack(both))]
    assert ranks == [len(base.names)] * 3
    assert len(every.names) > len(base.names)
    assert ("M2" in every.names) is not bool(known)


def test_the_regressor_of_base_parameters_is_a_part_of_that_of_all() -> None:
    """With what is known, whose torque is subtracted."""
    joints = [{"type": "revolute"}, {"type": "revolute", "a": 0.5, "parameters": {"M": 3.0}}]
    model = described(joints, gravity=[0, -9.81, 0], known=["M2"])
    base, motion = base_parameters(model), RNG(4).normal(size=(3, 5000, 2))
    columns, torque = RobotParameters(model, base).regressor(*motion)
    rows = model.regressor_rows(*motion)
    np.testing.assert_array_equal(columns, rows[..., base.index])
    np.testing.assert_allclose(torque, rows @ base.known, rtol=1e-12, atol=1e-12)
    assert torque.any()


def test_expand_puts_the_base_parameters_in_their_places() -> None:
    base = base_parameters(scara())
    chi = base.expand(np.arange(1.0, 9.0))
    got = {name: chi[i] for i, name in enumerate(base.standard_names) if chi[i]}
    assert got == {"ZZ1": 1.0, "Fv1": 2.0, "Fc1": 3.0, "ZZ2": 4.0, "MX2": 5.0, "MY2": 6.0, "Fv2": 7.0, "Fc2": 8.0}
    np.testing.assert_array_equal(base.reduce(chi), np.arange(1.0, 9.0))


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("extra", "partners"),
    [
        ({"Rotor": "Ia1"}, "'Rotor' cannot be told apart from ZZ1R."),
        ({"Second mass": "M2"}, "'Second mass' cannot be told apart from ZZ1R."),
    ],
)
def test_dependent_parameters_are_refused(extra: dict[str, str], partners: str) -> None:
    identified = {"ZZ1R": "ZZ1", "MX2": "MX2", **extra}
    with pytest.raises(InputError) as caught:
        base_parameters(from_file("scara", identified=identified))
    assert partners in str(caught.value)
    assert "identified: computed" in str(caught.value)


def test_all_partners_are_named() -> None:
    identified = {"Inertia": "ZZ1", "Moment": "MX1", "Friction": "Fv1", "Mass": "M2"}
    with pytest.raises(InputError, match=r"'Mass' cannot be told apart from Inertia, Moment\."):
        base_parameters(from_file("arm2r", identified=identified))


def test_parameters_without_effect_are_refused() -> None:
    with pytest.raises(InputError, match="'moment' has no effect on any torque"):
        base_parameters(from_file("scara", identified={"ZZ1R": "ZZ1", "moment": "MX1"}))


def test_parameters_with_an_effect_of_rounding_size_are_refused() -> None:
    """Axis 1 is parallel to gravity, but only to rounding: MX1 has no effect."""
    gravity = (0.0, 9.81 * np.sin(0.1), -9.81 * np.cos(0.1))
    joint = {"type": "revolute", "alpha": 0.1, "effects": []}
    assert base_parameters(described([joint], gravity=gravity)).names == ("ZZ1",)
    with pytest.raises(InputError, match="'MX1' has no effect"):
        base_parameters(described([joint], gravity=gravity, identified={"ZZ1": "ZZ1", "MX1": "MX1"}))


def test_nothing_left_to_identify() -> None:
    joint = {"type": "revolute", "effects": []}
    with pytest.raises(InputError, match=r"No parameter is left[\s\S]*'robot'"):
        base_parameters(described([joint], known=["ZZ1"]))
