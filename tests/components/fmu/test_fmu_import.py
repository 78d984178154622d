"""Import of FMUs: what files are refused, units, options, arrays, events, faults of FMUs in the field."""

from __future__ import annotations

import gc
import math
import os
import pickle
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.base.errors import FmuDidimError, FmuError, InputError, SimulationError, UnknownNameError
from fmu_didim.components.fmu import FmuProbe, load_fmu, probe_fmu, read_description
from fmu_didim.components.fmu.units import conversion
from fmu_didim.data.units import UnitDefinition, parse_unit
from fmu_didim.export import build_fmu
from fmu_didim.export.versions import VERSIONS
from tests.awkward.build import ARRAYS, DEFAULTS, EVENTS, SLAVE, awkward_fmu, library, pack
from tests.components.fmu.helpers import ONES, H, exported, slave_outputs
from tests.helpers import PERIOD, advance, begin, component, drive, scara, scara_cascade, scara_pd
from tests.patience import is_running, patience, wait_until


def xml(**options: str) -> str:
    return SLAVE.format(**{**DEFAULTS, **options})


def archive(path: Path, files: dict[str, str | bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as stream:
        for name, text in files.items():
            stream.writestr(name, text)
    return path


@pytest.fixture
def new_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    library("slave")  # compiled before, where the compiler has its own cache
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def no_leaks() -> Iterator[None]:
    """No child process is left behind."""
    yield
    children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
    if children.exists():
        pids = children.read_text().split()
        commands = [Path(f"/proc/{p}/cmdline").read_bytes() for p in pids if Path(f"/proc/{p}").exists()]
        assert not [c for c in commands if b"fmu.worker" in c]


# ---- what a file says ------------------------------------------------------------------------------


def test_description(tmp_path: Path) -> None:
    found = read_description(awkward_fmu(tmp_path))
    (interface,) = found.interfaces
    assert (found.version, found.major, found.token, found.name) == ("2.0", 2, "awkward", "slave")
    assert (interface.kind, interface.identifier) == ("co-simulation", "slave")
    assert interface.has_state and interface.has_variable_step
    assert not interface.has_derivatives and not interface.once_per_process and not interface.needs_execution_tool
    assert found.experiment.step == 0.01 and found.experiment.stop is None
    assert len(found.platforms) == 1
    by_name = {v.name: v for v in found.variables}
    assert by_name["a"].variability == "tunable" and by_name["a"].initial == "exact"
    assert not by_name["twice_a"].is_settable and not by_name["internal"].is_settable


@pytest.mark.parametrize("version", VERSIONS)
def test_description_of_exported_fmus(version: str) -> None:
    found = read_description(build_fmu(scara().block(), fmi_version=version))
    assert found.version == version
    assert [i.kind for i in found.interfaces] == ["co-simulation", "model-exchange"]
    assert all(i.has_derivatives and i.has_state for i in found.interfaces)
    assert found.state_count == 4
    assert found.units["N.m"] == UnitDefinition((1, 2, -2, 0, 0, 0, 0, 0))


@pytest.mark.parametrize("name", ["../evil.txt", "/evil.txt", "a/../../evil.txt", "C:/evil.txt", "..\\evil.txt"])
def test_members_outside_the_folder_are_refused(tmp_path: Path, new_cache: Path, name: str) -> None:
    path = archive(tmp_path / "slip.fmu", {"modelDescription.xml": xml(), name: "x"})
    with pytest.raises(FmuError, match="outside its folder"):
        load_fmu(path)
    assert not list(tmp_path.rglob("evil.txt"))
    assert not list((new_cache / "extracted").iterdir())


def test_archives_too_large_are_refused(tmp_path: Path, new_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = archive(tmp_path / "large.fmu", {"modelDescription.xml": xml(), "resources/data": b"0" * 100_000})
    monkeypatch.setattr("fmu_didim.components.fmu.archive.MAXIMUM_BYTES", 50_000)
    with pytest.raises(FmuError, match="too large"):
        load_fmu(path)
    monkeypatch.setattr("fmu_didim.components.fmu.archive.MAXIMUM_MEMBERS", 1)
    with pytest.raises(FmuError, match="too many members"):
        load_fmu(path)


SCHEDULED = ARRAYS.replace("CoSimulation ", "ScheduledExecution ")
BOMB = '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>'


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entity_bombs_are_refused_unread(tmp_path: Path, new_cache: Path, encoding: str) -> None:
    text = xml().replace("UTF-8", encoding).replace("<fmiModelDescription", f"{BOMB}<fmiModelDescription", 1)
    with pytest.raises(FmuError, match=r"document type[\s\S]*<!DOCTYPE"):
        load_fmu(archive(tmp_path / "bomb.fmu", {"modelDescription.xml": text.encode(encoding)}))


def test_strange_encodings_are_refused(tmp_path: Path, new_cache: Path) -> None:
    text = xml().replace("UTF-8", "UTF-7")
    with pytest.raises(FmuError, match=r"encoding[\s\S]*UTF-7"):
        load_fmu(archive(tmp_path / "bomb.fmu", {"modelDescription.xml": text}))


def test_folders_that_were_zipped_as_a_whole(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"no modelDescription\.xml at its top[\s\S]*model/modelDescription\.xml"):
        load_fmu(archive(tmp_path / "deep.fmu", {"model/modelDescription.xml": xml()}))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('<fmiModelDescription fmiVersion="1.0"/>', r"version is not supported[\s\S]*1\.0, model exchange only"),
        ('<fmiModelDescription fmiVersion="1.0"><Implementation/></fmiModelDescription>', "Description.xml is wrong"),
        (xml().replace('fmiVersion="2.0"', 'fmiVersion="4.0"'), r"got:   4\.0[\s\S]*valid: 2\.0, 3\.0"),
        ("<html/>", "no fmiVersion in <html>"),
        (xml().replace("</ModelVariables>", ""), "modelDescription.xml is wrong"),
        (SCHEDULED, r"no interface that can run[\s\S]*scheduled-execution only"),
        (SLAVE.format(**DEFAULTS).replace('start="2"', 'start="two"'), "start value in the FMU is not a number"),
    ],
)  # fmt: skip
def test_descriptions_that_cannot_be_used(tmp_path: Path, text: str, problem: str) -> None:
    binary = library("arrays" if 'fmiVersion="3' in text else "slave")
    with pytest.raises(FmuError, match=problem):
        load_fmu(pack(tmp_path / "bad.fmu", text, binary))


def test_binaries_of_other_platforms_are_listed(tmp_path: Path) -> None:
    path = pack(tmp_path / "windows.fmu", xml(), library("slave"), place="win32", name="slave.dll")
    with pytest.raises(FmuError, match=r"no binary for this platform[\s\S]*got:   win32"):
        load_fmu(path)


def test_wrong_library_names_are_told(tmp_path: Path) -> None:
    path = pack(tmp_path / "named.fmu", xml(), library("slave"), name="other" + library("slave").suffix)
    with pytest.raises(FmuError, match=r"wrong name[\s\S]*got:   other\.[\s\S]*valid: slave\."):
        load_fmu(path)


def test_missing_symbols_are_told(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"lacks functions[\s\S]*without fmi2DoStep"):
        load_fmu(awkward_fmu(tmp_path, "MISSING_SYMBOL")).instantiate()


def test_libraries_that_do_not_load_are_told(tmp_path: Path) -> None:
    broken = tmp_path / f"slave{library('slave').suffix}"
    broken.write_bytes(b"no library")
    with pytest.raises(FmuError, match=r"cannot be loaded[\s\S]*next:"):
        load_fmu(pack(tmp_path / "broken.fmu", xml(), broken)).instantiate()


def test_options_of_loading_are_checked(tmp_path: Path) -> None:
    path = awkward_fmu(tmp_path)
    for options, problem in (
        ({"interface": "me"}, "interface"), ({"solver": "euler"}, "solver"), ({"substeps": 0}, "substeps"),
        ({"time_limit_s": 0}, "time limit"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=problem):
            load_fmu(path, **options)  # type: ignore[arg-type]
    with pytest.raises(FmuError, match=r"no model-exchange interface[\s\S]*co-simulation only"):
        load_fmu(path, interface="model-exchange")


# ---- units -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "shown", "factor"),
    [
        ("deg", "rad", math.pi / 180), ("rpm", "rad/s", math.pi / 30), ("mm", "m", 1e-3), ("mN.m", "N.m", 1e-3),
        ("deg/s", "rad/s", math.pi / 180), ("g.cm2", "kg.m2", 1e-7), ("N.mm", "N.m", 1e-3), ("kN/m", "N/m", 1e3),
        ("N.m/rad", "N.m/rad", 1.0), ("kg.m2", "kg.m2", 1.0), ("m/s2", "m/s2", 1.0), ("furlong", "furlong", 1.0),
        ("", "", 1.0), ("N/m.s", "N/m.s", 1.0), ("ms", "s", 1e-3), ("rev/min", "rad/s", math.pi / 30),
    ],
)  # fmt: skip
def test_unit_strings(unit: str, shown: str, factor: float) -> None:
    rule = conversion(unit, {})
    assert rule.unit == shown
    assert rule.factor == pytest.approx(factor, rel=1e-14)
    assert rule.to_own(rule.to_shown(1.7)) == pytest.approx(1.7, rel=1e-15)


def test_units_defined_in_the_fmu_count() -> None:
    """value in base units = factor value + offset; rad may be left out of the exponents."""
    celsius = UnitDefinition((0, 0, 0, 0, 1, 0, 0, 0), 1.0, 273.15)
    assert conversion("Cel", {"Cel": celsius}).to_shown(20.0) == pytest.approx(293.15)
    turns = UnitDefinition((0, 0, -1, 0, 0, 0, 0, 0), 0.10471975511965977)
    assert conversion("rpm", {"rpm": turns}).unit == "rad/s"
    own = UnitDefinition((0, 1, 0, 0, 0, 0, 0, 0), 201.168)
    assert conversion("furlong", {"furlong": own}) == conversion("furlong", {"furlong": own, "x": celsius})
    assert conversion("furlong", {"furlong": own}).factor == 201.168
    assert parse_unit("degC") == celsius


UNITS = {
    "u_unit": ' unit="deg"', "y_unit": ' unit="mm"', "a_unit": ' unit="degF"',
    "definitions": '<Unit name="degF"><BaseUnit K="1" factor="0.5" offset="100"/></Unit>',
}  # fmt: skip


def test_values_pass_in_si(tmp_path: Path) -> None:
    path = awkward_fmu(tmp_path, **UNITS)
    made = load_fmu(path)
    assert [v.unit for v in (*made.inputs, *made.outputs, made.parameters[0])] == ["rad", "m", "K"]
    assert made.parameter_values()["a"] == 101.0
    u = np.random.default_rng(2).normal(size=(20, 1))
    np.testing.assert_allclose(drive(made, np.radians(u), H), 1e-3 * slave_outputs(u), rtol=1e-13)
    changed = made.with_parameters({"a": 101.5})
    np.testing.assert_allclose(drive(changed, np.radians(u), H), 1e-3 * slave_outputs(u, a=3.0), rtol=1e-13)
    own = load_fmu(path, si_units=False)
    assert [v.unit for v in (*own.inputs, *own.outputs)] == ["deg", "mm"]
    np.testing.assert_allclose(drive(own, u, H), slave_outputs(u), rtol=1e-13)
    instance = made.instantiate()
    begin(instance, np.zeros(1))
    by_input, by_parameter = instance.derivatives([0], [0], {"d": 0.5})
    instance.close()
    np.testing.assert_allclose(by_input, [[0.5e-3 * 180 / math.pi]], rtol=1e-8)
    assert by_parameter.shape == (1, 1)


def test_unknown_units_are_kept(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path, u_unit=' unit="furlong"'))
    assert made.inputs[0].unit == "furlong"
    np.testing.assert_allclose(drive(made, ONES, H), slave_outputs(ONES), rtol=1e-14)


