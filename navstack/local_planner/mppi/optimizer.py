# pyright: basic
"""The optimization of a control sequence by weighted samples (Williams et al., information-theoretic MPC), as in Nav2."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Twist2D, kernel
from navstack.local_planner.mppi.batch import (
    LANES,
    Batch,
    Floats,
    Motion,
    TrajectoryContext,
    envelope,
    integrate,
    integrate_one,
    padded,
    reach_axis,
    turn_sine,
)
from navstack.local_planner.mppi.params import ACKERMANN, OMNI, SAME_PERIOD_S, SHORTEST_FILTERED, MPPIParams
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic

# ----------------------------------------------------------------------------------------------------------------------
# The update of the controls: control cost, weights, average, smoothing filter, limits.


# pyright: basic


f32 = np.float32


@kernel
def add_control_cost(noise, controls, factors, costs):
    """Add the sum over axes and steps of `factors` (3,) * control * noise to `costs` (K,)."""
    steps, number = noise.shape[1], noise.shape[2]
    total = np.empty(LANES, np.float32)
    for begin in range(0, number, LANES):
        for i in range(LANES):
            total[i] = f32(0.0)
        for axis in range(3):
            if factors[axis] == f32(0.0):
                continue
            for t in range(steps):
                scale = factors[axis] * controls[t, axis]
                row = noise[axis, t, begin : begin + LANES]
                for i in range(LANES):
                    total[i] += scale * row[i]
        row = costs[begin : begin + LANES]
        for i in range(LANES):
            row[i] += total[i]


@kernel
def softmax(costs, number, temperature, weights):
    """Write exp(-(cost - lowest) / temperature), divided by the sum, of the first `number` costs to `weights` (K,), 0 beyond.

    Returns the sum before the division; NaN if a cost is NaN.
    """
    lowest = costs[0]
    for k in range(number):
        lowest = min(lowest, costs[k])
    total = 0.0
    for k in range(number):
        weights[k] = np.exp(-(costs[k] - lowest) / temperature)
        total += np.float64(weights[k])
    for k in range(number):
        weights[k] = f32(np.float64(weights[k]) / total)
    for k in range(number, len(weights)):
        weights[k] = f32(0.0)
    return total


@kernel
def add_weighted_noise(noise, weights, omni, controls):
    """Add the average of the noise (3, T, K), weighted by `weights` (K,), to `controls` (T, 3)."""
    steps, number = noise.shape[1], noise.shape[2]
    total = np.empty(LANES, np.float32)
    for axis in range(3):
        if axis == 1 and not omni:
            continue
        for t in range(steps):
            for i in range(LANES):
                total[i] = f32(0.0)
            for begin in range(0, number, LANES):
                row = noise[axis, t, begin : begin + LANES]
                weight = weights[begin : begin + LANES]
                for i in range(LANES):
                    total[i] += weight[i] * row[i]
            width = LANES // 2
            while width > 0:
                for i in range(width):
                    total[i] += total[i + width]
                width //= 2
            controls[t, axis] += total[0]


@kernel
def smooth(controls, before, coefficients, out):
    """Filter `controls` (T, 3) with nine `coefficients` over time (Savitzky and Golay) into `out`; the last row is kept.

    `before` (4, 3) stands to the left of the first row, the last row repeated to the right of the last one.
    """
    steps = len(controls)
    for axis in range(3):
        for t in range(steps - 1):
            total = f32(0.0)
            for i in range(9):
                at = t + i - 4
                if at < 0:
                    value = before[at + 4, axis]
                else:
                    value = controls[min(at, steps - 1), axis]
                total += coefficients[i] * value
            out[t, axis] = total
        out[steps - 1, axis] = controls[steps - 1, axis]


@kernel
def clip_turn(controls, radius):
    """Lower the turning speeds of `controls` (T, 3) to what a turning radius (m) allows; 0: no limit."""
    if radius > f32(0.0):
        for t in range(len(controls)):
            highest = abs(controls[t, 0]) / radius
            controls[t, 2] = min(max(controls[t, 2], -highest), highest)


@kernel
def limit(controls, start, highest, lowest, first_rates, rates, shifting, as_nav2):
    """Clip `controls` (T, 3) to the limits `lowest` .. `highest` (3,) and to the envelope of the control before.

    The one before the first is `start` (3,); with `shifting` the first is `start` itself. `first_rates` and `rates` (3, 3):
    axis, then as for `envelope`, for the step to the first control and between controls.
    """
    if shifting:
        for axis in range(3):
            controls[0, axis] = start[axis]
    for axis in range(3):
        before = start[axis]
        for t in range(len(controls)):
            rate = first_rates[axis] if t == 0 else rates[axis]
            value = min(max(controls[t, axis], lowest[axis]), highest[axis])
            if as_nav2:
                forward = before >= f32(0.0)
                low = before - rate[1] if forward else before - rate[0]
                high = before + rate[0] if forward else before + rate[1]
            else:
                low, high = envelope(before, rate[0], rate[1], rate[2], False)
            before = min(max(value, low), high)
            controls[t, axis] = before


# ----------------------------------------------------------------------------------------------------------------------
# Normally distributed noise from a counter: every number is a function of the key and its index.


# pyright: basic


u32 = np.uint32


@kernel
def mixed(value, key):
    """Return a hash of 32 bits: two rounds of multiplication and shift, the second half of the key between them."""
    h = u32(value ^ (value >> u32(16)))
    h = u32(h * u32(0x21F0AAAD))
    h = u32((h ^ (h >> u32(15))) ^ key)
    h = u32(h * u32(0xD35A2D97))
    h = u32(h ^ (h >> u32(15)))
    h = u32(h * u32(0x735A2D97))
    return u32(h ^ (h >> u32(15)))


@kernel
def fill_normals(keys, sigma, out):
    """Write independent normal numbers of standard deviation `sigma` to `out` (n,) float32, n a multiple of 2 * LANES.

    `keys` (2,) uint32. Box and Muller's method on two uniform numbers of 24 bits, on LANES pairs at a time.
    """
    first, second = keys[0], keys[1]
    uniform = np.empty(2 * LANES, np.float32)
    bits = uniform.view(np.uint32)
    exponent = np.empty(LANES, np.float32)
    for begin in range(0, len(out), 2 * LANES):
        for i in range(LANES):
            number = u32(u32(begin + 2 * i) + first)
            # in (0, 1], because of the logarithm
            uniform[i] = (f32(np.int32(mixed(number, second) >> u32(8))) + f32(1.0)) * f32(2.0**-24)
            uniform[LANES + i] = f32(np.int32(mixed(u32(number + u32(1)), second) >> u32(8))) * f32(2.0**-24)
        # u = m * 2**e with m in [1, 2)
        for i in range(LANES):
            exponent[i] = f32(np.int32(bits[i] >> u32(23)) - np.int32(127))
            bits[i] = u32((bits[i] & u32(0x007FFFFF)) | u32(0x3F800000))
        row = out[begin : begin + 2 * LANES]
        for i in range(LANES):
            m = uniform[i]
            large = m > f32(1.4142135)
            e = exponent[i] + f32(1.0) if large else exponent[i]
            x = (f32(0.5) * m if large else m) - f32(1.0)
            # log(1 + x) on [-0.293, 0.414]: Chebyshev fit of (log(1 + x) - x + x * x / 2) / x**3, error below 1e-7
            z = x * x
            p = f32(7.0376836e-2) * x - f32(1.1514610e-1)
            p = p * x + f32(1.1676998e-1)
            p = p * x - f32(1.2420141e-1)
            p = p * x + f32(1.4249323e-1)
            p = p * x - f32(1.6668057e-1)
            p = p * x + f32(2.0000714e-1)
            p = p * x - f32(2.4999994e-1)
            p = p * x + f32(3.3333331e-1)
            logarithm = (p * x * z - f32(0.5) * z) + x + e * f32(0.6931472)
            radius = np.sqrt(max(f32(-2.0) * logarithm, f32(0.0))) * sigma
            sine, cosine = turn_sine(uniform[LANES + i])
            row[i] = radius * cosine
            row[LANES + i] = radius * sine


FILTERS: Final = {
    1: np.full(9, 1.0 / 9.0, np.float32),
    2: (np.array([-21, 14, 39, 54, 59, 54, 39, 14, -21]) / 231.0).astype(np.float32),
}
"""Savitzky and Golay's coefficients of nine points, by order."""
HISTORY: Final = 5
"""Commands kept for the filter: four to the left of the first control, and the current one."""
_MIX: Final = 0x9E3779B97F4A7C15


