"""Directional derivatives that an FMU gives are used where differences show the same."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.base.errors import SimulationError
from fmu_didim.case import load_case
from fmu_didim.components.base import Instance
from fmu_didim.components.fmu import load_fmu
from fmu_didim.components.fmu.versions.fmi2 import Binding2
from fmu_didim.data.signals import Array
from tests.cases import ENTRIES, TRUTH
from tests.components.fmu.helpers import exported
from tests.helpers import begin
from tests.model.test_numerical_regressor import probed_case

Answer = Callable[[int, Array], None]
"""What is done to d unknowns / d known of the first, second, ... call."""
OUTPUTS, INPUTS, VALUES = [4, 5], [0, 1], {"ZZ1": 3.43, "Fv1": 0.03}


@pytest.fixture
def answer(monkeypatch: pytest.MonkeyPatch) -> Callable[[Answer], list[int]]:
    """Lets FMUs answer otherwise; gives the list of what was asked for."""

    def changed(how: Answer) -> list[int]:
        asked: list[int] = []
        true = Binding2.directional_derivative

        def other(self: Binding2, unknowns: Sequence[int], known: int, result: Array) -> None:
            asked.append(known)
            true(self, unknowns, known, result)
            how(known, result)

        monkeypatch.setattr(Binding2, "directional_derivative", other)
        return asked

    return changed


def running(**options: bool) -> tuple[Instance, int]:
    """The SCARA, moving, and the reference of its viscous friction."""
    component = load_fmu(exported("scara", "2.0"), **options)
    instance = component.instantiate()
    begin(instance, np.array([1.0, 0.2]))
    instance.step(0.0, 0.1)
    instance.get()
    return instance, component.references["Fv1"]


def asked_of(instance: Instance) -> Array:
    return np.hstack(instance.derivatives(OUTPUTS, INPUTS, VALUES))


def test_those_of_an_fmu_are_what_differences_show(answer: Callable[[Answer], list[int]]) -> None:
    asked = answer(lambda known, result: None)
    found = asked_of(running()[0])
    assert len(asked) == 4
    without = asked_of(running(directional_derivatives=False)[0])
    assert len(asked) == 4, "it was asked all the same"
    np.testing.assert_allclose(found, without, rtol=1e-7, atol=1e-9)
    assert np.abs(found).min(axis=0).all()


@pytest.mark.parametrize("factor", [0.0, 0.5, -1.0, np.nan])
def test_differences_take_the_place_of_wrong_ones(answer: Callable[[Answer], list[int]], factor: float) -> None:
    wanted = asked_of(running(directional_derivatives=False)[0])
    instance, friction = running()
    asked = answer(lambda known, result: result.__imul__(factor if known == friction else 1.0))
    for _ in range(3):
        np.testing.assert_allclose(asked_of(instance), wanted, rtol=1e-6, atol=1e-9)
    assert len(asked) == 4, "it was asked again"


def test_differences_take_the_place_of_refused_ones(answer: Callable[[Answer], list[int]]) -> None:
    wanted = asked_of(running(directional_derivatives=False)[0])
    instance, friction = running()

    def refused(known: int, result: Array) -> None:
        if known == friction:
            raise SimulationError("not by parameters", next_step="none")

    answer(refused)
    np.testing.assert_allclose(asked_of(instance), wanted, rtol=1e-9)


def test_those_that_are_wrong_only_later_are_told(answer: Callable[[Answer], list[int]]) -> None:
    instance, friction = running()
    calls: list[int] = []

    def later(known: int, result: Array) -> None:
        calls.append(known)
        if len(calls) > 8 and known == friction:
            result *= 2

    answer(later)
    asked_of(instance)
    asked_of(instance)
    with pytest.raises(SimulationError, match=r"by Fv1\n(.|\n)*directional_derivatives: false"):
        asked_of(instance)


@pytest.mark.gate
@pytest.mark.parametrize("factor", [0.0, 0.5])
def test_an_identification_beside_wrong_ones_is_right(
    tmp_path: Path, answer: Callable[[Answer], list[int]], factor: float
) -> None:
    """A column of zeros was refused as "no effect while the plant runs"; half of it moves didim before its finish."""
    path = probed_case(tmp_path, ENTRIES)
    reference = load_case(path).model.loop.plant.references["Fc1"]
    answer(lambda known, result: result.__imul__(factor if known == reference else 1.0))
    found = identify(path).estimate
    assert (np.abs(found.value - TRUTH) <= 3.5 * found.standard_deviation).all()
    expected = identify("examples/scara/identify.yaml").estimate
    np.testing.assert_allclose(found.standard_deviation, expected.standard_deviation, rtol=1e-3)
