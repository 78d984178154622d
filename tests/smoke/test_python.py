"""From Python: each kind of component, each estimator, frames and figures, a cluster."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import identify, load_case, simulate, study
from fmu_didim.components import Component, load_fmu
from fmu_didim.data.signals import write_csv
from fmu_didim.estimators import ESTIMATORS
from fmu_didim.export import build_fmu
from fmu_didim.export.versions import VERSIONS
from tests.helpers import KINDS, PERIOD, ROOT, component, drive, scara_cascade, scara_pd

pytestmark = pytest.mark.smoke
CASE = ROOT / "examples/scara/identify.yaml"
BLOCKS = {"with states": scara_cascade, "without states": scara_pd}


def parts(name: str) -> dict[str, Component]:
    """One block as each kind of component, and as the FMU of each version that is written."""
    block = BLOCKS[name]()
    made = {kind: component(kind, block) for kind in KINDS if kind != "fmu"}
    return made | {f"FMI {version}": load_fmu(build_fmu(block, fmi_version=version)) for version in VERSIONS}


@pytest.mark.parametrize("name", BLOCKS)
def test_kinds_of_components_compute_the_same(name: str) -> None:
    made = parts(name)
    assert len(made) == len(KINDS) - 1 + len(VERSIONS)
    t = np.arange(40)[:, None] * PERIOD
    inputs = np.sin(7 * t + np.arange(len(made["model"].inputs)))
    wanted = drive(made["model"], inputs, PERIOD)
    assert np.ptp(wanted, axis=0).min() > 1e-5
    for kind, part in made.items():
        np.testing.assert_allclose(
            drive(part, inputs, PERIOD), wanted, rtol=0, atol=1e-11 * np.abs(wanted).max(), err_msg=kind
        )


@pytest.mark.parametrize("kind", ESTIMATORS)
def test_estimator(kind: str, tmp_path: Path) -> None:
    """From the truth and with positions, so that those run through, too, that need a good start or more than torque."""
    content = yaml.safe_load(CASE.read_text(encoding="utf-8"))
    content["estimator"] = {"kind": kind} | ({"cutoff_hz": 20, "decimation": 4} if kind.startswith("idim") else {})
    content["plant"] = {"kind": "model"}
    content["controller"]["kind"] = "model"
    log = {"file": str(tmp_path / "loop.csv")}
    write_csv(simulate(CASE), tmp_path / "loop.csv")
    content["train"] |= {"torque": log, "positions": log}
    del content["validation"]
    found = identify(load_case(content, folder=CASE.parent))
    assert found.values["ZZ1R"] == pytest.approx(3.43, rel=0.05)


def test_frame_figure_and_page() -> None:
    found = identify(CASE)
    assert list(found.to_frame().index) == list(found.estimate.names)
    assert len(found.plot().axes) == 4  # torque and residual of two joints
    assert "ZZ1R" in found._repr_html_()


def test_results_of_a_campaign(tmp_path: Path) -> None:
    case, varied = CASE.with_name("identify_200hz.yaml"), {"train.torque.rate_hz": [20, 10]}
    found = study(case, out=tmp_path / "runs", name="smoke", vary=varied, noise={"relative": 0.05})
    results = found.run(workers=1)
    assert list(results.to_frame()["verdict"]) == ["valid"] * 2
    assert results.plot().axes[0].lines
