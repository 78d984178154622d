"""A version of FMI, for writing FMUs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fmu_didim.dynamics.block import Block
from fmu_didim.export.platforms import Platform


def _no_sources(block: Block) -> dict[str, str]:
    return {}


@dataclass(frozen=True)
class WrittenVersion:
    """A version of FMI: how it describes a block, and the layout of its archive.

    Attributes:
        name: what ``fmiVersion`` of its descriptions says.
        main: the file in ``wrapper/`` that is compiled; it includes the others.
        describe: (block, GUID or token compiled into the binary, name and version of the exporter, whether it gives
            directional derivatives) -> the text of ``modelDescription.xml``, for co-simulation and model exchange.
            Value references are those of
            :func:`fmu_didim.export.c_code.layout`.
        folders: (platforms, this machine) -> folders in ``binaries/`` and what is in them.
        sources: further files of ``sources/``: name -> text.
        own_names: names of the variables that only an FMU of this version has beside those of the block.
    """

    name: str
    main: str
    describe: Callable[[Block, str, str, bool], str]
    folders: Callable[[Sequence[Platform], Platform], Mapping[str, Platform]]
    sources: Callable[[Block], Mapping[str, str]] = _no_sources
    own_names: tuple[str, ...] = ()
