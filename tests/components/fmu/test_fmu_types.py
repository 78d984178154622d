"""Integer, Boolean and enumeration inputs and outputs, start values, and what feeds through."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.base.errors import SimulationError, UnknownNameError
from fmu_didim.cli.main import main
from fmu_didim.components.fmu import info_lines, load_fmu, probe_fmu, read_description
from fmu_didim.export import build_fmu
from tests.awkward.build import ARRAYS, DEFAULTS, SLAVE, awkward_fmu, library, pack
from tests.awkward.versions import TYPES_3, typed
from tests.components.fmu.helpers import ONES, H, slave_outputs
from tests.helpers import begin, drive, scara, scara_pd

LIMITS = {f"{s}{b}": np.iinfo(f"{s}{b}".lower()) for s in ("Int", "UInt") for b in (8, 16, 32)}


def test_types_of_fmi_2(tmp_path: Path) -> None:
    made = load_fmu(typed(tmp_path, 2))
    assert [v.name for v in made.inputs] == ["gear", "u", "on", "mode"]
    assert [v.start for v in made.inputs] == [1.0, 0.0, 1.0, 1.0]
    assert made.inputs[1].unit == "rad"
    u = np.array([[3, 0.1, 1, 2], [-2, 0.2, 1, 1], [2**31 - 1, 0.0, 0, 2], [5, 0.3, 0, 1]])
    wanted = np.column_stack([u[:, 0] * u[:, 1] * u[:, 2], 1 - u[:, 2], u[:, 3], 2 * u[:, 0]])
    wanted[2, 3] = -2  # 2 gear does not fit an int
    np.testing.assert_allclose(drive(made, u, H), wanted, rtol=1e-15)


@pytest.mark.gate
@pytest.mark.parametrize("isolated", [False, True])
def test_types_of_fmi_3(tmp_path: Path, isolated: bool) -> None:
    made = load_fmu(typed(tmp_path, 3), isolated=isolated)
    names = [v.name.removeprefix("u_") for v in made.inputs]
    assert [n for n in names if "[" not in n] == [t for t in TYPES_3 if t != "Int16"]
    rng = np.random.default_rng(3)
    u = np.zeros((6, len(names)))
    for i, name in enumerate(names):
        kind = name.partition("[")[0]
        if kind in LIMITS:
            u[:, i] = rng.integers(LIMITS[kind].min, LIMITS[kind].max, 6, endpoint=True)
            u[:2, i] = LIMITS[kind].min, LIMITS[kind].max
        else:
            u[:, i] = {
                "Float64": rng.normal(size=6), "Float32": [0.5, -2.25, 2**20, 0, 1, 3], "Boolean": [0, 1, 1, 0, 1, 0],
                "Enumeration": [1, 2, 1, 2, 2, 1], "Int64": [-(2**53), 2**53, 0, 1, 2, 3],
                "UInt64": [0, 2**53, 1, 2, 3, 4],
            }[kind]  # fmt: skip
    np.testing.assert_array_equal(drive(made, u, H), u)
    nearly = u.copy()
    nearly[:, names.index("Int8")] += 5e-10
    np.testing.assert_array_equal(drive(made, nearly, H), u)


@pytest.mark.parametrize(
    ("name", "value", "takes"),
    [
        ("u_Int32", 0.5, "integers"), ("u_Int32", 2e-9, "integers"), ("u_Int8", 128.0, "integers"),
        ("u_UInt8", -1.0, "integers"), ("u_Int64", 2.0**63, "integers"), ("u_UInt64", 2.0**64, "integers"),
        ("u_Boolean", 2.0, "0 and 1"), ("u_Boolean", 0.5, "0 and 1"), ("u_Int16[2]", np.nan, "integers"),
        ("u_Enumeration", np.inf, "integers"),
    ],
)  # fmt: skip
def test_values_that_do_not_fit_are_refused(tmp_path: Path, name: str, value: float, takes: str) -> None:
    instance = load_fmu(typed(tmp_path, 3)).instantiate()
    begin(instance, np.ones(13))
    instance.inputs[instance.input_names.index(name)] = value
    with pytest.raises(SimulationError, match=f"input '{name.replace('[', r'.').replace(']', '.')}' .* {takes} only"):
        instance.set()
    instance.close()


def test_derivatives_leave_integers_alone(tmp_path: Path) -> None:
    instance = load_fmu(typed(tmp_path, 2), si_units=False).instantiate()
    begin(instance, np.array([3.0, 0.5, 1.0, 1.0]))
    by_input, _ = instance.derivatives([0, 1], [0, 1, 2], {})
    np.testing.assert_allclose(by_input, [[0, 3, 0], [0, 0, 0]], atol=1e-8)
    assert instance.native() is None
    instance.close()


@pytest.mark.gate
def test_probes_of_other_types(tmp_path: Path) -> None:
    found = probe_fmu(load_fmu(typed(tmp_path, 2)))
    assert not found.facts.failure
    assert found.response == {"y": "at once", "off": "at once", "mode_out": "never", "double_gear": "never"}
    assert found.rerun.strategy == "re-instantiate"  # it has no reset


def test_strings_are_told_and_not_offered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = typed(tmp_path, 2)
    lines = list(info_lines(read_description(path)))
    assert any("words" in line and "(not offered)" in line for line in lines)
    assert not any("gear" in line and "(not offered)" in line for line in lines)
    assert main(["fmu", "info", str(path)]) == 0
    assert capsys.readouterr().out.splitlines() == lines


def test_start_values(tmp_path: Path) -> None:
    """Of local variables with initial = exact: no parameters, but they may be set before the initialisation."""
    made = load_fmu(awkward_fmu(tmp_path))
    assert made.start_values == {"internal": 0.0}
    assert "internal" not in made.parameter_values()
    changed = made.with_parameters({"internal": 0.7, "a": 1.0})
    assert changed.start_values == {"internal": 0.7}
    free = 0.7 * (1 - H) ** np.arange(10)[:, None]
    np.testing.assert_allclose(drive(changed, ONES, H), slave_outputs(ONES, a=1.0) + free, rtol=1e-13)
    instance = changed.instantiate()
    begin(instance, np.zeros(1))
    with pytest.raises(SimulationError, match=r"start value of the FMU[\s\S]*got:   internal"):
        instance.set_parameters({"internal": 0.0})
    instance.close()
    lines = list(info_lines(made.fmu))
    assert lines[lines.index("start values: 1") + 1].split() == ["internal", "Real", "0"]
    with pytest.raises(UnknownNameError, match="Did you mean 'internal'"):
        made.with_parameters({"internl": 1.0})


def test_start_values_that_name_a_parameter_are_not_offered(tmp_path: Path) -> None:
    """As a Modelica compiler writes them: start="q_start1"."""
    xml = SLAVE.format(**DEFAULTS)
    said = 'initial="exact"><Real start="0"/>'
    assert said in xml
    made = load_fmu(pack(tmp_path / "named.fmu", xml.replace(said, said.replace('"0"', '"a"')), library("slave")))
    assert made.start_values == {}
    np.testing.assert_allclose(drive(made, ONES, H), slave_outputs(ONES), rtol=1e-13)


def test_feedthrough_of_own_fmus() -> None:
    for version in ("2.0", "3.0"):
        plant = load_fmu(build_fmu(scara().block(), fmi_version=version))
        names = [v.name for v in plant.outputs]
        wanted = {(y, u) for y in names if y.startswith("ddq") for u in ("tau1", "tau2")}
        assert wanted and plant.feedthrough() == wanted
        block = scara_pd()
        law = load_fmu(build_fmu(block, fmi_version=version))
        rows, columns = block.output.jac_sparsity(0, 1).get_triplet()
        assert law.feedthrough() == {
            (law.outputs[i].name, law.inputs[j].name) for i, j in zip(rows, columns, strict=True)
        }


def test_feedthrough_with_other_names_and_types(tmp_path: Path) -> None:
    made = load_fmu(typed(tmp_path, 2))
    inputs = tuple(replace(v, name=f"in {v.name}") for v in made.inputs)
    outputs = tuple(replace(v, name=f"out {v.name}") for v in made.outputs)
    found = made.with_names(inputs, outputs).feedthrough()
    assert found is not None
    by_output = {y: sorted(u for o, u in found if o == f"out {y}") for y in ("y", "off", "mode_out", "double_gear")}
    everything = ["in gear", "in mode", "in on", "in u"]
    assert by_output == {"y": ["in gear", "in on", "in u"], "off": ["in on"], "mode_out": everything, "double_gear": []}


def test_feedthrough_of_arrays_and_of_what_is_not_said(tmp_path: Path) -> None:
    xml = ARRAYS.replace('<Output valueReference="3"/>', '<Output valueReference="3" dependencies=""/>')
    made = load_fmu(pack(tmp_path / "arrays.fmu", xml, library("arrays")))
    assert made.feedthrough() == {(y, u) for y in ("y[1]", "y[2]") for u in ("u[1]", "u[2]")}
    text = SLAVE.format(**DEFAULTS)
    for structure, wanted in (
        ('<Unknown index="2" dependencies="1 3"/>', {("y", "u")}),
        ('<Unknown index="2" dependencies="10"/>', set()),  # on a state only
        ('<Unknown index="2" dependencies=""/>', set()),
        ('<Unknown index="2"/>', {("y", "u")}),
        ("", None),
    ):
        path = tmp_path / "said.fmu"
        pack(path, text.replace('<Unknown index="2"/>', structure), library("slave"))
        assert load_fmu(path).feedthrough() == wanted


@pytest.mark.parametrize("isolated", [False, True])
def test_further_names_of_an_input_do_not_overwrite_it(tmp_path: Path, isolated: bool) -> None:
    """Of FMI 3.0: an alias of an input is no input of its own, that of an output is the output."""
    xml = ARRAYS.replace('start="0 0"><Dimension start="2"/>', 'start="0 0"><Dimension start="2"/><Alias name="twin"/>')
    xml = xml.replace('causality="output"><Dimension start="2"/>', 'causality="output"><Dimension start="2"/>'
                      '<Alias name="shown"/>')  # fmt: skip
    xml = xml.replace('<Output valueReference="1"/>', '<Output valueReference="1" dependencies=""/>')
    assert "twin" in xml and "shown" in xml
    made = load_fmu(pack(tmp_path / "arrays.fmu", xml, library("arrays")), isolated=isolated)
    assert [v.name for v in made.inputs] == ["u[1]", "u[2]"]
    assert [v.name for v in made.outputs] == ["y[1]", "y[2]", "z", "shown[1]", "shown[2]"]
    u = np.array([[1.0, 2.0], [3.0, -1.0], [0.5, 4.0]])
    found = drive(made, u, 0.5)
    np.testing.assert_array_equal(found[:, :2], u)
    np.testing.assert_array_equal(found[:, 3:], u)
    assert {output for output, _ in made.feedthrough() or ()} == {"z"}
