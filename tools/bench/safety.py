"""Time of one check of the collision monitor, next to the times that Nav2 publishes: `python tools/bench/safety.py`.

Nav2's are those of the README of nav2_collision_monitor, on a machine that it does not name; so a ratio says little more than
its order of magnitude. A check includes the message: points of the scan or cloud, their transform, and the decision.
"""

from __future__ import annotations

import time

import numpy as np

from navstack.core import Footprint, FrameTree, LaserScan, PointCloud, SensorData, Transform2D, Twist2D
from navstack.parameters import CollisionMonitorParams, MonitorSourceParams, ZoneParams
from navstack.safety import CollisionMonitor
from navstack.studies.speed import calibration_ms

NAV2_MS = {
    ("scan 360", "stop polygon"): 4.45,
    ("scan 360", "stop circle"): 4.45,
    ("scan 360", "approach polygon"): 4.93,
    ("scan 360", "approach circle"): 4.86,
    ("cloud 24,000", "stop polygon"): 4.94,
    ("cloud 24,000", "stop circle"): 4.06,
    ("cloud 24,000", "approach polygon"): 20.67,
    ("cloud 24,000", "approach circle"): 10.87,
}
FOOTPRINT = Footprint(np.array([[0.35, 0.25], [-0.35, 0.25], [-0.35, -0.25], [0.35, -0.25]]))
ROUNDS = 300
POLYGON = str((1.4 * FOOTPRINT.vertices).tolist())


def zones() -> dict[str, ZoneParams]:
    """The zone of each row."""
    return {
        "stop polygon": ZoneParams(action_type="stop", points=POLYGON),
        "stop circle": ZoneParams(type="circle", action_type="stop", radius=0.6),
        "approach polygon": ZoneParams(action_type="approach", points=str(FOOTPRINT.vertices.tolist())),
        "approach circle": ZoneParams(type="circle", action_type="approach", radius=0.45),
    }


def data(kind: str, stamp: float) -> SensorData:
    """A scan or a cloud of points 0.6 to 4 m away, all around."""
    rng = np.random.default_rng(1)
    if kind.startswith("scan"):
        ranges = rng.uniform(0.6, 4.0, 360).astype(np.float32)
        return LaserScan(ranges, -np.pi, 2.0 * np.pi / 360, 0.05, 12.0, stamp, "laser", "data")
    r, angle = rng.uniform(0.6, 4.0, 24_000), rng.uniform(-np.pi, np.pi, 24_000)
    points = np.column_stack((r * np.cos(angle), r * np.sin(angle), rng.uniform(0.05, 0.5, 24_000)))
    return PointCloud(points.astype(np.float32), stamp, "laser", "data")


def check_ms(kind: str, zone: ZoneParams, decel: list[float] | None) -> float:
    """Shortest time of a check (ms)."""
    source = MonitorSourceParams(type="scan" if kind.startswith("scan") else "pointcloud", topic="data")
    params = CollisionMonitorParams(
        polygons=["zone"], observation_sources=["data"], blocks={"zone": zone, "data": source}, max_decel=decel
    )
    frames = FrameTree()
    frames.set_static("base", "laser", Transform2D(0.1, 0.0, 0.0))
    monitor = CollisionMonitor(params, frames=frames, base_frame="base", footprint=FOOTPRINT)
    best = np.inf
    for k in range(ROUNDS):
        now = 0.05 * k
        frames.set("odom", "base", Transform2D(0.01 * k, 0.0, 0.001 * k), now)
        message = data(kind, now)
        begin = time.perf_counter()
        monitor.observe(message)
        monitor.process(Twist2D(0.5, 0.0, 0.3), now, Twist2D(0.45, 0.0, 0.2))
        best = min(best, time.perf_counter() - begin)
    return 1e3 * best


def main() -> None:
    """Print a table."""
    print(f"calibration {calibration_ms():.1f} ms")
    print(f"{'points':14} {'zone':18} {'navstack ms':>12} {'with braking':>13} {'Nav2 ms':>8} {'ratio':>6}")
    for (kind, name), nav2 in NAV2_MS.items():
        zone = zones()[name]
        plain, braking = check_ms(kind, zone, None), check_ms(kind, zone, [-1.0, -1.0, -2.0])
        print(f"{kind:14} {name:18} {plain:12.3f} {braking:13.3f} {nav2:8.2f} {nav2 / max(plain, braking):6.0f}")


if __name__ == "__main__":
    main()
