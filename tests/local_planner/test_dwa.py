"""DWA: parity with C++, deliberate differences, critics of third parties."""

from __future__ import annotations

import math
import tracemalloc
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from navstack.core import (
    INSCRIBED,
    LETHAL,
    Costmap,
    Footprint,
    GridGeometry,
    InvalidPathError,
    NoValidControlError,
    Path,
    Pose2D,
    RobotState,
    Twist2D,
)
from navstack.local_planner.critics import ObstacleCritic, OscillationCritic
from navstack.local_planner.critics.obstacle import ObstacleParams
from navstack.local_planner.critics.oscillation import OscillationParams
from navstack.local_planner.dwa import DEFAULT_CRITICS, DWAParams, DWAPlanner, velocity_window
from navstack.local_planner.sampling_planner import braking_twist, turning_twist
from navstack.plugins import (
    CRITICS,
    ControlInput,
    Critic,
    ParamModel,
    PluginSpec,
    RejectionDetail,
    Rollouts,
    ScoringContext,
    VelocityLimits,
    param,
)

FOOTPRINT = Footprint.from_radius(0.18)
TURTLEBOT: dict[str, Any] = {
    "max_vel_trans": 0.5,
    "max_vel_x": 0.5,
    "max_vel_y": 0.0,
    "min_vel_y": 0.0,
    "max_vel_theta": 5.0,
    "acc_lim_x": 1.0,
    "acc_lim_y": 0.0,
    "acc_lim_theta": 2.0,
    "controller_frequency": 5.0,
    "sim_time": 1.0,
    "vx_samples": 6,
    "vy_samples": 1,
    "path_distance_bias": 64.0,
    "goal_distance_bias": 24.0,
    "occdist_scale": 0.5,
}
LINE = np.column_stack((np.linspace(0.0, 1.5, 31), np.zeros(31), np.zeros(31)))


def empty_map() -> Costmap:
    return Costmap(GridGeometry(80, 80, 0.05, -2.0, -2.0), frame="odom")


def planner_on(line: NDArray[np.float64] = LINE, **more: Any) -> DWAPlanner:
    planner = DWAPlanner(DWAParams(**{**TURTLEBOT, **more}))
    planner.set_plan(Path(line, "odom"), Pose2D(*line[-1]))
    return planner


def at(pose: Pose2D, velocity: Twist2D = Twist2D(), costmap: Costmap | None = None) -> ControlInput:
    return ControlInput(RobotState(pose, velocity), costmap or empty_map(), FOOTPRINT)


# --- parameters -------------------------------------------------------------------------------------------------------


def test_effective_defaults_are_noetics() -> None:
    p = DWAParams()
    assert (p.max_vel_trans, p.min_vel_trans, p.max_vel_theta, p.min_vel_theta) == (0.55, 0.1, 1.0, 0.4)
    assert (p.path_distance_bias, p.goal_distance_bias, p.occdist_scale) == (0.6, 0.8, 0.01)
    assert (p.vx_samples, p.vy_samples, p.vth_samples, p.sim_time) == (3, 10, 20, 1.7)
    assert not p.prune_plan and p.use_dwa and not p.latch_xy_goal_tolerance


def test_parameter_names_of_previous_releases_are_known() -> None:
    for old, new in DWAParams.RENAMED.items():
        assert new in DWAParams.model_fields and old not in DWAParams.model_fields
    assert DWAParams.RENAMED["vtheta_samples"] == "vth_samples"
    assert not set(DWAParams.NO_EFFECT) & set(DWAParams.model_fields)


