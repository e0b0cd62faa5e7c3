"""Model predictive path integral control: nav2_mppi_controller::MPPIController."""

from navstack.local_planner.mppi import critics
from navstack.local_planner.mppi.params import MPPIParams
from navstack.local_planner.mppi.planner import MPPIPlanner

__all__ = ["MPPIParams", "MPPIPlanner", "critics"]
