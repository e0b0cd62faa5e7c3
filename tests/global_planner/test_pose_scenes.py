"""A few of the parking and narrow scenes; `python tools/pose_scenes.py` plans in 200 of them, and in 80 without a solution."""

from __future__ import annotations

import math

import pytest

from navstack.core import GoalOccupiedError, NoValidPathError, PlanningError
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner
from navstack.plugins import Plan
from tests.global_planner.pose_scenes import KINDS, Scene, solvable, unsolvable


def plan(scene: Scene) -> Plan:
    model = "REEDS_SHEPP" if scene.reverse else "DUBIN"
    params = SmacHybridParams(
        minimum_turning_radius=scene.radius, motion_model_for_search=model, max_iterations=200_000, tolerance=0.0
    )
    return SmacHybridPlanner(params).make_plan(scene.costmap, scene.start, scene.goal, footprint=scene.footprint)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_scene_with_a_known_solution(kind: str) -> None:
    scene = solvable(kind, 0)
    assert scene.faults_of_drive() == []
    found = plan(scene)
    assert scene.referee().faults(found, scene.start, scene.goal) == []
    assert found.goal_moved_m == 0.0


@pytest.mark.parametrize(
    ("kind", "error", "reason"),
    [
        ("narrow door", NoValidPathError, "too narrow for the footprint at .* at heading|gap of about"),
        ("goal in a wall", GoalOccupiedError, "its footprint overlaps the obstacle at"),
        ("sharp bend", NoValidPathError, "not for the turns: from .* with heading .* it cannot go on"),
        ("walled in", NoValidPathError, "blocked by an obstacle at"),
    ],
)
def test_a_scene_without_a_solution_ends_with_the_reason(kind: str, error: type[PlanningError], reason: str) -> None:
    scene = unsolvable(kind, 1)
    with pytest.raises(error, match=reason) as caught:
        plan(scene)
    data = caught.value.data
    places = [(spot["x"], spot["y"]) for spot in data.get("narrow", [])]
    if "furthest" in data:
        places.append(tuple(data["furthest"][:2]))
    assert all(math.dist(place, scene.place) < 1.5 for place in places)
