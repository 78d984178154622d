"""Case files: exchange of plant and controller, and what is said about wrong input."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import check, discover, identify, simulate
from fmu_didim.base.errors import FmuDidimError, InputError, UnknownNameError
from fmu_didim.case import load_case
from fmu_didim.cli.main import main
from fmu_didim.controllers import read_controller
from fmu_didim.data.signals import trajectory, write_csv
from fmu_didim.data.tables import read_trajectory
from fmu_didim.export import build_fmu
from fmu_didim.report.numbers import loop_lines
from tests.cases import SCARA, scara_case
from tests.conftest import ROOT
from tests.helpers import model_of


@pytest.mark.gate
@pytest.mark.parametrize("controller", ["fmu", "model", "control"])
@pytest.mark.parametrize("plant", ["fmu", "model"])
def test_one_line_exchanges_plant_and_controller(tmp_path: Path, plant: str, controller: str) -> None:
    outcome = identify(scara_case(tmp_path, plant={"kind": plant}, controller={"kind": controller}))
    expected = identify(SCARA)
    np.testing.assert_allclose(outcome.estimate.value, expected.estimate.value, rtol=1e-7)
    assert outcome.document.loop["components"]["plant"]["kind"] == plant
    assert outcome.document.loop["components"]["controller"]["kind"] == controller


@pytest.mark.slow
def test_plant_as_python_control_gives_the_same_torque(tmp_path: Path) -> None:
    """Simulated here, since each identification takes dozens of runs at the speed of Python."""
    reference = simulate(SCARA)
    for controller in ("fmu", "control"):
        table = simulate(scara_case(tmp_path, plant={"kind": "control"}, controller={"kind": controller}))
        np.testing.assert_allclose(table.values, reference.values, rtol=0, atol=1e-9 * np.abs(reference.values).max())


USER_SYSTEMS = """
import control
import numpy as np

KP, KD, T = np.diag([3700.0, 62.0]), np.diag([230.0, 4.0]), 0.005
LABELS = ["qr1", "qr2", "vr1", "vr2", "p1", "p2", "v1", "v2"]
static = control.ss([], [], [], np.hstack([KP, KD, -KP, -KD]), T, inputs=LABELS, outputs=["a", "b"])


def errors():
    gains = np.hstack([KP, KD])
    return control.ss([], [], [], gains, T, inputs=["e1", "e2", "de1", "de2"], outputs=["a", "b"])


def nonlinear():
    return control.nlsys(
        None, lambda t, x, u, params: KP @ (u[0:2] - u[4:6]) + KD @ (u[2:4] - u[6:8]),
        inputs=LABELS, outputs=["a", "b"], dt=T,
    )
