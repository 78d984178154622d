"""Numbers that no option takes: refused before anything is done, with what is valid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from fmu_didim import discover
from fmu_didim.base.errors import InputError
from fmu_didim.case.document import make_estimator
from fmu_didim.cli.main import main


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("discover CASE --rounds -1", "--rounds: it takes a whole number from 0 on, not '-1'"),
        ("discover CASE --rounds two", "--rounds: it takes a whole number from 0 on, not 'two'"),
        ("discover CASE --seed -4", "--seed: it takes a whole number from 0 on"),
        ("discover CASE --time-limit 0", "--time-limit: it takes a number above 0"),
        ("discover CASE --time-limit nan", "--time-limit: it takes a number above 0, not 'nan'"),
        ("fmu check x.fmu --step 0", "--step: it takes a number above 0, not '0'"),
        ("fmu check x.fmu --step -0.1", "--step: it takes a number above 0"),
        ("fmu check x.fmu --time-limit inf", "--time-limit: it takes a number above 0"),
        ("campaign run c.yaml --workers 0", "--workers: it takes a whole number from 1 on, not '0'"),
        ("campaign run c.yaml --workers 1.5", "--workers: it takes a whole number from 1 on"),
    ],
)
def test_of_the_command_line(command: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(command.replace("CASE", "examples/scara/identify.yaml").split())
    assert caught.value.code == 2
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"tolerance": -1.0}, "tolerance: must be greater than 0 (got -1.0)"),
        ({"tolerance": 0}, "tolerance: must be greater than 0"),
        ({"maximum_iterations": 0}, "maximum_iterations: must be 1 or more"),
        ({"maximum_iterations": -3}, "maximum_iterations"),
        ({"finish_tolerance": 0.0}, "finish_tolerance"),
        ({"kind": "clie", "tolerance": -1.0}, "tolerance"),
        ({"kind": "clie", "maximum_iterations": 0}, "maximum_iterations"),
        ({"kind": "idim_ls", "cutoff_hz": 0.0}, "cutoff_hz"),
        ({"kind": "idim_ls", "decimation": 0}, "decimation"),
        ({"kind": "idim_ls", "skip": -1}, "skip"),
        ({"start": {"ZZ1R": "abc"}}, "start.ZZ1R must be a finite number"),
        ({"start": {"ZZ1R": float("nan")}}, "start.ZZ1R must be a finite number"),
        ({"start": {"ZZ1R": 1.0, "Fv1": float("inf")}}, "start.Fv1 must be a finite number"),
    ],
)
def test_of_estimators(options: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError) as caught:
        make_estimator(options)
    assert told in str(caught.value)


def test_of_the_python_interface(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="rounds"):
        discover("examples/scara/identify.yaml", tmp_path, rounds=-1)
