"""Shunting: takes one robot to its goal on a route graph, one move of one robot at a time, with the others put out of its way.

Pebble motion with one named pebble (Papadimitriou et al., FOCS 1994): the others are put anywhere. A move goes along one edge
while all the others stand at nodes. So a robot that is pushed along a chain of others needs a free node at the end of the chain.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Sequence
from typing import Final

from navstack.routes import RouteGraph

Move = tuple[str, int]
"""Name of a robot and index of the edge that it drives."""
InWay = Callable[[str, int, str], Collection[int]]
"""Returns the nodes (indices) at which a robot (third argument) is in the way of another one (first) on an edge (second)."""
Closed = Callable[[str, int], bool]
"""Returns whether something that cannot be moved is in the way of a robot on an edge."""

DETOURS: Final = 300
"""So many places of the robot, with places of the others, are tried at most as begin of its way."""
STATES: Final = 3000
"""So many states, places of the robot and of the others, are searched at most if that finds nothing."""
_CHAINS: Final = 12
"""So many of the shortest ways out are tried for the robots in the way."""


class Shunting:
    """Finds moves on one graph, for robots that stand at nodes."""

    def __init__(self, graph: RouteGraph, in_way: InWay, closed: Closed) -> None:
        self._in_way, self._closed = in_way, closed
        self._starts: list[int] = graph.starts.tolist()
        self._ends: list[int] = graph.ends.tolist()
        self._lengths: list[float] = graph.lengths.tolist()
        first: list[int] = graph.first.tolist()
        self._out = [range(first[node], first[node + 1]) for node in range(len(graph))]
        self._into: list[list[tuple[int, int]]] = [[] for _ in self._out]
        for node, edges in enumerate(self._out):
            for edge in edges:
                self._into[self._ends[edge]].append((edge, node))

    def find(self, at: dict[str, int], mover: str, goal: int) -> list[Move] | None:
        """Return moves that end with `mover` at its goal; None if none were found. `at`: the nodes of all robots.

        The robot drives its shortest way if all that stand on it find places off it. If not, it drives elsewhere first, such as
        out of a dead end or past a junction; the shortest moves are tried first. If that fails, which needs nearly as many robots
        as nodes, all moves of all robots are searched.
        """
        toward = self._toward(mover, goal)
        if at[mover] not in toward:
            return None
        queue: list[tuple[float, int, dict[str, int], list[Move]]] = [(0.0, 0, dict(at), [])]
        seen = {self._key(at, mover)}
        for _ in range(DETOURS):
            if not queue:
                break
            cost, _, state, moves = heapq.heappop(queue)
            last = self._drive(dict(state), mover, goal, toward)
            if last is not None:
                return moves + last
            for edge in self._out[state[mover]]:
                after = dict(state)
                step = self._go(after, mover, [edge])
                key = self._key(after, mover)
                if step is None or key in seen:
                    continue
                seen.add(key)
                way = sum(self._lengths[each] for _, each in step)
                heapq.heappush(queue, (cost + way, len(seen), after, moves + step))
        return self._search(at, mover, goal)

    def _search(self, at: dict[str, int], mover: str, goal: int) -> list[Move] | None:
        """Return the fewest moves, of all that any robot can make (breadth first); None if there are none in STATES states."""
        states: list[tuple[dict[str, int], int, Move]] = [(at, -1, (mover, -1))]
        seen = {self._key(at, mover)}
        for number, (state, _, _) in enumerate(states):
            if number == STATES:
                return None
            if state[mover] == goal:
                moves = list[Move]()
                while number > 0:
                    _, before, move = states[number]
                    moves.append(move)
                    number = before
                return moves[::-1]
            for name, node in state.items():
                for edge in self._out[node]:
                    after = {**state, name: self._ends[edge]}
                    key = self._key(after, mover)
                    if key not in seen and self._free(state, name, edge):
                        seen.add(key)
                        states.append((after, number, (name, edge)))
        return None

    @staticmethod
    def _key(at: dict[str, int], mover: str) -> tuple[int, frozenset[int]]:
        return at[mover], frozenset(node for name, node in at.items() if name != mover)

    def _toward(self, mover: str, goal: int) -> dict[int, int]:
        """Return by node the first edge of the shortest way to a goal (-1 at the goal), with all robots away that can move."""
        found: dict[int, int] = {}
        queue = [(0.0, goal, -1)]
        while queue:
            away, node, edge = heapq.heappop(queue)
            if node in found:
                continue
            found[node] = edge
            for before, start in self._into[node]:
                if start not in found and not self._closed(mover, before):
                    heapq.heappush(queue, (away + self._lengths[before], start, before))
        return found

    def _drive(self, at: dict[str, int], mover: str, goal: int, toward: dict[int, int]) -> list[Move] | None:
        way, node = list[int](), at[mover]
        if node not in toward:
            return None
        while node != goal:
            way.append(toward[node])
            node = self._ends[toward[node]]
        return self._go(at, mover, way)

    def _go(self, at: dict[str, int], mover: str, way: Sequence[int]) -> list[Move] | None:
        """Clear a way and drive it; changes `at`. None if that is impossible."""
        moves = self._clear(at, mover, way)
        for edge in way:
            if moves is None or not self._free(at, mover, edge):
                return None
            moves.append((mover, edge))
            at[mover] = self._ends[edge]
        return moves

    def _free(self, at: dict[str, int], name: str, edge: int) -> bool:
        return not self._closed(name, edge) and not any(
            node in self._in_way(name, edge, other) for other, node in at.items() if other != name
        )

    def _clear(self, at: dict[str, int], mover: str, way: Sequence[int]) -> list[Move] | None:
        """Put all robots off a way, each to the nearest place; changes `at`. None if there is none for one of them."""
        off: dict[str, set[int]] = {
            name: set[int]().union(*(self._in_way(mover, edge, name) for edge in way)) for name in at if name != mover
        }
        moves: list[Move] = []
        for _ in range(len(at)):
            standing = [name for name in sorted(off) if at[name] in off[name]]
            if not standing:
                return moves
            chains = [chain for name in standing for chain in self._ways_out(at, name, mover, off[name])]
            for chain in sorted(chains, key=len)[:_CHAINS]:
                shifted = self._shift(at, mover, chain)
                if shifted:
                    moves += shifted
                    break
            else:
                return None
        return None

    def _ways_out(self, at: dict[str, int], name: str, mover: str, barred: set[int]) -> list[list[int]]:
        """Return ways (edges) of a robot to the nearest nodes without a robot that are not barred; robots on them are pushed."""
        taken = set(at.values())
        came: dict[int, int] = {at[name]: -1}
        queue, found = [at[name]], list[list[int]]()
        for node in queue:
            if node not in taken and node not in barred:
                way, each = list[int](), node
                while came[each] >= 0:
                    way.append(came[each])
                    each = self._starts[came[each]]
                found.append(way[::-1])
                if len(found) == _CHAINS // 2:
                    break
            for edge in self._out[node]:
                after = self._ends[edge]
                if after in came or self._closed(name, edge) or at[mover] in self._in_way(name, edge, mover):
                    continue
                came[after] = edge
                queue.append(after)
        return found

    def _shift(self, at: dict[str, int], mover: str, way: Sequence[int]) -> list[Move] | None:
        """Move the robots on a way on, each to the place of the next one, the last one to its end; changes `at`."""
        nodes = [self._starts[way[0]], *(self._ends[edge] for edge in way)]
        standing = {node: name for name, node in at.items() if name != mover}
        trial, moves, end = dict(at), list[Move](), len(way)
        for place in reversed(range(len(way))):
            name = standing.get(nodes[place])
            if name is None:
                continue
            for edge in way[place:end]:
                if not self._free(trial, name, edge):
                    return None
                trial[name] = self._ends[edge]
                moves.append((name, edge))
            end = place
        at.update(trial)
        return moves
