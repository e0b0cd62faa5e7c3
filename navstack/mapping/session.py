"""The file of a mapping: everything to go on with it, to draw its map again, and to explain it."""

from __future__ import annotations

import json
import zipfile
import zlib
from array import array
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from navstack.core import LogError, Transform2D, atomic_write, jsonable, read_arrays
from navstack.mapping.loops import Loop
from navstack.mapping.mapper import Lost, Mapper, Observations, Step
from navstack.mapping.params import MapperParams
from navstack.mapping.pose_graph import Edge

FORMAT: Final = 4
MAX_BYTES: Final = 4_000_000_000
_ARRAYS: Final = ("ranges", "lengths", "poses", "unfinished", "edges", "information", "track", "document")


def save_session(mapper: Mapper, path: str | Path) -> Path:
    """Write a mapping, finished or not; `load_session` returns one that goes on with the same bits."""
    store, edges, unfinished = mapper.keyframes, mapper.graph.edges, mapper.unfinished
    document = {
        "format": FORMAT,
        "params": mapper.params.model_dump(mode="json"),
        "stamps": store.stamps,
        "setups": store.setups,
        "known_setups": store.known_setups,
        "loops": [asdict(loop) for loop in mapper.loops],
        "pending": [asdict(loop) for loop in (unfinished or mapper).pending],
        "steps": [step._asdict() for step in mapper.steps],
        "observations": asdict(mapper.observations),
        "state": mapper.state(),
    }
    arrays = {
        "ranges": np.concatenate(store.ranges) if store.ranges else np.empty(0, np.uint16),
        "lengths": np.array([len(ranges) for ranges in store.ranges], np.int64),
        "poses": mapper.graph.poses,
        "unfinished": np.empty((0, 3)) if unfinished is None else unfinished.poses,
        "edges": np.array([(e.i, e.j, *e.measured, e.is_loop) for e in edges], np.float64).reshape(-1, 6),
        "information": np.array([e.information for e in edges], np.float64).reshape(-1, 3, 3),
        "track": np.array(mapper.track),
        "document": np.frombuffer(json.dumps(jsonable(document)).encode(), np.uint8),
    }
    with atomic_write(Path(path)) as out, out.open("wb") as file:
        savez: Any = np.savez_compressed
        savez(file, **arrays)
    return Path(path)


def load_session(path: str | Path) -> Mapper:
    """Read a mapping. Raises LogError for a file that is none, or of another version."""
    try:
        arrays = read_arrays(Path(path), _ARRAYS, MAX_BYTES)
        document = json.loads(arrays["document"].tobytes())
        if document["format"] != FORMAT:
            raise LogError(f"{path} is of format {document['format']}, not {FORMAT}; make the map again from its log")
        return _restored(arrays, document)
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        IndexError,
        zipfile.BadZipFile,
        zlib.error,
        ValidationError,
    ) as exc:
        why = exc.strerror if isinstance(exc, OSError) and exc.strerror else f"it is no file of a mapping ({exc})"
        raise LogError(
            f"cannot read {path}: {why}; `navstack map build` writes one next to its map", file=str(path)
        ) from exc


def _restored(arrays: Any, document: dict[str, Any]) -> Mapper:
    mapper = Mapper(MapperParams.model_validate(document["params"]))
    store = mapper.keyframes
    store.ranges = np.split(arrays["ranges"], np.cumsum(arrays["lengths"])[:-1]) if len(arrays["lengths"]) else []
    store.stamps, store.setups = document["stamps"], document["setups"]
    store.known_setups = [tuple(setup) for setup in document["known_setups"]]
    edges = [
        Edge(int(i), int(j), Transform2D(x, y, yaw), information, bool(loop))
        for (i, j, x, y, yaw, loop), information in zip(arrays["edges"].tolist(), arrays["information"], strict=True)
    ]
    mapper.loops = [_loop(each) for each in document["loops"]]
    mapper.pending = [_loop(each) for each in document["pending"]]
    mapper.steps = [_step(each) for each in document["steps"]]
    seen = document["observations"]
    mapper.observations = Observations(
        seen["rejected"],
        [(a, b) for a, b in seen["gaps"]],
        [(stamp, Transform2D(*step)) for stamp, step in seen["jumps"]],
        [(stamp, k, response) for stamp, k, response in seen["unmatched"]],
        [Lost(known, until, scans, k, Transform2D(*pose)) for known, until, scans, k, pose in seen["lost"]],
    )
    mapper.track = array("d", arrays["track"].tobytes())
    state = document["state"]
    mapper.restore(arrays["poses"], edges, state, None if state["decided"] is None else arrays["unfinished"])
    return mapper


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _loop(values: dict[str, Any]) -> Loop:
    for name in ("runner_up", "contradiction", "rms", "residual"):
        values[name] = _number(values[name])
    values["measured"] = Transform2D(*values["measured"])
    values["information"] = np.array(values["information"])
    values["correction"] = tuple(values["correction"])
    return Loop(**values)


def _step(values: dict[str, Any]) -> Step:
    odometry, matched = Transform2D(*values["odometry"]), Transform2D(*values["matched"])
    sigma = float(values["sigma"][0]), float(values["sigma"][1])
    return Step(
        values["keyframe"], values["before"], values["stamp"], odometry, matched, sigma, _number(values["response"])
    )
