"""Localization: where the robot is in the map, from its odometry and its scans."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.localization.amcl import Amcl as Amcl
    from navstack.localization.assembly import believed_start as believed_start
    from navstack.localization.assembly import make_filter as make_filter
    from navstack.localization.assembly import make_localizer as make_localizer
    from navstack.localization.dead_reckoning import DeadReckoning as DeadReckoning
    from navstack.localization.evaluation import LoggedScan as LoggedScan
    from navstack.localization.evaluation import RelationResult as RelationResult
    from navstack.localization.evaluation import Relations as Relations
    from navstack.localization.evaluation import Starts as Starts
    from navstack.localization.evaluation import Track as Track
    from navstack.localization.evaluation import errors_by_relations as errors_by_relations
    from navstack.localization.evaluation import follow as follow
    from navstack.localization.evaluation import run_starts as run_starts
    from navstack.localization.field import distance_field as distance_field
    from navstack.localization.global_search import scan_beams as scan_beams
    from navstack.localization.hypotheses import solve3 as solve3
    from navstack.localization.methods import Method as Method
    from navstack.localization.metrics import PoseErrors as PoseErrors
    from navstack.localization.scan_matcher import ScanMatcher as ScanMatcher
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
