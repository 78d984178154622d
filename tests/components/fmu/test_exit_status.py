"""How the end of an FMU's process is told, on Windows as elsewhere."""

from __future__ import annotations

import os
import subprocess

import pytest

from fmu_didim.components.fmu.isolation.exit_status import crash_name, is_from_outside
from fmu_didim.components.fmu.isolation.process import ProcessEndedError, Worker, keep_constants


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (None, ""),
        (0, ""),
        (3, ""),
        (77, ""),
        (255, ""),
        (0xC0000005, "0xC0000005, access violation"),
        (0xC00000FD, "0xC00000FD, stack overflow"),
        (0xC0000409, "0xC0000409, the stack is damaged, or abort() was called"),
        (0xC0001234, "0xC0001234, an error of Windows"),
        (0xE06D7363, "0xE06D7363, a C++ exception that nothing has caught"),
        (-11, "SIGSEGV, Segmentation fault"),
        (-999, "signal 999"),
    ],
)
def test_what_is_a_crash(code: int | None, name: str) -> None:
    if code == -11 and os.name == "nt":
        pytest.skip("its signals have other names")
    assert crash_name(code) == name


@pytest.mark.parametrize(
    ("code", "outside"),
    [(-9, True), (0xC000013A, True), (0xC0000017, True), (0xC0000005, False), (1, False), (-11, False)],
)
def test_who_is_to_blame(code: int, outside: bool) -> None:
    assert is_from_outside(code) is outside


@pytest.mark.parametrize(
    ("code", "told", "by_fmu", "killed"),
    [
        (0xC0000005, r"crashed its process \(0xC0000005, access violation\)", True, False),
        (0xC000013A, r"crashed its process \(0xC000013A, Ctrl-C\)", False, True),
        (5, r"ended its process \(exit status 5\)", True, False),
    ],
)
def test_the_end_of_a_process_on_windows(
    code: int, told: str, by_fmu: bool, killed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process ends, and the system gives the status that Windows would give."""
    worker = Worker("some.fmu", 60.0)
    try:
        assert worker.request("start", keep_constants, True, []) is None
        real = subprocess.Popen.poll

        def poll(process: subprocess.Popen[bytes]) -> int | None:
            return None if real(process) is None else code

        monkeypatch.setattr(subprocess.Popen, "poll", poll)
        with pytest.raises(ProcessEndedError, match=rf"{told}[\s\S]*during step") as caught:
            worker.kill()
            worker.request("step", keep_constants, True, [])
        assert (caught.value.by_fmu, caught.value.killed) == (by_fmu, killed)
    finally:
        worker.close()
