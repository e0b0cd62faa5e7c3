"""Primitive files in the format of Nav2's state lattice planner: read, checked and written."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, ensure_directory, write_text
from navstack.global_planner._lattice import (
    ARC,
    IN_PLACE,
    LINE,
    MOTION_MODELS,
    SLIDE,
    Lattice,
    MotionModel,
    Piece,
    Primitive,
    connect,
    connection_pieces,
    sample,
    scaled,
    wrapped,
)

# ----------------------------------------------------------------------------------------------------------------------
# Where a value is in JSON text: for messages about values that parse but are wrong.


_SPACE: Final = re.compile(r"[ \t\r\n]*")
_DECODER: Final = json.JSONDecoder()


def line_of(text: str, path: Sequence[str | int]) -> int:
    """Return the line (from 1) of the value at `path` (keys and indices), or of the deepest value on the way there.

    `text` must be valid JSON.
    """
    at = _skip(text, 0)
    for step in path:
        found = _child(text, at, step)
        if found is None:
            break
        at = found
    return text.count("\n", 0, at) + 1


def _skip(text: str, at: int) -> int:
    match = _SPACE.match(text, at)
    assert match is not None
    return match.end()


def _child(text: str, at: int, step: str | int) -> int | None:
    """Position of a child of the object or array at `at`."""
    if text[at] not in "{[" or (text[at] == "{") != isinstance(step, str):
        return None
    is_object = text[at] == "{"
    at = _skip(text, at + 1)
    index = 0
    found: int | None = None
    while text[at] not in "}]":
        key: str | int = index
        if is_object:
            key, at = _DECODER.raw_decode(text, at)
            at = _skip(text, _skip(text, at) + 1)
        if key == step:
            found = at  # the last of equal keys counts, as in json
            if not is_object:
                return found
        _, at = _DECODER.raw_decode(text, at)
        at = _skip(text, at)
        if text[at] == ",":
            at = _skip(text, at + 1)
        index += 1
    return found


_MAX_BYTES: Final = 64 << 20
_MAX_HEADINGS: Final = 360
_MAX_PRIMITIVES: Final = 20_000
_ON_CURVE_M: Final = 5e-4
"""A primitive is a line, an arc and a line if its poses are that close to them; the files have 5 decimals."""
_OFF_ARC: Final = 0.05
"""Radians: largest deviation of a step from the mean of the headings at its ends."""
Where = tuple[str | int, ...]


class _File:
    """A primitive file that is being read; its errors have the line of the value."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            if path.stat().st_size > _MAX_BYTES:
                self.fail((), f"the file is larger than {_MAX_BYTES >> 20} MB; a primitive file has up to a few MB")
            self.text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
            raise InputError(
                f"cannot read the primitive file {path}: {reason}; `navstack lattice generate` writes one",
                path=str(path),
            ) from None
        try:
            self.content: Any = json.loads(self.text)
        except (json.JSONDecodeError, RecursionError) as error:
            line = error.lineno if isinstance(error, json.JSONDecodeError) else 1
            what = error.msg if isinstance(error, json.JSONDecodeError) else "nested too deeply"
            raise InputError(f"{path}:{line}: not valid JSON: {what}", path=str(path), line=line) from None

    def fail(self, where: Where, message: str) -> NoReturn:
        line = line_of(self.text, where) if where else 1
        name = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in where).lstrip(".")
        prefix = f"{name}: " if name else ""
        raise InputError(f"{self.path}:{line}: {prefix}{message}", path=str(self.path), line=line, key=name)

    def item(self, parent: Any, where: Where, key: str) -> Any:
        if not isinstance(parent, dict):
            self.fail(where, f"expected an object with the key {key}")
        if key not in parent:
            self.fail(where, f"the key {key} is missing")
        return parent[key]

    def number(self, parent: Any, where: Where, key: str, *, least: float, most: float) -> float:
        value = self.item(parent, where, key)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= most:
            self.fail((*where, key), f"expected a number from {least:g} to {most:g}, not {_short(value)}")
        return float(value)

    def integer(self, parent: Any, where: Where, key: str, *, least: int, most: int) -> int:
        value = self.item(parent, where, key)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            self.fail((*where, key), f"expected an integer from {least} to {most}, not {_short(value)}")
        return value


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def read_lattice(path: str | Path) -> Lattice:
    """Read a primitive file.

    Raises InputError, with file and line, for a file that cannot be read, that lacks a key, whose values are out of range or
    contradict each other, or whose poses are not on arcs and lines.
    """
    file = _File(Path(path))
    meta = file.item(file.content, (), "lattice_metadata")
    at: Where = ("lattice_metadata",)
    model = file.item(meta, at, "motion_model")
    if model not in MOTION_MODELS:
        file.fail((*at, "motion_model"), f"expected one of {', '.join(MOTION_MODELS)}, not {_short(model)}")
    radius = file.number(meta, at, "turning_radius", least=0.0, most=1e4)
    resolution = file.number(meta, at, "grid_resolution", least=1e-4, most=100.0)
    headings = _headings(file, meta, at)
    rows = file.item(file.content, (), "primitives")
    if not isinstance(rows, list) or not rows or len(rows) > _MAX_PRIMITIVES:
        file.fail(("primitives",), f"expected a list of 1 to {_MAX_PRIMITIVES} primitives")
    count = file.integer(meta, at, "number_of_trajectories", least=1, most=_MAX_PRIMITIVES)
    if count != len(rows):
        file.fail((*at, "number_of_trajectories"), f"it is {count}, but the file has {len(rows)} primitives")
    reader = _Primitives(file, model, radius, resolution, headings)
    primitives = sorted((reader.read(row, i) for i, row in enumerate(rows)), key=lambda p: p.start)
    missing = sorted(set(range(len(headings))) - {p.start for p in primitives})
    if missing:
        file.fail(("primitives",), f"no primitive starts at the headings {', '.join(map(str, missing[:8]))}")
    ratio = meta.get("trajectory_distinctness_ratio")
    threshold = meta.get("stopping_threshold")
    return Lattice(
        model,
        radius,
        resolution,
        headings,
        tuple(primitives),
        threshold if isinstance(threshold, int) else None,
        float(ratio) if isinstance(ratio, (int, float)) else None,
        str(path),
    )


