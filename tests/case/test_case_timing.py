"""Rates, delays and treatments of loops as a case file asks for them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.case.build import load_case
from fmu_didim.controllers import read_controller
from fmu_didim.cosim import Recording, simulate
from fmu_didim.export import build_fmu
from tests.awkward.build import by
from tests.helpers import ROOT


def recorded(tmp_path: Path, change: Any) -> tuple[Any, Recording]:
    """The shipped example with a change of its document, simulated."""
    source = ROOT / "examples/scara/identify.yaml"
    document = yaml.safe_load(source.read_text())
    document["robot"] = str((source.parent / document["robot"]).resolve())
    document["controller"]["source"] = str((source.parent / document["controller"]["source"]).resolve())
    for key in ("train", "validation"):
        for part in document.get(key, {}).values():
            if isinstance(part, dict) and "file" in part:
                part["file"] = str((source.parent / part["file"]).resolve())
    change(document)
    path = tmp_path / "case.yaml"
    path.write_text(yaml.safe_dump(document))
    case = load_case(path, require_torque=False)
    reference = case.reference("estimation")
    system = case.system("estimation", reference)
    return system, simulate(system, reference, ticks=np.arange(0, 400, 4))


def test_a_delay_in_seconds_is_one_in_samples(tmp_path: Path) -> None:
    runs = []
    for option in ({"delay_s": 0.0075}, {"delay_samples": 1.5}):

        def change(document: Any, option: dict[str, float] = option) -> None:
            document.setdefault("loop", {}).update(option)

        system, run = recorded(tmp_path, change)
        assert system.delays["plant"] == pytest.approx(1.5, rel=1e-12)
        runs.append(run.applied["plant.q1"])
    np.testing.assert_allclose(runs[0], runs[1], rtol=0, atol=1e-12)


def test_a_component_may_have_its_own_rate(tmp_path: Path) -> None:
    def slow(document: Any) -> None:
        document["controller"]["rate_hz"] = 100.0
        document.setdefault("loop", {})["rate_hz"] = 200.0

    def fast(document: Any) -> None:
        document["plant"] = {"kind": "fmu", "rate_hz": 1000.0}

    system, run = recorded(tmp_path, slow)
    assert (dict(system.every), system.step_size) == ({"controller": 2}, 0.005)
    assert run.compiled
    system, _ = recorded(tmp_path, fast)
    assert dict(system.substeps) == {"plant": 5}


def test_outputs_after_the_step_and_loops_are_declared(tmp_path: Path) -> None:
    def change(document: Any) -> None:
        document["controller"]["outputs_after_step"] = True
        document.setdefault("loop", {})["algebraic_loops"] = "iterate"

    system, _ = recorded(tmp_path, change)
    assert system.after_step == {"controller"}
    assert system.describe()["outputs_after_step"] == ["controller"]
    assert system.describe()["algebraic_loops"] == "iterate"


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        ("rate_hz", 130.0, "whole multiple or divisor"),
        ("rate_hz", 0.0, "greater than 0"),
        ("outputs_after_step", "perhaps", "true or false"),
    ],
)
def test_wrong_timing_is_refused(tmp_path: Path, key: str, value: Any, problem: str) -> None:
    with pytest.raises(FmuDidimError, match=problem):
        recorded(tmp_path, lambda d: d.update(controller={**d["controller"], key: value}, loop={"rate_hz": 200}))


def test_two_delays_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FmuDidimError, match="not both"):
        recorded(tmp_path, lambda d: d.setdefault("loop", {}).update(delay_s=0.01, delay_samples=1))


@pytest.mark.parametrize("tool", ["", "Vendor 1.0"])
def test_the_rate_of_a_controller_that_was_exported_here_is_known(tmp_path: Path, tool: str) -> None:
    """What the FMU of another tool says of its default experiment is a suggestion, which the message repeats."""
    law = build_fmu(read_controller(ROOT / "controllers/scara_pd.yaml"), directory=tmp_path)
    law = by(tool, law) if tool else law

    def change(document: Any) -> None:
        document["controller"] = {"kind": "fmu", "source": str(law)}

    if not tool:
        assert recorded(tmp_path, change)[0].step_size == 0.005
        return
    with pytest.raises(FmuDidimError, match="200 Hz that the FMU suggests") as caught:
        recorded(tmp_path, change)
    assert "loop: {rate_hz: 200}" in str(caught.value)
