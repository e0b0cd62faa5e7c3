"""How well a robot followed a trajectory: the errors over time, from the record."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.behaviors import InvalidTrajectoryError, Trajectory, demands_of
from navstack.core import Event, InputError, RecordError, Transform2D, normalize_angles
from navstack.record import Record, believed_poses


@dataclass(frozen=True, slots=True, eq=False)
class TrackingReport:
    """A trajectory and how it was followed, at n control cycles. Errors are those of the true pose."""

    id: str
    name: str
    """Name of the trajectory."""
    frame: str
    """Frame in which it was followed: the robot's own estimate is in this frame."""
    begin: float
    """Time at which the trajectory's clock started (s)."""
    duration: float
    """Of the trajectory (s)."""
    t: NDArray[np.float64]
    """(n,) the trajectory's clock (s)."""
    reference: NDArray[np.float64]
    """(n, 3) x, y (m), yaw (rad) in the global frame."""
    poses: NDArray[np.float64]
    """(n, 3) true poses in the global frame."""
    along: NDArray[np.float64]
    """(n,) m; positive: the robot is ahead of the reference."""
    across: NDArray[np.float64]
    """(n,) m; positive: the robot is to the left."""
    heading: NDArray[np.float64]
    """(n,) rad; positive: the robot has turned too far to the left."""
    believed: NDArray[np.float64]
    """(n,) distance from the reference (m) as the robot knew it, by localization or odometry."""
    speed: NDArray[np.float64]
    """(n,) speed of the wheels (m/s)."""
    reference_speed: NDArray[np.float64]
    """(n,) m/s."""

    @property
    def distance(self) -> NDArray[np.float64]:
        """(n,) distance from the reference (m)."""
        return np.hypot(self.along, self.across)

    def statistics(self) -> dict[str, dict[str, float]]:
        """Return mean, root mean square, 95th percentile and maximum of the sizes of the errors."""
        found: dict[str, dict[str, float]] = {}
        for name, values in (
            ("distance_m", self.distance),
            ("along_m", self.along),
            ("across_m", self.across),
            ("heading_rad", self.heading),
            ("believed_m", self.believed),
        ):
            size = np.abs(values)
            found[name] = {
                "mean": float(size.mean()),
                "rms": float(np.sqrt((size**2).mean())),
                "p95": float(np.percentile(size, 95)),
                "max": float(size.max()),
            }
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data, without the curves, which `table` has."""
        worst = int(self.distance.argmax())
        return {
            "id": self.id,
            "name": self.name,
            "frame": self.frame,
            "begin": self.begin,
            "duration": self.duration,
            "followed_s": float(self.t[-1]),
            "worst_at_s": float(self.t[worst]),
            "errors": self.statistics(),
        }

    def table(self) -> str:
        """Return the curves as CSV: time, reference, pose and errors."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(
            [
                *("t", "ref_x", "ref_y", "ref_yaw", "x", "y", "yaw", "along", "across", "heading", "believed"),
                *("speed", "ref_speed"),
            ]
        )
        errors = np.column_stack((self.along, self.across, self.heading, self.believed))
        speeds = np.column_stack((self.speed, self.reference_speed))
        rows = np.column_stack((self.t, self.reference, self.poses, errors, speeds))
        writer.writerows([[f"{value:.6g}" for value in row] for row in rows.tolist()])
        return out.getvalue()


def explain_tracking(record: Record) -> tuple[TrackingReport, ...]:
    """Return a report of every trajectory that was followed in a run. Raises RecordError for a run without one."""
    begun: dict[str, Event] = {}
    found: list[TrackingReport] = []
    for event in record.events_of("motion"):
        if "trajectory" in event.data:
            begun[str(event.data["id"])] = event
        elif event.data.get("id") in begun and "clock_s" in event.data:
            report = _report(record, begun[str(event.data["id"])], float(event.data["clock_s"]), event.time)
            if report is not None:
                found.append(report)
    if not found:
        raise RecordError(
            f"{record.path or 'the record'} contains no trajectory that was followed; record one with `navstack follow`"
        )
    return tuple(found)


def choose_tracking(reports: Sequence[TrackingReport], number: int) -> TrackingReport:
    """Return report `number` (from 1). Raises InputError for an unknown number."""
    if not 1 <= number <= len(reports):
        known = "one trajectory" if len(reports) == 1 else f"{len(reports)} trajectories"
        raise InputError(f"--trajectory {number}: this run has {known}", argument="--trajectory", value=number)
    return reports[number - 1]


def _report(record: Record, start: Event, clock: float, end: float) -> TrackingReport | None:
    try:
        trajectory = Trajectory.from_dict(start.data["trajectory"])
    except InvalidTrajectoryError as exc:
        raise RecordError(f"{record.path or 'the record'} is damaged: {exc.message}") from exc
    frame = str(start.data.get("frame", record.global_frame))
    to_map = Transform2D()
    if frame == record.local_frame != record.global_frame:
        # where the robot believed the frame of the odometry to be when it placed the trajectory
        to_map = record.map_to_odom_at(start.time)
    rows = slice(
        int(np.searchsorted(record.times, clock - 1e-9)), int(np.searchsorted(record.times, end + 1e-9, side="right"))
    )
    t = record.times[rows] - clock
    rows = slice(rows.start, rows.start + int(np.searchsorted(t, trajectory.duration + 1e-9, side="right")))
    t = record.times[rows] - clock
    if not len(t):
        return None
    local = trajectory.poses(t)
    reference = to_map.apply_poses(local)
    poses = record.poses[rows]
    c, s = np.cos(reference[:, 2]), np.sin(reference[:, 2])
    dx, dy = poses[:, 0] - reference[:, 0], poses[:, 1] - reference[:, 1]
    return TrackingReport(
        id=str(start.data["id"]),
        name=trajectory.name or "trajectory",
        frame=frame,
        begin=clock,
        duration=trajectory.duration,
        t=t,
        reference=reference,
        poses=poses,
        along=c * dx + s * dy,
        across=c * dy - s * dx,
        heading=normalize_angles(poses[:, 2] - reference[:, 2]),
        believed=_believed(record, rows, local, frame),
        speed=np.hypot(*record.velocities[rows, :2].T),
        reference_speed=np.interp(t, demands_of(trajectory).t, demands_of(trajectory).speed),
    )


def _believed(record: Record, rows: slice, reference: NDArray[np.float64], frame: str) -> NDArray[np.float64]:
    """Return (n,) distances from the reference as the robot knew them (m)."""
    at = (record.odom_poses if frame == record.local_frame else believed_poses(record))[rows]
    return np.hypot(at[:, 0] - reference[:, 0], at[:, 1] - reference[:, 1])
