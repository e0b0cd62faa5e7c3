"""Parameters of motions: the `navstack: motion:` section of the YAML."""

from typing import Literal

from navstack.plugins import ParamModel, param


class MotionParams(ParamModel):
    """Motions: move, turn, drive to a pose, follow a path or a trajectory; and teleop.

    Speeds and accelerations are also limited by the local planner's.
    """

    frequency: float = param(20.0, "rate of the commands", unit="Hz", ge=1.0, le=1000.0)
    frame: Literal["odom", "map"] = param(
        "odom",
        "frame in which move and turn measure: odom, the odometry alone, as the ROS tutorial nodes; map: with localization",
    )
    speed_linear: float = param(0.2, "speed of move and of driving to a pose", unit="m/s", gt=0.0)
    speed_radian: float = param(0.436, "speed of turns in place (25 degrees per second)", unit="rad/s", gt=0.0)
    follow_speed: float | None = param(
        None, "maximum speed on paths and trajectories; none: the local planner's max_vel_trans", unit="m/s", gt=0.0
    )
    acc_lim_x: float | None = param(None, "acceleration along the path; none: the local planner's", unit="m/s²", gt=0.0)
    acc_lim_theta: float | None = param(None, "angular acceleration; none: the local planner's", unit="rad/s²", gt=0.0)
    tolerance: float = param(0.01, "distance from the target that counts as reached", unit="m", gt=0.0)
    tolerance_radian: float = param(0.02, "angle from the target that counts as reached", unit="rad", gt=0.0)
    time_allowance: float | None = param(
        None, "time limit of a motion; none: twice its expected time plus 5 s", unit="s", gt=0.0
    )
    simulate_ahead_time: float = param(2.0, "time ahead to check for collisions", unit="s", gt=0.0)
    disable_collision_checks: bool = param(False, "move without collision checks")
    tracking: Literal["kanayama", "samson"] = param(
        "kanayama",
        "tracking controller: kanayama (Kanayama et al. 1990), or samson (Samson 1993, with the gains of De Luca, Oriolo, "
        "Vendittelli 2001, which scale with the speed and the turn rate)",
    )
    damping: float = param(0.7, "samson: damping ratio of the errors", gt=0.0, le=1.0)
    stiffness: float = param(
        20.0,
        "samson: at speed v and turn rate w, errors decay with the frequency sqrt(w² + stiffness v²)",
        unit="1/m²",
        gt=0.0,
    )
    k_x: float = param(2.0, "kanayama: gain of the error along the path", unit="1/s", gt=0.0)
    k_y: float = param(20.0, "kanayama: gain of the lateral error", unit="1/m²", gt=0.0)
    k_theta: float = param(6.0, "kanayama: gain of the heading error", unit="1/m", gt=0.0)
    max_tracking_error: float = param(
        0.5,
        "distance from the trajectory at which following fails, and largest distance of its start",
        unit="m",
        gt=0.0,
    )
