"""Odometry filters."""

from navstack.localization.ekf.ekf import Ekf, Innovation
from navstack.localization.ekf.pose_ekf import PoseStep, RobotPoseEkf

__all__ = ["Ekf", "Innovation", "PoseStep", "RobotPoseEkf"]
