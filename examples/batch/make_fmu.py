"""Makes batch.fmu: biomass that grows on a substrate until that is used up, after Monod.

    mu = mu_max S / (K_S + S),    dX/dt = mu X,    dS/dt = -mu X / Y_XS,    X(0) = X0,    S(0) = S0

What is written holds C sources alone, which every machine compiles when it first runs them.
"""

import zipfile
from pathlib import Path

import casadi as ca

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu

HERE = Path(__file__).parent
HOUR = 3600.0
"""[s]"""


def batch() -> Block:
    """The equations, and the values that its maker gives the FMU."""
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u", 0), ca.SX.sym("p", 5)
    (biomass, substrate), (mu_max, k_s, y_xs, x0, s0) = ca.vertsplit(x), ca.vertsplit(p)
    growth = mu_max / HOUR * substrate / (k_s + substrate)
    used_up = mu_max / HOUR * biomass * k_s / (y_xs * (k_s + substrate) ** 2)
    return Block(
        name="batch",
        description="Biomass that grows on a substrate until that is used up, after Monod",
        inputs=(),
        outputs=(
            Variable("X", "kg/m3", description="Concentration of the biomass"),
            Variable("S", "kg/m3", description="Concentration of the substrate"),
        ),
        states=(Variable("biomass", "kg/m3"), Variable("substrate", "kg/m3")),
        parameters=(
            Variable("mu_max", "1/h", start=0.4, description="Greatest rate of growth"),
            Variable("K_S", "kg/m3", start=0.1, description="Substrate at which growth is half as fast"),
            Variable("Y_XS", "1", start=0.35, description="Biomass that a unit of substrate gives"),
            Variable("X0", "kg/m3", start=0.2, description="Biomass at the start"),
            Variable("S0", "kg/m3", start=10.0, description="Substrate at the start"),
        ),
        update=ca.Function("update", [x, u, p], [ca.vertcat(growth * biomass, -growth * biomass / y_xs)]),
        output=ca.Function("output", [x, u, p], [x]),
        start=ca.Function("start", [u, p], [ca.vertcat(x0, s0)]),
        rate_bound=ca.Function("rate", [x, p], [mu_max / HOUR + used_up]),
        fixed=frozenset({"X0", "S0"}),
    )


def main() -> None:
    """Write the FMU without the library for this machine."""
    with zipfile.ZipFile(build_fmu(batch())) as built, zipfile.ZipFile(HERE / "batch.fmu", "w") as written:
        for member in built.infolist():
            if not member.filename.startswith("binaries/"):
                written.writestr(member, built.read(member))


if __name__ == "__main__":
    main()
