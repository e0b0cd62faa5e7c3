"""Where the built-in plugins are: kind -> registered name -> module, ROS names and other aliases.

Written by tools/builtin_plugins.py from the decorators; run it after a plugin is added, moved or renamed.
"""

from typing import Final

BUILTIN: Final[dict[str, dict[str, tuple[str, ...]]]] = {
    "costmap layer": {
        "binary_mask": ("navstack.costmap.mask_layers", "nav2_costmap_2d/BinaryFilter"),
        "decaying_voxel": (
            "navstack.costmap.decaying_voxel_layer",
            "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer",
        ),
        "denoise": ("navstack.costmap.denoise_layer",),
        "inflation": ("navstack.costmap.inflation_layer", "costmap_2d/InflationLayer"),
        "keepout_mask": ("navstack.costmap.mask_layers", "nav2_costmap_2d/KeepoutFilter"),
        "nav2_denoise": ("navstack.costmap.denoise_layer", "nav2_costmap_2d/DenoiseLayer"),
        "nav2_inflation": ("navstack.costmap.inflation_layer", "nav2_costmap_2d/InflationLayer"),
        "nav2_obstacle": ("navstack.costmap.obstacle_layer", "nav2_costmap_2d/ObstacleLayer"),
        "nav2_static": ("navstack.costmap.static_layer", "nav2_costmap_2d/StaticLayer"),
        "nav2_voxel": ("navstack.costmap.voxel_layer", "nav2_costmap_2d/VoxelLayer"),
        "obstacle": ("navstack.costmap.obstacle_layer", "costmap_2d/ObstacleLayer"),
        "plugin_container": ("navstack.costmap.plugin_container_layer", "nav2_costmap_2d/PluginContainerLayer"),
        "range_sensor": (
            "navstack.costmap.range_sensor_layer",
            "range_sensor_layer/RangeSensorLayer",
            "nav2_costmap_2d/RangeSensorLayer",
        ),
        "speed_mask": ("navstack.costmap.mask_layers", "nav2_costmap_2d/SpeedFilter"),
        "static": ("navstack.costmap.static_layer", "costmap_2d/StaticLayer"),
        "voxel": ("navstack.costmap.voxel_layer", "costmap_2d/VoxelLayer"),
    },
    "global planner": {
        "astar": ("navstack.global_planner.astar",),
        "carrot_planner": ("navstack.global_planner.carrot", "carrot_planner/CarrotPlanner"),
        "given_path": ("navstack.global_planner.given_path",),
        "global_planner": ("navstack.global_planner.global_planner", "global_planner/GlobalPlanner"),
        "nav2_navfn": ("navstack.global_planner.navfn", "nav2_navfn_planner/NavfnPlanner"),
        "nav2_theta_star": ("navstack.global_planner.theta_star", "nav2_theta_star_planner/ThetaStarPlanner"),
        "navfn": ("navstack.global_planner.navfn", "navfn/NavfnROS"),
        "smac_2d": ("navstack.global_planner.smac_2d", "nav2_smac_planner/SmacPlanner2D", "smac_planner_2d"),
        "smac_hybrid": (
            "navstack.global_planner.smac_hybrid",
            "nav2_smac_planner/SmacPlannerHybrid",
            "smac_planner_hybrid",
        ),
        "smac_lattice": (
            "navstack.global_planner.smac_lattice",
            "nav2_smac_planner/SmacPlannerLattice",
            "smac_planner_lattice",
        ),
        "theta_star": ("navstack.global_planner.theta_star",),
    },
    "smoother": {
        "constrained": (
            "navstack.global_planner.smoothers.constrained",
            "nav2_constrained_smoother/ConstrainedSmoother",
            "constrained_smoother",
        ),
        "savitzky_golay": (
            "navstack.global_planner.smoothers.savitzky_golay",
            "nav2_smoother/SavitzkyGolaySmoother",
            "savitzky_golay_smoother",
        ),
        "simple": ("navstack.global_planner.smoothers.simple", "nav2_smoother/SimpleSmoother", "simple_smoother"),
    },
    "local planner": {
        "dwa": ("navstack.local_planner.dwa", "dwa_local_planner/DWAPlannerROS"),
        "dwb": ("navstack.local_planner.dwb.planner", "dwb_core/DWBLocalPlanner"),
        "graceful": ("navstack.local_planner.graceful", "nav2_graceful_controller/GracefulController"),
        "mppi": ("navstack.local_planner.mppi.planner", "nav2_mppi_controller/MPPIController"),
        "policy": ("navstack.local_planner.policy",),
        "regulated_pure_pursuit": (
            "navstack.local_planner.regulated_pure_pursuit",
            "nav2_regulated_pure_pursuit_controller/RegulatedPurePursuitController",
        ),
        "rotation_shim": (
            "navstack.local_planner.rotation_shim",
            "nav2_rotation_shim_controller/RotationShimController",
        ),
        "trajectory_rollout": (
            "navstack.local_planner.trajectory_rollout.planner",
            "base_local_planner/TrajectoryPlannerROS",
        ),
    },
    "critic": {
        "ConstraintCritic": ("navstack.local_planner.mppi.critics.constraint", "mppi/critics/ConstraintCritic"),
        "CostCritic": ("navstack.local_planner.mppi.critics.cost", "mppi/critics/CostCritic"),
        "GoalAlign": ("navstack.local_planner.dwb.map_grid", "dwb_critics/GoalAlignCritic"),
        "GoalAngleCritic": ("navstack.local_planner.mppi.critics.goal_angle", "mppi/critics/GoalAngleCritic"),
        "GoalCritic": ("navstack.local_planner.mppi.critics.goal", "mppi/critics/GoalCritic"),
        "GoalDist": ("navstack.local_planner.dwb.map_grid", "dwb_critics/GoalDistCritic"),
        "ObstacleFootprint": ("navstack.local_planner.dwb.critics", "dwb_critics/ObstacleFootprintCritic"),
        "ObstaclesCritic": ("navstack.local_planner.mppi.critics.obstacles", "mppi/critics/ObstaclesCritic"),
        "Oscillation": ("navstack.local_planner.dwb.critics", "dwb_critics/OscillationCritic"),
        "PathAlign": ("navstack.local_planner.dwb.map_grid", "dwb_critics/PathAlignCritic"),
        "PathAlignCritic": ("navstack.local_planner.mppi.critics.path_align", "mppi/critics/PathAlignCritic"),
        "PathAlignLegacyCritic": (
            "navstack.local_planner.mppi.critics.path_align",
            "mppi/critics/PathAlignLegacyCritic",
        ),
        "PathAngleCritic": ("navstack.local_planner.mppi.critics.path_angle", "mppi/critics/PathAngleCritic"),
        "PathDist": ("navstack.local_planner.dwb.map_grid", "dwb_critics/PathDistCritic"),
        "PathFollowCritic": ("navstack.local_planner.mppi.critics.path_follow", "mppi/critics/PathFollowCritic"),
        "PreferForwardCritic": (
            "navstack.local_planner.mppi.critics.prefer_forward",
            "mppi/critics/PreferForwardCritic",
        ),
        "Twirling": ("navstack.local_planner.dwb.critics", "dwb_critics/TwirlingCritic"),
        "TwirlingCritic": ("navstack.local_planner.mppi.critics.twirling", "mppi/critics/TwirlingCritic"),
        "VelocityDeadbandCritic": (
            "navstack.local_planner.mppi.critics.velocity_deadband",
            "mppi/critics/VelocityDeadbandCritic",
        ),
        "alignment": ("navstack.local_planner.critics.alignment",),
        "base_obstacle": (
            "navstack.local_planner.critics.base_obstacle",
            "dwb_critics/BaseObstacleCritic",
            "BaseObstacle",
        ),
        "goal": ("navstack.local_planner.critics.goal",),
        "goal_front": ("navstack.local_planner.critics.goal_front",),
        "obstacle": ("navstack.local_planner.critics.obstacle", "base_local_planner/ObstacleCostFunction"),
        "oscillation": ("navstack.local_planner.critics.oscillation", "base_local_planner/OscillationCostFunction"),
        "path": ("navstack.local_planner.critics.path",),
        "prefer_forward": (
            "navstack.local_planner.critics.prefer_forward",
            "dwb_critics/PreferForwardCritic",
            "PreferForward",
        ),
        "rotate_to_goal": (
            "navstack.local_planner.critics.rotate_to_goal",
            "dwb_critics/RotateToGoalCritic",
            "RotateToGoal",
        ),
        "twirling": ("navstack.local_planner.critics.twirling", "base_local_planner/TwirlingCostFunction"),
    },
    "goal checker": {
        "adaptive": ("navstack.local_planner.goal_checkers", "nav2_controller/AdaptiveToleranceGoalChecker"),
        "axis": ("navstack.local_planner.goal_checkers", "nav2_controller/AxisGoalChecker"),
        "position": ("navstack.local_planner.goal_checkers", "nav2_controller/PositionGoalChecker"),
        "simple": ("navstack.local_planner.goal_checkers", "nav2_controller/SimpleGoalChecker"),
        "stopped": ("navstack.local_planner.goal_checkers", "nav2_controller/StoppedGoalChecker"),
    },
    "progress checker": {
        "pose": ("navstack.local_planner.progress_checkers", "nav2_controller/PoseProgressChecker"),
        "simple": ("navstack.local_planner.progress_checkers", "nav2_controller/SimpleProgressChecker"),
    },
    "path handler": {
        "feasible": ("navstack.local_planner.path_handlers",),
        "nav2_feasible": ("navstack.local_planner.path_handlers", "nav2_controller/FeasiblePathHandler"),
    },
    "recovery behavior": {
        "assisted_teleop": (
            "navstack.behaviors.assisted_teleop",
            "nav2_behaviors/AssistedTeleop",
            "nav2_recoveries/AssistedTeleop",
        ),
        "back_up": ("navstack.behaviors.straight", "nav2_behaviors/BackUp", "nav2_recoveries/BackUp"),
        "clear_costmap_recovery": ("navstack.behaviors.clear_costmap", "clear_costmap_recovery/ClearCostmapRecovery"),
        "drive_on_heading": (
            "navstack.behaviors.straight",
            "nav2_behaviors/DriveOnHeading",
            "nav2_recoveries/DriveOnHeading",
        ),
        "move_slow_and_clear": ("navstack.behaviors.move_slow_and_clear", "move_slow_and_clear/MoveSlowAndClear"),
        "rotate_recovery": ("navstack.behaviors.turn", "rotate_recovery/RotateRecovery"),
        "spin": ("navstack.behaviors.turn", "nav2_behaviors/Spin", "nav2_recoveries/Spin"),
        "spin_to_localize": ("navstack.behaviors.turn",),
        "wait": ("navstack.behaviors.wait", "nav2_behaviors/Wait", "nav2_recoveries/Wait"),
    },
    "localizer": {
        "amcl": ("navstack.localization.amcl", "amcl/amcl", "nav2_amcl/AmclNode"),
        "dead_reckoning": ("navstack.localization.dead_reckoning",),
        "mapping": ("navstack.mapping.online",),
        "scan_matching": ("navstack.localization.scan_matcher",),
    },
    "dock type": {
        "simple_charging_dock": ("navstack.docking.dock_types", "opennav_docking/SimpleChargingDock"),
        "simple_non_charging_dock": ("navstack.docking.dock_types", "opennav_docking/SimpleNonChargingDock"),
    },
    "dock detector": {
        "pose_topic": ("navstack.docking.detectors",),
        "v_reflector": ("navstack.docking.reflector",),
    },
}