def _headings(file: _File, meta: Any, at: Where) -> NDArray[np.float64]:
    values = file.item(meta, at, "heading_angles")
    where = (*at, "heading_angles")
    if not isinstance(values, list) or not all(
        isinstance(v, (int, float)) and not isinstance(v, bool) and 0.0 <= v < 2.0 * math.pi for v in values
    ):
        file.fail(where, "expected a list of angles from 0 to below 2 pi")
    count = file.integer(meta, at, "num_of_headings", least=4, most=_MAX_HEADINGS)
    if count != len(values):
        file.fail(where, f"num_of_headings is {count}, but there are {len(values)} angles")
    headings = np.array(values, np.float64)
    if (np.diff(headings) <= 1e-6).any():
        k = int(np.argmax(np.diff(headings) <= 1e-6)) + 1
        file.fail((*where, k), "the angles must be ascending")
    return headings


class _Primitives:
    """Reads the primitives of a file."""

    def __init__(
        self, file: _File, model: MotionModel, radius: float, resolution: float, headings: NDArray[np.float64]
    ) -> None:
        self.file, self.model = file, model
        self.radius, self.resolution, self.headings = radius, resolution, headings

    def read(self, row: Any, i: int) -> Primitive:
        """Read primitive number `i`."""
        file, where = self.file, ("primitives", i)
        most = len(self.headings) - 1
        start = file.integer(row, where, "start_angle_index", least=0, most=most)
        end = file.integer(row, where, "end_angle_index", least=0, most=most)
        left = file.item(row, where, "left_turn")
        if not isinstance(left, bool):
            file.fail((*where, "left_turn"), f"expected true or false, not {_short(left)}")
        radius = file.number(row, where, "trajectory_radius", least=0.0, most=1e9)
        arc, straight, total = (
            file.number(row, where, key, least=0.0, most=1e6)
            for key in ("arc_length", "straight_length", "trajectory_length")
        )
        poses = self._poses(row, where)
        pieces = self._pieces(poses, start, end, where)
        turned = wrapped(poses[-1, 2] - self.headings[end])
        if abs(float(turned)) > 1e-3:
            file.fail(
                (*where, "poses"), f"the last yaw is {poses[-1, 2]:.5f}, but heading {end} is {self.headings[end]:.5f}"
            )
        length = sum(p.size for p in pieces if p.kind != IN_PLACE)
        if length > 0.0 and abs(total - length) > 0.05 * length + 1e-3 and not any(p.kind == SLIDE for p in pieces):
            file.fail((*where, "trajectory_length"), f"it is {total:g} m, but the poses are {length:.5f} m long")
        del arc, straight
        arc = sum(p.size for p in pieces if p.kind == ARC)
        return Primitive(start, end, left, radius, arc, length - arc, poses, tuple(pieces))

    def _poses(self, row: Any, where: Where) -> NDArray[np.float64]:
        values = self.file.item(row, where, "poses")
        if not isinstance(values, list) or not values:
            self.file.fail((*where, "poses"), "expected a list of poses [x, y, yaw]")
        for k, value in enumerate(values):
            good = isinstance(value, list) and len(value) == 3
            if not good or not all(isinstance(v, (int, float)) and math.isfinite(v) and abs(v) < 1e6 for v in value):
                self.file.fail((*where, "poses", k), f"expected a pose [x, y, yaw], not {_short(value)}")
        poses = np.array(values, np.float64)
        cells = poses[-1, :2] / self.resolution
        if np.abs(cells - np.round(cells)).max() > 0.01:
            self.file.fail(
                (*where, "poses", len(values) - 1),
                f"the primitive ends at ({poses[-1, 0]:g}, {poses[-1, 1]:g}) m, which is no whole number of cells of "
                f"{self.resolution:g} m",
            )
        return poses

    def _pieces(self, poses: NDArray[np.float64], start: int, end: int, where: Where) -> list[Piece]:
        a, b = float(self.headings[start]), float(self.headings[end])
        if np.hypot(poses[:, 0], poses[:, 1]).max() < 1e-4:
            if self.model == "ackermann":
                self.file.fail((*where, "poses"), "a turn in place, which motion_model ackermann cannot do")
            return [Piece(IN_PLACE, float(wrapped(b - a)))]
        direction = math.atan2(poses[-1, 1], poses[-1, 0])
        turned = np.abs(wrapped(poses[:, 2] - a)).max()
        off = abs(float(wrapped(direction - a)))
        if turned < 1e-4 and min(off, math.pi - off) > 1e-3:
            if self.model != "omni":
                self.file.fail((*where, "poses"), f"a slide to the side, which motion_model {self.model} cannot do")
            return [Piece(SLIDE, float(np.hypot(*poses[-1, :2])), 0.0, float(wrapped(direction - a)))]
        grid = np.round(poses[-1:, :2] / self.resolution)  # cells, as in the generation: the same bits
        links = connect(grid[:, 0], grid[:, 1], a, np.array([b]), 0.0)
        if not np.isnan(links.length[0]):
            pieces = list(scaled(connection_pieces(links, 0), self.resolution))
            near = sample(pieces, a, len(poses))
            if np.abs(near[:, :2] - poses[:, :2]).max() < _ON_CURVE_M:
                self._check_radius(float(links.radius[0]) * self.resolution, where)
                return pieces
        return self._arcs(poses, a, where)

    def _arcs(self, poses: NDArray[np.float64], start: float, where: Where) -> list[Piece]:
        """The arc between each pose and the next."""
        previous = np.array([0.0, 0.0, start])
        pieces: list[Piece] = []
        for k, pose in enumerate(poses):
            chord = float(np.hypot(*(pose[:2] - previous[:2])))
            turn = float(wrapped(pose[2] - previous[2]))
            if chord < 1e-6 and abs(turn) < 1e-6:
                continue
            course = math.atan2(pose[1] - previous[1], pose[0] - previous[0])
            off = abs(float(wrapped(course - previous[2] - 0.5 * turn)))
            if chord < 1e-6 or off > _OFF_ARC:
                self.file.fail(
                    (*where, "poses", k),
                    f"the step to this pose deviates by {math.degrees(off):.1f} degrees from the headings at its ends: it is "
                    "neither an arc, nor a line driven forward",
                )
            curvature = 2.0 * math.sin(0.5 * turn) / chord
            if abs(curvature) > 1e-6:
                self._check_radius(1.0 / abs(curvature), (*where, "poses", k))
                pieces.append(Piece(ARC, abs(turn / curvature), curvature))
            else:
                pieces.append(Piece(LINE, chord))
            previous = pose
        return pieces

    def _check_radius(self, radius: float, where: Where) -> None:
        if 0.0 < radius < 0.98 * self.radius:
            self.file.fail(where, f"an arc of radius {radius:.4f} m, which is below turning_radius {self.radius:g} m")


