"""Gymnasium environments on the simulator: learn to control a robot, to tune its planner, to correct its commands.

`import navstack.gym` registers `navstack/LocalControl-v0`, `navstack/PlannerParams-v0` and `navstack/Residual-v0`; it needs the
extra `gym`. `LocalControlParallelEnv` has several agents in one world, for PettingZoo.
"""

from typing import TYPE_CHECKING

from navstack.gym import _registration as _registration

if TYPE_CHECKING:
    from navstack.gym.levels import Level as Level
    from navstack.gym.levels import generated_barn_worlds as generated_barn_worlds
    from navstack.gym.levels import read_levels as read_levels
    from navstack.gym.local_control import LocalControlEnv as LocalControlEnv
    from navstack.gym.local_control import LocalControlVectorEnv as LocalControlVectorEnv
    from navstack.gym.parallel import LocalControlParallelEnv as LocalControlParallelEnv
    from navstack.gym.sb3 import stable_baselines_env as stable_baselines_env
    from navstack.gym.scenes import Scene as Scene
    from navstack.gym.scenes import read_scenes as read_scenes
    from navstack.gym.stack import PlannerParamsEnv as PlannerParamsEnv
    from navstack.gym.stack import ResidualEnv as ResidualEnv
    from navstack.gym.task import REWARDS as REWARDS
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
