"""Several agents in one world, as a PettingZoo parallel environment: `navstack/LocalControl-v0` for each of them.

The bodies move together in the compiled step of fleets; lidar, observation, reward and end of each agent are those of the kernel
of `LocalControl`, whose worlds have the outlines of the other agents among their polygons.
"""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple

import numpy as np
import shapely
from gymnasium import Space
from gymnasium.utils import seeding
from numpy.typing import NDArray

from navstack.core import InputError, kernel, require
from navstack.gym.levels import Level, level_number, level_weights
from navstack.gym.local_control import END_KEYS, Core
from navstack.gym.render import LevelPicture
from navstack.gym.scenes import read_scenes
from navstack.gym.simulation import (
    OUTCOMES,
    RobotModel,
    Simulation,
    Worlds,
    begin_episode,
    drive_noise,
    newest_scan,
    observe,
    report_state,
    report_step,
    take_action,
    true_clearance,
)
from navstack.sim import (
    DRIVEN_HIT,
    SAMPLE_SIZE,
    Outlines,
    SolidGeometry,
    drive_together,
    pack_outlines,
    place_polygons,
)

if TYPE_CHECKING:
    from pettingzoo import ParallelEnv
else:
    ParallelEnv = require("pettingzoo", "navstack.gym.LocalControlParallelEnv").ParallelEnv

NO_HIT, WORLD_HIT = -2, -1
AWAY_M: Final = 1e6
"""Where agents are that have left."""


class Bodies(NamedTuple):
    """The agents as obstacles of each other."""

    outlines: Outlines
    outline_of_variant: Outlines
    tops: NDArray[np.float64]
    """(variants,) heights of the bodies (m)."""
    struck: NDArray[np.int64]
    """(n,) the agent that each has driven into in the last step, or `WORLD_HIT`, `NO_HIT`."""
    leaves: NDArray[np.bool_]
    """(1,) agents whose episode has ended leave the world."""


# --- the kernel -------------------------------------------------------------------------------------------------------


@kernel
def place_others(i, step, batch, worlds, number, bodies):
    """Put the other agents, as they were at a physics step, behind the polygons of world `number`, which agent `i` sees."""
    n = batch.states.shape[0]
    poses = np.empty((n, 3))
    for j in range(n):
        poses[j] = batch.history[j, step % batch.history.shape[1]]
        if not np.isnan(batch.bodies[j].fixed_yaw):
            poses[j, 2] = batch.bodies[j].fixed_yaw
    outlines, place = bodies.outlines, worlds.places[number]
    corners, circles = place_polygons(outlines.corners, outlines.first, outlines.centers, poses)
    at = place.polygons_at + place.polygons - (n - 1)
    corner = place.corners_at + place.corner_count - (corners.shape[0] - outlines.first[i + 1] + outlines.first[i])
    for j in range(n):
        if j != i:
            worlds.circles[at] = circles[j]
            for k in range(outlines.first[j], outlines.first[j + 1]):
                worlds.corners[corner] = corners[k]
                corner += 1
            at += 1


@kernel
def begin_together(batch, robots, worlds, levels, cumulative, outputs, bodies):
    """Begin an episode: the level of agent 0 is drawn, the levels of the others follow it."""
    n = batch.states.shape[0]
    outlines, shapes = bodies.outlines, bodies.outline_of_variant
    for i in range(n):
        if i > 0:
            batch.episodes[i].wanted_level = outputs.infos[0].level + i
        begin_episode(i, batch, robots, levels, cumulative, outputs.infos[i])
        variant = batch.episodes[i].variant
        outlines.corners[outlines.first[i] : outlines.first[i + 1]] = shapes.corners[
            shapes.first[variant] : shapes.first[variant + 1]
        ]
        outlines.centers[i] = shapes.centers[variant]
    for i in range(n):
        place = worlds.places[levels[outputs.infos[i].level].world]
        top = place.tops_at + place.discs + place.polygons - (n - 1)
        for j in range(n):
            if j != i:
                worlds.tops[top] = bodies.tops[batch.episodes[j].variant]
                top += 1


