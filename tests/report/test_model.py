"""What is shown and saved of a model alone: its own names and units, and no word of robots."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from fmu_didim import identify, load_result
from fmu_didim.checks.outputs.words import ADVICE
from fmu_didim.fit.iteration import Iteration
from fmu_didim.workflow.output.result import Result
from tests.room import forbidden, room_case, write_room

TABLE = """\
room (output_error, 2 parameters)

parameter   value       σ   %σ  unit   95 % interval
----------------------------------------------------
R1         0.V       0.V   V    K/W   0.V   0.V
R2         0.V       0.V   V    K/W   0.V   0.V

Output  estimation %    noise σ
T               V  0.V °C

Condition number    V
Iterations          V
Correlations > 0.9  R1-R2 +0.V

Remarks
  One start: at a few values elsewhere the misfit is no lower; other minima were not looked for.
  C: 2000 J/K is taken on trust: an error of 10 % would not show, but move R1 by V sigma (-V %),
    R2 by V sigma (-V %).
  T0: 20 degC is taken on trust: an error of V % would not show, but move R1 by V sigma (-V
    %), R2 by V sigma (-V %).
  No experiment was held out: the prediction of another one is untested.

VALID: converged in V iterations; simulated output V % off on estimation
  Provided that the data do not hide an error of 10 % of C (2000 J/K), which would move R1 by V
    sigma (-V %).
"""
"""Figures are V: another processor may round them otherwise."""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a case."""
    folder = tmp_path_factory.mktemp("room")
    write_room(folder)
    room_case(folder)
    return folder


@pytest.fixture(scope="module")
def seen() -> list[Iteration]:
    return []


@pytest.fixture(scope="module")
def found(room: Path, seen: list[Iteration]) -> Result:
    return identify(room / "case.yaml", room / "out", progress=seen.append)


