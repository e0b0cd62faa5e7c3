"""A synthetic run with all data that a record can contain: two rooms, a corridor, three goals, a box that is not on the map."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from navstack.core import (
    Costmap,
    Event,
    Footprint,
    GridGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
    Window,
)
from navstack.plugins import LocalPlan
from navstack.record import RunRecorder

GOALS = ((8.2, 1.8, 0.0), (11.0, 6.6, math.pi / 2), (2.2, 6.4, math.pi))
CORNERS = np.array(
    [
        [1.6, 1.8],
        [4.4, 1.6],
        [6.0, 2.4],
        [8.2, 1.8],
        [10.8, 2.2],
        [11.4, 4.4],
        [11.0, 6.6],
        [8.0, 5.2],
        [6.2, 4.6],
        [4.6, 5.6],
        [2.2, 6.4],
    ]
)
OBSTACLE = (7.1, 4.1, 0.3)
CRITICS = ("oscillation", "obstacle", "goal_front", "alignment", "path", "goal", "twirling")
MAP_TO_ODOM = Transform2D(0.4, -0.25, 0.12)
INFLATION_M = 0.5


def office() -> OccupancyGrid:
    """13 x 8.5 m at 0.05 m: outer walls, a wall with two doors, a table, unknown space outside."""
    geometry = GridGeometry(280, 190, 0.05, -0.5, -0.5)
    cells = np.full(geometry.shape, -1, np.int8)

    def box(x0: float, y0: float, x1: float, y1: float, value: int) -> None:
        window = [round((v + 0.5) / 0.05) for v in (x0, y0, x1, y1)]
        cells[window[1] : window[3], window[0] : window[2]] = value

    box(0.0, 0.0, 13.0, 8.5, 100)
    box(0.15, 0.15, 12.85, 8.35, 0)
    for x0, y0, x1, y1 in (
        (0.0, 4.0, 5.4, 4.15),
        (7.9, 4.0, 10.2, 4.15),
        (12.3, 4.0, 13.0, 4.15),
        (6.6, 0.0, 6.75, 1.2),
    ):
        box(x0, y0, x1, y1, 100)
    box(3.0, 2.6, 4.2, 3.2, 100)
    box(8.6, 6.2, 9.6, 7.0, 100)
    return OccupancyGrid(cells, geometry)


def inflated(grid: OccupancyGrid, radius: float = 0.18) -> NDArray[np.uint8]:
    """Costs of the whole map, by an exact distance transform."""
    lethal = grid.data == 100
    distance = ndimage.distance_transform_edt(~lethal) * grid.geometry.resolution
    costs = np.where(distance <= INFLATION_M, 252 * np.exp(-5.0 * (distance - radius)), 0.0).astype(np.uint8)
    costs[distance <= radius] = 253
    costs[grid.data == -1] = 255
    costs[lethal] = 254
    return costs


def with_disc(grid: OccupancyGrid, x: float, y: float, r: float) -> OccupancyGrid:
    """The map with a disc drawn into it."""
    g = grid.geometry
    iy, ix = np.indices(g.shape)
    inside = np.hypot(g.origin_x + (ix + 0.5) * g.resolution - x, g.origin_y + (iy + 0.5) * g.resolution - y) <= r
    return OccupancyGrid(np.where(inside, 100, grid.data).astype(np.int8), g)


def curve(n: int) -> NDArray[np.float64]:
    """(n, 3) poses along a smooth curve through the corners, evenly spaced."""
    from scipy.interpolate import CubicSpline

    u = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(CORNERS, axis=0).T))))
    spline = CubicSpline(u, CORNERS)
    fine = np.linspace(0.0, u[-1], 4000)
    points = spline(fine)
    length = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    at = np.interp(np.linspace(0.0, length[-1], n), length, fine)
    points, slope = spline(at), spline(at, 1)
    return np.column_stack((points, np.arctan2(slope[:, 1], slope[:, 0])))


def local_plan(rng: np.random.Generator, pose: Pose2D, t: int, critics: tuple[str, ...] = CRITICS) -> LocalPlan:
    """A table of samples shaped as DWA's."""
    k, best = 126, int(rng.integers(0, 126))
    samples = np.array([(v, 0.0, w) for v in np.linspace(0.1, 0.5, 6) for w in np.linspace(-1.0, 1.0, 21)])
    costs = np.column_stack([np.zeros(k), *rng.integers(0, 120, (5, k)).astype(float), np.abs(samples[:, 2])])
    scales = np.array([1.0, 0.5, 1.2, 3.2, 3.2, 1.2, 0.0])
    rejected = np.where(rng.random(k) < 0.3, 1, -1).astype(np.int8)
    rejected[best] = -1
    totals = np.where(rejected == -1, costs @ scales, -1.0)
    bend = 0.4 * math.sin(t / 9.0)
    step = np.linspace(0.0, 1.0, 17)
    heading = pose.yaw + bend * step
    trajectory = np.column_stack(
        (pose.x + 0.6 * step * np.cos(heading), pose.y + 0.6 * step * np.sin(heading), heading)
    )
    return LocalPlan(
        Twist2D(float(samples[best, 0]), 0.0, float(samples[best, 2])),
        "follow",
        samples,
        critics,
        costs[:, : len(critics)],
        scales[: len(critics)],
        totals,
        rejected,
        best,
        trajectory,
        notes=("slowed down",) if t == 7 else (),
    )


