"""How curves are compared with the function that a case hides."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.tools.blind.curves import VARIABLES, Compared, figures, pair_figures, planted_function, within_band

AT = np.linspace(-1.0, 1.0, 61)


def notch(x: np.ndarray) -> np.ndarray:
    return np.exp(-((x / 0.2) ** 2))


@pytest.mark.parametrize(("ripple", "half", "within"), [(0.3, 0.05, True), (0.3, 0.5, True), (0.0, 0.05, False)])
def test_the_planted_ripple_is_a_part_of_what_depends_on_the_position(
    tmp_path: Path, ripple: float, half: float, within: bool
) -> None:
    """A curve that has it lies on the function; one that lacks it does not, unless its band is that wide."""
    (tmp_path / "truth.yaml").write_text(yaml.safe_dump({"clutter": "some", "parameters": {"Fc1": 5.0, "Fc2": 9.0}}))
    planted = planted_function(tmp_path / "truth.yaml", 1, VARIABLES["q"])
    np.testing.assert_allclose(planted(AT), 0.3 * np.sin(17.0 * AT))
    curve = {
        "variable": VARIABLES["q"], "at": AT, "half_width": np.full_like(AT, half),
        "torque": -2.0 * notch(AT) + ripple * np.sin(17.0 * AT) + 0.4 * AT + np.cos(AT),
    }  # fmt: skip
    assert (within_band(curve, notch, planted) == 1.0) is within


@pytest.mark.parametrize(
    ("variable", "clutter", "planted"),
    [
        (VARIABLES["dq"], "some", 0.05 * 5.0 * np.sign(AT) * np.exp(-((AT / 0.1) ** 2))),
        (VARIABLES["t"], "some", np.zeros_like(AT)),
        (VARIABLES["q"], "none", np.zeros_like(AT)),
    ],
)
def test_what_clutter_makes_of_a_variable(tmp_path: Path, variable: str, clutter: str, planted: np.ndarray) -> None:
    (tmp_path / "truth.yaml").write_text(yaml.safe_dump({"clutter": clutter, "parameters": {"Fc1": 5.0}}))
    np.testing.assert_allclose(planted_function(tmp_path / "truth.yaml", 1, variable)(AT), planted)


def test_figures_of_cases() -> None:
    """A torque from outside for a swell in time is counted apart; what is named and called valid is counted."""

    def case(hidden: str, judged: str, *named: str, within: float = float("nan")) -> Compared:
        return Compared(hidden, 100.0, "named" if named else "unknown", judged, named, within == within, within)

    found = [
        case("unknown_swell", "doubtful", "external_force, joint 1"),
        case("unknown_swell", "valid", "external_force, joint 1", "spring, joint 1"),
        case("unknown_swell", "doubtful", within=0.95),
        case("unknown_notch", "valid", "torque_ripple, joint 2"),
        case("unknown_notch", "doubtful", "external_force, joint 2", within=0.8),
    ]
    told = figures(found)
    assert {key: told[f"all_100hz_{key}"] for key in ("refused", "outside", "named_valid", "variable", "within")} == {
        "refused": "1 of 5", "outside": "1", "named_valid": "2", "variable": "2 of 5", "within": "1 of 2",
    }  # fmt: skip
    assert (told["swell_100hz_outside"], told["notch_100hz_outside"]) == ("1", "0")


def test_figures_of_effects_that_are_there(tmp_path: Path) -> None:
    """A class counts as its member; a curve beside names takes the place of none."""
    effects = [{"effect": "spring", "joint": 2}, {"effect": "torque_ripple", "joint": 2}]
    truth = {"truth": effects, "gap_sigma_rms_per_joint": {"train": [0.1, 1.5]}}

    def line(name: str, *named: tuple[str, int], curves: Sequence[int] = ()) -> dict[str, Any]:
        (tmp_path / name).mkdir()
        (tmp_path / name / "truth.yaml").write_text(yaml.safe_dump(truth))
        (tmp_path / name / "case.yaml").write_text(yaml.safe_dump({"measurement": {"rate_hz": 20}}))
        found = [{"effect": effect, "joint": joint} for effect, joint in named]
        return {"case": name, "findings": found, "curves": [{"joint": joint} for joint in curves]}

    lines = [
        line("a", ("gravity_compensator", 2), ("torque_ripple", 2)),
        line("b", ("spring", 2), ("current_ripple", 2), curves=[2]),
        line("c", ("torque_ripple", 2)),
        line("d", ("spring", 1), curves=[2]),
        line("e", ("spring", 1), ("torque_ripple", 2), curves=[1]),
        line("f"),
    ]
    assert pair_figures(tmp_path, lines) == {"pairs_20hz_named": "2 of 6", "pairs_20hz_curve": "1 of 6"}
