"""Traffic between robots on a route graph: rules, grants, and the communication with a traffic control."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.traffic.control import Communication as Communication
    from navstack.traffic.control import TrafficControl as TrafficControl
    from navstack.traffic.rules import RULES as RULES
    from navstack.traffic.rules import Grant as Grant
    from navstack.traffic.rules import RobotReport as RobotReport
    from navstack.traffic.rules import TrafficEvent as TrafficEvent
    from navstack.traffic.rules import TrafficParams as TrafficParams
    from navstack.traffic.rules import TrafficRule as TrafficRule
    from navstack.traffic.rules import make_rule as make_rule
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
