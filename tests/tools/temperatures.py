"""Machines logged cold and warm, with the temperatures of their gears: does discovery say whose friction follows them?

python -m tests.tools.temperatures FOLDER --plants 30 --seed 1 --jobs 2 [--figures JSON]

Plants, motions and noise are those of the pairs of logs (:mod:`tests.tools.changes.draw`), from a simulator that shares
no code with the package. Three fitted logs along one motion at three temperatures, a held-out one along another motion
at a fourth. In a third of the plants the friction of both joints follows the temperature, in a third that of one, in a
third of none, and the sensors show it all the same. Per kelvin, dry friction loses 0.2 to 0.8 % and viscous friction 1
to 2.5 % of what it is at 20 degC (Bittencourt and others, IROS 2010: viscous friction of an industrial robot halves
from 33 to 80 degC); in every second plant viscous friction falls exponentially, another form than that of the
catalogue. A sensor is off by up to 2 K all the time, and shows the temperature of the housing.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml

from tests.figures import command_of, table, write_figures
from tests.tools.blind.simulator.design import development_design, random_motion
from tests.tools.blind.simulator.equations import root_mean_square
from tests.tools.blind.simulator.make import NOISE, Plant, noise
from tests.tools.changes.draw import RATES, is_calm, scara, write_log
from tests.tools.changes.run import case_of

NAME = "temperature_dependent_friction"
RANGES = {"cold": (15.0, 25.0), "middle": (28.0, 35.0), "warm": (40.0, 50.0), "held_out": (25.0, 45.0)}
"""[degC] Of the logs."""
DRY, VISCOUS = (0.002, 0.008), (0.01, 0.025)
"""[1/K] Parts of the friction at 20 degC."""
SENSOR = 2.0
"""[K] Up to which a sensor is off."""
KINDS = ("both", "one", "none")
CLUTTER = ("torque_ripple", "stribeck", "thermal_friction_drift")
"""What a quarter of the plants have beside, of which a name is no false one."""
WITHIN = 3.0
"""[standard deviations] Of the true change of dry friction."""


def friction_at(true: dict[str, float], degrees: float, dry: np.ndarray, viscous: np.ndarray, *, bent: bool) -> dict:
    """Friction of all joints at a temperature; ``dry``, ``viscous``: (n,) 1/K, zero where it does not follow."""
    above, found = degrees - 20.0, {}
    for j, (a, b) in enumerate(zip(dry, viscous, strict=True), start=1):
        found[f"Fc{j}"] = true[f"Fc{j}"] * (1 - a * above)
        found[f"Fv{j}"] = true[f"Fv{j}"] * (np.exp(-b * above) if bent else 1 - b * above)
    return found


def make(number: int, seed: int, folder: Path) -> Path:
    """The logs of a plant, its case and, in ``truth.json``, what is hidden; returns the case."""
    rng = np.random.default_rng([seed, number])
    kind, rate = KINDS[number % len(KINDS)], RATES[number // len(KINDS) % len(RATES)]
    while True:
        design = scara(rng) if rng.random() < 0.5 else development_design(rng)
        plant = Plant(replace(design, periods=1), clutter=rng.random() < 0.25)
        first, second = random_motion(rng, plant.design), random_motion(rng, plant.design)
        if is_calm(plant, first) and is_calm(plant, second):
            break
    joints, bent = np.arange(1, plant.design.count + 1), bool(number % 2)
    follow = np.isin(joints, {"both": joints, "one": [rng.choice(joints)], "none": []}[kind])
    dry, viscous = (follow * rng.uniform(*one, joints.size) for one in (DRY, VISCOUS))
    off, deviation, experiments = rng.uniform(-SENSOR, SENSOR), None, {}
    for label, (low, high) in RANGES.items():
        degrees, motion = rng.uniform(low, high), second if label == "held_out" else first
        own = friction_at(plant.design.true, degrees, dry, viscous, bent=bent)
        warm = replace(plant, design=replace(plant.design, true=plant.design.true | own))
        logged = warm.simulate(motion)[1]
        deviation = NOISE * root_mean_square(logged) if deviation is None else deviation
        write_log(folder / label, warm, motion, logged + noise(rng, plant.design, deviation), rate)
        document = yaml.safe_load(case_of(folder, label).read_text(encoding="utf-8"))
        run = document["train"] | {"temperature": round(float(degrees + off), 1)}
        experiments[label] = run | ({"role": "validation"} if label == "held_out" else {})
        for part in ("reference", "torque"):
            run[part]["file"] = str((folder / f"{label}_input" / run[part]["file"]).resolve())
    case = folder / "cold_input" / "all.yaml"
    document = {key: value for key, value in document.items() if key not in ("train", "validation")}
    case.write_text(yaml.safe_dump(document | {"experiments": experiments}, sort_keys=False), encoding="utf-8")
    truth = {"kind": kind, "rate_hz": rate, "exponential": bent, "clutter": plant.clutter}
    truth |= {"FcK": [float(-a * plant.design.true[f"Fc{j}"]) for j, a in zip(joints, dry, strict=True)]}
    (folder / "truth.json").write_text(json.dumps(truth), encoding="utf-8")
    return case


def run(number: int, seed: int, folder: Path) -> dict[str, Any]:
    """What discovery says of a plant, beside what is hidden."""
    from fmu_didim import discover

    place = folder / f"t{number:03d}"
    case = make(number, seed, place)
    truth = json.loads((place / "truth.json").read_text(encoding="utf-8"))
    found = discover(case, progress=lambda _: None).document
    own = {f.joint: {p.name: (p.value, p.std) for p in f.parameters} for f in found.findings if f.effect == NAME}
    return truth | {
        "number": number, "answer": found.answer, "verdict": found.verdict, "found": own,
        "others": [
            f"{f.effect} {f.joint}" for f in found.findings
            if f.effect != NAME and not (truth["clutter"] and f.effect in CLUTTER)
        ],
    }  # fmt: skip


def scored(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Counts, and a table of what is named."""
    rows, inside, values = [], 0, 0
    for kind in KINDS:
        own = [line for line in lines if line["kind"] == kind]
        right = sum(sorted(line["found"]) == [j for j, v in enumerate(line["FcK"], 1) if v] for line in own)
        false = sum(any(not line["FcK"][j - 1] for j in line["found"]) for line in own)
        wrong = sum(bool(line["others"]) and line["verdict"] == "valid" for line in own)
        rows.append((kind, str(len(own)), str(right), str(false), str(wrong)))
    for line in lines:
        for j, found in line["found"].items():
            if truth := line["FcK"][j - 1]:
                value, std = found[f"FcK{j}"]
                values, inside = values + 1, inside + (abs(value - truth) <= WITHIN * std)
    heads = ("friction follows on", "plants", "all joints right", "a joint too many", "another name, valid")
    return {"kinds": table(heads, rows), "plants": str(len(lines)), "inside": f"{inside} of {values}"}


