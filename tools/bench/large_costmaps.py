"""Real-time factor with large, fine costmaps: 10 x 10 m at 0.025 m, updates and control at 20 Hz, three lidars.

    python tools/bench/large_costmaps.py [NAME ..] [--repeat 3] [--stages] [--profile]

Drives one goal on the packaged map of the office with one set of parameters per name. The factor is simulated time over processor
time, with recording, after a warm-up; the median and the best of the runs, and the calibration of the machine if it is available
(see `reference.py`).
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from reference import Reference

from navstack.map_io import load_map, packaged_map_file
from navstack.parameters import load_configuration
from navstack.scenario import Scenario, load_places, run_scenario
from navstack.studies.speed import stage_times

ROBOT = """
controller_frequency: 20.0
planner_frequency: 1.0
base_local_planner: dwa_local_planner/DWAPlannerROS
base_global_planner: navfn/NavfnROS
DWAPlannerROS:
  {max_vel_x: 0.6, min_vel_x: 0.0, max_vel_y: 0.0, min_vel_y: 0.0, vy_samples: 1, max_vel_trans: 0.6, min_vel_trans: 0.1,
   max_vel_theta: 1.5, min_vel_theta: 0.3, acc_lim_x: 1.5, acc_lim_y: 0.0, acc_lim_theta: 3.0, sim_time: SIM_TIME, vx_samples: 10,
   vth_samples: 20, path_distance_bias: 32.0, goal_distance_bias: 24.0, occdist_scale: 0.02}
global_costmap:
  {global_frame: map, robot_base_frame: base_link, update_frequency: 5.0, resolution: 0.05, footprint: &f FOOTPRINT,
   footprint_padding: 0.01,
   plugins: [{name: static_layer, type: "costmap_2d::StaticLayer"}, {name: obstacles, type: "LAYER"},
             {name: inflation_layer, type: "costmap_2d::InflationLayer"}],
   obstacles: &o SOURCES, inflation_layer: &i {inflation_radius: INFLATION, cost_scaling_factor: 5.0}}
local_costmap:
  {global_frame: odom, robot_base_frame: base_link, update_frequency: 20.0, rolling_window: true, width: SIZE, height: SIZE,
   resolution: RESOLUTION, footprint: *f, footprint_padding: 0.01,
   plugins: [{name: obstacles, type: "LAYER"}, {name: inflation_layer, type: "costmap_2d::InflationLayer"}],
   obstacles: *o, inflation_layer: *i}
navstack:
  sim:
    lasers: [front, left, right]
    front: &l {topic: front, frame: front_link, fov: 4.7, beams: 720, range_max: 12.0, frequency: 20.0,
               range_min: 0.1, x: 0.2, y: 0.0, yaw: 0.0, height: 0.3}
    left: {<<: *l, topic: left, frame: left_link, x: 0.0, y: 0.15, yaw: 1.57}
    right: {<<: *l, topic: right, frame: right_link, x: 0.0, y: -0.15, yaw: -1.57}
"""
SOURCES = """
    {observation_sources: front left right, track_unknown_space: false, max_obstacle_height: 2.0, z_voxels: 10, z_resolution: 0.2,
     front: {topic: front, data_type: LaserScan, marking: true, clearing: true, obstacle_range: 8.0, raytrace_range: 9.0},
     left: {topic: left, data_type: LaserScan, marking: true, clearing: true, obstacle_range: 8.0, raytrace_range: 9.0},
     right: {topic: right, data_type: LaserScan, marking: true, clearing: true, obstacle_range: 8.0, raytrace_range: 9.0}}
"""
LARGE = {
    "LAYER": "costmap_2d::ObstacleLayer",
    "SIZE": "10.0",
    "RESOLUTION": "0.025",
    "SIM_TIME": "1.5",
    "INFLATION": "0.8",
    "FOOTPRINT": "[[-0.3, -0.22], [-0.3, 0.22], [0.3, 0.22], [0.3, -0.22]]",
}
CONFIGURATIONS: dict[str, dict[str, str]] = {
    "obstacle": LARGE,
    "voxel": {**LARGE, "LAYER": "costmap_2d::VoxelLayer"},
    "coarse": {**LARGE, "RESOLUTION": "0.05"},
}


def scenario_of(name: str, folder: Path) -> Scenario:
    """The drive through the office with these parameters."""
    text = ROBOT.replace("SOURCES", SOURCES)
    for key, value in CONFIGURATIONS[name].items():
        text = text.replace(key, value)
    file = folder / "robot.yaml"
    file.write_text(text)
    places = load_places("office")
    return Scenario(
        load_map(packaged_map_file("office", ".yaml")), load_configuration([str(file)]), places.start, places.goals[:1]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(CONFIGURATIONS)}; all by default")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--stages", action="store_true", help="print the time of each stage: the fastest of the runs")
    parser.add_argument("--profile", action="store_true", help="print a profile of each")
    args = parser.parse_args()
    for name in args.names or CONFIGURATIONS:
        with tempfile.TemporaryDirectory() as folder:
            scenario = scenario_of(name, Path(folder))
        first = run_scenario(scenario)
        factors: list[float] = []
        for _ in range(args.repeat):
            started = time.process_time()
            simulated = run_scenario(scenario).simulated_s
            factors.append(simulated / (time.process_time() - started))
        states = ", ".join(goal.state for goal in first.goals)
        print(
            f"{name:15} {first.simulated_s:5.1f} s ({states})  real-time factor: median {statistics.median(factors):.0f}, "
            f"best {max(factors):.0f}; {Reference().text()}",
            flush=True,
        )
        if args.stages:
            times = stage_times(scenario, args.repeat)
            for stage, found in sorted(times["stages"].items(), key=lambda item: -item[1]["seconds"]):
                print(f"    {stage:16} {1e3 * found['seconds'] / times['simulated_s']:6.2f} ms per simulated second")
        if args.profile:
            import cProfile
            import pstats

            profile = cProfile.Profile()
            profile.runcall(run_scenario, scenario)
            pstats.Stats(profile).sort_stats("tottime").print_stats(25)


if __name__ == "__main__":
    main()
