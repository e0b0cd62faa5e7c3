"""Local planners: velocity commands from a plan, a pose and a costmap. Importing this package registers them and critics."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.local_planner.dwa import DWAParams as DWAParams
    from navstack.local_planner.dwa import DWAPlanner as DWAPlanner
    from navstack.local_planner.dwb.planner import DWBParams as DWBParams
    from navstack.local_planner.dwb.planner import DWBPlanner as DWBPlanner
    from navstack.local_planner.graceful import GracefulController as GracefulController
    from navstack.local_planner.graceful import GracefulParams as GracefulParams
    from navstack.local_planner.graceful import SmoothControlLaw as SmoothControlLaw
    from navstack.local_planner.mppi.params import ACKERMANN as ACKERMANN
    from navstack.local_planner.mppi.params import DIFF as DIFF
    from navstack.local_planner.mppi.params import OMNI as OMNI
    from navstack.local_planner.mppi.params import MotionModelParams as MotionModelParams
    from navstack.local_planner.mppi.params import MPPIParams as MPPIParams
    from navstack.local_planner.mppi.planner import MPPIPlanner as MPPIPlanner
    from navstack.local_planner.path_follower import PathFollower as PathFollower
    from navstack.local_planner.regulated_pure_pursuit import RegulatedPurePursuit as RegulatedPurePursuit
    from navstack.local_planner.regulated_pure_pursuit import RegulatedPurePursuitParams as RegulatedPurePursuitParams
    from navstack.local_planner.rotation_shim import RotationShim as RotationShim
    from navstack.local_planner.rotation_shim import RotationShimParams as RotationShimParams
    from navstack.local_planner.sampling_planner import control_period as control_period
    from navstack.local_planner.trajectory_rollout.planner import TrajectoryPlanner as TrajectoryPlanner
    from navstack.local_planner.trajectory_rollout.planner import TrajectoryPlannerParams as TrajectoryPlannerParams
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
