"""Smoothers of plans: simple, savitzky_golay and constrained."""

from navstack.global_planner.smoothers.base import PointSmoother, PointSmootherParams
from navstack.global_planner.smoothers.constrained import ConstrainedSmoother, ConstrainedSmootherParams
from navstack.global_planner.smoothers.savitzky_golay import SavitzkyGolayParams, SavitzkyGolaySmoother
from navstack.global_planner.smoothers.simple import SimpleSmoother, SimpleSmootherParams
from navstack.global_planner.smoothers.smoothed_planner import SmoothedPlanner, is_smoothed_by, smoothed, unsmoothed

__all__ = [
    "ConstrainedSmoother",
    "ConstrainedSmootherParams",
    "PointSmoother",
    "PointSmootherParams",
    "SavitzkyGolayParams",
    "SavitzkyGolaySmoother",
    "SimpleSmoother",
    "SimpleSmootherParams",
    "SmoothedPlanner",
    "is_smoothed_by",
    "smoothed",
    "unsmoothed",
]
