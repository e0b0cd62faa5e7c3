"""The dynamic window approach of ROS 1: dwa_local_planner/DWAPlannerROS.

D. Fox, W. Burgard, S. Thrun, "The Dynamic Window Approach to Collision Avoidance", 1997; as in
dwa_local_planner/src/dwa_planner.cpp and dwa_planner_ros.cpp. Samples velocities that are reachable within one control
period, simulates each for `sim_time`, and selects the one with the lowest total of its critics. Its horizon is `sim_time`:
beyond it, it relies on the global plan.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D
from navstack.core.parameters import ParamModel
from navstack.interfaces import Critic, LocalPlan, Rollouts, ScoringContext, VelocityLimits
from navstack.local_planner.critics.obstacle import ObstacleCritic, ObstacleParams
from navstack.local_planner.dwa.default_critics import DEFAULT_CRITICS
from navstack.local_planner.dwa.fused_scoring import FusedScorer
from navstack.local_planner.dwa.generator import DWAGenerator
from navstack.local_planner.dwa.params import DWAParams
from navstack.local_planner.goal_checker import LatchingGoalChecker
from navstack.local_planner.overlap import Overlap
from navstack.local_planner.sampling_planner import SamplingPlanner, control_period
from navstack.local_planner.scoring import ScoreTable, score
from navstack.plugins import CRITICS, LOCAL_PLANNERS


def make_critics(params: DWAParams) -> list[Critic]:
    """The critics of a planner.

    A critic's parameters come from its own namespace, then from those of the planner's parameters of the same name that were
    set, then from its defaults.
    """
    wanted = (
        [(entry.name, entry.type) for entry in params.critics]
        if params.critics is not None
        else [(name, name) for name in DEFAULT_CRITICS]
    )
    made: list[Critic] = []
    for name, kind in wanted:
        cls = CRITICS.get(kind).cls
        values: dict[str, Any] = {
            n: getattr(params, n) for n in cls.Params.model_fields if n in params.model_fields_set
        }
        own = params.critic_params.get(name)
        if own is not None:
            values.update({n: getattr(own, n) for n in own.model_fields_set if n != "ros_distro"})
        made.append(cls(name, cls.Params(**values)))
    return made


@LOCAL_PLANNERS.register("dwa", aliases=("dwa_local_planner/DWAPlannerROS",))
class DWAPlanner(SamplingPlanner):
    """Follows a plan by the dynamic window approach; stops and turns at the goal.

    State between cycles: the plan, the goal checker, the phase at the goal, the state of the critics.
    """

    Params: ClassVar[type[ParamModel]] = DWAParams
    params: DWAParams
    leaves_obstacles = True
    """ROS differs: if every sample is rejected, leave the lethal cells under the footprint (`Overlap`)."""

    def __init__(self, params: DWAParams) -> None:
        p = params
        critics = make_critics(p)
        # commands at the goal are checked for collisions even if the list of critics has no obstacle critic
        obstacle = next((c for c in critics if isinstance(c, ObstacleCritic)), None) or ObstacleCritic(
            "obstacle", ObstacleParams(scaling_speed=p.scaling_speed, max_scaling_factor=p.max_scaling_factor)
        )
        checker = LatchingGoalChecker(
            p.xy_goal_tolerance,
            p.yaw_goal_tolerance,
            p.trans_stopped_vel,
            p.theta_stopped_vel,
            latch=p.latch_xy_goal_tolerance,
        )
        self.generator: DWAGenerator
        super().__init__(p, critics, obstacle, checker, DWAGenerator(p, control_period(p.controller_frequency)))
        self._fused = FusedScorer.of(critics)

    def lowered_limits(self, max_vel_trans: float | None, max_vel_theta: float | None) -> VelocityLimits:
        """The limits of the parameters, lowered to these speeds.

        A lowered limit caps each axis, too: a robot that is faster gets the limit itself instead of no legal sample.
        """
        p = self.params
        trans = p.max_vel_trans if max_vel_trans is None else min(p.max_vel_trans, max_vel_trans)
        theta = p.max_vel_theta if max_vel_theta is None else min(p.max_vel_theta, max_vel_theta)
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
            # LocalPlannerLimits::getAccLimits returns a Vector3f
            acc_lim_x=float(np.float32(p.acc_lim_x)),
            acc_lim_y=float(np.float32(p.acc_lim_y)),
            acc_lim_theta=float(np.float32(p.acc_lim_theta)),
            yaw_goal_tolerance=p.yaw_goal_tolerance,
        )

    def search(
        self,
        state: RobotState,
        costmap: Costmap,
        footprint: Footprint,
        plan: NDArray[np.float64],
        goal: Pose2D,
    ) -> LocalPlan:
        """Select the best sample for following `plan` (n, 3), all in the costmap's frame (DWAPlanner::findBestPath)."""
        context = self.context(state, costmap, footprint, plan, goal)
        window = self.generator.window(state, plan, self._limits)
        samples, rollouts, table = self._scored(window, context)
        if table.best < 0 and self.generator.widen_rotation(window, state, self._limits):
            context = self.context(state, costmap, footprint, plan, goal)
            samples, rollouts, table = self._scored(window, context)
        overlap = None
        if table.best < 0 and self.leaves_obstacles and self._collision_check in self.critics:
            overlap = Overlap.at(context)
        if overlap is not None:
            samples, rollouts, table = self._scored(window, overlap.relaxed())
            table = self._without_nearer(overlap, rollouts, table)
        command = Twist2D(*rollouts.commands[table.best].tolist()) if table.best >= 0 else Twist2D()
        mode = "follow" if overlap is None or table.best < 0 else "escape"
        return self.result(command, samples.copy(), table, rollouts, context, mode)

    def _without_nearer(self, overlap: Overlap, rollouts: Rollouts, table: ScoreTable) -> ScoreTable:
        """`table`, scored with `overlap.relaxed()`, without the rollouts that come nearer to the overlapped cells."""
        self.finish_scoring()
        check = self._collision_check
        table = overlap.select(rollouts, table, self.critics.index(check), check.first_collision)
        check.set_result(overlap.context, rollouts, check.scale, check.first_collision)
        if table.best >= 0:
            overlap.context.notes.append(overlap.note)
        return table

    def finish_scoring(self) -> None:
        """Hand the results of fused scoring to the critics."""
        if self._fused is not None:
            self._fused.publish()

    def _scored(
        self, window: NDArray[np.float64], context: ScoringContext
    ) -> tuple[NDArray[np.float64], Rollouts, ScoreTable]:
        samples = self.generator.lattice(window)
        rollouts = self.generator.simulate(samples, context.state, self._limits)
        scored = score(self.critics, context, rollouts) if self._fused is None else self._fused.score(context, rollouts)
        return samples, rollouts, scored
