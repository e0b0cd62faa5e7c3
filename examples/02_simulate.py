"""Drive a turtlebot to two places of the packaged office, and draw the run."""

import navstack as nav

result = nav.simulate("office", robot="turtlebot", goals=["kitchen", "office_2"], seed=0)
print(result)
for goal in result.goals:
    print(f"{goal.state}: {goal.time_s:.1f} s, {goal.path_length_m:.1f} m")
result.plot("run.png")
