"""What a tick of move_base adds to a record, for any robot: simulated, replayed or real."""

from __future__ import annotations

from collections.abc import Callable

from navstack.core import LaserScan
from navstack.move_base import MoveBase
from navstack.record.recorder import RunRecorder


def record_tick_outputs(recorder: RunRecorder, move_base: MoveBase, mount: Callable[[str], None] | None = None) -> None:
    """Add the changed cells, plans, scans and command steps of the last tick.

    `mount` is called with the frame of each scan before the scan is added.
    """
    tick = move_base.last_tick
    t = tick.time
    if tick.global_window is not None:
        recorder.costmap(t, "global", move_base.global_costmap.master, tick.global_window)
    if tick.local_window is not None:
        recorder.costmap(t, "local", move_base.local_costmap.master, tick.local_window)
    if tick.plan is not None:
        recorder.plan(t, tick.plan.path.poses, tick.plan.path.frame)
    if tick.local_plan is not None:
        recorder.local_plan(t, tick.local_plan)
    for scan in tick.scans:
        if isinstance(scan, LaserScan):
            if mount is not None:
                mount(scan.frame)
            recorder.scan(scan.stamp, scan)
    if move_base.chain is not None:
        for step in move_base.chain.take_steps():
            recorder.command_step(step)
