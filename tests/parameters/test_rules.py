"""Checks across parameters: each rule finds its own combination, with the numbers, and nothing else."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest

from navstack.costmap import InflationLayer
from navstack.local_planner.dwa import make_critics
from navstack.parameters import Finding
from navstack.parameters.configuration import check_parameters, load_configuration
from navstack.parameters.rules import rules_page
from navstack.plugins import LAYERS, REGISTRIES, RULES, CheckContext, LayerTraits, ParamModel, Problem, param, rule
from tests.parameters.test_configuration import INFLATION, OBSTACLE, SCAN, STATIC, robot


def found(rule: str, **more: Any) -> Finding:
    (one,) = [f for f in check_parameters([robot(**more)]) if f.rule == rule]
    return one


def rules_of(**more: Any) -> set[str]:
    return {f.rule for f in check_parameters([robot(**more)]) if f.severity != "info"}


OLD = {"path_distance_bias": 64.0, "goal_distance_bias": 24.0, "occdist_scale": 0.5, "sim_time": 1.0, "max_vel_x": 0.5}


def test_the_scoring_scale_of_before_2018() -> None:
    """Parity 31, with the turtlebot's numbers."""
    one = found("scoring-scale", DWAPlannerROS=OLD, local_costmap__resolution=0.05)
    # noetic: goal and goal_front 2 * 24 a meter; 0.5 * 252 at the inscribed radius
    for number in (
        "is worth 48",
        "horizon of 0.5 m 24",
        "costs 126",
        "24 per meter, 6.3 per obstacle",
        "divide occdist_scale by 10",
        "indigo",
    ):
        assert number in one.message
    assert one.key == "DWAPlannerROS/occdist_scale"
    assert "scoring-scale" not in rules_of(DWAPlannerROS=OLD, navstack={"ros_distro": "indigo"})
    # a tenth of it, the value that worked on the real stack
    assert "scoring-scale" not in rules_of(DWAPlannerROS={**OLD, "occdist_scale": 0.05})
    assert "scoring-scale" not in rules_of()


def test_the_scoring_scale_of_trajectory_rollout_with_meter_scoring() -> None:
    """The weights of the published jackals, which spin in place in 13 of 50 BARN worlds (parity 31)."""
    weights = {"meter_scoring": True, "goal_distance_bias": 1.0, "path_distance_bias": 0.75, "occdist_scale": 0.1}
    rollout = {"base_local_planner": "base_local_planner/TrajectoryPlannerROS"}
    one = found("scoring-scale", **rollout, TrajectoryPlannerROS={**weights, "sim_time": 2.0, "max_vel_x": 0.5})
    for number in ("is worth 1 ", "costs 25.2", "1 per meter, 1.26 per obstacle", "divide occdist_scale by 20"):
        assert number in one.message
    old = {**rollout, "TrajectoryPlannerROS": {**weights, "sim_time": 2.0, "max_vel_x": 0.5}}
    assert "scoring-scale" not in rules_of(**old, navstack={"ros_distro": "indigo"})
    # without meter_scoring, distances count cells and progress weighs 20 times more
    assert "scoring-scale" not in rules_of(
        **rollout, TrajectoryPlannerROS={"occdist_scale": 0.1, "goal_distance_bias": 1.0}
    )


ROLLOUT = {"base_local_planner": "base_local_planner/TrajectoryPlannerROS"}


@pytest.mark.parametrize(("distro", "weights"), [("noetic", (0.6, 0.8)), ("indigo", (32.0, 24.0))])
def test_weights_that_are_not_set_are_the_defaults_of_their_time(distro: str, weights: tuple[float, float]) -> None:
    params = load_configuration([robot()], distro=distro).local_planner.params
    assert (params.path_distance_bias, params.goal_distance_bias) == weights
    of_critics = {c.name: c.params for c in make_critics(params)}
    assert (of_critics["path"].path_distance_bias, of_critics["goal"].goal_distance_bias) == weights
    both = robot(DWAPlannerROS={"path_distance_bias": 10.0})
    assert load_configuration([both], distro=distro).local_planner.params.path_distance_bias == 10.0


