"""Why a cell of a costmap has its cost: one sentence, and the contribution of every layer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navstack.core import FREE, UNKNOWN, InputError, Pose2D, describe_cost
from navstack.explain.resimulation import Replay
from navstack.plugins import CellProvenance, LayerShare


@dataclass(frozen=True, slots=True)
class CellReport:
    """The cost of one cell at one time, and where it comes from."""

    provenance: CellProvenance
    time: float
    """Time of the control cycle (s)."""
    point: tuple[float, float]
    """The requested point (m, map frame)."""
    frame: str
    """Frame of the costmap and of all coordinates in the provenance."""
    robot: Pose2D
    """Pose of the robot (map frame)."""
    summary: str
    """The cost and its cause in one sentence."""

    def as_dict(self) -> dict[str, Any]:
        """Return the report for JSON."""
        return {
            "time": self.time,
            "at": list(self.point),
            "frame": self.frame,
            "robot": list(self.robot),
            "summary": self.summary,
            "distance_m": obstacle_distance(self.provenance),
            **{key: value for key, value in self.provenance.as_dict().items() if key not in ("at", "text")},
            "centre": [self.provenance.x, self.provenance.y],
        }


def explain_cell(replayed: Replay, x: float, y: float, *, costmap: str = "global") -> CellReport:
    """Explain the cell at a point of the map frame (m) in the `global` or `local` costmap, at the time of the replay.

    For a costmap in another frame, the point is transformed with the robot's localization at that time. Raises InputError
    for a point outside the costmap.
    """
    live = replayed.costmap(costmap)
    to_map = replayed.to_map(costmap)
    (point,) = to_map.inverse().apply_points(np.array([[x, y]])).tolist()
    if live.updated_at is None:
        raise InputError(f"the {costmap} costmap has no update until {replayed.time:.3f} s; give a later --time")
    if live.master.geometry.world_to_cell(*point) is None:
        left, right, bottom, top = live.master.geometry.extent
        moved = "" if to_map.is_identity() else f", where the point is ({point[0]:.2f}, {point[1]:.2f})"
        raise InputError(
            f"({x:g}, {y:g}) is outside the {costmap} costmap at {replayed.time:.3f} s, which covers "
            f"x {left:.2f} .. {right:.2f}, y {bottom:.2f} .. {top:.2f} m in {live.frame}{moved}",
            at=[x, y],
            extent=[left, right, bottom, top],
            frame=live.frame,
        )
    provenance = live.explain_cell(*point)
    robot = replayed.robot_pose
    return CellReport(provenance, replayed.time, (x, y), live.frame, robot, summary_of(provenance))


def obstacle_distance(provenance: CellProvenance) -> float | None:
    """Return the distance to the obstacle that the cell is inflated from (m); None for a cell without inflation."""
    share = _setter(provenance)
    if provenance.obstacle is None or share is None or share.explanation is None:
        return None
    return float(share.explanation.data["distance_m"])


def summary_of(provenance: CellProvenance) -> str:
    """Return the cost of a cell and its cause, in one sentence."""
    if not provenance.stale:
        return f"{describe_cost(provenance.cost)}: {_cause(provenance, provenance.cost)}"
    current = provenance.layers[-1].after if provenance.layers else provenance.cost
    return (
        f"{describe_cost(provenance.cost)}: left from an earlier update; the next update of this cell writes "
        f"{describe_cost(current)}: {_cause(provenance, current)}"
    )


def _cause(provenance: CellProvenance, cost: int) -> str:
    if cost == FREE:
        return _why_free(provenance)
    share = _setter(provenance)
    if share is None:
        return "no layer wrote this cell" + (", it was never observed" if cost == UNKNOWN else "")
    distance = obstacle_distance(provenance)
    if provenance.obstacle is None or distance is None:
        return _source(share)
    obstacle = provenance.obstacle
    text = f"{distance:.2f} m from the lethal cell at ({obstacle.x:.2f}, {obstacle.y:.2f})"
    setter = _setter(obstacle)
    return text + (f", {_source(setter)}" if setter is not None else "")


def _why_free(provenance: CellProvenance) -> str:
    texts = [
        f"{s.layer}: {s.explanation.text}"
        for s in provenance.layers
        if s.explanation is not None and s.explanation.cost == FREE
    ]
    return "; ".join(texts) or "no layer wrote this cell, free by default"


def _source(share: LayerShare) -> str:
    """`marked by obstacle_layer from "scan" at 12.300 s`."""
    found = share.explanation
    if found is None or found.source is None:
        return f"written by {share.layer}" + (f" ({found.text})" if found is not None else "")
    if found.stamp is None:
        return f"copied by {share.layer} from the {found.source}"
    return f'marked by {share.layer} from "{found.source}" at {found.stamp:.3f} s'


def _setter(provenance: CellProvenance) -> LayerShare | None:
    """Return the layer that set the cost."""
    return next((share for share in provenance.layers if share.layer == provenance.set_by), None)
