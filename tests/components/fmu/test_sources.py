"""FMUs that hold sources only are compiled with the compiler that is there."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.base.errors import FmuError
from fmu_didim.components import load_fmu
from tests.awkward.build import DEFAULTS, HERE, SLAVE, awkward_fmu
from tests.components.fmu.helpers import ONES, H, exported, slave_outputs
from tests.helpers import drive


def stripped(fmu: Path, folder: Path, *, changed: dict[str, bytes] | None = None) -> Path:
    """An FMU without its binaries, some files of it changed."""
    path = folder / f"sources_{fmu.name}"
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            if not name.startswith("binaries/"):
                new.writestr(name, (changed or {}).get(name, old.read(name)))
    return path


@pytest.mark.gate
@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("interface", ["co-simulation", "model-exchange"])
def test_an_fmu_without_binaries_runs_as_the_one_with_them(tmp_path: Path, version: str, interface: str) -> None:
    whole = exported("scara", version)
    u = np.random.default_rng(2).normal(size=(20, 2))
    wanted = drive(load_fmu(whole, interface=interface), u, H)
    made = load_fmu(stripped(whole, tmp_path), interface=interface)
    np.testing.assert_allclose(drive(made, u, H), wanted, rtol=1e-9, atol=1e-12)


def by_hand(folder: Path, code: str, *, main: str = "slave.c") -> Path:
    """An FMU of slave.c that lists no source files; under another main file it is included by that."""
    path = folder / "slave.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", SLAVE.format(**DEFAULTS))
        archive.writestr("sources/slave.c", code)
        if main != "slave.c":
            archive.writestr(f"sources/{main}", '# include "slave.c"\n')
    return path


def test_files_that_others_include_are_not_compiled_alone(tmp_path: Path) -> None:
    code = (HERE / "slave.c").read_text(encoding="utf-8")
    made = load_fmu(by_hand(tmp_path, code, main="model.c"))
    np.testing.assert_allclose(drive(made, ONES, H), slave_outputs(ONES))


@pytest.mark.parametrize("prefix", ["", "slave_"])
def test_sources_that_are_not_listed_and_functions_with_the_name_of_the_model(tmp_path: Path, prefix: str) -> None:
    code = (HERE / "slave.c").read_text(encoding="utf-8").replace(" fmi2", f" {prefix}fmi2")
    code = code.replace('__attribute__((visibility("default")))', "")
    np.testing.assert_allclose(drive(load_fmu(by_hand(tmp_path, code)), ONES, H), slave_outputs(ONES))


def test_sources_that_do_not_compile_are_refused_with_the_words_of_the_compiler(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match="could not be compiled") as caught:
        load_fmu(by_hand(tmp_path, '#include "of_the_tool.h"\n'))
    assert "of_the_tool.h" in str(caught.value)
    assert "next:" in str(caught.value)


def test_without_binaries_and_sources_it_is_refused_as_before(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match="no binary for this platform"):
        load_fmu(stripped(awkward_fmu(tmp_path), tmp_path))
