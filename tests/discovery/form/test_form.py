"""The form of what has no name: the curve, what it takes back, and what it leaves alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import discover
from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.form import names as form
from fmu_didim.discovery.form.curve import FoundCurve, _Beside
from fmu_didim.discovery.form.names import FORM_DIFFERS, Forms, imitates, with_curves
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.discovery.selection.rounds import Discovery
from fmu_didim.dynamics.effects import EFFECTS, Curve
from fmu_didim.dynamics.effects.curve import LETTERS
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.gap import Ratio
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.results.findings import load_findings
from tests.discovery.by_hand import candidate_of
from tests.discovery.helpers import blind_case
from tests.tools.blind.curves import hidden_function, planted_function, within_band

# ---- on data of an independent simulator


@pytest.mark.gate
@pytest.mark.parametrize(
    ("effect", "seed", "variable", "within"),
    [
        pytest.param("unknown_hump", 5, "the velocity of the joint", 0.9, marks=pytest.mark.slow),
        pytest.param("unknown_detent", 5, "the position of the joint", 0.9, marks=pytest.mark.slow),
        pytest.param("unknown_swell", 6, "the time", 0.9, marks=pytest.mark.slow),
        pytest.param("unknown_neighbour", 5, "the position of the neighbour", 0.9, marks=pytest.mark.slow),
        pytest.param("unknown_reversal", 3, "the distance since the last reversal", 0.9, marks=pytest.mark.slow),
    ],
)
def test_what_no_effect_explains_is_drawn_as_a_curve(
    tmp_path: Path, effect: str, seed: int, variable: str, within: float
) -> None:
    """Effects that together imitate it lose their names; the curve is the function that is hidden."""
    case = blind_case(tmp_path / "case", (effect,), seed=seed, level=2.0)
    found = discover(case, tmp_path / "out").document
    _, hidden_variable, joint, function = hidden_function(tmp_path / "case", tmp_path / "case.truth.yaml")
    assert found.answer == "unknown" and not found.findings
    (curve,) = found.curves
    assert (curve.joint, curve.variable) == (joint, variable) == (joint, hidden_variable)
    planted = planted_function(tmp_path / "case.truth.yaml", joint, variable)
    assert within_band(curve.model_dump(), function, planted) >= within
    assert curve.share_of_gap > 0.85
    assert curve.ratio_interval is not None and curve.ratio_interval[1] < 1.0
    for taken, _ in curve.instead_of:
        assert any(name == taken and "a curve of" in why for name, _, why in found.refused)
    # Its robot has the curve as an effect, whose torque is the one that is drawn, and is an FMU.
    robot = read_robot(tmp_path / "out" / found.files[f"curve_robot_{joint}"])
    assert curve.effect in robot.joints[joint - 1].effects
    assert RobotModel(robot).joint_count == len(found.torque_unit)
    assert (tmp_path / "out" / found.files[f"curve_fmu_{joint}"]).is_file()
    table = np.loadtxt(tmp_path / "out" / found.files[f"curve_{joint}"], delimiter=",", skiprows=1)
    np.testing.assert_allclose(table, np.column_stack([curve.at, curve.torque, curve.half_width]), rtol=1e-6, atol=1e-9)
    assert load_findings(tmp_path / "out").curves == found.curves
    page = (tmp_path / "out" / "discovery.html").read_text(encoding="utf-8")
    assert "The form of what has no name" in page


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("effects", "seed", "are_there"),
    [(("unknown_notch",), 623, False), (("torque_offset", "torque_ripple"), 613, True)],
)
def test_held_out_data_tell_imitators_from_effects_that_are_there(
    tmp_path: Path, effects: tuple[str, ...], seed: int, are_there: bool
) -> None:
    """At 20 Hz a curve explains 1.09 times as much as a stop and a constant in the place of a notch, and 1.03 times as
    much as a constant and a ripple that are hidden: these predict better."""
    case = blind_case(
        tmp_path / "case", effects, seed=seed, level=1.5, rate_hz=20, clutter=True, robots="varied", one_joint=True
    )
    found = discover(case).document
    (curve,) = found.curves
    if are_there:
        assert {item.effect for item in found.findings} == set(effects)
        assert not curve.instead_of and found.verdict == "doubtful"
        (doubt,) = [one for one in found.reasons if one.code == "form-differs"]
        assert "the held-out RMS with it is 1.0" in doubt.text
        return
    assert found.answer == "unknown" and not found.findings and len(curve.instead_of) > 1
    for name, joint in curve.instead_of:
        (why,) = [why for taken, at, why in found.refused if (taken, at) == (name, joint) and "a curve of" in why]
        assert "explains more" in why and "the held-out RMS with it is 0.9" in why


# ---- least squares of splines beside a model


def beside(base: np.ndarray, deviation: float) -> _Beside:
    weight = np.array([1 / deviation])
    return _Beside(BaseProjection.of(base[:, None, :], weight), weight, (base.shape[0], 1))


@pytest.mark.parametrize(
    ("function", "count"),
    [
        pytest.param(lambda x: np.exp(-((x / 0.3) ** 2)), (7.0, 9.0), id="notch"),
        pytest.param(lambda x: (x - 0.2) / 0.2 / (1 + ((x - 0.2) / 0.2) ** 2), (8.0, 11.0), id="detent"),
        pytest.param(lambda x: np.exp(-((x - 0.1) ** 2)), (2.0, 7.5), id="swell"),
        pytest.param(lambda x: 0.0 * x, (0.0, 3.0), id="nothing"),
    ],
)
def test_the_interval_of_a_curve_beside_a_model_holds_it(
    function: Callable[[np.ndarray], np.ndarray], count: tuple[float, float]
) -> None:
    """Monte Carlo: over the range, 95 % of a narrow and of a wide function lie within the interval, what was smoothed
    counted; the wider takes fewer parameters, and what the model makes is in no curve."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.0, 1.0, 400)
    curve = EFFECTS["curve_of_position"]
    assert isinstance(curve, Curve)
    columns = curve.basis(x, -1.0, 1.0)[:, None, :]
    base = np.column_stack([np.ones_like(x), x])
    one, at = beside(base, 0.3), np.linspace(-0.95, 0.95, 39)
    shown, line = curve.basis(at, -1.0, 1.0), np.column_stack([np.ones_like(at), at])
    inside, counts = [], []
    for _ in range(200):
        target = function(x) + base @ rng.normal(scale=5.0, size=2) + rng.normal(scale=0.3, size=x.size)
        sizes, covariance, effective = one.solved(columns, target[:, None])
        half = 1.96 * np.sqrt(np.einsum("ij,jk,ik->i", shown, covariance, shown))
        off = function(at) - shown @ sizes
        off = off - line @ np.linalg.lstsq(line / half[:, None], off / half, rcond=None)[0]
        inside.append(np.mean(np.abs(off) <= half))
        counts.append(effective)
    assert 0.93 <= np.mean(inside) <= 0.995
    assert count[0] <= np.mean(counts) <= count[1]


