"""Merge what the user names (packaged sets, folders, files, overrides) into one tree, as roslaunch does.

In a folder, the name of a file decides its role, the role its namespace and its order.
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from navstack.core import data_folder, exists, is_file, resolved
from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.foreign import FOREIGN_PLANNERS
from navstack.parameters.launch import LaunchReader, launch_argument
from navstack.parameters.nav2.document import is_nav2, navigates
from navstack.parameters.nodes import NODE_SECTIONS, SAFETY_SECTIONS
from navstack.parameters.tree import COSTMAPS, Leaf, Sources, Space, descend, overlay, parts_of, put
from navstack.parameters.yaml_reader import (
    MAX_BYTES,
    DictNode,
    ListNode,
    Node,
    ScalarNode,
    first_alias,
    parse_value,
    read_yaml,
    relocate,
)

# ----------------------------------------------------------------------------------------------------------------------
# Read the parameter files of a folder: the name of a file decides its role, the role its namespace and its order.


NODE_NAMES = ("move_base", "move_base_node")
"""Usual names of the move_base node: a dump of the parameter server has its parameters below one of them."""

# The roles of a folder's files, in the order in which the turtlebot's move_base.launch loads them. A file without a role (of a
# sensor, a map, amcl) is loaded only if it is named.
_COMMON, _LOCAL, _GLOBAL = "costmap_common", "local_costmap", "global_costmap"
_ROLES: dict[str, tuple[str, ...]] = {
    _COMMON: ("costmap_common", "common_costmap"),
    _LOCAL: ("local_costmap", "costmap_local"),
    _GLOBAL: ("global_costmap", "costmap_global"),
    "local_planner": (
        "base_local_planner",
        "dwa_local_planner",
        "trajectory_planner",
        "local_planner",
        "dwa_planner",
        "teb_local_planner",
        "eband_local_planner",
        "dwb_local_planner",
    ),
    "move_base": ("move_base", "move_base_common", "planner", "planners"),
    "recovery": ("recovery_behaviors", "recovery", "recoveries", "recovery_behaviours"),
    "global_planner": ("global_planner", "base_global_planner", "navfn_global_planner", "navfn", "carrot_planner"),
    "navstack": ("navstack",),
    "safety": ("safety", "collision_monitor", "velocity_smoother"),
}
_AFFIX = re.compile(r"(?:^|_)(?:params?|config|parameters?|ros)(?=_|$)")
_CHOOSE = "name the files one by one instead of the folder, with only one of these"

_NEEDED = ("base_local_planner", "base_global_planner", "footprint", "robot_radius", "recovery_behaviors")
"""Parameters that a folder must not lose."""
_OF_MOVE_BASE = (*COSTMAPS, "base_local_planner", "base_global_planner")
"""Names of which a tree of move_base's parameters has at least one."""
_MOVE_BASE = re.compile(rb"""<node\b[^>]*\btype\s*=\s*["']move_base["']""")

_MAX_LAUNCHES = 3
"""Launch files that a message lists."""

_Files = list[tuple[Path, str]]
"""Files and their names in messages."""


def role_of(name: str) -> str | None:
    """Return the role of a file by its name (`costmap_common`, `local_planner`, ..), None if it has none."""
    stem = name.lower().partition(".")[0]
    bare = _AFFIX.sub("", stem).strip("_")
    for role, stems in _ROLES.items():
        if bare in stems:
            return role
    # variants of one role: costmap_common_params_burger, costmap_global_static
    for role in (_COMMON, _LOCAL, _GLOBAL):
        if any(s in bare for s in _ROLES[role]):
            return role
    # the name of a robot before or after: p3dx_dwa_local_planner, base_local_planner_holonomic
    for role in ("local_planner", "global_planner", "move_base"):
        if any(bare.startswith(f"{s}_") or bare.endswith(f"_{s}") for s in _ROLES[role] if "_" in s):
            return role
    return None


