"""The dynamic window approach of ROS 1: dwa_local_planner/DWAPlannerROS.

D. Fox, W. Burgard, S. Thrun, "The Dynamic Window Approach to Collision Avoidance", 1997; as in
dwa_local_planner/src/dwa_planner.cpp and dwa_planner_ros.cpp. Samples velocities that can be reached within one control
period, simulates each for `sim_time`, and takes the one that its critics like best. Good at what it sees, blind beyond
its horizon: it trusts the global plan for everything else.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D
from navstack.core.parameters import ParamModel
from navstack.interfaces import ControlInput, Critic, LocalPlan, Rollouts, ScoringContext, VelocityLimits
from navstack.local_planner import critics as _critics
from navstack.local_planner.critics.obstacle import ObstacleCritic, ObstacleParams
from navstack.local_planner.critics.oscillation import OscillationCritic
from navstack.local_planner.dwa.fused_scoring import Scorer
from navstack.local_planner.dwa.generator import Simulator, velocity_window
from navstack.local_planner.dwa.params import DWAParams
from navstack.local_planner.goal_checker import GoalChecker
from navstack.local_planner.sampling_planner import SamplingPlanner, at_least_standing
from navstack.local_planner.scoring import ScoreTable
from navstack.plugins import CRITICS, LOCAL_PLANNERS


def make_critics(params: DWAParams) -> list[Critic]:
    """The critics of a planner; what a critic's own namespace does not say comes from the planner's parameters."""
    wanted = (
        [(entry.name, entry.type) for entry in params.critics]
        if params.critics is not None
        else [(name, name) for name in _critics.DEFAULT_CRITICS]
    )
    made: list[Critic] = []
    for name, kind in wanted:
        cls = CRITICS.get(kind).cls
        own = params.critic_params.get(name)
        values = {n: getattr(params, n) for n in cls.Params.model_fields if n in DWAParams.model_fields}
        if own is not None:
            values.update({n: getattr(own, n) for n in own.model_fields_set if n != "ros_distro"})
        made.append(cls(name, cls.Params(**values)))
    return made


@LOCAL_PLANNERS.register("dwa", aliases=("dwa_local_planner/DWAPlannerROS",))
class DWAPlanner(SamplingPlanner):
    """Follows a plan by the dynamic window approach; stops and turns at the goal.

    Stateful between cycles: the plan, whether the goal's position has been reached, the oscillation flags.
    """

    Params: ClassVar[type[ParamModel]] = DWAParams
    params: DWAParams

    def __init__(self, params: DWAParams) -> None:
        p = params
        critics = make_critics(p)
        # commands near the goal are checked against obstacles even where a list of critics leaves them out
        own = next((c for c in critics if isinstance(c, ObstacleCritic)), None)
        super().__init__(
            p,
            critics,
            own
            or ObstacleCritic(
                "obstacle", ObstacleParams(scaling_speed=p.scaling_speed, max_scaling_factor=p.max_scaling_factor)
            ),
            GoalChecker(p.xy_goal_tolerance, p.yaw_goal_tolerance, p.trans_stopped_vel, p.theta_stopped_vel),
            latch=p.latch_xy_goal_tolerance,
            prune=p.prune_plan,
            controller_frequency=p.controller_frequency,
        )
        self.set_limits()
        self._simulator = Simulator(
            (p.vx_samples, p.vy_samples, p.vth_samples),
            p.sim_time,
            p.sim_granularity,
            p.angular_sim_granularity,
            accelerate=not p.use_dwa,
        )
        self._scorer = Scorer(critics)
        self._oscillation = [c for c in critics if isinstance(c, OscillationCritic)]

    # --- limits -----------------------------------------------------------------------------------------------------

    def limits_of(self, max_vel_trans: float | None, max_vel_theta: float | None) -> VelocityLimits:
        p = self.params
        trans = p.max_vel_trans if max_vel_trans is None else min(p.max_vel_trans, max_vel_trans)
        theta = p.max_vel_theta if max_vel_theta is None else min(p.max_vel_theta, max_vel_theta)
        # a lowered limit caps each axis too: a robot that is faster gets the limit itself instead of nothing legal
        along = p.max_vel_x if max_vel_trans is None else min(p.max_vel_x, trans)
        return VelocityLimits(
            max_vel_x=along,
            min_vel_x=min(p.min_vel_x, along) if max_vel_trans is not None else p.min_vel_x,
            max_vel_y=p.max_vel_y,
            min_vel_y=p.min_vel_y,
            max_vel_trans=trans,
            min_vel_trans=p.min_vel_trans if max_vel_trans is None else min(p.min_vel_trans, trans),
            max_vel_theta=theta,
            min_vel_theta=p.min_vel_theta if max_vel_theta is None else min(p.min_vel_theta, theta),
            acc_lim_x=p.acc_lim_x,
            acc_lim_y=p.acc_lim_y,
            acc_lim_theta=p.acc_lim_theta,
            yaw_goal_tolerance=p.yaw_goal_tolerance,
            xy_goal_tolerance=p.xy_goal_tolerance,
        )

    # --- the state of the flags -------------------------------------------------------------------------------------

    def plan_changed(self, *, same_goal: bool) -> None:
        """As in C++, every plan allows every direction again."""
        del same_goal
        self._reset_oscillation()

    def command_checked(self) -> None:
        """As in C++, so does a command at the goal."""
        self._scorer.tell()
        self._reset_oscillation()

    def _reset_oscillation(self) -> None:
        for critic in self._oscillation:
            critic.reset()

    def goal_reached(self, inputs: ControlInput) -> bool:
        """Position (or latched), heading and stopped."""
        if self._goal is None:
            return False
        goal = inputs.plan_to_costmap.apply(self._goal)
        pose = inputs.state.pose
        return (
            self.at_position(pose, goal)
            and self.checker.at_heading(pose, goal)
            and self.checker.stopped(inputs.state.velocity)
        )

    # --- the command ------------------------------------------------------------------------------------------------

    def search(
        self,
        state: RobotState,
        costmap: Costmap,
        footprint: Footprint,
        plan: NDArray[np.float64],
        goal: Pose2D,
    ) -> LocalPlan:
        """The best sample for following `plan` (n, 3), all in the costmap's frame (DWAPlanner::findBestPath)."""
        context = self.context(state, costmap, footprint, plan, goal)
        window = self._window(state, plan)
        samples, rollouts, table = self._scored(window, context)
        if table.best < 0 and self._turn_from_rest(window, state):
            context = self.context(state, costmap, footprint, plan, goal)
            samples, rollouts, table = self._scored(window, context)
        command = Twist2D()
        if table.best < 0:
            self._scorer.tell()
        else:
            command = Twist2D(*rollouts.samples[table.best].tolist())
            for critic in self._oscillation:
                critic.chosen(command, state.pose, self._limits.min_vel_trans)
        return self.result(command, samples.copy(), table, rollouts, context)

    def simulated(self, command: Twist2D, state: RobotState) -> Rollouts:
        """The one trajectory of a command at the goal, however slow it is."""
        free = at_least_standing(self._limits)
        return self._simulator.run(np.array([command]), state.pose, state.velocity, free)

    def explain_last(self) -> dict[str, Any]:
        """As for every follower, with the flags of `oscillation`."""
        self._scorer.tell()
        flags = self._oscillation[0].flags if self._oscillation else {}
        return {**super().explain_last(), "oscillation": flags}

    def _scored(
        self, window: NDArray[np.float64], context: ScoringContext
    ) -> tuple[NDArray[np.float64], Rollouts, ScoreTable]:
        state = context.state
        samples = self._simulator.lattice(window)
        rollouts = self._simulator.run(samples, state.pose, state.velocity, self._limits)
        return samples, rollouts, self._scorer.score(context, rollouts)

    def _window(self, state: RobotState, plan: NDArray[np.float64]) -> NDArray[np.float64]:
        limits, p = self._limits, self.params
        if not p.use_dwa:
            # without the dynamic window: no faster than would just reach the end of the plan in sight (float32 as in C++)
            apart = plan[-1, :2].astype(np.float32) - np.array(state.pose[:2], np.float32)
            distance = math.hypot(float(apart[0]), float(apart[1]))
            capped = limits._replace(
                max_vel_x=max(min(limits.max_vel_x, distance / p.sim_time), limits.min_vel_x),
                max_vel_y=max(min(limits.max_vel_y, distance / p.sim_time), limits.min_vel_y),
            )
            return velocity_window(state.velocity, capped, p.sim_time)
        window = velocity_window(state.velocity, limits, self._period)
        # ROS differs: where one period's acceleration stays below min_vel_trans, C++ has no way to start moving: all that is
        # legal is to turn in place, for ever. Here the lowest speed can be commanded from rest, as a turn at the goal can.
        lowest = limits.min_vel_trans
        if limits.acc_lim_x * self._period < lowest and state.velocity.speed < lowest:
            window[0, 0] = max(limits.min_vel_x, min(window[0, 0], -lowest))
            window[0, 1] = min(limits.max_vel_x, max(window[0, 1], lowest))
        return window

    def _turn_from_rest(self, window: NDArray[np.float64], state: RobotState) -> bool:
        """Widens `window` to min_vel_theta either way where acceleration alone does not get there; False if it does."""
        limits = self._limits
        lowest = min(limits.min_vel_theta, limits.max_vel_theta)
        if not self.params.use_dwa or abs(state.velocity.wz) + limits.acc_lim_theta * self._period >= lowest:
            return False
        # ROS differs: with acc_lim_theta / controller_frequency below min_vel_theta a robot that cannot go ahead is stuck
        window[2] = -lowest, lowest
        return True
