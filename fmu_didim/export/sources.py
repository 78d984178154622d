"""Foreign C sources, from FMUs or Modelica compilers, as a library for this machine."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

from fmu_didim.base.errors import BuildError
from fmu_didim.export.build import Compiler, find_compiler, run_compiler

_REPLACED = {"-fvisibility=hidden": "-fvisibility=default", "-std=c99": "-std=gnu11", "-O3": "-O2", "-Wall": "-w"}
"""Flags of our own code -> those for sources that do not mark their functions, and whose warnings are not ours."""
_NO_PREFIX = ("FMI2_OVERRIDE_FUNCTION_PREFIX=", "FMI3_OVERRIDE_FUNCTION_PREFIX=", "DISABLE_PREFIX=")
"""Definitions by which functions have the names of a shared library, without a prefix."""


def source_compiler() -> Compiler:
    """The compiler for foreign sources."""
    found = find_compiler()
    return replace(found, flags=tuple(_REPLACED.get(flag, flag) for flag in found.flags))


def compile_sources(
    folder: Path,
    names: Sequence[str],
    output: Path,
    *,
    definitions: Sequence[str] = (),
    compiler: Compiler | None = None,
) -> None:
    """Compile C files to a shared library for this machine, all of whose functions are visible.

    The headers of the FMI standard are found where the sources lack them.

    Args:
        folder: where the files lie; names: of the files that are compiled.
        definitions: of the preprocessor, ``NAME`` or ``NAME=VALUE``.

    Raises:
        BuildError: there is no compiler, or it reports an error.
    """
    chosen = compiler or source_compiler()
    what = f"The C compiler could not build '{output.name}'."
    # After the sources' own headers; FMPy ships those of the standard.
    headers = [f"-I{folder.absolute()}", "-idirafter", str(files("fmpy").joinpath("c-code"))]
    defined = [f"-D{name}" for name in (*_NO_PREFIX, *definitions)]
    shared = [flag for flag in chosen.flags if flag != "-shared" and not flag.startswith("-Wl,") and flag != "-s"]
    with tempfile.TemporaryDirectory(prefix="fmu_didim-") as temporary:
        objects = []
        for i, name in enumerate(names):
            objects.append(f"{temporary}/{i}.o")
            own = [*chosen.command, *shared, *defined, *headers, "-c", "-o", objects[-1], str(folder.absolute() / name)]
            run_compiler(own, cwd=folder, what=what)
        link = [*chosen.command, *chosen.link_flags(output), "-o", str(output.absolute()), *objects]
        if chosen.lean and not chosen.runtime:
            with suppress(BuildError):
                run_compiler([*link, *chosen.lean, *chosen.lean_libraries], cwd=folder, what=what)
        if not output.is_file():
            run_compiler([*link, *chosen.libraries], cwd=folder, what=what)
    if not output.is_file():
        raise BuildError(
            "The C compiler wrote no file.", where=str(output),
            next_step="Check that its folder is writable and the disk is not full.",
        )  # fmt: skip
