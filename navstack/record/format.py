"""The file of a run, `run.npz`, version 1.

A zip archive of `.npy` arrays and two JSON texts. numpy opens it without navstack (with `allow_pickle=False`):

    run = numpy.load("run.npz")
    table = pandas.DataFrame(run["samples"])                 # any table below, with its column names
    events = pandas.read_json(io.BytesIO(run["events.jsonl"]), lines=True)
    meta = json.loads(run["meta.json"])

Meters, radians counter-clockwise, seconds of the run's clock. There is no wall clock in the file: the same run gives the
same file byte for byte. "map" below is the global frame, "odom" the local frame, "base" the robot's frame (their names:
`meta["frames"]`). Rows are ordered by time. Little endian.

`meta.json`, one object:

    format            "navstack-run"
    version           1
    frames            {"global", "local", "base"}: names
    map               null or {"resolution" m, "origin_x" m, "origin_y" m, "origin_yaw" rad, "frame"}, see array `map`
    footprint         [[x, y], ..] m: the unpadded footprint, in base
    scenario          the scenario of the run, as passed to the recorder
    results           one object per goal, as passed to the recorder
    critics           names of the columns of `local_plan_costs`
    local_plan_notes  {row of `local_plans`: [sentences]}
    costmaps          {name: frame}
    scan_sources      [[topic, frame], ..], see column `source` of `scans`
    sensors           {frame of a lidar: [x, y, yaw] in base}; absent in records of 0.1.0

    steering          {"kinematics", "wheelbase" m, "max_angle" rad, "max_rate" rad/s or null}; absent for a base that is not
                      steered
    zones             [{"name", "action", "corners" [[x, y], ..] m, base}, ..]: of the collision monitor; absent without one

`events.jsonl`, one object per line: `{"time" s, "kind", "text", "data"}` as in `navstack.core.Event`; events of kind
"feedback" are omitted, because `samples` contains the same data.

Tables (structured arrays, one row per ..):

    samples       control cycle    t f8 s
                                   x, y, yaw f8             pose, map
                                   odom_x, odom_y, odom_yaw f8  odometry's pose, odom
                                   vx, vy, wz f8            odometry's velocity, base, m/s and rad/s
                                   map_to_odom_x, .._y, .._yaw f8  pose of odom in map
                                   cmd_vx, cmd_vy, cmd_wz f8  velocity commanded, base
                                   goal i4                  row of `goals`, -1 none
                                   state U                  state of the goal manager
    goals         goal accepted    t f8; x, y, yaw f8, map
    plans         global plan      t f8; first i8, count i8: rows of `plan_poses`; goal i4: row of `goals`; frame U
    local_plans   local plan       t f8; mode U; vx, vy, wz f8: the command, base;
                                   best i4: row of the selected sample among the cycle's samples, -1 none;
                                   first i8, count i8: rows of `local_plan_samples`, `.._costs`, `.._totals`,
                                   `.._rejected_by` (count is 0 if the table was not recorded);
                                   tried i4, rejected i4: number of samples, and of those rejected by a critic or a limit;
                                   first_pose i8, poses i8: rows of `local_plan_poses`
    collisions    collision        t f8; x, y, yaw f8, map
    scans         scan of a lidar  t f8; x, y, yaw f8: the robot, map; angle_min, angle_increment f8 rad;
                                   range_min, range_max, height f8 m; source i4; first i8, count i8: rows of `scan_ranges`
    commands      command that     t f8; requested_vx, .._vy, .._wz, smoothed_.., sent_.. f8: as its source gave it, after the
                  passed a chain   velocity smoother, as the robot got it, base, m/s and rad/s; source U; changed_by U:
                                   velocity_smoother, collision_monitor or empty; action, zone U: of the collision monitor;
                                   reason U. Absent without a chain; `cmd_..` of `samples` is what was requested
    estimates     estimate of the  t f8: stamp of the scan; x, y, yaw f8: the believed pose, map; xx, xy, xyaw, yy,
                  localizer        yyaw, yawyaw f8: its covariance, m and rad; count i4: particles or hypotheses;
                                   lost i4: 1 if the robot knew that it was lost; explained f8: share of the scan
                                   that the pose explains, or NaN; first i8, drawn i4: rows of `particles`.
                                   Absent without a localizer
    costmaps/<n>  update of the    t f8; nx, ny i4; resolution, origin_x, origin_y f8: the grid at that time;
                  costmap <n>      x0, y0, x1, y1 i4: the window of changed cells (half open; empty: no change);
                                   first i8: index of its first cell in `costmaps/<n>_cells`, row-major.
                                   A window of the whole grid replaces the state, others update it.

Plain arrays:

    map                      (ny, nx) i1    100 occupied, 0 free, -1 unknown, [iy, ix]; absent without a map
    clearances               (n,) f8 m      a row per row of `samples`: distance from the unpadded footprint to the nearest
                                            obstacle, inf without obstacles; absent if unknown (a real robot)
    steering                 (n,) f8 rad    a row per row of `samples`: steering angle; absent for a base that is not steered
    solid_discs              (r, k, 3) f4   x, y, radius, map: obstacles that are not on the map. r is 1 if none of them moves;
    solid_corners            (r, m, 2) f4   else there is a row per row of `samples`. Corners x, y of p polygons; those of
    solid_first              (p + 1,) i8    polygon i start at solid_first[i]. All absent if there are no obstacles besides
                                            the map and the scenario's `obstacles`. NaN while an obstacle is absent
    people                   (n, p, 2) f8   x, y, map: the centers of p people, a row per row of `samples`; NaN while one is
                                            absent
    persons                  (p,) table     radius f8 m; group i4: number of the group, -1 none; first_arrival f8 s: at a goal,
                                            inf none; delay_s f8 s, delay_m f8 m: how much longer the person took to its last
                                            goal than in the same run without the robot, NaN if unknown. Both arrays are
                                            absent without people
    plan_poses               (n, 3) f8      x, y, yaw in the plan's frame
    local_plan_samples       (n, 3) f4      velocities vx, vy, wz, m/s and rad/s
    local_plan_costs         (n, c) f4      raw cost per critic, NaN if it was not computed
    local_plan_totals        (n,) f4        weighted sum, or the negative rejection code, NaN if not scored
    local_plan_rejected_by   (n,) i1        column of the critic that rejected it, -1 valid, -2 no trajectory
    local_plan_scales        (m, c) f4      weights of the critics, a row per row of `local_plans`
    local_plan_poses         (n, 3) f4      the selected trajectory, in the local costmap's frame
    scan_ranges              (n,) f4 m      to the millimeter; inf without a hit, NaN invalid
    costmaps/<n>_cells       (n,) u1        costs
    particles                (n, 4) f4      x, y, yaw, map, and weight: at most 200 possible poses of an estimate; absent without
                                            a localizer
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

FORMAT: Final = "navstack-run"
VERSION: Final = 1
RUN_FILE: Final = "run.npz"
LOG_FILE: Final = "run.log"
META: Final = "meta.json"
EVENTS: Final = "events.jsonl"

_POSE = [("x", "<f8"), ("y", "<f8"), ("yaw", "<f8")]

SAMPLE_COLUMNS: Final = (
    *("t", "x", "y", "yaw", "odom_x", "odom_y", "odom_yaw", "vx", "vy", "wz"),
    *("map_to_odom_x", "map_to_odom_y", "map_to_odom_yaw", "cmd_vx", "cmd_vy", "cmd_wz"),
)

TABLES: Final[dict[str, list[tuple[str, str]]]] = {
    "samples": [*((name, "<f8") for name in SAMPLE_COLUMNS), ("goal", "<i4"), ("state", "<U")],
    "goals": [("t", "<f8"), *_POSE],
    "plans": [("t", "<f8"), ("first", "<i8"), ("count", "<i8"), ("goal", "<i4"), ("frame", "<U")],
    "local_plans": [
        *[("t", "<f8"), ("mode", "<U"), ("vx", "<f8"), ("vy", "<f8"), ("wz", "<f8"), ("best", "<i4")],
        *[("first", "<i8"), ("count", "<i8"), ("tried", "<i4"), ("rejected", "<i4")],
        *[("first_pose", "<i8"), ("poses", "<i8")],
    ],
    "collisions": [("t", "<f8"), *_POSE],
    "scans": [
        *[("t", "<f8"), *_POSE, ("angle_min", "<f8"), ("angle_increment", "<f8"), ("range_min", "<f8")],
        *[("range_max", "<f8"), ("height", "<f8"), ("source", "<i4"), ("first", "<i8"), ("count", "<i8")],
    ],
}
"""Column names and types of the tables; `<U` is text of the maximum length that occurs."""

COSTMAP_TABLE: Final[list[tuple[str, str]]] = [
    *[("t", "<f8"), ("nx", "<i4"), ("ny", "<i4"), ("resolution", "<f8"), ("origin_x", "<f8"), ("origin_y", "<f8")],
    *[("x0", "<i4"), ("y0", "<i4"), ("x1", "<i4"), ("y1", "<i4"), ("first", "<i8")],
]

ARRAYS: Final[dict[str, tuple[str, int]]] = {
    "plan_poses": ("<f8", 2),
    "local_plan_samples": ("<f4", 2),
    "local_plan_costs": ("<f4", 2),
    "local_plan_totals": ("<f4", 1),
    "local_plan_rejected_by": ("|i1", 1),
    "local_plan_scales": ("<f4", 2),
    "local_plan_poses": ("<f4", 2),
    "scan_ranges": ("<f4", 1),
}
"""dtype and number of dimensions of the plain arrays of every record."""


def table(columns: list[tuple[str, str]], data: dict[str, Any], rows: int) -> NDArray[np.void]:
    """Returns a structured array of `rows` rows; `data` has the columns by name. Text columns get the width they need."""
    dtype: list[tuple[str, str]] = []
    for name, kind in columns:
        dtype.append((name, f"<U{max((len(s) for s in data[name]), default=0) or 1}" if kind == "<U" else kind))
    out = np.zeros(rows, dtype)
    if rows:
        for name, _ in columns:
            out[name] = data[name]
    return out
