"""The environment of one robot and of many: the same bits as the simulator, alone, in a vector and on threads; resets; errors."""

from __future__ import annotations

import math
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import navstack.gym
from navstack.core import InputError, LaserScan, NavError, Pose2D, Twist2D
from navstack.gym import Level, LocalControlEnv, LocalControlVectorEnv, read_levels
from navstack.gym.simulation import fill_normals, uniform
from navstack.parameters import load_configuration
from navstack.sim import Shape, SimulatedRobot, World

NOISE = ["navstack/sim/wheel_slip=0.02", "navstack/sim/laser/range_noise=0.01", "navstack/sim/laser/dropout=0.05"]
NOISE += ["navstack/sim/localization_noise=0.02", "navstack/sim/odometry_noise=0.01"]


@pytest.fixture(scope="module")
def levels() -> list[Level]:
    return read_levels("barn", count=3)


def near_wall() -> Level:
    """A disc 1 m ahead: the robot hits it after a few steps."""
    return Level("near wall", World(None, [[1.5, 0.0, 0.5]]), Pose2D(0.0, 0.0, 0.0), Pose2D(4.0, 0.0, 0.0), length=4.2)


def rotated_map() -> Level:
    """Cells of a rotated grid, a disc, a polygon and a low object."""
    from navstack.core import GridGeometry, OccupancyGrid

    cells = np.zeros((80, 80), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[30:34, 40:60] = 100
    grid = OccupancyGrid(cells, GridGeometry(80, 80, 0.05, -1.0, -2.0), 0.3)
    shapes = [Shape(box=[0.4, 0.2], pose=[1.6, 0.6, 0.5]), Shape(radius=0.1, pose=[0.9, -0.6], height=0.1)]
    return Level("cells", World(grid, [[1.2, 0.0, 0.12]], shapes=shapes), Pose2D(0.0, 0.0, 0.3), Pose2D(1.5, 1.2, 0.0))


def bits(*values: Any) -> bytes:
    """The bytes of arrays and numbers, NaN included."""
    return b"".join(np.asarray(v).tobytes() for v in values)


def scans_of(robot: SimulatedRobot) -> list[LaserScan]:
    """The scans since the last call, without the clouds of the bumpers."""
    return [data for data in robot.scans() if isinstance(data, LaserScan)]


# --- against the simulator --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["navstack/sim/command_delay=0.13", "navstack/sim/velocity_lag=0.2", "navstack/sim/laser/delay=0.07"],
        ["navstack/sim/laser/frequency=15.0", "navstack/sim/acc_lim_x=1.0", "navstack/sim/jerk_lim_x=5.0"],
        [
            "global_costmap/footprint=[]",
            "local_costmap/footprint=[]",
            "robot_radius=0.2",
            "navstack/sim/laser/yaw=0.4",
            "navstack/sim/laser/y=0.1",
        ],
    ],
    ids=["plain", "delays", "slow lidar", "round"],
)
@pytest.mark.parametrize("place", ["cylinders", "cells"])
def test_poses_and_ranges_are_those_of_the_simulated_robot(
    overrides: list[str], place: str, levels: list[Level]
) -> None:
    level = levels[1] if place == "cylinders" else rotated_map()
    clip = 6.0
    env = LocalControlEnv(levels=level, overrides=overrides, collision="stop", scan_clip=clip, goal_range=20.0)
    configuration = load_configuration(["jackal_dwa"], overrides=overrides)
    sim = configuration.navstack.sim
    robot = SimulatedRobot(sim, level.world, configuration.local_costmap.true_footprint, level.start)
    observation, _ = env.reset(seed=0)
    rng = np.random.default_rng(3)
    scan = scans_of(robot) if sim.lidar("laser").delay == 0.0 else []
    action = np.zeros(2, np.float32)
    for step in range(120):
        if step % 8 == 0:  # towards the obstacles, and away from them
            action = rng.uniform(-1.0, 1.0, 2).astype(np.float32)
        shares = 0.5 * (action.astype(np.float64) + 1.0)
        robot.command(Twist2D(float(shares[0]), 0.0, float(-2.0 + shares[1] * 4.0)))
        robot.advance_to(round(0.1 * (step + 1), 6))
        observation, _, _, ended, info = env.step(action)
        assert info["pose"].tolist() == list(robot.pose), step
        scan = scans_of(robot) or scan
        ranges = np.maximum(scan[-1].ranges.astype(np.float64), 0.0)
        assert (observation["scan"] == (np.minimum(ranges, clip) / clip).astype(np.float32)).all(), step
        assert info["clearance"] == (0.0 if robot.in_collision else robot.clearance)
        assert info["collisions"] == len(robot.collisions)
        assert info["time"] == robot.time
    assert len(robot.collisions) > 0, "the robot should meet an obstacle"
    assert not ended


