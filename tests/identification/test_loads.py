"""A load in one of two runs, and gains of drives from it: known truth, and what misleads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import Case, Result, identify, load_case
from fmu_didim.base.errors import IdentificationError, InputError
from fmu_didim.checks.load import carried
from fmu_didim.estimators.starts.gains import free_gains as places_of_gains
from fmu_didim.estimators.starts.gains import with_first_gains
from fmu_didim.estimators.starts.reference_start import measured_of, rows_of, whole_reference
from tests.loads import LOAD, SCARA, case_of, errors, free_gains

GAINS = (1.3, 0.8)


def codes(found: Result) -> set[str]:
    return {reason.code for reason in found.reasons}


def largest_error(found: Result) -> float:
    """Over all parameters with a truth, in standard deviations; gains are relative to ``GAINS``."""
    names = tuple(found.parameters)
    values, sigma = (np.array([getattr(p, key) for p in found.parameters.values()]) for key in ("value", "std"))
    own = [abs(found.parameters[f"gain{j}"].value - g) / found.parameters[f"gain{j}"].std
           for j, g in enumerate(GAINS, start=1) if f"gain{j}" in names]  # fmt: skip
    return max([*map(abs, errors(values, sigma, names).values()), *own])


def with_runs_exchanged(case: Case) -> Case:
    signals = dict(case.memory.signals)
    for kind in ("log", "positions"):
        signals[f"{kind} empty"], signals[f"{kind} loaded"] = signals[f"{kind} loaded"], signals[f"{kind} empty"]
    return case.with_signals(signals)


# ---- the model of it ---------------------------------------------------------------------------------


def test_a_load_acts_in_its_run_alone_and_like_another_link() -> None:
    model = case_of(0).model
    values = model.start
    loads = [i for i, k in enumerate(model.free_parameters) if k.is_load]
    values[loads] = [LOAD[model.free_parameters[i].key.removeprefix("load_")] for i in loads]
    empty, loaded = (model.theta(values, label) for label in ("empty", "loaded"))
    moved = dict(zip(model.parameters.names, loaded - empty, strict=True))
    assert moved == pytest.approx(
        dict.fromkeys(moved, 0.0) | {"ZZ1R": 0.25 * LOAD["M"], "ZZ2": LOAD["ZZ"], "MX2": LOAD["MX"], "MY2": LOAD["MY"]}
    )
    assert model.theta(values) == pytest.approx(empty)
    known = case_of(0, load={"mass": 2.0}).model
    assert known.theta(known.start, "loaded") - known.theta(known.start, "empty") == pytest.approx(
        [0.25 * 2.0, *[0.0] * 7]
    )
    assert "load_M[loaded]" not in known.names


def test_columns_of_a_load_are_its_torque() -> None:
    """d torque / d value, with and without the derivatives that the loop gives."""
    from fmu_didim.fit.derivatives.sensitivity import sensitivity

    model = case_of(0).model
    values = model.start
    loads = [i for i, k in enumerate(model.free_parameters) if k.is_load]
    values[loads] = list(LOAD.values())
    outputs = model.outputs(values)
    exact = sensitivity(model, values, outputs)[:, :, loads]
    differences = sensitivity(model, values, outputs, exact=False)[:, :, loads]
    assert exact == pytest.approx(differences, abs=2e-3 * np.abs(exact).max())
    rows = model.experiments.rows
    assert not exact[rows["empty"]].any()
    assert (np.abs(exact[rows["loaded"]]).max(axis=(0, 1)) > 0).all()


@pytest.mark.gate
@pytest.mark.parametrize("gains", [(12.0, 0.09)])
@pytest.mark.parametrize("load", [{"mass": 2.0}, {"mass": 2.0, "mass_std": 0.01}])
def test_gains_start_near_those_of_the_data(gains: tuple[float, float], load: dict[str, Any]) -> None:
    model = case_of(0, gains=gains, load=load, identify=free_gains()).model
    columns, target = rows_of(model, whole_reference)
    found = with_first_gains(model, columns, target, measured_of(model))
    assert [found.start[i] for _, i in sorted(places_of_gains(found).items())] == pytest.approx(gains, rel=0.1)


def test_a_gain_that_is_negative_is_refused() -> None:
    model = case_of(0, load={"mass": 2.0}, identify=free_gains()).model
    columns, target = rows_of(model, whole_reference)
    measured = measured_of(model)
    turned = measured * [1.0, -1.0]
    with pytest.raises(IdentificationError, match="gain of a drive is negative"):
        with_first_gains(model, columns, target + turned - measured, turned)


# ---- what a case may say -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"load": {"mass_std": 0.1}}, "needs mass"),
        ({"load": {"mass": -1.0}}, "mass"),
        ({"load": {"mass": 1.0, "inertia": [1, 1, 1, 0, 0, 0]}}, "give centre"),
        ({"load": {"mass": 1.0, "mass_std": 0.1, "centre": [0, 0, 0]}}, "leave out centre"),
        ({"load": {"same_as": "empty"}}, "describes no load"),
        ({"load": {"same_as": "empty", "mass": 1.0}}, "stands alone"),
        ({"identify": {"g": {"of": "drive", "joint": 1}}}, "load of known mass"),
        ({"load": {"mass": 1.0}, "identify": free_gains(), "prior": {"result": "x"}}, "would be those of"),
        ({"prior": {"result": "x", "relative_std": 0.1}}, "stands alone"),
    ],
)
def test_what_cannot_be_meant_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        case_of(0, **changes)


@pytest.mark.gate
def test_a_load_in_all_runs_is_a_part_of_the_robot() -> None:
    with pytest.raises(InputError, match="part of the robot"):
        case_of(0).with_(experiments={"empty": {"load": {}}})
    with pytest.raises(InputError, match="is that of a fitted one"):
        case_of(0).with_(experiments={"loaded": {"role": "validation"}})


@pytest.mark.gate
def test_runs_with_the_same_load_share_it() -> None:
    case = case_of(0)
    third = {"torque": {"file": "log loaded"}, "positions": {"file": "positions loaded"}}
    content = case.content
    content["experiments"] = {**content["experiments"], "again": {**third, "load": {"same_as": "loaded"}}}
    content["experiments"]["held"] = {**third, "role": "validation", "load": {"same_as": "loaded"}}
    model = load_case(content, folder=SCARA.parent, signals=case.signals).model
    assert [k.name for k in model.free_parameters if k.is_load] == [f"load_{stem}[loaded]" for stem in LOAD]
    values = model.start
    values[-len(LOAD) :] = list(LOAD.values())
    first, *others = (model.theta(values, label) for label in ("loaded", "again", "held"))
    assert all((other == first).all() for other in others) and (first != model.theta(values, "empty")).any()
    assert case.tracking is not None


# ---- known truth -------------------------------------------------------------------------------------


@pytest.mark.gate
def test_the_load_is_found_with_the_robot(tmp_path: Path) -> None:
    found = identify(case_of(0), out=tmp_path)
    assert found.verdict == "valid"
    assert largest_error(found) < 4
    load = found.document.loads["loaded"]
    truth = {"mass": 2.0, "cx": 0.12, "cy": -0.03, "Izz": 0.004}
    for name, value in truth.items():
        assert load.body[name].value == pytest.approx(value, abs=4 * load.body[name].std), name
    assert load.body["mass"].std < 0.05
    assert "cz" in "".join(f"c{stem[1].lower()}" for stem in load.unseen if stem.startswith("M"))
    assert "What the robot carries" in found.summary()
    assert "the other runs carry no load" in " ".join(found.document.conditions)
    assert Result.load(tmp_path).document.loads == found.document.loads


@pytest.mark.parametrize(
    "tracking", [pytest.param(True, marks=pytest.mark.gate), pytest.param(False, marks=pytest.mark.slow)]
)
def test_gains_of_drives_are_found_from_a_weighed_load(tracking: bool) -> None:
    """Behind a virtual controller they are scales of the log, in a known loop what the drives give."""
    found = identify(case_of(0, gains=GAINS, load={"mass": 2.0}, identify=free_gains(), tracking=tracking))
    assert found.verdict == "valid"
    assert largest_error(found) < 4
    assert all(found.parameters[f"gain{j}"].std < 0.03 * g for j, g in enumerate(GAINS, start=1))
    assert "the load weighs what the case says, 2 kg (loaded)" in " ".join(found.document.conditions)


@pytest.mark.gate
def test_the_uncertainty_of_the_mass_is_in_the_gains_and_a_wrong_mass_scales_them() -> None:
    case = case_of(0, gains=GAINS, load={"mass": 2.0}, identify=free_gains())
    model = case.model
    exact = case.estimator.estimate(model)
    rough = case.with_(experiments={"loaded": {"load": {"mass_std": 0.1}}})
    wide = rough.estimator.estimate(rough.model)
    wrong = case.with_(experiments={"loaded": {"load": {"mass": 2.2}}})
    more = wrong.estimator.estimate(wrong.model)
    for name in ("gain1", "gain2", "ZZ1R", "Fc2"):
        i, j, k = (estimate.names.index(name) for estimate in (exact, wide, more))
        relative = wide.standard_deviation[j] / wide.value[j]
        own = exact.standard_deviation[i] / exact.value[i]
        assert relative == pytest.approx(np.hypot(own, 0.05), rel=0.1), name
        assert more.value[k] / exact.value[i] == pytest.approx(1.1, rel=0.01), name
    assert carried(wide)["loaded"].body["mass"][1] == pytest.approx(0.1, rel=0.05)


# ---- the robot as it was -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of the robot without load."""
    folder = tmp_path_factory.mktemp("empty")
    identify(case_of(0).with_(experiments={"loaded": None}), out=folder)
    return folder


