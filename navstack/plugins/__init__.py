"""Everything that the author of a plugin imports.

    from navstack.plugins import Layer, ParamModel, param

Base classes of all kinds of plugins and the values they exchange, parameter models and their checks, the registries, costs,
errors, and the functions that check a footprint on a costmap. Parameters are passed to the constructor, data as arguments,
failures as exceptions (`navstack.core.errors`). `navstack.testing` holds the contract suites for tests.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.core import FREE as FREE
    from navstack.core import INSCRIBED as INSCRIBED
    from navstack.core import LETHAL as LETHAL
    from navstack.core import UNKNOWN as UNKNOWN
    from navstack.core import Bounds as Bounds
    from navstack.core import ControlError as ControlError
    from navstack.core import Costmap as Costmap
    from navstack.core import Footprint as Footprint
    from navstack.core import FrameTree as FrameTree
    from navstack.core import GoalOccupiedError as GoalOccupiedError
    from navstack.core import GridGeometry as GridGeometry
    from navstack.core import InvalidPathError as InvalidPathError
    from navstack.core import LaserScan as LaserScan
    from navstack.core import NavError as NavError
    from navstack.core import NoValidControlError as NoValidControlError
    from navstack.core import NoValidPathError as NoValidPathError
    from navstack.core import OccupancyGrid as OccupancyGrid
    from navstack.core import Path as Path
    from navstack.core import PlanningError as PlanningError
    from navstack.core import PointCloud as PointCloud
    from navstack.core import Pose2D as Pose2D
    from navstack.core import RecoveryError as RecoveryError
    from navstack.core import RobotState as RobotState
    from navstack.core import StartOccupiedError as StartOccupiedError
    from navstack.core import Transform2D as Transform2D
    from navstack.core import Twist2D as Twist2D
    from navstack.core import Window as Window
    from navstack.core import angle_between as angle_between
    from navstack.core import footprint_cost as footprint_cost
    from navstack.core import kernel as kernel
    from navstack.core import normalize_angle as normalize_angle
    from navstack.core import turn_cost as turn_cost
    from navstack.plugins.behavior import Behavior as Behavior
    from navstack.plugins.behavior import BehaviorContext as BehaviorContext
    from navstack.plugins.behavior import BehaviorStatus as BehaviorStatus
    from navstack.plugins.behavior import BehaviorStep as BehaviorStep
    from navstack.plugins.behavior import RecoveryBehavior as RecoveryBehavior
    from navstack.plugins.behavior import RecoveryContext as RecoveryContext
    from navstack.plugins.behavior import RecoveryStatus as RecoveryStatus
    from navstack.plugins.behavior import RecoveryStep as RecoveryStep
    from navstack.plugins.builtin import BUILTIN as BUILTIN
    from navstack.plugins.checks import RULES as RULES
    from navstack.plugins.checks import CheckContext as CheckContext
    from navstack.plugins.checks import CostmapSetup as CostmapSetup
    from navstack.plugins.checks import Issue as Issue
    from navstack.plugins.checks import LayerSetup as LayerSetup
    from navstack.plugins.checks import LayerTraits as LayerTraits
    from navstack.plugins.checks import Problem as Problem
    from navstack.plugins.checks import Rule as Rule
    from navstack.plugins.checks import SensorSource as SensorSource
    from navstack.plugins.checks import Severity as Severity
    from navstack.plugins.checks import document as document
    from navstack.plugins.checks import rule as rule
    from navstack.plugins.costmap import CellExplanation as CellExplanation
    from navstack.plugins.costmap import CellProvenance as CellProvenance
    from navstack.plugins.costmap import CostmapServer as CostmapServer
    from navstack.plugins.costmap import Inflation as Inflation
    from navstack.plugins.costmap import Layer as Layer
    from navstack.plugins.costmap import LayerContext as LayerContext
    from navstack.plugins.costmap import LayerShare as LayerShare
    from navstack.plugins.critic import Critic as Critic
    from navstack.plugins.critic import DistanceGrid as DistanceGrid
    from navstack.plugins.critic import RejectionDetail as RejectionDetail
    from navstack.plugins.critic import ScoringContext as ScoringContext
    from navstack.plugins.docking import DockDetector as DockDetector
    from navstack.plugins.docking import DockingRobot as DockingRobot
    from navstack.plugins.docking import DockType as DockType
    from navstack.plugins.global_planner import GlobalPlanner as GlobalPlanner
    from navstack.plugins.global_planner import Plan as Plan
    from navstack.plugins.global_planner import Smoother as Smoother
    from navstack.plugins.guards import CommandLimits as CommandLimits
    from navstack.plugins.guards import broken_contract as broken_contract
    from navstack.plugins.guards import limits_of as limits_of
    from navstack.plugins.guards import name_of as name_of
    from navstack.plugins.guards import own_speeds as own_speeds
    from navstack.plugins.guards import plugin_error as plugin_error
    from navstack.plugins.guards import shown as shown
    from navstack.plugins.local_planner import ControlDiagnostics as ControlDiagnostics
    from navstack.plugins.local_planner import ControlInput as ControlInput
    from navstack.plugins.local_planner import LocalPlan as LocalPlan
    from navstack.plugins.local_planner import LocalPlanner as LocalPlanner
    from navstack.plugins.localization import LocalizationStatus as LocalizationStatus
    from navstack.plugins.localization import Localizer as Localizer
    from navstack.plugins.localization import OdometryFilter as OdometryFilter
    from navstack.plugins.localization import PoseEstimate as PoseEstimate
    from navstack.plugins.parameters import ParamModel as ParamModel
    from navstack.plugins.parameters import PluginSpec as PluginSpec
    from navstack.plugins.parameters import param as param
    from navstack.plugins.path_following import Approach as Approach
    from navstack.plugins.path_following import GoalChecker as GoalChecker
    from navstack.plugins.path_following import LocalPath as LocalPath
    from navstack.plugins.path_following import PathHandler as PathHandler
    from navstack.plugins.path_following import PluginSection as PluginSection
    from navstack.plugins.path_following import ProgressChecker as ProgressChecker
    from navstack.plugins.registry import CRITICS as CRITICS
    from navstack.plugins.registry import DOCK_DETECTORS as DOCK_DETECTORS
    from navstack.plugins.registry import DOCK_TYPES as DOCK_TYPES
    from navstack.plugins.registry import GLOBAL_PLANNERS as GLOBAL_PLANNERS
    from navstack.plugins.registry import GOAL_CHECKERS as GOAL_CHECKERS
    from navstack.plugins.registry import LAYERS as LAYERS
    from navstack.plugins.registry import LOCAL_PLANNERS as LOCAL_PLANNERS
    from navstack.plugins.registry import LOCALIZERS as LOCALIZERS
    from navstack.plugins.registry import PATH_HANDLERS as PATH_HANDLERS
    from navstack.plugins.registry import PROGRESS_CHECKERS as PROGRESS_CHECKERS
    from navstack.plugins.registry import RECOVERY_BEHAVIORS as RECOVERY_BEHAVIORS
    from navstack.plugins.registry import REGISTRIES as REGISTRIES
    from navstack.plugins.registry import SMOOTHERS as SMOOTHERS
    from navstack.plugins.registry import Plugin as Plugin
    from navstack.plugins.registry import Registry as Registry
    from navstack.plugins.registry import normalize as normalize
    from navstack.plugins.registry import unknown_groups as unknown_groups
    from navstack.plugins.robot import Robot as Robot
    from navstack.plugins.rollouts import RolloutCells as RolloutCells
    from navstack.plugins.rollouts import Rollouts as Rollouts
    from navstack.plugins.rollouts import TrajectoryGenerator as TrajectoryGenerator
    from navstack.plugins.rollouts import VelocityLimits as VelocityLimits
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
