"""The simulator: a robot with odometry, localization and sensors in a world with a map, obstacles, doors and pedestrians."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.parameters import BumperParams as BumperParams
    from navstack.parameters import CameraParams as CameraParams
    from navstack.parameters import ImuParams as ImuParams
    from navstack.parameters import LidarParams as LidarParams
    from navstack.parameters import SimParams as SimParams
    from navstack.parameters import SonarParams as SonarParams
    from navstack.sim.body import DRIVEN_HIT as DRIVEN_HIT
    from navstack.sim.body import SAMPLE_SIZE as SAMPLE_SIZE
    from navstack.sim.body import STATE as STATE
    from navstack.sim.body import Outlines as Outlines
    from navstack.sim.body import body_settings as body_settings
    from navstack.sim.body import drive as drive
    from navstack.sim.body import drive_together as drive_together
    from navstack.sim.body import wheel_drive as wheel_drive
    from navstack.sim.bumper import Bumper as Bumper
    from navstack.sim.camera import Camera as Camera
    from navstack.sim.camera import CameraImage as CameraImage
    from navstack.sim.collision import Collision as Collision
    from navstack.sim.collision import clearance as clearance
    from navstack.sim.docks import Docks as Docks
    from navstack.sim.docks import contact_error as contact_error
    from navstack.sim.docks import dock_shapes as dock_shapes
    from navstack.sim.docks import energy_of as energy_of
    from navstack.sim.estimation import Estimation as Estimation
    from navstack.sim.lidar import Lidar as Lidar
    from navstack.sim.lidar import scan_settings as scan_settings
    from navstack.sim.lidar import sweep as sweep
    from navstack.sim.lockstep import Lockstep as Lockstep
    from navstack.sim.lockstep import Nearest as Nearest
    from navstack.sim.movers import Mover as Mover
    from navstack.sim.movers import Track as Track
    from navstack.sim.movers import TrackedDiscs as TrackedDiscs
    from navstack.sim.robot import SimulatedRobot as SimulatedRobot
    from navstack.sim.shapes import LOW as LOW
    from navstack.sim.shapes import MOTIONS as MOTIONS
    from navstack.sim.shapes import DoorMotion as DoorMotion
    from navstack.sim.shapes import OnTrack as OnTrack
    from navstack.sim.shapes import PedestrianMotion as PedestrianMotion
    from navstack.sim.shapes import ReplayMotion as ReplayMotion
    from navstack.sim.shapes import Shape as Shape
    from navstack.sim.shapes import Still as Still
    from navstack.sim.shapes import low_disc as low_disc
    from navstack.sim.solids import SolidGeometry as SolidGeometry
    from navstack.sim.solids import Solids as Solids
    from navstack.sim.solids import pack_outlines as pack_outlines
    from navstack.sim.solids import place_polygons as place_polygons
    from navstack.sim.world import OCCUPIED as OCCUPIED
    from navstack.sim.world import World as World
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
