"""A campaign says from the first second what it does, and Ctrl-C ends its checks at once."""

from __future__ import annotations

import logging
import threading
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any, ClassVar

import pytest

from fmu_didim.campaigns import campaign as module
from fmu_didim.campaigns.running import runner
from fmu_didim.components.fmu.isolation.process import ProcessEndedError
from tests.campaigns.helpers import small
from tests.patience import patience, wait_until


@pytest.mark.gate
def test_the_checks_are_announced(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "fmu_didim"):
        small(tmp_path).check(workers=2)
    assert "checking 2 cases ..." in caplog.messages


class Waiting:
    """A process whose requests wait until it is killed."""

    made: ClassVar[list[Waiting]] = []

    def __init__(self, *_: Any, **__: Any) -> None:
        self.killed = threading.Event()
        Waiting.made.append(self)

    def request(self, what: str, *_: Any, **__: Any) -> None:
        if what == "the run":
            self.killed.wait(patience(60.0))
            raise ProcessEndedError("It was killed.", next_step="Begin again.")

    def kill(self) -> None:
        self.killed.set()

    def close(self) -> None:
        pass


def test_an_interrupt_during_the_checks_ends_them_and_loads_no_further_case(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Waiting.made.clear()
    monkeypatch.setattr(runner, "Worker", Waiting)
    monkeypatch.setattr(runner, "_fmu_slots", lambda *_: nullcontext())

    def interrupted(plan: Any, attempt: Any) -> None:
        def beside() -> None:
            with suppress(Exception):  # what is left of it ends with the executor
                attempt([None] * 20)

        threading.Thread(target=beside, daemon=True).start()
        wait_until(lambda: len(Waiting.made) == 2)
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "case_problems", interrupted)
    with pytest.raises(KeyboardInterrupt):
        small(tmp_path).check(workers=2)
    assert len(Waiting.made) == 2, "no process was started for a further case"


def test_a_stopped_worker_starts_no_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "Worker", Waiting)
    Waiting.made.clear()
    worker = runner.RunWorker(tmp_path, small(tmp_path).plan.document.limits)
    worker.stop()
    with pytest.raises(ProcessEndedError, match="interrupted"):
        worker.ask(print)
    assert not Waiting.made
