import math

from fmu_didim.dynamics.effects.joint import Parameter, Search
from fmu_didim.dynamics.effects.stated_size import StatedSize
from fmu_didim.dynamics.effects.structure import StructureEffect


def tilt(name: str, text: str) -> Parameter:
    """An angle of the base."""
    grid = Search(-0.1, 0.1, 3, logarithmic=False)
    return Parameter(name, "rad", text, neutral=0.0, limits=(-3.2, 3.2), search=grid)


class BaseTilt(StructureEffect):
    """Gravity in the frame of the base is R(h_x, tilt_x) R(h_y, tilt_y) g, with the angles in rad about two horizontal
    axes: x and y of the base where gravity acts along z, else the axis of the base closest to horizontal, and the
    one perpendicular to it. Listed at joint 1."""

    name = "base_tilt"
    title = "Tilt of the base"
    equation = "g -> R(h_x, tilt_x)*R(h_y, tilt_y)*g"
    confounded_with = ("torque_offset", "spring")
    signature = "Residual like gravity on all joints; a first vertical joint absorbs it in its MX and MY."
    experiment = "A wide range of all joints, or a spirit level on the base."
    source = "rotation of the gravity vector; Khalil and Dombre, Modeling, Identification and Control of Robots, ch. 9"
    acts_on_base = True
    signed = frozenset({"tilt_x", "tilt_y"})
    stated = StatedSize("a tilt of the base", "deg", math.degrees(1.0), largest=10.0, joints="base")
    own_parameters = (
        tilt("tilt_x", "rotation of gravity about the first horizontal axis"),
        tilt("tilt_y", "rotation of gravity about the second one"),
    )
