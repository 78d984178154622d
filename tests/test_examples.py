"""Every example runs, and shows what it says."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.optimize import least_squares

from fmu_didim import discover, identify
from fmu_didim.case import load_case
from fmu_didim.components import ModelComponent
from fmu_didim.estimators import Didim
from tests.conftest import ROOT, needs_emps

SCARA = Path("examples/scara")
CAMPAIGNS = (
    "arm2r_hidden", "controller_swap", "emps", "house", "scara_controllers", "scara_estimators", "scara_robustness",
    "tx40_estimators",
)  # fmt: skip
"""Run by tests/campaigns/test_ready.py."""


def load(path: str) -> dict[str, object]:
    """The names that a script defines."""
    return runpy.run_path(path)


@pytest.mark.gate
def test_shipped_data_are_what_the_script_makes(tmp_path: Path) -> None:
    """The torque tables come from the generator, whose equations and integrator are not the package's."""
    import yaml

    script = load("examples/scara/make_data.py")
    made = [("identify", name, "", seed, (200, 10)) for name, seed in script["SEEDS"].items()]  # type: ignore[attr-defined]
    made += [
        ("identify_modelica", "train", "moves_", 5, (20,)),
        ("identify_modelica", "validation", "moves_", 6, (20,)),
    ]
    for case, name, prefix, seed, rates in made:
        content = yaml.safe_load((SCARA / f"{case}.yaml").read_text(encoding="utf-8"))
        _, torque = script["closed_loop"](content[name]["reference"])  # type: ignore[operator]
        deviation = 0.05 * np.sqrt((torque**2).mean(axis=0))
        measured = torque + deviation * np.random.default_rng(seed).normal(size=torque.shape)
        for rate in rates:
            shipped = np.loadtxt(SCARA / f"{prefix}{name}_{rate}hz.csv", delimiter=",", skiprows=1)[:, 1:]
            np.testing.assert_allclose(shipped, measured[:: 200 // rate], rtol=2e-5, atol=1e-6)


def test_two_runs_with_a_payload_in_the_second() -> None:
    """What is shared, what the payload changes and the gain of the controller, within three standard deviations."""
    script = load("examples/scara/make_data.py")
    truth, loaded = script["TRUTH"], script["with_payload"](script["TRUTH"])  # type: ignore[operator]
    wanted = truth | {f"{n}[payload]": loaded[n] for n in ("ZZ1R", "ZZ2", "MX2")} | {"Kp2": script["KP"][1]}  # type: ignore[index,operator]
    outcome = identify(SCARA / "two_payloads.yaml")
    assert outcome.converged
    for name, found in outcome.document.parameters.items():
        assert abs(found.value - wanted[name]) < 3 * found.std, name
    assert all(part.agreement.agrees for part in outcome.document.experiments.values() if part.agreement)


@pytest.mark.gate
def test_paper_tables(capsys: pytest.CaptureFixture[str]) -> None:
    script = load("examples/scara/paper_tables.py")
    estimates = script["reproduce"]()  # type: ignore[operator]
    truth = np.array(list(script["TRUTH"].values()))  # type: ignore[attr-defined]
    for (title, estimate), most in zip(estimates.items(), (2, 5, 5, 6), strict=True):
        assert estimate.iteration_count <= most, title
        assert (np.abs(estimate.value - truth) <= 3 * estimate.standard_deviation).all(), title
        assert title in script["table"](title, estimate)  # type: ignore[operator]


@pytest.mark.slow
def test_rate_sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "sweep.svg"
    monkeypatch.setattr(sys, "argv", ["rate_sweep.py", "--out", str(out)])
    runpy.run_path("examples/scara/rate_sweep.py", run_name="__main__")
    printed = capsys.readouterr().out
    # The paper reaches 4 Hz; without model errors it must hold at least to there.
    breaks = float(printed.split("Breaks at ")[1].split()[0])
    assert breaks < 4
    assert "<!-- torque rate, Hz -->" in out.read_text(encoding="utf-8")


@pytest.mark.gate
def test_rate_sweep_of_a_case_of_ones_own(tmp_path: Path) -> None:
    """From the shell, in another folder; from the rate of its log downwards, by its own estimator."""
    content = load_case(SCARA / "two_payloads.yaml").content
    for run in content["experiments"].values():
        run["torque"] = {**run["torque"], "file": str((SCARA / run["torque"]["file"]).resolve()), "rate_hz": 0.7}
    content["robot"] = str(Path("fmus/scara/robot.yaml").resolve())
    content["controller"] = {"source": str(Path("controllers/scara_pd.yaml").resolve())}
    (tmp_path / "my case.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    command = [sys.executable, str(Path("examples/scara/rate_sweep.py").resolve()), "my case.yaml"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    rows = done.stdout.splitlines()
    assert rows[0].startswith("SCARA, two runs, payload in the second") and "paper" not in done.stdout
    assert [float(row.split()[0]) for row in rows[3:5]] == [0.7, 0.5]
    assert "Kp2" in rows[2] and (tmp_path / "results/my case_rates.svg").is_file()


@pytest.mark.gate
def test_a_real_robot_is_identified_from_the_default_start() -> None:
    """Base parameters near those that its makers published, and torque that it was not fitted to."""
    found = identify("examples/double_pendulum/identify.yaml")
    assert found.document.status == "converged"
    assert not any("Started from" in remark for remark in found.document.remarks)  # as the first start fails
    published = {"MX1R": 0.349, "MX2": 0.111}
    for name, value in published.items():
        assert found.parameters[name].value == pytest.approx(value, rel=0.07)
    for name, value in {"ZZ1R": 0.111, "ZZ2": 0.0239}.items():
        assert abs(found.parameters[name].value - value) < 2 * found.parameters[name].std
    assert found.document.relative_error_percent["validation"].total <= 10  # type: ignore[operator]
    assert found.parameters["Fv2"].value == 0.0
    assert found.parameters["Fv2"].interval[0] == 0.0


HOUSE, BATCH = Path("examples/house"), Path("examples/batch")


def test_a_model_that_is_no_robot_is_calibrated() -> None:
    """The truth within three standard deviations, from fifteen lines, and another week that was not fitted."""
    text = (HOUSE / "identify.yaml").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 15
    script = load("examples/house/make_data.py")
    found = identify(HOUSE / "identify.yaml")
    assert found.verdict == "valid" and found.document.status == "converged"
    for name, value in found.parameters.items():
        assert abs(value.value - script[name]) < 3 * value.std, name  # type: ignore[operator]
        assert value.std < 0.01 * value.value
    percent = found.document.relative_error_percent
    assert percent["validation"].total < 1.2 * percent["estimation"].total  # type: ignore[operator]


def test_replicates_of_a_model_share_some_values_and_have_others_of_their_own() -> None:
    """Values and deviations of SciPy's least squares on the equations, from fifteen lines."""
    assert len((BATCH / "identify.yaml").read_text(encoding="utf-8").splitlines()) <= 15
    script = load("examples/batch/make_data.py")
    found = identify(BATCH / "identify.yaml")
    assert found.verdict == "valid" and found.document.status == "converged"
    expected, deviation = _replicates_by_scipy(script)
    values = np.array([value.value for value in found.parameters.values()])
    stds = np.array([value.std for value in found.parameters.values()])
    assert list(found.parameters) == ["mu_max", "Y_XS", "X0", "X0[second]"]
    assert (np.abs(values - expected) < 1e-3 * deviation).all()
    np.testing.assert_allclose(stds, deviation, rtol=0.03)
    truth = [script["MU_MAX"], script["Y_XS"], *script["X0"].values()]  # type: ignore[attr-defined]
    assert (np.abs(values - truth) < 3 * stds).all()


def _replicates_by_scipy(script: dict[str, object]) -> tuple[np.ndarray, np.ndarray]:
    """Values and standard deviations of mu_max, Y_XS and the two X0, weighted as the case states the noise."""
    tables = [np.genfromtxt(BATCH / f"{name}.csv", delimiter=",", skip_header=1) for name in script["X0"]]  # type: ignore[attr-defined]
    weights: list[np.ndarray] = []

    def outputs(values: np.ndarray) -> np.ndarray:
        runs = zip(values[2:], tables, strict=True)
        return np.vstack([script["true"](x0, table[:, 0], *values[:2]) for x0, table in runs])  # type: ignore[operator]

    measured = np.vstack([table[:, 1:] for table in tables])
    taken = np.isfinite(measured)

    def residual(values: np.ndarray) -> np.ndarray:
        return ((outputs(values) - measured) / weights[-1])[taken]

    values = np.array([0.4, 0.5, 0.15, 0.15])
    for _ in range(12):  # the deviation of X is a part of the X that is simulated
        simulated = outputs(values)
        biomass = np.hypot(0.02, 0.05 * simulated[:, 0])
        weights.append(np.column_stack([biomass, np.full(len(simulated), 0.2)]))
        found = least_squares(residual, values, x_scale=[0.4, 0.5, 0.1, 0.1], jac="3-point", diff_step=1e-4, xtol=1e-12)
        values = found.x
    return values, np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))


@pytest.mark.parametrize(
    ("folder", "tables", "values"),
    [
        (HOUSE, ("weather", "room", "weather_2", "room_2"), [0.03, 0.02]),
        (BATCH, ("batch_1", "batch_2"), [0.5, 0.4, 0.15, 0.1]),
    ],
)
def test_data_and_fmu_of_a_model_are_what_its_scripts_make(
    folder: Path, tables: tuple[str, ...], values: list[float], tmp_path: Path
) -> None:
    """The tables come from SciPy; the FMU holds sources alone, and computes what its equations say."""
    copy = tmp_path / "make_data.py"
    copy.write_text((folder / "make_data.py").read_text(encoding="utf-8"), encoding="utf-8")
    runpy.run_path(str(copy), run_name="__main__")
    for name in tables:
        made, shipped = (np.genfromtxt(at / f"{name}.csv", delimiter=",", skip_header=1) for at in (tmp_path, folder))
        np.testing.assert_allclose(made, shipped, rtol=1e-4, atol=1e-4, err_msg=name)
    with zipfile.ZipFile(folder / f"{folder.name}.fmu") as archive:
        assert not [member for member in archive.namelist() if member.startswith("binaries/")]
    block = load(str(folder / "make_fmu.py"))[folder.name]()  # type: ignore[operator]
    case = load_case(folder / "identify.yaml")
    described = {v.name: v.start for v in case.plant.parameters}
    assert described == {v.name: v.start for v in block.parameters}
    of_block = case.with_(model=ModelComponent(block, substeps=200))
    simulated, expected = (one.model.torque(np.array(values)) for one in (case, of_block))
    assert simulated == pytest.approx(expected, rel=2e-5, abs=1e-4)  # its steps are those for six digits: 1e-5


@pytest.mark.gate
@needs_emps
def test_emps_examples(capsys: pytest.CaptureFixture[str]) -> None:
    outcome = identify("examples/emps/identify.yaml")
    assert outcome.document.status == "converged"
    script = load("examples/emps/loop_delay.py")
    script["main"]()  # type: ignore[operator]
    rows = capsys.readouterr().out.splitlines()[-4:]
    errors = [float(row.split()[-2]) for row in rows]
    assert errors[0] < errors[1] < errors[2]
    assert errors[3] <= errors[0] + 0.01


@needs_emps
def test_emps_torque_rates() -> None:
    """The script's own functions at one rate; all rates and starts are in test_emps.py."""
    script = load("examples/emps/torque_rates.py")
    case = load_case("examples/emps/identify.yaml")
    full = script["full_rate"](case)  # type: ignore[operator]
    assert full.experiments["estimation"].time.size == 24841
    estimate = Didim().estimate(script["thinned"](full, 10.0, 0.05))  # type: ignore[operator]
    direct, cross = script["errors"](full, estimate)  # type: ignore[operator]
    assert direct <= 4.6
    assert cross <= 5.4


def test_every_case_file_is_named_here() -> None:
    found = {str(path) for path in Path("examples").glob("*/*.yaml")}
    assert found == {
        "examples/scara/identify.yaml",
        "examples/scara/identify_200hz.yaml",
        "examples/scara/identify_modelica.yaml",
        "examples/scara/two_payloads.yaml",
        *(f"examples/campaigns/{name}.yaml" for name in CAMPAIGNS),
        "examples/arm2r/discover.yaml",
        *(
            f"examples/double_pendulum/{name}.yaml"
            for name in ("controller", "discover", "identify", "prior", "published", "robot")
        ),
        "examples/pendulum_modelica/identify.yaml",
        "examples/house/identify.yaml",
        "examples/batch/identify.yaml",
        "examples/emps/identify.yaml",
        "examples/emps/identify_idim_ls.yaml",
        "examples/emps/discover.yaml",
        "examples/emps/discover_pulses.yaml",
        "examples/emps/robot_base.yaml",
        "examples/tx40/discover_wrist.yaml",
        "examples/tx40/discover_load.yaml",
        "examples/tx40/pd_1khz.yaml",
    }


@pytest.mark.gate
def test_discovery_names_friction_under_load_on_a_real_robot() -> None:
    """With the measured positions, least squares find 0.072 of the torque, and no term that helps more."""
    document = discover("examples/double_pendulum/discover.yaml", rounds=1)
    (found,) = document.findings
    assert (found.effect, found.joint) == ("load_dependent_friction", 1)
    assert "directional_efficiency" in [rival.effect for rival in found.ambiguous]
    (part,) = found.parameters
    assert part.interval is not None
    assert 0.05 < part.interval[0] < part.value < part.interval[1] < 0.09
    for before, after in document.error_percent.values():
        assert before is not None and after is not None
        assert after < before
    # The interval of the whole held-out error reaches one: the user is told what confirmed the effect.
    assert found.ratio_interval is not None and found.ratio_interval[1] > 1
    assert any("held-out data show the effect at 0." in note for note in document.notes)
    assert document.answer == "named_with_remainder" and document.verdict == "doubtful"


@pytest.mark.gate
def test_discovery_finds_what_the_data_of_the_arm_hide(tmp_path: Path) -> None:
    """Other functional form, other integrator, other smoothing: the names, the joints and the lag come out right."""
    import yaml

    script = load("examples/arm2r/make_data.py")
    document = discover("examples/arm2r/discover.yaml", tmp_path)
    assert document.answer == "named"
    assert {(f.effect, f.joint) for f in document.findings} == {("actuator_lag", 2), ("stribeck", 1)}
    lag = next(p for f in document.findings for p in f.parameters if p.name == "T_2")
    assert lag.std is not None
    assert abs(lag.value - script["LAG"]) < 3 * lag.std
    gap = document.gap["validation"]
    assert gap.before is not None and gap.after is not None
    assert gap.after < 0.4 * gap.before
    assert (tmp_path / document.files["plant_fmu"]).is_file()
    # The friction of joint 1 that was drawn is that of the found values, and near the true one where the arm moves.
    (curve,) = document.friction
    velocity, drawn, half = np.array(curve.velocity), np.array(curve.final), np.array(curve.half_width)
    values = {
        p.name: p.value for p in [*document.base_parameters, *(p for f in document.findings for p in f.parameters)]
    }
    sign = np.tanh(velocity / values["v0_1"])
    formula = values["Fv1"] * velocity + values["Fc1"] * sign
    formula += values["Fs1"] * sign * np.exp(-((velocity / values["vs_1"]) ** 2))
    np.testing.assert_allclose(drawn, formula, rtol=1e-9)
    true = np.array([script["friction"](np.array([v, 0.0]))[0] for v in velocity])  # type: ignore[operator]
    moving = np.abs(velocity) > 0.3  # below, the other form of the true friction shows
    assert np.abs(drawn - true)[moving].max() < 0.25
    assert np.abs(np.array(curve.base) - true).max() > 3 * np.abs(drawn - true)[moving].max()
    assert (half[moving] < 0.2).all()
    # The tables are what the script makes: the first rows, anew.
    series = yaml.safe_load(Path("examples/arm2r/discover.yaml").read_text())["train"]["reference"]
    time, torque = script["closed_loop"]({**series, "duration_s": 0.2})
    made = np.loadtxt("examples/arm2r/train_50hz.csv", delimiter=",", skiprows=1)[:10]
    exact = torque + script["noise"](4001, script["SEEDS"]["train"])[: time.size]
    np.testing.assert_allclose(made[:, 1:], exact[::4][:10], rtol=1e-4, atol=1e-4)