def test_half_a_turn_outlasts_the_oscillation_timeout() -> None:
    slow: dict[str, Any] = {
        "oscillation_timeout": 10.0,
        "DWAPlannerROS": {"max_vel_theta": 0.04, "min_vel_theta": 0.02},
    }
    one = found("slow-turn", **slow)
    assert "78.5 s at max_vel_theta 0.04, longer than oscillation_timeout = 10 s" in one.message
    assert (one.key, one.severity, one.suggestion) == ("oscillation_timeout", "warning", "157")
    assert "slow-turn" not in rules_of(**{**slow, "oscillation_timeout": 157.5})
    assert "slow-turn" not in rules_of(**{**slow, "oscillation_timeout": 0.0})  # no timeout
    assert "slow-turn" not in rules_of(oscillation_timeout=10.0)


def test_a_robot_without_a_footprint() -> None:
    bare = robot(local_costmap__radius=0.4)
    del bare["local_costmap"]["robot_radius"]
    (one,) = [f for f in check_parameters([bare]) if f.rule == "default-footprint"]
    assert "of local_costmap is set" in one.message and "radius of ROS, 0.46 m" in one.message
    # of move_base, for both costmaps
    assert not [f for f in check_parameters([{**bare, "robot_radius": 0.2}]) if f.rule == "default-footprint"]
    bare["local_costmap"]["footprint"] = [[0.2, 0.2], [0.2, -0.2], [-0.2, -0.2], [-0.2, 0.2]]
    assert not [f for f in check_parameters([bare]) if f.rule == "default-footprint"]


def test_a_global_costmap_that_is_only_a_window() -> None:
    rolling = {"global_costmap__rolling_window": True, "global_costmap__width": 6.0, "global_costmap__height": 8.0}
    one = found("global-window", **rolling)
    assert "covers 6 x 8 m around the robot" in one.message and "set rolling_window: false" in one.message
    empty = {"global_costmap__plugins": [OBSTACLE, INFLATION], "global_costmap__origin_x": -2.0}
    one = found("global-window", **empty)
    assert "covers 10 x 10 m from (-2, 0)" in one.message and "list a static layer" in one.message
    assert "global-window" not in {f.rule for f in check_parameters([robot()])}


def test_standing_still_is_a_sample_of_trajectory_rollout() -> None:
    one = found("standing-sample", **ROLLOUT)
    assert (one.severity, one.suggestion) == ("info", "0.1")
    moving = robot(**ROLLOUT, TrajectoryPlannerROS={"min_vel_x": 0.1})
    assert "standing-sample" not in {f.rule for f in check_parameters([moving])}


def test_previous_names_tell_of_the_scoring_of_before_2018() -> None:
    one = found("dated-names", DWAPlannerROS={"max_trans_vel": 0.5, "max_rot_vel": 1.0})
    assert one.severity == "info" and one.key == "DWAPlannerROS/max_trans_vel"
    assert (
        "max_trans_vel and max_rot_vel are names from before 2018" in one.message and "--distro indigo" in one.message
    )
    both = robot(DWAPlannerROS={"max_trans_vel": 0.5, "max_vel_theta": 1.0})
    known = robot(DWAPlannerROS={"max_trans_vel": 0.5}, navstack={"ros_distro": "indigo"})
    heavy = robot(DWAPlannerROS={**OLD, "max_trans_vel": 0.5}, local_costmap__resolution=0.05)
    assert "scoring-scale" in {f.rule for f in check_parameters([heavy])}
    for quiet in (both, known, heavy, robot(), robot(**ROLLOUT)):
        assert "dated-names" not in {f.rule for f in check_parameters([quiet])}


def test_speeds_that_are_too_coarse_to_reach_the_goal() -> None:
    """Clearpath's DWA: 5 Hz, 2.5 m/s², 3 speeds up to 0.5 m/s, 1.7 s, tolerance 0.2 m."""
    clearpath = {"vx_samples": 3, "sim_time": 1.7, "acc_lim_x": 2.5, "max_vel_x": 0.5, "max_vel_trans": 0.5,
                 "min_vel_x": 0.0, "min_vel_trans": 0.1, "xy_goal_tolerance": 0.2}  # fmt: skip
    one = found("coarse-speeds", controller_frequency=5.0, DWAPlannerROS=clearpath)
    assert one.severity == "warning" and one.suggestion == "4"
    assert "trajectory is 0.425 m long" in one.message and "raise xy_goal_tolerance to 0.22" in one.message
    one = found("coarse-speeds", controller_frequency=5.0, DWAPlannerROS={**clearpath, "sim_time": 40.0})
    assert one.suggestion is None and "set vx_samples" not in one.message
    for fine in ({"vx_samples": 4}, {"xy_goal_tolerance": 0.22}, {"sim_time": 1.5}):
        good = robot(controller_frequency=5.0, DWAPlannerROS={**clearpath, **fine})
        assert "coarse-speeds" not in {f.rule for f in check_parameters([good])}


