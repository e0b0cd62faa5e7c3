"""Shunting: the moves are possible one after another, and take the robot to its goal."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.routes import RouteGraph, build_graph
from navstack.traffic.shunting import Move, Shunting


def moves_on(graph: RouteGraph, at: dict[str, int], mover: str, goal: int) -> list[Move] | None:
    """Find moves of robots that are in the way at the end of an edge only."""
    return Shunting(graph, lambda _, edge, __: {int(graph.ends[edge])}, lambda _, __: False).find(at, mover, goal)


def carry_out(graph: RouteGraph, at: dict[str, int], moves: list[Move]) -> dict[str, int]:
    """Carry the moves out; each begins where its robot stands, and ends at a free node."""
    where = dict(at)
    for name, edge in moves:
        assert where[name] == graph.starts[edge]
        where[name] = int(graph.ends[edge])
        assert len(set(where.values())) == len(where)
    return where


def line(count: int, *branches: tuple[int, int]) -> RouteGraph:
    """Return a line of nodes, with a node beside some of them: (number of the branch's node, node of the line)."""
    nodes = {i: (float(i), 0.0) for i in range(count)} | {node: (float(at), 1.0) for node, at in branches}
    return build_graph(nodes, [*((i, i + 1) for i in range(count - 1)), *branches], both_ways=True)


def test_robots_in_the_way_are_pushed_along_a_chain() -> None:
    graph = line(6, (6, 3))
    moves = moves_on(graph, {"a": 0, "b": 1, "c": 2}, "a", 2)
    assert moves is not None
    assert carry_out(graph, {"a": 0, "b": 1, "c": 2}, moves)["a"] == 2


def test_a_robot_lets_another_one_out_of_a_dead_end_that_it_wants_into() -> None:
    graph = line(6, (6, 2))
    at = {"a": 3, "b": 5}  # b stands at the end of the line, and a has to get out of its way first
    moves = moves_on(graph, at, "a", 5)
    assert moves is not None
    assert moves[0][0] == "a"
    assert carry_out(graph, at, moves)["a"] == 5


def test_robots_on_a_line_without_a_branch_cannot_change_places() -> None:
    assert moves_on(line(5), {"a": 1, "b": 4}, "a", 4) is None


@st.composite
def trees_with_robots(draw: st.DrawFn) -> tuple[RouteGraph, dict[str, int], int]:
    count = draw(st.integers(5, 10))
    parents = [draw(st.integers(0, node - 1)) for node in range(1, count)]
    extra = draw(st.lists(st.tuples(st.integers(0, count - 1), st.integers(0, count - 1)), max_size=3))
    edges = {tuple(sorted(pair)) for pair in [*zip(parents, range(1, count)), *extra] if pair[0] != pair[1]}
    nodes = {i: (math.cos(i), math.sin(i)) for i in range(count)}
    graph = build_graph(nodes, sorted((a, b) for a, b in edges), both_ways=True)
    places = draw(st.permutations(range(count)))[: draw(st.integers(1, count - 2))]
    return graph, {f"robot_{i}": place for i, place in enumerate(places)}, draw(st.integers(0, count - 1))


def reachable(graph: RouteGraph, at: dict[str, int], goal: int) -> bool:
    """Return whether robot_0 can reach a goal: all states, with the others alike."""
    first = at["robot_0"], frozenset(node for name, node in at.items() if name != "robot_0")
    queue, seen = [first], {first}
    for mover, others in queue:
        if mover == goal:
            return True
        for start in (mover, *others):
            for edge in range(int(graph.first[start]), int(graph.first[start + 1])):
                end = int(graph.ends[edge])
                if end == mover or end in others:
                    continue
                state = (end, others) if start == mover else (mover, others - {start} | {end})
                if state not in seen:
                    seen.add(state)
                    queue.append(state)
    return False


@settings(max_examples=20, deadline=None)
@given(trees_with_robots())
def test_moves_are_found_where_there_are_any(case: tuple[RouteGraph, dict[str, int], int]) -> None:
    graph, at, goal = case
    moves = moves_on(graph, at, "robot_0", goal)
    if moves is not None:
        assert carry_out(graph, at, moves)["robot_0"] == goal
    assert (moves is not None) == reachable(graph, at, goal)
