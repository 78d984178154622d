"""The command line as a user meets it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

from fmu_didim.cli.main import main
from fmu_didim.data.tables import read_trajectory
from fmu_didim.results.result import result_schema
from fmu_didim.ssp import read_ssp


@pytest.mark.gate
def test_identify_writes_result_and_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "examples/scara/identify.yaml", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "didim 1:" in printed  # progress
    assert "restarted from the motion that the measured torque implies" in printed
    assert "ZZ1R" in printed
    assert "kg.m2" in printed or "kg·m²" in printed
    document = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    jsonschema.validate(document, result_schema())
    assert document["schema_version"] == 3
    assert (document["verdict"], document["reasons"]) == ("valid", [])
    assert document["status"] == "converged"
    assert document["iterations"] <= 5
    zz1 = document["parameters"]["ZZ1R"]
    assert set(zz1) >= {"value", "std", "rel_std_percent", "interval", "unit"}
    assert zz1["interval"][0] < 3.43 < zz1["interval"][1]
    assert zz1["unit"] == "kg.m2"
    errors = document["relative_error_percent"]
    assert len(errors["estimation"]["per_joint"]) == 2
    assert 4 < errors["validation"]["total"] < 6
    roles = {label: experiment["role"] for label, experiment in document["experiments"].items()}
    assert roles == {"estimation": "estimation", "validation": "validation"}
    assert document["experiments"]["estimation"]["samples"] == 100
    assert document["experiments"]["validation"]["relative_error_percent"] == errors["validation"]
    assert document["loop"]["order"] == ["controller", "plant"]
    provenance = document["provenance"]
    assert len(provenance["files"]["train_10hz.csv"]) == 64
    assert provenance["versions"]["casadi"]
    assert (tmp_path / "report.html").stat().st_size > 1e5
    torque = read_trajectory(tmp_path / document["signals"]["validation"])
    assert torque.names == (
        *("tau_measured1", "tau_measured2", "tau_simulated1", "tau_simulated2"), "q1", "q2", "dq1", "dq2"
    )  # fmt: skip
    every = read_trajectory(tmp_path / document["simulated"]["validation"])
    assert (every.names, every.time.size) == (("tau1", "tau2"), 2001)  # at 200 Hz


def test_quiet_prints_the_table_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "examples/scara/identify.yaml", "--out", str(tmp_path), "--quiet"]) == 0
    assert "didim 1:" not in capsys.readouterr().out


def test_simulate_writes_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "loop.csv"
    assert main(["simulate", "examples/scara/identify.yaml", "--set", "Fc1=0.5", "--out", str(out)]) == 0
    table = read_trajectory(out)
    assert table.names == ("tau1", "tau2", "q1", "q2", "dq1", "dq2", "ddq1", "ddq2")
    assert table.time.size == 2001
    assert "2001 rows" in capsys.readouterr().out


def test_export_builds_an_fmu(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for description in ("fmus/emps/robot.yaml", "controllers/emps.yaml"):
        assert main(["export", description, "--out", str(tmp_path)]) == 0
        assert Path(capsys.readouterr().out.strip()).is_file()


@pytest.mark.gate
def test_export_writes_the_loop_of_a_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case, file = "examples/scara/identify.yaml", tmp_path / "new" / "loop.ssp"
    assert main(["identify", case, "--out", str(tmp_path / "out"), "--quiet"]) == 0
    capsys.readouterr()
    assert main(["export", case, "--ssp", str(file), "--result", str(tmp_path / "out" / "result.json")]) == 0
    assert capsys.readouterr().out.strip() == str(file)
    document = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    values = read_ssp(file).components["plant"].parameter_values()
    assert values["ZZ1"] == document["parameters"]["ZZ1R"]["value"]
    assert main(["export", case, "--ssp", str(file)]) == 0
    assert read_ssp(file).components["plant"].parameter_values()["ZZ1"] == 3.43


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["export", "fmus/scara/robot.yaml", "--result", "result.json"], "--result goes with --robot or --ssp"),
        (["export", "examples/scara/identify.yaml", "--ssp", "x.ssp", "--result", "nowhere"], "There is no result"),
        (["identify", "nowhere.yaml"], "The file does not exist"),
        (["simulate", "examples/scara/identify.yaml", "--set", "Fc1"], "This is not an assignment"),
        (["simulate", "examples/scara/identify.yaml", "--set", "ZZ1=1"], "Did you mean 'ZZ1R'"),
        (["simulate", "examples/scara/identify.yaml", "--set", "ZZ1R=1e-3"], "not positive definite"),
    ],
)
def test_errors_are_messages_not_tracebacks(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 1
    assert expected in capsys.readouterr().err


@pytest.mark.gate
def test_refusal_is_saved_without_values(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = Path("examples/scara/identify.yaml").read_text(encoding="utf-8")
    for name in ("../../fmus", "../../controllers"):
        text = text.replace(name, str(Path(name.removeprefix("../../")).resolve()))
    for name in ("train", "validation"):
        log = Path(f"examples/scara/{name}_10hz.csv").read_text(encoding="utf-8")
        (tmp_path / f"{name}_10hz.csv").write_text(log, encoding="utf-8")
    limited = "identify: {Kp2: {of: controller, start: 50, maximum: 51}}  # 62 in truth\n"
    (tmp_path / "case.yaml").write_text(text + limited, encoding="utf-8")
    assert main(["identify", str(tmp_path / "case.yaml"), "--out", str(tmp_path / "out")]) == 1
    assert "at a limit given in the case: Kp2" in capsys.readouterr().err
    document = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert document["status"] == "refused"
    assert document["parameters"] == {}
    assert document["verdict"] == "refused"
    assert set(document["unconstrained"]) == {"ZZ1R", "Fv1", "Fc1", "ZZ2", "MX2", "MY2", "Fv2", "Fc2", "Kp2"}
    assert document["history"]
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.gate
def test_fmu_info_and_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "fmus/scara/robot.yaml", "--out", str(tmp_path), "--fmi", "3.0"]) == 0
    fmu = capsys.readouterr().out.strip()
    assert main(["fmu", "info", fmu]) == 0
    told = capsys.readouterr().out
    assert "scara: FMI 3.0" in told
    assert "co-simulation: saves its state, gives derivatives, takes variable steps" in told
    assert "ZZ1" in told
    assert "kg.m2" in told
    assert main(["fmu", "check", fmu]) == 0
    found = capsys.readouterr().out
    assert "reset: restores" in found
    assert "outputs that follow the inputs at once: ddq1, ddq2" in found
    assert main(["fmu", "info", "README.md"]) == 1


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["identify", "--help"], ["export", "--help"]])
def test_help_needs_no_heavy_import(arguments: list[str]) -> None:
    code = (
        "import sys; from fmu_didim.cli.main import main\n"
        f"try: main({arguments})\n"
        "except SystemExit: pass\n"
        "heavy = {'casadi', 'control', 'numpy', 'scipy', 'fmpy', 'matplotlib', 'pandas', 'pydantic', 'yaml'}\n"
        "heavy = (heavy | {'jinja2'}) & set(sys.modules)\n"
        "sys.exit(f'imported: {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "fmu-didim" in done.stdout


SLOW_TO_IMPORT = {"control", "matplotlib", "pandas", "scipy.ndimage", "scipy.signal", "scipy.stats"}
"""They take from 0.1 s to a second, each; all of them together as long as an identification."""


def run_without_slow_imports(code: str) -> None:
    code += f"\nimport sys\nslow = {SLOW_TO_IMPORT} & set(sys.modules)\nsys.exit(f'imported: {{slow}}' if slow else 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_verbs_import_nothing_that_few_cases_need() -> None:
    run_without_slow_imports("import fmu_didim.case, fmu_didim.workflow")


@pytest.mark.gate
def test_an_identification_imports_nothing_that_it_does_not_need(tmp_path: Path) -> None:
    arguments = ["identify", "examples/double_pendulum/identify.yaml", "--out", str(tmp_path)]
    run_without_slow_imports(f"from fmu_didim.cli.main import main; main({arguments})")
    assert (tmp_path / "report.html").is_file()
