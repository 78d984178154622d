"""Objects outside the tree, named ``module:name`` or ``path/to/file.py:name``.

One rule holds for controllers, plants and effects. A file is relative to the folder of the file that names it, or to
the working folder where it is named on the command line or in memory. A module is a file ``module.py`` in that same
folder, else one on Python's import path, else a file of the working folder, so that nothing there replaces an installed
module.

To name one is to run its code. For a case or a robot description from somebody else, the environment variable
``FMU_DIDIM_NO_CODE`` (on the command line ``--no-code``) refuses all of them.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

from fmu_didim.base.errors import FmuDidimError, InputError, UnknownNameError
from fmu_didim.base.files import is_file

NO_CODE = "FMU_DIDIM_NO_CODE"
"""Environment variable under which no Python of a case is run; processes that are started here inherit it."""
Result = TypeVar("Result")


_REFERENCE = re.compile(r"(?P<module>.+\.py|[^\W\d]\w*(\.[^\W\d]\w*)*):(?P<name>[^\W\d]\w*)")


def is_reference(text: str) -> bool:
    """Whether a text has the form ``module:name`` or ``file.py:name``."""
    return bool(_REFERENCE.fullmatch(text))


def located(reference: str, *folders: Path) -> str:
    """The reference by the absolute path of its file, where it means a file; runs nothing.

    Other texts, and files that are not found, stay as they are; importing them reports the error.

    Args:
        folders: to look in, the first one that has the file counts; the working folder by default.
    """
    match = _REFERENCE.fullmatch(reference)
    if match is None:
        return reference
    module, name = match["module"], match["name"]
    is_path = module.endswith(".py")
    if not is_path and "." in module:
        return reference  # of a package, which is installed
    file = module if is_path else f"{module}.py"
    searched = [*(folders or [Path()])]
    if not is_path and not any(is_file(folder / file) for folder in searched) and not _is_installed(module):
        searched.append(Path())
    found = next((folder / file for folder in searched if is_file(folder / file)), None)
    return reference if found is None else f"{found.resolve()}:{name}"


def source_file(reference: str) -> Path | None:
    """The file of the module that a reference names, once that was imported; None without one, as in a notebook."""
    module = located(reference).rpartition(":")[0]
    file = module if module.endswith(".py") else getattr(sys.modules.get(module), "__file__", None)
    return None if file is None else Path(file)


def without_folder(reference: str) -> str:
    """A reference as texts name it: its file without the folder; other texts stay as they are."""
    return Path(reference).name if is_reference(reference) else reference


def _is_installed(module: str) -> bool:
    with suppress(ImportError, ValueError):
        return importlib.util.find_spec(module) is not None
    return False


def import_object(reference: str, *, folder: Path | None = None, where: str = "") -> Any:
    """The object that ``reference`` names; its module is run.

    Args:
        reference: ``module:name`` or ``file.py:name``, see above.
        folder: the folder of the file in which the reference stands; None: the working folder.
        where: that place, for the error message.

    Raises:
        InputError: code is not to be run, the module or file does not exist, or running it raises or exits;
            UnknownNameError: it has no such name.
    """
    if not is_reference(reference):
        raise InputError(
            "This does not name a Python object.", where=where, got=reference,
            valid="package.module:name, path/to/file.py:name", next_step="Name the object with its module or file.",
        )  # fmt: skip
    check_allowed(reference, where=where)
    module_name, _, name = located(reference, folder or Path()).rpartition(":")
    module = run_code(lambda: _module(module_name, folder or Path(), where), what="module", where=where, got=reference)
    if not hasattr(module, name):
        raise UnknownNameError("object", name, [n for n in vars(module) if not n.startswith("_")], where=module_name)
    return getattr(module, name)


def check_allowed(reference: str, *, where: str) -> None:
    """Raise InputError if no code of a case is to be run, even where it is loaded already."""
    if os.environ.get(NO_CODE):
        raise InputError(
            "This names Python code, which must not be run.", where=where, got=reference,
            valid="a description, an FMU or a catalogued effect",
            next_step=f"Read that code; if you trust it, leave out --no-code (unset {NO_CODE}).",
        )  # fmt: skip


def run_code(function: Callable[[], Result], *, what: str, where: str, got: str) -> Result:
    """The return value of a user's function.

    Args:
        what: the function in words; where: the place that names it; got: its name.

    Raises:
        InputError: it raised something, or ended the program, with the line in which it did.
    """
    try:
        return function()
    except FmuDidimError:
        raise
    except (Exception, SystemExit) as error:
        raise InputError(
            f"The user's {what} cannot be used: {raised(error)}.", where=where, got=got,
            next_step="Fix it; it must run when it is imported or called alone.",
        ) from error  # fmt: skip


def raised(error: BaseException) -> str:
    """An error and its place, in the user's own file if possible, in one line."""
    text = " ".join(str(error).split())[:300]
    what = "it exits" if isinstance(error, SystemExit) else type(error).__name__
    if isinstance(error, SyntaxError):
        return f"{what}: {text}"  # the text names the place
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if "site-packages" not in f.filename and not f.filename.startswith("<frozen")] or frames
    place = f", {own[-1].filename}, line {own[-1].lineno}" if own else ""
    return f"{what}{f': {text}' if text else ''}{place}"


def _module(name: str, folder: Path, where: str) -> Any:
    if not name.endswith(".py"):
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{name}.".startswith(f"{error.name}."):
                raise  # it is there, but not what it imports
            raise InputError(
                "The module cannot be found.", where=where, got=name,
                valid=f"a file {name.rpartition('.')[2]}.py in {folder.resolve()}, or a module that Python can import",
                next_step="Name its file, path/to/file.py:name, or install the package in this environment.",
            ) from error  # fmt: skip
    path = Path(name)
    if not path.is_absolute():
        raise InputError(
            "The Python file does not exist.", where=where, got=str((folder / path).resolve()),
            next_step="The path of a file is relative to the file that names it; on the command line, to the "
            "working folder.",
        )  # fmt: skip
    if not is_file(path):
        raise InputError(
            "The Python file does not exist.", where=where, got=name,
            next_step="Check the path; it is relative to the file that names it.",
        )  # fmt: skip
    return _run(path)


def _run(path: Path) -> Any:
    """The module of a file, run again; no other file has its name in ``sys.modules``."""
    unique = f"{path.stem}_{sha256(str(path).encode()).hexdigest()[:12]}"
    spec = importlib.util.spec_from_file_location(unique, path)
    assert spec is not None and spec.loader is not None  # of a file that ends with .py
    module = importlib.util.module_from_spec(spec)
    sys.modules[unique] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[unique]
        raise
    return module