@pytest.fixture(scope="module")
def several(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """Two outputs, each at instants of its own, in a fitted and a held-out experiment."""
    folder = tmp_path_factory.mktemp("several")
    write_room(folder, flow=3)
    write_room(folder, seed=2, name="other_", flow=3)
    runs = {
        name: {
            "inputs": {"file": f"{prefix}weather.csv", "interpolation": "held"},
            "measured": [{"file": f"{prefix}{what}.csv"} for what in ("room", "flow")], "role": role,
        }
        for name, prefix, role in (("june", "", "estimation"), ("july", "other_", "validation"))
    }  # fmt: skip
    path = room_case(folder, inputs=None, measured=None, experiments=runs)
    return identify(path, folder / "out"), folder / "out"


def plain(text: str) -> str:
    """A text without the digits of its figures and the widths of columns."""
    shape = re.sub(r"(?<![\w.])\d+\.\d+|(?<=converged in )\d+|(?<=Iterations          )\d+", "V", text)
    shape = re.sub(r"(?<=-)\d+\.?\d*(?= %)", "V", shape)
    return re.sub(r" +", " ", re.sub(r"0\.V", "V", shape))


def test_the_table_speaks_of_the_output(found: Result) -> None:
    assert plain(found.summary()) == plain(TABLE)


def strings(content: Any) -> Iterator[str]:
    """All texts in a JSON document, and the keys of what is free in it; those of the schema are the same for all."""
    if isinstance(content, dict):
        for value in content.values():
            yield from strings(value)
    elif isinstance(content, list):
        for value in content:
            yield from strings(value)
    elif isinstance(content, str):
        yield content


def words_of_page(page: str) -> str:
    """What a page shows, with its titles and its charts."""
    scripts = re.findall(r"(?s)<script[^>]*type=\"application/json\"[^>]*>(.*?)</script>", page)
    shown = re.sub(r"(?s)<script.*?</script>|<style.*?</style>", "", page)
    attributes = re.findall(r"(?:title|aria-label|id)=\"([^\"]*)\"", shown)
    texts = [text for script in scripts for text in strings(json.loads(script)) if len(text) < 200]
    return " ".join([re.sub(r"<[^>]+>", " ", shown), *attributes, *texts]).replace("-", " ")


def check_words(result: Result, out: Path) -> None:
    document = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert [text for text in strings(document) if forbidden(text)] == []
    assert forbidden(result.summary()) == []
    page = words_of_page((out / "report.html").read_text(encoding="utf-8"))
    assert forbidden(page) == []
    assert forbidden(result._repr_html_()) == []
    assert [file.name for file in out.iterdir() if forbidden(file.name.replace("_", " "))] == []
    for file in out.glob("*.csv"):
        assert forbidden(file.read_text(encoding="utf-8").splitlines()[0]) == []


def test_no_word_of_robots_in_the_result(found: Result, room: Path) -> None:
    check_words(found, room / "out")


def test_no_word_of_robots_where_outputs_have_instants_of_their_own(several: tuple[Result, Path]) -> None:
    result, out = several
    check_words(result, out)
    assert result.verdict == "valid", result.reasons
    assert "At instants of their own: Q" in result.summary()


def test_no_advice_speaks_of_robots() -> None:
    assert [text for text in ADVICE.values() if forbidden(text)] == []


def test_progress_speaks_of_the_output(found: Result, seen: list[Iteration]) -> None:
    assert {(it.stage, it.quantity) for it in seen} == {("output_error", "output")}
    assert seen[-1].relative_error_percent == pytest.approx(found.document.relative_error_percent["estimation"].total)


def test_it_is_the_same_when_it_is_loaded(found: Result, several: tuple[Result, Path], room: Path) -> None:
    assert load_result(room / "out") == found
    assert load_result(several[1]) == several[0]


def test_saved_again_it_is_the_same(found: Result, room: Path, tmp_path: Path) -> None:
    load_result(room / "out").save(tmp_path)
    assert load_result(tmp_path) == found
    names = {file.name for file in tmp_path.iterdir() if not file.name.startswith(".")}
    assert names == {file.name for file in (room / "out").iterdir() if not file.name.startswith(".")}


def test_python_gives_values_and_a_figure(found: Result) -> None:
    frame = found.to_frame()
    assert list(frame.index) == ["R1", "R2"] and set(frame["of"]) == {"model"}
    assert frame.loc["R1", "std"] == found.parameters["R1"].std > 0
    axes = [axis for axis in found.plot().axes if axis.get_ylabel()]
    assert [axis.get_ylabel() for axis in axes] == ["Ti1, Ti2 (°C)", "T (°C)", "residual (°C)"]
    assert found.robot is None and found.robots == {} and found.outside_robot == ()


def test_the_values_go_back(found: Result, room: Path) -> None:
    import yaml

    root = ET.fromstring((room / "out" / "parameters.ssv").read_text(encoding="utf-8"))
    space = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
    reals = {p.get("name"): p[0] for p in root.iter(f"{space}Parameter")}
    assert {name: float(real.get("value") or "nan") for name, real in reals.items()} == found.values
    assert {real.get("unit") for real in reals.values()} == {"K/W"}
    entry = yaml.safe_load((room / "out" / "parameters.yaml").read_text(encoding="utf-8"))
    assert entry == {"model": {"parameters": found.values}}
    assert not list((room / "out").glob("robot*"))


def test_own_values_have_files_of_their_own(tmp_path: Path) -> None:
    write_room(tmp_path)
    write_room(tmp_path, seed=2, name="other_", R2=0.3)
    runs = {
        name: {
            "inputs": {"file": f"{prefix}weather.csv", "interpolation": "held"}, "measured": f"{prefix}room.csv",
            "own": own,
        }
        for name, prefix, own in (("june", "", []), ("july", "other_", ["R2"]))
    }  # fmt: skip
    found = identify(room_case(tmp_path, inputs=None, measured=None, experiments=runs), tmp_path / "out")
    text = (tmp_path / "out" / "parameters_july.ssv").read_text(encoding="utf-8")
    assert repr(found.values["R2[july]"]) in text and repr(found.values["R1"]) in text
    assert repr(found.values["R2"]) in (tmp_path / "out" / "parameters.ssv").read_text(encoding="utf-8")


def test_the_error_is_that_of_what_the_output_moves(found: Result) -> None:
    own = found.validation("estimation")
    moved = own.measured - own.measured.mean()
    percent = 100 * np.linalg.norm(own.measured - own.simulated) / np.linalg.norm(moved)
    assert found.document.relative_error_percent["estimation"].total == pytest.approx(percent)


def test_the_live_table_names_the_output(seen: list[Iteration], found: Result) -> None:
    from rich.console import Console

    from fmu_didim.cli.console import Display

    stream = StringIO()
    console = Console(file=stream, force_terminal=True, width=100)
    with Display(console=console) as display:
        for iteration in seen:
            display.iteration(iteration)
    assert "output error" in stream.getvalue() and forbidden(stream.getvalue()) == []
