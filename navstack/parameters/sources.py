"""What the user names (a packaged set, a folder, files, overrides) -> one tree, with roslaunch's overlay semantics."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from navstack.core.data_files import data_folder
from navstack.core.files import exists
from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.launch import LaunchReader, launch_argument
from navstack.parameters.tree import COSTMAPS, Space, descend, overlay, parts_of, put
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, parse_value, read_yaml, relocate

Source = str | Path | Mapping[str, Any] | DictNode
"""A name, folder or file; values from Python; or a mapping that was read elsewhere, with its places."""

NODE_NAMES = ("move_base", "move_base_node")
"""Names under which move_base runs: a dump of the parameter server has everything below one of them."""

# The roles of a folder's files, in the order in which the turtlebot's move_base.launch loads them. A file that plays no
# role (a sensor's, a map's, amcl's) is not loaded unless named.
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
}
_NOISE = re.compile(r"(?:^|_)(?:params?|config|parameters?|ros)(?=_|$)")


def packaged_sets() -> list[str]:
    """Names of the parameter sets that come with navstack."""
    here = data_folder("params")
    return sorted(p.name for p in here.iterdir() if p.is_dir() and p.joinpath("costmap_common_params.yaml").is_file())


def packaged_folder(name: str) -> Path:
    """The folder of a packaged set."""
    return data_folder("params") / name


@dataclass(slots=True)
class Sources:
    """The tree that the sources make together, and what was noticed on the way."""

    root: Space = field(default_factory=lambda: Space("", Location("")))
    findings: list[Finding] = field(default_factory=list[Finding])
    files: list[str] = field(default_factory=list[str])
    """Files read, as shown, in order."""
    arguments: dict[str, str] = field(default_factory=dict[str, str])
    """For launch files: `name:=value` among the sources."""

    def say(self, severity: Any, rule: str, at: Location, message: str, suggestion: str | None = None) -> None:
        """Adds a finding about a source as a whole."""
        self.findings.append(finding(severity, rule, at, "", message, suggestion))


def read_sources(sources: Iterable[Source], overrides: Sequence[str] = ()) -> Sources:
    """Reads everything into one tree, later over earlier, overrides last. Never raises for content."""
    out = Sources()
    named: list[Source] = []
    for source in sources:
        argument = launch_argument(source) if isinstance(source, str) else None
        if argument is None:
            named.append(source)
        else:
            out.arguments[argument[0]] = argument[1]
    if not named:
        out.say(
            "error", "no-source", Location("--params"), f"no parameters were named; give a folder, files or {_sets()}"
        )
    for source in named:
        if isinstance(source, Mapping):
            node = to_node(source, Location("(a Python mapping)"))
            assert isinstance(node, DictNode)
            _load_root(out, node)
        elif isinstance(source, DictNode):
            _load_root(out, source)
        else:
            _read_one(out, str(source))
    for number, text in enumerate(overrides, 1):
        _override(out, text, number)
    return out


def split_namespace(text: str) -> tuple[str, str]:
    """`file@namespace` -> both; a file or folder of just that name wins, and its namespace is empty."""
    path, at, namespace = text.rpartition("@")
    return (text, "") if not at or exists(Path(text)) else (path, namespace)


def short_name(source: str) -> str:
    """A source as tables and records name it, wherever it lies: `/home/x/turtlebot2/param` is turtlebot2/param."""
    path = Path(source)
    return f"{path.parent.name}/{path.name}" if path.name in ("param", "params", "config") else path.name


def _sets() -> str:
    return " or ".join(f'"{n}"' for n in packaged_sets())


def to_node(value: Any, at: Location) -> Node:
    """Python values as a node."""
    if isinstance(value, Mapping):
        return DictNode({str(k): (at, to_node(v, at)) for k, v in value.items()}, at)
    if isinstance(value, (list, tuple)):
        return ListNode([to_node(v, at) for v in value], at)
    return ScalarNode(value, at, isinstance(value, str), str(value))


def _read_one(out: Sources, text: str) -> None:
    path_text, namespace = split_namespace(text)
    path = Path(path_text)
    if path_text in packaged_sets():
        if exists(path):
            message = f"{path_text} is the packaged set here, not the folder of that name; write ./{path_text} for that"
            out.say("info", "packaged-set", Location(path_text), message)
        _read_folder(out, packaged_folder(path_text), path_text, namespace)
    elif exists(path) and path.is_dir():
        _read_folder(out, path, path_text.rstrip("/") or "/", namespace)
    elif exists(path):
        _read_file(out, path, path_text, namespace)
    else:
        close = difflib.get_close_matches(path_text, packaged_sets(), n=1)
        hint = f'; did you mean "{close[0]}"?' if close else f"; give a folder, a YAML file or {_sets()}"
        message = f'there is no file, folder or packaged set "{path_text}"{hint}'
        out.say("error", "no-source", Location(path_text), message, close[0] if close else None)


# --- files ------------------------------------------------------------------------------------------------------------


def role_of(name: str) -> str | None:
    """The role of a file in a folder, by its name: `costmap_common`, `local_planner`..; None plays none."""
    stem = name.lower().partition(".")[0]
    bare = _NOISE.sub("", stem).strip("_")
    for role, stems in _ROLES.items():
        if bare in stems:
            return role
    # variants of one role: costmap_common_params_burger, costmap_global_static
    for role in (_COMMON, _LOCAL, _GLOBAL):
        if any(s in bare for s in _ROLES[role]):
            return role
    # a robot's name before or after: p3dx_dwa_local_planner, base_local_planner_holonomic
    for role in ("local_planner", "global_planner", "move_base"):
        if any(bare.startswith(f"{s}_") or bare.endswith(f"_{s}") for s in _ROLES[role] if "_" in s):
            return role
    return None


def _read_file(out: Sources, path: Path, shown: str, namespace: str) -> None:
    """A file that the user named."""
    if path.suffix in (".launch", ".xml"):
        _read_launch(out, path, shown)
        return
    read = read_yaml(path, shown)
    out.files.append(shown)
    out.findings += read.findings
    if namespace:
        _load(out, read.root, parts_of(namespace))
    elif role_of(path.name) == _COMMON and not _has_costmaps(read.root):
        for costmap in COSTMAPS:
            _load(out, read.root, [costmap])
    else:
        _load_role(out, read.root, role_of(path.name), shown)


def _read_launch(out: Sources, path: Path, shown: str) -> None:
    space = LaunchReader(out.findings, out.files).read(path, shown, out.arguments)
    if space is not None:
        overlay(out.root, space.as_node(), out.findings)


def _has_costmaps(root: DictNode) -> bool:
    return any(c in root.items for c in COSTMAPS) or any(n in root.items for n in NODE_NAMES)


def _load(out: Sources, root: DictNode, names: list[str]) -> None:
    space = out.root
    for name in names:
        space = descend(space, name, root.at, out.findings)
    overlay(space, root, out.findings)


def _load_root(out: Sources, root: DictNode) -> None:
    """Into move_base's own namespace; a dump of the whole parameter server is entered at move_base."""
    for name in NODE_NAMES:
        if name not in root.items:
            continue
        at, node = root.items[name]
        if isinstance(node, DictNode):
            message = f"everything under {name} is loaded as move_base's own; other nodes' parameters are left out"
            out.findings.append(finding("info", "node-namespace", at, name, message))
            overlay(out.root, node, out.findings)
            for key, (there, other) in root.items.items():
                if key == "navstack":
                    put(out.root, key, there, other, out.findings)
            return
    overlay(out.root, root, out.findings)


