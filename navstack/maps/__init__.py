"""The packaged maps: an office, a maze and a warehouse, each with places to start from and to go to.

They are drawn by `tools/draw_maps.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from navstack.core.errors import MapError
from navstack.core.geometry import Pose2D

_ENDING = ".places.yaml"


@dataclass(frozen=True, slots=True)
class Places:
    """Free poses in the frame of a packaged map (m, rad)."""

    start: Pose2D
    """Where `navstack simulate` starts when nothing else is said."""
    goals: tuple[Pose2D, ...]
    """The tour it drives then."""
    places: dict[str, Pose2D]
    """All of them by name, start and goals included."""


def map_names() -> list[str]:
    """Names of the packaged maps, sorted."""
    found = (entry.name for entry in files(__name__).iterdir())
    return sorted(name.removesuffix(_ENDING) for name in found if name.endswith(_ENDING))


def map_path(name: str) -> Path:
    """The YAML file of a packaged map; raises MapError with the names there are."""
    return _file(name, ".yaml")


def places(name: str) -> Places:
    """Start, tour and named places of a packaged map; raises MapError with the names there are."""
    import yaml

    read: Any = yaml.safe_load(_file(name, _ENDING).read_text(encoding="utf-8"))
    return Places(
        start=_pose(read["start"]),
        goals=tuple(_pose(goal) for goal in read["goals"]),
        places={place: _pose(pose) for place, pose in read["places"].items()},
    )


def _pose(numbers: list[float]) -> Pose2D:
    x, y, yaw = map(float, numbers)
    return Pose2D(x, y, yaw)


def _file(name: str, ending: str) -> Path:
    known = map_names()
    if name not in known:
        raise MapError(f'there is no packaged map "{name}"; there are: {", ".join(known)}', map=name, known=known)
    return Path(str(files(__name__) / f"{name}{ending}"))
