"""What one page sees of a session: `frame` returns what has changed since the last call."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.behavior_trees import Action, BehaviorTree, Condition, Decorator, Node, Status
from navstack.core import Costmap, GridGeometry, LaserScan, NavError, Pose2D, Transform2D, Window
from navstack.costmap import LayeredCostmap
from navstack.live.graph import route_now
from navstack.live.messages import Frame
from navstack.live.session import Session
from navstack.move_base import TreeMoveBase, plugin_calls
from navstack.plugins import LocalPlanner
from navstack.record import SteeredBase, copy_changed_window
from navstack.sim import PedestrianMotion, Shape, SimulatedRobot

# ----------------------------------------------------------------------------------------------------------------------
# The part of a costmap that has changed since a page saw it last.


class GridView:
    """A costmap as one page knows it."""

    def __init__(self) -> None:
        self._geometry: GridGeometry | None = None
        self._cells: NDArray[np.uint8] | None = None

    def clear(self) -> None:
        """Lets the next update contain the whole grid."""
        self._geometry = self._cells = None

    def update(self, costmap: Costmap, frame: Frame) -> dict[str, Any] | None:
        """Returns the entry of the header for what has changed, with its blob; None if nothing has.

        `shift` are the cells (x, y) by which the page moves what it has, before it writes the window `box` (x0, y0, x1, y1).
        """
        geometry, data = costmap.geometry, costmap.data
        shift = self._shift_to(geometry)
        if shift is None or self._cells is None:
            self._cells = data.copy()
            box = geometry.window
        else:
            if shift != (0, 0):
                self._cells = shifted(self._cells, *shift)
            box = copy_changed_window(data, self._cells)
        moved = shift is None or shift != (0, 0)
        self._geometry = geometry
        if box.is_empty and not moved:
            return None
        entry: dict[str, Any] = {
            "nx": geometry.nx,
            "ny": geometry.ny,
            "resolution": geometry.resolution,
            "origin": [geometry.origin_x, geometry.origin_y],
            "box": [int(v) for v in box],
        }
        if shift is not None and shift != (0, 0):
            entry["shift"] = list(shift)
        if not box.is_empty:
            entry["blob"] = frame.blob(data[box.slices])
        return entry

    def _shift_to(self, geometry: GridGeometry) -> tuple[int, int] | None:
        """Returns the whole cells by which the window has moved; None if the grid is another one."""
        old = self._geometry
        if old is None or (old.nx, old.ny, old.resolution) != (geometry.nx, geometry.ny, geometry.resolution):
            return None
        dx = (geometry.origin_x - old.origin_x) / geometry.resolution
        dy = (geometry.origin_y - old.origin_y) / geometry.resolution
        if abs(dx - round(dx)) > 1e-3 or abs(dy - round(dy)) > 1e-3:
            return None
        return round(dx), round(dy)


def shifted(cells: NDArray[np.uint8], dx: int, dy: int) -> NDArray[np.uint8]:
    """Returns the cells (ny, nx) of a window that has moved by (dx, dy) cells; new ones are 0."""
    ny, nx = cells.shape
    out = np.zeros_like(cells)
    if abs(dx) >= nx or abs(dy) >= ny:
        return out
    source = Window(max(dx, 0), max(dy, 0), min(nx, nx + dx), min(ny, ny + dy))
    target = Window(max(-dx, 0), max(-dy, 0), min(nx, nx - dx), min(ny, ny - dy))
    out[target.slices] = cells[source.slices]
    return out


# ----------------------------------------------------------------------------------------------------------------------
# The potential of the global planner, on the current costmap, as a small image.


LONGEST_SIDE: Final = 256
"""Cells of the image along its longer side."""
UNREACHED: Final = 255


class PotentialView:
    """The potential of the current plan as one page knows it."""

    def __init__(self) -> None:
        self._shown = (-1, -1)

    def update(self, session: Session, frame: Frame) -> dict[str, Any] | None:
        """Returns the entry of the header after a new plan: an image (ny, nx) u1, 0 lowest .. 254 highest, 255 unreached.

        Plans again with a planner of its own, so that the run is not disturbed. None if the planner has no potential.
        """
        key = (session.restarts, session.history.plan_count)
        move_base = session.run.move_base
        if key == self._shown or move_base.goal_pose is None or move_base.plan is None:
            return None
        self._shown = key
        planner = type(move_base.global_planner)(move_base.global_planner.params)
        costmap = move_base.global_costmap
        start = session.run.robot.pose
        try:
            plan = plugin_calls.make_plan(
                planner, costmap.master, start, move_base.goal_pose, costmap.footprint, keep_potential=True
            )
        except NavError:
            return None
        if plan.potential is None:
            return None
        geometry = costmap.master.geometry
        stride = -(-max(plan.potential.shape) // LONGEST_SIDE)
        values = plan.potential[::stride, ::stride].astype(np.float64)
        reached = np.isfinite(values) & (values < 1e9)
        highest = float(values[reached].max()) if reached.any() else 1.0
        image = np.where(reached, np.minimum(values / max(highest, 1e-9) * 254.0, 254.0), UNREACHED)
        return {
            "nx": image.shape[1],
            "ny": image.shape[0],
            "resolution": geometry.resolution * stride,
            "origin": [geometry.origin_x, geometry.origin_y],
            "highest": round(highest, 2),
            "blob": frame.blob(image.astype(np.uint8)),
        }


# ----------------------------------------------------------------------------------------------------------------------
# The trajectories of the last control cycle as a page draws them: colored by score, the rejected ones apart.


POINTS: Final = 6
"""Points per trajectory."""
MAX_ROWS: Final = 500
"""More samples than this are thinned out."""


def trajectories_of(planner: LocalPlanner, frame: Frame) -> dict[str, Any] | None:
    """Returns the entry of the header: rows in the local costmap's frame; None for a planner without rollouts.

    The blob `points` has (rows, POINTS, 2) i2: centimeters relative to `origin`; `scores` (rows,) f4, NaN for rejected rows;
    `samples` (rows,) u2: the row's number in the table of the cycle.
    """
    details = planner.diagnostics()
    if details is None or details.plan.totals is None:
        return None
    rollouts, plan = details.rollouts, details.plan
    rows = np.flatnonzero(rollouts.counts > 0)
    best = plan.best
    if len(rows) > MAX_ROWS:
        rows = rows[:: -(-len(rows) // MAX_ROWS)]
        if best >= 0 and best not in rows:
            rows = np.append(rows, best)
    if not len(rows):
        return None
    steps = np.linspace(0.0, 1.0, POINTS)
    last = rollouts.counts[rows] - 1
    index = np.rint(steps[None, :] * last[:, None]).astype(np.int64)
    points = rollouts.poses[rows[:, None], index, :2]
    origin = points[0, 0]
    totals = details.plan.totals[rows]
    rejected = plan.rejected_by[rows] != -1 if plan.rejected_by is not None else totals < 0.0
    scores = np.where(rejected, np.nan, totals).astype("<f4")
    return {
        "origin": [float(origin[0]), float(origin[1])],
        "rows": len(rows),
        "points": POINTS,
        "best": int(np.flatnonzero(rows == best)[0]) if best >= 0 and best in rows else -1,
        "blob": frame.blob(np.clip(np.rint((points - origin) * 100.0), -32767, 32767).astype("<i2")),
        "scores": frame.blob(scores),
        "samples": frame.blob(rows.astype("<u2")),
    }


# ----------------------------------------------------------------------------------------------------------------------
# What the camera of the robot sees, as a small picture.


CAMERA_WIDTH: Final = 320
"""Pixels per row of the picture."""


class CameraView:
    """The picture of the first camera as one page knows it."""

    def __init__(self) -> None:
        self._shown: tuple[Any, ...] = ()
        self._time = math.inf

    def clear(self) -> None:
        """Lets the next update contain a picture."""
        self._shown = ()

    def update(self, session: Session, frame: Frame) -> dict[str, Any] | None:
        """Returns the entry of the header when the next picture is due: an image (ny, nx, 3) u1, the first row at the top.

        None before, and for a robot without a camera.
        """
        robot: Any = session.run.robot
        if not has_camera(robot):
            return None
        shown = (session.restarts, session.changes, session.is_done, session.is_seeking)
        period = 1.0 / robot.params.camera(robot.params.cameras[0]).frequency
        if shown == self._shown and abs(robot.time - self._time) < period - 1e-9:
            return None
        self._shown, self._time = shown, robot.time
        rgb = robot.camera(width=CAMERA_WIDTH).rgb
        return {"nx": rgb.shape[1], "ny": rgb.shape[0], "blob": frame.blob(rgb)}


def has_camera(robot: Any) -> bool:
    """True if pages can show what the robot sees: it is no replay of a log, which does not know the world."""
    return isinstance(robot, SimulatedRobot) and bool(robot.params.cameras)


# ----------------------------------------------------------------------------------------------------------------------
# What the behavior tree of a Nav2 robot does.


TREE_PERIOD_S: Final = 0.2
"""Least time between two states of the tree on a page while the robot drives (s)."""
STATES: Final = {Status.RUNNING: 1, Status.SUCCESS: 2, Status.FAILURE: 3, Status.SKIPPED: 4, Status.IDLE: 5}
"""States of a node on the page; 0 is a node that never ran, 5 one that was halted."""


def tree_of(session: Session) -> BehaviorTree | None:
    """Return the tree that drives the robot; None for a robot of move_base."""
    move_base = session.run.move_base
    return move_base.tree if isinstance(move_base, TreeMoveBase) else None


def tree_rows(tree: BehaviorTree) -> dict[str, Any]:
    """Return the name of a tree and its nodes, parents first: depth, label, kind."""
    depth = {tree.root.index: 0}
    for item in tree.nodes:
        depth |= {child.index: depth[item.index] + 1 for child in item.children}
    return {"name": tree.name, "nodes": [[depth[item.index], item.label, _kind_of(item)] for item in tree.nodes]}


def _kind_of(item: Node) -> str:
    kinds = {"action": Action, "condition": Condition, "decorator": Decorator}
    return next((name for name, cls in kinds.items() if isinstance(item, cls)), "control")


class TreeView:
    """The states of the nodes as one page knows them."""

    def __init__(self, timer: Callable[[], float] = time.monotonic) -> None:
        self._timer = timer
        self._sent: dict[str, Any] | None = None
        self._sent_at = -math.inf

    def clear(self) -> None:
        """Let the next update contain every node."""
        self._sent, self._sent_at = None, -math.inf

    def update(self, session: Session, tree: BehaviorTree) -> dict[str, Any] | None:
        """Return the entry of the header if a node changed and the last entry is old enough, or the time stands.

        `nodes`: state, ticks and failures of each node; `messages`: why leaves failed, by index; `recoveries`: their number.
        """
        stands = session.paused or session.is_done or session.is_seeking
        now = self._timer()
        if not stands and now - self._sent_at < TREE_PERIOD_S:
            return None
        found = {
            "nodes": [[_state_of(item), sum(item.counts[1:]), item.counts[Status.FAILURE]] for item in tree.nodes],
            "messages": {
                str(item.index): item.message[:200]
                for item in tree.nodes
                if isinstance(item, (Action, Condition)) and item.last is Status.FAILURE and item.message
            },
            "recoveries": tree.blackboard.get("number_recoveries") or 0,
        }
        if found == self._sent:
            return None
        self._sent, self._sent_at = found, now
        return found


def _state_of(item: Node) -> int:
    return STATES[item.last] if any(item.counts) else 0


# ----------------------------------------------------------------------------------------------------------------------
# A frame.


LAYERS: Final = ("global", "local", "scan", "trajectories", "potential", "camera", "tree")
"""Layers that a page asks for; the others are always sent."""
SAMPLES_PER_FRAME: Final = 300
PLAN_SPACING_M: Final = 0.05
OUTCOMES: Final = 50


class SessionView:
    """The differences between a session and what a page has of it."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.layers: frozenset[str] = frozenset()
        self._restarts = -1
        self._mark: tuple[Any, ...] = ()
        self._known: dict[str, Any] = {}
        self._grids = {"global": GridView(), "local": GridView()}
        self._potential = PotentialView()
        self._camera = CameraView()
        self._tree = TreeView()
        self._tree_shown: BehaviorTree | None = None
        self._event = -1
        self._sampled = -math.inf
        self._cycle = -1

    def set_layers(self, layers: frozenset[str]) -> None:
        """Chooses the layers that frames contain; new ones are sent in full."""
        for name in layers - self.layers:
            if name in self._grids:
                self._grids[name].clear()
            if name == "camera":
                self._camera.clear()
            if name == "tree":
                self._tree.clear()
            self._known.pop(name, None)
        self.layers = layers
        self._mark = ()
        self._cycle = -1

    @property
    def is_current(self) -> bool:
        """True if nothing has happened since the last frame."""
        return self._mark == self._marks()

    def frame(self, header: Frame) -> dict[str, Any]:
        """Returns the entries of the next frame; blobs go into `header`."""
        session = self.session
        if session.restarts != self._restarts:
            self._forget()
        self._mark = self._marks()
        run = session.run
        robot, move_base = run.robot, run.move_base
        velocity = robot.state().velocity
        entries: dict[str, Any] = {
            "t": session.time,
            "clock": session.clock,
            "end": session.end,
            "cycle": session.cycles,
            "paused": session.paused,
            "seeking": session.is_seeking,
            "done": session.is_done,
            "speed": session.speed,
            "factor": round(session.factor, 2),
            "restarts": session.restarts,
            "pose": _rounded(robot.pose, 4),
            "odom": _rounded(_map_to_odom(session), 5),
            "velocity": _rounded(velocity, 3),
            "command": _rounded(move_base.command if robot.by_hand is None else robot.by_hand, 3),
            "by_hand": robot.by_hand is not None or run.interventions.teleop is not None,
            "state": move_base.state.name,
            "recovery": move_base.recovery or "",
            "collisions": len(robot.collisions),
            "length": round(run.path_length, 3),
            "nearest": _finite(session.history.least_clearance),
        }
        steered = SteeredBase.of(robot.params)
        if steered is not None:
            width = float(np.ptp(robot.footprint.vertices[:, 1]))
            entries["steering"] = round(robot.steering_angle, 4)
            entries["wheels"] = [_rounded(wheel, 4) for wheel in steered.wheels(width, robot.steering_angle)]
        self._if_changed(entries, "goals", self._goals())
        self._if_changed(entries, "shapes", [_shape(shape) for shape in session.shapes])
        self._if_changed(entries, "route", route_now(session))
        self._if_changed(entries, "interactions", self._interactions())
        self._add_moving(entries)
        self._add_history(entries)
        self._add_tree(entries)
        self._add_layers(entries, header)
        self._cycle = session.cycles
        return entries

    # --- inside -----------------------------------------------------------------------------------------------------

    def _marks(self) -> tuple[Any, ...]:
        s = self.session
        return (s.cycles, s.changes, s.restarts, s.is_seeking, s.is_done, s.paused)

    def _forget(self) -> None:
        self._known.clear()
        self._restarts = self.session.restarts
        self._event, self._sampled, self._cycle = -1, -math.inf, -1
        self._tree.clear()
        self._tree_shown = None
        for grid in self._grids.values():
            grid.clear()

    def _if_changed(self, entries: dict[str, Any], name: str, value: Any) -> None:
        if name not in self._known or self._known[name] != value:
            self._known[name] = value
            entries[name] = value

    def _goals(self) -> dict[str, Any]:
        goals = self.session.run.goals
        first = max(0, len(goals.outcomes) - OUTCOMES)
        return {
            "under_way": [
                {
                    "number": sent.index + 1,
                    "pose": list(
                        sent.target or self.session.run.robot.pose
                    ),  # a motion has no target before its first step
                    "state": sent.handle.status.name,
                }
                for sent in goals.under_way
            ],
            "waiting": [list(goal) for goal in goals.waiting if isinstance(goal, Pose2D)],
            "loop": goals.loop,
            "ended": [
                {
                    "number": number,
                    "pose": list(o.goal),
                    "state": o.state,
                    "time": round(o.time_s, 2),
                    "text": o.message,
                }
                for number, o in enumerate(goals.outcomes[first:], first + 1)
            ],
        }

    def _interactions(self) -> list[list[Any]]:
        """Times and kinds, for the marks on the time line."""
        return [[item.time, item.kind] for item in self.session.interactions[-500:]]

    def _add_moving(self, entries: dict[str, Any]) -> None:
        """Adds where the moving obstacles are now."""
        world, solids = self.session.run.robot.world, self.session.run.robot.solids
        if not self.session.run.robot.moves:
            return
        entries["discs"] = [
            [world.name_of("disc", k), *_rounded(disc, 3)]
            for k, disc in enumerate(solids.discs.tolist())
            if disc[0] == disc[0]  # absent ones have no position
        ]
        entries["polygons"] = [
            [self.session.run.robot.polygon_name(k), *_rounded(solids.polygon(k).ravel().tolist(), 3)]
            for k in range(len(solids.circles))
        ]
        entries["robots"] = [[name, *_rounded(pose, 3), waits] for name, pose, waits in self.session.others()]

    def _add_history(self, entries: dict[str, Any]) -> None:
        history = self.session.history
        new = [sample for sample in history.samples if sample.t > self._sampled]
        if new:
            self._sampled = new[-1].t
            stride = max(1, math.ceil(len(new) / SAMPLES_PER_FRAME))
            entries["samples"] = [_sample(sample) for sample in new[::-1][::stride][::-1]]
        events = list(history.events_after(self._event))
        if events:
            self._event = events[-1].number
            entries["events"] = [[e.number, round(e.time, 3), e.kind, e.text] for e in events[-100:]]
        if self._known.get("trail") != history.trail_version:
            self._known["trail"] = history.trail_version
            entries["trail"] = [[round(x, 2), round(y, 2)] for x, y in _new_part(history.trail)]
        if self._known.get("plan") != history.plan_count:
            before = self._known.get("plan", 0)
            self._known["plan"] = history.plan_count
            entries["plans"] = [[number, _points(poses)] for number, poses in history.plans if number > before]
        local = self.session.run.move_base.local_plan
        if local is not None and local.trajectory is not None and self.session.cycles != self._cycle:
            entries["trajectory"] = _points(local.trajectory, 0.02)

    def _add_tree(self, entries: dict[str, Any]) -> None:
        """Add the tree once, and the states of its nodes while the page shows them."""
        tree = tree_of(self.session)
        if tree is not self._tree_shown or "behavior_tree" not in self._known:
            self._tree_shown = tree
            self._if_changed(entries, "behavior_tree", None if tree is None else tree_rows(tree))
        if tree is not None and "tree" in self.layers:
            states = self._tree.update(self.session, tree)
            if states is not None:
                entries["tree_states"] = states

    def _add_layers(self, entries: dict[str, Any], frame: Frame) -> None:
        move_base = self.session.run.move_base
        costmaps: dict[str, Any] = {}
        for name, costmap in (("global", move_base.global_costmap), ("local", move_base.local_costmap)):
            if name in self.layers and isinstance(costmap, LayeredCostmap) and costmap.updated_at is not None:
                change = self._grids[name].update(costmap.master, frame)
                if change is not None:
                    costmaps[name] = change
        if costmaps:
            entries["costmaps"] = costmaps
        if "camera" in self.layers:
            picture = self._camera.update(self.session, frame)
            if picture is not None:
                entries["camera"] = picture
        if self.session.cycles == self._cycle:
            return
        if "scan" in self.layers:
            entries["scan"] = frame.blob(_scan_points(self.session))
        if "trajectories" in self.layers:
            entries["trajectories"] = trajectories_of(move_base.local_planner, frame)
        if "potential" in self.layers:
            potential = self._potential.update(self.session, frame)
            if potential is not None:
                entries["potential"] = potential