def _load_role(out: Sources, root: DictNode, role: str | None, shown: str) -> None:
    """A file of a role whose content does not say its namespace itself goes where its role belongs."""
    if role in (_LOCAL, _GLOBAL) and root.items and not _has_costmaps(root):
        message = f"{shown} names no costmap inside, so it is loaded into {role}; say {shown}@namespace for another"
        out.say("info", "namespace-by-name", Location(shown), message)
        _load(out, root, [role])
        return
    _load_root(out, root)


# --- folders ----------------------------------------------------------------------------------------------------------


def _yaml_files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.suffix in (".yaml", ".yml") and p.is_file())


def _read_folder(out: Sources, folder: Path, shown: str, namespace: str) -> None:
    try:
        found = _yaml_files(folder)
        inner = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith((".", "_")))
        below = [p for p in inner if any(role_of(f.name) for f in _yaml_files(p))]
    except OSError as exc:
        out.say("error", "cannot-read", Location(shown), f"the folder {shown} cannot be read: {exc.strerror or exc}")
        return
    roles: dict[str, list[tuple[Path, str]]] = {}
    for path in found:
        name = f"{shown}/{path.name}"
        role = role_of(path.name)
        if role is None:
            message = "not loaded: its name is none of move_base's files; name it to load it as well"
            out.say("info", "not-loaded", Location(name), message)
        else:
            roles.setdefault(role, []).append((path, name))
    _add_inner_folder(out, roles, below, shown)
    if not roles and not (below and len(below) > 1):
        what = "no YAML file" if not found else "no file that move_base loads, by its name"
        message = f"the folder holds {what}; name its launch file, or the files or folders to load"
        out.say("error", "no-source", Location(shown), message)
    for role in _ROLES:
        _read_role(out, role, roles.get(role, []), shown, namespace)