# ---- parameters, options, names --------------------------------------------------------------------


def test_options_of_every_type(tmp_path: Path) -> None:
    made, wanted = load_fmu(awkward_fmu(tmp_path)), slave_outputs(ONES)
    np.testing.assert_allclose(drive(made.with_options({"n": 3}), ONES, H), 3 * wanted)
    np.testing.assert_allclose(drive(made.with_options({"flip": True}), ONES, H), -wanted)
    np.testing.assert_allclose(drive(made.with_options({"label": "double"}), ONES, H), 2 * wanted)
    mixed = made.with_parameters({"a": 1.0, "n": 2, "flip": 1})
    np.testing.assert_allclose(drive(mixed, ONES, H), -2 * slave_outputs(ONES, a=1.0))
    assert made.options == {} and mixed.describe()["options"] == {"n": 2, "flip": True}
    for bad in ({"n": 1.5}, {"n": "three"}, {"flip": 2}, {"label": 1}):
        with pytest.raises(InputError, match="is of type"):
            made.with_options(bad)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["twice_a", "y", "u"])
def test_variables_that_cannot_be_set_are_no_parameters(tmp_path: Path, name: str) -> None:
    with pytest.raises(UnknownNameError, match=r"valid: a, d, unused, n, flip, label, internal"):
        load_fmu(awkward_fmu(tmp_path)).with_parameters({name: 1.0})


