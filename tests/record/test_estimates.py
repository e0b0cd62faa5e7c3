"""The estimates of a localizer in a record: through a file, bounded, refused where they are damaged, and in pictures."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from navstack.core import InputError, LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.plot import plot_estimate, plot_run
from navstack.plot.film import Film
from navstack.plot.localization import ellipse
from navstack.plugins import Localizer, PoseEstimate
from navstack.record import Record
from navstack.record.estimates import ESTIMATE_TABLE, MAX_DRAWN, EstimateBuffer, check_estimates
from navstack.record.reader import believed_poses, estimate_at, estimates_of, moved
from navstack.scenario import Run, Scenario


class Cloudy(Localizer):
    """An estimate per call of `scan`, with `n` equally weighted particles."""

    def __init__(self, n: int) -> None:
        self.n = n
        self._estimate: PoseEstimate | None = None

    def scan(self, stamp: float) -> None:
        covariance = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, 0.003], [0.002, 0.003, 0.01]])
        self._estimate = PoseEstimate(Pose2D(stamp, 1.0, 0.5), covariance, Transform2D(), stamp, {"explained": 0.75})

    def possible_poses(self) -> tuple[Any, Any]:
        return np.arange(3.0 * self.n).reshape(-1, 3), np.full(self.n, 1.0 / self.n)

    def set_map(self, grid: OccupancyGrid) -> None: ...

    def set_pose(self, pose: Pose2D, covariance: Any, stamp: float) -> None: ...

    def start_globally(self) -> None: ...

    def update(self, odometry: Transform2D, scan: LaserScan, sensor: Transform2D) -> PoseEstimate | None:
        return self._estimate

    @property
    def estimate(self) -> PoseEstimate | None:
        return self._estimate


def filled(count: int, n: int, most: int = 10**6) -> dict[str, Any]:
    buffer, localizer = EstimateBuffer(most), Cloudy(n)
    buffer.take(localizer)  # nothing before the first estimate
    for i in range(count):
        localizer.scan(float(i))
        buffer.take(localizer)
        buffer.take(localizer)  # the same estimate again
    return buffer.arrays()


def test_a_bounded_number_of_particles() -> None:
    arrays = filled(9, 1000)
    table = arrays["estimates"]
    assert len(table) == 9
    assert (table["count"] == 1000).all()
    assert (table["drawn"] == MAX_DRAWN).all()
    assert arrays["particles"].shape == (9 * MAX_DRAWN, 4)
    # first and last of the cloud are among them
    assert arrays["particles"][0, :3].tolist() == [0.0, 1.0, 2.0]
    assert arrays["particles"][-1, :3].tolist() == [2997.0, 2998.0, 2999.0]
    few = filled(9, 10, most=50)
    assert few["estimates"]["drawn"].tolist() == [10, 0, 10, 0, 10, 0, 10, 0, 10]
    assert len(few["particles"]) == 50
    check_estimates(few)


@pytest.mark.parametrize(
    ("column", "value", "named"),
    [
        ("x", math.nan, "not finite"),
        ("t", 1e9, "decrease"),
        ("first", 10**6, "do not exist"),
        ("drawn", -1, "do not exist"),
    ],
)
def test_damaged_estimates_are_refused(column: str, value: float, named: str) -> None:
    arrays = filled(3, 5)
    arrays["estimates"][column][1] = value
    with pytest.raises(ValueError, match=named):
        check_estimates(arrays)


def test_estimates_of_another_shape_are_refused() -> None:
    arrays = filled(3, 5)
    for wrong, named in (
        ({"estimates": arrays["estimates"]}, "belong together"),
        (arrays | {"particles": arrays["particles"][:, :3]}, "shape"),
        (arrays | {"estimates": np.zeros(3, ESTIMATE_TABLE[:-1])}, "columns"),
        (arrays | {"particles": np.full_like(arrays["particles"], np.inf)}, "not finite"),
    ):
        with pytest.raises(ValueError, match=named):
            check_estimates(wrong)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """Eight seconds in the office on amcl, through a file."""
    overrides = ["navstack/sim/localization=amcl", "navstack/sim/odometry_turn=0.05", "navstack/goal_time_limit=8.0"]
    configuration = load_configuration(["turtlebot"], overrides=overrides)
    grid = load_map(map_path("office"))
    run = Run(Scenario(grid, configuration, Pose2D(2.0, 7.45, 0.0), (Pose2D(8.0, 7.45, 0.0),), seed=3))
    while run.step():
        pass
    assert run.recorder is not None
    folder = tmp_path_factory.mktemp("run")
    run.recorder.save(folder)
    return Record.load(folder)


@pytest.mark.slow
def test_a_run_on_amcl(record: Record) -> None:
    table = estimates_of(record)
    assert len(table) > 3
    assert (np.diff(table["t"]) > 0.0).all()
    assert (table["drawn"] <= MAX_DRAWN).all()
    assert not table["lost"].any()
    believed = believed_poses(record)
    assert np.hypot(*(believed - record.poses)[:, :2].T).max() < 0.6
    assert estimate_at(record, -1.0) is None
    for row in (1, len(table) - 1):
        t = float(table["t"][row])
        found = estimate_at(record, t + 1e-6)
        assert found is not None and found.t == t
        mean = np.average(found.particles[:, :2], axis=0, weights=found.particles[:, 3])
        assert np.hypot(*(mean - found.pose[:2])) < 0.3
        assert np.allclose(found.covariance, found.covariance.T)
        later = moved(record, found, record.times[-1])
        assert np.hypot(*(np.array(later.pose[:2]) - believed[-1, :2])) < 0.7


@pytest.mark.slow
def test_pictures(record: Record, tmp_path: Path) -> None:
    file = plot_estimate(record, tmp_path / "moment.png", t=4.0)
    with Image.open(file) as picture:
        pixels = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    for color in ((204, 121, 167), (230, 159, 0)):  # particles, likelihood field
        assert (np.abs(pixels.astype(int) - color).max(axis=1) < 12).sum() > 20
    axes = plot_run(record)
    named = {text.get_text() for legend in axes.figure.legends for text in legend.get_texts()}
    assert {"believed path", "particles", "95 % ellipse"} <= named
    film = Film(record, "run", 60.0)
    frames = [film.frame(t).astype(int) for t in (0.0, 5.0)]
    assert (np.abs(frames[0] - frames[1]).max(axis=2) > 40).sum() > 100


def test_a_run_without_a_localizer_has_no_moment(record: Record) -> None:
    arrays = {name: array for name, array in record.arrays.items() if name not in ("estimates", "particles")}
    plain = Record(record.meta, [], arrays)
    assert len(estimates_of(plain)) == 0
    with pytest.raises(InputError, match="no localizer"):
        plot_estimate(plain)


def test_the_ellipse_of_a_known_covariance() -> None:
    outline = ellipse(Pose2D(1.0, 2.0), np.diag([0.04, 0.01, 0.1]))
    assert outline[:, 0].max() - 1.0 == pytest.approx(0.2 * 2.4477, rel=2e-3)
    assert outline[:, 1].max() - 2.0 == pytest.approx(0.1 * 2.4477, rel=5e-3)