@kernel
def move_together(batch, robots, worlds, number, task, bodies):
    """Drive all agents for one control step; return the number of new collisions of each (n,).

    `number`: the world of agent 0, whose solids before those of the other agents are the solids of the world.
    """
    n = batch.states.shape[0]
    place = worlds.places[number]
    cells, still = place.ny * place.nx, place.polygons - (n - 1)
    first = worlds.first[place.first_at : place.first_at + still + 1]
    solids = SolidGeometry(
        worlds.discs[place.discs_at : place.discs_at + place.discs],
        worlds.circles[place.polygons_at : place.polygons_at + still],
        worlds.corners[place.corners_at : place.corners_at + first[still]],
        first,
    )
    squares = worlds.squares[4 * place.cells_at : 4 * (place.cells_at + cells)].reshape((4, place.ny, place.nx))
    known = place.discs + still
    noisy = False
    for i in range(n):
        noisy = noisy or robots.variants[batch.episodes[i].variant].noisy
    noise = np.zeros((n, 1 if noisy else 0, 8))
    samples = np.empty((n, 1, SAMPLE_SIZE))
    nearest = np.zeros((n, 3))  # no distance is below 0: the distances between the agents are not computed
    hits = np.zeros(n, np.int64)
    for step in range(task.physics_steps):
        for i in range(n):
            episode, state = batch.episodes[i], batch.states[i]
            variant = robots.variants[episode.variant]
            # until its delay has passed, the command before is in force
            age = variant.command_delay // task.physics_steps
            if step < variant.command_delay - age * task.physics_steps:
                age += 1
            state.command_vx, state.command_vy = episode.given[3 * age], episode.given[3 * age + 1]
            state.command_wz = episode.given[3 * age + 2]
            if variant.noisy:
                noise[i] = drive_noise(episode, variant, 1)
        new = drive_together(
            batch.states,
            batch.bodies,
            bodies.outlines,
            noise,
            squares,
            worlds.grids[number],
            solids,
            samples,
            nearest,
            batch.episodes[0].physics_step,
        )
        for i in range(n):
            hits[i] += new[i]
            hit = -2 - int(samples[i, 0, DRIVEN_HIT])
            if hit != -1:
                bodies.struck[i] = hit - known if hit >= known else WORLD_HIT
            episode = batch.episodes[i]
            episode.physics_step += 1
            for column in range(3):
                batch.history[i, episode.physics_step % batch.history.shape[1], column] = samples[i, 0, column]
    return hits


@kernel
def advance_together(begins, live, actions, batch, robots, worlds, levels, cumulative, tasks, outputs, bodies):
    """Begin an episode of all agents, or step those that are `live` (n,); the others stand, or have left.

    `actions` (n, 2 or 3), `cumulative` and `tasks` as of `advance`.
    """
    n, task = batch.states.shape[0], tasks[0]
    if begins:
        begin_together(batch, robots, worlds, levels, cumulative, outputs, bodies)
    was = np.empty((n, 2))
    change = np.zeros(n)
    hits = np.zeros(n, np.int64)
    bodies.struck[:] = NO_HIT
    if not begins:
        for i in range(n):
            episode, state = batch.episodes[i], batch.states[i]
            was[i, 0], was[i, 1] = state.x, state.y
            if live[i]:
                change[i] = take_action(episode, task, actions[i])
                continue
            for k in range(episode.given.shape[0]):
                episode.given[k] = 0.0
            if bodies.leaves[0]:
                batch.states[i] = robots.blank[0]
                state.x, state.y = AWAY_M + 100.0 * i, AWAY_M
        hits = move_together(batch, robots, worlds, levels[outputs.infos[0].level].world, task, bodies)
    for i in range(n):
        if not live[i]:
            continue
        episode = batch.episodes[i]
        level = levels[outputs.infos[i].level]
        place_others(i, episode.physics_step, batch, worlds, level.world, bodies)
        clear = true_clearance(i, batch, robots, worlds, level.world)
        if not begins:
            episode.control_step += 1
        scanned = newest_scan(episode, robots.variants[episode.variant])[1]
        if scanned != episode.physics_step:
            place_others(i, scanned, batch, worlds, level.world, bodies)
        lowest = observe(i, batch, robots, worlds, level, task, outputs.observations[i])
        if begins:
            outputs.rewards[i] = 0.0
            outputs.terms[i] = 0.0
            outputs.terminated[i] = outputs.truncated[i] = False
            report_state(i, batch, task, clear, outputs.infos[i])
        else:
            at = (was[i, 0], was[i, 1])
            report_step(i, batch, level, task, at, hits[i], clear, lowest, change[i], outputs)


