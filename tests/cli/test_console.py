"""What a person sees in a terminal, and a script in a pipe."""

from __future__ import annotations

import io
import json
import logging
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from fmu_didim.cli import console
from fmu_didim.cli.console import Display, show
from fmu_didim.cli.main import main
from fmu_didim.fit.iteration import Iteration


def terminal() -> tuple[Console, io.StringIO]:
    stream = io.StringIO()
    return Console(file=stream, force_terminal=True, color_system="standard", width=100, legacy_windows=False), stream


def step(number: int, error: float = 5.0, note: str = "") -> Iteration:
    return Iteration("didim", number, np.zeros(2), error, 1e-3, note=note)


@pytest.mark.parametrize(
    ("text", "styled"),
    [
        ("VALID: converged", "\x1b[1;32mVALID: converged\x1b[0m"),
        ("READY: nothing stands against it", "\x1b[1;32mREADY"),
        ("READY, with doubts", "\x1b[1;33mREADY, with doubts"),
        ("NAMED: all", "\x1b[1;32mNAMED: all"),
        ("NAMED IN PART: some", "\x1b[1;33mNAMED IN PART: some"),
        ("NAMED, WITH DOUBTS: x", "\x1b[1;33mNAMED, WITH DOUBTS: x"),
        ("THE EXPERIMENTS DO NOT AGREE: x", "\x1b[1;33mTHE EXPERIMENTS DO NOT AGREE: x"),
        ("UNKNOWN: x", "\x1b[1;31mUNKNOWN: x"),
        ("DOUBTFUL: see below", "\x1b[1;33mDOUBTFUL"),
        ("REFUSED: no answer", "\x1b[1;31mREFUSED"),
        ("INVALID words [bold]stay[/bold] as they are", "INVALID words [bold]stay[/bold] as they are"),
        # A name in a file steers no terminal.
        ("column \x1b[31mred\x07", "column \\x1b[31mred\\x07"),
    ],
)
def test_colours(text: str, styled: str) -> None:
    made, stream = terminal()
    show(text, console=made)
    assert styled in stream.getvalue()


def test_no_colours_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    show("VALID: converged")
    assert capsys.readouterr().out == "VALID: converged\n"


def test_live_table_ends_as_a_table() -> None:
    made, stream = terminal()
    with Display(console=made) as display:
        display.say("Identifying ...")
        for number in range(1, 15):
            display.iteration(step(number, note="[odd] \x1b" if number == 3 else ""))
    last = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", stream.getvalue()).rpartition("torque error")[2]
    assert [f"didim {n} " in last for n in range(1, 15)] == [True] * 14
    assert "[odd] \\x1b" in last


def test_counters_write_over_each_other() -> None:
    made, stream = terminal()
    with Display(console=made) as display:
        for text in ("screening", "fitting candidate 1 of 3", "fitting candidate 2 of 3", "round 2"):
            display.say(text)
    lines = [line for line in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", stream.getvalue()).split("\n") if line.strip()]
    kept = [line for line in lines if re.search(r" s  ", line)]
    assert any("screening" in line for line in kept)


def test_lines_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    with Display() as display:
        display.say("Reading case.yaml")
        display.iteration(step(1))
        display.iteration(step(2, float("nan"), "restarted"))
    first, second, third = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r" *\d+\.\d s  Reading case\.yaml", first)
    assert "didim 1: torque error   5.000 %, change 1.00e-03" in second
    assert "no simulation" in third and third.endswith("[restarted]")


def test_quiet_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with Display(quiet=True) as display:
        display.say("Reading")
        display.iteration(step(1))
    assert capsys.readouterr().out == ""


def test_log_goes_to_standard_error_as_it_is_then(capsys: pytest.CaptureFixture[str]) -> None:
    handler = console.CurrentStderr()
    handler.emit(logging.LogRecord("fmu_didim", logging.INFO, "", 0, "compiling", None, None))
    assert capsys.readouterr().err == "compiling\n"


def first_time(text: str) -> float:
    return float(re.findall(r"^ *(\d+\.\d) s  ", text, re.MULTILINE)[0])


