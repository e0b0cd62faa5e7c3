from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path as FilePath

import numpy as np
import pytest
from PIL import Image

from navstack.core import (
    Bounds,
    Costmap,
    Event,
    Footprint,
    GridGeometry,
    InputError,
    OccupancyGrid,
    OutputError,
    Path,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
)
from navstack.plot import canvas, colors, plot_costmap, plot_plan, plot_run
from navstack.plot.benchmarks import plot_pairs
from navstack.plot.picture import Picture, round_length
from navstack.plot.run import area_of_run, circumstances, headline, incidents
from navstack.plugins import Plan
from navstack.record import Record, RunRecorder
from tests.record import synthetic

ROOT = FilePath(__file__).resolve().parents[2]


def pixels(path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def count(image: np.ndarray, color: str, tolerance: int = 3) -> int:
    rgb = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)])
    return int((np.abs(image - rgb).max(axis=2) <= tolerance).sum())


def a_run(
    points, goals=(), *, n=60, grid=None, scenario=None, results=(), events=(), plan_frame="map", offset=Transform2D()
):
    recorder = RunRecorder(map=grid, footprint=Footprint.from_radius(0.2), scenario=scenario or {})
    at = np.linspace(0.0, len(points) - 1.0, n)
    x, y = (np.interp(at, range(len(points)), [p[i] for p in points]) for i in (0, 1))
    for goal in goals:
        recorder.goal(0.0, Pose2D(*goal))
    for i in range(n):
        pose = Pose2D(float(x[i]), float(y[i]), 0.0)
        recorder.sample(
            i / 5,
            pose=pose,
            odom=RobotState(offset.inverse().apply(pose)),
            map_to_odom=offset,
            command=Twist2D(),
            state="CONTROLLING",
            goal_index=0,
        )
    for event in events:
        recorder.on_event(event)
    poses = np.column_stack((x, y, np.zeros(n)))
    recorder.plan(0.0, poses if plan_frame == "map" else offset.inverse().apply_poses(poses), plan_frame)
    recorder.finish(list(results))
    return recorder.record()


# --- plot_run ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_run_shows_paths_goals_and_incidents(record, tmp_path):
    image = pixels(plot_run(record, tmp_path / "run.png", dpi=130))
    height, width, _ = image.shape
    assert 1000 < width < 1400
    assert 400 < height < 1200
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 100
    for name, color, least in (
        ("driven path", colors.DRIVEN, 2000),
        ("plan", colors.PLAN, 300),
        ("start", colors.START, 150),
        ("goals", colors.GOAL, 500),
        ("recovery", colors.RECOVERY, 50),
        ("collision", colors.COLLISION, 50),
        ("obstacle", colors.OBSTACLE, 300),
        ("lethal", colors.hex_of(colors.LETHAL_RGB), 5000),
        ("inscribed", colors.hex_of(colors.INSCRIBED_RGB), 5000),
    ):
        assert count(image, color) > least, name
    # the margin is white
    assert (image[:5] == 255).all()
    assert (image[-5:] == 255).all()
    assert (image[:, -5:] == 255).all()


def test_the_picture_is_cut_to_the_run(record):
    area = area_of_run(record)
    for poses in (record.poses, record.goals):
        assert (poses[:, 0] > area.min_x + 0.5).all()
        assert (poses[:, 0] < area.max_x - 0.5).all()
        assert (poses[:, 1] > area.min_y + 0.5).all()
        assert (poses[:, 1] < area.max_y - 0.5).all()
    far = a_run([(100.0, 100.0), (104.0, 101.0)])
    around = area_of_run(far)
    assert around.max_x - around.min_x < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("points", [[(0, 0), (60, 1)], [(0, 0), (1, 60)], [(0, 0), (0, 0)]])
def test_aspect_ratio_of_long_tall_and_stationary_runs(points, tmp_path):
    image = pixels(plot_run(a_run(points, [(*points[-1], 0.0)]), tmp_path / "run.png", dpi=100))
    height, width, _ = image.shape
    assert 600 < width < 1000
    assert 300 < height < 850
    assert 0.35 < height / width < 1.2