def test_a_path_that_outweighs_the_goal() -> None:
    one = found("heavy-path", DWAPlannerROS={"path_distance_bias": 90.0, "goal_distance_bias": 24.0})
    assert (one.severity, one.suggestion) == ("info", "32") and "is 3.8 times goal_distance_bias" in one.message
    turtlebot = robot(DWAPlannerROS={"path_distance_bias": 64.0, "goal_distance_bias": 24.0})
    assert "heavy-path" not in {f.rule for f in check_parameters([turtlebot])}


def test_weights_that_are_large_on_both_scales_do_not_suggest_indigo() -> None:
    one = found("scoring-scale", DWAPlannerROS={**OLD, "occdist_scale": 50.0})
    assert "set navstack/ros_distro" not in one.message
    assert "divide" in one.message


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rule", "more", "numbers"),
    [
        ("window-too-small", {"DWAPlannerROS": {"sim_time": 4.0, "max_vel_x": 1.5, "max_vel_trans": 2.0}},
         ("5 m", "6.33", "12.7 m", "max_vel_x 1.5")),
        ("cannot-start", {"DWAPlannerROS": {"acc_lim_x": 1.0, "acc_lim_theta": 2.0}}, ("0.05", "0.1 rad/s", "20 Hz")),
        ("stopping-time", {"DWAPlannerROS": {"max_vel_x": 3.0, "max_vel_trans": 1.0, "acc_lim_x": 0.5}},
         ("2 s", "1.7 s", "max_vel_trans 1 m/s")),
        ("coarse-simulation", {"DWAPlannerROS": {"sim_granularity": 0.2, "sim_time": 1.2, "acc_lim_x": 0.5}},
         ("0.2 m", "0.17 m/s", "1.2 s", "0.036 m", "0.025 m or less")),
        ("min-vel-trans-zero", {"DWAPlannerROS": {"min_vel_trans": 0.0}}, ("0.4",)),
        ("tolerance-under-cell", {"DWAPlannerROS": {"xy_goal_tolerance": 0.01}}, ("0.01", "0.05")),
        ("yaw-tolerance", {"DWAPlannerROS": {"yaw_goal_tolerance": 0.005}}, ("0.005", "0.02")),
        ("inflation-under-radius", {"local_costmap__inflation_layer": {"inflation_radius": 0.1}}, ("0.1", "0.214", "0.22")),
        ("no-gradient", {"local_costmap__inflation_layer": {"cost_scaling_factor": 100.0, "inflation_radius": 0.6},
                         "local_costmap__resolution": 0.1}, ("100", "0.055", "0.1")),
        ("no-gradient", {"local_costmap__inflation_layer": {"cost_scaling_factor": 0.0}}, ("same cost",)),
        ("inflation-not-last", {"local_costmap__plugins": [INFLATION, OBSTACLE]}, ("obstacle_layer", "local_costmap")),
        ("marks-beyond-clearing", {"local_costmap__obstacle_layer": {**SCAN, "obstacle_range": 4.0}}, ("4", "3")),
        ("drops-every-point", {"local_costmap__obstacle_layer": {**SCAN, "max_obstacle_height": 0.1,
                               "scan": {**SCAN["scan"], "min_obstacle_height": 0.2}}}, ("0.2", "0.1")),
        ("fixed-window", {"local_costmap__rolling_window": False}, ("rolling_window",)),
        ("blind", {"local_costmap__plugins": [INFLATION]}, ("sensor",)),
        ("footprint-beside-center", {"footprint": [[0.5, 0.1], [1.0, 0.1], [1.0, 0.5]]}, ("(0, 0)",)),
        ("base-frames-differ", {"local_costmap__robot_base_frame": "base_footprint"}, ("base_link", "base_footprint")),
        ("unknown-not-tracked", {"NavfnROS": {"allow_unknown": False},
                                 "global_costmap__static_layer": {"track_unknown_space": False}}, ("track_unknown_space",)),
        ("updates-too-slow", {"local_costmap__update_frequency": 1.0}, ("0.55 m", "20")),
        ("simulated-robot-blind", {"navstack": {"sim": {"laser": {"topic": "front/scan"}}}}, ("front/scan", "scan")),
        ("simulated-robot-blind", {"navstack": {"sim": {"laser": {"height": 2.5}}}}, ("2.5 m", "from 0 to 2 m")),
    ],
)  # fmt: skip
def test_each_rule_finds_its_combination_with_the_numbers(
    rule: str, more: dict[str, Any], numbers: tuple[str, ...]
) -> None:
    findings = [f for f in check_parameters([robot(**more)]) if f.rule == rule]
    assert findings
    assert all(f.severity == "warning" for f in findings)
    for number in numbers:
        assert number in findings[0].message
    # a warning does not prevent loading, and the correct robot has none
    load_configuration([robot(**more)])
    assert rule not in rules_of()


