"""Reads a scenario file section by section, with a finding for every problem."""

from __future__ import annotations

from pathlib import Path

from navstack.parameters.yaml_reader import DictNode
from navstack.scenario.file.context import ReadContext
from navstack.scenario.file.goals import read_start_and_goals
from navstack.scenario.file.inputs import read_map, read_parameters, read_places
from navstack.scenario.file.interactions import read_interactions
from navstack.scenario.file.models import Settings
from navstack.scenario.file.shapes import read_shapes, read_success

SECTIONS = ("map", "places", "params", "set", "sim", "start", "goals", "tour", "shapes", "interactions", "success")
"""Keys of a scenario file besides those of `Settings`."""
_KEYS = (*Settings.model_fields, *SECTIONS)

_SYNONYMS = {
    "robot": "params",
    "parameters": "params",
    "overrides": "set",
    "obstacles": "shapes",
    "discs": "shapes",
    "noise": "sim",
    "sensors": "sim",
    "body": "sim",
    "localization": "sim",
    "timeout": "time_limit",
    "limit": "time_limit",
    "conditions": "success",
    "goal": "goals",
    "world": "map",
    "events": "interactions",
    "actions": "interactions",
    "teleop": "interactions",
}
"""Other names that users may try for a key -> the key."""


def read_file(path: Path, shown: str | None = None) -> ReadContext:
    """Reads a scenario file; `shown` is its name in messages. The result's `findings` list every problem."""
    context = ReadContext(path, shown)
    if not context.readable:
        return context
    root = context.root
    unknown = {key: value for key, value in root.items.items() if key not in Settings.RENAMED}
    context.check_keys(DictNode(unknown, root.at), _KEYS, "a scenario", _SYNONYMS)
    names = (*Settings.model_fields, *Settings.RENAMED)
    settings = {key: value for key, value in root.items.items() if key in names}
    context.parts.settings = context.bind(Settings, DictNode(settings, root.at), "") or context.parts.settings
    read_map(context)
    read_places(context)
    read_parameters(context)
    read_start_and_goals(context)
    read_shapes(context)
    read_interactions(context)
    read_success(context)
    return context
