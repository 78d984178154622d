"""Names, units and descriptions of any kind in exported FMUs: legal XML, legal C."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from pathlib import Path

import casadi as ca
import fmpy
import pytest
from fmpy.validation import validate_fmu

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu, compile_shared_library, generate_c
from fmu_didim.export.build import find_compiler
from fmu_didim.export.c_code import generate_config
from fmu_didim.export.versions import VERSIONS
from tests.export.helpers import gain

NAMES = ("joint 1 <q> & 'torque' \"raw\" 50%s", "Drehmoment_ä", "モーメント", "😀??=\\n", "a.b[1,2].der(x)", " x ")


@pytest.mark.parametrize("fmi_version", VERSIONS)
def test_names_of_any_kind(fmi_version: str, tmp_path: Path) -> None:
    x, u, p = ca.SX.sym("x", 0), ca.SX.sym("u", 3), ca.SX.sym("p", 3)
    block = Block(
        name="names",
        inputs=tuple(Variable(name, "N.m", "input", 1.0, "is < 1 & > 0\nor not") for name in NAMES[:3]),
        outputs=(Variable("y", "%"),),
        states=(),
        parameters=tuple(Variable(name, "", "parameter", 2.0) for name in NAMES[3:]),
        update=ca.Function("update", [x, u, p], [ca.SX(0, 1)]),
        output=ca.Function("output", [x, u, p], [ca.dot(u, p)]),
        start=ca.Function("start", [u, p], [ca.SX(0, 1)]),
        description="5 < 6 & ä",
        fixed=frozenset(NAMES[3:]),
    )
    path = build_fmu(block, fmi_version=fmi_version, directory=tmp_path)
    assert validate_fmu(str(path)) == []
    description = fmpy.read_model_description(str(path))
    assert set(NAMES) <= {v.name for v in description.modelVariables}
    assert description.description == block.description
    result = fmpy.simulate_fmu(str(path), stop_time=0.1, start_values={NAMES[0]: 3.0, NAMES[3]: 5.0}, output=["y"])
    assert result["y"][-1] == 3.0 * 5.0 + 2.0 + 2.0
    source, compiler = generate_config(block, guid=""), find_compiler()
    assert source.isascii()
    (tmp_path / "config.c").write_text(f"{source}const char *name(int i) {{ return block_names[i]; }}\n")
    compile_shared_library(
        tmp_path,
        tmp_path / "config.so",
        main="config.c",
        compiler=replace(compiler, flags=(*compiler.flags, "-fvisibility=default")),
    )
    loaded = ctypes.CDLL(str(tmp_path / "config.so"))
    loaded.name.restype = ctypes.c_char_p
    assert [loaded.name(i).decode() for i in (0, 1, 2, 4, 5, 6)] == list(NAMES)


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"name": "a\x01b"}, r"The name .*\n.*\n.*'a\\x01b'"),
        ({"name": "a\nb"}, "The name"),
        ({"name": ""}, "at least one"),
        ({"name": "\ufffe"}, "The name"),
        ({"name": "\ud800"}, "The name"),
        ({"unit": "N\tm"}, "The unit"),
        ({"description": "bell \x07"}, r"description of a variable .*\n.*variable 'u'"),
    ],
)
def test_texts_that_xml_cannot_hold_are_refused(changed: dict[str, str], text: str) -> None:
    with pytest.raises(InputError, match=text):
        generate_c(replace(gain(), inputs=(replace(Variable("u", "", "input"), **changed),)))