# --- content -> tree --------------------------------------------------------------------------------------------------


def load_file(out: Sources, path: Path, shown: str, namespace: str) -> None:
    """Load a YAML file that the user named, into `namespace` or that of its role."""
    read = read_yaml(path, shown)
    out.files.append(shown)
    out.findings += read.findings
    if not read.root.items and not read.findings:
        message = "the file has no parameters, so the defaults of ROS are in use; was it saved?"
        out.add_finding("warning", "empty-file", Location(shown), message)
    elif not _is_other_file(out, read.root, shown):
        _load_as(out, read.root, role_of(path.name), shown, namespace)


class _OtherFile(NamedTuple):
    """A YAML file of robots that is no parameter file."""

    keys: frozenset[str]
    """The keys at its root that tell it."""
    what: str
    instead: str
    """What to do with it; {0} is its name."""


_OTHER_FILES: Final = (
    _OtherFile(
        frozenset({"image", "resolution", "origin"}),
        "describes a map or a mask",
        "pass a map as the world (`navstack simulate {0} --params ROBOT`), a mask to its filter "
        "(`--set global_costmap/FILTER/mask={0}`)",
    ),
    _OtherFile(frozenset({"map", "goals"}), "is a scenario", "pass it as the world (`navstack simulate {0}`)"),
    _OtherFile(
        frozenset({"places"}),
        "names places of a map",
        "drive to them with `navstack tour {0}`, and name the robot's file",
    ),
    _OtherFile(
        frozenset({"waypoints"}),
        "lists waypoints",
        "pass their poses as goals (`--goal X,Y,YAW`, repeated), and name the robot's file",
    ),
    _OtherFile(frozenset({"docks"}), "lists docks", "name the file with the parameters of the robot that docks there"),
    _OtherFile(frozenset({"Visualization Manager"}), "configures rviz", "name the robot's file"),
    _OtherFile(frozenset({"launch"}), "is a launch file in YAML", "name the parameter files that it loads"),
)


def _is_other_file(out: Sources, root: DictNode, shown: str) -> bool:
    """Report a file of a robot that has no parameters."""
    found = next((other for other in _OTHER_FILES if other.keys <= root.items.keys()), None)
    if found is None or any(name in root.items for name in (*_OF_MOVE_BASE, *NODE_NAMES)):
        return False
    at, _ = root.items[min(found.keys, key=lambda key: root.items[key][0].line)]
    message = f"the file {found.what} and has no parameters of a robot; {found.instead.format(Path(shown).name)}"
    out.findings.append(finding("error", "no-robot", at, "", message))
    return True


def load_root(out: Sources, root: DictNode) -> None:
    """Load a mapping into move_base's own namespace; of a dump of the parameter server, only move_base's part."""
    for name in NODE_NAMES:
        if name not in root.items:
            continue
        at, node = root.items[name]
        if isinstance(node, DictNode):
            message = (
                f"the parameters under {name} are loaded as those of move_base; parameters of other nodes are ignored"
            )
            out.findings.append(finding("info", "node-namespace", at, name, message))
            overlay(out.root, node, out.findings)
            for key, (there, other) in root.items.items():
                if key == "navstack" or key in SAFETY_SECTIONS:
                    put(out.root, key, there, other, out.findings)
            return
    overlay(out.root, root, out.findings)


def _load_as(out: Sources, root: DictNode, role: str | None, shown: str, namespace: str) -> None:
    if not namespace and _is_of_nav2(out, root, shown):
        return
    if namespace:
        _load_into(out, root, parts_of(namespace))
    elif role == _COMMON and not _names_costmaps(root):
        for costmap in COSTMAPS:
            _load_into(out, root, [costmap])
    elif role in (_LOCAL, _GLOBAL) and root.items and not _names_costmaps(root):
        message = f"the file names no costmap, so it is loaded into {role}; use {shown}@NAMESPACE for another namespace"
        out.add_finding("info", "namespace-by-name", Location(shown), message)
        _load_into(out, root, [role])
    else:
        load_root(out, root)


