"""Opening an archive from an unknown source: safe names, bounded sizes, XML without entities."""

from __future__ import annotations

import logging
import posixpath
import re
import stat
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree as ET

from fmu_didim.base.cache import cached_folder, file_digest
from fmu_didim.base.errors import InputError
from fmu_didim.base.files import is_file
from fmu_didim.components.fmu.archive import MAXIMUM_RATIO, RATIO_FROM
from fmu_didim.ssp.document import PREFIXES, STRUCTURE, VERSIONS

_log = logging.getLogger(__name__)
MAXIMUM_BYTES = 2 * 1024**3
MAXIMUM_XML_BYTES = 64 * 1024**2
MAXIMUM_ENTRIES = 10_000
"""Bounds of an archive: far above any real one, far below what fills a disk."""
_ENCODING = re.compile(rb"""^\s*<\?xml[^>]*\sencoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
_ENCODINGS = {"utf-8": "utf-8-sig", "us-ascii": "ascii", "iso-8859-1": "latin-1", "windows-1252": "cp1252"}


@dataclass(frozen=True)
class Archive:
    """An unpacked ``.ssp`` file: ``folder`` holds the entries of ``path`` whose ``names`` were checked."""

    path: Path
    folder: Path
    names: frozenset[str]

    def file(self, source: str, *, where: str) -> Path:
        """The file that a relative URI of the SSD names; raises InputError."""
        where = f"{self.path}: {where}"
        parts = urlsplit(source)
        name = posixpath.normpath(unquote(parts.path)) if parts.path else ""
        if parts.scheme or parts.netloc or parts.query or parts.fragment or not _is_safe(name):
            raise InputError(
                "The source is not a relative path inside the archive.", where=where, got=source,
                valid="resources/<file>", next_step="Put the file into the archive, and name it relative to its top.",
            )  # fmt: skip
        if name not in self.names:
            raise InputError(
                f"The archive does not contain '{name}'.", where=where, got=source, valid=sorted(self.names),
                next_step="Add the file to the archive, or correct the source.",
            )  # fmt: skip
        return self.folder / name

    def xml(self, source: str, root: str, *, where: str) -> ET.Element:
        """The root element of an XML file of the archive, which must have this tag; raises InputError."""
        file = self.file(source, where=where)
        element = parse_xml(file.read_bytes(), where=f"{self.path}: {source}")
        check_root(element, root, where=f"{self.path}: {source}")
        return element


def open_archive(path: Path) -> Archive:
    """Unpack an archive into the cache, once for each content.

    Raises:
        InputError: it is missing, no zip file, too large, without SystemStructure.ssd, or has entries that lie
            outside it, occur twice, are links or are encrypted.
    """
    if not is_file(path):
        raise InputError("The SSP archive does not exist.", where=str(path), next_step="Check the path.")
    try:
        with zipfile.ZipFile(path) as archive:
            entries = _check_entries(archive.infolist(), path)
            if STRUCTURE not in entries:
                raise InputError(
                    f"The archive has no {STRUCTURE}.", where=str(path), valid=sorted(entries),
                    next_step="The file must lie at the top of the archive, not in a folder.",
                )  # fmt: skip
            # zipfile never gives more bytes than the size that was checked.
            unpack = partial(archive.extractall, members=entries.values())
            folder = cached_folder("ssp", file_digest(path), unpack)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise InputError(
            "The file is not a readable zip archive.", where=str(path), got=str(error),
            next_step="Export or download it again.",
        ) from error  # fmt: skip
    return Archive(path, folder, frozenset(entries))


def _check_entries(infos: list[zipfile.ZipInfo], path: Path) -> Mapping[str, zipfile.ZipInfo]:
    def refuse(what: str, info: zipfile.ZipInfo) -> InputError:
        return InputError(what, where=str(path), got=info.orig_filename, next_step="Do not use this archive.")

    _check_size(infos, path)
    entries: dict[str, zipfile.ZipInfo] = {}
    folded: set[str] = set()
    for info in infos:
        name = info.filename.rstrip("/")
        if not _is_safe(name) or "\\" in info.orig_filename or "\0" in info.orig_filename:
            raise refuse("An entry of the archive lies outside of it.", info)
        if stat.S_ISLNK(info.external_attr >> 16):
            raise refuse("An entry of the archive is a symbolic link.", info)
        if info.flag_bits & 1:
            raise refuse("An entry of the archive is encrypted.", info)
        if info.is_dir():
            continue
        place = str(PurePosixPath(name)).casefold()  # names that differ in case only are one file on some systems
        if place in folded:
            raise refuse("Two entries of the archive have the same name.", info)
        folded.add(place)
        entries[name] = info
    return entries


def _check_size(infos: list[zipfile.ZipInfo], path: Path) -> None:
    total, own = sum(info.file_size for info in infos), path.stat().st_size
    expands = total > RATIO_FROM and total > MAXIMUM_RATIO * own
    if total > MAXIMUM_BYTES or len(infos) > MAXIMUM_ENTRIES or expands:
        raise InputError(
            "The archive is too large.", where=str(path),
            got=f"{total} bytes in {len(infos)} entries, packed into {own}",
            valid=f"at most {MAXIMUM_BYTES} bytes in {MAXIMUM_ENTRIES} entries, {MAXIMUM_RATIO} times what is packed",
            next_step="Take what the system does not need out of the archive.",
        )  # fmt: skip


def _is_safe(name: str) -> bool:
    parts = PurePosixPath(name).parts
    return bool(parts) and not name.startswith("/") and ".." not in parts and ":" not in name and "\\" not in name


def parse_xml(data: bytes, *, where: str) -> ET.Element:
    """The root element; a document type declaration, in which entities could multiply, is refused."""
    if len(data) > MAXIMUM_XML_BYTES:
        raise InputError(
            "The XML file is too large.", where=where, valid=f"at most {MAXIMUM_XML_BYTES} bytes",
            next_step="Shorten it, or split the system.",
        )  # fmt: skip
    declared = _ENCODING.match(data)
    encoding = declared[1].decode("ascii").lower() if declared else "utf-8"
    if encoding not in _ENCODINGS:
        raise InputError(
            "This encoding of XML is not read.", where=where, got=encoding, valid=_ENCODINGS,
            next_step="Save it as UTF-8.",
        )  # fmt: skip
    try:
        text = data.decode(_ENCODINGS[encoding])
        if "<!DOCTYPE" in text:
            raise InputError(
                "A document type declaration is not accepted.", where=where, got="<!DOCTYPE",
                next_step="Remove the declaration; SSP does not need it.",
            )  # fmt: skip
        return ET.fromstring(_with_prefixes(text, where))
    except (UnicodeDecodeError, ET.ParseError) as error:
        raise InputError(
            "The file is not well-formed XML.", where=where, got=str(error), next_step="Export the system again."
        ) from error


def _with_prefixes(text: str, where: str) -> str:
    """The text with all prefixes declared at its root that it uses and declares nowhere: those of the standard as the
    standard has them; others stand in annotations of other tools."""
    used = dict.fromkeys(re.findall(r"<([A-Za-z_][\w.-]*):", text))
    absent = [p for p in used if p != "xml" and not re.search(rf"xmlns:{re.escape(p)}\s*=", text)]
    if not absent:
        return text
    _log.warning("%s uses prefixes that it does not declare: %s", where, ", ".join(absent))
    declared = " ".join(f'xmlns:{p}="{PREFIXES.get(p, f"urn:undeclared:{p}")}"' for p in absent)
    return re.sub(r"<([A-Za-z_][\w.:-]*)", rf"<\1 {declared}", text, count=1)


def check_root(element: ET.Element, tag: str, *, where: str) -> None:
    """Refuse another root element, or a version that is not read."""
    if element.tag != tag:
        raise InputError(
            "This is not the expected kind of file.", where=where, got=element.tag, valid=tag,
            next_step="Export the system again, as SSP 1.0 or 2.0.",
        )  # fmt: skip
    version = element.get("version", "")
    if version.partition(".")[0] not in {known.partition(".")[0] for known in VERSIONS}:
        raise InputError(
            "This version of SSP is not supported.", where=where, got=version, valid=VERSIONS,
            next_step="Export the system as one of these.",
        )  # fmt: skip
