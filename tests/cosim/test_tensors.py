"""Arrays of FMI 3.0 with one to three dimensions in the loop, in ``fmu check`` and in SSP, beside FMPy by hand."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Slave

from fmu_didim.cli.main import main
from fmu_didim.components import load_fmu
from fmu_didim.components.fmu import probe_fmu
from fmu_didim.cosim import Connection, System, simulate
from fmu_didim.data.signals import trajectory
from fmu_didim.ssp import read_ssp, write_ssp
from tests.awkward.build import TENSORS, library, pack

STEP, TICKS = 0.01, 60
SHAPES = {"u": (2,), "V": (2, 3), "S": (2, 2, 3), "a": (2,), "B": (2, 3), "T": (2, 2, 3)} | {
    "y": (2,), "Y": (2, 3), "Z": (2, 2, 3)
}  # fmt: skip
REFERENCES = {name: number for number, name in enumerate(SHAPES)}
ONE = {"a[2]": 5.0, "B[1,3]": -0.5, "B[2,1]": 0.25, "T[1,2,3]": 1.5, "T[2,1,1]": -2.0, "T[2,2,2]": 0.125}
TWO = {"a[1]": 3.0, "B[2,3]": 0.75, "T[1,1,2]": -1.0, "T[2,2,3]": 0.5}
"""By element, parameters that the first and the second one get."""


def names(array: str) -> list[str]:
    """Its elements as they are stored, the last index first to change."""
    every = product(*(range(1, size + 1) for size in SHAPES[array]))
    return [f"{array}[{','.join(map(str, index))}]" for index in every]


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return pack(tmp_path_factory.mktemp("fmu") / "tensors.fmu", TENSORS, library("tensors"))


WIRES = (
    ("second.y[1]", "first.u[1]", -0.5), ("reference.r", "first.u[2]", 2.0),
    *(("reference.r" if k % 2 else "second.y[2]", f"first.{e}", 0.1 * k - 0.3) for k, e in enumerate(names("V"))),
    *(("reference.s", f"first.{e}", 0.2 - 0.05 * k) for k, e in enumerate(names("S"))),
    *(
        (f"first.{source}", f"second.{target}", 1.0 + 0.01 * k)
        for k, (source, target) in enumerate(
            zip(
                [*names("Z")[3:5], *reversed(names("Y")), *reversed(names("Z"))],
                [*names("u"), *names("V"), *names("S")],
                strict=True,
            )
        )
    ),
)  # fmt: skip
"""Source, input, gain: the second one feeds its states back, and takes elements of arrays in another order."""


def system_of(fmu: Path, *, isolated: bool) -> System:
    made = load_fmu(fmu, isolated=isolated)
    parts = {"first": made.with_parameters(ONE), "second": made.with_parameters(TWO)}
    return System(parts, tuple(Connection(*wire) for wire in WIRES), ("first", "second"), STEP)


def given() -> tuple[np.ndarray, np.ndarray]:
    t = STEP * np.arange(TICKS)
    return np.sin(7 * t) + 0.2, np.cos(3 * t) * t


class ByHand:
    """FMPy's instance, with arrays as they are."""

    def __init__(self, fmu: Path, folder: Path, name: str, changed: dict[str, float]) -> None:
        token = fmpy.read_model_description(str(fmu)).guid
        fmpy.extract(str(fmu), unzipdir=str(folder / name))
        self.fmu = FMU3Slave(
            guid=token, unzipDirectory=str(folder / name), modelIdentifier="tensors", instanceName=name
        )
        self.fmu.instantiate()
        self.fmu.enterInitializationMode()
        for array in "aBT":
            values = np.arange(1.0, np.prod(SHAPES[array]) + 1)
            for k, element in enumerate(names(array)):
                values[k] = changed.get(element, values[k])
            self.set(array, values)

    def set(self, array: str, values: np.ndarray) -> None:
        self.fmu.setFloat64([REFERENCES[array]], list(values))

    def get(self, array: str) -> np.ndarray:
        return np.array(self.fmu.getFloat64([REFERENCES[array]], nValues=int(np.prod(SHAPES[array]))))