"""


@pytest.mark.parametrize("name", ["static", "nonlinear", "errors"])
def test_user_python_control_system_plugs_in(tmp_path: Path, name: str) -> None:
    (tmp_path / "mine.py").write_text(USER_SYSTEMS, encoding="utf-8")
    roles = ["q_ref1", "q_ref2", "dq_ref1", "dq_ref2", "q1", "q2", "dq1", "dq2"]
    inputs = dict(zip(roles, ["qr1", "qr2", "vr1", "vr2", "p1", "p2", "v1", "v2"], strict=True))
    if name == "errors":
        inputs = {"q_ref1 - q1": "e1", "q_ref2 - q2": "e2", "dq_ref1 - dq1": "de1", "dq_ref2 - dq2": "de2"}
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["controller"] = {
        "kind": "control", "source": f"mine.py:{name}", "inputs": inputs,
        "outputs": {"command1": "a", "command2": "b"},
    }  # fmt: skip
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    expected = simulate(SCARA)
    table = simulate(path)
    np.testing.assert_allclose(table.values, expected.values, rtol=0, atol=1e-9 * np.abs(expected.values).max())


def test_averages_and_points_are_told_apart(tmp_path: Path) -> None:
    """A 200 Hz log averaged to 10 Hz identifies the same robot when the simulation is averaged alike."""
    torque = {"file": str(SCARA.parent.resolve() / "train_200hz.csv"), "rate_hz": 10, "sampling": "average"}
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["train"]["torque"] = torque
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    outcome = identify(path)
    truth = [3.43, 0.03, 0.82, 0.063, 0.241, 0.014, 0.013, 0.137]
    assert (np.abs(outcome.estimate.value - truth) <= 3 * outcome.estimate.standard_deviation).all()
    # Twenty samples make an average, so its noise is smaller than that of a point.
    assert outcome.document.relative_error_percent["estimation"].total < 2.0  # type: ignore[operator]


@pytest.mark.parametrize("sampling", ["point", "average"])
def test_a_log_with_gaps_gives_the_samples_that_it_has(tmp_path: Path, sampling: str) -> None:
    """At its own rate and at another one: those that need a row which is missing are left out, all others are right."""
    rows = (SCARA.parent / "train_200hz.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "whole.csv").write_text("\n".join(rows), encoding="utf-8")
    (tmp_path / "gaps.csv").write_text("\n".join(rows[:300] + rows[303:700] + rows[701:]), encoding="utf-8")
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    found = {}
    for name, further in (("gaps", {}), ("whole", {"rate_hz": 20}), ("gaps at 20 Hz", {"rate_hz": 20})):
        content["train"]["torque"] = {"file": f"{name.split()[0]}.csv", "sampling": sampling, **further}
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        model = model_of(path)
        found[name] = model.experiments[model.first]
    assert found["gaps"].torque.shape == (len(rows) - 1 - 4, 2)
    whole, left = found["whole"], found["gaps at 20 Hz"]
    kept = np.isin(np.round(whole.time, 6), np.round(left.time, 6))
    # Of every tenth row one lay in the first gap (1.495, 1.5, 1.505 s); each average needs ten.
    assert (~kept).sum() == {"point": 1, "average": 3}[sampling]
    np.testing.assert_allclose(left.torque, whole.torque[kept], rtol=0, atol=1e-12)


def test_a_part_of_a_run(tmp_path: Path) -> None:
    """The samples between both instants, with the torque that they have in the whole run: it begins where that does."""
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    whole = model_of(path)
    content["train"] |= {"from_s": 2.0, "to_s": 5.5}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    part = model_of(path)
    experiment, of_whole = part.experiments[part.first], whole.experiments[whole.first]
    assert (experiment.time[0], experiment.time[-1]) == pytest.approx((2.0, 5.5))
    assert (experiment.reference.time[0], experiment.reference.time[-1]) == pytest.approx((0.0, 5.5))
    kept = (of_whole.time > 2 - 1e-6) & (of_whole.time < 5.5 + 1e-6)
    np.testing.assert_array_equal(experiment.torque, of_whole.torque[kept])
    values = np.array([3.43, 0.03, 0.82, 0.063, 0.241, 0.014, 0.013, 0.137])
    np.testing.assert_allclose(part.torque(values), whole.torque(values)[kept], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ({"from_s": 5.0, "to_s": 2.0}, "from_s must lie before to_s"),
        ({"from_s": 50.0}, r"no samples in the part[\s\S]*50 to inf s[\s\S]*0 to 9.9"),
    ],
)
def test_a_part_that_cannot_be(tmp_path: Path, part: dict[str, float], words: str) -> None:
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["train"] |= part
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        load_case(path)


@pytest.mark.gate
def test_late_stamps_are_taken_back(tmp_path: Path) -> None:
    """The log of the example, stamped 17 ms late: the estimate of the right stamps if that is told, else another."""
    log = read_trajectory(SCARA.parent / "train_200hz.csv")
    torque = log.select(["tau1", "tau2"])[:-20:20]
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    found = {}
    for name, late_s, told_s in (("right", 0.0, 0.0), ("told", 0.017, 0.017), ("not told", 0.017, 0.0)):
        columns = {f"tau{j + 1}": torque[:, j] for j in range(2)}
        write_csv(trajectory(log.time[:-20:20] + late_s, columns), tmp_path / f"{name}.csv")
        content["train"]["torque"] = {"file": f"{name}.csv", "log_shift_s": told_s}
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        found[name] = identify(path).estimate.value
        assert simulate(path).time.size == simulate(SCARA).time.size
    np.testing.assert_allclose(found["told"], found["right"], rtol=1e-6)
    shared = found["right"].size  # the wrong clock may look like a wrong start, too
    assert np.abs(found["not told"][:shared] / found["right"] - 1).max() > 0.1


@pytest.mark.parametrize("value", [1.5, -1.01, float("nan"), "late"])
def test_impossible_shifts_of_the_log_are_refused(tmp_path: Path, value: object) -> None:
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["train"]["torque"]["log_shift_s"] = value
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InputError, match=r"train\.torque\.log_shift_s"):
        load_case(path)


def test_all_problems_are_listed_with_their_paths(tmp_path: Path) -> None:
    path = scara_case(
        tmp_path, controler={"kind": "fmu"}, loop={"delay_samples": -1, "rate": 3}, estimator={"kind": "didm"}
    )
    with pytest.raises(InputError) as caught:
        load_case(path)
    text = str(caught.value)
    assert "controler: unknown key. Did you mean 'controller'?" in text
    assert "loop.rate: unknown key. Did you mean 'rate_hz'?" in text
    assert "loop.delay_samples:" in text
    assert "there is no estimator 'didm'; valid: didim, clie, idim_ls, idim_iv, output_error" in text
    assert "4 problems" in text


def test_unknown_estimator_option_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown option 'tolerence' of didim; valid: start, tolerance"):
        load_case(scara_case(tmp_path, estimator={"tolerence": 1}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robot": "nowhere.yaml"}, "does not exist"),
        ({"controller": {"source": "nowhere.fmu"}}, "The FMU does not exist"),
        ({"controller": {"kind": "model", "source": "some.fmu"}}, "An .fmu file is of the kind fmu"),
        ({"controller": {"kind": "control", "source": "nowhere.py:thing"}}, "The Python file does not exist"),
        ({"controller": {"parameters": {"Kp3": 1.0}}}, "Did you mean 'Kp"),
        ({"controller": {"outputs": {"command1": "tau1"}}}, "There is no output named 'tau1'"),
        ({"loop": {"drive_gains": [1.0]}}, "One drive gain is needed for each joint"),
        ({"loop": {"rate_hz": 100, "delay_samples": 0.0}, "torque_std": [1.0]}, "torque_std needs one value"),
        ({"estimator": {"kind": "idim_ls", "start": None}}, "unknown option 'start' of idim_ls"),
    ],
)
def test_wrong_entries_are_refused_with_a_message(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(FmuDidimError, match=message):
        load_case(scara_case(tmp_path, **changes))


def test_estimator_without_its_data_is_refused(tmp_path: Path) -> None:
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["estimator"] = {"kind": "idim_ls"}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InputError, match="needs measured positions"):
        load_case(path)


def test_log_beyond_the_reference_is_refused(tmp_path: Path) -> None:
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["train"]["torque"]["offset_s"] = 3.0
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InputError, match=r"train_10hz\.csv reaches beyond its reference"):
        load_case(path)


def test_absent_benchmark_data_say_where_to_get_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FMU_DIDIM_DATA", str(tmp_path))
    with pytest.raises(InputError) as caught:
        load_case("examples/emps/identify.yaml")
    assert "FMU_DIDIM_DATA" in str(caught.value)
    assert "nonlinearbenchmark.org" in str(caught.value)


def test_simulation_takes_other_parameters() -> None:
    heavy = simulate(SCARA, parameters={"ZZ1R": 6.86})
    normal = simulate(SCARA)
    assert np.linalg.norm(heavy.select(["tau1"])) > 1.5 * np.linalg.norm(normal.select(["tau1"]))
    with pytest.raises(UnknownNameError, match="ZZ1R"):
        simulate(SCARA, parameters={"ZZ1": 1.0})


@pytest.mark.gate
@pytest.mark.parametrize(
    ("name", "law", "form"),
    [
        ("scara_pd", "pd", "fmu"),
        ("scara_pid", "pid", "fmu"),
        ("scara_cascade", "cascade_ppi", "fmu"),
        ("scara_computed_torque", "computed_torque", "fmu"),
        ("scara_cascade", "cascade_ppi", "control"),
        ("scara_cascade", "cascade_ppi", "FMI 3.0"),
        ("scara_cascade", "", "vendor.fmu"),
    ],
)
def test_every_controller_of_the_scara_identifies_it(tmp_path: Path, name: str, law: str, form: str) -> None:
    """One line exchanges the controller; the torque is then its own. The report says which it was."""
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    description = Path(f"controllers/{name}.yaml").resolve()
    content["controller"] = {"kind": "control" if form == "control" else "fmu", "source": str(description)}
    shown = f"controller: {name}.yaml ({law}), FMI 2.0 co-simulation, run again by reset"
    if form == "control":
        shown = f"controller: {name}.yaml ({law}), python-control"
    elif form == "FMI 3.0":
        content["controller"]["fmi"] = "3.0"
        shown = f"controller: {name}.yaml ({law}), FMI 3.0 co-simulation, run again by reset"
    elif form == "vendor.fmu":
        built = build_fmu(read_controller(description), directory=tmp_path).rename(tmp_path / "vendor.fmu")
        content["controller"]["source"] = str(built)
        content["loop"] = {"rate_hz": 200, "delay_samples": 0.5}
        shown = "controller: vendor.fmu, FMI 2.0 co-simulation, run again by reset"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    table = simulate(path)
    rows = slice(0, 2000, 20)
    torque = table.select(["tau1", "tau2"])[rows]
    noise = 0.05 * np.sqrt((torque**2).mean(axis=0)) * np.random.default_rng(3).normal(size=torque.shape)
    data = np.column_stack([table.time[rows], torque + noise])
    np.savetxt(tmp_path / "torque.csv", data, delimiter=",", header="t,tau1,tau2", comments="")
    content["train"]["torque"]["file"] = "torque.csv"
    del content["validation"]
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    outcome = identify(path, out=tmp_path / "out")
    truth = [3.43, 0.03, 0.82, 0.063, 0.241, 0.014, 0.013, 0.137]
    assert outcome.document.status == "converged"
    assert (np.abs(outcome.estimate.value - truth) <= 3.5 * outcome.estimate.standard_deviation).all()
    delay = "plant 0.5 samples" if form == "vendor.fmu" else "none"
    lines = [
        shown, "plant: robot.yaml, FMI 2.0 co-simulation, run again by reset",
        f"200 Hz, Gauss-Seidel in this order, delay: {delay}",
    ]  # fmt: skip
    assert loop_lines(outcome.document.loop) == lines
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for line in lines:
        assert f"<li>{line}</li>" in page


def test_python_control_definition_of_the_pd(tmp_path: Path) -> None:
    source = str(Path("controllers/scara_pd_control.py").resolve()) + ":controller"
    table = simulate(scara_case(tmp_path, controller={"kind": "control", "source": source}))
    np.testing.assert_allclose(table.values, simulate(SCARA).values, rtol=0, atol=1e-8)


def test_misspelt_injection_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="no reference has it"):
        load_case(scara_case(tmp_path, loop={"injections": {"command1": "pulses"}}))


def test_plant_without_acceleration_outputs_is_identified(tmp_path: Path) -> None:
    """Differences of velocity stand in; the result says so, and the finish does not depend on them."""
    path = scara_case(tmp_path, plant={"kind": "fmu", "outputs": {"a1": "ddq1", "a2": "ddq2"}})
    outcome = identify(path)
    expected = identify(SCARA)
    assert outcome.document.status == "converged"
    np.testing.assert_allclose(outcome.estimate.value, expected.estimate.value, rtol=1e-5)
    assert any("differences of its velocities" in remark for remark in outcome.document.remarks)


@pytest.mark.parametrize("form", ["train", "experiments"])
def test_a_case_without_a_log_is_loaded_and_simulated(
    tmp_path: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """What needs the log says that it is missing; ``validate`` says so, too."""
    content = load_case(SCARA).content
    run = {"reference": content["train"]["reference"]}
    runs = {"train": run} if form == "train" else {"experiments": {"first": run}}
    del content["train"], content["validation"]
    path = tmp_path / "case.yaml"
    path.write_text(yaml.safe_dump(content | runs | {"robot": str(ROOT / "fmus/scara/robot.yaml"),
                    "controller": {"source": str(ROOT / "controllers/scara_pd.yaml")}}), encoding="utf-8")  # fmt: skip
    case = load_case(path)
    np.testing.assert_array_equal(simulate(case).values, simulate(path).values)
    label = "estimation" if form == "train" else "first"
    for verb in (identify, check, discover):
        with pytest.raises(InputError, match=rf"torque log is missing[\s\S]*{label}[\s\S]*torque: {{file"):
            verb(case)
    assert main(["validate", str(path)]) == 1
    assert "torque log is missing" in capsys.readouterr().out
