"""N robots in N worlds, advanced by one kernel: bodies, collisions, lidar, noise, rewards and resets.

Every environment of this package is this kernel; a single one has N = 1. Environments share nothing that changes, and every
random number is a function of (seed, episode, purpose, index), so neither their number nor that of the threads changes a bit.
"""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint, InputError, kernel
from navstack.gym.levels import Level
from navstack.parameters import LidarParams, SimParams
from navstack.scenario import START_RADIUS_M, barn_score
from navstack.sim import SAMPLE_SIZE, STATE, World, body_settings, clearance, drive, scan_settings, sweep

MAX_DELAY: Final = 16
"""Most control steps that a command may be delayed."""
TERMS: Final = ("goal", "collision", "progress", "forward", "time", "near", "discomfort", "turning", "change")
"""Names of the reward terms, in the order of the kernel."""
OUTCOMES: Final = ("", "goal", "collision", "timeout")
"""Outcomes of an episode by number; the first one: it goes on."""
SKIP, STEP, RESET = 0, 1, 2
"""What `advance` does with an environment."""

VARIANT: Final = np.dtype(
    [
        ("footprint_at", "i8"),  # first row of its outline
        ("corners", "i8"),
        ("radius", "f8"),  # circumscribed radius of the footprint, m
        ("lidar", "f8", (3,)),  # mounting pose of the lidar, m, m, rad
        ("scan_rate", "f8"),  # scans per physics step
        ("scan_delay", "i8"),  # physics steps from a scan to its arrival
        ("range_noise", "f8"),  # standard deviation of the ranges, m
        ("dropout", "f8"),  # share of lost beams
        ("command_delay", "i8"),  # physics steps
        ("slip", "f8", (4,)),  # errors of motion and odometry per step: relative, relative, rad/sqrt(m), rad/sqrt(m)
        ("noisy", "?"),  # any of these errors is not zero
        ("uses_odometry", "?"),  # the robot believes its odometry; else the truth with the noise below
        ("position_noise", "f8"),  # m
        ("yaw_noise", "f8"),  # rad
    ],
    align=True,
)
"""Element type of the robots' settings that `BODY` and `SCAN` do not have."""
LEVEL: Final = np.dtype(
    [
        ("world", "i8"),
        ("start", "f8", (3,)),
        ("target", "f8", (3,)),
        ("tolerance", "f8"),  # m
        ("yaw_tolerance", "f8"),  # rad; inf: any heading
        ("optimal_length", "f8"),  # m
        ("limit", "i8"),  # control steps
        ("path_at", "i8"),  # first row of its path
        ("path_size", "i8"),
    ],
    align=True,
)
"""Element type of the levels."""
PLACE: Final = np.dtype(
    [(name, "i8") for name in ("cells_at", "ny", "nx", "discs_at", "discs", "polygons_at", "polygons", "corners_at")]
    + [("corner_count", "i8"), ("first_at", "i8"), ("tops_at", "i8")],
    align=True,
)
"""Element type of the worlds: where their arrays begin in those of all worlds."""
TASK: Final = np.dtype(
    [
        ("physics_steps", "i8"),  # per control step
        ("period", "f8"),  # of a control step, s
        ("frequency", "f8"),  # of the physics, Hz
        ("ends_at_collision", "?"),
        ("same_step", "?"),  # a new episode begins in the step that ends one
        ("clip", "f8"),  # largest range in the observation, m
        ("reach", "f8"),  # largest distance of the goal in the observation, m
        ("low", "f8", (3,)),  # vx, vy, wz of the action -1, m/s and rad/s
        ("high", "f8", (3,)),  # of the action 1
        ("repeats_action", "?"),  # the observation ends with the last action
        ("plan_points", "i8"),
        ("plan_spacing", "f8"),  # m
        ("plan_range", "f8"),  # m
        ("max_velocity", "f8", (3,)),  # scale of the velocities in the observation
        ("near", "f8"),  # distance (m) beyond the footprint's circle up to which a range counts as near
        ("comfort", "f8"),  # clearance (m) below which there is discomfort
        ("weights", "f8", (len(TERMS),)),
    ],
    align=True,
)
"""Element type of the task's settings."""
EPISODE: Final = np.dtype(
    [
        ("seed_key", "u8"),
        ("key", "u8"),  # of this episode
        ("episode", "i8"),
        ("wanted_level", "i8"),  # level of the next episode; -1: drawn
        ("ended", "?"),
        ("variant", "i8"),
        ("physics_step", "i8"),
        ("control_step", "i8"),
        ("moved_at", "f8"),  # time when the robot was `START_RADIUS_M` from the start, s; negative before
        ("path_index", "i8"),
        ("given", "f8", (3 * (MAX_DELAY + 2),)),  # commands, the newest first
        ("last", "f8", (3,)),  # the last action
    ],
    align=True,
)
"""Element type of the environments' state beside the body."""
INFO: Final = np.dtype(
    [
        (name, "f8")
        for name in ("time", "x", "y", "yaw", "clearance", "path_length", "min_clearance", "time_to_goal", "spl")
    ]
    + [("barn_score", "f8")]
    + [(name, "i8") for name in ("collisions", "outcome", "level", "number")],
    align=True,
)
"""Element type of what an environment reports; `number` is that of the episode."""


