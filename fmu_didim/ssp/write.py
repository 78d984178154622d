"""From a system of FMUs to a ``.ssp`` archive."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.base.files import file_name, whole_file
from fmu_didim.cosim import System
from fmu_didim.ssp.archive import parse_xml
from fmu_didim.ssp.compose import Part, connections, parts
from fmu_didim.ssp.document import STRUCTURE, free_name
from fmu_didim.ssp.xml_text import parameter_set, structure_text

_ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # the earliest a zip file can hold; the same content gives the same bytes


def write_ssp(
    system: System, path: Path | str, *, name: str, parameters: Mapping[str, Mapping[str, float]] | None = None
) -> Path:
    """Write a system as an SSP 1.0 archive: its FMUs, wiring, units, and the values that were set.

    The columns of the reference become input connectors of the system, in the unit of the first input that
    each feeds; gains become linear transformations, with suppressUnitConversion where the units of both ends
    differ, because a gain of this framework already contains the conversion. What was set in a component
    (:meth:`~fmu_didim.components.Component.with_parameters`, start values of inputs) goes into
    ``resources/<component>.ssv``. Order, delays, step and roles of the variables, for which SSP has no
    words, go into an annotation of the type ``org.fmu-didim.loop``, which other tools ignore.

    Args:
        system: all its components must be FMUs.
        path: the file to write; it appears as a whole or not at all.
        name: name of the system, for the user.
        parameters: component -> name -> value in addition, such as what was identified.

    Returns:
        The path.

    Raises:
        InputError: a component is no FMU, or several connections add up in one input.
        UnknownNameError: ``parameters`` names a component or parameter that does not exist.

    Source: "System Structure and Parameterization", version 1.0.
    """
    path = Path(path)
    for component, values in (parameters or {}).items():
        if component not in system.components:
            raise UnknownNameError("component", component, system.components, where="parameters of write_ssp")
        system = system.replace(component, system.components[component].with_parameters(values))
    own = parts(system)
    sources = _sources(own)
    files: dict[str, bytes | Path] = {}
    bindings: dict[str, str] = {}
    for component, part in own.items():
        files[sources[component]] = part.fmu.path
        if part.values:
            bindings[component] = free_name(f"resources/{_safe(component)}", ".ssv", files)
            files[bindings[component]] = parameter_set(component, part).encode()
    text = structure_text(
        name, system, own, connections(system, own),
        {component: quote(source) for component, source in sources.items()},
        {component: quote(source) for component, source in bindings.items()},
    )  # fmt: skip
    for what, content in ((STRUCTURE, text.encode()), *((n, c) for n, c in files.items() if isinstance(c, bytes))):
        parse_xml(content, where=f"{path}: {what}")  # a name may hold characters that XML cannot
    _write(path, {STRUCTURE: text.encode(), **files})
    return path


def _sources(own: Mapping[str, Part]) -> dict[str, str]:
    """Component -> its FMU in the archive; components of the same FMU share the file."""
    by_digest: dict[str, str] = {}
    for part in own.values():
        digest = part.fmu.digest
        if digest not in by_digest:
            by_digest[digest] = free_name(f"resources/{_safe(part.fmu.path.stem)}", ".fmu", set(by_digest.values()))
    return {component: by_digest[part.fmu.digest] for component, part in own.items()}


def _safe(name: str) -> str:
    return file_name(re.sub(r"[^A-Za-z0-9_-]", "_", name))


def _write(path: Path, files: Mapping[str, bytes | Path]) -> None:
    if not path.parent.is_dir():
        raise InputError(
            "The folder does not exist.", where=str(path.parent), next_step="Make it first, or choose another path."
        )
    with whole_file(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, date_time=_ZIP_TIME)
            entry.external_attr = 0o644 << 16
            # An FMU is compressed already.
            entry.compress_type = zipfile.ZIP_STORED if isinstance(content, Path) else zipfile.ZIP_DEFLATED
            archive.writestr(entry, content.read_bytes() if isinstance(content, Path) else content)
