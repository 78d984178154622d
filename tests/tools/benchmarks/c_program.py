"""C programs of the benchmarks: built as the FMUs are, with the same compiler and flags, and kept in the cache."""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from fmu_didim.base.cache import cached_folder
from fmu_didim.data.signals import Trajectory
from fmu_didim.dynamics.block import Block
from fmu_didim.export import compile_shared_library
from fmu_didim.export.build import find_compiler

HERE = Path(__file__).parent / "c"
_DOUBLES = ctypes.POINTER(ctypes.c_double)


def build(main: str, sources: Mapping[str, str]) -> ctypes.CDLL:
    """The library of one translation unit ``c/<main>``, which includes the ``sources`` (name -> text)."""
    compiler = find_compiler()
    texts = {main: (HERE / main).read_text(encoding="utf-8"), **sources}
    key = hashlib.sha256(repr((sorted(texts.items()), compiler)).encode()).hexdigest()[:32]

    def fill(folder: Path) -> None:
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        compile_shared_library(folder, folder / "program.library", main=main, compiler=compiler)

    return ctypes.CDLL(str(cached_folder("benchmarks", key, fill) / "program.library"))


def doubles(values: np.ndarray) -> ctypes._Pointer[ctypes.c_double]:
    """The address of an array for C; the array must be contiguous and live as long."""
    assert values.flags.c_contiguous
    return values.ctypes.data_as(_DOUBLES)


def equations(plant: Block, law: Block | None = None) -> str:
    """C code of the plant and the control law as CasADi writes it, in one unit."""
    generator = ca.CodeGenerator("equations.c", {"with_header": False, "main": False, "mex": False})
    for prefix, block in (("plant", plant), ("law", law)):
        if block is None:
            continue
        x, u, p = (ca.SX.sym(n, len(g)) for n, g in (("x", block.states), ("u", block.inputs), ("p", block.parameters)))
        for name, arguments in (("update", (x, u, p)), ("output", (x, u, p)), ("start", (u, p))):
            rows = {"update": len(block.states), "start": len(block.states), "output": len(block.outputs)}[name]
            result = ca.densify(ca.reshape(getattr(block, name)(*arguments), rows, 1))
            generator.add(ca.Function(f"{prefix}_{name}", list(arguments), [result]))
    return str(generator.dump())


@dataclass(frozen=True)
class ClosedLoop:
    """A plant under a sampled control law, without delay, as one C program.

    Per tick: the law's command from reference and motion, the plant's acceleration where it is recorded, the
    law's next state, RK4 with ``substeps`` equal substeps. The order of all sums is that of the exported FMUs.

    Attributes:
        plant, law: the equations and the values of their parameters.
        reference: columns ``q<j>``, ``dq<j>``, ``ddq<j>``; gains: drive gains.
        period: of the control, s.
    """

    plant: Block
    law: Block
    reference: Trajectory
    gains: Sequence[float]
    period: float
    substeps: int

    def library(self) -> ctypes.CDLL:
        """The compiled program."""
        config = [
            f"#define JOINTS {len(self.gains)}",
            f"#define PLANT_STATES {len(self.plant.states)}",
            f"#define LAW_STATES {len(self.law.states)}",
            f"#define LAW_INPUTS {len(self.law.inputs)}",
            f"#define COLUMNS {self.reference.values.shape[1]}",
            f"#define SUBSTEPS {self.substeps}",
            f"static const double period = {self.period!r};",
            f"static const double gain[] = {{{', '.join(repr(float(g)) for g in self.gains)}}};",
            f"static const int source[] = {{{', '.join(str(self._source(v.name)) for v in self.law.inputs)}}};",
        ]
        return build(
            "closed_loop.c", {"config.h": "\n".join(config) + "\n", "equations.c": equations(self.plant, self.law)}
        )

    def _source(self, name: str) -> int:
        """Source of an input of the law: a column of the reference (>= 0), or -1 - i for output i of the plant."""
        stem, joint = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
        if stem.endswith("_ref"):
            return self.reference.names.index(stem.removesuffix("_ref") + joint)
        return -1 - [v.name for v in self.plant.outputs].index(name)

    def runner(self, ticks: np.ndarray) -> ClosedLoopRun:
        """Ready to run, recording these ticks."""
        return ClosedLoopRun(self, ticks)


class ClosedLoopRun:
    """The program with its memory; calling it runs the loop once and gives (K, 4 n): tau, q, dq, ddq."""

    def __init__(self, loop: ClosedLoop, ticks: np.ndarray) -> None:
        self._table = np.ascontiguousarray(loop.reference.values)
        self._parameters = (loop.plant.parameter_values, loop.law.parameter_values)
        self._ticks = int(ticks[-1]) + 1
        self._rows = np.full(self._ticks, -1, dtype=np.int64)
        self._rows[ticks] = np.arange(ticks.size)
        self.record = np.zeros((ticks.size, 4 * len(loop.gains)))
        self._library = loop.library()
        self._run = self._library.run
        self._arguments = (
            ctypes.c_longlong(self._ticks), doubles(self._table), *(doubles(p) for p in self._parameters),
            self._rows.ctypes.data_as(ctypes.POINTER(ctypes.c_longlong)), doubles(self.record),
        )  # fmt: skip

    def __call__(self) -> np.ndarray:
        self._run(*self._arguments)
        return self.record
