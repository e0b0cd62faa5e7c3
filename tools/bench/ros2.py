"""Times of the ROS 2 nodes: control period, scan to command, processor share; in real time, and an hour of simulated time.

    python tools/bench/ros2.py                     # both parts, 1 minute and 10 minutes of simulated time
    python tools/bench/ros2.py --hours 1           # an hour of simulated time at ten times real time

The graph is real (rclpy of Kilted, `tools/install_ros2.sh`): `navstack ros2 sim`, `navstack ros2 navigator`; the drive and
the figures are those of `tools/bench/ros1.py`.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.ros2.rig import Rig2  # noqa: E402
from tools.bench.ros1 import PARAMS, measure  # noqa: E402


def run(title: str, seconds: float, speed: float) -> None:
    """Start a graph, and measure."""
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig2(Path(folder))
        try:
            rig.start_sim("office", "--speed", f"{speed:g}", relayed=False)
            rig.start_probe("--results")
            rig.start_node(*PARAMS)
            measure(title, rig, seconds)
        finally:
            rig.close()
            rig.ros2.close()


def main() -> int:
    """Run the chosen parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=1.0 / 6.0, help="simulated hours at --speed; 0: not")
    parser.add_argument("--seconds", type=float, default=60.0, help="of driving in real time; 0: not")
    parser.add_argument("--speed", type=float, default=10.0)
    chosen = parser.parse_args()
    # the programs of the graph must end with this one
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
    if chosen.seconds > 0.0:
        run("real time", chosen.seconds, 1.0)
    if chosen.hours > 0.0:
        run("simulated time", 3600.0 * chosen.hours, chosen.speed)
    return 0


if __name__ == "__main__":
    sys.exit(main())
