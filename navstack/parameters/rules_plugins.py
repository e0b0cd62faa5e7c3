"""What the rules of the built-in plugins look for, which `check` of their parameter models declares, for the page of rules."""

from navstack.plugins import document

document(
    "one-plugin",
    "warning",
    """`goal_checker_plugins` or `path_handler_plugins` lists no plugin, or several. Nav2's controller_server chooses
    among several by a topic; here a controller has one: the first of the list, or the default. List one.
    """,
    __name__,
)
document(
    "model-dt",
    "error",
    """`model_dt` of MPPI is a step of its model, `1 / controller_frequency` the time for which a command is held. A
    shorter step is an error: commands would be held longer than the model assumes, and Nav2 refuses it with an
    exception. A longer one is a warning: the control sequence is then not shifted between cycles.

    Fix: set `model_dt` to `1 / controller_frequency`, and `time_steps` so that the horizon stays the same.
    """,
    __name__,
)
document(
    "no-critics",
    "error",
    """MPPI without critics averages all samples: the robot drives at random, also into obstacles. Nav2 starts with
    such parameters, for `critics` is empty by default there. To DWB every sample is then as good as any other.

    Fix: list critics, or remove the key; those of nav2_bringup are used then.
    """,
    __name__,
)
document(
    "horizon-over-path",
    "warning",
    """Trajectories of MPPI at `vx_max` reach beyond the local path, which ends at `prune_distance` or at the border
    of the local costmap. PathFollow draws the end of the trajectory to the end of the path, so the robot never
    reaches `vx_max`.

    Fix: raise `prune_distance` or enlarge the local costmap to `time_steps * model_dt * vx_max`, or lower
    `time_steps`. Threads: ros-navigation/navigation2#4970, #5694.
    """,
    __name__,
)
document(
    "footprint-ignored",
    "warning",
    """With `consider_footprint: false` a critic of MPPI treats the robot as a disc of its inscribed radius, as
    BaseObstacle of DWB always does. The corners of an elongated robot then touch obstacles.

    Fix: set `consider_footprint: true`; list ObstacleFootprint instead of BaseObstacle.
    """,
    __name__,
)
document(
    "turning-radius",
    "warning",
    """With the Ackermann model of MPPI a turn is limited by the speed over `min_turning_r`. If that is far below
    `wz_max`, most samples are cut to the same turn. With regulated pure pursuit, a carrot nearer than half of
    `min_turning_r` asks for curves that the base cannot drive as soon as it is a little to the side.

    Fix: lower `wz_max` and `wz_std`; set `lookahead_dist` to `min_turning_r` or more.
    """,
    __name__,
)
document(
    "turn-in-place",
    "error",
    """A base with a turning radius (`min_turning_r`) cannot turn in place, but `use_rotate_to_heading` or a rotation
    shim commands it to. The robot would stand still.

    Fix: set `use_rotate_to_heading` to false; use the controller without the shim.
    """,
    __name__,
)
document(
    "turn-or-reverse",
    "warning",
    """`use_rotate_to_heading` (graceful: `initial_rotation`) turns the robot to a path behind it, so
    `allow_reversing` (`allow_backward`) has no effect.

    Fix: set one of them to false.
    """,
    __name__,
)
document(
    "no-reverse-speed",
    "warning",
    """With `use_dynamic_window`, a `min_linear_vel` of 0 or more allows no backward speed, so `allow_reversing` has
    no effect. A path behind the robot ends in NO_VALID_CONTROL (Nav2 commands zero, and the robot stands still).
    The packaged set `turtlebot_rpp` has `min_linear_vel: 0.0`.

    Fix: `min_linear_vel` of `-max_linear_vel`, or `allow_reversing` false.
    """,
    __name__,
)
document(
    "no-path",
    "warning",
    """`given_path` returns the path of its parameters, but has none, so that every plan fails.

    Fix: set `begin` and `segments`, or another `base_global_planner`.
    """,
    __name__,
)
document(
    "no-second-carrot",
    "warning",
    """`interpolate_curvature_after_goal` concerns the second carrot, which is off. Nav2 switches the parameter off
    with a warning.

    Fix: set `use_fixed_curvature_lookahead` to true.
    """,
    __name__,
)
document(
    "carrot-beyond-path",
    "warning",
    """The lookahead is longer than the local path, which ends at `prune_distance` or at the border of the local
    costmap. The robot steers to the end of the local path instead.

    Fix: lower the lookahead, raise `prune_distance`, or enlarge the local costmap.
    """,
    __name__,
)
document(
    "short-lookahead",
    "warning",
    """The carrot is within two control periods of driving. Pure pursuit then weaves about the path: an offset decays
    within about the lookahead distance.

    Fix: raise `lookahead_dist`.
    """,
    __name__,
)
document(
    "no-primary-controller",
    "warning",
    """A rotation shim without `primary_controller` has the default controller drive, regulated pure pursuit.

    Fix: write `primary_controller: {plugin: "..", its parameters}`.
    """,
    __name__,
)
document(
    "shim-in-shim",
    "error",
    """The `primary_controller` of a rotation shim is a rotation shim: nothing would drive.

    Fix: name a controller that drives.
    """,
    __name__,
)
document(
    "zero-limits",
    "error",
    """Every limit of DWB is 0 unless it is written. With `max_vel_x` and `max_vel_theta` at 0 nothing is sampled; with
    `max_speed_xy` at 0 every sample that drives is rejected, and the robot only turns: both are errors. An
    acceleration of 0 leaves the robot at rest along that axis: a warning. Nav2 starts with such parameters, and the
    robot stands still or fails with "No valid trajectories".

    Fix: write the speeds and accelerations of the base.
    """,
    __name__,
)
document(
    "no-deceleration",
    "warning",
    """`decel_lim_x` or `decel_lim_theta` of DWB is 0, its default, so no sample is slower than the robot: once it
    drives, it never brakes for obstacles or its goal.

    Fix: set it to the negative of the acceleration. A deceleration is negative in Nav2.
    """,
    __name__,
)
document(
    "no-obstacle-critic",
    "warning",
    """No critic of DWB rejects trajectories that hit obstacles, or its scale is 0, which switches a critic off.

    Fix: list BaseObstacle (round robots) or ObstacleFootprint, with a scale above 0.
    """,
    __name__,
)
document(
    "rotate-before-goal",
    "warning",
    """`xy_goal_tolerance` of RotateToGoal, written in its namespace or in the controller's, is larger than that of the
    goal checker. The robot stops between the two, turns to the goal's heading, and never arrives.

    Fix: the same tolerance for both, or a smaller one for RotateToGoal.
    """,
    __name__,
)
document(
    "two-plan-windows",
    "warning",
    """`prune_plan`, `prune_distance`, `forward_prune_distance` or `shorten_transformed_plan` of DWB selects the part of
    the plan as Nav2 does up to Kilted. The parameters of a path handler, which replaced them, then have no effect.

    Fix: remove the ones or the others.
    """,
    __name__,
)
document(
    "scoring-scale",
    "warning",
    """Passing an obstacle at the inscribed radius costs more than three whole horizons of progress are worth: the
    robot stops, turns in place or aborts ("Robot is oscillating") in narrow places. Example, the turtlebot's YAML
    under noetic: a meter is worth 2 * 24 = 48, its horizon of 0.5 m 24, and passing an obstacle costs 0.5 * 252 =
    126. The YAML was written for a scale of 24 per meter and 0.05 * 126 = 6.3 per obstacle. Under the noetic stack
    it fails at 8 of 18 office goals; with occdist_scale divided by 10 it reaches all of them.

    Fix: `navstack: {ros_distro: indigo}` (`--distro indigo`), or divide occdist_scale by 1 / (2 * resolution) (1 /
    resolution for TrajectoryPlannerROS with meter_scoring). Threads: ros-planning/navigation#689, #699, #1000.
    """,
    __name__,
)
document(
    "standing-sample",
    "info",
    """With `min_vel_x: 0` (the default of TrajectoryPlannerROS), standing still is one of its samples. A turn in place
    replaces the best sample only where it costs no more (TrajectoryPlanner::createTrajectories), and a turn that brings
    a corner of the robot to a higher cost does: the robot stands with a valid command until oscillation_timeout.

    Fix: `min_vel_x: 0.1`, as most published files have.
    """,
    __name__,
)
document(
    "coarse-speeds",
    "warning",
    """DWAPlannerROS samples `vx_samples` forward speeds between the lowest and the highest that one control period allows.
    Near the goal, the slowest one over `sim_time` may lead past it: a robot at rest at a distance d gains by a trajectory
    of length s only if s < 2 d. Between `xy_goal_tolerance` and s / 2 it stands, or turns in place until the time limit;
    a turn in place is no progress. Example: 3 samples up to 0.5 m/s and 1.7 s give s = 0.425 m, with a tolerance of 0.2 m.

    Fix: the number of `vx_samples` in the message, a shorter `sim_time`, or a larger `xy_goal_tolerance`.
    """,
    __name__,
)
document(
    "window-too-small",
    "warning",
    """Trajectories of length sim_time * max_vel_x + forward_point_distance leave the local costmap, and samples that
    leave it are rejected: the robot never reaches its maximum speed, or does not move toward the edge of the
    window. Example: 1.7 s * 1 m/s + 0.325 m need a window of more than 4 m.

    Fix: set width and height to twice that reach, or shorten sim_time.
    """,
    __name__,
)
document(
    "cannot-start",
    "warning",
    """From rest, one control period reaches less than min_vel_trans and less than min_vel_theta. Samples below both
    are rejected, so no sample is left, and the local planner fails in free space. Example: 0.5 m/s² at 20 Hz reach
    0.025 m/s.

    Fix: lower the minimum speeds or raise the acceleration limits. Thread: ros-planning/navigation#651.
    """,
    __name__,
)
document(
    "stopping-time",
    "warning",
    """Braking from max_vel_x, one control period late, takes longer than sim_time: the robot cannot avoid obstacles at
    the end of its horizon. Example: 1 m/s with 0.5 m/s² takes 2 s, longer than a sim_time of 1.7 s.

    Fix: raise sim_time or lower max_vel_x.
    """,
    __name__,
)
document(
    "coarse-simulation",
    "warning",
    """A simulated trajectory has ceil(speed * sim_time / sim_granularity) points, and the last one is not scored, as in
    ROS. One that is no longer than sim_granularity is checked only where the robot stands, so the robot drives into
    obstacles that its costmap has. Example: with 0.2 m and 1.2 s, speeds of up to 0.17 m/s look nowhere.

    Fix: set sim_granularity to half a cell (0.025 m is the default of ROS).
    """,
    __name__,
)
document(
    "minimum-over-maximum",
    "error",
    """A minimum speed is greater than its maximum, so there is no velocity to sample. This is an error.

    Fix: swap or correct the values.
    """,
    __name__,
)
document(
    "counts-as-one",
    "info",
    """Many published files of robots that cannot move sideways contain `vy_samples: 0`. ROS silently uses 1; navstack
    does the same, with this note.
    """,
    __name__,
)
document(
    "min-vel-trans-zero",
    "warning",
    """A sample is too slow only if it is below min_vel_trans and below min_vel_theta. With min_vel_trans 0 no sample
    is: in-place rotations of 0.04 rad/s are commanded, which most motors do not execute, and the robot does not
    move.

    Fix: set min_vel_trans to about 0.1. Threads: turtlebot/turtlebot_apps#91, ros-planning/navigation#1.
    """,
    __name__,
)
document(
    "tolerance-under-cell",
    "warning",
    """xy_goal_tolerance is smaller than a cell of the local costmap, which is the resolution of the planner's grids:
    the robot circles around its goal.

    Fix: set it to at least the resolution. Thread: ros-planning/navigation#147.
    """,
    __name__,
)
document(
    "yaw-tolerance",
    "warning",
    """At its minimum turning speed the robot turns farther in one control period than the width of the
    yaw_goal_tolerance band: it overshoots the goal's heading in both directions. Example: min_vel_theta 0.4 rad/s
    at 5 Hz is 0.08 rad per period; the tolerance must be 0.04 rad or more.

    Fix: raise yaw_goal_tolerance or lower min_vel_theta. Thread: ros-planning/navigation#741.
    """,
    __name__,
)
document(
    "inflation-under-radius",
    "warning",
    """Cells outside the inflation radius have no cost, independent of the shape of the robot. Below the circumscribed
    radius (the distance of the farthest corner from the center), plans pass where corners collide during a
    rotation, and the local planner then rejects every sample. Below the inscribed radius, plans cut through the
    edges of walls. A published jackal of 0.41 m uses 0.3 m.

    Fix: use the circumscribed radius or more; two to three times as much keeps a distance from obstacles. Threads:
    ros-navigation/navigation2#4423, #5148, ros-planning/navigation#1110.
    """,
    __name__,
)
document(
    "steep-inflation",
    "info",
    """Planners over cells keep the inscribed circle free, not the corners. With a steep decay of the costs (a large
    cost_scaling_factor) a plan around a corner passes as close as the inscribed radius; a robot that is longer than wide
    turns there, touches the obstacle with a corner, and the local planner then rejects every sample. Reported where the cost
    at the circumscribed radius is less than a tenth of that at the inscribed radius. A published robot of 0.5 m x 0.5 m
    whose base is at its front reached no goal in a warehouse with 10 (ROS's default), all with 2.1.

    Fix: a cost_scaling_factor with which the cost has fallen by half at the circumscribed radius:
    ln 2 / (circumscribed radius - inscribed radius).
    """,
    __name__,
)
document(
    "no-gradient",
    "warning",
    """cost_scaling_factor 0 gives all inflated cells the same cost; a large factor lets the cost fall to 0 within one
    cell (ln 252 / 60 = 0.09 m, less than a cell of 0.1 m). In both cases no gradient leads away from walls, and
    plans run along them.

    Fix: set it between 3 and 10.
    """,
    __name__,
)
document(
    "inflation-not-last",
    "warning",
    """Layers write in the order of `plugins`. Obstacles marked by a layer after the inflation layer are not inflated:
    the robot's center may pass directly next to them.

    Fix: list the inflation layer last.
    """,
    __name__,
)
document(
    "marks-beyond-clearing",
    "warning",
    """Obstacles are marked up to obstacle_range and cleared up to raytrace_range. An obstacle marked between the two
    (a person who walked by) is not cleared and blocks the path until a recovery. Example: 5 m and 3 m leave a ring
    of 2 m.

    Fix: make raytrace_range the larger value, usually by 0.5 m. Threads: ros-planning/navigation#808,
    ros-navigation/navigation2#545.
    """,
    __name__,
)
document(
    "drops-every-point",
    "warning",
    """min_obstacle_height exceeds max_obstacle_height (the lower one of source and layer), so every point of the
    source is dropped without a message in ROS.

    Fix: use a range of heights that contains the sensor.
    """,
    __name__,
)
document(
    "voxels-vanish",
    "warning",
    """A decaying voxel layer has the linear decay model and a voxel_decay that is not above 0 (its default is -1), so an
    obstacle is gone in the update after the one that marks it.

    Fix: set voxel_decay to the time in seconds for which an obstacle that is not seen again stays.
    """,
    __name__,
)
document(
    "voxels-never-decay",
    "warning",
    """A decaying voxel layer has an exponential or persistent decay model, which ends voxels only in the field of view of a
    clearing source with a decay_acceleration, and no source has both: obstacles stay for ever.

    Fix: give a source `clearing: true` and a decay_acceleration above 0, or set decay_model to 0.
    """,
    __name__,
)
document(
    "unknown-not-tracked",
    "warning",
    """`allow_unknown: false` forbids unknown cells, but no layer of the global costmap marks cells as unknown: all of
    them are free, and plans cross unobserved space.

    Fix: `track_unknown_space: true`.
    """,
    __name__,
)
document(
    "updates-too-slow",
    "warning",
    """Between two updates of the local costmap the robot drives on old obstacles. Example: at 0.22 m/s and 1 Hz it
    drives 0.22 m, more than the inscribed radius of a small robot.

    Fix: raise update_frequency to controller_frequency.
    """,
    __name__,
)
document(
    "no-such-layer",
    "error",
    """A recovery is configured to clear a layer that no affected costmap has. In ROS it clears nothing and still logs
    "Clearing costmap to unstuck robot"; its default name `obstacles` matches no common layer. This is an error
    here; without layer_names, every layer fed by sensors is cleared.

    Fix: use the name of a layer, or remove layer_names. Threads: ros-planning/navigation#641, #1020,
    naturerobots/move_base_flex#152.
    """,
    __name__,
)
document(
    "check-failed",
    "warning",
    """The check of a plugin raised an exception. The parameters are loaded without it.

    Fix: report the exception to the author of the plugin.
    """,
    __name__,
)
document(
    "lattice-file",
    "error",
    """The file with the motion primitives of `smac_lattice` is missing, or is not one in Nav2's format; the message
    names the line. This is an error.

    Fix: `navstack lattice generate` writes a file for a turning radius, a resolution and a motion model.
    """,
    __name__,
)
document(
    "cost-check-points",
    "error",
    """`cost_check_points` of the constrained smoother is a list of x, y and weight of each point of the footprint.
    The number of values is no multiple of three, a weight is negative, or all weights are 0. This is an error.

    Fix: write `[x, y, weight, x, y, weight, ..]` with weights of at least 0, not all 0.
    """,
    __name__,
)
document(
    "smoother-window",
    "warning",
    """`savitzky_golay` fits polynomials of `poly_order` to `window_size` points around each point of a path. An even
    window is raised by one, where Nav2 refuses it. Polynomials of an order of `window_size` - 1 or more pass
    through all points of the window, so nothing is smoothed.

    Fix: write an odd `window_size`, and a `poly_order` of at most `window_size` - 2.
    """,
    __name__,
)
document(
    "policy-model",
    "error",
    """The controller `policy` cannot run its model: the file is missing or no ONNX model, or the shapes of its input and
    output are not those that `beams`, `plan_points`, `last_action` and the limits ask for.

    Fix: set these parameters to those of the training, or export the model again.
    """,
    __name__,
)
