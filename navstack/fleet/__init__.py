"""Fleets: many robots in one world, and the traffic between them."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
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
