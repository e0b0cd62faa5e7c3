"""Read the parameter files of a folder: the name of a file decides its role, the role its namespace and its order."""

from __future__ import annotations

import re
from pathlib import Path

from navstack.core.files import is_file, resolved
from navstack.parameters.findings import Location, finding
from navstack.parameters.foreign import FOREIGN_PLANNERS
from navstack.parameters.safety_sections import SAFETY_MODELS
from navstack.parameters.source_tree import Sources
from navstack.parameters.tree import COSTMAPS, descend, overlay, parts_of, put
from navstack.parameters.yaml_reader import MAX_BYTES, DictNode, read_yaml

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
_MOVE_BASE = re.compile(rb"""<node\b[^>]*\btype\s*=\s*["']move_base["']""")

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
    _load_as(out, read.root, role_of(path.name), shown, namespace)


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
                if key == "navstack" or key in SAFETY_MODELS:
                    put(out.root, key, there, other, out.findings)
            return
    overlay(out.root, root, out.findings)


def _load_as(out: Sources, root: DictNode, role: str | None, shown: str, namespace: str) -> None:
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