@pytest.mark.parametrize("values", [{"vx_samples": 0}, {"sim_time": 0.0}, {"acc_lim_x": -1.0}, {"max_vel_x": math.nan}])
def test_rejects_values_out_of_range(values: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        DWAParams(**values)


@pytest.mark.parametrize(("distro", "factor", "obstacle"), [("noetic", 1.0, 0.5), ("indigo", 0.5, 0.5 * 0.05)])
def test_scoring_scale_of_both_distros(distro: str, factor: float, obstacle: float) -> None:
    """Parity 31."""
    plan = planner_on(ros_distro=distro).compute_command(at(Pose2D(0.0, 0.0, 0.1)))
    assert plan.scales is not None
    path, goal = 64.0 * 0.05 * factor, 24.0 * 0.05 * factor
    np.testing.assert_allclose(plan.scales, [1.0, obstacle, goal, path, path, goal, 0.0])


# --- samples and trajectories -----------------------------------------------------------------------------------------


def test_window_stays_within_limits_and_acceleration() -> None:
    limits = planner_on().limits
    window = velocity_window(Twist2D(0.3, 0.0, 4.9), limits, 0.2)
    # C++ holds the velocity as float32, and computes in double
    x, turn = float(np.float32(0.3)), float(np.float32(4.9))
    assert window.tolist() == [[x - 0.2, 0.5], [0.0, 0.0], [turn - 2.0 * 0.2, 5.0]]
    # a robot that measures a small sideways speed is not commanded to strafe
    assert velocity_window(Twist2D(0.0, 0.001, 0.0), limits, 0.2)[1].tolist() == [0.0, 0.0]
    # a robot above its limit gets the limit
    assert velocity_window(Twist2D(2.0, 0.0, 0.0), limits, 0.2)[0].tolist() == [0.5, 0.5]


def test_acceleration_limits_are_float32_as_in_cpp() -> None:
    """LocalPlannerLimits::getAccLimits returns a Vector3f: 3.2 rad/s² is 3.2000000477."""
    limits = planner_on(acc_lim_theta=3.2).limits
    assert limits.acc_lim_theta == float(np.float32(3.2)) != 3.2
    assert velocity_window(Twist2D(), limits, 0.2)[2].tolist() == [
        -limits.acc_lim_theta * 0.2,
        limits.acc_lim_theta * 0.2,
    ]
    assert turning_twist(1.0, 0.0, limits, 0.2, 0.0).wz == limits.acc_lim_theta * 0.2


def test_oscillation_distance_is_float32_as_in_cpp() -> None:
    """From 1.5 to 1.55 m is more than 0.05 m in double and less in float32."""
    start, end = 1.5, 1.55
    assert (end - start) > 0.05 and float(np.float32(end) - np.float32(start)) < 0.05
    critic = OscillationCritic("oscillation", OscillationParams(oscillation_reset_dist=0.05))
    critic.debrief(Twist2D(0.0, 0.0, 0.5), Pose2D(start, 0.0))
    critic.debrief(Twist2D(0.0, 0.0, -0.5), Pose2D(start, 0.0))
    critic.debrief(Twist2D(0.0, 0.0, -0.5), Pose2D(end, 0.0))
    assert critic.allowed_signs[2] == -1


def test_the_last_simulated_pose_is_not_scored() -> None:
    """Parity 28: 0.5 m/s for 1 s ends at 0.475 m, the pose before the last step."""
    planner = planner_on()
    planner.compute_command(at(Pose2D(0.0, 0.0), Twist2D(0.4, 0.0, 0.0)))
    why = planner.diagnostics()
    assert why is not None
    k = int(np.flatnonzero((why.rollouts.commands[:, 0] == 0.5) & (why.rollouts.commands[:, 2] == 0.0))[0])
    n = int(why.rollouts.counts[k])
    assert why.rollouts.poses[k, 0].tolist() == [0.0, 0.0, 0.0]
    assert why.rollouts.poses[k, n - 1, 0] == pytest.approx(0.475, abs=1e-6)


def test_an_angular_speed_above_pi_keeps_its_sign() -> None:
    """Parity 15: the plan leads behind a robot that turns at 4.6 rad/s."""
    planner = planner_on(-LINE)
    plan = planner.compute_command(at(Pose2D(0.0, 0.0, 0.3), Twist2D(0.0, 0.0, 4.6)))
    assert plan.command.wz > 4.0


def test_holonomic_samples_keep_their_order() -> None:
    planner = planner_on(max_vel_y=0.2, min_vel_y=-0.2, acc_lim_y=1.0, vy_samples=3, vx_samples=2, vth_samples=2)
    plan = planner.compute_command(at(Pose2D(0.0, 0.0, 0.0), Twist2D(0.3, 0.0, 0.0)))
    assert plan.samples is not None
    expected = [(x, y, w) for x in (0.1, 0.5) for y in (-0.2, 0.0, 0.2) for w in (-0.4, 0.0, 0.4)]
    np.testing.assert_allclose(plan.samples, expected, atol=1e-7)


def test_a_robot_at_rest_starts_at_any_frequency() -> None:
    """In C++ every sample is too slow if one period's acceleration stays below the lowest speeds."""
    for frequency in (20.0, 50.0):
        ahead = planner_on(controller_frequency=frequency).compute_command(at(Pose2D(0.0, 0.0, 0.0)))
        assert ahead.command.vx == pytest.approx(0.1, abs=1e-6)
        # close to a wall it turns
        wall = empty_map()
        wall.data[:, 45] = LETHAL
        aside = planner_on(-LINE, controller_frequency=frequency).compute_command(at(Pose2D(0.0, 0.0), costmap=wall))
        assert aside.command.vx == 0.0 and abs(aside.command.wz) == pytest.approx(0.4, abs=1e-6)


# --- critics ----------------------------------------------------------------------------------------------------------


def test_obstacle_scores_sum_or_maximum() -> None:
    costmap = empty_map()
    costmap.data[:, 50:] = 100
    highest = planner_on().compute_command(at(Pose2D(0.0, 0.0), Twist2D(0.4, 0.0, 0.0), costmap))
    summed = planner_on(sum_scores=True).compute_command(at(Pose2D(0.0, 0.0), Twist2D(0.4, 0.0, 0.0), costmap))
    assert highest.costs is not None and summed.costs is not None
    assert set(np.unique(highest.costs[:, 1])) <= {0.0, 100.0}
    assert (summed.costs[:, 1] >= highest.costs[:, 1]).all()
    assert (summed.costs[:, 1] % 100.0 == 0.0).all() and summed.costs[:, 1].max() > 100.0


@pytest.mark.parametrize("dot", [LETHAL, 255, 252])
def test_a_high_cost_under_the_center_hides_no_collision(dot: int) -> None:
    """A high-cost cell inside the footprint does not hide a later collision of its edges; a lethal one is a collision."""
    costmap = empty_map()
    x, y, resolution = 0.01, 0.01, costmap.geometry.resolution
    cell = costmap.geometry.world_to_cell(x, y)
    assert cell is not None
    costmap.data[cell[1], cell[0]] = dot
    costmap.data[:, cell[0] + 8] = LETHAL
    poses = np.zeros((2, 12, 3))
    poses[0, :, 0], poses[1, :, 0] = x + np.arange(12) * resolution, x
    poses[:, :, 1] = y
    rollouts = Rollouts(np.zeros((2, 3)), poses, np.full(2, 12, np.int64))
    critic = ObstacleCritic("obstacle", ObstacleParams())
    limits = planner_on().limits
    critic.prepare(ScoringContext(at(Pose2D(x, y)).state, costmap, FOOTPRINT, LINE, Pose2D(1.0, 0.0), limits))
    assert critic.score(rollouts).tolist() == [-6.0, -6.0 if dot == LETHAL else dot]
    # the edge reaches the cell behind the robot one step before the wall
    assert critic.first_collision.tolist() == ([0, 0] if dot == LETHAL else [4 if dot > LETHAL else 5, -1])


def test_local_goal_in_an_inscribed_cell_moves_back_along_the_plan() -> None:
    """Parity 27: C++ rejects every sample here."""
    costmap = empty_map()
    costmap.data[:, 68:] = INSCRIBED
    plan = planner_on().compute_command(at(Pose2D(0.0, 0.0, 0.0), costmap=costmap))
    assert plan.command.vx > 0.0
    assert any("moved back over" in note for note in plan.notes)
    assert not planner_on().compute_command(at(Pose2D(0.0, 0.0, 0.0))).notes


def test_alignment_is_off_near_the_goal() -> None:
    near = planner_on().compute_command(at(Pose2D(1.25, 0.0, 0.0)))
    far = planner_on().compute_command(at(Pose2D(0.5, 0.0, 0.0)))
    i = DEFAULT_CRITICS.index("alignment")
    assert near.scales is not None and near.scales[i] == 0.0
    assert far.scales is not None and far.scales[i] > 0.0


def test_oscillation_flags() -> None:
    critic = OscillationCritic("oscillation", OscillationParams())
    turning = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -0.5], [0.3, 0.0, 0.0]])
    rollouts = Rollouts(turning, np.zeros((3, 1, 3)), np.ones(3, np.int64))
    limits = limits_of(min_vel_trans=0.1)
    critic.prepare(ScoringContext(at(Pose2D(0.0, 0.0)).state, empty_map(), FOOTPRINT, LINE, Pose2D(1.0, 0.0), limits))
    critic.debrief(Twist2D(0.0, 0.0, 0.5), Pose2D(0.0, 0.0))
    assert critic.score(rollouts).tolist() == [0.0, 0.0, 0.0]
    critic.debrief(Twist2D(0.0, 0.0, -0.5), Pose2D(0.0, 0.0))
    assert critic.state()["rot_neg_only"]
    assert critic.score(rollouts).tolist() == [-5.0, 0.0, 0.0]
    # moved far enough: every direction is allowed
    critic.debrief(Twist2D(0.3, 0.0, 0.0), Pose2D(0.06, 0.0))
    assert not any(critic.state().values())