def test_headline_and_circumstances(record):
    assert headline(record) == "3 of 3 goals reached, 24.6 m in 23.8 s, 1 recovery, 1 collision"
    assert circumstances(record) == "map office   distro noetic   seed 1"
    one = a_run(
        [(0, 0), (3, 4)],
        [(3, 4, 0)],
        results=[{"state": "ABORTED"}],
        scenario={"map": "/maps/my.map.yaml", "params": ["a/b", "c", "d", "e"], "seed": 0, "ros_distro": "indigo"},
    )
    assert headline(one) == "goal not reached, 5.0 m in 11.8 s"
    assert circumstances(one) == "map my.map   params b, c, d, ..   distro indigo   seed 0"


def test_a_recovery_counts_once():
    def recovery(t, status):
        return Event(t, "recovery", status, {"status": status})

    events = [
        recovery(1, "running"),
        recovery(2, "running"),
        recovery(3, "done"),
        recovery(4, "done"),
        recovery(5, "failed"),
        recovery(6, "running"),
    ]
    assert [event.time for event in incidents(a_run([(0, 0), (1, 1)], events=events))] == [1, 4, 5, 6]


@pytest.mark.slow
def test_goals_not_reached_are_hollow(tmp_path):
    goals = [(1.0, 1.0, 0.0), (4.0, 1.0, 0.0)]
    images = [
        pixels(plot_run(a_run([(0, 0), (2, 3)], goals, results=[{"state": s} for s in states]), tmp_path / f"{i}.png"))
        for i, states in enumerate((("SUCCEEDED", "SUCCEEDED"), ("SUCCEEDED", "ABORTED"), ("ABORTED", "ABORTED")))
    ]
    filled = [count(image, colors.GOAL) for image in images]
    assert filled[0] > filled[1] > filled[2] > 0


@pytest.mark.slow
def test_records_with_missing_parts(tmp_path):
    empty = RunRecorder(map=None, footprint=Footprint.from_radius(0.2), scenario={}).record()
    assert headline(empty) == "a run without samples"
    plot_run(empty, tmp_path / "empty.png")
    plot_run(
        RunRecorder(map=synthetic.office(), footprint=Footprint.from_radius(0.2), scenario={}).record(),
        tmp_path / "map.png",
    )
    recorder = RunRecorder(
        map=None, footprint=Footprint.from_radius(0.2), scenario={"obstacles": ["x", [1, 2], None, [1, 1, 0.3]]}
    )
    recorder.goal(0.0, Pose2D(math.nan, 1.0, 0.0))
    recorder.goal(0.0, Pose2D(1.0, 1.0, 0.0))
    recorder.plan(0.0, np.empty((0, 3)), "map")
    recorder.plan(0.0, np.ones((1, 3)), "odom")
    recorder.costmap(0.0, "local", Costmap(GridGeometry(20, 20, 0.1), frame="odom"))
    plot_run(recorder.record(), tmp_path / "odd.png", costmap="local")
    assert len(list(tmp_path.iterdir())) == 3


def test_a_rotated_map_and_a_plan_in_the_odometry_frame(tmp_path):
    """A wall along the map's x axis, rotated by 90 degrees, runs along y; a plan in odom lies on the driven path."""
    cells = np.zeros((40, 80), np.int8)
    cells[20:22] = 100
    turned = OccupancyGrid(cells, GridGeometry(80, 40, 0.1, 2.0, -4.0), origin_yaw=math.pi / 2)
    run = a_run([(0.5, 0.0), (3.5, 0.0)], grid=turned, plan_frame="odom", offset=Transform2D(5.0, -3.0, 0.7))
    assert area_of_run(run).max_x < 6.0  # the plan was transformed from odom
    image = pixels(plot_run(run, tmp_path / "run.png", footprints=False))
    dark = (np.abs(image - np.array(colors.LETHAL_RGB)).max(axis=2) < 3)[:, :870]  # left of the legend
    iy, ix = np.nonzero(dark)
    assert np.ptp(ix) < 0.2 * np.ptp(iy)


