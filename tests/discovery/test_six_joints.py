"""Discovery on a robot with six joints: the TX40 of examples/tx40, with one effect that its model lacks."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import discover
from fmu_didim.dynamics.effects import EFFECTS, TorqueEffect
from fmu_didim.results.findings import FindingsDocument

EXAMPLE = Path("examples/tx40")
FRICTION = {
    "asymmetric_coulomb", "asymmetric_viscous", "quadratic_viscous", "cubic_viscous", "stribeck",
    "load_dependent_friction", "directional_efficiency", "coupling_friction", "wrist_friction",
    "spring", "torque_offset",
}  # fmt: skip
"""Effects proposed in the quick tests: those whose signatures need no simulation and no grid of shapes."""
CLASS = {"wrist": "wrist coupling", "load": "load_dependent_friction"}


def script() -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLE / "make_data.py"))


def case_in(folder: Path, name: str, made: Any = None) -> Path:
    """The case of the example with data made anew, in a folder laid out like that of the example."""
    out = folder / "examples" / "tx40"
    out.mkdir(parents=True)
    for kind in ("fmus", "controllers"):
        (folder / kind).symlink_to(Path(kind).resolve())
    for file in EXAMPLE.glob("*.yaml"):
        (out / file.name).write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    (made or script()["make"])(name, out)
    return out / f"discover_{name}.yaml"


def case_that_hides(folder: Path, effect: str, joint: int, values: dict[str, float]) -> Path:
    """The case ``wrist`` with another effect in its data."""
    made = script()["make"]
    made.__globals__["HIDDEN"]["wrist"] = (effect, joint, values)
    return case_in(folder, "wrist", made)


def check(document: FindingsDocument, name: str) -> None:
    """Right name and joint first, the true values within the intervals, and the gap closed."""
    effect, joint, truth = script()["HIDDEN"][name]
    first = document.findings[0]
    assert (first.effect, first.joint, first.class_) == (effect, joint, CLASS[name])
    assert [f.joint for f in document.findings] == [joint], "nothing else is named"
    for value in first.parameters:
        expected = truth[value.name.removesuffix(str(joint))]
        assert value.value == pytest.approx(expected, rel=0.1), value.name
    for label in ("estimation", "validation"):
        gap = document.gap[label]
        assert gap.before is not None and gap.after is not None
        assert gap.after < 0.4 * gap.before, label
    assert document.gap["validation"].after < 0.6  # type: ignore[operator]


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param("wrist", marks=pytest.mark.slow), "load"])
def test_effect_is_named_among_effects_of_friction(name: str) -> None:
    """The shipped data; the rest of the catalogue, whose signatures take simulations, is forbidden."""
    forbidden = [e for e in EFFECTS if e not in FRICTION]
    assert all(isinstance(EFFECTS[e], TorqueEffect) for e in FRICTION)
    check(discover(EXAMPLE / f"discover_{name}.yaml", forbid=forbidden, rounds=2), name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wrist", "load"])
def test_effect_is_named_among_the_whole_catalogue(tmp_path: Path, name: str) -> None:
    document = discover(case_in(tmp_path, name), tmp_path / "out")
    check(document, name)
    assert (tmp_path / "out" / document.files["plant_fmu"]).is_file()
    (note,) = [n for n in document.notes if "augmented case" in n]
    assert "could not" not in note


@pytest.mark.slow
def test_the_inertia_of_a_motor_of_two_joints_is_named_among_the_whole_catalogue(tmp_path: Path) -> None:
    """Of a motor that turns with joints 5 and 6, most of whose inertia is its own: Ia6 = 0.0114 kg.m2."""
    document = discover(case_that_hides(tmp_path, "coupled_inertia", 5, {"Iam": 0.0097}), tmp_path / "out")
    assert [(f.effect, f.joint) for f in document.findings] == [("coupled_inertia", 5)]
    (value,) = document.findings[0].parameters
    assert value.std is not None and abs(value.value - 0.0097) <= 3 * value.std <= 0.001
    assert document.verdict == "valid"
    assert "coupled_inertia" in Path(tmp_path / "out" / document.files["robot"]).read_text(encoding="utf-8")


@pytest.mark.slow
def test_shipped_data_are_what_the_script_makes(tmp_path: Path) -> None:
    for name in CLASS:
        folder = case_in(tmp_path / name, name).parent
        for label in ("train", "validation"):
            made, shipped = (
                np.loadtxt(f / f"{name}_{label}.csv", delimiter=",", skiprows=1) for f in (folder, EXAMPLE)
            )
            np.testing.assert_allclose(made, shipped, rtol=2e-4, atol=1e-4)
