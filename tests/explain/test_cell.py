"""Why a cell costs what it costs: by wall, by scan, by distance, or not at all."""

from __future__ import annotations

import math

import pytest

from navstack.core import LETHAL, Costmap
from navstack.core.errors import InputError
from navstack.explain import Replay, explain_cell_at, replay
from navstack.record import Record
from tests.explain.conftest import OBSTACLE


@pytest.fixture(scope="module")
def end(record: Record) -> Replay:
    return replay(record)


def marked_by_scan(costmap: Costmap) -> tuple[float, float]:
    """The lethal cell nearest to the obstacle that is on no map."""
    g = costmap.geometry
    cells = [g.cell_to_world(int(ix), int(iy)) for iy, ix in zip(*(costmap.data == LETHAL).nonzero())]
    return min(cells, key=lambda at: math.hypot(at[0] - OBSTACLE[0], at[1] - OBSTACLE[1]))


def test_a_wall_comes_from_the_map(end: Replay) -> None:
    told = explain_cell_at(end, -2.0, 0.02)
    assert told.provenance.cost == LETHAL
    assert told.provenance.set_by == "static_layer"
    assert told.verdict == "lethal (254): static_layer took from the map"


def test_inflation_names_its_obstacle_and_the_scan_behind_it(end: Replay) -> None:
    master = end.costmap("global").master
    x, y = marked_by_scan(master)
    assert math.hypot(x - OBSTACLE[0], y - OBSTACLE[1]) < 0.25
    lethal = explain_cell_at(end, x, y)
    assert lethal.provenance.set_by == "obstacle_layer"
    assert lethal.provenance.source == "scan"
    stamp = lethal.provenance.stamp
    assert stamp is not None and 0.0 <= stamp <= end.time
    assert lethal.verdict == f'lethal (254): obstacle_layer marked from "scan" at {stamp:.3f} s'
    near = explain_cell_at(end, x, y - 0.4)
    distance = near.as_dict()["distance_m"]
    assert near.provenance.set_by == "inflation_layer"
    assert 0.0 < distance <= 0.4 + 1e-9
    assert near.provenance.obstacle is not None
    assert near.verdict.startswith(f"inflated ({near.provenance.cost}): {distance:.2f} m from the lethal cell at (")
    assert 'which obstacle_layer marked from "scan" at ' in near.verdict


def test_a_free_cell_says_who_says_so(end: Replay) -> None:
    told = explain_cell_at(end, 2.5, -2.5)
    assert told.provenance.cost == 0
    assert told.verdict.startswith("free (0): static_layer: map value 0")


def test_the_account_is_about_its_time(record: Record) -> None:
    x, y = marked_by_scan(replay(record).costmap("global").master)
    before = explain_cell_at(replay(record, float(record.costmap_times("global")[0])), x, y)
    assert before.provenance.cost < LETHAL  # the wall hid it


def test_the_costs_are_those_of_the_record(end: Replay, record: Record) -> None:
    recorded = record.costmap_at("local", end.time)
    assert recorded is not None
    to_map = record.to_global(recorded.frame, end.time)
    for ix, iy in ((5, 5), (40, 40), (60, 22)):
        x, y = recorded.geometry.cell_to_world(ix, iy)
        (point,) = to_map.apply_points(__import__("numpy").array([[x, y]])).tolist()
        told = explain_cell_at(end, *point, costmap="local")
        assert (told.provenance.ix, told.provenance.iy) == (ix, iy)
        assert told.provenance.cost == int(recorded.data[iy, ix])


@pytest.mark.parametrize("costmap", ["global", "local"])
def test_a_point_off_the_costmap_is_told_the_extent(end: Replay, costmap: str) -> None:
    with pytest.raises(InputError, match=rf"off the {costmap} costmap at .* covers x -?\d+\.\d\d \.\. ") as caught:
        explain_cell_at(end, 40.0, 0.0, costmap=costmap)
    assert caught.value.data["frame"] in ("map", "odom")


def test_before_the_first_update_there_is_nothing_to_explain(record: Record) -> None:
    first = float(record.costmap_times("global")[0])
    if first > record.times[0]:
        with pytest.raises(InputError, match="not been updated yet"):
            explain_cell_at(replay(record, float(record.times[0])), 0.0, -2.0)
