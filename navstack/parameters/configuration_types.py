"""The typed result of loading parameters: move_base, both costmaps with their layers, planners, recoveries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from navstack.core import Footprint
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import GlobalPlanner, Layer, LocalPlanner, RecoveryBehavior, Smoother
from navstack.parameters.findings import Finding, Location
from navstack.parameters.localization_sections import LocalizationConfiguration
from navstack.parameters.models.costmap import CostmapParams
from navstack.parameters.models.motion import MotionParams
from navstack.parameters.models.move_base import MoveBaseParams
from navstack.parameters.models.sim import SimParams
from navstack.parameters.safety_sections import SafetyConfiguration
from navstack.parameters.tree import Space
from navstack.plugins import PluginChoice


class NavstackParams(ParamModel):
    """The `navstack:` section, which ROS does not read."""

    ros_distro: Literal["noetic", "indigo"] = param(
        "noetic",
        "scoring scale that the planners' weights were tuned for: noetic, or indigo for weights from before 2018",
    )
    goal_time_limit: float = param(
        0.0,
        "time limit of a goal, counted from its acceptance; 0 = none, as in ROS",
        unit="s",
        ge=0.0,
    )
    stall_timeout: float = param(
        2.0,
        "maximum time that the robot may stand still although it is commanded to move, beyond the time to reach the commanded "
        "velocity (at most 1 s); then the cycle counts as without a valid command. 0 = no check, as in ROS",
        unit="s",
        ge=0.0,
    )
    lost_action: Literal["recover", "stop", "ignore"] = param(
        "recover",
        "what a robot does that is lost: recover: it stops and runs the recovery behaviors, then waits; stop: it stops and "
        "waits; ignore: it drives on, as in ROS. It matters only for a robot that supervises its localization",
    )
    lost_timeout: float = param(
        60.0, "maximum time that a goal waits for a robot that is lost; then the goal is aborted", unit="s", gt=0.0
    )
    sim: SimParams = param(SimParams(), "the simulated robot")
    motion: MotionParams = param(MotionParams(), "motions and teleop")


@dataclass(frozen=True, slots=True)
class CostmapConfiguration:
    """Parameters of a costmap and its layers."""

    params: CostmapParams
    footprint: Footprint
    """With the padding."""
    true_footprint: Footprint
    """Without the padding: used for collisions."""
    layers: tuple[PluginChoice[Layer], ...]
    """In the order in which they write."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """All parameters of a robot."""

    move_base: MoveBaseParams
    global_costmap: CostmapConfiguration
    local_costmap: CostmapConfiguration
    global_planner: PluginChoice[GlobalPlanner]
    local_planner: PluginChoice[LocalPlanner]
    recoveries: tuple[PluginChoice[RecoveryBehavior], ...]
    navstack: NavstackParams
    findings: tuple[Finding, ...]
    """Warnings and infos, sorted by file and line."""
    tree: Space = field(repr=False, compare=False)
    """All parameters as loaded."""
    origins: Mapping[str, Location] = field(repr=False, compare=False)
    """Full name of a parameter (`DWAPlannerROS/max_vel_x`) -> location of its value; defaults are absent."""
    smoother: PluginChoice[Smoother] | None = None
    """Smoother of the plans; None without one."""
    safety: SafetyConfiguration = SafetyConfiguration()
    """Multiplexer, velocity smoother and collision monitor."""
    localization: LocalizationConfiguration = LocalizationConfiguration()
    """amcl and the odometry filter."""

    @property
    def turning_radius(self) -> float:
        """Radius (m) of the tightest circle of base and local planner; 0 if the robot turns in place."""
        return max(self.navstack.sim.turning_radius, float(getattr(self.local_planner.params, "turning_radius", 0.0)))
