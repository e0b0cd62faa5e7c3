"""The chain between the sources of commands and the robot: multiplexer, velocity smoother, collision monitor.

MoveBase, motions and teleop command the chain as they would command the robot; `tick` passes the result to the robot.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from navstack.core import Costmap, FrameTree, RobotState, SensorData, Twist2D
from navstack.parameters import TwistMuxParams
from navstack.plugins import LocalizationStatus, Robot
from navstack.safety.monitor import CollisionDetector, CollisionMonitor, MonitorDecision
from navstack.safety.multiplexer import CommandMultiplexer
from navstack.safety.velocity_smoother import VelocitySmoother

NAVIGATION: Final = "navigation"
"""Source of the commands of `CommandChain.command`, which MoveBase calls."""
MOST_STEPS: Final = 4096
"""Number of steps that a chain keeps until they are taken."""
_ZERO: Final = Twist2D()


@dataclass(frozen=True, slots=True)
class CommandStep:
    """A command on its way through the chain."""

    time: float
    """Seconds."""
    source: str
    """Which source requested it; empty if no source drives the robot."""
    requested: Twist2D
    """The source's command."""
    smoothed: Twist2D
    """After the velocity smoother."""
    sent: Twist2D
    """Sent to the robot."""
    is_sent: bool
    """False if the robot did not get it: the collision monitor has been silent since `stop_pub_timeout`."""
    smoother_reason: str = ""
    """Why the smoother changed it, empty if it did not."""
    decision: MonitorDecision | None = None
    """What the collision monitor decided; None without one."""
    release_reason: str = ""
    """Why the robot got less than the collision monitor allowed: it speeds up within the limits of the smoother; else empty."""

    @property
    def changed_by(self) -> str:
        """`collision_monitor`, `velocity_smoother` or empty: the last one that changed the command."""
        if self.release_reason:
            return "velocity_smoother"
        if self.sent != self.smoothed:
            return "collision_monitor"
        return "velocity_smoother" if self.smoothed != self.requested else ""

    @property
    def action(self) -> str:
        """Action of the collision monitor: `stop`, `slowdown`, `limit`, `approach` or `none`."""
        return self.decision.action if self.decision is not None else "none"

    @property
    def reason(self) -> str:
        """Why the command was changed, one clause per part that changed it."""
        parts: list[str] = []
        if self.smoothed != self.requested:
            parts.append(f"velocity_smoother: {self.smoother_reason}")
        if self.decision is not None and self.decision.command != self.smoothed:
            parts.append(f"collision_monitor: {self.decision.reason}")
        if self.release_reason:
            parts.append(f"release: {self.release_reason}")
        return "; ".join(parts)

    def as_dict(self) -> dict[str, Any]:
        """Return the step for JSON."""
        return {
            "time": self.time,
            "source": self.source,
            "requested": list(self.requested),
            "smoothed": list(self.smoothed),
            "sent": list(self.sent),
            "changed_by": self.changed_by,
            "action": self.action,
            "zone": self.decision.zone if self.decision is not None else "",
            "reason": self.reason,
        }


