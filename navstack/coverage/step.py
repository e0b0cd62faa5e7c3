"""The step `cover` of a scenario: {cover: all}, {cover: lawn.geojson}, {cover: [[0, 0], [4, 0], [4, 3]]}, with parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from navstack.core import InputError, short_repr
from navstack.coverage.drive import CoverageDrive
from navstack.coverage.errors import InvalidCoverageRequestError
from navstack.coverage.field import Field, as_geojson, field_of, field_of_corners, read_field
from navstack.coverage.params import CoverageParams, read_params
from navstack.parameters import MotionParams
from navstack.plugins import param

ALL: Final = "all"
"""Everything that can be reached."""


class CoverStep(CoverageParams):
    """Cover an area with a tool."""

    cover: str | list[Any] = param(ALL, "all, a GeoJSON file, or corners [[x, y], ..] in the map")
    field: dict[str, Any] | None = param(None, "the polygon of a file, in records")

    @property
    def polygon(self) -> Field | None:
        """The field; None for everything that can be reached."""
        if self.field is not None:
            return field_of(self.field, "cover")
        if isinstance(self.cover, str):
            return None
        nested = bool(self.cover) and isinstance(self.cover[0], list) and bool(self.cover[0])
        return field_of_corners(self.cover if nested and isinstance(self.cover[0][0], list) else [self.cover])

    @property
    def text(self) -> str:
        """The step in a few words."""
        return f"cover {Path(self.cover).stem if isinstance(self.cover, str) else 'a polygon'}"

    def motion(self, params: MotionParams, *, turning_radius: float = 0.0) -> CoverageDrive:
        """Return the behavior. Raises InvalidCoverageRequestError for a base that cannot turn in place."""
        if turning_radius > 0.0:
            raise InvalidCoverageRequestError(
                f"{self.text}: a base with a turning radius of {turning_radius:.2f} m cannot turn in place; plan with "
                "min_turning_radius, and drive the path with the local planner",
                min_turning_radius_m=turning_radius,
            )
        own = CoverageParams.model_validate({key: getattr(self, key) for key in CoverageParams.model_fields})
        return CoverageDrive(own, params, field=self.polygon)


def read_cover_step(values: Mapping[str, Any], *, folder: Path | None = Path()) -> CoverStep:
    """Return the step of a mapping with the key `cover`; files of polygons are below `folder` (None: not at all).

    Raises InvalidModeError for a parameter, InvalidCoverageRequestError for a polygon.
    """
    rest = {key: value for key, value in values.items() if key not in ("cover", "field")}
    params = read_params(rest)
    cover, field = values.get("cover", ALL), values.get("field")
    if not isinstance(cover, (str, list)):
        raise InvalidCoverageRequestError(
            f"cover is {short_repr(cover)}; give all, a GeoJSON file, or corners [[x, y], ..] in the map"
        )
    if isinstance(cover, str) and cover != ALL and field is None:
        if folder is None:
            raise InputError(f"the step cover {short_repr(cover)} has no polygon")
        field = as_geojson(read_field(folder / Path(cover).expanduser()))
    given = {key: getattr(params, key) for key in CoverageParams.model_fields if key in params.model_fields_set}
    step = CoverStep.model_validate({**given, "cover": cover, "field": field})
    _ = step.polygon  # a wrong polygon is reported now
    return step


def cover_step_data(step: CoverStep) -> dict[str, Any]:
    """Return a step as JSON data, which `read_cover_step` reads."""
    return {"cover": step.cover, **step.model_dump(mode="json", exclude_none=True, exclude_defaults=True)}
