"""Docking: the dock database, types and detectors of docks, the approach and the way out, as Nav2's docking server."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.docking.behavior import Approach as Approach
    from navstack.docking.behavior import DockingLog as DockingLog
    from navstack.docking.behavior import DockingState as DockingState
    from navstack.docking.behavior import DockSensing as DockSensing
    from navstack.docking.behavior import Leave as Leave
    from navstack.docking.database import Dock as Dock
    from navstack.docking.database import DockDatabase as DockDatabase
    from navstack.docking.database import dump_docks as dump_docks
    from navstack.docking.database import load_docks as load_docks
    from navstack.docking.dock_types import SimpleChargingDock as SimpleChargingDock
    from navstack.docking.dock_types import SimpleNonChargingDock as SimpleNonChargingDock
    from navstack.docking.errors import DockingError as DockingError
    from navstack.docking.task import Docking as Docking
    from navstack.docking.task import DockingFeedback as DockingFeedback
    from navstack.docking.task import DockTask as DockTask
    from navstack.docking.task import Undocking as Undocking
    from navstack.docking.task import docking_robot as docking_robot
    from navstack.docking.tree import docking_servers as docking_servers
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
