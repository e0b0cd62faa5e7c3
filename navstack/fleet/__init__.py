"""Fleets: many robots in one world, each with its own move_base, and the traffic between them."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.fleet.assignment import Task as Task
    from navstack.fleet.drive import GuidedDrive as GuidedDrive
    from navstack.fleet.file_reader import check_fleet as check_fleet
    from navstack.fleet.file_reader import load_fleet as load_fleet
    from navstack.fleet.file_reader import read_fleet as read_fleet
    from navstack.fleet.fleet import Fleet as Fleet
    from navstack.fleet.fleet import FleetRobot as FleetRobot
    from navstack.fleet.fleet import is_of_fleet as is_of_fleet
    from navstack.fleet.fleet import make_fleet as make_fleet
    from navstack.fleet.member import MemberRun as MemberRun
    from navstack.fleet.recognition import is_fleet_file as is_fleet_file
    from navstack.fleet.recognition import shipped_fleets as shipped_fleets
    from navstack.fleet.run import FleetResult as FleetResult
    from navstack.fleet.run import FleetRun as FleetRun
    from navstack.fleet.run import replay_member as replay_member
    from navstack.fleet.run import run_fleet as run_fleet
    from navstack.fleet.run import warm_up_fleet as warm_up_fleet
    from navstack.fleet.tasks import Charger as Charger
    from navstack.fleet.tasks import ChargingParams as ChargingParams
    from navstack.fleet.tasks import TaskParams as TaskParams
    from navstack.fleet.tasks import TaskPlan as TaskPlan
    from navstack.fleet.tasks import TaskReport as TaskReport
    from navstack.fleet.traffic import Communication as Communication
    from navstack.fleet.traffic import Grant as Grant
    from navstack.fleet.traffic import RobotReport as RobotReport
    from navstack.fleet.traffic import TrafficControl as TrafficControl
    from navstack.fleet.traffic import TrafficEvent as TrafficEvent
    from navstack.fleet.traffic import TrafficParams as TrafficParams
    from navstack.fleet.traffic import TrafficRule as TrafficRule
    from navstack.fleet.traffic import make_rule as make_rule
    from navstack.fleet.vda5050 import MqttLink as MqttLink
    from navstack.fleet.vda5050 import NavigatorVehicle as NavigatorVehicle
    from navstack.fleet.vda5050 import Vda5050Robot as Vda5050Robot
    from navstack.fleet.vda5050 import Vehicle as Vehicle
    from navstack.fleet.vda5050 import VehicleState as VehicleState
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
