"""Speed of the Gymnasium environments, next to navground and ir-sim where they are installed.

    python tools/bench/environments.py [--barn FOLDER] [--steps 2000] [--threads 2] [--peers] [--rough]

Steps per second of wall time, and microseconds of processor time per step, the best of three repeats; resets count. The robot
drives at random through a generated BARN world (or number 295 of the folder), with lidar ranges of 10 m, 0.1 s per step. `discs`
are its cylinders; `cells` the same world as a map with cells of 0.05 m.

    pip install navground ir-sim     # for --peers
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import navstack.gym
from navstack.core import GridGeometry, OccupancyGrid
from navstack.gym import Level, LocalControlParallelEnv, read_levels
from navstack.sim import World

RANGE_M = 10.0


def best(name: str, run: Callable[[], int], repeats: int = 3) -> None:
    """Print the best of the repeats; `run` returns its number of steps."""
    run()
    rates: list[tuple[float, float]] = []
    for _ in range(repeats):
        wall, processor = time.perf_counter(), time.process_time()
        steps = run()
        rates.append((steps / (time.perf_counter() - wall), 1e6 * (time.process_time() - processor) / steps))
    rate, each = max(rates)[0], min(each for _, each in rates)
    print(f"{name:<52} {rate:>10,.0f} steps/s {each:>10,.1f} us of processor time per step", flush=True)


def as_cells(level: Level) -> Level:
    """Return the level with its cylinders as cells of a map."""
    discs = level.world.solids_at(0.0).discs
    low, high = discs[:, :2].min(axis=0) - 1.0, np.maximum(discs[:, :2].max(axis=0), level.goal[:2]) + 1.0
    nx, ny = np.ceil((high - low) / 0.05).astype(int).tolist()
    x, y = np.meshgrid(low[0] + 0.05 * (np.arange(nx) + 0.5), low[1] + 0.05 * (np.arange(ny) + 0.5))
    cells = np.zeros((ny, nx), np.int8)
    for cx, cy, radius in discs.tolist():
        cells[np.hypot(x - cx, y - cy) <= radius] = 100
    world = World(OccupancyGrid(cells, GridGeometry(nx, ny, 0.05, float(low[0]), float(low[1]))))
    return Level(level.name, world, level.start, level.goal, level.tolerance, length=level.length, time_limit=100.0)


def single(level: Level, beams: int, steps: int) -> Callable[[], int]:
    """One environment through Gymnasium's default wrappers."""
    env = gymnasium.make("navstack/LocalControl-v0", levels=[level], beams=beams, scan_clip=RANGE_M)
    actions = list(np.random.default_rng(0).uniform(-1.0, 1.0, (steps, 2)).astype(np.float32))
    env.reset(seed=0)

    def run() -> int:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return steps

    return run


