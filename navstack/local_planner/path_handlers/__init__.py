"""Path handlers, one file each. Importing this package registers them."""

from navstack.local_planner.path_handlers.feasible import FeasiblePathHandler

__all__ = ["FeasiblePathHandler"]
