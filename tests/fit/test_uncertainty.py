"""Standard deviations with noise of any colour: against dense algebra, and by counting what intervals contain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import toeplitz

from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.residual_noise import LOUDER, varies
from fmu_didim.fit.statistics import influence_efficient, influence_of_instruments, noise_deviation
from fmu_didim.fit.uncertainty import Uncertainty, chi_square_bounds, covariance_of, stretches, uncertainty
from tests.fit.test_autoregression import by_impulse_response
from tests.tools.monte_carlo import half_coloured

DURATION_S = 10.0
SIZES = np.array([0.5, 2.0])
"""Standard deviations of the noise of the two joints."""


def regressor(time: np.ndarray) -> np.ndarray:
    """(N, 2, 6) inertia, viscous and Coulomb friction of two joints in motion, the first two coupled."""
    w = 2 * np.pi * np.array([0.3, 0.7])
    speed = np.cos(w * time[:, None] + [0.4, 1.1]) + 0.4 * np.sin(2.3 * w * time[:, None])
    acceleration = -w * np.sin(w * time[:, None] + [0.4, 1.1]) + 0.92 * w * np.cos(2.3 * w * time[:, None])
    table = np.zeros((time.size, 2, 6))
    for j in range(2):
        own = np.column_stack([acceleration[:, j], speed[:, j], np.tanh(speed[:, j] / 0.05)])
        table[:, j, 3 * j : 3 * j + 3] = own
    table[:, 0, 3] = 0.3 * acceleration[:, 1]
    return table


@dataclass(frozen=True)
class Fit:
    """Weighted least squares of S x + e, with x = 0, on logs one below the other."""

    sensitivity: np.ndarray
    influence: np.ndarray
    times: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, *times: np.ndarray, weights: np.ndarray = SIZES) -> Fit:
        s = np.concatenate([regressor(time) for time in times])
        flat = influence_efficient((s / weights[:, None]).reshape(-1, s.shape[2]))
        return cls(s, flat.reshape(s.shape) / weights[:, None], times)

    def solve(self, noise: np.ndarray, **options: object) -> tuple[np.ndarray, Uncertainty]:
        """Values, and how well they are known."""
        values = np.einsum("mjp,mj->p", self.influence, noise)
        residual = noise - self.sensitivity @ values
        leverage = np.einsum("mjp,mjp->mj", self.sensitivity, self.influence)
        deviation = options.pop("deviation", noise_deviation(residual, leverage, floor=np.zeros(2)))
        logs = stretches(self.times)
        return values, uncertainty(residual, self.sensitivity, self.influence, deviation, logs, **options)

    def white(self, deviation: np.ndarray) -> np.ndarray:
        return np.einsum("mjp,mjq,j->pq", self.influence, self.influence, deviation**2)


def grid(rate_hz: float, *, gaps: float = 0.0, start: float = 0.0) -> np.ndarray:
    time = start + np.arange(round(DURATION_S * rate_hz)) / rate_hz
    return time[np.random.default_rng(5).random(time.size) >= gaps]


def noise_at(time: np.ndarray, rate_hz: float, seed: int, *, coloured: bool) -> np.ndarray:
    rng, places = np.random.default_rng(seed), np.rint((time - time[0]) * rate_hz).astype(int)
    shape = (int(places[-1]) + 1, 2)
    return SIZES * (half_coloured(rng, shape, rate_hz) if coloured else rng.normal(size=shape))[places]


FURTHER = [
    (200.0, True, 0.0, 240), (50.0, True, 0.0, 300), (10.0, True, 0.0, 450), (4.0, True, 0.0, 450),
    (200.0, False, 0.0, 240), (50.0, False, 0.1, 300), (4.0, False, 0.0, 450),
]  # fmt: skip
COUNTED = [
    (20.0, True, 0.0, 450), (50.0, True, 0.1, 300), (10.0, False, 0.0, 450),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in FURTHER),
]  # fmt: skip


@pytest.mark.gate
@pytest.mark.parametrize(("rate_hz", "coloured", "gaps", "seeds"), COUNTED)
def test_intervals_contain_the_truth(rate_hz: float, coloured: bool, gaps: float, seeds: int) -> None:
    """95 % intervals of all six values, counted; half of the power of coloured noise remembers 50 ms."""
    fit, inside, usual = Fit.of(grid(rate_hz, gaps=gaps)), [], []
    for seed in range(seeds):
        values, known = fit.solve(noise_at(fit.times[0], rate_hz, seed, coloured=coloured))
        freedom = (fit.times[0].size - 3) / known.inflation**2
        inside.append(np.abs(values) <= stats.t.ppf(0.975, freedom) * known.deviation)
        usual.append([colour.coefficients.size == 0 for colour in known.colours])
    # 93.8 to 95.9 % of very many draws; the share of so many as here scatters by 0.45 to 0.7 %.
    assert 91.5 <= 100 * np.mean(inside) <= 97.5
    if not coloured:
        assert np.mean(usual) > 0.91  # 95 to 99 %, by 1 %


def test_white_noise_keeps_its_covariance() -> None:
    fit = Fit.of(grid(50.0))
    deviation = np.array([0.6, 1.7])
    _, known = fit.solve(noise_at(fit.times[0], 50.0, 3, coloured=False), deviation=deviation)
    assert [colour.coefficients.size for colour in known.colours] == [0, 0]
    np.testing.assert_allclose(known.covariance, fit.white(deviation), rtol=1e-12)
    assert [colour.inflation for colour in known.colours] == [1.0, 1.0]
    assert all(colour.whiteness > 0.01 for colour in known.colours)


def test_covariance_is_that_of_dense_matrices_over_gaps_logs_and_rates() -> None:
    """Two logs at 50 Hz, one with gaps, and one at 20 Hz: each colour acts inside its log only."""
    times = (grid(50.0, gaps=0.1), grid(50.0, start=100.0), grid(20.0, start=200.0))
    fit = Fit.of(*times)
    noise = np.concatenate(
        [noise_at(t, r, i, coloured=True) for i, (t, r) in enumerate(zip(times, (50, 50, 20), strict=True))]
    )
    _, known = fit.solve(noise)
    assert {(c.rate_hz, c.joint) for c in known.colours} == {(20.0, 1), (20.0, 2), (50.0, 1), (50.0, 2)}
    assert all(c.coefficients.size for c in known.colours if c.rate_hz == 50.0)
    expected, first = np.zeros((6, 6)), 0
    for time, rate in zip(times, (50.0, 50.0, 20.0), strict=True):
        places = np.rint((time - time[0]) * rate).astype(int)
        for colour in (c for c in known.colours if c.rate_hz == rate):
            covariance = by_impulse_response(colour.coefficients, places[-1] + 1)
            omega = colour.variance * toeplitz(covariance / covariance[0])[np.ix_(places, places)]
            phi = fit.influence[first : first + time.size, colour.joint - 1]
            expected += phi.T @ omega @ phi
        first += time.size
    np.testing.assert_allclose(known.covariance, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


def test_a_long_pause_needs_no_memory() -> None:
    """An hour between two parts of a log at 50 Hz: as two logs, since nothing remembers for so long."""
    first, second = grid(50.0), grid(50.0, start=3600.0)
    noise = np.concatenate([noise_at(t, 50.0, i, coloured=True) for i, t in enumerate((first, second))])
    apart = Fit.of(first, second).solve(noise)[1]
    whole = Fit.of(np.concatenate([first, second])).solve(noise)[1]
    np.testing.assert_allclose(whole.deviation, apart.deviation, rtol=0.02)
    assert [c.rate_hz for c in whole.colours] == [50.0, 50.0]


def test_joints_with_and_without_colour_are_told_apart() -> None:
    fit, seeds, found = Fit.of(grid(50.0)), 60, []
    for seed in range(seeds):
        noise = noise_at(fit.times[0], 50.0, seed, coloured=False)
        noise[:, 1] = noise_at(fit.times[0], 50.0, seed + seeds, coloured=True)[:, 1]
        first, second = fit.solve(noise)[1].colours
        found.append((first.coefficients.size, first.inflation, second.coefficients.size, second.inflation))
        assert second.lag_one > 0.15
    orders_first, inflation_first, orders_second, inflation_second = np.array(found).T
    assert np.mean(orders_first == 0) > 0.6
    assert abs(inflation_first.mean() - 1) < 0.05
    assert (orders_second > 0).all()
    # With the noise as it is: half white, half with the correlation exp(-0.4 k).
    rho = 0.5 * np.exp(-0.4 * np.arange(fit.times[0].size)) + 0.5 * (np.arange(fit.times[0].size) == 0)
    phi, every = fit.influence[:, 1] * SIZES[1], np.diag(fit.white(SIZES))
    expected = np.sqrt(np.sum(np.diag(phi.T @ toeplitz(rho) @ phi) / every) / np.sum(np.diag(phi.T @ phi) / every))
    assert expected > 1.4
    assert inflation_second.mean() == pytest.approx(expected, rel=0.06)


def test_equal_weights_count_each_joint_with_its_own_noise() -> None:
    """The weights of the fit are wrong, its covariance is not."""
    fit, seeds = Fit.of(grid(20.0), weights=np.ones(2)), 300
    found = [fit.solve(noise_at(fit.times[0], 20.0, seed, coloured=False)) for seed in range(seeds)]
    scatter = np.std([values for values, _ in found], axis=0)
    stated = np.sqrt(np.mean([known.deviation**2 for _, known in found], axis=0))
    # A deviation from 300 draws is known to 4 %.
    np.testing.assert_allclose(stated, scatter, rtol=0.13)


@pytest.mark.gate
def test_instruments_count_as_they_do() -> None:
    """The fixed point of W'(y - S x) = 0 with noise that remembers 50 ms, as of DIDIM."""
    time, seeds = grid(50.0), 100
    s = regressor(time)
    w = s + 0.3 * np.roll(s, 7, axis=0)
    flat = influence_of_instruments((w / SIZES[:, None]).reshape(-1, 6), (s / SIZES[:, None]).reshape(-1, 6))
    fit, inside = Fit(s, flat.reshape(s.shape) / SIZES[:, None], (time,)), []
    for seed in range(seeds):
        values, known = fit.solve(noise_at(time, 50.0, seed, coloured=True))
        inside.append(np.abs(values) <= stats.t.ppf(0.975, 200) * known.deviation)
    assert 92.0 <= 100 * np.mean(inside) <= 97.0


