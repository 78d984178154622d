"""An elastic gear that hardens, named by discovery; what it is not taken for, and what is not taken for it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import discover, simulate
from fmu_didim.data.tables import read_trajectory
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.plausible import MAY_BE_ABSENT
from fmu_didim.dynamics.robot import read_robot
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.results.findings import FindingsDocument
from tests.discovery.helpers import arm_case, base_of

GEAR = {"K": 1500.0, "motor_share": 0.4}
PLAY = {**GEAR, "gap": 0.004, "D": 2.0}
HARDER = {"K_cubic": 2e6}
"""At the largest twist of the arm, 0.01 rad, an eighth of the torque of the gear."""
MUCH_HARDER = {"K_cubic": 2e7}
HARDENING = EffectAtJoint("gear_hardening", 1)
Truth = Mapping[str, Mapping[str, float]]


def found_of(folder: Path, truth: Truth, gear: Mapping[str, float] | None = None) -> FindingsDocument:
    """What is found of an arm with these effects, of which the description has the gear, or nothing."""
    return discover(arm_case(folder, truth, gear=gear, sigma=0.05)).document


def named(document: FindingsDocument) -> list[tuple[str, int]]:
    return [(f.effect, f.joint) for f in document.findings]


def within(document: FindingsDocument, effect: str, truth: Mapping[str, float], part: float = 0.1) -> None:
    """A finding has these values within 3 sigma, and they are known to a part of them."""
    values = {p.name: p for f in document.findings if f.effect == effect for p in f.parameters}
    for name, value in truth.items():
        one = values[f"{name}_1"]
        assert one.std is not None
        assert abs(one.value - value) < 3 * one.std, name
        assert one.std < part * abs(value), name


@pytest.mark.gate
def test_hardening_of_a_gear_that_is_known_to_give_way(tmp_path: Path) -> None:
    """Beside the right name: the files of the answer give the torque that was fitted, the plant as an FMU."""
    case, out = arm_case(tmp_path, {"gear_hardening": HARDER}, gear=GEAR, sigma=0.05), tmp_path / "out"
    document = discover(case, out).document
    assert named(document) == [("gear_hardening", 1)] and document.findings[0].ambiguous == []
    within(document, "gear_hardening", HARDER)
    joint = read_robot(out / document.files["robot"]).joints[0]
    assert joint.effects[-2:] == ("joint_elasticity", "gear_hardening")
    assert joint.parameters["K_cubic"] == pytest.approx(document.findings[0].parameters[0].value)
    table = read_trajectory(out / document.files["signals_estimation"])
    wanted, simulated = table.select(["final1"])[:, 0], simulate(out / document.files["case"], experiment="estimation")
    at = np.round((table.time - simulated.time[0]) * 200).astype(int)
    assert np.abs(simulated.select(["tau1"])[at, 0] - wanted).max() < 2e-3 * np.abs(wanted).max()


@pytest.mark.gate
def test_a_gear_thought_rigid_that_hardens_is_no_play(tmp_path: Path) -> None:
    """Beside the base alone play may explain more than an elastic gear, and of the gear's gap hardening is but one per
    cent: it is named all the same, for without it the stiffness is wrong."""
    document = found_of(tmp_path, {"joint_elasticity": GEAR, "gear_hardening": HARDER})
    assert named(document) == [("joint_elasticity", 1), ("gear_hardening", 1)]
    within(document, "joint_elasticity", GEAR)
    within(document, "gear_hardening", HARDER)
    assert document.verdict == "valid" and not any(f.ambiguous for f in document.findings)


@pytest.mark.slow
def test_play_and_hardening_are_told_apart_where_both_are_there(tmp_path: Path) -> None:
    document = found_of(tmp_path, {"backlash": PLAY, "gear_hardening": MUCH_HARDER})
    assert named(document) == [("backlash", 1), ("gear_hardening", 1)]
    within(document, "backlash", PLAY)
    within(document, "gear_hardening", MUCH_HARDER)


@pytest.mark.slow
@pytest.mark.parametrize("gear", [{"joint_elasticity": GEAR}, {"backlash": PLAY}], ids=["elastic", "play"])
def test_a_gear_that_does_not_harden_is_not_said_to(tmp_path: Path, gear: Truth) -> None:
    document = found_of(tmp_path, gear)
    assert named(document) == [(name, 1) for name in gear]
    for name, values in gear.items():
        within(document, name, values)


@pytest.mark.slow
def test_a_gear_that_softens_is_doubted(tmp_path: Path) -> None:
    """No gear does: whatever else is named in the place of that is doubted, and why hardening is not named is told."""
    document = found_of(tmp_path, {"gear_hardening": {"K_cubic": -2e6}}, GEAR)
    assert "gear_hardening" not in {f.effect for f in document.findings}
    assert document.verdict == "doubtful"
    (reason,) = [why for effect, _, why in document.refused if effect == "gear_hardening"]
    assert reason.startswith("physically impossible: K_cubic = -") and reason.endswith("below 0")


def fitted(folder: Path, gear: Mapping[str, float], truth: Truth) -> FittedCandidate:
    """Hardening fitted beside a known gear."""
    base = base_of(arm_case(folder, truth, gear=gear, sigma=0.05))
    builder = LoopModelBuilder(base.model, read_robot(folder / "robot.yaml"))
    competition = Competition(builder, base)
    fit = competition.refit(Proposal(HARDENING, HARDER))
    assert fit is not None
    return competition.assess(HARDENING, fit)


def value_of(candidate: FittedCandidate) -> tuple[float, float]:
    """K_cubic and its standard deviation."""
    place = candidate.fit.model.names.index("K_cubic_1")
    return float(candidate.fit.values[place]), float(np.sqrt(candidate.fit.covariance[place, place]))


@pytest.mark.gate
def test_where_a_gear_is_hardly_twisted_its_interval_says_so(tmp_path: Path) -> None:
    """The same cube in a gear ten times as stiff is a ten-thousandth of its torque: any value fits, none is named."""
    told = fitted(tmp_path / "soft", GEAR, {"gear_hardening": HARDER})
    value, deviation = value_of(told)
    assert abs(value - 2e6) < 3 * deviation < 0.2 * 2e6 and not told.implausible
    untold = fitted(tmp_path / "stiff", {**GEAR, "K": 15000.0}, {"gear_hardening": HARDER})
    value, deviation = value_of(untold)
    assert abs(value - 2e6) < 3 * deviation and deviation > 2e6
    assert untold.implausible.startswith(MAY_BE_ABSENT)