class _LeftParams(ParamModel):
    weight: float = param(1.0, "weight")


class _Left(Critic):
    """Prefers left turns and rejects fast right turns."""

    Params = _LeftParams
    CODES = {-9: "turns right"}  # noqa: RUF012

    @property
    def scale(self) -> float:
        return self.params.weight

    def prepare(self, context: ScoringContext) -> None:
        assert context.plan.shape[1] == 3

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        w = rollouts.commands[:, 2]
        return np.where(w < -0.2, -9.0, 1.0 - w)


def test_a_critic_of_a_third_party(monkeypatch: pytest.MonkeyPatch) -> None:
    listed = [PluginSpec(name=n, type=n) for n in DEFAULT_CRITICS]
    same = planner_on(critics=listed).compute_command(at(Pose2D(0.0, 0.0, 0.2), Twist2D(0.3, 0.0, 0.0)))
    default = planner_on().compute_command(at(Pose2D(0.0, 0.0, 0.2), Twist2D(0.3, 0.0, 0.0)))
    np.testing.assert_array_equal(same.totals, default.totals)
    assert same.command == default.command and same.critics == default.critics

    monkeypatch.setattr(CRITICS, "_entries", dict(CRITICS._entries))
    monkeypatch.setattr(CRITICS, "_lookup", dict(CRITICS._lookup))
    CRITICS.add("left", _Left, origin="test")
    entries = [{"name": n, "type": n} for n in DEFAULT_CRITICS] + [{"name": "veer", "type": "left"}]
    assert DWAParams.child_models({"critics": entries})["veer"] is _LeftParams
    planner = planner_on(
        critics=[*listed, PluginSpec(name="veer", type="left")], critic_params={"veer": _LeftParams(weight=500.0)}
    )
    plan = planner.compute_command(at(Pose2D(0.0, 0.0, 0.0), Twist2D(0.3, 0.0, 0.0)))
    assert plan.critics[-1] == "veer" and plan.command.wz > 0.3
    assert plan.samples is not None and plan.rejected_by is not None and plan.totals is not None
    right = plan.samples[:, 2] < -0.2
    assert (plan.rejected_by[right] == len(DEFAULT_CRITICS)).all() and (plan.totals[right] == -9.0).all()


