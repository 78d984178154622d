"""Our FMUs in an independent master: libcosim (Open Simulation Platform) steps in Jacobi order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_didim.components import FmuComponent, load_fmu
from fmu_didim.controllers import read_controller
from fmu_didim.cosim import closed_loop, simulate
from fmu_didim.data.signals import Trajectory
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.export import build_fmu
from tests.conftest import package
from tests.helpers import reference as smooth_reference

package("libcosimpy._internal", lambda library: library.libcosimc())
STEP_S = 0.005
TICKS = 400


def references_of(fmu: FmuComponent, names: list[str]) -> list[int]:
    numbers = dict(zip((v.name for v in fmu.inputs), fmu.input_references, strict=True))
    numbers |= dict(zip((v.name for v in fmu.outputs), fmu.output_references, strict=True))
    numbers |= fmu.references
    return [numbers[name] for name in names]


def by_libcosim(plant: FmuComponent, controller: FmuComponent, reference: Trajectory) -> np.ndarray:
    """Command of the controller at the ticks, (TICKS, 2)."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(round(STEP_S * 1e9))
    slaves = {
        name: execution.add_local_slave(CosimLocalSlave(str(fmu.path), name))
        for name, fmu in (("plant", plant), ("controller", controller))
    }
    wires = [("controller", f"command{j}", "plant", f"tau{j}") for j in (1, 2)]
    wires += [("plant", f"{s}{j}", "controller", f"{s}{j}") for s in ("q", "dq") for j in (1, 2)]
    fmus = {"plant": plant, "controller": controller}
    for source, output, target, entry in wires:
        status = execution.connect_real_variables(
            slaves[source], references_of(fmus[source], [output])[0],
            slaves[target], references_of(fmus[target], [entry])[0],
        )  # fmt: skip
        assert status == 0
    for name, value in zip(reference.names, reference.values[0], strict=True):
        start = {"q1": "q_start1", "q2": "q_start2", "dq1": "dq_start1", "dq2": "dq_start2"}.get(name)
        if start is not None:
            execution.real_initial_value(slaves["plant"], plant.references[start], value)
            entry = references_of(controller, [f"{name[:-1]}_ref{name[-1]}"])[0]
            execution.real_initial_value(slaves["controller"], entry, value)
    override, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    assert execution.add_manipulator(override)
    assert execution.add_observer(observer)
    columns = [f"{s}{j}" for s in ("q", "dq") for j in (1, 2)]
    roles = references_of(controller, [f"{c[:-1]}_ref{c[-1]}" for c in columns])
    commands = references_of(controller, ["command1", "command2"])
    table = reference.select(columns)
    found = []
    for k in range(TICKS):
        assert override.slave_real_values(slaves["controller"], roles, table[k].tolist())
        assert execution.step()
        found.append(list(observer.last_real_values(slaves["controller"], commands)))
    return np.array(found)


def test_same_torque_as_libcosim_in_jacobi_order() -> None:
    plant = load_fmu(build_fmu(RobotModel(read_robot(Path("fmus/scara/robot.yaml"))).block()))
    controller = load_fmu(build_fmu(read_controller(Path("controllers/scara_pd.yaml"))))
    reference = smooth_reference(STEP_S * TICKS)
    starts = dict(zip(reference.names, reference.values[0], strict=True))
    moving = plant.with_parameters({f"{s}_start{j}": starts[f"{s}{j}"] for s in ("q", "dq") for j in (1, 2)})
    system = closed_loop(
        moving, controller, joint_count=2, step_size=STEP_S, reference_names=reference.names, jacobi=True
    )
    recording = simulate(system, reference, ticks=np.arange(TICKS + 1))
    ours = np.column_stack([recording.inputs["plant.tau1"], recording.inputs["plant.tau2"]])
    theirs = by_libcosim(plant, controller, reference)
    scale = np.abs(ours).max()
    # What libcosim shows after step k is what the plant gets at tick k + 1.
    assert np.abs(theirs - ours[1:]).max() <= 1e-9 * scale, (theirs[:6], ours[:7])
    # The order matters: with the controller first the torque differs by far more.
    first = simulate(
        closed_loop(moving, controller, joint_count=2, step_size=STEP_S, reference_names=reference.names),
        reference, ticks=np.arange(TICKS + 1),
    )  # fmt: skip
    other = np.column_stack([first.inputs["plant.tau1"], first.inputs["plant.tau2"]])
    assert np.abs(other - ours).max() > 1e-3 * scale


@pytest.mark.parametrize("delay", [0.0, 0.5, 1.0])
def test_regressor_fits_the_applied_torque_in_jacobi_order(delay: float) -> None:
    model = RobotModel(read_robot(Path("fmus/scara/robot.yaml")))
    reference = smooth_reference(STEP_S * TICKS)
    system = closed_loop(
        load_fmu(build_fmu(model.block())), load_fmu(build_fmu(read_controller(Path("controllers/scara_pd.yaml")))),
        joint_count=2, step_size=STEP_S, reference_names=reference.names, jacobi=True, delay_samples=delay,
    )  # fmt: skip
    recording = simulate(system, reference)
    motion = [recording.table([f"plant.{s}1", f"plant.{s}2"]) for s in ("q", "dq", "ddq")]
    torque = np.column_stack([recording.inputs["plant.tau1"], recording.inputs["plant.tau2"]])
    rebuilt = model.regressor_rows(*motion) @ model.parameter_values
    np.testing.assert_allclose(rebuilt, torque, rtol=0, atol=1e-11 * np.abs(torque).max())
