"""Work that is mostly Python, in copies of the process: same results, same errors, and threads where it is not safe."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from fmu_didim.base.errors import SimulationError
from fmu_didim.model.workers import apart, can_copy_process

IN_ONE_OF_ITS_OWN = """
import os, signal, sys, time
from fmu_didim.base.errors import SimulationError
from fmu_didim.model.workers import apart, can_copy_process, default_workers

here = os.getpid()

def refused():
    raise SimulationError("broken", where="plant", next_step="Change it.")

def killed(i):
    time.sleep(0.1)
    if os.getpid() != here:
        os.kill(os.getpid(), signal.SIGKILL)
    return i

def slow(seconds, result):
    time.sleep(seconds)
    return result()

assert can_copy_process() == (sys.platform == "linux")
is_linux = sys.platform == "linux"
found = apart([lambda i=i: slow(0.3, lambda: (i, os.getpid())) for i in range(5)], 2)
assert [i for i, _ in found] == [0, 1, 2, 3, 4], found
assert len({pid for _, pid in found}) == (2 if is_linux else 1), found
found = apart([lambda s=s: slow(s, os.getpid) for s in (3.0, 0.0, 0.0, 0.0, 0.0, 0.0)], 2)  # who is free takes the next
assert not is_linux or (len(set(found[1:])) == 1 and found[0] != found[1]), found
count = 5000  # more tasks than shares: each is done once, by one of both
told = apart([lambda i=i: i for i in range(count)], 2)
assert told == list(range(count)), told
assert apart([lambda i=i: b"0" * 10_000_000 for i in range(3)], 3) == [b"0" * 10_000_000] * 3  # more than a pipe holds
asked = [lambda i=i: slow(0.3, lambda: (lambda: i)) for i in range(4)]
assert [one() for one in apart(asked, 2)] == [0, 1, 2, 3]  # cannot be handed back
assert apart([lambda i=i: killed(i) for i in range(4)], 2) == [0, 1, 2, 3]
copies = apart([lambda: slow(0.3, lambda: (os.getpid(), can_copy_process())) for _ in range(4)], 2)
assert not any(can for pid, can in copies if pid != here)  # a copy makes no copies
assert not is_linux or any(pid != here for pid, _ in copies)
before = os.listdir("/proc/self/fd") if is_linux else []
apart([os.getpid] * 4, 2)
assert not is_linux or len(os.listdir("/proc/self/fd")) == len(before)
try:
    apart([lambda: 1, refused, lambda: 2], 2)
except SimulationError as error:
    assert (error.what, error.where, error.next_step) == ("broken", "plant", "Change it.")
else:
    raise AssertionError
print("as it should be")
"""


def test_a_process_and_its_copies_share_the_tasks() -> None:
    """In a process without other threads."""
    done = subprocess.run([sys.executable, "-W", "error", "-c", IN_ONE_OF_ITS_OWN], capture_output=True, text=True)
    assert (done.stdout, done.returncode) == ("as it should be\n", 0), done.stderr


@pytest.mark.parametrize("is_linux", [True, False])
def test_beside_another_thread_nothing_is_copied(monkeypatch: pytest.MonkeyPatch, is_linux: bool) -> None:
    monkeypatch.setattr(sys, "platform", "linux" if is_linux else "darwin")
    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    try:
        assert not can_copy_process()
        assert set(apart([os.getpid] * 4, 2)) == {os.getpid()}
    finally:
        done.set()
        other.join()


def test_one_worker_does_all_in_this_process() -> None:
    assert apart([threading.get_ident] * 3, 1) == [threading.get_ident()] * 3

    def refused() -> int:
        raise SimulationError("broken", next_step="Change it.")

    with pytest.raises(SimulationError, match="broken"):
        apart([lambda: 1, refused], 1)


BESIDE = """
import multiprocessing, os, sys, time
from fmu_didim.base.errors import SimulationError
from fmu_didim.model.workers import Beside, apart

here = os.getpid()

def refused():
    raise SimulationError("broken", where="plant", next_step="Change it.")

def killed():
    if os.getpid() != here:
        os.kill(os.getpid(), 9)
    return os.getpid()

def in_turn():
    return set(apart([os.getpid] * 3, 2)) == {os.getpid()}

linux = sys.platform == "linux"
task = Beside(lambda: (time.sleep(0.3), os.getpid())[1], 2)
assert task.is_done != linux
assert (task.result() != here) == linux and task.result() == task.result() and task.is_done
assert Beside(os.getpid, 1).result() == here
assert Beside(lambda: b"0" * 10_000_000, 2).result() == b"0" * 10_000_000  # more than a pipe holds
assert Beside(lambda: (lambda: 3), 2).result()() == 3  # cannot be handed back
assert Beside(killed, 2).result() == here
assert Beside(in_turn, 2).result()
for workers in (1, 2):
    failing = Beside(refused, workers)  # told when it is asked for
    for _ in range(2):
        try:
            failing.result()
        except SimulationError as error:
            assert (error.what, error.where) == ("broken", "plant")
        else:
            raise AssertionError
done = []
asked = Beside(lambda: done.append(1) or len(done), 1, at_once=False)  # where there is no copy: when it is asked for
assert not done and not asked.is_done and asked.result() == asked.result() == 1
left = Beside(lambda: time.sleep(60), 2, at_once=False)
begin = time.perf_counter()
left.leave()
assert not linux or (time.perf_counter() - begin < 30 and not multiprocessing.active_children())
ended = Beside(killed, 2)
while not ended.is_done:  # a copy that has died has nothing more to say
    time.sleep(0.01)
print("as it should be")
"""


def test_a_copy_works_beside_this_process() -> None:
    done = subprocess.run([sys.executable, "-W", "error", "-c", BESIDE], capture_output=True, text=True)
    assert (done.stdout, done.returncode) == ("as it should be\n", 0), done.stderr
