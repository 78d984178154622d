"""Progress of a search: messages, time left, and when its time is up."""

from __future__ import annotations

import threading
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from fmu_didim.base.errors import InputError

SAID_EVERY_S = 5.0
"""[s] Time between two lines about the progress of a piece of work."""

Say = Callable[[str], None]
"""Takes a line about a piece of work."""


def seconds_left(done: int, count: int, elapsed: float) -> float:
    """Time in s that the rest of ``count`` equal pieces of work takes, from what the first ``done`` of them took."""
    return elapsed / done * (count - done) if done else float("inf")


@dataclass(frozen=True)
class Progress:
    """Progress of a search and the time that it has.

    Attributes:
        say: called with a line about each piece of work.
        limit_s: time available, None without a limit; ends: reading of the clock ``now`` (s) at which it is up.
    """

    say: Say = field(default=lambda text: None)
    limit_s: float | None = None
    ends: float = float("inf")
    now: Callable[[], float] = clock.perf_counter

    @staticmethod
    def limited(say: Say, limit_s: float | None) -> Progress:
        """Progress whose time starts now.

        Raises:
            InputError: the limit is not a positive number.
        """
        if limit_s is None:
            return Progress(say)
        if not limit_s > 0:
            raise InputError(
                "The time limit is not valid.", where="time_limit", got=f"{limit_s:g}", valid="> 0 s",
                next_step="Give minutes above 0, or leave the limit out.",
            )  # fmt: skip
        return Progress(say, limit_s, clock.perf_counter() + limit_s)

    @property
    def is_time_up(self) -> bool:
        """Whether the time is up, so that nothing new is begun."""
        return self.now() >= self.ends

    def counted(self, what: str, count: int) -> Callable[[str], None]:
        """A function to call after each of ``count`` pieces of work, which reports their number and the time left.

        It takes a text about the piece; pieces without one are reported every few seconds only.

        Args:
            what: the kind of work, such as ``fitting candidate``.
        """
        begin = last = self.now()
        done, lock = 0, threading.Lock()

        def one_more(text: str = "") -> None:
            nonlocal done, last
            with lock:
                done += 1
                now = self.now()
                if not text and (now - last < SAID_EVERY_S or done == count):
                    return
                last = now
                left = f", about {seconds_left(done, count, now - begin):.0f} s left" if done < count else ""
                self.say(f"{what} {done} of {count}{left}" + (f": {text}" if text else ""))

        return one_more


@contextmanager
def never_silent(progress: Progress, *, every_s: float = SAID_EVERY_S) -> Iterator[Progress]:
    """Progress that says what it said last once more, with the time since then, where nothing was said for a while.

    Args:
        every_s: s, the longest silence.
    """
    last, since = "", progress.now()
    heard, over = threading.Condition(), False

    def say(text: str) -> None:
        nonlocal last, since
        with heard:
            last, since = text, progress.now()
            progress.say(text)
            heard.notify()

    def remind() -> None:
        with heard:
            while not over:
                if not heard.wait(every_s) and last and not over:
                    progress.say(f"{last} ({progress.now() - since:.0f} s ago, still at work)")

    thread = threading.Thread(target=remind, daemon=True)
    thread.start()
    try:
        yield replace(progress, say=say)
    finally:
        with heard:
            over = True
            heard.notify()
        thread.join()
