"""The results of a replay as a document, and as lines of text."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.replay.comparison import CommandComparison, PlanComparison, compare_commands
from navstack.replay.log_replay import LogReplay, ReplayedGoal
from navstack.ros_messages import seconds


class ReplayReport:
    """What a replay found."""

    def __init__(self, replay: LogReplay) -> None:
        self._replay = replay
        self.commands: CommandComparison | None = compare_commands(replay.cycles)
        self.plans: PlanComparison | None = replay.compared_plans.result()
        self.cycles = len(replay.cycles)
        self.active, self.rejected, self.controlled = replay.cycles.count()
        """Cycles with an active goal, and of these those in which the local planner found no valid command, and one."""

    @property
    def rejected_share(self) -> float:
        """Share of the control cycles without a valid command; nan without control cycles."""
        cycles = self.controlled + self.rejected
        return self.rejected / cycles if cycles else math.nan

    def as_dict(self) -> dict[str, Any]:
        """Return the results for JSON."""
        replay = self._replay
        return {
            "log": str(replay.log.path),
            "start_ns": replay.log.start_ns,
            "duration_s": replay.duration,
            "cycles": self.cycles,
            "active_cycles": self.active,
            "control_cycles": self.controlled + self.rejected,
            "rejected_cycles": self.rejected,
            "commands": None if self.commands is None else self.commands.as_dict(),
            "plans": None if self.plans is None else self.plans.as_dict(),
            "goals": [_goal(goal) for goal in replay.goals],
            "silences": [
                {"topic": s.topic, "start_s": s.start, "duration_s": s.duration} for s in replay.player.silences
            ],
            "late_transforms": replay.player.late_transforms,
            "problems": dict(replay.player.problems),
            "notes": replay.notes,
        }

    def lines(self) -> list[str]:
        """Return the results in words."""
        found = [
            f"{self._replay.duration:.1f} s of the log, {self.cycles:,} cycles, {self.active:,} of them with an active goal"
        ]
        if self.controlled + self.rejected:
            found.append(
                f"no valid command in {self.rejected:,} of {self.controlled + self.rejected:,} control cycles "
                f"({100.0 * self.rejected_share:.1f} %)"
            )
        if self.commands is not None:
            found += _command_lines(self.commands)
        if self.plans is not None:
            p = self.plans
            found.append(
                f"{p.plans} plans compared: mean length {p.length:.2f} m, in the log {p.recorded_length:.2f} m; mean of the "
                f"largest deviations {p.deviation:.2f} m, largest {p.largest:.2f} m at {p.largest_at:.2f} s"
            )
        silences = self._replay.player.silences
        if silences:
            longest = max(silences, key=lambda silence: silence.duration)
            found.append(
                f"{len(silences)} silences of sensors or odometry; the longest: {longest.topic}, {longest.duration:.2f} s from "
                f"{longest.start:.2f} s"
            )
        late = self._replay.player.late_transforms
        if late:
            found.append(f"{late:,} transforms arrived more than 0.1 s after their stamp")
        for text, count in sorted(self._replay.player.problems.items(), key=lambda item: -item[1])[:5]:
            found.append(f"{count:,} times: {text}")
        return found

    def series(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return times (n,), commands (n, 3), commands of the log (n, 3) and rejected cycles (n,) for a picture.

        NaN where there is no command.
        """
        return self._replay.cycles.series()


def _command_lines(c: CommandComparison) -> list[str]:
    share = 100.0 * c.different / c.cycles
    text = (
        f"commands differ from the log in {c.different:,} of {c.cycles:,} cycles ({share:.1f} %), equal to the bit in "
    )
    text += (
        f"{c.equal:,}, opposite in {c.opposite:,}; mean difference {c.mean_linear:.3f} m/s, {c.mean_angular:.3f} rad/s"
    )
    lines = [text]
    if c.first is not None:
        ours, theirs = c.first.command, c.first.recorded
        navstack = f"navstack {ours.vx:.3f} m/s, {ours.wz:.3f} rad/s"
        lines.append(
            f"first difference at {c.first.time:.2f} s: {navstack}; log {theirs.vx:.3f} m/s, {theirs.wz:.3f} rad/s"
        )
    return lines


def _goal(goal: ReplayedGoal) -> dict[str, Any]:
    handle = goal.handle
    return {
        "goal": list(goal.pose),
        "frame": goal.frame,
        "time_s": goal.time,
        "state": handle.status.name,
        "text": handle.text,
        "message": handle.result.message if handle.is_done else "",
        "ended_s": goal.ended,
        "attempts": list(goal.attempts),
        "recorded_end_s": goal.recorded_end,
        "recorded_text": goal.recorded_text,
    }


def clock_text(replay: LogReplay, time: float) -> str:
    """Return the date and time of a time (s) of a replay, in UTC."""
    from datetime import UTC, datetime

    return datetime.fromtimestamp(seconds(replay.log.start_ns) + time, UTC).strftime("%Y-%m-%d %H:%M:%S")
