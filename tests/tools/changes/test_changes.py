"""Drawn pairs of logs: what is drawn is what is stated, and the score tells right from wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.tools.changes.draw import CAUSES, NOTHING, PLAN, TWO, draw, write
from tests.tools.changes.results import Counts, Machine, count, figures, numbers
from tests.tools.changes.run import read_lines, run
from tests.tools.changes.score import KINDS, criteria, judged, shares, truth_of


def truth(*changes: tuple[str, int], repaired: bool = False) -> dict[str, Any]:
    return {"changes": [{"cause": cause, "joint": joint} for cause, joint in changes], "repaired": repaired}


def line(*causes: list[list[Any]], answer: str = "named", verdict: str = "valid") -> dict[str, Any]:
    return {"answer": answer, "verdict": verdict, "causes": list(causes)}


def test_a_third_of_the_pairs_and_more_have_not_changed_and_all_causes_are_drawn() -> None:
    assert PLAN.count(NOTHING) >= len(PLAN) / 3
    assert set(CAUSES) == set(KINDS) == set(PLAN) - {NOTHING, TWO}


@pytest.mark.parametrize("number", [PLAN.index(cause) for cause in CAUSES])
def test_a_pair_is_the_same_each_time_and_its_logs_differ_by_more_than_noise(number: int) -> None:
    one, again = draw(number, 5), draw(number, 5)
    assert (one.changes, one.robot) == (again.changes, again.robot)
    assert [change.cause for change in one.changes] == [PLAN[number]]
    logs = [plant.simulate(one.motions[0])[1] for plant in (one.before, one.after)]
    apart = np.sqrt(np.mean((logs[1] - logs[0]) ** 2, axis=0)) / np.sqrt(np.mean(logs[0] ** 2, axis=0))
    assert apart.max() > 0.002


def test_the_score_knows_right_names_and_where_a_wrong_one_misleads() -> None:
    gap = [["backlash", 2, "backlash on joint 2, new"]]
    assert judged(line(gap), truth(("backlash", 2))).right
    wrong = judged(line(gap), truth(("backlash", 1)))
    assert (wrong.right, wrong.in_set, wrong.wrong) == (False, False, True)
    assert not judged(line(gap, verdict="doubtful"), truth(("backlash", 1))).wrong
    assert not judged(line(gap), truth(("backlash", 2), repaired=True)).right  # it has gone, not come
    second = line([["payload", 2, "payload on the last link"]], gap, answer="ambiguous")
    found = judged(second, truth(("backlash", 2)))
    assert (found.right, found.in_set, found.wrong) == (False, True, False)


def test_a_change_of_an_unchanged_machine_is_an_alarm_and_wrong_where_it_is_called_valid() -> None:
    said = line([["payload", 2, "payload on the last link"]])
    assert (judged(said, truth()).alarm, judged(said, truth()).wrong) == (True, True)
    assert not judged(line(answer="unchanged"), truth()).alarm
    missed = judged(line(answer="unchanged"), truth(("clock", 0)))
    assert (missed.right, missed.in_set, missed.alarm) == (False, False, False)


def test_a_drive_that_gives_less_is_one_cause_under_two_names() -> None:
    for kind in KINDS["torque constant"]:
        assert judged(line([[kind, 1, "..."]]), truth(("torque constant", 1))).right


def test_shares_and_their_table() -> None:
    rows = [judged(line(answer="unchanged"), truth()), judged(line(answer="unchanged"), truth(("clock", 0)))]
    assert shares(rows)["alarm"] == (0, 1)
    assert shares(rows)["right"] == (0, 1)
    assert any("0 of 1" in row for row in criteria(rows))


@pytest.mark.slow
def test_a_pair_is_drawn_compared_and_not_compared_again(tmp_path: Path) -> None:
    write(draw(PLAN.index("payload"), 5), tmp_path / "pairs" / "p001")
    folders, out = [tmp_path / "pairs" / "p001"], tmp_path / "lines"
    found = run(folders, out)
    assert judged(found[0], truth_of(folders[0])).right, found
    assert run(folders, out) == found == read_lines(out)


@pytest.mark.slow
def test_what_stands_for_two_alone_and_may_be_absent_beside_the_second_gives_way(tmp_path: Path) -> None:
    """A belt that is slack and a drive that gives less: backlash explains most of both, and no gap is left beside the
    gain of the drive, but the elasticity with which it is confounded."""
    write(draw(50, 11), tmp_path / "pair")
    (found,) = run([tmp_path / "pair"], tmp_path / "lines.jsonl")
    assert judged(found, truth_of(tmp_path / "pair")).right, found
    assert [part[0] for part in found["causes"][0]] == ["joint_elasticity", "drive_gain"]


@pytest.mark.slow
def test_what_both_machines_have_and_one_log_tells_by_itself_is_no_change_beside_what_has(tmp_path: Path) -> None:
    """Friction of joint 1, and ripple and Stribeck friction of joint 2 in both logs, along another motion. What the log
    after says of the latter by itself may be nothing; that it is there as before explains that log far better."""
    write(draw(3, 21), tmp_path / "pair")
    (found,) = run([tmp_path / "pair"], tmp_path / "lines.jsonl")
    assert found["causes"] == [[["friction", 1, "friction of joint 1"]]], found
    assert "change-lacks" in found["codes"]


@pytest.mark.slow
def test_a_part_of_a_change_that_is_more_than_noise_by_a_little_is_not_a_second_cause(tmp_path: Path) -> None:
    """Play, and what its form leaves of it: named alone, with the doubt."""
    write(draw(22, 21), tmp_path / "pair")
    (found,) = run([tmp_path / "pair"], tmp_path / "lines.jsonl")
    assert judged(found, truth_of(tmp_path / "pair")).right, found
    assert len(found["causes"]) == 1
    assert "change-rest" in found["codes"]


@pytest.mark.slow
def test_nothing_is_said_to_have_changed_that_has_not_and_no_wrong_cause_is_valid(tmp_path: Path) -> None:
    """One round of the table on the page of compare, with its seed."""
    folders = [tmp_path / "pairs" / f"p{number:03d}" for number in range(len(PLAN))]
    for number, folder in enumerate(folders):
        write(draw(number, 3), folder)
    lines = run(folders, tmp_path / "lines", jobs=2)
    rows = [judged(line, truth_of(folder)) for line, folder in zip(lines, folders, strict=True)]
    assert shares(rows)["alarm"][0] == 0
    assert shares(rows)["wrong"][0] == 0
    assert sum(row.in_set for row in rows if len(row.truth) == 1) >= len(CAUSES) - 1


def test_figures_of_drawn_results_say_what_was_counted() -> None:
    found = Counts(still=2000, false=2, doubted=0, later=50, seen=40, told=10, near=9, held=10)
    rows = {row.split("|")[1].strip(): row.split("|")[2:] for row in figures(found, 4, 5, 1)["criteria"][2:]}
    assert [cell.strip() for cell in rows["unchanged logs that were called changed"]][:2] == ["0.1 %", "2 of 2000"]
    assert rows["unchanged logs that were called changed"][3].strip() == "0.1 %"
    assert rows["onset right within one log, of those told"][1].strip() == "9 of 10"
    assert figures(Counts(), 1, 1, 1)["histories"] == "1"


def test_machines_whose_results_are_drawn_take_turns_in_causes_and_rates() -> None:
    pairs = [draw(number, 5) for number in numbers(12)]
    causes = [pair.changes[0].cause for pair in pairs]
    assert causes[:3] == causes[3:6] == ["payload", "temperature", "friction"]
    assert {(pair.changes[0].cause, pair.rate_hz) for pair in pairs} == {
        (cause, rate) for cause in causes for rate in (20, 100)
    }  # fmt: skip


@pytest.mark.gate
def test_results_are_drawn_as_an_identification_says_and_a_history_of_them_is_counted(tmp_path: Path) -> None:
    machine, rng = Machine.of(draw(PLAN.index("payload"), 5), tmp_path), np.random.default_rng(2)
    still = {name: value for name, value in machine.before.items() if not name.startswith("Fc")}
    drawn = [machine.drawn(rng, machine.before) for _ in range(400)]
    own = machine.answer.shared
    for name in set(still) & set(own):
        values = np.array([one.shared[name].value for one in drawn])
        assert abs(values.mean() - still[name]) < 4 * own[name].std / np.sqrt(400), name
        assert values.std() == pytest.approx(own[name].std, rel=0.2), name
    friction = np.array([one.shared["Fc1"].value for one in drawn])
    assert friction.std() > 1.2 * own["Fc1"].std  # it varies from day to day
    found = Counts()
    count(machine, rng, 2, found)
    assert (found.still, found.later) == (60, 10)
    assert found.false <= 1
    assert found.near <= found.told <= 2
