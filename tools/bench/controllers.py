"""Tours by each controller with its packaged tuning: the office's three goals, all its places, and Willow Garage's three goals.

    python tools/bench/controllers.py [CONTROLLER..]

Prints, for each tour and controller, the goals reached, the time of each goal, contacts and the smallest clearance.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from navstack.core import Pose2D
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.scenario import Scenario, load_places, run_scenario
from navstack.studies.controllers import CONTROLLERS

DATA = Path(os.environ.get("NAVSTACK_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data")
WILLOW = DATA / "maps" / "turtlebot_apps__willow-2010-02-18-0.10" / "willow-2010-02-18-0.10.yaml"
WILLOW_START = Pose2D(29.75, 7.95, 0.0)
WILLOW_GOALS = (Pose2D(27.35, 10.55, 1.57), Pose2D(34.45, 15.25, 0.0), Pose2D(26.25, 3.45, 3.14))


def tours() -> dict[str, tuple[Path, Pose2D, tuple[Pose2D, ...]]]:
    """Map, start and goals of each tour; Willow's only where its map is."""
    office = load_places("office")
    start = office.places["corridor_west"]
    found = {
        "office, 3 goals": (
            map_path("office"),
            start,
            tuple(office.places[name] for name in ("office_2", "meeting_room", "kitchen")),
        ),
        "office, all places": (map_path("office"), start, tuple(office.places.values())),
    }
    if WILLOW.is_file():
        found["Willow, 3 goals"] = (WILLOW, WILLOW_START, WILLOW_GOALS)
    return found


def main() -> None:
    """Drive and print."""
    names = sys.argv[1:] or list(CONTROLLERS)
    for tour, (map_file, start, goals) in tours().items():
        for name in names:
            configuration = load_configuration(list(CONTROLLERS[name].with_map.params))
            result = run_scenario(Scenario(load_map(map_file), configuration, start, goals), record=False)
            reached = sum(goal.succeeded for goal in result.goals)
            times = ", ".join(f"{goal.time_s:.1f}" for goal in result.goals) if len(goals) < 5 else ""
            print(
                f"{tour:20} {name:18} {reached} of {len(goals)} reached, {result.metrics.time_s:6.1f} s "
                f"{f'({times})':22}, {result.collisions} contacts, clearance {result.min_clearance_m:.3f} m",
                flush=True,
            )


if __name__ == "__main__":
    main()
