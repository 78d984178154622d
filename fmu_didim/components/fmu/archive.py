"""FMU archives: opened safely, extracted once for each content.

An FMU is a zip file from anywhere. No member may lie outside the folder, number and size of the members are limited,
and a ``modelDescription.xml`` with a document type (the way to entity bombs and to foreign files) is refused unread.
"""

from __future__ import annotations

import re
import shutil
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from fmu_didim.base.cache import OF_NAMES, cached_folder, file_digest
from fmu_didim.base.errors import FmuError
from fmu_didim.base.files import is_file

DESCRIPTION = "modelDescription.xml"
MAXIMUM_MEMBERS = 50_000
MAXIMUM_BYTES = 4 * 2**30
"""[bytes] Uncompressed size of all members at most."""
MAXIMUM_DESCRIPTION_BYTES = 64 * 2**20
MAXIMUM_RATIO, RATIO_FROM = 100, 64 * 2**20
"""[1], [bytes] Largest ratio of content to archive, and the content from which on it is checked: text shrinks to a
tenth."""
AGAIN = "Export or download it again."

_ENCODING = re.compile(rb"""<\?xml[^>]*\bencoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
_PLAIN_ENCODINGS = re.compile(
    r"utf-?8|us-ascii|ascii|utf-?16(le|be)?|iso-8859-\d+|latin-?1|windows-125\d", re.IGNORECASE
)


def open_archive(path: Path) -> tuple[Path, str]:
    """The folder an FMU is extracted to, and the SHA-256 of the file.

    Raises:
        FmuError: the file does not exist, is no zip archive, has no or no safe ``modelDescription.xml``, has members
            outside its folder, or is too large.
    """
    if not is_file(path):
        raise FmuError("The FMU does not exist.", where=str(path), next_step="Check the path.")
    digest = file_digest(path)
    return cached_folder("extracted", digest, lambda target: _extract(path, target)), digest


def unreadable(why: str, path: Path, got: str, next_step: str = AGAIN) -> FmuError:
    """The error of a file that is no FMU."""
    return FmuError(f"The file is not a readable FMU: {why}.", where=str(path), got=got, next_step=next_step)


def _extract(path: Path, target: Path) -> None:
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            _check_members(members, path)
            if DESCRIPTION not in {m.filename for m in members}:
                raise _no_description(members, path)
            check_description(archive.read(DESCRIPTION), path)
            for member in members:
                place = target / _safe_name(member, path)
                if member.is_dir():
                    place.mkdir(parents=True, exist_ok=True)
                    continue
                place.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(member) as source, place.open("wb") as copy:
                    shutil.copyfileobj(source, copy, 2**20)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, EOFError, ValueError, RuntimeError) as error:
        why = "it is damaged" if zipfile.is_zipfile(path) else "it is not a zip archive"
        raise unreadable(why, path, str(error)) from error
    except (FileExistsError, NotADirectoryError) as error:
        raise unreadable("a member is a file and a folder", path, str(error)) from error
    except OSError as error:
        if error.errno in OF_NAMES:
            raise unreadable("a member has a name that no file can have", path, str(error)) from error
        raise  # the cache cannot be written


def _check_members(members: list[zipfile.ZipInfo], path: Path) -> None:
    if len(members) > MAXIMUM_MEMBERS:
        raise unreadable("it has too many members", path, f"{len(members)}, at most {MAXIMUM_MEMBERS}")
    size = sum(m.file_size for m in members)
    if size > MAXIMUM_BYTES:
        raise unreadable("it is too large", path, f"{size} bytes uncompressed, at most {MAXIMUM_BYTES}")
    if size > RATIO_FROM and size > MAXIMUM_RATIO * path.stat().st_size:
        got = f"{size} bytes in an archive of {path.stat().st_size}, at most {MAXIMUM_RATIO} times as many"
        raise unreadable("it unpacks to very much more than it is", path, got)
    description = next((m for m in members if m.filename == DESCRIPTION), None)
    if description is not None and description.file_size > MAXIMUM_DESCRIPTION_BYTES:
        raise unreadable(f"its {DESCRIPTION} is too large", path, f"{description.file_size} bytes")
    for member in members:
        _safe_name(member, path)


def _safe_name(member: zipfile.ZipInfo, path: Path) -> PurePosixPath:
    """The member's place in the folder; some tools on Windows write backslashes."""
    text = member.filename.replace("\\", "/")
    name = PurePosixPath(text)
    if not text or name.is_absolute() or ".." in name.parts or ":" in text or "\0" in text:
        raise unreadable("a member lies outside its folder", path, member.filename)
    return name


def _no_description(members: list[zipfile.ZipInfo], path: Path) -> FmuError:
    deeper = next((m.filename for m in members if m.filename.endswith("/" + DESCRIPTION)), None)
    got = f"only {deeper}" if deeper else ", ".join(m.filename for m in members[:5]) or "an empty archive"
    advice = "Zip the content of the folder, not the folder." if deeper else "Check that the file is an FMU."
    return unreadable(f"it has no {DESCRIPTION} at its top", path, got, advice)


def check_description(content: bytes, path: Path) -> None:
    """Refuse a model description that declares a document type or entities, or hides them in a strange encoding.

    Raises:
        FmuError: it does.
    """
    text = content.replace(b"\0", b"")  # so that UTF-16 hides nothing
    encoding = _ENCODING.search(text[:400])
    if encoding is not None and not _PLAIN_ENCODINGS.fullmatch(encoding[1].decode()):
        raise unreadable(f"the encoding of its {DESCRIPTION} is not read", path, encoding[1].decode(), "Use UTF-8.")
    for word in (b"<!DOCTYPE", b"<!ENTITY"):
        if word in text.upper():
            raise unreadable(
                f"its {DESCRIPTION} declares a document type, which FMI does not use and which can do harm",
                path, word.decode(), "Remove the declaration.",
            )  # fmt: skip
