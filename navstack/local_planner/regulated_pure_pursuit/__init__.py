"""Regulated pure pursuit: nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController."""

from navstack.local_planner.regulated_pure_pursuit.params import RegulatedPurePursuitParams
from navstack.local_planner.regulated_pure_pursuit.planner import RegulatedPurePursuit

__all__ = ["RegulatedPurePursuit", "RegulatedPurePursuitParams"]
