"""wait: stand still for some time."""

from __future__ import annotations

import math
from typing import Any

from navstack.core import RobotState
from navstack.interfaces import Motion, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.motion.errors import InvalidMotionError
from navstack.parameters.models.motion import MotionParams


class Wait(Motion):
    """Commands zero velocity for `duration` (s). It cannot fail."""

    Params = MotionParams

    def __init__(self, duration: float, params: MotionParams | None = None, name: str = "wait") -> None:
        """Raise InvalidMotionError for a negative duration, or one that is not finite."""
        super().__init__(name, params or MotionParams())
        if not (math.isfinite(duration) and duration >= 0.0):
            raise InvalidMotionError(f"{name} takes a time of 0 s or more, not {duration}", duration=duration)
        self.duration = duration
        self._until = 0.0

    def describe(self) -> dict[str, Any]:
        """Return the duration (s)."""
        return {"wait": self.duration}

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self.params.frequency

    def start(self, context: RecoveryContext, now: float) -> None:
        """Start the wait at `now` (s)."""
        del context
        self._until = now + self.duration

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """Return zero velocity."""
        del state
        left = self._until - now
        if left <= 1e-6:
            return RecoveryStep(RecoveryStatus.DONE, text=f"{self.name} waited {self.duration:g} s")
        return RecoveryStep(RecoveryStatus.RUNNING, data={"left_s": left})
