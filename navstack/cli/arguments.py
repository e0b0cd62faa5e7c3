"""Parsers of command-line arguments: poses, points, obstacles, maps, scenario files."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from navstack.cli.output import print_note
from navstack.core import Footprint, InputError, MapError, Pose2D, is_file, normalize_angle, open_regular
from navstack.map_io import load_map, map_names, map_path
from navstack.parameters import Override, nearest, parse_footprint
from navstack.scenario import is_scenario_file, load_places, read_scenario, shipped_scenarios
from navstack.sim import low_disc

if TYPE_CHECKING:
    from navstack.core import OccupancyGrid
    from navstack.sim import Shape

_MAP_KEY: Final = re.compile(
    rb"""^\W*(image|resolution|origin|negate|occupied_thresh|free_thresh)["']?[ \t]*:""", re.MULTILINE
)
_LENGTH: Final = re.compile(r"\s*(\d+\.?\d*|\.\d+)(e[-+]?\d+)?\s*", re.IGNORECASE)
_SEARCHED_BYTES: Final = 1_000_000
"""Length of the part of a YAML file that is searched for keys of a map."""


def parse_numbers(text: str, argument: str, shape: str, counts: tuple[int, ...]) -> list[float]:
    parts = [part.strip() for part in text.split(",")]
    values: list[float] = []
    for part in parts:
        try:
            value = float(part)
        except ValueError:
            raise InputError(
                f'{argument} "{text}": "{part}" is not a number; give {shape}', argument=argument, value=text
            ) from None
        if not math.isfinite(value):
            raise InputError(
                f'{argument} "{text}": {part} is not a finite number; give {shape}', argument=argument, value=text
            )
        values.append(value)
    if len(values) not in counts:
        raise InputError(
            f'{argument} "{text}" has {len(values)} number{"s" * (len(values) != 1)}; give {shape}',
            argument=argument,
            value=text,
        )
    return values


def parse_pose(text: str, argument: str) -> Pose2D:
    """`x,y` or `x,y,yaw` -> pose (m, rad; `90deg` is an angle in degrees); the default yaw is 0. Raises InputError."""
    head, comma, yaw = text.rpartition(",")
    if comma and yaw.strip().endswith("deg"):
        from navstack.behaviors import parse_angle

        text = f"{head},{parse_angle(yaw)!r}"
    values = parse_numbers(text, argument, "x,y or x,y,yaw in meters and radians, such as 29.75,7.95,1.57", (2, 3))
    if len(values) == 3 and abs(values[2]) > 2.0 * math.pi:
        print_note(f"{argument}: the yaw {values[2]:g} is taken as radians; for degrees, write {values[2]:g}deg")
    return Pose2D(values[0], values[1], normalize_angle(values[2]) if len(values) == 3 else 0.0)


def parse_place(text: str, argument: str, world: str | None, file: Path | None = None) -> Pose2D:
    """A pose as numbers, or the name of a place of a map or scenario (`world`, or the `file` with places) -> pose (m, rad).

    Raises InputError for a name without such a place, with the places that there are.
    """
    if "," in text or _is_number(text):
        return parse_pose(text, argument)
    places = places_of(world, file)
    if text in places:
        return places[text]
    close = nearest(text, places)
    hint = f"did you mean {close}? Places: {', '.join(places)}" if close else f"places: {', '.join(places)}"
    if not places:
        hint = "there is no file of places here; give x,y or x,y,yaw in meters and radians, such as 29.75,7.95,1.57"
    raise InputError(f'{argument} "{text}" is no place of {world or "a map"}; {hint}', argument=argument, value=text)


def places_of(world: str | None, file: Path | None = None) -> dict[str, Pose2D]:
    """The places of a packaged map, of a scenario, or in the file of places next to a map (`MAP.places.yaml`), by name."""
    if file is not None:
        return load_places(file).places
    if world is None:
        return {}
    if world in map_names():
        return load_places(world).places
    scenario = scenario_file(world)
    if scenario is not None:
        return dict(read_scenario(scenario).places)
    beside = Path(world).with_suffix(".places.yaml")
    return load_places(beside).places if is_file(beside) else {}


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def parse_point(text: str, argument: str) -> tuple[float, float]:
    """`x,y` -> point (m). Raises InputError."""
    x, y = parse_numbers(text, argument, "x,y in meters, such as 29.75,7.95", (2,))
    return x, y


def parse_obstacle(text: str) -> tuple[tuple[float, float, float], bool]:
    """`x,y,r` or `x,y,r,low` -> disc (x, y, radius in m), and True for a low one. Raises InputError."""
    head, comma, word = text.rpartition(",")
    low = bool(comma) and word.strip() == "low"
    shape = "x,y,r in meters, such as 3.0,1.5,0.2; append ,low for an obstacle that only bumpers and low lidars detect"
    x, y, r = parse_numbers(head if low else text, "--obstacle", shape, (3,))
    if r <= 0.0:
        raise InputError(f'--obstacle "{text}": the radius must be positive', argument="--obstacle", value=text)
    return (x, y, r), low


