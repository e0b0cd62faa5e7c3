"""Merge what the user names (packaged sets, folders, files, overrides) into one tree, as roslaunch does."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from navstack.core.data_files import data_folder
from navstack.core.files import exists, resolved
from navstack.parameters.findings import Location, finding
from navstack.parameters.folders import launch_files, load_file, load_folder, load_root
from navstack.parameters.launch import LaunchReader, launch_argument
from navstack.parameters.source_tree import Sources
from navstack.parameters.tree import Space, descend, overlay, parts_of, put
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, parse_value, relocate

Source = str | Path | Mapping[str, Any] | DictNode
"""A name, folder or file; values from Python; or a mapping with locations that was read elsewhere."""


class Override(NamedTuple):
    """A value of the command line that another option than `--set` gives."""

    text: str
    """`NAME=VALUE`"""
    option: str
    """The option as it is written: `--footprint 2x1`. Findings name it as their location."""


__all__ = [
    "Override",
    "Source",
    "Sources",
    "packaged_folder",
    "packaged_sets",
    "read_sources",
    "short_name",
    "split_namespace",
    "to_node",
]


def packaged_sets() -> list[str]:
    """Return the names of the parameter sets that ship with navstack."""
    here = data_folder("params")
    return sorted(p.name for p in here.iterdir() if p.is_dir() and p.joinpath("costmap_common_params.yaml").is_file())


def packaged_folder(name: str) -> Path:
    """Return the folder of a packaged set."""
    return data_folder("params") / name


def read_sources(sources: Iterable[Source], overrides: Sequence[str | Override] = ()) -> Sources:
    """Read everything into one tree; later sources override earlier ones, overrides come last. Never raises for content."""
    out = Sources()
    named: list[Source] = []
    for source in sources:
        argument = launch_argument(source) if isinstance(source, str) else None
        if argument is None:
            named.append(source)
        else:
            out.arguments[argument[0]] = argument[1]
    if not named:
        message = f"no parameters are named; name a folder, files or {_sets()}"
        out.add_finding("error", "no-source", Location("--params"), message)
    out.named = {resolved(Path(str(s).partition("@")[0])) for s in named if isinstance(s, (str, Path))}
    for source in named:
        if isinstance(source, Mapping):
            node = to_node(source, Location("(a Python mapping)"))
            assert isinstance(node, DictNode)
            load_root(out, node)
        elif isinstance(source, DictNode):
            load_root(out, source)
        else:
            _read_named(out, str(source))
    for number, given in enumerate(overrides, 1):
        text, option = (given, f"--set argument {number}") if isinstance(given, str) else given
        _override(out, text, Location(option))
    return out


def split_namespace(text: str) -> tuple[str, str]:
    """Split `file@namespace`; an existing file or folder of the whole name has an empty namespace."""
    path, at, namespace = text.rpartition("@")
    return (text, "") if not at or exists(Path(text)) else (path, namespace)


def short_name(source: str) -> str:
    """Return the name of a source for tables and records: `/home/x/turtlebot2/param` -> turtlebot2/param."""
    path = Path(source)
    return f"{path.parent.name}/{path.name}" if path.name in ("param", "params", "config") else path.name


def _sets() -> str:
    return " or ".join(f'"{n}"' for n in packaged_sets())


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
        load_folder(out, packaged_folder(path_text), path_text, namespace)
    elif exists(path) and path.is_dir():
        shown = path_text.rstrip("/") or "/"
        if not _read_through_launch(out, path, shown, namespace):
            load_folder(out, path, shown, namespace)
    elif exists(path) and path.suffix in (".launch", ".xml"):
        space = LaunchReader(out.findings, out.files).read(path, path_text, out.arguments)
        if space is not None:
            overlay(out.root, space.as_node(), out.findings)
    elif exists(path):
        load_file(out, path, path_text, namespace)
    else:
        close = difflib.get_close_matches(path_text, packaged_sets(), n=1)
        hint = f'did you mean "{close[0]}"?' if close else f"name a folder, a YAML file or {_sets()}"
        message = f'"{path_text}" is not a file, folder or packaged set; {hint}'
        out.add_finding("error", "no-source", Location(path_text), message, close[0] if close else None)


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
    overlay(out.root, space.as_node(), out.findings)
    return True


def _override(out: Sources, text: str, at: Location) -> None:
    """Apply `DWAPlannerROS/max_vel_x=0.4`; dots separate names as well."""
    key, equals, value = text.partition("=")
    names = parts_of(key.strip().replace(".", "/"))
    if not equals or not names:
        message = f'"{text}" is not an override; write NAME=VALUE, for example DWAPlannerROS/max_vel_x=0.4'
        out.add_finding("error", "override", at, message)
        return
    node, findings = parse_value(value.strip(), at.file)
    errors = [f for f in findings if f.severity == "error"]
    if errors:
        path = "/".join(names)
        message = f'{path} = "{value}" cannot be read: {errors[0].message}'
        out.findings.append(finding("error", "override", at, path, message))
        return
    if node is None:
        node = ScalarNode(None, at)
    relocate(node, at)
    space = out.root
    for name in names[:-1]:
        space = descend(space, name, at, out.findings)
    put(space, names[-1], at, node, out.findings)
