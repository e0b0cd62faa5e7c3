"""The file of a run, `run.npz`, version 1.

A zip of `.npy` arrays and two JSON texts. numpy opens it without navstack (`allow_pickle=False` is enough):

    run = numpy.load("run.npz")
    table = pandas.DataFrame(run["samples"])                 # any table below, columns named
    events = pandas.read_json(io.BytesIO(run["events.jsonl"]), lines=True)
    meta = json.loads(run["meta.json"])

Metres, radians counter-clockwise, seconds of the run's own clock; never a wall clock, so that the same run gives the
same file byte for byte. "map" below is the global frame, "odom" the local frame, "base" the robot's own (their names:
`meta["frames"]`). Rows are in order of time. Little endian.

`meta.json`, one object:

    format            "navstack-run"
    version           1
    frames            {"global", "local", "base"}: names
    map               null or {"resolution" m, "origin_x" m, "origin_y" m, "origin_yaw" rad, "frame"}, see array `map`
    footprint         [[x, y], ..] m: the true outline, in base
    scenario          what the run was started with, as given to the recorder
    results           one object per goal, as given to the recorder
    critics           names of the columns of `local_plan_costs`
    local_plan_notes  {row of `local_plans`: [sentences]}
    costmaps          {name: frame}
    scan_sources      [[topic, frame], ..], see column `source` of `scans`

`events.jsonl`, one object per line: `{"time" s, "kind", "text", "data"}` as `navstack.core.Event`; those of kind
"feedback" are left out, since `samples` says the same.

Tables (structured arrays, one row per ..):

    samples       control cycle    t f8 s
                                   x, y, yaw f8             pose, map
                                   odom_x, odom_y, odom_yaw f8  odometry's pose, odom
                                   vx, vy, wz f8            odometry's velocity, base, m/s and rad/s
                                   map_to_odom_x, .._y, .._yaw f8  pose of odom in map
                                   cmd_vx, cmd_vy, cmd_wz f8  velocity commanded, base
                                   goal i4                  row of `goals`, -1 none
                                   state U                  state of the goal manager
    goals         goal accepted    t f8; x, y, yaw f8, map
    plans         global plan      t f8; first i8, count i8: rows of `plan_poses`; goal i4: row of `goals`; frame U
    local_plans   local plan       t f8; mode U; vx, vy, wz f8: the command, base;
                                   best i4: row of the winner among the cycle's samples, -1 none;
                                   first i8, count i8: rows of `local_plan_samples`, `.._costs`, `.._totals`,
                                   `.._rejected_by` (count is 0 where the table was not kept);
                                   tried i4, rejected i4: samples tried, and those that lost to a critic or a limit;
                                   first_pose i8, poses i8: rows of `local_plan_poses`
    collisions    collision          t f8; x, y, yaw f8, map
    scans         scan kept        t f8; x, y, yaw f8: the robot, map; angle_min, angle_increment f8 rad;
                                   range_min, range_max, height f8 m; source i4; first i8, count i8: rows of `scan_ranges`
    costmaps/<n>  update of the    t f8; nx, ny i4; resolution, origin_x, origin_y f8: the grid at that time;
                  costmap <n>      x0, y0, x1, y1 i4: the window of cells that follows (half open; empty: nothing changed);
                                   first i8: where its cells start in `costmaps/<n>_cells`, row by row.
                                   A window that is the whole grid starts afresh; others patch the state before.

Plain arrays:

    map                      (ny, nx) i1    100 occupied, 0 free, -1 unknown, [iy, ix]; absent without a map
    clearances               (n,) f8 m      a row per row of `samples`: from the true outline to the nearest obstacle, inf where
                                            there is none; absent where nobody knew (a real robot)
    solid_discs              (r, k, 3) f4   x, y, radius, map: what stands or moves beside the map. r is 1 where nothing moves;
    solid_corners            (r, m, 2) f4   else there is a row per row of `samples`. Corners x, y of p polygons, those of
    solid_first              (p + 1,) i8    polygon i from solid_first[i] on. All absent where there is nothing but the map
                                            and the scenario's `obstacles`
    plan_poses               (n, 3) f8      x, y, yaw in the plan's frame
    local_plan_samples       (n, 3) f4      velocities vx, vy, wz, m/s and rad/s
    local_plan_costs         (n, c) f4      raw cost per critic, NaN where it did not score
    local_plan_totals        (n,) f4        weighted sum, or the negative code of the rejection, NaN when never scored
    local_plan_rejected_by   (n,) i1        column of the critic that rejected it, -1 legal, -2 never a trajectory
    local_plan_scales        (m, c) f4      weights of the critics, a row per row of `local_plans`
    local_plan_poses         (n, 3) f4      the winner's trajectory, in the local costmap's frame
    scan_ranges              (n,) f4 m
    costmaps/<n>_cells       (n,) u1        costs
"""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import RecordError

