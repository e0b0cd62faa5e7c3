"""Write a run as a bag of ROS 1, read it, and replay it through costmaps, planner and controller."""

from pathlib import Path

import navstack as nav
from navstack.replay import LogReplay, ReplayReport, export_run

export_run(nav.simulate("narrow_door").record, Path("robot.bag"))
with nav.logs.open("robot.bag") as log:
    print(log.format, f"{log.duration:.1f} s,", len(log.channels), "topics")
    replay = LogReplay(log, nav.load_robot("turtlebot"), nav.load_map("office"))
    replay.run()
    commands = ReplayReport(replay).commands
    print(f"{commands.cycles} control cycles" if commands else "no commands")
