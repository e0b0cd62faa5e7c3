"""The search for contacts: thousands of scenes with and without the collision monitor."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import shapely

from navstack.core import Footprint, GridGeometry, LaserScan, OccupancyGrid, Pose2D, Twist2D
from navstack.parameters import CollisionMonitorParams, LidarParams, MonitorSourceParams, SimParams, ZoneParams
from navstack.safety import CollisionMonitor, CommandChain
from navstack.sim import Collision, DoorMotion, OnTrack, PedestrianMotion, Shape, SimulatedRobot, World
from navstack.studies.contacts import (
    MIN_POINTS,
    UNEXPLAINED,
    Braking,
    Moment,
    SeenPoints,
    cause_of,
    sight_of,
    touched_cell,
)
from navstack.studies.jobs import Job, JobResult
from navstack.studies.table import Column, Table
from navstack.studies.task import Report, Task

# --- scenes -----------------------------------------------------------------------------------------------------------


ROOM_M: Final = 8.0
"""Side of the square room."""
DURATION_S: Final = 10.0
PERIOD_S: Final = 0.05
"""Time between two commands, two scans and two checks."""
DEAD_TIME_S: Final = 0.05
"""Time between a command and its effect on the simulated base."""
MARGIN_M: Final = 0.06
"""Distance of the monitor's zone from the footprint."""
_AWAY: Final = -60.0
"""Where boxes are before they appear (m): beyond the walls and the range of the lidar."""


@dataclass(frozen=True, slots=True)
class RobotKind:
    """A robot of the search."""

    name: str
    footprint: Footprint
    holonomic: bool
    max_velocity: tuple[float, float, float]
    """m/s, rad/s."""
    max_decel: tuple[float, float, float]
    """m/s², rad/s²."""


def robot_kinds() -> tuple[RobotKind, ...]:
    """Return the three robots: a small round one, a rectangular one that moves sideways, a long one that turns about its tail."""
    rectangle = np.array([[0.35, 0.25], [-0.35, 0.25], [-0.35, -0.25], [0.35, -0.25]])
    # a fork-lift: its base is between the rear wheels, and the forks leave a notch in front
    long = np.array(
        [[0.9, 0.28], [0.5, 0.28], [0.5, 0.3], [-0.2, 0.3], [-0.2, -0.3], [0.5, -0.3], [0.5, -0.28], [0.9, -0.28]]
    )
    return (
        RobotKind("round", Footprint.from_radius(0.2), False, (0.7, 0.0, 2.0), (1.0, 1.0, 2.5)),
        RobotKind("rectangle", Footprint(rectangle), True, (0.8, 0.5, 1.5), (0.8, 0.8, 2.0)),
        RobotKind("long", Footprint(long), False, (1.0, 0.0, 1.0), (0.7, 0.7, 1.5)),
    )


