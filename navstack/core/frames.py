"""A tree of planar frames over time: what tf does for move_base, without threads.

A dynamic frame keeps its last `history_s` seconds of transforms; look-ups between two of them interpolate linearly (yaw
along the shorter way). Looking beyond the newest transform is an error, as in tf, except within `tolerance_s`.
"""

from __future__ import annotations

import bisect

from navstack.core.angles import angle_between, normalize_angle
from navstack.core.errors import FrameError
from navstack.core.geometry import Transform2D

IDENTITY = Transform2D()


def clean_frame(name: str) -> str:
    """`/map` and `map` are one frame: tf2 dropped the leading slash of tf."""
    return name.removeprefix("/")


class _Edge:
    """Transforms of one child in its parent, by time."""

    __slots__ = ("parent", "stamps", "static", "transforms")

    def __init__(self, parent: str, static: bool) -> None:
        self.parent = parent
        self.static = static
        self.stamps: list[float] = []
        self.transforms: list[Transform2D] = []


class FrameTree:
    """Frames by name; each has one parent."""

    def __init__(self, history_s: float = 10.0) -> None:
        self.history_s = history_s
        self._edges: dict[str, _Edge] = {}

    def set_static(self, parent: str, child: str, transform: Transform2D) -> None:
        """`transform` = pose of `child` in `parent`, true at any time."""
        edge = self._edge(clean_frame(parent), clean_frame(child), static=True)
        edge.stamps[:] = [0.0]
        edge.transforms[:] = [transform]

    def set(self, parent: str, child: str, transform: Transform2D, stamp: float) -> None:
        """`transform` = pose of `child` in `parent` at `stamp` (s). Stamps may come late, but not before the history."""
        edge = self._edge(clean_frame(parent), clean_frame(child), static=False)
        stamps = edge.stamps
        if not stamps or stamp > stamps[-1]:
            stamps.append(stamp)
            edge.transforms.append(transform)
            # trim in batches: deleting from the front of a list moves the rest
            if stamps[0] < stamp - 2.0 * self.history_s:
                keep = bisect.bisect_left(stamps, stamp - self.history_s)
                del stamps[:keep], edge.transforms[:keep]
            return
        if stamp < stamps[-1] - self.history_s:
            return
        at = bisect.bisect_left(stamps, stamp)
        if stamps[at] == stamp:
            edge.transforms[at] = transform
        else:
            stamps.insert(at, stamp)
            edge.transforms.insert(at, transform)

    def remove(self, child: str) -> None:
        """Forgets a frame, as when its publisher dies."""
        self._edges.pop(clean_frame(child), None)

    def frames(self) -> list[str]:
        """All names, sorted."""
        return sorted(set(self._edges) | {edge.parent for edge in self._edges.values()})

    def latest_stamp(self, target: str, source: str) -> float:
        """The newest time (s) at which the two frames are connected; inf when only static ones lie between."""
        newest = float("inf")
        common = self._common_ancestor(clean_frame(target), clean_frame(source))
        for name in (clean_frame(target), clean_frame(source)):
            while name != common and name in self._edges:
                edge = self._edges[name]
                if not edge.static:
                    newest = min(newest, edge.stamps[-1])
                name = edge.parent
        return newest

    def lookup(self, target: str, source: str, stamp: float | None = None, tolerance_s: float = 0.0) -> Transform2D:
        """Pose of frame `source` in frame `target` at `stamp` (s), or at the newest common time when None.

        Raises FrameError when the frames are not connected, or not at that time give or take `tolerance_s`.
        """
        target, source = clean_frame(target), clean_frame(source)
        if target == source:
            return IDENTITY
        if stamp is None:
            stamp = self.latest_stamp(target, source)
            tolerance_s = float("inf")
        common = self._common_ancestor(target, source)
        if common is None:
            known = ", ".join(self.frames()) or "none"
            raise FrameError(
                f'no transform from "{source}" to "{target}": they are not connected (frames: {known})',
                target=target,
                source=source,
            )
        up_source = self._up_to(common, source, stamp, tolerance_s)
        if common == target:
            return up_source
        return self._up_to(common, target, stamp, tolerance_s).inverse() @ up_source

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
                raise FrameError(f'frame "{child}" cannot hang below itself through "{parent}"', child=child)
            edge = self._edges[child] = _Edge(parent, static)
        return edge

    def _up_to(self, ancestor: str, name: str, stamp: float, tolerance_s: float) -> Transform2D:
        total = IDENTITY
        while name != ancestor:
            edge = self._edges[name]
            step = edge.transforms[0] if edge.static else self._at(name, edge, stamp, tolerance_s)
            total = step if total.is_identity() else step @ total
            name = edge.parent
        return total

    @staticmethod
    def _at(name: str, edge: _Edge, stamp: float, tolerance_s: float) -> Transform2D:
        stamps = edge.stamps
        if stamp >= stamps[-1]:
            if stamp - stamps[-1] > tolerance_s:
                raise FrameError(
                    f'the pose of "{name}" in "{edge.parent}" is {stamp - stamps[-1]:.3f} s old at {stamp:.3f} s '
                    f"(tolerance {tolerance_s:.3f} s)",
                    frame=name,
                    age_s=stamp - stamps[-1],
                )
            return edge.transforms[-1]
        if stamp <= stamps[0]:
            if stamps[0] - stamp > tolerance_s:
                raise FrameError(
                    f'the pose of "{name}" in "{edge.parent}" is known from {stamps[0]:.3f} s on, not at {stamp:.3f} s',
                    frame=name,
                )
            return edge.transforms[0]
        after = bisect.bisect_right(stamps, stamp)
        t0, t1 = stamps[after - 1], stamps[after]
        a, b = edge.transforms[after - 1], edge.transforms[after]
        f = (stamp - t0) / (t1 - t0)
        return Transform2D(
            a.x + f * (b.x - a.x), a.y + f * (b.y - a.y), normalize_angle(a.yaw + f * angle_between(a.yaw, b.yaw))
        )
