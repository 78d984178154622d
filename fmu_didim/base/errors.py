"""Exceptions of the framework.

Each says *what* went wrong, *where*, what was *got*, which values are *valid* and the
*next step*, so that the message alone is enough to act on.
"""

from __future__ import annotations

import difflib
import platform
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, Self

MOST_NAMES = 60
"""Names that a message lists at most: nobody reads thousands of columns."""
LONGEST_NAME = 200
"""Characters of a name that is compared with others; those of machines and models have some tens."""
NOTHING_TO_NAME = "Leave it out: there is none that could be named."


def _restored(kind: type[FmuDidimError], text: str, state: Mapping[str, Any]) -> FmuDidimError:
    """An error as it was in another process."""
    error = kind.__new__(kind, text)
    error.__dict__.update(state)
    return error


class FmuDidimError(Exception):
    """Root of all errors raised by the framework.

    Attributes:
        next_step: what to do about it, which every error has to say.
        component: the component of the loop that failed by itself; "" if there is no such component.
    """

    component = ""

    def __init__(
        self, what: str, *, next_step: str, where: str = "", got: object = None, valid: Iterable[str] | str = ()
    ) -> None:
        self.what = what
        self.where = where
        self.got = got
        self.valid = valid if isinstance(valid, str) else listed(list(valid))
        self.next_step = next_step
        super().__init__(self._text())

    def in_component(self, name: str, time: float | None) -> Self:
        """This error as that of a component of the loop, at a time in s; None: in its initialisation.

        The first component that is named stays.
        """
        if not self.component:
            when = " in its initialisation" if time is None else f" at t = {time:.6g} s"
            self.what = f"The {name} failed{'' if ' at t = ' in self.what else when}: {self.what}"
            self.component, self.args = name, (self._text(),)
        return self

    def locate(self, place: str) -> None:
        """Name a file and its line before the place: ``case.yaml, line 12, ``."""
        self.where = f"{place}{self.where}"
        self.args = (self._text(),)

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
        lines.append(f"  next:  {self.next_step}")
        return "\n".join(lines)


def listed(names: Sequence[str], most: int = MOST_NAMES, *, separator: str = ", ") -> str:
    """Names in one line, the first ones of many: ``a, b and 3 others``."""
    shown = separator.join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} others"


class InputError(FmuDidimError):
    """A file, an option or a value given by the user cannot be used."""


class UnknownNameError(InputError):
    """A name does not exist; the closest valid names are suggested."""

    def __init__(self, kind: str, name: str, valid: Iterable[str], *, where: str = "") -> None:
        names = list(valid)
        near = difflib.get_close_matches(name[:LONGEST_NAME], [n for n in names if len(n) <= LONGEST_NAME], n=1)
        step = f"Did you mean '{near[0]}'?" if near else "Take one of the valid names." if names else NOTHING_TO_NAME
        super().__init__(f"There is no {kind} named '{name}'.", where=where, got=name, valid=names, next_step=step)


class FmuError(FmuDidimError):
    """An FMU cannot be loaded, or one of its functions returned an error."""


class BuildError(FmuDidimError):
    """The C compiler could not build a binary."""


class SimulationError(FmuDidimError):
    """A closed-loop simulation stopped before its end."""


class FixedParameterError(SimulationError):
    """A parameter of a component cannot be changed while it runs."""


class DivergedError(SimulationError):
    """A closed-loop simulation left every sensible range or returned NaN.

    Attributes:
        time: s; is_finite: whether the value that was out of range is a number.
    """

    def __init__(self, what: str, *, time: float, next_step: str, where: str = "", is_finite: bool = True) -> None:
        self.time, self.is_finite = time, is_finite
        super().__init__(what, where=where, got=f"t = {time:.6g} s", next_step=next_step)


class IdentificationError(FmuDidimError):
    """No parameters could be identified; nothing is returned in their place."""


class LibraryError(FmuDidimError):
    """A library that this package uses does not work as it is installed; no file of the user is to blame."""

    def __init__(self, name: str, *, got: object) -> None:
        version, bounds = _installed(name)
        super().__init__(
            f"The library {name} does not work as it is installed.", got=got, valid=bounds,
            where=f"{name} {version}, Python {platform.python_version()}",
            next_step=f'pip install --upgrade "{bounds or name}"',
        )  # fmt: skip


@contextmanager
def loading(name: str, *, absent: FmuDidimError | None = None) -> Iterator[None]:
    """Report an error during the import of a library as that of the library.

    Args:
        name: of its module; absent: raised where it is not installed at all.

    Raises:
        LibraryError: it is there and does not work, or is absent and always needed; ``absent``.
    """
    try:
        yield
    except Exception as error:
        if absent is not None and isinstance(error, ModuleNotFoundError) and error.name == name:
            raise absent from error
        raise LibraryError(name, got=f"{type(error).__name__}: {' '.join(str(error).split())[:200]}") from error


def _installed(name: str) -> tuple[str, str]:
    """The version of a library, "not installed" if there is none, and the versions that this package needs."""
    from importlib.metadata import PackageNotFoundError, requires, version

    found, bounds = "not installed", list[str]()
    with suppress(PackageNotFoundError):
        found = version(name)
    with suppress(PackageNotFoundError):  # the package may run from its folder
        bounds = [line.partition(";")[0].strip() for line in requires("fmu_didim") or ()]
    return found, next((line for line in bounds if re.match(rf"{name}\b(?!-)", line)), "")
