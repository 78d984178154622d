"""Modelica models as FMUs, by the compiler rumoca where the extra ``modelica`` is installed."""

from __future__ import annotations

import hashlib
import re
import shutil
import tempfile
import zipfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from fmu_didim.base.cache import cached_folder
from fmu_didim.base.errors import BuildError, InputError
from fmu_didim.base.files import file_name
from fmu_didim.export.fmu import add_member, copied
from fmu_didim.export.modelica_names import SKELETON, circular, restored, set_aside, taken
from fmu_didim.export.platforms import host_platform
from fmu_didim.export.sources import compile_sources, source_compiler
from fmu_didim.export.versions import written_version

FMI = "2.0"


def build_modelica(path: Path, *, model: str | None = None, directory: Path | None = None) -> Path:
    """An FMU of a model in a Modelica file, for model exchange, with its binary for this machine and its sources.

    What rumoca writes for co-simulation integrates by ten explicit Euler steps a communication step, so it is to be run
    in model exchange. The file is kept in the cache under the content of all Modelica files of its folder.

    Args:
        model: its name; by default that of the file.
        directory: also copy the FMU there.

    Raises:
        InputError: there is no such file.
        BuildError: rumoca is not installed, refuses the model, or its C code cannot be compiled.
    """
    if not path.is_file():
        raise InputError("The Modelica file does not exist.", where=str(path), next_step="Check the path.")
    name = model or path.stem
    try:
        release = version("rumoca")
    except PackageNotFoundError as error:
        raise BuildError(
            "A Modelica file needs a Modelica compiler.", where=str(path), got="rumoca is not installed",
            next_step="pip install 'fmu-didim[modelica]'; or export an FMU from OpenModelica or Dymola, as "
            "docs/howto/modelica.md says.",
        ) from error  # fmt: skip
    compiler = source_compiler()
    state = hashlib.sha256(repr((release, name, compiler.flags, compiler.version, "complete")).encode())
    for source in sorted(path.parent.glob("*.mo")):
        state.update(source.name.encode() + source.read_bytes())
    key = state.hexdigest()[:32]
    file = f"{file_name(name)}.fmu"
    built = cached_folder("exported", key, lambda folder: _build(path, name, folder / file)) / file
    return built if directory is None else copied(built, directory)


def _build(path: Path, name: str, output: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="fmu_didim-") as temporary:
        folder, host = Path(temporary), host_platform()
        files = _generated(path, name)
        sources = [file for file in files if file.startswith("sources/") and file.endswith(".c")]
        for file, content in files.items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_text(content, encoding="utf-8")
        library = folder / f"{name}{host.suffix}"
        try:
            compile_sources(folder / "sources", [Path(source).name for source in sources], library)
        except BuildError as error:
            raise _not_compiled(path, name, error) from error
        with zipfile.ZipFile(output, "w", compression=zipfile.ZIP_DEFLATED) as archive:
            for file, content in files.items():
                if file == "modelDescription.xml" or file.startswith("sources/"):
                    add_member(archive, file, content.encode())
            for place in written_version(FMI).folders([host], host):
                add_member(archive, f"binaries/{place}/{library.name}", library.read_bytes())


def _not_compiled(path: Path, name: str, error: BuildError) -> BuildError:
    """The error of C code that rumoca wrote: of the compiler itself where that does not even take its own skeleton."""
    if not isinstance(error.got, str) or "error:" not in error.got:
        return error
    return BuildError(
        f"The C code that rumoca writes for the model '{name}' cannot be compiled.", where=str(path), got=error.got,
        next_step="Rename the variable that the first error names, or export an FMU from OpenModelica or Dymola, as "
        "docs/howto/modelica.md says.",
    )  # fmt: skip


def _generated(path: Path, name: str) -> dict[str, str]:
    """The files of a source FMU, as rumoca writes them; variables keep their names, whatever the C code calls its own.

    Raises:
        BuildError: rumoca refuses the model.
    """
    model = _loaded(path, name)
    kinds = ("parameters", "inputs", "outputs", "states", "algebraics")
    own = {variable.name for kind in kinds for variable in getattr(model, kind)}
    with tempfile.TemporaryDirectory(prefix="fmu_didim-") as temporary:
        folder = Path(temporary)
        skeleton = folder / "FmuDidimSkeleton.mo"
        skeleton.write_text(SKELETON, encoding="utf-8")
        names = own & taken(_files(_loaded(skeleton, skeleton.stem)).values())
        skeleton.unlink()
        if not names:
            return _complete(_files(model), path, name)
        for source in path.parent.glob("*.mo"):
            shutil.copyfile(source, folder / source.name)
        copy = folder / path.name
        copy.write_text(set_aside(path.read_text(encoding="utf-8-sig"), names), encoding="utf-8")
        files = _files(_loaded(copy, name))
    files = {file: restored(content) if file.endswith(".xml") else content for file, content in files.items()}
    return _complete(files, path, name)


def _complete(files: dict[str, str], path: Path, name: str) -> dict[str, str]:
    """The files; raises BuildError where rumoca has written 0 for what it has found no equation for, or computes a
    variable from itself, which then keeps the value 0, too."""
    code = [content for file, content in files.items() if file.endswith(".c")]
    lacking = [found for content in code for found in re.findall(r"no equation found for ([\w.]+)", content)]
    lacking += [found for content in code for found in circular(content)]
    if lacking:
        raise BuildError(
            f"The Modelica compiler rumoca finds no equation for some variables of the model '{name}'.",
            where=str(path), got=restored(", ".join(dict.fromkeys(lacking))),
            next_step="Where an output is a derivative, give that a variable of its own, and write the equation that "
            "determines it before those that use it: Real a; J*a = tau1; der(w) = a; ddq1 = a; or export an FMU from "
            "OpenModelica or Dymola, as docs/howto/modelica.md says.",
        )  # fmt: skip
    return files


def _files(model: Any) -> dict[str, str]:
    return {entry.path: entry.content for entry in model.codegen("fmi2").files}


def _loaded(path: Path, name: str) -> Any:
    import rumoca

    try:
        model = rumoca.load(str(path), model=name)
        model.codegen("fmi2")
    except Exception as error:
        raise BuildError(
            f"The Modelica compiler rumoca refuses the model '{name}'.", where=str(path),
            got=str(error).strip()[:2000] or type(error).__name__,
            next_step="Name the model (model: beside its source), or export an FMU from OpenModelica or Dymola, as "
            "docs/howto/modelica.md says.",
        ) from error  # fmt: skip
    return model
