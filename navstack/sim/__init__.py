"""The simulator: a robot with odometry, localization and sensors in a world with a map, obstacles, doors and pedestrians."""

from navstack.parameters.models.sim import BumperParams, ImuParams, LidarParams, SimParams, SonarParams
from navstack.sim.bumper import Bumper
from navstack.sim.collision import Collision
from navstack.sim.estimation import Estimation
from navstack.sim.lidar import Lidar
from navstack.sim.movers import Track, TrackedDiscs
from navstack.sim.robot import SimulatedRobot
from navstack.sim.shapes import LOW, DoorMotion, OnTrack, PedestrianMotion, Shape, Still
from navstack.sim.solids import Solids
from navstack.sim.world import Mover, World

__all__ = [
    "LOW",
    "Bumper",
    "BumperParams",
    "Collision",
    "DoorMotion",
    "Estimation",
    "ImuParams",
    "Lidar",
    "LidarParams",
    "Mover",
    "OnTrack",
    "PedestrianMotion",
    "Shape",
    "SimParams",
    "SimulatedRobot",
    "Solids",
    "SonarParams",
    "Still",
    "Track",
    "TrackedDiscs",
    "World",
]