@pytest.mark.slow
def test_thin_walls_are_visible_on_a_large_map(tmp_path):
    """A wall of one cell (5 cm) on 200 m is a quarter of a pixel wide."""
    cells = np.zeros((4000, 4000), np.int8)
    cells[:, 2001] = 100
    campus = OccupancyGrid(cells, GridGeometry(4000, 4000, 0.05))
    image = pixels(plot_run(a_run([(5, 5), (195, 195)], grid=campus), tmp_path / "campus.png"))
    dark = image[200:600, 100:850].sum(axis=2) < 450
    assert dark.any(axis=1).mean() > 0.95


@pytest.mark.parametrize("far", [Bounds(9.1, 9.1, 11.1, 11.1), Bounds(-3.0e3, -4.00002e6, -2.98e3, -4.0e6)])
def test_long_tick_labels_fit_the_figure(far):
    with canvas.style():
        picture = Picture(far, title="t")
        renderer = picture.canvas.get_renderer()
        picture.canvas.draw()
        written = [label.get_text() for label in picture.axes.get_yticklabels()]
        offset = picture.axes.yaxis.get_offset_text().get_text()
        name = picture.axes.yaxis.label.get_window_extent(renderer)
    assert name.x0 > 0.0
    assert offset == ""
    assert len(set(written)) == len(written) > 2


@pytest.mark.slow
def test_an_area_can_be_given(record, tmp_path):
    close = pixels(plot_run(record, tmp_path / "a.png", area=Bounds(6.0, 3.0, 9.0, 6.0)))
    assert count(close, colors.OBSTACLE) > 2 * count(pixels(plot_run(record, tmp_path / "b.png")), colors.OBSTACLE)


@pytest.mark.slow
def test_names_with_special_characters(tmp_path):
    run = a_run([(0, 0), (1, 1)], scenario={"map": "$\\alpha_{", "params": ["地図", "%s", "\udcff"]})
    plot_run(run, tmp_path / "ü $x.png", title="$^{ {0}")
    assert (tmp_path / "ü $x.png").stat().st_size > 10_000


# --- plot_plan, plot_costmap ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def costmap() -> Costmap:
    grid = synthetic.office()
    return Costmap(grid.geometry, synthetic.inflated(grid))


START, GOAL = Pose2D(1.6, 1.8, 0.0), Pose2D(11.0, 6.6, math.pi / 2)


def a_plan(bend: float = 0.0, potential=None, **more) -> Plan:
    poses = synthetic.curve(200)[:130].copy()
    poses[:, 1] += bend * np.sin(np.linspace(0.0, math.pi, len(poses)))
    return Plan(Path(poses), 1234.5, more.pop("goal", GOAL), cells_expanded=4321, potential=potential, **more)


def a_potential(costmap: Costmap) -> np.ndarray:
    iy, ix = np.indices(costmap.geometry.shape)
    field = np.hypot(ix - 30, iy - 40).astype(np.float32)
    field[costmap.data >= 253] = np.inf
    return field


@pytest.mark.slow
def test_a_plan(costmap, tmp_path):
    image = pixels(
        plot_plan(
            costmap, a_plan(), tmp_path / "plan.png", start=START, goal=GOAL, footprint=Footprint.from_radius(0.2)
        )
    )
    for color in (colors.PLANS[0], colors.START, colors.GOAL, colors.hex_of(colors.INSCRIBED_RGB)):
        assert count(image, color) > 150


@pytest.mark.slow
def test_the_potential_is_drawn_when_there_is_one(costmap, tmp_path):
    with_it = a_plan(potential=a_potential(costmap))
    a = pixels(plot_plan(costmap, with_it, tmp_path / "a.png", start=START, goal=GOAL))
    b = pixels(plot_plan(costmap, with_it, tmp_path / "b.png", start=START, goal=GOAL, potential=False))
    lines = (a != b).any(axis=2)[:, :870]
    assert lines.sum() > 5000
    blue = a[:, :870][lines]
    assert (blue[:, 2] >= blue[:, 0]).mean() > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("value", [np.inf, 1e10, 0.0])
def test_a_constant_potential_is_not_drawn(costmap, tmp_path, value):
    flat = np.full(costmap.geometry.shape, value, np.float32)
    plot_plan(costmap, a_plan(potential=flat), tmp_path / "plan.png", start=START, goal=GOAL)