@dataclass(frozen=True, slots=True)
class SafetyScene:
    """One scene, a function of its number."""

    number: int
    robot: RobotKind
    shapes: tuple[Shape, ...]

    @property
    def start(self) -> Pose2D:
        """The middle of the room, in one of eight headings."""
        return Pose2D(0.0, 0.0, (self.number // 3) % 8 * math.pi / 4.0 - math.pi)

    @property
    def sim(self) -> SimParams:
        """The simulated robot: limited accelerations, a dead time, and a lidar all around with noise."""
        x, y, w = self.robot.max_decel
        lidar = LidarParams(
            fov=2.0 * math.pi,
            beams=360,
            frequency=1.0 / PERIOD_S,
            range_min=0.02,
            range_max=12.0,
            range_noise=0.005,
            x=0.0,
        )
        return SimParams(
            kinematics="holonomic" if self.robot.holonomic else "differential",
            physics_frequency=2.0 / PERIOD_S,
            acc_lim_x=x,
            acc_lim_y=y,
            acc_lim_theta=w,
            command_delay=DEAD_TIME_S,
            bumpers=[],
            sensors={"laser": lidar},
        )

    def zone(self) -> shapely.Polygon:
        """Return the footprint with the margin."""
        return self.robot.footprint.polygon.buffer(MARGIN_M, join_style="mitre")


@cache
def room() -> OccupancyGrid:
    """Return an empty room with walls."""
    cells = round(ROOM_M / 0.05)
    data = np.zeros((cells, cells), np.int8)
    data[[0, -1], :] = 100
    data[:, [0, -1]] = 100
    half = -0.5 * ROOM_M
    return OccupancyGrid(data, GridGeometry(cells, cells, 0.05, half, half))


def safety_scene(number: int) -> SafetyScene:
    """Return scene `number`: four people, two of whom ignore everything, and six boxes that appear at random times."""
    rng = np.random.default_rng([number, 20])
    kind = robot_kinds()[number % 3]
    shapes: list[Shape] = []
    for k in range(2):
        ends = _points(rng, 2, kind)
        speed = float(rng.uniform(0.3, 1.2))
        motion = OnTrack(points=ends, speed=speed, start_offset=0.0)
        shapes.append(Shape(name=f"walker {k + 1}", radius=0.25, motion=motion))
    for k in range(2):
        goals = _points(rng, 3, kind)
        motion = PedestrianMotion(goals=goals, notices_robot=bool(rng.random() < 0.5))
        shapes.append(Shape(name=f"pedestrian {k + 1}", radius=0.25, pose=[*goals[0], 0.0], motion=motion))
    for k in range(6):
        (x, y), t = rng.uniform(-3.5, 3.5, 2), float(rng.uniform(0.5, 0.8 * DURATION_S))
        box = [float(rng.uniform(0.15, 1.0)), float(rng.uniform(0.15, 1.0))]
        motion = DoorMotion(style="sliding", slide=[float(x) - _AWAY, float(y)], open=[[t, 1e6]], moving_time=0.0)
        pose = [_AWAY, 0.0, float(rng.uniform(-math.pi, math.pi))]
        shapes.append(Shape(name=f"box {k + 1}", box=box, pose=pose, motion=motion))
    return SafetyScene(number, kind, tuple(shapes))


def _points(rng: np.random.Generator, count: int, kind: RobotKind) -> list[list[float]]:
    """Return random points in the room; the first one is away from the start of the robot."""
    out: list[list[float]] = []
    while len(out) < count:
        x, y = rng.uniform(-3.5, 3.5, 2).tolist()
        if out or math.hypot(x, y) > kind.footprint.circumscribed_radius + 0.5:
            out.append([x, y])
    return out


class HostileSource:
    """Random velocities up to the limits of the robot, each held for a random time; half of them straight ahead or back."""

    def __init__(self, scene: SafetyScene) -> None:
        self._rng = np.random.default_rng([scene.number, 21])
        self._limit = np.array(scene.robot.max_velocity)
        self._until = -1.0
        self._command = Twist2D()

    def command(self, now: float) -> Twist2D:
        """Return the command at `now` (s)."""
        rng = self._rng
        if now >= self._until:
            self._until = now + float(rng.choice((PERIOD_S, 0.2, 1.0, 3.0)))
            values = rng.uniform(-1.0, 1.0, 3) * self._limit
            if rng.random() < 0.5:
                values = np.sign(values) * self._limit
                values[2] *= float(rng.random() < 0.2)
            self._command = Twist2D(*values.tolist())
        return self._command


# --- drives -----------------------------------------------------------------------------------------------------------
# The monitor takes obstacles for static. So it guarantees no contact with a static obstacle that was seen while the robot
# could still brake; what moves can touch the robot by its own motion.


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact of the robot with an obstacle."""

    time: float
    obstacle: str
    cause: str
    """`contact_causes.Cause`, or empty without the monitor."""

    def as_dict(self) -> dict[str, Any]:
        """Return the contact for JSON."""
        return {"time": self.time, "obstacle": self.obstacle, "cause": self.cause}


def braking(scene: SafetyScene) -> Braking:
    """Return how the robot of a scene stops."""
    robot = scene.robot
    return Braking(robot.footprint, robot.name != "round", robot.holonomic, robot.max_decel, DEAD_TIME_S, PERIOD_S)


def build_monitor(scene: SafetyScene, robot: SimulatedRobot) -> CollisionMonitor:
    """Return a monitor with one zone: the footprint with a margin, approach."""
    corners = [list(point) for point in scene.zone().exterior.coords[:-1]]
    x, y, w = scene.robot.max_decel
    params = CollisionMonitorParams(
        polygons=["footprint"],
        observation_sources=["scan"],
        source_timeout=0.5,
        max_decel=[-x, -y, -w],
        reaction_time=DEAD_TIME_S,
        check_frequency=1.0 / PERIOD_S,
        blocks={
            "footprint": ZoneParams(
                action_type="approach", points=str(corners), min_points=MIN_POINTS, time_before_collision=1.0
            ),
            "scan": MonitorSourceParams(),
        },
    )
    return CollisionMonitor(
        params,
        frames=robot.frames,
        base_frame=robot.base_frame,
        odom_frame=robot.odom_frame,
        footprint=scene.robot.footprint,
    )


class SafetyDrive:
    """One drive of a scene."""

    def __init__(self, number: int, *, monitored: bool, log: bool = False) -> None:
        """`log` keeps the moments, which explanations need."""
        self.scene = safety_scene(number)
        self.world = World(room(), shapes=self.scene.shapes)
        self.robot = SimulatedRobot(
            self.scene.sim, self.world, self.scene.robot.footprint, self.scene.start, seed=number
        )
        monitor = build_monitor(self.scene, self.robot) if monitored else None
        self.chain = CommandChain(self.robot, monitor=monitor)
        self.moments: list[Moment] = []
        self.seen = SeenPoints()
        self._log = log
        self.moved = 0.0
        """Path length driven (m)."""

    def run(self) -> list[Collision]:
        """Drive for `DURATION_S`; return the contacts."""
        source = HostileSource(self.scene)
        robot, chain = self.robot, self.chain
        sent = Twist2D()
        for k in range(round(DURATION_S / PERIOD_S)):
            now = k * PERIOD_S
            robot.advance_to(now)
            scans = chain.scans()
            before = sent
            chain.send("navigation", source.command(now), now)
            step = chain.tick(now)
            sent = step.sent if step is not None else sent
            if self._log:
                scan = next((s for s in scans if isinstance(s, LaserScan)), None)
                sight = sight_of(scan, robot.pose, robot.solids)
                self.seen.add(sight.points, now)
                velocity = robot.state().velocity
                self.moments.append(Moment(now, robot.pose, velocity, before, sent, robot.solids, sight))
        self.moved = robot.distance_travelled
        return robot.collisions


def explain_contacts(number: int) -> list[Contact]:
    """Drive a scene with the monitor and explain each contact."""
    drive = SafetyDrive(number, monitored=True, log=True)
    return [_explained(drive, collision) for collision in drive.run()]


def contacts_of(drive: SafetyDrive) -> list[Contact]:
    """Drive a scene and return its contacts without explanations."""
    return [Contact(c.time, c.name or c.kind, "") for c in drive.run()]


# --- explanation ------------------------------------------------------------------------------------------------------


def _explained(drive: SafetyDrive, collision: Collision) -> Contact:
    moments = [m for m in drive.moments if m.time < collision.time - 1e-9]
    is_wall = collision.kind == "map"
    wall = drive.seen.wall(touched_cell(collision, drive.world.map.geometry.resolution)) if is_wall else None
    cause = cause_of(braking(drive.scene), moments, collision, wall)
    return Contact(collision.time, collision.name or collision.kind, cause)


@dataclass(frozen=True)
class SafetyTask(Task):
    """Drives the scene of a number twice, with and without the monitor: scenes `first` .. `first + count - 1`."""

    first: int = 0
    count: int = 1

    def __call__(self, number: int, /) -> dict[str, Any]:
        """The contacts with the monitor, explained, and those without it, for JSON."""
        monitored = SafetyDrive(number, monitored=True)
        with_it: Sequence[Contact] = explain_contacts(number) if monitored.run() else ()
        plain = SafetyDrive(number, monitored=False)
        without = contacts_of(plain)
        return {
            "number": number,
            "robot": monitored.scene.robot.name,
            "with": [contact.as_dict() for contact in with_it],
            "without": [contact.as_dict() for contact in without],
            "driven_with_m": monitored.moved,
            "driven_without_m": plain.moved,
        }

    def described(self) -> dict[str, Any]:
        """Return a scene depends on its number only."""
        return {"bench": "safety"}

    def jobs(self) -> list[Job]:
        """Return a job per scene."""
        return [Job(f"scene {number}", number) for number in range(self.first, self.first + self.count)]

    def report(self, results: Sequence[JobResult]) -> Report:
        """Contacts with and without the monitor; not passed if one with the monitor is unexplained."""
        tables = safety_tables(results)
        document = {"first": self.first, "count": self.count, "tables": {table.title: table for table in tables}}
        return Report(tables, document, passed=not unexplained(results))


def stopping_distance(speed: float, decel: float) -> float:
    """Return the distance (m) from the scan that shows an obstacle to standstill.

    Dead time and one period at full speed (m/s), then braking with `decel` (m/s²).
    """
    return speed * (DEAD_TIME_S + PERIOD_S) + speed * speed / (2.0 * decel)


def unexplained(results: Sequence[JobResult]) -> list[dict[str, Any]]:
    """Return the contacts with the monitor that nothing explains."""
    return [
        {"scene": result.value["number"], **contact}
        for result in results
        if not result.failed
        for contact in result.value["with"]
        if contact["cause"] == UNEXPLAINED
    ]


def safety_tables(results: Sequence[JobResult]) -> list[Table]:
    """Contacts per robot and obstacle with and without the monitor, their causes, and the stopping distances."""
    values = [result.value for result in results if not result.failed]
    tables = [_rates(values), _causes(values), _bounds()]
    found = unexplained(results)
    if found:
        columns = (Column("scene", "scene"), Column("time", "time s"), Column("obstacle", "obstacle"))
        tables.append(Table(UNEXPLAINED, columns, [{**row, "scene": str(row["scene"])} for row in found]))
    return tables


def _kind_of(contact: dict[str, Any]) -> str:
    name = str(contact["obstacle"])
    return "wall" if name == "map" else "box" if name.startswith("box") else "person"


def _rates(values: Sequence[dict[str, Any]]) -> Table:
    rows: list[dict[str, Any]] = []
    for kind in (*(kind.name for kind in robot_kinds()), "all"):
        mine = [value for value in values if kind in (value["robot"], "all")]
        for which in ("without", "with"):
            contacts = [contact for value in mine for contact in value[which]]
            kinds = Counter(_kind_of(contact) for contact in contacts)
            hit = sum(1 for value in mine if value[which])
            rows.append(
                {
                    "robot": kind,
                    "monitor": "yes" if which == "with" else "no",
                    "scenes": len(mine),
                    "hit": hit,
                    "share": 100.0 * hit / len(mine) if mine else None,
                    **{name: kinds[name] for name in ("wall", "box", "person")},
                    "driven": sum(float(value[f"driven_{which}_m"]) for value in mine) / max(len(mine), 1),
                }
            )
    columns = (
        Column("robot", "robot"),
        Column("monitor", "monitor"),
        Column("scenes", "scenes"),
        Column("hit", "scenes with contacts"),
        Column("share", "%", 1),
        Column("wall", "contacts with walls"),
        Column("box", "with boxes"),
        Column("person", "with people"),
        Column("driven", "m per scene", 2),
    )
    return Table("contacts", columns, rows)


def _causes(values: Sequence[dict[str, Any]]) -> Table:
    contacts = [contact for value in values for contact in value["with"]]
    causes = Counter((str(contact["cause"]), _kind_of(contact)) for contact in contacts)
    rows = [
        {"cause": cause, **{kind: causes[cause, kind] for kind in ("wall", "box", "person")}}
        for cause in sorted({cause for cause, _ in causes} | {UNEXPLAINED})
    ]
    columns = (Column("cause", "contacts with the monitor"), *(Column(k, k) for k in ("wall", "box", "person")))
    return Table("causes", columns, rows)


def _bounds() -> Table:
    rows = [
        {
            "robot": kind.name,
            "speed": kind.max_velocity[0],
            "decel": kind.max_decel[0],
            "distance": stopping_distance(kind.max_velocity[0], kind.max_decel[0]),
        }
        for kind in robot_kinds()
    ]
    columns = (
        Column("robot", "robot"),
        Column("speed", "speed m/s"),
        Column("decel", "deceleration m/s²"),
        Column("distance", "stopping distance m", 3),
    )
    return Table(f"stopping distances ({DURATION_S:g} s per scene)", columns, rows)
