"""The compiler: the link without its run-time library, what stands for it on Windows, what is told."""

from __future__ import annotations

import ctypes
import logging
import platform
import shlex
import sys
from pathlib import Path

import pytest

from fmu_didim.base.errors import BuildError
from fmu_didim.cli.main import main
from fmu_didim.export import build, build_fmu, compile_shared_library
from fmu_didim.export.build import find_compiler, wrapper_source
from tests.export.helpers import pendulum

SHOWN = '__attribute__((visibility("default"))) '


def compiled(folder: Path, code: str) -> ctypes.CDLL:
    (folder / "code.c").write_text(code, encoding="utf-8")
    compile_shared_library(folder, folder / "code.library", main="code.c")
    return ctypes.CDLL(str(folder / "code.library"))


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The commands that were run."""
    made: list[str] = []
    real = build.run_compiler

    def counted(command: list[str], *, what: str, cwd: Path | None = None) -> str:
        made.append(" ".join(command))
        return real(command, what=what, cwd=cwd)

    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(build, "run_compiler", counted)
    return made


def test_plain_code_needs_no_run_time_library(tmp_path: Path, commands: list[str]) -> None:
    library = compiled(tmp_path, f"#include <math.h>\n{SHOWN}double f(double x) {{ return tanh(x); }}")
    library.f.argtypes, library.f.restype = [ctypes.c_double], ctypes.c_double
    assert library.f(0.5) == pytest.approx(0.46211715726000975, rel=1e-15)
    assert len(commands) == 2 and "-rtlib=none" in commands[1]


@pytest.mark.gate
@pytest.mark.skipif(platform.system() != "Linux", reason="others may have the division elsewhere")
def test_code_that_needs_it_gets_it(tmp_path: Path, commands: list[str], caplog: pytest.LogCaptureFixture) -> None:
    """Division of 128 bits is a function of the compiler's run-time library."""
    code = f"{SHOWN}long long f(long long a, long long b) {{ return (long long)(((__int128)a << 64) / b >> 40); }}"
    with caplog.at_level(logging.INFO, "fmu_didim"):
        library = compiled(tmp_path, code)
    library.f.argtypes, library.f.restype = [ctypes.c_longlong] * 2, ctypes.c_longlong
    assert library.f(10**9, 7 * 10**12) == (10**9 << 64) // (7 * 10**12) >> 40
    assert len(commands) == 3 and "-rtlib=none" not in commands[2]
    assert "compiling the run-time library" in caplog.text


def test_an_error_in_the_code_is_told_at_once(tmp_path: Path, commands: list[str]) -> None:
    with pytest.raises(BuildError, match="no_such_name"):
        compiled(tmp_path, "int f(void) { return no_such_name; }")
    assert len(commands) == 1


def test_long_compilations_are_announced(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "fmu_didim"):
        compiled(tmp_path, f"{SHOWN}int f(void) {{ return 1; }}")
        assert not caplog.records
        (tmp_path / "padding.h").write_text(f"/* {'x' * 450_000} */")
        compiled(tmp_path, f"{SHOWN}int f(void) {{ return 2; }}")
    begun, done = (record.getMessage() for record in caplog.records)
    assert begun == "compiling code.library (about 4 s; the result is kept) ..."
    assert done.startswith("compiled code.library in ")


def test_the_command_line_shows_what_is_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(build, "TOLD_FROM", 0.0)
    assert main(["export", "controllers/scara_pd.yaml", "--out", str(tmp_path)]) == 0
    told = capsys.readouterr().err
    assert told.count("compiling scara_pd") == told.count("compiled scara_pd") == 1
    logging.getLogger("fmu_didim").info("nobody listens any more")
    assert capsys.readouterr().err == ""


NAMES = ("__fpclassify", "__isnan", "__signbit", "vsnprintf", "snprintf")
CHECKS = """
#undef __stdcall
#define __stdcall
#include "renamed.c"
int __stdio_common_vsprintf(unsigned long long options, char *buffer, size_t size, const char *format, void *locale,
                            va_list arguments) {
    return options == 2 && !locale ? __builtin_vsnprintf(buffer, size, format, arguments) : -1;
}
SHOWN int own_class(double x) { return own___fpclassify(x); }
SHOWN int class_of(double x) { return fpclassify(x); }
SHOWN int own_nan(double x) { return own___isnan(x); }
SHOWN int own_sign(double x) { return own___signbit(x); }
SHOWN int text(char *buffer, size_t size, double x) { return own_snprintf(buffer, size, "%s %.3g", "x is", x); }
"""


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="its assembler is for x86-64")
def test_what_stands_for_the_run_time_library_on_windows(tmp_path: Path) -> None:
    """Against what this machine's C library says; a run under Wine gave the same bits as with MinGW's."""
    code = wrapper_source("windows.c")
    for name in NAMES:
        code = code.replace(f"int {name}(", f"int own_{name}(")
    code = code.replace("= vsnprintf(", "= own_vsnprintf(").replace("return __fpclassify(", "return own___fpclassify(")
    (tmp_path / "renamed.c").write_text(code, encoding="utf-8")
    library = compiled(tmp_path, CHECKS.replace("SHOWN ", SHOWN))
    for name in ("own_class", "class_of", "own_nan", "own_sign"):
        getattr(library, name).argtypes = [ctypes.c_double]
    for x in (0.0, -0.0, 1.0, -2.5, 5e-324, 2.2e-308, 1e308, float("inf"), -float("inf"), float("nan")):
        assert library.own_class(x) == library.class_of(x)
        assert library.own_nan(x) == (x != x)
        assert library.own_sign(x) == str(x).startswith("-")
    library.text.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_double]
    buffer = ctypes.create_string_buffer(20)
    assert library.text(buffer, 20, 0.125) == 10 and buffer.value == b"x is 0.125"


def test_whichever_python_starts_ziglang_the_same_fmu_is_met_again(
    commands: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = build_fmu(pendulum())
    commands.clear()
    monkeypatch.setattr(sys, "executable", f"{sys.executable}-by-another-name")
    assert build_fmu(pendulum()) == first and not commands


def test_another_cc_or_other_options_of_it_is_another_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    def version_with(options: str) -> str:
        monkeypatch.setenv("CC", f"{shlex.quote(sys.executable)} -P -m ziglang cc {options}".rstrip())
        return find_compiler().version

    assert len({version_with(""), version_with("-O0"), version_with("-O3")}) == 3