@pytest.mark.slow
def test_several_plans_have_different_colors(costmap, tmp_path):
    plans = {f"planner {i}": a_plan(0.2 * i) for i in range(4)}
    image = pixels(plot_plan(costmap, plans, tmp_path / "plans.png", start=START, goal=GOAL))
    for color in colors.PLANS[:4]:
        assert count(image, color) > 500


@pytest.mark.slow
def test_a_moved_goal_is_marked(costmap, tmp_path):
    a = plot_plan(costmap, a_plan(), tmp_path / "a.png", start=START, goal=GOAL)
    moved = a_plan(goal=Pose2D(10.5, 6.6, 0.0), goal_moved_m=0.5)
    b = plot_plan(costmap, moved, tmp_path / "b.png", start=START, goal=GOAL)
    assert a.read_bytes() != b.read_bytes()


@pytest.mark.slow
def test_empty_plans(costmap, tmp_path):
    plot_plan(costmap, {}, tmp_path / "a.png", start=START, goal=START)
    nothing = Plan(Path(np.empty((0, 3))), 0.0, GOAL)
    plot_plan(costmap, nothing, tmp_path / "b.png", start=Pose2D(-50.0, 0.0), goal=GOAL)
    plot_plan(costmap, nothing, tmp_path / "c.png", start=Pose2D(math.nan, 0.0), goal=Pose2D(math.inf, 1.0))


@pytest.mark.slow
def test_a_costmap_shows_its_bands(costmap, tmp_path):
    image = pixels(plot_costmap(costmap, tmp_path / "c.png", robot=START, footprint=Footprint.from_radius(0.3)))
    values, numbers = np.unique(costmap.data, return_counts=True)
    inflated = values[(values > 0) & (values < 253)]
    most = inflated[np.argmax(numbers[(values > 0) & (values < 253)])]
    low = tuple(colors.cost_colors()[most].tolist())
    for rgb in (colors.FREE_RGB, low, colors.INSCRIBED_RGB, colors.LETHAL_RGB, colors.UNKNOWN_RGB):
        assert count(image, colors.hex_of(rgb), 6) > 500
    assert count(image, colors.BLUE) > 100


@pytest.mark.slow
@pytest.mark.parametrize(("nx", "ny"), [(1, 1), (1000, 3), (3, 700), (2000, 1500)])
def test_costmaps_of_any_shape(nx, ny, tmp_path):
    data = np.zeros((ny, nx), np.uint8)
    data[ny // 2, nx // 2] = 254
    image = pixels(plot_costmap(Costmap(GridGeometry(nx, ny, 0.05), data), tmp_path / "c.png", dpi=80))
    assert 200 < image.shape[0] < 800


# --- files ------------------------------------------------------------------------------------------------------------

DRAW = """
import sys
from tests.record import synthetic
from navstack.plot import plot_run
record = synthetic.record_run(6.0).record()
for name in sys.argv[1:]:
    plot_run(record, name)
"""


@pytest.mark.slow
def test_pictures_are_reproducible(tmp_path):
    record = synthetic.record_run(6.0).record()
    endings = ("png", "svg", "pdf")
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "matplotlibrc").write_text("axes.facecolor: red\nlines.linewidth: 9\nsavefig.dpi: 30\n")
    environment = {**os.environ, "PYTHONHASHSEED": "77", "MATPLOTLIBRC": str(tmp_path / "config")}
    elsewhere = [str(tmp_path / f"c.{ending}") for ending in endings]
    subprocess.run([sys.executable, "-W", "error", "-c", DRAW, *elsewhere], cwd=ROOT, check=True, env=environment)
    for ending in endings:
        a, b = (plot_run(record, tmp_path / f"{n}.{ending}").read_bytes() for n in "ab")
        assert a == b
        assert len(a) > 20_000
        assert (tmp_path / f"c.{ending}").read_bytes() == a


