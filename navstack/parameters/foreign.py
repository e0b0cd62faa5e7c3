"""Planners and parameters that exist for move_base but not in navstack."""

from __future__ import annotations

FOREIGN_PLANNERS = {
    "TrajectoryPlannerROS": "base_local_planner",
    "TebLocalPlannerROS": "teb_local_planner",
    "EBandPlannerROS": "eband_local_planner",
    "DWBLocalPlanner": "dwb_local_planner",
    "MIRPlannerROS": "mir_dwb",
    "PoseFollower": "pose_follower",
    "MpcLocalPlannerROS": "mpc_local_planner",
    "PalLocalPlanner": "pal_local_planner",
    "RegulatedPurePursuit": "regulated_pure_pursuit_controller",
    "NeoLocalPlanner": "neo_local_planner",
    "FTCPlanner": "ftc_local_planner",
    "TrackingPidLocalPlanner": "tracking_pid",
    "GracefulControllerROS": "graceful_controller",
    "SBPLLatticePlanner": "sbpl_lattice_planner",
    "CarrotPlanner": "carrot_planner",
    "GlobalPlanner": "global_planner",
    "NavfnROS": "navfn",
    "DWAPlannerROS": "dwa_local_planner",
    "GridBased": "Nav2",
    "FollowPath": "Nav2",
}
"""Namespaces of move_base's planners -> their packages."""

FOREIGN_LOCAL_PLANNERS = frozenset(FOREIGN_PLANNERS) - {
    "SBPLLatticePlanner",
    "CarrotPlanner",
    "GlobalPlanner",
    "NavfnROS",
    "GridBased",
    "FollowPath",
    "DWAPlannerROS",
    "TrajectoryPlannerROS",
}
"""Namespaces of local planners that navstack lacks."""

NAV2_NODES = {
    "planner_server": "base_global_planner names the planner, whose section (GridBased) belongs at the root",
    "controller_server": "base_local_planner names the controller, whose section (FollowPath) belongs at the root",
}
"""Namespaces of Nav2's nodes -> what move_base has instead."""

FOREIGN_PARAMETERS = {
    "teb_local_planner": frozenset(
        {
            "min_obstacle_dist",
            "inflation_dist",
            "include_costmap_obstacles",
            "costmap_obstacles_behind_robot_dist",
            "obstacle_poses_affected",
            "costmap_converter_plugin",
            "costmap_converter_spin_thread",
            "costmap_converter_rate",
            "weight_obstacle",
            "weight_inflation",
            "weight_kinematics_nh",
            "weight_optimaltime",
        }
    ),
}
"""Package -> parameters that occur in the namespaces of other components."""

REMOVED_PARAMETERS = {"planner_costmap_publish_frequency": "no component reads it any more (navfn removed it)"}
"""Parameters of earlier releases that no component reads -> reason."""
