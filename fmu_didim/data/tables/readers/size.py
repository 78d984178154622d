"""How much a file of signals may hold, which compressed and sparse ones state before they are read."""

from __future__ import annotations

from pathlib import Path

from fmu_didim.base.errors import InputError

MOST_VALUES = 2**27
"""[1] Values of a file at most, 1 GiB as floats: an hour of 30 signals at 1 kHz has 10^8. Some kilobytes can state any
number of them."""


def check_size(values: int, path: Path) -> None:
    """Raise InputError where a file holds more values than are read; called before memory is taken for them."""
    if values > MOST_VALUES:
        raise InputError(
            "The file holds more values than are read at once.", where=str(path),
            got=f"{values:.3g} values in {path.stat().st_size} bytes", valid=f"at most {MOST_VALUES:.3g}",
            next_step="Write a file with the part of the time and the signals that are needed.",
        )  # fmt: skip
