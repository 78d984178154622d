"""Verbs that make an answer for a case, show it and save it: what they print, and in which order."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

from fmu_didim.base.terminal import json_shown
from fmu_didim.cli.console import Display, show


class Answer(Protocol):
    """What such a verb finds."""

    @property
    def exit_code(self) -> int: ...
    @property
    def ok(self) -> bool: ...
    def summary(self) -> str: ...
    def saved(self) -> dict[str, Any]: ...
    def save(self, folder: Path) -> Sequence[Path]: ...


def show_and_save(
    options: argparse.Namespace,
    out: Path,
    make: Callable[[Callable[[str], None]], Answer],
    last: Callable[[Sequence[Path]], str],
) -> int:
    """Make the answer, show it, save it in a folder that is tried before any work, and return its exit code.

    Args:
        make: from the progress; last: from the files that were written to the last line, where the answer can be used.
    """
    with Display(quiet=options.quiet or options.json) as display:
        display.say(f"reading {options.case}")
        from fmu_didim.workflow.output.result_folder import check_writable

        check_writable(out)
        found = make(display.say)
        display.close()
        if not options.json:
            show(f"\n{found.summary()}")
        written = found.save(out)
    if options.json:
        print(json_shown(json.dumps(found.saved(), indent=1, ensure_ascii=False)))
        return found.exit_code
    print("\n".join(str(path) for path in written))
    if found.ok:
        print(last(written))
    return found.exit_code
