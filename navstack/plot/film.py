"""The frames of an animated run.

The background is drawn once. Each frame restores it and draws a dozen artists over it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Transform2D
from navstack.plot import colors, drawing, legend
from navstack.plot.estimates import EstimateArtists, has_estimates
from navstack.plot.film_layers import CostmapLayer, Stamp
from navstack.plot.obstacles import draw_obstacles, obstacle_patches, obstacles_moved
from navstack.plot.picture import Picture
from navstack.plot.run import area_of_run, draw_ends, draw_map, incidents
from navstack.plot.steering import wheel_lines
from navstack.record import Record

Entries = list[tuple[Any, str]]
_CURRENT_S = 0.5
"""Largest age of a trajectory that is shown (s): some control cycles."""


class Film:
    """Draws the frame of any time as pixels (h, w, 3) uint8. Frames in the order of time are fastest."""

    def __init__(self, record: Record, title: str, dpi: float) -> None:
        self._record = record
        self._picture = Picture(area_of_run(record), title=title, subtitle=" ")
        self._picture.figure.set_dpi(dpi)
        axes: Any = self._picture.axes
        draw_map(axes, record, self._picture.area)
        self._layers = [
            CostmapLayer(axes, record, name, self._picture.area)
            for name in ("global", "local")
            if len(record.costmap_times(name))
        ]
        before = set(map(id, axes.get_children()))
        obstacles = draw_obstacles(axes, record, moving=False)
        ends = draw_ends(axes, record, self._picture.points_per_m)
        marks = sorted((a for a in axes.get_children() if id(a) not in before), key=lambda a: a.get_zorder())
        for artist in marks:
            artist.set_animated(True)
        self._obstacles = _MovingObstacles(axes, record)
        self._robot = _RobotArtists(axes, record)
        self._incidents = _IncidentArtists(axes, record)
        self._beliefs = EstimateArtists(axes, record) if has_estimates(record) else None
        beliefs = [] if self._beliefs is None else self._beliefs.entries()
        self._add_legend(
            self._robot.entries() + beliefs + obstacles + self._obstacles.entries() + ends + self._incidents.entries()
        )
        self._status = self._picture.subtitle
        self._status.set_animated(True)
        surface = self._picture.canvas
        surface.draw()  # without animated artists: the background of every frame
        self._background = surface.copy_from_bbox(self._picture.figure.bbox)
        self._marks = Stamp(surface, axes, marks)

    def _add_legend(self, entries: Entries) -> None:
        bands, texts = legend.cost_legend(None) if self._layers else legend.occupancy_legend()
        if any(layer.name == "local" for layer in self._layers):
            entries = [*entries, (legend.frame_handle(), "local costmap")]
        box = self._picture.legend([h for h, _ in entries] + bands, [label for _, label in entries] + texts)
        for handle in box.legend_handles:
            handle.set_animated(False)  # handles inherit it from the artists, and would not be part of the background

    def frame(self, t: float) -> NDArray[np.uint8]:
        """Returns the pixels of the run at time `t` (s)."""
        axes = self._picture.axes
        self._robot.move_to(t)
        self._incidents.move_to(t)
        self._obstacles.move_to(t)
        below, above = (), ()
        if self._beliefs is not None:
            self._beliefs.move_to(t)
            below, above = self._beliefs.below, self._beliefs.above
        self._status.set_text(self._status_text(t))
        surface = self._picture.canvas
        surface.restore_region(self._background)
        for layer in self._layers:
            layer.draw(t, self._picture)
        for artist in (*self._obstacles.patches, *self._robot.paths, *below):
            axes.draw_artist(artist)
        self._marks.press(surface)
        incidents_, collisions = self._incidents.markers
        for artist in (*self._robot.body, *above, incidents_, collisions):
            axes.draw_artist(artist)
        self._picture.figure.draw_artist(self._status)
        return np.asarray(surface.buffer_rgba())[:, :, :3].copy()

    def _status_text(self, t: float) -> str:
        record = self._record
        i = record.index_at(t)
        v = record.velocities[i]
        goal = int(record.goal_indices[i])
        return (
            f"{t - float(record.times[0]):.1f} s    {record.states[i]}"
            + (f"    goal {goal + 1}" if goal >= 0 else "")
            + f"    {np.hypot(v[0], v[1]):.2f} m/s  {v[2]:+.2f} rad/s"
            + ("" if self._beliefs is None else self._beliefs.status(t))
            + ("" if record.steered_base is None else f"    steering {record.steering[i]:+.2f} rad")
        )


class _RobotArtists:
    """The robot with its driven path, plan and trajectory."""

    def __init__(self, axes: Any, record: Record) -> None:
        self._record = record
        options: dict[str, Any] = {"animated": True}
        empty = np.empty((0, 2))
        self._plan = drawing.draw_line(axes, empty, colors.PLAN, width=1.8, zorder=4, **options)
        self._driven = drawing.draw_line(axes, empty, colors.DRIVEN, width=2.2, casing=True, zorder=5, **options)
        self._local = drawing.draw_line(axes, empty, colors.GREEN, width=4.0, casing=True, zorder=5.5, **options)
        self._footprint = drawing.draw_footprint(axes, record.footprint, Pose2D(0.0, 0.0), zorder=6)
        self._footprint.set(animated=True, facecolor=colors.FOOTPRINT, linewidth=1.4)
        self._heading = drawing.draw_line(axes, empty, colors.BLACK, width=1.6, zorder=6.1, **options)
        (self._scan,) = axes.plot([], [], ".", ms=3.0, color=colors.SCAN, ls="none", zorder=4.5, **options)
        self._wheels = drawing.draw_line(axes, empty, colors.INK, width=3.0, zorder=6.2, **options)
        self.paths = (self._scan, self._plan, self._driven, self._local)
        self.body = (self._footprint, self._heading, self._wheels)

    def entries(self) -> Entries:
        """Returns the entries of the legend."""
        entries: Entries = [(self._driven, "driven path"), (self._plan, "plan")]
        if (self._record.arrays["local_plans"]["poses"] > 0).any():
            entries.append((self._local, "chosen trajectory"))
        if len(self._record.scans):
            entries.append((self._scan, "scan"))
        return [*entries, (self._footprint, "footprint")]

    def move_to(self, t: float) -> None:
        """Sets the artists to their state at time `t` (s)."""
        record = self._record
        i = record.index_at(t)
        pose = drawing.pose_of(record.poses[i])
        self._driven.set_data(*record.poses[: i + 1, :2].T)
        plan = record.plan_at(t)
        points = np.empty((0, 3)) if plan is None else record.to_global(plan.frame, plan.t).apply_poses(plan.poses)
        self._plan.set_data(*points[:, :2].T)
        local = record.local_plan_at(t)
        # an older one is no longer driven: the robot plans, recovers or has arrived
        trajectory = None if local is None or t - local.t > _CURRENT_S else local.plan.trajectory
        points = np.empty((0, 3)) if trajectory is None else self._local_frame(t).apply_poses(trajectory)
        self._local.set_data(*points[:, :2].T)
        scans = [scan.points for scan in record.scans_at(t)]
        self._scan.set_data(*np.concatenate([np.empty((0, 2)), *scans]).T)
        self._footprint.set_xy(record.footprint.at(pose))
        if record.steered_base is not None:
            self._wheels.set_data(*wheel_lines(record, i).T)
        reach = record.footprint.circumscribed_radius
        self._heading.set_data([pose.x, pose.x + reach * np.cos(pose.yaw)], [pose.y, pose.y + reach * np.sin(pose.yaw)])

    def _local_frame(self, t: float) -> Transform2D:
        return self._record.to_global(self._record.costmap_frame("local"), t)


class _IncidentArtists:
    """Markers of recoveries and collisions."""

    def __init__(self, axes: Any, record: Record) -> None:
        self._record = record
        self._times = np.array([event.time for event in incidents(record)])
        self._points = np.array([record.pose_at(t)[:2] for t in self._times]).reshape(-1, 2)
        options: dict[str, Any] = {"animated": True, "ls": "none"}
        (recoveries,) = drawing.draw_rings(axes, np.empty((0, 2)), colors.RECOVERY, animated=True)
        (collisions,) = axes.plot([], [], "X", ms=11, color=colors.COLLISION, mec="black", mew=1.1, **options)
        self.markers = (recoveries, collisions)

    def entries(self) -> Entries:
        """Returns the entries of the legend."""
        occurred = (len(self._points) > 0, len(self._record.collisions) > 0)
        handles = (drawing.ring_handle(colors.RECOVERY), self.markers[1])
        named = zip(occurred, handles, ("recovery", "collision"), strict=True)
        return [(marker, name) for any_, marker, name in named if any_]

    def move_to(self, t: float) -> None:
        """Shows the incidents until time `t` (s)."""
        record = self._record
        recoveries, collisions = self.markers
        recoveries.set_data(*self._points[self._times <= t].T)
        collisions.set_data(*record.collisions[record.collision_times <= t, :2].T)


class _MovingObstacles:
    """Patches of the obstacles that move during the run."""

    def __init__(self, axes: Any, record: Record) -> None:
        self._record = record
        self._rows = [k for k, moved in enumerate(obstacles_moved(record)) if moved]
        _, self.patches = obstacle_patches(record, float(record.times[0]))
        for patch in self.patches:
            patch.set_animated(True)
            axes.add_patch(patch)

    def entries(self) -> Entries:
        """Returns the entry of the legend; empty without moving obstacles."""
        return [(self.patches[0], "moving obstacle")] if self.patches else []

    def move_to(self, t: float) -> None:
        """Moves the patches to their places at time `t` (s)."""
        discs, polygons = self._record.solids_at(t, absent=True)
        for patch, k in zip(self.patches, self._rows, strict=True):
            if k < len(discs):
                patch.set_center(discs[k, :2])
            else:
                patch.set_xy(polygons[k - len(discs)])