# --- from objects to arrays -------------------------------------------------------------------------------------------


def with_others(worlds: Worlds, agents: int, corners: int) -> Worlds:
    """Return each world `agents` times, with room for the outlines of the others, of `corners` corners each, behind its polygons.

    Cells and discs are shared.
    """
    places = np.repeat(worlds.places, agents)
    circles, points, first, tops = list[Any](), list[Any](), list[Any](), list[Any]()
    at = dict.fromkeys(("polygons_at", "corners_at", "first_at", "tops_at"), 0)
    others = agents - 1
    for k, place in enumerate(places):
        known = worlds.places[k // agents]
        for name, value in at.items():
            place[name] = value
        polygons, count, discs = int(known["polygons"]), int(known["corner_count"]), int(known["discs"])
        place["polygons"], place["corner_count"] = polygons + others, count + others * corners
        circles += [_part(worlds.circles, known["polygons_at"], polygons), np.zeros((others, 3))]
        points += [_part(worlds.corners, known["corners_at"], count), np.zeros((others * corners, 2))]
        first += [_part(worlds.first, known["first_at"], polygons + 1), count + corners * np.arange(1, others + 1)]
        tops += [_part(worlds.tops, known["tops_at"], discs + polygons), np.zeros(others)]
        at["polygons_at"] += polygons + others
        at["corners_at"] += count + others * corners
        at["first_at"] += polygons + 1 + others
        at["tops_at"] += discs + polygons + others
    return worlds._replace(
        places=places,
        grids=np.repeat(worlds.grids, agents, axis=0),
        circles=np.concatenate(circles),
        corners=np.concatenate(points),
        first=np.concatenate(first).astype(np.int64),
        tops=np.concatenate(tops),
    )


def _part(array: NDArray[Any], begin: int, size: int) -> NDArray[Any]:
    return array[begin : begin + size]


class SharedSimulation(Simulation):
    """N agents in one world: level k * N + i is that of agent i in scene k."""

    def __init__(
        self,
        agents: int,
        levels: Sequence[Level],
        robots: Sequence[RobotModel],
        task: NDArray[np.void],
        *,
        actions: int,
        leaves: bool,
    ) -> None:
        """`leaves`: agents whose episode has ended leave the world. Raises InputError for starts that overlap."""
        largest = max((model.footprint for model in robots), key=lambda footprint: footprint.circumscribed_radius)
        for k in range(0, len(levels), agents):
            outlines = [(level.name, shapely.Polygon(largest.at(level.start))) for level in levels[k : k + agents]]
            for (one, a), (other, b) in itertools.combinations(outlines, 2):
                if a.intersects(b):
                    raise InputError(
                        f"the starts of {one} and {other} overlap for this robot; move one, or use a smaller robot"
                    )
        vertices = [model.footprint.vertices for model in robots]
        corners, starts, centers = pack_outlines([vertices[0]] * agents)
        tops = [np.inf if model.params.body_height is None else model.params.body_height for model in robots]
        self.bodies = Bodies(
            Outlines(corners, starts, centers),
            Outlines(*pack_outlines(vertices)),
            np.array(tops, np.float64),
            np.full(agents, NO_HIT, np.int64),
            np.array([leaves]),
        )
        self.live = np.ones(agents, np.bool_)
        """(n,) agents whose episode goes on."""
        super().__init__(agents, levels, robots, task, actions=actions)

    def _load(self, actions: int) -> None:
        agents = self.number
        self.worlds = with_others(self.worlds, agents, len(self.bodies.outlines.corners) // agents)
        agent = np.arange(len(self.rows)) % agents
        self.rows["world"] = self.rows["world"] * agents + agent
        # a scene is drawn as the level of its first agent
        self.cumulative = np.repeat(np.arange(1.0, len(self.rows) // agents + 1.0), agents)
        arrays = self.batch, self.robots, self.worlds, self.rows, self.cumulative, self.task, self.outputs, self.bodies
        self._shared: tuple[Any, ...] = arrays
        compiled = advance_together.dispatcher
        arguments = (True, self.live, np.zeros((agents, actions)), *self._shared)
        self._run: Callable[..., None] = compiled.compile(tuple(map(compiled.typeof_pyval, arguments)))

    def begin(self, actions: NDArray[np.float64]) -> None:
        """Begin an episode of all agents."""
        self.live[:] = True
        self._run(True, self.live, actions, *self._shared)

    def step(self, actions: NDArray[np.float64]) -> None:
        """Step the agents that are live."""
        self._run(False, self.live, actions, *self._shared)


class _SharedCore(Core):
    """The simulation, the spaces and the reports of the agents."""

    simulation: SharedSimulation

    def __init__(self, agents: int | None, leaves: bool, **options: Any) -> None:
        self._agents, self._leaves = agents, leaves
        self.scenes: list[str] = []
        super().__init__(0, 1, LocalControlParallelEnv, **options)

    def _read(self, source: Any, models: Sequence[RobotModel], **options: Any) -> list[Level]:
        radius = max(model.footprint.circumscribed_radius for model in models)
        scenes = read_scenes(source, agents=self._agents, radius=radius, **options)
        self.scenes = [scene.name for scene in scenes]
        self.number = len(scenes[0].levels)
        return [level for scene in scenes for level in scene.levels]

    def _simulate(
        self, levels: Sequence[Level], models: Sequence[RobotModel], task: NDArray[np.void], threads: int
    ) -> Simulation:
        del threads
        return SharedSimulation(self.number, levels, models, task, actions=self.scale.size, leaves=self._leaves)

    def set_weights(self, weights: Sequence[float]) -> None:
        """Set how often each scene is drawn, in proportion. Raises InputError."""
        self.simulation.cumulative[:] = np.repeat(np.cumsum(level_weights(weights, len(self.scenes))), self.number)


# --- the environment --------------------------------------------------------------------------------------------------


class LocalControlParallelEnv(ParallelEnv[str, Any, Any]):
    """Agents command velocities to robots in one world, where they are obstacles of each other, seen by lidar and by contact.

    Spaces, rewards, ends and `info` are those of `LocalControlEnv`. An agent whose episode has ended is no longer in `agents`;
    its robot stops and remains in the way, or leaves the world. A contact counts for the agent that drives into another one.
    """

    metadata: ClassVar[dict[str, Any]] = {  # pyright: ignore[reportIncompatibleVariableOverride]
        "name": "navstack_local_control",
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        *,
        agents: int | None = None,
        ended: str = "stays",
        render_mode: str | None = None,
        levels: Any = "crossing",
        **options: Any,
    ) -> None:
        """Make the environment.

        Args:
            agents: number of agents, where the scenes do not determine it; 4 by default.
            ended: `stays`: the robot of an agent whose episode has ended stands in the way; `leaves`: it is taken away.
            render_mode: None or `rgb_array`.
            levels: see `read_scenes`; `split`, `count` and `level_seed` are its arguments.
            options: the others of `LocalControlEnv`; `randomize` draws a robot for each agent.

        Raises NavError for invalid arguments.
        """
        if render_mode not in (None, "rgb_array"):
            raise InputError(f'render_mode is "{render_mode}"; it must be None or "rgb_array"', render_mode=render_mode)
        if ended not in ("stays", "leaves"):
            raise InputError(f'ended is "{ended}"; it must be "stays" or "leaves"', ended=ended)
        self.render_mode = render_mode
        self._core = core = _SharedCore(agents, ended == "leaves", levels=levels, **options)
        self.possible_agents = [f"agent_{i}" for i in range(core.number)]
        self.agents: list[str] = []
        self._numbers = {name: i for i, name in enumerate(self.possible_agents)}
        # one object each: agents sample independently
        spaces = [(core.observation.space, core.scale.space) for _ in self.possible_agents]
        self.observation_spaces = {name: space for name, (space, _) in zip(self.possible_agents, spaces, strict=True)}
        self.action_spaces = {name: space for name, (_, space) in zip(self.possible_agents, spaces, strict=True)}
        self._picture: LevelPicture | None = None
        frames = round(1.0 / float(core.simulation.task["period"][0]))
        self.metadata = {**self.metadata, "render_fps": frames}  # pyright: ignore[reportAttributeAccessIssue, reportIncompatibleVariableOverride]

    def observation_space(self, agent: str) -> Space[Any]:
        """Return the observation space of an agent, the same object at each call."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[Any]:
        """Return the action space of an agent, the same object at each call."""
        return self.action_spaces[agent]

    @property
    def scenes(self) -> list[str]:
        """Names of the scenes."""
        return list(self._core.scenes)

    def set_scene_weights(self, weights: Sequence[float]) -> None:
        """Set how often each scene is drawn from now on, in proportion (one weight per scene)."""
        self._core.set_weights(weights)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin the next episode of all agents; `options={"level": NAME or NUMBER}` chooses the scene, others are ignored."""
        core = self._core
        core.check_open()
        if seed is not None or not core.is_reset:
            rng, drawn = seeding.np_random(seed)
            for i in range(core.number):
                core.seed_from(i, rng, int(drawn))
            core.is_reset = True
        if options and "level" in options:
            core.want_level(0, core.number * level_number(options["level"], core.scenes))
        core.simulation.begin(core.no_actions)
        if self._picture is not None:
            self._picture.begin_episode()
        self.agents = list(self.possible_agents)
        return self._observations(self.agents), {name: self._report(i) for name, i in self._numbers.items()}

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Drive for one control period with the velocities of the actions, one for each of `agents`."""
        core, agents = self._core, self.agents
        core.check_open()
        if not agents:
            raise InputError("the episode has ended or not begun; call reset() before step()")
        if set(actions) != set(agents):
            wrong = sorted(set(actions) ^ set(agents))
            raise InputError(
                f"actions are wanted of {', '.join(agents)}; missing or too many: {', '.join(wrong)}", agents=wrong
            )
        values = core.no_actions.copy()
        for name in agents:
            values[self._numbers[name]] = core.scale.read(actions[name], 1)[0]
        simulation = core.simulation
        simulation.step(values)
        outputs, numbers = simulation.outputs, [self._numbers[name] for name in agents]
        observations = self._observations(agents)
        rewards = {name: float(outputs.rewards[i]) for name, i in zip(agents, numbers, strict=True)}
        terminated = {name: bool(outputs.terminated[i]) for name, i in zip(agents, numbers, strict=True)}
        truncated = {name: bool(outputs.truncated[i]) for name, i in zip(agents, numbers, strict=True)}
        infos = {name: self._report(i) for name, i in zip(agents, numbers, strict=True)}
        for name, i in zip(agents, numbers, strict=True):
            terms = outputs.terms[i].tolist()
            infos[name]["reward_terms"] = {term: terms[k] for k, term in core.terms}
            if terminated[name] or truncated[name]:
                simulation.live[i] = False
                infos[name] |= self._end(i)
        self.agents = [name for name in agents if not (terminated[name] or truncated[name])]
        return observations, rewards, terminated, truncated, infos

    def _observations(self, agents: Sequence[str]) -> dict[str, Any]:
        rows, core = self._core.simulation.outputs.observations, self._core
        return {name: core.observation.of_row(rows[self._numbers[name]].copy()) for name in agents}

    def _report(self, i: int) -> dict[str, Any]:
        simulation = self._core.simulation
        info, struck = simulation.outputs.infos[i], int(simulation.bodies.struck[i])
        return {
            "time": float(info["time"]),
            "pose": np.array([info["x"], info["y"], info["yaw"]]),
            "collisions": int(info["collisions"]),
            "clearance": float(info["clearance"]),
            "contact": self.possible_agents[struck] if struck >= 0 else "world" if struck == WORLD_HIT else "",
        }

    def _end(self, i: int) -> dict[str, Any]:
        core, info = self._core, self._core.simulation.outputs.infos[i]
        return {
            "is_success": OUTCOMES[info["outcome"]] == "goal",
            "outcome": OUTCOMES[info["outcome"]],
            **{key: float(info[key]) for key in END_KEYS},
            "scenario": core.scenes[int(info["level"]) // core.number],
            "seed": core.seeds[i],
        }

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture (height, width, 3) of the world, the robots and their ways; None without a render mode."""
        if self.render_mode is None:
            return None
        core = self._core
        core.check_open()
        if not core.is_reset:
            raise InputError("there is nothing to draw yet; call reset() before render()")
        if self._picture is None:
            self._picture = LevelPicture()
        simulation = core.simulation
        first = int(simulation.outputs.infos["level"][0])
        robots = [core.drawn(i, has_ended=not simulation.live[i]) for i in range(core.number)]
        return self._picture.draw(simulation.levels[first : first + core.number], robots)

    def close(self) -> None:
        """Close the environment; a second time does nothing."""
        self._core.close()
        self.agents = []
        if self._picture is not None:
            self._picture.close()
            self._picture = None
