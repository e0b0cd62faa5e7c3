"""Shortest curves for robots with a minimum turning radius: Dubins (forward only) and Reeds-Shepp (also backward)."""

from navstack.curves.curve import Curve, Segment, curve_lengths, dubins_curve, reeds_shepp_curve

__all__ = ["Curve", "Segment", "curve_lengths", "dubins_curve", "reeds_shepp_curve"]