def _add_inner_folder(out: Sources, roles: dict[str, list[tuple[Path, str]]], below: list[Path], shown: str) -> None:
    """The layout of jackal's: the costmaps' own files lie in a folder below, of which there may be several to choose from."""
    if not below or (_LOCAL in roles and _GLOBAL in roles):
        for folder in below:
            message = "this folder is not loaded; name it to load it as well"
            out.say("info", "not-loaded", Location(f"{shown}/{folder.name}"), message)
        return
    if len(below) > 1:
        choices = " or ".join(f"{shown}/{p.name}" for p in below)
        also = f" beside {shown}" if roles else ""
        missing = " and ".join(r for r in (_LOCAL, _GLOBAL) if r not in roles)
        message = f"{missing} files are in several folders here; name the one that is meant{also}: {choices}"
        out.say("error", "ambiguous", Location(shown), message)
        return
    for path in _yaml_files(below[0]):
        role = role_of(path.name)
        if role is not None:
            roles.setdefault(role, []).append((path, f"{shown}/{below[0].name}/{path.name}"))


_CHOOSE = "name the files one by one in the place of the folder, of these the one that is meant"


def _read_role(out: Sources, role: str, files: list[tuple[Path, str]], shown: str, namespace: str) -> None:
    if not files:
        return
    if role in (_COMMON, _LOCAL, _GLOBAL) and len(files) > 1:
        names = ", ".join(name for _, name in files)
        message = f"several files play the part of {role}: {names}; {_CHOOSE}"
        out.say("error", "ambiguous", Location(shown), message)
        return
    contents: list[DictNode] = []
    for path, name in files:
        read = read_yaml(path, name)
        out.files.append(name)
        out.findings += read.findings
        contents.append(read.root)
    if role == "local_planner" and not _one_choice(out, files, contents, shown):
        return
    for (_, name), root in zip(files, contents):
        if namespace:
            _load(out, root, parts_of(namespace))
        elif role == _COMMON and not _has_costmaps(root):
            for costmap in COSTMAPS:
                _load(out, root, [costmap])
        else:
            _load_role(out, root, role, name)


def _one_choice(out: Sources, files: list[tuple[Path, str]], contents: list[DictNode], shown: str) -> bool:
    """False when several files of the folder set the same planner or each choose another one."""
    for i, first in enumerate(contents):
        for j in range(i + 1, len(contents)):
            shared = [k for k in contents[j].items if k in first.items]
            if shared:
                both = f"{files[i][1]} and {files[j][1]} both set {shared[0]}"
                message = f"{both}; {_CHOOSE}"
                out.say("error", "ambiguous", Location(shown), message)
                return False
    return True


# --- overrides --------------------------------------------------------------------------------------------------------


def _override(out: Sources, text: str, number: int) -> None:
    """`DWAPlannerROS/max_vel_x=0.4`; dots separate as well."""
    at = Location(f"--set argument {number}")
    key, equals, value = text.partition("=")
    names = parts_of(key.strip().replace(".", "/"))
    if not equals or not names:
        message = f'"{text}" is no override; write NAME=VALUE, for example DWAPlannerROS/max_vel_x=0.4'
        out.say("error", "override", at, message)
        return
    node, findings = parse_value(value.strip(), at.file)
    errors = [f for f in findings if f.severity == "error"]
    if errors:
        path = "/".join(names)
        message = f'the value "{value}" of {path} cannot be read: {errors[0].message}'
        out.findings.append(finding("error", "override", at, path, message))
        return
    if node is None:
        node = ScalarNode(None, at)
    relocate(node, at)
    space = out.root
    for name in names[:-1]:
        space = descend(space, name, at, out.findings)
    put(space, names[-1], at, node, out.findings)
