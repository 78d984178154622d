"""A clock that does not keep the process from being copied."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import pytest

from fmu_didim.base.ticking import Ticking, is_alone

COPIED = """
import os, threading, time
from fmu_didim.base.ticking import Ticking, is_alone
from fmu_didim.model.workers import Beside, apart

ticks, threads = [], lambda: threading.active_count()
clock = Ticking(lambda: ticks.append(os.getpid()), 0.001)
clock.start()
assert threads() == 2 and is_alone()
seen = dict(apart([lambda: (time.sleep(0.5), (os.getpid(), (threads(), is_alone())))[1]] * 2, 2))  # one each
assert len(seen) == 2 and seen.pop(os.getpid()) == (2, True) and [*seen.values()] == [(1, True)], seen
beside = Beside(lambda: (time.sleep(0.2), len(ticks), threads())[1:], 2)
begun = len(ticks)
counted, alone = beside.result()
assert alone == 1 and counted <= begun, (alone, counted, begun)  # no tick in the copy
assert len(ticks) > begun + 5 and set(ticks) == {os.getpid()}
clock.stop()
seen = len(ticks)
time.sleep(0.05)
assert len(ticks) == seen and threads() == 1 and is_alone()
print("as it should be")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="no copies of the process")
def test_it_goes_on_here_and_not_in_a_copy() -> None:
    done = subprocess.run([sys.executable, "-W", "error", "-c", COPIED], capture_output=True, text=True)
    assert (done.stdout, done.returncode) == ("as it should be\n", 0), done.stderr


def until(holds: Callable[[], bool]) -> bool:
    """Whether something comes to hold within some seconds."""
    for _ in range(500):
        if holds():
            return True
        time.sleep(0.01)
    return False


def test_it_ticks_until_it_is_stopped() -> None:
    ticks, before = list[int](), threading.active_count()
    clock = Ticking(lambda: ticks.append(os.getpid()), 0.001)
    clock.start()
    assert until(lambda: len(ticks) > 3)
    assert threading.active_count() == before + 1
    clock.stop()
    assert threading.active_count() == before


def test_it_may_be_stopped_by_its_own_call() -> None:
    """As by a display that fails."""
    clock = Ticking(lambda: clock.stop(), 0.001)
    clock.start()
    assert until(lambda: clock._over.is_set())


def test_another_thread_counts() -> None:
    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    try:
        assert not is_alone()
    finally:
        done.set()
        other.join()
