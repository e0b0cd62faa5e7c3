"""Errors of coverage, with the numbers of opennav_coverage (ComputeCoveragePath.action, NavigateCompleteCoverage.action)."""

from __future__ import annotations

from navstack.core import InputError, PlanningError


class CoverageError(PlanningError):
    """Coverage failed: no part of the area could be planned or driven."""

    code = 800
    name = "UNKNOWN"


class NothingToCoverError(CoverageError):
    """The footprint fits nowhere, or the tool reaches nothing (INTERNAL_F2C_ERROR of opennav_coverage)."""

    code = 801
    name = "NOTHING_TO_COVER"


class InvalidModeError(InputError):
    """A mode of headland, swaths, route or path is wrong (INVALID_MODE_SET)."""

    code = 802
    name = "INVALID_MODE_SET"


class InvalidCoverageRequestError(InputError):
    """A request is wrong: the start, the polygon (INVALID_REQUEST, INVALID_COORDS)."""

    code = 803
    name = "INVALID_REQUEST"
