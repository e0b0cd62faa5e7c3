"""RViz, unchanged: it shows the robot, and a 2D Nav Goal that is dragged with the mouse arrives."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.ros1.conftest import PATIENT, Graph, paced, wait_for
from tests.ros1.rig import Rig
from tests.ros1.test_exported_bag import framebuffer

CONFIG = Path(__file__).parent / "navigation.rviz"
COLORS = {"scan": (255, 0, 0), "plan": (0, 255, 0), "footprint": (0, 0, 255)}
AHEAD = 240
"""Distance of the goal from the robot (pixels): 3 m."""


def has(picture: NDArray[np.uint8], name: str) -> NDArray[np.bool_]:
    return np.abs(picture.astype(int) - COLORS[name]).max(axis=2) < 60


def test_a_goal_that_is_dragged_in_rviz_is_reached(graph: Graph, tmp_path: Path) -> None:
    rig = Rig(graph)
    try:
        rig.start_sim("office", "--clock", "--speed", paced(2), relayed=False)
        rig.start_probe("--results")
        display = f":{100 + graph.port % 500}"
        graph.start("Xvfb", display, "-screen", "0", "1000x700x24", "-fbdir", str(tmp_path))
        screen = tmp_path / "Xvfb_screen0"
        wait_for(screen.exists, "the start of the virtual display")
        graph.start("rviz", "-d", str(CONFIG), DISPLAY=display)
        rig.start_node("--params", "turtlebot", *PATIENT)
        wait_for(lambda: has(framebuffer(screen), "footprint").sum() > 20, "the footprint in RViz")
        rows, columns = np.nonzero(has(framebuffer(screen), "footprint"))
        x, y = int(columns.mean()) + AHEAD, int(rows.mean())
        graph.environment["DISPLAY"] = display
        graph.run("/usr/bin/xdotool", "mousemove", str(x), str(y), "mousedown", "1")
        graph.run("/usr/bin/xdotool", "mousemove", "--sync", str(x + 40), str(y))
        graph.run("/usr/bin/xdotool", "mousemove", "--sync", str(x + 80), str(y), "mouseup", "1")

        def shows_all() -> bool:
            picture = framebuffer(screen)
            return all(has(picture, name).sum() > 20 for name in COLORS)

        wait_for(shows_all, f"a picture with {', '.join(COLORS)}")
        if "NAVSTACK_PICTURES" in os.environ:
            np.save(Path(os.environ["NAVSTACK_PICTURES"]) / "rviz.npy", framebuffer(screen))
        found = rig.wait(lambda e: e["what"] == "result", "the end of the goal")
        assert (found["status"], found["text"]) == (3, "Goal reached.")
    finally:
        rig.close()