def test_steep_inflation_of_a_robot_whose_corners_reach_far() -> None:
    long = {"footprint": [[0.1, 0.2], [0.1, -0.2], [-0.4, -0.2], [-0.4, 0.2]]}
    reach = math.hypot(0.4, 0.2) - 0.1  # padding moves both radii outward
    factor = math.log(252.0 / 20.0) / reach

    def finding(cost_scaling_factor: float, inflation_radius: float = 0.8, **more: Any) -> list[Finding]:
        layer = {"cost_scaling_factor": cost_scaling_factor, "inflation_radius": inflation_radius}
        both = {f"{c}_costmap__inflation_layer": layer for c in ("global", "local")}
        return [f for f in check_parameters([robot(**{**both, **long, **more})]) if f.rule == "steep-inflation"]

    [found] = finding(factor)
    assert found.severity == "info" and found.key.startswith("global_costmap/")  # the plan is made there
    assert "(0.46 m from its center), the cost is 19 of 252" in found.message
    assert found.suggestion is not None and not finding(float(found.suggestion))
    assert finding(0.9 * factor) == []
    assert finding(factor, footprint=None, robot_radius=0.4) == []
    assert finding(factor, 0.4) == []  # inflation-under-radius says it


def test_dwa_is_as_fast_as_the_lower_of_its_two_limits() -> None:
    """A sample above max_vel_trans is rejected, so a greater max_vel_x reaches no farther."""
    fast = {"max_vel_x": 4.0, "max_vel_trans": 0.5, "sim_time": 2.0, "acc_lim_x": 1.0}
    assert rules_of(DWAPlannerROS=fast).isdisjoint({"window-too-small", "stopping-time", "updates-too-slow"})
    one = found("updates-too-slow", DWAPlannerROS=fast, local_costmap__update_frequency=1.0)
    assert "0.5 m between two updates (max_vel_trans 0.5 m/s)" in one.message


def test_a_recovery_layer_of_one_costmap_is_accepted() -> None:
    clear = {"name": "r", "type": "clear_costmap_recovery/ClearCostmapRecovery"}
    named = {"recovery_behaviors": [clear], "r": {"layer_names": ["static_layer"]}}
    assert "no-such-layer" not in rules_of(**named)
    # but not if only the local costmap is cleared
    named["r"] = {"layer_names": ["static_layer"], "affected_maps": "local"}
    assert found("no-such-layer", **named).severity == "error"


def test_unknown_space_is_tracked_by_the_static_layer() -> None:
    assert "unknown-not-tracked" not in rules_of(NavfnROS={"allow_unknown": False})
    assert "unknown-not-tracked" not in rules_of(
        NavfnROS={"allow_unknown": False}, global_costmap__plugins=[STATIC, INFLATION]
    )


def test_rules_are_skipped_if_a_source_cannot_be_read() -> None:
    findings = check_parameters([robot(local_costmap__rolling_window=False), "nowhere"])
    assert {f.rule for f in findings if f.severity != "info"} == {"no-source"}


