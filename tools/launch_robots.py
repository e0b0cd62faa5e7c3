"""Drive the robots of public repositories by their own launch files: what loads, what drives, what touches.

    python tools/launch_robots.py FOLDER [--maps NAME ..] [--only TEXT ..] [--time-limit S] [--allow-missing] [--processes N]
                                  [--out FILE]

FOLDER has a checkout of each repository of `ROBOTS` in `owner/name`; absent ones are left out. Each robot drives to the goals of
each map. Where it does not reach all of them without contact and the doors are too narrow for it to turn, it drives through the
map scaled to it, as generated suites are. A drive ends with the first goal that fails.
Prints a table in Markdown: goals reached, contacts, simulated seconds, and below it the causes. `--out` writes the same as JSON.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from navstack.core import NavError
from navstack.explain import narrow_advice
from navstack.parameters import Configuration, load_configuration
from navstack.scenario import Scenario, ScenarioSpec, run_scenario, scaled, suite_scale
from navstack.shortcuts import make_scenario

ROBOTS: dict[str, str] = {
    "22arw/butler_navigation": "launch/butler_costmaps.launch",
    "521minsu/kobuki_navigation": "launch/includes/move_base.launch",
    "6-robot/wpr_simulation": "launch/wpb_navigation.launch",
    "AMABerkeley/amac_2dnav": "launch/move_base.launch",
    "Alex-Beh/ohmni_nav": "launch/move_base.launch",
    "AngeloChen14/jetbot_navigation": "launch/move_base.launch",
    "BruceChanJianLe/ros-move-base": "launch/move_base.launch",
    "CIFASIS/weed_robot_navigation": "launch/navigation.launch",
    "CNURobotics/chris_turtlebot_navigation": "launch/includes/move_base.launch.xml",
    "CentralLabFacilities/meka_2dnav": "launch/meka_navigation_mob_map.launch",
    "Connor-York/leo_navigation": "launch/move_base.launch",
    "D3Engineering/edge-ai-ros-2dnav": "launch/move_base.launch",
    "Daidalos99/qsbot_navigation": "launch/move_base.launch",
    "DanPierce/marv_nav": "launch/move_base_hokuyo.launch",
    "DroidAITech/xbot_navi": "launch/include/move_base.launch.xml",
    "EAIBOT/dashgo": "dashgo_nav/launch/move_base.launch",
    "GT-RAIL/carl_navigation": "launch/move_base.launch",
    "GeorgyOstr/udacity_bot": "launch/amcl.launch",
    "HemaZ/barista_bot": "launch/amcl.launch",
    "Honza0297/ros-trilobot": "launch/move_base.launch",
    "Hypha-ROS/hypharos_racecar": "launch/RACECAR_amcl_nav.launch",
    "IIT-SoftBots/alterego_navigation": "launch/autonomous_nav.launch",
    "InomaCreate/inobo_navigation": "launch/move_base.launch",
    "KeishiIshihara/p3at_navigation": "launch/move_base1.launch",
    "LCP-WORKS/atemr_nav": "launch/mb.launch",
    "LeoRover/leo_navigation": "launch/move_base.launch",
    "LeoYang94/nav_cubot": "launch/nav_move_base.launch.xml",
    "Mutsuto6210/raspimouse_all": "launch/run_move_base.launch",
    "RobotnikAutomation/rb1_base_common": "rb1_base_navigation/launch/move_base_teb.launch",
    "Saturn-robot/saturnbot_navigation": "launch/includes/move_base.launch.xml",
    "TNMY1110/connectwo_bringup": "launch/move_base.launch",
    "agilexrobotics/limo_ros": "limo_bringup/launch/limo_navigation_diff.launch",
    "aojedao/hykabai_navigation": "launch/move_base.launch",
    "blinky-robot/blinky_2dnav": "launch/move_base.launch",
    "boxer-cpr/boxer": "boxer_navigation/launch/amcl_demo.launch",
    "burf2000/burf_robot": "launch/robot.launch",
    "coderkarl/jeep_2dnav": "launch/jeep_move_base_nav.launch",
    "dingo-cpr/dingo": "dingo_navigation/launch/amcl_demo.launch",
    "dokkev/bumpybot_navigation": "launch/move_base.launch",
    "firephinx/rcah18_pepper_navigation": "launch/move_base.launch",
    "gaolin131/robot_navigation": "launch/move_base.launch",
    "inuex3/robot_mower_2dnav": "launch/move_base.launch",
    "neobotix/neo_mp_500": "configs/navigation/move_base/move_base.launch",
    "neobotix/neo_mpo_700": "configs/navigation/move_base/move_base.launch",
    "pandora-auth-ros-pkg/pandora_navigation": "pandora_monstertruck_2dnav/launch/move_base.launch",
    "roadnarrows-robotics/laelaps_2dnav": "launch/move_base.launch",
    "robotics-upo/upo_robot_navigation": "upo_launchers/upo_lab/move_base/real_nav_upo_lab.launch",
    "ros-mobile-robots/diffbot": "diffbot_navigation/launch/move_base.launch",
    "uchile-robotics/bender_bringup": "launch/navigation/move_base.launch.xml",
    "youbot/youbot-ros-pkg": "youbot_navigation/youbot_navigation_global/launch/move_base_global.launch",
}
"""Repository (`owner/name`) -> the launch file that starts its move_base."""
CORRIDOR_M = 1.6
"""Width of the corridor of the packaged office: a car turns within twice its turning radius and its width."""


@dataclass
class Drive:
    """How a robot drove through one map."""

    map: str
    scale: float = 1.0
    goals: int = 0
    reached: int = 0
    contacts: int = 0
    time_s: float = 0.0
    causes: list[str] = field(default_factory=list[str])
    """A sentence for each goal that was not reached, and advice."""

    @property
    def text(self) -> str:
        """Its cell of the table."""
        if not self.goals:
            return "no start"
        scale = "" if self.scale == 1.0 else f" (map x {self.scale:g})"
        return f"{self.reached} of {self.goals}, {self.contacts} contacts, {self.time_s:.0f} s{scale}"

    @property
    def clean(self) -> bool:
        """True if all goals were reached without contact."""
        return self.goals > 0 and self.reached == self.goals and self.contacts == 0


@dataclass
class Robot:
    """What became of one launch file."""

    name: str
    file: str
    controller: str = ""
    size: str = ""
    error: str = ""
    drives: list[Drive] = field(default_factory=list[Drive])
    fitted: list[Drive] = field(default_factory=list[Drive])
    """On maps that are scaled to the robot; the same drives where it fits into the maps as they are."""


def scale_for(configuration: Configuration, base: str) -> float:
    """Return by how much a packaged map must be larger for a robot: that of the suites, and for a car that of its turn."""
    footprint = configuration.global_costmap.footprint
    turn = configuration.navstack.sim.min_turning_radius
    for_turn = 2.0 * turn + 2.0 * footprint.inscribed_radius
    return max(suite_scale(base, footprint), math.ceil(4.0 * for_turn / CORRIDOR_M) / 4.0 if turn > 0.0 else 1.0)


def scenario_on(name: str, configuration: Configuration, time_limit_s: float, scale: float) -> Scenario:
    """Return the drive through a packaged map that is `scale` times as large."""
    made = make_scenario(name, robot=configuration, time_limit_s=time_limit_s)
    plain = replace(made, stop_on_failure=True)
    if scale == 1.0:
        return plain
    values: dict[str, Any] = {
        "name": name, "start": plain.start, "goals": plain.goals, "shapes": (), "time_limit_s": time_limit_s
    }  # fmt: skip
    [larger] = scaled([ScenarioSpec(values, sources=[], goal_names=("",), grid=plain.map)], scale)
    limit = larger.values["time_limit_s"]
    return replace(plain, map=larger.map(), start=larger.start, goals=tuple(larger.goals), time_limit_s=limit)


def examine(folder: Path, name: str, maps: tuple[str, ...], time_limit_s: float, allow_missing: bool) -> Robot:
    """Load a launch file and drive its robot."""
    found = Robot(name, ROBOTS[name])
    warnings.simplefilter("ignore")
    try:
        configuration = load_configuration([str(folder / name / ROBOTS[name])], allow_missing=allow_missing)
    except NavError as exc:
        found.error = exc.message
        return found
    found.controller = configuration.local_planner.name
    footprint = configuration.global_costmap.true_footprint
    found.size = f"{2.0 * footprint.inscribed_radius:.2f} to {2.0 * footprint.circumscribed_radius:.2f} m"
    for map_name in maps:
        plain = drive(map_name, configuration, time_limit_s, 1.0)
        found.drives.append(plain)
        scale = scale_for(configuration, map_name)
        found.fitted.append(
            plain if plain.clean or scale == 1.0 else drive(map_name, configuration, time_limit_s, scale)
        )
    return found


def drive(map_name: str, configuration: Configuration, time_limit_s: float, scale: float) -> Drive:
    """Drive to the goals of a map."""
    made = Drive(map_name, scale)
    try:
        scenario = scenario_on(map_name, configuration, time_limit_s, scale)
        result = run_scenario(scenario)
    except NavError as exc:
        made.causes.append(exc.message)
        return made
    made.goals, made.reached = len(scenario.goals), sum(g.succeeded for g in result.goals)
    made.contacts, made.time_s = result.collisions, result.simulated_s
    for number, goal in enumerate(result.goals, 1):
        if not goal.succeeded:
            made.causes.append(f"goal {number}: {goal.message}")
    if not made.clean:
        assert result.recorder is not None
        made.causes += [*result.advice, *narrow_advice(result.recorder.record())]
    return made


def print_table(robots: list[Robot], maps: tuple[str, ...]) -> None:
    """Print the table, the sums and the causes."""
    columns = [*maps, *(f"{name}, doors fit" for name in maps)]
    print("| robot | launch file | loads | controller | size | " + " | ".join(columns) + " |")
    print("|---" * (5 + len(columns)) + "|")
    for robot in robots:
        drives = [*robot.drives, *robot.fitted]
        cells = [drive.text for drive in drives] or ["-"] * len(columns)
        loads = "no" if robot.error else "yes"
        print("| " + " | ".join([robot.name, robot.file, loads, robot.controller, robot.size, *cells]) + " |")
    loaded = [robot for robot in robots if not robot.error]
    print(f"\n{len(loaded)} of {len(robots)} launch files load, the others say why")
    for what, drives in (("as they are", [r.drives for r in loaded]), ("where doors fit", [r.fitted for r in loaded])):
        clean = sum(all(drive.clean for drive in of_robot) for of_robot in drives)
        every = [drive for of_robot in drives for drive in of_robot]
        print(
            f"{' and '.join(maps)} {what}: {clean} robots reach all goals without contact; {sum(d.reached for d in every)} of "
            f"{sum(d.goals for d in every)} goals; {sum(d.contacts for d in every)} contacts in "
            f"{sum(d.contacts > 0 for d in every)} drives"
        )
    for robot in robots:
        if robot.error:
            print(f"\n{robot.name}: {robot.error}")
        fitted = [drive for drive in robot.fitted if drive.scale != 1.0]
        for drive in [*robot.drives, *fitted]:
            scale = "" if drive.scale == 1.0 else f" x {drive.scale:g}"
            for cause in drive.causes:
                print(f"\n{robot.name}, {drive.map}{scale}: {cause}")


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--maps", nargs="*", default=["office", "warehouse"])
    parser.add_argument("--only", nargs="+", default=[""], help="robots whose name contains one of these")
    parser.add_argument("--time-limit", type=float, default=300.0, help="simulated seconds for each goal")
    parser.add_argument("--allow-missing", action="store_true", help="let others stand in for missing plugins")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    maps = tuple(given.maps)
    names = [n for n in ROBOTS if (given.folder / n).is_dir() and any(text in n for text in given.only)]
    robots: list[Robot] = []
    with ProcessPoolExecutor(given.processes) as pool:
        tasks = [pool.submit(examine, given.folder, n, maps, given.time_limit, given.allow_missing) for n in names]
        for task in tasks:
            robots.append(task.result())
            print(f"{len(robots)} of {len(names)}: {robots[-1].name}", file=sys.stderr, flush=True)
            if given.out is not None:
                given.out.write_text(json.dumps([asdict(robot) for robot in robots], indent=1), encoding="utf-8")
    print_table(robots, maps)
    return 0


if __name__ == "__main__":
    sys.exit(main())
