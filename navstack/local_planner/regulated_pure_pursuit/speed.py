"""The speed that curves, obstacles and the end of the path allow."""

from __future__ import annotations

import math

from navstack.core.errors import NoValidControlError
from navstack.local_planner.path_follower import Following
from navstack.local_planner.regulated_pure_pursuit import regulation
from navstack.local_planner.regulated_pure_pursuit.params import RegulatedPurePursuitParams


def regulated_speed(
    p: RegulatedPurePursuitParams, now: Following, top: float, curvature: float, notes: list[str], *, as_nav2: bool
) -> float:
    """The speed (m/s), up to `top`, that curvature, cost and the rest of the path allow; appends what limits it to `notes`.

    Raises NoValidControlError if the robot is outside the local costmap.
    """
    reasons = {"max_linear_vel": top}
    if p.use_regulated_linear_velocity_scaling:
        slow = regulation.speed_in_curve(top, curvature, p.regulated_linear_scaling_min_radius)
        if slow < top:
            reasons[f"the curve's radius of {1.0 / abs(curvature):.2f} m"] = slow
    cost, distance = _obstacle(p, now, as_nav2=as_nav2)
    if p.use_cost_regulated_linear_velocity_scaling and p.inflation_cost_scaling_factor > 0.0:
        slow = regulation.speed_near_obstacle(top, distance, p.cost_scaling_dist, p.cost_scaling_gain)
        if slow < top:
            reasons[f"an obstacle at {distance:.2f} m (cost {cost})"] = slow
    reason = min(reasons, key=lambda r: reasons[r])
    speed = reasons[reason]
    if speed < p.regulated_linear_scaling_min_speed:
        speed = p.regulated_linear_scaling_min_speed
        reason += f", raised to regulated_linear_scaling_min_speed {speed:g}"
    left = now.path.length
    if left < p.approach_velocity_scaling_dist:
        end = now.path.poses[-1]
        distance = math.hypot(float(end[0]) - now.state.pose.x, float(end[1]) - now.state.pose.y)
        slow = regulation.approach_speed(
            speed, left, distance, p.approach_velocity_scaling_dist, p.min_approach_linear_velocity
        )
        if slow < speed:
            speed, reason = slow, f"the end of the path in {distance:.2f} m"
    if speed > top:
        speed, reason = top, "max_linear_vel"
    notes.append(f"{speed:.2f} m/s, limited by {reason}; curvature {curvature:+.2f} 1/m")
    return speed


def _obstacle(p: RegulatedPurePursuitParams, now: Following, *, as_nav2: bool) -> tuple[int, float]:
    """Cost under the robot's centre, and the distance (m) to the obstacle behind it."""
    pose = now.state.pose
    cost = now.costmap.cost_at(pose.x, pose.y)
    if cost is None:
        raise NoValidControlError(
            f"the robot at ({pose.x:.2f}, {pose.y:.2f}) is outside the local costmap; check the costmap's frames",
            pose=list(pose),
        )
    if cost in (0, 255) or p.inflation_cost_scaling_factor <= 0.0:
        return cost, math.inf
    # ROS differs: Nav2 takes the parameter even if the layer has another factor
    factor = p.inflation_cost_scaling_factor
    if now.inflation is not None and not as_nav2:
        factor = now.inflation.cost_scaling_factor
    return cost, regulation.distance_from_cost(cost, now.footprint.inscribed_radius, factor)
