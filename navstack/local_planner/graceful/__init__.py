"""Graceful controller: nav2_graceful_controller::GracefulController."""

from navstack.local_planner.graceful.params import GracefulParams
from navstack.local_planner.graceful.planner import GracefulController

__all__ = ["GracefulController", "GracefulParams"]
