"""Contract suites for plugins: the tests that navstack's own plugins must pass. They need pytest.

One line in a test file runs a suite on a plugin:

    from navstack.testing import critic_contract
    from my_package import MyCritic

    TestContract = critic_contract(MyCritic)

Each function takes the plugin class and, as keywords, parameter values; it returns a class that pytest collects.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.testing.critic import CriticContract as CriticContract
    from navstack.testing.critic import critic_contract as critic_contract
    from navstack.testing.dock_detector import DockDetectorContract as DockDetectorContract
    from navstack.testing.dock_detector import dock_detector_contract as dock_detector_contract
    from navstack.testing.global_planner import GlobalPlannerContract as GlobalPlannerContract
    from navstack.testing.global_planner import global_planner_contract as global_planner_contract
    from navstack.testing.layer import LayerContract as LayerContract
    from navstack.testing.layer import layer_contract as layer_contract
    from navstack.testing.local_planner import LocalPlannerContract as LocalPlannerContract
    from navstack.testing.local_planner import local_planner_contract as local_planner_contract
    from navstack.testing.localizer import LocalizerContract as LocalizerContract
    from navstack.testing.localizer import localizer_contract as localizer_contract
    from navstack.testing.path_following import GoalCheckerContract as GoalCheckerContract
    from navstack.testing.path_following import PathHandlerContract as PathHandlerContract
    from navstack.testing.path_following import ProgressCheckerContract as ProgressCheckerContract
    from navstack.testing.path_following import goal_checker_contract as goal_checker_contract
    from navstack.testing.path_following import path_handler_contract as path_handler_contract
    from navstack.testing.path_following import progress_checker_contract as progress_checker_contract
    from navstack.testing.recovery import RecoveryContract as RecoveryContract
    from navstack.testing.recovery import recovery_contract as recovery_contract
    from navstack.testing.smoother import SmootherContract as SmootherContract
    from navstack.testing.smoother import smoother_contract as smoother_contract
else:
    from navstack._lazy import lazy_face
    from navstack.core import require

    require("pytest", "navstack.testing")

    __getattr__, __dir__, __all__ = lazy_face(__name__)