def vector(level: Level, beams: int, steps: int, number: int, threads: int) -> Callable[[], int]:
    """Many environments."""
    env = gymnasium.make_vec(
        "navstack/LocalControl-v0", num_envs=number, levels=[level], beams=beams, scan_clip=RANGE_M, threads=threads
    )
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (max(4, steps // 50), number, 2)).astype(np.float32)
    env.reset(seed=0)

    def run() -> int:
        for action in actions:
            env.step(action)
        return len(actions) * number

    return run


def together(agents: int, beams: int, steps: int) -> Callable[[], int]:
    """Agents in one warehouse, which see each other; a step of the environment counts once per agent."""
    env = LocalControlParallelEnv(
        levels="warehouse", agents=agents, count=1, beams=beams, scan_clip=RANGE_M, collision="stop"
    )
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (max(4, steps // agents), agents, 2)).astype(np.float32)
    env.reset(seed=0)

    def run() -> int:
        done = 0
        for each in actions:
            chosen = {name: each[i] for i, name in enumerate(env.possible_agents) if name in env.agents}
            env.step(chosen)
            done += len(chosen)
            if not env.agents:
                env.reset()
        return done

    return run


def parameters(steps: int, **options: Any) -> Callable[[], int]:
    """The whole stack with new parameters in every simulated second."""
    env = gymnasium.make("navstack/PlannerParams-v0", **options)
    assert env.action_space.shape is not None
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (steps, *env.action_space.shape)).astype(np.float32)
    env.reset(seed=0)

    def run() -> int:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return steps

    return run


def navground_steps(level: Level, beams: int, steps: int) -> Callable[[], int]:
    """A robot with a lidar in navground; without a controller, as ours."""
    from navground import core, sim  # pyright: ignore[reportMissingImports]

    world = sim.World()
    for x, y, radius in level.world.solids_at(0.0).discs.tolist():
        world.add_obstacle(sim.Obstacle(np.array([x, y]), radius))
    lidar = sim.load_state_estimation(
        f"type: Lidar\nrange: {RANGE_M}\nresolution: {beams}\nstart_angle: -2.35619\nfield_of_view: 4.71238\n"
    )
    kinematics = core.kinematics.TwoWheelsDifferentialDriveKinematics(1.0, 0.4)
    agent = sim.Agent(0.2, core.behaviors.DummyBehavior(kinematics, 0.2), kinematics)
    agent.pose = core.Pose2(np.array([0.0, 0.0]), 1.57)
    world.add_agent(agent)
    state = core.SensingState()
    lidar.prepare(agent, world)
    lidar.prepare_state(state)

    def run() -> int:
        for _ in range(steps):
            world.update(0.1)
            lidar.update(agent, world, state)
        return steps

    run()
    assert np.isclose(min(lidar.read_ranges(state)), min_range(level), atol=0.05)
    return run


def min_range(level: Level) -> float:
    """Return the distance of the nearest cylinder ahead of the start (m), to check that peers measure the same."""
    x, y, r = level.world.solids_at(0.0).discs.T
    ahead = np.abs(np.arctan2(-x, y)) < 2.35
    return float((np.hypot(x, y) - r)[ahead].min())


IRSIM = """
world: {{height: 20, width: 20, step_time: 0.1, sample_time: 10, offset: [-10, -5], collision_mode: stop}}
robot:
  - kinematics: {{name: diff}}
    shape: {{name: circle, radius: 0.2}}
    state: [0, 0, 1.57]
    goal: [0, 10, 0]
    sensors: [{{type: lidar2d, range_min: 0, range_max: {range}, angle_range: 4.71238, number: {beams}}}]
obstacle:
{obstacles}
"""


def irsim_steps(level: Level, beams: int, steps: int) -> Callable[[], int]:
    """A robot with a lidar in ir-sim, without a picture."""
    import irsim  # pyright: ignore[reportMissingImports]

    text = IRSIM.format(
        range=RANGE_M,
        beams=beams,
        obstacles="\n".join(
            f"  - {{shape: {{name: circle, radius: {r}}}, state: [{x:.4f}, {y:.4f}, 0]}}"
            for x, y, r in level.world.solids_at(0.0).discs.tolist()
        ),
    )
    file = Path(tempfile.mkdtemp()) / "world.yaml"
    file.write_text(text)
    env = irsim.make(str(file), headless=True, display=False, disable_all_plot=True, log_level="ERROR")
    few = max(3, steps // 400)

    def run() -> int:
        for _ in range(few):
            env.step(np.array([[0.0], [0.5]]))
        return few

    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--barn", type=Path, help="folder with BARN's worlds.npz")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--number", type=int, default=256)
    parser.add_argument("--peers", action="store_true", help="navground and ir-sim, too")
    parser.add_argument("--stack", action="store_true", help="PlannerParams, too")
    args = parser.parse_args()
    found = {level.name: level for level in (read_levels(args.barn) if args.barn else read_levels("barn", count=8))}
    level = found["world 295" if args.barn else "world 6"]
    print(f"{navstack.gym.__name__}: {level.name} with {len(level.world.solids_at(0.0).discs)} cylinders")
    for beams in (640, 180):
        for kind, shown in (("discs", level), ("cells", as_cells(level))):
            best(f"LocalControl, {beams} beams, {kind}", single(shown, beams, args.steps))
            best(
                f"LocalControl, {beams} beams, {kind}, {args.number} in a vector, {args.threads} threads",
                vector(shown, beams, args.steps, args.number, args.threads),
            )
        for agents in (1, 10, 50):
            best(f"LocalControl, {beams} beams, {agents} agents in a warehouse", together(agents, beams, args.steps))
        for name, peer in (("navground", navground_steps), ("ir-sim", irsim_steps)) if args.peers else ():
            try:
                best(f"{name}, {beams} beams", peer(level, beams, args.steps))
            except ImportError:
                print(f"{name} is not installed")
    if args.stack:
        best("PlannerParams, turtlebot in the office", parameters(200, levels="office"))
        best("PlannerParams, BARN with jackal_dwa", parameters(60, levels=[level], robot="jackal_dwa", overrides=()))


if __name__ == "__main__":
    main()
