"""`navstack/LocalControl-v0`: an agent instead of the local planner; single and vectorized, on the same kernel."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, ClassVar, Final, Literal

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from navstack.core import InputError, Pose2D, Twist2D
from navstack.gym.levels import Level, Levels, level_number, level_weights, read_levels
from navstack.gym.render import DrawnRobot, LevelPicture
from navstack.gym.simulation import OUTCOMES, RESET, SKIP, STEP, TERMS, RobotModel, Simulation
from navstack.gym.task import (
    BUSY,
    ActionScale,
    Observation,
    Variation,
    check_reset_options,
    limits_of,
    make_task,
    refuse_unknown,
    reward_weights,
    robot_models,
)
from navstack.gym.watch import RENDER_MODES, ShownRun, Watch, check_render_mode
from navstack.parameters import Source, load_configuration
from navstack.scenario import Run, Scenario

END_KEYS: Final = ("path_length", "time_to_goal", "spl", "min_clearance", "barn_score")
"""Numbers of `info` at the end of an episode."""


class Core:
    """What the single and the vectorized environment share: the simulation, the spaces and the reports."""

    def __init__(
        self,
        number: int,
        threads: int,
        own: type[Any],
        same_step: bool = False,
        *,
        levels: Levels | Sequence[Levels] = "barn",
        split: str = "train",
        count: int | None = None,
        level_seed: int = 0,
        robot: Source | Sequence[Source] = "jackal_dwa",
        overrides: Sequence[str] = (),
        period: float = 0.1,
        actions: Literal["box", "discrete"] = "box",
        collision: Literal["end", "stop"] = "end",
        reward: str | Mapping[str, float] = "ros_jackal",
        scan_clip: float = 5.0,
        goal_range: float = 10.0,
        plan: int = 0,
        last_action: bool = False,
        flat: bool = False,
        beams: int | None = None,
        randomize: Mapping[str, Variation] | None = None,
        variants: int = 64,
        max_episode_steps: int | None = None,
        **unknown: Any,
    ) -> None:
        refuse_unknown(unknown, Core.__init__, own.__init__)
        if actions not in ("box", "discrete"):
            raise InputError(f'actions is "{actions}"; it must be "box" or "discrete"', actions=actions)
        self.number = number
        sources = [robot] if isinstance(robot, (str, Mapping)) or not isinstance(robot, Sequence) else list(robot)
        self.configuration = load_configuration(sources, overrides=list(overrides))
        sim = self.configuration.navstack.sim
        models = robot_models(self.configuration, randomize or {}, variants, level_seed, beams)
        found = self._read(levels, models, split=split, count=count, seed=level_seed)
        self.scale = ActionScale.of(
            limits_of(self.configuration), holonomic=sim.kinematics == "holonomic", discrete=actions == "discrete"
        )
        weights = reward_weights(reward)
        self.terms = [(k, name) for k, name in enumerate(TERMS) if name in weights]
        task = make_task(
            period=period,
            frequency=sim.physics_frequency,
            collision=collision,
            clip=scan_clip,
            reach=goal_range,
            plan=plan,
            scale=self.scale,
            weights=weights,
            same_step=same_step,
            repeats_action=last_action,
        )
        repeated = self.scale.size if last_action else 0
        self.simulation = self._simulate(found, models, task, threads)
        number = self.simulation.number
        if max_episode_steps is not None:
            if max_episode_steps < 1:
                raise InputError(f"max_episode_steps is {max_episode_steps}; it must be at least 1")
            limit = self.simulation.rows["limit"]
            self.simulation.rows["limit"] = np.minimum(limit, max_episode_steps)
        self.observation = Observation.of(self.simulation.beams, plan, repeated, flat=flat)
        self.names = [level.name for level in found]
        self.footprints = [model.footprint for model in models]
        self.lidars = [model.lidar for model in models]
        self.seeds = [0] * number
        self.is_closed = self.is_reset = self._busy = False
        self.no_actions = np.zeros((number, self.scale.size))

    def _read(self, source: Any, models: Sequence[RobotModel], **options: Any) -> list[Level]:
        """Return the levels of the environments for these robots; `options`: other arguments of `read_levels`."""
        return read_levels(source, radius=max(model.footprint.inscribed_radius for model in models), **options)

    def _simulate(
        self, levels: Sequence[Level], models: Sequence[RobotModel], task: NDArray[np.void], threads: int
    ) -> Simulation:
        return Simulation(self.number, levels, models, task, actions=self.scale.size, threads=threads)

    def seed(self, index: int, seed: int) -> None:
        """Begin the sequence of episodes of a seed in one environment."""
        self.seed_from(index, seeding.np_random(seed)[0], seed)

    def seed_from(self, index: int, rng: np.random.Generator, seed: int) -> None:
        """As `seed`, with a generator of that seed."""
        episode = self.simulation.batch.episodes[index]
        episode["seed_key"], episode["episode"], episode["wanted_level"] = int(rng.integers(1 << 63)), -1, -1
        self.seeds[index] = seed

    def want_level(self, index: int, level: Any) -> None:
        """Set the level of the next episode, by name or number. Raises InputError."""
        self.simulation.batch.episodes[index]["wanted_level"] = level_number(level, self.names)

    def run(self, todo: Any, actions: NDArray[np.float64]) -> None:
        """Step or reset: `todo` is one number, or one per environment. Raises InputError while another thread does."""
        if self._busy:
            raise InputError(BUSY)
        self._busy = True
        try:
            self.simulation.todo[:] = todo
            self.simulation.advance(actions)
        finally:
            self._busy = False

    def check_open(self) -> None:
        """Raise InputError if the environment is closed, or another thread uses it."""
        if self.is_closed:
            raise InputError("the environment is closed; make a new one")
        if self._busy:
            raise InputError(BUSY)

    def drawn(self, index: int, *, has_ended: bool = False) -> DrawnRobot:
        """Return what a picture shows of the robot of one environment; without its lidar, if its episode has ended."""
        simulation, state = self.simulation, self.simulation.batch.states[index]
        variant = simulation.batch.episodes[index]["variant"]
        pose = float(state["x"]), float(state["y"]), float(state["yaw"])
        if has_ended:
            return DrawnRobot(self.footprints[variant], pose, None)
        return DrawnRobot.of(
            self.footprints[variant],
            pose,
            simulation.robots.variants[variant]["lidar"],
            simulation.robots.beams[variant],
            simulation.outputs.observations[index, : simulation.beams],
            float(simulation.task["clip"][0]),
        )

    def set_weights(self, weights: Sequence[float]) -> None:
        """Set how often each level is drawn, in proportion. Raises InputError."""
        self.simulation.cumulative[:] = np.cumsum(level_weights(weights, len(self.names)))

    def close(self) -> None:
        """End the threads."""
        self.is_closed = True
        self.simulation.close()


class LocalControlEnv(gymnasium.Env[Any, Any]):
    """An agent commands velocities to a simulated robot, from its lidar, its goal and its velocity.

    One step is one control period. Terminated: the goal is reached, or with `collision="end"` the robot has collided. Truncated:
    the time limit of the level.
    """

    metadata: ClassVar[dict[str, Any]] = {  # pyright: ignore[reportIncompatibleVariableOverride]
        "render_modes": list(RENDER_MODES),
        "render_fps": 10,
    }

    def __init__(self, *, render_mode: str | None = None, port: int = 0, **options: Any) -> None:
        """Make the environment.

        Args:
            render_mode: None, `rgb_array`, or `live`: a page in the browser shows the episodes and sets their pace.
            port: of that page; 0 is any free one.
            options: what follows.
            levels: see `read_levels`; `split`, `count` and `level_seed` are its arguments.
            robot: parameter set, folder, files or dictionary of the robot; a list adds them up. Its section `navstack: sim:` is
                simulated, the velocity limits are those of its local planner.
            overrides: `NAME=VALUE`, which override the parameters.
            period: seconds of a step, a multiple of the physics step.
            actions: `box`: -1 .. 1 for forward (sideways, if the robot can) and turning; `discrete`: 15 pairs.
            collision: `end`: a collision ends the episode; `stop`: the robot stops there and goes on.
            reward: name of a preset, or weights of terms by name (see `REWARDS`); with `preset` as a key, changes of that.
            scan_clip: larger ranges (m) count as free; the observation is range / scan_clip.
            goal_range: larger distances (m) to the goal count as this one.
            plan: points of a path to the goal in the observation, 0.5 m apart.
            last_action: repeat the last action in the observation.
            flat: one array instead of a dictionary.
            beams: of the lidar, if not as in the parameters.
            randomize: parameters of the simulated robot that vary from episode to episode: `{"velocity_lag": (0.0, 0.2)}`.
            variants: number of robots drawn for `randomize`.
            max_episode_steps: shortens the time limits of the levels.

        Raises NavError for invalid arguments.
        """
        check_render_mode(render_mode, port)
        self.render_mode = render_mode
        self._core = core = Core(1, 1, LocalControlEnv, **options)
        self._watch = Watch(port, self._shown) if render_mode == "live" else None
        self.observation_space = core.observation.space
        self.action_space = core.scale.space
        self._picture: LevelPicture | None = None
        outputs = core.simulation.outputs
        self._row, self._info, self._terms = outputs.observations[0], outputs.infos[0], outputs.terms[0]
        self._rewards, self._terminated, self._truncated = outputs.rewards, outputs.terminated, outputs.truncated
        self._needs_reset = True
        frames = round(1.0 / float(core.simulation.task["period"][0]))
        self.metadata = {**self.metadata, "render_fps": frames}  # pyright: ignore[reportAttributeAccessIssue, reportIncompatibleVariableOverride]

    @property
    def levels(self) -> list[str]:
        """Names of the levels."""
        return list(self._core.names)

    def set_level_weights(self, weights: Sequence[float]) -> None:
        """Set how often each level is drawn from now on, in proportion (one weight per level)."""
        self._core.set_weights(weights)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin the next episode; `options={"level": NAME or NUMBER}` chooses its level."""
        if self._watch is None:
            return self._reset(seed, options)
        return self._watch.reset(partial(self._reset, seed, options))

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive for one control period with the velocity of the action."""
        return self._step(action) if self._watch is None else self._watch.step(partial(self._step, action))

    def _reset(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        core = self._core
        core.check_open()
        if seed is not None or not core.is_reset:
            core.seed_from(0, self.np_random, self.np_random_seed)
            core.is_reset = True
        options = {} if options is None else options
        check_reset_options(options, ("level",))
        if "level" in options:
            core.want_level(0, options["level"])
        core.run(RESET, core.no_actions)
        self._needs_reset = False
        if self._picture is not None:
            self._picture.begin_episode()
        return core.observation.of_row(self._row.copy()), self._report()

    def _step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        core = self._core
        if self._needs_reset or core.is_closed:
            core.check_open()
            raise InputError("the episode has ended or not begun; call reset() before step()")
        values = core.scale.read(action, 1)
        core.run(STEP, values)
        terminated, truncated = bool(self._terminated[0]), bool(self._truncated[0])
        self._needs_reset = terminated or truncated
        info = self._report()
        terms = self._terms.tolist()
        info["reward_terms"] = {name: terms[k] for k, name in core.terms}
        if self._needs_reset:
            info |= self._end()
        if self._watch is not None:
            self._update_shown()
            self._watch.seen()
        return core.observation.of_row(self._row.copy()), float(self._rewards[0]), terminated, truncated, info

    def _shown(self) -> tuple[Scenario, Run]:
        """Return the episode as pages show it."""
        core = self._core
        variant = core.simulation.batch.episodes[0]["variant"]
        level = core.simulation.levels[self._info["level"]]
        limits = limits_of(core.configuration)
        self._page_run = ShownRun(core.configuration, level, core.footprints[variant], core.lidars[variant], limits)
        self._update_shown()
        return self._page_run.scenario, self._page_run.run

    def _update_shown(self) -> None:
        """Tell the page of the last step."""
        core, info, state = self._core, self._info, self._core.simulation.batch.states[0]
        shares, clip = self._row[: core.simulation.beams], np.float32(core.simulation.task["clip"][0])
        self._page_run.update(
            float(info["time"]),
            Pose2D(float(info["x"]), float(info["y"]), float(info["yaw"])),
            Twist2D(float(state["vx"]), float(state["vy"]), float(state["wz"])),
            Twist2D(float(state["command_vx"]), float(state["command_vy"]), float(state["command_wz"])),
            np.where(shares < 1.0, shares * clip, np.float32(np.inf)),
            clearance=float(info["clearance"]),
            collisions=int(info["collisions"]),
            outcome=OUTCOMES[info["outcome"]],
        )

    _page_run: ShownRun

    def _report(self) -> dict[str, Any]:
        time, x, y, yaw, clearance, *_ = self._info.item()
        collisions = int(self._info["collisions"])
        return {"time": time, "pose": np.array([x, y, yaw]), "collisions": collisions, "clearance": clearance}

    def _end(self) -> dict[str, Any]:
        info = self._info
        return {
            "is_success": OUTCOMES[info["outcome"]] == "goal",
            "outcome": OUTCOMES[info["outcome"]],
            **{key: float(info[key]) for key in END_KEYS},
            "scenario": self._core.names[info["level"]],
            "seed": self._core.seeds[0],
        }

    def render(self) -> NDArray[np.uint8] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return a picture (height, width, 3) of the world, the robot and its way with `rgb_array`, else None."""
        if self.render_mode != "rgb_array":
            return None
        core = self._core
        core.check_open()
        if not core.is_reset:
            raise InputError("there is nothing to draw yet; call reset() before render()")
        if self._picture is None:
            self._picture = LevelPicture()
        level = core.simulation.levels[self._info["level"]]
        return self._picture.draw([level], [core.drawn(0)])

    def close(self) -> None:
        """Close the environment; a second time does nothing."""
        if self._watch is not None:
            self._watch.close()
        self._core.close()
        if self._picture is not None:
            self._picture.close()
            self._picture = None


