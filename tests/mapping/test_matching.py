"""Matching a scan with surfaces: which points may pull at it, and what a match knows about its position."""

import numpy as np
import pytest

from navstack.core import Transform2D
from navstack.mapping.loops import LEAST_SHARE, position_information, without_chance, worst_direction
from navstack.mapping.matching import Surfaces


def wall(x: np.ndarray, y: np.ndarray, normal: tuple[float, float]) -> np.ndarray:
    """Return points with normals (n, 4)."""
    x, y = np.broadcast_arrays(x, y)
    return np.column_stack((x, y, np.full(x.shape, normal[0]), np.full(x.shape, normal[1]))).astype(np.float64)


# a corridor 2 m wide that ends at x = 3 beside a door, as seen from its other end
SIDES = np.concatenate(
    [
        wall(np.arange(0.0, 3.0, 0.05), np.array(1.0), (0.0, -1.0)),
        wall(np.arange(0.0, 3.0, 0.05), np.array(-1.0), (0.0, 1.0)),
    ]
)
FRONT = wall(np.array(3.0), np.arange(0.3, 1.0, 0.05), (-1.0, 0.0))


@pytest.mark.parametrize("normal", [(0.0, 0.0), (0.0, -1.0)])
def test_points_behind_a_corner_do_not_pull_the_scan_back(normal: tuple[float, float]) -> None:
    surfaces = Surfaces([(np.concatenate([SIDES, FRONT]), Transform2D())])
    behind = wall(np.arange(3.02, 3.11, 0.02), np.array(0.3), normal)
    match = surfaces.align(np.concatenate([SIDES, FRONT, behind]), Transform2D(0.02, 0.01, 0.0))
    assert np.abs(match.pose).max() < 1e-3
    # they are explained all the same: a scan that sees a corner for the first time fits
    assert match.explained == 1.0


def test_noisy_normals_along_a_corridor_tell_nothing_about_the_position_along_it() -> None:
    rng = np.random.default_rng(5)
    noisy = SIDES.copy()
    noisy[:, 1] += rng.normal(0.0, 0.02, len(noisy))
    tilt = rng.normal(0.0, 0.08, len(noisy))
    noisy[:, 2:] = np.column_stack((-np.sin(tilt) * noisy[:, 3], np.cos(tilt) * noisy[:, 3]))
    match = Surfaces([(noisy, Transform2D())]).align(noisy, Transform2D())
    least, most = position_information(match.hessian)
    assert abs(np.cos(worst_direction(match.hessian))) == pytest.approx(1.0, abs=0.01)
    rest, same = position_information(without_chance(match.hessian))
    assert rest < 0.2 * least
    assert same == pytest.approx(most, rel=1e-3)


def test_a_position_that_walls_determine_keeps_its_information() -> None:
    corner = np.concatenate([SIDES, FRONT])
    hessian = Surfaces([(corner, Transform2D())]).align(corner, Transform2D()).hessian
    least, most = position_information(hessian)
    assert position_information(without_chance(hessian))[0] == pytest.approx(least - LEAST_SHARE * most, rel=0.01)
    assert least > 4.0 * LEAST_SHARE * most
