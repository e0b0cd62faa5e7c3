"""A tree of planar frames over time, like tf, without threads.

A dynamic frame stores the transforms of the last `history_s` seconds. Lookups between two of them interpolate linearly (yaw in
the shorter direction). A lookup after the newest transform is an error, as in tf, except within `tolerance_s`.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence

from navstack.core.angles import angle_between, normalize_angle
from navstack.core.errors import FrameError
from navstack.core.geometry import Transform2D

IDENTITY = Transform2D()


def clean_frame(name: str) -> str:
    """Return the name without a leading slash: tf2 treats `/map` as `map`."""
    return name.removeprefix("/")


class _Edge:
    """Transforms of one frame in its parent frame over time."""

    __slots__ = ("child", "parent", "stamps", "static", "transforms")

    def __init__(self, parent: str, child: str, static: bool) -> None:
        self.parent = parent
        self.child = child
        self.static = static
        self.stamps: list[float] = []
        self.transforms: list[Transform2D] = []

    def at(self, stamp: float, tolerance_s: float) -> Transform2D:
        """Return the transform at `stamp` (s), interpolated. Raises FrameError outside the range plus tolerance."""
        if self.static:
            return self.transforms[0]
        stamps = self.stamps
        newest = stamps[-1]
        if stamp >= newest:
            if stamp - newest > tolerance_s:
                raise FrameError(
                    f'the pose of "{self.child}" in "{self.parent}" is {stamp - newest:.3f} s old at {stamp:.3f} s '
                    f"(tolerance {tolerance_s:.3f} s)",
                    frame=self.child,
                    age_s=stamp - newest,
                )
            return self.transforms[-1]
        if stamp <= stamps[0]:
            if stamps[0] - stamp > tolerance_s:
                raise FrameError(
                    f'the pose of "{self.child}" in "{self.parent}" is known from {stamps[0]:.3f} s, not at {stamp:.3f} s',
                    frame=self.child,
                )
            return self.transforms[0]
        after = bisect.bisect_right(stamps, stamp)
        t0, t1 = stamps[after - 1], stamps[after]
        a, b = self.transforms[after - 1], self.transforms[after]
        f = (stamp - t0) / (t1 - t0)
        return Transform2D(
            a.x + f * (b.x - a.x), a.y + f * (b.y - a.y), normalize_angle(a.yaw + f * angle_between(a.yaw, b.yaw))
        )


class _Chain:
    """The edges from two frames up to their common ancestor, and the last result."""

    __slots__ = ("changes", "down", "moving", "result", "stamp", "tolerance_s", "up")

    def __init__(self, up: tuple[_Edge, ...], down: tuple[_Edge, ...]) -> None:
        self.up = up
        self.down = down
        self.moving = tuple(edge for edge in (*up, *down) if not edge.static)
        self.changes = -1
        self.stamp = 0.0
        self.tolerance_s = 0.0
        self.result = IDENTITY

    def newest(self) -> float:
        """Return the newest time (s) at which all edges are known; inf if all are static."""
        moving = self.moving
        if len(moving) == 1:
            return moving[0].stamps[-1]
        return min([edge.stamps[-1] for edge in moving], default=math.inf)

    def pose(self, stamp: float, tolerance_s: float) -> Transform2D:
        """Return the pose of the source in the target frame."""
        if not self.down and len(self.up) == 1:
            return self.up[0].at(stamp, tolerance_s)
        pose = _composed(self.up, stamp, tolerance_s)
        return _composed(self.down, stamp, tolerance_s).inverse() @ pose if self.down else pose


def _composed(edges: tuple[_Edge, ...], stamp: float, tolerance_s: float) -> Transform2D:
    total = IDENTITY
    for edge in edges:
        step = edge.at(stamp, tolerance_s)
        total = step if total is IDENTITY else step @ total
    return total


class FrameTree:
    """A tree of frames by name."""

    def __init__(self, history_s: float = 10.0) -> None:
        self.history_s = history_s
        self._edges: dict[str, _Edge] = {}
        # keyed by the names as passed by the caller; cleared when the structure of the tree changes
        self._chains: dict[tuple[str, str], _Chain] = {}
        self._known: dict[tuple[str, str], _Edge] = {}
        self._changes = 0

    def set_static(self, parent: str, child: str, transform: Transform2D) -> None:
        """Set the pose of `child` in `parent`, valid at all times."""
        edge = self._edge(clean_frame(parent), clean_frame(child), static=True)
        self._clear_caches()  # cached static chains depend on this edge
        edge.stamps[:] = [0.0]
        edge.transforms[:] = [transform]

    def set(self, parent: str, child: str, transform: Transform2D, stamp: float) -> None:
        """Set the pose of `child` in `parent` at `stamp` (s). Older stamps are inserted if they are within the history."""
        edge = self._dynamic(parent, child)
        self._changes += 1
        stamps = edge.stamps
        if not stamps or stamp > stamps[-1]:
            stamps.append(stamp)
            edge.transforms.append(transform)
            self._trim(edge)
            return
        if stamp < stamps[-1] - self.history_s:
            return
        at = bisect.bisect_left(stamps, stamp)
        if stamps[at] == stamp:
            edge.transforms[at] = transform
        else:
            stamps.insert(at, stamp)
            edge.transforms.insert(at, transform)

    def extend(self, parent: str, child: str, transforms: Sequence[Transform2D], stamps: Sequence[float]) -> None:
        """Set several transforms at once; the stamps (s) must increase."""
        edge = self._dynamic(parent, child)
        if not stamps or (edge.stamps and stamps[0] <= edge.stamps[-1]):
            for transform, stamp in zip(transforms, stamps, strict=True):
                self.set(parent, child, transform, stamp)
            return
        self._changes += 1
        edge.stamps.extend(stamps)
        edge.transforms.extend(transforms)
        self._trim(edge)

    def _dynamic(self, parent: str, child: str) -> _Edge:
        edge = self._known.get((parent, child))
        if edge is None:
            edge = self._edge(clean_frame(parent), clean_frame(child), static=False)
            self._known[parent, child] = edge
        return edge

    def _trim(self, edge: _Edge) -> None:
        """Remove transforms older than the history, in batches because removing from the front of a list is slow."""
        stamps = edge.stamps
        stamp = stamps[-1]
        if stamps[0] < stamp - 2.0 * self.history_s:
            keep = bisect.bisect_left(stamps, stamp - self.history_s)
            del stamps[:keep], edge.transforms[:keep]

    def remove(self, child: str) -> None:
        """Remove a frame, for example when its publisher stops."""
        self._edges.pop(clean_frame(child), None)
        self._clear_caches()

    def frames(self) -> list[str]:
        """Return all names, sorted."""
        return sorted(set(self._edges) | {edge.parent for edge in self._edges.values()})

    def latest_stamp(self, target: str, source: str) -> float:
        """Return the newest time (s) at which the two frames are connected; inf if only static transforms connect them.

        Raises FrameError if they are not connected.
        """
        return self._chain(target, source).newest()

    def lookup(self, target: str, source: str, stamp: float | None = None, tolerance_s: float = 0.0) -> Transform2D:
        """Return the pose of frame `source` in frame `target` at `stamp` (s), or at the newest common time if None.

        Raises FrameError if the frames are not connected at that time, within `tolerance_s`.
        """
        chain = self._chains.get((target, source))
        if chain is None:
            chain = self._chain(target, source)
        if stamp is None:
            stamp, tolerance_s = chain.newest(), math.inf
        if not chain.moving and chain.changes >= 0:
            return chain.result
        # repeated lookup at the same time
        if chain.changes == self._changes and chain.stamp == stamp and chain.tolerance_s <= tolerance_s:
            return chain.result
        chain.result = result = chain.pose(stamp, tolerance_s)
        chain.changes, chain.stamp, chain.tolerance_s = self._changes, stamp, tolerance_s
        return result

    def _chain(self, target: str, source: str) -> _Chain:
        known = self._chains.get((target, source))
        if known is not None:
            return known
        a, b = clean_frame(target), clean_frame(source)
        common = self._common_ancestor(a, b)
        if common is None:
            frames = ", ".join(self.frames()) or "none"
            raise FrameError(
                f'no transform from "{b}" to "{a}": the frames are not connected (known frames: {frames})',
                target=a,
                source=b,
            )
        chain = self._chains[target, source] = _Chain(self._edges_up(b, common), self._edges_up(a, common))
        return chain

    def _edges_up(self, name: str, ancestor: str) -> tuple[_Edge, ...]:
        edges: list[_Edge] = []
        while name != ancestor:
            edges.append(self._edges[name])
            name = edges[-1].parent
        return tuple(edges)

    def _clear_caches(self) -> None:
        self._changes += 1
        self._chains.clear()
        self._known.clear()

    def _common_ancestor(self, a: str, b: str) -> str | None:
        above: set[str] = {a}
        while a in self._edges:
            a = self._edges[a].parent
            above.add(a)
        while b not in above:
            edge = self._edges.get(b)
            if edge is None:
                return None
            b = edge.parent
        return b

    def _edge(self, parent: str, child: str, static: bool) -> _Edge:
        edge = self._edges.get(child)
        if edge is None or edge.parent != parent or edge.static != static:
            name: str = parent
            while name in self._edges:
                name = self._edges[name].parent
                if name == child:
                    break
            if name == child or parent == child:
                raise FrameError(
                    f'frame "{child}" cannot be its own ancestor, through "{parent}"; use a tree without cycles',
                    child=child,
                )
            edge = self._edges[child] = _Edge(parent, child, static)
            self._clear_caches()
        return edge