class _Recorder(Critic):
    """Records the calls of its life cycle."""

    Params = ParamModel

    def __init__(self, name: str, params: Any) -> None:
        super().__init__(name, params)
        self.calls: list[str] = []

    def reset(self) -> None:
        self.calls.append("reset")

    def prepare(self, context: ScoringContext) -> None:
        self.calls.append("prepare")

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        self.calls.append(f"score {int(rollouts.alive.sum())}")
        return np.where(rollouts.commands[:, 2] < 0.0, -1.0, 0.0)

    def debrief(self, command: Twist2D, pose: Pose2D) -> None:
        self.calls.append("debrief")

    def explain(self, row: int) -> RejectionDetail:
        return RejectionDetail(f"row {row}")


def test_the_life_cycle_of_a_critic(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CRITICS, "_entries", dict(CRITICS._entries))
    monkeypatch.setattr(CRITICS, "_lookup", dict(CRITICS._lookup))
    CRITICS.add("recorder", _Recorder, origin="test")
    planner = planner_on(critics=[PluginSpec(name=n, type=n) for n in ("recorder", "path")])
    critic = planner.critics[0]
    assert isinstance(critic, _Recorder)
    plan = planner.compute_command(at(Pose2D(0.0, 0.0), Twist2D(0.3, 0.0, 0.0)))
    assert plan.samples is not None and plan.rejected_by is not None
    assert critic.calls == ["reset", "prepare", f"score {len(plan.samples)}", "debrief"]
    details = planner.diagnostics()
    assert details is not None
    rejected = np.flatnonzero(plan.rejected_by == 0).tolist()
    assert rejected and [details.samples[k] for k in rejected] == [
        ("recorder", RejectionDetail(f"row {k}")) for k in rejected
    ]
    planner.compute_command(at(Pose2D(1.5, 0.0, 2.0)))  # at the goal's position critics do not score
    assert critic.calls[4:] == ["reset"]