def test_the_splines_are_those_of_the_effect() -> None:
    """All amplitudes equal make a constant, also beyond the range."""
    curve = EFFECTS["curve_of_time"]
    assert isinstance(curve, Curve)
    table = curve.basis(np.linspace(-3.0, 9.0, 50), 0.0, 6.0)
    np.testing.assert_allclose(table.sum(axis=1), 1.0, rtol=1e-12)
    assert curve.shape_values(0.0, 6.0) == {"tfrom": 0.0, "tto": 6.0}


def test_curves_are_never_proposed_as_an_explanation() -> None:
    curves = [effect for effect in EFFECTS.values() if isinstance(effect, Curve)]
    assert len(curves) == 6 and not any(effect.is_proposed for effect in curves)


def test_a_curve_takes_the_name_that_its_user_gives_it(tmp_path: Path) -> None:
    """As the page says: a class that inherits from it, listed in its place."""
    values = {f"cx{letter}": 0.1 * k for k, letter in enumerate(LETTERS)} | {"xfrom": -1.0, "xto": 2.0}
    (tmp_path / "cable.py").write_text(
        "from fmu_didim.dynamics.effects.curve_of_position import CurveOfPosition\n\n\n"
        "class CableDrag(CurveOfPosition):\n    name = 'cable_drag'\n    title = 'Drag of the cable'\n"
    )
    torques = []
    for name in ("curve_of_position", "cable.py:CableDrag"):
        joint = {"type": "revolute", "effects": ["viscous", name], "parameters": {"ZZ": 1.0, "Fv": 0.5, **values}}
        (tmp_path / "robot.yaml").write_text(yaml.safe_dump({"schema": 1, "name": "arm", "joints": [joint]}))
        robot = RobotModel(read_robot(tmp_path / "robot.yaml"))
        torques.append(robot.inverse([0.7], [0.3], [1.0], robot.parameter_values, robot.shape_values).full().item())
    plain = 1.0 + 0.5 * 0.3
    assert torques[0] == torques[1]
    assert torques[0] - plain == pytest.approx(0.1 * (17 * 1.7 / 3 + 1), rel=1e-12)  # a line


