"""How own data can mislead: each way is told, by refusal or by a doubt under its code, before any fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.diagnostics import DOUBT, PROBLEM, DiagnosedError
from fmu_didim.base.errors import InputError
from fmu_didim.case import load_case
from fmu_didim.case.build import Case
from fmu_didim.workflow.data import case_diagnostics
from tests.cases import SCARA

DEG = 180 / np.pi


def table(path: Path, header: str, *columns: Any, decimal: str = ".", delimiter: str = ";") -> None:
    rows = (delimiter.join(f"{v:.10g}".replace(".", decimal) for v in row) for row in np.column_stack(columns))
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")


def case(
    folder: Path, *, motion: str = "t;q1 [°];q2 [°]", sign: float = 1.0, decimal: str = ".", **changes: Any
) -> Case:
    """The SCARA with its reference in degrees and its torque in SI, written by a logger with semicolons."""
    run = load_case(SCARA).model.experiments["estimation"]
    q = DEG * run.reference.select(["q1", "q2"]) + changes.pop("noise", 0.0) * np.random.default_rng(1).normal(
        size=(run.reference.time.size, 2)
    )
    table(folder / "motion.csv", motion, run.reference.time, q, decimal=decimal)
    table(folder / "log.csv", "t;tau1;tau2", run.time, sign * run.torque, decimal=decimal)
    content = load_case(SCARA).content | {"validation": None}
    content["train"] = {
        "reference": {"file": str(folder / "motion.csv"), **changes.pop("reference", {})},
        "torque": {"file": str(folder / "log.csv"), **changes.pop("torque", {})},
    }
    return load_case(content, folder=SCARA.parent)


def codes(made: Case) -> dict[str, set[str]]:
    found = case_diagnostics(made)
    return {s.value: {d.code.name for d in found if d.code.severity is s} for s in (PROBLEM, DOUBT)}


def test_right_data_are_not_doubted(tmp_path: Path) -> None:
    assert codes(case(tmp_path)) == {"problem": set(), "doubt": set()}
    assert codes(case(tmp_path, decimal=",")) == {"problem": set(), "doubt": set()}


UNIT = {name: {"name": f"{name} [°]", "unit": "rad"} for name in ("q1", "q2")}
TURNED = {name: {"name": name, "sign": -1} for name in ("tau1", "tau2")}


@pytest.mark.gate
@pytest.mark.parametrize(
    ("build", "severity", "code"),
    [
        # Degrees for radians: nothing in the file says so, the log does.
        (lambda path: case(path, motion="t;q1;q2"), "problem", "reference-unit"),
        # The case says another unit than the file.
        (lambda path: case(path, reference={"columns": UNIT}), "doubt", "unit-contradicts-file"),
        # A unit in the file that nobody knows.
        (lambda path: unknown_unit(path), "doubt", "unit-unknown"),
        # A sign that is the wrong way round, in the log or in the case.
        (lambda path: case(path, sign=-1.0), "problem", "torque-sign"),
        (lambda path: case(path, torque={"columns": TURNED}), "problem", "torque-sign"),
        # Velocities from measured positions.
        (lambda path: case(path, noise=0.02), "doubt", "reference-derived-from-noise"),
        # A rate by hand that is not that of the stamps.
        (lambda path: case(path, torque={"time": {"rate_hz": 11}}), "doubt", "time-contradicts-file"),
    ],
)
def test_told(tmp_path: Path, build: Callable[[Path], Case], severity: str, code: str) -> None:
    assert code in codes(build(tmp_path))[severity]


def unknown_unit(path: Path) -> Case:
    """Encoder counts, by a row of units."""
    content = case(path).content
    lines = (path / "motion.csv").read_text(encoding="utf-8").splitlines()
    (path / "motion.csv").write_text("\n".join(["t;q1;q2", "s;Inc;Inc", *lines[1:]]) + "\n", encoding="utf-8")
    return load_case(content, folder=SCARA.parent)


def test_decimal_comma_in_a_file_that_is_separated_by_commas(tmp_path: Path) -> None:
    case(tmp_path)
    text = (tmp_path / "log.csv").read_text(encoding="utf-8").replace(".", ",").replace(";", ",")
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    content = load_case(SCARA).content | {"validation": None}
    content["train"] = {"reference": content["train"]["reference"], "torque": {"file": str(tmp_path / "log.csv")}}
    with pytest.raises(InputError, match=r"not a row of numbers[\s\S]*log\.csv"):
        load_case(content, folder=SCARA.parent)


def test_a_unit_row_is_not_swallowed(tmp_path: Path) -> None:
    """Neither taken for the header nor for data: its units are applied."""
    made = case(tmp_path)
    lines = (tmp_path / "motion.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "motion.csv").write_text("\n".join(["t;q1;q2", "s;°;°", *lines[1:]]) + "\n", encoding="utf-8")
    again = load_case(made.content, folder=SCARA.parent)
    assert (
        again.model.experiments["estimation"].reference.digest()
        == made.model.experiments["estimation"].reference.digest()
    )


def test_dropped_rows_are_refused_and_told_where_they_are_filled_in(tmp_path: Path) -> None:
    made = case(tmp_path)
    lines = (tmp_path / "motion.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "motion.csv").write_text("\n".join([*lines[:500], *lines[503:]]) + "\n", encoding="utf-8")
    with pytest.raises(
        DiagnosedError, match=r"motion\.csv[\s\S]*3 rows are missing|3 rows are missing[\s\S]*motion\.csv"
    ):
        load_case(made.content, folder=SCARA.parent)
    content = made.content
    content["train"]["reference"]["resample"] = True
    assert "reference-gaps" in codes(load_case(content, folder=SCARA.parent))["doubt"]


def test_the_file_that_is_wrong_is_named(tmp_path: Path) -> None:
    made = case(tmp_path)
    lines = (tmp_path / "motion.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "motion.csv").write_text("\n".join(lines[:1000]) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"log\.csv reaches beyond its reference \(.*motion\.csv\)"):
        load_case(made.content, folder=SCARA.parent)