def _new_part(trail: list[tuple[float, float]]) -> list[tuple[float, float]]:
    return trail[:: max(1, len(trail) // 400)]


def _sample(sample: Any) -> list[Any]:
    clearance = None if not math.isfinite(sample.clearance) else round(sample.clearance, 3)
    numbers = _rounded((sample.vx, sample.wz, sample.command_vx, sample.command_wz), 3)
    return [round(sample.t, 3), clearance, *numbers, sample.state, round(sample.steering, 4)]


def _shape(shape: Shape) -> dict[str, Any]:
    """A shape as the page draws and edits it."""
    entry = shape.model_dump(mode="json", exclude_none=True, exclude={"motion", "thickness"})
    entry["kind"] = shape.motion.kind
    if isinstance(shape.motion, PedestrianMotion):
        entry["goals"] = shape.motion.goals
    entry["outline"] = [_rounded(point, 4) for point in shape.outline()]
    return entry


def _map_to_odom(session: Session) -> Transform2D:
    robot = session.run.robot
    try:
        return robot.frames.lookup(robot.map_frame, session.run.move_base.local_costmap.frame)
    except NavError:
        return Transform2D()


def _scan_points(session: Session) -> NDArray[np.int16]:
    """(n, 2) hits of the last scans in cm, relative to the robot's pose at the time of the frame (its axes)."""
    robot = session.run.robot
    points: list[NDArray[np.float64]] = []
    scans = (data for data in session.history.readings.values() if isinstance(data, LaserScan))
    for scan in scans:
        ranges = np.asarray(scan.ranges, np.float64)
        good = np.isfinite(ranges) & (ranges >= scan.range_min) & (ranges <= scan.range_max)
        angles = scan.angle_min + scan.angle_increment * np.flatnonzero(good)
        local = ranges[good, None] * np.column_stack((np.cos(angles), np.sin(angles)))
        try:
            pose = robot.frames.lookup(robot.base_frame, scan.frame)
        except NavError:
            continue
        points.append(pose.apply_points(local))
    found = np.concatenate(points) if points else np.empty((0, 2))
    return np.clip(np.rint(found * 100.0), -32767, 32767).astype("<i2")


def _points(poses: NDArray[np.float64], spacing: float = PLAN_SPACING_M) -> list[float]:
    """x, y, x, y, .. (m) of the poses (n, 3) that are at least `spacing` apart, and the last one."""
    if not len(poses):
        return []
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T) if len(poses) > 1 else np.empty(0)
    along = np.concatenate(([0.0], np.cumsum(steps)))
    marks = np.floor(along / spacing)
    keep = np.concatenate(([True], marks[1:] != marks[:-1]))
    keep[-1] = True
    return np.round(poses[keep, :2], 2).ravel().tolist()


def _finite(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None


def _rounded(values: Pose2D | Any, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]