def beside(result: Path) -> Case:
    return case_of(0).with_(experiments={"empty": None}, prior={"result": str(result)})


@pytest.mark.gate
def test_an_earlier_result_stands_for_the_unloaded_run(empty: Path) -> None:
    both = case_of(0)
    joint, case = both.estimator.estimate(both.model), beside(empty)
    later = case.estimator.estimate(case.model)
    assert later.names == joint.names
    for i, name in enumerate(joint.names):
        if name.startswith("load"):
            assert later.value[i] == pytest.approx(joint.value[i], abs=joint.standard_deviation[i]), name
            assert later.standard_deviation[i] == pytest.approx(joint.standard_deviation[i], rel=0.35), name


@pytest.mark.gate
def test_an_earlier_result_that_is_no_match_is_refused_and_a_doubtful_one_doubted(empty: Path, tmp_path: Path) -> None:
    content = json.loads((empty / "result.json").read_text(encoding="utf-8"))

    def changed(**entries: Any) -> Path:
        (tmp_path / "result.json").write_text(json.dumps(content | entries), encoding="utf-8")
        return tmp_path

    links = [dict(link, a=0.4 if j else 0.0) for j, link in enumerate(content["geometry"]["links"])]
    fewer = {name: p for name, p in content["parameters"].items() if name != "MY2"}
    for entries, words in (
        ({"geometry": content["geometry"] | {"links": links}}, "another robot"),
        ({"parameters": fewer, "covariance": np.eye(7).tolist()}, "another robot"),
        ({"parameters": {}, "covariance": []}, "no values"),
        ({"covariance": "?"}, "no result"),
    ):
        with pytest.raises(InputError, match=words):
            beside(changed(**entries))
    with pytest.raises(InputError, match="do not exist"):
        beside(tmp_path / "nowhere")
    prior = beside(changed(verdict="doubtful")).model.prior
    assert prior is not None and "doubtful" in prior.doubted
    assert "prior-doubtful" in codes(identify(beside(changed(verdict="doubtful"))))


