"""Signatures of the torque effects against closed-loop simulations, and their states against a closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from threading import get_ident
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from fmu_didim.case import load_case
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.base_model import with_nuisances
from fmu_didim.discovery.screening import catalogue
from fmu_didim.discovery.screening.catalogue import Signature, SignatureCatalogue
from fmu_didim.dynamics.effects import EFFECTS, Search, TorqueEffect
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.fit.derivatives import load_response as load_response_module
from fmu_didim.fit.derivatives.load_response import DenseParts, load_response
from fmu_didim.fit.derivatives.torque_signature import TorqueSignature, search_grid
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.model.motion import Motion, simulated_motion
from tests.discovery.helpers import arm_model, known_noise

ADDED = [
    name for name, effect in EFFECTS.items() if isinstance(effect, TorqueEffect) and name not in ("viscous", "coulomb")
]  # the two that the arm has
PAIRED = ("coupling_friction", "wrist_friction", "coupled_inertia")
"""Effects of a joint and the next one: the last joint has none."""
UNMOVED = {("payload_change", 1): {"dM", "dMZ"}, ("payload_change", 2): {"dMZ"}}
"""Amplitudes that an arm in a plane does not feel: mass on the first axis, moments along the axes."""


WARMING = {"temperature_start1": 290.0, "warming_start1": 4.0, "temperature_start2": 310.0, "warming_start2": -3.0}
"""Gears that get warmer and colder, through 20 degC and above it."""


@dataclass(frozen=True)
class Bench:
    builder: LoopModelBuilder
    fit: Fit
    size: np.ndarray


def two_joints(folder: Path) -> Bench:
    """Two joints at 200 Hz for one period, the fit at the truth."""
    model = arm_model(folder, joints=2, rate_hz=200.0, seconds=4.0)
    for label, experiment in model.experiments.items():
        model = model.with_experiment(label, replace(experiment, measured_starts=WARMING))
    fit = minimise(with_nuisances(replace(model, workers=1)), known_noise([0.1, 0.05]))
    builder = LoopModelBuilder(fit.model, load_case(folder / "case.yaml").parameters.model.description)  # type: ignore[union-attr]
    return Bench(builder, fit, np.sqrt(np.mean(fit.torque**2, axis=0)))


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return two_joints(tmp_path_factory.mktemp("two"))


def signatures(bench: Bench, name: str, joint: int) -> list[Signature]:
    return list(SignatureCatalogue(bench.builder, bench.fit, candidates=[EffectAtJoint(name, joint)]))


def compared(bench: Bench, signature: Signature, amplitude: str, part: float = 0.02) -> tuple[float, float]:
    """Correlation of a column with the difference of two closed loops per unit of its amplitude, and the slope of the
    difference over the column; each joint in units of its torque. The effect moves the torque by a part of it."""
    column = signature.columns[:, :, signature.amplitudes.index(amplitude)] / bench.size
    value = part / np.sqrt(np.mean(column**2, axis=0)).max()
    values = {**signature.shapes, **dict.fromkeys(signature.amplitudes, 0.0), amplitude: float(value)}
    model = bench.builder.build(bench.fit.model, [Proposal(signature.effect_at, values)])
    change = ((model.torque(model.start) - bench.fit.torque) / bench.size / value).ravel()
    flat = column.ravel()
    return float(flat @ change / np.linalg.norm(flat) / np.linalg.norm(change)), float(flat @ change / (flat @ flat))


def chosen(bench: Bench, name: str, joint: int) -> Signature:
    """Friction over a wide range of speed or distance; the middle of the other grids."""
    found = signatures(bench, name, joint)
    return found[3 * len(found) // 4]


OUTSIDE = 0.1
"""[1] Of the largest spline of a curve: a smaller one lies outside the motion, or at its end."""


@pytest.mark.gate
@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize("name", ADDED)
def test_column_is_the_change_of_the_closed_loop(bench: Bench, name: str, joint: int) -> None:
    if joint == 2 and name in PAIRED:
        assert not signatures(bench, name, joint)
        return
    signature = chosen(bench, name, joint)
    sizes = np.linalg.norm(signature.columns, axis=(0, 1))
    for i, amplitude in enumerate(signature.amplitudes):
        if amplitude in UNMOVED.get((name, joint), ()):
            assert np.abs(signature.columns[:, :, i]).max() < 1e-9
            continue
        if EFFECTS[name].is_form and sizes[i] < OUTSIDE * sizes.max():
            continue
        correlation, slope = compared(bench, signature, amplitude)
        assert correlation > 0.99, amplitude
        assert slope == pytest.approx(1, abs=0.1), amplitude


SHARP = {"stribeck": 0.85, "presliding": 0.99, "lugre": 0.95, "torque_ripple": 0.99}
"""Effects that change within milliseconds of a reversal -> least correlation."""


def sharp(bench: Bench, name: str, joint: int) -> Signature:
    """One of the narrow shapes."""
    found = signatures(bench, name, joint)
    return found[len(found) // 4]


@pytest.mark.gate
@pytest.mark.parametrize(("name", "least"), SHARP.items())
def test_friction_that_is_sharp_at_a_reversal_is_only_like_its_column(bench: Bench, name: str, least: float) -> None:
    """Where friction changes within milliseconds of a reversal the loop is not linear: screening sees the right sign
    and most of the shape, and the closed-loop fit decides."""
    for joint in (1, 2):
        signature = sharp(bench, name, joint)
        for amplitude in signature.amplitudes:
            correlation, slope = compared(bench, signature, amplitude)
            assert correlation > least
            assert 0.5 < slope < 1.2


@pytest.mark.gate
def test_a_soft_loop_gives_way_to_ripple_as_its_response_says(tmp_path: Path) -> None:
    """With a twentieth of the gains the ripple reaches the command late and reshaped."""
    for factor in (0.05, 1.0):
        folder = tmp_path / f"{factor}"
        model = arm_model(folder, rate_hz=200.0, seconds=4.0, gain_factor=factor)
        fit = minimise(with_nuisances(replace(model, workers=1)), known_noise(0.1))
        builder = LoopModelBuilder(fit.model, load_case(folder / "case.yaml").parameters.model.description)  # type: ignore[union-attr]
        bench = Bench(builder, fit, np.sqrt(np.mean(fit.torque**2, axis=0)))
        ripple = min(signatures(bench, "torque_ripple", 1), key=lambda s: abs(s.shapes["nr"] - 10))
        correlation, slope = compared(bench, ripple, "Rsin")
        assert correlation > 0.99
        assert slope == pytest.approx(1, abs=0.05)


GEAR = {"K": 1500.0, "D": 1.0, "motor_share": 0.4}
"""An elastic gear of the first joint; with half a kg.m2 at either side it rings at some 12 Hz."""


@pytest.mark.gate
def test_the_error_of_a_gear_is_seen_in_what_it_does(tmp_path: Path) -> None:
    """Its columns are the derivatives of the loop; one turn in 21 is missed by no number of periods that is tried."""
    fit = minimise(arm_model(tmp_path, rate_hz=200.0, seconds=4.0, gear=GEAR), known_noise(0.1))
    builder = LoopModelBuilder(fit.model, load_case(tmp_path / "case.yaml").parameters.model.description)  # type: ignore[union-attr]
    bench = Bench(builder, fit, np.sqrt(np.mean(fit.torque**2, axis=0)))
    found = signatures(bench, "transmission_error", 1)
    numbers = sorted(s.shapes["gear_number"] for s in found)
    travelled = bench.builder.loop.ranges[0]
    assert max(np.diff(numbers)) * (travelled.highest - travelled.lowest) / 2 < np.pi / 2
    near = min(found, key=lambda s: abs(s.shapes["gear_number"] - 60.0))
    assert near.amplitudes == ("gear_cosine", "gear_sine")
    for amplitude in near.amplitudes:
        correlation, slope = compared(bench, near, amplitude)
        assert correlation > 0.99
        assert slope == pytest.approx(1, abs=0.05)


@pytest.fixture(scope="module")
def geared(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """One joint with an elastic gear."""
    folder = tmp_path_factory.mktemp("geared")
    fit = minimise(arm_model(folder, rate_hz=200.0, seconds=4.0, gear=GEAR), known_noise(0.1))
    builder = LoopModelBuilder(fit.model, load_case(folder / "case.yaml").parameters.model.description)  # type: ignore[union-attr]
    return Bench(builder, fit, np.sqrt(np.mean(fit.torque**2, axis=0)))


def test_hardening_of_a_gear_is_seen_in_what_it_does(geared: Bench) -> None:
    """One column, the derivative of the loop where the gear does not harden."""
    (found,) = signatures(geared, "gear_hardening", 1)
    assert found.amplitudes == ("K_cubic",) and not found.inverse
    correlation, slope = compared(geared, found, "K_cubic", part=0.002)  # with more the gear resonates elsewhere
    assert correlation > 0.999
    assert slope == pytest.approx(1, abs=0.02)


def error_of_gear(bench: Bench, substeps: int | None) -> np.ndarray:
    """(M, 2) the signature of 60 periods in a turn beside a fit with these substeps."""
    fit = replace(bench.fit, model=bench.fit.model.with_loop(substeps=substeps))
    of_gear = EffectAtJoint("transmission_error", 1)
    (found,) = SignatureCatalogue(bench.builder, fit, candidates=[]).of_shapes(of_gear, [{"gear_number": 60.0}])
    return found.columns[:, 0]


@pytest.mark.parametrize(("of_fit", "wanted"), [(1, 1), (2, 2), (4, 4), (64, 4), (None, 4)])
def test_errors_of_a_gear_are_tried_with_no_finer_steps_than_resolve_it(
    geared: Bench, monkeypatch: pytest.MonkeyPatch, of_fit: int | None, wanted: int
) -> None:
    """However finely the fit is integrated, which a gear that rings without end asks for."""
    model, asked = geared.fit.model, list[int | None]()
    assert model.fewest_substeps(geared.fit.values) == 1
    assert model.automatic_substeps(geared.fit.values) > wanted

    def by_variation(run: Any, places: Any, *_: Any, **__: Any) -> dict[int, np.ndarray]:
        asked.append(run.model.system(run.values).components["plant"].stated_substeps)
        return {i: np.ones_like(geared.fit.outputs) for i in places}

    monkeypatch.setattr(catalogue, "by_variation", by_variation)
    error_of_gear(geared, of_fit)
    assert asked == [wanted]


def test_an_error_of_a_gear_shows_as_with_finer_steps(geared: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    coarse = error_of_gear(geared, 64)
    monkeypatch.setattr(catalogue, "at_most_resolving", lambda model, values, times: model)
    for one, other in zip(coarse.T, error_of_gear(geared, 64).T, strict=True):
        assert not np.array_equal(one, other)
        assert one @ other / np.linalg.norm(one) / np.linalg.norm(other) > 0.995


def test_slow_loads_come_back_whole(bench: Bench) -> None:
    """The taps of the response sum to one on their own joint and to nothing across."""
    taps = load_response(bench.fit.simulation("estimation")).taps
    assert taps.sum(axis=0) == pytest.approx(np.eye(2), abs=0.05)
    assert np.abs(taps[0]).max() < 0.1 * np.abs(taps).max()  # nothing before the robot has moved


def test_tables_and_transforms_give_the_same(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of loads on one joint and on both, whichever way is taken for logs of this length."""
    response = load_response(bench.fit.simulation("estimation"))
    loads = np.random.default_rng(1).normal(size=(response.ticks.size, 2, 3))
    alone = np.where([[True], [False]], loads, 0.0)
    by_table = response.at_samples(loads), response.at_samples(alone), response.of_joint(loads[:, 1], 1)
    assert response._tables
    monkeypatch.setattr(load_response_module, "MOST_WEIGHTS", 0)
    other = replace(response)
    by_transform = other.at_samples(loads), other.at_samples(alone), other.of_joint(loads[:, 1], 1)
    assert not other._tables
    for one, same in zip(by_table, by_transform, strict=True):
        np.testing.assert_allclose(one, same, atol=1e-12 * np.abs(same).max())