def _percent(of: tuple[float, float]) -> str:
    return f"{100 * of[0]:g} to {100 * of[1]:g} %"


def read_lines(path: Path) -> list[dict[str, Any]]:
    """The lines of a run; joints are numbers again."""
    found = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("{")]
    return [line | {"found": {int(j): values for j, values in line["found"].items()}} for line in found]


def main(arguments: Sequence[str] | None = None) -> int:
    """0: done."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    parser = argparse.ArgumentParser(prog="python -m tests.tools.temperatures", description="Machines cold and warm.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--plants", type=int, default=30, help="how many (30)")
    parser.add_argument("--seed", type=int, default=1, help="of the draws (1)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--lines", type=Path, help="what a run has printed, to be scored once more")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    options = parser.parse_args(given)
    lines = read_lines(options.lines) if options.lines else []
    if not lines:
        with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
            for line in pool.map(partial(run, seed=options.seed, folder=options.folder), range(options.plants)):
                lines.append(line)
                print(json.dumps(line), flush=True)
    found = scored(lines)
    print("\n".join([*found["kinds"], f"dry friction within {WITHIN:g} sigma: {found['inside']}"]))
    if options.figures:
        words = ["FOLDER", "--plants", str(len(lines)), "--seed", str(options.seed), "--figures", str(options.figures)]
        stated = {"sensor": f"{SENSOR:g} K", "dry": _percent(DRY), "viscous": _percent(VISCOUS)}
        write_figures(options.figures, command_of("tests.tools.temperatures", words), found | stated)
    return 0


if __name__ == "__main__":
    sys.exit(main())
