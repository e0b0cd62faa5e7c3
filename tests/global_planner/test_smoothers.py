"""Smoothers: Nav2's results, properties, and paths that must stay as they are."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, GridGeometry, InputError, ParameterError, Path, UnknownPluginError
from navstack.global_planner.smoothers import PointSmoother, SavitzkyGolaySmoother, SimpleSmoother
from navstack.global_planner.smoothers.base import curvatures, cusp_indices, is_good
from navstack.parameters import check_parameters, load_configuration
from navstack.plugins import SMOOTHERS, Smoother
from tests.conftest import golden_nav2_files

FILES = {f.name: f for f in golden_nav2_files("smoothers*") + golden_nav2_files("smac_maps.npz")}
JOBS: dict[str, Any] = json.loads(FILES["smoothers_jobs.json"].read_text()) if FILES else {}
KINDS = ("simple", "simple_norefine", "sg", "sg_9_2")
POINT_M = 2e-6
"""Both compute in float64; the inputs and results are stored as float32: half a unit of 1e-6 m at 16 m."""
each = pytest.mark.parametrize("smoother", [e.cls(e.cls.Params()) for e in SMOOTHERS], ids=[e.name for e in SMOOTHERS])


def empty() -> Costmap:
    return Costmap(GridGeometry(200, 200, 0.05), np.zeros((200, 200), np.uint8))


def noisy(n: int = 60) -> Path:
    rng = np.random.default_rng(4)
    x = np.linspace(1.0, 8.0, n)
    y = 4.0 + np.sin(x) + rng.normal(0.0, 0.03, n)
    return Path(np.column_stack((x, y, np.arctan2(np.gradient(y), np.gradient(x)))))


@pytest.mark.skipif(not FILES, reason="the golden data of Nav2 are absent (NAVSTACK_GOLDEN_NAV2)")
@pytest.mark.parametrize("kind", KINDS)
def test_equal_to_nav2(kind: str) -> None:
    maps, data = np.load(FILES["smac_maps.npz"]), np.load(FILES["smoothers.npz"])
    jobs = {name: job for name, job in JOBS.items() if name.split("/")[0] == kind and data[f"{name}/status_ms"][0] == 1}
    assert jobs
    for name, job in jobs.items():
        x, y, resolution = (float(v) for v in maps[f"{job['map']}/info"])
        costs = maps[f"{job['map']}/costmap_round"]
        costmap = Costmap(GridGeometry(costs.shape[1], costs.shape[0], resolution, x, y), costs)
        entry = SMOOTHERS.get(job["plugin"])
        values = {key.removeprefix("smoother."): value for key, value in job["params"].items()}
        smoother = entry.cls(entry.cls.Params(**values))
        assert isinstance(smoother, PointSmoother)
        poses = data["in/" + job["input"]].astype(np.float64)
        ours, theirs = smoother.unchecked(Path(poses), costmap), data[f"{name}/path"]
        assert np.abs(ours[:, :2] - theirs[:, :2]).max() < POINT_M, name
        dx, dy = poses[2, :2] - poses[1, :2]
        if abs(abs(math.remainder(math.atan2(dy, dx) - poses[1, 2], 2.0 * math.pi)) - math.pi / 2.0) < 0.1:
            continue  # a path of the 2D planner (heading 0) at right angles to x: forward or backward by a hair
        turn = np.remainder(ours[:, 2] - theirs[:, 2] + np.pi, 2.0 * np.pi) - np.pi
        # a heading is that of a step: two points that are 2e-6 m off, over the shortest step
        steps = np.hypot(*np.diff(theirs[:, :2], axis=0).T)
        assert np.abs(turn).max() < 2.0 * POINT_M / max(1e-4, steps[steps > 1e-4].min()), name


@each
def test_contract(smoother: Smoother) -> None:
    """Ends stay, the input is unchanged, and the path becomes smoother."""
    path, costmap = noisy(), empty()
    before = path.poses.copy()
    out = smoother.smooth(path, costmap)
    assert (path.poses == before).all()
    assert out.frame == path.frame and len(out) == len(path)
    assert (out.poses[[0, -1], :2] == before[[0, -1], :2]).all()
    assert curvatures(out.poses).max() < 0.7 * curvatures(before).max()
    assert ((-math.pi < out.poses[:, 2]) & (out.poses[:, 2] <= math.pi)).all()
    for n in range(4):
        assert len(smoother.smooth(Path(before[:n]), costmap)) == n
    with pytest.raises(InputError, match="not finite"):
        smoother.smooth(Path(np.full((5, 3), np.nan)), costmap)


@each
def test_no_pose_enters_an_obstacle(smoother: Smoother) -> None:
    """Around a corner of inscribed cells that a smooth path would cut."""
    costmap = empty()
    costmap.data[:100, 100:] = 253
    poses = np.array([(x, 5.05, 0.0) for x in np.arange(2.0, 4.9, 0.1)] + [(4.95, 5.05, 0.0)])
    poses = np.concatenate([poses, [(4.95, y, -math.pi / 2.0) for y in np.arange(4.95, 2.0, -0.1)]])
    out = smoother.smooth(Path(poses), costmap)
    assert max(costmap.cost_at(float(x), float(y)) or 0 for x, y in out.poses[:, :2]) < 253


@each
def test_footprints_stay_free(smoother: Smoother) -> None:
    costmap = empty()
    costmap.data[95:99, 80:84] = 254
    costmap.data[90:104, 76:88][costmap.data[90:104, 76:88] == 0] = 100
    box = Footprint(np.array([[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]))
    from navstack.core import Pose2D, footprint_cost

    x = np.linspace(2.0, 6.5, 46)
    y = 4.85 + 0.45 * np.exp(-(((x - 4.1) / 0.35) ** 2))
    yaw = np.append(np.arctan2(np.diff(y), np.diff(x)), 0.0)
    path = Path(np.column_stack((x, y, yaw)))
    free = [footprint_cost(costmap, box, path[i]) != 254 for i in range(len(path))]
    out = smoother.smooth(path, costmap, footprint=box)
    for i, pose in enumerate(out.poses):
        if free[i]:
            assert footprint_cost(costmap, box, Pose2D(*(float(v) for v in pose))) != 254


@pytest.mark.parametrize("cls", [SimpleSmoother, SavitzkyGolaySmoother])
def test_the_turning_radius_is_kept(cls: type[Any]) -> None:
    """A result that turns more sharply than the radius and the path is dropped."""
    angles = np.linspace(0.0, 1.5 * math.pi, 60)
    circle = Path(np.column_stack((5.0 + np.cos(angles), 5.0 + np.sin(angles), angles + math.pi / 2.0)))
    out = cls(cls.Params(minimum_turning_radius=1.0)).smooth(circle, empty())
    assert curvatures(out.poses).max() <= 1.0 + 1e-3


def test_cusps_stay() -> None:
    forward = [(x, 5.0, 0.0) for x in np.arange(2.0, 4.05, 0.1)]
    back = [(x, 5.0 + 0.2 * (4.0 - x) ** 2, 0.0) for x in np.arange(3.9, 2.0, -0.1)]
    poses: NDArray[np.float64] = np.array(forward + back)
    (cusp,) = cusp_indices(poses)
    for entry in SMOOTHERS:
        out = entry.cls(entry.cls.Params()).smooth(Path(poses), empty())
        if entry.name == "constrained":
            continue  # cusps move with the path: test_constrained
        assert out.poses[cusp, :2] == pytest.approx(poses[cusp, :2])
        # backward: the heading is opposite to the steps
        assert abs(math.remainder(out.poses[cusp + 5, 2], 2.0 * math.pi)) < 0.5


def test_cubics_stay_under_savitzky_golay() -> None:
    x = np.arange(0.0, 6.0, 0.1)
    points = np.column_stack((x, 0.1 * x**3 - 0.5 * x**2))
    moved = SavitzkyGolaySmoother().move(points, np.ones(len(points), np.bool_), None)
    assert np.abs(moved - points)[10:-10].max() < 1e-9


def test_selected_by_yaml() -> None:
    configuration = load_configuration(["turtlebot"], overrides=["base_smoother=simple", "simple.w_smooth=0.4"])
    assert configuration.smoother is not None
    assert configuration.smoother.params.w_smooth == 0.4
    assert load_configuration(["turtlebot"]).smoother is None
    with pytest.raises(UnknownPluginError, match='did you mean "simple"'):
        load_configuration(["turtlebot"], overrides=["base_smoother=simpel"])
    with pytest.raises(ParameterError, match="cost_check_points has 2 values"):
        load_configuration(
            ["turtlebot"], overrides=["base_smoother=constrained", "constrained.cost_check_points=[1.0, 2.0]"]
        )
    found = check_parameters(
        ["turtlebot"], overrides=["base_smoother=savitzky_golay", "savitzky_golay.window_size=6", "simple.max_its=9"]
    )
    assert [f.message for f in found if "smooth" in f.rule or "simple" in f.message] == [
        "window_size = 6 is even, so 7 points are used (Nav2 refuses it); write 7",
        'simple has no effect: base_smoother selects "savitzky_golay"',
    ]


def test_a_pose_that_collides_does_not_get_worse() -> None:
    """A footprint that touches a wall is no reason for the center to enter it."""
    costmap = empty()
    costmap.data[:99] = 254
    costmap.data[99:105] = 150
    box = Footprint(np.array([[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]))
    touching, inside = np.array([[5.0, 5.0, 0.0]]), np.array([[5.0, 4.9, 0.0]])
    assert is_good(touching, touching + [0.01, 0.0, 0.0], costmap, box, 0.0)
    assert not is_good(touching, inside, costmap, box, 0.0)
