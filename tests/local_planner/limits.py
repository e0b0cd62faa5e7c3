"""Does a controller ever exceed a limit? Random scenes: paths, obstacles, jumps of the plan, goals near and far.

`excess` measures commands against `Limits`; `search_excess` drives a controller through many cycles and keeps the worst.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from navstack.core import (
    ControlError,
    Costmap,
    Footprint,
    GridGeometry,
    Path,
    Pose2D,
    RobotState,
    Twist2D,
    normalize_angle,
)
from navstack.local_planner import (
    DWBParams,
    DWBPlanner,
    RegulatedPurePursuit,
    RegulatedPurePursuitParams,
    RotationShim,
    RotationShimParams,
)
from navstack.local_planner.graceful import GracefulController, GracefulParams
from navstack.local_planner.mppi import MPPIParams, MPPIPlanner
from navstack.local_planner.mppi.params import ACKERMANN, DIFF, OMNI, MotionModelParams
from navstack.plugins import LOCAL_PLANNERS, ControlInput, Inflation, LocalPlanner

PERIOD_S: Final = 0.05
_RESET: Final = 50
"""Cycles between two scenes."""
_CELLS: Final = 80
_RESOLUTION: Final = 0.05
_HALF: Final = 0.5 * _CELLS * _RESOLUTION


@dataclass(frozen=True, slots=True)
class Limits:
    """What a controller must keep to; infinity: it does not limit this."""

    min_x: float
    max_x: float
    max_theta: float
    max_y: float = 0.0
    faster_x: float = math.inf
    """Acceleration (m/s²) away from zero."""
    slower_x: float = math.inf
    """Deceleration (m/s²) towards zero."""
    faster_y: float = math.inf
    slower_y: float = math.inf
    theta: float = math.inf
    """Turning acceleration (rad/s²)."""
    radius: float = 0.0
    """Turning radius (m)."""
    larger_from_rest: bool = False
    """True if, as in Nav2's MPPI, the larger of acceleration and deceleration counts from rest."""


@dataclass(slots=True)
class Excess:
    """The largest excess over each limit (m/s, rad/s); at most 0 where all is kept."""

    by_limit: dict[str, float] = field(default_factory=dict[str, float])
    cycles: int = 0
    """Commands that were checked."""
    refused: int = 0
    """Cycles without a command, after which the robot is stopped."""

    @property
    def worst(self) -> float:
        """The largest of them."""
        return max(self.by_limit.values(), default=-math.inf)

    def add(self, found: Mapping[str, float]) -> None:
        """Keeps what is larger."""
        for name, value in found.items():
            if not value <= self.by_limit.get(name, -math.inf):
                self.by_limit[name] = value
        self.cycles += 1


def excess(limits: Limits, last: Twist2D, command: Twist2D, period: float = PERIOD_S) -> dict[str, float]:
    """How much a command exceeds each limit after the last one (m/s, rad/s); negative within them."""
    found = {
        "vx": max(command.vx - limits.max_x, limits.min_x - command.vx),
        "vy": abs(command.vy) - limits.max_y,
        "wz": abs(command.wz) - limits.max_theta,
        "ax": _change(last.vx, command.vx, limits.faster_x * period, limits.slower_x * period, limits),
        "ay": _change(last.vy, command.vy, limits.faster_y * period, limits.slower_y * period, limits),
        "az": abs(command.wz - last.wz) - limits.theta * period,
    }
    if limits.radius > 0.0:
        found["radius"] = abs(command.wz) * limits.radius - abs(command.vx)
    return found


def _change(before: float, now: float, faster: float, slower: float, limits: Limits) -> float:
    """How much the change of a velocity exceeds what is allowed; through zero the larger of both counts."""
    if before == 0.0 and not limits.larger_from_rest:
        allowed = faster
    elif before * now < 0.0 or before == 0.0:
        allowed = max(faster, slower)
    else:
        allowed = slower if abs(now) < abs(before) else faster
    return abs(now - before) - allowed


