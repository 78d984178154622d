"""Saved documents: written whole, in the place of an earlier one, and read again from their file or its folder."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from fmu_didim.base.documents import Saved, why_unread
from fmu_didim.base.errors import InputError
from fmu_didim.base.files import whole_file

Document = TypeVar("Document", bound=Saved)


def write_saved(document: Saved, path: Path) -> Path:
    """Write a document as JSON, in the place of an earlier one when all is written; returns its path."""
    with whole_file(path) as temporary:
        temporary.write_text(document.model_dump_json(indent=2) + "\n", encoding="utf-8")
    return path


def read_saved(path: Path | str, file: str, kind: type[Document], *, what: str, next_step: str) -> Document:
    """A document from its file, or from the folder that holds one of this name; raises InputError, in these words, if
    it is missing or damaged."""
    path = Path(path)
    path = path / file if path.is_dir() else path
    try:
        return kind.model_validate_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, ValidationError) as error:
        raise InputError(what, where=str(path), got=why_unread(error, kind), next_step=next_step) from error
