"""Smoothers of plans: simple, savitzky_golay and constrained."""

from navstack.smoother.base import PointSmoother, PointSmootherParams
from navstack.smoother.constrained import ConstrainedSmoother, ConstrainedSmootherParams
from navstack.smoother.savitzky_golay import SavitzkyGolayParams, SavitzkyGolaySmoother
from navstack.smoother.simple import SimpleSmoother, SimpleSmootherParams
from navstack.smoother.smoothed_planner import SmoothedPlanner, is_smoothed_by, smoothed, unsmoothed

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
