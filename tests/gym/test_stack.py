"""Environments around the whole stack: parameters that change, commands that are corrected."""

from __future__ import annotations

import math
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from navstack.core import InputError, NavError
from navstack.gym import Level, PlannerParamsEnv, ResidualEnv, read_levels
from navstack.gym.stack import with_parameters
from navstack.parameters import load_configuration
from navstack.scenario import Run

ENVIRONMENTS = {"PlannerParams": PlannerParamsEnv, "Residual": ResidualEnv}


@pytest.fixture(scope="module")
def levels() -> list[Level]:
    return read_levels("office", count=2, split="train")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("PlannerParams", {"count": 2}),
        ("PlannerParams", {"levels": "barn", "robot": "jackal_dwa", "count": 1, "beams": 90}),
        ("Residual", {"count": 2}),
        ("Residual", {"levels": "crowd", "count": 1, "robot": "turtlebot_mppi", "collision": "stop"}),
    ],
)
def test_gymnasium_s_own_checks_pass_without_a_warning(name: str, options: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(f"navstack/{name}-v0", render_mode="rgb_array", **options)
        check_env(env.unwrapped)
        env.close()
        env.close()


def test_without_corrections_the_run_is_that_of_the_stack(levels: list[Level]) -> None:
    """Zero actions, or the parameters of the file: the same poses as without an environment."""
    env = ResidualEnv(levels=levels)
    _, info = env.reset(seed=4, options={"level": 1})
    poses = {round(info["time"], 6): info["pose"].tolist()}
    ended = False
    while not ended:
        _, _, a, b, info = env.step(np.zeros(2, np.float32))
        poses[round(info["time"], 6)] = info["pose"].tolist()
        ended = a or b
    assert info["outcome"] == "goal" and info["is_success"] and info["scenario"] == levels[1].name

    spec = levels[1].spec
    assert spec is not None
    run = Run(spec.build(params=["turtlebot"], seed=info["seed"], goals=[levels[1].goal]), record=False)
    compared = 0
    while run.step() and run.robot.time < info["time"]:
        if round(run.robot.time, 6) in poses:
            assert poses[round(run.robot.time, 6)] == list(run.robot.pose)
            compared += 1
    assert compared > 20


def test_a_correction_turns_the_robot_within_its_limits(levels: list[Level]) -> None:
    env = ResidualEnv(levels=levels)
    added: list[float] = []
    for turn in (-0.5, 0.0, 0.5):
        env.reset(seed=1, options={"level": 0})
        for _ in range(3):
            env.step(np.array([0.0, turn], np.float32))
        assert env._run is not None
        command, limits = env._run.move_base.command, env._planner.limits
        assert abs(command.wz) <= limits.max_vel_theta and command.vx <= limits.max_vel_x
        added.append(command.wz - env._planner.base.wz)
        wanted = min(
            max(env._planner.base.wz + 0.3 * turn * limits.max_vel_theta, -limits.max_vel_theta), limits.max_vel_theta
        )
        assert command.wz == pytest.approx(wanted)
    assert added[1] == 0.0 and (added[0] < 0.0 or added[2] > 0.0)


def test_the_observation_shows_the_base_command(levels: list[Level]) -> None:
    env = ResidualEnv(levels=levels)
    env.reset(seed=1)
    for _ in range(5):
        observation, *_ = env.step(np.array([-0.5, 0.5], np.float32))
    base = env._planner.base
    limits = env._planner.limits
    assert observation["base_command"] == pytest.approx(
        [base.vx / limits.max_vel_x, 0.0, base.wz / limits.max_vel_theta], abs=1e-6
    )
    assert env._run is not None
    wanted = base.wz + 0.3 * 0.5 * limits.max_vel_theta
    assert env._run.move_base.command.wz == pytest.approx(min(wanted, limits.max_vel_theta))


def test_parameters_change_in_the_running_stack(levels: list[Level]) -> None:
    names = [
        "DWAPlannerROS/max_vel_x=0.1:0.5",
        "local_costmap/inflation_layer/inflation_radius=0.2:0.6",
        "DWAPlannerROS/vx_samples=4:12",
    ]
    env = PlannerParamsEnv(levels=levels, parameters=names)
    observation, _ = env.reset(seed=0)
    assert observation["parameters"].shape == (3,)
    speeds: list[float] = []
    for action in ([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]):
        action = np.array(action, np.float32)
        for _ in range(4):
            observation, *_, info = env.step(action)
        assert env._run is not None
        params: Any = env._run.move_base.local_planner.params
        values = env.values_of(action)
        assert (params.max_vel_x, params.vx_samples) == (
            values["DWAPlannerROS/max_vel_x"],
            values["DWAPlannerROS/vx_samples"],
        )
        layers = {type(layer).__name__: layer for layer in env._run.move_base.local_costmap.layers}
        assert any(
            getattr(layer.params, "inflation_radius", None) == (0.2 if action[0] < 0 else 0.6)
            for layer in layers.values()
        )
        assert observation["parameters"].tolist() == action.tolist()
        speeds.append(float(np.hypot(*env._run.robot.state().velocity[:2])))
        assert info["time"] == pytest.approx(4.0 * len(speeds), abs=0.25)
    # samples of DWA are float32
    assert speeds[0] <= 0.1 + 1e-7 and speeds[1] > 0.15


def test_replaced_parameters_are_those_of_a_new_configuration() -> None:
    before = load_configuration(["turtlebot_dwb"])
    values = {
        "DWBLocalPlanner/sim_time": 1.3,
        "DWBLocalPlanner/PathDist/scale": 20.0,
        "local_costmap/inflation_layer/inflation_radius": 0.45,
        "controller_frequency": 8.0,
    }
    namespace = before.local_planner.namespace
    values = {name.replace("DWBLocalPlanner", namespace): value for name, value in values.items()}
    after = with_parameters(before, values)
    wanted = load_configuration(["turtlebot_dwb"], overrides=[f"{name}={value}" for name, value in values.items()])
    assert after.local_planner.params == wanted.local_planner.params
    assert [layer.params for layer in after.local_costmap.layers] == [
        layer.params for layer in wanted.local_costmap.layers
    ]
    assert after.move_base == wanted.move_base


def test_the_reward_is_the_sum_of_its_terms(levels: list[Level]) -> None:
    env = PlannerParamsEnv(levels=levels, reward={"preset": "appl", "time": -0.1, "discomfort": 3.0})
    env.reset(seed=2)
    before = env._level.start.distance_to(env._level.goal)
    total = 0.0
    for _ in range(6):
        _, reward, a, b, info = env.step(np.zeros(env.action_space.shape, np.float32))
        assert reward == pytest.approx(sum(info["reward_terms"].values()))
        assert set(info["reward_terms"]) == {"goal", "progress", "forward", "time", "discomfort"}
        total += info["reward_terms"]["progress"]
        assert not (a or b)
    left = math.hypot(*(info["pose"][:2] - np.array(env._level.goal[:2])))
    assert total == pytest.approx(before - left)


def test_the_time_limit_truncates(levels: list[Level]) -> None:
    env = PlannerParamsEnv(levels=levels, max_episode_steps=2)
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, np.float32)
    assert env.step(action)[2:4] == (False, False)
    _, _, terminated, truncated, info = env.step(action)
    assert (terminated, truncated, info["outcome"]) == (False, True, "timeout")