def write_lattice(lattice: Lattice, path: str | Path) -> Path:
    """Write a primitive file that Nav2 reads, too; raises OutputError if it cannot be written."""
    metadata = {
        "motion_model": lattice.motion_model,
        "turning_radius": lattice.turning_radius,
        "grid_resolution": lattice.resolution,
        "stopping_threshold": lattice.stopping_threshold,
        "num_of_headings": len(lattice.headings),
        "trajectory_distinctness_ratio": lattice.distinctness_ratio,
        "heading_angles": lattice.headings.tolist(),
        "number_of_trajectories": len(lattice.primitives),
    }
    content = {
        "version": 1.0,
        "date_generated": date.today().isoformat(),
        "lattice_metadata": {k: v for k, v in metadata.items() if v is not None},
        "primitives": [_row(p, i) for i, p in enumerate(lattice.primitives)],
    }
    target = Path(path)
    ensure_directory(target.parent)
    write_text(target, json.dumps(content, indent="\t") + "\n")
    return target


def _row(p: Primitive, number: int) -> dict[str, Any]:
    return {
        "trajectory_id": number,
        "start_angle_index": p.start,
        "end_angle_index": p.end,
        "left_turn": p.left_turn,
        "trajectory_radius": round(p.radius, 5),
        "trajectory_length": round(p.length, 5),
        "arc_length": round(p.arc_length, 5),
        "straight_length": round(p.straight_length, 5),
        "poses": [[round(float(x), 5), round(float(y), 5), float(yaw)] for x, y, yaw in p.poses],
    }