class LocalControlVectorEnv(VectorEnv[Any, Any, Any]):
    """Many `LocalControlEnv` in one kernel: each is the same, to the bit, as a single one with its seed."""

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """`options` as of `LocalControlEnv`; `threads` share the environments (default: the processors, from 32 on)."""
        if num_envs < 1:
            raise InputError(f"num_envs is {num_envs}; it must be at least 1", num_envs=num_envs)
        if render_mode is not None:
            raise InputError("the vector environment draws nothing; use render_mode with a single one")
        try:
            self._mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = ", ".join(mode.value for mode in AutoresetMode)
            raise InputError(f'autoreset_mode is "{autoreset_mode}"; it must be one of {modes}') from None
        if threads is None:
            threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
            threads = threads if num_envs >= 32 else 1
        if threads < 1:
            raise InputError(f"threads is {threads}; it must be at least 1", threads=threads)
        same_step = self._mode is AutoresetMode.SAME_STEP
        self._core = core = Core(num_envs, threads, LocalControlVectorEnv, same_step, **options)
        self.num_envs = num_envs
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self.single_observation_space, self.single_action_space = core.observation.space, core.scale.space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.ones(num_envs, np.bool_)

    @property
    def levels(self) -> list[str]:
        """Names of the levels."""
        return list(self._core.names)

    def set_level_weights(self, weights: Sequence[float]) -> None:
        """Set how often each level is drawn from now on, in proportion (one weight per level)."""
        self._core.set_weights(weights)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the next episode everywhere, or where `options["reset_mask"]` (n,) is True; environment i has the seed + i.

        `options["level"]`: level of all, or a list of one per environment (None: drawn).
        """
        core = self._core
        core.check_open()
        options = {} if options is None else options
        check_reset_options(options, ("level", "reset_mask"))
        mask = np.asarray(options.get("reset_mask", np.ones(self.num_envs, np.bool_)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise InputError(f"reset_mask must be {self.num_envs} booleans, at least one of them True")
        if not core.is_reset and not mask.all():
            raise InputError("the first reset must be of all environments; leave out reset_mask")
        if seed is None and not core.is_reset:
            seed = int(np.random.SeedSequence().generate_state(1)[0])
        if seed is not None:
            self._seed(
                [seed + i for i in range(self.num_envs)] if isinstance(seed, (int, np.integer)) else list(seed), mask
            )
        core.is_reset = True
        levels = options.get("level")
        if levels is not None:
            each = [levels] * self.num_envs if isinstance(levels, (str, int, np.integer)) else list(levels)
            if len(each) != self.num_envs:
                raise InputError(f"{len(each)} levels were given for {self.num_envs} environments")
            for i, level in enumerate(each):
                if level is not None and mask[i]:
                    core.want_level(i, level)
        core.run(np.where(mask, RESET, SKIP), core.no_actions)
        self._ended &= ~mask
        return self._observations(), self._report(core.simulation.outputs.infos, mask)

    def _seed(self, seeds: Sequence[int | None], mask: NDArray[np.bool_]) -> None:
        if len(seeds) != self.num_envs:
            raise InputError(
                f"{len(seeds)} seeds were given for {self.num_envs} environments; give one each, or a number"
            )
        for i, one in enumerate(seeds):
            if one is not None and mask[i]:
                self._core.seed(i, int(one))
            elif not self._core.is_reset:
                self._core.seed(i, int(np.random.SeedSequence().generate_state(1)[0]))

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Drive all robots for one control period; those whose episode ended behave as the autoreset mode says."""
        core, mode = self._core, self._mode
        core.check_open()
        if not core.is_reset:
            raise InputError("no episode has begun; call reset() before step()")
        if mode is AutoresetMode.DISABLED and self._ended.any():
            raise InputError(
                f"the episode of environment {int(np.flatnonzero(self._ended)[0])} has ended; call "
                "reset(options={'reset_mask': terminated | truncated}) first, or use another autoreset_mode"
            )
        values = core.scale.read(actions, self.num_envs)
        core.run(np.where(self._ended, RESET, STEP), values)
        outputs = core.simulation.outputs
        stepped = ~self._ended
        terminated, truncated = outputs.terminated.copy(), outputs.truncated.copy()
        ended = terminated | truncated
        self._ended = np.zeros_like(ended) if mode is AutoresetMode.SAME_STEP else ended
        everywhere = np.ones(self.num_envs, np.bool_)
        infos = self._report(outputs.infos, everywhere)
        terms = self._terms(stepped)
        infos |= {"reward_terms": terms, "_reward_terms": stepped}
        if ended.any():
            if mode is not AutoresetMode.SAME_STEP:
                infos |= self._ends(outputs.infos, ended)
            else:
                last = self._report(outputs.last_infos, ended)
                last |= {"reward_terms": terms, "_reward_terms": ended.copy(), **self._ends(outputs.last_infos, ended)}
                final = np.full(self.num_envs, None, dtype=object)
                for i in np.flatnonzero(ended).tolist():
                    final[i] = core.observation.of_row(outputs.last_observations[i].copy())
                infos |= {
                    "final_obs": final,
                    "_final_obs": ended.copy(),
                    "final_info": last,
                    "_final_info": ended.copy(),
                }
        return self._observations(), outputs.rewards.copy(), terminated, truncated, infos

    def _observations(self) -> Any:
        return self._core.observation.of_rows(self._core.simulation.outputs.observations.copy())

    @staticmethod
    def _report(rows: NDArray[np.void], mask: NDArray[np.bool_]) -> dict[str, Any]:
        values = {
            "time": rows["time"].copy(),
            "pose": np.stack((rows["x"], rows["y"], rows["yaw"]), axis=1),
            "collisions": rows["collisions"].copy(),
            "clearance": rows["clearance"].copy(),
        }
        return values | {f"_{key}": mask.copy() for key in values}

    def _terms(self, mask: NDArray[np.bool_]) -> dict[str, Any]:
        terms = self._core.simulation.outputs.terms
        values = {name: terms[:, k].copy() for k, name in self._core.terms}
        return values | {f"_{name}": mask.copy() for name in values}

    def _ends(self, rows: NDArray[np.void], mask: NDArray[np.bool_]) -> dict[str, Any]:
        """Return what `info` says of the environments of the mask, whose episodes have ended."""
        core = self._core
        outcomes, scenarios = (np.full(self.num_envs, None, dtype=object) for _ in range(2))
        seeds = np.zeros(self.num_envs, np.int64)
        for i in np.flatnonzero(mask).tolist():
            outcomes[i], scenarios[i] = OUTCOMES[rows["outcome"][i]], core.names[rows["level"][i]]
            seeds[i] = core.seeds[i]
        values = {
            "is_success": mask & (rows["outcome"] == OUTCOMES.index("goal")),
            "outcome": outcomes,
            **{key: np.where(mask, rows[key], 0.0) for key in END_KEYS},
            "scenario": scenarios,
            "seed": seeds,
        }
        return values | {f"_{key}": mask.copy() for key in values}

    def close_extras(self, **_: Any) -> None:
        """End the threads."""
        self._core.close()