def test_fixed_parameters(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path, "FIXED_PARAMETERS", variability="fixed"))
    changed = made.with_parameters({"a": 1.0})
    np.testing.assert_allclose(drive(changed, ONES, H), slave_outputs(ONES, a=1.0))
    instance = changed.instantiate()
    begin(instance, np.zeros(1))
    with pytest.raises(SimulationError, match=r"fixed parameter[\s\S]*got:   a[\s\S]*with_parameters"):
        instance.set_parameters({"a": 2.0})
    instance.close()


@pytest.mark.gate
@pytest.mark.parametrize(
    ("macro", "changed", "told"),
    [
        ("ENTER_OVERWRITES", {"d": 1.5}, r"did not take the value of 'd'[\s\S]*got:   0\.5 after 1\.5 was set"),
        ("ENTER_OVERWRITES", {"n": 3}, r"'n'[\s\S]*got:   1 after 3"),
        ("ENTER_OVERWRITES", {"flip": True}, r"'flip'[\s\S]*got:   0 after 1"),
        ("ENTER_OVERWRITES", {"internal": 0.4}, r"'internal'[\s\S]*got:   0 after 0\.4"),
        ("LIMITED", {"a": 4.0, "d": 1.0}, r"'a'[\s\S]*got:   3 after 4[\s\S]*next:  Choose a value"),
        ("LIMITED", {"a": 2.9, "d": 1.0}, None),
        ("SINGLE_PRECISION", {"a": 1 / 3, "d": 1e-9 / 3}, None),
        ("PARAMETERS_UNREADABLE", {"a": 1.0, "d": 2.0}, None),
    ],
)
@pytest.mark.parametrize("isolated", [False, True])
def test_values_that_read_back_different_are_told(
    tmp_path: Path, macro: str, changed: dict[str, float], told: str | None, isolated: bool
) -> None:
    made = load_fmu(awkward_fmu(tmp_path, macro), isolated=isolated).with_parameters(changed)
    if told is None:
        np.testing.assert_allclose(drive(made, ONES, H), slave_outputs(ONES, **changed), rtol=1e-7)
        return
    with pytest.raises(FmuError, match=told):
        drive(made, ONES, H)


