"""Fields: the polygons to cover, from GeoJSON files or from lists of corners as in NavigateCompleteCoverage."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from shapely.validation import explain_validity

from navstack.core import GridGeometry, NotRegularFileError, TooLargeError, read_bytes, short_repr
from navstack.coverage.errors import InvalidCoverageRequestError

Field = shapely.Polygon | shapely.MultiPolygon
MAX_BYTES: Final = 20_000_000
"""Largest file."""
MAX_POINTS: Final = 200_000
"""Most corners of a field."""
FORM: Final = (
    'a GeoJSON Polygon, MultiPolygon, Feature or FeatureCollection with "coordinates": [[[x, y], ..], hole, ..] in m'
)


def read_field(path: str | Path) -> Field:
    """Return the field of a GeoJSON file: its Polygon or MultiPolygon, in meters in the frame of the map.

    The first ring of a polygon is its border, further rings are holes; several features are several parts. Raises
    InvalidCoverageRequestError with the file and the place.
    """
    file = Path(path)
    try:
        text = read_bytes(file, MAX_BYTES).decode("utf-8")
    except FileNotFoundError:
        raise InvalidCoverageRequestError(f"{file}: no such file; give {FORM}", path=str(file)) from None
    except (NotRegularFileError, TooLargeError, OSError, UnicodeDecodeError) as error:
        raise InvalidCoverageRequestError(f"{file}: cannot be read: {error}", path=str(file)) from None
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        where = f":{error.lineno}:{error.colno}" if isinstance(error, json.JSONDecodeError) else ""
        what = error.msg if isinstance(error, json.JSONDecodeError) else str(error)
        raise InvalidCoverageRequestError(f"{file}{where}: not JSON ({what}); give {FORM}", path=str(file)) from None
    return field_of(data, str(file))


def field_of(data: Any, source: str = "the field") -> Field:
    """Return the field of GeoJSON data; `source` begins the messages. Raises InvalidCoverageRequestError."""
    polygons = [_polygon(rings, where) for rings, where in _polygons(data, source)]
    if not polygons:
        raise InvalidCoverageRequestError(f"{source}: there is no polygon; give {FORM}")
    if len(polygons) == 1:
        return polygons[0]
    joined = shapely.union_all(polygons)
    return joined if isinstance(joined, (shapely.Polygon, shapely.MultiPolygon)) else polygons[0]


def field_of_corners(polygons: Sequence[Any]) -> Field:
    """Return the field of lists of corners (x, y) (m): the border, then holes, as in opennav_coverage's `polygons`."""
    if not len(polygons):
        raise InvalidCoverageRequestError(
            "polygons is empty; give the border as a list of corners (x, y), then the holes"
        )
    rings = [[(c.x, c.y) if hasattr(c, "x") else c for c in ring] if _is_list(ring) else ring for ring in polygons]
    return _polygon([[tuple(c) if _is_list(c) else c for c in r] if _is_list(r) else r for r in rings], "polygons")


def check_field(field: Field, geometry: GridGeometry, name: str = "the polygon") -> Field:
    """Return the field. Raises InvalidCoverageRequestError if it does not meet the map."""
    left, right, bottom, top = geometry.extent
    if not field.intersects(shapely.box(left, bottom, right, top)):
        x0, y0, x1, y1 = field.bounds
        raise InvalidCoverageRequestError(
            f"{name} (x {x0:.2f} to {x1:.2f}, y {y0:.2f} to {y1:.2f}) is outside the map (x {left:.2f} to {right:.2f}, y "
            f"{bottom:.2f} to {top:.2f}); give corners in meters in the frame of the map",
            bounds=list(field.bounds),
        )
    return field