def test_commands_at_the_goal_are_checked_without_an_obstacle_critic() -> None:
    listed = [PluginSpec(name=n, type=n) for n in ("path", "goal")]
    planner = planner_on(critics=listed, scaling_speed=0.3)
    assert not any(isinstance(c, ObstacleCritic) for c in planner.critics)
    costmap = empty_map()
    costmap.data[40, 73] = LETHAL
    with pytest.raises(NoValidControlError, match="turning in place at the goal"):
        planner.compute_command(at(Pose2D(1.5, 0.0, 2.0), costmap=costmap))


# --- rejections -------------------------------------------------------------------------------------------------------


def test_the_error_counts_rejections_and_locates_the_first_collision() -> None:
    costmap = empty_map()
    costmap.data[:, 49:51] = LETHAL
    with pytest.raises(NoValidControlError) as caught:
        planner_on().compute_command(at(Pose2D(0.2, 0.0, 0.0), Twist2D(0.5, 0.0, 0.0), costmap))
    message, data = caught.value.message, caught.value.data
    assert message.startswith("126 of 126 rejected: 126 obstacle (footprint on lethal (254) 0.0")
    assert data["samples"] == 126 and data["rejected"] == {"obstacle": 126}
    collision = data["collision"]
    assert collision["cost"] == LETHAL and collision["cell"][0] == 49
    assert 0.0 < collision["ahead_m"] < 0.1
    table = data["plan"]
    assert table.best == -1 and (table.rejected_by == 1).all()


# --- plan and goal ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("latch", [True, False])
def test_the_latch_holds_after_a_replan(latch: bool) -> None:
    """Parity 17: C++ releases it with every plan."""
    planner = planner_on(latch_xy_goal_tolerance=latch)
    turned = Pose2D(1.5, 0.0, 2.0)
    assert planner.compute_command(at(turned)).mode == "rotate_to_goal"
    planner.set_plan(Path(LINE, "odom"), Pose2D(*LINE[-1]))
    outside = Pose2D(1.5, 0.2, 2.0)
    assert planner.compute_command(at(outside)).mode == ("rotate_to_goal" if latch else "follow")
    planner.set_plan(Path(LINE, "odom"), Pose2D(1.5, 0.0, 0.5))  # another goal
    assert planner.compute_command(at(outside)).mode == "follow"


