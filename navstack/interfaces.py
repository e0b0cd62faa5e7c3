"""The abstract base classes of everything that can be plugged in, and the values they exchange.

Parameters come by constructor, data by argument, failures by exception (`navstack.core.errors`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Bounds,
    Costmap,
    Footprint,
    FrameTree,
    GridGeometry,
    OccupancyGrid,
    Path,
    Pose2D,
    RobotState,
    SensorData,
    Transform2D,
    Twist2D,
    Window,
)
from navstack.core.clearance import clearance_along
from navstack.core.parameters import ParamModel

# --- layers -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LayerContext:
    """What a layer may know of the costmap it belongs to."""

    name: str
    """The layer's instance name, which is also its namespace: `inflation_layer`."""
    frame: str
    """The costmap's global frame."""
    frames: FrameTree
    footprint: Footprint
    """As padded by the costmap."""
    rolling_window: bool = False
    track_unknown_space: bool = False
    """The costmap's own setting, which obstacle layers take as their default."""
    static_map: OccupancyGrid | None = None
    """The map of map_server, None when the robot has none."""
    read_map: Callable[[str], OccupancyGrid] | None = None
    """Reads a map file by its path (`navstack.map_io.load_mask`), for layers that name one in their parameters."""


@dataclass(frozen=True, slots=True)
class LayerSays:
    """What a layer has to say about one cell, and on whose word."""

    cost: int | None
    """The cost the layer itself holds there; None when it says nothing."""
    text: str
    """In words."""
    source: str | None = None
    """The observation source behind it."""
    stamp: float | None = None
    """When that source saw it (s)."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])


class Layer(ABC):
    """A layer of a costmap. Bounds may only grow; costs are written only inside the window."""

    Params: ClassVar[type[ParamModel]]
    LIVE: ClassVar[frozenset[str]] = frozenset()
    """The parameters that may change while the layer is at work, by `set_params`."""

    def __init__(self, params: Any, context: LayerContext) -> None:
        self.params = params
        self.context = context
        self.name = context.name

    def set_params(self, params: Any) -> None:
        """Other parameters, which differ in `LIVE` and `live_parts` only; the costmap is written anew after it."""
        self.params = params

    def live_parts(self, params: Any) -> frozenset[str]:
        """Parameters beyond `LIVE` of which only such parts differ in `params` as may change: nested ones."""
        del params
        return frozenset()

    @abstractmethod
    def match_size(self, geometry: GridGeometry) -> None:
        """The master grid has (had) this geometry from now on: allocate. Called before anything else."""

    def shift_to(self, geometry: GridGeometry) -> None:
        """The rolling window moved by whole cells to `geometry`; keep what overlaps. For layers that hold cells."""
        del geometry

    @abstractmethod
    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Takes in what was observed; returns `bounds` (m) grown to hold every cell that may change."""

    @abstractmethod
    def update_costs(self, master: Costmap, window: Window) -> None:
        """Writes this layer's costs into the window of the master grid."""

    def observe(self, data: SensorData) -> bool:
        """Offers a sensor message; True when a source of this layer takes it (by topic)."""
        del data
        return False

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Forgets what was observed in `region` (m), outside it with `invert`, everywhere when None: cells cleared."""
        del region, invert
        return 0

    def is_current(self, now: float) -> bool:
        """False when an expected sensor is silent for too long at `now` (s)."""
        del now
        return True

    def explain(self, ix: int, iy: int, master: Costmap) -> LayerSays | None:
        """What this layer says about a cell of `master`, and why; computed on request only. None: nothing to add."""
        del ix, iy, master
        return None

    @property
    def clearable(self) -> bool:
        """True for layers fed by sensors: what clear_costmap_recovery clears when no layer is named (parity 18)."""
        return False

    def set_footprint(self, footprint: Footprint) -> None:
        """The robot's outline changed."""
        del footprint


class CostmapServer(Protocol):
    """A layered costmap as recovery behaviours and the goal manager see it (`navstack.costmap.LayeredCostmap`)."""

    name: str
    frame: str
    robot_base_frame: str
    master: Costmap
    footprint: Footprint

    @property
    def layers(self) -> Sequence[Layer]:
        """In the order in which they write."""
        ...

    def observe(self, data: SensorData) -> None:
        """Hands a sensor message to every layer that listens to its topic."""
        ...

    def robot_pose(self, now: float | None = None) -> Pose2D:
        """The robot in this costmap's frame; raises FrameError."""
        ...

    def update(self, now: float) -> Window:
        """One update around the robot's present pose; the window of cells that was rewritten."""
        ...

    def is_current(self, now: float) -> bool:
        """False when a layer's sensor is silent for too long."""
        ...

    def reset(self) -> int:
        """Resets every layer (move_base's clear_costmaps): cells cleared."""
        ...