def _is_of_nav2(out: Sources, root: DictNode, shown: str) -> bool:
    """Keep a file of Nav2 for later; False if it may as well be a section of move_base's files (`collision_monitor`)."""
    if not is_nav2(root):
        return False
    if navigates(root) and not any(navigates(other) for _, other in out.nav2):
        out.beside_move_base = any(name in out.root.children for name in _OF_MOVE_BASE)
    out.nav2.append((shown, root))
    return navigates(root)


def _names_costmaps(root: DictNode) -> bool:
    return any(c in root.items for c in COSTMAPS) or any(n in root.items for n in NODE_NAMES)


def _load_into(out: Sources, root: DictNode, names: list[str]) -> None:
    space = out.root
    for name in names:
        space = descend(space, name, root.at, out.findings)
    overlay(space, root, out.findings)


# --- folders ----------------------------------------------------------------------------------------------------------


def load_folder(out: Sources, folder: Path, shown: str, namespace: str) -> None:
    """Load the files of a folder that have a role, in the order of the roles."""
    try:
        found = _yaml_files(folder)
        inner = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith((".", "_")))
        below = [p for p in inner if any(role_of(f.name) for f in _yaml_files(p))]
    except OSError as exc:
        message = f"the folder {shown} cannot be read: {exc.strerror or exc}"
        out.add_finding("error", "cannot-read", Location(shown), message)
        return
    roles: dict[str, _Files] = {}
    for path in found:
        name = f"{shown}/{path.name}"
        role = role_of(path.name)
        if role is None:
            _report_left_out(out, path, name, shown)
        else:
            roles.setdefault(role, []).append((path, name))
    _add_inner_folder(out, roles, below, shown)
    if not roles and len(below) <= 1:
        content = "no YAML file" if not found else "no file whose name has a role for move_base"
        message = f"the folder contains {content}; name its launch file, or the files or folders to load"
        out.add_finding("error", "no-source", Location(shown), message)
    for role in _ROLES:
        if role in roles:
            _load_role(out, role, roles[role], shown, namespace)


def _report_left_out(out: Sources, path: Path, name: str, shown: str) -> None:
    """Report a file without a role: a warning if it holds what move_base needs."""
    keys = read_yaml(path, name).root.items
    held = next((key for key in keys if key in _NEEDED or key in FOREIGN_PLANNERS), None)
    if held is None:
        message = "the file is not loaded because its name has no role for move_base; name the file to load it"
        out.add_finding("info", "not-loaded", Location(name), message)
        return
    message = (
        f"the file is not loaded because its name has no role for move_base, but it sets {held}; name it as well: "
        f"{shown} {name}"
    )
    out.add_finding("warning", "not-loaded", Location(name, keys[held][0].line, keys[held][0].column), message)


def launch_files(folder: Path) -> list[Path]:
    """Return the launch files of a folder and of the folders in it that start a move_base node themselves."""
    found: list[Path] = []
    try:
        for place in (folder, *sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))):
            found += sorted(p for p in place.iterdir() if p.suffix in (".launch", ".xml") and is_file(p))
        return [p for p in found if _MOVE_BASE.search(p.read_bytes()[:MAX_BYTES])]
    except OSError:
        return []


def _yaml_files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.suffix in (".yaml", ".yml") and p.is_file())


