"""The versions of FMI that can be read, one per file, and the table of them."""

from fmu_didim.base.errors import FmuError
from fmu_didim.components.fmu.description import CO_SIMULATION, MODEL_EXCHANGE
from fmu_didim.components.fmu.versions.base import FmiVersion
from fmu_didim.components.fmu.versions.fmi1 import FMI_1
from fmu_didim.components.fmu.versions.fmi2 import FMI_2
from fmu_didim.components.fmu.versions.fmi3 import FMI_3

VERSIONS: dict[str, FmiVersion] = {fmi.name: fmi for fmi in (FMI_1, FMI_2, FMI_3)}


def version_of(text: str, where: str) -> FmiVersion:
    """The version as which a description with this ``fmiVersion`` is read.

    Raises:
        FmuError: there is no such version; ``where`` is the place that the error names.
    """
    for fmi in VERSIONS.values():
        if fmi.accepts(text):
            return fmi
    raise unsupported_version(text, where)


def unsupported_version(got: str, where: str) -> FmuError:
    """The error of an FMU of a version that is not read."""
    whole = [fmi.name for fmi in VERSIONS.values() if {CO_SIMULATION, MODEL_EXCHANGE} <= set(fmi.required)]
    partial = [f"{fmi.name} for {', '.join(fmi.required)}" for fmi in VERSIONS.values() if fmi.name not in whole]
    draft = ": it is a draft of the standard" if "-" in got else ""
    return FmuError(
        f"This FMI version is not supported{draft}.",
        where=where,
        got=got,
        valid=(*whole, *partial),
        next_step=f"Export the FMU again for FMI {' or '.join(whole)}.",
    )


__all__ = ["VERSIONS", "FmiVersion", "unsupported_version", "version_of"]
