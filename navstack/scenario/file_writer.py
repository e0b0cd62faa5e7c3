"""Writes a scenario as a file that loads to the same scenario: with the same map, parameters, obstacles and interactions."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from navstack.core import NavError, OccupancyGrid, OutputError, ensure_directory, write_text
from navstack.map_io import load_map, map_names, map_path, save_map
from navstack.parameters import Configuration, load_configuration, packaged_sets, same_parameters
from navstack.scenario.file_reader import load_scenario
from navstack.scenario.interactions import as_data
from navstack.scenario.scenario import Scenario
from navstack.scenario.steps import step_data
from navstack.scenario.success import SuccessConditions


def write_scenario(
    scenario: Scenario, path: Path, *, map_file: Path | None = None, sources: Sequence[str] = ()
) -> Scenario:
    """Writes the file and returns the scenario that it loads to, which gives the same run.

    `map_file` is the file of the map; without one, or if it has other cells, the map is written next to the scenario.
    `sources` are the parameters' `--params`: packaged sets keep their names if they and `set:` give the same parameters;
    otherwise all parameters are written. Raises OutputError.
    """
    ensure_directory(path.parent)
    document = {
        **({"name": scenario.name} if scenario.name else {}),
        "map": _map_name(scenario.map, map_file, path),
        **_parameters(scenario.configuration, sources, scenario.names.get("overrides", ())),
        "distro": scenario.configuration.navstack.ros_distro,
        "start": list(scenario.start),
        "goals": [step_data(s) for s in scenario.steps] or [list(goal) for goal in scenario.goals],
        "seed": scenario.seed,
        "time_limit": scenario.time_limit_s,
        "pause": scenario.pause_s,
        "stop_on_failure": scenario.stop_on_failure,
        "shapes": [*_obstacles(scenario), *(shape.model_dump(exclude_none=True) for shape in scenario.shapes)],
        "interactions": [as_data(item) for item in scenario.interactions],
        "success": _success(scenario.success),
    }
    kept = {key: value for key, value in document.items() if value not in ([], {}) or key == "goals"}
    if not kept["goals"]:
        kept.setdefault("interactions", [])
    write_text(path, scenario_text(kept))
    try:
        return load_scenario(path)
    except NavError as exc:
        raise OutputError(f"{path} was written, but cannot be read again: {exc.message}", path=str(path)) from exc


def scenario_text(document: Mapping[str, Any]) -> str:
    """Returns the YAML of a scenario: a line per section, goal, shape and interaction."""
    lines: list[str] = []
    for key, value in document.items():
        if isinstance(value, list) and value and isinstance(value[0], (dict, list)):
            lines.append(f"{key}:")
            lines += [f"  - {_flow(item)}" for item in value]
        elif isinstance(value, dict) and value:
            lines.append(f"{key}:")
            lines += [f"  {_flow(name)}: {_flow(inner)}" for name, inner in value.items()]
        else:
            lines.append(f"{key}: {_flow(value)}")
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    """Returns a value as YAML on one line."""
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=math.inf)
    return text.removesuffix("\n").removesuffix("\n...")


def _map_name(grid: OccupancyGrid, map_file: Path | None, path: Path) -> str:
    for name in map_names():
        if map_file is not None and map_file == map_path(name):
            return name
    if map_file is not None and _is_map(map_file, grid):
        return os.path.relpath(map_file.resolve(), path.parent.resolve())
    written, _ = save_map(grid, path.with_name(f"{path.stem}_map.yaml"))
    return written.name


def _is_map(file: Path, grid: OccupancyGrid) -> bool:
    try:
        found = load_map(file)
    except NavError:
        return False
    same = found.geometry == grid.geometry and found.origin_yaw == grid.origin_yaw and found.frame == grid.frame
    return same and np.array_equal(found.data, grid.data)


def _parameters(configuration: Configuration, sources: Sequence[str], overrides: Sequence[str]) -> dict[str, Any]:
    """Returns `params:` and `set:` that load to the configuration."""
    distro = configuration.navstack.ros_distro
    values = {name.strip(): yaml.safe_load(value) for name, _, value in (text.partition("=") for text in overrides)}
    if sources and all(source in packaged_sets() for source in sources):
        try:
            same = same_parameters(load_configuration([*sources, values], distro=distro), configuration)
        except NavError:
            same = False
        if same:
            return {"params": list(sources), "set": values}
    return {"params": [configuration.tree.as_dict()]}


def _obstacles(scenario: Scenario) -> list[dict[str, Any]]:
    return [
        {"name": f"obstacle {number}", "radius": radius, "pose": [x, y, 0.0]}
        for number, (x, y, radius) in enumerate(scenario.obstacles, 1)
    ]


def _success(success: SuccessConditions) -> dict[str, Any]:
    if success == SuccessConditions():
        return {}
    names = {"max_time_s": "max_time", "min_clearance_m": "min_clearance", "max_length_m": "max_length"}
    return {names.get(key, key): value for key, value in success.as_dict().items()}
