"""Localization: where the robot is in the map, from its odometry and its scans."""