# --- global planning --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """What a global planner found."""

    path: Path
    """From the start to `goal`, in the costmap's frame."""
    cost: float
    """In the planner's own unit; comparable between plans of one planner on one costmap."""
    goal: Pose2D
    """The goal really used."""
    goal_moved_m: float = 0.0
    """How far that is from the goal asked for (default_tolerance)."""
    cells_expanded: int = 0
    potential: NDArray[np.float32] | None = None
    """(ny, nx), inf where not reached; only on request."""
    notes: tuple[str, ...] = ()
    """What the planner mended on the way, in sentences."""
    took_s: float | None = None
    """Wall time the planner took (s); None when it does not say. To be shown: it decides nothing and is not recorded."""

    @property
    def length_m(self) -> float:
        """Length of the path (m)."""
        return self.path.length

    def clearance_m(self, costmap: Costmap) -> float:
        """Smallest distance (m) of the path to a lethal cell of `costmap`, inf when it has none; computed on request."""
        return clearance_along(costmap, self.path.poses)


class GlobalPlanner(ABC):
    """Plans over a costmap that it never writes to."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, params: Any) -> None:
        self.params = params

    @abstractmethod
    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """A plan between two poses in the costmap's frame; raises a PlanningError with code and data otherwise."""


# --- local planning ---------------------------------------------------------------------------------------------------


class VelocityLimits(NamedTuple):
    """What a local planner allows the base (m/s, rad/s, m/s², rad/s²), for behaviours that drive it otherwise."""

    max_vel_x: float
    min_vel_x: float
    max_vel_y: float
    min_vel_y: float
    max_vel_trans: float
    min_vel_trans: float
    max_vel_theta: float
    min_vel_theta: float
    acc_lim_x: float
    acc_lim_y: float
    acc_lim_theta: float
    yaw_goal_tolerance: float
    xy_goal_tolerance: float


@dataclass(frozen=True, slots=True, eq=False)
class ControlInput:
    """Everything a local planner looks at in one cycle."""

    state: RobotState
    """Pose in the costmap's frame, velocity in the robot's."""
    costmap: Costmap
    footprint: Footprint
    plan_to_costmap: Transform2D = field(default_factory=Transform2D)
    """Pose of the plan's frame in the costmap's frame at this time."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalPlan:
    """A command and how it was chosen. K samples, T points, C critics."""

    command: Twist2D
    mode: str = "follow"
    """follow, brake, rotate_to_goal, arrived, or escape: backing out where every sample was rejected."""
    samples: NDArray[np.float64] | None = None
    """(K, 3) velocities vx, vy, wz that were tried."""
    critics: tuple[str, ...] = ()
    costs: NDArray[np.float64] | None = None
    """(K, C) raw costs per critic; NaN where a sample was not scored by it."""
    scales: NDArray[np.float64] | None = None
    """(C,) weights."""
    totals: NDArray[np.float64] | None = None
    """(K,) weighted sums; negative: the code of the rejection."""
    rejected_by: NDArray[np.int8] | None = None
    """(K,) index of the critic that rejected the sample, -1 legal, -2 never a trajectory (too slow, too fast)."""
    best: int = -1
    """Index of the winner, -1 without samples."""
    trajectory: NDArray[np.float64] | None = None
    """(T, 3) the winner's poses in the costmap's frame."""
    local_plan: Path | None = None
    """The part of the global plan in sight, in the costmap's frame."""
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """A summary for JSON: the command, and how many samples were legal or rejected by which critic."""
        rejected: dict[str, int] = {}
        legal = 0
        if self.rejected_by is not None:
            legal = int((self.rejected_by == -1).sum())
            for index, name in ((-2, "limits"), *enumerate(self.critics)):
                number = int((self.rejected_by == index).sum())
                if number:
                    rejected[name] = number
        return {
            "mode": self.mode,
            "command": list(self.command),
            "samples": 0 if self.samples is None else len(self.samples),
            "legal": legal,
            "rejected": rejected,
            "best": None if self.best < 0 or self.samples is None else self.samples[self.best].tolist(),
            "total": None if self.best < 0 or self.totals is None else float(self.totals[self.best]),
            "notes": list(self.notes),
        }


