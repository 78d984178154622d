"""Every file of the examples under every verb: it succeeds where it should, else it is refused with what to do."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
import yaml

from fmu_didim.case.files import DATA_VARIABLE, data_folder
from fmu_didim.cli.main import command_parser, main
from tests.conftest import ROOT, has_emps, package
from tests.patience import patience
from tests.smoke.test_verbs import verbs_of

SECONDS = 60.0
"""In which a verb must end, longer on a machine that is busy."""
TIME_LIMIT = "30"
"""s, of a discovery: it ends with the best answer so far."""
VERBS: Mapping[str, Callable[[Path], list[str]]] = {
    "init": lambda file: [str(file), "--law", "pd", "--out", "made"],
    "identify": lambda file: [str(file), "--out", "identified"],
    "simulate": lambda file: [str(file), "--out", "loop.csv"],
    "name-controller": lambda file: [str(file), "--out", "named"],
    "excite": lambda file: [str(file), "--out", "motion", "--starts", "1"],
    "discover": lambda file: [str(file), "--out", "found", "--time-limit", TIME_LIMIT],
    "export": lambda file: [str(file), "--out", "built"],
    "compare": lambda file: [str(file), str(file), "--out", "compared"],
    "watch": lambda file: [str(file.parent), "--case", str(file), "--out", "watched"],
    "export --ssp": lambda file: ["loop.ssp", str(file)],
    "campaign run": lambda file: [str(file), "--dry-run", "--out", "runs"],
    **{
        verb: lambda file: [str(file)]
        for verb in (
            "validate", "check", "robot", "fmu info", "fmu check", "cache clear", "campaign status", "campaign report",
            "campaign retry", "campaign show", "effects", "example", "schema", "completion", "cache show",
            "robot",
        )
    },
}  # fmt: skip
"""Verb -> its arguments for a file."""
CASE_VERBS = {"validate", "check", "identify", "simulate", "discover", "export --ssp"}
MEANT_FOR: Mapping[str, set[str]] = {
    "case": CASE_VERBS,
    "model": CASE_VERBS,
    "campaign": {"campaign run"},
    "robot": {"export", "robot"},
    "controller": {"export"},
    "modelica": {"fmu info", "fmu check", "export"},
    "fmu": {"fmu info", "fmu check", "cache clear"},
    "data": set(),
    "text": set(),
}
"""Kind of file -> the verbs that must succeed with it; all others may refuse it."""
ANY = {"init", "excite", "name-controller"}
"""Verbs that may take some files of a kind and not others: a log alone, a robot of which the noise is known."""
SLOW = {"discover", "campaign run", "name-controller"}
"""Verbs that take tens of seconds."""
SLOW_FILES = ("tx40/discover_load.yaml", "tx40/discover_wrist.yaml", "scara/identify_modelica.yaml")


def kind_of(file: Path) -> str:
    """What a file of the examples is."""
    if file.suffix != ".yaml":
        return {".csv": "data", ".parquet": "data", ".mo": "modelica", ".fmu": "fmu"}.get(file.suffix, "text")
    keys = yaml.safe_load(file.read_text(encoding="utf-8"))
    named = {"case": "campaign", "law": "controller", "joints": "robot", "model": "model"}
    return next((kind for key, kind in named.items() if key in keys), "case")


FILES = {
    path.relative_to(ROOT / "examples").as_posix(): path
    for path in sorted((ROOT / "examples").rglob("*"))
    if path.is_file() and "__pycache__" not in path.parts
}


def outcome(verb: str, file: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and all that was printed."""
    begun = time.monotonic()
    try:
        code = main([*verb.split(), *VERBS[verb](file)])
    except SystemExit as usage:
        code = int(str(usage.code))
    assert time.monotonic() - begun < patience(SECONDS), f"{verb} took {time.monotonic() - begun:.0f} s"
    printed = capsys.readouterr()
    return code, printed.out + printed.err


def wrong_of(name: str, verb: str, code: int, told: str) -> str:
    """What is wrong with the end of a verb with a file of the examples; "" where nothing is."""
    kind = kind_of(FILES[name])
    if "unexpected error" in told or "Traceback" in told:
        return "not foreseen"
    needs_data = "emps" in name and not has_emps()
    if code in (0, 3, 4):
        return "" if verb in MEANT_FOR[kind] | ANY else "taken"
    if verb in MEANT_FOR[kind] and not (needs_data and "nonlinearbenchmark.org" in told):
        return "refused"
    if code == 2:
        return "" if "usage:" in told and "error:" in told else "no word of the usage"
    return "" if code == 1 and "next:" in told.lower() else "no next step"


def check(name: str, verbs: set[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if kind_of(FILES[name]) == "modelica" or "modelica" in name:
        package("rumoca")
    wrong = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv(DATA_VARIABLE, str(data_folder(ROOT).resolve()))  # also where a case is written elsewhere
        for verb in sorted(verbs):
            code, told = outcome(verb, FILES[name], capsys)
            if why := wrong_of(name, verb, code, told):
                wrong[verb] = f"{why}: {code}\n{told[-1000:]}"
    assert not wrong, "\n".join(f"{verb}: {why}" for verb, why in wrong.items())


def quick(name: str) -> set[str]:
    """The verbs that take seconds with a file."""
    if name in SLOW_FILES:
        return set()
    kind = kind_of(FILES[name])
    taken = MEANT_FOR[kind] | (ANY if MEANT_FOR[kind] >= CASE_VERBS else set())
    return set(VERBS) - (SLOW & taken)


@pytest.mark.gate
@pytest.mark.parametrize("name", [name for name in FILES if quick(name)])
def test_quick_verbs(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check(name, quick(name), tmp_path, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in FILES if quick(name) < set(VERBS)])
def test_long_verbs(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check(name, set(VERBS) - quick(name), tmp_path, capsys)


def test_every_verb_is_tried() -> None:
    assert set(VERBS) - {"export --ssp"} == set(verbs_of(command_parser()))


@pytest.mark.parametrize(
    ("verb", "code", "told", "wrong"),
    [
        ("identify", 0, "VALID", ""),
        ("identify", 4, "DOUBTFUL", ""),
        ("identify", 1, "next: mend it", "refused"),
        ("identify", 1, "unexpected error: KeyError", "not foreseen"),
        ("campaign run", 1, "This is a case.\n  next:  fmu-didim identify", ""),
        ("campaign run", 1, "This is a case.", "no next step"),
        ("campaign run", 2, "", "no word of the usage"),
        ("campaign run", 0, "done", "taken"),
    ],
)
def test_what_counts_as_wrong(verb: str, code: int, told: str, wrong: str) -> None:
    assert wrong_of("scara/identify.yaml", verb, code, told) == wrong
