"""FMUs whose own solver has a fixed step are not stepped within it: they would act on inputs at other instants."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.components.fmu.component import own_step
from fmu_didim.components.fmu.load import load_fmu
from fmu_didim.components.fmu.reading import read_description
from fmu_didim.data.signals import Array
from fmu_didim.export import build_fmu
from fmu_didim.workflow.output.result import Result
from tests.awkward.build import awkward_fmu
from tests.cosim.test_exchange import lag
from tests.room import room_fmu

STATED, UNSTATED = ' stepSize="0.01"', ""


def driven(time: Array) -> Array:
    return np.asarray(np.sin(2 * np.pi * 0.5 * time) + 0.5 * np.sin(2 * np.pi * 1.3 * time + 1))


def answered(time: Array, a: float = 2.0) -> Array:
    """x of x' = -a x + u, exact but for 1e-6, where u goes straight from row to row."""
    fine = np.linspace(time[0], time[-1], 100 * (time.size - 1) + 1)
    u, step, x = np.interp(fine, time, driven(time)), float(fine[1] - fine[0]), [0.0]
    for k in range(fine.size - 1):
        x.append(x[-1] * np.exp(-a * step) + (u[k] + u[k + 1]) / 2 * (1 - np.exp(-a * step)) / a)
    return np.array(x)[::100]


def identified(folder: Path, fmu: Path, step: float, *, noise: float = 0.02, seed: int = 0) -> Result:
    import yaml

    time = step * np.arange(round(10 / step) + 1)
    log = answered(time) + 0.5 * driven(time) + noise * np.random.default_rng(seed).normal(size=time.size)
    for name, head, values in (("u.csv", "t,u", driven(time)), ("y.csv", "t,y", log)):
        np.savetxt(folder / name, np.column_stack([time, values]), delimiter=",", header=head, comments="", fmt="%.9f")
    case: dict[str, Any] = {
        "schema": 1, "name": "own steps", "model": str(fmu), "inputs": "u.csv", "measured": "y.csv",
        "identify": {"a": {"start": 1.5}, "d": {"start": 0.4}},
    }  # fmt: skip
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    return identify(folder / "case.yaml")


@pytest.mark.gate
@pytest.mark.parametrize("step", [0.05, 0.01])
@pytest.mark.parametrize("stated", [STATED, UNSTATED])
def test_it_is_not_stepped_within_its_own_step(tmp_path: Path, stated: str, step: float) -> None:
    found = identified(tmp_path, awkward_fmu(tmp_path, "OWN_STEPS", step=stated), step)
    loop = found.estimate.fit.model.loop  # type: ignore[union-attr]
    assert step / loop.subdivision * (1 + 1e-9) >= 0.01
    for name, true in (("a", 2.0), ("d", 0.5)):
        assert abs(found.parameters[name].value - true) < 3 * found.parameters[name].std, (name, found.parameters)


def test_that_is_told(tmp_path: Path) -> None:
    """With so little noise the values were off by four standard deviations, and valid."""
    found = identified(tmp_path, awkward_fmu(tmp_path, "OWN_STEPS"), 0.05, noise=0.001)
    for name, true in (("a", 2.0), ("d", 0.5)):
        assert abs(found.parameters[name].value - true) < 3 * found.parameters[name].std
    assert any("own solver has a fixed step" in remark for remark in found.document.remarks), found.document.remarks


def test_the_step_that_a_file_states(tmp_path: Path) -> None:
    assert own_step(load_fmu(awkward_fmu(tmp_path))) == 0.01
    assert own_step(load_fmu(awkward_fmu(tmp_path, step=UNSTATED))) is None
    assert own_step(load_fmu(room_fmu())) is None  # whose steps are ours


@pytest.mark.parametrize(("text", "step"), [("0.02", 0.02), ("0", None), ("soon", None), ("-1", None), ("inf", None)])
def test_the_fixed_step_of_fmi_3(tmp_path: Path, text: str, step: float | None) -> None:
    copy = tmp_path / "fixed.fmu"
    with zipfile.ZipFile(build_fmu(lag(), fmi_version="3.0")) as old, zipfile.ZipFile(copy, "w") as new:
        for item in old.infolist():
            content = old.read(item)
            if item.filename == "modelDescription.xml":
                content = content.replace(b"<CoSimulation ", f'<CoSimulation fixedInternalStepSize="{text}" '.encode())
            new.writestr(item, content)
    interface = read_description(copy).interface("co-simulation")
    assert interface is not None and interface.own_step == step
