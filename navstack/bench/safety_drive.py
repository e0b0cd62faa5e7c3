"""Drives a scene of the safety search with or without the collision monitor, and explains each contact.

The monitor takes obstacles for static. So it guarantees no contact with a static obstacle that was seen while the robot could
still brake; what moves can touch the robot by its own motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from navstack.bench.contact_causes import MIN_POINTS, Braking, Moment, cause_of, sight_of
from navstack.bench.safety_scene import (
    DEAD_TIME_S,
    DURATION_S,
    PERIOD_S,
    HostileSource,
    SafetyScene,
    room,
    safety_scene,
)
from navstack.core import LaserScan, Twist2D
from navstack.parameters.models.collision_monitor import CollisionMonitorParams, MonitorSourceParams, ZoneParams
from navstack.safety import CollisionMonitor, CommandChain
from navstack.sim import Collision, SimulatedRobot, World


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
        world = World(room(), shapes=self.scene.shapes)
        self.robot = SimulatedRobot(self.scene.sim, world, self.scene.robot.footprint, self.scene.start, seed=number)
        monitor = build_monitor(self.scene, self.robot) if monitored else None
        self.chain = CommandChain(self.robot, monitor=monitor)
        self.moments: list[Moment] = []
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
    cause = cause_of(braking(drive.scene), moments, collision)
    return Contact(collision.time, collision.name or collision.kind, cause)
