"""The parameters of a session as a page shows them; saving changed values into copies of the user's files."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

from navstack.core import InputError, data_folder, resolved
from navstack.costmap import FIXED
from navstack.live.session import Session
from navstack.parameters import Configuration, Parameter, RewrittenFiles, overwrite, parameters_of, rewrite_parameters
from navstack.plugins import GLOBAL_PLANNERS, LOCAL_PLANNERS

_LIVE_NAVSTACK = (
    "navstack/goal_time_limit",
    "navstack/stall_timeout",
    "navstack/lost_action",
    "navstack/lost_timeout",
)
_FIXED_MOVE_BASE = ("recovery_behaviors", "recovery_behavior_enabled", "clearing_rotation_allowed")
_CHOICES = {"base_global_planner": GLOBAL_PLANNERS, "base_local_planner": LOCAL_PLANNERS}


def parameter_list(session: Session) -> list[dict[str, Any]]:
    """Returns every parameter: name, part, value, default, meaning, unit, range, whether it can change now and has changed."""
    initial = {p.name: p.value for p in parameters_of(session.scenario.configuration)}
    configuration = session.run.interventions.configuration
    live = _live_names(configuration)
    return [_entry(p, initial, p.name in live) for p in parameters_of(configuration)]


def changed_values(session: Session) -> dict[str, Any]:
    """Returns the parameters that differ from the start of the session."""
    initial = {p.name: p.value for p in parameters_of(session.scenario.configuration)}
    now = parameters_of(session.run.interventions.configuration)
    return {p.name: p.value for p in now if p.name not in initial or p.value != initial[p.name]}


def check_names(session: Session, values: Mapping[str, Any]) -> None:
    """Raises InputError for a parameter that is not in use or cannot change at run time: it would have no effect."""
    configuration = session.run.interventions.configuration
    known = {p.name for p in parameters_of(configuration)}
    live = _live_names(configuration)
    for name in values:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            hint = f'did you mean "{close[0]}"?' if close else "the page lists the parameters in use"
            raise InputError(f'"{name}" is not a parameter in use; {hint}', name=name)
        if name not in live:
            raise InputError(f"{name} cannot be changed at run time; start again with --set {name}=VALUE", name=name)


def rewritten(session: Session) -> RewrittenFiles:
    """Returns copies of the user's files with the changed values. Raises InputError without files or changes."""
    values = changed_values(session)
    if not values:
        raise InputError("no parameter has been changed since the start; there is nothing to save")
    sources = session.origin.sources
    if not sources:
        raise InputError("this session has no parameter files: its parameters came from a record")
    overrides = [str(text) for text in session.scenario.names.get("overrides", ())]
    return rewrite_parameters(list(sources), values, overrides=overrides)


def difference(session: Session) -> str:
    """Returns the changes to the user's files as a unified diff."""
    made = rewritten(session)
    lines: list[str] = []
    for name, text in made.files.items():
        original = made.originals.get(name)
        before = "" if original is None else original.read_bytes().decode("utf-8")
        shown = name if original is None else str(original)
        lines += difflib.unified_diff(
            before.splitlines(keepends=True), text.splitlines(keepends=True), f"before: {shown}", f"after: {shown}"
        )
    return "".join(lines) or "Your files have these values already."


def save_in_place(session: Session, folder: Path) -> list[Path]:
    """Writes the changed values into the user's own files, with their layout and comments; returns the files that changed.

    Raises InputError for a file outside of `folder`: nothing has been written then.
    """
    files = rewritten(session).changed_originals()
    outside = [path for path in files if not resolved(path).is_relative_to(resolved(folder))]
    packaged = [path for path in outside if resolved(path).is_relative_to(resolved(data_folder("params")))]
    if packaged:
        raise InputError(f"{packaged[0].parent.name} is a packaged set, which is not written into; save a copy")
    if outside:
        raise InputError(
            f"{outside[0]} is not in the folder {folder}; start with --save-to {outside[0].parent} to write into it, "
            "or save a copy"
        )
    overwrite(files)
    return list(files)


def _entry(parameter: Parameter, initial: Mapping[str, Any], live: bool) -> dict[str, Any]:
    info = parameter.info
    part, _, name = parameter.name.rpartition("/")
    bounds: dict[str, float] = {}
    for constraint in info.metadata:
        for key in ("ge", "gt", "le", "lt"):
            if hasattr(constraint, key):
                bounds[key] = float(getattr(constraint, key))
    default = info.get_default(call_default_factory=False)
    return {
        "name": parameter.name,
        "part": part or "move_base",
        "key": name,
        "value": _plain(parameter.value),
        "initial": _plain(initial.get(parameter.name)),
        "default": _plain(default),
        "origin": parameter.origin_text,
        "meaning": info.description or "",
        "unit": parameter.unit,
        "bounds": bounds,
        "type": _type_of(parameter),
        "choices": _choices(parameter),
        "live": live,
        "changed": parameter.name not in initial or initial[parameter.name] != parameter.value,
    }


def _plain(value: Any) -> Any:
    if isinstance(value, float) and (value != value or value in (float("inf"), -float("inf"))):
        return str(value)
    return value if isinstance(value, (bool, int, float, str, type(None))) else str(value)


def _type_of(parameter: Parameter) -> str:
    value = parameter.value
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, int):
        return "float" if "float" in str(parameter.info.annotation) else "int"
    if isinstance(value, float):
        return "float"
    return "text" if isinstance(value, str) else "other"


def _choices(parameter: Parameter) -> list[str]:
    registry = _CHOICES.get(parameter.name)
    if registry is not None:
        names = [entry.name for entry in registry]
        return names if parameter.value in names else [str(parameter.value), *names]
    return [str(choice) for choice in get_args(parameter.info.annotation) if isinstance(choice, str)]


def _live_names(c: Configuration) -> frozenset[str]:
    """Names of the parameters that `bringup.reconfigure` can change."""
    fixed: set[str] = set()
    live: set[str] = set()
    recoveries = tuple(f"{recovery.namespace}/" for recovery in c.recoveries)
    for prefix, costmap in (("global_costmap", c.global_costmap), ("local_costmap", c.local_costmap)):
        fixed |= {f"{prefix}/{name}" for name in FIXED}
        for layer in costmap.layers:
            allowed = layer.cls.LIVE
            for name in type(layer.params).model_fields:
                (live if name in allowed else fixed).add(f"{layer.namespace}/{name}")
    names = frozenset(p.name for p in parameters_of(c))
    layers = tuple(f"{layer.namespace}/" for m in (c.global_costmap, c.local_costmap) for layer in m.layers)
    return frozenset(
        name
        for name in names
        if name in live
        or (
            name not in fixed
            and not name.startswith((*recoveries, *layers))
            and name not in _FIXED_MOVE_BASE
            and (not name.startswith("navstack/") or name in _LIVE_NAVSTACK)
        )
    )
