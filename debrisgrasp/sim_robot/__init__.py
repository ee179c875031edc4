"""Layer 6: a whole robot in physics behind the protocols of a real one; extra `sim`."""

from .physics import RobotPhysics
from .robot import SimRobot, SimTruth, sim_robot

__all__ = ["RobotPhysics", "SimRobot", "SimTruth", "sim_robot"]
