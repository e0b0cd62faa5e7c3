"""Kinematics of wheeled bases: velocity of the base <-> velocities of the wheels, and odometry from wheels and encoders."""

from navstack.kinematics.ackermann import AckermannDrive
from navstack.kinematics.drives import DifferentialDrive, MecanumDrive, OmniDrive, WheelDrive
from navstack.kinematics.odometry import METHODS, Method, WheelOdometry, integrate

__all__ = [
    "METHODS",
    "AckermannDrive",
    "DifferentialDrive",
    "MecanumDrive",
    "Method",
    "OmniDrive",
    "WheelDrive",
    "WheelOdometry",
    "integrate",
]
