"""The versions of FMI that can be written, one per file, and the table of them."""

from fmu_didim.base.errors import InputError
from fmu_didim.export.versions.base import WrittenVersion
from fmu_didim.export.versions.fmi2 import FMI_2
from fmu_didim.export.versions.fmi3 import FMI_3

VERSIONS: dict[str, WrittenVersion] = {fmi.name: fmi for fmi in (FMI_2, FMI_3)}
DEFAULT_VERSION = FMI_2.name


def written_version(name: str) -> WrittenVersion:
    """The version of this name; raises InputError if FMUs of it cannot be written."""
    if name not in VERSIONS:
        raise InputError(
            "This FMI version cannot be exported.", got=name, valid=VERSIONS, next_step="Take one of these."
        )
    return VERSIONS[name]


__all__ = ["DEFAULT_VERSION", "VERSIONS", "WrittenVersion", "written_version"]
