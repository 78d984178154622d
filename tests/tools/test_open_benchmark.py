"""The scorer and the rules of ``examples/benchmark``; with the mark ``slow`` a few cases from end to end."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples.benchmark import __main__ as command
from examples.benchmark import real
from examples.benchmark import run as running
from examples.benchmark.answer import Answer, Name, named
from examples.benchmark.cases import KINDS, ORDER, Order, made
from examples.benchmark.methods import METHODS, NEEDS, TITLES, friction_models, neural
from examples.benchmark.score import OUTCOMES, counted, false_names, group, outcome, texts, within
from fmu_didim.base.errors import InputError
from fmu_didim.dynamics.effects import EFFECTS
from tests.tools.blind.score import Truth
from tests.tools.blind.simulator import hidden

STRIBECK = Truth((("stribeck", 2),), 1.5, True, 100.0, {"Fc2": 1.0, "Fv2": 2.0})
OUTSIDE = Truth((("unknown_chirp", 1),), 1.5, True, 100.0)
CLEAN = Truth((), 0.0, True, 100.0)
BARE = Truth((), 0.0, False, 100.0)
WHOLE = Truth((("drive_gain", None),), 1.5, False, 100.0)


def line(verdict: str, *names: Name, **more: Any) -> dict[str, Any]:
    return {"case": "b1", "seconds": 1.0, **Answer(verdict, names).line(), **more}


RIPPLE = Name("torque_ripple", 1)


@pytest.mark.parametrize(
    ("truth", "answer", "expected", "false"),
    [
        (STRIBECK, line("named", Name("stribeck", 2)), "right", 0),
        (STRIBECK, line("named", RIPPLE, Name("stribeck", 2)), "right", 0),  # planted, so neither right nor wrong
        (STRIBECK, line("named", Name("stribeck", 2), Name("spring", 1)), "right", 1),
        (STRIBECK, line("named", Name("stribeck", 1)), "missed", 0),  # planted there, too: what is hidden is not named
        (STRIBECK, line("named", Name("spring", 1), Name("stribeck", 2)), "wrong", 1),  # the first name counts
        (STRIBECK, line("named", Name("lugre", 2, ("stribeck",))), "in_set", 1),
        (STRIBECK, line("named", Name("lugre", 1, ("stribeck",))), "wrong", 1),  # the set is of another joint
        (STRIBECK, line("named", Name("lugre", 2, ("dahl",))), "wrong", 1),
        (STRIBECK, line("unknown"), "refused", 0),
        (STRIBECK, line("unknown", Name("spring", 1)), "wrong", 1),  # a name beside "unknown" is a name
        (STRIBECK, line("nothing"), "missed", 0),
        (STRIBECK, line("named", RIPPLE), "missed", 0),
        (STRIBECK, line("error"), "failed", 0),
        (WHOLE, line("named", Name("drive_gain", 2)), "right", 0),
        (OUTSIDE, line("unknown"), "right", 0),
        (OUTSIDE, line("nothing"), "missed", 0),
        (OUTSIDE, line("named", RIPPLE), "missed", 0),
        (OUTSIDE, line("unknown", Name("spring", 1)), "wrong", 1),
        (OUTSIDE, line("error"), "failed", 0),
        (CLEAN, line("nothing"), "right", 0),
        (CLEAN, line("named", RIPPLE), "right", 0),
        (BARE, line("named", RIPPLE), "wrong", 1),  # nothing was planted there
        (CLEAN, line("unknown"), "refused", 0),
        (CLEAN, line("named", Name("spring", 1)), "wrong", 1),
        (CLEAN, line("error"), "failed", 0),
    ],
)
def test_what_an_answer_is_worth(truth: Truth, answer: dict[str, Any], expected: str, false: int) -> None:
    assert expected in OUTCOMES
    assert outcome(answer, truth) == expected
    assert false_names(answer, truth) == false


def test_a_class_counts_as_its_members() -> None:
    truth = Truth((("power_viscous", 1),), 1.5, False, 100.0)
    assert outcome(line("named", Name("cubic_viscous", 1)), truth) == "right"


@pytest.mark.parametrize(
    ("truth", "expected"),
    [
        (STRIBECK, "catalogue"),
        (OUTSIDE, "outside"),
        (CLEAN, "clean"),
        (Truth((("stribeck", 1),), 0.9, True, 100.0), None),
    ],
)
def test_what_the_noise_hides_is_not_judged(truth: Truth, expected: str | None) -> None:
    assert group(truth) == expected


def test_parameters_are_compared_with_their_own_deviation() -> None:
    values = {"Fc2": [1.29, 0.1], "Fv2": [2.31, 0.1], "Fs2": [9.0, 0.1]}  # the truth has no Fs2
    assert within(line("named", parameters=values), STRIBECK) == (1, 2)


def test_the_tables_hold_what_was_counted() -> None:
    truths = {"b1": STRIBECK, "b2": OUTSIDE, "b3": CLEAN, "b4": Truth((("stribeck", 1),), 0.5, True, 100.0)}
    good = {
        "b1": line("named", Name("stribeck", 2)),
        "b2": line("unknown"),
        "b3": line("nothing"),
        "b4": line("nothing"),
    }
    bad = {"b1": line("named", Name("spring", 1)), "b2": line("named", Name("spring", 1)), "b3": line("error"),
           "b4": line("named", Name("spring", 1))}  # fmt: skip
    lines = {m: [{**one, "case": name} for name, one in own.items()] for m, own in (("ours", good), ("sindy", bad))}
    data = {"order": {"first_seed": 5, "seeds": 3}, "packages": {"a": "1.0"}, "methods": counted(lines, truths)}
    shown = texts(json.loads(json.dumps(data)))
    assert shown["cases"] == "3"
    assert shown["seeds"] == "5 to 7"
    assert shown["packages"] == "a 1.0"
    assert shown["catalogue"][2] == "| this project | 1 | 1 | 0 | 0 | 0 | 0 | 0 | 1 | 0 |"
    assert shown["catalogue"][3] == "| SINDy | 1 | 0 | 0 | 1 | 0 | 0 | 0 | 0 | 1 |"
    assert shown["outside"][3] == "| SINDy | 1 | 0 | 0 | 1 | 0 | 0 | 0 | 0 | 1 |"
    assert shown["clean"][3] == "| SINDy | 1 | 0 | 0 | 0 | 0 | 0 | 1 | 0 | 0 |"
    assert "| stribeck | 1 of 1 | 0 of 1, wrong name 1 |" in shown["kinds"]
    with pytest.raises(ValueError, match="sindy was run on 1 cases"):
        counted({"sindy": lines["sindy"][:1]}, truths)


def test_names_are_those_of_the_catalogue() -> None:
    assert set(KINDS) <= set(EFFECTS) & set(hidden.EFFECTS)
    assert {effect for effects in friction_models.MEANS.values() for effect in effects} <= set(EFFECTS)
    assert set(TITLES) == set(METHODS)


def test_the_order_of_names_is_kept() -> None:
    assert named([]) == Answer("nothing")
    assert [f["effect"] for f in named([Name("b", 1), Name("a", 2)]).line()["findings"]] == ["b", "a"]


# ---- what is kept ----------------------------------------------------------------------------------


def test_a_failure_and_a_slow_method_are_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(case: Path) -> Answer:
        raise ValueError("no")

    methods = {"broken": broken, "fine": lambda case: Answer("unknown")}
    monkeypatch.setattr(running, "translate", lambda folder, out: out / "identify.yaml")
    one = running.one(tmp_path / "b1", tmp_path, "broken", methods)
    assert (one["verdict"], one["error"], one["findings"]) == ("error", "ValueError: no", [])
    assert running.one(tmp_path / "b1", tmp_path, "fine", methods)["verdict"] == "unknown"
    monkeypatch.setattr(running, "BUDGET_S", -1.0)
    assert running.one(tmp_path / "b1", tmp_path, "fine", methods)["verdict"] == "error"


def test_what_changed_is_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, ran = tmp_path / "cases" / "b1", list[str]()
    folder.mkdir(parents=True)
    (folder / "case.yaml").write_text("a: 1", encoding="utf-8")

    def one(folder: Path, work: Path, method: str) -> dict[str, Any]:
        ran.append(method)
        return line("nothing", case=folder.name)

    monkeypatch.setattr(running, "one", one)
    for _ in range(2):
        assert len(running.run([folder], tmp_path, "ours")) == 1
    assert ran == ["ours"]
    (folder / "case.yaml").write_text("a: 2", encoding="utf-8")
    running.run([folder], tmp_path, "ours")
    monkeypatch.setattr(running, "code_digest", lambda: "other")
    (found,) = running.run([folder], tmp_path, "ours")
    assert len(ran) == 3
    assert found["case"] == "b1"


def test_cases_of_another_order_are_not_taken(tmp_path: Path) -> None:
    (tmp_path / "cases").mkdir()
    with pytest.raises(InputError, match="cut short"):
        made(tmp_path, Order())
    (tmp_path / ORDER).write_text(json.dumps({"kinds": ["spring"], "first_seed": 1}), encoding="utf-8")
    with pytest.raises(InputError, match="another order") as told:
        made(tmp_path, Order(("spring",), 2))
    assert "first_seed 1" in str(told.value)
    assert "spring" not in str(told.value)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--figures", "x.json", "--seeds", "1"], "for all methods on the published cases"),
        (["--figures", "x.json", "--methods", "ours"], "for all methods on the published cases"),
        (["--kinds", "rust"], "invalid choice: 'rust'"),
    ],
)
def test_figures_are_of_all_methods_and_cases(
    arguments: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        command.main([str(tmp_path / "out"), *arguments])
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_what_is_not_installed_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(NEEDS, "sindy", "no_such_package")  # type: ignore[index]
    monkeypatch.setattr(command, "made", lambda out, order, jobs: [tmp_path / "b1"])
    monkeypatch.setattr(command, "run", lambda folders, out, method, jobs: [line("nothing")])
    monkeypatch.setattr(command, "read_truth", lambda folder: CLEAN)
    assert command.main([str(tmp_path), "--methods", "sindy", "neural"]) == 0
    told = capsys.readouterr()
    assert "SINDy is left out: it needs no_such_package (pip install no_such_package)." in told.err
    assert "SINDy" not in told.out
    assert "| neural residual | 1 | 1 |" in told.out
    with pytest.raises(SystemExit):
        command.main([str(tmp_path), "--figures", "x.json"])
    assert "Install them first: pip install no_such_package" in capsys.readouterr().err


# ---- methods ---------------------------------------------------------------------------------------


def test_a_network_learns_a_curve_and_finds_none_in_noise() -> None:
    rng = np.random.default_rng(3)
    x, noise = rng.uniform(-2, 2, (600, 1)), rng.normal(size=1200)
    predict = neural.trained(x, np.sin(2 * x[:, 0]), 0.01)
    assert np.abs(predict(x) - np.sin(2 * x[:, 0])).mean() < 0.1
    assert neural.helps(noise**2, (0.7 * noise) ** 2, 0.01, 2.5)
    assert not neural.helps(noise**2, rng.permutation(noise) ** 2, 0.01, 2.5)


@pytest.mark.slow
def test_a_few_cases_from_end_to_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Seeds that are not the published ones: all methods answer, and the second time nothing is run."""
    chosen = ["--kinds", "torque_offset", "unknown_chirp", "--seeds", "1", "--first-seed", "401", "--clean", "1"]
    assert command.main([str(tmp_path), *chosen]) == 0
    told = capsys.readouterr()
    for method, title in TITLES.items():
        if f"{title} is left out" in told.err:
            continue
        answers = [json.loads(row) for row in (tmp_path / f"{method}.jsonl").read_text(encoding="utf-8").splitlines()]
        assert [one.get("error") for one in answers] == [None] * 3, method
        assert title in told.out
    assert command.main([str(tmp_path), *chosen]) == 0
    again = capsys.readouterr()
    assert again.out == told.out
    assert "of 3 cases" not in again.err


