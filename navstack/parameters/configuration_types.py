"""The typed result of loading parameters: move_base, both costmaps with their layers, planners, recoveries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from navstack.core import Footprint
from navstack.parameters.findings import Finding, Location
from navstack.parameters.models.motion import MotionParams
from navstack.parameters.models.move_base import CostmapParams, MoveBaseParams
from navstack.parameters.models.sim import SimParams
from navstack.parameters.nodes import LocalizationConfiguration, SafetyConfiguration
from navstack.parameters.tree import COSTMAPS, Space
from navstack.plugins import (
    CostmapSetup,
    GlobalPlanner,
    Layer,
    LayerSetup,
    LocalPlanner,
    ParamModel,
    Plugin,
    RecoveryBehavior,
    Smoother,
    param,
)

if TYPE_CHECKING:  # imported when its section is written
    from navstack.parameters.models.docking import DockingParams


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
    behavior_tree: str = param(
        "",
        "behavior tree that drives the goals, as Nav2's default_nav_to_pose_bt_xml: a file, or the name of a packaged tree; "
        "without one, move_base's own states do",
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
    layers: tuple[Plugin[Layer], ...]
    """In the order in which they write."""

    def setup(self, name: str) -> CostmapSetup:
        """Return what rules know of this costmap."""
        p = self.params
        return CostmapSetup(
            name=name,
            robot_base_frame=p.robot_base_frame,
            rolling_window=p.rolling_window,
            track_unknown_space=p.track_unknown_space,
            width=p.width,
            height=p.height,
            resolution=p.resolution,
            update_frequency=p.update_frequency,
            footprint=self.footprint,
            layers=tuple(LayerSetup(layer.name, layer.cls.traits(layer.params)) for layer in self.layers),
        )


@dataclass(frozen=True, slots=True)
class Configuration:
    """All parameters of a robot."""

    move_base: MoveBaseParams
    global_costmap: CostmapConfiguration
    local_costmap: CostmapConfiguration
    global_planner: Plugin[GlobalPlanner]
    local_planner: Plugin[LocalPlanner]
    recoveries: tuple[Plugin[RecoveryBehavior], ...]
    navstack: NavstackParams
    findings: tuple[Finding, ...]
    """Warnings and infos, sorted by file and line."""
    tree: Space = field(repr=False, compare=False)
    """All parameters as loaded."""
    origins: Mapping[str, Location] = field(repr=False, compare=False)
    """Full name of a parameter (`DWAPlannerROS/max_vel_x`) -> location of its value; defaults are absent."""
    smoother: Plugin[Smoother] | None = None
    """Smoother of the plans; None without one."""
    safety: SafetyConfiguration = SafetyConfiguration()
    """Multiplexer, velocity smoother and collision monitor."""
    localization: LocalizationConfiguration = LocalizationConfiguration()
    """amcl and the odometry filter."""
    docking: DockingParams | None = None
    """The section `docking_server`; None if it is not written."""
    behaviors: tuple[Plugin[RecoveryBehavior], ...] = ()
    """Behaviors of trees besides the recoveries: those of `behavior_plugins`."""
    smoothers: tuple[Plugin[Smoother], ...] = ()
    """Smoothers of trees: those of `smoother_plugins` of the section `smoother_server`."""
    route_server: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Parameters of Nav2's route_server, and its graph; empty if the section is not written."""
    nav2_ids: Mapping[str, str] = field(default_factory=dict[str, str], repr=False, compare=False)
    """Files of Nav2: id of a plugin -> its namespace here: FollowPath -> DWBLocalPlanner."""
    nav2_distro: str = field(default="", compare=False)
    """Files of Nav2: their distribution."""

    @property
    def planner_names(self) -> tuple[str, ...]:
        """Registered names of both planners and of the smoother; the kernels that they use are compiled ahead."""
        chosen = (self.global_planner, self.local_planner, *((self.smoother,) if self.smoother else ()))
        return tuple(choice.name for choice in chosen)

    @property
    def turning_radius(self) -> float:
        """Radius (m) of the tightest circle of base and local planner; 0 if the robot turns in place."""
        return max(self.navstack.sim.turning_radius, float(getattr(self.local_planner.params, "turning_radius", 0.0)))

    @property
    def costmaps(self) -> tuple[CostmapSetup, CostmapSetup]:
        """What rules know of the global and of the local costmap."""
        return self.global_costmap.setup(COSTMAPS[0]), self.local_costmap.setup(COSTMAPS[1])

    def __repr__(self) -> str:
        planners = f"{self.global_planner.name} and {self.local_planner.name}"
        return f"Configuration({planners}, {len(self.recoveries)} recoveries, {len(self.findings)} findings)"
