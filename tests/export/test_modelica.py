"""Modelica files as FMUs, and what is said where there is no compiler for them."""

from __future__ import annotations

import logging
import re
import shutil
import subprocess
import sys
import zipfile
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import identify, simulate
from fmu_didim.base.errors import BuildError, InputError
from fmu_didim.case import load_case
from fmu_didim.cli.main import main
from fmu_didim.components import load_fmu
from fmu_didim.cosim import simulation
from fmu_didim.data.signals import trajectory, write_csv
from fmu_didim.export import build_modelica, modelica
from fmu_didim.export.modelica_names import SUFFIX, circular, restored, set_aside
from fmu_didim.results.result import read_result
from tests.conftest import package
from tests.helpers import ROOT, drive
from tests.patience import patience

PENDULUM = ROOT / "examples/pendulum_modelica"
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


# ---- names and lost equations ------------------------------------------------------------------


def test_parameters_may_have_the_names_that_the_c_code_uses(tmp_path: Path) -> None:
    package("rumoca")
    names = ("c", "m", "t", "i", "n", "x", "value", "size", "double", "nvr")
    text = LAG.replace(
        "  parameter Real T = 0.1;", "".join(f'  parameter Real {n} = 0.01 "not c, m";\n' for n in names)
    )
    (tmp_path / "Lag.mo").write_text(
        text.replace("Real x(", "Real s(").replace("u - x", "u - s").replace("y = x", "y = s // c")
        .replace("T*der(x)", f"({' + '.join(names)})*der(s)").replace("// c;", "; // c"),
        encoding="utf-8",
    )  # fmt: skip
    made = load_fmu(build_modelica(tmp_path / "Lag.mo"), interface="model-exchange")
    assert made.parameter_values() == dict.fromkeys(names, 0.01)
    got = drive(made.with_parameters({"c": 0.41}), np.ones((40, 1)), 0.01)[:, 0]
    wanted = 1 - np.exp(-0.01 * np.arange(40) / 0.5)
    assert min(np.abs(got - wanted).max(), np.abs(got[:-1] - wanted[1:]).max()) < 1e-7


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("x = c + m.c;", "x = c~ + m.c;"),
        ('Real c = 1 "c" /* c */; // c', 'Real c~ = 1 "c" /* c */; // c'),
        ("Motor a(c = c);", "Motor a(c = c~);"),
        ("if (c == 1) then c = 2;", "if (c~ == 1) then c~ = 2;"),
        ("cc = c1 + 'c';", "cc = c1 + 'c';"),
    ],
)
def test_only_variables_are_set_aside(text: str, made: str) -> None:
    assert set_aside(text, ["c"]) == made.replace("~", SUFFIX)
    assert restored(made.replace("~", SUFFIX)) == text


def test_what_rumoca_finds_no_equation_for_is_refused(tmp_path: Path) -> None:
    package("rumoca")
    text = LAG.replace("  output Real y;", "  output Real y;\n  output Real rate;").replace(
        "y = x;", "y = x; rate = der(x);"
    )
    (tmp_path / "Lag.mo").write_text(text, encoding="utf-8")
    with pytest.raises(BuildError, match=r"no equation for some variables[\s\S]*got:   rate[\s\S]*der\(w\) = a"):
        build_modelica(tmp_path / "Lag.mo")
    circle = text.replace("rate = der(x)", "a = rate;\n  rate = a").replace("T*der(x)", "der(x) = a;\n  T*a")
    (tmp_path / "Lag.mo").write_text(circle.replace("  Real x", "  Real a;\n  Real x"), encoding="utf-8")
    with pytest.raises(BuildError):  # an equation too many, whatever the compiler makes of it
        build_modelica(tmp_path / "Lag.mo")


