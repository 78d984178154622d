"""Curves of what has no name against the function that a case hides, and against effects that are there.

python -m tests.tools.blind.curves FOLDER LINES [FOLDER LINES ...] [--pairs FOLDER LINES] [--figures JSON]

FOLDER of cases, LINES that discovery wrote of them. Pairs: cases that hide several effects of the catalogue on one
joint, which must keep their names.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.figures import command_of, write_figures
from tests.tools.blind.harness import read_lines
from tests.tools.blind.score import matches, read_truth, same_class

Array = np.ndarray
VARIABLES = {
    "q": "the position of the joint", "dq": "the velocity of the joint", "t": "the time",
    "other q": "the position of the neighbour", "distance": "the distance since the last reversal",
}  # fmt: skip
"""Of a hidden function -> in words, as of a curve."""
MOSTLY = 0.9
"""[1] Part of the range in which a function must lie in the band."""
RIPPLE, RIPPLES, STRIBECK, STRIBECK_RAD_S = 0.06, (17.0, 23.0), 0.05, 0.1
"""[1], [1/rad] a joint, [1], [rad/s] Of the clutter that cases plant on each joint, by its Coulomb friction: it is a
part of what is missing there over the position and the velocity."""
INSIDE = (0.05, 0.95)
"""[1] Part of the range of a curve that is compared: at its ends hardly a sample lies."""


@dataclass(frozen=True)
class Compared:
    """A case and its curve.

    Attributes:
        hidden: the hidden function; answer, judged: the answer and its verdict; named: effects that stand in it.
        is_found: whether the variable was found on its joint; within: the part of the range where the function lies in
            the 95 % interval, NaN without a curve.
    """

    hidden: str
    rate_hz: float
    answer: str
    judged: str
    named: tuple[str, ...]
    is_found: bool
    within: float

    @property
    def is_refused(self) -> bool:
        """Whether nothing was named."""
        return not self.named

    @property
    def is_outside(self) -> bool:
        """Whether a function of time was named as nothing but a torque from outside, which it may be."""
        alike = all(same_class(one.split(",")[0], "external_force") for one in self.named)
        return self.hidden == "unknown_swell" and not self.is_refused and alike


def hidden_function(folder: Path, truth_file: Path | None = None) -> tuple[str, str, int, Callable[[Array], Array]]:
    """Name, variable in words, joint and function of what a case hides, in the angles of the case.

    Args:
        truth_file: where the truth stands, if not in the folder.
    """
    truth = yaml.safe_load((truth_file or folder / "truth.yaml").read_text(encoding="utf-8"))["truth"][0]
    case = yaml.safe_load((folder / "case.yaml").read_text(encoding="utf-8"))
    turned = re.search(r"s=(-?1) ", " ".join(case["robot"]["torque_equation"]))
    signs = [1.0, float(turned[1]) if turned else 1.0]
    joint, (text, variable) = int(truth["joint"]), truth["form"].split(", x = ")
    own, seen = signs[joint - 1], signs[2 - joint if variable == "other q" else joint - 1]
    seen = 1.0 if variable in ("t", "distance") else seen
    own = 1.0 if variable == "distance" else own  # a part of friction, along the motion

    def function(x: Array) -> Array:
        return own * np.asarray(eval(text, {"exp": np.exp, "x": seen * x}), dtype=float)

    return truth["effect"], VARIABLES[variable], joint, function


def planted_function(truth_file: Path, joint: int, variable: str) -> Callable[[Array], Array]:
    """What the clutter of a case makes of a variable on a joint, from 1, in N.m."""
    content = yaml.safe_load(truth_file.read_text(encoding="utf-8"))
    dry = 0.0 if content["clutter"] == "none" else float(content["parameters"][f"Fc{joint}"])

    def function(x: Array) -> Array:
        if variable == VARIABLES["q"]:
            return np.asarray(RIPPLE * dry * np.sin(RIPPLES[joint - 1] * x))
        if variable == VARIABLES["dq"]:
            return np.asarray(STRIBECK * dry * np.sign(x) * np.exp(-((x / STRIBECK_RAD_S) ** 2)))
        return np.zeros_like(x)

    return function


def within_band(
    curve: Mapping[str, Any], function: Callable[[Array], Array], planted: Callable[[Array], Array] = np.zeros_like
) -> float:
    """Part of the range in which the function lies in the band: after least squares of its size, its sign, and of what
    the model makes itself, a constant, a line, sine and cosine, and friction, which belong to no curve.

    Args:
        planted: torque of the same variable that is there beside it.
    """
    at, torque, half = (np.array(curve[key]) for key in ("at", "torque", "half_width"))
    torque = torque - planted(at)
    low, high = (at[0] + part * (at[-1] - at[0]) for part in INSIDE)
    seen = (at >= low) & (at <= high)
    own = [np.ones_like(at), at]
    if "position" in curve["variable"]:
        own += [np.sin(at), np.cos(at)]
    if "velocity" in curve["variable"]:
        own += [np.tanh(at / 0.01)]
    table = np.column_stack([function(at), *own])[seen]
    weight = 1 / half[seen]
    sizes = np.linalg.lstsq(table * weight[:, None], torque[seen] * weight, rcond=None)[0]
    return float(np.mean(np.abs(table @ sizes - torque[seen]) <= half[seen]))


def compared(folder: Path, line: Mapping[str, Any]) -> Compared:
    """The answer to a case against what it hides."""
    case = folder / line["case"]
    name, variable, joint, function = hidden_function(case)
    rate = float(yaml.safe_load((case / "case.yaml").read_text(encoding="utf-8"))["measurement"]["rate_hz"])
    own = [c for c in line["curves"] if c["joint"] == joint and c["variable"] == variable]
    planted = planted_function(case / "truth.yaml", joint, variable)
    within = within_band(own[0], function, planted) if own else float("nan")
    named = tuple(f"{f['effect']}, joint {f['joint']}" for f in line["findings"])
    return Compared(name, rate, line["verdict"], line["judged"], named, bool(own), within)


def figures(found: list[Compared]) -> dict[str, str]:
    """Cases by hidden function and rate: refused, named as a torque from outside, named in an answer called valid,
    variable found, function in the band on nine tenths of the range."""
    groups = defaultdict(list)
    for one in found:
        groups[one.hidden.removeprefix("unknown_"), one.rate_hz].append(one)
        groups["all", one.rate_hz].append(one)
    shown = {}
    for (name, rate), own in sorted(groups.items()):
        key, count = f"{name}_{rate:g}hz", len(own)
        shown[f"{key}_refused"] = f"{sum(one.is_refused for one in own)} of {count}"
        shown[f"{key}_outside"] = str(sum(one.is_outside for one in own))
        shown[f"{key}_named_valid"] = str(sum(not one.is_refused and one.judged == "valid" for one in own))
        shown[f"{key}_variable"] = f"{sum(one.is_found for one in own)} of {count}"
        shown[f"{key}_within"] = f"{sum(one.within >= MOSTLY for one in own)} of {sum(one.is_found for one in own)}"
    return shown


def pair_figures(folder: Path, lines: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Cases of several effects on one joint, by rate: all named by their class, and a curve in the place of names."""
    named, taken = defaultdict[float, list[bool]](list), defaultdict[float, list[bool]](list)
    for line in lines:
        truth = read_truth(folder / line["case"])
        found, joint = line["findings"], truth.effects[0][1]
        named[truth.rate_hz].append(all(any(matches(f, e, j) for f in found) for e, j in truth.effects))
        drawn = any(curve["joint"] == joint for curve in line["curves"])
        taken[truth.rate_hz].append(drawn and not any(f["joint"] == joint for f in found))
    shown = {}
    for rate, own in sorted(named.items()):
        shown[f"pairs_{rate:g}hz_named"] = f"{sum(own)} of {len(own)}"
        shown[f"pairs_{rate:g}hz_curve"] = f"{sum(taken[rate])} of {len(own)}"
    return shown