# ---- decisions, by hand


@pytest.mark.parametrize(
    ("are_external", "gap", "lead", "predicts_better", "taken"),
    [
        ([False], 0.5, 2.0, None, False),
        ([False], 0.7, 1.45, None, False),
        ([False], 0.7, 1.55, None, True),
        ([False], 0.7, 1.55, True, True),
        ([False], 0.7, 1.55, False, False),  # a ripple beside another one
        ([False], 0.7, 1.45, True, False),
        ([False], 0.5, 2.0, True, False),
        ([True], 0.1, 1.35, None, True),
        ([True], 0.1, 1.35, False, True),
        # Several: by far, where held-out data do not tell.
        ([False, False], 0.1, 1.25, None, True),
        ([False, False], 0.7, 1.15, None, False),
        ([False, True, False], 2.0, 1.25, None, True),
        ([False, False], 0.1, 1.01, True, True),
        ([False, False], 0.1, 0.99, True, True),
        ([False, False], 0.7, 2.6, False, False),  # a stop and a ripple beside other ones
        ([True, False], 0.6, 1.48, False, True),  # a swell as a torque from outside and a drift
        ([True, False], 0.6, 1.15, False, False),
    ],
)
def test_a_single_effect_of_the_machine_that_leaves_little_or_is_near_keeps_its_name(
    are_external: list[bool], gap: float, lead: float, predicts_better: bool | None, taken: bool
) -> None:
    assert imitates(are_external, gap, lead, predicts_better=predicts_better) is taken


@pytest.mark.parametrize(
    ("gains", "in_loop", "held", "against", "imitate", "doubt"),
    [
        ([300.0, 10.0], 300.0, ("validation",), "", True, ""),
        ([10.0, 220.0], 220.0, ("validation",), "", True, ""),
        ([215.0], 215.0, ("validation",), "", False, ""),
        ([300.0], 210.0, ("validation",), "", False, ""),
        ([300.0], None, ("validation",), "", False, ""),
        ([], None, ("validation",), "", False, ""),
        # In the fitted log alone: an event that has another form.
        ([300.0], 300.0, ("validation",), "held-out RMS ratio 1.2", False, "what was held out does not have it"),
        ([300.0], 300.0, (), "", False, "nothing was held out that could have it"),
    ],
)
def test_torques_from_outside_without_edges_are_a_curve(
    monkeypatch: pytest.MonkeyPatch, gains: list[float], in_loop: float | None, held: tuple[str, ...], against: str,
    imitate: bool, doubt: str,
) -> None:  # fmt: skip
    """A swell in time was told as a torque from outside with a beginning and an end, at 20 Hz before any round."""
    given: Any = SimpleNamespace(model=SimpleNamespace(experiments=SimpleNamespace(validation_labels=held)))
    tried: Any = [SimpleNamespace(delta_bic=gain, effect=SimpleNamespace(variable="the time")) for gain in gains]
    monkeypatch.setattr(form, "tried_curves", lambda *_: tried)
    monkeypatch.setattr(form, "unconfirmed", lambda *_, **__: against)

    def fitted(builder: Any, fit: Any, ranked: Any) -> Any:
        assert ranked[0].delta_bic == max(gains)
        return None if in_loop is None else FoundCurve(ranked[0], given, given, in_loop, np.eye(1), ())

    monkeypatch.setattr(form, "fitted_curve", fitted)
    found, told = form.instead_of_torques(given, given, 1, 167.0, seed=0)
    assert found is imitate
    assert (told is not None) is bool(doubt)
    assert told is None or (doubt in told.text and told.code is FORM_DIFFERS)