def _add_inner_folder(out: Sources, roles: dict[str, _Files], below: list[Path], shown: str) -> None:
    """Add the costmaps' files from a folder below (the layout of jackal's); several such folders are an error."""
    if not below or (_LOCAL in roles and _GLOBAL in roles):
        for folder in below:
            message = "the folder is not loaded; name it to load it"
            out.add_finding("info", "not-loaded", Location(f"{shown}/{folder.name}"), message)
        return
    if any(resolved(p) in out.named for p in below):
        return  # the one that is meant is named as well
    if len(below) > 1:
        choices = " or ".join(f"{shown}/{p.name}" for p in below)
        also = f" in addition to {shown}" if roles else ""
        missing = " and ".join(r for r in (_LOCAL, _GLOBAL) if r not in roles)
        message = f"several folders contain {missing} files; name one of them{also}: {choices}"
        out.add_finding("error", "ambiguous", Location(shown), message)
        return
    for path in _yaml_files(below[0]):
        role = role_of(path.name)
        if role is not None:
            roles.setdefault(role, []).append((path, f"{shown}/{below[0].name}/{path.name}"))


def _load_role(out: Sources, role: str, files: _Files, shown: str, namespace: str) -> None:
    if role in (_COMMON, _LOCAL, _GLOBAL) and len(files) > 1:
        names = ", ".join(name for _, name in files)
        message = f"several files have the role of {role}: {names}; {_CHOOSE}"
        out.add_finding("error", "ambiguous", Location(shown), message)
        return
    contents: list[DictNode] = []
    for path, name in files:
        read = read_yaml(path, name)
        out.files.append(name)
        out.findings += read.findings
        contents.append(read.root)
    if role == "local_planner" and not _are_compatible(out, files, contents, shown):
        return
    for (_, name), root in zip(files, contents):
        _load_as(out, root, role, name, namespace)


def _are_compatible(out: Sources, files: _Files, contents: list[DictNode], shown: str) -> bool:
    """False if several files set the same planner or each select another one."""
    for i, first in enumerate(contents):
        for j in range(i + 1, len(contents)):
            shared = [k for k in contents[j].items if k in first.items]
            if shared:
                message = f"{files[i][1]} and {files[j][1]} both set {shared[0]}; {_CHOOSE}"
                out.add_finding("error", "ambiguous", Location(shown), message)
                return False
    return True


Source = str | Path | Mapping[str, Any] | DictNode
"""A name, folder or file; values from Python; or a mapping with locations that was read elsewhere."""


class SetText(str):
    """`NAME=VALUE` of the option `--set`: findings name the option instead of the Python argument `overrides`."""

    __slots__ = ()


class Override(NamedTuple):
    """A value of the command line that another option than `--set` gives."""

    text: str
    """`NAME=VALUE`"""
    option: str
    """The option as it is written: `--footprint 2x1`. Findings name it as their location."""


def packaged_sets() -> list[str]:
    """Return the names of the parameter sets that ship with navstack."""
    here = data_folder("params")
    return sorted(
        p.name
        for p in here.iterdir()
        if p.is_dir() and any(p.joinpath(n).is_file() for n in ("costmap_common_params.yaml", "nav2_params.yaml"))
    )


def packaged_folder(name: str) -> Path:
    """Return the folder of a packaged set."""
    return data_folder("params") / name


