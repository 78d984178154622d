"""Archives and documents that are made to do harm: refused with little work, and with 200 MB of memory.

The work is counted, so that it is the same on every machine: calls of functions, and bytes that are unpacked.
"""

from __future__ import annotations

import io
import json
import os
import re
import stat
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import fmpy
import pytest
import yaml

from fmu_didim.components.fmu.archive import MAXIMUM_DESCRIPTION_BYTES, MAXIMUM_MEMBERS
from tests.awkward.build import ARRAYS, DEFAULTS, SLAVE
from tests.base.test_documents import ATTACKS
from tests.patience import patience

MEGABYTES = 200
CALLS = 40 * MAXIMUM_MEMBERS * (1 if yaml.__with_libyaml__ else 10)
"""For each member of an archive and each value of a file, as many as are read at most: 15 to 25 of them, and some two
hundred of PyYAML's own parser, in a second of the processor or a few."""
UNPACKED = 4 * 2**20
"""Bytes, less than twice the longest description here; what is made to do harm unpacks to much more."""
XML = SLAVE.format(**DEFAULTS)
READS = f"""
import json, os, resource, sys, zipfile
from pathlib import Path
from fmu_didim.components.fmu import info_lines, load_fmu, read_description
from fmu_didim.base.documents import load_yaml
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.ssp import read_ssp
from tests.patience import Calls
import fmpy, fmpy.model_description  # before the memory is limited
unpacked, update = 0, zipfile.ZipExtFile._update_crc
def count(self, data):
    global unpacked
    unpacked += len(data)
    update(self, data)
zipfile.ZipExtFile._update_crc = count
used = next(int(l.split()[1]) for l in open("/proc/self/status") if l.startswith("VmData")) * 1024
resource.setrlimit(resource.RLIMIT_DATA, (used + {MEGABYTES} * 2**20,) * 2)
readers = {{".fmu": lambda p: (info_lines(read_description(p)), load_fmu(p)), ".ssp": read_ssp, ".yaml": load_yaml}}
for name in sys.argv[1:]:
    unpacked = 0
    try:
        with Calls() as calls:
            readers[Path(name).suffix](Path(name))
        told = "taken"
    except FmuDidimError as error:
        told = str(error)
    except BaseException as error:
        told = f"not foreseen: {{error!r}}"
    print(json.dumps([Path(name).stem, told, calls.count, unpacked]))
"""


def zipped(members: Mapping[str, bytes]) -> bytes:
    """An archive of these members."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, content in members.items():
            archive.writestr(member, content)
    return stream.getvalue()


def fmu(xml: str | bytes = XML, *, stem: str = "slave", **members: bytes) -> bytes:
    major = 3 if b'fmiVersion="3' in (xml if isinstance(xml, bytes) else xml.encode()) else 2
    place = f"binaries/{fmpy.platform_tuple if major == 3 else fmpy.platform}/{stem}{fmpy.sharedLibraryExtension}"
    return zipped({"modelDescription.xml": xml if isinstance(xml, bytes) else xml.encode(), place: b"x", **members})


def bomb() -> bytes:
    """A quarter of a gigabyte of zeros in a quarter of a megabyte, one thousandth."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("modelDescription.xml", XML)
        zeros = bytes(2**22)
        with archive.open("resources/zeros", "w", force_zip64=True) as member:
            for _ in range(64):
                member.write(zeros)
    return stream.getvalue()


def linked() -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("SystemStructure.ssd", "<a/>")
        entry = zipfile.ZipInfo("resources/plant.fmu")
        entry.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(entry, "/etc/passwd")
    return stream.getvalue()


def cut_short() -> bytes:
    """A member whose compressed stream ends too early, with sizes and checksum that fit what is there."""
    content = bytearray(fmu(resources_text=os.urandom(2000) * 20))
    at = content.index(b"resources_text") + len("resources_text")
    content[at + 100 : at + 400] = bytes(300)
    return bytes(content)


def many_members() -> bytes:
    return zipped({f"resources/{i}": b"" for i in range(MAXIMUM_MEMBERS + 1)})


