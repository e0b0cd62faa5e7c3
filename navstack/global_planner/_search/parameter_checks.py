"""Checks that global planners share; their parameter models call them in `check`."""

from __future__ import annotations

from collections.abc import Iterator

from navstack.core.parameter_checks import CheckContext, Issue


def unknown_not_tracked(context: CheckContext, allow_unknown: bool) -> Iterator[Issue]:
    """`allow_unknown: false` keeps plans out of unknown space only if a layer tracks it."""
    costmap = context.global_costmap
    if allow_unknown or costmap.track_unknown_space:
        return
    if any(layer.traits.tracks_unknown_space for layer in costmap.layers):
        return
    message = (
        "allow_unknown = false has no effect because no layer of the global costmap tracks unknown space; set "
        "track_unknown_space: true in global_costmap"
    )
    yield Issue("warning", "unknown-not-tracked", ("allow_unknown",), message)
