"""Why did the goal fail? A long robot with navfn and DWA at a door; then the robot that gets through."""

import navstack as nav

for scenario in ("long_robot_navfn", "long_robot"):
    result = nav.simulate(scenario)
    print(f"{scenario}: {result}")
    print(result.explain(goal=1))
