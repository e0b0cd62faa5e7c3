"""Localization: where the robot is in the map, from its odometry and its scans."""

from navstack.localization.amcl import Amcl
from navstack.localization.distance_field import distance_field

__all__ = ["Amcl", "distance_field"]
