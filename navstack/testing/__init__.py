"""Contract suites for plugins: the tests that navstack's own plugins must pass. They need pytest.

One line in a test file runs a suite on a plugin:

    from navstack.testing import critic_contract
    from my_package import MyCritic

    TestContract = critic_contract(MyCritic)

Each function takes the plugin class and, as keywords, parameter values; it returns a class that pytest collects.
"""

from navstack.testing.critic import CriticContract, critic_contract
from navstack.testing.global_planner import GlobalPlannerContract, global_planner_contract
from navstack.testing.layer import LayerContract, layer_contract
from navstack.testing.local_planner import LocalPlannerContract, local_planner_contract
from navstack.testing.localizer import LocalizerContract, localizer_contract
from navstack.testing.path_following import (
    GoalCheckerContract,
    PathHandlerContract,
    ProgressCheckerContract,
    goal_checker_contract,
    path_handler_contract,
    progress_checker_contract,
)
from navstack.testing.recovery import RecoveryContract, recovery_contract
from navstack.testing.smoother import SmootherContract, smoother_contract

__all__ = [
    "CriticContract",
    "GlobalPlannerContract",
    "GoalCheckerContract",
    "LayerContract",
    "LocalPlannerContract",
    "LocalizerContract",
    "PathHandlerContract",
    "ProgressCheckerContract",
    "RecoveryContract",
    "SmootherContract",
    "critic_contract",
    "global_planner_contract",
    "goal_checker_contract",
    "layer_contract",
    "local_planner_contract",
    "localizer_contract",
    "path_handler_contract",
    "progress_checker_contract",
    "recovery_contract",
    "smoother_contract",
]