@pytest.mark.gate
@pytest.mark.parametrize(
    ("stated", "coloured", "counts", "has_colour"),
    [
        (1.0, False, "stated", False), (1.0, True, "stated", True), (0.5, False, "residual", False),
        (0.5, True, "residual", True), (2.0, False, "stated", False), (4.0, True, "stated", False),
    ],
    ids=["right", "right, coloured", "too small", "too small, coloured", "too large", "too large, coloured"],
)  # fmt: skip
def test_stated_noise_counts_unless_the_residual_is_larger(
    stated: float, coloured: bool, counts: str, has_colour: bool
) -> None:
    """Over 40 draws: of white noise 3 in 100 seem to have a colour, 2 in 1000 to be larger than it is."""
    fit, as_expected = Fit.of(grid(50.0)), []
    for seed in range(40):
        noise = noise_at(fit.times[0], 50.0, seed, coloured=coloured)
        _, known = fit.solve(noise, deviation=stated * SIZES, stated=True)
        for colour, size in zip(known.colours, SIZES, strict=True):
            assert colour.residual_variance == pytest.approx(size**2, rel=0.45)
            expected = (stated * size) ** 2 if counts == "stated" else colour.residual_variance
            is_variance = colour.variance == pytest.approx(expected, rel=1e-3 if counts == "stated" else 0.02)
            as_expected.append(is_variance and bool(colour.coefficients.size) is has_colour)
        if all(as_expected[-2:]) and not has_colour and counts == "stated":
            np.testing.assert_allclose(known.covariance, fit.white(stated * SIZES), rtol=1e-12)
    assert np.mean(as_expected) >= (0.97 if has_colour else 0.9)


