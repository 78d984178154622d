"""Control laws, one per file, and the table of their names."""

from collections.abc import Mapping
from pathlib import Path

from fmu_didim.base.documents import TO_FILL_IN, Lines, load_yaml, validate
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.controllers.base import ControlLaw
from fmu_didim.controllers.cascade import CascadePPI
from fmu_didim.controllers.computed_torque import ComputedTorque
from fmu_didim.controllers.emps import Emps
from fmu_didim.controllers.pd import PD
from fmu_didim.controllers.pid import PID
from fmu_didim.dynamics.block import Block

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
    return read_law(path).block(folder=path.parent)


def read_law(path: Path | str) -> ControlLaw:
    """The law and its options in a YAML file; raises as :func:`read_controller`."""
    content = load_yaml(path)
    law = str(content.get("law", ""))
    if law == TO_FILL_IN:
        raise InputError(
            "The control law is still to be filled in.", where=f"{path}, law", valid=LAWS,
            next_step="Replace EDIT with one of these.",
        )  # fmt: skip
    if law not in LAWS:
        raise UnknownNameError("control law", law, LAWS, where=str(path))
    return validate(LAWS[law], content, where=str(path), lines=Lines(Path(path)))
