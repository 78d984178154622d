"""The verb ``export``: the loop of a case as an SSP archive."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fmu_didim.case import Case, load_case
from fmu_didim.errors import InputError
from fmu_didim.identification.result import ResultDocument, load_result
from fmu_didim.identification.start import with_free_delay
from fmu_didim.ssp import write_ssp
from fmu_didim.workflow.outcome import Outcome
from fmu_didim.workflow.simulate import model_without_data, named_values


def export_ssp(
    case: Case | Path | str | Mapping[str, Any], path: Path | str, *, result: Outcome | Path | str | None = None
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
        document = result.document if isinstance(result, Outcome) else _loaded(Path(result))
        values = {name: p.value for name, p in document.parameters.items()}
        if not values:
            raise InputError("The result holds no values.", where=str(result), got=document.status)
        if "delay" in values and "delay" not in model.names:
            model = with_free_delay(model)
    system = model.system(named_values(model, values))
    return write_ssp(system, path, name=case.name)


def _loaded(path: Path) -> ResultDocument:
    return load_result(path.parent if path.suffix == ".json" else path)
