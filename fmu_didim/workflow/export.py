"""The verb ``export``: a description as an FMU, the loop of a case as an SSP archive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fmu_didim.base.documents import load_yaml
from fmu_didim.base.errors import InputError
from fmu_didim.case import Case, load_case
from fmu_didim.controllers import read_controller
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.estimators.starts.start import with_free_delay
from fmu_didim.export import build_fmu, build_modelica
from fmu_didim.export.versions import DEFAULT_VERSION
from fmu_didim.results.result import read_result
from fmu_didim.ssp import write_ssp
from fmu_didim.workflow.output.result import Result
from fmu_didim.workflow.output.result_folder import check_writable, reported_unwritable
from fmu_didim.workflow.simulate import model_without_data, named_values


def export_fmu(
    description: Path, directory: Path, *, fmi_version: str | None = None, platforms: Sequence[str] | None = None
) -> Path:
    """Build the FMU of a robot description, a controller description or a Modelica file.

    Args:
        directory: for the FMU.
        fmi_version: of the standard, :data:`~fmu_didim.export.versions.DEFAULT_VERSION` by default.
        platforms: machines to build for, this one by default.

    Returns:
        The path of the FMU.

    Raises:
        InputError: the description is wrong, or the folder cannot be written.
    """
    if description.suffix == ".mo":
        if fmi_version is not None or platforms is not None:
            raise InputError(
                "The FMU of a Modelica file is of FMI 2.0 and for this machine.", where=str(description),
                next_step="Leave out --fmi and --platform.",
            )  # fmt: skip
        return build_modelica(description, directory=directory)
    if description.suffix == ".fmu":
        raise InputError(
            "This is an FMU already.", where=str(description),
            next_step="Identified values go into an archive with it, with an SSV file: fmu-didim export CASE.yaml "
            "--result result.json --ssp FILE.ssp.",
        )  # fmt: skip
    is_controller = "law" in load_yaml(description)
    block = read_controller(description) if is_controller else RobotModel(read_robot(description)).block()
    check_writable(directory)
    with reported_unwritable(directory):
        return build_fmu(block, directory=directory, fmi_version=fmi_version or DEFAULT_VERSION, platforms=platforms)


def export_ssp(
    case: Case | Path | str | Mapping[str, Any], path: Path | str, *, result: Result | Path | str | None = None
) -> Path:
    """Write the closed loop of a case as an SSP archive.

    Args:
        case: a loaded case, the path of its file, or its content; torque logs are not needed.
        path: the ``.ssp`` file.
        result: what :func:`~fmu_didim.identify` returned, ``result.json`` or its folder; its values, the delay among
            them, go into the archive instead of those of the robot description.

    Returns:
        The path of the archive.

    Raises:
        InputError: a component is no FMU, or there is no such result, or it holds no values of this case.
    """
    case = case if isinstance(case, Case) else load_case(case, require_torque=False)
    model = model_without_data(case, None)
    values: dict[str, float] = {}
    if result is not None:
        document = result.document if isinstance(result, Result) else read_result(result)
        values = {name: p.value for name, p in document.parameters.items()}
        if not values:
            raise InputError(
                "The result holds no values.", where=str(result), got=document.status,
                next_step="Take the result of a run that ended with values.",
            )  # fmt: skip
        if "delay" in values and "delay" not in model.names:
            model = with_free_delay(model)
    system = model.system(named_values(model, values))
    return write_ssp(system, path, name=case.name)