class CommandChain:
    """A `Robot` whose commands pass a multiplexer, a velocity smoother and a collision monitor; each may be absent.

    Call `command` or `send` with commands and `tick` at `due` and after every command. Nothing reads a clock: the time of
    `command` is that of the last `begin` or `tick`, `send` has its own.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        multiplexer: CommandMultiplexer | None = None,
        smoother: VelocitySmoother | None = None,
        monitor: CollisionMonitor | None = None,
        detector: CollisionDetector | None = None,
    ) -> None:
        """Without a multiplexer, that of the default parameters is used: teleop over motion over navigation."""
        self.robot = robot
        self.multiplexer = multiplexer or CommandMultiplexer(TwistMuxParams())
        self.smoother = smoother
        self.monitor = monitor
        self.detector = detector
        self.last: CommandStep | None = None
        """The last step."""
        self._now = 0.0
        self._requested: Twist2D | None = None
        """The command of the source that drives the robot; None before the first one."""
        self._source = ""
        self._is_new = False
        """`_requested` has not been passed on."""
        self._checked_at = -math.inf
        self._smoothed = _ZERO
        self._smoother_reason = ""
        self._steps: deque[CommandStep] = deque(maxlen=MOST_STEPS)

    # --- a robot ------------------------------------------------------------------------------------------------------

    @property
    def frames(self) -> FrameTree:
        """The frames of the robot."""
        return self.robot.frames

    def state(self) -> RobotState:
        """Return the odometry of the robot."""
        return self.robot.state()

    @property
    def localization_status(self) -> LocalizationStatus | None:
        """Whether the robot is localized; None for a robot that does not watch it."""
        return getattr(self.robot, "localization_status", None)

    def scans(self) -> Sequence[SensorData]:
        """Return the sensor data of the robot since the last call; monitor and detector see them too."""
        scans = self.robot.scans()
        for part in (self.monitor, self.detector):
            if part is not None:
                for data in scans:
                    part.observe(data)
        return scans

    def observe_costmap(self, name: str, costmap: Costmap, now: float) -> None:
        """Take an updated costmap (`local_costmap`, `global_costmap`) for sources of type costmap."""
        for part in (self.monitor, self.detector):
            if part is not None:
                part.field.observe_costmap(name, costmap, now)

    def command(self, twist: Twist2D) -> None:
        """Take a command of the navigation, at the time of the last `begin` or `tick`."""
        self.send(NAVIGATION, twist, self._now)

    # --- commands -----------------------------------------------------------------------------------------------------

    def send(self, source: str, twist: Twist2D, now: float) -> bool:
        """Take a command of a source (`navigation`, `motion`, `teleop`, or an input of twist_mux) at `now` (s).

        Return False if another source drives the robot. The robot gets the command at the next `tick`. Raises InputError for
        an unknown source and for a command that is not finite.
        """
        self._now = max(self._now, now)
        passed = self.multiplexer.command(source, twist, now)
        if passed is None:
            return False
        self._take(self.multiplexer.resolve(source), passed, now)
        return True

    def begin(self, now: float) -> None:
        """Set the time (s) of the commands that follow."""
        self._now = max(self._now, now)

    @property
    def due(self) -> float:
        """Next time (s) at which `tick` has work."""
        due = self.multiplexer.due
        if self.smoother is not None:
            due = min(due, self.smoother.due)
        elif self._is_new:
            due = min(due, self._now)
        if self.monitor is not None and self.last is not None and self.last.smoothed != _ZERO:
            due = min(due, self._checked_at + 1.0 / self.monitor.params.check_frequency)
        if self.detector is not None:
            due = min(due, self.detector.due)
        return due

    def tick(self, now: float) -> CommandStep | None:
        """Pass what is due at `now` (s) to the robot; return the step, None if nothing was sent.

        Raises what the robot raises for a command that it rejects.
        """
        self.begin(now)
        stop = self.multiplexer.step(now)
        if stop is not None:
            self._take("", stop, now)
        if self.detector is not None and now >= self.detector.due - 1e-9:
            self.detector.step(now)
        if not self._smooth(now) and not self._is_check_due(now):
            return None
        return self._pass_on(now)

    def halt(self, now: float) -> None:
        """Stop the robot at once: drop all commands, without the ramp of the smoother."""
        self.begin(now)
        self._requested, self._source, self._is_new = None, "", False
        self._smoothed, self._smoother_reason = _ZERO, ""
        if self.smoother is not None:
            self.smoother.reset()
        self.robot.command(_ZERO)

    def take_steps(self) -> list[CommandStep]:
        """Return the steps since the last call, oldest first; of more than `MOST_STEPS`, the last ones."""
        steps = list(self._steps)
        self._steps.clear()
        return steps

    def _take(self, source: str, twist: Twist2D, now: float) -> None:
        self._source, self._requested, self._is_new = source, twist, True
        if self.smoother is not None:
            self.smoother.command(twist, now)

    def _smooth(self, now: float) -> bool:
        """Return True if there is a new command for the collision monitor."""
        requested = self._requested
        if requested is None:
            return False
        if self.smoother is None:
            is_new, self._is_new = self._is_new, False
            self._smoothed, self._smoother_reason = requested, ""
            return is_new
        if now < self.smoother.due - 1e-9:
            return False
        self.smoother.observe(self.robot.state())
        smoothed = self.smoother.step(now)
        if smoothed is None:
            return False
        self._is_new = False
        self._smoothed, self._smoother_reason = smoothed.twist, smoothed.reason
        return True

    def _is_check_due(self, now: float) -> bool:
        """True if the last command must be checked again, because the robot drives and obstacles may have appeared."""
        if self.monitor is None or self._smoothed == _ZERO:
            return False
        return now >= self._checked_at + 1.0 / self.monitor.params.check_frequency - 1e-9

    def _pass_on(self, now: float) -> CommandStep:
        requested = self._requested
        assert requested is not None
        sent, is_sent, released, decision = self._smoothed, True, "", None
        if self.monitor is not None:
            decision = self.monitor.process(self._smoothed, now, self.robot.state().velocity)
            is_sent = decision.is_sent
            sent, released = self._release(decision, now)
        self._checked_at = now
        step = CommandStep(
            now, self._source, requested, self._smoothed, sent, is_sent, self._smoother_reason, decision, released
        )
        self.last = step
        self._steps.append(step)
        if is_sent:
            self.robot.command(sent)
        return step

    def _release(self, decision: MonitorDecision, now: float) -> tuple[Twist2D, str]:
        """Return what the robot gets of a command that the monitor lets pass, and why it is less, empty if it is not.

        The smoother limits changes of its own output. A robot that the monitor has held must not jump to that output when it lets
        go, and the output must not rise meanwhile.
        """
        assert self.monitor is not None
        sent, released = decision.command, ""
        if self.smoother is None or self.monitor.params.nav2_compatible:
            return sent, released
        last = self.last
        if last is not None and last.sent != last.smoothed:
            limited = self.smoother.release(last.sent, sent, now - last.time)
            sent, released = limited.twist, limited.reason
            if released:
                self.monitor.note_sent(sent)
        # a slowdown is a factor of the output: continuing from the product would apply it again and again
        if sent != self._smoothed and decision.action != "slowdown":
            self.smoother.feed_back(sent, now)
        return sent, released
