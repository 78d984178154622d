"""Figures of the pages: each comes from a file that a command wrote, and the page shows what the file holds."""

from __future__ import annotations

import importlib
import json
import re
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from examples.benchmark.score import texts as of_methods
from tests.conftest import ROOT
from tests.figures import FOLDER, write_figures
from tests.tools.benchmarks.__main__ import BENCHMARKS
from tests.tools.benchmarks.publish import texts as of_benchmarks
from tests.tools.blind.publish import figures as of_cases
from tests.tools.blind.publish import read_rows
from tests.tools.blind.score import score
from tests.tools.foreign.__main__ import texts as of_fmus
from tests.tools.hidden_controllers.__main__ import texts as of_controllers

FILES = sorted(FOLDER.glob("*.json"))
TABLES = {
    "discovery": "discovery_matrix.csv",
    "discovery_triples": "discovery_triples.csv",
    "discovery_harmonic": "discovery_harmonic.csv",
    "discovery_fresh": "discovery_fresh.csv",
    "discovery_since": "discovery_since.csv",
}
"""Figures of blind cases -> the table from which they follow."""


@pytest.fixture
def include(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """``docs/include.py``."""
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    return importlib.import_module("include")


# ---- the pages -------------------------------------------------------------------------------------


def test_pages_show_what_the_files_hold(include: ModuleType) -> None:
    known = include.figures()
    for page in include.pages():
        text = page.read_text(encoding="utf-8")
        assert include.filled(text, known, page.name) == text, f"{page.name}: run python docs/include.py"


def test_every_file_is_used(include: ModuleType) -> None:
    shown = {name for page in include.pages() for name, _ in include.MARKED.findall(page.read_text(encoding="utf-8"))}
    assert {name.partition(".")[0] for name in shown} == {path.stem for path in FILES}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_command_of_a_file_exists_and_a_page_names_it(
    path: Path, include: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    """The module is there, and its help knows every option; the page that shows the figures tells the command."""
    command = json.loads(path.read_text(encoding="utf-8"))["command"]
    python, flag, module, *arguments = shlex.split(command)
    assert (python, flag) == ("python", "-m")
    words = [word for word in arguments if re.fullmatch(r"[a-z_]+", word)]
    name = module if importlib.util.find_spec(module).submodule_search_locations is None else f"{module}.__main__"  # type: ignore[union-attr]
    with pytest.raises(SystemExit) as ended:
        importlib.import_module(name).main([*words[:1], "--help"])
    assert ended.value.code == 0
    told = capsys.readouterr().out
    assert [option for option in arguments if option.startswith("--") and option not in told] == []
    for page in include.pages():
        shown = {name for name, _ in include.MARKED.findall(page.read_text(encoding="utf-8"))}
        if any(name.startswith(f"{path.stem}.") for name in shown) and page.stem != "README":  # whose links lead there
            assert f"{path.stem}.command" in shown, f"{page.name} does not name the command of {path.stem}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_file_says_when_and_by_what_it_was_written(path: Path) -> None:
    content = json.loads(path.read_text(encoding="utf-8"))
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", content["date"])
    assert {"fmu_didim", "python"} <= set(content["versions"])
    assert re.match(r"\d+ cores, ", content["machine"])
    assert content["figures"]


def test_a_page_that_shows_something_else_is_found(include: ModuleType) -> None:
    known = {"a.share": "99 %", "a.rows": ["| x |", "|---|"]}
    page = (
        "It is <!-- figure: a.share -->98 %<!-- /figure --> here.\n\n<!-- figure: a.rows -->\nold\n<!-- /figure -->\n"
    )
    wanted = (
        "It is <!-- figure: a.share -->99 %<!-- /figure --> here.\n\n"
        "<!-- figure: a.rows -->\n\n| x |\n|---|\n\n<!-- /figure -->\n"
    )
    assert include.filled(page, known, "page.md") == wanted
    assert include.filled(wanted, known, "page.md") == wanted


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("is <!-- figure: a.sh -->1<!-- /figure -->", "no figure is called 'a.sh'. Valid: a.share, a.rows"),
        ("is <!-- figure: b.x -->1<!-- /figure -->", "no figure is called 'b.x'. Valid: a"),
        ("is <!-- figure: a.share -->1", "1 figures begin and 0 end"),
        ("is 1<!-- /figure -->", "0 figures begin and 1 end"),
        ("is\n<!-- figure: a.share -->1<!-- /figure -->", "the first of its line"),
        ("* <!-- figure: a.share -->1<!-- /figure -->", "the first of its line"),
        ("is <!-- figure: a.rows -->\n<!-- /figure -->", "a block of lines"),
        ("```sh\nx <!-- figure: a.share -->1<!-- /figure -->\n```", "in a block of code"),
    ],
)
def test_markers_that_cannot_be_filled(include: ModuleType, text: str, told: str) -> None:
    with pytest.raises(include.MarkerError, match=re.escape(told)):
        include.filled(text, {"a.share": "99 %", "a.rows": ["| x |"]}, "page.md")


