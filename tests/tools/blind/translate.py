"""From a blind case to the project's own documents: robot, controller and case file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from fmu_didim.base.errors import InputError

CASE_FILE = "case.yaml"
_INERTIAL = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
_EFFECTS = {"Ia": "motor_inertia", "Fv": "viscous", "Fc": "coulomb", "offset": "torque_offset"}
_CARRIERS = {name.lower(): name for name in (*_INERTIAL, *_EFFECTS)} | {"off": "offset", "tauoff": "offset"}
_NAME = re.compile(r"^(?P<stem>[A-Za-z]+?)_?(?P<joint>\d+)_?(?P<regrouped>[Rr]?)$")


def translate(folder: Path, out: Path, *, plant: str = "model") -> Path:
    """Write robot, controller and case for ``fmu-didim`` into ``out``; returns the path of the case.

    Only ``case.yaml`` and the names of the CSV files beside it are looked at.

    Args:
        folder: the blind case. plant: ``model`` or ``fmu``: how plant and controller run.

    Raises:
        InputError: the case states something that cannot be expressed.
    """
    case = yaml.safe_load((folder / CASE_FILE).read_text(encoding="utf-8"))
    out.mkdir(parents=True, exist_ok=True)
    documents = {
        "robot.yaml": robot_document(case["robot"], where=folder),
        "controller.yaml": controller_document(case["controller"], case["robot"]["joints"], where=folder),
        "identify.yaml": case_document(case, folder, plant),
    }
    for name, content in documents.items():
        (out / name).write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return out / "identify.yaml"


def robot_document(robot: Mapping[str, Any], *, where: Path) -> dict[str, Any]:
    """The robot description; each nominal base parameter is carried by the standard one of its name."""
    joints: list[dict[str, Any]] = [
        {key: joint[key] for key in ("type", "alpha", "a", "theta", "d") if key in joint} for joint in robot["joints"]
    ]
    nominal = next((value for key, value in robot.items() if key.startswith("nominal_parameters")), None)
    if not nominal:
        raise InputError(
            "The case gives no nominal parameters.",
            where=str(where),
            valid="nominal_parameters...",
            next_step="Complete the case.",
        )
    identified: dict[str, str] = {}
    for name, value in nominal.items():
        carrier, j = _carrier(name, len(joints), where)
        joints[j - 1].setdefault("parameters", {})[carrier] = float(value)
        identified[name] = f"{carrier}{j}"
    for joint in joints:
        joint["effects"] = [effect for key, effect in _EFFECTS.items() if key in joint.get("parameters", {})]
    gravity = next((value for key, value in robot.items() if key.startswith("gravity")), [0.0, 0.0, -9.81])
    name = re.sub(r"\W+", "_", str(robot.get("name", "robot")))
    return {
        "schema": 1,
        "name": name if name[:1].isalpha() else f"robot_{name}",
        "gravity": [float(g) for g in gravity],
        "joints": joints,
        "identified": identified,
    }


def _carrier(name: str, count: int, where: Path) -> tuple[str, int]:
    match = _NAME.match(name)
    carrier = _CARRIERS.get(match["stem"].lower()) if match else None
    if match is None or carrier is None or not 1 <= int(match["joint"]) <= count:
        raise InputError(
            "A nominal parameter is unknown.", where=str(where), got=name,
            valid=f"{', '.join((*_INERTIAL, *_EFFECTS))}, then a joint from 1 to {count}, then R if regrouped",
            next_step="Rename the parameter in the case.",
        )  # fmt: skip
    return carrier, int(match["joint"])


def controller_document(
    controller: Mapping[str, Any], joints: Sequence[Mapping[str, Any]], *, where: Path
) -> dict[str, Any]:
    """The control law: PD or PID, velocity measured or by backward difference, with a limit or none.

    Quantisation of the encoder is noise to the model and left out.
    """
    n = len(joints)
    gains = {key: controller[key] for key in ("Kp", "Kd", "Ki") if key in controller}
    if "Kp" not in gains:
        raise InputError(
            "The control law has no Kp.",
            where=str(where),
            got=", ".join(controller),
            valid="Kp, Kd, Ki",
            next_step="Complete the case.",
        )
    law = str(controller.get("law", "")).replace(" ", "")
    difference = "q[k]-q[k-1]" in law or "backward" in law
    document: dict[str, Any] = {
        "schema": 1,
        "law": "pid" if "Ki" in gains else "pd",
        "name": "blind_controller",
        "joints": [joint["type"] for joint in joints],
        "rate_hz": float(controller["rate_hz"]),
        "velocity": "backward_difference" if difference else "measured",
        "Kp": _per_joint(gains["Kp"], n),
        "Kd": _per_joint(gains.get("Kd", 0.0), n),
    }
    if "Ki" in gains:
        document["Ki"] = _per_joint(gains["Ki"], n)
    limit = next((v for k, v in controller.items() if "saturation" in k or "limit" in k), None)
    if isinstance(limit, (int, float, list)) and not isinstance(limit, bool):
        document["saturation"] = _per_joint(limit, n)
    return document


def _per_joint(value: float | list[float], count: int) -> list[float]:
    return [float(v) for v in value] if isinstance(value, list) else [float(value)] * count


def case_document(case: Mapping[str, Any], folder: Path, plant: str) -> dict[str, Any]:
    """The case file, with both experiments."""
    controller, measurement = case["controller"], case["measurement"]
    text = " ".join(str(value) for value in measurement.values())
    sampling: dict[str, Any] = {}
    if re.search(r"\baverag", text):
        window = next((w for w in ("preceding", "centred", "following") if w in text), "preceding")
        sampling = {"sampling": "average", "window": window}
    period = re.search(r"periods? of ([\d.]+) ?s", str(measurement.get("repeats", "")))

    def experiment(name: str) -> dict[str, Any]:
        reference: dict[str, Any] = {"file": str((folder / f"{name}_reference.csv").absolute()), "time": "t"}
        if period is not None:
            reference["period_s"] = float(period[1])
        torque = {"file": str((folder / f"{name}_torque.csv").absolute()), "time": "t", **sampling}
        return {"reference": reference, "torque": torque}

    loop: dict[str, Any] = {"rate_hz": float(controller["rate_hz"])}
    delay = next((v for k, v in controller.items() if k.startswith("delay")), None)
    if isinstance(delay, (int, float)):
        loop["delay_samples"] = float(delay)
    document = {
        "schema": 1,
        "name": folder.name,
        "robot": "robot.yaml",
        "plant": {"kind": plant},
        "controller": {"kind": plant, "source": "controller.yaml"},
        "loop": loop,
        "train": experiment("train"),
    }
    if (folder / "test_reference.csv").is_file() and (folder / "test_torque.csv").is_file():
        document["validation"] = experiment("test")
    return document
