"""What acts on the signals of the room and is not in its model: hidden, found, named, or told to be undecided."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fmu_didim import Discovered, discover
from fmu_didim.base.errors import InputError
from fmu_didim.cli.main import main
from fmu_didim.results.findings import FindingsDocument
from tests.room import STEP, forbidden, room_case, write_room

HELD_OUT = {"inputs": {"file": "held_weather.csv", "interpolation": "held"}, "measured": "held_room.csv"}


def test_a_hidden_delay_is_named_by_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_room(tmp_path, delay=3)
    write_room(tmp_path, seed=2, delay=3, name="held_")
    out = tmp_path / "out"
    code = main(["discover", str(room_case(tmp_path, validation=HELD_OUT)), "--out", str(out), "--quiet"])
    shown = capsys.readouterr().out
    assert code == 0
    assert "NAMED: The missing effects are named. Delay of the input Ti1" in shown
    assert forbidden(shown.replace("discovery.html", "")) == []
    found = FindingsDocument.model_validate(json.loads((out / "findings.json").read_text()))
    (one,) = found.findings
    assert (one.effect, one.side, one.signal, one.joint, one.ambiguous) == ("delay", "input", "Ti1", 0, [])
    (value,) = one.parameters
    assert value.interval[0] < 3 * STEP < value.interval[1]
    assert value.unit == "s"
    for pair in found.gap.values():
        assert pair.before > 1.5
        assert pair.after < 0.4
    (condition,) = found.conditions
    assert condition.startswith("the data do not hide an error of 10 % of C (2000 J/K), which would move R")
    assert "Provided that the data do not hide" in " ".join(shown.split())
    assert found.ratio_interval is not None
    assert found.ratio_interval[1] < 0.6
    page = (out / "discovery.html").read_text()
    assert "Delay of the input Ti1" in page
    assert {"signals_estimation.csv", "simulated_validation.csv"} <= {p.name for p in out.iterdir()}
    loaded = Discovered.load(out)
    assert loaded.answer == "named"
    assert loaded.summary() in shown
    assert loaded.to_frame()["parameter"].tolist() == ["delay of Ti1"]


def test_nothing_is_named_where_nothing_is_missing(tmp_path: Path) -> None:
    write_room(tmp_path, seed=5)
    found = discover(room_case(tmp_path))
    assert (found.answer, found.verdict, found.findings) == ("nothing", "valid", [])


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"prefer": ["lag"]}, "This is for robots"),
        ({"effects": ["my.py:Grease"]}, "This is for robots"),
        ({"forbid": ["backlash"]}, "backlash"),
    ],
)
def test_what_robots_have_is_not_offered(tmp_path: Path, asked: dict[str, list[str]], told: str) -> None:
    write_room(tmp_path, count=60)
    with pytest.raises(InputError, match=told) as caught:
        discover(room_case(tmp_path), **asked)  # type: ignore[arg-type]
    assert "lag" in str(caught.value)
    assert "friction" not in str(caught.value)
