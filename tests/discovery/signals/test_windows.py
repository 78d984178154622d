"""Pulses on the output of a model whose values they pull."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.data.signals import Array
from fmu_didim.discovery.signals.search import fitted
from fmu_didim.discovery.signals.windows import windows_of
from fmu_didim.fit.fit import Fit
from fmu_didim.results.findings import WindowResult
from tests.tools.acrobot.cases import write_cases
from tests.tools.acrobot.test_acrobot import TIME, log

BEGIN, END, SIZE = 1.4, 1.6, -0.6
"""[s], [N.m] Of the pulse on the first drive: it pushes back where the command is at its largest."""


def fit_of(folder: Path, pulse: Array) -> Fit:
    """Two drives, fitted to a log of 3 s with a pulse (N,) on what the first one gives."""
    path = folder / "runs/log.csv"
    log(path, disturbed=False)
    header = path.read_text("utf-8").split("\n", 1)[0]
    names, table = header.split(","), np.loadtxt(path, delimiter=",", skiprows=1)
    asked = 1.5 * np.exp(-(((TIME[:, None] - [0.5, 1.5, 2.5]) / 0.25) ** 2)).sum(axis=1)
    noise = 0.02 * np.random.default_rng(7).normal(size=TIME.size)
    table[:, names.index("tau_con1")] = asked
    table[:, names.index("tau_meas1")] = np.interp(TIME - 0.005, TIME, asked) + pulse + noise
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    assert write_cases([("one", path)], folder / "cases") == 1
    return fitted(load_case(folder / "cases/one/case.yaml").model, until=np.inf)


def windows(fit: Fit) -> list[WindowResult]:
    return [w for w in windows_of(fit) if w.signal == "tau1"]


def test_a_pulse_is_told_beside_values_that_it_does_not_pull(tmp_path: Path) -> None:
    """What the fit itself leaves of it is a fifth too low and begins 10 ms late."""
    fit = fit_of(tmp_path, SIZE * 0.5 ** (((TIME - (BEGIN + END) / 2) / ((END - BEGIN) / 2)) ** 2))
    values = dict(zip(fit.model.names, fit.values.tolist(), strict=True))
    assert values["gain1"] < 0.95
    (window,) = windows(fit)
    assert (window.begin_s, window.end_s) == pytest.approx((BEGIN, END), abs=0.006)
    assert window.torque == pytest.approx(SIZE, rel=0.1)


def test_without_a_pulse_there_is_no_window(tmp_path: Path) -> None:
    assert windows(fit_of(tmp_path, np.zeros(TIME.size))) == []
