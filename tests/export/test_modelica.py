"""Modelica files as FMUs, and what is said where there is no compiler for them."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.base.errors import BuildError, InputError
from fmu_didim.cli.main import main
from fmu_didim.components import load_fmu
from fmu_didim.export import build_modelica, modelica
from tests.conftest import package
from tests.helpers import ROOT, drive

LAG = """model Lag "T dy/dt = u - y"
  parameter Real T = 0.1;
  input Real u;
  output Real y;
  Real x(start = 0);
equation
  T*der(x) = u - x;
  y = x;
end Lag;
"""


def test_a_model_is_the_equation_that_it_says(tmp_path: Path) -> None:
    package("rumoca")
    (tmp_path / "Lag.mo").write_text(LAG, encoding="utf-8")
    made = load_fmu(build_modelica(tmp_path / "Lag.mo"), interface="model-exchange").with_parameters({"T": 0.05})
    got = drive(made, np.ones((40, 1)), 0.01)[:, 0]
    wanted = 1 - np.exp(-0.01 * np.arange(40) / 0.05)
    assert min(np.abs(got - wanted).max(), np.abs(got[:-1] - wanted[1:]).max()) < 1e-7


def test_the_command_writes_an_fmu_with_its_binary(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    package("rumoca")
    (tmp_path / "two.mo").write_text(LAG, encoding="utf-8")
    assert main(["export", str(ROOT / "fmus/scara/modelica/PD.mo"), "--out", str(tmp_path)]) == 0
    path = tmp_path / "PD.fmu"
    assert capsys.readouterr().out.strip() == str(path)
    assert load_fmu(path).fmu.platforms
    assert main(["export", str(tmp_path / "two.mo"), "--out", str(tmp_path)]) == 1
    assert "model: beside its source" in capsys.readouterr().err
    assert load_fmu(build_modelica(tmp_path / "two.mo", model="Lag")).parameter_values() == {"T": 0.1}


def test_what_to_install_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(modelica, "version", absent)
    (tmp_path / "Lag.mo").write_text(LAG, encoding="utf-8")
    with pytest.raises(BuildError, match=r"pip install 'fmu-didim\[modelica\]'[\s\S]*docs/howto/modelica.md"):
        build_modelica(tmp_path / "Lag.mo")
    with pytest.raises(InputError, match="does not exist"):
        build_modelica(tmp_path / "None.mo")
    assert (ROOT / "docs/howto/modelica.md").is_file()