def test_the_observation_in_words() -> None:
    """A goal 4 m ahead at rest, a disc 1 m away in the middle beam, ranges scaled."""
    env = LocalControlEnv(levels=near_wall(), scan_clip=2.0, goal_range=8.0, beams=721, plan=2, last_action=True)
    observation, info = env.reset(seed=1)
    assert observation["goal"].tolist() == [0.5, 1.0, 0.0]
    assert observation["velocity"].tolist() == [0.0, 0.0, 0.0]
    assert observation["scan"][360] == pytest.approx((1.0 - 0.055) / 2.0, abs=1e-6)
    assert observation["last_action"].tolist() == [0.0, 0.0]
    assert info["clearance"] == pytest.approx(1.0 - 0.21)
    observation, reward, _, _, info = env.step(np.array([1.0, -0.5], np.float32))
    assert observation["last_action"].tolist() == [1.0, -0.5]
    assert observation["velocity"][0] == pytest.approx(1.0) and observation["velocity"][2] == pytest.approx(-0.5)
    assert reward == pytest.approx(info["reward_terms"]["progress"])
    flat = LocalControlEnv(
        levels=near_wall(), scan_clip=2.0, goal_range=8.0, beams=721, plan=2, last_action=True, flat=True
    )
    whole, _ = flat.reset(seed=1)
    again, _ = env.reset(seed=1)
    order = ("scan", "goal", "velocity", "plan", "last_action")
    assert (whole == np.concatenate([again[name].ravel() for name in order])).all()


def test_the_plan_leads_along_the_path() -> None:
    path = np.array([[0.0, 0.0], [0.0, 4.0]])
    points = np.linspace(path[0], path[1], 401)
    level = Level(
        "up", World(None, [[9.0, 9.0, 0.1]]), Pose2D(0.0, 0.0, math.pi / 2), Pose2D(0.0, 4.0, 0.0), path=points
    )
    env = LocalControlEnv(levels=level, plan=3, goal_range=10.0)
    observation, _ = env.reset(seed=0)
    wanted = np.array([[0.5, 0.0], [1.0, 0.0], [1.5, 0.0]]) / 5.0
    assert observation["plan"] == pytest.approx(wanted, abs=2e-3)
    for _ in range(38):
        observation, *_, info = env.step(np.array([1.0, 0.0], np.float32))
    left = 4.0 - info["pose"][1]
    assert 0.1 < left < 0.5
    assert observation["plan"] == pytest.approx(np.array([[left, 0.0]] * 3) / 5.0, abs=3e-3)


# --- the end of an episode --------------------------------------------------------------------------------------------


