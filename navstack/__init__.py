"""navstack: move_base without ROS."""

__version__ = "0.1.0"