def test_the_page_of_rules_is_that_of_the_registry() -> None:
    """`python tools/rules_page.py` writes it."""
    root = Path(__file__).parents[2]
    for registry in REGISTRIES:
        list(registry)
    page = (root / "docs" / "reference" / "rules.md").read_text(encoding="utf-8")
    assert page == rules_page()
    own = {name: one for name, one in RULES.items() if one.module.startswith("navstack.")}
    assert re.findall(r"^## (.+)$", page, re.MULTILINE) == [*sorted(own), "Your own rules"]
    assert len(own) >= 60
    assert all(len(one.text.split()) > 10 for one in own.values())


def test_every_rule_of_a_plugin_is_in_the_registry() -> None:
    declared: set[tuple[str, str]] = set()
    for path in (Path(__file__).parents[2] / "navstack").rglob("*.py"):
        declared |= set(
            re.findall(r'Issue\(\s*"(error|warning|info)",\s*"([a-z-]+)"', path.read_text(encoding="utf-8"))
        )
    assert len(declared) >= 20
    assert {name for _, name in declared} <= set(RULES)
    assert {(RULES[name].severity, name) for _, name in declared} <= declared


def test_a_name_of_a_rule_is_used_once() -> None:
    with pytest.raises(ValueError, match='"blind" is registered already'):
        rule("blind", "warning")(lambda configuration: iter(()))


def test_zero_sideways_samples_count_as_one() -> None:
    """As in ROS, which clamps to 1."""
    one = found("counts-as-one", DWAPlannerROS={"vy_samples": 0})
    assert (one.severity, one.suggestion) == ("info", "1")
    assert rules_of(DWAPlannerROS={"vy_samples": 0}) == set()


class _TheirParams(ParamModel):
    """A layer of a third party with a rule."""

    reach: float = param(1.0, "reach", unit="m")

    @rule("their-reach", "warning")
    def covers_the_robot(self, context: CheckContext) -> Iterator[Problem]:
        """Their page."""
        if self.reach < 0.0:
            raise RuntimeError("negative reach")
        radius = context.costmap.footprint.circumscribed_radius
        if self.reach < radius:
            where = f"{context.name} in {context.costmap.name}"
            message = f"reach = {self.reach:g} m of {where} is less than {radius:.3g} m; raise it"
            yield Problem(("reach", "/local_costmap/robot_radius"), message, "1")


class _TheirLayer(InflationLayer):
    Params: ClassVar[type[ParamModel]] = _TheirParams

    @classmethod
    def traits(cls, params: Any) -> LayerTraits:
        return LayerTraits(fed_by_sensors=False, inflates=False)


@pytest.fixture
def theirs(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """An entry for a list of layers of a type that a third party registers."""
    list(LAYERS)
    monkeypatch.setattr(LAYERS, "_entries", dict(LAYERS._entries))
    monkeypatch.setattr(LAYERS, "_lookup", dict(LAYERS._lookup))
    LAYERS.add("their_layer", _TheirLayer, aliases=("theirs/TheirLayer",), origin="theirs")
    return {"name": "own", "type": "theirs/TheirLayer"}


def test_a_third_party_plugin_declares_its_rules(theirs: dict[str, str]) -> None:
    layers = {"local_costmap__plugins": [OBSTACLE, theirs, INFLATION]}
    one = found("their-reach", **layers, local_costmap__own={"reach": 0.1})
    assert (one.severity, one.key, one.suggestion) == ("warning", "local_costmap/own/reach", "1")
    assert one.message == "reach = 0.1 m of own in local_costmap is less than 0.214 m; raise it"
    assert "their-reach" not in rules_of(**layers, local_costmap__own={"reach": 0.5})
    # its traits count for the rules of others
    assert "blind" in rules_of(local_costmap__plugins=[theirs])


def test_a_rule_that_raises_does_not_prevent_loading(theirs: dict[str, str]) -> None:
    more = {"local_costmap__plugins": [OBSTACLE, theirs, INFLATION], "local_costmap__own": {"reach": -1.0}}
    one = found("check-failed", **more)
    assert one.message == (
        "the check of _TheirParams failed with RuntimeError: negative reach; report this to the author of the plugin"
    )
    load_configuration([robot(**more)])
