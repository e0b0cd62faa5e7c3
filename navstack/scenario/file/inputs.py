"""Reads the inputs that a scenario file names: the map, the places and the parameters."""

from __future__ import annotations

from pathlib import Path

from navstack.core import Pose2D
from navstack.core.errors import InputError
from navstack.core.files import exists, is_file
from navstack.map_io import map_names, map_path
from navstack.parameters import packaged_sets
from navstack.parameters.findings import Location
from navstack.parameters.launch import launch_argument
from navstack.parameters.spelling import nearest
from navstack.parameters.yaml_reader import DictNode, ListNode
from navstack.places import load_places
from navstack.scenario.file.context import ReadContext


def read_map(context: ReadContext) -> None:
    """Reads `map:`: a file relative to the scenario file, or the name of a packaged map."""
    known = ", ".join(map_names())
    node = context.section("map")
    if node is None:
        message = f"map is missing; add `map: FILE.yaml`, relative to this file, or a packaged map ({known})"
        context.error("missing", context.root.at, "map", message)
        return
    text = context.text(node, "map", f"the file of a map, relative to this file, or a packaged map ({known})")
    if text is None:
        return
    file = context.resolve(text)
    if is_file(file):
        context.parts.map_file = file
    elif text in map_names():
        context.parts.map_file = map_path(text)
    else:
        close = nearest(text, map_names())
        hint = f'did you mean "{close}"?' if close else f"packaged maps: {known}"
        message = f'map "{text}" is neither a file, relative to this file, nor a packaged map; {hint}'
        context.error("no-source", node.at, "map", message, close)


def read_places(context: ReadContext) -> None:
    """Reads `places:`: a mapping, a file, or by default MAP.places.yaml beside the map."""
    node = context.section("places")
    if isinstance(node, DictNode):
        found: dict[str, Pose2D] = {}
        for name, (_, inner) in node.items.items():
            pose = context.pose(inner, f'"{name}"')
            if pose is not None:
                found[name] = pose
        context.parts.places = found
        return
    if node is not None:
        text = context.text(node, "places", "`name: [x, y, yaw]` lines, or the name of a file with such lines")
        if text is not None:
            _load_places(context, context.resolve(text), node.at)
        return
    map_file = context.parts.map_file
    if map_file is not None:
        default = map_file.with_name(f"{map_file.stem}.places.yaml")
        if is_file(default):
            _load_places(context, default, context.root.at)


def _load_places(context: ReadContext, file: Path, at: Location) -> None:
    if not is_file(file):
        message = f"file {file} does not exist; name a file with places, or list the places here"
        context.error("no-source", at, "places", message)
        return
    try:
        context.places_file = load_places(file)
    except InputError as exc:
        context.add_input_error(exc, at, "places")
        return
    context.parts.places = context.places_file.places


def read_parameters(context: ReadContext) -> None:
    """Reads `params:`, `set:` and `sim:`."""
    parts = context.parts
    node = context.section("params")
    expected = f"a packaged set ({', '.join(packaged_sets())}), a folder or files, relative to this file"
    if node is None:
        parts.sources.append("turtlebot")
    else:
        items = node.items if isinstance(node, ListNode) else [node]
        if not items:
            context.error("missing", node.at, "params", f"params is an empty list; write {expected}")
        for item in items:
            # inline parameters are a source like a file
            if isinstance(item, DictNode):
                parts.sources.append(item)
                continue
            text = context.text(item, "params", expected)
            if text is not None:
                _add_source(context, text, item.at)
    changes = context.mapping("set", "`NAME: VALUE` lines, for example `DWAPlannerROS/max_vel_x: 0.4`")
    if changes is not None:
        parts.overlays.append(changes)
    sim = context.mapping(
        "sim", "parameters of the simulated robot, indented below it, for example `odometry_noise: 0.02`"
    )
    if sim is not None:
        at = context.root.items["sim"][0]
        parts.overlays.append(DictNode({"navstack": (at, DictNode({"sim": (at, sim)}, sim.at))}, sim.at))


def _add_source(context: ReadContext, text: str, at: Location) -> None:
    name, marker, namespace = text.rpartition("@")
    file = context.resolve(name if marker else text)
    sources = context.parts.sources
    if text in packaged_sets() or launch_argument(text) is not None:
        sources.append(text)
    elif exists(context.resolve(text)):
        sources.append(str(context.resolve(text)))
    elif marker and exists(file):
        sources.append(f"{file}@{namespace}")
    else:
        close = nearest(text, packaged_sets())
        hint = f'did you mean "{close}"?' if close else f"packaged sets: {', '.join(packaged_sets())}"
        message = f'params "{text}" is neither a file or folder, relative to this file, nor a packaged set; {hint}'
        context.error("no-source", at, "params", message, close)