def read_sources(
    sources: Iterable[Source],
    overrides: Sequence[str | Override] = (),
    *,
    distro: str | None = None,
    substitute: bool = False,
    native: bool = True,
) -> Sources:
    """Read everything into one tree; later sources override earlier ones, overrides come last. Never raises for content.

    Files of Nav2 are translated; `distro` is their distribution (found from their keys if None), and with `substitute` others
    stand in for plugins that navstack does not have. Where a plugin has a variant with Nav2's rules and one with those of ROS 1,
    `native` selects Nav2's.
    """
    out = Sources()
    named: list[Source] = []
    for source in sources:
        argument = launch_argument(source) if isinstance(source, str) else None
        if argument is None:
            named.append(source)
        else:
            out.arguments[argument[0]] = argument[1]
    if not named:
        message = f"no parameters are named; name a folder, YAML files or {_sets()}"
        out.add_finding("error", "no-source", Location("--params"), message)
    texts = [str(s).partition("@")[0] for s in named if isinstance(s, (str, Path))]
    out.named = {resolved(Path(text)) for text in texts if text not in packaged_sets()}
    for source in named:
        if isinstance(source, Mapping):
            node = to_node(source, Location("(a Python mapping)"))
            assert isinstance(node, DictNode)
            if not _is_of_nav2(out, node, node.at.file):
                load_root(out, node)
        elif isinstance(source, DictNode):
            if not _is_of_nav2(out, source, source.at.file):
                load_root(out, source)
        else:
            _read_named(out, str(source))
    given: list[_Given] = []
    for number, override in enumerate(overrides):
        text, option = (override, _name_of(number, override)) if isinstance(override, str) else override
        out.overrides.append(option)
        parsed = _parse_override(out, text, Location(option))
        if parsed is not None:
            given.append(parsed)
    if out.nav2:
        given = _read_nav2(out, given, distro, substitute, native)
    for names, at, node in given:
        _override(out, names, at, node)
    return out


_Given = tuple[list[str], Location, Node]
"""An override: parts of its name, location, value."""


def _read_nav2(out: Sources, given: list[_Given], distro: str | None, substitute: bool, native: bool) -> list[_Given]:
    """Translate the files of Nav2 into the tree; return the overrides that were not of them."""
    if not any(navigates(root) for _, root in out.nav2) and not set(out.root.children) <= set(NODE_SECTIONS):
        return given  # sections of safety or localization for move_base, as ROS 2 writes them
    if out.beside_move_base:
        for _, root in out.nav2:  # nodes of Nav2 beside the parameters of move_base
            if navigates(root):
                overlay(out.root, root, out.findings)
        return given
    from navstack.parameters.nav2.translate import override_target, translate  # only for files of Nav2

    for name in NODE_SECTIONS:  # loaded as sections of move_base, before a file of Nav2 was seen
        if any(name in root.items for _, root in out.nav2):
            out.root.children.pop(name, None)
    for shown, root in out.nav2:
        if is_file(Path(shown)):
            _check_aliases(out, Path(shown), shown)
        for key in ("navstack", "twist_mux"):
            if key in root.items:
                put(out.root, key, *root.items[key], out.findings)
    own = [g for g in given if override_target(out.nav2, ".".join(g[0]), out.arguments)]
    later, out.root = out.root, Space("", Location(""))
    out.translation = translate(
        out.nav2,
        out.root,
        out.findings,
        arguments=out.arguments,
        distro=distro,
        overrides=[(".".join(names), at, node) for names, at, node in own],
        substitute=substitute,
        native=native,
    )
    # what other sources set comes on top, also by the ids of Nav2: FollowPath={"vx_max": 0.3}
    ids = out.translation.ids if out.translation is not None else {}
    for name, child in later.children.items():
        node = child.node if isinstance(child, Leaf) else child.as_node()
        put(out.root, ids.get(name, name), child.at, node, out.findings)
    return [g for g in given if g not in own]


def _check_aliases(out: Sources, path: Path, shown: str) -> None:
    """Report aliases of YAML, which ROS 2's parser rejects."""
    at = first_alias(path)
    if at is not None:
        message = "the parameter files of ROS 2 cannot have anchors and aliases (`&name`, `*name`); write the value out"
        out.add_finding("error", "nav2-alias", Location(shown, *at), message)


def _name_of(number: int, given: str) -> str:
    """The name of an override in messages."""
    return f"--set argument {number + 1}" if isinstance(given, SetText) else f"overrides[{number}]"


def split_namespace(text: str) -> tuple[str, str]:
    """Split `file@namespace`; an existing file or folder of the whole name has an empty namespace."""
    path, at, namespace = text.rpartition("@")
    return (text, "") if not at or exists(Path(text)) else (path, namespace)