class Worlds(NamedTuple):
    """The arrays of all worlds, concatenated."""

    places: NDArray[np.void]
    grids: NDArray[np.float64]
    squares: NDArray[np.uint8]
    leaps: NDArray[np.uint8]
    discs: NDArray[np.float64]
    circles: NDArray[np.float64]
    corners: NDArray[np.float64]
    first: NDArray[np.int64]
    tops: NDArray[np.float64]


class Robots(NamedTuple):
    """The settings of all robots that an episode may have."""

    variants: NDArray[np.void]
    bodies: NDArray[np.void]
    scans: NDArray[np.void]
    beams: NDArray[np.float64]
    """(m, beams, 2) unit vectors."""
    footprints: NDArray[np.float64]
    blank: NDArray[np.void]
    """(1,) a body at rest."""


class Batch(NamedTuple):
    """The state of N environments."""

    states: NDArray[np.void]
    bodies: NDArray[np.void]
    episodes: NDArray[np.void]
    history: NDArray[np.float64]
    """(n, h, 3) true poses of the last physics steps, at step modulo h."""
    paths: NDArray[np.float64]
    """(p, 2) points of the levels' paths."""


class Outputs(NamedTuple):
    """What a step gives."""

    observations: NDArray[np.float32]
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    terms: NDArray[np.float64]
    infos: NDArray[np.void]
    last_observations: NDArray[np.float32]
    last_infos: NDArray[np.void]


# --- random numbers ---------------------------------------------------------------------------------------------------
# Counter-based: the finalizer of SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014)
# applied to key + counter * golden ratio.

GOLDEN, ONE = np.uint64(0x9E3779B97F4A7C15), np.uint64(1)
M1, M2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
S30, S27, S31, S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
LEVEL_DRAW, ROBOT_DRAW, DRIVE_DRAW, SCAN_DRAW, DROP_DRAW, POSE_DRAW = 1, 2, 3, 4, 5, 6


@kernel
def random_bits(key, counter):
    """Return 64 random bits of a key and a counter."""
    z = key + GOLDEN * (np.uint64(counter) + ONE)
    z = (z ^ (z >> S30)) * M1
    z = (z ^ (z >> S27)) * M2
    return z ^ (z >> S31)


@kernel
def uniform(key, counter):
    """Return a number in [0, 1)."""
    return np.float64(random_bits(key, counter) >> S11) * 2.0**-53


@kernel
def fill_normals(key, out):
    """Fill `out` (n,) with standard normal numbers, by Box and Muller."""
    for i in range(0, out.shape[0], 2):
        radius = math.sqrt(-2.0 * math.log(1.0 - uniform(key, i)))
        angle = 2.0 * math.pi * uniform(key, i + 1)
        out[i] = radius * math.cos(angle)
        if i + 1 < out.shape[0]:
            out[i + 1] = radius * math.sin(angle)


# --- one environment --------------------------------------------------------------------------------------------------