@pytest.mark.slow
def test_no_software_and_no_date_in_the_files(record, tmp_path):
    with Image.open(plot_run(record, tmp_path / "a.png")) as image:
        assert "Software" not in image.info
    text = plot_run(record, tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "<dc:date>" not in text
    assert "Matplotlib v" not in text


def test_unknown_suffixes(record, costmap, tmp_path):
    for name in ("run.jpg", "run", "run.gif", "run.mp4"):
        with pytest.raises(OutputError, match=r"\.png, \.svg, \.pdf"):
            plot_run(record, tmp_path / name)
    with pytest.raises(OutputError, match="plan"):
        plot_plan(costmap, a_plan(), tmp_path / "plan.xyz", start=START, goal=GOAL)
    with pytest.raises(OutputError, match="costs"):
        plot_costmap(costmap, tmp_path / "costs.tiff")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_a_file(record, tmp_path):
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(OutputError, match="taken"):
        plot_run(record, tmp_path / "taken" / "run.png")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


@pytest.mark.slow
def test_a_failure_leaves_the_old_picture(record, tmp_path, monkeypatch):
    path = plot_run(record, tmp_path / "run.png")
    before = path.read_bytes()

    def full(*args, **kwargs):
        FilePath(args[1]).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    from matplotlib.figure import Figure

    monkeypatch.setattr(Figure, "savefig", full)
    with pytest.raises(OutputError, match="No space left"):
        plot_run(record, path)
    assert [p.name for p in tmp_path.iterdir()] == ["run.png"]
    assert path.read_bytes() == before


# --- side effects -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_settings_of_the_user_do_not_change(record, tmp_path):
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    with mpl.rc_context({"axes.facecolor": "red", "font.size": 30.0}):
        a = plot_run(record, tmp_path / "a.png").read_bytes()
        assert mpl.rcParams["axes.facecolor"] == "red"
    assert dict(mpl.rcParams) == before
    assert plot_run(record, tmp_path / "b.png").read_bytes() == a


@pytest.mark.slow
def test_matplotlib_is_imported_late_and_pyplot_never(tmp_path):
    code = """
import sys
import navstack.plot, navstack.record
assert not {"matplotlib", "PIL", "numba"} & set(sys.modules), "imported too early"
from tests.record import synthetic
navstack.plot.plot_run(synthetic.record_run(1.0).record(), sys.argv[1])
assert "matplotlib.pyplot" not in sys.modules
"""
    subprocess.run([sys.executable, "-W", "error", "-c", code, str(tmp_path / "a.png")], cwd=ROOT, check=True)


@pytest.mark.slow
def test_a_loaded_record_gives_the_same_picture(tmp_path):
    recorder = synthetic.record_run(6.0)
    recorder.save(tmp_path)
    a = plot_run(recorder.record(), tmp_path / "a.png").read_bytes()
    assert plot_run(Record.load(tmp_path), tmp_path / "b.png").read_bytes() == a


@pytest.mark.slow
@pytest.mark.parametrize("name", ["turtlebot", "turtlebot " + "DWAPlannerROS/path_distance_bias=32.0 " * 9])
def test_pairs_with_names_of_any_length(name, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(canvas, "save", lambda figure, path, dpi: drawn.append(figure) or path)
    plot_pairs([(10.0, 12.0), (9.0, None), (None, None)], tmp_path / "c.png", title="t", names=(name, name))
    (figure,) = drawn
    figure.canvas.draw()
    for axis in (figure.axes[0].xaxis, figure.axes[0].yaxis):
        box = axis.label.get_window_extent()
        assert box.x0 >= 0.0 and box.y0 >= 0.0
        assert box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1


# --- layout -----------------------------------------------------------------------------------------------------------


def drawn_axes(record, **options):
    import matplotlib.pyplot as plt

    axes = plot_run(record, **options)
    plt.close("all")
    return axes


@pytest.mark.slow
def test_the_axes_of_a_wide_picture_take_its_width(record):
    box = drawn_axes(record).get_position()
    assert box.width > 0.88


@pytest.mark.slow
def test_the_legend_lies_inside_the_figure_and_below_the_axes(record):
    axes = drawn_axes(record)
    (legend,) = axes.figure.legends
    axes.figure.canvas.draw()
    box, around = legend.get_window_extent(), axes.get_tightbbox()
    assert box.x0 >= 0.0 and box.y0 >= 0.0 and box.x1 <= axes.figure.bbox.x1
    assert box.y1 < around.y0


@pytest.mark.parametrize(("longest", "length"), [(4.0, 2.0), (5.0, 5.0), (0.99, 0.5), (0.2, 0.2), (19.0, 10.0)])
def test_round_lengths(longest, length):
    assert round_length(longest) == pytest.approx(length)


def test_a_bar_shows_the_scale(record):
    axes = drawn_axes(record)
    text = next(t for t in axes.texts if t.get_text().strip().endswith(" m"))
    line = next(one for one in axes.lines if one.get_zorder() == 12)
    assert np.ptp(line.get_xdata()) == pytest.approx(float(text.get_text().split()[0]))


def test_functions_draw_into_axes_of_the_caller(record, costmap):
    from matplotlib.figure import Figure

    a, b, c = Figure().subplots(1, 3)
    assert plot_run(record, ax=a) is a
    assert plot_plan(costmap, a_plan(), start=START, goal=GOAL, ax=b) is b
    assert plot_costmap(costmap, ax=c) is c
    assert all(axes.images for axes in (a, b, c))


def test_a_file_and_axes_at_once(record, tmp_path):
    from matplotlib.figure import Figure

    with pytest.raises(InputError, match="ax="):
        plot_run(record, tmp_path / "run.png", ax=Figure().subplots())


def test_many_replans_are_faint_and_few(record):
    points = [(0.0, 0.0), (6.0, 0.0)]
    run = a_run(points, [(6.0, 0.0, 0.0)])
    from navstack.plot.run import MOST_REPLANS, draw_plans

    recorder = RunRecorder(map=None, footprint=Footprint.from_radius(0.2), scenario={})
    recorder.goal(0.0, Pose2D(6.0, 0.0, 0.0))
    for i in range(300):
        recorder.plan(float(i), run.plans[0].poses, "map")
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    entries = []
    draw_plans(axes, recorder.record(), entries, replans=True)
    faint = [line for line in axes.lines if line.get_alpha() is not None]
    assert len(faint) == MOST_REPLANS
    assert max(line.get_alpha() for line in faint) < 0.2
    assert entries[-1][1] == "replans (299)"


def test_a_recovery_surrounds_the_robot_where_it_began(record):
    axes = drawn_axes(record)
    (event,) = incidents(record)
    rings = next(line for line in axes.lines if line.get_marker() == "D")
    assert np.allclose(np.ravel(rings.get_data()), record.pose_at(event.time)[:2])


def test_generic_names_of_parameters_have_their_folder():
    run = a_run([(0, 0), (1, 1)], scenario={"params": "/robots/husky/param"})
    assert circumstances(run) == "params husky/param"


@pytest.mark.slow
def test_plans_that_coincide_are_all_visible(costmap, tmp_path):
    plans = {f"planner {i}": a_plan() for i in range(4)}
    image = pixels(plot_plan(costmap, plans, tmp_path / "plans.png", start=START, goal=GOAL))
    on_the_map = image[: int(0.75 * len(image))]
    for color in colors.PLANS[:4]:
        assert count(on_the_map, color) > 500


def test_a_costmap_shows_plan_scan_goal_and_trajectory(costmap):
    from matplotlib.figure import Figure

    line = np.array([[2.0, 2.0, 0.0], [5.0, 3.0, 0.0]])
    axes = plot_costmap(costmap, plan=line, trajectory=line, goal=GOAL, scan=line, ax=Figure().subplots())
    shown = [text.get_text() for text in axes.get_legend().get_texts()]
    assert {"plan", "chosen trajectory", "scan", "goal"} <= set(shown)


def test_the_title_of_a_film_does_not_tell_the_end(record, tmp_path, monkeypatch):
    from navstack.plot import animate_run
    from navstack.plot import film as animate

    titles = []

    class Stop(Exception):
        pass

    def film(record, title, dpi):
        titles.append(title)
        raise Stop

    monkeypatch.setattr(animate, "Film", film)
    with pytest.raises(Stop):
        animate_run(record, tmp_path / "run.gif")
    assert titles == [circumstances(record)]


def test_text_in_backticks_is_code_in_reports():
    from navstack.studies.report import ReportHeader, sensitivity_page

    picture = ROOT / "docs" / "images" / "states.png"
    page = "\n".join(sensitivity_page([], ReportHeader("a <b>", "p", "", "with `vx_samples`"), picture))
    assert "with <code>vx_samples</code>" in page
    assert "a &lt;b&gt;" in page
    assert "`" not in page.replace("base64", "")
    assert "overflow-x: auto" in page and 'name="viewport"' in page


def test_turning_in_place_and_standing_are_marked() -> None:
    """48 s of turning in place left no trace in the picture of a run."""
    from navstack.plot.run import long_stalls

    run = synthetic.record_run(3.0)
    record = run.record()
    assert long_stalls(record) == []
    count = len(record.times)
    times = np.arange(count) * 1.0  # the same drive, slower: then all of it at one place
    record.times[:] = times
    record.poses[:] = record.poses[0]
    record.poses[:, 2] = 0.5 * times
    (stall,) = long_stalls(record)
    assert stall.duration == pytest.approx(times[-1])
    assert stall.turned_rad == pytest.approx(0.5 * times[-1], rel=0.01)
    axes = plot_run(record)
    assert any(text.get_text() == f"{times[-1]:.0f} s" for text in axes.texts)
    legend = axes.figure.legends[0] if axes.figure.legends else axes.get_legend()
    assert f"turned in place ({times[-1]:.0f} s)" in [t.get_text() for t in legend.get_texts()]


def test_stalls_at_one_place_are_one_mark() -> None:
    from navstack.plot.run import Stall, _merged  # pyright: ignore[reportPrivateUsage]

    stalls = [Stall(0.0, 5.0, 1.0, 1.0, 2.0), Stall(9.0, 12.0, 1.05, 1.0, 0.5), Stall(20.0, 24.0, 3.0, 1.0, 4.0)]
    assert _merged(stalls) == [Stall(0.0, 8.0, 1.0, 1.0, 2.5), stalls[2]]


def test_the_legend_has_unknown_cells_only_where_there_are_some() -> None:
    from navstack.plot.picture import occupancy_legend

    known = OccupancyGrid(np.array([[0, 100], [0, 0]], np.int8), GridGeometry(2, 2, 0.1, 0.0, 0.0))
    assert [name for _, name in occupancy_legend(known)] == ["free", "occupied"]
    partly = OccupancyGrid(np.array([[0, -1], [0, 0]], np.int8), GridGeometry(2, 2, 0.1, 0.0, 0.0))
    assert [name for _, name in occupancy_legend(partly)] == ["free", "unknown"]


def test_a_turn_in_place_is_told_in_degrees() -> None:
    record = synthetic.record_run(3.0).record()
    record.poses[:] = record.poses[0]
    record.poses[:, 2] = np.linspace(0.0, math.pi / 2, len(record.times))
    assert "turned 90 degrees in" in headline(record)
    assert " m in" not in headline(record)


def test_a_refused_goal_shows_the_nearest_free_cell_and_many_plans_stay_thin() -> None:
    from navstack.plot.plan import draw_failure, points_of

    failure = {"nearest_free": [0.2, 0.3], "x": 0.0, "y": 0.0}
    assert points_of(failure).tolist() == [[0.2, 0.3]]
    axes = plot_costmap(Costmap(GridGeometry(10, 10, 0.1, 0.0, 0.0)))
    assert [name for _, name in draw_failure(axes, failure, None)] == ["nearest free cell"]
    line = Path(np.array([[0.1, 0.1, 0.0], [0.8, 0.8, 0.0]]))
    plans = {f"planner {k}": Plan(line, 1.0, Pose2D(0.8, 0.8, 0.0)) for k in range(7)}
    costmap = Costmap(GridGeometry(10, 10, 0.1, 0.0, 0.0))
    drawn = plot_plan(costmap, plans, start=Pose2D(0.1, 0.1, 0.0), goal=Pose2D(0.8, 0.8, 0.0))
    assert max(found.get_linewidth() for found in drawn.lines) <= 7.5
