"""Drives a coverage plan: leg by leg, around what the map does not contain, and measures what it covers."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.behaviors import DriveToPose, InvalidMotionError, MotionCollisionError, MotionTimeoutError
from navstack.core import LETHAL, Costmap, NavError, Path, Pose2D, RobotState, Transform2D, Twist2D
from navstack.coverage.area import distance_to
from navstack.coverage.errors import CoverageError, InvalidModeError
from navstack.coverage.field import Field, as_geojson
from navstack.coverage.measure import CoverageFigures, figures_of, left_in, visits_of
from navstack.coverage.params import CoverageParams
from navstack.coverage.planner import CoveragePlan, plan_coverage
from navstack.parameters import MotionParams
from navstack.plugins import Behavior, BehaviorContext, BehaviorStatus, BehaviorStep

LEG_TOLERANCE_M: Final = 0.02
"""Distance from the end of a leg that counts as reached (m)."""
LEG_TOLERANCE_RAD: Final = 0.03
"""Angle from the direction of a leg at which it begins (rad)."""
TURN_RATE: Final = 1.2
"""Fastest turn in place (rad/s); the limits of the local planner count as well."""
WAIT_S: Final = 2.0
"""Time for which an obstacle on the way may move away before the rest is planned anew (s)."""
FRUITLESS_PLANS: Final = 20
"""Plans in a row by which nothing more is covered, at most."""
BACK_OFF_M: Final = 0.2
"""Way back from an obstacle next to which the robot stopped twice (m)."""
SAME_CELLS: Final = 2.9
"""An obstacle within so many cells of a known one is that one."""
UNSEEN_M: Final = 0.15
"""An obstacle that the map does not contain is grown by this (m): the robot sees its front, but drives along its sides."""
AGAIN_M: Final = 0.15
"""Two stops this near to each other are at the same obstacle (m)."""
SHORTEST_LEG_M: Final = 0.03
"""Corners closer together than this are one (m)."""


def least_clearance(resolution: float) -> float:
    """Return the distance from obstacles (m) that a drive keeps at least, on costmaps with cells of `resolution` (m).

    A leg may end beside its end by the tolerance, and a scan with noise marks a wall one cell before its place on the map: closer
    to it, the robot would stop before cells that the scan has just marked.
    """
    return LEG_TOLERANCE_M + resolution


class CoverageDrive(Behavior[CoverageParams]):
    """Covers an area: plans with the global costmap, drives the legs, plans the rest anew where an obstacle is in the way.

    A leg is straight: the robot turns towards its end and drives there (`DriveToPose`), checked for collisions on both costmaps.
    Before an obstacle it waits for `WAIT_S`; then the obstacle is part of the area, its border included, and what is not covered
    yet is planned again. Stopped twice in one place, the robot drives back a little, and keeps more distance from then on. The
    drive succeeds when every leg of the last plan is driven, also if parts had to be left: its figures say which. It fails if
    nothing could be covered, or `FRUITLESS_PLANS` plans in a row cover no more.
    """

    Params = CoverageParams
    turns_in_place = True

    def __init__(
        self,
        params: CoverageParams,
        motion: MotionParams | None = None,
        *,
        field: Field | None = None,
        name: str = "cover",
    ) -> None:
        """`field` (m, frame of the global costmap) limits the work. Raises InvalidModeError without a path."""
        super().__init__(name, params)
        if not (params.generate_route and params.generate_path):
            raise InvalidModeError(f"{name}: driving needs generate_route and generate_path; leave both true")
        self.field = field
        self.plan: CoveragePlan | None = None
        """The first plan, for the whole area."""
        self.current: CoveragePlan | None = None
        """The plan that is driven."""
        self.track: list[tuple[float, float, float, bool]] = []
        """Time (s) and believed position (m) of each step, and whether the tool works from there on."""
        self.plans = 0
        """Number of plans so far."""
        self.clearance = params.clearance
        """Distance of the footprint from obstacles in the current plan (m), see `least_clearance`."""
        self._motion = (motion or MotionParams()).model_copy(
            update={"tolerance": LEG_TOLERANCE_M, "tolerance_radian": LEG_TOLERANCE_RAD, "speed_radian": TURN_RATE}
        )
        self._context: BehaviorContext | None = None
        self._legs: list[tuple[float, float, bool]] = []
        self._next = 0
        self._ahead = [0.0]
        """Length of the legs from each on (m)."""
        self._inner: DriveToPose | None = None
        self._waiting_since: float | None = None
        self._avoid: NDArray[np.bool_] | None = None
        self._blocked: NDArray[np.bool_] | None = None
        self._known: Costmap | None = None
        self._stops: list[tuple[float, float]] = []
        self._stopped_at: Pose2D | None = None
        """Where the robot was when it stopped last."""
        self._stuck = False
        """Whether it stopped there before."""
        self._backs_off = False
        self._done_cells = self._fruitless = 0
        self._last_failure = ""

    # --- a behavior ---------------------------------------------------------------------------------------------------

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self._motion.frequency

    def describe(self) -> dict[str, Any]:
        """Return the parameters, the field and the segments of the plan."""
        segments = [] if self.plan is None else self.plan.segments
        return {
            "cover": self.params.model_dump(mode="json"),
            "field": None if self.field is None else as_geojson(self.field),
            "segments": [{"kind": s.kind, "works": s.works, "points": s.points.tolist()} for s in segments],
        }

    def start(self, context: BehaviorContext, now: float) -> None:
        """Start; the first step plans, with costmaps that are current then."""
        self._context = context
        self.frame = context.global_costmap.frame
        self.track, self.plans, self.plan, self.current = [], 0, None, None
        self._avoid = self._blocked = self._waiting_since = self._inner = self._known = None
        self._stops, self._stopped_at, self._stuck, self._backs_off = [], None, False, False
        self._done_cells = self._fruitless = 0
        self.clearance = max(self.params.clearance, least_clearance(context.global_costmap.master.geometry.resolution))

    def step(self, state: RobotState, now: float) -> BehaviorStep:
        """Return the next command. Raises the errors of `plan_coverage`, and CoverageError if nothing could be covered."""
        context = self._context
        assert context is not None
        pose = context.global_costmap.robot_pose(now)
        if self.plan is None:
            self._begin(pose)
        if self._waiting_since is not None:
            self._remember(now, pose, works=False)
            if now - self._waiting_since < WAIT_S:
                return BehaviorStep(BehaviorStatus.RUNNING, Twist2D(), data=self._progress())
            self._waiting_since = None
            if self._stuck and not self._backs_off:
                self._back_off(pose, context, now)
            elif not self._plan_rest(pose):
                return self._done(now)
        while True:
            if self._inner is None:
                if self._backs_off and not self._plan_rest(pose):
                    return self._done(now)
                if self._next >= len(self._legs):
                    self._remember(now, pose, works=False)
                    return self._done(now)
                x, y, _ = self._legs[self._next]
                if math.hypot(x - pose.x, y - pose.y) <= LEG_TOLERANCE_M:
                    self._next += 1
                    continue
                heading = math.atan2(y - pose.y, x - pose.x)
                speed = context.local_planner.limits.max_vel_trans
                motion = self._motion.model_copy(update={"speed_linear": self._motion.follow_speed or max(speed, 0.05)})
                self._inner = DriveToPose(Pose2D(x, y, heading), motion, self.name)
                self._inner.start(context, now)
            works = self._legs[self._next][2] and not self._backs_off
            self._remember(now, pose, works=works)
            try:
                step = self._inner.step(state, now)
            except InvalidMotionError:
                raise
            except (MotionCollisionError, MotionTimeoutError) as error:
                return self._stopped(error, pose, now)
            self.local_plan = self._inner.local_plan
            if step.status is BehaviorStatus.RUNNING:
                notes = step.data.get("notes", ())
                return BehaviorStep(BehaviorStatus.RUNNING, step.twist, data={**self._progress(), "notes": notes})
            self._inner = None
            self._next += not self._backs_off

    # --- figures ------------------------------------------------------------------------------------------------------

    def driven(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the believed positions (n, 2) (m), and whether the tool worked from each to the next."""
        if not self.track:
            return np.zeros((0, 2)), np.zeros(0, np.bool_)
        table = np.array(self.track)
        return np.ascontiguousarray(table[:, 1:3]), table[:, 3] > 0.0

    def works_at(self, times: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether the tool worked at `times` (n,) (s); False before and after the drive."""
        if not self.track:
            return np.zeros(len(times), np.bool_)
        table = np.array(self.track)
        index = np.searchsorted(table[:, 0], times + 1e-9) - 1
        inside = (index >= 0) & (times <= table[-1, 0])
        return inside & (table[np.maximum(index, 0), 3] > 0.0)

    def figures(self) -> CoverageFigures:
        """Return what is covered so far of the area of the first plan, by the believed positions."""
        assert self.plan is not None
        points, works = self.driven()
        return figures_of(self.plan.area, points, works)

    def report(
        self, points: NDArray[np.float64] | None = None, works: NDArray[np.bool_] | None = None
    ) -> dict[str, Any]:
        """Return the figures of the plan and of the drive, and what was left and why, as JSON data.

        `points` (n, 2) (m) and `works` (n,): the true track, where it is known; otherwise the believed one.
        """
        plan = self.plan
        assert plan is not None
        if points is None or works is None:
            points, works = self.driven()
        visits = visits_of(plan.area, points, works)
        line, at_work = plan.line()
        planned = visits_of(plan.area, line, at_work)
        least = 0.1 * plan.area.operation_width**2
        left = left_in(
            plan.area, visits, planned=planned, blocked=self._blocked, ahead=self._to_drive(), least_m2=least
        )
        duration = self.track[-1][0] - self.track[0][0] if self.track else 0.0
        return {
            "plan": plan.figures.as_dict(),
            "driven": {**figures_of(plan.area, points, works, visits).as_dict(), "time_s": duration},
            "plans": self.plans,
            "clearance": self.clearance,
            "left": [part.as_dict() for part in left],
        }

    def _begin(self, pose: Pose2D) -> None:
        """Plan the whole area."""
        self._plan(pose)
        plan = self.plan = self.current
        assert plan is not None
        points, _ = plan.line()
        steps = np.diff(points, axis=0, append=points[-1:])
        self.reference = Path(np.column_stack((points, np.arctan2(steps[:, 1], steps[:, 0]))), self.frame)
        self.target = Pose2D(float(points[-1, 0]), float(points[-1, 1]), 0.0)

    def _to_drive(self) -> NDArray[np.int32] | None:
        """Return the visits of the legs that are not driven; None after the last one."""
        assert self.plan is not None
        legs = self._legs[self._next :]
        if not legs:
            return None
        begin = self.track[-1][1:3] if self.track else legs[0][:2]
        points = np.array([begin, *(leg[:2] for leg in legs)])
        works = np.array([*(leg[2] for leg in legs), False])
        return visits_of(self.plan.area, points, works)

    # --- planning and obstacles ---------------------------------------------------------------------------------------

    def _plan(self, pose: Pose2D, done: NDArray[np.bool_] | None = None) -> None:
        context = self._context
        assert context is not None
        costmap = self._seen(context)
        self.current = plan_coverage(
            costmap,
            context.global_costmap.footprint,
            pose,
            self.params.model_copy(update={"clearance": self.clearance}),
            polygon=self.field,
            avoid=self._avoid,
            done=done,
        )
        self.plans += 1
        legs: list[tuple[float, float, bool]] = []
        for segment in self.current.segments:
            for x, y in segment.points[1:].tolist():
                if (
                    legs
                    and math.hypot(x - legs[-1][0], y - legs[-1][1]) < SHORTEST_LEG_M
                    and legs[-1][2] == segment.works
                ):
                    legs[-1] = (x, y, segment.works)
                else:
                    legs.append((x, y, segment.works))
        self._legs, self._next = legs, 0
        corners = np.array([(x, y) for x, y, _ in legs] or [(pose.x, pose.y)])
        lengths = np.hypot(*np.diff(corners, axis=0, prepend=[(pose.x, pose.y)]).T)
        self._ahead = [*np.cumsum(lengths[::-1])[::-1].tolist(), 0.0]

    def _plan_rest(self, pose: Pose2D) -> bool:
        """Plan what is not covered; return False if nothing is left that can be."""
        plan = self.plan
        assert plan is not None
        self._backs_off = False
        done = visits_of(plan.area, *self.driven()) > 0
        cells = int((done & plan.area.reachable).sum())
        self._fruitless = 0 if cells > self._done_cells else self._fruitless + 1
        self._done_cells = cells
        if self._fruitless >= FRUITLESS_PLANS:
            raise CoverageError(
                f"{self._fruitless} plans in a row covered no more; the last stop: {self._last_failure}",
                **self.report(),
            )
        try:
            self._plan(pose, done)
        except NavError as error:
            self._last_failure = error.message
            return False
        current = self.current
        assert current is not None
        if current.area.grid == plan.area.grid:
            blocked = plan.area.reachable & ~current.area.reachable
            self._blocked = blocked if self._blocked is None else self._blocked | blocked
        return True

    def _seen(self, context: BehaviorContext) -> Costmap:
        """Return the costmap of the first plan, with the obstacles that both costmaps contain now.

        What is next to an obstacle of the first plan is that obstacle: a scan marks cells on either side of a wall's surface.
        """
        master, local = context.global_costmap.master, context.local_costmap
        if self._known is None:
            self._known = Costmap(master.geometry, master.data.copy(), master.frame)
            return self._known
        known = self._known
        lethal = np.zeros(known.geometry.shape, np.bool_)
        for costmap, to_map in ((master, Transform2D()), (local.master, self._local_to_map(context))):
            ys, xs = np.nonzero(costmap.data == LETHAL)
            g = costmap.geometry
            points = np.zeros((len(xs), 3))
            points[:, 0] = g.origin_x + (xs + 0.5) * g.resolution
            points[:, 1] = g.origin_y + (ys + 0.5) * g.resolution
            points = to_map.apply_poses(points)
            g = known.geometry
            ix = np.floor((points[:, 0] - g.origin_x) / g.resolution).astype(np.int64)
            iy = np.floor((points[:, 1] - g.origin_y) / g.resolution).astype(np.int64)
            inside = (ix >= 0) & (iy >= 0) & (ix < g.nx) & (iy < g.ny)
            lethal[iy[inside], ix[inside]] = True
        data = known.data.copy()
        seen = lethal & (distance_to(known.data == LETHAL) > SAME_CELLS)
        if seen.any():
            data[distance_to(seen) * known.geometry.resolution <= UNSEEN_M] = LETHAL
        return Costmap(known.geometry, data, known.frame)

    def _local_to_map(self, context: BehaviorContext) -> Transform2D:
        now = self.track[-1][0]
        in_map, here = context.global_costmap.robot_pose(now), context.local_costmap.robot_pose(now)
        return Transform2D(*in_map) @ Transform2D(*here).inverse()

    def _stopped(self, error: NavError, pose: Pose2D, now: float) -> BehaviorStep:
        """Wait before the obstacle. Where the footprint hit one twice, positions are no longer driven to."""
        self._stuck = self._stopped_at is not None and pose.distance_to(self._stopped_at) < AGAIN_M
        self._stopped_at = pose
        self._inner, self._waiting_since, self._last_failure = None, now, error.message
        assert self._known is not None
        g = self._known.geometry
        x, y, _ = error.data.get("collision_ahead") or [0.0, 0.0, 0.0]
        at = Transform2D(*pose).apply(Pose2D(float(x), float(y), 0.0))
        again = any(math.hypot(at.x - p, at.y - q) < AGAIN_M for p, q in self._stops)
        self._stops.append((at.x, at.y))
        cell = g.world_to_cell(at.x, at.y)
        if again and cell is not None:
            if self._avoid is None:
                self._avoid = np.zeros(g.shape, np.bool_)
            ix, iy = cell
            self._avoid[max(0, iy - 1) : iy + 2, max(0, ix - 1) : ix + 2] = True
        return BehaviorStep(BehaviorStatus.RUNNING, Twist2D(), data=self._progress())

    def _back_off(self, pose: Pose2D, context: BehaviorContext, now: float) -> None:
        """Drive back a little, and keep half a cell more from obstacles, up to one cell more than at first."""
        resolution = context.global_costmap.master.geometry.resolution
        most = max(self.params.clearance, least_clearance(resolution)) + resolution
        self.clearance = min(self.clearance + 0.5 * resolution, most)
        behind = Transform2D(*pose).apply(Pose2D(-BACK_OFF_M, 0.0, 0.0))
        self._inner = DriveToPose(behind, self._motion, self.name, backwards=True)
        self._inner.start(context, now)
        self._backs_off = True

    # --- results ------------------------------------------------------------------------------------------------------

    def _remember(self, now: float, pose: Pose2D, *, works: bool) -> None:
        if self.track and self.track[-1][0] == now:
            self.track.pop()
        self.track.append((now, pose.x, pose.y, works))

    def _progress(self) -> dict[str, Any]:
        left = len(self._legs) - self._next
        return {"legs_left": left, "legs": len(self._legs), "left_m": self._ahead[self._next], "plans": self.plans}

    def _done(self, now: float) -> BehaviorStep:
        report = self.report()
        driven = report["driven"]
        if driven["covered_m2"] <= 0.0:
            raise CoverageError(f"nothing could be covered: {self._last_failure or 'every leg was blocked'}", **report)
        left = sum(part["area_m2"] for part in report["left"])
        text = (
            f"covered {driven['covered_m2']:.1f} of {driven['reachable_m2']:.1f} m² ({driven['share']:.1%}; plan "
            f"{report['plan']['share']:.1%}), overlap {driven['overlap']:.1%}, {driven['length_m']:.1f} m in "
            f"{driven['time_s']:.0f} s, {self.plans} plan{'s' * (self.plans != 1)}, {left:.1f} m² left"
        )
        if self.clearance > self.params.clearance:
            text += f", {self.clearance:.3g} m from obstacles instead of {self.params.clearance:g}"
        return BehaviorStep(BehaviorStatus.DONE, text=text, data={**self._progress(), **report})
