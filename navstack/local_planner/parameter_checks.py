"""Checks that planners which sample velocities share; their parameter models call them in `check`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from navstack.plugins import CheckContext, Issue


class Limit(NamedTuple):
    """A parameter of a planner and its value: the highest forward speed (m/s), the deceleration (m/s²)."""

    parameter: str
    value: float


INSCRIBED_COST = 252.0
"""Cost of a cell just outside the inscribed radius."""
MAX_HORIZONS = 3.0
"""Passing an obstacle may cost this many horizons of progress; at a higher cost the robot prefers to stop."""


def window_too_small(
    context: CheckContext, sim_time: float, fastest: Limit, forward_point_distance: float = 0.0
) -> Iterator[Issue]:
    """Trajectories that leave the local costmap are rejected."""
    costmap = context.local_costmap
    reach = sim_time * fastest.value + forward_point_distance
    half = min(costmap.width, costmap.height) / 2.0
    if not costmap.rolling_window or half >= reach:
        return
    nose = f" + forward_point_distance {forward_point_distance:g} m" if forward_point_distance else ""
    message = (
        f"the local costmap ends {half:g} m from the robot, but trajectories reach {reach:.3g} m (sim_time {sim_time:g} s * "
        f"{fastest.parameter} {fastest.value:g} m/s{nose}), so fast trajectories are rejected; set width and height to at least "
        f"{math.ceil(20 * reach) / 10:g} m"
    )
    yield Issue("warning", "window-too-small", ("/local_costmap/width", "/local_costmap/height"), message)


def updates_too_slow(context: CheckContext, fastest: Limit) -> Iterator[Issue]:
    """Between two updates of the local costmap the robot drives on old obstacles."""
    costmap = context.local_costmap
    rate, control = costmap.update_frequency, context.controller_frequency
    radius = costmap.footprint.inscribed_radius
    if rate <= 0.0 or rate >= control or fastest.value / rate <= radius:
        return
    message = (
        f"update_frequency = {rate:g} Hz of the local costmap is too low: the robot drives up to "
        f"{fastest.value / rate:.3g} m between two updates ({fastest.parameter} {fastest.value:g} m/s), more than its "
        f"inscribed radius of {radius:.3g} m; raise it to {control:g} Hz"
    )
    yield Issue("warning", "updates-too-slow", ("/local_costmap/update_frequency",), message, f"{control:g}")


def stopping_time(context: CheckContext, deceleration: Limit, fastest: Limit, sim_time: float) -> Iterator[Issue]:
    """A robot that cannot stop within its horizon cannot avoid obstacles at the end of it.

    It drives toward an obstacle with the speed that reaches it at the end of the horizon, so that it brakes by speed / sim_time;
    it does so a control period late.
    """
    (name, speed), (limit, acceleration) = fastest, deceleration
    if acceleration <= 0.0 or speed <= 0.0:
        return
    period = 1.0 / context.controller_frequency
    least = speed / acceleration + period
    if least > sim_time:
        message = (
            f"the robot needs {speed / acceleration:.3g} s to stop from {name} {speed:g} m/s ({limit} {acceleration:g} m/s²), "
            f"after the {period:.3g} s of a control period; that is longer than sim_time {sim_time:g} s, so it cannot stop for "
            f"obstacles within its horizon; raise sim_time to {math.ceil(10.0 * least) / 10.0:g} or lower {name}"
        )
        yield Issue("warning", "stopping-time", ("sim_time", limit), message)


def coarse_simulation(
    context: CheckContext, sim_granularity: float, sim_time: float, acc_lim_x: float, fastest: Limit
) -> Iterator[Issue]:
    """A trajectory no longer than sim_granularity has one point, where the robot stands: what is ahead is not checked."""
    speed = min(sim_granularity / sim_time, fastest.value)
    if speed <= 0.0 or acc_lim_x <= 0.0:
        return
    unchecked = speed / context.controller_frequency + speed * speed / (2.0 * acc_lim_x)
    resolution = context.local_costmap.resolution
    if unchecked <= 0.5 * resolution:
        return
    message = (
        f"sim_granularity = {sim_granularity:g} m is too coarse: a trajectory of up to {speed:.2g} m/s has one point (sim_time "
        f"{sim_time:g} s), where the robot stands, so the {unchecked:.2g} m that it drives before it can stop are not checked; "
        f"set it to {0.5 * resolution:g} m or less"
    )
    yield Issue("warning", "coarse-simulation", ("sim_granularity",), message, f"{0.5 * resolution:g}")


def minimum_over_maximum(limits: Sequence[tuple[str, float, str, float]]) -> Iterator[Issue]:
    """A minimum speed over the maximum leaves no velocity to sample. `limits`: name and value of both."""
    for low, low_value, high, high_value in limits:
        if low_value > high_value:
            message = (
                f"{low} = {low_value:g} is greater than {high} = {high_value:g}, so there is no velocity to sample; swap or "
                "correct the values"
            )
            yield Issue("error", "minimum-over-maximum", (low, high), message)


def cannot_start(
    context: CheckContext, acc_lim_x: float, acc_lim_theta: float, min_vel_trans: float, min_vel_theta: float
) -> Iterator[Issue]:
    """From rest, one control period must be enough to reach one of the two minimum speeds."""
    hz = context.controller_frequency
    if acc_lim_x / hz < min_vel_trans and acc_lim_theta / hz < min_vel_theta:
        message = (
            f"the robot cannot start: from rest it reaches {acc_lim_x / hz:.3g} m/s and {acc_lim_theta / hz:.3g} rad/s in one "
            f"control period (controller_frequency {hz:g} Hz), less than min_vel_trans {min_vel_trans:g} and min_vel_theta "
            f"{min_vel_theta:g}, so every velocity sample is rejected; lower the minimum speeds or raise the acceleration "
            "limits"
        )
        yield Issue("warning", "cannot-start", ("acc_lim_theta", "acc_lim_x"), message)


def min_vel_trans_zero(min_vel_trans: float, min_vel_theta: float) -> Iterator[Issue]:
    """With a min_vel_trans of 0, min_vel_theta never applies."""
    if min_vel_trans == 0.0 and min_vel_theta > 0.0:
        message = (
            f"min_vel_trans = 0 disables min_vel_theta ({min_vel_theta:g} rad/s), so the robot may rotate in place too slowly "
            "for its motors; set min_vel_trans to about 0.1"
        )
        yield Issue("warning", "min-vel-trans-zero", ("min_vel_trans",), message, "0.1")


def vy_samples_zero(vy_samples: int) -> Iterator[Issue]:
    """Many published files contain `vy_samples: 0`, which ROS silently replaces by 1."""
    if vy_samples == 0:
        yield Issue("info", "counts-as-one", ("vy_samples",), "vy_samples = 0 is used as 1, as in ROS; write 1", "1")


def goal_tolerances(
    context: CheckContext, xy_goal_tolerance: float, yaw_goal_tolerance: float, min_vel_theta: float
) -> Iterator[Issue]:
    """Tolerances below the resolution of the grid, or below the smallest turn of one control period."""
    resolution = context.local_costmap.resolution
    if xy_goal_tolerance < resolution:
        message = (
            f"xy_goal_tolerance = {xy_goal_tolerance:g} m is smaller than a cell of the local costmap ({resolution:g} m), so "
            f"the robot may circle around its goal; set it to {resolution:g} m or more"
        )
        yield Issue("warning", "tolerance-under-cell", ("xy_goal_tolerance",), message)
    if min_vel_theta <= 0.0:
        return
    step = min_vel_theta / context.controller_frequency
    if 2.0 * yaw_goal_tolerance < step:
        message = (
            f"yaw_goal_tolerance = {yaw_goal_tolerance:g} rad is too small: the robot turns at least {step:.3g} rad in one "
            f"control period (min_vel_theta {min_vel_theta:g} rad/s) and may oscillate about the goal's heading; set it to "
            f"{step / 2:.2g} rad or more, or lower min_vel_theta"
        )
        yield Issue("warning", "yaw-tolerance", ("yaw_goal_tolerance",), message)


MOST_SPEEDS = 40
"""More forward speeds than that cost time and are no advice."""


def coarse_speeds(
    context: CheckContext,
    *,
    speeds: tuple[float, float],
    acceleration: float,
    samples: int,
    sim_time: float,
    xy_goal_tolerance: float,
) -> Iterator[Issue]:
    """From rest near the goal, the slowest forward trajectory ends as far behind the goal as the robot stands before it.

    `speeds`: lowest and highest forward speed (m/s). A robot at rest at a distance d gains by a trajectory of length s only if
    s < 2 d, so it stays where xy_goal_tolerance < d < s / 2.
    """
    reach = acceleration / context.controller_frequency
    low, high = max(speeds[0], -reach), min(speeds[1], reach)
    if high <= 0.0:
        return

    def shortest(number: int) -> float:
        step = (high - low) / max(1, number - 1)
        forward = [speed for k in range(max(2, number)) if (speed := low + k * step) > 1e-6]
        return min(forward) * sim_time

    length = shortest(samples)
    if length <= 2.0 * xy_goal_tolerance:
        return
    enough = next((n for n in range(samples + 1, MOST_SPEEDS + 1) if shortest(n) <= 2.0 * xy_goal_tolerance), None)
    fix = f"raise xy_goal_tolerance to {math.ceil(50.0 * length) / 100.0:g}"
    if enough is not None:
        fix = f"set vx_samples to {enough}, or {fix}"
    message = (
        f"near the goal the robot may turn in place or stand forever: its slowest forward trajectory is {length:.3g} m long "
        f"(vx_samples {samples}, sim_time {sim_time:g} s), so from rest at {length / 2:.2g} m or less it would overshoot the "
        f"goal by more than it gains, and xy_goal_tolerance is {xy_goal_tolerance:g} m; {fix}"
    )
    yield Issue("warning", "coarse-speeds", ("vx_samples",), message, None if enough is None else str(enough))


def scoring_scale(
    context: CheckContext,
    *,
    horizon: float,
    goal_distance_bias: float,
    occdist_scale: float,
    score: tuple[float, float],
    indigo_score: tuple[float, float],
    factor: float,
) -> Iterator[Issue]:
    """Weights tuned before 2018 make obstacles 1 / (2 * resolution) times heavier than intended (parity 31).

    `horizon` is the length of the longest trajectory (m). `score` and `indigo_score` are, with the current scoring and with
    that of indigo, the worth of a meter of progress and the cost of passing an obstacle at the inscribed radius. `factor`
    is the ratio of both scalings.
    """
    meter, passing = score
    if occdist_scale <= 0.0 or passing <= MAX_HORIZONS * meter * horizon:
        return
    old_meter, old_passing = indigo_score
    factor = max(1.0, factor)
    fix = f"divide occdist_scale by {factor:g}"
    if context.ros_distro != "indigo" and old_passing <= MAX_HORIZONS * old_meter * horizon:
        fix = (
            f"these weights suit the scoring of before 2018 ({old_meter:g} per meter, {old_passing:.3g} per obstacle): set "
            f"navstack/ros_distro to indigo (--distro indigo), or divide occdist_scale by {factor:g}"
        )
    message = (
        f"occdist_scale = {occdist_scale:g} makes obstacles outweigh progress, so the robot stops or turns in place where it "
        f"is narrow: with ros_distro {context.ros_distro}, passing an obstacle at the inscribed radius costs {passing:.3g}, "
        f"while a meter of progress is worth {meter:g} (goal_distance_bias {goal_distance_bias:g}) and the whole horizon of "
        f"{horizon:.2g} m {meter * horizon:.3g}; {fix}"
    )
    yield Issue("warning", "scoring-scale", ("occdist_scale",), message, f"{occdist_scale / factor:.6g}")