@pytest.mark.parametrize("order", ["J*a = u - x;\n  rate = a;", "rate = a;\n  J*a = u - x;"])
def test_an_output_that_is_a_derivative_is_right_or_refused(order: str, tmp_path: Path) -> None:
    package("rumoca")
    text = LAG.replace("  output Real y;", "  output Real y;\n  output Real rate;\n  Real a;")
    text = text.replace("T*der(x) = u - x;", f"der(x) = a;\n  {order.replace('J', 'T')}")
    (tmp_path / "Lag.mo").write_text(text, encoding="utf-8")
    try:
        made = load_fmu(build_modelica(tmp_path / "Lag.mo"), interface="model-exchange")
    except BuildError as error:
        assert "no equation for some variables" in error.what
        assert order.startswith("rate"), "written in the order that is advised, it is taken"
        return
    got = drive(made, np.ones((40, 1)), 0.01)
    steps = 0.01 * np.arange(40)
    assert min(np.abs(got[:, 0] - 1 + np.exp(-10 * at)).max() for at in (steps, steps + 0.01)) < 1e-7
    assert min(np.abs(got[:, 1] - 10 * np.exp(-10 * at)).max() for at in (steps, steps + 0.01)) < 1e-6


def test_variables_that_are_computed_from_each_other_are_found() -> None:
    code = "static void compute_algebraics(M* m);\nstatic void compute_algebraics(M* m) {{\n  {}\n}}\n a = b; b = a;"
    assert circular(code.format("a = b;\n  b = a;\n  c = 1.0;")) == ["a", "b"]
    assert circular(code.format("a = b;\n  b = c;\n  c = 1.0;")) == []
    assert circular(code.format("a = a + 1.0;")) == ["a"]


def test_c_code_that_does_not_compile_is_not_the_fault_of_the_compiler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package("rumoca")
    (tmp_path / "Lag.mo").write_text(LAG.replace("0.1", "0.125"), encoding="utf-8")
    files = modelica._files
    monkeypatch.setattr(
        modelica, "_files", lambda model: {k: v.replace("fmi2Reset(", "9(") for k, v in files(model).items()}
    )
    with pytest.raises(BuildError, match=r"'Lag' cannot be compiled[\s\S]*Rename the variable") as caught:
        build_modelica(tmp_path / "Lag.mo")
    assert "CC" not in caught.value.next_step


# ---- a plant and a controller of one's own -------------------------------------------------------


def test_info_and_check_take_modelica_files(capsys: pytest.CaptureFixture[str]) -> None:
    package("rumoca")
    assert main(["fmu", "info", str(PENDULUM / "Pendulum.mo")]) == 0
    assert "largest torque of gravity" in capsys.readouterr().out
    assert main(["fmu", "check", str(PENDULUM / "Pendulum.mo")]) == 0
    told = capsys.readouterr().out
    assert "parameters that act: J, c" in told and "model-exchange" in told


