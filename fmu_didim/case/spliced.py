"""The effects of drives and sensors that a robot description lists, put into the loop of a case."""

from __future__ import annotations

from fmu_didim.master import System, splice_effect
from fmu_didim.robot import RobotDescription


def with_spliced_effects(system: System, robot: RobotDescription, *, plant: str = "plant") -> System:
    """The loop with the drive and sensor effects of each joint, with the parameters given there.

    Args:
        system: the loop; plant: name of its plant, which may be any FMU.

    Raises:
        InputError: the loop runs in parallel (Jacobi), or nothing takes the signal that an effect changes.
    """
    for j, joint in enumerate(robot.joints, start=1):
        for effect in joint.outside_effects():
            names = [v.name for v in (*effect.parameters(joint.type), *effect.shapes(joint.type))]
            values = {name: joint.parameters[name] for name in names if name in joint.parameters}
            system = splice_effect(system, effect, j, joint.type, values=values, plant=plant)
    return system
