"""Why samples were rejected, in a sentence and in numbers."""

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


def first_collision(
    critic: ObstacleCritic, rollouts: Rollouts, rejected: NDArray[np.bool_]
) -> tuple[int, int, float] | None:
    """(row, point, metres travelled) of the collision nearest to the robot among the rows `rejected`."""
    where = critic.first_collision
    found: tuple[int, int, float] | None = None
    for k in np.flatnonzero(rejected & (where >= 0)):
        step = int(where[k])
        along = rollouts.poses[k, : step + 1, :2]
        travelled = float(np.hypot(*np.diff(along, axis=0).T).sum()) if step else 0.0
        if found is None or travelled < found[2]:
            found = int(k), step, travelled
    return found


def first_lethal_cell(
    costmap: Costmap, footprint: Footprint, pose: Pose2D, scale: float
) -> tuple[int, int, int] | None:
    """(ix, iy, cost) of the first cell of at least 254 on the walk along the outline; None when it only leaves the map.

    The same walk as the obstacle kernel's: from vertex to vertex (Bresenham), the longer axis leading.
    """
    g = costmap.geometry
    corners = Footprint(footprint.vertices * scale).at(pose)
    cells = np.floor((corners - (g.origin_x, g.origin_y)) / g.resolution).astype(np.int64).tolist()
    for (x0, y0), (x1, y1) in pairwise([*cells, cells[0]]):
        dx, dy = x1 - x0, y1 - y0
        steps, add = max(abs(dx), abs(dy)), min(abs(dx), abs(dy))
        step_x, step_y = (1 if dx >= 0 else -1), (1 if dy >= 0 else -1)
        for m in range(steps + 1):
            side = (steps // 2 + m * add) // max(steps, 1)
            along_x = abs(dx) >= abs(dy)
            ix = x0 + (m if along_x else side) * step_x
            iy = y0 + (side if along_x else m) * step_y
            if 0 <= ix < g.nx and 0 <= iy < g.ny and costmap.data[iy, ix] >= 254:
                return ix, iy, int(costmap.data[iy, ix])
    return None


def rejection_report(
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
                hit = first_collision(critic, rollouts, rejected)
                if hit is not None:
                    row, step, travelled = hit
                    pose = Pose2D(*(float(v) for v in rollouts.poses[row, step]))
                    speed = float(np.hypot(rollouts.samples[row, 0], rollouts.samples[row, 1]))
                    cell = first_lethal_cell(costmap, footprint, pose, critic.footprint_scale(speed, max_speed))
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
    total = f"{sum(counted.values())} of {k} rejected"
    return f"{total}: {', '.join(parts)}" if parts else total, data


def rejection_details(
    table: ScoreTable,
    critics: Sequence[Critic],
    rollouts: Rollouts,
    costmap: Costmap,
    footprint: Footprint,
    max_speed: float,
) -> list[dict[str, Any]]:
    """For every sample `rejected_by` (a critic's name or None) and `reason`; for collisions `step`, `pose`, `ahead_m`, `cell`."""
    accounts: list[dict[str, Any]] = []
    for k, by in enumerate(table.rejected_by.tolist()):
        if by == -1:
            accounts.append({"rejected_by": None, "reason": ""})
            continue
        if by == NEVER:
            accounts.append({"rejected_by": "limits", "reason": "too slow or too fast"})
            continue
        critic = critics[by]
        code = table.totals[k]
        reason = critic.CODES.get(int(code), "") if np.isfinite(code) else ""
        account: dict[str, Any] = {"rejected_by": critic.name, "reason": reason}
        if isinstance(critic, ObstacleCritic) and critic.first_collision[k] >= 0:
            step = int(critic.first_collision[k])
            along = rollouts.poses[k, : step + 1, :2]
            pose = Pose2D(*(float(v) for v in rollouts.poses[k, step]))
            speed = float(np.hypot(rollouts.samples[k, 0], rollouts.samples[k, 1]))
            cell = first_lethal_cell(costmap, footprint, pose, critic.footprint_scale(speed, max_speed))
            account |= {
                "reason": f"footprint on {describe_cost(cell[2])}" if cell else "footprint off the map",
                "step": step,
                "pose": list(pose),
                "ahead_m": float(np.hypot(*np.diff(along, axis=0).T).sum()) if step else 0.0,
                "cell": [cell[0], cell[1]] if cell else None,
                "cost": cell[2] if cell else None,
            }
        accounts.append(account)
    return accounts
