"""Why a cell of a costmap has its cost, in one sentence and layer by layer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from navstack.core import FREE, UNKNOWN, Pose2D, describe_cost
from navstack.core.errors import InputError
from navstack.explain.replay import Replay
from navstack.interfaces import CellProvenance, LayerShare


@dataclass(frozen=True, slots=True)
class CellExplanation:
    """The account of one cell at one time."""

    provenance: CellProvenance
    time: float
    """Of the control cycle it is about (s)."""
    asked: tuple[float, float]
    """The point that was asked for (m, in the map)."""
    frame: str
    """The costmap's frame, in which all coordinates of the provenance are."""
    robot: Pose2D
    """Where the robot stood (map)."""
    verdict: str
    """In one sentence."""

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "time": self.time,
            "at": list(self.asked),
            "frame": self.frame,
            "robot": list(self.robot),
            "verdict": self.verdict,
            "distance_m": distance_of(self.provenance),
            **{key: value for key, value in self.provenance.as_dict().items() if key not in ("at", "text")},
            "centre": [self.provenance.x, self.provenance.y],
        }


def explain_cell_at(replayed: Replay, x: float, y: float, *, costmap: str = "global") -> CellExplanation:
    """The cell at a point of the map (m) of the `global` or `local` costmap, as it stood.

    The local costmap lives in odometry's frame: the point is taken there as the robot believed it to lie. Raises
    InputError, with the extent, for a point off the costmap.
    """
    live = replayed.costmap(costmap)
    to_map = replayed.to_map(costmap)
    (point,) = to_map.inverse().apply_points(_row(x, y)).tolist()
    if live.updated_at is None:
        raise InputError(
            f"the {costmap} costmap had not been updated yet at {replayed.time:.3f} s; give a later --time"
        )
    if live.master.geometry.world_to_cell(*point) is None:
        left, right, bottom, top = live.master.geometry.extent
        moved = "" if to_map.is_identity() else f", where the point is ({point[0]:.2f}, {point[1]:.2f})"
        raise InputError(
            f"({x:g}, {y:g}) is off the {costmap} costmap at {replayed.time:.3f} s, which covers x {left:.2f} .. {right:.2f}, "
            f"y {bottom:.2f} .. {top:.2f} m in {live.frame}{moved}",
            at=[x, y],
            extent=[left, right, bottom, top],
            frame=live.frame,
        )
    told = live.explain_cell(*point)
    robot = replayed.run.robot.pose
    return CellExplanation(told, replayed.time, (x, y), live.frame, robot, verdict_on(told))


def distance_of(told: CellProvenance) -> float | None:
    """Distance to the obstacle whose inflation the cell shows (m); None when it shows none."""
    share = _setter(told)
    if told.obstacle is None or share is None or share.explanation is None:
        return None
    return float(share.explanation.data["distance_m"])


def verdict_on(told: CellProvenance) -> str:
    """The account in one sentence."""
    if told.stale:
        by_now = told.layers[-1].after if told.layers else told.cost
        return (
            f"{describe_cost(told.cost)}: left over from an earlier update; the next one that touches this cell writes "
            f"{describe_cost(by_now)}: {_cause(told, by_now)}"
        )
    return f"{describe_cost(told.cost)}: {_cause(told, told.cost)}"


def _cause(told: CellProvenance, cost: int) -> str:
    if cost == FREE:
        said = [
            f"{s.layer}: {s.explanation.text}"
            for s in told.layers
            if s.explanation is not None and s.explanation.cost == FREE
        ]
        return "; ".join(said) or "no layer wrote here, and free is the default"
    share = _setter(told)
    if share is None:
        return "no layer wrote here" + (": nobody has looked" if cost == UNKNOWN else "")
    distance = distance_of(told)
    if told.obstacle is not None and distance is not None:
        obstacle = told.obstacle
        where = f"{distance:.2f} m from the lethal cell at ({obstacle.x:.2f}, {obstacle.y:.2f})"
        maker = _setter(obstacle)
        return where + (f", which {_marked(maker)}" if maker is not None else "")
    return _marked(share)


def _marked(share: LayerShare) -> str:
    """`obstacle_layer marked from "scan" at 12.300 s`."""
    found = share.explanation
    if found is None or found.source is None:
        return f"{share.layer} wrote" + (f" ({found.text})" if found is not None else "")
    if found.stamp is None:
        return f"{share.layer} took from the {found.source}"
    return f'{share.layer} marked from "{found.source}" at {found.stamp:.3f} s'


def _setter(told: CellProvenance) -> LayerShare | None:
    return next((share for share in told.layers if share.layer == told.set_by), None)


def _row(x: float, y: float) -> Any:
    import numpy as np

    return np.array([[x, y]])