ASYMMETRY, PULSES = real.LOGS


@pytest.mark.parametrize(
    ("log", "names", "expected"),
    [
        (ASYMMETRY, ["asymmetric_viscous", "presliding"], "right: asymmetric viscous, presliding"),
        (
            ASYMMETRY,
            ["stribeck", "asymmetric_viscous"],
            "right: stribeck, asymmetric viscous",
        ),  # nobody knows the first
        (ASYMMETRY, ["stribeck"], "missed: stribeck"),
        (ASYMMETRY, ["torque_ripple", "asymmetric_viscous"], "wrong name: torque ripple, asymmetric viscous"),
        (PULSES, ["asymmetric_viscous", "external_force"], "right: asymmetric viscous, external force"),
        (PULSES, ["asymmetric_viscous"], "missed: asymmetric viscous"),
        (PULSES, [], "missed: nothing"),
    ],
)
def test_what_an_answer_to_a_real_log_is_worth(log: real.Log, names: list[str], expected: str) -> None:
    answer = named([Name(name, 1) for name in names])
    assert real.cell(log, {"case": "real", **answer.line()}) == expected


def test_a_real_log_that_is_not_there_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FMU_DIDIM_DATA", str(tmp_path))
    with pytest.raises(SystemExit):
        real.main([])
    assert "nonlinearbenchmark.org" in capsys.readouterr().err
