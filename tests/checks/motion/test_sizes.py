"""The larger a misfit the clearer its doubt: misfits of many sizes, on the noise of a right fit and in closed loops."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fmu_didim.checks.motion.colour import rest_of
from fmu_didim.checks.motion.dependence import (
    FOLLOWED,
    MOTION_CHANCE,
    followed,
    residuals_of_fit,
    samples_of,
)
from fmu_didim.checks.motion.dependence import tested_rows as rows_of
from fmu_didim.checks.motion.functions import SIGNATURE
from fmu_didim.checks.motion.misfits import INSTANTS, Misfit, Misfits
from fmu_didim.fit.fit import Fit, point
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from tests.checks.data.right import loaded, right
from tests.tools.verdict.power import along, judged, machine, with_logs

LEVEL = MOTION_CHANCE / 2
"""Of the p value of each of two joints."""


@pytest.fixture(scope="module")
def fit() -> Fit:
    model = right("scara", 1, noise=0.01)
    model = model.on("estimation").with_values(loaded("scara").start)
    return point(model, NoiseOfResidual(model))


@pytest.fixture(scope="module")
def found(fit: Fit) -> Misfits:
    return Misfits.of(fit)


@pytest.mark.parametrize(
    ("effect", "joint"),
    [("payload_change", 2), ("torque_offset", 1), ("thermal_friction_drift", 2), ("dead_zone", 1), ("stribeck", 2)],
)
def test_a_misfit_of_any_larger_size_is_told_by_its_name(fit: Fit, found: Misfits, effect: str, joint: int) -> None:
    """To first order, up to a thousand times the noise."""
    rows = rows_of(fit)
    one = residuals_of_fit(fit, rows, found)[joint - 1]
    (misfit,) = (m for m in found.stated if m.load.effect == effect and m.load.joint == joint)
    signature = rest_of(misfit.signature[samples_of(fit, rows), joint - 1], one.basis)
    noise = rest_of(one.residual, one.basis)
    unit = signature * np.linalg.norm(noise) / np.linalg.norm(signature)
    lefts = [replace(one.left, residual=noise + size * unit) for size in np.geomspace(0.05, 1000, 14)]
    told = [replace(one, left=left).dependence() for left in lefts]
    values = np.array([d.p_value for d in told])
    first = int(np.argmax(values < LEVEL))
    assert 0 < first < 6
    assert (values[first:] < LEVEL).all()
    if SIGNATURE + misfit.what in one.names:
        assert all(misfit.what in d.looks for d in told[first + 1 :])


def test_what_functions_follow_has_no_column_of_its_own_and_all_else_has(fit: Fit, found: Misfits) -> None:
    rows = rows_of(fit)
    plain, beside = residuals_of_fit(fit, rows), residuals_of_fit(fit, rows, found)

    def shows(misfit: Misfit, k: int) -> float:
        left = rest_of(misfit.signature[samples_of(fit, rows), k], plain[k].basis)
        return float(np.sum(left**2)) / plain[k].left.squares

    for k, (usual, one) in enumerate(zip(plain, beside, strict=True)):
        functions = rest_of(usual.motion, usual.basis)
        for misfit in found.stated:
            signature = rest_of(misfit.signature[samples_of(fit, rows), k], usual.basis)
            if part_followed(signature[:, None], functions)[0] >= FOLLOWED:
                assert SIGNATURE + misfit.what not in one.names
            elif shows(misfit, k) == max(shows(misfit, j) for j in range(len(plain))):
                assert SIGNATURE + misfit.what in one.names


def part_followed(signatures: np.ndarray, functions: np.ndarray) -> np.ndarray:
    """(s,) of the squares of signatures (N, s), by functions (N, m)."""
    return followed(functions.T @ functions, functions.T @ signatures, np.sum(signatures**2, axis=0))


def test_what_is_followed() -> None:
    time = np.linspace(0, 10, 500)
    functions = np.column_stack([np.sin((k + 1) * time) for k in range(5)])
    table = [functions[:, 2] - 2 * functions[:, 4], functions[:, :3].sum(axis=1), np.sin(40 * time), 0 * time]
    of_two, of_three, of_none, nothing = part_followed(np.column_stack(table), functions)
    assert of_two == pytest.approx(1.0)
    assert of_three == pytest.approx(2 / 3, abs=0.05)
    assert of_none < 0.05
    assert nothing == 0
    assert part_followed(functions[:, :1], np.column_stack([functions[:, 0]] * 2))[0] == pytest.approx(
        1.0
    )  # the same twice


def test_loads_of_any_shape_are_looked_for_at_many_instants(found: Misfits) -> None:
    parameters = {name for m in found.on_the_way for name, size in m.load.amplitudes.items() if size}
    assert {"dMX", "dMY"} <= parameters
    begun = {m.load.stated.in_log["t_load"] for m in found.on_the_way}
    assert begun == set(INSTANTS)
    assert "a payload that changes after 30 % of the log (joint 2)" in {m.what for m in found.on_the_way}


LOOPS = {
    "payload halfway": ("payload_change", 2, {"t_load": 5.0, "dMX": 0.0081, "dMY": 0.0005}),
    "payload of another shape, elsewhere": ("payload_change", 2, {"t_load": 6.2, "dMX": 0.002, "dMY": 0.008}),
    "offset": ("torque_offset", 1, {"offset": 0.06}),
    "drift of friction": ("thermal_friction_drift", 1, {"v0": 0.02, "Theat": 10.0, "Fvt": 0.005, "Fct": 0.1}),
    "dead zone": ("dead_zone", 1, {"dead_zone": 0.04}),
}
"""Name -> effect, joint, and parameters of the smallest size."""


@pytest.mark.gate
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if k % 2 else ()) for k, n in enumerate(LOOPS)]
)
def test_a_closed_loop_with_a_misfit_of_any_larger_size_is_doubted(name: str) -> None:
    """From the smallest size, which is a part of the noise in the torque, to fifty times it."""
    effect, joint, parameters = LOOPS[name]
    model, own = along("scara", 1), {"w_load": 0.02, "dM": 0.0, "dMZ": 0.0}
    own = {**own, **parameters} if effect == "payload_change" else parameters
    for times in (1, 2, 5, 10, 20, 50):
        stated = SimpleNamespace(effect=effect, joint=joint, parameters=own)
        real = machine("scara", model, stated, times)  # type: ignore[arg-type]
        torques = {label: real.torque(real.start, label) for label in real.experiments}
        verdict = judged(with_logs(model, torques, 1001, 0.01)).judgement
        assert verdict.verdict != "valid", f"{times} times"
