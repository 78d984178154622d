"""Torques from outside as columns of a reference."""

import numpy as np

from fmu_didim.data.signals import trajectory
from fmu_didim.model.external_torque import ExternalTorque, with_external_torques

TIME = np.arange(11) / 10


def test_columns_of_a_reference_stay_where_they_are_and_torques_on_a_joint_add_up() -> None:
    reference = trajectory(TIME, {"external_torque2": 0.5 * np.ones(11), "q1": TIME**2})
    torques = [ExternalTorque(1, 0.2, 0.4, 3.0), ExternalTorque(2, 0.0, 0.1, 2.0), ExternalTorque(1, 0.3, 0.4, -1.0)]
    found = with_external_torques(reference, torques)
    assert found.names == ("external_torque2", "q1", "external_torque1")
    np.testing.assert_array_equal(found.column("q1"), TIME**2)
    np.testing.assert_allclose(found.column("external_torque2"), 0.5 + 2.0 * (TIME < 0.05), atol=1e-12)
    expected = 3.0 * ((TIME > 0.15) & (TIME < 0.35)) - ((TIME > 0.25) & (TIME < 0.35))
    np.testing.assert_allclose(found.column("external_torque1"), expected, atol=1e-12)
    np.testing.assert_array_equal(reference.column("external_torque2"), 0.5)
    assert with_external_torques(reference, []) is reference
