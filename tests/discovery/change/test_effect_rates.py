"""How often a comparison of two simulated logs with their loops is wrong: nothing has changed, a value, an effect, or
two of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import Log, RobotDescription, compare, load_case, simulate
from tests.discovery.change.pairs import CASE, NOISE, ROBOT, identified, with_mass
from tests.discovery.change.test_rates import FALSE_ALARMS, IN_SET, PAYLOAD, RIGHT, Drawn, _friction, _mass, _warm

PAIRS = 60
CONTROLLER = "controllers/scara_pd.yaml"
GEAR = {"K": 3000.0, "D": 8.0}
"""N.m/rad and N.m.s/rad, of the second joint where it has play."""
LATE, BACKLASH = "time shift of the torque log, new", "backlash on joint 2, new"
SCALE, GAIN = "torque scale of joint 2", "gain of the controller on joint 2, new"


def log_of(
    folder: Path,
    rate_hz: float,
    seed: int,
    *,
    values: Mapping[str, float] | None = None,
    mass: tuple[float, float, float] | None = None,
    gap: float = 0.0,
    late_s: float = 0.0,
    controller: float = 1.0,
    gain: float = 1.0,
) -> Log:
    """A log of the torque.

    Args:
        values, mass: of the robot; gap: of its second joint, rad; late_s: by which stamps are late.
        controller: what the gains of the second joint are over those of the case; gain: what its log says over the
            torque.
    """
    content = yaml.safe_load(Path(ROBOT).read_text(encoding="utf-8"))
    if gap:
        content["joints"][1]["effects"].append("backlash")
        content["joints"][1]["parameters"] |= GEAR | {"gap": gap}
    robot = RobotDescription.model_validate(content).with_values(dict(values or {}))
    law = yaml.safe_load(Path(CONTROLLER).read_text(encoding="utf-8"))
    for key in ("Kp", "Kd"):
        law[key][1] *= controller
    path = folder / "law.yaml"
    path.write_text(yaml.safe_dump(law), encoding="utf-8")
    loop = {"plant": {"kind": "model"}, "controller": {"kind": "model", "source": str(path)}}
    case = load_case(CASE).with_(validation=None, **loop)  # type: ignore[arg-type]
    table = simulate(case, robot=robot if mass is None else with_mass(robot, *mass))
    step = table.time[1] - table.time[0]
    rows = slice(0, table.time.size - 1, round(1 / rate_hz / step))
    instants = table.time[rows] - late_s
    torque = np.column_stack([np.interp(instants, table.time, table.column(f"tau{j}")) for j in (1, 2)]) * (1.0, gain)
    return Log(table.time[rows], torque + NOISE * np.random.default_rng(seed).normal(size=torque.shape))


def _late(rng: np.random.Generator) -> dict[str, Any]:
    return {"late_s": rng.uniform(0.006, 0.02)}


def _controller(rng: np.random.Generator) -> dict[str, Any]:
    """A tight loop hides its gain: by 25 % it changes this log by half of its noise, by 50 % by twice that."""
    return {"controller": 1 + rng.uniform(0.35, 0.6) * rng.choice([-1, 1])}


KINDS: Mapping[str, Callable[[np.random.Generator], Drawn]] = {
    "friction 1": lambda rng: (_friction(rng, 1), {"friction of joint 1"}),
    "friction 2": lambda rng: (_friction(rng, 2), {"friction of joint 2"}),
    "warm": lambda rng: (_warm(rng), {"friction of all joints"}),
    "payload": lambda rng: (_mass(rng), {PAYLOAD}),
    "log scale": lambda rng: ({"gain": 1 + rng.uniform(0.06, 0.15) * rng.choice([-1, 1])}, {SCALE}),
    "backlash": lambda rng: ({"gap": rng.uniform(0.004, 0.012)}, {BACKLASH}),
    "clock": lambda rng: (_late(rng), {LATE}),
    "controller": lambda rng: (_controller(rng), {GAIN}),
    "payload, clock": lambda rng: (_mass(rng) | _late(rng), {PAYLOAD, LATE}),
    "clock, controller": lambda rng: (_late(rng) | _controller(rng), {LATE, GAIN}),
    "friction 1, controller": lambda rng: (_friction(rng, 1) | _controller(rng), {"friction of joint 1", GAIN}),
    "friction 2, payload": lambda rng: (_mass(rng) | _friction(rng, 2), {PAYLOAD, "friction of joint 2"}),
}


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_false_alarms_and_right_causes_with_effects(rate_hz: float, tmp_path: Path) -> None:
    kinds, counts, model = list(KINDS), Counter[str](), {"kind": "model"}
    for k in range(PAIRS):
        rng = np.random.default_rng(9000 + k)
        drawn, truth = KINDS[kinds[k // 2 % len(kinds)]](rng) if k % 2 else ({}, set())
        logs = log_of(tmp_path, rate_hz, 20 * k + 1), log_of(tmp_path, rate_hz, 20 * k + 2, **drawn)
        found = compare(*(identified(log, plant=model) for log in logs), effects=True)
        named = [{part.title for part in cause.parts} for cause in found.document.causes]
        if not truth:
            counts["still"] += 1
            counts["alarm"] += found.changed
            continue
        counts["changed"] += 1
        if truth == {SCALE}:  # with the gain of the loop, where that shows
            named = [each - {GAIN} if SCALE in each else each for each in named]
        counts["right"] += bool(named) and named[0] == truth
        counts["in set"] += truth in named
    assert counts["alarm"] <= FALSE_ALARMS * counts["still"]
    assert counts["right"] >= RIGHT * counts["changed"]
    assert counts["in set"] >= IN_SET * counts["changed"]