# ---- what misleads -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("case", "code"),
    [
        pytest.param(lambda: with_runs_exchanged(case_of(0)), "load-absent", marks=pytest.mark.gate),
        pytest.param(lambda: case_of(0, carried=dict.fromkeys(LOAD, 0.0)), "load-absent", marks=pytest.mark.slow),
        pytest.param(lambda: case_of(0, friction=0.1), "experiments-disagree", marks=pytest.mark.gate),
    ],
)
def test_what_bends_a_load_is_told(case: Any, code: str) -> None:
    found = identify(case())
    assert found.verdict == "doubtful"
    assert code in codes(found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "code"),
    [
        (lambda: with_runs_exchanged(case_of(0, load={"mass": 2.0}, identify=free_gains())), "drive-gain-unknown"),
        (lambda: case_of(0, carried={k: v / 100 for k, v in LOAD.items()}, load={"mass": 0.02},
                         identify=free_gains()), "drive-gain-unknown"),
        (lambda: case_of(0, friction=0.1, load={"mass": 2.0}, identify=free_gains()), "experiments-disagree"),
    ],
)  # fmt: skip
def test_what_bends_gains_is_told(case: Any, code: str) -> None:
    found = identify(case())
    assert found.verdict == "doubtful"
    assert code in codes(found)
