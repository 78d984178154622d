"""Discovery from several experiments: fitted to all that are for the estimation, judged by all that are held out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import discover
from fmu_didim.data.tables import read_trajectory
from fmu_didim.discovery.external_torques.fit import find_external_torques
from fmu_didim.discovery.external_torques.search import linear_external_torques, step_response
from fmu_didim.fit.gap import held_out_ratio
from fmu_didim.model.external_torque import ExternalTorque
from fmu_didim.results.findings import FindingsDocument
from tests.discovery.helpers import TRUTH, Run, arm_experiments, base_of, sines

FRICTION = {"quadratic_viscous": {"Fq": 0.3}}
FAST = {"slow": Run(16.0, 1), "fast": Run(4.0), "slow_held": Run(14.0, 1, "validation"),
        "fast_held": Run(4.4, role="validation")}  # fmt: skip
"""Friction that grows with the square of the speed hardly shows in slow motions: they are four times as slow."""


def named(document: FindingsDocument) -> list[tuple[str, int]]:
    return [(f.effect, f.joint) for f in document.findings]


# ---- fitted to all, judged by all ------------------------------------------------------------------


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FindingsDocument]:
    folder = tmp_path_factory.mktemp("two")
    return folder, discover(arm_experiments(folder, FAST, FRICTION), folder / "out")


@pytest.mark.slow
def test_an_effect_that_one_of_two_experiments_shows_is_found(found: tuple[Path, FindingsDocument]) -> None:
    document = found[1]
    assert document.answer == "named"
    assert named(document) == [("quadratic_viscous", 1)]
    (value,) = document.findings[0].parameters
    assert value.value == pytest.approx(0.3, abs=4 * value.std)  # type: ignore[operator]
    assert value.std < 0.02  # type: ignore[operator]
    base = {p.name: p for p in document.base_parameters}
    for name in ("ZZ", "MX", "MY", "Fv", "Fc"):
        p = base[f"{name}1"]
        assert p.value == pytest.approx(TRUTH[0][name], abs=4 * p.std), name  # type: ignore[operator]


@pytest.mark.slow
def test_each_experiment_is_told_with_its_role_and_its_gap(found: tuple[Path, FindingsDocument]) -> None:
    document = found[1]
    assert document.roles == {label: run.role for label, run in FAST.items()}
    assert set(document.gap) == set(document.error_percent) == set(document.findings[0].gap) == set(FAST)
    for label in FAST:  # a tenth more or less of what is taken for the noise is a gap of 0.45
        assert (document.gap[label].before > 0.45) == label.startswith("fast"), label  # type: ignore[operator]
    assert all(gap.after < 0.35 for gap in document.gap.values())  # type: ignore[operator]


@pytest.mark.gate
def test_files_hold_every_experiment(found: tuple[Path, FindingsDocument]) -> None:
    folder, document = found
    for label in FAST:
        table = read_trajectory(folder / "out" / document.files[f"signals_{label}"])
        rest = table.select(["measured1"]) - table.select(["final1"])
        assert np.std(rest) == pytest.approx(0.1, rel=0.15), label
    (note,) = [n for n in document.notes if "augmented case" in n]
    assert float(note.split(" of its peak")[0].split()[-1]) < 2e-3
    again = discover(folder / "out" / document.files["case"])
    assert again.answer == "nothing"
    assert again.roles == document.roles


@pytest.mark.gate
def test_slow_motions_alone_do_not_show_it(tmp_path: Path) -> None:
    runs = {label: run for label, run in FAST.items() if "slow" in label}
    assert named(discover(arm_experiments(tmp_path, runs, FRICTION))) == []


@pytest.mark.gate
def test_regions_are_those_of_all_experiments_together(found: tuple[Path, FindingsDocument]) -> None:
    """Where the slow motion does not go, as well: the largest speeds are those of the fast one."""
    speeds = [r for r in found[1].regions if r.quantity == "velocity"]
    slow, fast = (np.abs(sines(p, period_s=p).select(["dq1"])).max() for p in (16.0, 4.0))
    assert max(r.high for r in speeds) > 2 * slow
    assert max(max(abs(r.low), abs(r.high)) for r in speeds) == pytest.approx(fast, rel=0.05)


@pytest.mark.gate
def test_the_ratio_of_the_held_out_data_is_that_of_all_of_them(tmp_path: Path) -> None:
    """The root of the mean square over the samples of both, so that the longer one counts more."""
    before = base_of(arm_experiments(tmp_path, FAST, FRICTION))
    values = before.values * 1.05
    after = replace(before, model=before.model.with_values(values), values=values)
    ratio = held_out_ratio(before, after)
    squares = [
        sum(float(np.sum(before.model.residual(v, label) ** 2)) for label in ("slow_held", "fast_held"))
        for v in (values, before.values)
    ]
    assert ratio is not None
    assert ratio.value == pytest.approx(np.sqrt(squares[0] / squares[1]), rel=1e-9)


@pytest.mark.slow
def test_an_effect_that_fails_on_one_of_the_held_out_experiments_is_refused(tmp_path: Path) -> None:
    """The held-out run of higher speed has no such friction; without it the effect would be named."""
    runs = {"one": Run(5.0), "other": Run(4.0), "held": Run(4.4, role="validation"),
            "changed": Run(3.4, role="validation", has_effects=False)}  # fmt: skip
    forbid = ("power_viscous", "cubic_viscous", "viscous")
    document = discover(arm_experiments(tmp_path / "both", runs, FRICTION), forbid=forbid)
    assert "quadratic_viscous" not in {f.effect for f in document.findings}
    assert any(effect == "quadratic_viscous" and "held-out" in why for effect, _, why in document.refused)
    del runs["changed"]
    alone = discover(arm_experiments(tmp_path / "one", runs, FRICTION), forbid=forbid)
    assert named(alone) == [("quadratic_viscous", 1)]


# ---- torques from outside --------------------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize("pushed", [pytest.param("one", marks=pytest.mark.slow), "other"])
def test_a_push_is_found_in_its_experiment(tmp_path: Path, pushed: str) -> None:
    push = ExternalTorque(1, 2.3137, 2.9512, 4.0)
    runs = {
        label: Run(period, pushes=(push,) if label == pushed else ())
        for label, period in (("one", 4.0), ("other", 4.4))
    }
    runs |= {"held": Run(3.8, role="validation"), "held_too": Run(4.2, role="validation")}
    document = discover(arm_experiments(tmp_path, runs))
    assert named(document) == [("external_force", 1)]
    (window,) = document.windows
    assert (window.experiment, window.joint) == (pushed, 1)
    assert window.begin_s == pytest.approx(push.begin_s, abs=0.005)
    assert window.end_s == pytest.approx(push.end_s, abs=0.005)
    assert window.torque == pytest.approx(push.torque, rel=0.05)
    assert document.noise.std == pytest.approx([0.1], rel=0.1)
    assert all(gap.after < 0.2 * gap.before for gap in document.gap.values())  # type: ignore[operator]


@pytest.mark.gate
def test_pushes_are_told_apart_by_their_experiment(tmp_path: Path) -> None:
    """To first order a push explains nothing of an experiment in which it does not act, where there is no gap."""
    push = ExternalTorque(1, 2.3, 2.9, 4.0)
    fit = base_of(arm_experiments(tmp_path, {"one": Run(4.0), "other": Run(5.0, pushes=(push,))}))
    shares = {}
    for label in ("one", "other"):
        response = step_response(fit, label, 1)
        assert response is not None
        found = linear_external_torques(fit, label, 1, response, False)
        shares[label] = 0.0 if found is None else found[0]
    assert shares["other"] == pytest.approx(1.0, abs=0.02)
    assert 0.0 <= shares["one"] < 0.5


@pytest.mark.gate
def test_noise_beside_a_push_is_that_of_all_experiments(tmp_path: Path) -> None:
    """Each experiment repeats with a period of its own, by which it is compared."""
    push = ExternalTorque(1, 2.3137, 2.9512, 4.0)
    fit = base_of(arm_experiments(tmp_path, {"one": Run(4.0, 4), "other": Run(5.0, 4, pushes=(push,))}))
    torques = find_external_torques(fit)
    assert torques is not None
    assert torques.label == "other"
    assert torques.fit.noise.periods == 8
    assert torques.fit.noise.deviation == pytest.approx([0.1], rel=0.05)


@pytest.mark.gate
@pytest.mark.parametrize("label", ["one", "other"])
def test_a_torque_that_comes_back_with_the_motion_of_its_experiment_is_no_push(tmp_path: Path, label: str) -> None:
    """Each experiment has a period of its own."""
    periods = {"one": 4.0, "other": 5.0}
    again = tuple(ExternalTorque(1, 2.3 + periods[label] * k, 2.9 + periods[label] * k, 4.0) for k in range(3))
    runs = {name: Run(period, 3, pushes=again if name == label else ()) for name, period in periods.items()}
    fit = base_of(arm_experiments(tmp_path, runs))
    assert find_external_torques(fit) is None


# ---- parameters of one experiment ------------------------------------------------------------------

PAYLOAD = {"ZZ1": 1.2 + 0.5 * 0.6**2, "MX1": 0.8 + 0.5 * 0.6}
"""With half a kilogram 0.6 m from the axis."""


def loaded(*own: str) -> dict[str, Run]:
    return {
        "empty": Run(4.0), "loaded": Run(4.4, own=own, base=PAYLOAD),
        "held": Run(3.8, role="validation"), "held_too": Run(4.2, role="validation"),
    }  # fmt: skip


@pytest.mark.gate
def test_a_payload_of_one_experiment_is_no_effect(tmp_path: Path) -> None:
    document = discover(arm_experiments(tmp_path, loaded("ZZ1", "MX1", "MY1")))
    assert (document.answer, document.findings) == ("nothing", [])
    base = {p.name: p for p in document.base_parameters}
    truth = {f"{name}1": TRUTH[0][name] for name in ("ZZ", "MX", "MY", "Fv", "Fc")}
    truth |= {f"{name}[loaded]": value for name, value in PAYLOAD.items()} | {"MY1[loaded]": TRUTH[0]["MY"]}
    for name, value in truth.items():
        assert base[name].value == pytest.approx(value, abs=4 * base[name].std), name  # type: ignore[operator]
    assert base["ZZ1[loaded]"].value - base["ZZ1"].value == pytest.approx(0.18, abs=0.03)


@pytest.mark.slow
def test_the_same_payload_shared_by_all_experiments_leaves_a_gap(tmp_path: Path) -> None:
    document = discover(arm_experiments(tmp_path, loaded()))
    assert document.answer != "nothing"
    assert min(document.gap[label].before for label in ("empty", "loaded")) > 1.0  # type: ignore[type-var]
