"""What identify and discover return, as text, data frame, figure and notebook cell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from fmu_didim import (
    Discovered,
    Result,
    discover,
    export_ssp,
    identify,
    load_case,
    load_findings,
    load_result,
    read_controller,
    read_ssp,
    read_trajectory,
    simulate,
    validate_on,
)
from fmu_didim.base.constants import recorded
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.discovery.constants import DECIDING
from fmu_didim.fit.statistics import relative_error_percent
from fmu_didim.report import result_table
from fmu_didim.report.discovery.sections import discovery_table
from tests.report.drawn import plotted
from tests.workflow.three_experiments import PAYLOAD, three_experiments

ARM = Path("examples/arm2r")


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """Three experiments, identified."""
    return identify(three_experiments(), tmp_path_factory.mktemp("three"))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Discovered, Path]:
    """One effect found in a case in memory, and the folder of its files."""
    root = Path(__file__).parents[2] / ARM
    content = yaml.safe_load((root / "discover.yaml").read_text(encoding="utf-8"))
    signals = {"train_50hz.csv": read_trajectory(root / "train_50hz.csv")}
    folder = tmp_path_factory.mktemp("found")
    return discover(load_case(content, folder=root, signals=signals), folder, rounds=1), folder


@pytest.mark.gate
def test_outcome_gives_values_and_what_judges_them(outcome: Result) -> None:
    assert outcome.converged
    assert repr(outcome) == "Result('SCARA, torque at 10 Hz', valid, 11 parameters)"
    assert outcome.summary() == result_table(outcome.document)
    for name, truth in PAYLOAD.items():
        found = outcome.parameters[f"{name}[payload]"]
        assert abs(found.value - truth) < 5 * found.std
        assert found.experiment == "payload"
        assert found.of == "plant"
        assert found.standard == outcome.parameters[name].standard
    assert list(outcome.values) == list(outcome.estimate.names)
    assert outcome.robot is not None
    assert outcome.validation("check").role == "validation"
    with pytest.raises(UnknownNameError, match="Did you mean 'payload'"):
        outcome.validation("paylod")


AS_FITTED = 1e-4
"""[1] Of the largest torque, between what steps twice as fine as those of the fit give and those of the rule."""


def test_model_of_an_outcome_goes_on(outcome: Result) -> None:
    shown = outcome.validation("check").simulated
    again = validate_on(outcome.estimate.validated_model, outcome.model.start, "check")
    np.testing.assert_array_equal(again.simulated, shown)
    by_rule = validate_on(outcome.model, outcome.model.start, "check").simulated
    assert 0 < np.abs(by_rule - shown).max() < AS_FITTED * np.abs(shown).max()
    table = simulate(three_experiments(), parameters=outcome.values, experiment="payload")
    torque = table.select(["tau1", "tau2"])[::10]
    shown = outcome.validation("payload").simulated
    np.testing.assert_allclose(torque, shown, rtol=0, atol=AS_FITTED * np.abs(shown).max())


def test_frame_of_an_outcome(outcome: Result) -> None:
    frame = outcome.to_frame()
    assert list(frame.index) == list(outcome.estimate.names)
    assert frame.loc["ZZ2", "value"] == outcome.values["ZZ2"]
    assert frame.loc["ZZ2[payload]", "experiment"] == "payload"
    assert (frame["low"] < frame["high"]).all()
    assert frame["value"].dtype == float


def test_figure_of_each_experiment(outcome: Result) -> None:
    figure = outcome.plot("payload")
    panels = [plotted(axes) for axes in figure.axes]
    assert [set(panel) for panel in panels] == [{"measured", "simulated"}, {"residual"}] * 2
    shown, torque = outcome.validation("payload"), panels[0]
    np.testing.assert_allclose(torque["measured"].get_ydata(), shown.measured[:, 0], rtol=1e-6)
    time, simulated = torque["simulated"].get_data()  # every control period, the samples among them
    assert np.size(time) > 4 * shown.time.size
    np.testing.assert_allclose(np.interp(shown.time, time, simulated), shown.simulated[:, 0], rtol=1e-6)
    first = plotted(outcome.plot().axes[0])["measured"].get_ydata()
    np.testing.assert_allclose(first, outcome.validation("light").measured[:, 0], rtol=1e-6)
    with pytest.raises(UnknownNameError):
        outcome.plot("nowhere")


def test_notebook_view_is_self_contained_and_escaped(outcome: Result) -> None:
    text = outcome._repr_html_()
    assert len(text) < 20_000
    assert "<script" not in text
    assert "http" not in text
    assert "own to payload" in text
    assert "torque error, all fitted" in text and "torque error, check (validation)" in text
    evil = identify(three_experiments(name="<script>alert(1)</script>"))
    assert "<script>" not in evil._repr_html_()


def test_saved_result_is_that_of_the_outcome(tmp_path: Path) -> None:
    case = load_case("examples/scara/identify.yaml")
    outcome = identify(case, tmp_path)
    assert load_result(tmp_path) == outcome
    assert (tmp_path / "robot_identified.yaml").is_file()


@pytest.mark.gate
@pytest.mark.parametrize("name", ["", "result.json"])
@pytest.mark.parametrize("kind", [str, Path])
def test_result_is_loaded_from_a_folder_or_its_file(outcome: Result, tmp_path: Path, kind: type, name: str) -> None:
    assert outcome.save(tmp_path) == tmp_path / "result.json"
    loaded = Result.load(kind(tmp_path / name))
    assert loaded == outcome == load_result(kind(tmp_path / name))
    assert loaded.summary() == outcome.summary()
    assert loaded.robot == outcome.robot
    assert loaded.robots == outcome.robots
    for axes, expected in zip(loaded.plot("payload").axes, outcome.plot("payload").axes, strict=True):
        drawn, wanted = plotted(axes), plotted(expected)
        assert list(drawn) == list(wanted)
        for name, line in drawn.items():
            np.testing.assert_array_equal(line.get_ydata(), wanted[name].get_ydata())
    pd.testing.assert_frame_equal(loaded.covariance, outcome.covariance)
    assert (tmp_path / "report.html").is_file()


def test_results_that_differ_are_not_equal(outcome: Result, tmp_path: Path) -> None:
    table = outcome.save(tmp_path).parent / "torque_light.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    cells = lines[1].split(",")
    lines[1] = ",".join([cells[0], f"{float(cells[1]) + 1e-9:.17g}", *cells[2:]])
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert Result.load(tmp_path) != outcome


def test_loaded_result_is_saved_again(outcome: Result, tmp_path: Path) -> None:
    outcome.save(tmp_path / "one")
    Result.load(tmp_path / "one").save(tmp_path / "two")
    for path in (tmp_path / "one").glob("[!.]*"):
        assert (tmp_path / "two" / path.name).read_bytes() == path.read_bytes()


def test_result_without_its_torques_says_so(outcome: Result, tmp_path: Path) -> None:
    outcome.save(tmp_path)
    for table in tmp_path.glob("torque_*.csv"):
        table.unlink()
    loaded = load_result(tmp_path)
    assert loaded.values == outcome.values
    with pytest.raises(InputError, match=r"no torque_payload\.csv beside result\.json"):
        loaded.plot("payload")
    with pytest.raises(InputError, match="without the torques"):
        loaded.save(tmp_path / "copy")
    with pytest.raises(InputError, match="holds no loop and no fit"):
        _ = loaded.model
    with pytest.raises(UnknownNameError, match="Did you mean 'payload'"):
        loaded.plot("paylod")


def test_damaged_results_are_refused(outcome: Result, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="There is no result"):
        load_result(str(tmp_path))
    outcome.save(tmp_path)
    (tmp_path / "torque_light.csv").write_text("a,b\n1,2\n3,4\n", encoding="utf-8")
    with pytest.raises(InputError, match="no table of torques"):
        load_result(tmp_path)
    (tmp_path / "result.json").write_bytes(b"\xff{")
    with pytest.raises(InputError, match="does not follow the schema"):
        load_result(tmp_path)


def test_covariance_and_correlation_have_labels(outcome: Result) -> None:
    names = list(outcome.values)
    assert list(outcome.covariance.index) == list(outcome.covariance.columns) == names
    np.testing.assert_array_equal(outcome.covariance, outcome.estimate.covariance)
    assert outcome.covariance.loc["ZZ2", "ZZ2"] ** 0.5 == pytest.approx(outcome.parameters["ZZ2"].std)
    np.testing.assert_allclose(np.diag(outcome.correlation), 1)
    np.testing.assert_allclose(outcome.correlation, outcome.document.correlation, atol=1e-4)
    earlier = replace(outcome, document=outcome.document.model_copy(update={"covariance": []}))
    with pytest.raises(InputError, match="earlier version"):
        _ = earlier.covariance


@pytest.mark.gate
def test_discovered_gives_what_findings_json_holds(found: tuple[Discovered, Path]) -> None:
    discovered, folder = found
    document = load_findings(folder)
    assert document == discovered.document
    shared = [name for name in vars(Discovered) if name in type(document).model_fields]
    assert {"verdict", "findings", "gap", "files", "notes", "noise", "refused", "regions"} <= set(shared)
    for name in shared:
        assert getattr(discovered, name) == getattr(document, name)
    assert repr(discovered).endswith("named_with_remainder: actuator_lag 2)")
    assert discovered.summary() == discovery_table(document)


@pytest.mark.gate
def test_discovered_as_frame_figure_and_notebook_cell(found: tuple[Discovered, Path]) -> None:
    discovered, _ = found
    frame = discovered.to_frame()
    assert list(frame["parameter"]) == ["T_2"]
    assert frame.loc[0, "value"] == discovered.findings[0].parameters[0].value
    figure = discovered.plot("validation")
    panel = plotted(figure.axes[0])
    assert set(panel) == {"measured", "base model", "final model"}
    torque = discovered.model.torque(discovered.model.start, "validation")
    time, final = panel["final model"].get_data()
    samples = panel["measured"].get_xdata()
    assert np.size(time) > 3 * np.size(samples)  # every control period
    np.testing.assert_allclose(np.interp(samples, time, final), torque[:, 0], rtol=1e-5, atol=1e-5)
    assert "Lag of the current loop, joint 2" in discovered._repr_html_()
    with pytest.raises(UnknownNameError):
        discovered.plot("nowhere")


@pytest.mark.gate
def test_augmented_case_of_a_case_in_memory_holds_its_signals(found: tuple[Discovered, Path]) -> None:
    discovered, folder = found
    case = load_case(folder / discovered.files["case"])
    assert case.document.files == ("data_1.csv", case.document.files[1])
    final = discovered.found.discovery.final
    measured = case.model.experiments.measured_in("estimation")
    np.testing.assert_allclose(measured[-final.model.measured.shape[0] :], final.model.measured, rtol=0, atol=1e-6)


def test_discovery_records_the_constants_on_which_it_depends(found: tuple[Discovered, Path]) -> None:
    thresholds = found[0].provenance["thresholds"]
    assert thresholds == recorded(DECIDING)
    assert thresholds["discovery.selection.decide.bic"] == 10.0


def test_loaded_discovery_is_that_of_the_session(found: tuple[Discovered, Path]) -> None:
    discovered, folder = found
    for path in (folder, str(folder), folder / "findings.json"):
        loaded = Discovered.load(path)
        assert loaded == discovered
        assert loaded.summary() == discovered.summary()
        for axes, expected in zip(loaded.plot("validation").axes, discovered.plot("validation").axes, strict=True):
            drawn, wanted = plotted(axes), plotted(expected)
            assert list(drawn) == list(wanted)
            for name, line in drawn.items():
                np.testing.assert_allclose(line.get_ydata(), wanted[name].get_ydata(), rtol=1e-5, atol=1e-5)
    with pytest.raises(InputError, match="holds no fits"):
        _ = loaded.model
    with pytest.raises(UnknownNameError):
        loaded.plot("nowhere")


def test_discovery_in_memory_is_saved_as_out_saves_it(found: tuple[Discovered, Path], tmp_path: Path) -> None:
    discovered, folder = found
    in_memory = Discovered(discovered.found.document, discovered.found, case=discovered.case)
    assert in_memory.files == {}
    path = in_memory.save(tmp_path / "saved")
    assert path == tmp_path / "saved" / "findings.json"
    names = {file.name for file in folder.iterdir()}
    assert {file.name for file in path.parent.iterdir()} == names
    assert load_findings(path) == load_findings(folder)
    assert Discovered.load(path) == in_memory == discovered


def test_loaded_discovery_is_saved_again(found: tuple[Discovered, Path], tmp_path: Path) -> None:
    discovered, folder = found
    copy = tmp_path / "copies" / "copy"
    Discovered.load(folder).save(copy)
    assert {file.name for file in copy.iterdir()} == {file.name for file in folder.iterdir()}
    assert load_findings(copy) == discovered.document
    one, other = (load_case(place / discovered.files["case"]).model for place in (folder, copy))
    np.testing.assert_array_equal(other.torque(other.start), one.torque(one.start))
    (copy / discovered.files["plant_fmu"]).unlink()
    with pytest.raises(InputError, match="A file of the discovery is missing"):
        Discovered.load(copy).save(tmp_path / "third")
    assert not (tmp_path / "third" / "findings.json").exists()


def test_torque_errors_of_a_discovery_are_by_all_samples_as_those_of_an_identification(
    found: tuple[Discovered, Path],
) -> None:
    """The search leaves out the first quarter of a second."""
    discovered, _ = found
    assert discovered.case is not None
    steps = discovered.found.discovery
    for label, whole in discovered.case.model.experiments.items():
        own = steps.final.model.experiments[label]
        assert own.time[0] > whole.time[0] and own.time[-1] == whole.time[-1]
        for fit, told in zip((steps.base, steps.final), discovered.error_percent[label], strict=True):
            model = fit.model.with_experiment(label, whole)
            assert told == pytest.approx(relative_error_percent(whole.torque, model.torque(fit.values, label))[0])


def test_discoveries_that_differ_are_not_equal(found: tuple[Discovered, Path]) -> None:
    discovered, _ = found
    document = discovered.document
    assert Discovered(document.model_copy(update={"notes": [], "files": {}})) == discovered
    assert Discovered(document.model_copy(update={"verdict": "not_settled"})) != discovered
    assert Discovered(document.model_copy(update={"findings": []})) != discovered
    assert discovered != document


@pytest.mark.gate
def test_augmented_case_of_a_controller_in_memory_asks_for_it_again(tmp_path: Path) -> None:
    case = load_case(ARM / "discover.yaml")
    source = case.document.parts["controller"].source
    controller = read_controller(ARM / str(source))
    discovered = discover(case, tmp_path, controller=controller, rounds=1)
    assert [(finding.effect, finding.joint) for finding in discovered.findings] == [("actuator_lag", 2)]
    note = next(note for note in discovered.notes if "in memory" in note)
    assert "<controller>" in note
    assert "run with its plant as an FMU, gives the fitted torque" in note
    with pytest.raises(InputError, match="was in memory when it was saved"):
        load_case(tmp_path / discovered.files["case"])
    assert simulate(tmp_path / discovered.files["case"], controller=controller).time.size > 2


def test_archive_takes_the_values_of_an_outcome(tmp_path: Path) -> None:
    outcome = identify(load_case("examples/scara/identify.yaml"))
    path = export_ssp("examples/scara/identify.yaml", tmp_path / "loop.ssp", result=outcome)
    assert read_ssp(path).components["plant"].parameter_values()["ZZ1"] == outcome.values["ZZ1R"]
