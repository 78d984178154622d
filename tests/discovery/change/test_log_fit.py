"""Effects fitted to one log, and gears, of which slopes say little."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from fmu_didim import Log, SimulationError, load_case, read_robot, simulate
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.beginning import FIRST_S
from fmu_didim.discovery.change import log_fit, worlds
from fmu_didim.discovery.change.difference import Difference
from fmu_didim.discovery.change.document import compared
from fmu_didim.discovery.change.log_fit import (
    Known,
    LogFit,
    at_best_minimum,
    fitted,
    gain,
    in_common,
    known,
    louder,
    not_widely_searched,
    settled,
    shared,
)
from fmu_didim.discovery.change.worlds import difference_of, may_be_gear
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import wide_search
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import BIC
from fmu_didim.dynamics.effects import EFFECTS, Effect
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import delta_bic
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.workflow.output.result import Result
from tests.discovery.change.pairs import CASE, NOISE, ROBOT, answer, identified, log_of

RATE = 20
BELT = {"K": 155.0, "D": 0.1}
"""[N.m/rad, N.m.s/rad] Of the motor of joint 2, whose inertia then swings at 14 Hz, beyond half of the rate."""
ROTOR = {"ZZ": 0.043, "Ia": 0.02}
GEARS = {name: EFFECTS[name] for name in ("joint_elasticity", "backlash", "controller_gain", "log_time_shift")}
SHIFT = EffectAtJoint("log_time_shift", 1)


@pytest.mark.parametrize(
    ("gear", "shown", "is_one"),
    [
        (("joint_elasticity", 2), ("backlash", 2), True),  # what it is confounded with
        (("joint_elasticity", 2), ("controller_gain", 2), True),
        (("backlash", 1), ("joint_elasticity", 1), True),
        (("joint_elasticity", 1), ("joint_elasticity", 2), True),  # a gear shows on its neighbours
        (("joint_elasticity", 1), ("backlash", 2), False),
        (("joint_elasticity", 1), ("controller_gain", 2), False),
        (("joint_elasticity", 2), ("torque_offset", 2), False),  # nothing to do with it
        (("backlash", 2), ("backlash", 2), False),  # itself
        (("actuator_lag", 2), ("joint_elasticity", 2), False),  # no gear: its own slope says what it is worth
    ],
)  # fmt: skip
def test_which_gears_an_effect_may_stand_for(gear: tuple[str, int], shown: tuple[str, int], is_one: bool) -> None:
    @dataclass(frozen=True)
    class Builder:
        def effect(self, at: EffectAtJoint) -> Effect:
            return EFFECTS[at.effect]

    assert may_be_gear(cast(LoopModelBuilder, Builder()), EffectAtJoint(*gear), EffectAtJoint(*shown)) is is_one


@pytest.mark.parametrize(
    ("misfits", "least", "kept"),
    [
        ({300.0: 0.5, 100.0: 0.7}, 1, [300.0, 100.0]),  # both nearer to the log than without the gear
        ({300.0: 0.9, 100.0: 0.7}, 1, [100.0, 300.0]),  # the nearest first
        ({300.0: 0.9, 100.0: 1.4}, 1, [300.0]),
        ({300.0: 2.0, 100.0: 1.4}, 1, [100.0]),  # an effect that is promised is fitted in any case
        ({300.0: 2.0, 100.0: 1.4}, 0, []),  # one for which another may stand is not
        ({300.0: np.inf, 100.0: 0.9}, 0, [100.0]),  # where the loop fails
    ],
)  # fmt: skip
def test_from_which_starts_a_gear_is_fitted(misfits: dict[float, float], least: int, kept: list[float]) -> None:
    """Misfits of the loop over that without the gear; each start stands for one shape."""

    @dataclass(frozen=True)
    class Loop:
        def misfit(self, proposal: Proposal | None = None) -> float:
            return 1.0 if proposal is None else misfits[proposal.values["K"]]

    @dataclass(frozen=True)
    class Side:
        competition: Loop

    starts = [Proposal(EffectAtJoint("joint_elasticity", 1), {"K": k}) for k in misfits]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(log_fit, "_sizes", lambda side, start: [start])
        found = log_fit._in_the_loop(cast(LogFit, Side(Loop())), starts, least=least)
    assert [start.values["K"] for start in found] == kept


@pytest.mark.parametrize(
    ("effect", "wide", "kept"),
    [
        ("backlash", (0.5, ""), "wide"),  # nearer to the log
        ("backlash", (1.5, ""), "narrow"),  # farther
        ("backlash", (0.5, "physically impossible"), "narrow"),
        ("backlash", None, "narrow"),  # it would take too long, or nothing there can be simulated
        ("controller_gain", (0.5, ""), "narrow"),  # an effect of one minimum is not looked for anew
    ],
)  # fmt: skip
def test_an_effect_of_many_minima_is_fitted_at_the_best(
    effect: str, wide: tuple[float, str] | None, kept: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sums of squares over that of the fit that is there."""

    builder = SimpleNamespace(effect=lambda at: EFFECTS[at.effect])
    side = cast(LogFit, SimpleNamespace(builder=builder, competition=None))
    fits = {name: SimpleNamespace(chi_square=size) for name, size in (("narrow", 1.0), ("wide", wide and wide[0]))}
    found = None if wide is None else SimpleNamespace(fit=fits["wide"], implausible=wide[1])
    monkeypatch.setattr(log_fit, "searched_widely", lambda *_, **__: found)
    best = at_best_minimum(side, cast(Fit, fits["narrow"]), EffectAtJoint(effect, 1), Progress())
    assert best is fits[kept]


