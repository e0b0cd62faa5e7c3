"""Turning in place as Nav2's controllers do: as fast as allowed, braking so that the turn ends at its target."""

from __future__ import annotations

import math


def turning_speed(error: float, speed: float, acceleration: float, last: float, period: float) -> float:
    """Return the turning speed (rad/s) of Nav2 for an `error` (rad) that is left, `period` (s) after the speed `last`.

    At most `speed`, within `acceleration` (rad/s²) of `last`, then at most sqrt(2 acceleration |error|), from which the turn can
    be stopped in time, even if the acceleration does not allow to brake that much.
    """
    wanted = speed if error > 0.0 else -speed
    change = acceleration * period
    wanted = min(max(wanted, last - change), last + change)
    highest = math.sqrt(2.0 * acceleration * abs(error))
    return min(max(wanted, -highest), highest)


def limited_turning_speed(error: float, speed: float, acceleration: float, last: float, period: float) -> float:
    """As `turning_speed`, but always within `acceleration` of `last`, and made for commands that last a whole period.

    From a speed w, commands that fall by acceleration * period each turn by w² / (2 acceleration) + w period / 2 (rad) until they
    are zero. The highest w for which that is at most `error` never has to brake harder.
    """
    half = 0.5 * period
    braking = acceleration * (math.sqrt(half * half + 2.0 * abs(error) / acceleration) - half)
    wanted = math.copysign(min(speed, braking, abs(error) / period), error)
    change = acceleration * period
    return min(max(wanted, last - change), last + change)
