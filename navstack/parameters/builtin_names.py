"""Names of the parameters of the built-in plugins, to explain unused keys without importing all of them.

Written by tools/builtin_plugins.py from the parameter models; run it after a parameter is added or renamed.
"""

from typing import Final, NamedTuple


class PluginNames(NamedTuple):
    """What the YAML of one plugin may contain."""

    values: str
    """Names of its parameters, current and previous, separated by blanks."""
    others: str = ""
    """Names that are accepted without effect, and namespaces."""
    namespaces: str = ""
    """Namespaces that it shares with other planners (`NAMESPACES`)."""


BUILTIN_NAMES: Final[dict[str, dict[str, PluginNames]]] = {
    "global planner": {
        "astar": PluginNames(
            values=(
                "default_tolerance start_policy max_expansions allow_unknown neutral_cost cost_factor "
                "heuristic_weight cut_corners orientation_mode"
            ),
        ),
        "carrot_planner": PluginNames(
            values="",
            others="step_size min_dist_from_robot",
        ),
        "given_path": PluginNames(
            values="begin segments step start_tolerance goal_tolerance",
        ),
        "global_planner": PluginNames(
            values=(
                "default_tolerance start_policy max_expansions old_navfn_behavior use_quadratic "
                "use_dijkstra use_grid_path allow_unknown outline_map lethal_cost neutral_cost cost_factor "
                "publish_potential publish_scale orientation_mode orientation_window_size"
            ),
            others="planner_window_x planner_window_y",
        ),
        "nav2_navfn": PluginNames(
            values="tolerance use_astar allow_unknown max_cycles_factor use_final_approach_orientation",
            namespaces="GridBased",
        ),
        "nav2_theta_star": PluginNames(
            values=(
                "how_many_corners allow_unknown w_euc_cost w_traversal_cost use_final_approach_orientation start_policy"
            ),
            others="terminal_checking_interval w_heuristic_cost",
            namespaces="GridBased",
        ),
        "navfn": PluginNames(
            values="default_tolerance start_policy max_expansions allow_unknown visualize_potential use_astar",
            others="planner_window_x planner_window_y",
        ),
        "smac_2d": PluginNames(
            values=(
                "tolerance allow_unknown max_iterations cost_travel_multiplier use_quadratic_cost_penalty "
                "use_final_approach_orientation start_policy"
            ),
            others=(
                "max_on_approach_iterations terminal_checking_interval max_planning_time downsample_costmap "
                "downsampling_factor smooth_path debug_visualizations"
            ),
            namespaces="GridBased",
        ),
        "smac_hybrid": PluginNames(
            values=(
                "tolerance allow_unknown max_iterations max_on_approach_iterations "
                "terminal_checking_interval max_planning_time cost_penalty change_penalty "
                "non_straight_penalty reverse_penalty retrospective_penalty cusp_penalty "
                "use_quadratic_cost_penalty analytic_expansion_ratio analytic_expansion_max_length "
                "analytic_expansion_max_cost analytic_expansion_max_cost_override cache_obstacle_heuristic "
                "downsample_obstacle_heuristic lookup_table_size goal_heading_mode coarse_search_resolution "
                "smooth_path start_policy heuristic_weight motion_model_for_search angle_quantization_bins "
                "minimum_turning_radius allow_primitive_interpolation downsample_costmap "
                "downsampling_factor"
            ),
            others="debug_visualizations",
            namespaces="GridBased",
        ),
        "smac_lattice": PluginNames(
            values=(
                "tolerance allow_unknown max_iterations max_on_approach_iterations "
                "terminal_checking_interval max_planning_time cost_penalty change_penalty "
                "non_straight_penalty reverse_penalty retrospective_penalty cusp_penalty "
                "use_quadratic_cost_penalty analytic_expansion_ratio analytic_expansion_max_length "
                "analytic_expansion_max_cost analytic_expansion_max_cost_override cache_obstacle_heuristic "
                "downsample_obstacle_heuristic lookup_table_size goal_heading_mode coarse_search_resolution "
                "smooth_path start_policy heuristic_weight lattice_filepath allow_reverse_expansion "
                "rotation_penalty"
            ),
            others="debug_visualizations",
            namespaces="GridBased",
        ),
        "theta_star": PluginNames(
            values=(
                "default_tolerance start_policy max_expansions allow_unknown neutral_cost cost_factor "
                "heuristic_weight cut_corners orientation_mode"
            ),
        ),
    },
    "local planner": {
        "dwa": PluginNames(
            values=(
                "max_vel_trans min_vel_trans max_vel_x min_vel_x max_vel_y min_vel_y max_vel_theta "
                "min_vel_theta acc_lim_x acc_lim_y acc_lim_theta prune_plan xy_goal_tolerance "
                "yaw_goal_tolerance trans_stopped_vel theta_stopped_vel latch_xy_goal_tolerance sim_time "
                "sim_granularity angular_sim_granularity path_distance_bias goal_distance_bias "
                "occdist_scale twirling_scale oscillation_reset_dist oscillation_reset_angle "
                "forward_point_distance cheat_factor scaling_speed max_scaling_factor vx_samples vy_samples "
                "vth_samples use_dwa sum_scores controller_frequency publish_traj_pc publish_cost_grid_pc "
                "global_frame_id odom_topic critics max_trans_vel min_trans_vel max_rot_vel min_rot_vel "
                "rot_stopped_vel vtheta_samples acc_limit_x acc_limit_y acc_limit_th acc_lim_th pdist_scale "
                "gdist_scale"
            ),
            others=(
                "stop_time_buffer acc_lim_trans acc_limit_trans restore_defaults holonomic_robot penalize_negative_x"
            ),
        ),
        "dwb": PluginNames(
            values=(
                "controller_frequency goal_checker_plugins path_handler_plugins prune_distance "
                "max_robot_pose_search_dist enforce_path_inversion inversion_xy_tolerance "
                "inversion_yaw_tolerance min_vel_x max_vel_x min_vel_y max_vel_y max_vel_theta min_speed_xy "
                "max_speed_xy min_speed_theta acc_lim_x acc_lim_y acc_lim_theta decel_lim_x decel_lim_y "
                "decel_lim_theta trajectory_generator_name sim_time sim_period discretize_by_time "
                "time_granularity linear_granularity angular_granularity include_last_point "
                "limit_vel_cmd_in_traj vx_samples vy_samples vtheta_samples "
                "short_circuit_trajectory_evaluation prune_plan forward_prune_distance "
                "shorten_transformed_plan xy_goal_tolerance trans_stopped_velocity path_length_tolerance "
                "default_critic_namespaces critics max_rot_vel min_trans_vel max_trans_vel min_rot_vel"
            ),
            others=(
                "plugin transform_tolerance debug_trajectory_details publish_evaluation publish_global_plan "
                "publish_transformed_plan publish_local_plan publish_trajectories publish_cost_grid_pc "
                "marker_lifetime stateful"
            ),
            namespaces="FollowPath",
        ),
        "graceful": PluginNames(
            values=(
                "controller_frequency goal_checker_plugins path_handler_plugins prune_distance "
                "max_robot_pose_search_dist enforce_path_inversion inversion_xy_tolerance "
                "inversion_yaw_tolerance lambda max_lookahead k_phi k_delta beta v_linear_min v_linear_max "
                "v_angular_max v_angular_min_in_place slowdown_radius deceleration_max max_linear_accel "
                "max_angular_accel initial_rotation initial_rotation_tolerance prefer_final_rotation "
                "rotation_scaling_factor allow_backward use_collision_detection "
                "in_place_collision_resolution footprint_scaling_linear_vel footprint_scaling_factor "
                "footprint_scaling_step obstacle_cost_margin final_rotation_search_step motion_target_dist "
                "initial_rotation_min_angle"
            ),
            others="plugin transform_tolerance min_lookahead final_rotation",
            namespaces="FollowPath",
        ),
        "mppi": PluginNames(
            values=(
                "controller_frequency goal_checker_plugins path_handler_plugins prune_distance "
                "max_robot_pose_search_dist enforce_path_inversion inversion_xy_tolerance "
                "inversion_yaw_tolerance batch_size time_steps model_dt iteration_count temperature gamma "
                "vx_max vx_min vy_max wz_max ax_max ax_min ay_max ay_min az_max vx_std vy_std wz_std "
                "model_delay_vx model_delay_vy model_delay_wz clamp_raw_controls open_loop sgf_order "
                "retry_attempt_limit regenerate_noises seed motion_model critics"
            ),
            others=(
                "plugin transform_tolerance visualize publish_critics_stats critic_index_to_visualize "
                "publish_optimal_trajectory reset_period"
            ),
            namespaces="FollowPath",
        ),
        "policy": PluginNames(
            values=(
                "controller_frequency goal_checker_plugins path_handler_plugins prune_distance "
                "max_robot_pose_search_dist enforce_path_inversion inversion_xy_tolerance "
                "inversion_yaw_tolerance model beams fov scan_x scan_y scan_yaw scan_clip goal_range "
                "plan_points last_action max_vel_x min_vel_x max_vel_y min_vel_y max_vel_theta acc_lim_x "
                "acc_lim_y acc_lim_theta use_collision_detection collision_time"
            ),
            others="plugin transform_tolerance",
            namespaces="FollowPath",
        ),
        "regulated_pure_pursuit": PluginNames(
            values=(
                "controller_frequency goal_checker_plugins path_handler_plugins prune_distance "
                "max_robot_pose_search_dist enforce_path_inversion inversion_xy_tolerance "
                "inversion_yaw_tolerance max_linear_vel lookahead_dist use_velocity_scaled_lookahead_dist "
                "lookahead_time min_lookahead_dist max_lookahead_dist use_fixed_curvature_lookahead "
                "curvature_lookahead_dist interpolate_curvature_after_goal "
                "use_regulated_linear_velocity_scaling regulated_linear_scaling_min_radius "
                "regulated_linear_scaling_min_speed use_cost_regulated_linear_velocity_scaling "
                "cost_scaling_dist cost_scaling_gain inflation_cost_scaling_factor "
                "approach_velocity_scaling_dist min_approach_linear_velocity use_rotate_to_heading "
                "rotate_to_heading_min_angle rotate_to_heading_angular_vel max_angular_accel "
                "allow_reversing use_cancel_deceleration cancel_deceleration use_collision_detection "
                "max_allowed_time_to_collision_up_to_carrot min_distance_to_obstacle "
                "allow_obstacle_checking_beyond_goal use_dynamic_window min_linear_vel max_angular_vel "
                "min_angular_vel max_linear_accel max_angular_decel max_linear_decel min_turning_r "
                "desired_linear_vel"
            ),
            others="plugin transform_tolerance stateful use_interpolation",
            namespaces="FollowPath",
        ),
        "rotation_shim": PluginNames(
            values=(
                "controller_frequency goal_checker_plugins path_handler_plugins prune_distance "
                "max_robot_pose_search_dist enforce_path_inversion inversion_xy_tolerance "
                "inversion_yaw_tolerance angular_dist_threshold angular_disengage_threshold "
                "forward_sampling_distance rotate_to_heading_angular_vel max_angular_accel "
                "simulate_ahead_time max_cost_threshold rotate_to_goal_heading rotate_to_heading_once "
                "closed_loop use_path_orientations"
            ),
            others="plugin transform_tolerance",
            namespaces="FollowPath",
        ),
        "trajectory_rollout": PluginNames(
            values=(
                "acc_lim_x acc_lim_y acc_lim_theta max_vel_x min_vel_x max_vel_theta min_vel_theta "
                "max_rotational_vel min_in_place_vel_theta sim_time sim_granularity angular_sim_granularity "
                "vx_samples vtheta_samples path_distance_bias goal_distance_bias occdist_scale "
                "meter_scoring heading_lookahead oscillation_reset_dist escape_reset_dist "
                "escape_reset_theta escape_vel holonomic_robot y_vels dwa heading_scoring "
                "heading_scoring_timestep simple_attractor prune_plan yaw_goal_tolerance xy_goal_tolerance "
                "latch_xy_goal_tolerance controller_frequency pdist_scale gdist_scale "
                "min_in_place_rotational_vel backup_vel acc_limit_x acc_limit_y acc_limit_th acc_lim_th "
                "vth_samples"
            ),
            others=(
                "stop_time_buffer world_model point_grid restore_defaults publish_cost_grid_pc "
                "global_frame_id max_vel_y min_vel_y"
            ),
        ),
    },
    "smoother": {
        "constrained": PluginNames(
            values=(
                "minimum_turning_radius w_smooth w_curve w_dist w_cost w_cost_cusp_multiplier "
                "cusp_zone_length cost_check_points path_downsampling_factor path_upsampling_factor "
                "reversing_enabled keep_start_orientation keep_goal_orientation"
            ),
        ),
        "savitzky_golay": PluginNames(
            values=(
                "do_refinement refinement_num enforce_path_inversion minimum_turning_radius window_size poly_order"
            ),
        ),
        "simple": PluginNames(
            values=(
                "do_refinement refinement_num enforce_path_inversion minimum_turning_radius tolerance "
                "max_its w_data w_smooth"
            ),
        ),
    },
    "costmap layer": {
        "binary_mask": PluginNames(
            values="enabled mask filter_info_topic base multiplier default_state flip_threshold",
            others="binary_state_topic",
        ),
        "decaying_voxel": PluginNames(
            values=(
                "enabled voxel_size voxel_decay decay_model mark_threshold track_unknown_space "
                "update_footprint_enabled combination_method transform_tolerance observation_sources"
            ),
            others=("publish_voxel_map mapping_mode map_save_duration unknown_threshold max_obstacle_height origin_z"),
        ),
        "denoise": PluginNames(
            values="enabled minimal_group_size group_connectivity_type",
        ),
        "inflation": PluginNames(
            values="enabled cost_scaling_factor inflation_radius inflate_unknown",
        ),
        "keepout_mask": PluginNames(
            values="enabled mask filter_info_topic",
        ),
        "nav2_denoise": PluginNames(
            values="enabled minimal_group_size group_connectivity_type",
        ),
        "nav2_inflation": PluginNames(
            values=(
                "enabled cost_scaling_factor inflation_radius inflate_unknown inflate_around_unknown "
                "custom_inscribed_radius"
            ),
            others="num_threads",
        ),
        "nav2_obstacle": PluginNames(
            values=(
                "enabled footprint_clearing_enabled max_obstacle_height combination_method "
                "track_unknown_space transform_tolerance observation_sources min_obstacle_height"
            ),
            others="tf_filter_tolerance",
        ),
        "nav2_static": PluginNames(
            values=(
                "enabled map_topic subscribe_to_updates footprint_clearing_enabled "
                "restore_cleared_footprint track_unknown_space use_maximum lethal_cost_threshold "
                "inscribed_obstacle_cost_value unknown_cost_value trinary_costmap nav2_compatible"
            ),
            others="map_subscribe_transient_local transform_tolerance",
        ),
        "nav2_voxel": PluginNames(
            values=(
                "enabled footprint_clearing_enabled max_obstacle_height combination_method "
                "track_unknown_space transform_tolerance observation_sources min_obstacle_height origin_z "
                "z_resolution z_voxels unknown_threshold mark_threshold publish_voxel_map"
            ),
            others="tf_filter_tolerance",
        ),
        "obstacle": PluginNames(
            values=(
                "enabled footprint_clearing_enabled max_obstacle_height combination_method "
                "track_unknown_space transform_tolerance observation_sources obstacle_range raytrace_range"
            ),
        ),
        "plugin_container": PluginNames(
            values="enabled plugins combination_method nav2_compatible",
        ),
        "range_sensor": PluginNames(
            values=(
                "enabled ns topics phi inflate_cone no_readings_timeout clear_threshold mark_threshold "
                "clear_on_max_reading input_sensor_type"
            ),
        ),
        "speed_mask": PluginNames(
            values="enabled mask filter_info_topic type base multiplier",
        ),
        "static": PluginNames(
            values=(
                "enabled map_topic first_map_only subscribe_to_updates track_unknown_space use_maximum "
                "lethal_cost_threshold unknown_cost_value trinary_costmap"
            ),
        ),
        "voxel": PluginNames(
            values=(
                "enabled footprint_clearing_enabled max_obstacle_height combination_method "
                "track_unknown_space transform_tolerance observation_sources obstacle_range raytrace_range "
                "origin_z z_resolution z_voxels unknown_threshold mark_threshold publish_voxel_map"
            ),
        ),
    },
    "recovery behavior": {
        "assisted_teleop": PluginNames(
            values="time_allowance cycle_frequency projection_time simulation_time_step",
            others="cmd_vel_teleop",
        ),
        "back_up": PluginNames(
            values=(
                "time_allowance simulate_ahead_time cycle_frequency disable_collision_checks backup_dist backup_speed"
            ),
        ),
        "clear_costmap_recovery": PluginNames(
            values=("reset_distance invert_area_to_clear force_updating affected_maps layer_names layer_search_string"),
        ),
        "drive_on_heading": PluginNames(
            values=("time_allowance simulate_ahead_time cycle_frequency disable_collision_checks dist_to_travel speed"),
        ),
        "move_slow_and_clear": PluginNames(
            values="clearing_distance limited_trans_speed limited_rot_speed limited_distance",
            others="max_trans_param_name max_rot_param_name planner_namespace",
        ),
        "rotate_recovery": PluginNames(
            values="sim_granularity frequency max_rotational_vel",
        ),
        "spin": PluginNames(
            values=(
                "time_allowance simulate_ahead_time cycle_frequency disable_collision_checks spin_dist "
                "max_rotational_vel min_rotational_vel rotational_acc_lim"
            ),
        ),
        "spin_to_localize": PluginNames(
            values=(
                "time_allowance simulate_ahead_time cycle_frequency disable_collision_checks spin_dist "
                "max_rotational_vel min_rotational_vel rotational_acc_lim"
            ),
        ),
        "wait": PluginNames(
            values="wait_duration",
        ),
    },
}
