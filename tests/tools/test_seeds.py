"""Seeds of tests are shifted, those of the package and of fixed cases are not."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tools import seeds


def asked_by(module: str, seed: object) -> float:
    scope = {"__name__": module, "shifted": seeds.shifted, "seed": seed}
    exec("drawn = shifted(seed).random()", scope)
    return float(scope["drawn"])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("module", "seed", "moves"),
    [
        ("tests.fit.test_noise", 3, True),
        ("tests.fit.test_noise", [3, 4], True),
        ("tests.tools.blind.harness", 3, False),
        ("fmu_didim.fit.gap", 3, False),
    ],
)
def test_which_seeds_are_shifted(module: str, seed: object, moves: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = float(seeds._default_rng(seed).random())
    drawn = []
    for shift in ("1", "2"):
        monkeypatch.setenv(seeds.VARIABLE, shift)
        drawn.append(asked_by(module, seed))
    assert len({plain, *drawn}) == (3 if moves else 1)
    assert asked_by(module, seed) == drawn[1]


def test_what_fails_with_some_draws_is_listed_with_how_often(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(seeds, "failed", lambda shift, arguments: ["a::one", "a::two"] if shift == 2 else ["a::one"])
    assert seeds.main(["--shifts", "3", "tests/a"]) == 1
    assert capsys.readouterr().out.splitlines() == ["3 of 3: a::one", "1 of 3: a::two"]
    monkeypatch.setattr(seeds, "failed", lambda shift, arguments: [])
    assert seeds.main([]) == 0


def test_no_shift_without_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(seeds.VARIABLE, raising=False)
    before = np.random.default_rng
    seeds.pytest_configure()
    assert np.random.default_rng is before
