"""VDA 5050: a robot behind the interface of fleet managers, with or without an MQTT broker."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.vda5050.mqtt import MqttLink as MqttLink
    from navstack.vda5050.vehicle import NavigatorVehicle as NavigatorVehicle
    from navstack.vda5050.vehicle import Vda5050Robot as Vda5050Robot
    from navstack.vda5050.vehicle import Vehicle as Vehicle
    from navstack.vda5050.vehicle import VehicleState as VehicleState
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
