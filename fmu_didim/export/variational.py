"""A block with its derivatives by some parameters as compiled code: the variational equations.

With z one of the parameters, a the hidden accelerations of a block and r(x, a, u, p) = 0 their balance
(:class:`fmu_didim.dynamics.block.Balance`)

    da/dz = -(dr/da)^-1 (r_x dx/dz + r_u du/dz + r_z),    d(dx/dt)/dz = f_x dx/dz + f_a da/dz + f_u du/dz + f_z

CasADi writes the coefficients, which are computed once for all parameters; loops over the parameters, which the
compiler turns into vector instructions, do the products.

Source: E. Hairer, S. P. Norsett, G. Wanner, *Solving Ordinary Differential Equations I*, section I.14.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import casadi as ca

from fmu_didim.base.cache import cached_folder
from fmu_didim.base.symbolic import jacobian, reverse, serialised
from fmu_didim.dynamics.block import FEWEST_EXPLICIT, FEWEST_IMPLICIT, MAXIMUM_SUBSTEPS, SUBSTEP_RATE, Balance, Block
from fmu_didim.dynamics.linearly_implicit import LinearlyImplicit
from fmu_didim.export.build import compile_shared_library, compiler_for_here, find_compiler, wrapper_source

MAIN = "variational.c"
LANES_MULTIPLE = 4
"""The number of lanes is a multiple of this, the doubles in a vector register."""
MANY_LANES = 16
"""[1] Lanes from which on code for the processor of this machine pays off."""


def lane_count(parameters: int) -> int:
    """Lanes for so many parameters; those that are not needed stay zero."""
    return -(-parameters // LANES_MULTIPLE) * LANES_MULTIPLE


def variational_library(
    block: Block, parameters: tuple[tuple[int, int], ...], lanes: int, outputs: tuple[int, ...]
) -> Path:
    """The library of a block and its derivatives; ``wrapper/variational.c`` says what it offers.

    It is kept in the cache under the digest of all that it follows from, and the compiler: to write its sources only to
    find them there would take a robot of six joints longer than to simulate it.

    Args:
        block: the equations, of scalar expressions.
        parameters: what of the block to differentiate by: (lane, place among the block's parameters) each.
        lanes: parameters of the whole loop to differentiate by; outputs: places of those that are differentiated.

    Raises:
        BuildError: there is no compiler, or it reports an error.
    """
    equations = (block.update, block.output, block.start, block.step_rate)
    sampled = block.sample_time is not None
    return _library(_Request(equations, block.balance, block.implicit, sampled, parameters, lanes, outputs))


@dataclass(frozen=True)
class _Request:
    """All that a library follows from."""

    equations: tuple[ca.Function, ca.Function, ca.Function, ca.Function | None]
    balance: Balance | None
    implicit: LinearlyImplicit | None
    sampled: bool
    parameters: tuple[tuple[int, int], ...]
    lanes: int
    outputs: tuple[int, ...]

    def digest(self) -> str:
        """SHA-256 of all this, of the code that writes the sources, and of CasADi."""
        return hashlib.sha256(_packed((ca.__version__, _digest_of_writer(), self))).hexdigest()


def _packed(value: Any) -> bytes:
    """A request or a part of it as bytes, other ones for another request; raises TypeError for what none can hold."""
    if isinstance(value, ca.Function):
        packed = serialised(value)
    elif is_dataclass(value):
        packed = _packed(tuple(getattr(value, entry.name) for entry in fields(value)))
    elif isinstance(value, tuple):
        packed = b"".join(map(_packed, value))
    elif value is None or isinstance(value, bool | int | str):
        packed = repr(value).encode()
    else:
        raise TypeError(f"a request for a library holds no {type(value).__name__}")
    return b"%s %d %s" % (type(value).__name__.encode(), len(packed), packed)


WRITERS = ("export.variational", "base.symbolic", "dynamics.block", "dynamics.linearly_implicit")
"""The modules that write the sources of a library: what another state of them has written is not taken."""


@cache
def _digest_of_writer() -> str:
    """SHA-256 of the code that writes the sources, and of what it writes as it stands."""
    package = files("fmu_didim")
    texts = [package.joinpath(f"{name.replace('.', '/')}.py").read_bytes() for name in WRITERS]
    texts.append(wrapper_source(MAIN).encode())
    return hashlib.sha256(repr(texts).encode()).hexdigest()


@lru_cache(maxsize=64)
def _library(request: _Request) -> Path:
    compiler = compiler_for_here() if request.lanes >= MANY_LANES else find_compiler()
    key = hashlib.sha256(repr((request.digest(), compiler.flags, compiler.version)).encode()).hexdigest()[:32]

    def fill(folder: Path) -> None:
        for name, text in _Writer(request).sources().items():
            (folder / name).write_text(text, encoding="utf-8")
        compile_shared_library(folder, folder / "variational.library", main=MAIN, compiler=compiler)

    return cached_folder("variational", key, fill) / "variational.library"


@dataclass
class _Product:
    """Jacobians times derivatives: the coefficients (nonzeros of the Jacobians) and the C code of the sums.

    Attributes:
        values: coefficients so far; terms: of each row, such as ``k[3] * dx[0][l]``.
        lanes: (row, lane, coefficient) of the derivatives by the parameters themselves; own_lanes: their lanes.
    """

    values: list[ca.SX] = field(default_factory=list)
    terms: list[list[str]] = field(default_factory=list)
    lanes: list[tuple[int, int, int]] = field(default_factory=list)
    own_lanes: list[int] = field(default_factory=list)

    def add(self, expression: ca.SX, arguments: dict[str, ca.SX], parameters: ca.SX) -> None:
        """Rows for an expression: its Jacobians by arguments, whose derivatives have these names, and parameters."""
        first = len(self.terms)
        self.terms += [[] for _ in range(expression.numel())]
        *tables, own = _jacobians(expression, [*arguments.values(), parameters])
        for name, table in zip(arguments, tables, strict=True):
            for row, column, value in _nonzeros(table):
                self.terms[first + row].append(f"{self._coefficient(value)}{name}[{column}][l]")
        for row, lane, value in _nonzeros(own):
            self.lanes.append((first + row, self.own_lanes[lane], len(self.values)))
            self.values.append(value)

    def add_solution(self, inverse: ca.SX, rest: str) -> None:
        """Rows for minus a matrix times the vector of this name."""
        for i in range(inverse.shape[0]):
            terms = [f"{self._coefficient(-inverse[i, j])}{rest}[{j}][l]" for j in range(inverse.shape[1])]
            self.terms.append(terms)

    def _coefficient(self, value: ca.SX) -> str:
        if value.is_constant() and float(value) == 1.0:
            return ""
        self.values.append(value)
        return f"k[{len(self.values) - 1}] * "

    def code(self, target: str, first: int, count: int) -> list[str]:
        """Statements for rows first to first + count - 1 into ``target``."""
        if count == 0:
            return []
        sums = [" + ".join(self.terms[first + i]) or "0.0" for i in range(count)]
        body = [f"        {target}[{i}][l] = {text};" for i, text in enumerate(sums)]
        lines = ["    for (int l = 0; l < LANES; ++l) {", *body, "    }"]
        own = [(row - first, lane, k) for row, lane, k in self.lanes if first <= row < first + count]
        return lines + [f"    {target}[{row}][{lane}] += k[{k}];" for row, lane, k in own]


def _jacobians(expression: ca.SX, arguments: Sequence[ca.SX]) -> list[ca.SX]:
    """Jacobians by the arguments: column by column, or all together row by row where there are fewer rows.

    The residual of a robot has a row a joint and ten times as many columns, so that rows take a third less operations.
    """
    count = expression.numel()
    if count >= sum(argument.numel() for argument in arguments):
        return [jacobian(expression, argument) for argument in arguments]
    rows = ca.SX.eye(count)
    swept = reverse([expression], list(arguments), [[rows[:, i]] for i in range(count)])
    patterns = [ca.jacobian_sparsity(expression, argument) for argument in arguments]
    return [
        ca.project(ca.horzcat(*(sweep[i] for sweep in swept)).T, pattern) if pattern.nnz() else ca.SX(pattern)
        for i, pattern in enumerate(patterns)
    ]


def _nonzeros(matrix: ca.SX) -> list[tuple[int, int, ca.SX]]:
    rows, columns = matrix.sparsity().get_triplet()
    return list(zip(rows, columns, matrix.nonzeros(), strict=True))


class _Writer:
    """Writes the sources of one library."""

    def __init__(self, request: _Request) -> None:
        self.update, self.output, self.start, self.rate = request.equations
        self.balance, self.implicit, self.sampled = request.balance, request.implicit, request.sampled
        self.outputs = list(request.outputs)
        sizes = [self.update.numel_in(i) for i in range(3)]
        self.x, self.u, self.p = (ca.SX.sym(name, size) for name, size in zip("xup", sizes, strict=True))
        self.a = ca.SX.sym("a", self.balance.count if self.balance is not None else 0)
        self.chosen = self.p[[place for _, place in request.parameters]]
        self.own_lanes = [lane for lane, _ in request.parameters]
        self.lanes = lane_count(request.lanes)
        self.coefficients = 0
        self.code: list[str] = []

    def sources(self) -> dict[str, str]:
        """File name -> text."""
        generator = ca.CodeGenerator("variational_equations.c", {"with_header": False, "main": False, "mex": False})
        step = self._operation("update") if self.implicit is None else self._implicit_step(self.implicit)
        rate = ca.densify(self.rate(self.x, self.p)) if self.rate is not None else ca.SX(ca.DM(0.0))
        rate = ca.Function("variational_rate", [self.x, self.p], [rate])
        functions = [self._start(), step, self._operation("output"), rate]
        hidden = self.a.numel() if self.implicit is None else max(self.a.numel(), self.implicit.hidden)
        for function in functions:
            generator.add(function)
        config = {
            "LANES": self.lanes, "STATES": self.x.numel(), "INPUTS": self.u.numel(), "PARAMETERS": self.p.numel(),
            "OUTPUTS": self.output.numel_out(0), "HIDDEN": hidden, "COEFFICIENTS": self.coefficients,
            "WORK": max(f.sz_w() for f in functions), "SAMPLED": int(self.sampled), "SUBSTEP_RATE": SUBSTEP_RATE,
            "MINIMUM_SUBSTEPS": FEWEST_EXPLICIT if self.implicit is None else FEWEST_IMPLICIT,
            "MAXIMUM_SUBSTEPS": MAXIMUM_SUBSTEPS, "IMPLICIT": int(self.implicit is not None),
            "MEMORY": self.implicit.memory if self.implicit is not None else 0,
        }  # fmt: skip
        return {
            MAIN: wrapper_source(MAIN),
            "variational_config.h": "".join(f"#define {name} {value!r}\n" for name, value in config.items()),
            "variational_lanes.c": "\n".join(self.code) + "\n",
            "variational_equations.c": str(generator.dump()),
        }

    def _start(self) -> ca.Function:
        product, start = _Product(own_lanes=self.own_lanes), _column(self.start(self.u, self.p))
        product.add(start, {"du": self.u}, self.chosen)
        lines = product.code("result", 0, start.numel())
        self._write("lanes_start", ("const Lane *restrict du", "Lane *restrict result"), lines)
        return self._function("variational_start", [self.u, self.p], [start], product)

    def _operation(self, name: str) -> ca.Function:
        """``update`` or ``output``: its value and coefficients, and the loops of its derivatives."""
        x, a, u, p = self.x, self.a, self.u, self.p
        explicit = self.update if name == "update" else self.output
        value = _column(explicit(x, u, p))
        if name == "output":
            value = self._needed(value)
        result = value if self.balance is None else _column(getattr(self.balance, name)(x, a, u, p))
        wanted = result if name == "update" else result[self.outputs]
        product, lines = _Product(own_lanes=self.own_lanes), []
        if self.balance is not None and ca.depends_on(wanted, a):
            residual = self.balance.residual(x, a, u, p)
            product.add(residual, {"dx": x, "du": u}, self.chosen)
            product.add_solution(_inverse(jacobian(residual, a), symmetric=self.balance.symmetric), "rest")
            lines = [*product.code("rest", 0, a.numel()), *product.code("hidden", a.numel(), a.numel())]
        first = len(product.terms)
        product.add(wanted, {"dx": x, "hidden": a, "du": u}, self.chosen)
        lines += product.code("result", first, wanted.numel())
        given = (f"const Lane *restrict {argument}" for argument in ("dx", "du"))
        written = (f"Lane *restrict {argument}" for argument in ("rest", "hidden", "result"))
        self._write(f"lanes_{name}", (*given, *written), lines)
        solved = None if self.balance is None else (a, self.balance.solution(x, u, p))
        return self._function(f"variational_{name}", [x, u, p], [value], product, solved)

    def _needed(self, outputs: ca.SX) -> ca.SX:
        """The outputs that are followed or cost nothing; the others, such as accelerations, are not used here: zero."""
        result = ca.SX(outputs)
        for i in range(outputs.numel()):
            if i not in self.outputs and ca.depends_on(outputs[i], self.u):
                result[i] = 0
        return result

    def _implicit_step(self, implicit: LinearlyImplicit) -> ca.Function:
        """A linearly implicit step."""
        x, u, p, h = self.x, self.u, self.p, ca.SX.sym("h")
        m, a = ca.SX.sym("m", implicit.memory), ca.SX.sym("a", implicit.hidden)
        product, given = _Product(own_lanes=self.own_lanes), {"dx": x, "dm": m, "du": u}
        residual, count = implicit.residual(x, m, a, u, p, h), implicit.hidden
        product.add(residual, given, self.chosen)
        product.add_solution(_inverse(jacobian(residual, a), symmetric=implicit.symmetric), "rest")
        lines = [*product.code("rest", 0, count), *product.code("hidden", count, count)]
        after, memory = (_column(part) for part in implicit.following(x, m, a, u, p, h))
        product.add(ca.vertcat(after, memory), {**given, "hidden": a}, self.chosen)
        lines += product.code("result", 2 * count, after.numel())
        lines += product.code("remembered", 2 * count + after.numel(), memory.numel())
        arguments = [f"const Lane *restrict {name}" for name in given]
        arguments += [f"Lane *restrict {name}" for name in ("rest", "hidden", "result", "remembered")]
        self._write("lanes_step", arguments, lines)
        solution = implicit.solution(x, m, u, p, h)
        value = ca.substitute([after, memory], [a], [solution])
        return self._function("variational_step", [x, m, u, p, h], value, product, (a, solution))

    def _function(
        self,
        name: str,
        arguments: list[ca.SX],
        values: Sequence[ca.SX],
        product: _Product,
        solved: tuple[ca.SX, ca.SX] | None = None,
    ) -> ca.Function:
        coefficients = ca.vertcat(ca.SX(0, 1), *product.values)
        self.coefficients = max(self.coefficients, coefficients.numel())
        if solved is not None:
            coefficients = ca.substitute(coefficients, *solved)
        return ca.Function(name, arguments, ca.cse([*values, ca.densify(coefficients)]))

    def _write(self, name: str, arguments: Sequence[str], lines: Sequence[str]) -> None:
        unused = ["(void)k", *(f"(void){argument.rpartition('restrict ')[2]}" for argument in arguments)]
        self.code += [
            f"static void {name}(const double *restrict k, {', '.join(arguments)}) {{",
            f"    {', '.join(unused)};",
            *lines,
            "}",
        ]


def _column(expression: ca.SX) -> ca.SX:
    return ca.densify(ca.reshape(expression, expression.numel(), 1))


def _inverse(matrix: ca.SX, *, symmetric: bool) -> ca.SX:
    unit = ca.SX.eye(matrix.shape[0])
    return ca.densify(ca.ldl_solve(unit, *ca.ldl(matrix)) if symmetric else ca.solve(matrix, unit))
