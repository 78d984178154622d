"""The models of a robot: against each other and against Pinocchio."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from fmu_didim.export import compile_shared_library

try:
    import pinocchio
except ImportError:
    pinocchio = None  # there are no wheels for Windows
needs_pinocchio = pytest.mark.skipif(pinocchio is None, reason="needs Pinocchio: pip install pin")
RIGID = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")


def random_robot(count: int, seed: int) -> RobotDescription:
    """A physical robot: random geometry, links made of point masses, every effect present."""
    rng = np.random.default_rng(seed)
    joints = []
    for _ in range(count):
        masses = rng.uniform(0.5, 2.0, 6)
        points = rng.normal(scale=0.3, size=(6, 3))
        inertia = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
        first = masses @ points
        values = dict(
            XX=inertia[0, 0],
            XY=inertia[0, 1],
            XZ=inertia[0, 2],
            YY=inertia[1, 1],
            YZ=inertia[1, 2],
            ZZ=inertia[2, 2],
            MX=first[0],
            MY=first[1],
            MZ=first[2],
            M=masses.sum(),
            Ia=rng.uniform(0.1, 1),
            Fv=rng.uniform(0, 2),
            Fc=rng.uniform(0, 2),
            offset=rng.normal(),
            v0=0.1,
        )
        joints.append(
            dict(
                type="revolute" if rng.random() < 0.7 else "prismatic",
                alpha=rng.uniform(-np.pi, np.pi),
                a=rng.normal(),
                theta=rng.uniform(-np.pi, np.pi),
                d=rng.normal(),
                parameters={k: float(v) for k, v in values.items()},
            )
        )
    return RobotDescription.model_validate(
        dict(name="random", gravity=tuple(rng.normal(scale=9.81, size=3)), joints=joints)
    )


def pinocchio_model(robot: RobotDescription) -> pinocchio.Model:
    """The rigid part of the same robot, built joint by joint from the modified Denavit-Hartenberg frames."""
    model = pinocchio.Model()
    model.gravity = pinocchio.Motion(np.array(robot.gravity), np.zeros(3))
    parent = 0
    for j, joint in enumerate(robot.joints, start=1):
        about_x = pinocchio.SE3(pinocchio.utils.rotate("x", joint.alpha), np.array([joint.a, 0, 0]))
        about_z = pinocchio.SE3(pinocchio.utils.rotate("z", joint.theta), np.array([0, 0, joint.d]))
        # rotate returns the rotation matrix; Rx Tx commute, and so do Rz Tz.
        kind = pinocchio.JointModelRZ() if joint.type == "revolute" else pinocchio.JointModelPZ()
        parent = model.addJoint(parent, kind, about_x * about_z, f"joint{j}")
        p = joint.parameters
        com = np.array([p["MX"], p["MY"], p["MZ"]]) / p["M"]
        about_origin = np.array([[p["XX"], p["XY"], p["XZ"]], [p["XY"], p["YY"], p["YZ"]], [p["XZ"], p["YZ"], p["ZZ"]]])
        about_com = about_origin - p["M"] * (com @ com * np.eye(3) - np.outer(com, com))
        model.appendBodyToJoint(parent, pinocchio.Inertia(p["M"], com, about_com), pinocchio.SE3.Identity())
    return model


def motion(count: int, seed: int, size: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(np.random.default_rng(seed + 1000).normal(size=(3, size, count)))  # type: ignore[return-value]


@pytest.mark.parametrize("count", range(1, 8))
@pytest.mark.parametrize("seed", range(3))
class TestModels:
    def test_regressor_times_parameters_is_the_inverse_model(self, count: int, seed: int) -> None:
        model = RobotModel(random_robot(count, seed))
        q, dq, ddq = motion(count, seed)
        rows = model.regressor_rows(q, dq, ddq)
        for k in range(q.shape[0]):
            torque = model.inverse(q[k], dq[k], ddq[k], model.parameter_values, model.shape_values).full().ravel()
            assert np.linalg.norm(rows[k] @ model.parameter_values - torque) <= 1e-10 * np.linalg.norm(torque)

    def test_direct_after_inverse_is_the_identity(self, count: int, seed: int) -> None:
        model = RobotModel(random_robot(count, seed))
        q, dq, ddq = motion(count, seed)
        for k in range(q.shape[0]):
            torque = model.inverse(q[k], dq[k], ddq[k], model.parameter_values, model.shape_values)
            back = model.direct(q[k], dq[k], torque, model.parameter_values, model.shape_values).full().ravel()
            assert np.linalg.norm(back - ddq[k]) <= 1e-10 * np.linalg.norm(ddq[k])

    @needs_pinocchio
    def test_rigid_body_part_agrees_with_pinocchio(self, count: int, seed: int) -> None:
        robot = random_robot(count, seed)
        model, other = RobotModel(robot), pinocchio_model(robot)
        data = other.createData()
        chi = np.array(
            [v.start if any(v.name.rstrip("0123456789") == name for name in RIGID) else 0.0 for v in model.parameters]
        )
        q, dq, ddq = motion(count, seed)
        for k in range(q.shape[0]):
            ours = model.inverse(q[k], dq[k], ddq[k], chi, model.shape_values).full().ravel()
            theirs = pinocchio.rnea(other, data, q[k], dq[k], ddq[k])
            assert np.linalg.norm(ours - theirs) <= 1e-10 * np.linalg.norm(theirs)

    @pytest.mark.gate
    def test_mass_matrix_and_bias_make_up_the_torque(self, count: int, seed: int) -> None:
        model = RobotModel(random_robot(count, seed))
        q, dq, ddq = motion(count, seed)
        chi, s = model.parameter_values, model.shape_values
        assert model.inertia_along(q, chi).min() > 0
        for k in range(q.shape[0]):
            mass = model.mass_matrix(q[k], chi).full()
            torque = model.inverse(q[k], dq[k], ddq[k], chi, s).full().ravel()
            assert np.allclose(mass, mass.T, rtol=0, atol=1e-10 * np.abs(mass).max())
            sum_of_parts = mass @ ddq[k] + model.bias(q[k], dq[k], chi, s).full().ravel()
            assert np.linalg.norm(sum_of_parts - torque) <= 1e-10 * np.linalg.norm(torque)


def test_arm_follows_its_closed_form() -> None:
    """The torque equations that the description of the vertical arm states."""
    model = RobotModel(read_robot("fmus/arm2r/robot.yaml"))
    values = {v.name: v.start for v in (*model.parameters, *model.shapes)}
    q, dq, ddq = motion(2, 0, 20)
    for (q1, q2), (v1, v2), (a1, a2) in zip(q, dq, ddq, strict=True):
        coupling = 0.5 * (values["MX2"] * np.cos(q2) - values["MY2"] * np.sin(q2))
        centrifugal = 0.5 * (values["MX2"] * np.sin(q2) + values["MY2"] * np.cos(q2))
        g2 = 9.81 * (values["MX2"] * np.cos(q1 + q2) - values["MY2"] * np.sin(q1 + q2))
        g1 = 9.81 * (values["MX1"] * np.cos(q1) - values["MY1"] * np.sin(q1)) + g2
        zz1, zz2, ia2 = values["ZZ1"], values["ZZ2"], values["Ia2"]
        expected = [
            (zz1 + zz2 + 2 * coupling) * a1
            + (zz2 + coupling) * a2
            - centrifugal * (2 * v1 * v2 + v2**2)
            + g1
            + values["Fv1"] * v1
            + values["Fc1"] * np.tanh(v1 / values["v0_1"]),
            (zz2 + coupling) * a1
            + (zz2 + ia2) * a2
            + centrifugal * v1**2
            + g2
            + values["Fv2"] * v2
            + values["Fc2"] * np.tanh(v2 / values["v0_2"]),
        ]
        got = model.inverse([q1, q2], [v1, v2], [a1, a2], model.parameter_values, model.shape_values).full().ravel()
        np.testing.assert_allclose(got, expected, rtol=1e-12)


def test_not_positive_definite_inertia_is_seen() -> None:
    model = RobotModel(read_robot("fmus/scara/robot.yaml"))
    q = np.zeros((1, 2))
    chi = model.parameter_values
    chi[model.parameter_index("ZZ1")] = -1.0
    assert model.inertia_along(q, chi).min() <= 0
    chi[model.parameter_index("ZZ1")] = 1e-4
    assert model.inertia_along(q, chi).min() <= 0  # coupling larger than the inertias allow


def test_a_wrong_description_lists_all_its_problems() -> None:
    from fmu_didim.base.documents import validate

    content = dict(
        name="2bad",
        gravty=[0, 0, 0],
        joints=[dict(type="revolut", parameters=dict(ZZZ=1)), dict(type="prismatic", parameters=dict(ZZZ=1))],
    )
    with pytest.raises(InputError) as caught:
        validate(RobotDescription, content, where="robot.yaml")
    text = str(caught.value)
    assert "Did you mean 'gravity'?" in text
    assert "name:" in text
    assert "joints.0.type:" in text
    assert "joints.1: unknown parameters ZZZ; valid: XX, XY" in text


def test_c_code_computes_the_same(tmp_path: Path) -> None:
    """The C source of the models, compiled, against CasADi's own evaluation."""
    model = RobotModel(read_robot("fmus/arm2r/robot.yaml"))
    visible = '#define CASADI_SYMBOL_EXPORT __attribute__((visibility("default")))\n'
    (tmp_path / "arm.c").write_text(visible + model.c_code(), encoding="utf-8")
    library = tmp_path / "arm.so"
    compile_shared_library(tmp_path, library, main="arm.c")
    q, dq, ddq = motion(2, 0, 1)
    chi, shapes = model.parameter_values, model.shape_values
    arguments = {
        "inverse": [q, dq, ddq, chi, shapes],
        "regressor": [q, dq, ddq, shapes],
        "mass_matrix": [q, chi],
        "bias": [q, dq, chi, shapes],
        "direct": [q, dq, ddq, chi, shapes],
    }
    for name, values in arguments.items():
        columns = [np.asarray(v).ravel() for v in values]
        compiled = ca.external(name, str(library))
        expected = getattr(model, name)(*columns).full()
        np.testing.assert_allclose(compiled(*columns).full(), expected, rtol=1e-13, atol=1e-15)
