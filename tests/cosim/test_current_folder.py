"""The current folder, which belongs to all threads, while one of them loads the library of an FMU."""

from __future__ import annotations

import os
import threading
from pathlib import Path

from fmu_didim.components.fmu.library import CURRENT_FOLDER
from fmu_didim.cosim.simulation import _same_folder


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
    with _same_folder():
        loading.join()
    assert Path.cwd() == here


def test_a_run_that_leaves_the_folder_is_brought_back(tmp_path: Path) -> None:
    here = Path.cwd()
    with _same_folder():
        os.chdir(tmp_path)
    assert Path.cwd() == here
