"""Motions: move, turn, drive to a pose, follow a path or a timed trajectory."""

from navstack.motion.drive_to_pose import DriveToPose
from navstack.motion.errors import (
    InfeasibleTrajectoryError,
    InvalidMotionError,
    InvalidTrajectoryError,
    MotionCollisionError,
    MotionTimeoutError,
    TrackingLostError,
)
from navstack.motion.feasibility import Demands, Violation, demands_of, require_feasible, slowest_factor, violations
from navstack.motion.follow import FollowPath, FollowTrajectory
from navstack.motion.move import Move
from navstack.motion.shapes import figure_eight, heart, poly_path
from navstack.motion.timing import MotionLimits, from_path, with_rest
from navstack.motion.trajectory import Reference, Trajectory
from navstack.motion.trajectory_files import load_trajectory, save_trajectory
from navstack.motion.turn import Turn
from navstack.motion.wait import Wait

__all__ = [
    "Demands",
    "DriveToPose",
    "FollowPath",
    "FollowTrajectory",
    "InfeasibleTrajectoryError",
    "InvalidMotionError",
    "InvalidTrajectoryError",
    "MotionCollisionError",
    "MotionLimits",
    "MotionTimeoutError",
    "Move",
    "Reference",
    "TrackingLostError",
    "Trajectory",
    "Turn",
    "Violation",
    "Wait",
    "demands_of",
    "figure_eight",
    "from_path",
    "heart",
    "load_trajectory",
    "poly_path",
    "require_feasible",
    "save_trajectory",
    "slowest_factor",
    "violations",
    "with_rest",
]
