"""A motion that is designed keeps clear of boxes and of the robot itself, and what is not looked at is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import InputError, excite, load_case, trajectory
from fmu_didim.cli.main import main
from fmu_didim.data.signals import Trajectory
from fmu_didim.discovery.excitation.optimum import Problem
from fmu_didim.workflow.excitation.excited import Excited
from fmu_didim.workflow.excitation.findings import _of_space
from tests.helpers import ROOT
from tests.workflow.test_excite import LIMITS, NOISE, SCARA

LONG = (0.5, 0.35)
"""[m] Of the links; the second one is that of the capsules below."""
RADII = (0.05, 0.04)
CAPSULES = [
    {"link": j + 1, "from": [0, 0, 0], "to": [LONG[j], 0, 0], "radius": RADII[j]} for j in range(2)
]  # fmt: skip
BOX = [[0.55, 0.9], [-0.15, 0.1], [-1.0, 1.0]]
"""In the way of the best motion without it."""
QUICK: dict[str, Any] = {"torque_std": NOISE, "starts": 1, "period_s": 5.0, "periods": 1}
KINDS: list[dict[str, Any]] = [{}, {"kind": "point_to_point", "moves": 6}]


def points(table: Trajectory) -> list[np.ndarray]:
    """(N, 41, 2) points on the axes of both links, by the law of a planar arm, ten times as dense as the log."""
    q = table.select(["q1", "q2"])
    time = np.linspace(0, len(q) - 1, 10 * len(q))
    a, b = (np.interp(time, np.arange(len(q)), column) for column in (q[:, 0], q.sum(axis=1)))
    part, elbow = np.linspace(0, 1, 41)[:, None], LONG[0] * np.stack([np.cos(a), np.sin(a)])
    beyond = LONG[1] * np.stack([np.cos(b), np.sin(b)])
    return [np.moveaxis(part[:, :, None] * elbow.T, 0, 1), np.moveaxis(elbow.T + part[:, :, None] * beyond.T, 0, 1)]


def least(table: Trajectory, box: list[list[float]]) -> float:
    """The least distance of the links' surfaces from a box, m."""
    low, high = np.array(box[:2]).T
    found = [np.linalg.norm(x - np.clip(x, low, high), axis=-1).min() for x in points(table)]
    return float(min(d - radius for d, radius in zip(found, RADII, strict=True)))


def wide(**further: Any) -> dict[str, Any]:
    return {**LIMITS, "velocity": [3.0, 4.0], "acceleration": [10.0, 20.0], "torque": [45.0, 4.0], **further}


@pytest.mark.gate
@pytest.mark.parametrize("options", KINDS, ids=["fourier", "moves"])
def test_the_motion_keeps_out_of_a_box_that_the_best_one_goes_through(options: dict[str, Any]) -> None:
    free = excite(SCARA, limits=wide(), **QUICK, **options)
    assert least(free.prediction.loop, BOX) < -0.01
    found = excite(SCARA, limits=wide(capsules=CAPSULES, boxes=[BOX], clearance=0.01), **QUICK, **options)
    assert found.ok and least(found.prediction.loop, BOX) >= 0.01 - 1e-6
    assert least(found.reference, BOX) >= 0.01 - 2e-3
    assert found.prediction.criterion < free.prediction.criterion
    space = found.saved()["space"]
    assert space["compared"] == ["link 1, box 1", "link 2, box 1"] and space["left_out"] == ["link 2, link 1"]
    assert space["nearest"][0]["clearance_m"] == pytest.approx(least(found.prediction.loop, BOX), abs=0.02)
    assert "link 2, box 1" in found.summary() and "Links are not compared with each other" in found.summary()


@pytest.mark.gate
def test_the_arm_stays_inside() -> None:
    inside = [[-0.2, 0.95], [-0.45, 0.3], [-1.0, 1.0]]
    found = excite(SCARA, limits=wide(capsules=CAPSULES, inside=inside), **QUICK)
    assert found.ok
    for x, radius in zip(points(found.prediction.loop), RADII, strict=True):
        assert (x >= np.array(inside)[:2, 0] + radius - 1e-6)[:, -1].all()
        assert (x <= np.array(inside)[:2, 1] - radius + 1e-6)[:, -1].all()
    assert any(one["clearance_m"] < 0.05 for one in found.saved()["space"]["nearest"])  # it is used


def test_lines_stand_for_links_without_shape_and_that_is_told() -> None:
    found = excite(SCARA, limits={**LIMITS, "boxes": [[[0.6, 0.7], [0.1, 0.2], [-1, 1]]]}, **QUICK)
    told = {d.code.name: d for d in found.diagnostics}
    assert found.exit_code == 4 and "Lines between the origins" in told["excitation-shape-partial"].text
    only = excite(SCARA, limits={**LIMITS, "capsules": CAPSULES[1:], "boxes": [BOX]}, **QUICK)
    assert "No shape is known of link 1" in {d.code.name: d.text for d in only.diagnostics}["excitation-shape-partial"]
    none = excite(SCARA, limits=LIMITS, **QUICK)
    assert "are not looked at" in none.summary() and none.saved()["space"]["compared"] == []


