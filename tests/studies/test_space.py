from __future__ import annotations

from pathlib import Path

import pytest

from navstack.core import InputError
from navstack.parameters import Configuration, load_configuration, parameters_of
from navstack.studies.search_space import candidates
from navstack.studies.search_space_parser import (
    GLOBAL_PLANNERS,
    LOCAL_PLANNERS,
    Range,
    default_space,
    parse_search_space,
)

INFLATION = "inflation_layer/inflation_radius"


@pytest.fixture(scope="module")
def turtlebot() -> Configuration:
    return load_configuration(["turtlebot"])


def test_default_space_covers_planner_and_costmaps_and_loads(turtlebot: Configuration) -> None:
    space = default_space(turtlebot)
    names = {d.name for d in space}
    assert {"DWAPlannerROS/sim_time", "DWAPlannerROS/path_distance_bias", f"global_costmap/{INFLATION}"} <= names
    # speeds end at the current value; the inflation of both costmaps is tied
    by_name = {d.name: d for d in space}
    assert by_name["DWAPlannerROS/max_vel_theta"].high == 5.0
    assert by_name[f"global_costmap/{INFLATION}"].names == (f"global_costmap/{INFLATION}", f"local_costmap/{INFLATION}")
    assert by_name["DWAPlannerROS/max_vel_x"].ties == (("DWAPlannerROS/max_vel_trans", 1.0),)
    for candidate in (space.present(), space.start(), *candidates(space, "lhs", samples=5, points=1, seed=0)):
        load_configuration(["turtlebot"], overrides=space.overrides(candidate))


@pytest.mark.parametrize("plugin", [*LOCAL_PLANNERS, *GLOBAL_PLANNERS])
def test_a_search_starts_inside_its_ranges(plugin: str) -> None:
    for name, values in {**LOCAL_PLANNERS, **GLOBAL_PLANNERS}[plugin].items():
        if isinstance(values, Range):
            assert values.low <= values.start <= values.high, name
            assert values.low > 0.0 or not values.log, name
        else:
            assert values.start in values.values, name


def test_default_space_of_mppi() -> None:
    """Weights of the listed critics, and limits up to those of the robot."""
    listed = {"MPPIController": {"critics": ["CostCritic", "PathFollowCritic"], "vx_max": 0.4}}
    base = load_configuration(["turtlebot_mppi", listed])
    by_name = {d.name: d for d in default_space(base, "local_planner")}
    assert "MPPIController/CostCritic/cost_weight" in by_name
    assert "MPPIController/PathAlignCritic/cost_weight" not in by_name
    assert by_name["MPPIController/vx_max"].high == 0.4 and by_name["MPPIController/temperature"].log


def test_default_space_of_dwb_in_a_file_of_nav2() -> None:
    """Scales of the listed critics; a user may write the names as Nav2 does."""
    base = load_configuration(["nav2_turtlebot"])
    space = default_space(base, "local_planner")
    by_name = {d.name: d for d in space}
    assert by_name["DWBLocalPlanner/PathDist/scale"].log
    assert "DWBLocalPlanner/ObstacleFootprint/scale" not in by_name
    assert by_name["DWBLocalPlanner/max_vel_x"].ties == (("DWBLocalPlanner/max_speed_xy", 1.0),)
    for candidate in (space.present(), space.start(), *candidates(space, "lhs", samples=3, points=1, seed=0)):
        load_configuration(["nav2_turtlebot"], overrides=space.overrides(candidate))
    for name in ("FollowPath.PathDist.scale", "controller_server.FollowPath.PathDist.scale"):
        found = parse_search_space(base, params=[f"{name}=5:60"])
        assert [d.name for d in found] == ["DWBLocalPlanner/PathDist/scale"]


@pytest.mark.parametrize(
    ("robot", "name"),
    [
        ("turtlebot_rpp", "RegulatedPurePursuitController/lookahead_dist"),
        ("turtlebot_shim", "RotationShimController/angular_dist_threshold"),
        ("turtlebot_graceful", "GracefulController/k_phi"),
    ],
)
def test_default_space_of_followers(robot: str, name: str) -> None:
    """Every dimension is a parameter that can be loaded at both ends."""
    base = load_configuration([robot])
    space = default_space(base, "local_planner")
    assert name in {d.name for d in space}
    for end in (0, 1):
        candidate = {d.name: (d.low, d.high)[end] for d in space if hasattr(d, "low")}
        load_configuration([robot], overrides=[f"{key}={value}" for key, value in candidate.items()])