def test_files_are_written_and_read(include: ModuleType, tmp_path: Path) -> None:
    write_figures(tmp_path / "x.json", "python -m tests.x", {"one": "1 %", "rows": ("| a |",)}, data={"raw": 0.01})
    content = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert content["data"] == {"raw": 0.01}
    known = include.figures(tmp_path)
    assert (known["x.one"], known["x.rows"], known["x.command"]) == ("1 %", ["| a |"], "`python -m tests.x`")
    assert str(tmp_path) not in json.dumps(content)


@pytest.mark.parametrize("name", TABLES)
def test_figures_of_discovery_are_those_of_its_table(name: str) -> None:
    """The shares, the matrix and the criteria follow from the table of cases alone, and so does what is right."""
    table = ROOT / "docs" / TABLES[name]
    lines, truths = read_rows(table)
    held = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))["figures"]
    assert held == of_cases(lines, truths)
    wrong = {note.partition(":")[0] for note in score(lines, truths).notes}
    rows = table.read_text(encoding="utf-8").splitlines()
    place = rows[0].split(",").index("right")
    assert wrong == {"/".join(row.split(",")[:2]) for row in rows[1:] if row.split(",")[place] == "0"}


@pytest.mark.parametrize(
    ("name", "texts"),
    [
        ("speed", lambda data: of_benchmarks(data, list(BENCHMARKS))),
        ("foreign", of_fmus),
        ("benchmark", of_methods),
        ("controllers", of_controllers),
    ],
)
def test_what_is_shown_follows_from_what_was_measured(name: str, texts: Callable[[Any], Mapping[str, Any]]) -> None:
    held = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    assert held["figures"] == texts(held["data"])


# ---- figures that stand outside --------------------------------------------------------------------

