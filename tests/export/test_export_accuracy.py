"""The accuracy of exported FMUs, as a parameter or as the master states it: by FMPy, against SciPy's integrator."""

from __future__ import annotations

from functools import cache
from typing import Any

import fmpy
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmu_didim.base.errors import InputError
from fmu_didim.components import load_fmu
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu
from fmu_didim.export.versions import VERSIONS
from tests.export.helpers import controller, pendulum
from tests.helpers import drive, scara

STEP, STEPS = 0.01, 20
BLOCKS = {"pendulum": [1.5], "scara": [1.0, 0.4], "steep scara": [1.0, 0.4]}
"""Constant torque. Where friction is steep, the linearly implicit method; where much is asked for, RK4 again."""


@cache
def block_of(name: str) -> Block:
    if name == "pendulum":
        return pendulum()
    return scara().block({"q_start1": 0.3} | ({"v0_1": 0.002, "v0_2": 0.002} if name == "steep scara" else {}))


@cache
def truth(name: str) -> np.ndarray:
    """Outputs (STEPS + 1, ny), to some 1e-12."""
    block, torque = block_of(name), BLOCKS[name]
    p = block.parameter_values
    found = solve_ivp(
        lambda t, x: np.array(block.update(x, torque, p)).ravel(), (0, STEP * STEPS),
        np.array(block.start(torque, p)).ravel(), method="DOP853", rtol=1e-13, atol=1e-14,
        t_eval=np.linspace(0, STEP * STEPS, STEPS + 1),
    )  # fmt: skip
    return np.array([np.array(block.output(x, torque, p)).ravel() for x in found.y.T])


def run(name: str, version: str = "2.0", *, stated: float | None = None, **values: float) -> np.ndarray:
    """Outputs (STEPS + 1, ny) by FMPy."""
    block, torque = block_of(name), BLOCKS[name]
    names = [v.name for v in block.outputs]
    inputs = dict(zip((v.name for v in block.inputs), torque, strict=True))
    result = fmpy.simulate_fmu(
        str(build_fmu(block, fmi_version=version)), fmi_type="CoSimulation", stop_time=STEP * STEPS,
        output_interval=STEP, start_values=inputs | values, output=names, relative_tolerance=stated,
    )  # fmt: skip
    return np.column_stack([result[n] for n in names])


def error(name: str, found: np.ndarray) -> float:
    """Of positions and velocities, relative to the largest."""
    states = slice(0, 2 if name == "pendulum" else 4)
    wanted = truth(name)[:, states]
    return float(np.abs(found[:, states] - wanted).max() / np.abs(wanted).max())


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", BLOCKS)
def test_a_finer_tolerance_gives_a_smaller_error(name: str, version: str) -> None:
    tolerances = 1e-5 / 2.0 ** (4 * np.arange(4))
    errors = [error(name, run(name, version, relative_tolerance=float(t))) for t in tolerances]
    assert (errors <= tolerances).all()
    if block_of(name).automatic_steps(STEP).explicit:
        np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 4, atol=0.1)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", BLOCKS)
def test_what_the_master_states_counts_unless_the_parameter_is_set(name: str, version: str) -> None:
    automatic, fine = run(name, version), run(name, version, relative_tolerance=1e-7)
    assert not np.array_equal(automatic, fine)
    np.testing.assert_array_equal(run(name, version, stated=1e-7), fine)
    np.testing.assert_array_equal(run(name, version, stated=1e-9, relative_tolerance=1e-7), fine)
    np.testing.assert_array_equal(run(name, version, stated=1e-7, relative_tolerance=0.0), fine)
    for coarse in (1e-5, 1e-3):  # never coarser than the rule, which keeps explicit steps stable
        np.testing.assert_array_equal(run(name, version, stated=coarse), automatic)
        np.testing.assert_array_equal(run(name, version, relative_tolerance=coarse), automatic)


@pytest.mark.parametrize("name", BLOCKS)
def test_substeps_override_the_tolerance(name: str) -> None:
    np.testing.assert_array_equal(run(name, substeps=8, relative_tolerance=1e-9), run(name, substeps=8))


@pytest.mark.parametrize("name", ["pendulum", "steep scara"])
def test_the_automatic_steps_are_those_of_the_rule(name: str) -> None:
    count = block_of(name).automatic_steps(STEP).count
    np.testing.assert_array_equal(run(name, substeps=count), run(name))
    np.testing.assert_array_equal(run(name, substeps=2 * count), run(name, relative_tolerance=0.9e-5))


def test_where_nothing_is_steep_rk4_takes_fewer_steps_and_errs_less() -> None:
    """A stated number is one of linearly implicit steps, whatever the values of the parameters."""
    block = block_of("scara")
    steps, implicit = block.automatic_steps(STEP), block.automatic_substeps(STEP)
    assert steps.explicit and 2 * steps.count <= implicit
    assert error("scara", run("scara")) < error("scara", run("scara", substeps=implicit))
    assert not block_of("steep scara").automatic_steps(STEP).explicit


@pytest.mark.parametrize("tolerance", [-1e-6, 1e-13, float("nan"), float("inf")])
@pytest.mark.parametrize("version", VERSIONS)
def test_tolerances_that_mean_nothing_are_refused(
    tolerance: float, version: str, capfd: pytest.CaptureFixture[str]
) -> None:
    for how in ({"relative_tolerance": tolerance}, {"stated": tolerance}):
        with pytest.raises(fmpy.fmi1.FMICallException):
            run("pendulum", version, **how)  # type: ignore[arg-type]
        assert "valid: 0 (automatic) and numbers from 1e-12" in capfd.readouterr().out


@pytest.mark.parametrize("version", VERSIONS)
def test_an_imported_fmu_has_it_as_an_option(version: str) -> None:
    """No parameter of the plant: nobody wants to identify it."""
    block = block_of("scara")
    made = load_fmu(build_fmu(block, fmi_version=version))
    assert [v.name for v in made.parameters] == [v.name for v in block.parameters]
    fine = made.with_parameters({"relative_tolerance": 1e-7})
    torque = np.tile(BLOCKS["scara"], (STEPS + 1, 1))
    wanted = run("scara", version, stated=1e-7)
    # FMPy's steps end at times that are rounded otherwise.
    np.testing.assert_allclose(drive(fine, torque, STEP), wanted, rtol=0, atol=1e-13)
    instance: Any = fine.instantiate()
    assert instance.restart(made)
    instance.close()
    automatic = run("scara", version)
    np.testing.assert_allclose(drive(made, torque, STEP), automatic, rtol=0, atol=1e-13)
    assert np.abs(automatic - wanted).max() > 1e-8
    with pytest.raises(InputError, match=r"relative_tolerance[\s\S]*valid: a number"):
        made.with_options({"relative_tolerance": "fine"})
    # Its equations are integrated as the rule says, so they do not stand for an FMU that is finer.
    known = made.built_from(block)
    assert known.equations() is not None
    assert known.with_options({"relative_tolerance": 1e-7}).equations() is None
    assert known.with_options({"relative_tolerance": 1e-7, "substeps": 64}).equations() is not None


def test_sampled_blocks_have_none() -> None:
    description = fmpy.read_model_description(str(build_fmu(controller())))
    assert not {"substeps", "relative_tolerance"} & {v.name for v in description.modelVariables}
