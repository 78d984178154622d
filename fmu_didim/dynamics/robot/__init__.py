"""Robots: description and models."""

from fmu_didim.dynamics.robot.description import RobotDescription
from fmu_didim.dynamics.robot.files import read_robot, write_robot
from fmu_didim.dynamics.robot.model import RobotModel

__all__ = ["RobotDescription", "RobotModel", "read_robot", "write_robot"]