def test_goal_collision_and_timeout() -> None:
    def drive(level: Level, **options: Any) -> tuple[float, bool, bool, dict[str, Any]]:
        env = LocalControlEnv(levels=level, reward="jaxnav", **options)
        env.reset(seed=5)
        total = 0.0
        while True:
            _, reward, terminated, truncated, info = env.step(np.array([1.0, 0.0], np.float32))
            total += reward
            if terminated or truncated:
                return total, terminated, truncated, info

    free = Level("free", World(None, [[9.0, 9.0, 0.1]]), Pose2D(0.0, 0.0, 0.0), Pose2D(2.0, 0.0, 0.0), length=2.0)
    total, terminated, truncated, info = drive(free)
    assert (terminated, truncated, info["outcome"], info["is_success"]) == (True, False, "goal", True)
    assert info["time_to_goal"] == pytest.approx(1.8, abs=0.11)
    assert info["spl"] == 1.0 and info["barn_score"] == 0.5 and info["scenario"] == "free" and info["seed"] == 5
    steps = round(info["time"] / 0.1)
    assert total == pytest.approx(4.0 + 0.25 * info["path_length"] - 0.01 * steps, abs=1e-9)

    total, terminated, truncated, info = drive(near_wall())
    assert (terminated, truncated, info["outcome"], info["is_success"]) == (True, False, "collision", False)
    assert info["collisions"] == 1 and info["min_clearance"] == 0.0 and math.isnan(info["time_to_goal"])
    assert info["reward_terms"]["collision"] == -4.0 and info["reward_terms"]["near"] == -0.1

    _, terminated, truncated, info = drive(near_wall(), collision="stop", max_episode_steps=30)
    assert (terminated, truncated, info["outcome"]) == (False, True, "timeout")
    assert info["time"] == pytest.approx(3.0) and info["collisions"] == 1


def test_levels_are_drawn_by_their_weights(levels: list[Level]) -> None:
    env = LocalControlVectorEnv(200, levels=levels, autoreset_mode="Disabled")
    env.set_level_weights([1.0, 0.0, 3.0])
    env.reset(seed=0)
    drawn = np.bincount(env._core.simulation.outputs.infos["level"], minlength=3)
    assert drawn[1] == 0
    # 4 standard deviations of a binomial distribution
    assert abs(drawn[2] - 150) < 4.0 * math.sqrt(200 * 0.75 * 0.25)
    env.reset(options={"level": "world 1"})
    assert set(env._core.simulation.outputs.infos["level"].tolist()) == {1}


def test_episodes_draw_robots_of_the_variations() -> None:
    env = LocalControlVectorEnv(
        64,
        levels=near_wall(),
        randomize={"velocity_lag": (0.0, 0.3), "laser/range_noise": (0.0, 0.1), "footprint_scale": (0.8, 1.2)},
        variants=32,
    )
    env.reset(seed=0)
    assert len(set(env._core.simulation.batch.episodes["variant"].tolist())) > 15
    variants = env._core.simulation.robots.variants
    assert variants["range_noise"].min() < 0.02 < 0.08 < variants["range_noise"].max()
    assert variants["radius"].min() < 0.25 < 0.28 < variants["radius"].max()
    lags = env._core.simulation.robots.bodies["lag_factor"]
    assert lags.max() - lags.min() > 0.05 and lags.max() <= math.exp(-0.01 / 0.3)


def test_noise_has_its_standard_deviation() -> None:
    out = np.empty(100_001)
    fill_normals(np.uint64(12345), out)
    # 5 standard errors
    assert abs(out.mean()) < 5.0 / math.sqrt(len(out)) and abs(out.std() - 1.0) < 5.0 / math.sqrt(2 * len(out))
    assert abs(np.corrcoef(out[:-1], out[1:])[0, 1]) < 5.0 / math.sqrt(len(out))
    values = np.array([uniform(np.uint64(7), k) for k in range(2000)])
    assert values.min() >= 0.0 and values.max() < 1.0 and abs(values.mean() - 0.5) < 5.0 / math.sqrt(12 * len(values))