def test_default_space_of_trajectory_planner() -> None:
    base = load_configuration(["turtlebot"], overrides=["base_local_planner=base_local_planner/TrajectoryPlannerROS"])
    by_name = {d.name: d for d in default_space(base)}
    turning = by_name["TrajectoryPlannerROS/max_vel_theta"]
    assert dict(turning.settings(0.8)) == {
        "TrajectoryPlannerROS/max_vel_theta": 0.8,
        "TrajectoryPlannerROS/min_vel_theta": -0.8,
    }


def test_parameter_names_and_patterns(turtlebot: Configuration) -> None:
    space = parse_search_space(
        turtlebot, params=["max_rot_vel=0.5:2", "sim_time", "use_dwa", f"*_costmap/{INFLATION}=0.3:0.8"]
    )
    by_name = {d.name: d for d in space}
    assert (by_name["DWAPlannerROS/max_vel_theta"].low, by_name["DWAPlannerROS/max_vel_theta"].high) == (0.5, 2.0)
    assert (by_name["DWAPlannerROS/sim_time"].low, by_name["DWAPlannerROS/sim_time"].high) == (0.25, 4.0)
    assert by_name["DWAPlannerROS/sim_time"].log
    assert by_name["DWAPlannerROS/use_dwa"].choices == (False, True)
    assert len(by_name[f"global_costmap/{INFLATION}"].names) == 2


def test_a_given_range_replaces_the_default_one_and_keeps_its_ties(turtlebot: Configuration) -> None:
    space = parse_search_space(turtlebot, space="auto", params=["DWAPlannerROS/max_vel_x=0.1:0.4"], keep=["vx_samples"])
    by_name = {d.name: d for d in space}
    assert by_name["DWAPlannerROS/max_vel_x"].high == 0.4
    assert by_name["DWAPlannerROS/max_vel_x"].ties == (("DWAPlannerROS/max_vel_trans", 1.0),)
    assert "DWAPlannerROS/vx_samples" not in by_name


def test_kept_parameters_are_not_searched(turtlebot: Configuration) -> None:
    both = (f"global_costmap/{INFLATION}", f"local_costmap/{INFLATION}")

    def searched(*keep: str) -> set[str]:
        return {n for d in parse_search_space(turtlebot, space="auto", keep=keep) for n in d.names}

    everything = searched()
    assert set(both) <= everything
    for kept in both:  # both are tied, and each can be excluded
        assert searched(kept) == everything - {kept}
    assert searched(f"*/{INFLATION}") == everything - set(both)
    speeds = {"DWAPlannerROS/max_vel_x", "DWAPlannerROS/max_vel_trans"}
    assert searched("max_vel_trans") == everything - {"DWAPlannerROS/max_vel_trans"}
    assert searched("max_vel_x") == everything - speeds  # the parameter that follows it is removed too


def test_space_file(turtlebot: Configuration, tmp_path: Path) -> None:
    file = tmp_path / "space.yaml"
    file.write_text(
        "DWAPlannerROS:\n  sim_time: [0.5, 3]\n  occdist_scale: {low: 0.001, high: 1, log: true}\n"
        f'  vx_samples: {{choices: [3, 6]}}\n"*/{INFLATION}": [0.3, 0.9]\n'
    )
    by_name = {d.name: d for d in parse_search_space(turtlebot, space=str(file))}
    assert by_name["DWAPlannerROS/occdist_scale"].log
    assert by_name["DWAPlannerROS/vx_samples"].grid(9) == [3, 6]
    assert len(by_name[f"global_costmap/{INFLATION}"].names) == 2


