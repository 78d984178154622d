"""Exceptions of the framework.

Each says *what* went wrong, *where*, what was *got*, which values are *valid* and the
*next step*, so that the message alone is enough to act on.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any


def _restored(kind: type[FmuDidimError], text: str, state: Mapping[str, Any]) -> FmuDidimError:
    """An error as it was in another process."""
    error = kind.__new__(kind, text)
    error.__dict__.update(state)
    return error


class FmuDidimError(Exception):
    """Root of all errors raised by the framework."""

    def __init__(
        self, what: str, *, where: str = "", got: object = None, valid: Iterable[str] | str = (), next_step: str = ""
    ) -> None:
        self.what = what
        self.where = where
        self.got = got
        self.valid = valid if isinstance(valid, str) else ", ".join(valid)
        self.next_step = next_step
        super().__init__(self._text())

    def __reduce__(self) -> tuple[Any, ...]:
        got = None if self.got is None else str(self.got)  # which may be anything
        return _restored, (type(self), str(self), {**self.__dict__, "got": got})

    def _text(self) -> str:
        lines = [self.what]
        if self.where:
            lines.append(f"  where: {self.where}")
        if self.got is not None:
            lines.append(f"  got:   {self.got}")
        if self.valid:
            lines.append(f"  valid: {self.valid}")
        if self.next_step:
            lines.append(f"  next:  {self.next_step}")
        return "\n".join(lines)


class InputError(FmuDidimError):
    """A file, an option or a value given by the user cannot be used."""


class UnknownNameError(InputError):
    """A name does not exist; the closest valid names are suggested."""

    def __init__(self, kind: str, name: str, valid: Iterable[str], *, where: str = "") -> None:
        names = list(valid)
        near = difflib.get_close_matches(name, names, n=1)
        super().__init__(
            f"There is no {kind} named '{name}'.",
            where=where,
            got=name,
            valid=names,
            next_step=f"Did you mean '{near[0]}'?" if near else "",
        )


class FmuError(FmuDidimError):
    """An FMU cannot be loaded, or one of its functions returned an error."""


class BuildError(FmuDidimError):
    """The C compiler could not build a binary."""


class SimulationError(FmuDidimError):
    """A closed-loop simulation stopped before its end."""


class DivergedError(SimulationError):
    """A closed-loop simulation left every sensible range or returned NaN."""

    def __init__(self, what: str, *, time: float, where: str = "", next_step: str = "") -> None:
        self.time = time
        super().__init__(what, where=where, got=f"t = {time:.6g} s", next_step=next_step)


class IdentificationError(FmuDidimError):
    """No parameters could be identified; nothing is returned in their place."""
