"""Which public FMUs are calibrated, from which data, and what their user edits in the case that ``init`` writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fmu_didim.data.signals import Array

Values = Mapping[str, float]


@dataclass(frozen=True)
class Trial:
    """An FMU and what is asked of it. Its data are what FMPy simulates with ``truth``, and noise.

    Attributes:
        name: of the trial; repository: ``owner/name``; fmu: its file there; made_by: the tool that exported it.
        outputs: name -> standard deviation of its noise; instants: (N,) s of the samples.
        truth: the values that are sought; known: values that the case holds, other than those of the FMU.
        starts: where the search begins, if not at the FMU's own values.
        inputs: name -> (amplitude, period in s) of a sine around ``level``; level: of all inputs.
        interface: of the reference: that which the case takes where it is given no other.
        step_s: the communication step of a co-simulation, where the tool states one.
        settings: lines that the user adds beside.
    """

    name: str
    repository: str
    fmu: str
    made_by: str
    outputs: Values
    instants: Array
    truth: Values
    known: Values = field(default_factory=dict)
    starts: Values = field(default_factory=dict)
    inputs: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    level: float = 0.0
    interface: str = "ModelExchange"
    step_s: float | None = None
    settings: Sequence[str] = ()

    def path(self, checkouts: Path) -> Path:
        """Its FMU among the checked-out repositories."""
        return checkouts / self.repository / self.fmu

    def driven(self) -> dict[str, Array]:
        """(N,) values of each input at the instants."""
        return {
            name: self.level + amplitude * np.sin(2 * np.pi * self.instants / period)
            for name, (amplitude, period) in self.inputs.items()
        }


def _estim8(fmu: str, outputs: Values, truth: Values, starts: Values) -> Trial:
    return Trial(
        fmu, "JuBiotech/estim8", f"tests/test_data/{fmu}_linux64.fmu", "OpenModelica 1.26", outputs,
        np.linspace(0.0, 10.0, 51), truth, starts=starts,
    )  # fmt: skip


def _omsysident(fmu: str, outputs: Values, truth: Values, inputs: Mapping[str, tuple[float, float]]) -> Trial:
    return Trial(
        fmu, "OpenModelica/OMSysIdent", f"testsuite/resources/{fmu}.fmu", "OpenModelica 1.14", outputs,
        np.linspace(0.0, 4.0, 81), truth, inputs=inputs,
    )  # fmt: skip


TRIALS = (
    _estim8("Growth", {"X": 0.1}, {"X0": 0.12, "mu_max": 0.43}, {}),
    _estim8("SimpleBatch", {"X": 0.05, "S": 0.1}, {"mu_max": 0.52, "Y_XS": 0.48}, {}),
    _omsysident("HelloWorld", {"x": 0.01}, {"a": -1.7, "x_start": 1.3}, {}),
    _omsysident("HelloWorldWithInput", {"x": 0.01}, {"a": -1.7, "x_start": 1.3}, {"u": (1.0, 2.0)}),
    _omsysident(
        "Lin2DimODE", {"x1": 0.005, "x2": 0.005}, {"a11": -1.2, "a12": 0.3, "a21": 0.25, "a22": -0.7}, {}
    ),
    Trial(
        "Drivetrain", "CATIA-Systems/FMPy", "tests/resources/Drivetrain.fmu", "Dymola 2021x", {"w": 0.02},
        np.linspace(0.0, 4.0, 401), {"inertia1.J": 1.4, "loadTorque.tau_constant": 7.0}, inputs={"tau": (40.0, 1.3)},
    ),
    Trial(
        "StateInitExample", "open-simulation-platform/libcosim", "tests/data/fmi2/StateInitExample.fmu",
        "Simulink R2024b", {"Integrator_out1": 0.01}, np.linspace(0.0, 5.0, 101),
        {"Parameters.Integrator1_x0": 0.7, "Parameters.Constant_Value": 1.3}, interface="CoSimulation", step_s=0.01,
    ),
    Trial(
        "MassSpringDamper1", "INTO-CPS-Association/maestro", "mass_spring_damper/MassSpringDamper1.fmu", "20-sim",
        {"x1": 0.005}, np.linspace(0.0, 10.0, 201), {"c1": 1.4, "d1": 0.6}, interface="CoSimulation", step_s=0.05,
    ),
    Trial(
        "Tank", "NTNU-IHB/PythonFMU", "Tank.fmu", "PythonFMU 0.7", {"h": 0.005}, np.linspace(0.0, 200.0, 401),
        {"area": 0.06, "outlet": 0.0007}, interface="CoSimulation", step_s=0.5,
    ),
)  # fmt: skip
"""One a row: the estim8 notebooks' models, those of OMSysIdent's tests, and an FMU each of Dymola, Simulink, 20-sim and
PythonFMU."""
COVERED = ("Growth", "HelloWorldWithInput", "Lin2DimODE", "MassSpringDamper1")
"""Those whose coverage is counted: a batch, a driven decay, one of four parameters, and one in co-simulation."""
