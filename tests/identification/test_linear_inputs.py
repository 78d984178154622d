"""Recorded inputs that are linear between their rows: the same answer in model exchange and in co-simulation."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import identify, load_case
from fmu_didim.components.fmu import FmuComponent
from fmu_didim.export import build_fmu
from tests.cosim.test_exchange import RATE, exact, lag, zigzag
from tests.foreign import exported

NOISE = 0.01


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An FMU of a lag, its inputs and its output with noise."""
    shutil.copy(build_fmu(lag()), tmp_path / "lag.fmu")
    shutil.copy(exported(tmp_path / "of_another_tool", lag()), tmp_path / "of_another_tool.fmu")
    inputs = zigzag(200)
    y = exact(inputs, ramps=True) + NOISE * np.random.default_rng(5).normal(size=200)
    for name, column, values in (("inputs", "u", inputs.values[:, 0]), ("outputs", "y", y)):
        table = np.column_stack([inputs.time, values])
        np.savetxt(tmp_path / f"{name}.csv", table, delimiter=",", header=f"t,{column}", comments="", fmt="%.12g")
    return tmp_path


def content(interface: str, **more: object) -> dict[str, object]:
    return {
        "schema": 1, "name": "lag", "model": {"source": "lag.fmu", "interface": interface}, "inputs": "inputs.csv",
        "measured": "outputs.csv", "identify": {"a": {"start": 1.2 * RATE}}, **more,
    }  # fmt: skip


@pytest.mark.gate
def test_both_interfaces_give_the_same_answer(folder: Path) -> None:
    found = {
        kind: identify(load_case(content(kind), folder=folder)) for kind in ("model-exchange", "co-simulation")
    }  # fmt: skip
    exchange, co_simulation = (found[kind].parameters["a"] for kind in ("model-exchange", "co-simulation"))
    assert exchange.value == pytest.approx(RATE, abs=4 * exchange.std)
    assert co_simulation.value == pytest.approx(exchange.value, abs=0.03 * exchange.std)
    assert co_simulation.std == pytest.approx(exchange.std, rel=0.01)
    told = " ".join(found["co-simulation"].document.remarks)
    assert "Steps are divided into" in told and "linear inputs are held" in told
    assert "divided" not in " ".join(found["model-exchange"].document.remarks)


@pytest.mark.parametrize(
    ("model", "kind", "told"),
    [
        ("of_another_tool.fmu", "model-exchange", True),
        ("lag.fmu", "co-simulation", False),
        ({"source": "lag.fmu", "solver": "rk4"}, "model-exchange", True),
        ({"source": "lag.fmu", "interface": "model-exchange"}, "model-exchange", False),
        ({"source": "lag.fmu", "interface": "co-simulation"}, "co-simulation", False),
    ],
)
def test_an_fmu_with_both_interfaces_is_integrated_here_and_that_is_said(
    folder: Path, model: object, kind: str, told: bool
) -> None:
    run = {"inputs": "inputs.csv", "measured": "outputs.csv"}
    runs = {"one": run, "two": {**run, "role": "validation"}}
    entries = {name: value for name, value in content("").items() if name not in ("inputs", "measured")}
    case = load_case({**entries, "model": model, "experiments": runs}, folder=folder)
    assert isinstance(case.plant, FmuComponent) and case.plant.interface.kind == kind
    found = [d for e in case.model.experiments.values() for d in e.told if d.code.name == "exchange-chosen"]
    assert len(found) == told  # once, whatever the number of experiments
    assert all(f"by {'RK4' if 'rk4' in str(model) else 'CVode'};" in d.text for d in found)


def test_held_inputs_are_not_divided(folder: Path) -> None:
    case = load_case(content("co-simulation", inputs={"file": "inputs.csv", "interpolation": "held"}), folder=folder)
    assert not case.model.loop.holds_ramps and case.model.twice_as_fine() is None
    held, linear = (exact(zigzag(200), ramps=ramps) for ramps in (False, True))
    simulated = case.model.with_values(np.array([RATE])).torque(np.array([RATE]))[:, 0]
    assert np.abs(simulated - held).max() < 1e-4 < np.abs(held - linear).max()


def test_steps_are_halved_to_a_limit(folder: Path) -> None:
    model, counts = load_case(content("co-simulation"), folder=folder).model, []
    errors, wanted = [], exact(zigzag(200), ramps=True)
    while model is not None:
        counts.append(model.loop.subdivision)
        errors.append(np.abs(model.torque(np.array([RATE]))[:, 0] - wanted).max())
        model = model.twice_as_fine()
    assert counts == [1, 2, 4, 8, 16, 32, 64]
    ratios = np.array(errors[:4]) / np.array(errors[1:5])
    np.testing.assert_allclose(ratios, 4.0, rtol=0.1)  # the error falls with the square of the step


@pytest.mark.parametrize("interface", ["model-exchange", "co-simulation"])
@pytest.mark.parametrize("first", ["linear", "held"])
def test_each_experiment_has_its_own_interpolation(folder: Path, interface: str, first: str) -> None:
    """A zigzag at a row a step: what one experiment holds differs from what goes straight in the other."""
    kinds = {"one": first, "two": "held" if first == "linear" else "linear"}
    runs = {
        label: {"inputs": {"file": "inputs.csv", "interpolation": kind}, "measured": "outputs.csv"}
        for label, kind in kinds.items()
    }  # fmt: skip
    document = {k: v for k, v in content(interface).items() if k not in ("inputs", "measured")}
    model = load_case({**document, "experiments": runs}, folder=folder).model
    assert model.loop.holds_ramps == (interface == "co-simulation")
    for _ in range(4):
        model = model.twice_as_fine() or model
    for label, kind in kinds.items():
        got = model.torque(np.array([RATE]), label)[:, 0]
        assert np.abs(got - exact(zigzag(200), ramps=kind == "linear")).max() < 1e-3
