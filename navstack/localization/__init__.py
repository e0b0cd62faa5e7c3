"""Localization: where the robot is in the map, from its odometry and its scans."""

from navstack.localization.amcl import Amcl
from navstack.localization.dead_reckoning import DeadReckoning
from navstack.localization.distance_field import distance_field
from navstack.localization.scan_matcher import ScanMatcher

__all__ = ["Amcl", "DeadReckoning", "ScanMatcher", "distance_field"]