LAUGHS = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))
NESTED = "<a>" * 200_000 + "</a>" * 200_000
ARCHIVES: Mapping[str, tuple[Callable[[], bytes], str]] = {
    "bomb.fmu": (bomb, "unpacks to very much more than it is"),
    "bomb.ssp": (bomb, "too large"),
    "many.fmu": (many_members, "too many members"),
    "many.ssp": (many_members, "too large"),
    "outside.fmu": (lambda: fmu(**{"../../outside": b"x"}), "lies outside its folder"),
    "absolute.fmu": (lambda: fmu(**{"/tmp/outside": b"x"}), "lies outside its folder"),
    "backslashes.fmu": (lambda: fmu(**{"..\\..\\outside": b"x"}), "lies outside its folder"),
    "drive.fmu": (lambda: fmu(**{"C:outside": b"x"}), "lies outside its folder"),
    "outside.ssp": (lambda: zipped({"SystemStructure.ssd": b"<a/>", "../x": b""}), "lies outside of it"),
    "nameless.fmu": (lambda: fmu(NAME=b"x").replace(b"NAME", b"\0AME"), "lies outside its folder"),
    "nameless.ssp": (
        lambda: zipped({"SystemStructure.ssd": b"<a/>", "NAME": b""}).replace(b"NAME", b"\0AME"), "lies outside of it"
    ),
    "linked.ssp": (linked, "symbolic link"),
    "file-and-folder.fmu": (lambda: fmu(a=b"x", **{"a/b": b"x"}), "a file and a folder"),
    "long-name.fmu": (lambda: fmu(**{"resources/" + "n" * 300: b"x"}), "name that no file can have"),
    "cut-short.fmu": (cut_short, "it is damaged"),
    "truncated.fmu": (lambda: fmu()[:-30], "not a zip archive"),
    "laughs.fmu": (lambda: fmu(f'<!DOCTYPE a [<!ENTITY a0 "ha">{LAUGHS}]><a>&a9;</a>'), "declares a document type"),
    "laughs.ssp": (
        lambda: zipped({"SystemStructure.ssd": f"<!DOCTYPE a [{LAUGHS}]><a>&a9;</a>".encode()}), "document type"
    ),
    "hidden-laughs.fmu": (lambda: fmu(f"<!DOCTYPE a [{LAUGHS}]><a/>".encode("utf-16")), "declares a document type"),
    "other-file.fmu": (lambda: fmu('<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/group">]><a>&b;</a>'), "document type"),
    "nested.fmu": (lambda: fmu(NESTED), "no fmiVersion|is wrong"),
    "large-description.fmu": (lambda: fmu(b" " * (MAXIMUM_DESCRIPTION_BYTES + 1)), "is too large|more than it is"),
    "identifier.fmu": (
        lambda: fmu(XML.replace('modelIdentifier="slave"', 'modelIdentifier="../../x"')), "is not a valid name"
    ),
    "absolute-identifier.fmu": (
        lambda: fmu(XML.replace('modelIdentifier="slave"', 'modelIdentifier="/lib/libc"')), "is not a valid name"
    ),
    "huge-array.fmu": (
        lambda: fmu(ARRAYS.replace('<Dimension start="2"/>', '<Dimension start="2000000000"/>'), stem="arrays"),
        "more than 100000 elements",
    ),
}  # fmt: skip


@pytest.mark.gate
@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited by Linux")
def test_what_is_made_to_do_harm_is_refused_with_little_work(tmp_path: Path) -> None:
    wanted = {Path(name).name: told for name, (_, told) in ARCHIVES.items()}
    for name, (make, _) in ARCHIVES.items():
        (tmp_path / name).write_bytes(make())
    for k, (text, told) in enumerate(ATTACKS.values()):
        (tmp_path / f"attack{k}.yaml").write_text(text, encoding="utf-8")
        wanted[f"attack{k}.yaml"] = told
    environment = os.environ | {"FMU_DIDIM_CACHE": str(tmp_path / "cache"), "OPENBLAS_NUM_THREADS": "1"}
    run = subprocess.run(
        [sys.executable, "-c", READS, *(str(tmp_path / name) for name in wanted)], env=environment,
        capture_output=True, text=True, timeout=patience(100),
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    found = [json.loads(line) for line in run.stdout.splitlines()]
    assert len(found) == len(wanted)
    for (stem, told, calls, unpacked), (name, expected) in zip(found, wanted.items(), strict=True):
        assert stem == Path(name).stem
        assert re.search(expected, told), (name, told)
        assert calls < CALLS, (name, calls)
        assert unpacked < UNPACKED, (name, unpacked)
    assert max(unpacked for *_, unpacked in found) > 2**20, "that of nested.fmu is counted"
    assert not (tmp_path / "outside").exists()
    assert not list((tmp_path / "cache").rglob("outside"))
