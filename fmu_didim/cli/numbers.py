"""Numbers on the command line: what each option takes."""

from __future__ import annotations

import argparse
import math


def at_least_one(text: str) -> int:
    """A whole number from 1 on; raises ArgumentTypeError."""
    return _whole(text, 1)


def at_least_two(text: str) -> int:
    """A whole number from 2 on; raises ArgumentTypeError."""
    return _whole(text, 2)


def not_negative(text: str) -> int:
    """A whole number from 0 on; raises ArgumentTypeError."""
    return _whole(text, 0)


def positive(text: str) -> float:
    """A finite number above 0; raises ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"it takes a number above 0, not '{text}'")
    return value


def _whole(text: str, least: int) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least:
        raise argparse.ArgumentTypeError(f"it takes a whole number from {least} on, not '{text}'")
    return value