FAR = [[2.0, 3.0], [0.0, 1.0], [-1.0, 1.0]]
AROUND = [[-2.0, 2.0], [-2.0, 2.0], [-1.0, 1.0]]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"start": [0.0, 0.0], "boxes": [BOX]}, "begin in a collision(.|\n)*link 2, box 1 by"),
        ({"boxes": [AROUND]}, "No posture keeps its space(.|\n)*link 1, box 1"),
        ({"inside": [[0.0, 0.2], [0.0, 0.2], [-1.0, 1.0]]}, "No posture keeps its space"),
        ({"boxes": [[[0.1, 2.0], [-2.0, 0.0], [-1, 1]], [[0.1, 2.0], [0.0, 2.0], [-1, 1]]]}, "No posture keeps"),
        ({"capsules": [{**CAPSULES[0], "link": 3}]}, "link that the robot does not have"),
        ({"capsules": [{**CAPSULES[0], "radius": -1}]}, "radius"),
        ({"boxes": [[[1, 0], [0, 1], [0, 1]]]}, "must be less than"),
        ({"inside": [[0, 1], [0, 1]]}, "inside"),
    ],
)
def test_what_cannot_be_kept_is_refused_before_any_work(
    changes: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Problem, "solved", lambda *_: pytest.fail("IPOPT was asked"))
    with pytest.raises(InputError, match=words):
        excite(SCARA, limits={**LIMITS, "capsules": CAPSULES, **changes}, **QUICK)


