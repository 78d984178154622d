"""The robot that moves, the residual over its posture, values beside the expected ones, and how a page says them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.checks.data.log import LOG_OUTLIERS
from fmu_didim.checks.judgement import DiagnosticResult, diagnostic_result
from fmu_didim.data.signals import trajectory
from fmu_didim.dynamics.robot import read_robot
from fmu_didim.report.drawing.forest_chart import Expectation, forest_chart
from fmu_didim.report.drawing.residual import Residual
from fmu_didim.report.drawing.residual_charts import share_with
from fmu_didim.report.drawing.skeleton import joint_points, skeleton
from fmu_didim.report.experiment_charts import posture_matrix
from fmu_didim.report.sections import Report
from fmu_didim.report.verdict import Banner
from fmu_didim.results.result import LinkResult, read_result
from tests.conftest import package
from tests.helpers import ROOT
from tests.patience import wait_until
from tests.report.test_browser import opened

Q = np.array([[0.3, -0.7], [1.9, 0.4]])


def link(kind: str = "revolute", **geometry: float) -> LinkResult:
    whole = {"alpha": 0.0, "a": 0.0, "theta": 0.0, "d": 0.0} | geometry
    return LinkResult.model_validate({"type": kind, **whole})


def test_points_of_a_planar_arm() -> None:
    """Base, both joints, and an end as far as the only link is long."""
    found = joint_points([link(), link(a=0.5)], Q)
    elbow = 0.5 * np.column_stack([np.cos(Q[:, 0]), np.sin(Q[:, 0]), np.zeros(2)])
    both = Q.sum(axis=1)
    end = elbow + 0.5 * np.column_stack([np.cos(both), np.sin(both), np.zeros(2)])
    np.testing.assert_allclose(found[:, 0], 0)
    np.testing.assert_allclose(found[:, 2], elbow, atol=1e-14)
    np.testing.assert_allclose(found[:, 3], end, atol=1e-14)


def test_a_long_motion_is_drawn_by_a_part_of_its_samples() -> None:
    time = 0.01 * np.arange(50_001)
    q = np.column_stack([np.sin(time), np.cos(0.7 * time)])
    links = [link(), link(a=0.5)]
    drawn = skeleton("one", "One", links, (0.0, 0.0, -9.81), time, q, np.abs(np.sin(time)))
    assert drawn is not None and drawn.time[[0, -1]].tolist() == [0.0, time[-1]]
    rows = np.searchsorted(time, drawn.time - 1e-9)
    np.testing.assert_allclose(drawn.points, joint_points(links, q[rows])[:, :, :2], atol=1e-12)
    assert len(drawn.path) == len(drawn.level) == 1200


def test_points_of_a_slide() -> None:
    """A vertical axis that carries a slide along the horizontal x axis of its frame turned by 90 degrees."""
    found = joint_points([link(d=0.4), link("prismatic", alpha=-np.pi / 2)], np.array([[0.0, 0.3]]))
    np.testing.assert_allclose(found[0, 1:3], [[0, 0, 0.4], [0, 0.3, 0.4]], atol=1e-14)


@pytest.mark.parametrize("seed", range(3))
def test_points_are_those_of_pinocchio(seed: int) -> None:
    pin = package("pinocchio")
    robot = read_robot(ROOT / "fmus/tx40/robot.yaml")
    model = pin.Model()
    for j, joint in enumerate(robot.joints):
        # Rx(alpha) Tx(a) stands before the joint, Rz(theta) Tz(d) of the description after it: they commute with q.
        before = pin.SE3(pin.utils.rotate("x", joint.alpha), np.zeros(3)) * pin.SE3(
            np.eye(3), np.array([joint.a, 0, 0])
        )
        before = before * pin.SE3(pin.utils.rotate("z", joint.theta), np.array([0, 0, joint.d]))
        model.addJoint(j, pin.JointModelRZ(), before, f"j{j}")
    data, q = model.createData(), np.random.default_rng(seed).uniform(-2, 2, size=6)
    pin.forwardKinematics(model, data, q)
    links = [link(j.type, alpha=j.alpha, a=j.a, theta=j.theta, d=j.d) for j in robot.joints]
    found = joint_points(links, q[None])[0, 1:-1]
    np.testing.assert_allclose(found, [data.oMi[k + 1].translation for k in range(6)], atol=1e-12)


@pytest.mark.parametrize(
    ("gravity", "axis", "sign"), [((0.0, -9.81, 0.0), 1, 1.0), ((0.0, 9.81, 0.0), 1, -1.0), ((-9.81, 0.0, 0.0), 0, 1.0)]
)
def test_up_is_against_gravity(gravity: Sequence[float], axis: int, sign: float) -> None:
    """In the plane of an arm: along its y or its x axis."""
    q = np.column_stack([np.linspace(0, 6, 50), np.zeros(50)])
    drawn = skeleton("s", "title", [link(), link(a=0.5)], gravity, np.arange(50.0), q, np.zeros(50))
    assert drawn is not None
    elbow = 0.5 * np.column_stack([np.cos(q[:, 0]), np.sin(q[:, 0])])
    np.testing.assert_allclose(drawn.points[:, 2, 1], sign * elbow[:, axis], atol=1e-12)


def test_a_robot_in_space_is_seen_from_aside_and_drawn_with_few_numbers() -> None:
    robot = read_robot(ROOT / "fmus/tx40/robot.yaml")
    links = [link(j.type, alpha=j.alpha, a=j.a, theta=j.theta, d=j.d) for j in robot.joints]
    time = np.linspace(0, 10, 5000)
    q = np.sin(time[:, None] * np.arange(1, 7))
    left = np.where(time > 9, 30.0, 0.5)
    drawn = skeleton("s", "title", links, robot.gravity, time, q, left)
    assert drawn is not None
    assert drawn.points.shape == (240, 8, 2)
    assert np.linalg.matrix_rank(drawn.points.reshape(-1, 2)) == 2
    assert drawn.points[:, 2, 1].max() > 0  # the shoulder stands above the base
    assert set(drawn.level.tolist()) == {0.0, 4.0}
    assert len(drawn.json) < 100_000
    assert json.loads(drawn.json)["levels"] == 5


def test_nothing_is_drawn_of_a_motion_that_is_none() -> None:
    assert skeleton("s", "t", [link()], (0, 0, -9.81), np.arange(3.0), np.full((3, 1), np.nan), np.zeros(3)) is None


# ---- the residual over the posture, values beside the expected ones ------------------------------


def residual(values: np.ndarray, *, names: Sequence[str] = ()) -> Residual:
    time = np.linspace(0, 10, 4000)
    signals = trajectory(time, {"q1": np.sin(3 * time), "q2": np.sin(4.7 * time)})
    noise = np.random.default_rng(1).normal(size=(4000, 2))
    both = noise + values[:, None] * [1.0, 0.0]
    return Residual(
        "1", "estimation", signals, ["N.m"] * 2, [{"residual": ("residual", c)} for c in both.T], [[], []], names
    )


def test_a_residual_that_goes_with_another_joint_stands_out() -> None:
    time = np.linspace(0, 10, 4000)
    table = posture_matrix(residual(2 * np.sin(4.7 * time)))
    assert table is not None
    shares = {name: [int(cell.text) for cell in cells] for name, cells in table.rows}
    assert table.columns == ("q1", "q2")
    assert shares["Joint 1"][1] == pytest.approx(100 * 2 / 3, abs=3)  # 2 of 3: a sine of 2 has a variance of 2
    assert max(shares["Joint 1"][0], *shares["Joint 2"]) < 8


def test_outputs_of_a_model_have_no_posture() -> None:
    assert posture_matrix(residual(np.zeros(4000), names=["T1", "T2"])) is None


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_noise_has_no_share(size: float) -> None:
    rng = np.random.default_rng(2)
    assert share_with(rng.normal(size=3000), size * rng.normal(size=3000)) < 0.02


def test_values_stand_beside_what_was_expected() -> None:
    values = {"a": Expectation(1.1, 0.05, 1.0), "b": Expectation(-3.0, 0.0, -2.0), "c": Expectation(1.0, 1.0, 0.0)}
    found = forest_chart("f", "title", "the description", {"value": values})
    assert found is not None
    assert [text for _, text in found.ticks] == ["a", "b"]  # nothing is a part of zero
    (series,) = found.panels[0].series
    np.testing.assert_allclose(series.y, [10.0, -50.0])
    np.testing.assert_allclose(series.error, [9.8, 0.0], atol=0.01)
    assert forest_chart("f", "title", "the truth", {"value": {"c": Expectation(1.0, 1.0, 0.0)}}) is None


def test_several_series_stand_side_by_side() -> None:
    one = {"a": Expectation(1.0, 0.1, 1.0)}
    found = forest_chart("f", "title", "the truth", {"first": one, "second": one})
    assert found is not None
    places = [float(series.x[0]) for series in found.panels[0].series]
    assert places == [-0.125, 0.125]


# ---- reasons and remarks -------------------------------------------------------------------------


def reason(code: str, step: str) -> DiagnosticResult:
    return diagnostic_result(Diagnostic(LOG_OUTLIERS, code)).model_copy(update={"next_step": step})


@pytest.mark.parametrize(
    ("steps", "shown"),
    [
        (["a", "a", "a", "a"], ["", "", "", "a"]),
        (["a", "b", "a"], ["", "b", "a"]),
        (["", "a", ""], ["", "a", ""]),
        ([], []),
    ],
)
def test_the_same_advice_is_given_once(steps: list[str], shown: list[str]) -> None:
    banner = Banner("doubtful", "DOUBTFUL", "", [reason(f"r{k}", step) for k, step in enumerate(steps)])
    assert [step for _, step in banner.advised] == shown


def test_remarks_that_differ_by_place_and_numbers_are_one_group() -> None:
    remarks = [
        "joint 1: the residual is not white (0.46): 1.8 times.",
        "Started from elsewhere.",
        "estimation: joint 2: the residual is not white (-5.0e-1): 2.8 times.",
    ]
    report = Report("r", "r", Banner("good", "VALID", ""), [], remarks=remarks)
    assert report.remark_groups == [(remarks[0], [remarks[2]]), (remarks[1], [])]


# ---- on the page ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def page_of_an_arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("arm")
    identify(ROOT / "examples/arm2r/discover.yaml", out=folder)
    return folder / "report.html"


@pytest.mark.gate
def test_the_robot_moves(browser: Any, page_of_an_arm: Path) -> None:
    page, told = opened(browser, page_of_an_arm)
    assert read_result(page_of_an_arm.parent).geometry is not None
    assert page.locator(".skeleton").count() == 2  # of both experiments
    first = page.locator(".skeleton").first
    before = first.locator(".link").first.get_attribute("d")
    first.locator("input").focus()
    page.keyboard.press("End")
    at_end = first.locator(".link").first.get_attribute("d")
    assert at_end != before
    assert first.locator("output").inner_text() == "20 s"
    first.locator("button").click()
    wait_until(lambda: first.locator("output").inner_text() != "20 s", "motion")
    first.locator("button").click()
    assert first.locator("button").inner_text() == "play"
    assert not told


@pytest.mark.gate
@pytest.mark.parametrize(("width", "hinted"), [(390, True), (1400, False)])
def test_tables_that_are_too_wide_say_so_and_scroll(
    browser: Any, page_of_an_arm: Path, width: int, hinted: bool
) -> None:
    page, _ = opened(browser, page_of_an_arm, width=width)
    table = page.locator(".scroll").first
    assert (table.get_attribute("class") == "scroll wide") is hinted
    hint = table.evaluate("e => getComputedStyle(e, '::before').content")
    assert ("scroll sideways" in hint) is hinted
    if hinted:
        name = table.locator("tbody th").first
        before = name.bounding_box()["x"]
        table.evaluate("e => { e.scrollLeft = e.scrollWidth; }")
        assert table.evaluate("e => e.scrollLeft") > 0
        assert name.bounding_box()["x"] == pytest.approx(before, abs=1)  # the names of the rows stay


@pytest.mark.gate
def test_remarks_stand_below_the_parameters(browser: Any, page_of_an_arm: Path) -> None:
    page, _ = opened(browser, page_of_an_arm)
    heads = page.locator("h2").all_inner_texts()
    assert heads[:3] == ["Parameters", "Remarks", "Experiments"]
    steps = [line for line in page.locator(".banner").inner_text().splitlines() if line.startswith("Next:")]
    assert len(steps) == len(set(steps)) < page.locator(".banner li").count()
