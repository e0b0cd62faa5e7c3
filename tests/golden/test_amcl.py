"""The parts of amcl compared with the C++, each from the recorded input.

The data are those of NAVSTACK_GOLDEN_ROS1 (default `../shared/golden_ros1`); maps, scans and cases are found by name. The
deliberate differences of navstack (docs/parity/localization.md) are off: `ros_defects` lists all of them, and particles do not
learn the odometry's errors.

Tolerances. The same generator of random numbers, the same formulas in double precision: 1e-9 relative, for sums and products
of up to 640 beams in another order. End points within 1e-12 m of the border of a cell could fall into the next one; none does.
Maps of distances are stored as float32: equal to that rounding. Means and covariances over 200,000 samples: six standard errors.
"""

from __future__ import annotations

import itertools
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.localization import distance_field
from navstack.localization.particles import (
    RESAMPLING,
    ParticleSet,
    draw_gaussian,
    normal,
    particle_limit,
    random_state,
    uniform,
)
from navstack.localization.sensor_model import BEAM, Readings, SensorModel, cast
from navstack.parameters import AmclParams
from navstack.parameters.models.amcl import DEFECTS
from tests.conftest import golden_ros1_files

Array = NDArray[Any]
RELATIVE = 1e-9
MODELS = ("beam", "likelihood_field", "likelihood_field_prob")
ALL_DEFECTS = sorted(DEFECTS)


@lru_cache(maxsize=8)
def read(file: Path) -> dict[str, Array]:
    with np.load(file) as data:
        return {key: data[key] for key in data.files}


def first_file(pattern: str) -> dict[str, Array]:
    files = golden_ros1_files(pattern)
    if not files:
        pytest.skip("no golden data of ROS 1: set NAVSTACK_GOLDEN_ROS1 to their folder")
    return read(files[0])


def groups(pattern: str, depth: int) -> list[tuple[Path, str]]:
    """The groups of keys of all files of a pattern: (file, `group/..`)."""
    found = [
        (file, name)
        for file in golden_ros1_files(pattern)
        for name in sorted({"/".join(key.split("/")[:depth]) for key in read(file) if key.count("/") >= depth})
    ]
    return found or [(Path(), "")]


def parametrized(pattern: str, depth: int) -> pytest.MarkDecorator:
    cases = groups(pattern, depth)
    return pytest.mark.parametrize(("file", "name"), cases, ids=[name or "no data" for _, name in cases])


def case(file: Path, name: str) -> dict[str, Array]:
    if not name:
        pytest.skip("no golden data of ROS 1: set NAVSTACK_GOLDEN_ROS1 to their folder")
    return {key.removeprefix(name + "/"): value for key, value in read(file).items() if key.startswith(name + "/")}


def grid_of(data: dict[str, Array]) -> OccupancyGrid:
    info = data["info"]
    geometry = GridGeometry(int(info[0]), int(info[1]), float(info[2]), float(info[3]), float(info[4]))
    return OccupancyGrid(data["occupancy"], geometry)


MAPS = groups("amcl_willow.npz", 1) + groups("amcl_fetch.npz", 1)
each_map = pytest.mark.parametrize(("file", "name"), [m for m in MAPS if m[1]] or [(Path(), "")], ids=lambda v: str(v))


@each_map
def test_distance_field(file: Path, name: str) -> None:
    data = case(file, name)
    grid, farthest = grid_of(data), float(data["info"][7])
    params = AmclParams(laser_likelihood_max_dist=farthest, ros_defects=["distance_field"])
    np.testing.assert_array_equal(SensorModel(params, grid).distances(), data["occ_dist"])


@each_map
def test_the_exact_distance_field_is_nowhere_farther(file: Path, name: str) -> None:
    data = case(file, name)
    grid, farthest = grid_of(data), float(data["info"][7])
    exact = distance_field(grid, farthest)
    assert (exact <= data["occ_dist"] + 1e-6).all()
    # most cells agree; the others have a label in amcl that is not the nearest
    assert (np.abs(exact - data["occ_dist"]) <= 1e-6).mean() > 0.8