@pytest.mark.parametrize("name", list(ENVIRONMENTS))
def test_wrong_calls(name: str, levels: list[Level]) -> None:
    env = ENVIRONMENTS[name](levels=levels, render_mode="rgb_array")
    action = np.zeros(env.action_space.shape, np.float32)
    for call in (lambda: env.step(action), env.render):
        with pytest.raises(InputError, match=r"call reset\(\)"):
            call()
    env.reset(seed=0)
    for bad in (action + np.nan, action + 2.0, np.zeros(40), np.zeros(1)):
        with pytest.raises(InputError, match=r"finite numbers in \[-1, 1\]"):
            env.step(bad)
    with pytest.raises(InputError, match="there is no level"):
        env.reset(options={"level": "x"})
    with pytest.raises(InputError, match='unknown option "levle" of reset; options: level'):
        env.reset(options={"levle": 0})
    with pytest.raises(InputError, match="the level is 99"):
        env.reset(options={"level": 99})
    with pytest.raises(InputError, match="one per level"):
        env.set_level_weights([1.0])
    advance = env._advance

    def and_reset(run: Any) -> bool:
        with pytest.raises(InputError, match="another thread steps or resets this environment"):
            env.reset()
        return advance(run)

    env._advance = and_reset
    env.step(action)
    env.close()
    with pytest.raises(InputError, match="is closed"):
        env.step(action)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("PlannerParams", {"parameters": ["DWAPlannerROS/max_vel_xx=0.1:0.5"]}, "max_vel_xx"),
        ("PlannerParams", {"parameters": ["DWAPlannerROS/max_vel_x=0.5:0.1"]}, "0.5"),
        ("PlannerParams", {"parameters": "DWAPlannerROS/max_vel_x"}, "give a list such as"),
        ("PlannerParams", {"period": 0.0}, "period is 0"),
        ("PlannerParams", {"max_episode_steps": 0}, "max_episode_steps is 0"),
        ("Residual", {"share": 2.0}, "share is 2"),
        ("Residual", {"shar": 0.2}, 'unknown argument "shar" of the environment; did you mean "share"?'),
        ("Residual", {"scan_clip": -1.0}, "scan_clip is -1"),
        ("Residual", {"collision": "no"}, '"end" or "stop"'),
        ("Residual", {"render_mode": "human"}, "rgb_array"),
    ],
)
def test_wrong_options(name: str, options: dict[str, Any], message: str, levels: list[Level]) -> None:
    with pytest.raises(NavError) as caught:
        ENVIRONMENTS[name](levels=levels, **options)
    assert message in caught.value.message


def test_a_level_without_a_scenario_is_refused(levels: list[Level]) -> None:
    from dataclasses import replace

    with pytest.raises(InputError, match="the whole stack drives scenarios"):
        ResidualEnv(levels=replace(levels[0], spec=None))
