"""Discovery with the controller of another tool: one simulation at a time, whatever the number of threads."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from fmu_didim import discover
from fmu_didim.controllers import read_controller
from fmu_didim.export import build_fmu
from fmu_didim.model import loop_model
from fmu_didim.model.workers import VARIABLE
from fmu_didim.workflow.output.discovered import Discovered
from tests.awkward.build import by
from tests.discovery.helpers import RATE, arm_case

HIDDEN = {"stribeck": {"Fs": 1.5, "vs": 0.3}}


class Crowd:
    """How many simulations went on at once."""

    def __init__(self) -> None:
        self.now, self.most, self.all = 0, 0, 0
        self._lock = threading.Lock()

    @contextmanager
    def one_more(self) -> Iterator[None]:
        with self._lock:
            self.now, self.all = self.now + 1, self.all + 1
            self.most = max(self.most, self.now)
        try:
            yield
        finally:
            with self._lock:
                self.now -= 1


def discovered(folder: Path, tool: str, monkeypatch: pytest.MonkeyPatch, threads: int = 3) -> tuple[Discovered, Crowd]:
    case = arm_case(folder, HIDDEN)
    document = yaml.safe_load(case.read_text(encoding="utf-8"))
    law = build_fmu(read_controller(folder / "controller.yaml"), directory=folder)
    document["controller"] = {"kind": "fmu", "source": str(by(tool, law))}
    document["loop"] = {"rate_hz": RATE}
    case.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    crowd, run = Crowd(), loop_model.simulate

    def counted(*args: object, **options: object) -> object:
        with crowd.one_more():
            return run(*args, **options)

    monkeypatch.setattr(loop_model, "simulate", counted)
    monkeypatch.setenv(VARIABLE, str(threads))
    return discover(case, folder / "out"), crowd


@pytest.mark.gate
@pytest.mark.parametrize(
    ("tool", "threads", "at_once"),
    [("Vendor 1.0", 3, 1), *(pytest.param("fmu_didim 9.9", n, n, marks=pytest.mark.slow) for n in (3, 1))],
)
def test_only_instances_of_own_fmus_run_at_once(
    tmp_path: Path, tool: str, threads: int, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The third row shows that the variable holds, the second one that the first one can fail."""
    document, crowd = discovered(tmp_path, tool, monkeypatch, threads)
    assert [(f.effect, f.joint) for f in document.findings] == [("stribeck", 1)]
    assert crowd.all > 50
    assert crowd.most == 1 if at_once == 1 else 1 < crowd.most <= at_once
