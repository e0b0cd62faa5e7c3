"""The adapter for stable-baselines3; skipped where that is not installed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from navstack.core import InputError
from navstack.gym import LocalControlEnv, stable_baselines_env


def test_episodes_follow_each_other_as_stable_baselines_wants() -> None:
    options: dict[str, Any] = {"count": 2, "beams": 20, "max_episode_steps": 6, "flat": True}
    env, single = stable_baselines_env(3, **options), LocalControlEnv(**options)
    env.seed(5)
    observations = env.reset()
    alone, _ = single.reset(seed=6)
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(20):
        assert (observations[1] == alone).all()
        actions = rng.uniform(-1.0, 1.0, (3, 2)).astype(np.float32)
        observations, rewards, dones, infos = env.step(actions)
        alone, reward, terminated, truncated, info = single.step(actions[1])
        assert rewards[1] == np.float32(reward) and dones[1] == (terminated or truncated)
        if dones[1]:
            ended += 1
            assert (infos[1]["terminal_observation"] == alone).all()
            assert infos[1]["TimeLimit.truncated"] == truncated
            assert infos[1]["is_success"] == info["is_success"] and infos[1]["outcome"] == info["outcome"]
            alone, _ = single.reset()
    assert ended == 3
    env.close()


def test_stable_baselines_accepts_it() -> None:
    from stable_baselines3 import PPO

    env = stable_baselines_env(2, count=1, beams=10, max_episode_steps=20)
    model = PPO("MultiInputPolicy", env, n_steps=16, batch_size=16, n_epochs=1, device="cpu")
    model.learn(32)
    assert env.get_attr("num_envs") == [2, 2] and env.env_is_wrapped(object) == [False, False]
    env.close()


def test_the_autoreset_mode_is_fixed() -> None:
    with pytest.raises(InputError, match="leave out autoreset_mode"):
        stable_baselines_env(2, autoreset_mode="Disabled")
