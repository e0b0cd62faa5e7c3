"""Coverage: drive a tool over all of an area that the footprint can reach; swaths, their order, and what was left."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.coverage.area import Area as Area
    from navstack.coverage.area import make_area as make_area
    from navstack.coverage.area import roomy_start as roomy_start
    from navstack.coverage.drive import CoverageDrive as CoverageDrive
    from navstack.coverage.drive import least_clearance as least_clearance
    from navstack.coverage.errors import CoverageError as CoverageError
    from navstack.coverage.errors import InvalidCoverageRequestError as InvalidCoverageRequestError
    from navstack.coverage.errors import InvalidModeError as InvalidModeError
    from navstack.coverage.errors import NothingToCoverError as NothingToCoverError
    from navstack.coverage.field import Field as Field
    from navstack.coverage.field import field_of_corners as field_of_corners
    from navstack.coverage.field import read_field as read_field
    from navstack.coverage.measure import CoverageFigures as CoverageFigures
    from navstack.coverage.measure import figures_of as figures_of
    from navstack.coverage.measure import left_in as left_in
    from navstack.coverage.measure import visits_of as visits_of
    from navstack.coverage.params import CoverageParams as CoverageParams
    from navstack.coverage.params import read_params as read_params
    from navstack.coverage.planner import CoveragePlan as CoveragePlan
    from navstack.coverage.planner import Segment as Segment
    from navstack.coverage.planner import plan_coverage as plan_coverage
    from navstack.coverage.step import CoverStep as CoverStep
    from navstack.coverage.step import cover_step_data as cover_step_data
    from navstack.coverage.step import read_cover_step as read_cover_step
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
