"""Trajectories in files: YAML or JSON of the shape of trajectory_msgs/MultiDOFJointTrajectory, and CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from navstack.core.bounded_reading import read_bytes, short_repr
from navstack.core.files import atomic_write
from navstack.motion.errors import InvalidTrajectoryError
from navstack.motion.trajectory import FloatArray, Trajectory

MAX_BYTES: Final = 20_000_000
"""Largest file that is read."""
MAX_SAMPLES: Final = 200_000
JOINT: Final = "robot_link"
"""Name of the joint, as in the ROS tutorial node."""
COLUMNS: Final = ("t", "x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az")
"""Columns of a CSV file; t, x and y are required."""


# --- message ----------------------------------------------------------------------------------------------------------


def as_message(trajectory: Trajectory) -> dict[str, Any]:
    """Return a mapping with the fields of a MultiDOFJointTrajectory: one joint, rotations identity, as the ROS tutorial sends."""
    points: list[dict[str, Any]] = []
    for t, p, v, a in zip(trajectory.t, trajectory.position, trajectory.velocity, trajectory.acceleration):
        seconds, nanoseconds = divmod(round(float(t) * 1e9), 1_000_000_000)
        points.append(
            {
                "transforms": [{"translation": _xyz(p), "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}],
                "velocities": [{"linear": _xyz(v), "angular": _xyz(np.zeros(3))}],
                "accelerations": [{"linear": _xyz(a), "angular": _xyz(np.zeros(3))}],
                "time_from_start": {"secs": seconds, "nsecs": nanoseconds},
            }
        )
    header = {"seq": 0, "stamp": {"secs": 0, "nsecs": 0}, "frame_id": trajectory.frame}
    return {"header": header, "joint_names": [JOINT], "points": points}


def from_message(message: Any, name: str = "") -> Trajectory:
    """Return the trajectory of a mapping with the fields of a MultiDOFJointTrajectory; its first joint counts.

    Times are `{secs, nsecs}` (ROS 1), `{sec, nanosec}` (ROS 2) or seconds; the first one becomes 0. Missing velocities are those
    of a cubic spline through the positions. Raises InvalidTrajectoryError.
    """
    if not isinstance(message, Mapping) or not isinstance(message.get("points"), list):
        raise InvalidTrajectoryError("a trajectory is a mapping with a list `points` (MultiDOFJointTrajectory)")
    points: list[Any] = message["points"]
    if not 2 <= len(points) <= MAX_SAMPLES:
        raise InvalidTrajectoryError(f"a trajectory has 2 to {MAX_SAMPLES} points, not {len(points)}")
    header = message.get("header")
    frame = str(header.get("frame_id") or "map") if isinstance(header, Mapping) else "map"
    rows = [_point(point, k) for k, point in enumerate(points)]
    t = np.array([row[0] for row in rows])
    given = [[row[i] for row in rows] for i in (1, 2, 3)]
    velocity, acceleration = (None if None in column else np.array(column) for column in given[1:])
    return from_arrays(t, np.array(given[0]), velocity, acceleration, frame=frame, name=name)


def from_arrays(
    t: FloatArray,
    position: FloatArray,
    velocity: FloatArray | None = None,
    acceleration: FloatArray | None = None,
    *,
    frame: str = "map",
    name: str = "",
) -> Trajectory:
    """Return a trajectory from times (n,) s and positions (n, 2 or 3) m; the first time becomes 0.

    Missing velocities and accelerations are those of a cubic spline through the positions (velocities, if given). Raises
    InvalidTrajectoryError.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    if position.ndim != 2 or len(t) < 2 or len(position) != len(t) or not (np.diff(t) > 0.0).all():
        bad = int(np.argmin(np.diff(t) > 0.0)) + 1 if len(t) > 1 else 0
        raise InvalidTrajectoryError(f"the times of a trajectory must increase; sample {bad + 1} does not", sample=bad)
    if not (np.isfinite(t).all() and np.isfinite(position).all()):
        raise InvalidTrajectoryError("the times and positions of a trajectory must be finite")
    arrays = [None if a is None else _three_columns(a) for a in (position, velocity, acceleration)]
    p, v, a = arrays
    assert p is not None
    t = t - t[0]
    if v is None:
        spline = CubicSpline(t, p, bc_type="natural" if len(t) > 2 else "clamped") if len(t) > 2 else None
        v = np.asarray(spline(t, 1)) if spline is not None else np.repeat((p[1:] - p[:1]) / t[1], 2, axis=0)
    if a is None:
        a = np.asarray(CubicHermiteSpline(t, p, v)(t, 2))
    return Trajectory(t, p, v, a, frame, name)


