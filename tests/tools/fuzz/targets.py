"""What is fuzzed: for each kind of input how one is made from a right one, and what reads it."""

from __future__ import annotations

import io
import os
import random
import shutil
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import yaml
from scipy.io import savemat

from fmu_didim import export_ssp, simulate
from fmu_didim.case import load_case
from fmu_didim.case.build import Case
from fmu_didim.components.fmu import info_lines, load_fmu, read_description
from fmu_didim.controllers import read_controller
from fmu_didim.cosim.execution.running import CHECK_INTERVAL
from fmu_didim.data.tables import read_trajectory
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.ssp import read_ssp
from tests.awkward import build
from tests.tools.fuzz import mutate

ROOT = Path(__file__).parents[3]
MOST_TICKS = 100 * CHECK_INTERVAL
"""A case that is taken is also run, if it is no longer than this."""


@dataclass(frozen=True)
class Kind:
    """A kind of input.

    Attributes:
        suffix: of its files; make: an input of it; read: what is done with its file.
    """

    suffix: str
    make: Callable[[random.Random], bytes]
    read: Callable[[Path], object]


def _as_yaml(rng: random.Random, content: Any) -> bytes:
    text = yaml.safe_dump(content, sort_keys=rng.random() < 0.5, allow_unicode=rng.random() < 0.5)
    return text.encode("utf-8", "surrogatepass")


def _described(rng: random.Random, texts: tuple[str, ...]) -> bytes:
    text = rng.choice(texts)
    if mutate.idle(rng):
        return text.encode()
    if rng.random() < 0.2:
        return mutate.data(rng, text.encode())
    return _as_yaml(rng, mutate.document(rng, yaml.safe_load(text)))


def _damaged(rng: random.Random, content: bytes) -> bytes:
    return content if mutate.idle(rng) else mutate.data(rng, content)


def _read(*names: str) -> tuple[str, ...]:
    return tuple((ROOT / name).read_text(encoding="utf-8") for name in names)


@cache
def _cases() -> tuple[str, ...]:
    """Cases of all sorts, without FMUs that would have to be compiled, and with all paths whole."""
    content = yaml.safe_load(_read("examples/scara/identify.yaml")[0])
    here = ROOT / "examples/scara"
    content["robot"] = str(here / content["robot"])
    source = str(here / content["controller"].pop("source"))
    content["plant"], content["controller"] = {"kind": "model"}, {"kind": "model", "source": source}
    for name in ("train", "validation"):
        content[name]["torque"]["file"] = str(here / content[name]["torque"]["file"])
    log = content["train"]["torque"]
    chirp = {"kind": "chirp", "start_hz": 0.1, "stop_hz": 1.0, "duration_s": 10.0,
             "joints": [{"amplitude": 0.5}, {"amplitude": 0.3, "offset": 0.1}]}  # fmt: skip
    points = {"kind": "point_to_point", "points": [[0.0, 0.0], [1.0, 0.5], [0.2, -0.4]], "move_s": 4.0, "dwell_s": 1.0}
    runs = {
        "a": {"reference": content["train"]["reference"], "torque": log | {"sampling": "average", "window_s": 0.1}},
        "b": {"reference": chirp, "torque": log | {"rate_hz": 5, "phase_s": 0.1, "log_shift_s": 0.01}, "own": ["ZZ2"]},
        "c": {"reference": points, "torque": log | {"quantity": "command"}, "role": "validation"},
    }
    rest = {key: value for key, value in content.items() if key not in ("train", "validation")}
    more = {
        "loop": {"delay_samples": 1.5, "drive_gains": [2.0, 1.0], "algorithm": "jacobi", "rate_hz": 200},
        "identify": {"Kp2": {"of": "controller", "start": 50, "minimum": 0}, "g": {"of": "drive", "joint": 1}},
        "estimator": {"kind": "clie", "start": {"ZZ2": 0.06}, "tolerance": 1e-6}, "torque_std": [0.2, 0.01],
        "low_pass": {"cutoff_hz": 3.0, "order": 2}, "joint_weights": "equal",
    }  # fmt: skip
    return tuple(
        yaml.safe_dump(c) for c in (content, rest | {"experiments": runs}, rest | {"experiments": runs} | more)
    )


