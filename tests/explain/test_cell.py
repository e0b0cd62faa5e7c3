"""Explanations of cell costs: walls, scans, inflation, free cells."""

from __future__ import annotations

import math

import pytest

from navstack.core import LETHAL, Costmap, InputError
from navstack.explain import Replay, explain_cell, replay
from navstack.record import Record
from tests.explain.conftest import OBSTACLE


@pytest.fixture(scope="module")
def end(record: Record) -> Replay:
    return replay(record)


def marked_by_scan(costmap: Costmap) -> tuple[float, float]:
    """The lethal cell nearest to the obstacle that is not on the map."""
    g = costmap.geometry
    cells = [g.cell_to_world(int(ix), int(iy)) for iy, ix in zip(*(costmap.data == LETHAL).nonzero())]
    return min(cells, key=lambda at: math.hypot(at[0] - OBSTACLE[0], at[1] - OBSTACLE[1]))


def test_a_wall_comes_from_the_map(end: Replay) -> None:
    report = explain_cell(end, -2.0, 0.02)
    assert report.provenance.cost == LETHAL
    assert report.provenance.set_by == "static_layer"
    assert report.summary == "lethal (254): copied by static_layer from the map"


def test_inflation_names_its_obstacle_and_the_scan_behind_it(end: Replay) -> None:
    master = end.costmap("global").master
    x, y = marked_by_scan(master)
    assert math.hypot(x - OBSTACLE[0], y - OBSTACLE[1]) < 0.25
    lethal = explain_cell(end, x, y)
    assert lethal.provenance.set_by == "obstacle_layer"
    assert lethal.provenance.source == "scan"
    stamp = lethal.provenance.stamp
    assert stamp is not None and 0.0 <= stamp <= end.time
    assert lethal.summary == f'lethal (254): marked by obstacle_layer from "scan" at {stamp:.3f} s'
    near = explain_cell(end, x, y - 0.4)
    distance = near.as_dict()["distance_m"]
    assert near.provenance.set_by == "inflation_layer"
    assert 0.0 < distance <= 0.4 + 1e-9
    assert near.provenance.obstacle is not None
    assert near.summary.startswith(f"inflated ({near.provenance.cost}): {distance:.2f} m from the lethal cell at (")
    assert 'marked by obstacle_layer from "scan" at ' in near.summary


def test_a_free_cell_names_its_layer(end: Replay) -> None:
    report = explain_cell(end, 2.5, -2.5)
    assert report.provenance.cost == 0
    assert report.summary.startswith("free (0): static_layer: map value 0")


def test_the_report_is_about_its_time(record: Record) -> None:
    x, y = marked_by_scan(replay(record).costmap("global").master)
    before = explain_cell(replay(record, float(record.costmap_times("global")[0])), x, y)
    assert before.provenance.cost < LETHAL  # hidden by the wall


def test_the_costs_are_those_of_the_record(end: Replay, record: Record) -> None:
    recorded = record.costmap_at("local", end.time)
    assert recorded is not None
    to_map = record.to_global(recorded.frame, end.time)
    for ix, iy in ((5, 5), (40, 40), (60, 22)):
        x, y = recorded.geometry.cell_to_world(ix, iy)
        (point,) = to_map.apply_points(__import__("numpy").array([[x, y]])).tolist()
        report = explain_cell(end, *point, costmap="local")
        assert (report.provenance.ix, report.provenance.iy) == (ix, iy)
        assert report.provenance.cost == int(recorded.data[iy, ix])


@pytest.mark.parametrize("costmap", ["global", "local"])
def test_a_point_outside_the_costmap_reports_the_extent(end: Replay, costmap: str) -> None:
    with pytest.raises(InputError, match=rf"outside the {costmap} costmap at .* covers x -?\d+\.\d\d \.\. ") as caught:
        explain_cell(end, 40.0, 0.0, costmap=costmap)
    assert caught.value.data["frame"] in ("map", "odom")


def test_before_the_first_update_there_is_nothing_to_explain(record: Record) -> None:
    first = float(record.costmap_times("global")[0])
    if first > record.times[0]:
        with pytest.raises(InputError, match="has no update until"):
            explain_cell(replay(record, float(record.times[0])), 0.0, -2.0)
