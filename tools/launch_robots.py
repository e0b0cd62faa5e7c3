"""Drive the robots of public repositories by their own launch files: what loads, what drives, what touches.

    python tools/launch_robots.py FOLDER [--maps NAME ..] [--only TEXT ..] [--time-limit S] [--distro noetic|indigo]
                                  [--allow-missing] [--processes N] [--out FILE [--resume]]

FOLDER has a checkout of each repository of `ROBOTS` in `owner/name`; absent ones are left out. Each robot drives to the goals of
each map. Where it does not reach all of them without contact and the doors are too narrow for it to turn, it drives through the
map scaled to it, as generated suites are. A drive ends with the first goal that fails.
Robots whose YAML was last changed before move_base scored as it does today (`SCORING_CHANGED`) are driven with `--distro indigo`.
Prints a table in Markdown: goals reached, contacts, simulated seconds, and below it the causes. `--out` writes the same as JSON,
after each robot; with `--resume`, robots that it has are not driven again.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from navstack.core import NavError
from navstack.explain import narrow_advice
from navstack.parameters import Configuration, load_configuration
from navstack.scenario import Scenario, ScenarioSpec, run_scenario, scaled, suite_scale
from navstack.shortcuts import make_scenario


@dataclass(frozen=True)
class Source:
    """Where a robot's parameters are."""

    launch: str
    """The launch file that people start, below the checkout."""
    changed: str
    """Date of the last change of a YAML file."""

    @property
    def distro(self) -> str:
        """The distribution whose scoring the weights were tuned for, as far as the date tells."""
        return "indigo" if self.changed < SCORING_CHANGED else "noetic"


SCORING_CHANGED = "2018-07-25"
"""Date of navigation 1.16.0, which changed the scale of the weights of local planners."""
ROBOTS: dict[str, Source] = {
    "22arw/butler_navigation": Source("launch/butler_costmaps.launch", "2021-04-11"),
    "521minsu/kobuki_navigation": Source("launch/master.launch", "2024-09-21"),
    "6-robot/wpr_simulation": Source("launch/wpb_navigation.launch", "2020-07-01"),
    "AMABerkeley/amac_2dnav": Source("launch/move_base.launch", "2019-01-26"),
    "Alex-Beh/ohmni_nav": Source("launch/move_base.launch", "2021-07-07"),
    "AngeloChen14/jetbot_navigation": Source("launch/move_base.launch", "2021-06-11"),
    "BruceChanJianLe/ros-move-base": Source("launch/move_base.launch", "2020-10-30"),
    "CIFASIS/weed_robot_navigation": Source("launch/navigation.launch", "2022-05-15"),
    "CNURobotics/chris_create_navigation": Source("launch/amcl_demo.launch", "2016-09-30"),
    "CNURobotics/chris_turtlebot_navigation": Source("launch/includes/move_base.launch.xml", "2019-07-08"),
    "CentralLabFacilities/meka_2dnav": Source("launch/meka_navigation_mob_map.launch", "2018-01-22"),
    "Connor-York/leo_navigation": Source("launch/move_base.launch", "2024-06-17"),
    "D3Engineering/edge-ai-ros-2dnav": Source("launch/move_base.launch", "2023-01-04"),
    "Daidalos99/qsbot_navigation": Source("launch/move_base.launch", "2023-02-03"),
    "DanPierce/marv_nav": Source("launch/move_base_hokuyo.launch", "2012-09-11"),
    "DroidAITech/xbot_navi": Source("launch/include/move_base.launch.xml", "2019-06-17"),
    "EAIBOT/dashgo": Source("dashgo_nav/launch/move_base.launch", "2016-11-07"),
    "GJXS1980/arv_navigation": Source("launch/amcl_demo.launch", "2022-04-07"),
    "GT-RAIL/carl_navigation": Source("launch/move_base.launch", "2015-09-09"),
    "GeorgyOstr/udacity_bot": Source("launch/amcl.launch", "2018-08-24"),
    "HemaZ/barista_bot": Source("launch/amcl.launch", "2020-05-15"),
    "Honza0297/ros-trilobot": Source("launch/move_base.launch", "2022-05-24"),
    "Hypha-ROS/hypharos_racecar": Source("launch/RACECAR_amcl_nav.launch", "2017-09-23"),
    "IIT-SoftBots/alterego_navigation": Source("launch/autonomous_nav.launch", "2025-02-03"),
    "InomaCreate/inobo_navigation": Source("launch/move_base.launch", "2024-07-19"),
    "KeishiIshihara/p3at_navigation": Source("launch/move_base1.launch", "2019-02-22"),
    "LCP-WORKS/atemr_nav": Source("launch/mb.launch", "2022-02-03"),
    "LeoRover/leo_navigation": Source("launch/move_base.launch", "2020-12-18"),
    "LeoYang94/nav_cubot": Source("launch/nav_move_base.launch.xml", "2019-11-22"),
    "LordBismaya/argo_navigation": Source("launch/amcl_demo.launch", "2016-09-12"),
    "MartijnWisse/mirte_navigation": Source("launch/amcl_demo.launch", "2024-07-18"),
    "Mutsuto6210/raspimouse_all": Source("launch/run_move_base.launch", "2020-11-04"),
    "RobotnikAutomation/rb1_base_common": Source("rb1_base_navigation/launch/move_base_teb.launch", "2023-07-13"),
    "Saturn-robot/saturnbot_navigation": Source("launch/includes/move_base.launch.xml", "2017-10-24"),
    "TNMY1110/connectwo_bringup": Source("launch/move_base.launch", "2026-07-08"),
    "WalkingMachine/sara_navigation": Source("launch/move_base_amcl.launch", "2019-06-18"),
    "agilexrobotics/limo_ros": Source("limo_bringup/launch/limo_navigation_diff.launch", "2022-02-09"),
    "aojedao/hykabai_navigation": Source("launch/move_base.launch", "2023-05-19"),
    "blinky-robot/blinky_2dnav": Source("launch/move_base.launch", "2015-06-21"),
    "boxer-cpr/boxer": Source("boxer_navigation/launch/amcl_demo.launch", "2021-11-10"),
    "burf2000/burf_robot": Source("launch/robot.launch", "2017-02-25"),
    "coderkarl/jeep_2dnav": Source("launch/jeep_move_base_nav.launch", "2019-05-25"),
    "dingo-cpr/dingo": Source("dingo_navigation/launch/amcl_demo.launch", "2021-12-20"),
    "dokkev/bumpybot_navigation": Source("launch/move_base.launch", "2024-08-23"),
    "dparne/pepper_navigation": Source("launch/amcl_demo.launch", "2015-09-06"),
    "firephinx/rcah18_pepper_navigation": Source("launch/move_base.launch", "2018-06-14"),
    "gaolin131/robot_navigation": Source("launch/move_base.launch", "2021-04-28"),
    "haiing/aiibot_navigation": Source("launch/amcl_demo.launch", "2016-08-19"),
    "inuex3/robot_mower_2dnav": Source("launch/move_base.launch", "2022-09-12"),
    "kamccall/robotics-ud-ros-navigation": Source("launch/amcl_demo.launch", "2022-12-24"),
    "nag92/warthog_navigation": Source("launch/amcl_demo.launch", "2024-07-27"),
    "neobotix/neo_mp_500": Source("configs/navigation/move_base/move_base.launch", "2020-07-23"),
    "neobotix/neo_mpo_700": Source("configs/navigation/move_base/move_base.launch", "2020-10-14"),
    "pandora-auth-ros-pkg/pandora_navigation": Source(
        "pandora_monstertruck_2dnav/launch/move_base.launch", "2016-10-14"
    ),
    "roadnarrows-robotics/laelaps_2dnav": Source("launch/move_base.launch", "2017-06-28"),
    "robotics-upo/upo_robot_navigation": Source(
        "upo_launchers/upo_lab/move_base/real_nav_upo_lab.launch", "2017-09-13"
    ),
    "ros-mobile-robots/diffbot": Source("diffbot_navigation/launch/move_base.launch", "2022-02-06"),
    "uchile-robotics/bender_bringup": Source("launch/navigation/navigation.launch", "2019-01-03"),
    "unt-robotics/eddiebot_navigation": Source("launch/amcl_demo.launch", "2013-03-29"),
    "youbot/youbot-ros-pkg": Source(
        "youbot_navigation/youbot_navigation_global/launch/move_base_global.launch", "2012-11-30"
    ),
}
"""Repository (`owner/name`) -> its source. The last ten are all that hold `launch/amcl_demo.launch` and are named
`navigation`, without those of turtlebots, Jackals and Huskies; they were chosen before they were driven."""
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
    distro: str = ""
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


