"""Fields and parameters: what is wrong is said with its place and its fix."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from navstack.behaviors import InvalidMotionError
from navstack.core import InputError
from navstack.coverage import (
    CoverageParams,
    InvalidCoverageRequestError,
    InvalidModeError,
    cover_step_data,
    field_of_corners,
    read_cover_step,
    read_field,
    read_params,
)
from navstack.coverage.field import as_geojson, field_of
from navstack.scenario.steps import is_step, read_step, step_data, step_text

SQUARE = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0], [0.0, 0.0]]
HOLE = [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 1.0]]


def geojson(*rings: Any) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": list(rings)}


def test_all_forms_of_geojson_are_read(tmp_path: Path) -> None:
    one = geojson(SQUARE, HOLE)
    other = {"type": "Polygon", "coordinates": [[[x + 10.0, y] for x, y in SQUARE]]}
    feature = {"type": "Feature", "properties": {}, "geometry": one}
    several = {"type": "FeatureCollection", "features": [feature, {"type": "Feature", "geometry": other}]}
    assert field_of(one).area == pytest.approx(11.5)
    assert field_of(feature).equals(field_of(one))
    assert field_of(several).area == pytest.approx(23.5)
    file = tmp_path / "field.geojson"
    file.write_text(json.dumps(several), encoding="utf-8")
    assert read_field(file).equals(field_of(several))
    assert field_of(as_geojson(field_of(several))).equals(field_of(several))


def test_polygons_as_in_the_action() -> None:
    class Corner:
        def __init__(self, x: float, y: float) -> None:
            self.x, self.y = x, y

    points = [[Corner(x, y) for x, y in ring] for ring in (SQUARE, HOLE)]
    assert field_of_corners(points).equals(field_of_corners([SQUARE, HOLE]))
    assert field_of_corners([SQUARE]).area == pytest.approx(12.0)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ([1], "is no GeoJSON object"),
        ({"type": "Point"}, "\"type\" is 'Point'"),
        ({"type": "FeatureCollection"}, '"features" is None'),
        ({"type": "FeatureCollection", "features": []}, "there is no polygon"),
        ({"type": "FeatureCollection", "features": [{"type": "Feature"}]}, r"features\[0\].geometry"),
        (geojson(), "give the border as a list of corners"),
        (geojson([[0, 0], [1, 0]]), r"coordinates\[0\] has 2 different corners; a polygon needs three"),
        (geojson([[0, 0], [1, 0], [2, 0], [0, 0]]), "no area|crosses|self"),
        (geojson([[0, 0], [1, "a"], [1, 1]]), r"coordinates\[0\]\[1\] is \[1, 'a'\]; give a corner"),
        (geojson([[0, 0], [1, float("nan")], [1, 1]]), r"coordinates\[0\]\[1\] is \[1, nan\]: not a finite position"),
        (
            geojson([[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]),
            r"the border crosses itself; list the corners .* at \(1, 1\)",
        ),
        (geojson(SQUARE, [[9, 9], [10, 9], [10, 10], [9, 9]]), "holes must be inside the border"),
        ({"type": "MultiPolygon", "coordinates": 3}, "give a list of polygons"),
    ],
)
def test_wrong_geojson(data: Any, message: str) -> None:
    with pytest.raises(InvalidCoverageRequestError, match=message) as caught:
        field_of(data, "lawn.geojson")
    assert caught.value.code == 803
    assert str(caught.value).startswith("lawn.geojson")


def test_wrong_files(tmp_path: Path) -> None:
    with pytest.raises(InvalidCoverageRequestError, match="no such file"):
        read_field(tmp_path / "missing.geojson")
    broken = tmp_path / "broken.geojson"
    broken.write_text('{"type": "Polygon",\n "coordinates": [[0, 0}', encoding="utf-8")
    with pytest.raises(InvalidCoverageRequestError, match=r"broken.geojson:2:\d+: not JSON"):
        read_field(broken)
    broken.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InvalidCoverageRequestError, match="cannot be read"):
        read_field(broken)
    with pytest.raises(InvalidCoverageRequestError, match="cannot be read"):
        read_field(tmp_path)


@pytest.mark.parametrize(
    ("polygons", "message"),
    [
        ([], "polygons is empty"),
        ([1.0, 2.0], r"polygons\[0\] is 1.0; give a list of corners"),
        ([[]], "0 different corners"),
        ([[(0, 0), (1, 1)]], "needs three"),
    ],
)
def test_wrong_polygons(polygons: Any, message: str) -> None:
    with pytest.raises(InvalidCoverageRequestError, match=message):
        field_of_corners(polygons)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"operation_with": 0.3}, 'no field "operation_with"; did you mean "operation_width"'),
        ({"operation_width": -1.0}, "operation_width is -1.0: input should be greater than 0"),
        ({"operation_width": float("nan")}, "operation_width is nan"),
        ({"swath_mode": {"mode": "BRUTEFORCE"}}, "swath_mode.mode is 'BRUTEFORCE'"),
        ({"swath_mode": {"angle": 1.0}}, 'swath_mode has no field "angle"'),
        ({"route_mode": "SNAKE"}, "route_mode is 'SNAKE'; give its fields: mode, spiral_n, custom_order"),
        ({"path_mode": {"continuity_mode": "CONTINUOUS"}}, "path_mode.continuity_mode is 'CONTINUOUS'"),
    ],
)
def test_wrong_parameters(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidModeError, match=message) as caught:
        read_params(values)
    assert caught.value.code == 802


def test_parameters_have_the_names_of_the_action() -> None:
    action = (
        "generate_headland",
        "generate_route",
        "generate_path",
        "frame_id",
        "headland_mode",
        "swath_mode",
        "route_mode",
        "path_mode",
    )
    assert set(action) <= set(CoverageParams.model_fields)
    params = read_params({"swath_mode": {"mode": "SET_ANGLE", "best_angle": 0.5}, "headland_mode": {"width": 0.7}})
    assert (params.swath_mode.best_angle, params.headland_mode.width) == (0.5, 0.7)


def test_a_step_goes_to_a_record_and_back(tmp_path: Path) -> None:
    file = tmp_path / "lawn.geojson"
    file.write_text(json.dumps(geojson(SQUARE, HOLE)), encoding="utf-8")
    step = read_step({"cover": "lawn.geojson", "operation_width": 0.3}, folder=tmp_path)
    again = read_step(json.loads(json.dumps(step_data(step))), folder=None)
    assert again == step
    assert step_text(step) == "cover lawn"
    corners = read_cover_step({"cover": SQUARE})
    assert read_cover_step(cover_step_data(corners)).polygon == corners.polygon
    assert read_cover_step({"cover": "all"}).polygon is None
    assert read_cover_step({"cover": [SQUARE, HOLE]}).polygon == field_of(geojson(SQUARE, HOLE))
    assert is_step({"cover": "all"})
    assert not is_step({"covers": "all"})


def test_wrong_steps(tmp_path: Path) -> None:
    with pytest.raises(InvalidCoverageRequestError, match="cover is 3; give all, a GeoJSON file, or corners"):
        read_cover_step({"cover": 3})
    with pytest.raises(InvalidCoverageRequestError, match="needs three"):
        read_cover_step({"cover": [[0.0, 0.0], [1.0, 1.0]]})
    with pytest.raises(InputError, match="has no polygon"):
        read_cover_step({"cover": "lawn.geojson"}, folder=None)
    with pytest.raises(InvalidCoverageRequestError, match="no such file"):
        read_cover_step({"cover": "lawn.geojson"}, folder=tmp_path)
    with pytest.raises(InvalidMotionError):
        read_step({"covers": "all"})