SCANS = [g for pattern in ("amcl_willow.npz", "amcl_fetch.npz") for g in groups(pattern, 3) if g[1]]


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("file", "name"),
    [g for g in SCANS if f"{g[1]}/weights" in read(g[0])] or [(Path(), "")],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_sensor_weights(file: Path, name: str) -> None:
    case(file, name)
    place, scan, model = name.split("/")
    weights = case(file, name)["weights"]
    data = case(file, f"{place}/{scan}")
    sensor = sensor_model(file, place, tuple(read(file)[f"{name}/params"].tolist()))
    ranges = data["ranges"].copy()
    if model.startswith("beam"):
        ranges[np.isnan(ranges[:, 0]), 0] = data["range_max"][0]
    # bearings are in the base frame: the turn of the laser is in them, or in its pose
    readings = Readings(ranges, float(data["range_max"][0]), data["laser_pose"].copy())
    converged = bool(read(file)[f"{name}/params"][9])
    factors = sensor.factors(data["particles"], readings, converged=converged)
    np.testing.assert_allclose(factors, weights, rtol=RELATIVE, atol=0.0)


@lru_cache(maxsize=64)
def sensor_model(file: Path, place: str, values: tuple[float, ...]) -> SensorModel:
    kind, beams, hit, short, most, rand, sigma, decay, skip, _, distance, threshold, error = values
    data = case(file, place)
    params = AmclParams(
        laser_model_type=MODELS[int(kind)],
        laser_max_beams=int(beams),
        laser_z_hit=hit,
        laser_z_short=short,
        laser_z_max=most,
        laser_z_rand=rand,
        laser_sigma_hit=sigma,
        laser_lambda_short=decay,
        do_beamskip=bool(skip),
        beam_skip_distance=distance,
        beam_skip_threshold=threshold,
        beam_skip_error_threshold=error,
        laser_likelihood_max_dist=float(data["info"][7]),
        ros_defects=ALL_DEFECTS,
    )
    return SensorModel(params, grid_of(data))


