"""Load every parameter file of Nav2 in a folder and drive its robot through packaged maps: what loads, what drives, what touches.

    python tools/nav2_robots.py FOLDER [--maps NAME ..] [--only TEXT ..] [--time-limit S] [--substitute] [--out FILE]

FOLDER has a folder for each robot. Each file is loaded alone; its robot drives to the goals of each map with the tree that the
file names, or that of its distribution. Prints a table in Markdown: goals reached, contacts, simulated seconds, and below it a
sentence for each file that does not load and for each goal that is not reached. `--out` writes the same as JSON; files that it
has from an earlier run are not driven again.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import navstack as nav
from navstack.core import NavError
from navstack.explain import explain_goal
from navstack.parameters import load_configuration, read_yaml
from navstack.parameters.nav2.document import is_nav2
from navstack.record import Record


@dataclass
class Drive:
    """How the robot of one file drove through one map."""

    map: str
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
        return f"{self.reached} of {self.goals}, {self.contacts} contacts, {self.time_s:.0f} s"


@dataclass
class Robot:
    """What became of one file."""

    file: str
    controller: str = ""
    planner: str = ""
    error: str = ""
    drives: list[Drive] = field(default_factory=list[Drive])


def examine(path: Path, maps: tuple[str, ...], time_limit_s: float, substitute: bool) -> Robot:
    """Load a file and drive its robot."""
    found = Robot(f"{path.parent.name}/{path.name}")
    warnings.simplefilter("ignore")
    try:
        configuration = load_configuration([str(path)], allow_missing=substitute)
    except NavError as exc:
        found.error = exc.message
        return found
    found.controller = configuration.local_planner.name
    found.planner = configuration.global_planner.name
    for name in maps:
        drive = Drive(name)
        found.drives.append(drive)
        try:
            result = nav.simulate(name, robot=configuration, time_limit_s=time_limit_s)
        except NavError as exc:
            drive.causes.append(exc.message)
            continue
        drive.goals, drive.reached = len(result.goals), sum(g.succeeded for g in result.goals)
        drive.contacts, drive.time_s = result.collisions, result.simulated_s
        for number, goal in enumerate(result.goals, 1):
            if not goal.succeeded:
                drive.causes.append(f"goal {number}: {goal.message}")
                drive.causes += stuck(result.record, number)
        if drive.reached < drive.goals or drive.contacts:
            drive.causes += result.advice
    return found


def stuck(record: Record, number: int) -> list[str]:
    """Return why the robot did not move on the way to a goal, as far as `navstack explain goal` knows a cause."""
    entries = [entry.text for entry in explain_goal(record, number).timeline if entry.kind == "stuck"]
    return list(dict.fromkeys(text.partition("; ")[2] for text in entries if "; " in text))


def earlier(file: Path | None) -> list[Robot]:
    """Return the robots of an earlier run."""
    if file is None or not file.is_file():
        return []
    found: list[dict[str, Any]] = json.loads(file.read_text(encoding="utf-8"))
    for robot in found:
        robot["drives"] = [Drive(**drive) for drive in robot["drives"]]
    return [Robot(**robot) for robot in found]


def print_table(robots: list[Robot], maps: tuple[str, ...]) -> None:
    """Print the table, the sums and the causes."""
    print("| file | loads | controller | planner | " + " | ".join(maps) + " |")
    print("|---" * (4 + len(maps)) + "|")
    for robot in robots:
        cells = [drive.text for drive in robot.drives] or ["-"] * len(maps)
        loads = "no" if robot.error else "yes"
        print("| " + " | ".join([robot.file, loads, robot.controller, robot.planner, *cells]) + " |")
    loaded = [robot for robot in robots if not robot.error]
    drives = [drive for robot in loaded for drive in robot.drives]
    whole = sum(d.goals > 0 and d.reached == d.goals for d in drives)
    print(
        f"\n{len(loaded)} of {len(robots)} files load; {whole} of {len(drives)} "
        f"drives reach all goals ({sum(d.reached for d in drives)} of {sum(d.goals for d in drives)} goals); "
        f"{sum(d.contacts for d in drives)} contacts in {sum(d.contacts > 0 for d in drives)} drives"
    )
    for robot in robots:
        if robot.error:
            print(f"\n{robot.file}: {robot.error}")
        for drive in robot.drives:
            for cause in drive.causes:
                print(f"\n{robot.file}, {drive.map}: {cause}")


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--maps", nargs="+", default=["office", "warehouse"])
    parser.add_argument("--only", nargs="+", default=[""], help="files whose folder and name contain one of these")
    parser.add_argument("--time-limit", type=float, default=300.0, help="simulated seconds for each goal")
    parser.add_argument("--substitute", action="store_true", help="let others stand in for missing plugins")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    maps = tuple(given.maps)
    files = sorted(given.folder.glob("*/*.yaml"))
    files = [
        p
        for p in files
        if any(text in f"{p.parent.name}/{p.name}" for text in given.only) and is_nav2(read_yaml(p).root)
    ]
    robots = earlier(given.out)
    there = {robot.file for robot in robots}
    with ProcessPoolExecutor(given.processes) as pool:
        tasks = [
            pool.submit(examine, path, maps, given.time_limit, given.substitute)
            for path in files
            if f"{path.parent.name}/{path.name}" not in there
        ]
        for task in tasks:
            robots.append(task.result())
            print(f"{len(robots)} of {len(files)}: {robots[-1].file}", file=sys.stderr, flush=True)
            if given.out is not None:
                given.out.write_text(json.dumps([asdict(robot) for robot in robots], indent=1), encoding="utf-8")
    robots.sort(key=lambda robot: robot.file)
    print_table(robots, maps)
    return 0


if __name__ == "__main__":
    sys.exit(main())
