"""Which joint a column is of: by its number, by the name of a joint, or not to be told."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.data.tables import SignalTable
from fmu_didim.workflow.init.roles import guess, guesses

STRUCT = ("log.q1", "log.q2", "log.tau1", "log.tau2", "log.pos_error")
LIST = tuple(f"/joint_states.{field}.{joint}" for field in ("position", "effort") for joint in ("elbow", "wrist_1"))


@pytest.mark.parametrize(
    ("columns", "joints", "expected"),
    [
        (("q1", "q2", "tau1", "tau2"), (), [1, 2, 1, 2]),
        (STRUCT, (), [1, 2, 1, 2, None]),  # fields of a struct are no list
        (LIST, (), [None] * 4),  # wrist_1 is not the first joint
        (LIST, ("elbow", "wrist_1"), [1, 2, 1, 2]),
        (LIST, ("Wrist_1", "Elbow"), [2, 1, 2, 1]),
        (LIST, ("elbow", "hand"), [None] * 4),
        (("/s.position.joint1", "/s.position.joint2"), (), [1, 2]),
    ],
)
def test_joint_of_a_column(columns: tuple[str, ...], joints: tuple[str, ...], expected: list[int | None]) -> None:
    table = SignalTable({"time": np.arange(3.0), **{name: np.zeros(3) for name in columns}})
    assert [one.joint for one in guesses(table, joints)] == expected


def test_a_wrist_is_not_measured_because_of_its_letters() -> None:
    """German *ist* says that; the topic of joint states says it, too."""
    table = SignalTable(
        {"time": np.arange(3.0), "wrist1": np.zeros(3), "q1_ist": np.zeros(3), **dict.fromkeys(LIST, np.zeros(3))}
    )
    assert [one.side for one in guesses(table)] == ["", "measured", *["measured"] * 4]


@pytest.mark.parametrize(
    ("name", "unit", "expected"),
    [
        ("Temp1", "", True), ("Temperatur_Achse2", "", True), ("joint_temperatures.elbow", "", True),
        ("motor_temp_3", "", True), ("T_gear1", "degC", True), ("housing", "K", True),
        ("attempt1", "", False), ("template2", "", False), ("contempt_q1", "", False),
    ],
)  # fmt: skip
def test_temperatures_are_known_by_name_or_unit(name: str, unit: str, expected: bool) -> None:
    assert (guess(name, unit).role == "temperature") == expected