@pytest.mark.parametrize(
    ("rows", "columns", "band"),
    [
        (10, 40, 7),  # a log of one tick in four
        (40, 40, 7),
        (40, 10, 3),  # several samples of a tick, as averages are
        (1, 5, 5),
        (6, 6, 1),
    ],
)
def test_dense_parts_of_a_table_are_the_table(rows: int, columns: int, band: int) -> None:
    """With rows that have nothing, and a part of the log that is missing."""
    rng, table = np.random.default_rng(2), np.zeros((rows, columns))
    last = np.linspace(0, columns - 1, rows).astype(int)
    last[rows // 2 :] = np.minimum(last[rows // 2 :] + 5, columns - 1)
    for row, place in enumerate(last):
        table[row, max(place - band + 1, 0) : place + 1] = rng.normal(size=min(band, place + 1))
    table[rows // 3] = 0.0
    parts, other = DenseParts.of(sparse.csr_array(table)), rng.normal(size=(columns, 4))
    np.testing.assert_allclose(parts.times(other), table @ other, atol=1e-14)
    assert not np.any(DenseParts.of(sparse.csr_array(np.zeros((rows, columns)))).times(other))


# ---- states ----------------------------------------------------------------------------------------


def made_up(dq: np.ndarray, step: float = 0.005) -> Motion:
    """Motion of one joint with these speeds (K,)."""
    count = dq.size
    q = np.concatenate([[0.0], np.cumsum(dq[:-1]) * step])
    zero = np.zeros((count, 1))
    return Motion(
        np.arange(count) * step, q[:, None], dq[:, None], zero, zero, zero, step, {0: np.zeros((count, 1, 4))}
    )  # fmt: skip


def dahl(dq: np.ndarray, step: float, distance: float) -> np.ndarray:
    """Deflection with the mean speed of each tick held, exactly: z goes to zs sign(w) with the rate |w| / zs.

    The speed is the effect's own, w = V tanh(dq/V) with V = 5 rad/s.
    """
    z = np.zeros(dq.size)
    for k, w in enumerate(5.0 * np.tanh((dq[1:] + dq[:-1]) / 2 / 5.0)):
        end = distance * np.sign(w)
        z[k + 1] = end + (z[k] - end) * np.exp(-abs(w) * step / distance)
    return z


def speeds(kind: str) -> np.ndarray:
    time = np.arange(800) * 0.005
    if kind == "sine":
        return np.asarray(1.5 * np.cos(2 * np.pi * 0.7 * time) + 0.4 * np.sin(2 * np.pi * 2.1 * time))
    # Short fast moves between long rests: the peak is ten times the root of the mean square.
    return np.asarray(3.0 * np.sin(np.pi * (time % 2.0) / 0.1) * ((time % 2.0) < 0.1) * np.sign(np.sin(np.pi * time)))


def signature_of(name: str) -> TorqueSignature:
    effect = EFFECTS[name]
    assert isinstance(effect, TorqueEffect)
    return TorqueSignature(effect, 0, ("revolute",), tuple(v.name for v in effect.shapes("revolute")))


@pytest.mark.parametrize("kind", ["sine", "moves"])
@pytest.mark.parametrize("distance", [1e-4, 1e-3, 1e-2])
def test_states_of_presliding(kind: str, distance: float) -> None:
    dq = speeds(kind)
    z = signature_of("presliding").states(made_up(dq), {"v0": 0.01, "zs": distance})
    assert z.shape == (800, 1)
    assert np.abs(z[:, 0] / distance).max() <= 1 + 1e-9
    assert z[:, 0] == pytest.approx(dahl(dq, 0.005, distance), abs=1e-9 * distance)


@pytest.mark.parametrize("distance", [1e-4, 0.1])
def test_states_at_constant_speed_follow_dahls_equation(distance: float) -> None:
    """z = zs (1 - exp(-v t/zs)), however short the distance."""
    z = signature_of("presliding").states(made_up(np.full(200, 0.5)), {"v0": 0.01, "zs": distance})
    held = 5.0 * np.tanh(0.5 / 5.0)  # the speed that the effect itself limits
    expected = distance * -np.expm1(-held * np.arange(200) * 0.005 / distance)
    np.testing.assert_allclose(z[:, 0], expected, rtol=1e-9, atol=1e-15)


def test_column_of_presliding_is_dahl_minus_coulomb() -> None:
    dq = speeds("sine")
    motion, shapes = made_up(dq), {"v0": 0.02, "zs": 1e-2}
    made = signature_of("presliding")
    column = made.columns(motion, shapes, made.states(motion, shapes))[:, 0, 0]
    assert column == pytest.approx(dahl(dq, 0.005, 1e-2) / 1e-2 - np.tanh(dq / 0.02), abs=0.02)


def test_states_do_not_look_ahead() -> None:
    """The state at a tick follows from the motion up to it only."""
    dq = speeds("sine")
    changed = dq.copy()
    changed[400:] *= -1
    made, shapes = signature_of("presliding"), {"v0": 0.01, "zs": 1e-2}
    first, second = (made.states(made_up(v), shapes) for v in (dq, changed))
    assert np.array_equal(first[:400], second[:400])
    assert not np.array_equal(first[400:], second[400:])


# ---- the rest --------------------------------------------------------------------------------------


def test_load_is_that_of_the_links_alone(bench: Bench) -> None:
    """Torque minus load is the friction of the joint."""
    motion = simulated_motion(bench.fit.simulation("estimation"), RobotModel(bench.builder.description))
    assert motion is not None
    friction = motion.torque - motion.load
    for j, (fv, fc) in enumerate([(1.5, 2.0), (0.6, 0.9)]):
        wanted = fv * motion.dq[:, j] + fc * np.tanh(motion.dq[:, j] / 0.02)
        assert friction[:, j] == pytest.approx(wanted, abs=2e-3 * bench.size[j])


def test_grid_of_the_shapes() -> None:
    search = {"a": Search(1.0, 100.0, 3), "b": Search(-1.0, 1.0, 5, logarithmic=False)}
    grid = list(search_grid(search, {"a": 7.0, "c": 9.0}))
    assert len(grid) == 15
    assert sorted({g["a"] for g in grid}) == pytest.approx([1, 10, 100])
    assert sorted({g["b"] for g in grid}) == pytest.approx([-1, -0.5, 0, 0.5, 1])
    assert {g["c"] for g in grid} == {9.0}


def test_thinned_motion_gives_the_same_columns(bench: Bench) -> None:
    """Columns at some ticks are those of all ticks, there."""
    motion = simulated_motion(bench.fit.simulation("estimation"), RobotModel(bench.builder.description))
    assert motion is not None
    effect = EFFECTS["load_dependent_friction"]
    assert isinstance(effect, TorqueEffect)
    made = TorqueSignature(effect, 1, ("revolute", "revolute"), tuple(v.name for v in effect.shapes("revolute")))
    shapes = {v.name: v.start for v in effect.shapes("revolute")}
    some = np.array([3, 50, 333])
    fields = {name: getattr(motion, name)[some] for name in ("time", "q", "dq", "ddq", "torque", "load")}
    part = replace(motion, **fields, links={j: table[some] for j, table in motion.links.items()})
    assert made.columns(part, shapes) == pytest.approx(made.columns(motion, shapes)[some])


@pytest.mark.gate
def test_what_is_of_the_base_is_tried_once(bench: Bench) -> None:
    assert bench.builder.joints("base_tilt") == (1,)
    assert bench.builder.joints("joint_elasticity") == (1, 2)
    assert signatures(bench, "base_tilt", 1)
    # A description has it at joint 1 or nowhere: at any other joint it would be simulated and change nothing.
    assert not signatures(bench, "base_tilt", 2)


NAMES = ("quadratic_viscous", "stribeck", "spring", "presliding")


def test_expressions_are_made_and_dropped_in_one_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """CasADi shares constants between expressions without a lock: two threads that made and dropped some at once ended
    a discovery of six joints with "Fatal Python error: Aborted"."""
    bench, threads = two_joints(tmp_path), list[tuple[str, int]]()

    class Watched(TorqueSignature):
        def __init__(self, *given: Any) -> None:
            threads.append(("made", get_ident()))
            super().__init__(*given)

        def columns(self, *given: Any, **named: Any) -> np.ndarray:
            threads.append(("used", get_ident()))
            return super().columns(*given, **named)

        def states(self, *given: Any) -> np.ndarray:  # an expression for each shape
            threads.append(("walked", get_ident()))
            return super().states(*given)

        def __del__(self) -> None:
            threads.append(("dropped", get_ident()))

    monkeypatch.setattr(catalogue, "TorqueSignature", Watched)
    several = replace(bench.fit, model=replace(bench.fit.model, workers=2))
    candidates = [EffectAtJoint(name, j) for name in NAMES for j in (1, 2)]
    found = SignatureCatalogue(bench.builder, several, candidates=candidates)
    assert {s.effect_at for s in found} == set(candidates)
    where = {what: {thread for done, thread in threads if done == what} for what in ("made", "walked", "used")}
    dropped = {thread for done, thread in threads if done == "dropped"}
    assert where["made"] == where["walked"] == {get_ident()} and dropped <= {get_ident()}
    assert where["used"] - {get_ident()}  # side by side
