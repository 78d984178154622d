"""The command line in bad surroundings: what it prints, where it goes, and how it ends."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from fmu_didim.base.terminal import Encodable, Printable, json_shown, printable
from fmu_didim.cli.main import main
from tests.cases import scara_case
from tests.patience import patience

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="needs /dev/full and /proc")
ROOT = Path(__file__).parents[2]
CASE = str(ROOT / "examples/scara/identify.yaml")


def command(*arguments: str, shell: str = "", **environment: str) -> subprocess.CompletedProcess[bytes]:
    """The command line in a process of its own; ``shell`` is what stands after it, or before it with ``{}``."""
    line = f'"{sys.executable}" -c "import sys; from fmu_didim.cli.main import main; sys.exit(main())" '
    line += " ".join(f"'{argument}'" for argument in arguments)
    line = shell.format(line) if "{}" in shell else f"{line} {shell}"
    known = os.environ | {"PYTHONPATH": str(ROOT)} | environment
    return subprocess.run(["bash", "-c", line], capture_output=True, env=known, timeout=patience(300), check=False)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain, with\ttabs\nand lines", "plain, with\ttabs\nand lines"),
        ("\x1b[31mred\x1b[0m", "\\x1b[31mred\\x1b[0m"),
        ("\x1b]0;title\x07", "\\x1b]0;title\\x07"),
        ("back\rover\x08", "back\\x0dover\\x08"),
        ("\x9b2J\x7f\0", "\\x9b2J\\x7f\\x00"),
        ("turned \u202egnp.exe", "turned \\u202egnp.exe"),
        ("σ ± N·m ü 漢", "σ ± N·m ü 漢"),
    ],
)
def test_what_steers_a_terminal_is_written_out(text: str, shown: str) -> None:
    stream = io.StringIO()
    assert Printable(stream).write(text) == len(text)
    assert stream.getvalue() == shown


def test_an_encoding_without_the_letters_and_names_that_are_none() -> None:
    raw = io.BytesIO()
    stream = Printable(io.TextIOWrapper(raw, encoding="ascii"))
    stream.write("σ = 0.1 N·m, file \udcff\n")
    stream.flush()
    assert raw.getvalue() == b"sigma = 0.1 N.m, file ?\n"


@pytest.mark.parametrize(
    ("encoding", "shown"),
    [
        ("utf-8", "σ ± 3 kg·m² s⁻¹ → ü 漢"),
        ("cp1252", "sigma ± 3 kg·m² s^-¹ -> ü ?"),
        ("cp437", "σ ± 3 kg·m² s^-1 -> ü ?"),
        ("ascii", "sigma +- 3 kg.m^2 s^-1 -> ? ?"),
    ],
)
def test_signs_that_an_encoding_lacks(encoding: str, shown: str) -> None:
    """In a pipe, and below the colours of a terminal."""
    for wrapped in (Printable, Encodable):
        raw = io.BytesIO()
        stream = wrapped(io.TextIOWrapper(raw, encoding=encoding))
        stream.write("σ ± 3 kg·m² s⁻¹ → ü 漢")
        stream.flush()
        assert raw.getvalue().decode(encoding) == shown


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "ascii"])
def test_json_says_the_same_in_every_encoding(encoding: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A name whose letters became ``?`` would be another name."""
    content = {"τ1": "ü 漢 \U0001f600 \udcff", "steers": "\x9b2J \u202e \x7f \x1b \n"}
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", Printable(io.TextIOWrapper(raw, encoding=encoding)))
    print(json_shown(json.dumps(content, ensure_ascii=False)))
    sys.stdout.flush()
    assert json.loads(raw.getvalue().decode(encoding)) == content
    assert json_shown('"σ"') == ('"σ"' if encoding == "utf-8" else '"\\u03c3"')


def test_names_in_files_reach_the_terminal_written_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t,tau1,\x1b[2Jtau2\n0,1,2\n0.005,1,2\n", encoding="utf-8")
    case = scara_case(tmp_path, train={"reference": {"file": str(log)}, "torque": {"file": str(log)}})
    assert main(["identify", str(case), "--out", str(tmp_path / "out")]) == 1
    told = capsys.readouterr()
    assert "\x1b" not in told.out + told.err
    assert "\\x1b[2Jtau2" in told.err


def fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*arguments: object, **options: object) -> None:
        raise ZeroDivisionError("nobody thought\nof that")

    monkeypatch.setattr("fmu_didim.workflow.check.check", broken)


def test_an_error_that_nobody_has_foreseen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fails(monkeypatch)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert main(["check", CASE]) == 1
    told = capsys.readouterr().err
    assert "fmu-didim: unexpected error: ZeroDivisionError: nobody thought of that." in told
    assert "Traceback" not in told
    (log,) = tmp_path.glob("fmu-didim-*.log")
    assert str(log) in told
    text = log.read_text(encoding="utf-8")
    assert "Traceback" in text and "test_terminal.py" in text and "fmu_didim 0." in text