def test_the_start_of_a_log_counts_for_nothing() -> None:
    """There a gear takes up its play, which leaves what looks like a second effect."""
    model = late_log().fit.model
    (label,) = model.estimation_labels
    experiment = model.experiments[label]
    assert experiment.time[0] >= experiment.reference.time[0] + FIRST_S
    assert experiment.time[0] < experiment.reference.time[0] + FIRST_S + 1 / RATE


@pytest.mark.parametrize(
    ("values", "deviations", "told"),
    [
        ({"gap": 0.01}, {"gap": 0.001}, True),
        ({"gap": 0.01}, {"gap": 0.006}, False),  # may be absent
        ({"position_gain": 1.5, "velocity_gain": 1.3}, {"position_gain": 0.14, "velocity_gain": 0.14}, True),
        ({"position_gain": 1.2, "velocity_gain": 1.1}, {"position_gain": 0.2, "velocity_gain": 0.2}, False),
        ({"position_gain": 1.0, "velocity_gain": 1.3}, {"position_gain": 0.2, "velocity_gain": 0.1}, True),  # one is
    ],
)  # fmt: skip
def test_an_effect_that_may_be_absent_by_the_noise_of_its_residual_is_no_cause(
    values: dict[str, float], deviations: dict[str, float], told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    neutral = {"gap": 0.0, "position_gain": 1.0, "velocity_gain": 1.0}
    free = [SimpleNamespace(key=f"{name}_1", effect=0, is_shape=False) for name in values]
    free.append(SimpleNamespace(key="K_1", effect=0, is_shape=True))  # whatever its shapes are
    gear = EffectAtJoint("any", 1)
    model = SimpleNamespace(added_effects=(gear,), free_parameters=free)
    fit = SimpleNamespace(model=model, values=np.array([*values.values(), 1e4]))
    covariance = np.diag(np.square([*deviations.values(), 1e5]))
    monkeypatch.setattr(worlds, "fit_uncertainty", lambda fit: SimpleNamespace(covariance=covariance))
    side = SimpleNamespace(builder=SimpleNamespace(effect=lambda at: SimpleNamespace(neutral=neutral)))
    assert worlds._is_told(cast(LogFit, side), cast(Fit, fit), gear) is told


@pytest.mark.parametrize(
    ("loud", "too_long", "named", "told"),
    [
        (({1}, set()), True, set(), True),
        (({1}, {1}), True, set(), True),  # once
        (({1}, set()), False, set(), False),  # it was searched
        ((set(), set()), True, set(), False),  # and not asked
        (({1}, set()), True, {"backlash"}, False),  # it was found all the same
    ],
)  # fmt: skip
def test_play_that_was_not_searched_in_its_whole_range_is_told(
    loud: tuple[set[int], set[int]], too_long: bool, named: set[str], told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_fit, "louder", lambda sides: loud)
    monkeypatch.setattr(wide_search, "takes_too_long", lambda *_: too_long)
    fit = SimpleNamespace(model=SimpleNamespace(added_effects=()))
    candidates = [EffectAtJoint("backlash", 1), EffectAtJoint("torque_offset", 1)]
    side = SimpleNamespace(
        builder=SimpleNamespace(effect=lambda at: EFFECTS[at.effect]), fit=fit, candidates=lambda: candidates
    )
    notes = not_widely_searched(cast(tuple[LogFit, LogFit], (side, side)), named)
    assert [note.startswith("Backlash was looked for on joint 1 from a few starts") for note in notes] == [True] * told


@pytest.mark.parametrize(
    ("sizes", "loud"),
    [
        (((1.0, 1.0), (1.3, 1.0)), (set(), {1})),
        (((1.3, 1.0), (1.0, 1.3)), ({1}, {2})),
        (((1.0, 1.0), (1.05, 0.95)), (set(), set())),  # noise
    ],
)  # fmt: skip
def test_which_joints_have_a_larger_residual_in_one_log(
    sizes: tuple[tuple[float, float], ...], loud: tuple[set[int], set[int]]
) -> None:
    """Residuals of 400 samples and no value fitted."""
    rng = np.random.default_rng(8)
    noise = rng.normal(size=(2, 400, 2))
    noise /= np.sqrt(np.mean(noise**2, axis=1, keepdims=True))
    sides = [
        SimpleNamespace(fit=SimpleNamespace(residual=n * s, values=np.zeros(0)))
        for n, s in zip(noise, sizes, strict=True)
    ]
    assert louder(cast(tuple[LogFit, LogFit], tuple(sides))) == loud


@pytest.mark.parametrize(
    ("soft", "other", "chi_square"),
    [
        ((143.0, 14.0), (1510.0, 2000.0), (30.0, 35.0)),  # slack in one log, and hardly anything in the other
        ((143.0, 14.0), (150.0, 15.0), (0.0, 1.0)),  # in both
        ((143.0, 14.0), (100.0, 7.0), (7.0, 9.5)),  # grown
        ((143.0, 14.0), (1e5, 1e6), (100.0, 105.0)),  # none
    ],
)  # fmt: skip
def test_stiffnesses_are_compared_as_compliances(
    soft: tuple[float, float], other: tuple[float, float], chi_square: tuple[float, float]
) -> None:
    """Of a gear that hardly gives way the stiffness may be anything: a stiffness of 143 would be one of 1510 ± 2000."""
    base = Difference(("a",), ("N.m",), np.zeros(1), np.zeros(1), np.eye(1), np.inf, 1000)
    sides = [
        Known(("a", "K_2"), np.array([0.0, value]), np.diag([1.0, spread**2])) for value, spread in (soft, other)
    ]  # fmt: skip
    found = difference_of(base, sides[0], sides[1], units=["N.m/rad"], stiff=frozenset({"K_2"}))
    assert (found.names, found.units) == (("a", "1/K_2"), ("N.m", "1/(N.m/rad)"))
    assert chi_square[0] <= found.total <= chi_square[1]


@cache
def late_log(seed: int = 21, late_s: float = 0.01) -> LogFit:
    """Of a clock that is late, by 10 ms where nothing is said, beside which there is nothing."""
    found = identified(log_of(float(RATE), seed, late_s=late_s))
    return LogFit.of(found.model, read_robot(ROBOT), GEARS)


@cache
def shifted() -> Fit:
    found = fitted(late_log(), [Proposal(SHIFT, {"log_shift": 0.008})])
    assert found is not None
    return found


def test_a_second_effect_counts_by_the_colour_of_what_both_leave() -> None:
    """Else all that the first one explains counts anew, because what is left is a little less coloured."""
    noise, slow = np.random.default_rng(5).normal(size=(400, 1)), np.sin(np.linspace(0, 40, 400))[:, None]
    floor = Noise(np.ones(1), np.zeros(1), "residual")

    def left(part: float) -> Fit:
        model = SimpleNamespace(experiments=SimpleNamespace(channels=()), prior=None)
        return cast(Fit, SimpleNamespace(model=model, values=np.zeros(0), residual=part * slow + noise, noise=floor))

    nothing, first, both = left(30.0), left(0.6), left(0.4)
    side = LogFit(nothing, cast(LoopModelBuilder, None))
    step = gain(side, both, first) - gain(side, first)
    assert step == pytest.approx(delta_bic(first.residual, both.residual, 0.0, floor))
    assert 0 < step < 0.25 * (gain(side, both) - gain(side, first))


@pytest.mark.gate
@pytest.mark.parametrize(("late_s", "excludes"), [(0.01, False), (0.0, True)])
def test_a_log_is_asked_whether_it_excludes_what_another_one_shows(late_s: float, excludes: bool) -> None:
    """Whether its clock is late as well, by as much as the other log knows it is."""
    side, there = late_log(22, late_s), shifted()
    assert shared(there) == frozenset()
    found = in_common(side, there, SHIFT)
    assert found is not None
    assert shared(found) == {"log_shift"}
    values = [fit.values[fit.model.names.index("log_shift")] for fit in (there, found)]
    variances = [known(fit, ["log_shift"]).covariance[0, 0] for fit in (there, found)]
    pulled = late_s + (values[0] - late_s) * variances[1] / variances[0]  # towards what the other log knows
    assert abs(values[1] - pulled) < 3 * variances[1] ** 0.5 < 0.003
    off = (values[0] - values[1]) / variances[0] ** 0.5
    free = fitted(side, [Proposal(SHIFT, {"log_shift": 0.008})])
    if excludes:
        assert gain(side, found) < -(off**2) + 20 < -BIC
    else:
        assert free is not None
        assert gain(side, found) > gain(side, free) - off**2 - 1
        assert off**2 < 10


@pytest.mark.gate
def test_a_loop_that_fails_on_the_way_of_one_fit_loses_that_start_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    side, whole = gear_log(slack=True), Competition.refit

    def fails(own: Competition, proposal: Proposal, **options: object) -> Fit | None:
        if proposal.values["K"] > BELT["K"]:
            raise SimulationError("The loop diverges.", got="inf", next_step="Try others.")
        return whole(own, proposal, **options)  # type: ignore[arg-type]

    gear = EffectAtJoint("joint_elasticity", 2)
    starts = [Proposal(gear, {"K": k}) for k in (300.0, 100.0)]
    monkeypatch.setattr(log_fit, "_in_the_loop", lambda side, starts, least: starts)
    monkeypatch.setattr(Competition, "refit", fails)
    found = fitted(side.log, starts)
    assert found is not None
    assert abs(found.values[found.model.names.index("K_2")] / BELT["K"] - 1) < 0.2
    assert fitted(side.log, starts[:1]) is None


@pytest.mark.gate
def test_a_fit_that_fails_on_the_way_to_its_end_stays_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> Fit:
        raise SimulationError("The loop diverges.", got="inf", next_step="Try others.")

    found = shifted()
    monkeypatch.setattr(log_fit, "minimise", fails)
    assert settled(found) is found
    assert settled(None) is None


@dataclass(frozen=True)
class Side:
    """A result of the SCARA with a rotor on joint 2, and its log with its loop."""

    result: Result
    log: LogFit


@cache
def gear_log(*, slack: bool, late_s: float = 0.0) -> Side:
    robot = read_robot(ROBOT)
    first, second = robot.joints
    second = second.model_copy(update={"parameters": {**second.parameters, **ROTOR}})
    stiff = robot.model_copy(
        update={
            "joints": (first, second),
            "identified": {**dict(cast("dict[str, str]", robot.identified)), "Ia2": "Ia2"},
        }
    )
    true = stiff
    if slack:
        loose = {"effects": (*second.effects, "joint_elasticity"), "parameters": {**second.parameters, **BELT}}
        true = stiff.model_copy(update={"joints": (first, second.model_copy(update=loose))})
    table = simulate(load_case(CASE).with_(), robot=true)
    rows = slice(0, table.time.size - 1, round(1 / RATE / (table.time[1] - table.time[0])))
    instants = table.time[rows] - late_s
    torque = np.column_stack([np.interp(instants, table.time, table.column(f"tau{j}")) for j in (1, 2)])
    noise = NOISE * np.random.default_rng(31 + slack).normal(size=torque.shape)
    found = identified(Log(table.time[rows], torque + noise), robot=stiff)
    return Side(found, LogFit.of(found.model, stiff, GEARS))


@pytest.mark.gate
@pytest.mark.parametrize(("late_s", "told"), [(0.0, 1), (0.01, 2)])
def test_a_slack_belt_at_a_low_rate_is_named_alone_and_beside_a_late_clock(late_s: float, told: int) -> None:
    """Its slope, of a gear that is stiff, promises less than play, or a gain of the controller. Beside a late clock the
    log does not tell which of the two gears has become slack, and both are told."""
    before, after = gear_log(slack=False), gear_log(slack=True, late_s=late_s)
    found = compared(answer("before", before.result), answer("after", after.result), (before.log, after.log))
    late = {"time shift of the torque log, new"} if late_s else set()
    titles = [{part.title for part in cause.parts} for cause in found.causes]
    assert {"joint elasticity on joint 2, new"} | late in titles
    assert len(titles) <= told
    cause = found.causes[titles.index({"joint elasticity on joint 2, new"} | late)]
    stiffness = next(a for part in cause.parts for a in part.amounts if a.name == "K")
    assert stiffness.std is not None
    assert abs(stiffness.value - BELT["K"]) < 4 * stiffness.std
