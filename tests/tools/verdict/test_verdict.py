"""No wrong answer is called valid, its cause is named, and right models stay valid: the part that takes seconds."""

from __future__ import annotations

import pytest

from fmu_didim.estimators import Didim
from tests.checks.data.right import loaded, quantised
from tests.tools.verdict import drawn, random_starts
from tests.tools.verdict.__main__ import NAMED, is_named, main
from tests.tools.verdict.catalogue import CATALOGUE, right
from tests.tools.verdict.random_starts import DATA, draw, run
from tests.tools.verdict.run import Answer, answer, named

QUICK = [w for w in CATALOGUE if "scara" in w.robots and w.name.split(":")[0] in ("timing", "model", "machine", "pair")]
"""Inputs that are refused before any work have tests of their own in ``tests/checks/data``."""


@pytest.mark.gate
def test_no_wrong_answer_is_called_valid_and_causes_are_named() -> None:
    truth = named(loaded("scara"))
    answers = {wrong.name: (wrong, answer(wrong.make("scara", 1), truth)) for wrong in QUICK}
    assert [name for name, (_, found) in answers.items() if found.is_wrong] == []
    told = [name for name, (wrong, found) in answers.items() if is_named(wrong, found)]
    assert len(told) >= NAMED * len(QUICK), sorted(answers.keys() - set(told))


@pytest.mark.gate
@pytest.mark.parametrize("seed", range(101, 107))
@pytest.mark.parametrize("robot", ["scara", "arm"])
def test_a_right_model_is_valid(robot: str, seed: int) -> None:
    found = answer(right(robot, seed), named(loaded(robot)))
    assert (found.verdict, found.codes) == ("valid", ())
    assert found.farthest < 5


@pytest.mark.slow
@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("robot", ["scara", "arm"])
def test_a_right_model_of_a_quantised_log_is_valid_and_its_intervals_hold(robot: str, bits: int) -> None:
    """Noise of 0.1 % of the torque, a seventh of what the steps of 8 bits make."""
    models = [quantised(right(robot, seed, noise=0.001), bits) for seed in range(111, 117)]
    found = [answer(model, named(loaded(robot))) for model in models]
    assert [one.codes for one in found] == [()] * len(found)
    assert sum(one.inside for one in found) >= 0.85 * sum(one.compared for one in found)  # three deviations below 95 %


@pytest.mark.gate
@pytest.mark.parametrize("bits", [pytest.param(8, marks=pytest.mark.slow), 12])
def test_a_wrong_model_of_a_quantised_log_is_not_valid(bits: int) -> None:
    makes = [w for w in QUICK if w.name.startswith(("machine", "model"))]
    found = {w.name: answer(quantised(w.make("scara", 1), bits), named(loaded("scara"))).verdict for w in makes}
    assert [name for name, verdict in found.items() if verdict == "valid"] == []


@pytest.mark.gate
@pytest.mark.parametrize(("robot", "seed"), [("scara", 8), ("scara", 11), ("arm", 5), ("arm", 184)])
def test_random_starts_end_in_the_usual_answer(robot: str, seed: int) -> None:
    """From 1/1000 to 1000 times the truth; the last one goes astray at first and gives way to another start."""
    model = right(robot, 500 + seed % DATA)
    assert run(model, Didim(start="torque").estimate(model), draw(loaded(robot), seed)).holds


@pytest.mark.parametrize(
    ("verdict", "farthest", "held_out", "wrong"),
    [("valid", 3.9, 1.4, False), ("valid", 4.1, 0.0, True), ("valid", 0.0, 1.6, True), ("doubtful", 99.0, 9.0, False)],
)
def test_what_counts_as_wrong(verdict: str, farthest: float, held_out: float, wrong: bool) -> None:
    assert Answer(verdict, (), farthest, held_out).is_wrong is wrong


def test_the_catalogue_has_sixty_entries_and_all_have_names_of_their_own() -> None:
    assert len({w.name for w in CATALOGUE}) == len(CATALOGUE) >= 60


@pytest.mark.slow
def test_whole_catalogue() -> None:
    assert main(["--seeds", "3", "--right", "20"]) == 0


@pytest.mark.gate
@pytest.mark.parametrize("robot", ["scara", pytest.param("arm", marks=pytest.mark.slow)])
def test_no_effect_that_is_drawn_and_shown_is_valid_and_wrong(robot: str) -> None:
    found = [one for _, _, one in drawn.drawn([robot], range(1, 9))]
    assert len(found) >= 6
    assert [one.what for one in found if one.answer.is_wrong and one.is_shown] == []


@pytest.mark.gate
def test_no_torque_without_a_name_that_is_shown_is_valid_and_wrong() -> None:
    found = [one for _, _, one in drawn.drawn(["scara"], range(1, 7), expressions=True)]
    assert len(found) >= 3
    assert any(one.answer.verdict == "doubtful" for one in found)
    assert [one.what for one in found if one.answer.is_wrong and one.is_shown] == []


def test_answers_are_counted_by_what_the_log_could_show() -> None:
    def one(chi_square: float, verdict: str, farthest: float) -> drawn.Drawn:
        return drawn.Drawn("", chi_square, Answer(verdict, (), farthest))

    told = [
        one(10, "valid", 5),
        one(100, "valid", 3),
        one(200, "valid", 4.5),
        one(2e3, "doubtful", 9),
        one(1e5, "refused", 0),
    ]
    found = drawn.figures(told)
    assert found["table"][2:] == [
        "| 0 to 60 | 1 | 0 | 0 | 1 |", "| 60 to 1000 | 2 | 0 | 1 | 1 |", "| 1000 to 10000 | 1 | 1 | 0 | 0 |",
        "| 10000 and more | 1 | 1 | 0 | 0 |",
    ]  # fmt: skip
    assert (found["count"], found["shown"], found["wrong"]) == ("5", "4", "1")


@pytest.mark.slow
@pytest.mark.parametrize("kinds", [[], ["--expressions"]], ids=["catalogue", "expressions"])
def test_what_is_drawn(kinds: list[str]) -> None:
    assert drawn.main(["--draws", "60", *kinds]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("bits", ["8", "12"])
def test_whole_catalogue_of_quantised_logs(bits: str) -> None:
    for kind in (
        "machine",
        "model",
        "controller",
        "scale",
    ):  # what is wrong with the file itself is seen before its steps
        assert main(["--seeds", "1", "--right", "5", "--robots", "scara", "arm", "--bits", bits, "--only", kind]) == 0


@pytest.mark.slow
def test_two_hundred_random_starts() -> None:
    assert random_starts.main(["--seeds", "200"]) == 0
