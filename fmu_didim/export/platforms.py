"""The machines an FMU is built for: their names, their folders in an FMU, their compiler targets."""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from fmu_didim.base.errors import InputError, UnknownNameError

_SUFFIXES = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}


@dataclass(frozen=True)
class Platform:
    """One kind of machine.

    Attributes:
        name: what the user writes, such as ``linux-arm64``.
        system: ``linux``, ``windows`` or ``darwin``, as in FMI.
        architecture: ``x86_64``, ``aarch64``, ..., as in FMI.
        zig_target: how the compiler of ``ziglang`` calls it; empty: the machine it runs on.
    """

    name: str
    system: str
    architecture: str
    zig_target: str = ""

    @property
    def suffix(self) -> str:
        """File name extension of a shared library."""
        return _SUFFIXES[self.system]

    @property
    def bits_folder(self) -> str:
        """A folder in ``binaries/`` that states the bits only: ``linux64``, ``win64``, ``darwin64``."""
        bits = "32" if self.architecture in ("x86", "i386", "i686", "aarch32", "armv7l") else "64"
        return f"{'win' if self.system == 'windows' else self.system}{bits}"

    @property
    def tuple_folder(self) -> str:
        """A folder in ``binaries/`` that is a platform tuple: ``x86_64-linux``."""
        return f"{self.architecture}-{self.system}"


# An old C library and an old macOS, so that the result also runs on machines that are not new.
PLATFORMS: dict[str, Platform] = {
    p.name: p
    for p in (
        Platform("linux-x86_64", "linux", "x86_64", "x86_64-linux-gnu.2.17"),
        Platform("linux-arm64", "linux", "aarch64", "aarch64-linux-gnu.2.17"),
        Platform("windows-x86_64", "windows", "x86_64", "x86_64-windows-gnu"),
        Platform("macos-x86_64", "darwin", "x86_64", "x86_64-macos.11.0"),
        Platform("macos-arm64", "darwin", "aarch64", "aarch64-macos.11.0"),
    )
}
"""The machines that can be built for from any other."""


def host_platform() -> Platform:
    """This machine; for the Python that runs, so a 32-bit one on a 64-bit system counts as 32-bit."""
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    machine = platform.machine().lower()
    architecture = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    if architecture in ("x86_64", "i386", "i686") and sys.maxsize < 2**32:
        architecture = "x86"
    for known in PLATFORMS.values():
        if (known.system, known.architecture) == (system, architecture):
            return known
    return Platform(f"{system}-{architecture}", system, architecture)


def select_platforms(names: Sequence[str] | None) -> tuple[Platform, ...]:
    """The platforms with these names, each once and in the order of the table; None is this machine.

    Raises:
        UnknownNameError: a name is not in the table.
        InputError: there is no name.
    """
    host = host_platform()
    if names is None:
        return (host,)
    wanted = (names,) if isinstance(names, str) else tuple(names)
    available = PLATFORMS | {host.name: host}
    for name in wanted:
        if name not in available:
            raise UnknownNameError("platform", name, available, where="platforms of the FMU")
    if not wanted:
        raise InputError(
            "The FMU has no platform.", where="platforms of the FMU", got="[]", valid=available,
            next_step="Name one at least, or leave the option out for that of this machine.",
        )  # fmt: skip
    return tuple(p for name, p in available.items() if name in wanted)