def parse_obstacles(
    texts: Sequence[str],
) -> tuple[tuple[tuple[float, float, float], ...], tuple[Shape, ...]]:
    """The values of all `--obstacle` -> discs (m) that every lidar detects, and low obstacles as shapes."""
    parsed = [parse_obstacle(text) for text in texts]
    low_ones = [disc for disc, low in parsed if low]
    if not low_ones:
        return tuple(disc for disc, _ in parsed), ()

    return tuple(disc for disc, low in parsed if not low), tuple(low_disc(*disc) for disc in low_ones)


def map_of(name: str, others: Mapping[str, Iterable[str]] | None = None) -> tuple[Path, OccupancyGrid]:
    """Loads a map file, or the packaged map of that name. Raises MapError.

    `others` are further names that the argument accepts, by kind ("scenario", ..); the error lists them.
    """
    path = Path(name)
    # is_file: a folder called "office" must not hide the packaged map
    if not is_file(path) and path.suffix == "" and path.parent == Path():
        if name not in map_names():
            raise _unknown_map(name, {"map": map_names(), **(others or {})})
        path = map_path(name)
    return path, load_map(path)


def _unknown_map(name: str, known: Mapping[str, Iterable[str]]) -> MapError:
    import difflib

    close = difflib.get_close_matches(name, [one for names in known.values() for one in names], n=1)
    *kinds, last = ("file", *(f"packaged {kind}" for kind in known))
    return MapError(
        f'no {", ".join(kinds)} or {last} is called "{name}"; '
        + (f'did you mean "{close[0]}"? ' if close else "")
        + "; ".join(f"packaged {kind}s: {', '.join(sorted(names))}" for kind, names in known.items()),
        map=name,
        known=map_names(),
    )


def extent_text(grid: OccupancyGrid) -> str:
    """The extent of a map, for messages."""
    left, right, bottom, top = grid.geometry.extent
    return f"x {left:g} .. {right:g}, y {bottom:g} .. {top:g} m"


def note_off_the_map(grid: OccupancyGrid, start: Pose2D, goals: Sequence[Pose2D]) -> None:
    """Prints a note for each pose outside the map, with a hint if x and y seem to be swapped.

    A start outside the map is an error later. A goal outside the map is sent nevertheless, as in move_base.
    """
    if grid.origin_yaw != 0.0:
        return
    for what, pose in [("start", start), *(("goal", goal) for goal in goals)]:
        if grid.geometry.world_to_cell(pose.x, pose.y) is None:
            swapped = grid.geometry.world_to_cell(pose.y, pose.x) is not None
            hint = f"; are x and y swapped? {pose.y:g},{pose.x:g} is inside" if swapped else ""
            if swapped or what == "goal":
                print_note(
                    f"the {what} {pose.x:g},{pose.y:g} is outside the map, which covers {extent_text(grid)}{hint}"
                )


def scenario_file(name: str) -> Path | None:
    """Path of a scenario file, or of the packaged scenario of that name; None if the name is neither.

    A YAML file without a key of a map counts as a scenario file even if it is broken: the scenario reader then reports
    the errors.
    """
    path = Path(name)
    if is_scenario_file(path) or (path.suffix in (".yaml", ".yml") and is_file(path) and not _has_map_key(path)):
        return path
    # is_file: as for maps, a folder of that name hides nothing
    return None if is_file(path) or name in map_names() else shipped_scenarios().get(name)


def _has_map_key(path: Path) -> bool:
    """True for a file with a key of map_server's YAML at the beginning of a line; the file need not be valid YAML."""
    try:
        with open_regular(path) as stream:
            return _MAP_KEY.search(stream.read(_SEARCHED_BYTES)) is not None
    except OSError:
        return True  # the map reader reports why the file is unreadable


def parse_costmap_name(text: str) -> str:
    """`global`, `local`, `global_costmap` or `local_costmap` -> `global` or `local`. Raises InputError."""
    name = text.removesuffix("_costmap")
    if name not in ("global", "local"):
        raise InputError(f'--costmap "{text}" is unknown; give global or local', argument="--costmap", value=text)
    return name


def footprint_overrides(text: str | None) -> list[Override]:
    """Overrides that set the footprint of both costmaps. Raises InputError."""
    import numpy as np

    if text is None:
        return []
    try:
        points = _box(text) or parse_footprint(text)
        Footprint(np.array(points))
    except (ValueError, InputError) as exc:
        why = "it is neither a box such as 1.2x0.7 (length x width, m) nor a list of points [[x,y],[x,y],..]"
        if text.lstrip().startswith("[["):
            why = str(exc)
        raise InputError(f'--footprint "{text}" cannot be used: {why}', argument="--footprint") from None
    return [Override(f"{name}.footprint={points}", "--footprint") for name in ("global_costmap", "local_costmap")]


def _box(text: str) -> list[list[float]]:
    """The corners of `LENGTHxWIDTH` (m), none for other texts."""
    sides = [float(part) if _LENGTH.fullmatch(part) else 0.0 for part in text.split("x")]
    if len(sides) != 2 or min(sides) <= 0.0:
        return []
    x, y = 0.5 * sides[0], 0.5 * sides[1]
    return [[x, y], [-x, y], [-x, -y], [x, -y]]
