"""The C compiler: from a folder of sources to a shared library for this machine or another one."""

from __future__ import annotations

import logging
import os
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from platform import libc_ver, machine, processor

from fmu_didim.base.cache import COMPILER, own_folder
from fmu_didim.base.errors import BuildError
from fmu_didim.export.platforms import Platform, host_platform

TIMEOUT = 1800.0
"""[s] Limit after which a compiler is stopped."""

_COMMON = ("-std=c99", "-O3", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-Wall")
_FLAGS: dict[str, tuple[str, ...]] = {
    # An FMU calls its own functions even when another one with the same names is loaded before.
    "linux": (*_COMMON, "-fPIC", "-Wl,-Bsymbolic", "-Wl,--no-undefined", "-s"),
    "darwin": (*_COMMON, "-fPIC"),
    "windows": _COMMON,
}
_NAMED = {"linux": "", "darwin": "-Wl,-install_name,@rpath/", "windows": ""}
_WINDOWS_LIBRARIES = tuple(f"-lapi-ms-win-crt-{part}-l1-1-0" for part in ("math", "heap", "stdio", "string", "private"))
"""Windows' own C library, by the names under which it is linked."""
_SUPERVISED = Path(__file__).with_name("supervised.py")
_log = logging.getLogger(__name__)
SECONDS, SECONDS_A_BYTE = 0.4, 8e-6
"""[s] Duration of a compilation at least, and for each byte of sources, on a common core: 0.4 s for a gain, 3 to 4 s
for the 450 kB of a TX40."""
TOLD_FROM = 2.0
"""[s] Expected duration from which on a compilation is announced."""
_ADVICE = "Unset CC to use the compiler of the 'ziglang' package, or set CC to a working C compiler such as gcc."


@dataclass(frozen=True)
class Compiler:
    """A C compiler for one platform.

    Attributes:
        command: program and first arguments.
        flags: further arguments, besides input and output.
        version: identification, part of the key under which built files are kept: CC as it stands, or the release of
            ziglang, whichever Python starts that.
        libraries: arguments that stand last.
        lean: arguments of a link without the compiler's own run-time library, which ziglang compiles for each platform
            when it is first used: seconds, for Windows minutes; empty: no such link.
        runtime: the file in ``wrapper/`` that stands for it then; lean_libraries: arguments that stand last then.
        named: the option before the name that a library holds inside, where that would be the path it was built at.
    """

    command: tuple[str, ...]
    flags: tuple[str, ...]
    version: str
    libraries: tuple[str, ...] = ()
    lean: tuple[str, ...] = ()
    runtime: str = ""
    lean_libraries: tuple[str, ...] = ()
    named: str = ""

    def link_flags(self, output: Path) -> tuple[str, ...]:
        """The flags to link a library with; it holds its file name inside, wherever it is built."""
        return (*self.flags, f"{self.named}{output.name}") if self.named else self.flags


def compiler_for_here() -> Compiler:
    """The compiler of :func:`find_compiler` for code that stays on this machine: it may use all of its processor.

    That processor is part of the version, so that another machine does not take what this one has built.
    """
    found = find_compiler()
    if "-target" not in found.flags:
        return found
    place = found.flags.index("-target")
    own = found.flags[:place] + found.flags[place + 2 :]
    return replace(found, flags=own, version=f"{found.version} {_processor()}")


def _processor() -> str:
    """Model and features of the processor of this machine."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    known = sorted({line for line in lines if line.startswith(("flags", "Features", "model name"))})
    return " ".join(known) or f"{machine()} {processor()}"


def find_compiler(platform: Platform | None = None) -> Compiler:
    """The compiler of the environment variable CC, else the one of the ``ziglang`` package.

    CC is the compiler for this machine; for another platform it is always ``ziglang``.

    Args:
        platform: what to build for; default: this machine.

    Raises:
        BuildError: CC does not run, or there is no CC and ``ziglang`` is not installed.
    """
    host = host_platform()
    target = host if platform is None else platform
    flags = _FLAGS[target.system]
    libraries = () if target.system == "windows" else ("-lm",)
    chosen = os.environ.get("CC", "").strip()
    if chosen and target == host:
        command = tuple(shlex.split(chosen, posix=os.name != "nt"))
        return Compiler(command, flags, f"{chosen}: {_version_of(command)}", libraries, named=_NAMED[target.system])
    try:
        release = version("ziglang")
    except PackageNotFoundError as error:
        advice = "pip install ziglang" + (", or set the environment variable CC." if target == host else ".")
        raise BuildError(f"There is no C compiler for {target.name}.", next_step=advice) from error
    flags = (*flags, *(() if "-s" in flags else ("-s",)), "-fno-sanitize=undefined")
    other_libc = target == host and target.system == "linux" and libc_ver()[0] != "glibc"  # such as Alpine, with musl
    if target.zig_target and not other_libc:  # any model of the processor, and an old C library
        flags = (*flags, "-target", target.zig_target)
    command = (sys.executable, "-P", "-m", "ziglang", "cc")
    found = Compiler(command, flags, f"zig {release}", libraries, named=_NAMED[target.system])
    if target.system == "windows":
        return replace(found, lean=("-nostdlib",), runtime="windows.c", lean_libraries=_WINDOWS_LIBRARIES)
    return replace(found, lean=("-rtlib=none",), lean_libraries=libraries)


def compile_shared_library(source_dir: Path, output: Path, *, main: str, compiler: Compiler | None = None) -> None:
    """Compile one translation unit to a shared library in which only marked functions are visible.

    Args:
        source_dir: folder with the sources; the compiler runs there, so paths do not enter the result.
        output: the library to write.
        main: the file to compile; it includes the others.
        compiler: default :func:`find_compiler` for this machine.

    Raises:
        BuildError: the compiler does not run, does not end, or reports an error; its output is in the message.
    """
    chosen = compiler or find_compiler()
    target = str(output.absolute())
    what = f"The C compiler could not build '{output.name}'."
    expected = SECONDS + SECONDS_A_BYTE * sum(p.stat().st_size for p in source_dir.glob("*.[ch]"))
    began = time.perf_counter()
    if expected > TOLD_FROM:
        _log.info("compiling %s (about %.0f s; the result is kept) ...", output.name, expected)
    if not chosen.lean or not _built_lean(chosen, source_dir, output, main, what):
        command = [*chosen.command, *chosen.link_flags(output), "-o", target, main, *chosen.libraries]
        run_compiler(command, cwd=source_dir, what=what)
    if not output.is_file():
        raise BuildError("The C compiler wrote no file.", where=target, next_step=_ADVICE)
    if expected > TOLD_FROM:
        _log.info("compiled %s in %.1f s", output.name, time.perf_counter() - began)


def _built_lean(chosen: Compiler, source_dir: Path, output: Path, main: str, what: str) -> bool:
    """Whether the library could be linked without the compiler's own run-time library; the code itself must compile."""
    with tempfile.TemporaryDirectory(prefix="objects-", dir=source_dir) as name:
        objects = [f"{name}/main.o"]
        run_compiler([*chosen.command, *chosen.flags, "-c", "-o", objects[0], main], cwd=source_dir, what=what)
        if chosen.runtime:
            runtime = Path(name) / chosen.runtime
            runtime.write_text(wrapper_source(chosen.runtime), encoding="utf-8")
            objects.append(f"{name}/runtime.o")
            run_compiler(
                [*chosen.command, *chosen.flags, "-c", "-o", objects[1], str(runtime)], cwd=source_dir, what=what
            )
        with suppress(BuildError):
            target = str(output.absolute())
            link = [*chosen.link_flags(output), *chosen.lean, "-o", target, *objects, *chosen.lean_libraries]
            run_compiler([*chosen.command, *link], cwd=source_dir, what=what)
            return True
    _log.info("compiling the run-time library of the platform of %s (minutes, once on this machine) ...", output)
    return False


def wrapper_source(name: str) -> str:
    """The text of a file of ``wrapper/``."""
    return (files("fmu_didim.export") / "wrapper" / name).read_text(encoding="utf-8")


def compile_console_program(source: Path, output: Path, platform: Platform) -> None:
    """Compile one C file with an entry of its own, ``mainCRTStartup``, to a program for Windows that needs nothing of
    a compiler's run-time library.

    Raises:
        BuildError: there is no compiler for that platform, or it reports an error.
    """
    compiler = find_compiler(platform)
    flags = [flag for flag in compiler.flags if flag != "-shared"]
    alone = ["-fno-builtin", "-nostdlib", "-Wl,--subsystem,console", "-Wl,-e,mainCRTStartup"]
    command = [*compiler.command, *flags, *alone, "-o", str(output), str(source), "-lkernel32"]
    run_compiler(command, what=f"The C compiler could not build '{output.name}'.")


@cache
def _version_of(command: Sequence[str]) -> str:
    """The version that a compiler prints; asked once in a process."""
    return run_compiler([*command, "--version"], what="The C compiler of the environment variable CC does not run.")


def run_compiler(command: Sequence[str], *, what: str, cwd: Path | None = None) -> str:
    """The output of a compiler; raises BuildError with it where it fails."""
    environment = dict(os.environ)
    for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"):
        # Zig would otherwise write to the home folder and to the current one.
        environment.setdefault(name, str(own_folder(COMPILER)))
    where = shlex.join(command)
    try:
        with subprocess.Popen(
            [sys.executable, "-I", "-S", "-X", "utf8", str(_SUPERVISED), *command], cwd=cwd, env=environment,
            encoding="utf-8", errors="replace", stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            start_new_session=True,
        ) as process:  # fmt: skip
            held, process.stdin = process.stdin, None  # open for as long as the command is wanted
            try:
                output, errors = process.communicate(timeout=TIMEOUT)
            finally:  # after Ctrl-C, too
                assert held is not None
                held.close()
    except OSError as error:
        raise BuildError(what, where=where, got=str(error), next_step=_ADVICE) from error
    except subprocess.TimeoutExpired as error:
        raise BuildError(what, where=where, got=f"no end after {TIMEOUT:g} s", next_step=_ADVICE) from error
    if process.returncode != 0:
        text = (errors + output).strip()[-4000:] or f"exit status {process.returncode}"
        raise BuildError(what, where=where, got=text, next_step=_ADVICE)
    return output
