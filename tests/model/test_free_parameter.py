"""The scales of free parameters: what is noticeable, though a description leaves an inertia at zero."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fmu_didim.model.free_parameter import ROUNDING, base_free_parameters


@pytest.mark.parametrize(("value", "scale"), [(-0.5, 0.5), (1e-11, 1e-11), (0.0, 1.0), (1e-32, 1.0), (-1e-84, 1.0)])
def test_the_rounding_of_a_zero_is_no_scale(value: float, scale: float) -> None:
    """A URDF without inertia of its last link: sines of pi times zero, by which no step could be made. A small value of
    another unit is none."""
    parameters = SimpleNamespace(
        names=("XX6", "ZZ1", "Fv1"), units=("kg.m2", "kg.m2", "N.m.s/rad"),
        nominal=lambda: np.array([value, 2.0, 1e-13]), limits=lambda: (np.full(3, -np.inf), np.full(3, np.inf)),
    )  # fmt: skip
    assert [k.scale for k in base_free_parameters(parameters)] == [scale, 2.0, 1e-13]
    assert ROUNDING * 2.0 < 1e-11
