"""What tests of imported FMUs share: exported ones, and the outputs of slave.c."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from fmu_didim.export import build_fmu
from tests.helpers import scara, scara_cascade, scara_pd

H = 0.01
ONES = np.ones((10, 1))


def slave_outputs(u: np.ndarray, *, a: float = 2.0, d: float = 0.5, h: float = H) -> np.ndarray:
    """Outputs of slave.c by its own equations."""
    x, found = 0.0, []
    for value in u[:, 0]:
        found.append([x + d * value])
        x += h * (value - a * x)
    return np.array(found)


@cache
def exported(name: str, version: str) -> Path:
    blocks = {"scara": lambda: scara().block({"q_start1": 0.3}), "cascade": scara_cascade, "pd": scara_pd}
    return build_fmu(blocks[name](), fmi_version=version)