def record_run(seconds: float = 72.0, *, scans: bool = False, seed: int = 1, spool: Path | None = None) -> RunRecorder:
    """The whole run, at 5 Hz, with a replan every second."""
    rng = np.random.default_rng(seed)
    grid = office()
    real = with_disc(grid, *OBSTACLE)
    free_costs, real_costs = inflated(grid), inflated(real)
    recorder = RunRecorder(
        map=grid,
        footprint=Footprint.from_radius(0.18),
        scenario={
            "map": "office",
            "start": [*CORNERS[0], 0.0],
            "goals": [list(goal) for goal in GOALS],
            "seed": seed,
            "distro": "noetic",
            "obstacles": [list(OBSTACLE)],
        },
        global_frame="map",
        local_frame="odom",
        base_frame="base_footprint",
        spool=spool,
    )
    n = max(int(seconds * 5), 1)
    path = curve(n)
    to_odom = MAP_TO_ODOM.inverse()
    ends = [int(n * share) for share in (0.34, 0.64, 1.0)]
    seen = False
    goal = -1
    g = grid.geometry
    master = Costmap(g, free_costs.copy())
    for i in range(n):
        t = round(i * 0.2, 6)
        pose = Pose2D(*(float(v) for v in path[i]))
        odom = to_odom.apply(pose)
        if goal < 0 or (goal < 2 and i > ends[goal]):
            goal += 1
            recorder.goal(t, Pose2D(*GOALS[goal]))
            recorder.on_event(Event(t, "goal", f"goal {goal + 1} accepted", {"goal": list(GOALS[goal])}))
        if not seen and pose.distance_to(Pose2D(*OBSTACLE[:2])) < 2.5:
            seen = True
            master.data[:] = real_costs
        if i % 5 == 0:
            ix, iy = g.world_to_cell(pose.x, pose.y) or (0, 0)
            window = Window(max(ix - 60, 0), max(iy - 60, 0), min(ix + 61, g.nx), min(iy + 61, g.ny)) if i else None
            recorder.costmap(t, "global", master, window)
            poses = path[i : ends[goal] + 1].copy()
            along = np.linspace(0.0, 1.0, len(poses))[:, None]
            poses[:, :2] += 4.0 * along * (1.0 - along) * rng.normal(0.0, 0.12, 2)
            recorder.plan(t, poses, "map")
            recorder.on_event(Event(t, "plan", f"plan of {len(poses)} poses", {"poses": len(poses)}))
        ox, oy = (math.floor((c - 2.0) / 0.05) * 0.05 for c in (odom.x, odom.y))
        local = GridGeometry(80, 80, 0.05, ox, oy)
        recorder.costmap(t, "local", Costmap(local, _looked_up(local, real, real_costs), "odom"), None)
        chosen = local_plan(rng, odom, i)
        recorder.local_plan(t, chosen)
        if i == int(n * 0.55):
            recorder.on_event(Event(t, "recovery", "rotate_recovery: turned by 360 degrees", {"behavior": "rotate"}))
        if scans and i % 5 == 0:
            ranges = np.full(90, 3.0, np.float32)
            ranges[::7] = np.inf
            recorder.scan(t, LaserScan(ranges, -0.5, 0.01, 0.45, 6.0, t), pose)
        recorder.sample(
            t,
            pose=pose,
            odom=RobotState(odom, chosen.command, t),
            map_to_odom=MAP_TO_ODOM,
            command=chosen.command,
            state="CONTROLLING" if i % 40 else "PLANNING",
            goal_index=goal,
        )
    recorder.collision(round(n * 0.2 * 0.8, 6), Pose2D(*(float(v) for v in path[int(n * 0.8)])))
    recorder.finish([{"goal": list(g), "state": "SUCCEEDED", "text": "Goal reached.", "time_s": 20.0} for g in GOALS])
    return recorder


def _looked_up(local: GridGeometry, grid: OccupancyGrid, costs: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The costs of the world around the robot, in the turned odometry frame."""
    iy, ix = np.indices(local.shape)
    points = np.column_stack(
        (
            local.origin_x + (ix.ravel() + 0.5) * local.resolution,
            local.origin_y + (iy.ravel() + 0.5) * local.resolution,
        )
    )
    world = MAP_TO_ODOM.apply_points(points)
    g = grid.geometry
    cx = np.clip(((world[:, 0] - g.origin_x) / g.resolution).astype(int), 0, g.nx - 1)
    cy = np.clip(((world[:, 1] - g.origin_y) / g.resolution).astype(int), 0, g.ny - 1)
    out = costs[cy, cx].reshape(local.shape)
    return np.where(out == 255, 0, out).astype(np.uint8)
