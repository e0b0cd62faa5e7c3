from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import Bounds, Costmap, Footprint, GridGeometry, Path, Pose2D, Transform2D, Window, normalize_angle
from navstack.core.errors import InputError
from tests.conftest import golden_files


@settings(deadline=None)
@given(st.floats(-1e4, 1e4))
def test_normalized_angles_are_in_the_half_open_interval(angle: float) -> None:
    turned = normalize_angle(angle)
    assert -math.pi < turned <= math.pi
    assert math.isclose(math.cos(turned), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(turned), math.sin(angle), abs_tol=1e-9)


def test_minus_pi_is_normalized_to_pi() -> None:
    assert normalize_angle(math.pi) == math.pi
    assert normalize_angle(-math.pi) == math.pi
    turned = Transform2D(0, 0, math.pi).apply_poses(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, math.pi]]))
    assert turned[0, 2] == math.pi
    assert abs(turned[1, 2]) < 1e-12


@settings(deadline=None)
@given(st.integers(0, 79), st.integers(0, 49), st.sampled_from([0.05, 0.1, 0.025, 1.0]), st.floats(-50, 50))
def test_cells_round_trip(ix: int, iy: int, resolution: float, origin: float) -> None:
    geometry = GridGeometry(80, 50, resolution, origin, -origin)
    assert geometry.world_to_cell(*geometry.cell_to_world(ix, iy)) == (ix, iy)


def test_points_outside_or_not_finite_have_no_cell() -> None:
    geometry = GridGeometry(4, 3, 0.5)
    assert geometry.world_to_cell(1.99, 1.49) == (3, 2)
    for point in [(-1e-9, 0), (2.0, 0), (0, 1.5), (math.nan, 0), (0, math.inf)]:
        assert geometry.world_to_cell(*point) is None
    assert geometry.world_to_cell_unbounded(-0.1, 2.0) == (-1, 4)


def test_window_of_bounds_includes_both_corners_and_is_clipped() -> None:
    geometry = GridGeometry(10, 10, 1.0)
    assert geometry.window_of(Bounds(1.5, 2.5, 3.5, 3.5)) == Window(1, 2, 4, 4)
    assert geometry.window_of(Bounds(-5, -5, 50, 50)) == geometry.window
    assert geometry.window_of(Bounds()).is_empty


@pytest.mark.parametrize("resolution", [0.0, -1.0, math.nan, math.inf])
def test_resolution_must_be_positive(resolution: float) -> None:
    with pytest.raises(InputError, match="resolution"):
        GridGeometry(1, 1, resolution)


def test_costmap_rejects_the_wrong_array() -> None:
    with pytest.raises(InputError, match="uint8"):
        Costmap(GridGeometry(3, 2, 1.0), np.zeros((3, 2), np.uint8))


def test_path_length_and_shape() -> None:
    path = Path(np.array([[0.0, 0, 0], [3, 4, 0], [3, 5, 0]]))
    assert path.length == 6.0
    assert path[1] == Pose2D(3, 4, 0)
    with pytest.raises(InputError, match="shape"):
        Path(np.zeros((3, 2)))


@pytest.mark.parametrize("file", golden_files("primitives.npz"), ids=lambda f: f.name)
def test_footprint_radii_match_cpp(file) -> None:
    with np.load(file) as data:
        for radius, padding, inscribed, circumscribed in data["footprint_radius"]:
            footprint = Footprint.from_radius(radius, padding)
            assert footprint.inscribed_radius == pytest.approx(inscribed, abs=1e-12)
            assert footprint.circumscribed_radius == pytest.approx(circumscribed, abs=1e-12)


@pytest.mark.parametrize("file", golden_files("costmap_seq_*.npz"), ids=lambda f: f.name)
def test_padded_footprint_matches_cpp(file) -> None:
    with np.load(file) as data:
        np.testing.assert_allclose(Footprint.from_radius(0.18, 0.01).vertices, data["footprint"], atol=1e-12)


@pytest.mark.parametrize(
    ("points", "match"),
    [
        ([[0, 0], [1, 0]], "at least three points"),
        ([[0, 0], [1, 0], [2, 0]], "area"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "crosses itself"),
        ([[0, 0], [1, 0], [math.nan, 1]], "finite"),
    ],
)
def test_invalid_footprints_are_rejected(points: list[list[float]], match: str) -> None:
    with pytest.raises(InputError, match=match):
        Footprint(np.array(points, float))


def test_footprint_at_a_pose() -> None:
    footprint = Footprint(np.array([[1.0, 0.0], [-1.0, 1.0], [-1.0, -1.0]]))
    np.testing.assert_allclose(
        footprint.at(Pose2D(2.0, 3.0, math.pi / 2)), [[2.0, 4.0], [1.0, 2.0], [3.0, 2.0]], atol=1e-12
    )
    assert footprint.contains_center
    assert not Footprint(np.array([[1.0, 0.0], [2.0, 0.0], [1.5, 1.0]])).contains_center


def tf2_rotate(q: list[float], v: list[float]) -> list[float]:
    """tf2's quatRotate: q * v * q.inverse(), with the operations in the order of tf2/LinearMath/Quaternion.h."""
    x, y, z, w = q
    a, b, c, d = (
        w * v[0] + y * v[2] - z * v[1],
        w * v[1] + z * v[0] - x * v[2],
        w * v[2] + x * v[1] - y * v[0],
        -x * v[0] - y * v[1] - z * v[2],
    )
    x, y, z = -x, -y, -z
    return [
        d * x + a * w + b * z - c * y,
        d * y + b * w + c * x - a * z,
        d * z + c * w + a * y - b * x,
    ]


def test_transforms_are_composed_as_in_tf2_to_the_last_bit() -> None:
    rng = np.random.default_rng(3)
    for _ in range(2000):
        x, y, yaw, right, up, turn = (rng.uniform(-1.0, 1.0, 6) * (30.0, 30.0, math.pi, 3.0, 3.0, math.pi)).tolist()
        q = [0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)]
        composed = Transform2D(x, y, yaw) @ Transform2D(right, up, turn)
        moved = tf2_rotate(q, [right, up, 0.0])
        assert (composed.x, composed.y) == (moved[0] + x, moved[1] + y)
        inverse = Transform2D(x, y, yaw).inverse()
        back = tf2_rotate([0.0, 0.0, -q[2], q[3]], [-x, -y, 0.0])
        assert (inverse.x, inverse.y) == (back[0], back[1])
