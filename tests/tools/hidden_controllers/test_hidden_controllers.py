"""Controllers are hidden as it is said, and answers are judged as it is said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.tools.hidden_controllers.__main__ import main, one, read_rows
from tests.tools.hidden_controllers.draw import OUTSIDE, POSITION_NOISE, SCALE, draw
from tests.tools.hidden_controllers.score import Row, is_misled, lines, totals


def row(**changes: object) -> Row:
    """A line of a case that is right in all."""
    whole = {
        "robot": "scara", "hidden": "pid", "log_hz": 20.0, "seed": 1, "verdict": "valid", "right_law": True,
        "right_set": True, "gains": {"Kp1": 0.3}, "scale": [], "seconds": 1.0,
    }  # fmt: skip
    return whole | changes


def test_a_seed_draws_the_same_machine_with_noise_as_stated(tmp_path: Path) -> None:
    one, same, other = (draw("scara", "pd", 200.0, seed) for seed in (3, 3, 5))
    np.testing.assert_array_equal(one.log.values, same.log.values)
    assert one.truth != other.truth
    quick = np.diff(one.log.column("q1"), 4) / np.sqrt(70)
    assert np.std(quick) == pytest.approx(POSITION_NOISE, rel=0.1)
    path = one.write(tmp_path)
    guess = yaml.safe_load((tmp_path / "guess.yaml").read_text(encoding="utf-8"))
    np.testing.assert_allclose(one.truth["Kp"], SCALE * np.array(guess["Kp"]))
    assert "lag_s" in one.truth and "lag_s" not in guess
    assert "lag" not in path.read_text(encoding="utf-8")


def test_the_log_at_a_tenth_of_the_rate_is_of_the_same_machine() -> None:
    fast, slow = (draw("scara", "cascade", rate, 2) for rate in (200.0, 20.0))
    assert fast.truth == slow.truth
    np.testing.assert_array_equal(fast.log.values[::10], slow.log.values)


def test_laws_outside_alternate() -> None:
    assert [draw("scara", "outside", 20.0, seed).truth["law"] for seed in (2, 3)] == list(OUTSIDE)


@pytest.mark.parametrize(
    ("changes", "misled"),
    [
        ({}, False), ({"right_law": False}, True), ({"right_set": False}, True),
        ({"right_law": False, "verdict": "doubtful"}, False), ({"hidden": "outside", "right_law": False}, True),
        ({"hidden": "outside", "verdict": "refused", "right_law": False}, False),
    ],
)  # fmt: skip
def test_who_is_misled(changes: dict[str, object], misled: bool) -> None:
    assert is_misled(row(**changes)) == misled


def test_the_table_counts() -> None:
    rows = [row(), row(seed=2, right_set=False, verdict="doubtful", gains={}), row(seed=3, gains={"Kp1": 3.5})]
    found = totals([*rows, row(hidden="outside", verdict="refused")])
    assert found["law"] == "100 % (3 of 3)" and found["set"] == "67 % (2 of 3)"
    assert found["gains"] == "50 % (1 of 2)" and found["refused"] == "100 % (1 of 1)"
    assert found["misled"] == "0 % (0 of 4)"
    assert lines(rows)[2].startswith("| SCARA, 20 Hz | PID with filter | 100 % (3 of 3) | 67 % (2 of 3) |")


@pytest.mark.gate
def test_a_case_is_named_and_published(tmp_path: Path) -> None:
    out, figures = tmp_path / "lines.jsonl", tmp_path / "figures.json"
    asked = ["--robots", "scara", "--rates", "200", "--laws", "cascade", "--seeds", "1", "1"]
    assert main(["run", str(out), *asked]) == 0
    assert main(["run", str(out), *asked]) == 0  # what is there is not run again
    (found,) = read_rows(out)
    assert found["right_law"] and found["right_set"] and found["verdict"] == "valid"
    main(["publish", str(out), "--figures", str(figures), "--tree", "abc"])
    written = json.loads(figures.read_text(encoding="utf-8"))
    assert written["data"]["tree"] == "abc" and written["figures"]["scara_200.law"] == "100 % (1 of 1)"


@pytest.mark.slow
def test_the_filter_of_one_joint_of_six_does_not_lose_the_law() -> None:
    """A step takes it to zero, where nothing would show that it acts; a minute."""
    found = one(("tx40", "pid", 20.0, 41))
    assert found["right_law"] and found["right_set"] and found["verdict"] == "doubtful"
    assert max(map(abs, found["gains"].values())) < 4.0