def main(arguments: Sequence[str] | None = None) -> int:
    """0: compared."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    parser = argparse.ArgumentParser(prog="python -m tests.tools.blind.curves", description="Curves against the truth.")
    parser.add_argument("cases", type=Path, nargs="+", metavar="FOLDER LINES")
    parser.add_argument("--pairs", type=Path, nargs=2, metavar=("FOLDER", "LINES"))
    parser.add_argument("--figures", type=Path)
    options = parser.parse_args(given)
    if len(options.cases) % 2:
        parser.error("every folder of cases needs its file of lines")
    both = zip(options.cases[::2], options.cases[1::2], strict=True)
    found = [compared(folder, line) for folder, lines in both for line in read_lines(lines)]
    shown = figures(found) | (pair_figures(options.pairs[0], read_lines(options.pairs[1])) if options.pairs else {})
    for one in found:
        text = f"{one.hidden:20s} {one.rate_hz:4g} Hz  {one.answer:22s} {one.judged:10s}"
        print(text, f"variable {one.is_found!s:5s} in band {one.within:.2f}", "; ".join(one.named))
    for name, text in shown.items():
        print(f"{name:28s} {text}")
    if options.figures:
        write_figures(options.figures, command_of("tests.tools.blind.curves", given), shown)
    return 0


if __name__ == "__main__":
    sys.exit(main())
