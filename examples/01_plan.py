"""Plan on an array, and on a packaged map between named places."""

import numpy as np

import navstack as nav

walls = np.zeros((60, 80), bool)  # (ny, nx), row 0 has the smallest y
walls[20:, 40] = True
path = nav.plan(walls, 0.05, (0.5, 2.0), (3.5, 2.0), planner="astar", robot_radius=0.15).path
print(f"around the wall: {path.length:.2f} m")

plan = nav.plan("office", "corridor_west", "kitchen", robot="turtlebot", planner="theta_star")
print(f"through the office: {plan.path.length:.2f} m, {len(plan.path)} poses")
plan.plot("plan.png")
