"""Cases with several experiments and unknowns around the robot: what is wrong with them is said when they are read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.case import load_case
from tests.cases import plant_case, scara_case

EXAMPLE = Path("examples/scara/two_payloads.yaml")
Change = Callable[[dict[str, Any]], Any]


def changed(change: Change) -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    change(document)
    return document


def relabelled(label: str) -> Change:
    return lambda d: d["experiments"].update({label: d["experiments"].pop("later")})


def free(name: str, **entry: object) -> Change:
    return lambda d: d["identify"].update({name: entry})


def own(label: str, *names: str) -> Change:
    return lambda d: d["experiments"][label].update(own=list(names))


@pytest.mark.gate
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (relabelled("a/b"), "'a/b' becomes part of file names"),
        (relabelled(".."), "becomes part of file names"),
        (relabelled(""), "becomes part of file names"),
        (relabelled("x[y]"), "becomes part of file names"),
        (relabelled("Empty"), "empty, Empty differ only in capitals"),
        (own("payload", "ZZ9"), "Did you mean 'ZZ2'"),
        (own("payload", "ZZ2", "ZZ2"), "payload.own: name ZZ2 once"),
        (own("later", "ZZ2"), "role estimation, not for later"),
        (free("ZZ2", of="controller", parameter="Kp2"), "has this name already"),
        (free("gain", of="controller", parameter="Kp2"), "got:   Kp2 and gain"),
        (free("gain", of="controler"), "Did you mean 'controller'"),
        (free("gain", of="controller", parameter="Kp9"), "no parameter of the controller named 'Kp9'"),
        (free("gain", of="drive"), "needs the joint"),
        (free("gain", of="drive", joint=7), r"no such joint[\s\S]*valid: 1 to 2"),
        (free("late", of="log", minimum=3, maximum=1), "late: give minimum <= start <= maximum"),
        (free("Kp2", of="controller", start=-3, minimum=0), "Kp2: give minimum <= start <= maximum"),
        (free("Kd2", of="controller", maximum=0.5), r"outside the limits[\s\S]*got:   4"),
    ],
)
def test_what_is_wrong_is_said(change: Change, words: str) -> None:
    with pytest.raises(FmuDidimError, match=words):
        load_case(changed(change), folder=EXAMPLE.parent.resolve())


@pytest.mark.parametrize("label", ["later", "2", "run-2.1_b"])
def test_a_label_may_be_a_part_of_a_file_name(label: str) -> None:
    case = load_case(changed(relabelled(label)), folder=EXAMPLE.parent.resolve())
    assert tuple(case.model.experiments) == ("empty", "payload", label)


def test_a_gain_may_be_of_one_experiment_alone() -> None:
    case = load_case(changed(own("payload", "Kp2")), folder=EXAMPLE.parent.resolve())
    assert case.model.names[-2:] == ("Kp2", "Kp2[payload]")


@pytest.mark.parametrize("of", ["controller", "plant"])
@pytest.mark.parametrize(
    ("limits", "start", "valid"),
    [
        ({}, None, ""),
        ({"minimum": 0.0}, None, ""),
        ({"minimum": 9.0}, None, "9 to inf"),
        ({"maximum": 0.001}, None, "-inf to 0.001"),
        ({"minimum": -2.0, "maximum": -1.0}, None, "-2 to -1"),
        ({"minimum": 9.0}, 9.0, ""),
        ({"minimum": 8.0, "maximum": 9.0}, 8.5, ""),
    ],
)
def test_a_start_value_outside_the_limits_is_refused(
    tmp_path: Path, of: str, limits: dict[str, float], start: float | None, valid: str
) -> None:
    """The same for an unknown of the loop and for a parameter of a plant without robot description, whose start values
    are their own where the case gives none."""
    entry = {"of": of, "parameter": "Kd2" if of == "controller" else "Fv1", "start": start, **limits}
    entries = {"sought": entry}
    path = scara_case(tmp_path, identify=entries) if of == "controller" else plant_case(tmp_path, entries)
    if valid:
        with pytest.raises(InputError, match=rf"outside the limits[\s\S]*identify\.sought[\s\S]*valid: {valid}"):
            _ = load_case(path).model
        return
    found = next(p for p in load_case(path).model.free_parameters if p.name == "sought")
    assert (found.lowest, found.highest) == (limits.get("minimum", -np.inf), limits.get("maximum", np.inf))
    assert start is None or found.value == start