def examine(
    folder: Path, name: str, maps: tuple[str, ...], time_limit_s: float, distro: str | None, allow_missing: bool
) -> Robot:
    """Load a launch file and drive its robot; `distro` instead of that of its date."""
    source = ROBOTS[name]
    found = Robot(name, source.launch, distro or source.distro)
    warnings.simplefilter("ignore")
    try:
        configuration = load_configuration(
            [str(folder / name / source.launch)], distro=found.distro, allow_missing=allow_missing
        )
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


def read_results(path: Path) -> list[Robot]:
    """Return the robots of an earlier `--out`."""
    found: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    for robot in found:
        for name in ("drives", "fitted"):
            robot[name] = [Drive(**drive) for drive in robot[name]]
    return [Robot(**robot) for robot in found]


def print_table(robots: list[Robot], maps: tuple[str, ...]) -> None:
    """Print the table, the sums and the causes."""
    columns = [*maps, *(f"{name}, doors fit" for name in maps)]
    print("| robot | launch file | loads | distro | controller | size | " + " | ".join(columns) + " |")
    print("|---" * (6 + len(columns)) + "|")
    for robot in robots:
        drives = [*robot.drives, *robot.fitted]
        cells = [drive.text for drive in drives] or ["-"] * len(columns)
        loads = "no" if robot.error else "yes"
        print(
            "| "
            + " | ".join([robot.name, robot.file, loads, robot.distro, robot.controller, robot.size, *cells])
            + " |"
        )
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
    parser.add_argument("--distro", choices=("noetic", "indigo"), help="for all; by default by the date of the YAML")
    parser.add_argument("--allow-missing", action="store_true", help="let others stand in for missing plugins")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--resume", action="store_true", help="keep the robots that --out has")
    given = parser.parse_args()
    maps = tuple(given.maps)
    names = [n for n in ROBOTS if (given.folder / n).is_dir() and any(text in n for text in given.only)]
    robots = read_results(given.out) if given.resume and given.out is not None and given.out.is_file() else []
    done = {robot.name for robot in robots}
    common = (maps, given.time_limit, given.distro, given.allow_missing)
    with ProcessPoolExecutor(given.processes) as pool:
        tasks = [pool.submit(examine, given.folder, n, *common) for n in names if n not in done]
        for task in as_completed(tasks):
            robots = sorted([*robots, task.result()], key=lambda robot: robot.name)
            print(f"{len(robots)} of {len(names)}: {task.result().name}", file=sys.stderr, flush=True)
            if given.out is not None:
                given.out.write_text(json.dumps([asdict(robot) for robot in robots], indent=1), encoding="utf-8")
    print_table(robots, maps)
    return 0


if __name__ == "__main__":
    sys.exit(main())