@kernel
def begin_episode(i, batch, robots, levels, cumulative, info):
    """Put environment `i` at the start of its next episode."""
    episode = batch.episodes[i]
    episode.episode += 1
    episode.key = random_bits(episode.seed_key, episode.episode)
    number = episode.wanted_level
    if number < 0:
        drawn = uniform(random_bits(episode.key, LEVEL_DRAW), 0)
        number = min(np.searchsorted(cumulative, drawn * cumulative[-1], side="right"), levels.shape[0] - 1)
    episode.wanted_level = -1
    count = robots.variants.shape[0]
    episode.variant = min(int(uniform(random_bits(episode.key, ROBOT_DRAW), 0) * count), count - 1)
    episode.ended = False
    episode.physics_step = 0
    episode.control_step = 0
    episode.path_index = 0
    episode.moved_at = -1.0
    for k in range(episode.given.shape[0]):
        episode.given[k] = 0.0
    for k in range(3):
        episode.last[k] = 0.0
    batch.states[i] = robots.blank[0]
    batch.bodies[i] = robots.bodies[episode.variant]
    level, state, body = levels[number], batch.states[i], batch.bodies[i]
    state.x, state.y, state.yaw = level.start[0], level.start[1], level.start[2]
    # the odometry starts at the true pose: its frame is the map's
    state.odom_x, state.odom_y, state.odom_yaw = state.x, state.y, state.yaw
    if not math.isnan(body.fixed_yaw):
        body.fixed_yaw = state.yaw
    for k in range(batch.history.shape[1]):
        batch.history[i, k, 0], batch.history[i, k, 1], batch.history[i, k, 2] = state.x, state.y, state.yaw
    info.number, info.level = episode.episode, number
    info.time, info.path_length, info.collisions, info.outcome = 0.0, 0.0, 0, 0
    info.min_clearance = math.inf
    info.time_to_goal, info.spl, info.barn_score = math.nan, 0.0, 0.0


