"""What a search reports of its progress, with a clock by hand."""

from __future__ import annotations

import threading

import pytest

from fmu_didim.discovery.progress import SAID_EVERY_S, Progress, never_silent, seconds_left
from tests.patience import patience


@pytest.mark.parametrize(
    ("done", "count", "elapsed", "left"),
    [(1, 4, 2.0, 6.0), (3, 4, 6.0, 2.0), (4, 4, 8.0, 0.0), (0, 4, 3.0, float("inf"))],
)
def test_the_rest_takes_as_long_as_what_is_done(done: int, count: int, elapsed: float, left: float) -> None:
    assert seconds_left(done, count, elapsed) == pytest.approx(left)


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.time = 100.0

    def __call__(self) -> float:
        return self.time


def test_each_piece_with_something_to_say_is_told_with_the_time_left() -> None:
    said, clock = list[str](), Clock()
    one_more = Progress(said.append, now=clock).counted("fitting candidate", 3)
    for text in ("a", "b", "c"):
        clock.time += 10.0
        one_more(text)
    assert said == [
        "fitting candidate 1 of 3, about 20 s left: a",
        "fitting candidate 2 of 3, about 10 s left: b",
        "fitting candidate 3 of 3: c",
    ]


def test_pieces_with_nothing_to_say_are_told_now_and_then() -> None:
    said, clock = list[str](), Clock()
    one_more = Progress(said.append, now=clock).counted("signatures of candidate", 100)
    for _ in range(100):
        clock.time += 0.3 * SAID_EVERY_S
        one_more("")
    assert len(said) == 24  # each fourth, but for the last
    assert said[0] == f"signatures of candidate 4 of 100, about {96 * 0.3 * SAID_EVERY_S:.0f} s left"
    assert said[-1].startswith("signatures of candidate 96 of 100")


@pytest.mark.parametrize(("ends", "over"), [(99.0, True), (100.0, True), (100.1, False), (float("inf"), False)])
def test_the_time_is_up_from_its_end_on(ends: float, over: bool) -> None:
    assert Progress(ends=ends, now=Clock()).is_time_up is over


def test_a_long_silence_is_broken() -> None:
    """By what was said last, as often as nothing else is said; not before the first line, and not after the end."""
    said, thrice = list[str](), threading.Event()

    def say(text: str) -> None:
        said.append(text)
        if len(said) == 4:
            thrice.set()

    with never_silent(Progress(say), every_s=0.01) as progress:
        progress.say("base model")
        assert thrice.wait(patience(10))
    count = len(said)
    assert said[0] == "base model" and all(line.startswith("base model (") for line in said[1:])
    assert all("still at work" in line for line in said[1:])
    assert not [t for t in threading.enumerate() if "remind" in t.name]
    assert len(said) == count


def test_who_speaks_is_not_interrupted() -> None:
    said = list[str]()
    with never_silent(Progress(said.append), every_s=patience(60)) as progress:
        for k in range(20):
            progress.say(str(k))
    assert said == [str(k) for k in range(20)]


def test_the_reminder_ends_with_a_search_that_fails() -> None:
    before = threading.active_count()
    with pytest.raises(ValueError), never_silent(Progress()) as progress:
        progress.say("base model")
        raise ValueError("of the search")
    assert threading.active_count() == before
