"""MPPI: nav2_mppi_controller::MPPIController.

G. Williams et al., "Information-Theoretic Model Predictive Control: Theory and Applications to Autonomous Driving", 2018; stages
and critics as in nav2_mppi_controller. In each cycle a batch of control sequences is sampled around the current one and rolled
out within the acceleration limits; critics score the trajectories; the next sequence is the average of the samples, weighted by
exp(-cost / temperature).
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from navstack.core import NoValidControlError, ParameterError, Path, Twist2D
from navstack.local_planner.mppi.batch import Floats, TrajectoryContext
from navstack.local_planner.mppi.collisions import CHECK, COLLISION, EVERYWHERE, FREE, CollisionTest
from navstack.local_planner.mppi.diagnostics import all_collide, diagnose
from navstack.local_planner.mppi.optimizer import Optimizer
from navstack.local_planner.mppi.params import MPPIParams, TrajectoryValidatorParams
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic
from navstack.local_planner.path_follower import Following, PathFollower, check_speed
from navstack.plugins import CRITICS, LOCAL_PLANNERS, ControlDiagnostics, LocalPlan, ParamModel, VelocityLimits


def make_critics(params: MPPIParams) -> list[TrajectoryCritic]:
    """The critics of a controller, with the parameters of their namespaces."""
    made: list[TrajectoryCritic] = []
    for name, kind in params.listed_critics:
        cls = CRITICS.get(kind).cls
        if not issubclass(cls, TrajectoryCritic):
            raise ParameterError(
                f'"{kind}" is a critic of DWA, which cannot score the trajectories of MPPI; use one of: '
                + ", ".join(entry.name for entry in CRITICS if issubclass(entry.cls, TrajectoryCritic)),
                critic=name,
            )
        made.append(cls(name, params.sections.get(name) or cls.Params()))
    return made


@LOCAL_PLANNERS.register("mppi", aliases=("nav2_mppi_controller/MPPIController",))
class MPPIPlanner(PathFollower):
    """Follows a path by model predictive path integral control.

    State between cycles: the plan, the goal checker, the control sequence, the last commands, the counter of the noise.
    """

    Params: ClassVar[type[ParamModel]] = MPPIParams
    params: Any

    def __init__(self, params: MPPIParams) -> None:
        text = params.too_slow()
        if text is not None:
            raise ParameterError(text, model_dt=params.model_dt, controller_frequency=params.controller_frequency)
        super().__init__(params)
        self.optimizer = Optimizer(params, make_critics(params))
        self._motion = self.optimizer.motion
        self._limits = self._stated()
        self._context: TrajectoryContext | None = None
        self._plan: LocalPlan | None = None

    # --- limits -----------------------------------------------------------------------------------------------------

    @property
    def limits(self) -> VelocityLimits:
        """The limits in force."""
        return self._limits

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lower the speed limits (m/s, rad/s) until the next call; None restores the parameter's value."""
        check_speed(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta)
        m = self._motion
        fastest = math.hypot(max(m.vx_max, -m.vx_min), m.vy_max)
        scale = 1.0 if max_vel_trans is None or fastest <= max_vel_trans else max_vel_trans / fastest
        turning = m.wz_max if max_vel_theta is None else min(m.wz_max, max_vel_theta)
        self.optimizer.motion = m._replace(
            vx_max=m.vx_max * scale, vx_min=m.vx_min * scale, vy_max=m.vy_max * scale, wz_max=turning
        )
        self._limits = self._stated()

    def _stated(self) -> VelocityLimits:
        m, p = self.optimizer.motion, self.params
        return VelocityLimits(
            max_vel_x=m.vx_max,
            min_vel_x=m.vx_min,
            max_vel_y=m.vy_max,
            min_vel_y=-m.vy_max,
            max_vel_trans=math.hypot(max(m.vx_max, -m.vx_min), m.vy_max),
            min_vel_trans=0.0,
            max_vel_theta=m.wz_max,
            min_vel_theta=0.0,
            acc_lim_x=min(p.ax_max, -p.ax_min),
            acc_lim_y=min(p.ay_max, -p.ay_min) if m.omni else 0.0,
            acc_lim_theta=p.az_max,
            yaw_goal_tolerance=self.goal_checker.yaw_tolerance,
            min_turning_radius=self.optimizer.radius,
        )

    # --- the command ------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Reset the previous goal and the control sequence."""
        super().reset()
        self.optimizer.reset()

    def arrived(self) -> None:
        """Start the next goal from rest."""
        self.optimizer.reset()
        self._plan = None

    def follow(self, now: Following) -> LocalPlan:
        """Optimize, validate, and try again if that fails.

        Raises NoValidControlError if every trajectory of every attempt collides.
        """
        optimizer, p = self.optimizer, self.params
        context = self.context(now)
        start = optimizer.begin(now.state.velocity)
        problem, notes = "", list[str]()
        for attempt in range(p.retry_attempt_limit + 1):
            problem = self._attempt(context, start, attempt)
            if not problem:
                break
            notes.append(f"attempt {attempt + 1} of {p.retry_attempt_limit + 1}: {problem}")
            if attempt < p.retry_attempt_limit:
                optimizer.retry()
                start = optimizer.begin(now.state.velocity)
        local = Path(now.path.poses, now.costmap.frame)
        self._context = context
        if problem:
            self._plan = LocalPlan(Twist2D(), local_plan=local, notes=tuple(notes))
            text, data = all_collide(optimizer, context, problem)
            optimizer.reset()
            raise NoValidControlError(text, **data, attempts=len(notes), plan=self._plan)
        command = optimizer.command()
        trajectory = optimizer.optimal.astype(np.float64)
        trajectory[:, :2] += optimizer.batch.anchor
        self._plan = LocalPlan(command, trajectory=trajectory, local_plan=local, notes=tuple(notes))
        optimizer.finish(command)
        return self._plan

    def _attempt(self, context: TrajectoryContext, start: Floats, attempt: int) -> str:
        """Optimize once; return what failed, empty if nothing did."""
        optimizer = self.optimizer
        if not optimizer.optimize(context, start, attempt):
            return "every trajectory collides"
        if not np.isfinite(optimizer.controls).all():
            return "the controls are not finite"
        if not is_safe(context, optimizer.optimal, self.params.validator, self.params.model_dt):
            return "the chosen trajectory collides"
        return ""

    def context(self, now: Following) -> TrajectoryContext:
        """Input of the critics.

        ROS differs: unless the path is cut at a cusp, lengths and the goal are those of the whole plan, not of the local path,
        which is short where the local costmap is small.
        """
        path, optimizer = now.path, self.optimizer
        local = path.ends_at_cusp or optimizer.as_nav2
        last = path.poses[-1].tolist()
        return TrajectoryContext(
            now.state,
            now.costmap,
            now.footprint,
            path.poses,
            now.goal,
            self._limits,
            length=path.length if local else path.remaining_m,
            target=type(now.goal)(*last) if local else now.goal,
            motion=optimizer.motion,
            inflation=now.inflation,
            track_unknown_space=now.track_unknown_space,
            xy_tolerance=self.goal_checker.xy_tolerance,
            exact=not optimizer.as_nav2,
        )

    def diagnostics(self) -> ControlDiagnostics | None:
        """All samples of the last cycle, then the chosen sequence, with the scores of the critics; None before the first."""
        if self._context is None or self._plan is None:
            return None
        return diagnose(self.optimizer, self._context, self._plan)


def is_safe(context: TrajectoryContext, optimal: Floats, validator: TrajectoryValidatorParams, dt: float) -> bool:
    """True if the beginning of the trajectory `optimal` (T, 3), relative to the robot, is free of collisions."""
    ahead = min(len(optimal), math.floor(validator.collision_lookahead_time / dt + 1e-9))
    if ahead == 0:
        return True
    meaning = np.full(256, FREE, np.uint8)
    if validator.consider_footprint or (context.exact and context.inflation is None):
        meaning[:] = CHECK
    else:
        meaning[253:255] = COLLISION
    test = CollisionTest(context, meaning, np.ascontiguousarray(context.footprint.vertices.T), EVERYWHERE)
    points = np.ascontiguousarray(optimal[:ahead].T[:, :, None])
    return test.is_free(points)
