# pyright: basic
"""What trajectories cost under the robot's centre (Nav2's BaseObstacleCritic)."""

from __future__ import annotations

from navstack.core.jit import kernel

HITS, LEAVES = -6.0, -4.0  # the critic's codes


@kernel
def center_costs(costs, cells, counts, alive, sum_scores, out):
    """Cost of each trajectory's last cell, or the sum of all its points'; HITS or LEAVES, whichever comes first.

    `cells` (K, T): flat, -1 off the map.
    """
    flat = costs.ravel()
    for k in range(len(counts)):
        if not alive[k]:
            continue
        score = 0.0
        for i in range(counts[k]):
            if cells[k, i] < 0:
                score = LEAVES
                break
            cost = flat[cells[k, i]]
            if cost >= 253:
                score = HITS
                break
            score = score + cost if sum_scores else float(cost)
        out[k] = score