def test_brakes_before_it_turns() -> None:
    planner = planner_on()
    fast = planner.compute_command(at(Pose2D(1.45, 0.0, 2.0), Twist2D(0.5, 0.0, 0.0)))
    assert fast.mode == "brake" and fast.command == pytest.approx((0.3, 0.0, 0.0))
    slow = planner.compute_command(at(Pose2D(1.5, 0.0, 2.0), Twist2D(0.05, 0.0, 0.0)))
    assert slow.mode == "rotate_to_goal" and slow.command.vx == 0.0 and slow.command.wz < 0.0
    done = planner.compute_command(at(Pose2D(1.5, 0.0, 0.05), Twist2D(0.0, 0.0, 0.0)))
    assert done.mode == "arrived" and done.command == Twist2D()
    assert planner.goal_reached(at(Pose2D(1.5, 0.0, 0.05)))
    assert not planner.goal_reached(at(Pose2D(1.5, 0.0, 0.05), Twist2D(0.0, 0.0, 0.3)))


def limits_of(**more: float) -> VelocityLimits:
    return planner_on().limits._replace(**more)


@pytest.mark.parametrize(
    ("error", "turning", "expected"),
    [
        (1.0, 0.0, 0.4),  # one period's acceleration from rest
        (-1.0, 0.0, -0.4),
        (3.0, 0.9, 1.0),  # the limit
        (0.1, 1.0, 0.6),  # no slower than braking allows
        (0.05, 1.0, 0.44721360),  # no faster than can be stopped: sqrt(2 a e)
        (0.02, 0.0, 0.4),  # never slower than the base can turn
    ],
)
def test_turning_speed(error: float, turning: float, expected: float) -> None:
    twist = turning_twist(error, turning, limits_of(max_vel_theta=1.0, acc_lim_theta=2.0), 0.2, 0.4)
    assert twist == pytest.approx((0.0, 0.0, expected))


def test_braking_stops_every_axis() -> None:
    limits = limits_of(acc_lim_y=0.5)
    assert braking_twist(Twist2D(0.5, -0.2, 1.0), limits, 0.2) == pytest.approx((0.3, -0.1, 0.6))
    assert braking_twist(Twist2D(-0.1, 0.05, -0.3), limits, 0.2) == Twist2D()


def test_prune_plan_drops_passed_poses() -> None:
    """A plan that starts 1.5 m behind the robot begins 1 m behind it after pruning."""
    behind = np.column_stack((np.linspace(-1.5, 1.5, 61), np.zeros(61), np.zeros(61)))
    seen = planner_on(behind, prune_plan=True).compute_command(at(Pose2D(0.0, 0.0))).local_plan
    all_of_it = planner_on(behind).compute_command(at(Pose2D(0.0, 0.0))).local_plan
    assert seen is not None and all_of_it is not None
    assert seen.poses[0, 0] == pytest.approx(-0.95) and all_of_it.poses[0, 0] == pytest.approx(-1.5)
    with pytest.raises(InvalidPathError, match="prune_plan"):
        planner_on(prune_plan=True).compute_command(at(Pose2D(0.0, 1.2)))


def test_the_local_plan_ends_one_pose_beyond_the_window() -> None:
    long = np.column_stack((np.linspace(0.0, 6.0, 121), np.zeros(121), np.zeros(121)))
    seen = planner_on(long).compute_command(at(Pose2D(0.0, 0.0))).local_plan
    assert seen is not None and seen.poses[-1, 0] == pytest.approx(2.05)