WRONG_PARAMS = [
    ("DWAPlannerROS/sim_tim=1:2", 'did you mean "DWAPlannerROS/sim_time"?'),
    ("sim_time=4:1", "the range of DWAPlannerROS/sim_time is empty: 4 is not below 1"),
    ("sim_time=2:2", "is empty"),
    ("sim_time=-1:1", "must be above 0 s, not -1 to 1"),
    ("sim_time=1:x", "not a number"),
    ("sim_time=1:2:cubic", 'unknown scale "cubic"'),
    ("sim_time=1:.inf", "must be finite"),
    ("min_vel_x=-1:1:log", "a log scale needs values above 0"),
    ("sim_time=", "NAME=LOW:HIGH"),
    ("=1:2", "NAME=LOW:HIGH"),
    ("sim_time=1,,2", "a value is missing"),
    ("sim_time=1", "at least two values"),
    ("vx_samples=1.2:1.9", "contains fewer than two"),
    ("vx_samples=3,4.5", "it takes integers"),
    ("use_dwa=1,2", "cannot be 1; it takes false, true"),
    ("use_dwa=0:1", "is not a number; give its choices"),
    ("critics", "neither a number nor a choice"),
    ("twirling_scale", "no range is known for DWAPlannerROS/twirling_scale"),
    ("inflation_radius=0.3:1", "is ambiguous"),
    ("*/no_such=0:1", "no parameter matches"),
    ("nonsense=0:1", "no parameter in use is named"),
]


@pytest.mark.parametrize(("text", "expected"), WRONG_PARAMS)
def test_wrong_param(turtlebot: Configuration, text: str, expected: str) -> None:
    with pytest.raises(InputError) as error:
        parse_search_space(turtlebot, params=[text])
    assert expected in error.value.message
    assert "\n" not in error.value.message


WRONG_FILES = [
    ("DWAPlannerROS: {sim_time: [1]}", "space.yaml:1:27: a range needs two numbers, not 1"),
    ("DWAPlannerROS: {sim_time: 3}", "is not a range; write"),
    ("DWAPlannerROS: {sim_time: {low: 1}}", "high of DWAPlannerROS/sim_time is missing"),
    ("DWAPlannerROS: {sim_time: {low: 1, hihg: 2}}", 'unknown key "hihg"'),
    ("DWAPlannerROS: {sim_time: {low: 1, high: 2, log: 3}}", "log must be true or false"),
    ("DWAPlannerROS: {vx_samples: {choices: 3}}", "must be a list"),
    ("DWAPlannerROS: {sim_tme: [1, 2]}", 'did you mean "DWAPlannerROS/sim_time"?'),
    ("a: [", "invalid YAML"),
]


@pytest.mark.parametrize(("text", "expected"), WRONG_FILES)
def test_wrong_space_file(turtlebot: Configuration, tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "space.yaml").write_text(text)
    with pytest.raises(InputError) as error:
        parse_search_space(turtlebot, space=str(tmp_path / "space.yaml"))
    assert expected in error.value.message
    assert "space.yaml" in error.value.message


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"space": "costmap"}, 'did you mean "costmaps"?'),
        ({"space": "global_planner"}, "the search space is empty"),
        ({"params": ["sim_time=1:2", "DWAPlannerROS/sim_time=1:3", "*/sim_time=1:2"]}, None),
    ],
)
def test_invalid_spaces(turtlebot: Configuration, options: dict[str, object], expected: str | None) -> None:
    if expected is None:  # the last one takes precedence
        assert [d.high for d in parse_search_space(turtlebot, **options)] == [2.0]  # type: ignore[arg-type]
        return
    with pytest.raises(InputError, match=expected.replace("?", r"\?")):
        parse_search_space(turtlebot, **options)  # type: ignore[arg-type]


# --- samples ----------------------------------------------------------------------------------------------------------


def test_grid_has_every_combination(turtlebot: Configuration) -> None:
    space = parse_search_space(turtlebot, params=["sim_time=1:3", "use_dwa", "vx_samples=3:5"])
    found = candidates(space, "grid", samples=0, points=3, seed=0)
    assert len(found) == 3 * 2 * 3
    assert found[0] == {"DWAPlannerROS/sim_time": 1.0, "DWAPlannerROS/use_dwa": False, "DWAPlannerROS/vx_samples": 3}
    assert len({tuple(c.values()) for c in found}) == len(found)


