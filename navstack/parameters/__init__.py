"""Parameters: ROS YAML and launch files with the location of every value -> typed, checked configuration of a robot.

- `load_configuration`, `check_parameters`, `choose_global_planner`: what most callers need.
- `read_sources`, `read_yaml`, `Space`, `Leaf`: the tree of parameters before it is typed.
- `navstack.parameters.report`: effective parameters, JSON schema, reference page, migration.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.parameters.binding import Binder as Binder
    from navstack.parameters.binding import bounds_of as bounds_of
    from navstack.parameters.binding import message_for as message_for
    from navstack.parameters.binding import unit_of as unit_of
    from navstack.parameters.configuration import check_parameters as check_parameters
    from navstack.parameters.configuration import choose_global_planner as choose_global_planner
    from navstack.parameters.configuration import load_configuration as load_configuration
    from navstack.parameters.configuration import parse_footprint as parse_footprint
    from navstack.parameters.configuration_types import Configuration as Configuration
    from navstack.parameters.configuration_types import CostmapConfiguration as CostmapConfiguration
    from navstack.parameters.configuration_types import NavstackParams as NavstackParams
    from navstack.parameters.findings import Finding as Finding
    from navstack.parameters.findings import Location as Location
    from navstack.parameters.findings import finding as finding
    from navstack.parameters.findings import in_order as in_order
    from navstack.parameters.fix import KeyFixes as KeyFixes
    from navstack.parameters.fix import fix_keys as fix_keys
    from navstack.parameters.launch import Element as Element
    from navstack.parameters.launch import RejectedLaunchFileError as RejectedLaunchFileError
    from navstack.parameters.launch import find_file as find_file
    from navstack.parameters.launch import launch_argument as launch_argument
    from navstack.parameters.launch import read_launch_xml as read_launch_xml
    from navstack.parameters.launch import substitute as substitute
    from navstack.parameters.models.amcl import AmclParams as AmclParams
    from navstack.parameters.models.collision_monitor import CollisionDetectorParams as CollisionDetectorParams
    from navstack.parameters.models.collision_monitor import CollisionMonitorParams as CollisionMonitorParams
    from navstack.parameters.models.collision_monitor import ExclusionZoneParams as ExclusionZoneParams
    from navstack.parameters.models.collision_monitor import MonitorSourceParams as MonitorSourceParams
    from navstack.parameters.models.collision_monitor import SubPolygonParams as SubPolygonParams
    from navstack.parameters.models.collision_monitor import ZoneParams as ZoneParams
    from navstack.parameters.models.docking import DockControllerParams as DockControllerParams
    from navstack.parameters.models.docking import DockingParams as DockingParams
    from navstack.parameters.models.docking import DockInstanceParams as DockInstanceParams
    from navstack.parameters.models.ekf import PLANAR as PLANAR
    from navstack.parameters.models.ekf import FilterParams as FilterParams
    from navstack.parameters.models.ekf import SourceParams as SourceParams
    from navstack.parameters.models.motion import MotionParams as MotionParams
    from navstack.parameters.models.move_base import CostmapParams as CostmapParams
    from navstack.parameters.models.move_base import MoveBaseParams as MoveBaseParams
    from navstack.parameters.models.move_base import builtin_recoveries as builtin_recoveries
    from navstack.parameters.models.sim import MAX_CAR_ANGLE as MAX_CAR_ANGLE
    from navstack.parameters.models.sim import BatteryParams as BatteryParams
    from navstack.parameters.models.sim import BumperParams as BumperParams
    from navstack.parameters.models.sim import CameraParams as CameraParams
    from navstack.parameters.models.sim import DockCameraParams as DockCameraParams
    from navstack.parameters.models.sim import ImuParams as ImuParams
    from navstack.parameters.models.sim import LidarParams as LidarParams
    from navstack.parameters.models.sim import SimDockParams as SimDockParams
    from navstack.parameters.models.sim import SimParams as SimParams
    from navstack.parameters.models.sim import SonarParams as SonarParams
    from navstack.parameters.models.supervision import LostParams as LostParams
    from navstack.parameters.models.supervision import ScanMatcherParams as ScanMatcherParams
    from navstack.parameters.models.supervision import SearchingParams as SearchingParams
    from navstack.parameters.models.twist_mux import MuxInputParams as MuxInputParams
    from navstack.parameters.models.twist_mux import MuxLockParams as MuxLockParams
    from navstack.parameters.models.twist_mux import TwistMuxParams as TwistMuxParams
    from navstack.parameters.models.velocity_smoother import VelocitySmootherParams as VelocitySmootherParams
    from navstack.parameters.nav2.conversion import Change as Change
    from navstack.parameters.nav2.conversion import Conversion as Conversion
    from navstack.parameters.nav2.convert import to_nav2 as to_nav2
    from navstack.parameters.nav2.convert_back import to_move_base as to_move_base
    from navstack.parameters.nav2.declared import NAV2_DISTROS as NAV2_DISTROS
    from navstack.parameters.nodes import LocalizationConfiguration as LocalizationConfiguration
    from navstack.parameters.nodes import default_filter as default_filter
    from navstack.parameters.nodes import unwrap_ros2 as unwrap_ros2
    from navstack.parameters.report import Parameter as Parameter
    from navstack.parameters.report import as_dict as as_dict
    from navstack.parameters.report import as_yaml as as_yaml
    from navstack.parameters.report import json_schema as json_schema
    from navstack.parameters.report import migrate as migrate
    from navstack.parameters.report import parameters_of as parameters_of
    from navstack.parameters.report import reference as reference
    from navstack.parameters.report import same_parameters as same_parameters
    from navstack.parameters.sections import first_of as first_of
    from navstack.parameters.sections import make_section as make_section
    from navstack.parameters.sections import section_model as section_model
    from navstack.parameters.sources import Override as Override
    from navstack.parameters.sources import SetText as SetText
    from navstack.parameters.sources import Source as Source
    from navstack.parameters.sources import packaged_folder as packaged_folder
    from navstack.parameters.sources import packaged_sets as packaged_sets
    from navstack.parameters.sources import read_sources as read_sources
    from navstack.parameters.sources import short_name as short_name
    from navstack.parameters.sources import split_namespace as split_namespace
    from navstack.parameters.sources import to_node as to_node
    from navstack.parameters.spelling import nearest as nearest
    from navstack.parameters.tree import Leaf as Leaf
    from navstack.parameters.tree import Sources as Sources
    from navstack.parameters.tree import Space as Space
    from navstack.parameters.tree import overlay as overlay
    from navstack.parameters.yaml_editor import value_text as value_text
    from navstack.parameters.yaml_reader import DictNode as DictNode
    from navstack.parameters.yaml_reader import ListNode as ListNode
    from navstack.parameters.yaml_reader import Node as Node
    from navstack.parameters.yaml_reader import ScalarNode as ScalarNode
    from navstack.parameters.yaml_reader import parse_value as parse_value
    from navstack.parameters.yaml_reader import plain as plain
    from navstack.parameters.yaml_reader import read_yaml as read_yaml
    from navstack.parameters.yaml_reader import scalar as scalar
    from navstack.parameters.yaml_rewrite import RewrittenFiles as RewrittenFiles
    from navstack.parameters.yaml_rewrite import overwrite as overwrite
    from navstack.parameters.yaml_rewrite import rewrite_parameters as rewrite_parameters
    from navstack.plugins import Severity as Severity
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