# --- memory -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_memory_does_not_grow() -> None:
    planner = planner_on()
    inputs = at(Pose2D(0.0, 0.0, 0.1), Twist2D(0.3, 0.0, 0.0))

    def run(cycles: int) -> int:
        for _ in range(cycles):
            planner.set_plan(Path(LINE, "odom"), Pose2D(*LINE[-1]))
            planner.compute_command(inputs)
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        run(50)
        before = run(50)
        after = run(500)
    finally:
        tracemalloc.stop()
    assert after - before < 20_000


def test_accepts_read_only_and_sliced_costmaps() -> None:
    big = np.zeros((80, 200), np.uint8)
    big[:44, 66] = LETHAL
    sliced = Costmap(GridGeometry(80, 80, 0.05, -2.0, -2.0), big[:, 10:90], "odom")
    fixed = Costmap(sliced.geometry, big[:, 10:90].copy(), "odom")
    fixed.data.setflags(write=False)
    inputs = [at(Pose2D(0.0, 0.0, 0.1), Twist2D(0.3, 0.0, 0.0), c) for c in (sliced, fixed)]
    a, b = (planner_on().compute_command(i) for i in inputs)
    np.testing.assert_array_equal(a.totals, b.totals)


def test_an_obstacle_between_the_cells_of_the_edges_is_a_collision_with_its_cell() -> None:
    """The lethal cell under the footprint but on no line from corner to corner: rejected, and named by the report."""
    costmap = empty_map()
    box = Footprint(np.array([[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]), 0.01)
    pose = Pose2D(0.01, 0.01, 0.0)
    cell = costmap.geometry.world_to_cell(0.12, 0.08)
    assert cell is not None
    costmap.data[cell[1], cell[0]] = LETHAL
    poses = np.tile(np.array(pose), (1, 3, 1))
    rollouts = Rollouts(np.zeros((1, 3)), poses, np.full(1, 3, np.int64))
    critic = ObstacleCritic("obstacle", ObstacleParams())
    critic.prepare(ScoringContext(at(pose).state, costmap, box, LINE, Pose2D(1.0, 0.0), planner_on().limits))
    assert critic.score(rollouts).tolist() == [-6.0]
    assert critic.explain(0).cell == cell


BOX = [(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)]
DIAMOND = [(0.3, 0.0), (0.0, 0.3), (-0.3, 0.0), (0.0, -0.3)]
AROUND_BOX = {(ix, iy) for ix in range(17, 24) for iy in range(18, 23) if ix in (17, 23) or iy in (18, 22)}
AROUND_DIAMOND = {(ix, iy) for ix in range(17, 24) for iy in range(17, 24) if abs(ix - 20) + abs(iy - 20) == 3}


@pytest.mark.parametrize(("corners", "around"), [(BOX, AROUND_BOX), (DIAMOND, AROUND_DIAMOND)])
def test_an_unknown_cell_on_an_edge_is_the_cell_that_is_blamed(
    corners: list[tuple[float, float]], around: set[tuple[int, int]]
) -> None:
    """Every cell of the border, of edges in all eight directions; cells of 0.1 m, the robot in the middle of (20, 20)."""
    footprint, pose = Footprint(np.array(corners)), Pose2D(0.05, 0.05, 0.0)
    poses, limits = np.array([[pose]]), planner_on().limits
    critic = ObstacleCritic("obstacle", ObstacleParams())
    blamed: dict[tuple[int, int], tuple[int, int] | None] = {}
    for ix in range(15, 26):
        for iy in range(15, 26):
            costmap = Costmap(GridGeometry(40, 40, 0.1, -2.0, -2.0), frame="odom")
            costmap.data[iy, ix] = 255
            critic.prepare(ScoringContext(RobotState(pose), costmap, footprint, LINE, Pose2D(1.0, 0.0), limits))
            if critic.score(Rollouts(np.zeros((1, 3)), poses, np.ones(1, np.int64)))[0] == -6.0:
                detail = critic.explain(0)
                blamed[ix, iy] = detail.cell
                assert detail.cost == 255 and detail.step == 0 and detail.pose == pose
    assert blamed == {cell: cell for cell in around}