def short_name(source: str) -> str:
    """Return the name of a source for tables and records: `/home/x/turtlebot2/param` -> turtlebot2/param."""
    path = Path(source)
    return f"{path.parent.name}/{path.name}" if path.name in ("param", "params", "config") else path.name


def _sets() -> str:
    return f"a packaged set ({', '.join(packaged_sets())})"


def to_node(value: Any, at: Location) -> Node:
    """Return Python values as a node; `at` is the location of all of them."""
    if isinstance(value, Mapping):
        return DictNode({str(k): (at, to_node(v, at)) for k, v in value.items()}, at)
    if isinstance(value, (list, tuple)):
        return ListNode([to_node(v, at) for v in value], at)
    return ScalarNode(value, at, isinstance(value, str), str(value))


def _read_named(out: Sources, text: str) -> None:
    path_text, namespace = split_namespace(text)
    path = Path(path_text)
    if path_text in packaged_sets():
        if exists(path):
            message = f"{path_text} is read as the packaged set, not as the folder; write ./{path_text} for the folder"
            out.add_finding("info", "packaged-set", Location(path_text), message)
        folder = packaged_folder(path_text)
        if namespace or not _read_nav2_folder(out, folder, path_text):
            load_folder(out, folder, path_text, namespace)
    elif exists(path) and path.is_dir():
        shown = path_text.rstrip("/") or "/"
        if not namespace and _read_nav2_folder(out, path, shown):
            return
        if not _read_through_launch(out, path, shown, namespace):
            before = len(out.findings)
            load_folder(out, path, shown, namespace)
            if any(f.rule == "ambiguous" for f in out.findings[before:]):
                out.findings[before:] = _with_launch_files(out.findings[before:], path, shown)
    elif exists(path) and path.suffix in (".launch", ".xml"):
        reader = LaunchReader(out.findings, out.files)
        space = reader.read(path, path_text, out.arguments)
        out.descriptions += reader.descriptions
        if space is not None:
            overlay(out.root, space.as_node(), out.findings)
    elif exists(path):
        load_file(out, path, path_text, namespace)
    else:
        close = difflib.get_close_matches(path_text, packaged_sets(), n=1)
        hint = f'did you mean "{close[0]}"?' if close else _nearest_files(path)
        message = f'"{path_text}" is not a file, folder or packaged set; {hint}'
        out.add_finding("error", "no-source", Location(path_text), message, close[0] if close else None)


def _nearest_files(path: Path) -> str:
    """Return what to name instead of a path that does not exist: a similar file there, or else what the folder has."""
    if len(path.parts) < 2 and not path.suffix:
        return f"name a folder, a YAML file or {_sets()}"
    folder = next((parent for parent in path.parents if exists(parent) and parent.is_dir()), Path())
    where = "the current folder" if folder == Path() else f'"{folder}"'
    if folder != path.parent:
        return f"{where} has no {path.relative_to(folder).parts[0]}; correct the path"
    try:
        names = sorted(p.name for p in folder.iterdir() if p.suffix in (".launch", ".xml", ".yaml", ".yml"))
    except OSError:
        names = []
    close = difflib.get_close_matches(path.name, names, n=1)
    if close:
        return f'did you mean "{folder / close[0]}"?'
    some = f"{', '.join(names[:5])}{', ..' if len(names) > 5 else ''}" if names else "no launch file and no YAML file"
    return f"{where} has {some}; correct the path"


def _read_nav2_folder(out: Sources, folder: Path, shown: str) -> bool:
    """Load the only file of Nav2 in a folder without files of move_base, with its `navstack.yaml`; False if there is none."""
    try:
        files = _yaml_files(folder)
    except OSError:
        return False
    if any(role_of(path.name) in (_COMMON, _LOCAL, _GLOBAL, "move_base") for path in files):
        return False
    found = [path for path in files if navigates(read_yaml(path).root)]
    if len(found) == 1:
        own = [path for path in files if role_of(path.name) == "navstack"]
        for path in (*found, *own):
            load_file(out, path, f"{shown}/{path.name}", "")
    elif found:
        names = ", ".join(f"{shown}/{path.name}" for path in found)
        message = f"the folder has {len(found)} parameter files of Nav2; name the one that is meant: {names}"
        out.add_finding("error", "ambiguous", Location(shown), message)
    return bool(found)


