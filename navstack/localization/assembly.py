"""The localizer and the odometry filter that the parameters of a simulated robot name."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from navstack.core import OccupancyGrid, Pose2D, Transform2D
from navstack.localization.ekf import FilteredOdometry
from navstack.localization.searching import SearchingLocalizer
from navstack.parameters import AmclParams, LocalizationConfiguration, SearchingParams, SimParams, default_filter
from navstack.plugins import LOCALIZERS, Localizer


def make_localizer(
    sim: SimParams, sections: LocalizationConfiguration, grid: OccupancyGrid, start: Pose2D, seed: int
) -> Localizer | None:
    """Return the localizer of `localization: amcl` or `scan_matching`, supervised, or `mapping`, at the start pose.

    None for another value.
    """
    if sim.localization == "mapping":
        mapping: Any = LOCALIZERS.get(sim.localization).cls
        mapper: Localizer = mapping(seed=seed)
        mapper.set_pose(believed_start(sim, start), np.diag([1e-4, 1e-4, 1e-4]), math.inf)
        return mapper
    amcl, supervision = sections.amcl or AmclParams(), sections.supervision or SearchingParams()
    params = {"amcl": amcl, "scan_matching": supervision}.get(sim.localization)
    if params is None:
        return None
    plugin: Any = LOCALIZERS.get(sim.localization).cls
    tracker: Localizer = plugin(params, seed=seed)
    localizer = SearchingLocalizer(tracker, supervision)
    localizer.set_map(grid)
    if sim.initial_pose == "unknown":
        localizer.start_globally()
    else:
        variances = amcl.initial_cov_xx, amcl.initial_cov_yy, amcl.initial_cov_aa
        localizer.set_pose(believed_start(sim, start), np.diag(variances), math.inf)
    return localizer


def believed_start(sim: SimParams, start: Pose2D) -> Pose2D:
    """Return the initial pose that the localizer is given: the true one with `initial_pose_error`."""
    return Transform2D(*start).apply(Pose2D(*sim.initial_pose_error))


def make_filter(sim: SimParams, sections: LocalizationConfiguration) -> FilteredOdometry | None:
    """Return the filter of `odometry: ekf`; None for the wheels' odometry."""
    return FilteredOdometry(sections.ekf or default_filter()) if sim.odometry == "ekf" else None
