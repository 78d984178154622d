"""What identify and discover return, as text, data frame, figure and notebook cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import (
    Discovered,
    Outcome,
    discover,
    export_ssp,
    identify,
    load_case,
    load_findings,
    load_result,
    read_ssp,
    read_trajectory,
    simulate,
    validate,
)
from fmu_didim.base.errors import UnknownNameError
from fmu_didim.report import result_table
from fmu_didim.report.discovery.sections import discovery_table
from tests.report.drawn import plotted
from tests.workflow.three_experiments import PAYLOAD, three_experiments

ARM = Path("examples/arm2r")


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
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


def test_outcome_gives_values_and_what_judges_them(outcome: Outcome) -> None:
    assert outcome.converged
    assert repr(outcome) == "Outcome('SCARA, torque at 10 Hz', valid, 11 parameters)"
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


def test_model_of_an_outcome_goes_on(outcome: Outcome) -> None:
    again = validate(outcome.model, outcome.model.start, "check")
    np.testing.assert_array_equal(again.simulated, outcome.validation("check").simulated)
    table = simulate(three_experiments(), parameters=outcome.values, experiment="payload")
    torque = table.select(["tau1", "tau2"])[::10]
    np.testing.assert_allclose(torque, outcome.validation("payload").simulated, rtol=0, atol=1e-9)


def test_frame_of_an_outcome(outcome: Outcome) -> None:
    frame = outcome.to_frame()
    assert list(frame.index) == list(outcome.estimate.names)
    assert frame.loc["ZZ2", "value"] == outcome.values["ZZ2"]
    assert frame.loc["ZZ2[payload]", "experiment"] == "payload"
    assert (frame["low"] < frame["high"]).all()
    assert frame["value"].dtype == float


def test_figure_of_each_experiment(outcome: Outcome) -> None:
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


def test_notebook_view_is_self_contained_and_escaped(outcome: Outcome) -> None:
    text = outcome._repr_html_()
    assert len(text) < 20_000
    assert "<script" not in text
    assert "http" not in text
    assert "own to payload" in text
    assert "torque error, payload (estimation)" in text
    evil = identify(three_experiments(name="<script>alert(1)</script>"))
    assert "<script>" not in evil._repr_html_()


def test_saved_result_is_that_of_the_outcome(tmp_path: Path) -> None:
    case = load_case("examples/scara/identify.yaml")
    outcome = identify(case, tmp_path)
    assert load_result(tmp_path) == outcome.document
    assert (tmp_path / "robot_identified.yaml").is_file()


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


def test_augmented_case_of_a_case_in_memory_holds_its_signals(found: tuple[Discovered, Path]) -> None:
    discovered, folder = found
    case = load_case(folder / discovered.files["case"])
    assert case.document.files == ("data_1.csv", case.document.files[1])
    final = discovered.found.discovery.final
    measured = case.model.measured_in("estimation")
    np.testing.assert_allclose(measured[-final.model.measured.shape[0] :], final.model.measured, rtol=0, atol=1e-6)


def test_archive_takes_the_values_of_an_outcome(tmp_path: Path) -> None:
    outcome = identify(load_case("examples/scara/identify.yaml"))
    path = export_ssp("examples/scara/identify.yaml", tmp_path / "loop.ssp", result=outcome)
    assert read_ssp(path).components["plant"].parameter_values()["ZZ1"] == outcome.values["ZZ1R"]
