"""The vector environment as a `VecEnv` of stable-baselines3, which does not take those of Gymnasium."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from navstack.core import InputError
from navstack.gym.local_control import LocalControlVectorEnv


def stable_baselines_env(num_envs: int, **options: Any) -> Any:
    """Return N environments `navstack/LocalControl-v0` as a `VecEnv`; `options` as of `LocalControlVectorEnv`.

    An ended episode is followed by the next one at once; its last observation is `infos[i]["terminal_observation"]`. Only the
    infos of ended episodes are filled, with the keys of `LocalControlEnv`, which `Monitor` and `EvalCallback` read.

    Raises InputError without stable-baselines3, and for an `autoreset_mode`, which is always the same step.
    """
    return _adapter()(num_envs, **options)


@cache
def _adapter() -> Any:
    """Return the class; its base is imported when it is used."""
    try:
        base: Any = importlib.import_module("stable_baselines3.common.vec_env").VecEnv
    except ImportError:
        raise InputError(
            "navstack.gym.stable_baselines_env needs stable-baselines3, which is not installed: pip install stable-baselines3",
            module="stable_baselines3",
        ) from None

    class StableBaselinesEnv(base):
        """N environments `navstack/LocalControl-v0` for stable-baselines3.

        An ended episode is followed by the next one at once; its last observation is `infos[i]["terminal_observation"]`. Only the
        infos of ended episodes are filled, with the keys of `LocalControlEnv`, which `Monitor` and `EvalCallback` read.
        """

        def __init__(self, num_envs: int, **options: Any) -> None:
            """`options` as of `LocalControlVectorEnv`, without `autoreset_mode`."""
            if "autoreset_mode" in options:
                raise InputError("stable-baselines3 resets in the same step; leave out autoreset_mode")
            self.env = LocalControlVectorEnv(num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **options)
            self._actions: Any = None
            self._seed: int | Sequence[int | None] | None = None
            super().__init__(num_envs, self.env.single_observation_space, self.env.single_action_space)

        def seed(self, seed: int | None = None) -> Sequence[int | None]:
            """Set the seeds of the next `reset`: environment i has seed + i."""
            self._seed = seed
            return [None if seed is None else seed + i for i in range(self.num_envs)]

        def reset(self) -> Any:
            """Begin new episodes."""
            seed, self._seed = self._seed, None
            options = self._options[0] or None
            observations, _ = self.env.reset(seed=seed, options=options)
            self._reset_options()
            return observations

        def step_async(self, actions: Any) -> None:
            """Keep the actions for `step_wait`."""
            self._actions = actions

        def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
            """Step all environments."""
            observations, rewards, terminated, truncated, infos = self.env.step(self._actions)
            dones = terminated | truncated
            listed: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
            if dones.any():
                last = infos["final_info"]
                keys = [key for key in last if not key.startswith("_") and key != "reward_terms"]
                for i in np.flatnonzero(dones).tolist():
                    listed[i] = {key: _plain(last[key][i]) for key in keys}
                    listed[i]["terminal_observation"] = infos["final_obs"][i]
                    listed[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            return observations, rewards.astype(np.float32), dones, listed

        def close(self) -> None:
            """Close the environments."""
            self.env.close()

        def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
            """Return the attribute, which all environments share, once per environment."""
            value = getattr(self.env, attr_name)
            return [value for _ in self._get_indices(indices)]

        def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
            """Set an attribute of the vector environment."""
            del indices
            setattr(self.env, attr_name, value)

        def env_method(
            self, method_name: str, *args: Any, indices: int | Iterable[int] | None = None, **kwargs: Any
        ) -> list[Any]:
            """Call a method of the vector environment once."""
            result = getattr(self.env, method_name)(*args, **kwargs)
            return [result for _ in self._get_indices(indices)]

        def env_is_wrapped(self, wrapper_class: type[Any], indices: int | Iterable[int] | None = None) -> list[bool]:
            """No environment is wrapped."""
            del wrapper_class
            return [False for _ in self._get_indices(indices)]

    return StableBaselinesEnv


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