def _with_launch_files(findings: Sequence[Finding], folder: Path, shown: str) -> list[Finding]:
    """Add the launch files of the package that load files of a folder to the findings about its ambiguous files."""
    parent = resolved(folder).parent
    above = [parent] if is_file(parent / "package.xml") else [parent, parent.parent]
    mention = re.compile(rb"/" + re.escape(resolved(folder).name).encode() + rb"/")
    found = [p for place in above for p in launch_files(place) if mention.search(p.read_bytes()[:MAX_BYTES])]
    if not found:
        return list(findings)
    names = [os.path.relpath(path) if not Path(shown).is_absolute() else str(path) for path in dict.fromkeys(found)]
    listed = " or ".join(names[:_MAX_LAUNCHES]) + (
        f" or {len(names) - _MAX_LAUNCHES} more" if names[_MAX_LAUNCHES:] else ""
    )
    which = "the launch file that loads them" if len(names) == 1 else "a launch file that loads them"
    return [
        replace(f, message=f"{f.message}; or name {which}: {listed}") if f.rule == "ambiguous" else f for f in findings
    ]


def _read_through_launch(out: Sources, folder: Path, shown: str, namespace: str) -> bool:
    """Load a folder that cannot be loaded by its files' names through its only launch file that can; False if it need not."""
    launches = launch_files(folder)
    if not launches or namespace:
        return False
    trial = Sources(named=out.named)
    load_folder(trial, folder, shown, namespace)
    if not any(f.severity == "error" for f in trial.findings):
        return False
    good: list[tuple[str, Space, LaunchReader]] = []
    for path in launches:
        name = f"{shown}/{path.relative_to(folder)}"
        reader = LaunchReader([], [])
        space = reader.read(path, name, out.arguments)
        if space is not None and not any(f.severity == "error" for f in reader.findings):
            good.append((name, space, reader))
    if len(good) != 1:
        if len(good) > 1:
            names = " or ".join(name for name, _, _ in good)
            message = f"several launch files of the folder start move_base; name the one that is meant: {names}"
            out.add_finding("error", "ambiguous", Location(shown), message)
        return len(good) > 1
    name, space, reader = good[0]
    out.add_finding("info", "through-launch", Location(shown), f"the folder is loaded through its launch file {name}")
    out.findings += reader.findings
    out.files += reader.files
    out.descriptions += reader.descriptions
    overlay(out.root, space.as_node(), out.findings)
    return True


def _parse_override(out: Sources, text: str, at: Location) -> _Given | None:
    """Read `DWAPlannerROS/max_vel_x=0.4`; dots separate names as well."""
    key, equals, value = text.partition("=")
    names = parts_of(key.strip().replace(".", "/"))
    if not equals or not names:
        message = f'"{text}" is not an override; write NAME=VALUE, for example DWAPlannerROS/max_vel_x=0.4'
        out.add_finding("error", "override", at, message)
        return None
    node, findings = parse_value(value.strip(), at.file)
    errors = [f for f in findings if f.severity == "error"]
    if errors:
        path = "/".join(names)
        message = f'{path} = "{value}" cannot be read: {errors[0].message}'
        out.findings.append(finding("error", "override", at, path, message))
        return None
    if node is None:
        node = ScalarNode(None, at)
    relocate(node, at)
    return names, at, node


def _override(out: Sources, names: list[str], at: Location, node: Node) -> None:
    space = out.root
    for name in names[:-1]:
        space = descend(space, name, at, out.findings)
    put(space, names[-1], at, node, out.findings)
