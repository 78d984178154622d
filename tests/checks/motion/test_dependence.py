"""Whether a residual depends on the motion: chance, colour, what the fit has used up, and which cause is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from fmu_didim.base.errors import SimulationError
from fmu_didim.case import load_case
from fmu_didim.checks.motion import dependence as dependence_module
from fmu_didim.checks.motion.colour import Colour, Columns, Logs
from fmu_didim.checks.motion.dependence import (
    Dependence,
    OwnColours,
    _moved_by_clock,
    dependence,
    dependence_of_fit,
    motion_dependence,
    motion_diagnostics,
    residuals_of_fit,
)
from fmu_didim.checks.motion.functions import (
    LIKE_GRAVITY,
    LIKE_PAYLOAD,
    LOOKS_LIKE,
    TORQUE_RATE,
    functions_of_motion,
    looks_like,
)
from fmu_didim.data.filters import LowPass
from fmu_didim.fit.fit import point
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.fit.uncertainty import stretches
from fmu_didim.model.loop_model import Simulation
from tests.checks.data.right import loaded, right
from tests.helpers import model_of, with_torque

RNG = np.random.default_rng
TIME = np.linspace(0, 10, 400)
MOTION = np.column_stack([np.sin((k + 1) * TIME) for k in range(6)])
NAMES = ["a", "b", "c", "d", "e", "f"]
SENSITIVITY = np.column_stack([np.cos(TIME), np.cos(2 * TIME), np.sign(np.cos(TIME))])


def found(residual, motion=MOTION, nuisance=SENSITIVITY, names=NAMES):
    return dependence(residual, nuisance, motion, names, joint=2)


def test_noise_is_told_no_more_often_than_the_level_says():
    """Less often, since the p values of what is tried are alike, and the smallest is corrected as if they were not."""
    values = np.array([found(RNG(seed).normal(size=400)).p_value for seed in range(1000)])
    for level in (0.01, 0.05, 0.25):
        share = np.mean(values < level)
        assert level / 5 < share < level + 3 * np.sqrt(level * (1 - level) / 1000)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_a_function_of_the_motion_is_found_whatever_its_unit(scale):
    residual = scale * (RNG(0).normal(size=400) + 0.5 * MOTION[:, 2])
    one = found(residual)
    assert one.p_value < 1e-6
    assert (one.joint, one.most) == (2, "c")
    assert abs(one.slope - 0.5 * scale) < 4 * one.deviation
    assert one.most_share > 0.8


def test_what_the_fit_has_used_up_does_not_count():
    assert found(RNG(1).normal(size=400) + SENSITIVITY @ (3.0, -2.0, 5.0)).p_value > 1e-3
    assert found(RNG(1).normal(size=400), motion=SENSITIVITY @ np.ones((3, 2))).p_value == 1.0


@pytest.mark.parametrize(("samples", "functions"), [(400, 6), (30, 3), (10, 0)])
def test_few_samples_are_asked_for_few_functions(samples, functions):
    """A column of its own explains all: it is found only among those that the samples allow."""
    motion = RNG(4).normal(size=(samples, 6))
    for k, name in enumerate(NAMES):
        one = found(RNG(2).normal(size=samples) + 100 * motion[:, k], motion, SENSITIVITY[:samples])
        assert (one.most == name and one.p_value < 1e-9) is (k < functions)
        assert bool(one.samples) is (functions == 0)
        assert ("motion-untested" in [d.code.name for d in motion_diagnostics([one])]) is (functions == 0)


@pytest.mark.parametrize(("missing", "past"), [((), 26), ((17, 18, 200), 25)])
def test_a_colour_leaves_white_noise_and_no_row_beside_a_gap(missing, past):
    white = RNG(3).normal(size=1400)
    coloured = lfilter([1.0], [1.0, -1.2, 0.4], white)[1000:]
    places = np.array([i for i in range(400) if i not in missing])
    columns = Columns(of_logs(TIME[places]), coloured[places, None])
    longest = columns.logs.pasts[0].lags
    colour = replace(Colour.white(1), coefficients=(np.array([1.2, -0.4]),))
    alone = [i for i in places if set(range(i - longest, i)) <= set(places)]
    assert longest == past
    np.testing.assert_allclose(columns.whitened(colour)[:, 0], white[1000:][alone], atol=1e-12)


def test_a_log_with_many_gaps_has_a_shorter_past():
    logs = of_logs(TIME[np.arange(400) % 10 != 9])
    assert 1 <= logs.pasts[0].lags < 5
    assert logs.samples >= 0.5 * 360


def test_a_memory_is_told_from_an_autoregression():
    """Noise 1/f is white once half a difference has been taken of it."""
    white = RNG(5).normal(size=4400)
    weights = np.cumprod(np.append(1.0, (np.arange(1, 4400) - 0.5) / np.arange(1, 4400)))
    slow = np.convolve(weights, white)[4000:4400]
    for noise, memory in ((slow, 0.5), (white[:400], 0.0)):
        columns = Columns(of_logs(TIME), noise[:, None])
        assert columns.logs.memories[columns.colour(0, []).memory] == memory


@pytest.mark.parametrize(
    ("most", "most_share", "p_value", "moved", "codes"),
    [
        ("velocity", 0.9, 1e-9, np.inf, ["residual-depends-on-motion"]),
        ("velocity", 0.9, 1e-9, 0.1, ["residual-depends-on-motion"]),  # that may be anything
        (TORQUE_RATE, 0.95, 1e-9, np.inf, ["clock-late"]),  # not known
        (TORQUE_RATE, 0.95, 1e-9, 0.31, ["clock-late"]),
        (TORQUE_RATE, 0.95, 1e-9, 0.29, ["clock-slightly-off"]),
        (TORQUE_RATE, 0.5, 1e-9, 0.1, ["residual-depends-on-motion"]),
        (TORQUE_RATE, 0.95, 1e-3, np.inf, []),
        ("velocity", 0.95, 0.04, np.inf, []),
    ],
)
def test_what_is_reported(most, most_share, p_value, moved, codes):
    """Of two joints: each needs half the level; the other one is as noise is."""
    other = Dependence(2, p_value, 0.2, most, most_share, -0.005, 0.0001, moved=moved)
    told = motion_diagnostics([Dependence(1, 0.4, 0.01, "offset", 0.3), other])
    assert [d.code.name for d in told] == codes
    assert all(d.place == "joint 2" for d in told)
    if codes == ["clock-late"]:
        assert told[0].value == pytest.approx(5.0)
        assert "5 ± 0.1 ms late" in told[0].text
    if codes == ["clock-slightly-off"]:
        assert told[0].value == moved and "moves no value by more than 0.29" in told[0].text


def test_functions_follow_the_motion_at_the_samples():
    model = model_of(Path("examples/scara/identify.yaml"))
    functions = functions_of_motion(model.simulation(model.start))
    torque = model.torque(model.start, model.first)
    assert len(functions) == 2
    for j, one in enumerate(functions):
        assert next(iter(one)) == TORQUE_RATE
        np.testing.assert_allclose(one["torque"], torque[:, j], atol=1e-9 * np.abs(torque).max())
        assert {"velocity", "position", "direction of motion"} <= set(one)
        slope = np.diff(one["position"]) / np.diff(model.experiments[model.first].time)
        middle = (one["velocity"][1:] + one["velocity"][:-1]) / 2
        assert np.corrcoef(slope, middle)[0, 1] > 0.99


def of_logs(*times):
    return Logs(tuple(stretches(times)))


COLOURS = {"white": (), "ar 0.7": (0.7,), "ar of order two": (1.2, -0.4), "ar 0.9": (0.9,), "ar 0.97": (0.97,)}
SLOW = ("1/f", "half 1/f")
WITH_OFFSET = np.column_stack([MOTION, np.ones(400)])


def drawn(colour, seed, loud=0.0):
    """(400,) noise of a colour, or 1/f noise; ``loud``: with the motion, over its size at rest."""
    white = RNG(seed).normal(size=1400)
    if "1/f" in colour:
        hz = np.fft.rfftfreq(1400)
        noise = np.fft.irfft(np.fft.rfft(white) / np.sqrt(np.maximum(hz, hz[1])), 1400)[1000:]
        if colour == "half 1/f":
            noise = noise / noise.std() + RNG([seed, 1]).normal(size=400)
    else:
        noise = lfilter([1.0], [1.0, *(-a for a in COLOURS[colour])], white)[1000:]
    return noise / noise.std() * (1 + loud * np.abs(MOTION[:, 0]))


def chance(residual, motion=WITH_OFFSET):
    names = [*NAMES, "offset"][: motion.shape[1]]
    return dependence(residual, SENSITIVITY, motion, names, joint=1, logs=of_logs(TIME)).p_value


@pytest.mark.parametrize("colour", [*COLOURS, *SLOW])
def test_noise_of_any_colour_is_not_told(colour):
    assert min(chance(drawn(colour, seed)) for seed in range(10)) > 0.001


@pytest.mark.gate
@pytest.mark.parametrize(("colour", "loud"), [*((colour, 0.0) for colour in [*COLOURS, *SLOW]), ("white", 2.0)])
def test_noise_of_any_colour_is_told_at_most_twice_as_often_as_the_level_says(colour, loud):
    """Also where it is loud with the motion. The colour of noise with a memory of ten samples is known from forty
    independent ones only."""
    values = np.array([chance(drawn(colour, seed, loud)) for seed in range(100)])
    assert np.mean(values < 0.05) < 2 * 0.05
    assert np.sum(values < 0.001) <= 2, "three of 200 have a chance of 0.1 %"


SHAPES = {
    "offset": np.ones(400),
    "as slow as the motion": MOTION[:, 0],
    "drift in two functions": MOTION[:, 0] + 0.5 * MOTION[:, 3],
    "beside what the fit absorbs": MOTION[:, 1] + 5 * SENSITIVITY[:, 1],
}


@pytest.mark.parametrize("colour", ["white", "ar 0.7"])
@pytest.mark.parametrize("name", SHAPES)
def test_the_larger_a_misfit_the_clearer(name, colour):
    """It does not pass for the colour of the noise: from twice the size that is told on every larger one is told."""
    for seed in range(3):
        noise, shape = drawn(colour, seed), SHAPES[name]
        values = np.array([chance(noise + size * shape) for size in np.geomspace(0.1, 1000, 13)])
        first = int(np.argmax(values < 1e-4))
        assert 0 < first < 7
        assert (values[first:] < 1e-4).all()
        gains = [gain(noise + size * shape) for size in (2.0, 10.0, 100.0, 1000.0)]
        assert (np.diff(gains) > -0.1).all(), "the criterion itself, where functions follow all of it"


def test_what_shows_in_the_first_samples_alone_is_told():
    """A transient of 12 samples. Only those are left out that the colour needs as its past: none of white noise, some
    where it seems to have a colour by chance; 26 if the longest past was taken."""
    transient = np.exp(-TIME / 0.3)
    motion = np.column_stack([MOTION, transient])
    told = [chance(drawn("white", seed) + 5 * transient, motion) < 0.001 for seed in range(10)]
    assert np.mean(told) >= 0.8


def gain(residual):
    """Of the criterion, by all functions, at the same samples."""
    columns = Columns(of_logs(TIME), np.column_stack([SENSITIVITY, residual, WITH_OFFSET]))
    alone = columns.colour(3, range(3))
    return alone.criterion - columns.colour(3, [0, 1, 2, *range(4, 11)], alone.orders).criterion


@pytest.mark.parametrize(("shape", "most"), [(MOTION[:, 0], "a"), (MOTION[:, 0] + 0.5 * MOTION[:, 3], "ad")])
def test_a_misfit_does_not_widen_its_own_bound(shape, most):
    """As slow as the motion, three times as large as the noise: the colour of the residual is nearly all that of it. It
    explains much of it, but at the cost of its coefficients."""
    for seed in range(20):
        residual = RNG(seed).normal(size=400) + 3 * shape
        tested = OwnColours.of(residual, Columns(of_logs(TIME), np.zeros((400, 0)))).with_functions(MOTION)
        assert tested.alone.coefficients[0].sum() > 0.5 > abs(tested.beside([0, 3]).coefficients[0].sum())
        one = dependence(residual, SENSITIVITY, MOTION, NAMES, joint=1, logs=of_logs(TIME))
        assert one.most in most
        assert one.p_value < 1e-9


def test_logs_of_two_rates_have_a_colour_each():
    times = (TIME, np.arange(600) / 100.0)
    parts = [lfilter([1.0], [1.0, -a], RNG(4).normal(size=t.size)) for a, t in zip((0.8, -0.5), times, strict=True)]
    columns = Columns(of_logs(*times), np.concatenate([parts[0], 10 * parts[1]])[:, None])
    colour = columns.colour(0, [])
    first, second = (a[0] for a in colour.coefficients)
    assert (first, second) == (pytest.approx(0.8, abs=0.1), pytest.approx(-0.5, abs=0.1))
    assert colour.deviations[1] / colour.deviations[0] == pytest.approx(10, rel=0.1)


@pytest.mark.parametrize(
    ("joint", "name", "looks"),
    [
        (1, "direction of the torque", "a dead zone of the drive"),
        (1, "time in the direction of motion", "friction that grows or falls with time"),
        (2, "time and velocity", "viscous friction that grows or falls with time"),
        (2, "torque, which changes after 50 % of the log", "a payload that changes on the way"),
        (1, "acceleration, which changes after 75 % of the log", "a payload that changes on the way"),
        (1, "sine of the angle of link 2", "a tilted base or other gravity"),
        (2, "cosine of the angle of link 2", "a tilted base or other gravity"),
        (2, "friction by load", "friction that grows with the load"),
    ],
)
def test_what_a_model_lacks_is_named(joint, name, looks):
    model = model_of(Path("examples/double_pendulum/identify.yaml"))
    functions = functions_of_motion(model.simulation(model.start))[joint - 1]
    columns, shape = np.column_stack(list(functions.values())), functions[name]
    residual = shape / np.std(shape) + 0.1 * RNG(joint).normal(size=shape.size)
    told = found(residual, columns, np.zeros((shape.size, 0)), list(functions))
    assert name in (told.most, *told.as_well)
    (doubt,) = motion_diagnostics([told])
    assert f"as {told.looks} would" in doubt.text
    assert looks in told.looks


def test_a_cause_of_two_functions_is_said_once():
    told = replace(Dependence.untested(1, 100), most="jerk", as_well=(TORQUE_RATE,))
    assert told.looks == "an elastic joint or a wrong clock or a lag of the drive"


def test_every_function_looks_like_something():
    model = model_of(Path("examples/double_pendulum/identify.yaml"))
    names = {name for one in functions_of_motion(model.simulation(model.start)) for name in one}
    assert set(LOOKS_LIKE) < names
    assert {looks_like(name) for name in names - set(LOOKS_LIKE)} == {LIKE_GRAVITY, LIKE_PAYLOAD}


def test_a_motion_that_breaks_off_after_the_log_says_nothing(monkeypatch):
    def diverged(*_arguments, **_options):
        raise SimulationError("It diverges.", next_step="Change it.")

    model = model_of(Path("examples/scara/identify.yaml"))
    monkeypatch.setattr(Simulation, "record", diverged)
    residual, columns = np.zeros((100, 2)), np.zeros((100, 2, 8))
    assert motion_dependence(model, model.start, {model.first: residual}, {model.first: columns}) == []


@pytest.mark.gate
@pytest.mark.parametrize(("rate_hz", "cutoff_hz"), [(20.0, 5.0), (200.0, 10.0)])
def test_filtered_noise_does_not_depend_on_the_motion_and_an_effect_does(rate_hz, cutoff_hz):
    """The filter makes neighbouring samples alike: noise counted sample by sample would seem to follow the motion."""
    case = load_case("examples/scara/identify_200hz.yaml").with_(train={"torque": {"rate_hz": rate_hz}})
    model = case.model.on(case.model.first)
    torque = model.torque(model.start, model.first)
    size = 0.05 * torque.std(axis=0)
    shape = np.column_stack([one["size of the torque"] for one in functions_of_motion(model.simulation(model.start))])
    shape = shape / shape.std(axis=0)

    def chances(added, seed):
        noisy = torque + added * size * shape + size * RNG(seed).normal(size=torque.shape)
        own = with_torque(model, noisy).with_low_pass(LowPass(cutoff_hz))
        fit = point(own.with_values(own.start), NoiseOfResidual(own))
        return [one.p_value for one in dependence_of_fit(fit)]

    noise = np.array([chances(0.0, seed) for seed in range(15)])
    assert np.mean(noise < 0.01) < 0.1
    assert (np.array(chances(1.0, 1)) < 1e-6).any()


def test_a_band_too_narrow_to_ask_is_told():
    """With a cut-off of 0.1 Hz a few seconds have no sample of their own for each parameter."""
    model = load_case("examples/scara/identify_200hz.yaml").model
    model = model.on(model.first).with_low_pass(LowPass(0.1))
    told = motion_diagnostics(dependence_of_fit(point(model, NoiseOfResidual(model))))
    assert [(d.code.name, d.place) for d in told] == [("motion-untested", "joint 1"), ("motion-untested", "joint 2")]
    assert all("samples are too few" in d.text for d in told)


@pytest.mark.parametrize(
    ("late_s", "joints", "codes"),
    [
        (5e-5, 2, {"clock-slightly-off"}),
        (5e-4, 2, {"clock-late"}),
        (5e-4, 1, {"clock-late"}),  # the other joint of the log is in time: whatever it is, no clock
    ],
)
def test_a_clock_after_the_fit_is_doubted_where_it_moves_a_value(late_s, joints, codes):
    """What it moves the values by, in their deviations, is that of one more step of least squares."""
    model = right("scara", 1, noise=0.01)
    model = model.on("estimation").with_values(loaded("scara").start)
    own = model.experiments["estimation"]
    rates = functions_of_motion(model.simulation(model.start))
    shift = -late_s * np.column_stack([one[TORQUE_RATE] for one in rates])
    shift[:, joints:] = 0.0
    fit = point(with_torque(model, own.torque + shift), NoiseOfResidual(model))
    tested = residuals_of_fit(fit, dependence_module.tested_rows(fit))
    slopes = [one.slope(TORQUE_RATE) for one in tested]
    for (slope, deviation), is_late in zip(slopes, [True, joints == 2], strict=True):
        assert abs(-slope - late_s * is_late) < 4 * deviation
    slope, deviation = slopes[0]
    clock = Dependence(1, 1e-9, 0.2, TORQUE_RATE, 0.95, -late_s, deviation)
    told = replace(clock, moved=_moved_by_clock(fit, clock, tested))
    assert {d.code.name for d in motion_diagnostics([told])} == codes
    if joints == 2:
        table = (fit.jacobian / fit.deviation[:, None]).reshape(-1, fit.values.size)
        step = np.linalg.lstsq(table, (shift / fit.deviation).ravel(), rcond=None)[0]
        moved = np.abs(step) / np.sqrt(np.diag(fit_uncertainty(fit).covariance))
        assert told.moved == pytest.approx(moved.max(), rel=0.05)
