"""Which files are fleets, and which are packaged: what commands ask before they read one."""

from __future__ import annotations

from pathlib import Path

from navstack.core import is_file
from navstack.parameters import read_yaml


def is_fleet_file(path: Path) -> bool:
    """Return True for a YAML file with the key `robots`. Reads the top level only."""
    return path.suffix in (".yaml", ".yml") and is_file(path) and "robots" in read_yaml(path).root.items


def shipped_fleets() -> dict[str, Path]:
    """Return the fleet files shipped with navstack, by name."""
    folder = Path(__file__).parent / "files"
    return {file.stem: file for file in sorted(folder.glob("*.yaml"))}
