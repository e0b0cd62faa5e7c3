"""CARMEN logs written for tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from navstack.core import OccupancyGrid, Transform2D
from tests.localization.rooms import scan_from


def half_scan(grid: OccupancyGrid, pose: Transform2D) -> list[float]:
    """180 ranges by 1 degree from -90 degrees on; 81.91 without a return."""
    scan = scan_from(grid, pose, reach=20.0)
    angles = np.degrees(scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges)))
    # the scan has a beam every 3 degrees: the nearest one serves
    found = [float(scan.ranges[int(np.argmin(np.abs(angles - a)))]) for a in range(-90, 90)]
    return [r if np.isfinite(r) else 81.91 for r in found]


def write_corrected_log(path: Path, grid: OccupancyGrid, truths: list[Transform2D], *, drift: float = 0.02) -> Path:
    """A corrected log: after each scan, the odometry is rebased to the corrected pose by a line of time 0."""
    lines = ["# message formats defined: PARAM SYNC ODOM FLASER", "PARAM robot_frontlaser_offset 0.0 nohost 0"]
    base, t = truths[0], 10.0
    lines.append(f"ODOM {base.x:.6f} {base.y:.6f} {base.yaw:.6f} 0 0 0 {t} nohost {t}")
    for before, truth in zip([truths[0], *truths], truths, strict=False):
        step = before.inverse() @ truth
        half = Transform2D(step.x / 2.0, step.y / 2.0, step.yaw / 2.0)
        for part in (half, half.inverse() @ Transform2D(step.x, step.y, step.yaw + drift)):
            base = base @ part
            t += 0.5
            lines.append(f"ODOM {base.x:.6f} {base.y:.6f} {base.yaw:.6f} 0 0 0 {t} nohost {t}")
        pose = f"{truth.x:.6f} {truth.y:.6f} {truth.yaw:.6f}"
        ranges = " ".join(f"{r:.3f}" for r in half_scan(grid, truth))
        lines.append(f"FLASER 180 {ranges} {pose} {pose} {t} nohost {t}")
        lines.append(f"ODOM {pose} 0 0 0 0 nohost 0")
        base = truth
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def circle(start: Transform2D, count: int) -> list[Transform2D]:
    """Poses on a circle of 1 m, half a meter apart."""
    poses = [start]
    while len(poses) < count:
        poses.append(poses[-1] @ Transform2D(0.48, 0.12, 0.5))
    return poses
