"""Lidars of a robot from its own files: the sensors of URDF and xacro files, and the filters of laser_filters.

Read are the ray sensors of Gazebo (`<sensor type="ray|gpu_ray|lidar|gpu_lidar">`): angles, samples, ranges, rate, topic and the
pose of their link along the joints. xacro is expanded without executing Python: properties, arguments, conditions, includes,
macros with parameters and blocks. What cannot be evaluated stays as text, and a sensor whose numbers are not known is left out.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import read_bytes
from navstack.parameters.expressions import MATH, evaluate
from navstack.parameters.launch import Element, RejectedLaunchFileError, find_file, parse_xml, substitute
from navstack.parameters.packages import workspace
from navstack.parameters.yaml_reader import plain, read_yaml

MAX_FILES = 400
"""Most files that a search opens."""
MAX_FOLDERS = 1_000
"""Most folders that a search reads."""
MAX_ELEMENTS = 50_000
"""Most elements that an expanded description may have."""
FILTERED = "scan_filtered"
"""The topic of laser_filters unless it is remapped."""
_MAX_BYTES = 3_000_000
_SENSORS = frozenset({"ray", "gpu_ray", "lidar", "gpu_lidar"})
_SENSOR = re.compile(rb"<sensor\b[^>]*\btype\s*=\s*[\"'](?:gpu_)?(?:ray|lidar)[\"']")
_ROBOT = re.compile(rb"<robot\b[^>]*\bname\s*=")
_EXPRESSION = re.compile(r"\$\{([^{}]*)\}")
_BASES = ("base_footprint", "base_link")


@dataclass(frozen=True, slots=True)
class DescribedLidar:
    """A lidar as a file of the robot describes it, with its pose on the base (m, rad)."""

    topic: str
    frame: str
    x: float
    y: float
    yaw: float
    height: float
    fov: float
    beams: int
    range_min: float
    range_max: float
    frequency: float
    file: str = ""
    filtered: bool = False
    """True behind the filters of laser_filters."""

    FIELDS: ClassVar[tuple[str, ...]] = (
        *("x", "y", "yaw", "height", "fov", "beams", "range_min", "range_max", "frequency"),
    )
    """The parameters of a simulated lidar that it gives."""


def described_lidars(
    near: Sequence[Path], named: Sequence[tuple[Path, Mapping[str, str]]], hints: Sequence[str]
) -> list[DescribedLidar]:
    """Return the lidars of the robot: of the description that its launch file names, else of the packages near its files.

    `hints` are words that choose between several robots (burger or waffle): arguments of the launch file, names of files. Several
    robots with different lidars of which none is meant give no lidar.
    """
    found = [lidars for path, arguments in named if (lidars := lidars_of(path, arguments))]
    if not found:
        files = list(_descriptions(near))
        meant = [
            path for path in files if any(re.search(rf"(?<![a-z]){re.escape(h)}(?![a-z])", path.stem) for h in hints)
        ]
        for paths in (meant, files):
            found = [lidars for path in paths if (lidars := lidars_of(path, {}))]
            if found:
                break
    if not found or any(_bare(lidars) != _bare(found[0]) for lidars in found):
        return []
    return [*found[0], *_filtered(found[0], near)]


def _bare(lidars: Sequence[DescribedLidar]) -> list[DescribedLidar]:
    return [replace(lidar, file="") for lidar in lidars]


def _files(near: Sequence[Path], suffixes: tuple[str, ...]) -> Iterator[Path]:
    """Files with an ending in the named folders and in the packages near them, each once, at most MAX_FILES."""
    seen: set[Path] = set()
    read = 0
    for path in near:
        folder = path if path.is_dir() else path.parent
        for place in (*((folder,) if folder is path else ()), *workspace(folder / "x")):
            for above, folders, names in os.walk(place):
                read += 1
                if read > MAX_FOLDERS:
                    return
                depth = len(Path(above).relative_to(place).parts)
                folders[:] = sorted(f for f in folders if depth < 3 and not f.startswith(".") and f != "meshes")
                for name in sorted(names):
                    file = Path(above, name)
                    if name.endswith(suffixes) and file not in seen:
                        seen.add(file)
                        if len(seen) > MAX_FILES:
                            return
                        yield file


def _descriptions(near: Sequence[Path]) -> Iterator[Path]:
    """The files of whole robots: `<robot name=..>`; those that only others include have no name."""
    for path in _files(near, (".urdf", ".xacro")):
        try:
            data = read_bytes(path, _MAX_BYTES)
        except OSError:
            continue
        if _ROBOT.search(data) and (_SENSOR.search(data) or b"include" in data):
            yield path


# --- a description -> lidars ------------------------------------------------------------------------------------------


def lidars_of(path: Path, arguments: Mapping[str, str]) -> list[DescribedLidar]:
    """Return the lidars of a URDF or xacro file; none if it cannot be read."""
    try:
        root = _Xacro(path, arguments).expanded()
    except (RejectedLaunchFileError, ValueError, RecursionError):
        return []
    joints = _joints(root)
    found: list[DescribedLidar] = []
    for link, sensor in _sensors(root):
        try:
            lidar = _lidar_of(sensor, link, joints)
        except (ValueError, KeyError, IndexError):
            continue
        if lidar is not None:
            found.append(replace(lidar, file=str(path)))
    return found


def _sensors(root: Element) -> Iterator[tuple[str, Element]]:
    """Every ray sensor with its link."""
    for element in root.children:
        if element.tag == "gazebo":
            link = element.attributes.get("reference", "")
            for child in element.children:
                if child.tag == "sensor" and child.attributes.get("type") in _SENSORS:
                    yield link, child


def _lidar_of(
    sensor: Element, link: str, joints: Mapping[str, tuple[str, NDArray[np.float64]]]
) -> DescribedLidar | None:
    ray = _child(sensor, "ray") or _child(sensor, "lidar")
    horizontal = _at(ray, "scan", "horizontal")
    low, high = _number(horizontal, "min_angle"), _number(horizontal, "max_angle")
    samples, nearest, farthest = (
        _number(horizontal, "samples"),
        _number(_at(ray, "range"), "min"),
        _number(_at(ray, "range"), "max"),
    )
    if not (high > low and farthest > nearest >= 0.0 and samples >= 1.0):
        return None
    plugin = _child(sensor, "plugin")
    topic = _topic(plugin) or _text(sensor, "topic") or "scan"
    rate = _text(sensor, "update_rate")
    pose = _pose(link, joints)
    ahead = pose[:3, 0]
    yaw = math.atan2(ahead[1], ahead[0])
    middle = 0.5 * (low + high)
    upright = pose[2, 2] >= 0.0  # a lidar upside down sees its left on the right
    frame = _text(plugin, "frameName") or _text(plugin, "frame_name") or link
    return DescribedLidar(
        topic.strip("/"),
        frame.strip("/"),
        round(float(pose[0, 3]), 6),
        round(float(pose[1, 3]), 6),
        round(math.remainder(yaw + (middle if upright else -middle), 2.0 * math.pi), 6),
        round(max(float(pose[2, 3]), 0.0), 6),
        min(high - low, 2.0 * math.pi),
        int(min(samples, 100_000)),
        nearest,
        farthest,
        min(float(rate), 1000.0) if rate and float(rate) > 0.0 else 10.0,
    )


def _topic(plugin: Element | None) -> str:
    """The topic that a plugin publishes: ROS 1's topicName, or ROS 2's remapping of ~/out."""
    remapped = next((e.text.strip() for e in _all(_child(plugin, "ros"), "remapping") if ":=" in e.text), "")
    return _text(plugin, "topicName") or _text(plugin, "topic_name") or remapped.partition(":=")[2]


def _child(element: Element | None, tag: str) -> Element | None:
    return next((child for child in _all(element, tag)), None)


def _all(element: Element | None, tag: str) -> list[Element]:
    return [child for child in element.children if child.tag == tag] if element is not None else []


def _at(element: Element | None, *tags: str) -> Element | None:
    for tag in tags:
        element = _child(element, tag)
    return element


def _text(element: Element | None, tag: str) -> str:
    child = _child(element, tag)
    return child.text.strip() if child is not None else ""


def _number(element: Element | None, tag: str) -> float:
    """A number; ValueError without one."""
    value = float(_text(element, tag))
    if not math.isfinite(value):
        raise ValueError(tag)
    return value


# --- poses along the joints -------------------------------------------------------------------------------------------


def _joints(root: Element) -> dict[str, tuple[str, NDArray[np.float64]]]:
    """Child link -> its parent and its pose there (4, 4)."""
    joints: dict[str, tuple[str, NDArray[np.float64]]] = {}
    for joint in _all(root, "joint"):
        parent, child, origin = (_child(joint, tag) for tag in ("parent", "child", "origin"))
        if parent is None or child is None:
            continue
        try:
            joints[child.attributes["link"]] = (parent.attributes["link"], _matrix(origin))
        except (KeyError, ValueError):
            continue
    return joints


def _matrix(origin: Element | None) -> NDArray[np.float64]:
    """The pose of an `<origin xyz rpy>` as a matrix (4, 4)."""
    given = origin.attributes if origin is not None else {}
    x, y, z = (float(v) for v in given.get("xyz", "0 0 0").split())
    roll, pitch, yaw = (float(v) for v in given.get("rpy", "0 0 0").split())
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, x],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, y],
            [-sp, cp * sr, cp * cr, z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _pose(link: str, joints: Mapping[str, tuple[str, NDArray[np.float64]]]) -> NDArray[np.float64]:
    """The pose of a link on the root of its tree, the base; ValueError for a link without joint, and for a circle."""
    pose = np.eye(4)
    if link not in joints and link not in _BASES:
        raise ValueError(link)
    for _ in range(len(joints) + 1):
        if link not in joints:
            return pose
        link, step = joints[link]
        pose = step @ pose
    raise ValueError(link)


# --- xacro ------------------------------------------------------------------------------------------------------------


class _Xacro:
    """Expands a description."""

    def __init__(self, path: Path, arguments: Mapping[str, str]) -> None:
        self._path = path
        self._arguments = dict(arguments)
        self._given = frozenset(arguments)
        self._macros: dict[str, tuple[list[str], Element]] = {}
        self._properties: dict[str, Any] = {}
        self._blocks: dict[str, list[Element]] = {}
        self._count = 0

    def expanded(self) -> Element:
        root = _read(self._path)
        return replace(root, children=self._children(root.children, self._path))

    def _children(self, elements: Sequence[Element], path: Path) -> list[Element]:
        made: list[Element] = []
        for element in elements:
            self._count += 1
            if self._count > MAX_ELEMENTS:
                raise ValueError("too many elements")
            made += self._element(element, path)
        return made

    def _element(self, element: Element, path: Path) -> list[Element]:
        name = element.tag.removeprefix("xacro:")
        if element.tag == name and name not in ("include", "property", "macro", "arg"):
            filled = {key: self._fill(value, path) for key, value in element.attributes.items()}
            text = self._fill(element.text, path)
            return [replace(element, attributes=filled, text=text, children=self._children(element.children, path))]
        if element.tag == name and name != "include" and not path.name.endswith(".xacro"):
            return [element]
        given = {key: self._fill(value, path) for key, value in element.attributes.items() if key != "params"}
        match name:
            case "property":
                if "value" in given:
                    self._properties[given.get("name", "")] = _typed(given["value"])
                elif "name" in given:
                    self._blocks[given["name"]] = element.children
            case "arg":
                if given.get("name", "") not in self._given:
                    self._arguments[given.get("name", "")] = given.get("default", "")
            case "include":
                return self._include(given.get("filename", ""), path)
            case "macro":
                called = given.get("name", "").removeprefix("xacro:")
                self._macros[called] = (element.attributes.get("params", "").split(), element)
            case "if" | "unless":
                if self._is_true(given.get("value", "")) is (name == "if"):
                    return self._children(element.children, path)
            case "insert_block":
                return self._children(self._blocks.get(given.get("name", ""), []), path)
            case _:
                if name in self._macros:
                    return self._call(name, given, element, path)
        return []

    def _include(self, text: str, path: Path) -> list[Element]:
        file = find_file(text, path)
        if file is None:
            return []
        try:
            return self._children(_read(file).children, file)
        except RejectedLaunchFileError:
            return []

    def _call(self, name: str, given: Mapping[str, str], element: Element, path: Path) -> list[Element]:
        names, macro = self._macros[name]
        before, blocks = dict(self._properties), dict(self._blocks)
        children = list(element.children)
        for param in names:
            key, separator, default = param.partition(":=") if ":=" in param else param.partition("=")
            if key.startswith("**"):
                self._blocks[key[2:]] = self._children(children.pop(0).children, path) if children else []
            elif key.startswith("*"):
                self._blocks[key[1:]] = self._children([children.pop(0)], path) if children else []
            elif key in given:
                self._properties[key] = _typed(given[key])
            elif separator:
                inherited = default.startswith("^")
                value = default.lstrip("^|") if not inherited or key not in before else ""
                if value or not inherited:
                    self._properties[key] = _typed(self._fill(value.strip("'"), path))
        made = self._children(macro.children, path)
        self._properties, self._blocks = before, blocks
        return made

    def _fill(self, text: str, path: Path) -> str:
        """A text with its arguments and expressions; as written where one has no value."""
        if "$" not in text:
            return text
        try:
            text = substitute(text, self._arguments, path.parent)
        except ValueError:
            return text

        def value(found: re.Match[str]) -> str:
            try:
                return str(evaluate(found[1], {**MATH, **self._properties}))
            except ValueError:
                return found[0]

        return _EXPRESSION.sub(value, text)

    def _is_true(self, text: str) -> bool:
        return text.strip().lower() in ("true", "1", "1.0")


def _read(path: Path) -> Element:
    """The top element of a file; RejectedLaunchFileError."""
    try:
        return parse_xml(read_bytes(path, _MAX_BYTES), str(path))
    except OSError as exc:
        raise ValueError(str(path)) from exc


def _typed(text: str) -> Any:
    """A property: a number where it is one."""
    for convert in (int, float):
        try:
            return convert(text)
        except ValueError:
            continue
    return {"true": True, "false": False}.get(text.strip().lower(), text)


# --- laser_filters ----------------------------------------------------------------------------------------------------


def _filtered(lidars: list[DescribedLidar], near: Sequence[Path]) -> list[DescribedLidar]:
    """The lidar behind a filter chain near the robot's files; none if several chains or lidars leave open which is meant."""
    chains: list[list[Mapping[str, Any]]] = []
    for path in _files(near, (".yaml", ".yml")):
        try:
            if b"scan_filter_chain" not in read_bytes(path, _MAX_BYTES):
                continue
        except OSError:
            continue
        chain = plain(read_yaml(path, str(path)).root).get("scan_filter_chain")
        if isinstance(chain, list):
            chains.append([entry for entry in chain if isinstance(entry, dict)])
    if not chains or any(chain != chains[0] for chain in chains) or len(lidars) != 1:
        return []
    for entry in chains[0]:
        lidars = [_bounded(lidar, str(entry.get("type", "")), entry.get("params") or {}) for lidar in lidars]
    return [replace(lidar, topic=FILTERED, filtered=True) for lidar in lidars]


def _bounded(lidar: DescribedLidar, kind: str, params: Any) -> DescribedLidar:
    """The lidar behind one filter."""
    if not isinstance(params, dict):
        return lidar

    def number(name: str, default: float) -> float:
        value = params.get(name, default)
        return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else default

    half = 0.5 * lidar.fov
    if kind.endswith("LaserScanAngularBoundsFilter"):
        low, high = max(number("lower_angle", -half), -half), min(number("upper_angle", half), half)
        if high > low:
            beams = max(1, round((lidar.beams - 1) * (high - low) / lidar.fov) + 1)
            yaw = math.remainder(lidar.yaw + 0.5 * (low + high), 2.0 * math.pi)
            return replace(lidar, fov=high - low, yaw=yaw, beams=beams)
    if kind.endswith("LaserScanRangeFilter"):
        low, high = number("lower_threshold", lidar.range_min), number("upper_threshold", lidar.range_max)
        low, high = max(low, lidar.range_min), min(high, lidar.range_max)
        return replace(lidar, range_min=low, range_max=high) if high > low else lidar
    return lidar