FORMAT: Final = "navstack-run"
VERSION: Final = 1
RUN_FILE: Final = "run.npz"
LOG_FILE: Final = "run.log"
META: Final = "meta.json"
EVENTS: Final = "events.jsonl"

_POSE = [("x", "<f8"), ("y", "<f8"), ("yaw", "<f8")]

SAMPLE_COLUMNS: Final = (
    *("t", "x", "y", "yaw", "odom_x", "odom_y", "odom_yaw", "vx", "vy", "wz"),
    *("map_to_odom_x", "map_to_odom_y", "map_to_odom_yaw", "cmd_vx", "cmd_vy", "cmd_wz"),
)

TABLES: Final[dict[str, list[tuple[str, str]]]] = {
    "samples": [*((name, "<f8") for name in SAMPLE_COLUMNS), ("goal", "<i4"), ("state", "<U")],
    "goals": [("t", "<f8"), *_POSE],
    "plans": [("t", "<f8"), ("first", "<i8"), ("count", "<i8"), ("goal", "<i4"), ("frame", "<U")],
    "local_plans": [
        *[("t", "<f8"), ("mode", "<U"), ("vx", "<f8"), ("vy", "<f8"), ("wz", "<f8"), ("best", "<i4")],
        *[("first", "<i8"), ("count", "<i8"), ("tried", "<i4"), ("rejected", "<i4")],
        *[("first_pose", "<i8"), ("poses", "<i8")],
    ],
    "collisions": [("t", "<f8"), *_POSE],
    "scans": [
        *[("t", "<f8"), *_POSE, ("angle_min", "<f8"), ("angle_increment", "<f8"), ("range_min", "<f8")],
        *[("range_max", "<f8"), ("height", "<f8"), ("source", "<i4"), ("first", "<i8"), ("count", "<i8")],
    ],
}
"""Column names and types of the tables; `<U` stands for text as wide as the longest."""

COSTMAP_TABLE: Final[list[tuple[str, str]]] = [
    *[("t", "<f8"), ("nx", "<i4"), ("ny", "<i4"), ("resolution", "<f8"), ("origin_x", "<f8"), ("origin_y", "<f8")],
    *[("x0", "<i4"), ("y0", "<i4"), ("x1", "<i4"), ("y1", "<i4"), ("first", "<i8")],
]

ARRAYS: Final[dict[str, tuple[str, int]]] = {
    "plan_poses": ("<f8", 2),
    "local_plan_samples": ("<f4", 2),
    "local_plan_costs": ("<f4", 2),
    "local_plan_totals": ("<f4", 1),
    "local_plan_rejected_by": ("|i1", 1),
    "local_plan_scales": ("<f4", 2),
    "local_plan_poses": ("<f4", 2),
    "scan_ranges": ("<f4", 1),
}
"""dtype and number of dimensions of the plain arrays that every record holds."""


