"""Why no sample was legal, in a sentence and in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, describe_cost
from navstack.interfaces import Critic, Rollouts
from navstack.local_planner.critics.obstacle import ObstacleCritic
from navstack.local_planner.scoring import NEVER, ScoreTable


def rejections(table: ScoreTable, critics: Sequence[Critic]) -> dict[str, int]:
    """How many samples each critic rejected, most first; `too slow or too fast` are those that never were trajectories."""
    counted = {critic.name: int((table.rejected_by == i).sum()) for i, critic in enumerate(critics)}
    counted["too slow or too fast"] = int((table.rejected_by == NEVER).sum())
    return {name: n for name, n in sorted(counted.items(), key=lambda item: -item[1]) if n}


def first_contact(
    critic: ObstacleCritic, rollouts: Rollouts, rejected: NDArray[np.bool_]
) -> tuple[int, int, float] | None:
    """(row, point, metres travelled) of the collision nearest to the robot among the rows `rejected`."""
    where = critic.first_contact
    found: tuple[int, int, float] | None = None
    for k in np.flatnonzero(rejected & (where >= 0)):
        step = int(where[k])
        along = rollouts.poses[k, : step + 1, :2]
        travelled = float(np.hypot(*np.diff(along, axis=0).T).sum()) if step else 0.0
        if found is None or travelled < found[2]:
            found = int(k), step, travelled
    return found


def cell_hit(costmap: Costmap, footprint: Footprint, pose: Pose2D, scale: float) -> tuple[int, int, int] | None:
    """(ix, iy, cost) of a cell of at least 254 under the outline at `pose`; None when it only leaves the map."""
    g = costmap.geometry
    corners = Footprint(footprint.vertices * scale).at(pose)
    closed = np.vstack((corners, corners[:1]))
    for a, b in pairwise(closed):
        # half a cell a step: finds every cell that the walk along the edge can hit, give or take its corners
        steps = max(2, int(np.ceil(np.hypot(*(b - a)) / (0.5 * g.resolution))) + 1)
        for x, y in zip(np.linspace(a[0], b[0], steps), np.linspace(a[1], b[1], steps)):
            cell = g.world_to_cell(float(x), float(y))
            if cell is not None and costmap.data[cell[1], cell[0]] >= 254:
                return cell[0], cell[1], int(costmap.data[cell[1], cell[0]])
    return None


def no_valid_control(
    table: ScoreTable,
    critics: Sequence[Critic],
    rollouts: Rollouts,
    targets: NDArray[np.float64],
    costmap: Costmap,
    footprint: Footprint,
    max_speed: float,
) -> tuple[str, dict[str, Any]]:
    """The sentence and the data of a NoValidControlError."""
    k = len(table.totals)
    counted = rejections(table, critics)
    parts: list[str] = []
    data: dict[str, Any] = {"samples": k, "rejected": counted}
    for name, number in counted.items():
        detail = ""
        index = next((i for i, c in enumerate(critics) if c.name == name), None)
        if index is not None:
            critic = critics[index]
            rejected = table.rejected_by == index
            if isinstance(critic, ObstacleCritic):
                hit = first_contact(critic, rollouts, rejected)
                if hit is not None:
                    row, step, travelled = hit
                    pose = Pose2D(*(float(v) for v in rollouts.poses[row, step]))
                    speed = float(np.hypot(rollouts.samples[row, 0], rollouts.samples[row, 1]))
                    cell = cell_hit(costmap, footprint, pose, critic.footprint_scale(speed, max_speed))
                    on = f"on {describe_cost(cell[2])}" if cell else "off the map"
                    at = f"{travelled:.2f} m ahead" if travelled > 0.0 else "where it stands"
                    detail = f" (footprint {on} {at})"
                    data["contact"] = {
                        "ahead_m": travelled,
                        "pose": list(pose),
                        "step": step,
                        "sample": targets[row].tolist(),
                        "cell": [cell[0], cell[1]] if cell else None,
                        "cost": cell[2] if cell else None,
                    }
            else:
                codes = sorted({int(c) for c in table.totals[rejected] if np.isfinite(c)})
                words = [critic.CODES[c] for c in codes if c in critic.CODES]
                detail = f" ({'; '.join(words)})" if words else ""
        parts.append(f"{number} {name}{detail}")
    return f"{sum(counted.values())} of {k} rejected: {', '.join(parts)}", data
