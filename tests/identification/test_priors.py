"""A prior beside the data: what it adds, what is told of it, and that it never passes for data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import discover, identify
from fmu_didim.base.errors import IdentificationError, InputError
from fmu_didim.case import load_case
from fmu_didim.checks.agreement import agreement
from fmu_didim.checks.identification import checked
from fmu_didim.discovery.run import WITHOUT_PRIOR
from fmu_didim.dynamics.prior import Prior, prior_of
from fmu_didim.estimators import Estimator
from fmu_didim.estimators.clie import Clie
from fmu_didim.estimators.didim import Didim
from fmu_didim.estimators.starts.start import start_sequence, start_values
from fmu_didim.fit.confounding import confounded
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.free_parameter import base_free_parameters
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.report import result_table
from tests.helpers import ROOT, with_torque

NOISE = np.array([0.35, 0.012])
CAD = {
    "M1": 10.0, "MX1": 3.0, "XX1": 0.05, "YY1": 2.6, "ZZ1": 2.6, "Ia1": 0.33,
    "M2": 2.0, "MX2": 0.241, "MY2": 0.014, "XX2": 0.007, "YY2": 0.062, "ZZ2": 0.063, "XY2": -0.0017,
}  # fmt: skip
"""Two links whose base parameters are those of the SCARA."""


@pytest.fixture(scope="module")
def model() -> LoopModel:
    return load_case(ROOT / "examples/scara/identify.yaml").model


def prior(model: LoopModel, relative: float, *, of_motor: float | None = None, **factors: float) -> Prior:
    """Both links to a part of their values, these taken times factors."""
    assert isinstance(model.parameters, RobotParameters)
    base = model.parameters.base
    nominal = dict.fromkeys(base.standard_names, 0.0) | CAD
    for name, factor in factors.items():
        nominal[name] *= factor
    single = {"Ia1": (relative if of_motor is None else of_motor) * CAD["Ia1"]}
    return prior_of(
        model.parameters.model, base, nominal, links={1: relative, 2: relative}, single=single, source="CAD"
    )


def measured(model: LoopModel, truth: np.ndarray, noise: np.ndarray, seed: int) -> LoopModel:
    rng = np.random.default_rng(seed)
    for label in model.estimation_labels:
        torque = model.torque(truth, label)
        model = with_torque(model, torque + noise * rng.standard_normal(torque.shape), label)
    return replace(model, torque_deviation=noise)


def codes(estimate: Estimate) -> set[str]:
    judged = checked(estimate, []).judgement
    return {d.code.name for d in (*judged.reasons, *judged.remarks)}


@pytest.mark.gate
@pytest.mark.parametrize("factor", [4.0, pytest.param(15.0, marks=pytest.mark.slow)])
def test_intervals_hold_over_draws_of_the_prior(model: LoopModel, factor: float) -> None:
    """Robots are drawn from the prior, logs from the noise; the test of agreement is right by chance, too."""
    known, z, inside, p_values = prior(model, 0.1), [], [], []
    spread = np.linalg.pinv(known.rows)
    center = np.where(np.isfinite(known.deviation), known.mean, model.start)
    for seed in range(50):
        truth = center + spread @ np.random.default_rng([seed, 1]).standard_normal(known.target.size)
        estimate = Didim().estimate(replace(measured(model, truth, factor * NOISE, seed), prior=known))
        z.append((estimate.value - truth) / estimate.standard_deviation)
        low, high = estimate.interval().T
        inside.append((low <= truth) & (truth <= high))
        assert estimate.prior is not None
        p_values.append(estimate.prior.p_value)
    assert 0.9 <= np.mean(inside) <= 0.99
    assert 0.88 <= np.sqrt(np.mean(np.square(z))) <= 1.12
    assert 0.3 <= np.mean(p_values) <= 0.65
    assert min(p_values) > 1e-4


@pytest.mark.gate
def test_a_prior_of_no_weight_changes_nothing(model: LoopModel) -> None:
    data = measured(model, model.start, NOISE, 3)
    alone = Didim().estimate(data)
    both = Didim().estimate(replace(data, prior=prior(model, 1e5)))
    assert both.value == pytest.approx(alone.value, abs=float(2e-2 * alone.standard_deviation.min()))
    assert both.standard_deviation == pytest.approx(alone.standard_deviation, rel=1e-2)
    assert both.prior is not None
    assert both.prior.data_share == pytest.approx(1.0, abs=1e-6)
    assert both.prior.alone == pytest.approx(alone.value, abs=float(2e-2 * alone.standard_deviation.min()))
    assert alone.prior is None


@pytest.mark.parametrize("estimator", [Didim(), Clie(start="reference")])
def test_a_prior_without_doubt_gives_its_own_values(model: LoopModel, estimator: Estimator) -> None:
    data = measured(model, model.start, NOISE, 3)
    known = prior(model, 1e-5)
    found = estimator.estimate(replace(data, prior=known))
    assert found.prior is not None
    has = np.isfinite(known.deviation)
    assert found.value[has] == pytest.approx(known.mean[has], rel=1e-4)
    assert found.standard_deviation[has] == pytest.approx(known.deviation[has], rel=1e-2)
    assert (found.prior.data_share[has] < 1e-3).all()
    assert (found.prior.data_share[~has] > 0.9).all()
    assert "prior-decides" in codes(found)


def test_both_weigh_by_what_they_know(model: LoopModel) -> None:
    """Neither alone is as sure; what the prior decides is told, and where both agree there is no doubt."""
    data = measured(model, model.start, 4 * NOISE, 5)
    alone, both = Didim().estimate(data), Didim().estimate(replace(data, prior=prior(model, 0.1)))
    assert both.prior is not None
    has = np.isfinite(both.prior.deviation)
    assert (both.standard_deviation <= 1.01 * alone.standard_deviation).all()
    assert (both.standard_deviation[has] < both.prior.deviation[has]).all()
    assert both.prior.data_share[both.names.index("MY2")] < 0.5
    assert "prior-decides" in codes(both)
    assert "prior-disagrees" not in codes(both)
    stage = both.stages["didim"]
    assert (stage.formulas["cramer_rao"] <= 1.02 * stage.standard_deviation).all()  # the bound counts it, too


def test_a_wrong_prior_is_a_doubt_and_never_passes_for_data(model: LoopModel) -> None:
    """A second link three times as heavy as it is, said to be known to 5 %, where the noise is by the residual."""
    data = replace(measured(model, model.start, NOISE, 7), torque_deviation=None)
    heavy = {name: 3.0 for name in CAD if name.endswith("2")}
    found = Didim().estimate(replace(data, prior=prior(model, 0.05, **heavy)))
    judged = checked(found, []).judgement
    assert judged.verdict == "doubtful"
    reason = next(d for d in judged.reasons if d.code.name == "prior-disagrees")
    assert "CAD" in reason.text
    assert any(name in reason.text for name in ("ZZ2", "MX2", "ZZ1R"))
    # The noise is that of the data, whatever the prior does to the residual.
    assert found.noise == pytest.approx(NOISE, rel=0.35)


def test_a_wrong_unit_is_told_even_where_the_prior_is_modest(model: LoopModel) -> None:
    data = measured(model, model.start, NOISE, 8)
    found = Didim().estimate(replace(data, prior=prior(model, 0.3, ZZ1=20, YY1=20, M1=20, MX1=20, XX1=20)))
    assert "prior-disagrees" in codes(found)


def test_the_pull_of_a_wrong_prior_is_no_disagreement_of_experiments(model: LoopModel) -> None:
    """Each experiment is compared with the others where the data alone have the minimum."""
    data, rng = replace(model.on(*model.experiments), torque_deviation=2 * NOISE), np.random.default_rng(0)
    for label in model.experiments:
        torque = model.torque(model.start, label)
        data = with_torque(data, torque + 2 * NOISE * rng.standard_normal(torque.shape), label)
    heavy = {name: 1.5 for name in CAD if name.endswith("2")}
    found = [Didim().estimate(data), Didim().estimate(replace(data, prior=prior(model, 0.05, **heavy)))]
    assert "prior-disagrees" in codes(found[1])
    p_values = [[a.p_value for a in agreement(e.fit).values()] for e in found if e.fit is not None]
    assert p_values[1] == pytest.approx(p_values[0], abs=0.02)


def test_values_that_an_experiment_has_of_its_own_have_no_prior(model: LoopModel) -> None:
    """A payload that is in no description."""
    data = measured(model.on(*model.experiments), model.start, NOISE, 4)
    labels = list(model.experiments)
    own = base_free_parameters(model.parameters, {labels[1]: ["MX2"]})
    found = Didim().estimate(replace(data.with_free(own), prior=prior(model, 0.1)))
    assert found.prior is not None
    place = found.names.index(f"MX2[{labels[1]}]")
    assert np.isnan(found.prior.mean[place])
    assert np.isfinite(found.prior.mean[found.names.index("MX2")])
    assert found.prior.data_share[place] > 0.5


def brief(model: LoopModel, samples: int) -> LoopModel:
    """The first samples of a log at 10 Hz."""
    short = model.experiments[model.first].before(samples)
    return measured(model.with_experiment(model.first, short).on(model.first), model.start, NOISE, 1)


def test_a_prior_makes_a_log_of_less_than_a_second_enough(model: LoopModel) -> None:
    """Alone it has no answer at all."""
    data = brief(model, 8)
    with pytest.raises(IdentificationError):
        Didim().estimate(data)
    known = prior(model, 0.1)
    found = Didim().estimate(replace(data, prior=known))
    assert np.isfinite(found.standard_deviation).all()
    assert np.abs((found.value - model.start) / found.standard_deviation).max() < 4
    assert found.prior is not None
    share = dict(zip(found.names, found.prior.data_share, strict=True))
    assert share["MY2"] < 0.1
    assert share["Fc2"] > 0.9
    place = found.names.index("MY2")
    assert found.standard_deviation[place] == pytest.approx(known.deviation[place], rel=0.1)


def test_what_neither_knows_is_refused_by_name(model: LoopModel) -> None:
    """Two columns that are alike: a prior of their difference tells them apart, one of something else does not."""
    known = prior(model, 0.1)
    rng = np.random.default_rng(0)
    table = rng.standard_normal((50, len(model.names)))
    zz, fv = model.names.index("ZZ2"), model.names.index("Fv2")
    names, values = model.names, np.ones(len(model.names))
    alike = table.copy()
    alike[:, model.names.index("MX2")] = 2 * alike[:, zz]
    assert set(confounded(alike, values, names, torque=1.0)) == {"ZZ2", "MX2"}
    assert confounded(replace(model, prior=known).beside_prior(alike), values, names, torque=1.0) == ()
    alike = table.copy()
    alike[:, fv] = 2 * alike[:, model.names.index("Fc2")]
    found = confounded(replace(model, prior=known).beside_prior(alike), values, names, torque=1.0)
    assert set(found) == {"Fv2", "Fc2"}


CASE = ROOT / "examples/double_pendulum/identify.yaml"
PUBLISHED: Mapping[str, Any] = {"towards": "published.yaml", "relative_std": 0.2, "motor_inertia": 0.2}
SHORT: Mapping[str, Any] = {"train": {"to_s": 5}, "validation": None}


@pytest.mark.gate
def test_five_seconds_of_a_real_robot_and_published_links() -> None:
    """Published for the same machine: ZZ1R 0.111, MX1R 0.349, ZZ2 0.0239, MX2 0.111; by 34 s MX1R 0.334, MX2 0.117."""
    result = identify(load_case(CASE).with_(**SHORT, prior=PUBLISHED))
    values = result.document.parameters
    for name, whole in (("ZZ1R", 0.111), ("MX1R", 0.334), ("ZZ2", 0.0239), ("MX2", 0.117)):
        assert abs(values[name].value - whole) < 3 * values[name].std
        assert values[name].std < 0.1 * whole
    found = result.document.prior
    assert found is not None
    assert found.source == "published.yaml"
    assert found.parameters["Fc1"].prior is None
    assert found.parameters["ZZ2"].data_share < 0.6 < found.parameters["Fc1"].data_share
    assert found.p_value is not None
    assert found.p_value > 0.01
    text = result_table(result.document)
    assert "data %" in text
    assert "Data beside published.yaml" in text
    assert "published.yaml" in result.document.provenance["files"]


def test_iterations_begin_at_the_prior_unless_another_start_is_asked_for(model: LoopModel) -> None:
    informed = replace(model, prior=prior(model, 0.1))
    assert start_sequence(informed, "torque")[:2] == ("prior", "torque")
    assert start_sequence(informed, "reference")[0] == "reference"
    assert "prior" not in start_sequence(model, "torque")
    values, known = start_values(informed, "prior"), informed.prior
    assert known is not None
    has = np.isfinite(known.deviation)
    assert np.abs((values - known.mean)[has] / known.deviation[has]).max() < 0.2
    with pytest.raises(InputError):
        start_values(model, "prior")


@pytest.mark.gate
def test_a_minimum_that_was_passed_by_is_found_from_the_prior() -> None:
    """From the motion that the torque implies the iterations end with a link 2 of a tenth of its inertia."""
    case = load_case(CASE).with_(train={"to_s": 6}, validation=None, prior=PUBLISHED)
    for start in ({"kind": "didim"}, {"kind": "didim", "start": "nominal"}):
        found = case.with_(estimator=start)
        estimate = found.estimator.estimate(found.model)
        assert estimate.value[estimate.names.index("ZZ2")] == pytest.approx(0.0247, abs=0.003)
        assert estimate.prior is not None
        assert estimate.prior.p_value > 0.01


@pytest.mark.parametrize(
    ("changes", "got"),
    [
        ({"prior": {"relative_std": 0.2}}, "link 1 that is a body"),
        ({"prior": {"towards": "published.yaml"}}, "give relative_std"),
        ({"prior": {**PUBLISHED, "relative_std": 0}}, "greater than 0"),
        ({"prior": {**PUBLISHED, "relative_std": {"joint3": 0.1}}}, "joint3"),
        ({"prior": {**PUBLISHED, "relative_std": {"elbow": 0.1}}}, "joint"),
        ({"prior": {**PUBLISHED, "towards": "nowhere.yaml"}}, "nowhere.yaml"),
        ({"prior": PUBLISHED, "estimator": {"kind": "didim", "finish": False}}, "takes no prior"),
        ({"prior": PUBLISHED, "estimator": {"kind": "idim_ls"}}, "takes no prior"),
    ],
)
def test_what_cannot_be_is_refused_with_the_case(changes: dict[str, Any], got: str) -> None:
    with pytest.raises(InputError, match=got):
        load_case(CASE).with_(**changes)


def test_values_in_other_frames_are_refused(tmp_path: Path) -> None:
    content = yaml.safe_load((CASE.parent / "published.yaml").read_text())
    content["joints"][1]["a"] = 0.2
    (tmp_path / "other.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=r"joint 2: a: 0\.2 instead of 0\.3"):
        load_case(CASE).with_(prior={**PUBLISHED, "towards": str(tmp_path / "other.yaml")})


def test_a_plant_without_description_has_no_prior() -> None:
    case = load_case(CASE)
    entries = {name: {"start": value} for name, value in zip(case.model.names, case.model.start, strict=True)}
    plain = {"robot": None, "identify": {"ZZ2": entries["ZZ2"]}, "plant": {"kind": "fmu", "source": "robot.yaml"}}
    with pytest.raises(InputError, match="about the base parameters of a robot description"):
        case.with_(**plain, estimator={"kind": "clie"}, prior={"relative_std": 0.2})


def test_what_is_left_open_is_told() -> None:
    """Nobody states the motor inertia of joint 1, which is a part of ZZ1R."""
    model = load_case(CASE).with_(prior={"towards": "published.yaml", "relative_std": 0.2}).model
    assert model.prior is not None
    assert dict(model.prior.open) == {"ZZ1R": ("Ia1",)}


@pytest.mark.slow
def test_discovery_leaves_it_out_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the advice of a result says, the case can be given to discover as it is: the data alone decide there."""
    asked: list[LoopModel] = []

    def base_model(model: LoopModel) -> None:
        asked.append(model)
        raise InputError("asked", next_step="Change it.")

    case = load_case(CASE).with_(prior=PUBLISHED)
    monkeypatch.setattr("fmu_didim.discovery.run.prepare", base_model)
    with pytest.raises(InputError, match="asked"):
        discover(case)
    assert case.model.prior is not None
    assert asked[0].prior is None
    monkeypatch.undo()
    found = discover(case, rounds=0).document
    assert WITHOUT_PRIOR in found.notes
    plain = discover(case.with_(prior=None), rounds=0).document
    assert WITHOUT_PRIOR not in plain.notes
    assert found.gap == plain.gap
