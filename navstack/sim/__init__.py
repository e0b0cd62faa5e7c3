"""The simulator: a robot's body, odometry, lidars and bumpers in a world made of a map and round obstacles."""

from navstack.sim.bumper import Bumper
from navstack.sim.lidar import Lidar
from navstack.sim.movers import Track, TrackedDiscs
from navstack.sim.params import BumperParams, LidarParams, SimParams
from navstack.sim.robot import Contact, SimulatedRobot
from navstack.sim.shapes import Shape
from navstack.sim.world import Mover, World

__all__ = [
    "Bumper",
    "BumperParams",
    "Contact",
    "Lidar",
    "LidarParams",
    "Mover",
    "Shape",
    "SimParams",
    "SimulatedRobot",
    "Track",
    "TrackedDiscs",
    "World",
]
