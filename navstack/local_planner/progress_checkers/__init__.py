"""Progress checkers, one file each. Importing this package registers them."""

from navstack.local_planner.progress_checkers.pose import PoseProgressChecker
from navstack.local_planner.progress_checkers.simple import SimpleProgressChecker

__all__ = ["PoseProgressChecker", "SimpleProgressChecker"]