# --- one, many, threads -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("number", "threads"), [(1, 1), (7, 1), (7, 2), (256, 1), (256, 2)])
def test_single_and_vector_give_the_same_bits(number: int, threads: int, levels: list[Level]) -> None:
    options: dict[str, Any] = {
        "levels": levels,
        "overrides": NOISE,
        "beams": 60,
        "reward": "jaxnav",
        "flat": True,
        "randomize": {"velocity_lag": (0.0, 0.2), "command_delay": (0.0, 0.3)},
        "variants": 8,
        "max_episode_steps": 25,
    }
    vector = LocalControlVectorEnv(number, threads=threads, autoreset_mode="Disabled", **options)
    checked = sorted({0, number // 2, number - 1})
    single = {i: LocalControlEnv(**options) for i in checked}
    observations, _ = vector.reset(seed=100)
    for i, env in single.items():
        assert bits(env.reset(seed=100 + i)[0]) == bits(observations[i])
    rng = np.random.default_rng(0)
    for _ in range(60):
        actions = rng.uniform(-0.4, 1.0, (number, 2)).astype(np.float32)
        observations, rewards, terminated, truncated, infos = vector.step(actions)
        for i, env in single.items():
            observation, reward, a, b, info = env.step(actions[i])
            assert bits(observation, reward, a, b, info["pose"], info["clearance"]) == bits(
                observations[i], rewards[i], terminated[i], truncated[i], infos["pose"][i], infos["clearance"][i]
            )
        ended = terminated | truncated
        if ended.any():
            fresh, _ = vector.reset(options={"reset_mask": ended})
            for i, env in single.items():
                if ended[i]:
                    assert bits(env.reset()[0]) == bits(fresh[i])
    vector.close()


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_autoreset_modes_against_a_plain_loop(mode: AutoresetMode, levels: list[Level]) -> None:
    """A list of single environments, reset by hand, gives what each mode must give."""
    options: dict[str, Any] = {"levels": levels, "beams": 30, "max_episode_steps": 12, "overrides": NOISE}
    number = 5
    vector = LocalControlVectorEnv(number, autoreset_mode=mode, threads=2, **options)
    single = [LocalControlEnv(**options) for _ in range(number)]
    observations, _ = vector.reset(seed=7)
    plain = [env.reset(seed=7 + i)[0] for i, env in enumerate(single)]
    must_reset = [False] * number
    rng = np.random.default_rng(2)
    for _ in range(40):
        for i in range(number):
            assert all(bits(observations[name][i]) == bits(plain[i][name]) for name in plain[i])
        actions = rng.uniform(-1.0, 1.0, (number, 2)).astype(np.float32)
        observations, rewards, terminated, truncated, infos = vector.step(actions)
        for i, env in enumerate(single):
            if must_reset[i]:  # NEXT_STEP: the action is ignored
                plain[i], must_reset[i] = env.reset()[0], False
                assert (rewards[i], terminated[i], truncated[i]) == (0.0, False, False)
                assert not infos["_reward_terms"][i]
                continue
            plain[i], reward, a, b, info = env.step(actions[i])
            assert (rewards[i], terminated[i], truncated[i]) == (reward, a, b)
            terms = infos["reward_terms"]
            assert {name: terms[name][i] for name in info["reward_terms"]} == info["reward_terms"]
            if not (a or b):
                continue
            last = infos["final_info"] if mode is AutoresetMode.SAME_STEP else infos
            for key in ("is_success", "outcome", "path_length", "spl", "scenario", "seed", "min_clearance"):
                assert last[f"_{key}"][i] and last[key][i] == info[key]
            if mode is AutoresetMode.SAME_STEP:
                assert infos["_final_obs"][i]
                assert all(bits(infos["final_obs"][i][name]) == bits(plain[i][name]) for name in plain[i])
                plain[i] = env.reset()[0]
            else:
                must_reset[i] = mode is AutoresetMode.NEXT_STEP
        ended = terminated | truncated
        if mode is AutoresetMode.DISABLED and ended.any():
            with pytest.raises(InputError, match="has ended; call reset"):
                vector.step(actions)
            observations, _ = vector.reset(options={"reset_mask": ended})
            for i in np.flatnonzero(ended).tolist():
                plain[i] = single[i].reset()[0]
    vector.close()


# --- Gymnasium --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"flat": True, "plan": 4, "last_action": True},
        {"actions": "discrete", "collision": "stop"},
        {"robot": "omni_dwa", "levels": "map:office", "beams": 90},
        {"robot": "turtlebot", "levels": "narrow", "randomize": {"laser/range_noise": (0.0, 0.05)}},
    ],
)
def test_gymnasium_s_own_checks_pass_without_a_warning(options: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make("navstack/LocalControl-v0", render_mode="rgb_array", **{"count": 2, **options})
        check_env(env.unwrapped)
        env.close()
        env.close()


def test_make_vec_takes_the_kernel() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make_vec("navstack/LocalControl-v0", num_envs=3, count=2, beams=20)
    assert isinstance(env, LocalControlVectorEnv)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    observations, infos = env.reset(seed=0)
    assert env.observation_space.contains(observations)
    assert infos["pose"].shape == (3, 3) and infos["_pose"].all()
    env.step(env.action_space.sample())
    env.close()


def test_a_picture_shows_world_robot_and_goal(levels: list[Level]) -> None:
    env = LocalControlEnv(levels=levels, render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.step(np.array([1.0, 0.0], np.float32))
    after = env.render()
    assert before is not None and after is not None
    assert before.dtype == np.uint8 and before.shape == after.shape and before.shape[2] == 3
    assert (before != after).any()
    dark = (before.sum(axis=2) < 300).mean()
    assert 0.01 < dark < 0.5


# --- wrong input ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"reward": "jaxnavv"}, 'did you mean "jaxnav"'),
        ({"reward": {"gaol": 1.0}}, 'unknown reward term "gaol"; did you mean "goal"'),
        ({"reward": {"goal": math.nan}}, "finite number"),
        ({"levels": "offise"}, 'did you mean "office"'),
        ({"levls": "office"}, 'unknown argument "levls" of the environment; did you mean "levels"?'),
        ({"plan": -1}, "plan is -1; it must be a number of points, 0 or more"),
        ({"levels": "crowd"}, "obstacles that move"),
        ({"split": "test"}, "known splits: train, held_out, all"),
        ({"period": 0.015}, "whole number of physics steps"),
        ({"period": 0.5}, "commands last 0.25 s"),
        ({"robot": "car_rpp", "levels": "map:office"}, "does not drive ackermann bases"),
        ({"randomize": {"velocity_lagg": (0.0, 1.0)}}, 'did you mean "velocity_lag"'),
        ({"randomize": {"velocity_lag": (-1.0, -0.5)}}, "velocity_lag is -"),
        ({"randomize": {"velocity_lag": 0.3}}, "give (lowest, highest)"),
        ({"collision": "bounce"}, '"end" or "stop"'),
        ({"actions": "both"}, '"box" or "discrete"'),
        ({"scan_clip": 0.0}, "scan_clip is 0.0; it must be a number above 0"),
        ({"count": 0}, "count is 0"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0"),
        ({"variants": 0}, "variants is 0; it must be at least 1"),
        ({"render_mode": "human"}, "rgb_array"),
    ],
)
def test_wrong_options_say_what_to_do(options: dict[str, Any], message: str) -> None:
    if options.get("period") == 0.5:
        options = {**options, "overrides": ["navstack/sim/command_timeout=0.25"]}
    with pytest.raises(NavError) as caught:
        LocalControlEnv(**{"count": 2, **options})
    assert message in caught.value.message


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([math.nan, 0.0], "the action [nan, 0.0] is not finite"),
        ([1.5, 0.0], "the action [1.5, 0.0] is outside [-1, 1]"),
        ([0.0, 0.0, 0.0], "shape (3,)"),
        ("left", "shape ()"),
    ],
)
def test_wrong_actions(action: Any, message: str) -> None:
    env = LocalControlEnv(levels=near_wall())
    env.reset(seed=0)
    with pytest.raises(InputError) as caught:
        env.step(np.array(action) if not isinstance(action, str) else action)
    assert message in caught.value.message
    env.step(np.zeros(2, np.float32))  # it is still usable


