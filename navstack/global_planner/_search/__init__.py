"""Shared parts of the planners: a planner is a cost interpreter, an expansion and a traceback in the frame of `base`."""
