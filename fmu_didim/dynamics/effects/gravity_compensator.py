import math

import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Search, Surroundings, Values


class GravityCompensator(TorqueEffect):
    """tau_e = (Fgc + kgc (l - l0)) dl/dq, the force of a spring of length l that acts on a lever.

    Revolute: l^2 = Lc^2 + rc^2 + 2 Lc rc cos(q - qc), with the distance Lc of the spring's foot from the axis, the
    lever rc and the position qc at which the spring is longest. Prismatic: l^2 = Lc^2 + (q - qc)^2, a spring across the
    slide. Fgc is the pull in N at l0 = sqrt(Lc^2 + rc^2) (Lc for a slide), negative for a strut that pushes (a gas
    spring, a hydraulic cylinder); kgc is the stiffness in N/m. The part l dl/dq kgc of a revolute joint looks exactly
    like gravity.
    """

    name = "gravity_compensator"
    title = "Gravity compensator with a spring"
    equation = "(Fgc + kgc*(l - l0))*dl/dq, l = l(q; Lc, rc, qc)"
    class_name = "position-dependent load"
    confounded_with = ("spring", "cubic_spring")
    signature = "Residual that depends only on the position of this joint, close to sine and cosine."
    experiment = "A wide range of positions, with the base or the preceding joints in other orientations."
    source = (
        "Klimchik, Caro, Wu, Chablat, Furet, Pashkevich: Identification of the manipulator stiffness model "
        "parameters with gravity compensators, arXiv 1311.6674"
    )
    signed = frozenset({"qc"})
    acts_on_link = True
    simple_form = ("spring", "torque_offset")
    own_parameters = (
        Parameter("Fgc", "N", "pull of the compensator's spring at its reference length, negative where it pushes"),
        Parameter("kgc", "N/m", "stiffness of the compensator's spring", least=0.0),
    )
    own_shapes = (
        Parameter("Lc", "m", "distance of the foot of the spring", 0.5),
        Parameter("rc", ("m", None), "lever of the spring", 0.1),
        Parameter(
            "qc", "position", "position of the longest or shortest spring",
            search=(
                Search(-math.pi, 5 / 6 * math.pi, 12, logarithmic=False),
                Search(-1.0, 1.0, 9, logarithmic=False),
            ),
        ),
    )  # fmt: skip

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        away, foot = at.q - shapes["qc"], shapes["Lc"]
        if at.joint_type == "prismatic":
            length, reference = ca.sqrt(foot**2 + away**2), foot
            arm = away / length
        else:
            lever = shapes["rc"]
            length = ca.sqrt(foot**2 + lever**2 + 2 * foot * lever * ca.cos(away))
            reference = ca.sqrt(foot**2 + lever**2)
            arm = -foot * lever * ca.sin(away) / length
        return (arm, (length - reference) * arm)

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        force, spring = ca.fabs(parameters["Fgc"]), ca.fabs(parameters["kgc"])
        foot = shapes["Lc"]
        if "rc" not in shapes:
            return force / foot + spring
        lever = shapes["rc"]
        return force * foot * lever / ca.fmax(ca.fabs(foot - lever), 0.1 * lever) + 2 * spring * foot * lever
