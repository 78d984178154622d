"""Objects outside the tree, named ``package.module:name`` or ``path/to/file.py:name``.

To name one is to run its code. Where a case or a robot description comes from somebody else, the environment variable
``FMU_DIDIM_NO_CODE`` (on the command line ``--no-code``) refuses all of them.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from fmu_didim.errors import FmuDidimError, InputError, UnknownNameError
from fmu_didim.files import is_file

NO_CODE = "FMU_DIDIM_NO_CODE"
"""Environment variable under which no Python of a case is run; processes that are started here inherit it."""
Result = TypeVar("Result")


def import_object(reference: str, *, folder: Path | None = None, where: str = "") -> Any:
    """The object that ``reference`` names; its module is run.

    Args:
        reference: ``package.module:name`` on Python's import path, or ``file.py:name`` relative to ``folder``.
        folder: the folder of the file in which the reference stands; without it there are no files.
        where: that place, for the error message.

    Raises:
        InputError: code is not to be run, the module or file does not exist, or running it raises or exits;
            UnknownNameError: it has no such name.
    """
    module_name, separator, name = reference.rpartition(":")
    if not separator or not module_name or not name:
        raise InputError("This does not name a Python object.", where=where, got=reference, valid="package.module:name")
    if os.environ.get(NO_CODE):
        raise InputError(
            "This names Python code, which is not to be run.", where=where, got=reference,
            valid="a description, an FMU or a catalogued effect",
            next_step=f"Read that code; if you trust it, leave out --no-code (unset {NO_CODE}).",
        )  # fmt: skip
    module = run_code(lambda: _module(module_name, folder, where), what="module", where=where, got=reference)
    if not hasattr(module, name):
        raise UnknownNameError("object", name, [n for n in vars(module) if not n.startswith("_")], where=module_name)
    return getattr(module, name)


def run_code(function: Callable[[], Result], *, what: str, where: str, got: str) -> Result:
    """What a function of the user returns.

    Args:
        what: it is in words; where: it is named; got: its name.

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
            next_step="Mend it; it must run when it is imported or called alone.",
        ) from error  # fmt: skip


def raised(error: BaseException) -> str:
    """What was raised and where, as far as possible in the user's own file, in one line."""
    text = " ".join(str(error).split())[:300]
    what = "it exits" if isinstance(error, SystemExit) else type(error).__name__
    if isinstance(error, SyntaxError):
        return f"{what}: {text}"  # which tells the place
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if "site-packages" not in f.filename and not f.filename.startswith("<frozen")] or frames
    place = f", {own[-1].filename}, line {own[-1].lineno}" if own else ""
    return f"{what}{f': {text}' if text else ''}{place}"


def _module(name: str, folder: Path | None, where: str) -> Any:
    if not name.endswith(".py"):
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{name}.".startswith(f"{error.name}."):
                raise  # it is there, but not what it imports
            raise InputError(
                "The module cannot be imported.", where=where, got=f"{name}: {error}",
                next_step="Install it in this environment, or name a file: path/to/file.py:name.",
            ) from error  # fmt: skip
    if folder is None and not Path(name).is_absolute():
        raise InputError(
            "A Python file cannot be named here, as it would be looked for in the current folder.", where=where,
            got=name, valid="package.module:name",
        )  # fmt: skip
    path = ((folder or Path()) / name).resolve()
    spec = importlib.util.spec_from_file_location(path.stem, path) if is_file(path) else None
    if spec is None or spec.loader is None:
        raise InputError("The Python file does not exist.", where=where, got=str(path))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