def test_elements_that_read_back_different_are_named(tmp_path: Path) -> None:
    """An FMU of FMI 3.0 whose array begins anew with the initialisation."""
    made = load_fmu(pack(tmp_path / "arrays.fmu", ARRAYS, library("arrays", "ENTER_OVERWRITES")))
    with pytest.raises(FmuError, match=r"'A\[1,2\]'[\s\S]*got:   0 after 10 was set"):
        drive(made.with_parameters({"A[1,2]": 10.0}), np.ones((1, 2)), 0.5)


def test_names_of_any_kind(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path, u="arm.joint[1].tau ref", y="der(arm.q[1,2])"))
    assert (made.inputs[0].name, made.outputs[0].name) == ("arm.joint[1].tau ref", "der(arm.q[1,2])")
    np.testing.assert_allclose(drive(made, ONES, H), slave_outputs(ONES))


def test_arrays_of_fmi_3_are_flattened(tmp_path: Path) -> None:
    made = load_fmu(pack(tmp_path / "arrays.fmu", ARRAYS, library("arrays")))
    assert [v.name for v in made.inputs] == ["u[1]", "u[2]"]
    assert [v.name for v in made.outputs] == ["y[1]", "y[2]", "z"]
    assert made.parameter_values() == {"A[1,1]": 1.0, "A[1,2]": 0.0, "A[2,1]": 0.0, "A[2,2]": 1.0}
    changed = made.with_parameters({"A[1,2]": 10.0, "A[2,2]": -3.0, "n": 2})
    u = np.array([[1.0, 2.0], [3.0, -1.0]])
    wanted = np.column_stack([2 * u @ np.array([[1.0, 10.0], [0.0, -3.0]]).T, [0.0, 0.5]])
    np.testing.assert_allclose(drive(changed, u, 0.5), wanted)
    np.testing.assert_allclose(drive(made.with_options({"off": True}), u, 0.5)[:, :2], 0)
    np.testing.assert_array_equal(drive(pickle.loads(pickle.dumps(changed)), u, 0.5), wanted)
    instance = made.instantiate()
    with pytest.raises(SimulationError, match="cannot save its state"):
        instance.save_state()
    instance.close()