@pytest.mark.gate
def test_a_plant_without_robot_description_ends_as_ssv(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    package("rumoca")
    case = PENDULUM / "identify.yaml"
    assert main(["validate", str(case)]) == 0
    assert main(["check", str(case)]) == 0
    assert main(["identify", str(case), "--out", str(tmp_path), "--quiet"]) == 0
    found = read_result(tmp_path).parameters
    for name, true in {"J": 0.62, "c": 1.43}.items():
        assert abs(found[name].value - true) < 4 * found[name].std
    archive = tmp_path / "loop.ssp"
    assert main(["export", str(case), "--result", str(tmp_path / "result.json"), "--ssp", str(archive)]) == 0
    with zipfile.ZipFile(archive) as ssp:
        values = dict(
            re.findall(r'name="(\w+)">\s*<ssv:Real value="([^"]+)"', ssp.read("resources/plant.ssv").decode())
        )
    assert {name: float(value) for name, value in values.items()} == {n: p.value for n, p in found.items()}


FRICTION = {"J": 0.62, "mgl": 1.43, "d": 0.25, "fc": 0.35}
"""Of a plant whose friction is steep: its time constants are a tenth of those of the motion."""


def own_pendulum(folder: Path, rate_hz: int) -> Path:
    """A case of a plant and a controller of one's own, with steep friction, whose control and log have this rate."""
    text = (PENDULUM / "Pendulum.mo").read_text(encoding="utf-8")
    text = text.replace("parameter Real c(", "parameter Real mgl(").replace(
        "c*sin(x)", "mgl*sin(x) - d*v - fc*tanh(v/0.02)"
    )
    text = text.replace("  input", "  parameter Real d = 0.1;\n  parameter Real fc = 0.2;\n  input", 1)
    (folder / "Pendulum.mo").write_text(text, encoding="utf-8")
    shutil.copy(PENDULUM / "PD.mo", folder)
    case = yaml.safe_load((PENDULUM / "identify.yaml").read_text(encoding="utf-8"))
    del case["plant"]["substeps"]
    case["loop"] = {"rate_hz": rate_hz}
    case["identify"] = {name: {"parameter": name} for name in FRICTION} | {"J": {"parameter": "J", "minimum": 0.01}}
    rng = np.random.default_rng(1)
    for label in ("train", "validation"):
        case[label]["torque"] = {"file": "none.csv", "rate_hz": rate_hz}
    (folder / "making.yaml").write_text(yaml.safe_dump(case), encoding="utf-8")
    for label in ("train", "validation"):
        experiment = "estimation" if label == "train" else label
        table = simulate(folder / "making.yaml", parameters=FRICTION, experiment=experiment)
        torque = table.column("tau1")
        torque = torque + 0.02 * np.std(torque) * rng.standard_normal(torque.size)
        write_csv(trajectory(table.time, {"tau1": torque}), folder / f"{label}.csv")
        case[label]["torque"] = {"file": f"{label}.csv"}
    (folder / "case.yaml").write_text(yaml.safe_dump(case, sort_keys=False), encoding="utf-8")
    return folder / "case.yaml"


@pytest.mark.gate
@pytest.mark.parametrize("rate_hz", [200, 1000])
def test_a_plant_of_ones_own_at_the_rate_of_a_drive_says_what_it_does_and_ends(tmp_path: Path, rate_hz: int) -> None:
    """At 1 kHz it ran for ten minutes without a word; at 200 Hz its parameters were said to have no effect."""
    package("rumoca")
    case = own_pendulum(tmp_path, rate_hz)
    command = [sys.executable, "-m", "fmu_didim.cli.main", "identify", str(case), "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=patience(60.0), check=True)
    told = [line for line in done.stdout.splitlines() if re.search(r"clie \d+: torque error", line)]
    assert "building its FMUs" in done.stdout and len(told) > 2
    result = read_result(tmp_path / "out")
    assert result.verdict == "valid", result.reasons
    for name, true in FRICTION.items():
        assert abs(result.parameters[name].value - true) < 4 * result.parameters[name].std, name


@pytest.mark.gate
def test_didim_says_that_the_parameters_of_a_plant_are_fixed(tmp_path: Path) -> None:
    package("rumoca")
    for name in ("PD.mo", "identify.yaml", "train_50hz.csv", "validation_50hz.csv"):
        shutil.copy(PENDULUM / name, tmp_path)
    text = (PENDULUM / "Pendulum.mo").read_text(encoding="utf-8")
    text = text.replace("protected", "  output Real ddq1;\nprotected\n  Real a;")
    text = text.replace("J*der(v)", "der(v) = a;\n  J*a").replace("  q1 = x;", "  q1 = x;\n  ddq1 = a;")
    (tmp_path / "Pendulum.mo").write_text(text, encoding="utf-8")
    case = load_case(tmp_path / "identify.yaml").with_(estimator={"kind": "didim"})
    with pytest.raises(InputError, match=r"fixed then[\s\S]*J[\s\S]*clie"):
        identify(case)


def test_a_run_that_takes_long_is_told_once(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    package("rumoca")
    model = load_case(PENDULUM / "identify.yaml").model
    model.torque(model.start)
    monkeypatch.setattr(simulation, "SLOW", -1.0)
    with caplog.at_level(logging.INFO, "fmu_didim"):
        for factor in (1.0, 1.1, 1.2, 1.3):
            model.torque(factor * model.start)
    told = [record.getMessage() for record in caplog.records if "One simulation takes" in record.getMessage()]
    assert len(told) == 1
    assert "plant (Pendulum.fmu)" in told[0] and "substeps" in told[0]
