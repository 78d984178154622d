"""Makes house.fmu: a room between the weather and a heated flat, two resistances and a capacity.

    C dT/dt = (T_out - T) / R1 + (T_beside - T) / R2,    T(0) = T_start

What is written holds C sources alone, which every machine compiles when it first runs them.
"""

import zipfile
from pathlib import Path

import casadi as ca

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu

HERE = Path(__file__).parent


def house() -> Block:
    """The equations, and the values that its maker gives the FMU."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u", 2), ca.SX.sym("p", 4)
    (out, beside), (r1, r2, c, start) = ca.vertsplit(u), ca.vertsplit(p)
    flow = (out - x) / r1 + (beside - x) / r2
    return Block(
        name="house",
        description="A room between the weather and a heated flat: two resistances and a capacity",
        inputs=(
            Variable("T_out", "degC", description="Air outside"),
            Variable("T_beside", "degC", description="Air in the flat beside"),
        ),
        outputs=(Variable("T", "degC", description="Air in the room"),),
        states=(Variable("x", "degC", description="Of the capacity"),),
        parameters=(
            Variable("R1", "K/W", start=0.05, description="Resistance of the outer wall"),
            Variable("R2", "K/W", start=0.05, description="Resistance of the wall to the flat"),
            Variable("C", "J/K", start=4e6, description="Heat capacity of the room"),
            Variable("T_start", "degC", start=20.0, description="Temperature at the start"),
        ),
        update=ca.Function("update", [x, u, p], [flow / c]),
        output=ca.Function("output", [x, u, p], [x]),
        start=ca.Function("start", [u, p], [start]),
        rate_bound=ca.Function("rate", [x, p], [(1 / r1 + 1 / r2) / c]),
        fixed=frozenset({"T_start"}),
    )


def main() -> None:
    """Write the FMU without the library for this machine."""
    with zipfile.ZipFile(build_fmu(house())) as built, zipfile.ZipFile(HERE / "house.fmu", "w") as written:
        for member in built.infolist():
            if not member.filename.startswith("binaries/"):
                written.writestr(member, built.read(member))


if __name__ == "__main__":
    main()