def test_time_counts_from_the_start_of_the_command(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not from that of the process: a shell may have worked in it for minutes, or another command."""
    clock = [1000.0]
    monkeypatch.setattr(console, "time", SimpleNamespace(perf_counter=lambda: clock[0]))
    real = console.Display.__enter__

    def later(self: Display) -> Display:
        clock[0] += 2.5
        return real(self)

    monkeypatch.setattr(console.Display, "__enter__", later)
    for _ in range(2):
        clock[0] += 148.0
        assert main(["identify", str(tmp_path / "nowhere.yaml"), "--out", str(tmp_path / "out")]) == 1
        assert first_time(capsys.readouterr().out) == 2.5


@pytest.mark.gate
def test_json_of_all_that_has_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "examples/scara/identify.yaml", "--json", "--out", str(tmp_path / "out")]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert main(["check", "examples/scara/identify.yaml", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ready"] is True
    assert {d["severity"] for d in found["diagnostics"]} <= {"remark"}
    assert main(["identify", str(tmp_path / "none.yaml"), "--json"]) == 1
    assert "does not exist" in json.loads(capsys.readouterr().out)["error"]


VERBS = (
    *(["campaign", name] for name in ("run", "retry", "status", "report", "show")),
    ["identify"], ["check"], ["simulate"], ["discover"], ["export"], ["init"], ["validate"], ["schema"], ["effects"],
    ["robot"], ["excite"], ["name-controller"],
    ["example"], ["completion"], ["fmu", "info"], ["fmu", "check"], ["cache", "show"], ["cache", "clear"], [],
)  # fmt: skip


@pytest.mark.parametrize("verb", VERBS, ids=" ".join)
def test_every_help_ends_with_examples(verb: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([*verb, "--help"])
    text = capsys.readouterr().out
    examples = text.rpartition("examples:\n")[2]
    assert " ".join(["fmu-didim", *verb]) in examples


@pytest.mark.gate
@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo terminals")
def test_identify_in_a_terminal(tmp_path: Path) -> None:
    import pty

    leader, follower = pty.openpty()
    command = [
        sys.executable,
        "-m",
        "fmu_didim.cli.main",
        "identify",
        "examples/scara/identify.yaml",
        "--out",
        str(tmp_path),
    ]
    run = subprocess.Popen(
        command, stdout=follower, stderr=follower, env={**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    )
    os.close(follower)
    shown = b""
    while True:
        try:
            part = os.read(leader, 65536)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        shown += part
    os.close(leader)
    assert run.wait() == 0
    text = shown.decode("utf-8", "replace")
    assert "\x1b[1;32mVALID" in text
    assert "\x1b[?25l" in text and text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l")  # the cursor comes back
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)
    assert "torque error" in plain and "finish 1" in plain


FREE = "identify: {Kp1: {of: controller, start: 1, minimum: 0}, Xx: {of: drive}}"


@pytest.mark.parametrize(
    ("old", "new", "key", "told"),
    [
        ("plant: {kind: fmu}", f"plant: {{kind: fmu}}\n{FREE}", "Xx:", "case.yaml, line {line}, identify.Xx"),
        ("estimator:", "lop: 3\nestimator:", "lop:", "line {line}, lop: unknown key"),
        ("kind: didim", "kind: didm", "estimator:", "line {line}, estimator: there is no estimator 'didm'"),
    ],
)
def test_mistakes_in_a_case_are_told_with_their_line(
    tmp_path: Path, old: str, new: str, key: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path("examples/scara/identify.yaml").read_text(encoding="utf-8").replace("../../", f"{Path.cwd()}/")
    assert old in text
    path = tmp_path / "case.yaml"
    text = text.replace(old, new).replace("file: ", f"file: {Path.cwd()}/examples/scara/")
    path.write_text(text, encoding="utf-8")
    line = next(i for i, row in enumerate(text.splitlines(), start=1) if key in row and not row.startswith("#"))
    assert main(["identify", str(path), "--out", str(tmp_path / "out"), "--quiet"]) == 1
    assert told.format(line=line) in capsys.readouterr().err


def test_no_python_of_a_case_is_run_by_validate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.py").write_text("raise SystemExit('run')\n", encoding="utf-8")
    text = Path("examples/scara/identify.yaml").read_text(encoding="utf-8").replace("../../", f"{Path.cwd()}/")
    source = f"{Path.cwd()}/controllers/scara_pd.yaml"
    text = text.replace(f"kind: fmu, source: {source}", "kind: control, source: 'mine.py:controller'")
    text = text.replace("file: ", f"file: {Path.cwd()}/examples/scara/")
    (tmp_path / "case.yaml").write_text(text, encoding="utf-8")
    assert main(["validate", str(tmp_path / "case.yaml"), "--no-code"]) == 1
    assert "no-code" in capsys.readouterr().out.lower().replace("_", "-")
