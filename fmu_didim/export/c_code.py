"""C source of a block: its equations by CasADi, and the constants the fixed wrapper reads.

Only two of the files in an exported FMU differ from block to block, and both are written here:
``block_equations.c`` (:func:`generate_c`) and ``block_config.h`` (:func:`generate_config`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import casadi as ca

from fmu_didim.base.errors import InputError
from fmu_didim.base.symbolic import forward
from fmu_didim.dynamics.block import (
    EXPLICIT_COST,
    FEWEST_EXPLICIT,
    FEWEST_IMPLICIT,
    FINEST_TOLERANCE,
    MAXIMUM_SUBSTEPS,
    REFINEMENT_EXPLICIT,
    REFINEMENT_IMPLICIT,
    SUBSTEP_RATE,
    SUBSTEP_TOLERANCE,
    Block,
)
from fmu_didim.export.variables import SUBSTEPS_NAME, TOLERANCE_NAME, exported_variables, layout
from fmu_didim.export.xml_file import is_text

EQUATIONS_FILE = "block_equations.c"
CONFIG_FILE = "block_config.h"


def check_exportable(block: Block, *, own_names: Iterable[str] = ()) -> None:
    """Raise InputError unless an FMU can hold the names and start values of the block.

    Args:
        own_names: of further variables that the FMU has.
    """
    where = f"block '{block.name}'"
    if not (block.name.isascii() and block.name.isidentifier()):
        raise InputError(
            "The name of the block is not a legal C name, so it cannot name an FMU.", where=where,
            valid="letters, digits and underscores, not beginning with a digit", next_step="Rename it.",
        )  # fmt: skip
    if block.sample_time is not None and not (math.isfinite(block.sample_time) and block.sample_time > 0):
        raise InputError(
            "The sample time is not a positive number.", where=where, got=f"{block.sample_time} s",
            next_step="Give the sample time in s, such as 0.001.",
        )  # fmt: skip
    _check_texts(block)
    names = [v.own.name for v in exported_variables(block)]
    names += [*([SUBSTEPS_NAME, TOLERANCE_NAME] if block.sample_time is None else []), *own_names]
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise InputError(
            "The block uses a name that its FMU needs for a variable of its own.",
            where=where,
            got=", ".join(doubled),
            next_step="Rename that variable of the block.",
        )
    for variable in (*block.inputs, *block.parameters):
        if not math.isfinite(variable.start):
            raise InputError(
                "A start value is not a finite number.", where=where, got=f"{variable.name} = {variable.start}",
                next_step="Give it a finite start value.",
            )  # fmt: skip
    unknown = sorted(block.fixed - {v.name for v in block.parameters})
    if unknown:
        raise InputError(
            "Names in 'fixed' are not parameters.", where=where, got=", ".join(unknown),
            next_step="Take names of its parameters.",
        )  # fmt: skip


def _check_texts(block: Block) -> None:
    """Names may hold any character but control characters (FMI's flat naming); XML escapes the others."""
    where = f"block '{block.name}'"
    for variable in (*block.inputs, *block.outputs, *block.states, *block.parameters):
        for kind, text in (("name", variable.name), ("unit", variable.unit)):
            if not is_text(text) or any(c in text for c in "\t\n\r") or (kind == "name" and not text):
                raise InputError(
                    f"The {kind} of a variable is not legal in an FMU.", where=where, got=repr(text),
                    valid=f"any characters but control characters{', at least one' if kind == 'name' else ''}",
                    next_step="Change it in the block.",
                )  # fmt: skip
        if not is_text(variable.description):
            raise InputError(
                "The description of a variable holds characters that XML cannot.",
                where=f"{where}, variable '{variable.name}'", got=repr(variable.description),
                next_step="Take control characters out of it.",
            )  # fmt: skip
    if not is_text(block.description):
        raise InputError(
            "The description of the block holds characters that XML cannot.", where=where, got=repr(block.description),
            next_step="Take control characters out of it.",
        )  # fmt: skip


def generate_c(block: Block, *, directional: bool = True) -> str:
    """C source of the equations of a block, without main and without a header.

    The functions, with dense column vectors, CasADi's calling convention, in double precision:

    ============================  ===========================================================
    ``block_update``              (x, u, p) -> dx/dt (nx,), or x[k+1] of a sampled block
    ``block_output``              (x, u, p) -> y (ny,)
    ``block_start``               (u, p) -> x (nx,)
    ``block_ready``               (x, p) -> the first outputs, if no input reaches them, without the others
    ``block_step``                (x, m, u, p, h) -> x (nx,), m (nm,) after a linearly implicit step, if there is one
    ``block_rate``                (x, p) -> rates of RK4 and of linearly implicit steps, if there are, 1/s; 0 without
    ``block_directional``         (x, u, p, dx, du, dp) -> J_update d, J_output d
    ``block_start_directional``   (u, p, du, dp) -> J_start d
    ============================  ===========================================================

    where J d is the Jacobian with respect to all arguments times the seed, in CasADi's forward mode.

    Args:
        directional: whether the last two, two fifths of the code of a robot, are among them.

    Raises:
        InputError: a name or a start value cannot be exported.

    Source: J. A. E. Andersson et al., "CasADi: a software framework for nonlinear optimization and
    optimal control", Math. Prog. Comp. 11 (2019), sections 3.6 (forward mode) and 5 (C code).
    """
    check_exportable(block)
    generator = ca.CodeGenerator(EQUATIONS_FILE, {"with_header": False, "main": False, "mex": False})
    for function in _exported_functions(block, directional=directional):
        generator.add(function)
    return str(generator.dump())


def generate_config(block: Block, *, guid: str, directional: bool = True) -> str:
    """The header ``block_config.h``: sizes, value references, start values and names of a block."""
    check_exportable(block)
    refs, variables = layout(block), list(exported_variables(block))
    fixed = [int(v.name in block.fixed) for v in block.parameters]
    implicit = block.implicit
    lines = [
        "/* Generated by fmu_didim: what the wrapper knows about this block. */",
        f"#define BLOCK_NAME {_c_string(block.name)}",
        f"#define BLOCK_GUID {_c_string(guid)}",
        f"#define BLOCK_SAMPLED {int(block.sample_time is not None)}",
        f"#define BLOCK_SAMPLE_TIME {float(block.sample_time or 0.0)!r}",
        f"#define BLOCK_SUBSTEP_RATE {SUBSTEP_RATE!r}",
        # The rule of `choose_steps` is handed over, not repeated.
        f"#define BLOCK_EXPLICIT_COST {EXPLICIT_COST!r}",
        f"#define BLOCK_FEWEST_EXPLICIT {FEWEST_EXPLICIT}",
        f"#define BLOCK_FEWEST_IMPLICIT {FEWEST_IMPLICIT}",
        f"#define BLOCK_MAXIMUM_SUBSTEPS {MAXIMUM_SUBSTEPS}",
        f"#define BLOCK_TOLERANCE {SUBSTEP_TOLERANCE!r}",
        f"#define BLOCK_FINEST_TOLERANCE {FINEST_TOLERANCE!r}",
        f"#define BLOCK_REFINEMENT_EXPLICIT {REFINEMENT_EXPLICIT}",
        f"#define BLOCK_REFINEMENT_IMPLICIT {REFINEMENT_IMPLICIT}",
        f"#define READY_COUNT {ready_count(block)}",
        f"#define BLOCK_DIRECTIONAL {int(directional)}",
        f"#define BLOCK_IMPLICIT {int(implicit is not None)}",
        f"#define MEMORY_COUNT {implicit.memory if implicit is not None else 0}",
        f"#define INPUT_COUNT {len(refs.inputs)}",
        f"#define OUTPUT_COUNT {len(refs.outputs)}",
        f"#define STATE_COUNT {len(refs.states)}",
        f"#define PARAMETER_COUNT {len(refs.parameters)}",
        f"#define DERIVATIVE_COUNT {len(refs.derivatives)}",
        f"#define VALUE_COUNT {len(variables)}",
        "/* First value reference of each group; they follow each other without a gap. */",
        f"#define INPUT_FIRST {refs.inputs.start}",
        f"#define OUTPUT_FIRST {refs.outputs.start}",
        f"#define STATE_FIRST {refs.states.start}",
        f"#define PARAMETER_FIRST {refs.parameters.start}",
        f"#define DERIVATIVE_FIRST {refs.derivatives.start}",
        f"#define SUBSTEPS_REFERENCE {len(variables)}",
        f"#define TIME_REFERENCE {refs.time}",
        f"#define TOLERANCE_REFERENCE {len(variables) + 2}",
        _c_array("double", "block_start_values", [v.start or "0.0" for v in variables]),
        _c_array("unsigned char", "block_parameter_fixed", [str(flag) for flag in fixed]),
        _c_array("char *const", "block_names", [_c_string(v.own.name) for v in variables]),
    ]
    return "\n".join(lines) + "\n"


def _exported_functions(block: Block, *, directional: bool) -> list[ca.Function]:
    nx, nu, p = len(block.states), len(block.inputs), len(block.parameters)
    functions = [f for f in (block.update, block.output, block.start, block.rates) if f is not None]
    # Scalar expressions give straight-line code; matrix expressions are kept where they are needed.
    kind: Any = ca.SX if all(f.is_a("SXFunction") for f in functions) else ca.MX
    x, u, q = kind.sym("x", nx), kind.sym("u", nu), kind.sym("p", p)
    dx, du, dq = kind.sym("x_seed", nx), kind.sym("u_seed", nu), kind.sym("p_seed", p)

    def column(expression: Any, rows: int) -> Any:
        return ca.densify(ca.reshape(expression, rows, 1))

    update = column(block.update(x, u, q), nx)
    output = column(block.output(x, u, q), len(block.outputs))
    start = column(block.start(u, q), nx)
    rate = column(block.rates(x, q), block.rates.numel_out(0)) if block.rates is not None else kind(ca.DM(0.0))
    derivatives = list[ca.Function]()
    if directional:
        # One forward sweep for both results, so that they share what they have in common.
        dots = [ca.densify(dot) for dot in forward([update, output], [x, u, q], [[dx, du, dq]])[0]]
        start_dot = ca.densify(forward([start], [u, q], [[du, dq]])[0][0])
        derivatives = [
            _function("block_directional", [x, u, q, dx, du, dq], dots),
            _function("block_start_directional", [u, q, du, dq], [start_dot]),
        ]
    ready, still = ready_count(block), column(block.output(x, kind.zeros(nu), q), len(block.outputs))
    return [
        _function("block_update", [x, u, q], [update]),
        _function("block_output", [x, u, q], [output]),
        _function("block_start", [u, q], [start]),
        _function("block_rate", [x, q], [rate]),
        *derivatives,
        *([_function("block_ready", [x, q], [still[:ready]])] if ready else []),
        *([block.implicit.step("block_step")] if block.implicit is not None else []),
    ]


def _function(name: str, arguments: list[Any], results: list[Any]) -> ca.Function:
    """A function that computes common subexpressions once: half of the operations of a robot's directional
    derivative."""
    return ca.Function(name, arguments, ca.cse(results))


def ready_count(block: Block) -> int:
    """Number of the first outputs of a continuous block that depend on no input: they are computed without the others,
    such as positions without accelerations; 0 for a sampled block, and where no output depends on an input."""
    if block.sample_time is not None:
        return 0
    reached = {int(row) for row in block.output.jac_sparsity(0, 1).get_triplet()[0]}
    return min(reached, default=0)


def _c_string(text: str) -> str:
    """A C string of the UTF-8 bytes; octal escapes have an end, and ``\\?`` is no trigraph."""
    safe = {ord(c): c for c in map(chr, range(32, 127))} | {ord(c): f"\\{c}" for c in '"\\?'}
    return '"' + "".join(safe.get(byte, f"\\{byte:03o}") for byte in text.encode()) + '"'


def _c_array(kind: str, name: str, values: Iterable[str]) -> str:
    items = list(values) or ["0"]  # C has no empty array
    return f"static const {kind} {name}[] = {{{', '.join(items)}}};"
