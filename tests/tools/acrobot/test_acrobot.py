"""The tool of the disturbed double pendulum, on logs like those of its repository, made here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.tools.acrobot.__main__ import main
from tests.tools.acrobot.cases import CONTROLLER, DISTURBED, UNDISTURBED, Pulse, pulses, read, runs_of, write_cases
from tests.tools.acrobot.score import figures_of, known_pulse, scored, text

TIME = np.sort(np.arange(1500) / 500 + np.random.default_rng(0).uniform(0, 5e-4, 1500))
HALF = np.sqrt(2 * np.log(2))


def log(path: Path, *, disturbed: bool) -> None:
    """Drives that give what is asked for and, if disturbed, a bell on either joint, 5 ms late."""
    rng = np.random.default_rng(len(str(disturbed)))
    columns = {"time": TIME}
    for j, (middle, size) in enumerate(((1.0, 0.7), (2.0, -0.6)), start=1):
        asked = 0.5 * np.sin(2 * np.pi * TIME / j)
        bell = size * np.exp(-(((TIME - middle) / 0.07) ** 2) / 2) if disturbed else np.zeros(TIME.size)
        given = np.interp(TIME - 0.005, TIME, 0.98 * asked + bell) + 0.02 * rng.normal(size=TIME.size)
        columns |= {f"tau_con{j}": asked, f"tau_meas{j}": given} | ({f"tau_pert{j}": bell} if disturbed else {})
    path.parent.mkdir(parents=True)
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")


@pytest.fixture
def leaderboard(tmp_path: Path) -> Path:
    for folder, disturbed in ((DISTURBED, True), (UNDISTURBED, False)):
        own = tmp_path / "leaderboard" / "acrobot" / folder / "src_data" / CONTROLLER / "experiment01"
        log(own / "trajectory.csv", disturbed=disturbed)
    return tmp_path / "leaderboard"


def test_pulses_are_read_from_half_to_half(leaderboard: Path) -> None:
    disturbed, undisturbed = (read(path) for _, path in runs_of(leaderboard, "acrobot"))
    first, second = pulses(disturbed, 0.5)
    assert (first.joint, second.joint) == (1, 2)
    assert (first.torque, second.torque) == pytest.approx((0.7, -0.6), rel=0.01)
    assert first.begin_s == pytest.approx(1 - HALF * 0.07, abs=0.003)
    assert second.end_s == pytest.approx(2 + HALF * 0.07, abs=0.003)
    assert [p.joint for p in pulses(disturbed, 0.65)] == [1]
    assert pulses(undisturbed, 0.1) == []


def test_no_case_holds_what_disturbed(leaderboard: Path, tmp_path: Path) -> None:
    assert write_cases(runs_of(leaderboard, "acrobot"), tmp_path / "cases") == 2
    texts = [path.read_text() for path in (tmp_path / "cases").rglob("*") if path.suffix in (".csv", ".yaml")]
    assert texts and not any("pert" in one for one in texts)
    with pytest.raises(FileNotFoundError, match="checkout"):
        runs_of(leaderboard, "pendubot")


def window(signal: str, begin: float, end: float, torque: float) -> dict[str, object]:
    return {"signal": signal, "begin_s": begin, "end_s": end, "torque": torque}


def test_the_score_counts_a_window_once_and_names_what_is_beyond() -> None:
    asked = [Pulse(1, 1.0, 1.2, 0.6), Pulse(1, 3.0, 3.2, 0.6), Pulse(2, 1.0, 1.2, 0.6)]
    windows = [
        window("tau1", 1.01, 1.19, 0.6), window("tau1", 1.1, 1.4, 0.5), window("tau2", 1.05, 1.2, 0.6),
        window("tau1", 3.0, 3.2, -0.6), window("tau1", 5.0, 5.2, 0.1), window("tau1", 5.0, 5.02, 0.9),
    ]  # fmt: skip
    one = scored("disturbed01", {"windows": windows, "findings": [], "verdict": "doubtful"}, asked, least=0.5)
    assert (one.found, one.sharp, one.windows) == (2, 1, 6)
    assert list(one.beyond) == [windows[1], windows[3]]
    still = scored("undisturbed01", {"windows": windows[:1], "findings": [], "verdict": "valid"}, [], least=0.5)
    figures = figures_of([one, still])
    assert figures["found"] == "2 of 3" and figures["sharp"] == "1 of 3"
    assert figures["late"] == "30 and -5"
    assert figures_of([still])["late"] == ""
    assert figures["undisturbed_beyond"] == "1 of 1 runs"
    assert "missed" in text([one]) and "+10 -10 ms" in text([one])


def test_intervals_of_edges_are_held_against_the_log() -> None:
    """An edge that is late by less than the lag of its drive is one that the interval holds."""
    found = window("tau1", 1.01, 1.19, 0.6) | {"begin_interval": (1.004, 1.02), "end_interval": (1.15, 1.25)}
    document = {"windows": [found], "findings": [], "verdict": "doubtful"}
    asked = [Pulse(1, 1.0, 1.3, 0.6)]
    without = scored("disturbed01", document, asked, least=0.5)
    assert without.edges == ((False, pytest.approx(0.016)), (False, pytest.approx(0.1)))
    late = scored("disturbed01", {**document, "base_parameters": [{"name": "lag1", "value": 0.005}]}, asked, least=0.5)
    assert [holds for holds, _ in late.edges] == [True, False]
    figures = figures_of([late])
    assert (figures["intervals"], figures["wide"], figures["told"]) == ("1 of 2", "29", "1 of 2")
    near = [found | {"begin_s": 1.022, "end_s": 1.322}]  # 2 ms too late, and less than that by the lag of the drive
    both = scored("disturbed01", {**document, "windows": near, "base_parameters": [{"name": "lag1", "value": 0.005}]},
                  asked, least=0.5)  # fmt: skip
    assert (both.sharp, both.sharp_at_the_drive) == (0, 1)


def test_a_pulse_that_is_told_is_late_by_what_the_drive_adds(leaderboard: Path) -> None:
    disturbed = read(runs_of(leaderboard, "acrobot")[0][1])
    values = {"gain1": 0.98, "gain2": 0.98, "lag1": 1e-4, "lag2": 1e-4}
    assert [known_pulse(disturbed, p, values) for p in pulses(disturbed, 0.5)] == pytest.approx([0.005] * 2, abs=0.0025)


@pytest.mark.slow
def test_from_end_to_end(leaderboard: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, file = tmp_path / "cases", tmp_path / "figures.json"
    assert main(["make", str(leaderboard), str(folder)]) == 0
    assert main(["run", str(folder)]) == 0
    assert main(["score", str(leaderboard), str(folder), "--figures", str(file)]) == 0
    said = capsys.readouterr().out
    assert "found: 2 of 2" in said and "sharp: 2 of 2" in said, said
    assert "undisturbed_beyond: 0 of 1 runs" in said and "named_valid: 0" in said
    assert file.is_file()