@pytest.mark.parametrize("action", [15, -1, 0.5])
def test_wrong_discrete_actions(action: Any) -> None:
    env = LocalControlEnv(levels=near_wall(), actions="discrete")
    env.reset(seed=0)
    with pytest.raises(InputError, match=r"not one of the numbers 0 \.\. 14"):
        env.step(action)


def test_calls_in_the_wrong_order() -> None:
    env = LocalControlEnv(levels=near_wall(), render_mode="rgb_array", max_episode_steps=1)
    for call in (lambda: env.step(np.zeros(2)), env.render):
        with pytest.raises(InputError, match=r"call reset\(\)"):
            call()
    env.reset(seed=0)
    with pytest.raises(InputError, match="there is no level"):
        env.reset(options={"level": "nowhere"})
    with pytest.raises(InputError, match="the options of reset are 3; give a dictionary with level"):
        env.reset(options=3)  # pyright: ignore[reportArgumentType]
    assert env.step(np.zeros(2))[3]
    with pytest.raises(InputError, match=r"ended or not begun; call reset\(\)"):
        env.step(np.zeros(2))
    env.close()
    for call in (lambda: env.step(np.zeros(2)), env.reset, env.render):
        with pytest.raises(InputError, match="is closed; make a new one"):
            call()
    vector = LocalControlVectorEnv(2, levels=near_wall(), beams=10)
    with pytest.raises(InputError, match=r"call reset\(\)"):
        vector.step(np.zeros((2, 2)))
    for options, message in (
        ({"reset_mask": np.array([True, False])}, "first reset must be of all"),
        ({"reset_mask": np.array([1, 0])}, "2 booleans"),
        ({"level": ["near wall"]}, "1 levels were given for 2"),
    ):
        with pytest.raises(InputError, match=message):
            vector.reset(seed=0, options=options)
    vector.reset(seed=[3, 4])
    with pytest.raises(InputError, match="one each"):
        vector.reset(seed=[3])
    vector.close()
    with pytest.raises(InputError, match="is closed"):
        vector.step(np.zeros((2, 2)))