MEASURED = re.compile(
    r"(?<!FMI )(?<!Python )(?<![\w.:/-])(?:\d[\d ]*\d|\d+)(?:\.\d+)?"
    r"(?= (?:%|s|ms|µs|min|h|MB|kB|kg|N|times|σ|standard deviations)(?![\w/])| of \d)"
    r"|(?<!FMI )(?<!Python )(?<![\w.:/-])\d+\.\d+(?![\w.])"
)
"""A number with a decimal point, a unit or a total: what could have been measured; not the version of FMI or Python."""
NO_TEXT = (r"(?ms)^```.*?^```$", r"(?s)\$\$.*?\$\$", r"`[^`\n]*`", r"\$[^$\n]*\$", r"\]\([^)]*\)")
"""Blocks of code, which are run; formulas, words of code, targets of links."""
THRESHOLD, MADE, MEANS = "a threshold, which every result records", "how data were made", "what a word means"
STATED: Mapping[str, Mapping[str, str]] = {
    "README": {"remembering 50 ms": MADE, "intervals of 95 %": MEANS},
    "case": {
        "those at 0.005 s": MEANS, "the torque at t − 0.017 s": MEANS, "the torque at t - 0.017 s": MEANS,
        "FMI 2.0 or 3.0 (1.0:": "versions",
    },
    "discovery": {
        "longer than noise is (50 ms)": THRESHOLD, "no joint by more than 1 % of its noise": THRESHOLD,
        "values with a 95 % interval": MEANS, "must gain 1.2 times as much": THRESHOLD,
        "one that gains 1.5 times as much": THRESHOLD, "several of them, or 1.3 times as much": THRESHOLD,
        "that gains 1.3 times as much": THRESHOLD,
        "(the 95 % interval of": MEANS,
        "a 95 % interval of the held-out RMS ratio": MEANS, "at least 0.6 σ in the torque, and 3 % of": THRESHOLD,
        "or within 2 % of its gain": THRESHOLD, "adds 0.6 σ or more": THRESHOLD, "Wald's test, 5 %": THRESHOLD,
        "at 1.5 σ after refitting": MADE, "a gap below 1 σ": "from where cases are judged", "of up to 0.6 σ": MADE,
        "a torque sample of 10 ms": MADE, "three periods of 4 s": MADE, "1.5 % of noise": MADE, "lag of 6 ms": MADE,
        "(0.08 N.m, 0.15 rad/s)": MADE, "friction (0.8 N·m), logged at 20 Hz with noise of 0.3 N·m": MADE,
        "the joint changes by 10 % or more": THRESHOLD, "that differ by more than 10 %": THRESHOLD,
        "no clutter, 0.2 σ in the torque": THRESHOLD, "in the place of 0.6 σ": THRESHOLD,
        "but one below 0.6 σ": THRESHOLD,
        "differs by a factor of 1.5 or more": THRESHOLD, "less than 0.2 of the noise": THRESHOLD,
        "each pulse above 0.5 N·m, with begin and end within 20 ms": "what was asked",
    },
    "examples": {"200 to 0.5 Hz": MADE},
    "exchange": {"FMI 1.0 and 3.0": "versions"},
    "fmu-compatibility": {"by more than 2 % of its largest value": THRESHOLD, "200 steps of 10 ms": MADE},
    "glossary": {"95 % intervals": MEANS, "0.95 if": MEANS, "Interface 1.0, 2.0, 3.0": "versions"},
    "platforms": {
        "Python 3.11 to 3.14": "versions", "glibc 2.28": "a version", "Jinja2 3.1.4": "a version",
        "0.24 to 0.24.3": "versions", "FMI 2.0 and 3.0": "versions",
    },
    "calibrate-an-fmu": {"simulated with 0.02 and 0.01 K/W": MADE},
    "campaigns": {"less than 1 h and 4 GB": "an example of limits"},
    "compare": {
        "with a payload of 0.3 kg": MADE, "Below p = 0.001 something": THRESHOLD, "at once with 95 %": MEANS,
        "or less than 2 % of the change": THRESHOLD, "have been seen with 95 %": MEANS,
    },
    "watch": {"chance allows with p = 0.001": THRESHOLD, "an interval of 95 %": MEANS},
    "name-a-controller": {"noise of 1 % of the torque": MADE},
    "find-an-effect": {"stops after 60 s": "what the option says"},
    "choose-a-motion": {"0.1 Hz is usual": "an example"},
    "modelica": {"FMI 2.0 or 3.0": "versions"},
    "own-data": {"one control period, 5 ms": MADE, "MAT (5 or 7.3)": "versions", "MAT 7.3": "a version"},
    "priors": {"0.2 says": MEANS, "standard deviation of 20 %": MEANS, "(p < 0.001)": THRESHOLD},
    "read-a-report": {"in 95 of 100 repetitions": MEANS, "above 30 %": "advice"},
    "limits": {"between 0.1 and 1 rad/s": "an example", "by 0.6 times its noise": THRESHOLD},
    "didim": {"5 % of noise": MADE},
    "theory/discovery": {"its 95 % interval": MEANS, "within 2 % of its gain": THRESHOLD},
    "sigma": {"An interval of 95 %": MEANS, "remembering 50 ms": MADE},
    "tutorial": {"its 95 % interval": MEANS},
}  # fmt: skip
"""Page -> words of it -> why their numbers are no figures that a command must write."""


def running_text(page: Path, include: ModuleType) -> str:
    """What a page says in words outside its figures, on one line."""
    text = include.MARKED.sub("§", page.read_text(encoding="utf-8"))
    for pattern in NO_TEXT:
        text = re.sub(pattern, "§", text)
    return " ".join(text.split())


def unexplained(text: str, stated: Mapping[str, str]) -> list[str]:
    """Numbers that could have been measured, with the words around them, outside of what is stated."""
    known = [m.span() for words in stated for m in re.finditer(re.escape(words), text)]
    return [
        text[max(0, m.start() - 30) : m.end() + 20]
        for m in MEASURED.finditer(text)
        if not any(begin <= m.start() and m.end() <= end for begin, end in known)
    ]


def name_of(page: Path) -> str:
    """``theory/discovery`` is not ``discovery``."""
    return "theory/discovery" if page.parent.name == "theory" and page.stem == "discovery" else page.stem


def test_measured_figures_stand_in_files(include: ModuleType) -> None:
    for page in include.pages():
        stated = STATED.get(name_of(page), {})
        text = running_text(page, include)
        assert [words for words in stated if words not in text] == [], f"{page.name} does not say so any more"
        found = unexplained(text, stated)
        assert not found, f"{page.name}: a figure that no command wrote? See docs/include.py. {found}"
    assert set(STATED) <= {name_of(page) for page in include.pages()}


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("It takes 36 s.", True), ("in 99 % of cases", True), ("4 of 120 fail", True), ("a ratio of 0.87 here", True),
        ("1 500 ms", True), ("a loop at 200 Hz", False), ("step 6", False), ("20 seeds", False), ("§ of 1 %", True),
    ],
)  # fmt: skip
def test_what_could_have_been_measured(text: str, found: bool) -> None:
    assert bool(unexplained(text, {})) == found
    assert not unexplained(text, {text: "stated"})
