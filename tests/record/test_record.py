from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest

from navstack.core import Costmap, Event, Footprint, GridGeometry, Pose2D, RobotState, Transform2D, Twist2D, Window
from navstack.plugins import LocalPlan
from navstack.record import Record, RunRecorder
from tests.record import synthetic


def a_recorder(**options) -> RunRecorder:
    options = {"map": None, "footprint": Footprint.from_radius(0.2), "scenario": {}} | options
    return RunRecorder(**options)


def saved(recorder: RunRecorder, folder) -> Record:
    recorder.save(folder)
    return Record.load(folder)


def test_a_saved_run_is_restored(tmp_path):
    recorder = synthetic.record_run(12.0, scans=True)
    files = recorder.save(tmp_path / "out")
    assert sorted(files) == ["log", "record"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["run.log", "run.npz"]
    kept = recorder.record()
    for loaded in (Record.load(tmp_path / "out"), Record.load(str(files["record"]))):
        assert loaded.path == files["record"]
        assert loaded.meta == kept.meta
        assert loaded.events == kept.events
        assert sorted(loaded.arrays) == sorted(kept.arrays)
        for name, array in kept.arrays.items():
            assert loaded.arrays[name].dtype == array.dtype
            assert loaded.arrays[name].tobytes() == array.tobytes()


def test_samples_are_restored(tmp_path):
    recorder = a_recorder(local_frame="odom_combined")
    rows = []
    for i in range(5):
        pose, odom = Pose2D(1.0 + i, 2.0, 0.1 * i), Pose2D(-i, 0.5, -0.2 * i)
        offset, twist, command = Transform2D(0.1, 0.2, 0.3 + i), Twist2D(0.3, 0.01, -i), Twist2D(0.5, 0.0, i / 7)
        rows.append((pose, odom, offset, twist, command))
        recorder.sample(
            i / 5,
            pose=pose,
            odom=RobotState(odom, twist, i / 5),
            map_to_odom=offset,
            command=command,
            state="CLEARING" if i == 3 else i,
            goal_index=i - 1,
        )
    run = saved(recorder, tmp_path)
    assert run.times.tolist() == [i / 5 for i in range(5)]
    assert run.poses.tolist() == [list(pose) for pose, *_ in rows]
    assert run.odom_poses.tolist() == [list(odom) for _, odom, *_ in rows]
    assert run.map_to_odom.tolist() == [list(offset) for _, _, offset, *_ in rows]
    assert run.velocities.tolist() == [list(twist) for *_, twist, _ in rows]
    assert run.commands.tolist() == [list(command) for *_, command in rows]
    assert run.states.tolist() == ["0", "1", "2", "CLEARING", "4"]
    assert run.goal_indices.tolist() == [-1, 0, 1, 2, 3]
    assert run.duration == 0.8
    assert run.path_length == pytest.approx(4.0)
    assert (run.global_frame, run.local_frame, run.base_frame) == ("map", "odom_combined", "base_link")
    # the last one not later than t, the first one before that
    assert run.pose_at(0.4).x == run.pose_at(0.59).x == 3.0
    assert run.pose_at(-1.0).x == 1.0
    assert run.pose_at(99.0).x == 5.0
    assert run.map_to_odom_at(0.2) == Transform2D(0.1, 0.2, 1.3)
    assert run.to_global("map", 0.2) == Transform2D()
    assert run.to_global("odom_combined", 0.2) == Transform2D(0.1, 0.2, 1.3)


def test_plans_goals_events_collisions_and_results(tmp_path):
    recorder = a_recorder(scenario={"map": "office", "goals": ((1, 2, 3),), "seed": np.int64(4)})
    first = np.array([[0.0, 0.0, 0.0], [1.0, 0.1, 0.2]])
    recorder.plan(0.0, first, "map")
    recorder.goal(0.5, Pose2D(1.0, 2.0, 3.0))
    recorder.plan(1.0, np.empty((0, 3)), "odom")
    first[:] = 7.0  # handed over and then reused
    recorder.on_event(Event(0.5, "goal", "go\nthere", {"pose": Pose2D(1, 2, 3), "n": np.float32(2.0), "nan": math.nan}))
    recorder.on_event(Event(0.7, "feedback", "", {"pose": [0, 0, 0]}))
    recorder.on_event(Event(0.9, "warning", "Ärger"))
    recorder.collision(2.0, Pose2D(4.0, 5.0, 6.0))
    recorder.finish([{"state": "ABORTED", "distance_left_m": np.float64(0.5)}])
    run = saved(recorder, tmp_path)
    assert [(plan.t, plan.frame, plan.goal, len(plan.poses)) for plan in run.plans] == [
        (0.0, "map", -1, 2),
        (1.0, "odom", 0, 0),
    ]
    assert run.plans[0].poses.tolist() == [[0.0, 0.0, 0.0], [1.0, 0.1, 0.2]]
    assert run.plan_at(-0.1) is None
    assert run.plan_at(0.99) is run.plans[0]
    assert run.goals.tolist() == [[1.0, 2.0, 3.0]]
    assert run.goal_times.tolist() == [0.5]
    assert run.collisions.tolist() == [[4.0, 5.0, 6.0]]
    assert run.events == (
        Event(0.5, "goal", "go\nthere", {"pose": [1, 2, 3], "n": 2.0, "nan": None}),
        Event(0.9, "warning", "Ärger"),
    )
    assert run.events_of("warning", "plan") == [run.events[1]]
    assert run.results == [{"state": "ABORTED", "distance_left_m": 0.5}]
    assert run.scenario == {"map": "office", "goals": [[1, 2, 3]], "seed": 4}
    assert (tmp_path / "run.log").read_text(encoding="utf-8").splitlines() == [
        "# navstack run, format 1",
        "# scenario:",
        "#   map: office",
        "#   goals:",
        "#   - [1, 2, 3]",
        "#   seed: 4",
        "     0.500  goal            go there",
        "     0.900  warning         Ärger",
        '# goal 0 {"state":"ABORTED","distance_left_m":0.5}',
    ]


def test_collisions_of_the_simulator_replace_those_added_before(tmp_path):
    class Hit:
        time, pose = 3.0, Pose2D(1.0, 1.0, 0.0)

    recorder = a_recorder()
    recorder.collision(1.0, Pose2D(0.0, 0.0))
    recorder.finish([], [Hit()])
    assert saved(recorder, tmp_path).collision_times.tolist() == [3.0]


def test_a_local_plan_keeps_its_table_in_single_precision(tmp_path):
    rng = np.random.default_rng(3)
    recorder = a_recorder()
    given = [synthetic.local_plan(rng, Pose2D(1.0, 2.0, 0.3), i) for i in range(9)]
    for i, plan in enumerate(given):
        recorder.local_plan(i / 5, plan)
    recorder.local_plan(2.0, LocalPlan(Twist2D(0.0, 0.0, 0.4), "rotate_to_goal"))
    run = saved(recorder, tmp_path)
    assert run.critics == synthetic.CRITICS
    for i, plan in enumerate(given):
        back = run.local_plan(i)
        assert (back.t, back.plan.command, back.plan.mode) == (i / 5, plan.command, "follow")
        assert back.plan.best == plan.best
        assert back.tried == 126
        assert back.rejected == np.count_nonzero(plan.rejected_by != -1)
        assert np.array_equal(back.plan.rejected_by, plan.rejected_by)
        for name in ("samples", "costs", "totals", "scales", "trajectory"):
            assert np.array_equal(getattr(back.plan, name), getattr(plan, name).astype(np.float32), equal_nan=True)
        assert back.plan.notes == plan.notes
    assert run.local_plan_at(1.0).t == 1.0
    last = run.local_plan_at(9.0)
    assert (last.t, last.plan.mode, last.plan.samples, last.plan.trajectory) == (2.0, "rotate_to_goal", None, None)
    assert run.local_plan(-1).t == 2.0
    assert run.local_plan_at(-1.0) is None


def test_planners_with_other_critics_share_the_record(tmp_path):
    def plan(critics, rejected):
        k = len(rejected)
        return LocalPlan(
            Twist2D(),
            "follow",
            np.zeros((k, 3)),
            critics,
            np.arange(k * len(critics), dtype=float).reshape(k, -1),
            np.arange(1.0, len(critics) + 1),
            np.zeros(k),
            np.array(rejected, np.int8),
        )

    recorder = a_recorder()
    recorder.local_plan(0.0, plan(("path", "goal"), [-1, 0, 1, -2]))
    recorder.local_plan(0.2, plan(("goal", "twirl"), [1, 0, -1, -2]))
    run = saved(recorder, tmp_path)
    assert run.critics == ("path", "goal", "twirl")
    first, second = run.local_plan(0).plan, run.local_plan(1).plan
    nan = math.nan
    assert np.array_equal(first.costs, [[0, 1, nan], [2, 3, nan], [4, 5, nan], [6, 7, nan]], equal_nan=True)
    assert np.array_equal(second.costs, [[nan, 0, 1], [nan, 2, 3], [nan, 4, 5], [nan, 6, 7]], equal_nan=True)
    assert first.rejected_by.tolist() == [-1, 0, 1, -2]
    assert second.rejected_by.tolist() == [2, 1, -1, -2]
    assert np.array_equal(second.scales, [nan, 1.0, 2.0], equal_nan=True)


def test_tables_of_samples_can_be_omitted(tmp_path):
    recorder = a_recorder(keep_tables=False)
    recorder.local_plan(0.0, synthetic.local_plan(np.random.default_rng(1), Pose2D(0, 0), 0))
    back = saved(recorder, tmp_path).local_plan(0)
    assert back.plan.samples is None
    assert back.tried == 126
    assert back.rejected > 0
    assert len(back.plan.trajectory) == 17


def test_a_costmap_is_restored_at_any_time(tmp_path):
    """Windows of the global costmap, whole grids of the rolling one: each update is restored cell by cell."""
    rng = np.random.default_rng(5)
    recorder = a_recorder()
    wide = Costmap(GridGeometry(60, 40, 0.1, -1.0, -2.0), frame="map")
    states: dict[str, list[tuple[float, GridGeometry, np.ndarray]]] = {"global": [], "local": []}
    for i in range(40):
        t = i / 5
        if i % 3 == 0:
            x0, y0 = int(rng.integers(0, wide.geometry.nx - 9)), int(rng.integers(0, wide.geometry.ny - 9))
            window = Window(x0, y0, x0 + 10, y0 + 10)
            if i % 2:
                wide.data[window.slices] = rng.integers(0, 255, (10, 10))
            if i == 21:  # the map server sent another map
                wide = Costmap(GridGeometry(30, 20, 0.2, 0.0, 0.0), rng.integers(0, 255, (20, 30)).astype(np.uint8))
                window = None
            recorder.costmap(t, "global_costmap", wide, window)
            states["global"].append((t, wide.geometry, wide.data.copy()))
        origin = 0.05 * (i // 4)
        local = Costmap(
            GridGeometry(20, 20, 0.05, origin, -origin), rng.integers(0, 9, (20, 20)).astype(np.uint8), "odom"
        )
        recorder.costmap(t, "local", local)
        states["local"].append((t, local.geometry, local.data.copy()))
    run = saved(recorder, tmp_path)
    assert run.costmap_names == ("global", "local")
    assert run.costmap_frame("local") == "odom"
    for name, expected in states.items():
        assert run.costmap_times(name).tolist() == [t for t, _, _ in expected]
        followed = [(t, c.geometry, c.data.copy()) for t, c in run.costmap_updates(f"{name}_costmap")]
        for (t, geometry, data), (seen, seen_geometry, seen_data) in zip(expected, followed, strict=True):
            assert (seen, seen_geometry) == (t, geometry)
            assert np.array_equal(seen_data, data)
            at = run.costmap_at(name, t + 0.01)
            assert at.geometry == geometry
            assert np.array_equal(at.data, data)
    assert run.costmap_at("local", -0.1) is None
    assert run.costmap_at("attic", 1.0) is None
    # what was handed out may be written to
    run.costmap_at("global", 0.0).data[:] = 9
    assert np.array_equal(run.costmap_at("global", 0.0).data, states["global"][0][2])


def test_small_changes_need_little_memory(tmp_path):
    recorder = a_recorder()
    costmap = Costmap(GridGeometry(500, 500, 0.1))
    for i in range(100):
        costmap.data[250 + i % 3, 250:255] = i
        recorder.costmap(i / 5, "global", costmap, Window(200, 200, 300, 300))
    assert recorder.record().arrays["costmaps/global_cells"].size <= 500 * 500 + 100 * 5


def test_scans(tmp_path):
    run = saved(synthetic.record_run(4.0, scans=True), tmp_path)
    assert len(run.scans) == 4
    scan = run.scans[2]
    assert scan.t == scan.scan.stamp == 2.0
    assert (scan.scan.topic, scan.scan.frame, scan.scan.range_max) == ("scan", "base_laser_link", 6.0)
    assert np.isinf(scan.scan.ranges[::7]).all()
    assert scan.pose == run.pose_at(2.0)


def test_an_empty_run(tmp_path):
    run = saved(a_recorder(), tmp_path)
    assert run.duration == 0.0
    assert run.path_length == 0.0
    assert run.poses.shape == run.goals.shape == run.collisions.shape == (0, 3)
    assert run.plans == run.scans == run.events == ()
    assert run.map is None
    with pytest.raises(Exception, match="no samples"):
        run.pose_at(0.0)


def test_map_and_footprint(tmp_path):
    grid = synthetic.office()
    outline = Footprint(np.array([[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]), padding=0.01)
    run = saved(a_recorder(map=grid, footprint=outline), tmp_path)
    assert np.array_equal(run.map.data, grid.data)
    assert (run.map.geometry, run.map.origin_yaw, run.map.frame) == (grid.geometry, grid.origin_yaw, grid.frame)
    assert run.footprint == outline


def test_numpy_and_json_can_read_the_file(tmp_path):
    synthetic.record_run(4.0).save(tmp_path)
    with np.load(tmp_path / "run.npz", allow_pickle=False) as run:
        assert run["samples"]["x"].shape == (20,)
        assert run["samples"].dtype.names[:4] == ("t", "x", "y", "yaw")
        assert json.loads(run["meta.json"])["format"] == "navstack-run"
        assert [json.loads(line)["kind"] for line in io.BytesIO(run["events.jsonl"])][:2] == ["goal", "plan"]


def test_the_file_of_a_full_run_is_small(tmp_path):
    """72 s at 5 Hz."""
    rng = np.random.default_rng(0)
    cells = rng.integers(0, 2, (80, 80)).astype(np.uint8) * 254
    plans = [synthetic.local_plan(rng, Pose2D(i, 0), i) for i in range(360)]
    recorder = a_recorder()
    for i, plan in enumerate(plans):
        t, pose = i / 5, Pose2D(0.05 * i, 1.0, 0.2)
        recorder.sample(
            t,
            pose=pose,
            odom=RobotState(pose),
            map_to_odom=Transform2D(),
            command=plan.command,
            state="CONTROLLING",
            goal_index=0,
        )
        recorder.local_plan(t, plan)
        recorder.costmap(t, "local", Costmap(GridGeometry(80, 80, 0.05, 0.05 * i, 0.0), cells, "odom"))
    files = recorder.save(tmp_path)
    assert files["record"].stat().st_size < 1_500_000