def test_a_reset_during_a_step_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    env, alone = (LocalControlEnv(levels=near_wall()) for _ in range(2))
    for each in (env, alone):
        each.reset(seed=3)
    refused: list[str] = []
    advance = env._core.simulation.advance

    def and_reset(actions: Any) -> None:
        """What another thread would do while the kernel runs."""
        for call in (lambda: env.reset(seed=4), lambda: env.step(np.zeros(2))):
            with pytest.raises(InputError) as caught:
                call()
            refused.append(caught.value.message)
        advance(actions)

    monkeypatch.setattr(env._core.simulation, "advance", and_reset)
    observation = env.step(np.array([0.5, 0.1]))[0]
    assert len(refused) == 2 and all(text.startswith("another thread steps or resets") for text in refused)
    assert bits(*observation.values()) == bits(*alone.step(np.array([0.5, 0.1]))[0].values())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_envs": 0}, "num_envs is 0"),
        ({"autoreset_mode": "later"}, "autoreset_mode is"),
        ({"threads": 0}, "threads is 0"),
        ({"render_mode": "rgb_array"}, "draws nothing"),
    ],
)
def test_wrong_vector_options(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        LocalControlVectorEnv(**{"num_envs": 2, "levels": near_wall(), **options})


def test_all_environments_are_registered() -> None:
    assert navstack.gym.__name__ in str(gymnasium.registry["navstack/LocalControl-v0"].entry_point)
    assert {"navstack/PlannerParams-v0", "navstack/Residual-v0"} <= set(gymnasium.registry)
