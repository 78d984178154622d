"""Progress of a long job: plain lines in a file or a pipe; colour, a live table and a running clock in a terminal."""

from __future__ import annotations

import logging
import math
import os
import sys
import time
from typing import TYPE_CHECKING, Any, TextIO

from fmu_didim.base.terminal import harmless
from fmu_didim.base.ticking import Ticking

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.live import Live

    from fmu_didim.fit.iteration import Iteration

_begun = [time.perf_counter()]
YELLOW = "bold yellow"
_STYLES = (
    (r"(?m)^((VALID|READY|NAMED|NOTHING MISSING):|No mistakes).*", "bold green"),
    (
        r"(?m)^(DOUBTFUL|NOT SETTLED|NOT FINISHED|NAMED IN PART|NAMED, WITH DOUBTS|NOTHING FOUND|THE EXP[A-Z ]+):.*",
        YELLOW,
    ),
    (r"(?m)^READY, with doubts.*", YELLOW),
    (r"(?m)^(REFUSED|NOT READY|UNKNOWN):.*", "bold red"),
    (r"(?m)^PROBLEM\b", "bold red"),
    (r"(?m)^DOUBT\b", YELLOW),
    (r"(?m)^\s*Next:", "cyan"),
    (r"\[[a-z]+(-[a-z]+)*\]$", "dim"),
    (r"(?m)^\s+(where|got|valid|next|code):", "cyan"),
)
TICK_S = 0.2
"""[s] After which the clock on a terminal is drawn again."""
ROWS = 12
"""Iterations that the live table shows."""


def begin() -> None:
    """Start the clock of a command: earlier work of its process is not counted."""
    _begun[0] = time.perf_counter()


def since_start() -> float:
    """Seconds since the command began; since this module was imported where none did."""
    return time.perf_counter() - _begun[0]


def raw(stream: Any) -> TextIO:
    """The stream under one that writes escapes out, which rich makes itself."""
    found: TextIO = getattr(stream, "_stream", stream)
    return found


def is_terminal(stream: Any) -> bool:
    """Whether a stream is a terminal that shows colours."""
    try:
        return bool(raw(stream).isatty()) and os.environ.get("TERM") != "dumb"
    except (AttributeError, ValueError):
        return False


def show(text: str, *, stream: Any = None, console: Console | None = None) -> None:
    """Print a text, coloured where it is a terminal."""
    stream = sys.stdout if stream is None else stream
    if console is None and not is_terminal(stream):
        print(text, file=stream, flush=True)
        return
    from rich.console import Console
    from rich.text import Text

    styled = Text(harmless(text))
    for pattern, style in _STYLES:
        styled.highlight_regex(pattern, style)
    (console or Console(file=raw(stream))).print(styled, soft_wrap=True, highlight=False)


class Display:
    """The progress of ``identify`` and ``discover``; a context.

    Args:
        quiet: whether nothing is shown; console: to write to, for tests.
    """

    def __init__(self, *, quiet: bool = False, console: Console | None = None) -> None:
        self._quiet, self._console = quiet, console
        self._live: Live | None = None
        self._clock: Ticking | None = None
        self._iterations: list[tuple[float, Iteration]] = []
        self._now = ""
        self._begun = 0.0

    def __enter__(self) -> Display:
        if self._quiet or (self._console is None and not is_terminal(sys.stdout)):
            return self
        from rich.console import Console
        from rich.live import Live

        self._console = self._console or Console(file=raw(sys.stdout))
        self._live = Live(
            console=self._console, get_renderable=self._shown, auto_refresh=False, redirect_stdout=False,
            vertical_overflow="visible", transient=True,
        )  # fmt: skip
        self._live.start()
        self._clock = Ticking(self._live.refresh, TICK_S)
        self._clock.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave what was shown as it is; what follows is printed under it."""
        if self._live is None or self._console is None:
            return
        live, self._live = self._live, None
        if self._clock is not None:
            self._clock.stop()
        live.stop()
        if self._iterations:
            self._console.print(self._table(self._iterations))

    def say(self, text: str) -> None:
        """Show the present work, with the time since the command began."""
        if self._quiet:
            return
        now = since_start()
        if self._live is None:
            print(f"{now:6.1f} s  {text}", flush=True)
            return
        if self._now and " of " not in self._now:  # a counter is written over by the next one
            self._live.console.print(f"{self._begun:6.1f} s  {harmless(self._now)}", markup=False, highlight=False)
        self._now, self._begun = text, now
        self._live.refresh()

    def iteration(self, iteration: Iteration) -> None:
        """Show a step of an estimator."""
        if self._quiet:
            return
        now = since_start()
        if self._live is None:
            error = iteration.relative_error_percent
            text = f"{iteration.quantity} error {error:7.3f} %" if math.isfinite(error) else "no simulation       "
            change = f", change {iteration.change:.2e}" if math.isfinite(iteration.change) else ""
            note = f"  [{iteration.note}]" if iteration.note else ""
            print(f"{now:6.1f} s  {iteration.stage:>6} {iteration.number}: {text}{change}{note}", flush=True)
            return
        self._iterations.append((now, iteration))
        self._live.refresh()

    def _shown(self) -> RenderableType:
        from rich.console import Group
        from rich.text import Text

        working = Text(
            f"{since_start():6.1f} s  {harmless(self._now)}", style="cyan", no_wrap=True, overflow="ellipsis"
        )
        if not self._iterations:
            return working
        return Group(self._table(self._iterations[-ROWS:]), working)

    @staticmethod
    def _table(rows: list[tuple[float, Iteration]]) -> RenderableType:
        from rich import box
        from rich.table import Table

        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for name in ("time", "step", f"{rows[-1][1].quantity} error", "change", ""):
            table.add_column(name, justify="left" if name in ("step", "") else "right")
        for now, it in rows:
            percent = it.relative_error_percent
            error = f"{percent:.3f} %" if math.isfinite(percent) else "no simulation"
            change = f"{it.change:.2e}" if math.isfinite(it.change) else ""
            note = harmless(it.note).replace("[", "\\[")
            table.add_row(f"{now:.1f} s", f"{it.stage} {it.number}", error, change, note)
        return table


class CurrentStderr(logging.StreamHandler[TextIO]):
    """Writes what the package logs to what standard error is at that moment, above a live table where there is one."""

    def __init__(self) -> None:
        logging.Handler.__init__(self)

    @property
    def stream(self) -> TextIO:  # type: ignore[override]
        """Standard error as it is now."""
        return sys.stderr