# --- files ------------------------------------------------------------------------------------------------------------


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory: .csv with a header (t, x, y; z, vx .. az if known), YAML or JSON of a MultiDOFJointTrajectory.

    Raises InvalidTrajectoryError, whose message begins with the file.
    """
    file = Path(path)
    try:
        text = read_bytes(file, MAX_BYTES).decode("utf-8")
    except OSError as exc:
        raise InvalidTrajectoryError(f"cannot read {file}: {exc.strerror or exc}", path=str(file)) from exc
    except UnicodeDecodeError as exc:
        raise InvalidTrajectoryError(f"{file} is not a text file (UTF-8)", path=str(file)) from exc
    try:
        if file.suffix.lower() == ".csv":
            return _from_csv(text, file.stem)
        return from_message(_parsed(text, file.suffix.lower()), file.stem)
    except InvalidTrajectoryError as exc:
        raise InvalidTrajectoryError(f"{file}: {exc.message}", **exc.data, path=str(file)) from exc


def save_trajectory(trajectory: Trajectory, path: str | Path) -> Path:
    """Write a trajectory to .csv, .json, .yaml or .yml, atomically; return the file.

    Raises OutputError, and InvalidTrajectoryError for another suffix.
    """
    file = Path(path)
    kind = file.suffix.lower()
    if kind == ".csv":
        out = io.StringIO()
        rows = np.column_stack((trajectory.t, trajectory.position, trajectory.velocity, trajectory.acceleration))
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(rows.tolist())
        text = out.getvalue()
    elif kind == ".json":
        text = json.dumps(as_message(trajectory), allow_nan=False) + "\n"
    elif kind in (".yaml", ".yml"):
        text = yaml.dump(as_message(trajectory), Dumper=yaml.SafeDumper, sort_keys=False, default_flow_style=None)
    else:
        raise InvalidTrajectoryError(f'cannot write a trajectory to "{file.name}"; use .yaml, .json or .csv')
    with atomic_write(file) as beside:
        beside.write_text(text, encoding="utf-8")
    return file


def _parsed(text: str, suffix: str) -> Any:
    try:
        if suffix == ".json":
            return json.loads(text)
        loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        return yaml.load(text, Loader=loader)
    except (yaml.YAMLError, ValueError, RecursionError) as exc:
        reason = " ".join(str(exc).split())[:200]
        raise InvalidTrajectoryError(f"neither YAML nor JSON ({reason})") from exc


def _from_csv(text: str, name: str) -> Trajectory:
    rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].lstrip().startswith("#")]
    header = [cell.strip() for cell in rows[0]] if rows else []
    unknown = [cell for cell in header if cell not in COLUMNS]
    if unknown or not {"t", "x", "y"} <= set(header) or len(set(header)) != len(header):
        raise InvalidTrajectoryError(
            f"the first line {short_repr(header)} is not a header of columns {', '.join(COLUMNS)} (t, x, y are required)"
        )
    if len(rows) - 1 > MAX_SAMPLES:
        raise InvalidTrajectoryError(f"more than {MAX_SAMPLES} samples")
    values: list[list[float]] = []
    for number, row in enumerate(rows[1:], 2):
        try:
            values.append([float(cell) for cell in row])
        except ValueError:
            raise InvalidTrajectoryError(f"row {number}: {short_repr(row)} are not numbers", row=number) from None
        if len(row) != len(header):
            raise InvalidTrajectoryError(f"row {number} has {len(row)} numbers instead of {len(header)}", row=number)
    table = np.array(values, np.float64).reshape(-1, len(header))
    columns = dict(zip(header, table.T))

    def triple(first: str, *others: str) -> FloatArray | None:
        if first not in columns:
            return None
        return np.column_stack([columns.get(key, np.zeros(len(table))) for key in (first, *others)])

    position = triple("x", "y", "z")
    assert position is not None
    return from_arrays(
        columns["t"], position, triple("vx", "vy", "vz"), triple("ax", "ay", "az"), frame="map", name=name
    )


# --- fields -----------------------------------------------------------------------------------------------------------


def _xyz(vector: FloatArray) -> dict[str, float]:
    return dict(zip("xyz", (float(v) for v in vector)))


def _point(point: Any, number: int) -> tuple[float, list[float], list[float] | None, list[float] | None]:
    """Return time, position, velocity and acceleration of the first joint of a point; None for what is missing."""
    where = f"points[{number}]"
    if not isinstance(point, Mapping):
        raise InvalidTrajectoryError(f"{where} is {short_repr(point)}, not a mapping", point=number)
    transform = _first(point, "transforms", where)
    if transform is None:
        raise InvalidTrajectoryError(f"{where} has no transforms", point=number)
    position = _vector(transform.get("translation"), f"{where}.transforms[0].translation")
    found: list[list[float] | None] = []
    for key in ("velocities", "accelerations"):
        entry = _first(point, key, where)
        found.append(None if entry is None else _vector(entry.get("linear"), f"{where}.{key}[0].linear"))
    return _seconds(point.get("time_from_start"), where), position, found[0], found[1]


def _first(point: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any] | None:
    entries = point.get(key)
    if entries is None or entries == []:
        return None
    if not isinstance(entries, list) or not isinstance(entries[0], Mapping):
        raise InvalidTrajectoryError(f"{where}.{key} is {short_repr(entries)}, not a list of mappings")
    return entries[0]


def _vector(value: Any, where: str) -> list[float]:
    if not isinstance(value, Mapping):
        raise InvalidTrajectoryError(f"{where} is {short_repr(value)}, not {{x, y, z}}")
    return [_number(value.get(axis, 0.0), f"{where}.{axis}") for axis in "xyz"]


def _seconds(value: Any, where: str) -> float:
    if isinstance(value, Mapping):
        for whole, part in (("secs", "nsecs"), ("sec", "nanosec")):
            if whole in value:
                seconds = _number(value[whole], f"{where}.time_from_start.{whole}")
                return seconds + 1e-9 * _number(value.get(part, 0), f"{where}.time_from_start.{part}")
    return _number(value, f"{where}.time_from_start")


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e12:
        raise InvalidTrajectoryError(f"{where} is {short_repr(value)}, not a finite number")
    return float(value)


def _three_columns(array: FloatArray) -> FloatArray:
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise InvalidTrajectoryError(f"an array of a trajectory has the shape {array.shape}, not (n, 2) or (n, 3)")
    return np.column_stack((array, np.zeros(len(array)))) if array.shape[1] == 2 else array
