"""FMI 1.0 co-simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_didim.base.errors import FmuError, SimulationError, UnknownNameError
from fmu_didim.cli.main import main
from fmu_didim.components.fmu import load_fmu, probe_fmu, read_description
from fmu_didim.cosim import Connection, InstancePool, System, simulate
from fmu_didim.data.signals import trajectory
from tests.awkward.versions import fmi_1
from tests.components.fmu.helpers import H, slave_outputs
from tests.helpers import begin, drive

U = np.random.default_rng(5).normal(size=(30, 1))


def test_description_of_fmi_1(tmp_path: Path) -> None:
    found = read_description(fmi_1(tmp_path))
    assert (found.version, found.major, found.token) == ("1.0", 1, "awkward")
    (interface,) = found.interfaces
    assert (interface.kind, interface.identifier, interface.has_variable_step) == ("co-simulation", "slave1", True)
    made = load_fmu(found.path)
    assert [v.name for v in made.inputs] == ["u"]
    assert [v.name for v in made.outputs] == ["y", "minus_y", "steps"]
    assert made.parameter_values() == {"a": 2.0, "d": 0.5}
    assert made.feedthrough() == {("y", "u"), ("minus_y", "u")}
    with pytest.raises(UnknownNameError):
        made.with_parameters({"y": 1.0})


@pytest.mark.parametrize("isolated", [False, True])
def test_fmi_1_computes_the_same(tmp_path: Path, isolated: bool) -> None:
    made = load_fmu(fmi_1(tmp_path), isolated=isolated)
    wanted = slave_outputs(U)
    got = drive(made, U, H)
    np.testing.assert_allclose(got[:, :2], np.column_stack([wanted, -wanted]), rtol=1e-13)
    np.testing.assert_array_equal(got[:, 2], np.arange(len(U)))
    changed = made.with_parameters({"a": 1.0, "n": 2, "flip": True})
    np.testing.assert_allclose(drive(changed, U, H)[:, :1], -2 * slave_outputs(U, a=1.0), rtol=1e-13)


def test_units_of_fmi_1(tmp_path: Path) -> None:
    made = load_fmu(fmi_1(tmp_path, u_unit=' unit="deg"'))
    assert made.inputs[0].unit == "rad"
    np.testing.assert_allclose(drive(made, np.radians(U), H)[:, :1], slave_outputs(U), rtol=1e-13)


def test_what_fmi_1_cannot_do(tmp_path: Path) -> None:
    made = load_fmu(fmi_1(tmp_path))
    instance = made.instantiate()
    begin(instance, np.zeros(1))
    with pytest.raises(SimulationError, match="cannot save its state"):
        instance.save_state()
    with pytest.raises(SimulationError, match="fixed parameter"):
        instance.set_parameters({"a": 1.0})
    assert instance.native() is None
    instance.close()
    with pytest.raises(FmuError, match=r"not supported[\s\S]*1\.0, model exchange only"):
        load_fmu(fmi_1(tmp_path, implementation=""))


@pytest.mark.gate
@pytest.mark.parametrize(("macros", "strategy"), [((), "reset"), (("RESET_KEEPS_STATE",), "re-instantiate")])
def test_fmi_1_is_run_again(tmp_path: Path, macros: tuple[str, ...], strategy: str) -> None:
    made = load_fmu(fmi_1(tmp_path, *macros))
    found = probe_fmu(made, step_size=H)
    assert (found.rerun.strategy, found.facts.failure) == (strategy, "")
    assert found.parameters == {"a": "acts", "d": "acts"}
    instance = made.with_parameters({"a": 5.0}).instantiate()
    begin(instance, np.zeros(1))
    assert instance.restart(made) == (strategy == "reset")
    if strategy == "reset":
        instance.begin_initialisation(0.0)
        instance.end_initialisation()
        instance.step(0.0, H)
    instance.close()


@pytest.mark.gate
def test_fmi_1_in_the_loop(tmp_path: Path) -> None:
    """Two slaves of FMI 1.0 in a row; the second one sees the first at the same tick. Then again with another value."""
    made = load_fmu(fmi_1(tmp_path))
    motion = trajectory(np.arange(len(U)) * H, {"r": U[:, 0]})
    pool = InstancePool()
    for a in (2.0, 1.0, 2.0):
        system = System(
            components={"first": made.with_parameters({"a": a}), "second": made.with_parameters({"d": 0.1})},
            connections=(Connection("reference.r", "first.u"), Connection("first.minus_y", "second.u")),
            order=("first", "second"),
            step_size=H,
        )
        recording = simulate(system, motion, pool=pool)
        middle = slave_outputs(U, a=a)
        wanted = np.column_stack([middle, slave_outputs(-middle, d=0.1)])
        np.testing.assert_allclose(recording.table(["first.y", "second.y"]), wanted, rtol=0, atol=1e-13)
    pool.close()


@pytest.mark.gate
def test_info_and_check_of_fmi_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(fmi_1(tmp_path))
    assert main(["fmu", "info", path]) == 0
    text = capsys.readouterr().out
    assert "FMI 1.0" in text and "words" in text and "(not offered)" in text
    assert main(["fmu", "check", path, "--step", "0.01"]) == 0
    assert "parameters that act: a, d" in capsys.readouterr().out