def _polygons(data: Any, where: str) -> list[tuple[Any, str]]:
    """Return the rings of every polygon, and where they are."""
    if not isinstance(data, dict):
        raise InvalidCoverageRequestError(f"{where}: {short_repr(data)} is no GeoJSON object; give {FORM}")
    kind = data.get("type")
    match kind:
        case "FeatureCollection":
            features = data.get("features")
            if not isinstance(features, list):
                raise InvalidCoverageRequestError(
                    f'{where}: "features" is {short_repr(features)}; give a list of features'
                )
            return [
                each for k, feature in enumerate(features) for each in _polygons(feature, f"{where}: features[{k}]")
            ]
        case "Feature":
            return _polygons(data.get("geometry"), f"{where}.geometry" if "[" in where else f"{where}: geometry")
        case "Polygon":
            return [(data.get("coordinates"), f"{where}: coordinates")]
        case "MultiPolygon":
            parts = data.get("coordinates")
            if not isinstance(parts, list):
                raise InvalidCoverageRequestError(
                    f'{where}: "coordinates" is {short_repr(parts)}; give a list of polygons'
                )
            return [(part, f"{where}: coordinates[{k}]") for k, part in enumerate(parts)]
        case _:
            raise InvalidCoverageRequestError(f'{where}: "type" is {short_repr(kind)}; give {FORM}')


def _polygon(rings: Any, where: str) -> shapely.Polygon:
    if not isinstance(rings, (list, tuple)) or not rings:
        raise InvalidCoverageRequestError(
            f"{where} is {short_repr(rings)}; give the border as a list of corners [x, y]"
        )
    found = [_ring(ring, f"{where}[{k}]") for k, ring in enumerate(rings)]
    polygon = shapely.Polygon(found[0], found[1:])
    if not polygon.is_valid:
        reason = explain_validity(polygon)
        what, _, place = reason.partition("[")
        at = f" at ({', '.join(place.rstrip(']').split())})" if place else ""
        fix = {"Self-intersection": "the border crosses itself; list the corners in order around the field"}
        raise InvalidCoverageRequestError(
            f"{where}: {fix.get(what, what[0].lower() + what[1:] + '; holes must be inside the border and apart')}{at}",
            reason=reason,
        )
    if polygon.area <= 0.0:
        raise InvalidCoverageRequestError(
            f"{where}: the polygon has no area; give three corners that are not on one line"
        )
    return polygon


def _ring(ring: Any, where: str) -> list[tuple[float, float]]:
    if not isinstance(ring, (list, tuple)):
        raise InvalidCoverageRequestError(f"{where} is {short_repr(ring)}; give a list of corners [x, y] in meters")
    if len(ring) > MAX_POINTS:
        raise InvalidCoverageRequestError(
            f"{where} has {len(ring)} corners, more than {MAX_POINTS}; simplify the polygon"
        )
    corners: list[tuple[float, float]] = []
    for k, corner in enumerate(ring):
        if not isinstance(corner, (list, tuple)) or not 2 <= len(corner) <= 3 or not all(map(_is_number, corner)):
            raise InvalidCoverageRequestError(
                f"{where}[{k}] is {short_repr(corner)}; give a corner as [x, y] in meters"
            )
        x, y = float(corner[0]), float(corner[1])
        if not (math.isfinite(x) and math.isfinite(y) and abs(x) < 1e9 and abs(y) < 1e9):
            raise InvalidCoverageRequestError(
                f"{where}[{k}] is {short_repr(corner)}: not a finite position; correct it"
            )
        corners.append((x, y))
    if len(set(corners)) < 3:
        raise InvalidCoverageRequestError(f"{where} has {len(set(corners))} different corners; a polygon needs three")
    return corners


def _is_list(value: Any) -> bool:
    return hasattr(value, "__iter__") and not isinstance(value, (str, bytes, dict))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)


def as_geojson(field: Field) -> dict[str, Any]:
    """Return a field as GeoJSON data, which `field_of` reads."""
    parts = [field] if isinstance(field, shapely.Polygon) else list(field.geoms)
    rings = [[[list(p) for p in ring.coords] for ring in (part.exterior, *part.interiors)] for part in parts]
    if len(rings) == 1:
        return {"type": "Polygon", "coordinates": rings[0]}
    return {"type": "MultiPolygon", "coordinates": rings}
