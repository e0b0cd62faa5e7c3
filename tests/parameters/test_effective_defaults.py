"""Every default is what a user of noetic gets with an empty YAML: the models against the tables read from ROS's code."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest

from navstack.parameters.binding import bounds_of, iter_names
from navstack.parameters.models.move_base import CostmapParams, MoveBaseParams
from navstack.parameters.report import children_of
from navstack.plugins import GLOBAL_PLANNERS, LAYERS, LOCAL_PLANNERS, RECOVERY_BEHAVIORS, ParamModel

OBSTACLE: type[ParamModel] = LAYERS.get("costmap_2d/ObstacleLayer").cls.Params
TABLES: dict[str, list[type[ParamModel]]] = {
    "1": [MoveBaseParams],
    "2": [CostmapParams],
    "3": [LAYERS.get("costmap_2d/StaticLayer").cls.Params],
    "4": [OBSTACLE, *children_of(OBSTACLE).values()],
    "5": [LAYERS.get("costmap_2d/VoxelLayer").cls.Params],
    "6": [LAYERS.get("costmap_2d/InflationLayer").cls.Params],
    "7": [GLOBAL_PLANNERS.get("navfn/NavfnROS").cls.Params],
    "8": [GLOBAL_PLANNERS.get("global_planner/GlobalPlanner").cls.Params],
    "9": [GLOBAL_PLANNERS.get("carrot_planner/CarrotPlanner").cls.Params],
    "10": [LOCAL_PLANNERS.get("base_local_planner/TrajectoryPlannerROS").cls.Params],
    "11": [LOCAL_PLANNERS.get("dwa_local_planner/DWAPlannerROS").cls.Params],
    "12": [RECOVERY_BEHAVIORS.get("clear_costmap_recovery/ClearCostmapRecovery").cls.Params],
    "13": [RECOVERY_BEHAVIORS.get("rotate_recovery/RotateRecovery").cls.Params],
    "14": [RECOVERY_BEHAVIORS.get("move_slow_and_clear/MoveSlowAndClear").cls.Params],
}
"""Section of parameters.md -> the models of its tables, in order."""

EXCEPTIONS = {
    # name: why the model has another default or none
    ("1", "recovery_behaviors"): "unset here as there: the built-in list",
    ("1", "clearing_radius"): "parity 21: none stands for the footprint's own circumscribed radius",
    ("1", "local_costmap/circumscribed_radius"): "parity 21: computed from the footprint",
    ("1", "local_costmap/inscribed_radius"): "dead in ROS; computed from the footprint",
    ("1", "global_costmap/robot_base_frame"): "the costmap's own parameter, in table 2",
    ("1", "global_costmap/global_frame"): "the costmap's own parameter, in table 2",
    ("2", "plugins"): "unset here as there: the conversion from before Hydro",
    ("4", "topic"): "the source's name: empty stands for it",
    ("4", "track_unknown_space"): "the costmap's own",
    ("9", "step_size"): "dead in ROS",
    ("10", "meter_scoring"): "indeterminate in ROS (an uninitialized bool); false here",
    ("12", "layer_names"): "parity 18: none stands for every layer fed by sensors",
    ("13", "acc_lim_theta"): "parity 19: the local planner's own",
    ("13", "max_vel_theta"): "parity 19: the local planner's own",
    ("13", "min_in_place_vel_theta"): "parity 19: the local planner's own",
    ("13", "yaw_goal_tolerance"): "parity 19: the local planner's own",
    ("14", "max_trans_param_name"): "parity 20: limits are set, not parameters by name",
    ("14", "max_rot_param_name"): "parity 20: limits are set, not parameters by name",
    ("14", "planner_namespace"): "parity 20: the local planner in use",
    ("10", "controller_frequency"): "searched for; 20 without one, as the text says",
    ("11", "controller_frequency"): "searched for; 20 without one, as the text says",
    ("10", "min_pt_separation"): "dead in ROS, below point_grid",
    ("10", "max_obstacle_height"): "dead in ROS, below point_grid",
    ("10", "grid_resolution"): "dead in ROS, below point_grid",
}

OTHER_RANGES = {
    ("5", "combination_method"): "ROS clamps 99 (nothing) to 2, which is nothing as well; both are taken here",
} | {
    ("1", name): "move_base clamps only in a reconfiguration; until then it uses values over the slider as written"
    for name in (
        "planner_frequency",
        "controller_frequency",
        "planner_patience",
        "controller_patience",
        "max_planning_retries",
        "oscillation_timeout",
        "oscillation_distance",
        "conservative_reset_dist",
    )
}


def tables(text: str) -> list[tuple[str, list[dict[str, str]]]]:
    """Every table with the number of its section: rows as column -> cell."""
    found: list[tuple[str, list[dict[str, str]]]] = []
    section, columns = "", list[str]()
    for line in text.splitlines():
        heading = re.match(r"## (\d+)\.", line)
        if heading:
            section = heading[1]
        cells = [c.strip() for c in line.strip().strip("|").split("|")] if line.startswith("|") else []
        if not cells:
            columns = []
        elif not columns:
            columns = cells
            found.append((section, []))
        elif not set(line) <= set("|-: "):
            found[-1][1].append(dict(zip(columns, cells)))
    return found


def rows(text: str) -> list[tuple[str, type[ParamModel], str, str, str]]:
    """Section, model, parameter, effective default and type, as written in the tables."""
    made: list[tuple[str, type[ParamModel], str, str, str]] = []
    seen: dict[str, int] = {}
    for section, table in tables(text):
        if section not in TABLES:
            continue
        number = seen[section] = seen.get(section, -1) + 1
        model = TABLES[section][number]
        for row in table:
            names = re.sub(r"[*`]", "", row["name"]).split(" (old")[0]
            default = (row.get("eff") or row["default"]).replace("**", "")
            parts = [n.strip() for n in re.split(r" / |, ", names)]
            values = [v.strip() for v in re.split(r" / |, ", default)] if len(parts) > 1 else [default]
            for i, name in enumerate(parts):
                full = re.sub(r"[xy]$", name[-1], parts[0]) if name in ("_y", "origin_y") else name
                made.append((section, model, full, values[min(i, len(values) - 1)], row.get("type", "")))
    return made


def written(text: str) -> Any:
    """A table's default as a Python value."""
    plain = text.strip().strip("`")
    if re.match(r"code [\d.]+, cfg", plain):  # move_base's first reconfigure is stored only: the code's default lives
        plain = plain.split()[1].rstrip(",")
    if plain in ("true", "false"):
        return plain == "true"
    if plain.startswith('"'):
        return plain[1 : plain.index('"', 1)]
    pi = re.match(r"pi/(\d)", plain)
    if pi:
        return math.pi / int(pi[1])
    number = re.match(r"-?\d+(\.\d+)?", plain)
    return float(number[0]) if number else plain