# ---- the same model in every version, interface and solver -----------------------------------------


WAVE = np.sin(7 * np.arange(40)[:, None] * PERIOD + np.arange(2)) * [1.0, 0.2]


@pytest.mark.gate
@pytest.mark.parametrize("version", VERSIONS)
def test_model_exchange_of_a_plant(version: str) -> None:
    """Both integrate with held inputs; co-simulation chooses its substeps by itself."""
    fine = load_fmu(exported("scara", version)).with_substeps(800)
    assert fine is not None
    wanted = drive(fine, WAVE, PERIOD)
    path = exported("scara", version)
    coarse, finer = (load_fmu(path, interface="model-exchange", substeps=n) for n in (5, 50))
    errors = [np.abs(drive(c, WAVE, PERIOD) - wanted)[:, :4].max() for c in (coarse, finer)]
    assert errors[1] < 1e-9 and errors[0] < 1e-5
    cvode = load_fmu(path, interface="model-exchange", solver="cvode")
    assert np.abs(drive(cvode, WAVE, PERIOD) - wanted)[:, :4].max() < 1e-5
    assert cvode.with_substeps(3) is None and coarse.describe()["substeps"] == 5
    assert cvode.describe()["solver"] == "cvode"


@pytest.mark.gate
@pytest.mark.parametrize("name", ["cascade", "pd"])
@pytest.mark.parametrize("version", VERSIONS)
def test_model_exchange_of_a_sampled_controller(name: str, version: str) -> None:
    """Its samples are time events at the communication points, where they must see the new inputs."""
    block = {"cascade": scara_cascade, "pd": scara_pd}[name]()
    u = np.sin(np.arange(20)[:, None] * 0.1 + np.arange(len(block.inputs)))
    fine = np.repeat(u, 5, axis=0)
    fine[np.arange(len(fine)) % 5 != 0] += 5.0
    wanted = np.repeat(drive(component("model", block), u, PERIOD, 0.1), 5, axis=0)
    made = load_fmu(exported(name, version), interface="model-exchange")
    np.testing.assert_allclose(drive(made, fine, PERIOD / 5, 0.1), wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("version", VERSIONS)
def test_state_of_model_exchange_is_restored(version: str) -> None:
    for name in ("scara", "cascade"):
        made = load_fmu(exported(name, version), interface="model-exchange")
        u = np.sin(np.arange(30)[:, None] * 0.1 + np.arange(len(made.inputs)))
        instance = made.instantiate()
        begin(instance, u[0])
        for k in range(10):
            advance(instance, u[k], k * PERIOD, PERIOD)
        state = instance.save_state()
        wanted = [advance(instance, u[k], k * PERIOD, PERIOD) for k in range(10, 20)]
        instance.restore_state(state)
        got = [advance(instance, u[k], k * PERIOD, PERIOD) for k in range(10, 20)]
        np.testing.assert_array_equal(got, wanted)
        instance.close()


@pytest.mark.parametrize("kind", ["co-simulation", "model-exchange"])
def test_fmi_3_has_derivatives(kind: str) -> None:
    pair = []
    for version in ("2.0", "3.0"):
        instance = load_fmu(exported("scara", version), interface=kind).instantiate()
        begin(instance, np.array([1.0, 0.2]))
        pair.append(instance.derivatives([4, 5], [0, 1], {"ZZ1": 3.43}))
        instance.close()
    assert np.abs(pair[0][0]).max() > 0.01
    for a, b in zip(*pair, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


def exact_events(t: float) -> float:
    return t if t <= 0.53 else 1.06 - t if t < 0.75 else 3.06 - t


@pytest.mark.parametrize(("solver", "error"), [("rk4", 2 * 0.1 / 7), ("cvode", 1e-6)])
@pytest.mark.parametrize("h", [0.1, 0.05])
def test_time_and_state_events(tmp_path: Path, solver: str, error: float, h: float) -> None:
    """RK4 is late by at most one substep at the state event, and exact at the time event."""
    path = pack(tmp_path / "events.fmu", EVENTS, library("events"))
    made = load_fmu(path, solver=solver, substeps=7)
    assert made.interface.kind == "model-exchange"
    u = np.random.default_rng(0).normal(size=(round(1 / h), 1))
    got = drive(made, u, h)[:, 0] - 10 * u[:, 0]
    times = np.arange(len(u)) * h
    wanted = np.array([exact_events(t) for t in times])
    others = ~np.isclose(times, 0.75)  # there it is seen before the event iteration of that instant
    np.testing.assert_allclose(got[others], wanted[others], rtol=0, atol=error)
    before, after = np.flatnonzero(times < 0.74)[-1], np.flatnonzero(times > 0.76)[0]
    assert got[after] - got[before] == pytest.approx(2 - (times[after] - times[before]), abs=1e-9)


# ---- FMUs with faults ------------------------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize(
    ("macro", "what"),
    [
        ("CRASH_IN_STEP", "crashed its process"),
        ("EXIT_IN_STEP", r"ended its process \(exit status 7\)"),
        ("HANG_IN_STEP", r"no answer within {limit:g} s"),
    ],
)
@pytest.mark.usefixtures("no_leaks")
def test_crashes_stay_in_their_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, macro: str, what: str) -> None:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    limit = patience(1.0)
    made = load_fmu(awkward_fmu(tmp_path, macro), isolated=True, time_limit_s=limit)
    instance = made.instantiate()
    begin(instance, np.zeros(1))
    for k in range(3):
        advance(instance, ONES[k], k * H, H)
    with pytest.raises(FmuError, match=what.format(limit=limit) + r"[\s\S]*during step[\s\S]*next:"):
        instance.step(3 * H, H)
    with pytest.raises(SimulationError, match="has ended"):
        instance.step(3 * H, H)
    instance.close()
    instance.close()
    assert not list(folder.iterdir())


