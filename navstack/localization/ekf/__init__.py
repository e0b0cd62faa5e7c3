"""Odometry filters."""

from navstack.localization.ekf.pose_ekf import PoseStep, RobotPoseEkf

__all__ = ["PoseStep", "RobotPoseEkf"]