class LocalPlanner(ABC):
    """Turns a plan, a pose and a local costmap into a velocity."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, params: Any) -> None:
        self.params = params

    @property
    @abstractmethod
    def limits(self) -> VelocityLimits:
        """The limits in force."""

    @abstractmethod
    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lowers the speed limits for a while (move_slow_and_clear, speed masks); None restores that of the parameters."""

    @abstractmethod
    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        """Follow this plan to this goal, both in the plan's frame.

        Same goal as before: a replan, and what was achieved (a latched position) holds. Oscillation flags are reset by every
        plan, as in C++.

        Raises InvalidPathError for a plan that is empty or not finite.
        """

    @abstractmethod
    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """The velocity to command now; raises a ControlError (NoValidControlError with the table of samples) if none."""

    @abstractmethod
    def goal_reached(self, inputs: ControlInput) -> bool:
        """True once the robot stands at the goal within the tolerances."""

    def explain(self, inputs: ControlInput) -> dict[str, Any]:
        """More about the last cycle than a command needs (grids, rollouts), computed on request only."""
        del inputs
        return {}


# --- critics ----------------------------------------------------------------------------------------------------------


class Rollouts(NamedTuple):
    """K simulated trajectories of at most T points, in the costmap's frame; row k has `counts[k]` valid points."""

    samples: NDArray[np.float64]
    """(K, 3) the velocities vx, vy, wz of the first step, which would be commanded."""
    poses: NDArray[np.float64]
    """(K, T, 3) x, y, yaw; the first point is the present pose."""
    counts: NDArray[np.int64]
    """(K,) points per row; 0 = never a trajectory (too slow, too fast)."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoringContext:
    """What critics may look at in one cycle, all in the costmap's frame."""

    state: RobotState
    costmap: Costmap
    footprint: Footprint
    plan: NDArray[np.float64]
    """(n, 3) the part of the plan in sight."""
    goal: Pose2D
    """The final goal."""
    limits: VelocityLimits
    shared: dict[str, Any] = field(default_factory=dict[str, Any])
    """What one critic computed and others may use in this cycle, by name (`path_grid`)."""


class Critic(ABC):
    """Scores trajectories; a file each."""

    Params: ClassVar[type[ParamModel]]
    CODES: ClassVar[dict[int, str]] = {}
    """Negative score -> what it means, in words."""

    def __init__(self, name: str, params: Any) -> None:
        self.name = name
        self.params = params

    @property
    def scale(self) -> float:
        """Weight of this critic's scores in the sum; with 0 it is skipped."""
        return 1.0

    @abstractmethod
    def prepare(self, context: ScoringContext) -> None:
        """Called once per cycle, before scoring."""

    @abstractmethod
    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) raw costs of the rows that are `alive` (others: anything); negative = rejected, the code from `CODES`."""


# --- recovery ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class RecoveryContext:
    """What a recovery behaviour may act on."""

    global_costmap: CostmapServer
    local_costmap: CostmapServer
    local_planner: LocalPlanner
    controller_frequency: float = 20.0


class RecoveryStatus(Enum):
    """Where a recovery behaviour stands after a step."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class RecoveryStep:
    """The velocity to command until the next step, and whether there will be one."""

    status: RecoveryStatus
    twist: Twist2D = Twist2D()
    text: str = ""
    """What was done or why it failed, for the log."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])


class RecoveryBehavior(ABC):
    """Stepwise, so that a cancel or a new goal takes effect within one cycle."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, name: str, params: Any) -> None:
        self.name = name
        self.params = params

    @property
    def frequency(self) -> float | None:
        """How often it wants to be stepped (Hz); None: at the controller's frequency."""
        return None

    @abstractmethod
    def start(self, context: RecoveryContext, now: float) -> None:
        """Called once, before the first step. May raise a RecoveryError."""

    @abstractmethod
    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """One step; `state.pose` in the local costmap's frame. Never blocks."""

    def check(self, context: RecoveryContext) -> None:
        """Raises a ParameterError when the parameters do not fit this robot; called once, before the first goal."""
        del context

    def follow_up(self, state: RobotState, now: float) -> bool:
        """Called once a control cycle after the last step, until it returns False: for effects that outlast the behaviour.

        A speed limit that holds for a distance, say. `state.pose` in the local costmap's frame.
        """
        del state, now
        return False


# --- what others supply -----------------------------------------------------------------------------------------------


class Robot(Protocol):
    """A robot, simulated or real."""

    @property
    def frames(self) -> FrameTree:
        """Map -> odom -> base and the sensors, kept up to date by the robot."""
        ...

    def state(self) -> RobotState:
        """Odometry: pose in the odometry frame, velocity in the robot's own."""
        ...

    def scans(self) -> Sequence[SensorData]:
        """What the sensors delivered since the last call, oldest first."""
        ...

    def command(self, twist: Twist2D) -> None:
        """Drive so until told otherwise."""
        ...