def by_fmpy(fmu: Path, folder: Path) -> dict[str, np.ndarray]:
    """Outputs of both at the ticks: the inputs of the first, its outputs, those of the second, then a step of both."""
    parts = {"first": ByHand(fmu, folder, "first", ONE), "second": ByHand(fmu, folder, "second", TWO)}
    r, s = given()
    found: dict[str, list[float]] = {f"{part}.{e}": [] for part in parts for a in ("y", "Y", "Z") for e in names(a)}
    now: dict[str, float] = {}

    def read(part: str, *arrays: str) -> None:
        for array in arrays:
            now.update(zip((f"{part}.{e}" for e in names(array)), parts[part].get(array), strict=True))

    for k in range(TICKS):
        now.update({"reference.r": r[k], "reference.s": s[k]})
        read("second", "y")
        for name, part in parts.items():
            into = {target: gain * now[source] for source, target, gain in WIRES if target.startswith(f"{name}.")}
            for array in ("u", "V", "S"):
                part.set(array, np.array([into[f"{name}.{e}"] for e in names(array)]))
            if k == 0:
                part.fmu.exitInitializationMode()
            read(name, "y", "Y", "Z")
        for key, column in found.items():
            column.append(float(now[key]))
        for part in parts.values():
            part.fmu.doStep(k * STEP, STEP)
    for part in parts.values():
        part.fmu.freeInstance()
    return {key: np.array(column) for key, column in found.items()}


@pytest.mark.parametrize("isolated", [False, pytest.param(True, marks=pytest.mark.gate)])
def test_the_loop_is_that_of_fmpy(fmu: Path, tmp_path: Path, isolated: bool) -> None:
    wanted, system = by_fmpy(fmu, tmp_path), system_of(fmu, isolated=isolated)
    r, s = given()
    motion = trajectory(STEP * np.arange(TICKS), {"r": r, "s": s})
    assert any(np.ptp(column) > 1.0 for column in wanted.values())
    for compiled in (True, False):
        found = simulate(system, motion, compiled=compiled).applied
        for name, column in wanted.items():
            np.testing.assert_allclose(found[name], column, rtol=1e-12, atol=1e-13, err_msg=f"{name}, {compiled}")


@pytest.mark.parametrize("isolated", [False, pytest.param(True, marks=pytest.mark.gate)])
def test_an_archive_holds_the_same_loop(fmu: Path, tmp_path: Path, isolated: bool) -> None:
    system = system_of(fmu, isolated=isolated)
    r, s = given()
    motion = trajectory(STEP * np.arange(TICKS), {"r": r, "s": s})
    again = read_ssp(write_ssp(system, tmp_path / "x.ssp", name="tensors"))
    wanted, found = (simulate(loop, motion).applied for loop in (system, again))
    for name in wanted:
        np.testing.assert_array_equal(found[name], wanted[name], err_msg=name)


@pytest.mark.gate
def test_fmu_check_tries_every_element(fmu: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Outputs that follow at once are those whose array does, and each element of each parameter acts."""
    found = probe_fmu(load_fmu(fmu))
    assert not found.facts.failure and not found.undeclared
    when = {"y": "after a step", "Y": "at once", "Z": "at once"}
    assert found.response == {element: when[array] for array in when for element in names(array)}
    assert found.parameters == {element: "acts" for array in "aBT" for element in names(array)}
    assert found.tunable == dict.fromkeys(names("a"), "acts")
    assert main(["fmu", "check", str(fmu)]) == 0
    told = capsys.readouterr().out
    assert f"parameters that act: {', '.join([*names('a'), *names('B'), *names('T')])}" in " ".join(told.split())
