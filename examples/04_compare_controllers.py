"""Drive the same goals with two controllers, and with changed parameters."""

import navstack as nav

slow = nav.load_robot("turtlebot", DWAPlannerROS={"max_vel_x": 0.3})
robots = {"DWA": "turtlebot", "DWA, 0.3 m/s": slow, "pure pursuit": "turtlebot_rpp"}
for name, robot in robots.items():
    result = nav.simulate("office", robot=robot, goals=["kitchen"])
    print(f"{name:14} {result}; clearance {result.min_clearance_m:.2f} m")