@pytest.mark.parametrize("method", ["random", "lhs"])
def test_samples_depend_only_on_the_seed(turtlebot: Configuration, method: str) -> None:
    space = default_space(turtlebot)
    first, again, other = (candidates(space, method, samples=6, points=1, seed=s) for s in (1, 1, 2))
    assert first == again != other
    for candidate in first:
        for d in space:
            assert d.kind == "choice" or d.low <= float(candidate[d.name]) <= d.high


def test_latin_hypercube_visits_every_stratum(turtlebot: Configuration) -> None:
    space = parse_search_space(turtlebot, params=["sim_time=0.5:4.5", "occdist_scale=0.001:1:log"])
    found = candidates(space, "lhs", samples=8, points=1, seed=3)
    assert sorted(int((float(c["DWAPlannerROS/sim_time"]) - 0.5) / 0.5) for c in found) == list(range(8))


@pytest.mark.parametrize(
    ("method", "samples", "points", "expected"),
    [
        ("latin", 5, 5, "choose grid, random, lhs"),
        ("lhs", 0, 5, "at least 1"),
        ("grid", 5, 0, "at least 1"),
        ("grid", 5, 5, "candidates; give fewer"),
    ],
)
def test_invalid_samples(turtlebot: Configuration, method: str, samples: int, points: int, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        candidates(default_space(turtlebot), method, samples=samples, points=points, seed=0)


def test_speeds_and_accelerations_never_exceed_those_of_the_yaml() -> None:
    changes = [
        [],
        ["DWAPlannerROS/max_vel_trans=0.3"],
        ["DWAPlannerROS/max_vel_x=0.2", "DWAPlannerROS/acc_lim_x=0.4", "DWAPlannerROS/acc_lim_theta=0.6"],
        ["DWAPlannerROS/max_vel_theta=0.5", "DWAPlannerROS/min_vel_x=-0.05"],
        ["DWAPlannerROS/max_vel_y=0.3", "DWAPlannerROS/acc_lim_y=1.0"],
        ["base_local_planner=base_local_planner/TrajectoryPlannerROS", "TrajectoryPlannerROS/acc_lim_x=0.7"],
        ["base_local_planner=base_local_planner/TrajectoryPlannerROS", "TrajectoryPlannerROS/min_vel_theta=-0.4"],
    ]
    limits = ("max_vel_x", "max_vel_trans", "max_vel_theta", "acc_lim_x", "acc_lim_theta", "min_vel_theta")
    for overrides in changes:
        robot = load_configuration(["turtlebot"], overrides=overrides)
        present = {p.name: p.value for p in parameters_of(robot)}
        prefix = robot.local_planner.namespace
        named = [f"{prefix}/{n}" for n in limits[:5] if f"{prefix}/{n}" in present]
        for space in (default_space(robot), parse_search_space(robot, params=named)):
            for d in space:
                if d.kind == "choice":
                    continue
                for name, value in (*d.settings(d.high), *d.settings(d.low), *d.settings(d.start or d.low)):
                    last = name.rpartition("/")[2]
                    if last in limits:
                        assert abs(float(value)) <= abs(float(present[name])) + 1e-12, (overrides, name, value)
                    if last == "min_vel_x":
                        assert float(value) >= min(0.0, present[name])
    given = parse_search_space(
        load_configuration(["turtlebot"]), space="auto", params=["DWAPlannerROS/acc_lim_x=0.5:2.5"]
    )
    assert {d.name: d.high for d in given}["DWAPlannerROS/acc_lim_x"] == 2.5  # a given range may exceed them


def test_the_limits_of_the_robot_are_exceeded_by_a_factor_only(turtlebot: Configuration) -> None:
    """Given ranges stay as they are, and all other parameters too."""
    named = ["DWAPlannerROS/acc_lim_theta=0.5:9.0"]
    one = {d.name: d for d in parse_search_space(turtlebot, space="auto", params=named)}
    three = {d.name: d for d in parse_search_space(turtlebot, space="auto", params=named, limit_factor=3.0)}
    assert list(one) == list(three)
    for name, dimension in one.items():
        if dimension.robot:
            assert three[name].high == pytest.approx(3.0 * dimension.high)
            assert three[name].low == dimension.low
        else:
            assert three[name] == dimension
    assert one["DWAPlannerROS/acc_lim_x"].robot
    assert three["DWAPlannerROS/acc_lim_theta"].high == 9.0