def test_the_tables_are_parsed(reference_dir: Path) -> None:
    found = rows((reference_dir / "parameters.md").read_text(encoding="utf-8"))
    assert len(found) >= 180
    assert {section for section, *_ in found} == set(TABLES)
    assert {(s, n) for s, _, n, *_ in found} >= set(EXCEPTIONS)


@pytest.mark.parametrize("section", TABLES)
def test_effective_defaults(section: str, reference_dir: Path) -> None:
    wrong: list[str] = []
    for at, model, name, default, _ in rows((reference_dir / "parameters.md").read_text(encoding="utf-8")):
        if at != section:
            continue
        if (at, name) in EXCEPTIONS:
            continue
        if name not in model.model_fields:
            if name.split("/")[0] not in (*iter_names(model), *model.NO_EFFECT):
                wrong.append(f"{name}: not known to {model.__name__}")
            continue
        ours, theirs = model.model_fields[name].default, written(default)
        same = math.isclose(ours, theirs) if isinstance(theirs, float) and not isinstance(ours, str) else ours == theirs
        if not same:
            wrong.append(f"{name}: {ours!r} here, {theirs!r} in ROS ({default})")
    assert wrong == []


@pytest.mark.parametrize("section", TABLES)
def test_ranges(section: str, reference_dir: Path) -> None:
    """The ranges of the models are those of dynamic_reconfigure, or narrower (where 0 makes no sense)."""
    wrong: list[str] = []
    for at, model, name, _, kind in rows((reference_dir / "parameters.md").read_text(encoding="utf-8")):
        limits = re.search(r"\[(-?[\d.]+),([\d.]+|pi/2)\]", kind.replace("**", ""))
        if (
            at != section
            or limits is None
            or name not in model.model_fields
            or (at, name) in {**EXCEPTIONS, **OTHER_RANGES}
        ):
            continue
        high = math.pi / 2 if limits[2] == "pi/2" else float(limits[2])
        bounds = bounds_of(model.model_fields[name])
        if bounds.get("ge", bounds.get("gt")) != float(limits[1]) or bounds.get("le", bounds.get("lt")) != high:
            wrong.append(f"{name}: {bounds} here, [{limits[1]}, {limits[2]}] in ROS")
    assert wrong == []
