"""What a search reports of its progress, with a clock by hand."""

from __future__ import annotations

import pytest

from fmu_didim.discovery.progress import SAID_EVERY_S, Progress, seconds_left


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