def test_rounding_has_no_colour() -> None:
    """Data without noise: what is left is the integration's, as slow as the motion."""
    fit = Fit.of(grid(50.0))
    rounding = 1e-14 * np.sin(fit.times[0])[:, None] * np.ones(2)
    _, known = fit.solve(rounding, deviation=np.full(2, 1e-12), floor=np.full(2, 1e-12))
    assert [(c.coefficients.size, c.whiteness, c.inflation) for c in known.colours] == [(0, 1.0, 1.0)] * 2
    _, silent = fit.solve(np.zeros_like(rounding), deviation=np.full(2, 1e-12), floor=np.full(2, 1e-12))
    np.testing.assert_allclose(silent.covariance, fit.white(np.full(2, 1e-12)), rtol=1e-12)


def test_few_samples_count_as_white() -> None:
    fit = Fit.of(grid(1.5))
    _, known = fit.solve(np.cumsum(noise_at(fit.times[0], 1.5, 2, coloured=False), axis=0))
    assert [c.coefficients.size for c in known.colours] == [0, 0]


def test_slow_model_error_makes_deviations_larger() -> None:
    """A residual that is a slow wave, not noise: its samples are far from independent, and intervals say so."""
    fit = Fit.of(grid(200.0))
    wave = SIZES * np.sin(2 * np.pi * 0.45 * fit.times[0])[:, None]
    for seed in range(20):
        _, known = fit.solve(wave + 0.1 * noise_at(fit.times[0], 200.0, seed, coloured=False))
        assert all(colour.lag_one > 0.8 and colour.inflation > 3 for colour in known.colours)


