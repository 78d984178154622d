"""The current folder, which belongs to all threads, while one of them loads the library of an FMU."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import control
import numpy as np

from fmu_didim.components.fmu.library import CURRENT_FOLDER
from fmu_didim.components.user_control import wrap_control
from fmu_didim.cosim import Connection, System, simulate
from fmu_didim.data.signals import trajectory


def simulate_and(act: Callable[[], Any]) -> None:
    """A run in which a component does something else beside."""

    def output(t: float, x: Any, u: Any, params: Any) -> Any:
        act()
        return u

    component = wrap_control(control.nlsys(None, output, inputs=["u"], outputs=["y"]))
    system = System({"part": component}, (Connection("reference.u", "part.u"),), ("part",), 0.1)
    simulate(system, trajectory(np.arange(2) * 0.1, {"u": np.ones(2)}))


def test_a_run_does_not_take_the_folder_of_a_library_that_another_thread_loads_for_its_own(tmp_path: Path) -> None:
    here, begun = Path.cwd(), threading.Event()

    def load() -> None:
        with CURRENT_FOLDER:
            os.chdir(tmp_path)
            begun.set()
            threading.Event().wait(0.1)
            os.chdir(here)

    loading = threading.Thread(target=load)
    loading.start()
    begun.wait()
    simulate_and(loading.join)
    assert Path.cwd() == here


def test_a_run_that_leaves_the_folder_is_brought_back(tmp_path: Path) -> None:
    here = Path.cwd()
    simulate_and(lambda: os.chdir(tmp_path))
    assert Path.cwd() == here