class RandomScenes:
    """A robot in a window of random costs on its way along random paths."""

    def __init__(self, seed: int, *, lag: bool, smooth: bool) -> None:
        """`lag`: the robot follows commands late, differently in each cycle. `smooth`: paths are arcs without corners."""
        self._rng = np.random.default_rng(seed)
        self._lag, self._smooth = lag, smooth
        self.pose = Pose2D(0.0, 0.0)
        self.velocity = Twist2D()
        geometry = GridGeometry(_CELLS, _CELLS, _RESOLUTION, -_HALF, -_HALF)
        self._costmap = Costmap(geometry, np.zeros((_CELLS, _CELLS), np.uint8), "odom")
        self._footprint = Footprint(np.array([[0.22, 0.15], [0.22, -0.15], [-0.22, -0.15], [-0.22, 0.15]]))

    def begin(self, planner: LocalPlanner) -> None:
        """A new scene: pose, obstacles, path and goal. The velocity stays as it is."""
        rng = self._rng
        self.pose = Pose2D(0.0, 0.0, float(rng.uniform(-math.pi, math.pi)))
        data = self._costmap.data
        data[:] = np.where(rng.random(data.shape) < 0.002, 100, rng.integers(0, 60))
        data[:] = np.where(rng.random(data.shape) < 0.0005 * rng.integers(0, 2), 254, data)
        self.replan(planner)

    def replan(self, planner: LocalPlanner) -> None:
        """A new path from near the robot."""
        rng = self._rng
        n = int(rng.integers(4, 60))
        first = (
            float(rng.uniform(-math.pi, math.pi)) if rng.random() < 0.3 else self.pose.yaw + float(rng.normal(0, 0.4))
        )
        bends = np.full(n, rng.normal(0.0, 0.04)) if self._smooth else rng.normal(0.0, 0.15, n)
        yaws = first + np.cumsum(bends)
        if rng.random() < 0.15:
            yaws[n // 2 :] += math.pi  # a cusp
        steps = np.column_stack((np.cos(yaws), np.sin(yaws))) * _RESOLUTION
        xy = np.array(self.pose[:2]) + rng.normal(0.0, 0.05, 2) + np.cumsum(steps, axis=0)
        xy = np.clip(xy, -_HALF + 0.1, _HALF - 0.1)
        poses = np.column_stack((xy, [normalize_angle(yaw) for yaw in yaws.tolist()]))
        poses[-1, 2] = rng.uniform(-math.pi, math.pi)
        planner.set_plan(Path(poses, "odom"), Pose2D(*poses[-1].tolist()))

    def inputs(self) -> ControlInput:
        """What the controller is given."""
        return ControlInput(
            RobotState(self.pose, self.velocity), self._costmap, self._footprint, inflation=Inflation(0.15, 0.5, 5.0)
        )

    def drive(self, command: Twist2D) -> None:
        """Moves the robot for one period."""
        share = float(self._rng.uniform(0.3, 1.0)) if self._lag else 1.0
        v = self.velocity
        self.velocity = Twist2D(*(a + share * (b - a) for a, b in zip(v, command, strict=True)))
        yaw = self.pose.yaw + 0.5 * PERIOD_S * self.velocity.wz
        c, s = math.cos(yaw), math.sin(yaw)
        x = self.pose.x + PERIOD_S * (self.velocity.vx * c - self.velocity.vy * s)
        y = self.pose.y + PERIOD_S * (self.velocity.vx * s + self.velocity.vy * c)
        self.pose = Pose2D(x, y, normalize_angle(self.pose.yaw + PERIOD_S * self.velocity.wz))

    @property
    def is_left(self) -> bool:
        """True near the border of the window."""
        return max(abs(self.pose.x), abs(self.pose.y)) > _HALF - 0.3


@dataclass(frozen=True, slots=True)
class LimitCase:
    """A controller and the limits it must keep to."""

    make: Callable[[], LocalPlanner]
    limits: Limits
    lag: bool = False
    """True if the accelerations hold from command to command, however the robot follows."""
    smooth: bool = False
    tolerance: float = 1e-9
    """Rounding (m/s, rad/s)."""


def search_excess(case: LimitCase, cycles: int, seed: int = 0) -> Excess:
    """Drives a controller through random scenes for a number of cycles."""
    rng = np.random.default_rng([seed, 1])
    scenes, planner, out = RandomScenes(seed, lag=case.lag, smooth=case.smooth), case.make(), Excess()
    last = Twist2D()
    for cycle in range(cycles):
        if cycle % _RESET == 0 or scenes.is_left:
            scenes.begin(planner)
        elif rng.random() < 0.05:
            scenes.replan(planner)
        try:
            plan = planner.compute_command(scenes.inputs())
        except ControlError:
            # move_base stops the robot
            scenes.velocity = last = Twist2D()
            out.refused += 1
            continue
        if plan.mode == "arrived":
            scenes.velocity = last = Twist2D()
            scenes.begin(planner)
            continue
        out.add(excess(case.limits, last, plan.command))
        scenes.drive(plan.command)
        last = plan.command
    return out


# --- the controllers --------------------------------------------------------------------------------------------------


def _dwa() -> LocalPlanner:
    cls = LOCAL_PLANNERS.get("dwa").cls
    values: dict[str, Any] = {"max_vel_x": 0.5, "min_vel_x": -0.2, "max_vel_trans": 0.5, "max_vel_theta": 1.5}
    values |= {
        "max_vel_y": 0.0,
        "min_vel_y": 0.0,
        "acc_lim_x": 1.5,
        "acc_lim_theta": 3.0,
        "sim_time": 1.0,
        "vy_samples": 1,
    }
    return cls(cls.Params(**{**values, "min_vel_trans": 0.0, "min_vel_theta": 0.0}))


def _rollout(*, sideways: bool) -> LocalPlanner:
    cls = LOCAL_PLANNERS.get("trajectory_rollout").cls
    values: dict[str, Any] = {"holonomic_robot": sideways, "y_vels": [-0.3, -0.1, 0.1, 0.3]}
    values |= {"max_vel_x": 0.5, "min_vel_x": 0.1, "max_vel_theta": 1.2, "min_vel_theta": -1.2, "escape_vel": -0.1}
    return cls(cls.Params(**values))


def _dwb(**values: Any) -> LocalPlanner:
    limits: dict[str, Any] = {"min_vel_x": -0.2, "max_vel_x": 0.5, "max_speed_xy": 0.5, "max_vel_theta": 1.5}
    limits |= {"acc_lim_x": 1.2, "decel_lim_x": -1.8, "acc_lim_theta": 2.6, "decel_lim_theta": -2.6}
    return DWBPlanner(DWBParams(**{**limits, "vx_samples": 7, "vtheta_samples": 9, **values}))


_PURSUIT: Final[dict[str, Any]] = {
    "max_linear_vel": 0.6,
    "use_dynamic_window": True,
    "max_linear_accel": 1.2,
    "max_linear_decel": -1.8,
    "max_angular_vel": 1.6,
    "min_angular_vel": -1.4,
    "max_angular_accel": 2.6,
    "max_angular_decel": -2.6,
    "rotate_to_heading_angular_vel": 1.3,
    "min_linear_vel": -0.6,
}
_WINDOW: Final = Limits(0.0, 0.6, 1.6, faster_x=1.2, slower_x=1.8, theta=2.6)


def _pursuit(**values: Any) -> LocalPlanner:
    return RegulatedPurePursuit(RegulatedPurePursuitParams(**{**_PURSUIT, **values}))


def _car() -> LocalPlanner:
    return _pursuit(min_turning_r=0.6, use_rotate_to_heading=False, allow_reversing=True, enforce_path_inversion=True)


def _shim(primary: Any, **values: Any) -> LocalPlanner:
    params = RotationShimParams(
        rotate_to_heading_angular_vel=1.3,
        max_angular_accel=2.6,
        rotate_to_goal_heading=True,
        sections={"primary_controller": primary},
        **values,
    )
    return RotationShim(params)


def _shim_of_pursuit() -> LocalPlanner:
    values: dict[str, Any] = {**_PURSUIT, "use_rotate_to_heading": False}
    own = RegulatedPurePursuitParams(**values)
    return _shim(own, closed_loop=False)


def _graceful() -> LocalPlanner:
    values: dict[str, Any] = {"deceleration_max": 1.8, "max_linear_accel": 1.2, "max_angular_accel": 2.6}
    return GracefulController(GracefulParams(v_linear_max=0.6, v_angular_max=1.2, **values))


def _mppi(plugin: str, radius: float = 0.2) -> Callable[[], LocalPlanner]:
    def make() -> LocalPlanner:
        sections = {"base": MotionModelParams(plugin=plugin, min_turning_r=radius)}
        params = MPPIParams(
            batch_size=64,
            motion_model="base",
            sections=sections,
            ax_max=2.0,
            ax_min=-2.5,
            ay_min=-2.0,
            vy_max=0.3,
            regenerate_noises=True,
        )
        return MPPIPlanner(params)

    return make


_SAMPLED: Final = Limits(-0.35, 0.5, 1.9, faster_x=2.0, slower_x=2.5, theta=3.5, larger_from_rest=True)
_FLOAT32: Final = 1e-5
_ONE_VALUE: Final = 1.1e-5
"""DWB samples speeds up to 1e-5 beyond the highest one, as Nav2 does."""

LIMIT_CASES: Final[Mapping[str, LimitCase]] = {
    "dwa": LimitCase(_dwa, Limits(-0.2, 0.5, 1.5), tolerance=_FLOAT32),
    "trajectory_rollout": LimitCase(lambda: _rollout(sideways=False), Limits(-0.1, 0.5, 1.2), tolerance=_FLOAT32),
    "trajectory_rollout, holonomic": LimitCase(
        lambda: _rollout(sideways=True), Limits(-0.1, 0.5, 1.2, max_y=0.3), tolerance=_FLOAT32
    ),
    "dwb": LimitCase(_dwb, Limits(-0.2, 0.5, 1.5), tolerance=_ONE_VALUE),
    "dwb, limited acceleration": LimitCase(
        # backward, the deceleration is what speeds the robot up, as in Nav2
        lambda: _dwb(trajectory_generator_name="dwb_plugins::LimitedAccelGenerator", min_vel_x=0.0),
        Limits(0.0, 0.5, 1.5, faster_x=1.2, slower_x=1.8, theta=2.6),
        tolerance=_ONE_VALUE,
    ),
    "dwb, omni": LimitCase(
        lambda: _dwb(min_vel_y=-0.3, max_vel_y=0.3, acc_lim_y=1.0, decel_lim_y=-1.0, vy_samples=3),
        Limits(-0.2, 0.5, 1.5, max_y=0.3),
        tolerance=_ONE_VALUE,
    ),
    "pure_pursuit": LimitCase(_pursuit, _WINDOW, lag=True),
    "pure_pursuit, car": LimitCase(
        _car, Limits(-0.6, 0.6, 1.6, faster_x=1.2, slower_x=1.8, theta=2.6, radius=0.6), lag=True
    ),
    "pure_pursuit, no window": LimitCase(lambda: _pursuit(use_dynamic_window=False), Limits(0.0, 0.6, 1.6), lag=True),
    "rotation_shim": LimitCase(_shim_of_pursuit, _WINDOW, lag=True),
    "graceful": LimitCase(_graceful, Limits(0.0, 0.6, 1.2, faster_x=1.2, slower_x=1.8, theta=2.6), lag=True),
    "mppi, diff": LimitCase(_mppi(DIFF), _SAMPLED, lag=True, tolerance=_FLOAT32),
    "mppi, omni": LimitCase(
        _mppi(OMNI),
        Limits(
            -0.35,
            0.5,
            1.9,
            max_y=0.3,
            faster_x=2.0,
            slower_x=2.5,
            faster_y=3.0,
            slower_y=2.0,
            theta=3.5,
            larger_from_rest=True,
        ),
        lag=True,
        tolerance=_FLOAT32,
    ),
    "mppi, ackermann": LimitCase(
        _mppi(ACKERMANN, 0.6),
        replace(_SAMPLED, radius=0.6),
        lag=True,
        tolerance=_FLOAT32,
    ),
}
"""The controllers and what each limits.

Trajectory rollout does not limit accelerations from command to command, pure pursuit does with `use_dynamic_window` only, and
DWA as in C++ not while it turns at the goal: the velocity smoother does. A cycle without a command stops the robot at once.
"""