class Optimizer:
    """Holds the control sequence and what else lasts from cycle to cycle; every stage of a cycle is a method.

    With `as_nav2`, the deliberate differences from Nav2 are off (parity page).
    """

    def __init__(self, params: MPPIParams, critics: Sequence[TrajectoryCritic], *, as_nav2: bool = False) -> None:
        p = self.params = params
        self.critics = list(critics)
        self.as_nav2 = as_nav2
        model = params.motion
        self.omni = model.plugin == OMNI
        self.radius = model.min_turning_r if model.plugin == ACKERMANN else 0.0
        self.period = p.period
        self.shifting = abs(self.period - p.model_dt) <= SAME_PERIOD_S
        self.sent = 1 if self.shifting else 0
        """Index of the control that is sent."""
        self.motion = Motion(p.vx_max, p.vx_min, p.vy_max if self.omni else 0.0, p.wz_max, self.omni, self.radius)
        """The limits in force."""
        self.sigma = np.array([p.vx_std, p.vy_std if self.omni else 0.0, p.wz_std], np.float32)
        lanes, steps = padded(p.batch_size), p.time_steps
        self.noise: Floats = np.zeros((3, steps, lanes), np.float32)
        """(3, T, K) what was added to the controls."""
        self.batch = Batch.empty(p.batch_size, steps, p.model_dt)
        self.scores: Floats = np.zeros((max(1, len(critics)), lanes), np.float32)
        """(C, K) weighted scores of the critics."""
        self.used = [False] * len(self.critics)
        """Which critics were interested."""
        self.costs: Floats = np.zeros(lanes, np.float32)
        """(K,) totals: critics and control costs."""
        self.weights: Floats = np.zeros(lanes, np.float32)
        """(K,) softmax of the totals."""
        self.optimal: Floats = np.zeros((steps, 3), np.float32)
        """(T, 3) the chosen trajectory, relative to the batch's anchor."""
        self.before: Floats = np.zeros((steps, 3), np.float32)
        """(T, 3) the sequence that the noise was added to."""
        self.sequence: Floats = np.zeros((steps, 3), np.float32)
        """(T, 3) the sequence chosen in the last cycle."""
        self.sampled: Floats = self.noise
        """(3, T, K) the noise, or with clamp_raw_controls what is left of it."""
        self._drawn: tuple[int, ...] | None = None
        self._cycle = self._draws = 0
        self.reset()

    def retry(self) -> None:
        """Reset the sequence and the histories, and draw new noise.

        ROS differs: Nav2 also resets the last command, so that the next one may be out of its reach.
        """
        last = self.last
        self.reset()
        if not self.as_nav2:
            self.last = last

    def reset(self) -> None:
        """Reset the whole state: sequence, histories, last command; the noise is redrawn."""
        self.controls: Floats = np.zeros((self.params.time_steps, 3), np.float32)
        self.history: Floats = np.zeros((HISTORY, 3), np.float32)
        """(5, 3) commands sent, the oldest first."""
        self.last = Twist2D()
        """The last command."""
        longest = max(self._delays())
        self.delayed: deque[Twist2D] = deque([Twist2D()] * longest, maxlen=max(1, longest))
        """Commands that the drives may not have executed yet, the oldest first."""
        self._drawn = None
        self._draws += 1

    def _delays(self) -> tuple[int, int, int]:
        """Dead time of each axis (steps)."""
        p = self.params
        steps = [round(d / p.model_dt) for d in (p.model_delay_vx, p.model_delay_vy, p.model_delay_wz)]
        return steps[0], steps[1] if self.omni else 0, steps[2]

    # --- the stages of a cycle --------------------------------------------------------------------------------------

    def rates(self, seconds: float) -> Floats:
        """(3, 3) by axis: change by speeding up and by slowing down in `seconds`, and their ratio."""
        p = self.params
        up = np.array([p.ax_max, p.ay_max, p.az_max])
        down = np.array([-p.ax_min, -p.ay_min, p.az_max])
        return np.stack([up * seconds, down * seconds, up / down], axis=1).astype(np.float32)

    def begin(self, measured: Twist2D) -> Floats:
        """Return the velocity (3,) that the cycle starts with: the last command, as far as the robot can have followed it."""
        p, last = self.params, self.last
        if p.open_loop:
            return np.array(last, np.float32)
        values = list(measured)
        ranges = ((p.ax_min, p.ax_max), (p.ay_min, p.ay_max), (-p.az_max, p.az_max))
        for axis, (low, high) in enumerate(ranges):
            if axis == 1 and not self.omni:
                continue
            speed = measured[axis]
            reach = sorted((speed + self.period * low, speed + self.period * high))
            values[axis] = min(max(last[axis], reach[0]), reach[1])
        return np.array(values, np.float32)

    def pin(self, start: Floats) -> None:
        """Let the sequence begin with what cannot be changed: the current speed, or what is reachable in a period."""
        if self.shifting:
            self.controls[0] = start
            if not self.omni:
                self.controls[0, 1] = 0.0
            return
        first = self.controls[:1].copy()
        big = np.full(3, np.inf, np.float32)
        rates = self.rates(self.period)
        limit(first, start, big, -big, rates, rates, False, self.as_nav2)
        self.controls[0] = first[0]

    def draw(self, attempt: int) -> None:
        """Draw the noise, unless the same noise is used in every cycle and is there."""
        keys = (self.params.seed, self._draws) + ((self._cycle, attempt) if self.params.regenerate_noises else ())
        if keys == self._drawn:
            return
        self._drawn = keys
        for axis in range(3):
            if self.sigma[axis] > 0.0:
                fill_normals(_keys((*keys, axis)), self.sigma[axis], self.noise[axis].reshape(-1))

    def roll_out(self, start: Floats, pose: Pose2D) -> None:
        """Reachable velocities and points of all trajectories."""
        p, batch, dt = self.params, self.batch, np.float32(self.params.model_dt)
        offset = 1 if self.as_nav2 else 0
        first = 1 if self.as_nav2 or self.shifting else 0
        rates = self.rates(p.model_dt)
        if p.clamp_raw_controls:
            self.sampled = self.noise.copy()
        else:
            self.sampled = self.noise
        for axis in range(3):
            if axis == 1 and not self.omni:
                batch.speeds[1] = start[1]
                continue
            controls = np.ascontiguousarray(self.controls[:, axis])
            turning = axis == 2
            reach_axis(
                self.noise[axis],
                controls,
                start[axis],
                rates[axis],
                first,
                offset,
                self.as_nav2 and not turning,
                batch.speeds[axis],
            )
            if p.clamp_raw_controls:
                reached = batch.speeds[axis, first:]
                at = slice(first - offset, first - offset + len(reached))
                self.sampled[axis, at] = reached - controls[at, None]
        self._delay()
        batch.anchor = (pose.x, pose.y)
        batch.collided[:] = False
        batch.all_collided = False
        integrate(batch.speeds, np.array([0.0, 0.0, pose.yaw], np.float32), dt, self.omni, batch.points)

    def _delay(self) -> None:
        """Let each axis follow its controls after its dead time."""
        sent = list(self.delayed)
        for axis, delay in enumerate(self._delays()):
            late = delay - 1 if self.as_nav2 else delay
            speeds = self.batch.speeds[axis]
            if delay == 0 or late == 0:
                continue
            late = min(late, len(speeds) - 1)
            speeds[1 + late :] = speeds[1 : len(speeds) - late].copy()
            for step, command in enumerate(sent[-late:], start=1):
                speeds[step] = command[axis]

    def evaluate(self, context: TrajectoryContext) -> None:
        """Scores of all critics, in order, until one finds every trajectory in collision."""
        self.costs[:] = 0.0
        batch = self.batch
        context.begin(batch.anchor)
        self.used = [False] * len(self.critics)
        for index, critic in enumerate(self.critics):
            self.scores[index] = 0.0
            if not critic.params.enabled:
                continue
            critic.prepare(context)
            self.used[index] = critic.add_scores(batch, self.scores[index], self.costs)
            if batch.all_collided:
                return

    def add_control_cost(self) -> None:
        """Add gamma / sigma² * u * noise to the totals."""
        factors = np.zeros(3, np.float32)
        moving = self.sigma > 0.0
        factors[moving] = np.float32(self.params.gamma) / self.sigma[moving] ** 2
        add_control_cost(self.sampled, self.controls, factors, self.costs)

    def weigh(self) -> None:
        """Softmax of the totals."""
        softmax(self.costs, self.params.batch_size, np.float32(self.params.temperature), self.weights)

    def average(self) -> None:
        """Replace the sequence by the weighted average of the samples."""
        add_weighted_noise(self.sampled, self.weights, self.omni, self.controls)

    def smooth(self) -> None:
        """Filter the sequence over time."""
        if len(self.controls) <= SHORTEST_FILTERED:
            return
        before = self.history[1:] if self.as_nav2 or not self.shifting else self.history[:-1]
        out = np.empty_like(self.controls)
        smooth(self.controls, np.ascontiguousarray(before), FILTERS[self.params.sgf_order], out)
        self.controls = out

    def limit(self, start: Floats) -> None:
        """Clip the sequence to the limits of speed and acceleration, and to the turning radius."""
        m = self.motion
        highest = np.array([m.vx_max, m.vy_max, m.wz_max], np.float32)
        lowest = np.array([m.vx_min, -m.vy_max, -m.wz_max], np.float32)
        radius = np.float32(self.radius)
        clip_turn(self.controls, radius)
        first, rates = self.rates(self.period), self.rates(self.params.model_dt)
        start = start.copy()
        if not self.omni:
            start[1] = 0.0
        limit(self.controls, start, highest, lowest, first, rates, self.shifting, self.as_nav2)
        clip_turn(self.controls, radius)

    def trajectory(self, pose: Pose2D) -> None:
        """Integrate the sequence itself."""
        integrate_one(
            self.controls, np.array([0.0, 0.0, pose.yaw], np.float32), np.float32(self.params.model_dt), self.optimal
        )

    # --- a cycle ----------------------------------------------------------------------------------------------------

    def optimize(self, context: TrajectoryContext, start: Floats, attempt: int) -> bool:
        """Optimize `iteration_count` times from the velocity `start`; return False if every trajectory collides."""
        pose = context.state.pose
        filtered = self.controls[self.sent]
        for iteration in range(self.params.iteration_count):
            self.pin(start)
            self.draw(attempt * self.params.iteration_count + iteration)
            self.before = self.controls.copy()
            self.roll_out(start, pose)
            self.evaluate(context)
            if self.batch.all_collided:
                return False
            self.add_control_cost()
            self.weigh()
            self.average()
            self.smooth()
            filtered = self.controls[self.sent].copy()
            self.limit(start)
        if self.as_nav2:
            self._remember(filtered)
        else:
            self.keep()
        self.trajectory(pose)
        return True

    def command(self) -> Twist2D:
        """The control that is sent now."""
        vx, vy, wz = self.controls[self.sent].tolist()
        return Twist2D(vx, vy if self.omni else 0.0, wz)

    def keep(self) -> None:
        """Keep the control that is sent within one period's acceleration of the last command, and the others within its reach.

        ROS differs: in Nav2 only the measured speed counts, so that commands jump if the robot lags.
        """
        rates = self.rates(self.period)
        kept = self.controls[self.sent : self.sent + 1].copy()
        big = np.full(3, np.inf, np.float32)
        last = np.array(self.last, np.float32)
        limit(kept, last, big, -big, rates, rates, False, False)
        if self.radius > 0.0:
            # brake no faster than the turning speed can follow the turning radius
            slowest = self.radius * (abs(float(last[2])) - float(rates[2, 0]))
            if abs(kept[0, 0]) < slowest:
                kept[0, 0] = np.copysign(np.float32(slowest), last[0])
            clip_turn(kept, np.float32(self.radius))
        if np.array_equal(kept[0], self.controls[self.sent]):
            return
        self.controls[self.sent] = kept[0]
        rates = self.rates(self.params.model_dt)
        limit(self.controls[self.sent + 1 :], kept[0], big, -big, rates, rates, False, False)
        clip_turn(self.controls[self.sent + 1 :], np.float32(self.radius))

    def finish(self, command: Twist2D) -> None:
        """Remember the command that is sent, and shift the sequence to the next cycle."""
        self.last = command
        self.sequence = self.controls.copy()
        self.delayed.append(command)
        if not self.as_nav2:
            self._remember(np.array(command, np.float32))
        if self.shifting:
            self.shift()
        self._cycle += 1

    def shift(self) -> None:
        """Move the sequence on by a step; the last control is repeated."""
        self.controls[:-1] = self.controls[1:].copy()

    def _remember(self, control: NDArray[np.float32]) -> None:
        self.history[:-1] = self.history[1:].copy()
        self.history[-1] = control


def _keys(numbers: tuple[int, ...]) -> NDArray[np.uint32]:
    """(2,) keys of 32 bits from any numbers: splitmix64 over all of them."""
    state = 0
    for number in numbers:
        state = (state ^ (number & 0xFFFFFFFFFFFFFFFF)) + _MIX & 0xFFFFFFFFFFFFFFFF
        state = (state ^ (state >> 30)) * 0xBF58476D1CE4E5B9 & 0xFFFFFFFFFFFFFFFF
        state = (state ^ (state >> 27)) * 0x94D049BB133111EB & 0xFFFFFFFFFFFFFFFF
        state ^= state >> 31
    return np.array([state & 0xFFFFFFFF, state >> 32], np.uint32)
