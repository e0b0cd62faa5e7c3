"""What a robot of move_base stumbles on when it moves to Nav2, each with the place in its files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from navstack.parameters import Configuration, Conversion, Leaf, Location, load_configuration, to_nav2, value_text

DEFAULT_TREE_HZ: Final = 1.0
NAV2_BASE_FRAME: Final = "base_link"
_PLANNERS: Final = ("dwa", "trajectory_rollout")
"""Local planners that become DWB."""
_LIMITS: Final = ("max_vel_x", "max_vel_theta", "max_vel_trans", "acc_lim_x", "acc_lim_theta")


@dataclass(frozen=True, slots=True)
class MigrationPoint:
    """One thing to change."""

    title: str
    places: tuple[tuple[str, Location | None], ...]
    """What is written (`planner_frequency = 1.0`) and where; None for a default."""
    cause: str
    """What differs in Nav2."""
    fix: str

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON."""
        places = [{"text": text, "at": at._asdict() if at is not None else None} for text, at in self.places]
        return {"title": self.title, "places": places, "cause": self.cause, "fix": self.fix}


class MigrationReport(NamedTuple):
    """The points that apply to a robot, and the titles of those that do not."""

    distro: str
    points: list[MigrationPoint]
    others: list[str]

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON."""
        return {"distro": self.distro, "points": [p.as_dict() for p in self.points], "do_not_apply": self.others}


class _Robot(NamedTuple):
    """What the points look at."""

    c: Configuration
    made: Conversion
    leaves: dict[str, Leaf]
    """Every written parameter by full name."""

    def place(self, name: str, value: Any = None) -> tuple[str, Location | None]:
        """Return a parameter as text, and where it is written."""
        leaf = self.leaves.get(name)
        written = leaf.value if leaf is not None else value
        at = leaf.node.at if leaf is not None else self.c.origins.get(name)
        return f"{name} = {value_text(written)}", at


def explain_migration(
    sources: Sequence[str], distro: str = "jazzy", *, overrides: Sequence[str] = (), allow_missing: bool = False
) -> MigrationReport:
    """Return what the robot of these parameters must change for a distribution of Nav2.

    Raise InputError for an unknown distribution and for files of Nav2, ParameterError for parameters that cannot be used.
    """
    made = to_nav2(sources, distro, ".", overrides=overrides, allow_missing=allow_missing)
    configuration = load_configuration(sources, overrides=overrides, allow_missing=allow_missing)
    robot = _Robot(configuration, made, {leaf.path: leaf for leaf in configuration.tree.leaves()})
    points: list[MigrationPoint] = []
    others: list[str] = []
    for title, find in POINTS:
        point = find(robot, title)
        if point is None:
            others.append(title)
        else:
            points.append(point)
    return MigrationReport(distro, points, others)


def _rate(robot: _Robot, title: str) -> MigrationPoint | None:
    rate = robot.c.move_base.planner_frequency
    if rate == DEFAULT_TREE_HZ:
        return None
    cause = "the rate of replanning is in the behavior tree, not in the YAML; the default tree replans at 1 Hz"
    fix = f"set hz of RateController to {rate:g}" if rate else "use a tree without RateController"
    return MigrationPoint(title, (robot.place("planner_frequency", rate),), cause, fix)


def _integers(robot: _Robot, title: str) -> MigrationPoint | None:
    found: dict[str, Leaf] = {}
    for change in robot.made.changes:
        leaf = robot.leaves.get(change.source)
        whole = leaf is not None and isinstance(leaf.value, int) and not isinstance(leaf.value, bool)
        if leaf is not None and whole and isinstance(change.converted, float):
            found[change.source] = leaf
    if not found:
        return None
    cause = "an integer is written for a double: Nav2's node fails to configure"
    return MigrationPoint(title, tuple(robot.place(name) for name in found), cause, "write it with a point: 1 -> 1.0")


def _footprint(robot: _Robot, title: str) -> MigrationPoint | None:
    lists = [
        leaf
        for leaf in robot.leaves.values()
        if leaf.name == "footprint" and isinstance(leaf.value, list) and leaf.value
    ]
    if not lists:
        return None
    cause = "lists of lists are not possible in parameters of ROS 2"
    return MigrationPoint(
        title, tuple(robot.place(leaf.path) for leaf in lists), cause, 'write a text: footprint: "[[x, y], ..]"'
    )


def _sources(robot: _Robot, title: str) -> MigrationPoint | None:
    places: list[tuple[str, Location | None]] = []
    for name, leaf in robot.leaves.items():
        if leaf.name != "observation_sources" or not isinstance(leaf.value, str):
            continue
        for source in leaf.value.split():
            section = f"{name.rpartition('/')[0]}/{source}"
            if f"{section}/max_obstacle_height" not in robot.leaves:
                places.append((f"{section} has no max_obstacle_height", leaf.node.at))
        above = name.rpartition("/")[0]
        ranges = (f"{above}/{key}" for key in ("obstacle_range", "raytrace_range"))
        places += [robot.place(key) for key in ranges if key in robot.leaves]
    if not places:
        return None
    cause = (
        "heights and ranges stand in each source; a source without max_obstacle_height drops every point (default 0.0)"
    )
    fix = "write max_obstacle_height (2.0 in move_base), obstacle_max_range and raytrace_max_range into each source"
    return MigrationPoint(title, tuple(places), cause, fix)


def _braking(robot: _Robot, title: str) -> MigrationPoint | None:
    local = robot.c.local_planner
    if local.name not in _PLANNERS:
        return None
    names = [f"{local.namespace}/{n}" for n in _LIMITS if n in type(local.params).model_fields]
    missing = [n.rpartition("/")[2] for n in names if n not in robot.c.origins]
    acceleration = next(n for n in names if n.endswith("acc_lim_x"))
    cause = "every limit of DWB is 0 by default: without decel_lim_* the robot cannot brake"
    if missing:
        cause += f", and without {', '.join(missing)}, which you leave at the defaults of move_base, it does not move"
    value = getattr(local.params, "acc_lim_x")  # noqa: B009
    return MigrationPoint(
        title, (robot.place(acceleration, value),), cause, "write every limit, and decel_lim_* = -acc_lim_*"
    )


def _tolerances(robot: _Robot, title: str) -> MigrationPoint | None:
    local = robot.c.local_planner
    if local.name not in _PLANNERS:
        return None
    value = getattr(local.params, "xy_goal_tolerance")  # noqa: B009
    cause = "DWB reads it twice: for the goal checker and for RotateToGoal; each is 0.25 by default"
    fix = "write the same value into goal_checker and into FollowPath"
    return MigrationPoint(title, (robot.place(f"{local.namespace}/xy_goal_tolerance", value),), cause, fix)


def _progress(robot: _Robot, title: str) -> MigrationPoint | None:
    timeout = robot.c.move_base.oscillation_timeout
    if timeout > 0.0 or robot.c.move_base.sections:
        return None
    cause = "0 switches the check off; Nav2 always checks, and gives up after 10 s without 0.5 m of progress"
    fix = "write a large movement_time_allowance, or accept the check"
    return MigrationPoint(title, (robot.place("oscillation_timeout", timeout),), cause, fix)


def _costmaps(robot: _Robot, title: str) -> MigrationPoint | None:
    places = [
        robot.place(f"{n}/plugins") for n in ("local_costmap", "global_costmap") if f"{n}/plugins" in robot.leaves
    ]
    listed = tuple((text.partition(" = ")[0], at) for text, at in places)
    cause = (
        "a costmap is a node in a namespace of its name, its layers are names with a class in the block of each, and no file is "
        "loaded into both; a key at another level is ignored without a message"
    )
    fix = (
        'write local_costmap: local_costmap: ros__parameters:, plugins: [..] and <layer>: plugin: "nav2_costmap_2d::.."'
    )
    return MigrationPoint(title, listed or (("plugins are not listed", None),), cause, fix)


def _recoveries(robot: _Robot, title: str) -> MigrationPoint | None:
    if not robot.c.recoveries or not robot.c.move_base.recovery_behavior_enabled:
        return None
    names = ", ".join(r.name for r in robot.c.recoveries)
    leaf = robot.leaves.get("recovery_behaviors")
    cause = "recoveries are nodes of the behavior tree that call behavior_server; the list in the YAML is not read"
    fix = "write them into the tree: ClearCostmapExceptRegion, Spin with spin_dist 6.28 (1.57 by default), BackUp"
    return MigrationPoint(title, ((f"recoveries: {names}", leaf.at if leaf is not None else None),), cause, fix)


def _frames(robot: _Robot, title: str) -> MigrationPoint | None:
    frame = robot.c.local_costmap.params.robot_base_frame
    if frame == NAV2_BASE_FRAME:
        return None
    cause = (
        "each server has its own robot_base_frame: base_link by default, base_footprint in amcl and collision_monitor"
    )
    fix = f"write robot_base_frame: {frame} for costmaps, behavior_server, bt_navigator, smoother_server and docking_server"
    return MigrationPoint(title, (robot.place("local_costmap/robot_base_frame", frame),), cause, fix)


POINTS: Final[tuple[tuple[str, Callable[[_Robot, str], MigrationPoint | None]], ...]] = (
    ("replanning rate", _rate),
    ("recoveries", _recoveries),
    ("costmap layers and levels", _costmaps),
    ("sensor sources", _sources),
    ("integers for doubles", _integers),
    ("footprint", _footprint),
    ("limits and braking", _braking),
    ("goal tolerance in two places", _tolerances),
    ("progress check", _progress),
    ("base frame", _frames),
)


def listed(point: MigrationPoint, limit: int) -> Iterator[str]:
    """Yield the places of a point as lines, at most `limit`."""
    by_place: dict[str, str] = {}
    for text, at in point.places:  # both costmaps may have a value from one line
        by_place.setdefault(str(at) if at is not None else f"default of move_base: {text}", text)
    places = [where if where.endswith(text) else f"{where}: {text}" for where, text in by_place.items()]
    yield from places[:limit]
    if len(places) > limit:
        yield f"and {len(places) - limit} more"
