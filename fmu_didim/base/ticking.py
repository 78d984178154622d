"""A clock on a terminal that does not keep the process from being copied: its thread ends for that moment."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable

_running: list[Ticking] = []


class Ticking:
    """Calls a function again and again in a thread of its own, until it is stopped.

    A process that is copied (``os.fork``) must have no other thread, which may hold a lock that nobody opens in the
    copy: before, the thread ends, and in this process another one goes on afterwards.

    Args:
        call: what is called; seconds: between two calls.
    """

    def __init__(self, call: Callable[[], object], seconds: float) -> None:
        self._call, self._seconds = call, seconds
        self._thread: threading.Thread | None = None
        self._over = threading.Event()

    def start(self) -> None:
        """Begin to call."""
        _running.append(self)
        self.resume()

    def stop(self) -> None:
        """Call no more; returns when the last call has ended."""
        _running.remove(self)
        self.pause()

    def pause(self) -> None:
        """End the thread, but for a call of its own."""
        self._over.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
            self._thread = None

    def resume(self) -> None:
        """Begin another thread."""
        if self._thread is None:
            self._over.clear()
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()

    def _run(self) -> None:
        while not self._over.wait(self._seconds):
            self._call()


def is_alone() -> bool:
    """Whether this process has no other thread, but for those that end when it is copied."""
    return threading.active_count() - len(_running) == 1


def _pause() -> None:
    for one in _running:
        one.pause()


def _resume() -> None:
    for one in _running:
        one.resume()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_pause, after_in_parent=_resume, after_in_child=_running.clear)
