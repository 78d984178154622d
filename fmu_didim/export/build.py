"""The C compiler: from a folder of sources to a shared library for this machine."""

from __future__ import annotations

import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from fmu_didim.cache import cache_directory
from fmu_didim.errors import BuildError

TIMEOUT = 1800.0
"""Seconds after which a compiler that does not end is stopped."""

_FLAGS: tuple[str, ...] = ("-std=c99", "-O3", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-Wall")
_ADVICE = "Unset CC to use the compiler of the 'ziglang' package, or set CC to a working C compiler such as gcc."


@dataclass(frozen=True)
class Compiler:
    """A C compiler for this machine.

    Attributes:
        command: program and first arguments.
        flags: further arguments, apart from input and output.
        version: identification, part of the key under which built files are kept.
    """

    command: tuple[str, ...]
    flags: tuple[str, ...]
    version: str


def platform_folder() -> str:
    """Name of this machine's folder in ``binaries/`` (FMI 2.0, section 2.3): ``linux64``, ``win64``, ``darwin64``."""
    bits = 64 if sys.maxsize > 2**32 else 32
    system = "win" if sys.platform == "win32" else "darwin" if sys.platform == "darwin" else "linux"
    return f"{system}{bits}"


def library_suffix() -> str:
    """File name extension of a shared library on this machine."""
    return {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def find_compiler() -> Compiler:
    """The compiler of the environment variable CC, else the one of the ``ziglang`` package.

    Raises:
        BuildError: CC does not run, or there is no CC and ``ziglang`` is not installed.
    """
    flags = _FLAGS
    if sys.platform == "win32":
        flags = tuple(flag for flag in flags if flag != "-fPIC")
    elif sys.platform == "linux":
        # An FMU calls its own functions even when another one with the same names is loaded before.
        flags = (*flags, "-Wl,-Bsymbolic", "-Wl,--no-undefined", "-s")
    chosen = os.environ.get("CC", "").strip()
    if chosen:
        command = tuple(shlex.split(chosen, posix=os.name != "nt"))
        return Compiler(command, flags, _version_of(command))
    try:
        release = version("ziglang")
    except PackageNotFoundError as error:
        raise BuildError(
            "There is no C compiler.", next_step="pip install ziglang, or set the environment variable CC."
        ) from error
    flags = (*flags, "-fno-sanitize=undefined", *_zig_target())
    return Compiler((sys.executable, "-m", "ziglang", "cc"), flags, f"zig {release}")


def compile_shared_library(
    source_dir: Path, output: Path, *, main: str = "fmi2.c", compiler: Compiler | None = None
) -> None:
    """Compile one translation unit to a shared library in which only marked functions are visible.

    Args:
        source_dir: folder with the sources; the compiler runs there, so paths do not enter the result.
        output: the library to write.
        main: the file to compile; it includes the others.
        compiler: default :func:`find_compiler`.

    Raises:
        BuildError: the compiler does not run, does not end, or reports an error; its output is in the message.
    """
    chosen = compiler or find_compiler()
    libraries = () if sys.platform == "win32" else ("-lm",)
    command = [*chosen.command, *chosen.flags, "-o", str(output.absolute()), main, *libraries]
    _run(command, cwd=source_dir, what=f"The C compiler could not build '{output.name}'.")
    if not output.is_file():
        raise BuildError("The C compiler wrote no file.", where=shlex.join(command), next_step=_ADVICE)


def _zig_target() -> tuple[str, ...]:
    """Zig's target on Linux: this processor's architecture, any model of it, and an old C library."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    if sys.platform == "linux" and platform.libc_ver()[0] == "glibc" and machine in ("x86_64", "aarch64"):
        return ("-target", f"{machine}-linux-gnu.2.17")
    return ()


@cache
def _version_of(command: Sequence[str]) -> str:
    """What a compiler says about itself; asked once in a process."""
    return _run([*command, "--version"], what="The C compiler of the environment variable CC does not run.")


def _run(command: Sequence[str], *, what: str, cwd: Path | None = None) -> str:
    environment = dict(os.environ)
    for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"):
        # Zig would otherwise write to the home folder and to the current one.
        environment.setdefault(name, str(cache_directory() / "zig"))
    where = shlex.join(command)
    try:
        done = subprocess.run(
            command, cwd=cwd, env=environment, capture_output=True, text=True, errors="replace", timeout=TIMEOUT
        )
    except OSError as error:
        raise BuildError(what, where=where, got=str(error), next_step=_ADVICE) from error
    except subprocess.TimeoutExpired as error:
        raise BuildError(what, where=where, got=f"no end after {TIMEOUT:g} s", next_step=_ADVICE) from error
    if done.returncode != 0:
        text = (done.stderr + done.stdout).strip()[-4000:] or f"exit status {done.returncode}"
        raise BuildError(what, where=where, got=text, next_step=_ADVICE)
    return done.stdout