@pytest.mark.parametrize("samples", [10.0, 200.0, 5000.0])
def test_bounds_of_chi_square(samples: float) -> None:
    """White noise of so many samples leaves them once in a thousand, each."""
    least, most = chi_square_bounds(samples)
    assert stats.chi2.sf(most * samples, samples) == pytest.approx(0.001)
    assert stats.chi2.cdf(least * samples, samples) == pytest.approx(0.001)


def test_noise_that_is_known_from_few_samples_bounds_less() -> None:
    """The ratio of two variances, drawn."""
    rng = np.random.default_rng(1)
    ratios = (rng.chisquare(100, 400_000) / 100) / (rng.chisquare(40, 400_000) / 40)
    least, most = chi_square_bounds(100, 40)
    np.testing.assert_allclose([least, most], np.quantile(ratios, [0.001, 0.999]), rtol=0.03)
    assert most > chi_square_bounds(100)[1]


def loud(torque: np.ndarray, rng: np.random.Generator, share: float) -> np.ndarray:
    """White noise of which a share grows with the size of the torque."""
    size = np.abs(torque) / np.sqrt(np.mean(torque**2, axis=0))
    return np.asarray(SIZES * (1 - share + share * size) * rng.normal(size=torque.shape))


TORQUE = np.array([1.0, 0.4, 3.0, 2.0, 0.3, 1.0])
"""Values of inertia, viscous and Coulomb friction of two joints."""


@pytest.mark.gate
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("rate_hz", [20.0, 50.0])
def test_intervals_contain_the_truth_where_noise_grows_with_the_torque(share: float, rate_hz: float) -> None:
    fit, rng, inside, usual = Fit.of(grid(rate_hz, gaps=0.1)), np.random.default_rng(8), [], []
    torque, seeds = fit.sensitivity @ TORQUE, 300
    for _ in range(seeds):
        values, known = fit.solve(loud(torque, rng, share), size=torque)
        inside.append(np.abs(values) <= stats.t.ppf(0.975, fit.times[0].size - 3) * known.deviation)
        usual.append([colour.is_louder for colour in known.colours])
    assert 92.0 <= 100 * np.mean(inside) <= 97.0
    assert np.mean(usual) < 0.03 if not share else np.mean(usual) > 0.85


