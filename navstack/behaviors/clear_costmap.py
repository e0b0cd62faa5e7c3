"""clear_costmap_recovery: clear obstacles far from the robot, which may have disappeared.

Source: clear_costmap_recovery/src/clear_costmap_recovery.cpp.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal

from navstack.core import Bounds, ParameterError, RobotState
from navstack.plugins import (
    RECOVERY_BEHAVIORS,
    Behavior,
    BehaviorContext,
    BehaviorStatus,
    BehaviorStep,
    CheckContext,
    CostmapServer,
    Issue,
    Layer,
    ParamModel,
    param,
)


class ClearCostmapRecoveryParams(ParamModel):
    """Namespace: the instance's name, `conservative_reset` and `aggressive_reset` in the built-in list."""

    RENAMED: ClassVar[Mapping[str, str]] = {"layer_search_string": "layer_names"}

    reset_distance: float = param(
        3.0, "side length of the square around the robot that is not cleared", unit="m", ge=0.0
    )
    invert_area_to_clear: bool = param(False, "clear inside the square instead of outside")
    force_updating: bool = param(False, "update the costmaps after clearing")
    affected_maps: Literal["both", "local", "global"] = param(
        "both", "costmaps to clear", ros_differs="any other value is an error; in ROS it means both"
    )
    layer_names: list[str] | None = param(
        None,
        "layers to clear; by default every layer with sensor data",
        ros_differs='ROS\'s default ["obstacles"] matches no layer of most robots, so that nothing is cleared; '
        "here a name that matches no layer is an error",
    )

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield layer names that no affected costmap has: the recovery would clear nothing (parity 18)."""
        affected = [
            c for c in context.costmaps if self.affected_maps == "both" or c.name.startswith(self.affected_maps)
        ]
        known = list(dict.fromkeys(layer.name for costmap in affected for layer in costmap.layers))
        costmaps = " or ".join(costmap.name for costmap in affected)
        for name in self.layer_names or ():
            if name not in known:
                message = (
                    f'layer_names of {context.name} contains "{name}", which is not a layer of {costmaps}; use one of: '
                    f"{', '.join(known) or 'none'}; or remove layer_names to clear every layer with sensor data"
                )
                yield Issue("error", "no-such-layer", ("layer_names",), message)


def _last_name(name: str) -> str:
    """Return a layer's name without namespaces: as in ROS, `global_costmap/obstacle_layer` is `obstacle_layer`."""
    return name.rsplit("/", 1)[-1]


@RECOVERY_BEHAVIORS.register("clear_costmap_recovery", aliases=("clear_costmap_recovery/ClearCostmapRecovery",))
class ClearCostmapRecovery(Behavior[ClearCostmapRecoveryParams]):
    """Clears the costmaps outside a square around the robot, in one step."""

    Params = ClearCostmapRecoveryParams

    def __init__(self, name: str, params: ClearCostmapRecoveryParams) -> None:
        super().__init__(name, params)
        self._context: BehaviorContext | None = None

    def check(self, context: BehaviorContext) -> None:
        """Raise ParameterError if a layer name matches no layer of the affected costmaps."""
        names = self.params.layer_names
        if names is None:
            return
        known = [_last_name(layer.name) for costmap in self._affected(context) for layer in costmap.layers]
        for name in names:
            if _last_name(name) not in known:
                names_of_layers = ", ".join(dict.fromkeys(known)) or "none"
                raise ParameterError(
                    f'{self.name}/layer_names: no layer "{name}"; layers of '
                    f"{' and '.join(c.name for c in self._affected(context))}: {names_of_layers}. Remove layer_names to "
                    "clear every layer with sensor data",
                    parameter=f"{self.name}/layer_names",
                    layer=name,
                    known=known,
                )

    def start(self, context: BehaviorContext, now: float) -> None:
        """Raise ParameterError as `check` does."""
        del now
        self.check(context)
        self._context = context

    def step(self, state: RobotState, now: float) -> BehaviorStep:
        """Clear the costmaps. Raises FrameError if the robot's pose is unknown."""
        del state
        context = self._context
        assert context is not None
        p = self.params
        cleared = {costmap.name: self._clear(costmap, now) for costmap in self._affected(context)}
        plural = "s" if p.affected_maps == "both" else ""
        side = "inside" if p.invert_area_to_clear else "outside"
        text = (
            f"Clearing {p.affected_maps} costmap{plural} {side} a square ({p.reset_distance:.2f}m) large centered on "
            "the robot."
        )
        return BehaviorStep(BehaviorStatus.DONE, text=text, data={"cells_cleared": cleared})

    def _affected(self, context: BehaviorContext) -> list[CostmapServer]:
        which = self.params.affected_maps
        found: list[CostmapServer] = []
        if which in ("both", "global"):
            found.append(context.global_costmap)
        if which in ("both", "local"):
            found.append(context.local_costmap)
        return found

    def _clear(self, costmap: CostmapServer, now: float) -> dict[str, int]:
        pose = costmap.robot_pose(now)
        square = Bounds(pose.x, pose.y, pose.x, pose.y).grown(self.params.reset_distance / 2.0)
        cells = {
            layer.name: layer.reset(square, invert=not self.params.invert_area_to_clear)
            for layer in costmap.layers
            if self._is_selected(layer)
        }
        if self.params.force_updating:
            costmap.update(now)
        return cells

    def _is_selected(self, layer: Layer) -> bool:
        names = self.params.layer_names
        if names is None:
            return layer.clearable
        return _last_name(layer.name) in (_last_name(name) for name in names)