@pytest.mark.usefixtures("no_leaks")
def test_a_crash_while_loading(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"crashed its process \(SIGABRT[\s\S]*during instantiate"):
        load_fmu(awkward_fmu(tmp_path, "CRASH_WHEN_LOADED"), isolated=True).instantiate()


@pytest.mark.usefixtures("no_leaks")
def test_isolated_fmus_compute_the_same(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path), isolated=True).with_parameters({"a": 1.0, "n": 2})
    assert made.describe()["isolated"] is True
    np.testing.assert_array_equal(drive(made, ONES, H), 2 * slave_outputs(ONES, a=1.0))
    instance = made.instantiate()
    begin(instance, np.zeros(1))
    state = instance.save_state()
    wanted = [advance(instance, row, k * H, H) for k, row in enumerate(ONES)]
    instance.restore_state(state)
    np.testing.assert_array_equal([advance(instance, row, k * H, H) for k, row in enumerate(ONES)], wanted)
    (gain, _) = instance.derivatives([0], [0], {})
    np.testing.assert_allclose(gain, [[1.0]], rtol=1e-9)
    instance.set_parameters({"d": 0.0})
    instance.close()


@pytest.mark.usefixtures("no_leaks")
def test_errors_of_isolated_fmus_arrive(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path, "REFUSED_STEP"), isolated=True)
    with pytest.raises(SimulationError, match=r"returned Discard[\s\S]*only steps of 10 ms and more"):
        drive(made, ONES, 0.001)
    with pytest.raises(FmuError, match="lacks functions"):
        load_fmu(awkward_fmu(tmp_path, "MISSING_SYMBOL"), isolated=True).instantiate()


