import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.stated_size import of_peak


class TorqueOffset(TorqueEffect):
    """tau_e = offset, in N.m (N): bias of the current measurement or of the amplifier."""

    name = "torque_offset"
    title = "Torque offset"
    equation = "offset"
    class_name = "offset"
    confounded_with = ("asymmetric_coulomb", "spring")
    signature = "Residual with the same mean in both directions of motion and at all positions."
    experiment = (
        "Hold the joint at rest at several positions: an offset stays, Coulomb friction of either direction does not."
    )
    source = "Gautier, Janot, Vandanjon: DIDIM, section 2"
    stated = of_peak("an offset of the torque")
    own_parameters = (Parameter("offset", "torque", "torque offset"),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (ca.SX(1),)