@kernel
def drive_noise(episode, variant, steps):
    """Return the errors of the next physics steps as `drive` takes them: (steps, 8) or (0, 8)."""
    if not variant.noisy:
        return np.empty((0, 8))
    noise = np.empty((steps, 8))
    for k in range(steps):
        fill_normals(random_bits(random_bits(episode.key, DRIVE_DRAW), episode.physics_step + k), noise[k])
        for column in range(8):
            noise[k, column] *= variant.slip[column // 3 if column < 6 else column - 4]
    return noise


@kernel
def move(i, batch, robots, worlds, number, task):
    """Drive environment `i` in world `number` for one control step; return the number of new collisions."""
    episode, place = batch.episodes[i], worlds.places[number]
    variant = robots.variants[episode.variant]
    footprint = robots.footprints[variant.footprint_at : variant.footprint_at + variant.corners]
    cells = place.ny * place.nx
    squares = worlds.squares[4 * place.cells_at : 4 * (place.cells_at + cells)].reshape((4, place.ny, place.nx))
    discs = worlds.discs[place.discs_at : place.discs_at + place.discs]
    circles = worlds.circles[place.polygons_at : place.polygons_at + place.polygons]
    corners = worlds.corners[place.corners_at : place.corners_at + place.corner_count]
    first = worlds.first[place.first_at : place.first_at + place.polygons + 1]
    state = batch.states[i]
    rows = batch.history.shape[1]
    whole = variant.command_delay // task.physics_steps
    late = variant.command_delay - whole * task.physics_steps
    samples = np.empty((task.physics_steps, SAMPLE_SIZE))
    hits = 0
    for part in range(2):
        # until its delay has passed, the command before is in force
        age, steps = (whole + 1, late) if part == 0 else (whole, task.physics_steps - late)
        if steps == 0:
            continue
        state.command_vx, state.command_vy = episode.given[3 * age], episode.given[3 * age + 1]
        state.command_wz = episode.given[3 * age + 2]
        hits += drive(
            batch.states[i : i + 1],
            batch.bodies[i : i + 1],
            footprint,
            steps,
            drive_noise(episode, variant, steps),
            squares,
            worlds.grids[number],
            discs,
            circles,
            corners,
            first,
            samples,
        )
        for k in range(steps):
            episode.physics_step += 1
            row = episode.physics_step % rows
            for column in range(3):
                batch.history[i, row, column] = samples[k, column]
    return hits


@kernel
def newest_scan(episode, variant):
    """Return the number of the newest scan that has arrived, and the physics step at which it was taken."""
    index = max(math.floor((episode.physics_step - variant.scan_delay) * variant.scan_rate + 1e-6), 0)
    return index, math.ceil(index / variant.scan_rate - 1e-6)


@kernel
def scan_into(i, batch, robots, worlds, number, task, out):
    """Write the newest scan that has arrived to `out` (beams,), from 0 (touching) to 1 (free); return its lowest range (m)."""
    episode, place = batch.episodes[i], worlds.places[number]
    variant = robots.variants[episode.variant]
    index, step = newest_scan(episode, variant)
    at = batch.history[i, step % batch.history.shape[1]]
    c, s = math.cos(at[2]), math.sin(at[2])
    mounted = variant.lidar
    eye = (at[0] + c * mounted[0] - s * mounted[1], at[1] + s * mounted[0] + c * mounted[1], at[2] + mounted[2])
    n = out.shape[0]
    noise = np.empty((0, n))
    if variant.range_noise > 0.0 or variant.dropout > 0.0:
        noise = np.zeros((2 if variant.dropout > 0.0 else 1, n))
        if variant.range_noise > 0.0:
            fill_normals(random_bits(random_bits(episode.key, SCAN_DRAW), index), noise[0])
            noise[0] *= variant.range_noise
        if variant.dropout > 0.0:
            key = random_bits(random_bits(episode.key, DROP_DRAW), index)
            for k in range(n):
                noise[1, k] = 1.0 if uniform(key, k) >= variant.dropout else 0.0
    cells = place.ny * place.nx
    ranges = sweep(
        worlds.leaps[8 * place.cells_at : 8 * (place.cells_at + cells)].reshape((8, place.ny, place.nx)),
        worlds.grids[number],
        worlds.discs[place.discs_at : place.discs_at + place.discs],
        worlds.circles[place.polygons_at : place.polygons_at + place.polygons],
        worlds.corners[place.corners_at : place.corners_at + place.corner_count],
        worlds.first[place.first_at : place.first_at + place.polygons + 1],
        worlds.tops[place.tops_at : place.tops_at + place.discs + place.polygons],
        eye,
        robots.beams[episode.variant],
        robots.scans[episode.variant : episode.variant + 1],
        noise,
    )
    lowest = math.inf
    for k in range(n):
        measured = np.float64(ranges[k])
        if math.isnan(measured):
            out[k] = 1.0
            continue
        lowest = min(lowest, max(measured, 0.0))
        out[k] = min(max(measured, 0.0), task.clip) / task.clip
    return lowest


@kernel
def plan_into(i, batch, level, task, x, y, yaw, out):
    """Write points of the level's path ahead of the pose, in the robot's frame and scaled, to `out` (2 * points,)."""
    episode = batch.episodes[i]
    path = batch.paths[level.path_at : level.path_at + level.path_size]
    # the nearest point, from the last one on: the robot may come near a later part of the path
    best, nearest = math.inf, episode.path_index
    passed = 0.0
    for k in range(episode.path_index, path.shape[0]):
        if k > episode.path_index:
            passed += math.hypot(path[k, 0] - path[k - 1, 0], path[k, 1] - path[k - 1, 1])
        away = math.hypot(path[k, 0] - x, path[k, 1] - y)
        if away < best:
            best, nearest = away, k
        if passed > 2.0:
            break
    episode.path_index = nearest
    c, s = math.cos(yaw), math.sin(yaw)
    k, passed = nearest, 0.0
    for point in range(task.plan_points):
        while k + 1 < path.shape[0] and passed < (point + 1) * task.plan_spacing:
            passed += math.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
            k += 1
        dx, dy = path[k, 0] - x, path[k, 1] - y
        out[2 * point] = min(max((c * dx + s * dy) / task.plan_range, -1.0), 1.0)
        out[2 * point + 1] = min(max((c * dy - s * dx) / task.plan_range, -1.0), 1.0)


@kernel
def observe(i, batch, robots, worlds, level, task, out):
    """Write the observation of environment `i` to `out`; return the lowest range of its scan (m)."""
    episode, state = batch.episodes[i], batch.states[i]
    variant = robots.variants[episode.variant]
    beams = robots.beams.shape[1]
    lowest = scan_into(i, batch, robots, worlds, level.world, task, out[:beams])
    x, y, yaw = state.x, state.y, state.yaw
    if variant.uses_odometry:
        x, y, yaw = state.odom_x, state.odom_y, state.odom_yaw
    elif variant.position_noise > 0.0 or variant.yaw_noise > 0.0:
        drawn = np.empty(3)
        fill_normals(random_bits(random_bits(episode.key, POSE_DRAW), episode.control_step), drawn)
        x, y = x + variant.position_noise * drawn[0], y + variant.position_noise * drawn[1]
        yaw += variant.yaw_noise * drawn[2]
    dx, dy = level.target[0] - x, level.target[1] - y
    bearing = math.atan2(dy, dx) - yaw
    at = beams
    out[at] = min(math.hypot(dx, dy), task.reach) / task.reach
    out[at + 1], out[at + 2] = math.cos(bearing), math.sin(bearing)
    velocity = (state.vx, state.vy, state.wz)
    for k in range(3):
        scale = task.max_velocity[k]
        out[at + 3 + k] = min(max(velocity[k] / scale, -1.0), 1.0) if scale > 0.0 else 0.0
    at += 6
    if task.plan_points > 0:
        plan_into(i, batch, level, task, x, y, yaw, out[at : at + 2 * task.plan_points])
        at += 2 * task.plan_points
    if task.repeats_action:
        for k in range(out.shape[0] - at):
            out[at + k] = episode.last[k]
    return lowest


@kernel
def true_clearance(i, batch, robots, worlds, number):
    """Return the distance (m) from the footprint to the nearest obstacle; 0 in collision, inf without obstacles."""
    episode, state, place, body = batch.episodes[i], batch.states[i], worlds.places[number], batch.bodies[i]
    if state.collided != 0.0:
        return 0.0
    variant = robots.variants[episode.variant]
    cells = place.ny * place.nx
    return clearance(
        worlds.squares[4 * place.cells_at : 4 * (place.cells_at + cells)].reshape((4, place.ny, place.nx)),
        worlds.grids[number],
        worlds.discs[place.discs_at : place.discs_at + place.discs],
        worlds.circles[place.polygons_at : place.polygons_at + place.polygons],
        worlds.corners[place.corners_at : place.corners_at + place.corner_count],
        worlds.first[place.first_at : place.first_at + place.polygons + 1],
        robots.footprints[variant.footprint_at : variant.footprint_at + variant.corners],
        state.x,
        state.y,
        state.yaw if math.isnan(body.fixed_yaw) else body.fixed_yaw,
    )


@kernel
def report_state(i, batch, task, clear, info):
    """Write what `info` says at every step."""
    episode, state = batch.episodes[i], batch.states[i]
    info.time = episode.physics_step / task.frequency
    info.x, info.y, info.yaw = state.x, state.y, state.yaw
    info.path_length = state.distance
    info.clearance = clear
    info.min_clearance = min(info.min_clearance, clear)


@kernel
def report_end(level, moved_at, info):
    """Write what `info` says at the end of an episode; `moved_at`: time when the robot left its start (s)."""
    if info.outcome != 1:
        return
    info.time_to_goal = info.time
    longest = max(level.optimal_length, info.path_length)
    info.spl = level.optimal_length / longest if longest > 0.0 else 1.0
    info.barn_score = barn_score(level.optimal_length, info.time - max(moved_at, 0.0))


@kernel
def take_action(episode, task, action):
    """Take the command of an action; return the sum of the changes from the last action."""
    for k in range(episode.given.shape[0] - 1, 2, -1):
        episode.given[k] = episode.given[k - 3]
    last = action.shape[0] - 1
    for k in range(3):
        # forward, (sideways,) turning
        share = action[0] if k == 0 else action[last] if k == 2 else action[1] if last == 2 else 0.0
        wanted = task.low[k] + 0.5 * (share + 1.0) * (task.high[k] - task.low[k])
        episode.given[k] = min(max(wanted, task.low[k]), task.high[k])
    change = 0.0
    for k in range(action.shape[0]):
        change += abs(action[k] - episode.last[k])
        episode.last[k] = action[k]
    return change


@kernel
def report_step(i, batch, level, task, was, hits, clear, lowest, change, outputs):
    """Write reward, end and info of environment `i`, which was at `was` (x, y) before the step and has `hits` new collisions.

    `clear`: clearance, `lowest`: lowest range (m), `change`: as `take_action` returns it.
    """
    info = outputs.infos[i]
    episode, state = batch.episodes[i], batch.states[i]
    report_state(i, batch, task, clear, info)
    if episode.moved_at < 0.0 and math.hypot(state.x - level.start[0], state.y - level.start[1]) >= START_RADIUS_M:
        episode.moved_at = info.time
    before = math.hypot(level.target[0] - was[0], level.target[1] - was[1])
    away = math.hypot(level.target[0] - state.x, level.target[1] - state.y)
    turn = level.target[2] - state.yaw
    facing = math.isinf(level.yaw_tolerance) or abs(math.atan2(math.sin(turn), math.cos(turn))) <= level.yaw_tolerance
    info.collisions += hits
    if hits > 0 and task.ends_at_collision:
        info.outcome = 2
    elif away <= level.tolerance and facing:
        info.outcome = 1
    elif episode.control_step >= level.limit:
        info.outcome = 3
    episode.ended = info.outcome != 0
    outputs.terminated[i] = info.outcome == 1 or info.outcome == 2
    outputs.truncated[i] = info.outcome == 3
    terms = outputs.terms[i]
    terms[0] = 1.0 if info.outcome == 1 else 0.0
    terms[1] = np.float64(hits)
    terms[2] = before - away
    terms[3] = state.y - was[1]
    terms[4] = 1.0
    terms[5] = 1.0 if lowest <= batch.bodies[i].radius + task.near else 0.0
    terms[6] = (clear - task.comfort) * task.period if clear < task.comfort else 0.0
    terms[7] = abs(state.wz) * task.period
    terms[8] = change
    reward = 0.0
    for k in range(terms.shape[0]):
        terms[k] = terms[k] * task.weights[k] + 0.0  # no -0.0
        reward += terms[k]
    outputs.rewards[i] = reward
    if episode.ended:
        report_end(level, episode.moved_at, info)


@kernel
def step_environment(i, batch, robots, worlds, levels, task, action, outputs):
    """Drive environment `i` for one control step; write its observation, reward, end and info."""
    episode, state = batch.episodes[i], batch.states[i]
    level = levels[outputs.infos[i].level]
    change = take_action(episode, task, action)
    was = (state.x, state.y)
    hits = move(i, batch, robots, worlds, level.world, task)
    episode.control_step += 1
    clear = true_clearance(i, batch, robots, worlds, level.world)
    lowest = observe(i, batch, robots, worlds, level, task, outputs.observations[i])
    report_step(i, batch, level, task, was, hits, clear, lowest, change, outputs)


@kernel
def advance(todo, actions, batch, robots, worlds, levels, cumulative, tasks, outputs, begin, end):
    """Step or reset the environments `begin` .. `end` - 1.

    `todo` (n,): `SKIP`, `STEP` or `RESET`; `actions` (n, 2 or 3) in [-1, 1]: forward, (sideways,) turning; `cumulative`
    (levels,): cumulative weights by which levels are drawn; `tasks` (1,) of type `TASK`.
    """
    task = tasks[0]
    for i in range(begin, end):
        if todo[i] == SKIP:
            continue
        resets = todo[i] == RESET
        if todo[i] == STEP:
            step_environment(i, batch, robots, worlds, levels, task, actions[i], outputs)
            if task.same_step and batch.episodes[i].ended:
                outputs.last_observations[i] = outputs.observations[i]
                outputs.last_infos[i] = outputs.infos[i]
                resets = True
        else:
            outputs.rewards[i] = 0.0
            outputs.terms[i] = 0.0
            outputs.terminated[i] = outputs.truncated[i] = False
        if resets:
            info = outputs.infos[i]
            begin_episode(i, batch, robots, levels, cumulative, info)
            level = levels[info.level]
            observe(i, batch, robots, worlds, level, task, outputs.observations[i])
            report_state(i, batch, task, true_clearance(i, batch, robots, worlds, level.world), info)


# --- from objects to arrays -------------------------------------------------------------------------------------------


class RobotModel(NamedTuple):
    """A robot that an episode may have."""

    params: SimParams
    footprint: Footprint
    lidar: LidarParams
    believed: str = "truth"
    """`truth` or `odometry`: what the robot takes as its pose."""


def pack_worlds(worlds: Sequence[World]) -> Worlds:
    """Return the arrays of the worlds. Raises InputError for a world in which anything moves."""
    places = np.zeros(len(worlds), PLACE)
    counts = dict.fromkeys(("cells_at", "discs_at", "polygons_at", "corners_at", "first_at", "tops_at"), 0)
    parts: list[tuple[NDArray[np.generic], ...]] = []
    for place, world in zip(places, worlds, strict=True):
        if world.moves:
            raise InputError(
                "a level has obstacles that move; this environment takes worlds that stand still: leave them out, or use "
                "navstack/Residual-v0 or navstack/PlannerParams-v0"
            )
        solids = world.solids_at(0.0)
        _, ny, nx = world.squares.shape
        for name, at in counts.items():
            place[name] = at
        place["ny"], place["nx"], place["discs"], place["polygons"] = ny, nx, len(solids.discs), len(solids.circles)
        place["corner_count"] = len(solids.corners)
        counts["cells_at"] += ny * nx
        counts["discs_at"] += len(solids.discs)
        counts["polygons_at"] += len(solids.circles)
        counts["corners_at"] += len(solids.corners)
        counts["first_at"] += len(solids.first)
        counts["tops_at"] += len(solids.tops)
        arrays = (world.squares.ravel(), world.leaps.ravel(), solids.discs, solids.circles, solids.corners)
        parts.append((*arrays, solids.first, solids.tops))
    joined = [np.ascontiguousarray(np.concatenate(arrays)) for arrays in zip(*parts, strict=True)]
    return Worlds(places, np.array([world.grid for world in worlds]), *joined)  # pyright: ignore[reportArgumentType]


def pack_robots(models: Sequence[RobotModel], period: float, clip: float) -> Robots:
    """Return the arrays of the robots. Raises InputError for what the environments do not simulate."""
    variants = np.zeros(len(models), VARIANT)
    outlines: list[NDArray[np.float64]] = []
    for variant, model in zip(variants, models, strict=True):
        params, lidar = model.params, model.lidar
        frequency = params.physics_frequency
        if params.is_steered:
            raise InputError(
                f"navstack/LocalControl-v0 does not drive {params.kinematics} bases; use navstack/Residual-v0, or a differential "
                "or holonomic robot",
                kinematics=params.kinematics,
            )
        if params.command_timeout is not None and params.command_timeout < period:
            raise InputError(
                f"commands last {params.command_timeout:g} s (navstack/sim/command_timeout) but come every {period:g} s; set a "
                "shorter period",
                command_timeout=params.command_timeout,
            )
        variant["footprint_at"], variant["corners"] = sum(map(len, outlines)), len(model.footprint.vertices)
        outlines.append(model.footprint.vertices)
        variant["radius"] = model.footprint.circumscribed_radius
        variant["lidar"] = lidar.x, lidar.y, lidar.yaw
        variant["scan_rate"] = lidar.frequency / frequency
        variant["scan_delay"] = math.ceil(lidar.delay * frequency - 1e-9)
        variant["range_noise"], variant["dropout"] = lidar.range_noise, lidar.dropout
        variant["command_delay"] = math.ceil(params.command_delay * frequency - 1e-9)
        if variant["command_delay"] > MAX_DELAY * round(period * frequency):
            raise InputError(
                f"a command_delay of {params.command_delay:g} s is over {MAX_DELAY} steps of {period:g} s; set a shorter delay",
                command_delay=params.command_delay,
            )
        root = math.sqrt(frequency)
        slip = (
            root * params.wheel_slip,
            root * params.odometry_noise,
            params.wheel_slip_turn,
            params.odometry_noise_turn,
        )
        variant["slip"], variant["noisy"] = slip, any(slip)
        variant["uses_odometry"] = model.believed == "odometry"
        variant["position_noise"] = params.localization_noise
        variant["yaw_noise"] = params.localization_yaw_noise
    bodies = [body_settings(m.params, m.footprint, 0.0, moving_obstacles=False) for m in models]
    lidars = [m.lidar for m in models]
    # what is beyond `clip` counts as free: it need not be measured
    scans = [
        scan_settings(p.height, p.angle_min, p.angle_increment, p.range_min, min(p.range_max, clip)) for p in lidars
    ]
    angles = np.array([p.angle_min + p.angle_increment * np.arange(p.beams) for p in lidars])
    beams = np.ascontiguousarray(np.stack((np.cos(angles), np.sin(angles)), axis=-1))
    footprints = np.concatenate(outlines)
    return Robots(variants, np.concatenate(bodies), np.concatenate(scans), beams, footprints, np.zeros(1, STATE))


class Simulation:
    """N environments and their worlds, robots and levels."""

    def __init__(
        self,
        number: int,
        levels: Sequence[Level],
        robots: Sequence[RobotModel],
        task: NDArray[np.void],
        *,
        actions: int,
        threads: int = 1,
    ) -> None:
        """`task` (1,) of type `TASK`; `actions`: numbers of an action."""
        self.number, self.levels, self.task = number, tuple(levels), task
        period = float(task["period"][0])
        worlds = list({id(level.world): level.world for level in levels}.values())
        index = {id(world): k for k, world in enumerate(worlds)}
        self.worlds, self.robots = pack_worlds(worlds), pack_robots(robots, period, float(task["clip"][0]))
        rows = np.zeros(len(levels), LEVEL)
        paths: list[NDArray[np.float64]] = []
        for row, level in zip(rows, levels, strict=True):
            row["world"] = index[id(level.world)]
            row["start"], row["target"] = tuple(level.start), tuple(level.goal)
            row["tolerance"], row["yaw_tolerance"] = level.tolerance, level.yaw_tolerance
            row["optimal_length"], row["limit"] = level.length, max(1, math.ceil(level.time_limit / period - 1e-9))
            row["path_at"], row["path_size"] = sum(map(len, paths)), len(level.path)
            paths.append(level.path)
        self.rows = rows
        self.cumulative = np.arange(1.0, len(levels) + 1.0)
        variants = self.robots.variants
        steps = int(task["physics_steps"][0])
        # a scan may be as old as its delay, the time between two scans and a control step
        history = int(np.ceil(variants["scan_delay"] + 1.0 / variants["scan_rate"]).max()) + steps + 2
        episodes = np.zeros(number, EPISODE)
        episodes["episode"], episodes["wanted_level"], episodes["ended"] = -1, -1, True
        self.batch = Batch(
            np.zeros(number, STATE),
            np.zeros(number, self.robots.bodies.dtype),
            episodes,
            np.zeros((number, history, 3)),
            np.concatenate(paths),
        )
        self.beams = self.robots.beams.shape[1]
        size = self.beams + 6 + 2 * int(task["plan_points"][0]) + (actions if task["repeats_action"][0] else 0)
        self.outputs = Outputs(
            np.zeros((number, size), np.float32),
            np.zeros(number),
            np.zeros(number, np.bool_),
            np.zeros(number, np.bool_),
            np.zeros((number, len(TERMS))),
            np.zeros(number, INFO),
            np.zeros((number, size), np.float32),
            np.zeros(number, INFO),
        )
        self.todo = np.zeros(number, np.int8)
        """(n,) what `advance` does: `SKIP`, `STEP` or `RESET`."""
        self._threads = max(1, min(threads, number))
        self._pool: ThreadPoolExecutor | None = None
        if self._threads > 1:
            self._pool = ThreadPoolExecutor(self._threads - 1, thread_name_prefix="navstack-gym")
        self._load(actions)

    def _load(self, actions: int) -> None:
        """Load the kernel for actions of so many numbers."""
        self._fixed = (self.batch, self.robots, self.worlds, self.rows, self.cumulative, self.task, self.outputs)
        # the machine code for these types: to find it by the types of 30 arrays takes 7 of 40 us of a step
        compiled = advance.dispatcher
        arguments = (self.todo, np.zeros((self.number, actions)), *self._fixed, 0, self.number)
        self._advance: Callable[..., None] = compiled.compile(tuple(map(compiled.typeof_pyval, arguments)))

    def advance(self, actions: NDArray[np.float64]) -> None:
        """Step or reset the environments as `todo` says, into `outputs`; `actions` (n, a) are contiguous."""
        pool = self._pool
        if pool is None:
            self._advance(self.todo, actions, *self._fixed, 0, self.number)
            return
        # several parts per thread, which takes the next one when it is done: resets and narrow places take longer
        bounds = np.linspace(0, self.number, 4 * self._threads + 1).astype(int).tolist()
        parts = iter([(a, b) for a, b in pairwise(bounds) if a < b])

        def work() -> None:
            for begin, end in parts:
                self._advance(self.todo, actions, *self._fixed, begin, end)

        others = [pool.submit(work) for _ in range(self._threads - 1)]
        work()
        for other in others:
            other.result()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