@pytest.mark.parametrize(
    ("file", "name"),
    [(f, n) for f, n in sorted({(f, n.rsplit("/", 1)[0]) for f, n in SCANS}) if f"{n}/calc_range" in read(f)]
    or [(Path(), "")],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_rays(file: Path, name: str) -> None:
    data = case(file, name)
    grid = grid_of(case(file, name.split("/")[0]))
    g = grid.geometry
    beam = np.zeros(1, BEAM)
    columns, rows = g.nx // 2, g.ny // 2
    beam["map_center_x"], beam["map_center_y"] = g.origin_x + columns * g.resolution, g.origin_y + rows * g.resolution
    beam["map_cell"], beam["map_shift_x"], beam["map_shift_y"] = g.resolution, 0.5 + columns, 0.5 + rows
    blocked = grid.data != 0
    ranges = [cast(blocked, beam, *query) for query in data["calc_range_query"].tolist()]
    np.testing.assert_allclose(ranges, data["calc_range"], rtol=1e-12)


def test_particle_limit() -> None:
    data = first_file("amcl_kld.npz")
    for (error, quantile, least, most), limits in zip(data["kld/params"], data["kld/limit"], strict=True):
        settings = np.zeros(1, RESAMPLING)
        settings["pop_err"], settings["pop_z"] = error, quantile
        settings["min_particles"], settings["max_particles"] = least, most
        settings["one_bin_asks_for_max"] = True
        assert [particle_limit(bins, settings) for bins in range(1, len(limits) + 1)] == limits.tolist()


def test_random_numbers() -> None:
    data = first_file("amcl_resample.npz")
    expected = data["resample/drand48_srand48_5"]
    state = random_state(5)
    assert [uniform(state) for _ in expected] == expected.tolist()
    expected = data["resample/ran_gaussian_sigma2_srand48_5"]
    state = random_state(5)
    assert [normal(2.0, state) for _ in expected] == expected.tolist()


def test_first_cloud() -> None:
    expected = first_file("amcl_resample.npz")["resample/pf_init_srand48_5"]
    values, axes = np.linalg.eigh([[0.3, 0.1, 0.0], [0.1, 0.2, 0.0], [0.0, 0.0, 0.07]])
    mean, out = np.array([3.0, -2.0, 1.0]), np.empty_like(expected)
    errors: list[float] = []
    for signs in itertools.product((1.0, -1.0), repeat=3):  # an eigenvector has no sign of its own
        draw_gaussian(mean, axes * signs, np.sqrt(values), random_state(5), out)
        errors.append(np.abs(out - expected).max())
    assert min(errors) < 1e-12


def motions() -> list[tuple[str, int]]:
    return [(model, row) for model in ("diff", "omni", "diff_corrected", "omni_corrected") for row in range(5)]


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize(("model", "row"), motions())
def test_motion_model(model: str, row: int) -> None:
    data = first_file("amcl_odom.npz")
    alphas = data["odom/alphas"][row]
    for number, motion in enumerate(data["odom/motion"]):
        start_yaw = motion[2] - motion[5]
        if row < len(data[f"odom/{model}/exact_srand48_7"]):
            expected = data[f"odom/{model}/exact_srand48_7"][row, number]
            i = np.arange(len(expected))
            poses = np.column_stack((0.01 * i, -0.02 * i, -3.0 + 0.03 * i))
            moved = move(poses, motion[3:], start_yaw, alphas, model, seed=7)
            np.testing.assert_allclose(moved, expected, rtol=0.0, atol=1e-12)
        count = 20_000
        yaws = data["odom/start_yaw"]
        begin = np.column_stack((np.full(count, 10.0), np.full(count, -5.0), np.full(count, yaws[number % len(yaws)])))
        difference = move(begin, motion[3:], start_yaw, alphas, model, seed=number) - begin
        mean, covariance = data[f"odom/{model}/mean"][row, number], data[f"odom/{model}/cov"][row, number]
        error = np.sqrt(np.diag(covariance) * (1.0 / count + 1.0 / 200_000))
        assert (np.abs(difference.mean(axis=0) - mean) <= 6.0 * error + 1e-10).all()
        spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        # the variance of a sample covariance from its own fourth moments: the headings are not normal after wrapping
        centered = difference - difference.mean(axis=0)
        products = centered[:, :, None] * centered[:, None, :]
        allowed = 6.0 * products.std(axis=0) * np.sqrt(1.0 / count + 1.0 / 200_000) + 1e-12
        assert (np.abs(products.mean(axis=0) - covariance) <= allowed + 1e-9 * np.outer(spread, spread)).all()


def move(poses: Array, motion: Array, start_yaw: float, alphas: Array, model: str, seed: int) -> Array:
    params = AmclParams(max_particles=len(poses), min_particles=1, learn_odometry=False, ros_defects=ALL_DEFECTS)
    particles = ParticleSet(params, seed)
    particles.put(poses, np.ones(len(poses)))
    particles.move(np.ascontiguousarray(motion), float(start_yaw), alphas, model.replace("_", "-"))
    return particles.poses.copy()


def particle_set(poses: Array, weights: Array, seed: int = 0, **params: Any) -> ParticleSet:
    particles = ParticleSet(AmclParams(**params, learn_odometry=False, ros_defects=ALL_DEFECTS), seed)
    particles.put(poses, np.ones(len(poses)))
    particles.weights[:] = weights
    return particles


@pytest.mark.slow
@parametrized("amcl_clusters.npz", 2)
def test_clusters(file: Path, name: str) -> None:
    data = case(file, name)
    poses, weights = data["particles"], data["weights"]
    particles = particle_set(poses, weights, max_particles=max(len(poses), 100))
    found = particles.clusters()
    # amcl numbers clusters by the leaves of its tree, navstack by weight
    order = np.argsort(-data["weight"], kind="stable")
    assert found.counts.sum() == data["count"].sum()
    np.testing.assert_allclose(found.weights, data["weight"][order], rtol=RELATIVE)
    for k, weight in enumerate(found.weights):
        same = np.flatnonzero(
            np.isclose(data["weight"], weight, rtol=RELATIVE)
        )  # clusters of one particle have equal weights
        nearest = same[np.abs(data["mean"][same] - found.means[k]).max(axis=1).argmin()]
        assert found.counts[k] == data["count"][nearest]
        np.testing.assert_allclose(found.means[k], data["mean"][nearest], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(found.covariances[k], data["cov"][nearest], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found.mean, data["set_mean"], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found.covariance, data["set_cov"], rtol=0.0, atol=1e-11)
    assert particles.bin_count == data["leaf_count"][0]
    assert particles.is_converged() == bool(data["converged"][0])


@parametrized("amcl_resample.npz", 2)
def test_resampling(file: Path, name: str) -> None:
    data = case(file, name)
    if "out" not in data:
        return  # the random numbers, see above
    least, most, error, quantile, share, seed = data["params"].tolist()
    found: list[Array] = []
    for free, place in free_cells() if share > 0.0 else [(np.zeros((1, 2), np.int32), (0.0, 0.0, 1.0))]:
        settings = {"kld_err": error, "kld_z": quantile, "min_particles": int(least), "max_particles": int(most)}
        particles = particle_set(data["particles"], data["weights"], int(seed), **settings)
        particles.slow, particles.fast = 1.0, 1.0 - share
        particles.resample(free, place[:2], place[2])
        found.append(particles.poses.copy())
        assert particles.bin_count == data["leaf_count"][0] or share > 0.0
        if share == 0.0:
            np.testing.assert_allclose(particles.clusters().mean, data["set_mean"], rtol=0.0, atol=1e-12)
    out = data["out"]
    assert any(len(poses) == len(out) and np.abs(poses - out).max() <= 1e-12 for poses in found)


def free_cells() -> list[tuple[NDArray[np.int32], tuple[float, float, float]]]:
    """The free cells of every map, x outer and y inner, and the place of the cell (0, 0)."""
    cells: list[tuple[NDArray[np.int32], tuple[float, float, float]]] = []
    for file, name in [m for m in MAPS if m[1]]:
        data = case(file, name)
        g = grid_of(data).geometry
        free = np.ascontiguousarray(np.argwhere(data["occupancy"].T == 0).astype(np.int32))
        x, y = g.origin_x + (g.nx // 2) * g.resolution, g.origin_y + (g.ny // 2) * g.resolution
        cells.append((free, (x - (g.nx // 2) * g.resolution, y - (g.ny // 2) * g.resolution, g.resolution)))
    return cells


@parametrized("amcl_recovery.npz", 2)
def test_recovery(file: Path, name: str) -> None:
    data = case(file, name)
    slow, fast = data["alpha_slow_fast"].tolist()
    settings = {"min_particles": 200, "max_particles": 1000, "kld_err": 0.05, "kld_z": 0.99}
    rng = np.random.default_rng(0)
    poses = rng.normal((20.0, 20.0, 0.0), (1.0, 1.0, 0.3), (1000, 3))
    particles = particle_set(
        poses, np.full(1000, 1e-3), 1, **settings, recovery_alpha_slow=slow, recovery_alpha_fast=fast
    )
    free = np.argwhere(np.ones((100, 100))).astype(np.int32)
    expected_poses, variance, drawn = 0.0, 0.0, 0
    for step, (average, row) in enumerate(zip(data["w_avg"], data["trace"], strict=True)):
        factor = average * particles.count  # amcl's average is divided by the number of particles twice
        particles.weigh(np.full(particles.count, factor))
        np.testing.assert_allclose((particles.slow, particles.fast, particles.injection), row[:3], rtol=RELATIVE)
        if row[3] >= 0.0:
            particles.resample(free, (0.0, 0.0), 0.4)
            expected_poses += row[2] * particles.count
            variance += row[2] * (1.0 - row[2]) * particles.count
            drawn += particles.injected
            if row[2] == 0.0:
                assert particles.injected == 0
        np.testing.assert_allclose((particles.slow, particles.fast), row[5:7], rtol=RELATIVE, err_msg=f"step {step}")
    assert abs(drawn - expected_poses) <= 6.0 * np.sqrt(variance)


def test_pose_of_the_heaviest_cluster() -> None:
    particles = particle_set(np.zeros((3, 3)), np.full(3, 1.0 / 3.0), max_particles=100)
    assert particles.clusters().pose == Pose2D(0.0, 0.0, 0.0)