class Hand:
    """Decisions on one joint, with all fits replaced: what was named gains ``named`` in BIC, curves as given."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **given: Any) -> None:
        self.named = [EffectAtJoint(name, 1) for name in given.get("effects", ())]
        self.given = given
        self.fit = SimpleNamespace(
            residual=np.zeros((4, 1)), noise=None, values=np.zeros(1), name="final",
            model=SimpleNamespace(
                added_effects=tuple(self.named), experiments=SimpleNamespace(validation_labels=("a", "b")),
            ),
        )  # fmt: skip
        self.fit.torque_alone = self.fit
        monkeypatch.setattr(form, "joint_gaps", lambda residual, noise: np.array([given.get("gap", 1.0)]))
        monkeypatch.setattr(form, "minimise", lambda model, noise, **_: SimpleNamespace(model=model, noise=noise))
        monkeypatch.setattr(form, "bic_gain", self.gained)
        monkeypatch.setattr(form, "tried_curves", lambda *_: [self.curve(name, gain) for name, gain in given["curves"]])
        monkeypatch.setattr(form, "fitted_curve", self.fitted)
        monkeypatch.setattr(form, "unconfirmed", lambda *_, **__: given.get("against", ""))
        monkeypatch.setattr(form, "beside_others", lambda *_: (None, False))
        monkeypatch.setattr(form, "held_out_ratio", self.ratio)
        monkeypatch.setattr(form, "new_in", lambda _, label: given.get("new", {}).get(label, 1.0))

    def gained(self, before: Any, after: Any, *_: Any) -> float:
        """In BIC: by what was named, or by what is too small for a name beside that or beside the curve."""
        first, last = (after.model.added_effects[i].effect if after.model.added_effects else "" for i in (0, -1))
        if first == "curve":
            return float(self.given.get("beside_curve", -1.0))
        if len(after.model.added_effects) <= len(self.named):
            return float(self.given.get("gain", 0.0))
        return float(self.given["bent_gain" if last == "cubic_spring" else "small_gain"])

    def ratio(self, before: Any, after: Any, **_: Any) -> Ratio | None:
        """Of what was named, with what is too small for a name if there is any there."""
        ratio = self.given.get("ratio")
        if len(before.model.added_effects) > len(self.named):
            ratio = self.given.get("ratio_with_small", ratio)
        return None if ratio is None else Ratio(ratio, 0.5 * ratio, self.given.get("high", ratio))

    def curve(self, name: str, gain: float) -> Any:
        return SimpleNamespace(
            effect=SimpleNamespace(variable=name), effect_at=EffectAtJoint(name, 1), delta_bic=gain
        )  # fmt: skip

    def fitted(self, builder: Any, before: Any, ranked: Any) -> Any:
        if self.given.get("fails"):
            raise SimulationError("It diverges.", next_step="Change it.")
        gain = self.given.get("in_loop", ranked[0].delta_bic)
        after: Any = SimpleNamespace(**vars(before))
        after.model = replace_added(before.model, (EffectAtJoint("curve", 1),))
        return FoundCurve(ranked[0], before, after, gain, np.eye(1), ())

    def run(self) -> Forms:
        steps = tuple(SimpleNamespace(effect_at=a) for a in self.named)
        small = tuple(candidate_of("current_ripple", joint) for joint in self.given.get("small", ()))
        discovery = Discovery(self.fit, self.fit, steps, (), small=small)  # type: ignore[arg-type]
        builder: Any = SimpleNamespace(
            effect=lambda a: SimpleNamespace(
                is_of_log=self.given.get("is_of_log", False),
                is_external=a.effect == "external_force",
                rest="torque_offset" if a.effect == "spring" else "",
            ),
            cost_in=lambda fit, a: 1.0,
            at=lambda a: SimpleNamespace(can_be_added=not self.given.get("is_taken", False)),
            effects={"cubic_spring": SimpleNamespace(bends="spring" if "bent_gain" in self.given else "none")},
            has_place=lambda a, added: not self.given.get("has_no_place", False),
            build=lambda model, proposals: SimpleNamespace(
                added_effects=(*model.added_effects, *(p.effect_at for p in proposals))
            ),
            without=lambda model, i: SimpleNamespace(
                added_effects=tuple(a for k, a in enumerate(model.added_effects) if k != i)
            ),
        )
        return with_curves(discovery, builder, Options(), Progress())


SAME, OTHER = {"b": 0.4}, {"b": 0.5}
ONE, TWO, OUTSIDE = ("spring",), ("spring", "torque_ripple"), ("external_force",)
RESTS = ("torque_offset", "spring")


@pytest.mark.parametrize(
    ("given", "left", "is_drawn", "is_doubted"),
    [
        # Nothing was named: a curve that gains is drawn, another one is not.
        ({"curves": [("q", 300.0)]}, [], True, False),
        ({"curves": [("q", 9.0)]}, [], False, False),
        ({"curves": [("q", 300.0)], "gap": 0.5}, [], False, False),  # no gap remains: nobody asks
        ({"curves": []}, [], False, False),  # the plant does not give its motion
        # Held-out data speak against it.
        ({"curves": [("q", 300.0)], "against": "held-out RMS ratio 1.2"}, [], False, False),
        # To first order only.
        ({"curves": [("q", 300.0)], "in_loop": 5.0}, [], False, False),
        ({"curves": [("q", 300.0)], "fails": True}, [], False, False),
        # Effects that explain nearly as much keep their names; those far behind do not.
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 99.0)]}, [*TWO], False, False),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 119.0)]}, [*TWO], True, True),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 121.0)]}, [], True, False),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 121.0)], "in_loop": 110.0}, [*TWO], True, True),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 121.0)], "in_loop": 99.0}, [*TWO], False, False),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 121.0)], "gap": 0.3}, [], True, False),
        # Held-out data that refuse it: a doubt, where it explains far more of what was fitted.
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 300.0)], "against": "no"}, [*TWO], False, True),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 121.0)], "against": "no"}, [*TWO], False, True),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 119.0)], "against": "no"}, [*TWO], False, False),
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 131.0)], "against": "no"}, [*ONE], False, True),
        ({"effects": OUTSIDE, "gain": 100.0, "curves": [("t", 131.0)], "against": "no"}, [*OUTSIDE], False, True),
        ({"effects": OUTSIDE, "gain": 100.0, "curves": [("t", 129.0)], "against": "no"}, [*OUTSIDE], False, False),
        # What predicts held-out data better decides between several names and a curve that is near.
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 101.0)], "ratio": 0.99}, [], True, False),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 101.0)], "ratio": 1.0}, [*TWO], True, True),
        # Held-out data that repeat the fitted motion tell nothing.
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 101.0)], "ratio": 0.9, "new": SAME}, [*TWO], True, True),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 101.0)], "ratio": 0.9, "new": OTHER}, [], True, False),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 121.0)], "ratio": 0.9, "new": SAME}, [], True, False),
        # It explains as much within 10, or 2 % of the gain.
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 90.0)], "ratio": 0.9}, [], True, False),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 89.0)], "ratio": 0.9}, [*TWO], False, False),
        ({"effects": TWO, "gain": 1000.0, "curves": [("q", 981.0)], "ratio": 0.99}, [], True, False),
        ({"effects": TWO, "gain": 1000.0, "curves": [("q", 979.0)], "ratio": 0.9}, [*TWO], False, False),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 99.0)], "ratio": 1.0}, [*TWO], False, False),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 99.0)], "against": "no"}, [*TWO], False, False),
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 99.0)], "ratio": 0.9}, [*ONE], False, False),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 300.0)], "ratio": 1.1}, [*TWO], True, True),
        # Better for certain: the whole interval tells.
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 300.0)], "ratio": 0.9, "high": 1.01}, [*TWO], True, True),
        ({"effects": TWO, "gain": 100.0, "curves": [("q", 101.0)], "ratio": 0.9, "high": 1.01}, [*TWO], True, True),
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 300.0)], "ratio": 0.9, "high": 1.01}, [*ONE], True, True),
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 149.0)], "ratio": 0.9}, [*ONE], True, True),
        # A single one that leaves little, or is not that far behind, keeps its name, with a doubt.
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 300.0)], "gap": 0.5}, [*ONE], True, True),
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 300.0)], "gap": 0.7}, [], True, False),
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 300.0)], "gap": 0.7, "ratio": 0.9}, [], True, False),
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 300.0)], "gap": 0.7, "ratio": 1.02}, [*ONE], True, True),
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 149.0)], "gap": 0.7}, [*ONE], True, True),
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 131.0)], "gap": 0.7}, [*ONE], True, True),
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 129.0)], "gap": 0.7}, [*ONE], False, False),
        # A spring and the constant of its rest are a single one, too; with a ripple they are two.
        ({"effects": RESTS, "gain": 100.0, "curves": [("q", 129.0)], "ratio": 0.9}, [*RESTS], False, False),
        ({"effects": RESTS, "gain": 100.0, "curves": [("q", 149.0)], "ratio": 0.9}, [*RESTS], True, True),
        ({"effects": RESTS, "gain": 100.0, "curves": [("q", 151.0)], "ratio": 0.9}, [], True, False),
        ({"effects": (*RESTS, "torque_ripple"), "gain": 100.0, "curves": [("q", 121.0)]}, [], True, False),
        # A torque from outside is nothing but its form.
        ({"effects": OUTSIDE, "gain": 100.0, "curves": [("t", 129.0)], "gap": 0.1}, [*OUTSIDE], False, False),
        ({"effects": OUTSIDE, "gain": 100.0, "curves": [("t", 131.0)], "gap": 0.1}, [], True, False),
        # What changes the log as a whole is on no joint: it stays.
        ({"effects": ONE, "gain": 100.0, "curves": [("q", 300.0)], "is_of_log": True}, [*ONE], True, False),
    ],
)
def test_which_names_are_taken_back(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, Any], left: list[str], is_drawn: bool, is_doubted: bool
) -> None:
    found = Hand(monkeypatch, **given).run()
    discovery, curves = found.discovery, found.curves
    assert [step.effect_at.effect for step in discovery.steps] == left
    assert bool(curves) is is_drawn
    assert [doubt.code for doubt in found.doubts] == [FORM_DIFFERS] * is_doubted
    assert all(("what was held out does not have it" in d.text) is ("against" in given) for d in found.doubts)
    taken = [a.effect for a, why in discovery.refused if ": BIC " in why]
    texts = [*(why for _, why in discovery.refused), *(doubt.text for doubt in found.doubts)]
    ratio = f"the held-out RMS with it is {given.get('ratio', 0):.3f} times" if "ratio" in given else ""
    assert all(ratio in text for text in texts)
    assert all(("on the motion of the fit" in text) is (given.get("new") == SAME) for text in texts)
    assert taken == [name for name in given.get("effects", ()) if name not in left]
    assert [a.effect for a in (curves[0].instead_of if curves else ())] == taken
    assert [a.effect for a in discovery.final.model.added_effects] == left


@pytest.mark.parametrize(
    ("given", "are_kept"),
    [
        ({}, False),
        ({"small": [1], "small_gain": 30.0}, True),  # 125 against 130, and it predicts no better
        ({"small": [1], "small_gain": 2.0}, False),  # 125 against 102
        ({"small": [1], "small_gain": -5.0}, False),  # it has gone astray: as if there were none
        ({"small": [2], "small_gain": 30.0}, False),  # on another joint
        ({"small": [1], "small_gain": 30.0, "has_no_place": True}, False),
        ({"small": [1], "small_gain": 30.0, "is_taken": True}, False),
        (
            {"small": [1], "small_gain": 30.0, "beside_curve": 35.0},
            False,
        ),  # 160 against 130: the curve does not follow it
        ({"small": [1], "small_gain": 30.0, "beside_curve": 5.0}, True),
        # So does what bends the law of what was named.
        ({"bent_gain": 30.0}, True),
        ({"bent_gain": -3.0}, False),
        ({"bent_gain": 30.0, "is_taken": True}, False),
        ({"bent_gain": 2.0, "small": [1], "small_gain": 3.0}, True),  # 125 against 105, 1.19 times
        # Held-out data decide between the curve and all that there is.
        ({"small": [1], "small_gain": 20.0, "ratio": 0.9, "ratio_with_small": 1.01}, True),
        ({"small": [1], "small_gain": 20.0, "ratio": 0.9, "ratio_with_small": 0.98}, False),
        ({"small": [1], "small_gain": 20.0, "ratio": 0.9, "ratio_with_small": 0.98, "effects": ONE}, True),
    ],
)
def test_a_curve_is_compared_with_what_is_too_small_for_a_name_too(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, Any], are_kept: bool
) -> None:
    """It follows a small ripple beside a spring as well: that it explains more by that is no reason against these."""
    found = Hand(monkeypatch, **{"effects": TWO, "gain": 100.0, "curves": [("q", 125.0)], **given}).run()
    assert [s.effect_at.effect for s in found.discovery.steps] == [*given.get("effects", TWO)] * are_kept
    if "ratio_with_small" in given and found.doubts:
        assert "1.010 times" in found.doubts[0].text


def test_that_no_curve_explains_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    notes = Hand(monkeypatch, curves=[("the position", 3.0), ("the time", -5.0)]).run().notes
    assert notes == ("Joint 1: no curve of the position or the time alone explains what remains.",)
    notes = Hand(monkeypatch, curves=[("the time", 300.0)], against="held-out RMS ratio 1.2").run().notes
    assert "not what was held out (held-out RMS ratio 1.2): it is not shown" in notes[0]


def test_nothing_is_looked_at_when_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    hand = Hand(monkeypatch, curves=[("q", 300.0)])
    monkeypatch.setattr(Progress, "is_time_up", True)
    assert hand.run().curves == ()


@pytest.mark.parametrize("is_filled", [False, True])
def test_what_only_filled_the_gaps_of_imitators_goes_with_them(
    monkeypatch: pytest.MonkeyPatch, is_filled: bool
) -> None:
    """An effect on another joint that explains nothing beside the curve."""
    hand = Hand(monkeypatch, effects=TWO, gain=100.0, curves=[("q", 300.0)])
    other = EffectAtJoint("base_tilt", 2)
    hand.named.append(other)
    hand.fit.model = replace_added(hand.fit.model, (*hand.fit.model.added_effects, other))
    monkeypatch.setattr(form, "joint_gaps", lambda residual, noise: np.array([1.0, 0.1]))
    monkeypatch.setattr(form, "beside_others", lambda *_: (None, is_filled))
    monkeypatch.setattr(form, "_joints", lambda *_: [1])
    found = hand.run()
    discovery, (curve,) = found.discovery, found.curves
    assert [s.effect_at.effect for s in discovery.steps] == ([] if is_filled else ["base_tilt"])
    assert (other in curve.instead_of) is is_filled


def replace_added(model: Any, added: tuple[EffectAtJoint, ...]) -> Any:
    return SimpleNamespace(**{**vars(model), "added_effects": added})
