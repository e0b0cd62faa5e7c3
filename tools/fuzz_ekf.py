"""Random inputs for the odometry filter: the covariance must stay positive definite, the state finite.

    python tools/fuzz_ekf.py [COUNT] [--seed N]

Inputs of three sources with values and variances over many orders of magnitude, negative and missing ones, correlations,
gaps, late and repeated stamps. After each input the smallest eigenvalue of the correlation matrix is checked: being positive
definite does not depend on units.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Twist2D
from navstack.localization.ekf import Ekf
from navstack.parameters.models.ekf import STATES, EkfParams


def make() -> Ekf:
    """Return a filter with three sources."""

    def config(*names: str) -> list[bool]:
        return [state in names for state in STATES]

    settings: dict[str, Any] = {
        "odom0_config": config("x", "y", "yaw", "vx", "vy", "vyaw"),
        "imu0_config": config("yaw", "vyaw", "ax", "ay"),
        "pose0_config": config("x", "y", "yaw"),
        "odom0_twist_rejection_threshold": 50.0,
    }
    return Ekf(EkfParams(**settings))


def covariance(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a (3, 3) covariance; one in ten is defective."""
    root = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-6, 4, (3, 1))
    matrix = root @ root.T
    kind = int(rng.integers(40))
    if kind == 0:
        return -matrix
    if kind == 1:
        return np.full((3, 3), np.nan)
    if kind == 2:
        return matrix * 1e290
    if kind == 3:
        matrix[0, 1] = 1e6
    return matrix


def value(rng: np.random.Generator) -> float:
    """Return a number; a few are huge or none."""
    kind = int(rng.integers(60))
    if kind < 3:
        return (math.nan, math.inf, -1e300)[kind]
    return float(rng.normal() * 10.0 ** rng.uniform(-3, 3))


def feed(ekf: Ekf, count: int, seed: int) -> Iterator[bool]:
    """Feed random inputs one by one; yield whether each was used."""
    rng = np.random.default_rng(seed)
    stamp = 0.0
    for _ in range(count):
        stamp += float(rng.choice([0.0, 1e-6, 0.01, 0.02, 0.1, 1.0, 100.0], p=[0.05, 0.05, 0.4, 0.3, 0.15, 0.04, 0.01]))
        at = stamp - 0.03 if rng.random() < 0.05 else stamp
        kind = int(rng.integers(3))
        if kind == 0:
            pose, twist = Pose2D(value(rng), value(rng), value(rng)), Twist2D(value(rng), value(rng), value(rng))
            yield ekf.add_odometry("odom0", at, pose, covariance(rng), twist, covariance(rng))
        elif kind == 1:
            yield ekf.add_pose("pose0", at, Pose2D(value(rng), value(rng), value(rng)), covariance(rng))
        else:
            spread = np.diag(covariance(rng)).tolist()
            push = value(rng), value(rng), spread[2]
            yield ekf.add_imu("imu0", at, (value(rng), spread[0]), (value(rng), spread[1]), push)


def smallest_eigenvalue(matrix: NDArray[np.float64]) -> float:
    """Return the smallest eigenvalue of the correlation matrix; negative for a variance that is not positive."""
    variances = np.diag(matrix)
    if not (np.isfinite(matrix).all() and (variances > 0.0).all()):
        return -1.0
    scale = 1.0 / np.sqrt(variances)
    return float(np.linalg.eigvalsh(matrix * scale[:, None] * scale)[0])


def run(count: int, seed: int) -> tuple[int, float]:
    """Return how many inputs were used, and the smallest eigenvalue after any of them."""
    ekf = make()
    used, least = 0, 1.0
    for fused in feed(ekf, count, seed):
        if fused:
            used += 1
            least = min(least, smallest_eigenvalue(ekf.covariance))
        if not np.isfinite(ekf.state).all():
            return used, -2.0
    return used, least


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    used, least = run(arguments.count, arguments.seed)
    print(f"{arguments.count} inputs, {used} used; smallest eigenvalue of the correlations {least:.3g}")
    raise SystemExit(0 if least > 0.0 else 1)


if __name__ == "__main__":
    main()
