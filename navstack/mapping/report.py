"""What a mapping found out about its log: drift, loops, parts that do not fit, times, odometry, the mounting of the laser."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any, Final, NamedTuple

import numpy as np

from navstack.core import Transform2D, normalize_angle
from navstack.mapping.mapper import Lost, Mapper
from navstack.mapping.matching import Surfaces

CONTRADICTION_SIGMAS: Final = 5.0
"""A match that differs from the odometry by more standard errors contradicts it."""
_GOOD_RESPONSE: Final = 0.6
_PAIRS: Final = 60
"""Pairs of keyframes that the mounting of the laser is judged by,"""
_FEWEST_PAIRS: Final = 8
"""and fewest for a judgment."""
_MOUNTING_RAD: Final = 0.06
"""A laser turned by more (3.4 degrees) is reported: scans of straight drives place it within a degree."""
_SHOWN: Final = 5


class Mounting(NamedTuple):
    """How the laser seems to be turned on the base, from the motion in its scans."""

    pairs: int
    """Pairs of keyframes with a straight motion."""
    yaw: float
    """What to add to the yaw of the sensor (rad); NaN if there were too few pairs."""
    spread: float
    """Median deviation from it (rad)."""
    mirrored: bool
    """Whether turns go the other way in the scans: the laser is upside down, or its beams are in the reverse order."""


def judge_mounting(mapper: Mapper) -> Mounting:
    """Compare the direction of motion in scans, matched without the odometry, with that of the odometry."""
    steps = [s for s in mapper.steps if s.before == s.keyframe - 1]
    straight = [s for s in steps if math.hypot(s.odometry.x, s.odometry.y) > 0.15 and abs(s.odometry.yaw) < 0.15]
    turns = [s for s in steps if abs(s.odometry.yaw) > 0.15]
    offsets: list[float] = []
    for step in straight[:: max(1, len(straight) // _PAIRS)][:_PAIRS]:
        found = _motion_by_scans(mapper, step.keyframe, 0.3)
        if found is not None and math.hypot(found.x, found.y) > 0.5 * math.hypot(step.odometry.x, step.odometry.y):
            offsets.append(math.atan2(step.odometry.y, step.odometry.x) - math.atan2(found.y, found.x))
    signs: list[float] = []
    for step in turns[:: max(1, len(turns) // (_PAIRS // 2))][: _PAIRS // 2]:
        found = _motion_by_scans(mapper, step.keyframe, abs(step.odometry.yaw) + 0.2)
        if found is not None and abs(abs(found.yaw) - abs(step.odometry.yaw)) < 0.1 + 0.2 * abs(step.odometry.yaw):
            signs.append(math.copysign(1.0, found.yaw * step.odometry.yaw))
    mirrored = len(signs) >= _FEWEST_PAIRS and float(np.mean(signs)) < -0.6
    if len(offsets) < _FEWEST_PAIRS:
        return Mounting(len(offsets), math.nan, math.nan, mirrored)
    middle = math.atan2(float(np.mean(np.sin(offsets))), float(np.mean(np.cos(offsets))))
    around = [normalize_angle(value - middle) for value in offsets]
    yaw = normalize_angle(middle + float(np.median(around)))
    spread = float(np.median(np.abs([normalize_angle(value - yaw) for value in offsets])))
    return Mounting(len(offsets), yaw, spread, mirrored)


def _motion_by_scans(mapper: Mapper, k: int, half_rad: float) -> Transform2D | None:
    """Return the motion from keyframe `k - 1` to `k` by their scans alone; None if they do not fit or leave it open."""
    reach = mapper.params.max_laser_range
    before, now = (mapper.keyframes.surface(n, reach) for n in (k - 1, k))
    surfaces = Surfaces([(before, Transform2D())])
    found, _ = surfaces.search(now, Transform2D(), half_m=0.8, half_rad=half_rad, step_rad=0.02)
    match = surfaces.align(now, found)
    h = match.hessian
    tight = h[0, 0] * h[1, 1] - h[0, 1] ** 2 > 0.02 * (h[0, 0] + h[1, 1]) ** 2
    if match.response < _GOOD_RESPONSE or not tight:
        return None
    return Transform2D(*match.pose.tolist())


def report_document(mapper: Mapper) -> dict[str, Any]:
    """Return the report of a finished mapping for JSON; `lines` are sentences for people."""
    seen = mapper.observations
    stamps, _ = mapper.trajectory()
    end = mapper.last_stamp if mapper.last_stamp is not None else -math.inf
    accepted = [loop for loop in mapper.loops if loop.accepted]
    drift = _drift(mapper)
    mounting = judge_mounting(mapper)
    against = [
        (s.stamp, s.keyframe, error.x, error.y, error.yaw)
        for s in mapper.steps
        if s.response >= _GOOD_RESPONSE and (error := _beyond(s.odometry, s.matched, s.sigma)) is not None
    ]
    document: dict[str, Any] = {
        "scans": len(stamps),
        "keyframes": len(mapper.keyframes),
        "path_m": mapper.travelled,
        "followed_m": mapper.followed,
        "duration_s": float(stamps[-1] - stamps[0]) if len(stamps) else 0.0,
        "drift": drift,
        "loops": {
            "accepted": len(accepted),
            "rejected": len(mapper.loops) - len(accepted),
            "why_rejected": dict(Counter(_kind(loop.reason) for loop in mapper.loops if not loop.accepted)),
            "decisions": [_loop_document(loop) for loop in mapper.loops],
        },
        "unmatched": [{"stamp": t, "keyframe": k, "response": r} for t, k, r in seen.unmatched],
        "lost": [_lost_document(mapper, each, end) for each in seen.lost],
        "rejected_scans": {reason: len(when) for reason, when in seen.rejected.items()},
        "gaps": [list(gap) for gap in seen.gaps],
        "odometry_jumps": [[t, *step] for t, step in seen.jumps],
        "odometry_against_scans": [list(row) for row in against],
        "mounting": mounting._asdict(),
        "calibration": None if mapper.calibration is None else mapper.calibration._asdict(),
    }
    document["lines"] = _lines(mapper, document, mounting)
    return document


def _drift(mapper: Mapper) -> dict[str, float]:
    """Return how far the odometry alone, and the matches alone, end from the graph (m, rad)."""
    if not mapper.steps:
        return {}
    odometry = matched = Transform2D(*mapper.graph.poses[0].tolist())
    # after known places, the way to the last keyframe goes on from an older one
    way = [mapper.steps[-1]]
    while way[-1].before > 0:
        way.append(mapper.steps[way[-1].before - 1])
    for step in reversed(way):
        odometry, matched = odometry @ step.odometry, matched @ step.matched
    graph = Transform2D(*mapper.graph.poses[-1].tolist())
    a, b = graph.inverse() @ odometry, graph.inverse() @ matched
    return {
        "odometry_m": math.hypot(a.x, a.y),
        "odometry_rad": a.yaw,
        "matches_m": math.hypot(b.x, b.y),
        "matches_rad": b.yaw,
        "path_m": sum(math.hypot(step.matched.x, step.matched.y) for step in way),
    }


def _beyond(odometry: Transform2D, matched: Transform2D, sigma: tuple[float, float]) -> Transform2D | None:
    """Return the difference of two motions if it is beyond what is expected of the odometry over a keyframe."""
    error = odometry.inverse() @ matched
    far, turned = math.hypot(error.x, error.y), abs(error.yaw)
    return error if far > CONTRADICTION_SIGMAS * sigma[0] or turned > CONTRADICTION_SIGMAS * sigma[1] else None


def _kind(reason: str) -> str:
    """Return the reason of a rejection without its figures."""
    for part in (":", " in free space", " would be off", " is off by"):
        if part in reason:
            return "points in free space" if "free" in part else reason.partition(part)[0]
    return reason


def _loop_document(loop: Any) -> dict[str, Any]:
    names = ("keyframe", "place", "stamp", "seen_at", "path", "coarse", "runner_up", "response", "contradiction", "rms")
    document = {name: getattr(loop, name) for name in names}
    return document | {
        "correction": list(loop.correction),
        "residual": loop.residual,
        "accepted": loop.accepted,
        "reason": loop.reason,
    }


def _lost_document(mapper: Mapper, lost: Lost, end: float) -> dict[str, Any]:
    """Return a part in which the robot was lost, for JSON; `end`: stamp of the last scan (s)."""
    pose = Transform2D(*mapper.graph.poses[lost.keyframe].tolist()) @ lost.pose
    return {
        "known_until": lost.known_until,
        "until": lost.until,
        "scans": lost.scans,
        "pose": list(pose),
        "to_the_end": lost.until >= end,
    }


def _lines(mapper: Mapper, d: dict[str, Any], mounting: Mounting) -> list[str]:
    lines = [
        f"{d['scans']} scans in {d['duration_s']:.0f} s, {d['keyframes']} keyframes on {d['path_m']:.1f} m of path",
    ]
    for part in d["lost"][:_SHOWN]:
        x, y, _ = part["pose"]
        n, known, until = part["scans"], part["known_until"], part["until"]
        where = f"near ({x:.2f}, {y:.2f})"
        if n == 0:
            lines.append(
                f"no odometry tells how the robot moved from {known:.1f} to {until:.1f} s {where}: the place after it was "
                "recognized by one scan"
            )
            continue
        end = "to the end of the log" if part["to_the_end"] else f"to {until:.1f} s"
        lines.append(
            f"tracking lost at {known:.1f} s {where}: the scans fit nothing around, and no odometry says where it went; "
            f"{n} scan{'s' * (n != 1)} {end} {'are' if n != 1 else 'is'} not in the map"
        )
    if len(d["lost"]) > _SHOWN:
        lines.append(f"  {len(d['lost']) - _SHOWN} more such parts are in the report")
    if d["lost"]:
        lines.append(
            "  the map may be wrong from there on: record odometry, or drive and turn more slowly, so that scans overlap"
        )
    lines.append(f"loops: {d['loops']['accepted']} accepted, {d['loops']['rejected']} rejected")
    lines += [f"  rejected {n} time{'s' * (n != 1)}: {why}" for why, n in d["loops"]["why_rejected"].items()]
    if d["followed_m"] > 0.0:
        lines.append(f"known places: {d['followed_m']:.1f} m of the path needed no new keyframes")
    if d["drift"] and d["path_m"] > 0.0:
        far, turned, left = d["drift"]["odometry_m"], math.degrees(d["drift"]["odometry_rad"]), d["drift"]["matches_m"]
        share = far / max(d["drift"]["path_m"], 1e-3)
        lines.append(
            f"drift at the end: odometry {far:.2f} m ({share:.1%} of the path) and {turned:+.1f} degrees; matches without "
            f"loops {left:.2f} m"
        )
    calibration = mapper.calibration
    if calibration is not None and calibration.steps:
        ahead, left, turn = calibration.noise
        lines.append(
            f"odometry, calibrated by {calibration.steps} steps of {calibration.mean_step:.2f} m: multiply distances by "
            f"{calibration.scale:.4f} and turns by {calibration.turn_scale:.4f}, add {math.degrees(calibration.curve):+.2f} "
            f"degrees per meter; noise of a step {1000.0 * ahead:.1f} mm ahead, {1000.0 * left:.1f} mm to the side, "
            f"{math.degrees(turn):.2f} degrees"
        )
    for begin, end, count in _parts([row["stamp"] for row in d["unmatched"]])[:_SHOWN]:
        lines.append(
            f"does not fit: {count} scan{'s' * (count != 1)} from {begin:.1f} to {end:.1f} s, like nothing before"
        )
    for reason, count in d["rejected_scans"].items():
        when = mapper.observations.rejected[reason][0]
        lines.append(f"not used: {count} scan{'s' * (count != 1)}, the first at {when:.1f} s: {reason}")
    for begin, end in d["gaps"][:_SHOWN]:
        lines.append(f"gap: no scan from {begin:.1f} to {end:.1f} s ({end - begin:.1f} s)")
    for stamp, x, y, yaw in d["odometry_jumps"][:_SHOWN]:
        lines.append(
            f"odometry jumps at {stamp:.1f} s by {math.hypot(x, y):.2f} m and {math.degrees(yaw):+.0f} degrees; not believed"
        )
    against = d["odometry_against_scans"]
    if against:
        stamp, _, x, y, yaw = max(against, key=lambda row: math.hypot(row[2], row[3]) + abs(row[4]))
        lines.append(
            f"odometry contradicts the scans at {len(against)} of {len(mapper.steps)} keyframes, most at {stamp:.1f} s: by "
            f"{math.hypot(x, y):.2f} m and {math.degrees(yaw):+.1f} degrees; the scans were believed"
        )
    if mounting.mirrored:
        lines.append(
            "the laser turns the wrong way: it is upside down, or its beams are in the reverse order; negate angle_min and "
            "angle_increment in its driver"
        )
    elif not math.isnan(mounting.yaw) and abs(mounting.yaw) > max(_MOUNTING_RAD, 2.0 * mounting.spread):
        lines.append(
            f"the laser is mounted at another angle than the log says: by the motion in {mounting.pairs} pairs of scans, add "
            f"{mounting.yaw:+.3f} rad ({math.degrees(mounting.yaw):+.1f} degrees) to its yaw (--turn-laser {mounting.yaw:.3f})"
        )
    return lines


def _parts(stamps: list[float]) -> list[tuple[float, float, int]]:
    """Return begin, end and number of the stamps that follow each other within 5 s, most first."""
    parts: list[tuple[float, float, int]] = []
    for stamp in stamps:
        if parts and stamp - parts[-1][1] < 5.0:
            parts[-1] = parts[-1][0], stamp, parts[-1][2] + 1
        else:
            parts.append((stamp, stamp, 1))
    return sorted(parts, key=lambda part: (-part[2], part[0]))