def table(columns: list[tuple[str, str]], data: dict[str, Any], rows: int) -> NDArray[np.void]:
    """A structured array of `rows` rows from columns by name; text columns become as wide as they need."""
    dtype: list[tuple[str, str]] = []
    for name, kind in columns:
        dtype.append((name, f"<U{max((len(s) for s in data[name]), default=0) or 1}" if kind == "<U" else kind))
    out = np.zeros(rows, dtype)
    if rows:
        for name, _ in columns:
            out[name] = data[name]
    return out


# --- writing ----------------------------------------------------------------------------------------------------------


def dump_json(value: Any) -> str:
    """JSON on one line, the same text for the same value."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def write(file: IO[bytes], meta: dict[str, Any], events: list[dict[str, Any]], arrays: dict[str, NDArray[Any]]) -> None:
    """Writes a record: the same content gives the same bytes (fixed order, no time stamps)."""
    with zipfile.ZipFile(file, "w") as archive:
        _add(archive, META, _encoded(dump_json(meta)))
        _add(archive, EVENTS, _encoded("".join(dump_json(event) + "\n" for event in events)))
        for name, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, array, version=(1, 0), allow_pickle=False)
            _add(archive, f"{name}.npy", buffer.getbuffer())


def _encoded(text: str) -> bytes:
    # a file name that is no UTF-8 holds lone surrogates: JSON spells them \\udcXX, and reads them back
    return text.encode("utf-8", "backslashreplace")


def _add(archive: zipfile.ZipFile, name: str, content: bytes | memoryview) -> None:
    info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    info.compress_type = zipfile.ZIP_DEFLATED
    info.create_system = 3
    info.external_attr = 0o644 << 16
    # Level 1: grids and tables of few values shrink tenfold already; higher levels cost more than the run itself.
    archive.writestr(info, content, compresslevel=1)


# --- reading ----------------------------------------------------------------------------------------------------------


def locate(path: Path) -> Path:
    """The record's file, given itself or its folder; RecordError when there is none."""
    if path.is_dir():
        inside = path / RUN_FILE
        if not inside.is_file():
            raise RecordError(
                f"there is no recorded run in {path}: it has no {RUN_FILE}; give the folder that `navstack simulate` wrote",
                path=str(path),
            )
        return inside
    if not path.exists():
        raise RecordError(
            f"there is no recorded run at {path}: no such file or folder; give the folder that `navstack simulate` wrote",
            path=str(path),
        )
    return path


