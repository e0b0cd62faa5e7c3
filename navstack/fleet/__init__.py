"""Fleets: many robots in one world, each with its own move_base, and the tasks that they share."""

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
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