@pytest.mark.parametrize("arguments", [["--debug", "check", CASE], ["check", CASE, "--debug"]])
def test_debug_shows_the_traceback(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    fails(monkeypatch)
    assert main(arguments) == 1
    assert "Traceback" in capsys.readouterr().err
    assert main(["check", str(tmp_path / "nowhere.yaml"), "--debug"]) == 1


def test_without_a_place_for_a_log_the_error_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fails(monkeypatch)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    assert main(["check", CASE]) == 1
    told = capsys.readouterr().err
    assert "ZeroDivisionError" in told and "--debug" in told and "Traceback" not in told


def test_streams_are_as_before() -> None:
    before = sys.stdout, sys.stderr
    with printable():
        assert isinstance(sys.stdout, Printable)
    assert (sys.stdout, sys.stderr) == before


@pytest.mark.gate
@LINUX
def test_a_reader_that_has_gone_ends_nothing(tmp_path: Path) -> None:
    """``| head -1``, before the table: the results are written all the same."""
    done = command(
        "identify",
        CASE,
        "--out",
        str(tmp_path / "out"),
        shell='set -o pipefail; {} | head -1; echo "${{PIPESTATUS[0]}}"',
    )
    assert done.stdout.decode().splitlines()[-1] == "0"
    assert done.stderr.decode() == ""
    assert (tmp_path / "out" / "result.json").is_file()


@pytest.mark.gate
@LINUX
def test_an_output_that_is_full_is_told(tmp_path: Path) -> None:
    done = command("identify", CASE, "--out", str(tmp_path / "out"), shell="> /dev/full")
    assert done.returncode == 0
    assert "the output cannot be written" in done.stderr.decode()
    assert "Traceback" not in done.stderr.decode() and "Exception ignored" not in done.stderr.decode()
    assert (tmp_path / "out" / "result.json").is_file()


@pytest.mark.gate
@LINUX
def test_a_terminal_of_letters_only() -> None:
    done = command("check", "--codes", LC_ALL="C", PYTHONUTF8="0", PYTHONIOENCODING="ascii:strict")
    assert done.returncode == 0, done.stderr
    assert all(byte < 128 for byte in done.stdout)


@pytest.mark.gate
@LINUX
@pytest.mark.parametrize(
    ("environment", "told"),
    [
        ({"FMU_DIDIM_CACHE": "/proc/nowhere"}, "The cache of compiled and extracted files cannot be written"),
        ({"FMU_DIDIM_CACHE": "/dev/null"}, "The cache of compiled and extracted files cannot be written"),
    ],
)
def test_a_cache_that_cannot_be_written(environment: dict[str, str], told: str, tmp_path: Path) -> None:
    done = command("identify", CASE, "--out", str(tmp_path), **environment)
    assert done.returncode == 1
    assert told in done.stderr.decode() and "FMU_DIDIM_CACHE" in done.stderr.decode()
    assert "Traceback" not in done.stderr.decode()


@pytest.mark.slow
@LINUX
def test_a_home_that_cannot_be_written(tmp_path: Path) -> None:
    """Nobody has named its folder, so another one does as well; in one line, whatever processes are started."""
    (tmp_path / "temporary").mkdir()
    home = {"HOME": "/proc/nowhere", "XDG_CACHE_HOME": "", "FMU_DIDIM_CACHE": "", "TMPDIR": str(tmp_path / "temporary")}
    done = command("identify", CASE, "--out", str(tmp_path / "out"), **home)
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stderr.decode().splitlines() if "cannot be written" in line]
    assert str(tmp_path / "temporary" / "fmu_didim") in line and "FMU_DIDIM_CACHE" in line
    assert (tmp_path / "out" / "result.json").is_file()


@LINUX
def test_a_folder_that_is_no_more(tmp_path: Path) -> None:
    done = command("check", "--codes", shell=f"mkdir {tmp_path}/gone && cd {tmp_path}/gone && rmdir ../gone && {{}}")
    assert done.returncode == 1
    assert "The current folder does not exist any more" in done.stderr.decode()


@pytest.mark.skipif(sys.platform != "linux", reason="names are Unicode on other systems")
@pytest.mark.parametrize("place", ["argument", "folder", "home"])
def test_a_name_that_the_shell_cannot_read_is_told_before_any_work(place: str, tmp_path: Path) -> None:
    """Where UTF-8 is switched off by hand, and where a name on the disk is not UTF-8."""
    odd = os.fsencode(tmp_path) + b"/r\xfcbe"
    Path(os.fsdecode(odd)).mkdir()
    environment = os.environb | {b"PYTHONPATH": os.fsencode(ROOT)} | ({b"HOME": odd} if place == "home" else {})
    argument = odd + b"/case.yaml" if place == "argument" else os.fsencode(CASE)
    command = [os.fsencode(sys.executable), b"-m", b"fmu_didim.cli.main", b"identify", argument]
    cwd = odd if place == "folder" else os.fsencode(tmp_path)
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, check=False)
    told = done.stderr.decode("utf-8", "replace")
    assert done.returncode == 1, told
    assert "is not text in the encoding of this shell" in told and "PYTHONUTF8=1" in told
    assert "building" not in told and "unforeseen" not in told
