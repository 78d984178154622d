"""The right case, in files, and what a run of the command line says of one."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim.cli.main import main
from tests.checks.data.right import loaded, right
from tests.helpers import ROOT

ROBOT = "arm"
"""With gravity, so that each key of its description shows in the torque."""
LABELS = {"estimation": "train", "validation": "validation"}
SAME = 0.5
"""[1] Standard deviations of the right fit by which a value may be off that fit and counts as right: of 480 drawn
mistakes 58 of the 59 that are harmless move none by more than 0.24."""
PRECISION = 0.005
"""[1] Of a value, by which it may be off where the result itself says, for that parameter, that a mistake below a size
that shows moves it as far (``moves``): an offset of 0.4 of that size moves MX2 by 15 deviations, 0.24 %."""
SPREAD = 3.0
"""[1] Factor by which a standard deviation may be off that of the right fit."""
TOLD, HARMLESS, SILENT, UNFORESEEN, NO_STEP = "told", "harmless", "silent", "unforeseen", "no next step"


@dataclass
class Files:
    """A case with the files that it names, as they are written: documents, and tables of texts."""

    documents: dict[str, Any]
    tables: dict[str, list[list[str]]]
    others: dict[str, bytes]

    def write(self, folder: Path) -> Path:
        folder.mkdir(parents=True)
        for name, content in self.documents.items():
            text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
            (folder / name).write_text(text, encoding="utf-8")
        for name, rows in self.tables.items():
            (folder / name).write_text("".join(",".join(row) + "\n" for row in rows), encoding="utf-8")
        for name, content in self.others.items():
            (folder / name).write_bytes(content)
        return folder / "case.yaml"


@cache
def _tables() -> Mapping[str, tuple[tuple[str, ...], np.ndarray]]:
    model, found = right(ROBOT, 1, noise=0.01), {}
    for label, short in LABELS.items():
        run = model.experiments[label]
        names = [name for name in run.reference.names if name.startswith(("q", "dq"))]
        reference = np.column_stack([run.reference.time, run.reference.select(names)])
        found[f"{short}_reference.csv"] = (("t", *names), reference)
        torques = tuple(f"tau{j}" for j in range(1, model.joint_count + 1))
        found[f"{short}.csv"] = (("t", *torques), np.column_stack([run.time, run.torque]))
    return found


def files() -> Files:
    """The right case: all mistakes begin with it."""
    read = lambda name: yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))  # noqa: E731
    tables = {
        name: [list(head), *([f"{value:.9g}" for value in row] for row in rows)]
        for name, (head, rows) in _tables().items()
    }
    case: dict[str, Any] = {
        "schema": 1, "name": "an arm", "robot": "robot.yaml", "plant": {"kind": "model"},
        "controller": {"kind": "model", "source": "controller.yaml"},
        "loop": {"rate_hz": 200, "delay_samples": 0, "algorithm": "gauss_seidel"},
    }  # fmt: skip
    for short in LABELS.values():
        signals = [name for name in tables[f"{short}_reference.csv"][0] if name != "t"]
        units = {name: "rad/s" if name.startswith("d") else "rad" for name in signals}
        case[short] = {
            "reference": {
                "file": f"{short}_reference.csv", "time": {"name": "t", "unit": "s"},
                "columns": {name: {"name": name, "unit": unit} for name, unit in units.items()},
            },
            "torque": {
                "file": f"{short}.csv", "time": {"name": "t", "unit": "s"}, "rate_hz": 100, "sampling": "point",
                "columns": {name: {"name": name, "unit": "N.m", "scale": 1.0, "sign": 1, "zero": 0.0}
                            for name in ("tau1", "tau2")},
            },
        }  # fmt: skip
    case["estimator"] = {"kind": "didim", "start": "torque", "tolerance": 0.025, "maximum_iterations": 20}
    case["joint_weights"] = "estimated"
    documents = {"case.yaml": case, "robot.yaml": read("fmus/arm2r/robot.yaml")}
    documents["controller.yaml"] = read("controllers/arm2r_pd.yaml")
    return Files(documents, tables, {})


@dataclass(frozen=True)
class Said:
    """What a run said: its exit code, its texts, and its result, where it gave one."""

    code: int
    text: str
    result: Mapping[str, Any] | None = None

    @property
    def verdict(self) -> str:
        return "" if self.result is None else str(self.result["verdict"])

    @property
    def suspects(self) -> list[str]:
        """Codes of the reasons, the first one first."""
        return [] if self.result is None else [reason["code"] for reason in self.result["reasons"]]


def run(made: Files, folder: Path) -> Said:
    """``fmu-didim identify`` on the case."""
    case, out = made.write(folder), folder / "out"
    stream = io.StringIO()
    try:
        with redirect_stdout(stream), redirect_stderr(stream), chdir(folder):
            code = main(["identify", str(case), "--out", str(out), "--quiet"])
    except SystemExit as usage:
        code = int(str(usage.code))
    except Exception as error:  # noqa: BLE001 - whatever it is, it is counted
        return Said(-1, f"unexpected error: {error!r}")
    file = out / "result.json"
    result = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None
    return Said(code, stream.getvalue(), result)


def outcome(said: Said, expected: Mapping[str, tuple[float, float]]) -> str:
    """What became of a mistake: told with a next step, harmless, or one of the three that must not be.

    Args:
        expected: value and standard deviation of each parameter by the right fit.
    """
    if "unexpected error" in said.text or "Traceback" in said.text:
        return UNFORESEEN
    if said.verdict == "valid":
        return HARMLESS if _is_right(said, expected) else SILENT
    if said.result is not None:
        reasons = said.result["reasons"]
        has_step = all(r["next_step"] for r in reasons) if reasons else bool(said.result["advice"])
        return TOLD if has_step else NO_STEP
    return TOLD if "next:" in said.text else NO_STEP


def _is_right(said: Said, expected: Mapping[str, tuple[float, float]]) -> bool:
    assert said.result is not None
    found = {name: p for name, p in said.result["parameters"].items() if name in expected}
    off = {name: abs(p["value"] - expected[name][0]) / expected[name][1] for name, p in found.items()}
    spread = (abs(math.log((p["std"] or math.inf) / expected[name][1])) for name, p in found.items())
    worst = max(off, key=lambda name: off[name])
    value, std = expected[worst]
    told = max((abs(m["deviations"]) for m in _moves(said.result) if m["parameter"] == worst), default=0.0)
    return off[worst] < max(SAME, min(told, PRECISION * abs(value) / std)) and all(
        one < math.log(SPREAD) for one in spread
    )


def _moves(result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """What mistakes below the sizes that the result says to exclude would move."""
    return [one["moves"] for one in (result.get("power") or {}).get("stated", []) if one.get("moves")]


def expected_of(said: Said) -> dict[str, tuple[float, float]]:
    """Values and standard deviations of the fit of the right case, which hold the truth."""
    assert said.result is not None and said.verdict == "valid", said.text
    model = loaded(ROBOT)
    truth = dict(zip(model.names, model.start.tolist(), strict=True))
    found = {name: (p["value"], p["std"]) for name, p in said.result["parameters"].items() if name in truth}
    assert all(abs(value - truth[name]) < 3 * std for name, (value, std) in found.items())
    return found


def changed(made: Files, **tables: list[list[str]]) -> Files:
    """The same files with other tables."""
    return replace(made, tables={**made.tables, **tables})