def _case(path: Path) -> None:
    case = load_case(path)
    if _is_short(case):
        simulate(case)


def _is_short(case: Case) -> bool:
    run = next(iter(case.document.runs))
    return case.reference(run).time.size <= MOST_TICKS


def _robot(path: Path) -> None:
    model = RobotModel(read_robot(path))
    base_parameters(model)
    model.block()


def _csv(rng: random.Random) -> bytes:
    rows = [",".join(f"{x:.6g}" for x in row) for row in _table(rng)]
    return _damaged(rng, "\n".join(["t,q1,tau1", *rows]).encode())


def _table(rng: random.Random) -> np.ndarray:
    values = np.random.default_rng(rng.randrange(2**32)).normal(size=(rng.choice((1, 2, 30)), 3))
    values[:, 0] = np.arange(len(values)) * 0.01
    return values


def _mat(rng: random.Random) -> bytes:
    table, stream = _table(rng), io.BytesIO()
    content: dict[str, Any] = {"t": table[:, :1], "q1": table[:, 1:2], "tau1": table[:, 2]}
    content |= rng.choice(({}, {"s": {"a": 1, "b": "text"}}, {"c": np.array([1, "x"], dtype=object), "k": 1 + 2j}))
    savemat(stream, content, format=rng.choice(("5", "5", "4")) if len(content) == 3 else "5",
            do_compression=rng.random() < 0.3)  # fmt: skip
    made = stream.getvalue()
    if made.startswith(b"MATLAB"):
        made = b"MATLAB 5.0 MAT-file".ljust(116) + made[116:]  # without the time
    return _damaged(rng, made)


def _parquet(rng: random.Random) -> bytes:
    import pyarrow
    from pyarrow import parquet

    table, stream = _table(rng), io.BytesIO()
    columns: dict[str, Any] = {"t": table[:, 0], "q1": table[:, 1], "tau1": table[:, 2]}
    others = {"s": ["x"] * len(table), "l": [[1.0, 2.0]] * len(table), "b": [True] * len(table)}
    columns |= rng.choice(({}, {"q1": [None, *table[1:, 1]]}, others))
    parquet.write_table(pyarrow.table(columns), stream, compression=rng.choice(("none", "snappy", "gzip")))
    return _damaged(rng, stream.getvalue())


def _hdf5(rng: random.Random) -> bytes:
    import h5py

    table, stream = _table(rng), io.BytesIO()
    with h5py.File(stream, "w", userblock_size=rng.choice((0, 512))) as file:
        for name, column in zip(("t", "q1", "group/tau1"), table.T, strict=True):
            data = file.create_dataset(name, data=column, compression=rng.choice((None, "gzip")))
            data.attrs["unit"] = rng.choice(("s", "rad", "deg"))
        if rng.random() < 0.5:
            file["text"], file["rows"] = "text", np.array([(1, 2.0)], dtype=[("a", "i4"), ("b", "f8")])
    return _damaged(rng, stream.getvalue())


def _fmu(rng: random.Random, description: bytes, *, stem: str, major: int) -> bytes:
    stream = io.BytesIO()
    folder = fmpy.platform_tuple if major == 3 else fmpy.platform
    _write(stream, {
        "modelDescription.xml": description,
        f"binaries/{folder}/{stem}{fmpy.sharedLibraryExtension}": b"never loaded",
        "resources/text.txt": b"resource " * 20,
    }, rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))  # fmt: skip
    return stream.getvalue()


def _write(stream: io.BytesIO, members: Mapping[str, bytes], way: int) -> None:
    """An archive that is the same whenever it is written."""
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content, compress_type=way)


