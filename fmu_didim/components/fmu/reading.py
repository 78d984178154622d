"""Reads ``modelDescription.xml``: the part that all versions of FMI share; the rest is in ``versions``."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from fmu_didim.components.fmu.archive import DESCRIPTION, check_description, open_archive, unreadable
from fmu_didim.components.fmu.description import FmuDescription
from fmu_didim.components.fmu.versions import unsupported_version, version_of
from fmu_didim.components.fmu.versions.base import DescriptionFile

MAXIMUM_ELEMENTS = 100_000
"""[1] Elements of an array at most: each becomes a variable of its own."""
_WRONG = f"its {DESCRIPTION} is wrong"
_SUFFIXES = (".so", ".dll", ".dylib")


def read_description(path: Path | str) -> FmuDescription:
    """Read the description of an FMU, without loading its library. It is not validated.

    Raises:
        FmuError: the file is not a readable FMU, or of a version that is not in the table of ``versions``.
    """
    path = Path(path)
    folder, digest = open_archive(path)
    content = (folder / DESCRIPTION).read_bytes()
    check_description(content, path)
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise unreadable(_WRONG, path, str(error)) from error
    file = DescriptionFile(path, folder, digest, _platforms(folder), root)
    if root.tag != "fmiModelDescription" or not file.version:
        raise unsupported_version(f"no fmiVersion in <{root.tag}>", str(path))
    fmi = version_of(file.version, str(path))
    if refusal := fmi.refusal(root):
        raise unsupported_version(f"{file.version}, {refusal}", str(path))
    try:
        found = fmi.describe(file)
    except Exception as error:
        raise unreadable(_WRONG, path, f"{type(error).__name__}: {error}") from error
    for variable in found.variables:
        if min(variable.shape, default=1) < 0 or variable.size > MAXIMUM_ELEMENTS:
            got = f"'{variable.name}' has the shape {variable.shape}"
            raise unreadable(f"an array has more than {MAXIMUM_ELEMENTS} elements, or less than none", path, got)
    return found


def _platforms(folder: Path) -> tuple[str, ...]:
    binaries = folder / "binaries"
    if not binaries.is_dir():
        return ()
    folders = [d for d in binaries.iterdir() if d.is_dir() and any(f.suffix in _SUFFIXES for f in d.iterdir())]
    return tuple(sorted(d.name for d in folders))