def read(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, NDArray[Any]]]:
    """Meta, events and arrays of the record in the file `path`, each checked; RecordError says what is wrong."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if META not in names:
                raise RecordError(
                    f"{path} is not a recorded run: a zip without {META}; give the {RUN_FILE} of a run",
                    path=str(path),
                )
            meta = json.loads(archive.read(META))
            _check_version(path, meta)
            events = [json.loads(line) for line in archive.read(EVENTS).splitlines()]
            arrays: dict[str, NDArray[Any]] = {}
            for name in names:
                if name.endswith(".npy"):
                    member = io.BytesIO(archive.read(name))  # whole first: that is what checks its checksum
                    arrays[name[:-4]] = np.lib.format.read_array(member, allow_pickle=False)
                    if member.read(1):
                        raise ValueError(f"{name} goes on after its last cell")
        check(meta, events, arrays)
    except RecordError:
        raise
    except PermissionError as exc:
        raise RecordError(f"cannot read {path}: permission denied", path=str(path)) from exc
    except Exception as exc:
        # whatever zipfile, zlib, json, numpy and the checks have to say about bytes that are no record
        reason = " ".join(str(exc).split()) or type(exc).__name__
        raise RecordError(
            f"{path} is truncated, damaged or not a recorded run ({reason}); record the run again", path=str(path)
        ) from exc
    return meta, events, arrays


def _check_version(path: Path, meta: Any) -> None:
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        raise RecordError(f"{path} is not a recorded run of navstack; give the {RUN_FILE} of a run", path=str(path))
    version = meta.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise RecordError(f"{path} has no valid format version: {version!r}", path=str(path))
    if version > VERSION:
        raise RecordError(
            f"{path} has format version {version}, this navstack reads up to {VERSION}; update navstack",
            path=str(path),
            version=version,
        )


def check(meta: dict[str, Any], events: list[dict[str, Any]], arrays: dict[str, NDArray[Any]]) -> None:
    """Raises ValueError or KeyError unless everything the reader relies on holds."""
    _check_meta(meta)
    for name, columns in TABLES.items():
        _check_table(name, arrays[name], columns)
    for name, (dtype, ndim) in ARRAYS.items():
        array = arrays[name]
        if array.dtype != np.dtype(dtype) or array.ndim != ndim:
            raise ValueError(f"{name} is {array.dtype} of {array.ndim} dimensions")
    clearances = arrays.get("clearances")
    if clearances is not None and (
        clearances.dtype != np.dtype("<f8") or clearances.shape != (len(arrays["samples"]),)
    ):
        raise ValueError("clearances has not one row per sample")
    if "solid_discs" in arrays:
        _check_solids(arrays)
    for name in ("plan_poses", "local_plan_samples", "local_plan_poses"):
        if arrays[name].shape[1] != 3:
            raise ValueError(f"{name} has shape {arrays[name].shape}")
    critics = len(meta["critics"])
    if arrays["local_plan_costs"].shape[1] != critics:
        raise ValueError("local_plan_costs has not one column per critic")
    if arrays["local_plan_scales"].shape != (len(arrays["local_plans"]), critics):
        raise ValueError("local_plan_scales has not one row per local plan")
    scored = len(arrays["local_plan_samples"])
    if any(len(arrays[f"local_plan_{name}"]) != scored for name in ("costs", "totals", "rejected_by")):
        raise ValueError("the tables of samples differ in length")
    _check_slices("plans", arrays["plans"]["first"], arrays["plans"]["count"], len(arrays["plan_poses"]))
    plans = arrays["local_plans"]
    _check_slices("local_plans", plans["first"], plans["count"], scored)
    _check_slices("local_plans", plans["first_pose"], plans["poses"], len(arrays["local_plan_poses"]))
    scans = arrays["scans"]
    _check_slices("scans", scans["first"], scans["count"], len(arrays["scan_ranges"]))
    if len(scans) and not (scans["source"].min() >= 0 and scans["source"].max() < len(meta["scan_sources"])):
        raise ValueError("scans name a source that is not listed")
    for name in meta["costmaps"]:
        _check_costmap(name, arrays[f"costmaps/{name}"], arrays[f"costmaps/{name}_cells"])
    if meta["map"] is not None:
        cells = arrays["map"]
        if cells.dtype != np.int8 or cells.ndim != 2:
            raise ValueError(f"map is {cells.dtype} of {cells.ndim} dimensions")
    for event in events:
        if not (isinstance(event["data"], dict) and isinstance(event["kind"], str) and isinstance(event["text"], str)):
            raise ValueError("an event is not an event")
        float(event["time"])


def _check_solids(arrays: dict[str, NDArray[Any]]) -> None:
    discs, corners, first = (arrays[f"solid_{name}"] for name in ("discs", "corners", "first"))
    if discs.dtype != np.dtype("<f4") or discs.ndim != 3 or discs.shape[2] != 3:
        raise ValueError(f"solid_discs is {discs.dtype} of shape {discs.shape}")
    if corners.dtype != np.dtype("<f4") or corners.ndim != 3 or corners.shape[2] != 2:
        raise ValueError(f"solid_corners is {corners.dtype} of shape {corners.shape}")
    if len(discs) != len(corners) or len(discs) not in (1, len(arrays["samples"])):
        raise ValueError("the solids have neither one row nor one per sample")
    if (
        first.dtype != np.dtype("<i8")
        or first.ndim != 1
        or not len(first)
        or first[0] != 0
        or first[-1] != corners.shape[1]
        or (np.diff(first) < 0).any()
    ):
        raise ValueError("solid_first does not divide solid_corners")


def _check_meta(meta: dict[str, Any]) -> None:
    def check_type(key: str, value: Any, *types: Any) -> None:
        if not isinstance(value, types):
            raise ValueError(f"{key} in {META} is of type {type(value).__name__}")

    for key, kind in _META_TYPES.items():
        check_type(key, meta[key], kind)
    for key in ("global", "local", "base"):
        check_type(f"frames.{key}", meta["frames"][key], str)
    if meta["map"] is not None:
        for key in ("resolution", "origin_x", "origin_y", "origin_yaw"):
            check_type(f"map.{key}", meta["map"][key], int, float)
        check_type("map.frame", meta["map"]["frame"], str)
    for result in meta["results"]:
        check_type("results", result, dict)
    for name in meta["critics"]:
        check_type("critics", name, str)
    for notes in meta["local_plan_notes"].values():
        check_type("local_plan_notes", notes, list)
    for frame in meta["costmaps"].values():
        check_type("costmaps", frame, str)
    for source in meta["scan_sources"]:
        topic, frame = source
        check_type("scan_sources", topic, str)
        check_type("scan_sources", frame, str)


_META_TYPES: Final[dict[str, Any]] = {
    "frames": dict,
    "map": (dict, type(None)),
    "footprint": list,
    "scenario": dict,
    "results": list,
    "critics": list,
    "local_plan_notes": dict,
    "costmaps": dict,
    "scan_sources": list,
}


def _check_table(name: str, array: NDArray[Any], columns: list[tuple[str, str]]) -> None:
    if array.ndim != 1 or array.dtype.names != tuple(column for column, _ in columns):
        raise ValueError(f"{name} has not the columns of version {VERSION}")
    for column, kind in columns:
        if array.dtype[column].kind != "U" if kind == "<U" else array.dtype[column] != np.dtype(kind):
            raise ValueError(f"{name}.{column} is {array.dtype[column]}, not {kind}")


def _check_slices(name: str, first: NDArray[np.int64], count: NDArray[np.int64], total: int) -> None:
    if ((first < 0) | (count < 0) | (first > total) | (count > total - first)).any():
        raise ValueError(f"{name} points outside its rows")


def _check_costmap(name: str, updates: NDArray[Any], cells: NDArray[Any]) -> None:
    _check_table(f"costmaps/{name}", updates, COSTMAP_TABLE)
    if cells.dtype != np.uint8 or cells.ndim != 1:
        raise ValueError(f"costmaps/{name}_cells is {cells.dtype} of {cells.ndim} dimensions")
    if not len(updates):
        return
    wide = {column: updates[column].astype(np.int64) for column in ("nx", "ny", "x0", "y0", "x1", "y1")}
    inside = (
        (wide["nx"] > 0)
        & (wide["ny"] > 0)
        & (wide["x0"] >= 0)
        & (wide["y0"] >= 0)
        & (wide["x1"] >= wide["x0"])
        & (wide["y1"] >= wide["y0"])
        & (wide["x1"] <= wide["nx"])
        & (wide["y1"] <= wide["ny"])
    )
    positive = np.isfinite(updates["resolution"]) & (updates["resolution"] > 0.0)
    if not (inside & positive).all():
        raise ValueError(f"costmaps/{name} has a window outside its grid")
    count = (wide["x1"] - wide["x0"]) * (wide["y1"] - wide["y0"])
    _check_slices(f"costmaps/{name}", updates["first"], count, len(cells))
    whole = count == wide["nx"] * wide["ny"]
    same = np.ones(len(updates), bool)
    for column in ("nx", "ny", "resolution", "origin_x", "origin_y"):
        same[1:] &= updates[column][1:] == updates[column][:-1]
    same[0] = False
    if not (whole | same).all():
        raise ValueError(f"costmaps/{name} patches a grid that was never whole")