@pytest.mark.gate
@pytest.mark.skipif(sys.platform == "win32", reason="looks for processes in /proc")
def test_a_hanging_fmu_ends_with_its_parent(tmp_path: Path) -> None:
    """Also if the parent dies without a chance to clean up."""
    path = awkward_fmu(tmp_path, "HANG_IN_STEP")
    code = (
        "import os, threading, time\n"
        "from fmu_didim.components import load_fmu\n"
        f"i = load_fmu({str(path)!r}, isolated=True, time_limit_s=1e6).instantiate()\n"
        "i.begin_initialisation(0.0); i.end_initialisation()\n"
        "for k in range(3): i.step(k * 0.01, 0.01)\n"
        "print(i._worker._process.pid, flush=True)\n"
        "threading.Thread(target=i.step, args=(0.03, 0.01), daemon=True).start()\n"
        "time.sleep(0.2); os._exit(0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    wait_until(lambda: not is_running(int(done.stdout)))


@pytest.mark.usefixtures("no_leaks")
def test_forgotten_instances_end_too(tmp_path: Path) -> None:
    instance = load_fmu(awkward_fmu(tmp_path), isolated=True).instantiate()
    begin(instance, np.zeros(1))
    del instance
    gc.collect()


def test_a_refused_step_is_told(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path, "REFUSED_STEP"))
    with pytest.raises(SimulationError, match=r"Discard[\s\S]*only steps of 10 ms[\s\S]*another control rate"):
        drive(made, ONES, 0.001)
    np.testing.assert_allclose(drive(made, ONES, H), slave_outputs(ONES))


def test_one_instance_in_a_process(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path, "ONCE_PER_PROCESS"))
    first = made.instantiate()
    with pytest.raises(FmuError, match="cannot be instantiated"):
        made.instantiate()
    first.close()
    made.instantiate().close()


# ---- probe -----------------------------------------------------------------------------------------


def probed(folder: Path, *macros: str, **options: str) -> FmuProbe:
    return probe_fmu(load_fmu(awkward_fmu(folder, *macros, **options)), time_limit_s=patience(20.0))


@pytest.mark.gate
@pytest.mark.parametrize(
    ("macros", "strategy", "told"),
    [
        pytest.param((), "reset", "reset: restores", marks=pytest.mark.slow),
        (("RESET_KEEPS_STATE",), "state", "reset: does not restore"),
        (("RESET_KEEPS_STATE", "STATE_INCOMPLETE"), "re-instantiate", "saved state: does not restore"),
        (("COUNTS_INSTANCES",), "fresh process", "one after the other: DIFFERENT"),
        (("SHARED_STATE",), "reset", "side by side: DISTURB each other"),
        (("DELAYED_OUTPUT",), "reset", "follow the inputs after a step: y"),
        pytest.param(("NAN_OUTPUT",), "reset", "NaN or infinite: y", marks=pytest.mark.slow),
        (("FIXED_PARAMETERS",), "reset", "change is refused in a run: a, d, unused"),
        pytest.param(("TUNABLE_IGNORED",), "reset", "WITHOUT EFFECT in a run: a, d", marks=pytest.mark.slow),
        pytest.param(("RESET_KEEPS_PARAMETERS",), "state", "reset: does not restore", marks=pytest.mark.slow),
        (("EXIT_IN_STEP",), "fresh process", "does not run: The FMU ended its process"),
        (("ONLY_SMALL_INPUTS",), "re-instantiate", "with pseudo-random inputs, while it does with its inputs at their"),
        (("ABORT_IN_FREE_STATE",), "reset", "saved state: NOT KNOWN, The FMU crashed its process (SIGABRT"),
    ],
)
@pytest.mark.usefixtures("no_leaks")
def test_probe(tmp_path: Path, macros: tuple[str, ...], strategy: str, told: str) -> None:
    found = probed(tmp_path, *macros)
    text = "\n".join(found.lines())
    assert found.rerun.strategy == strategy
    assert told in text
    if not found.facts.failure and "COUNTS_INSTANCES" not in macros:
        assert found.parameters == {"a": "acts", "d": "acts", "unused": "no effect"}
    if macros == ():
        assert found.side_by_side and found.facts.reproducible and found.response == {"y": "at once"}


def test_every_error_is_one_of_ours(tmp_path: Path) -> None:
    """Whatever half of a file is left."""
    whole = awkward_fmu(tmp_path).read_bytes()
    for size in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        path = tmp_path / f"cut{size}.fmu"
        path.write_bytes(whole[:size])
        with pytest.raises(FmuDidimError):
            load_fmu(path)
