"""Which files are scenarios, and which are packaged: what commands ask before they read one."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from navstack.core import is_file
from navstack.parameters import read_yaml

SUFFIXES: Final = (".yaml", ".yml")


def is_scenario_file(path: Path) -> bool:
    """True for a YAML file with the keys of a scenario, as opposed to a map or parameters. Reads the top level only."""
    if path.suffix not in SUFFIXES or not is_file(path):
        return False
    keys = read_yaml(path).root.items.keys()
    if {"image", "resolution"} & keys:
        return False
    return "map" in keys or len({"start", "goals", "tour", "shapes", "success", "time_limit", "params"} & keys) >= 2


def shipped_scenarios() -> dict[str, Path]:
    """Returns the scenario files shipped with navstack, by name."""
    folder = Path(__file__).parent / "files"
    return {file.stem: file for file in sorted(folder.glob("*.yaml"))}