def test_no_reference_is_written_where_the_loop_comes_too_near(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The design looks at nothing, so that the motion goes through the box: the loop is looked at for itself."""
    monkeypatch.setattr(Problem, "_short_at", lambda *_: np.full(2, -1.0))
    monkeypatch.setattr(Problem, "_placed", lambda self, z, *_: z)
    found = excite(SCARA, tmp_path, limits=wide(capsules=CAPSULES, boxes=[BOX]), **QUICK)
    told = [d for d in found.diagnostics if d.code.name == "excitation-collision"]
    assert {d.place for d in told} >= {"link 2, box 1"} and "at t = " in told[0].text
    assert found.exit_code == 1 and [path.name for path in tmp_path.iterdir()] == ["excite.json"]


TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
POST = (
    '<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry><cylinder radius="{r}" length="{l}"/></geometry></collision>'
)


def folding(folder: Path, *, mesh: str = "") -> Path:
    """A planar arm whose second link reaches the post on which it stands."""
    inertia = " ".join(f'{name}="{value}"' for name, value in zip(TENSOR, (0.1, 0, 0, 0.1, 0, 0.1), strict=True))
    mass = f'<inertial><origin xyz="0.2 0 0"/><mass value="2"/><inertia {inertia}/></inertial>'
    post = POST.format(xyz="0 0 0", rpy="0 0 0", r=0.1, l=0.6)
    last = POST.format(xyz="0.225 0 0", rpy="0 1.5707963267948966 0", r=0.02, l=0.45)
    joint = (
        '<joint name="j{n}" type="revolute"><parent link="{p}"/><child link="{c}"/><origin xyz="{x} 0 0"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="3"/>'
        '<dynamics damping="1.0" friction="0.5"/></joint>'
    )
    if mesh:
        last = f'<collision><geometry><mesh filename="{mesh}"/></geometry></collision>'
    text = (
        f'<robot name="folding"><link name="base">{post}</link><link name="one">{mass}</link>'
        f'<link name="two">{mass}{last}</link>'
        + joint.format(n=1, p="base", c="one", x=0) + joint.format(n=2, p="one", c="two", x=0.4) + "</robot>"
    )  # fmt: skip
    path = folder / "folding.urdf"
    path.write_text(text, encoding="utf-8")
    return path


def of_urdf(path: Path, **capsules: Any) -> Excited:
    law = yaml.safe_load((ROOT / "controllers/scara_pd.yaml").read_text(encoding="utf-8"))
    (path.parent / "soft.yaml").write_text(yaml.safe_dump({**law, "Kp": [400, 60], "Kd": [25, 4]}), encoding="utf-8")
    case = load_case(SCARA, require_torque=False).with_(
        robot=str(path), plant={"kind": "model"}, validation=None,
        controller={"kind": "model", "source": str(path.parent / "soft.yaml")},
        estimator={"kind": "didim", "start": "description"},
    )  # fmt: skip
    limits = {
        "position": [[-1, 1], [1.5, 3]],
        "velocity": [2, 4],
        "acceleration": [8, 20],
        "torque": [60, 30],
        **capsules,
    }
    return excite(case, limits=limits, **{**QUICK, "torque_std": [0.1, 0.1]})


def from_post(made: Excited) -> float:
    """Least distance of the second link's surface from that of the post, m."""
    q = made.prediction.loop.select(["q1", "q2"])
    part, b = np.linspace(0, 1, 101), q.sum(axis=1)[:, None]
    x, y = (0.4 * f(q[:, :1]) + 0.45 * part * f(b) for f in (np.cos, np.sin))
    return float(np.hypot(x, y).min()) - 0.1 - 0.02


@pytest.mark.gate
def test_a_robot_of_a_urdf_keeps_clear_of_itself(tmp_path: Path) -> None:
    path = folding(tmp_path)
    blind = of_urdf(path, capsules=[])
    assert from_post(blind) < -0.01 and "are not looked at" in blind.summary()
    found = of_urdf(path)
    assert from_post(found) >= -1e-6 and found.ok
    space = found.saved()["space"]
    assert space["compared"] == ["link 2, link 0"] and space["shape_of_links"] == "the collision geometry of the URDF"
    assert "No shape is known of link 1" in {d.code.name: d.text for d in found.diagnostics}["excitation-shape-partial"]


def test_a_mesh_that_is_not_found_is_told(tmp_path: Path) -> None:
    found = of_urdf(folding(tmp_path, mesh="package://arm/two.stl"))
    told = {d.code.name: d.text for d in found.diagnostics}
    assert "link 2 (two)" in told["excitation-shape-unread"] and "not found" in told["excitation-shape-unread"]
    assert found.exit_code == 4 and found.saved()["space"]["not_read"]


@pytest.mark.gate
def test_the_command_reads_boxes_and_says_what_is_nearest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    limits = tmp_path / "limits.yaml"
    limits.write_text(yaml.safe_dump(wide(capsules=CAPSULES, boxes=[BOX])), encoding="utf-8")
    arguments = ["--torque-std", "0.17,0.0065", "--limits", str(limits), "--period", "5", "--starts", "1"]
    assert main(["excite", str(SCARA), *arguments, "--out", str(tmp_path / "out")]) == 0
    assert "nearest" in capsys.readouterr().out


@pytest.mark.gate
def test_each_random_start_keeps_its_space() -> None:
    drawn = []
    own = Problem.solved

    def kept(self: Problem, start: np.ndarray, bounds: Any, **options: Any) -> Any:
        q = self._motion(self.basis.grid(400), start)[0].T
        drawn.append(self.space.at(q).min() if self.space is not None else -1.0)
        return own(self, start, bounds, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Problem, "solved", kept)
        excite(SCARA, limits=wide(capsules=CAPSULES, boxes=[BOX]), **{**QUICK, "starts": 3})
    assert len(drawn) >= 3 and min(drawn[:3]) >= 0


def test_links_that_are_no_neighbours_and_always_overlap_are_told(tmp_path: Path) -> None:
    """The capsules of a robot of two links in mm: a post of 100 m."""
    post = [{"link": 0, "from": [0, 0, 0], "to": [0, 0, 0.3], "radius": 100}]
    found = excite(SCARA, limits={**LIMITS, "capsules": [*post, *CAPSULES]}, **QUICK)
    text = {d.code.name: d.text for d in found.diagnostics}["excitation-pairs-left-out"]
    assert "link 2, link 0" in text and found.saved()["space"]["compared"] == []


def test_clearances_of_links_behind_gears_that_give_way_are_told() -> None:
    found = excite(SCARA, limits={**LIMITS, "capsules": CAPSULES, "boxes": [FAR]}, **QUICK)
    assert "excitation-space-unverified" not in {d.code.name for d in found.diagnostics}
    told = _of_space(replace(found.around, is_elastic=True), found.prediction)
    assert "gears give way" in {d.code.name: d.text for d in told}["excitation-space-unverified"]
    loop = found.prediction.loop
    unseen = replace(found.prediction, loop=trajectory(loop.time, {"tau1": loop.column("tau1")}))
    assert (
        "no positions" in {d.code.name: d.text for d in _of_space(found.around, unseen)}["excitation-space-unverified"]
    )


def test_a_clearance_that_hardly_any_posture_changes_is_kept_all_the_same() -> None:
    """The elbow is the nearest to the post wherever the second link does not fold back."""
    post = {"link": 0, "from": [0, 0, 0], "to": [0, 0, 0.3], "radius": 0.05}
    found = excite(SCARA, limits={**LIMITS, "capsules": [post, *CAPSULES]}, **QUICK)
    assert found.saved()["space"]["compared"] == ["link 2, link 0"]
    assert found.saved()["space"]["left_out"] == ["link 1, link 0", "link 2, link 1"]
