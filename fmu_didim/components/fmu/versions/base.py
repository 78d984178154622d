"""A version of FMI, for reading and running FMUs."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from fmu_didim.components.fmu.binding import Binding
from fmu_didim.components.fmu.description import FmuDescription

Signatures = Mapping[str, tuple[list[Any], Any]]
"""Name of a C function -> its argument types and its result type."""
TRUE = ("true", "1")
"""The texts of a Boolean attribute that is true."""


@dataclass(frozen=True)
class DescriptionFile:
    """A ``modelDescription.xml`` that is safe to read.

    Attributes:
        path: the ``.fmu`` file; folder: where it is extracted; digest: SHA-256 of the file.
        platforms: folders of ``binaries/`` with at least one library; root: the root element.
    """

    path: Path
    folder: Path
    digest: str
    platforms: tuple[str, ...]
    root: ET.Element

    @property
    def version(self) -> str:
        """The version as the file states it; empty if it does not."""
        return self.root.get("fmiVersion", "")


def _nothing(root: ET.Element) -> str:
    return ""


def _as_it_is(name: str, identifier: str) -> str:
    return name


@dataclass(frozen=True)
class FmiVersion:
    """A version of FMI: how its descriptions are read, and how its functions are found and called.

    It travels to the processes of isolated FMUs, so its functions must be picklable: no lambdas.

    Attributes:
        name: what ``fmiVersion`` of its descriptions says.
        describe: reads a description, types of variables by their names in FMI 2.0 or 3.0; what it raises means that
            the file is wrong.
        binding: the calls on an instance.
        required: kind of interface that can be run -> C functions without which it cannot, one text without prefixes.
        signatures: kind of interface -> its C functions, those among them that are optional too.
        platform_folders: names in ``binaries/`` under which those for this machine may lie, the standard's own first.
        has_minors: whether its later minor versions and bug fixes (``3.1``, ``3.0.2``) are read as this one.
        symbol: (name of a C function, model identifier) -> its name in the library.
        refusal: what keeps a file of this version from being read; empty if nothing does.
    """

    name: str
    describe: Callable[[DescriptionFile], FmuDescription]
    binding: type[Binding]
    required: Mapping[str, str]
    signatures: Callable[[str], Signatures]
    platform_folders: Callable[[], tuple[str, ...]]
    has_minors: bool = False
    symbol: Callable[[str, str], str] = _as_it_is
    refusal: Callable[[ET.Element], str] = _nothing

    def accepts(self, text: str) -> bool:
        """Whether a description with this ``fmiVersion`` is read as this version; drafts (``3.0-beta.2``) are not."""
        major, number = self.name.partition(".")[0], "(0|[1-9][0-9]*)"
        later = rf"{re.escape(major)}\.{number}(\.{number})?"
        return text == self.name or (self.has_minors and re.fullmatch(later, text) is not None)