DESCRIPTIONS = (
    ("slave", 2, build.SLAVE.format(**build.DEFAULTS)),
    ("events", 2, build.EVENTS),
    ("arrays", 3, build.ARRAYS),
)


def _fmu_xml(rng: random.Random) -> bytes:
    stem, major, text = rng.choice(DESCRIPTIONS)
    return _fmu(rng, text.encode() if mutate.idle(rng) else mutate.xml(rng, text), stem=stem, major=major)


def _fmu_archive(rng: random.Random) -> bytes:
    stem, major, text = rng.choice(DESCRIPTIONS)
    return _damaged(rng, _fmu(rng, text.encode(), stem=stem, major=major))


def _load(path: Path) -> None:
    info_lines(read_description(path))
    load_fmu(path)


@cache
def _loop() -> Mapping[str, bytes]:
    """Members of the archive of a right loop; the libraries are left empty, as nothing here is run."""
    folder = Path(os.environ["FMU_DIDIM_FUZZ"])
    path = folder / "loop.ssp"
    if not path.is_file():
        export_ssp(ROOT / "examples/scara/identify.yaml", path)
    with zipfile.ZipFile(path) as archive:
        return {name: _emptied(archive.read(name)) if name.endswith(".fmu") else archive.read(name)
                for name in archive.namelist()}  # fmt: skip


def _emptied(fmu: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(fmu)) as archive, zipfile.ZipFile(stream, "w") as copy:
        for name in archive.namelist():
            if name == "modelDescription.xml" or name.startswith("binaries/"):
                copy.writestr(name, archive.read(name) if name.endswith(".xml") else b"never loaded")
    return stream.getvalue()


def _ssp(rng: random.Random) -> bytes:
    members, stream = dict(_loop()), io.BytesIO()
    if rng.random() < 0.7:
        name = rng.choice([n for n in members if n.endswith((".ssd", ".ssv", ".ssm"))])
        members[name] = mutate.xml(rng, members[name].decode())
    _write(stream, members, zipfile.ZIP_STORED)
    return stream.getvalue() if rng.random() < 0.7 else _damaged(rng, stream.getvalue())


ROBOTS = ("fmus/scara/robot.yaml", "fmus/emps/robot.yaml", "fmus/arm2r/robot.yaml", "fmus/tx40/robot.yaml")
LAWS = ("scara_pd", "scara_pid", "scara_cascade", "scara_computed_torque", "emps", "tx40_pd")
KINDS: Mapping[str, Kind] = {
    "case": Kind(".yaml", lambda rng: _described(rng, _cases()), _case),
    "robot": Kind(".yaml", lambda rng: _described(rng, _read(*ROBOTS[: 4 if rng.random() < 0.1 else 3])), _robot),
    "controller": Kind(
        ".yaml", lambda rng: _described(rng, _read(*(f"controllers/{n}.yaml" for n in LAWS))), read_controller
    ),
    "csv": Kind(".csv", _csv, read_trajectory),
    "mat": Kind(".mat", _mat, read_trajectory),
    "parquet": Kind(".parquet", _parquet, read_trajectory),
    "hdf5": Kind(".h5", _hdf5, read_trajectory),
    "fmu-xml": Kind(".fmu", _fmu_xml, _load),
    "fmu-archive": Kind(".fmu", _fmu_archive, _load),
    "ssp": Kind(".ssp", _ssp, read_ssp),
}


def make(kind: str, seed: int, number: int) -> bytes:
    """The input of this number: always the same."""
    return KINDS[kind].make(random.Random(f"{kind} {seed} {number}"))


def forget() -> None:
    """Clear what the inputs have left in the cache."""
    for folder in ("extracted", "ssp"):
        shutil.rmtree(Path(os.environ["FMU_DIDIM_CACHE"]) / folder, ignore_errors=True)