def test_louder_noise_counts_sample_by_sample() -> None:
    """As by dense algebra over two logs with gaps; outputs whose noise is as loud everywhere keep their variance."""
    times = (grid(20.0, gaps=0.1), grid(20.0, start=100.0))
    fit, rng = Fit.of(*times), np.random.default_rng(3)
    torque = fit.sensitivity @ TORQUE
    noise = loud(torque, rng, 0.0)
    noise[:, 1] = loud(torque, rng, 1.0)[:, 1]
    values, known = fit.solve(noise, size=torque)
    assert [colour.is_louder for colour in known.colours] == [False, True]
    assert [colour.coefficients.size for colour in known.colours] == [0, 0]
    leverage = np.einsum("mjp,mjp->mj", fit.sensitivity, fit.influence)
    squares = ((noise - fit.sensitivity @ values) / (1 - leverage)) ** 2
    first, second = known.colours
    variance = second.variance * squares[:, 1] / squares[:, 1].mean()
    phi = fit.influence
    expected = phi[:, 0].T @ phi[:, 0] * first.variance + (phi[:, 1].T * variance) @ phi[:, 1]
    np.testing.assert_allclose(known.covariance, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(covariance_of(phi, known, stretches(times)), expected, rtol=1e-9, atol=1e-15)
    assert first.inflation == 1.0 and second.inflation != 1.0


@pytest.mark.parametrize(
    ("options", "shape", "told"),
    [
        ({}, "loud", [True, True]),
        ({"size": None}, "loud", [False, False]),  # nothing is known that noise may follow
        ({"stated": True}, "loud", [False, False]),  # the case says how loud it is
        ({"stated": np.array([True, False])}, "loud", [False, True]),
        ({"floor": np.full(2, 100.0)}, "loud", [False, False]),  # rounding
        ({}, "alike", [False, False]),
        ({}, "misfit", [False, False]),  # what is loud where the model is wrong has a colour
    ],
)
def test_which_noise_is_louder_in_places(options: dict[str, object], shape: str, told: list[bool]) -> None:
    fit, rng = Fit.of(grid(50.0)), np.random.default_rng(6)
    torque = fit.sensitivity @ TORQUE
    noise = loud(torque, rng, 0.0 if shape == "alike" else 1.0)
    if shape == "misfit":  # friction that grows with the load, three times as large as the noise
        speed = fit.sensitivity[:, [0, 1], [1, 4]]
        noise = noise + 3 * SIZES * np.sign(speed) * np.abs(torque) / torque.std(axis=0)
    _, known = fit.solve(noise, **({"size": torque, "deviation": SIZES} | options))
    assert [colour.is_louder for colour in known.colours] == told
    if not any(told):
        assert (known.loudness == 1).all()


@pytest.mark.parametrize(
    ("squares", "causes", "is_found"),
    [
        (lambda e, f: e**2, lambda f: f[:, None], False),
        (lambda e, f: (f * e) ** 2, lambda f: f[:, None], True),
        (lambda e, f: (e / f) ** 2, lambda f: f[:, None], True),  # softer there
        (lambda e, f: (f * e) ** 2, lambda f: np.column_stack([np.ones(f.size), np.zeros(f.size), f]), True),
        (lambda e, f: (f * e) ** 2, lambda f: np.ones((f.size, 2)), False),  # causes that do not vary
        (lambda e, f: 0 * e, lambda f: f[:, None], False),  # no residual
        (lambda e, f: np.where(np.arange(e.size) == 7, 400.0, e**2), lambda f: f[:, None], False),  # one outlier
    ],
)
def test_what_squares_follow(squares: Callable[..., Array], causes: Callable[..., Array], is_found: bool) -> None:
    rng = np.random.default_rng(2)
    size = 0.3 + np.abs(np.sin(0.05 * np.arange(400)))
    assert (varies(squares(rng.normal(size=400), size), causes(size)) < LOUDER) is is_found
