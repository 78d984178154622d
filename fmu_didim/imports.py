"""Objects outside the tree, named ``package.module:name`` or ``path/to/file.py:name``."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import Any

from fmu_didim.errors import InputError, UnknownNameError


def import_object(reference: str, *, folder: Path | None = None, where: str = "") -> Any:
    """The object that ``reference`` names.

    Args:
        reference: ``package.module:name``, or ``file.py:name`` relative to ``folder``.
        folder: the folder of the file in which the reference stands.
        where: that place, for the error message.

    Raises:
        InputError: the module or file cannot be imported; UnknownNameError: it has no such name.
    """
    module_name, separator, name = reference.rpartition(":")
    if not separator or not module_name or not name:
        raise InputError("This does not name a Python object.", where=where, got=reference, valid="package.module:name")
    if module_name.endswith(".py"):
        path = ((folder or Path()) / module_name).resolve()
        spec = importlib.util.spec_from_file_location(path.stem, path) if path.is_file() else None
        if spec is None or spec.loader is None:
            raise InputError("The Python file does not exist.", where=where, got=str(path))
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    else:
        try:
            module = importlib.import_module(module_name)
        except ImportError as error:
            raise InputError(
                "The module cannot be imported.", where=where, got=f"{module_name}: {error}",
                next_step="Install it in this environment, or name a file: path/to/file.py:name.",
            ) from error  # fmt: skip
    if not hasattr(module, name):
        raise UnknownNameError("object", name, [n for n in vars(module) if not n.startswith("_")], where=module_name)
    return getattr(module, name)
