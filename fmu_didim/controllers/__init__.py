"""Control laws, one per file, and the table of their names."""

from collections.abc import Mapping
from pathlib import Path

from fmu_didim.block import Block
from fmu_didim.controllers.base import ControlLaw
from fmu_didim.controllers.cascade import CascadePPI
from fmu_didim.controllers.computed_torque import ComputedTorque
from fmu_didim.controllers.emps import Emps
from fmu_didim.controllers.pd import PD
from fmu_didim.controllers.pid import PID
from fmu_didim.documents import load_yaml, validate
from fmu_didim.errors import UnknownNameError

LAWS: Mapping[str, type[ControlLaw]] = {
    "pd": PD,
    "pid": PID,
    "cascade_ppi": CascadePPI,
    "computed_torque": ComputedTorque,
    "emps": Emps,
}


def read_controller(path: Path | str) -> Block:
    """The controller described in a YAML file, as a sampled block.

    Raises:
        InputError: the description has problems; UnknownNameError: there is no such law.
    """
    path = Path(path)
    content = load_yaml(path)
    law = str(content.get("law", ""))
    if law not in LAWS:
        raise UnknownNameError("control law", law, LAWS, where=str(path))
    return validate(LAWS[law], content, where=str(path)).block(folder=path.parent)


__all__ = ["LAWS", "PD", "PID", "CascadePPI", "ComputedTorque", "ControlLaw", "Emps", "read_controller"]
