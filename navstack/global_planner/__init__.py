"""Floor 2: global planners. Importing the room registers them."""

from navstack.global_planner.navfn import NavfnParams, NavfnROS

__all__ = ["NavfnParams", "NavfnROS"]
