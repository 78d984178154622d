"""Robots: description and models."""

from fmu_didim.robot.description import Joint, RobotDescription, read_robot, write_robot
from fmu_didim.robot.model import RobotModel

__all__ = ["Joint", "RobotDescription", "RobotModel", "read_robot", "write_robot"]
