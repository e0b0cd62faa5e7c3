"""Parameters of coverage: the fields of opennav_coverage's action and server, by their names."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, Literal

from pydantic import ValidationError

from navstack.core import short_repr
from navstack.coverage.errors import InvalidModeError
from navstack.parameters import nearest
from navstack.plugins import ParamModel, param

RouteName = Literal["BOUSTROPHEDON", "SNAKE", "SPIRAL", "CUSTOM"]


class HeadlandMode(ParamModel):
    """The passes along the border of the area (HeadlandMode.msg)."""

    mode: Literal["CONSTANT"] = param("CONSTANT", "the same width everywhere")
    width: float = param(0.0, "width of the headland; 0: one pass of the tool", unit="m", ge=0.0, le=100.0)


class SwathMode(ParamModel):
    """The straight swaths (SwathMode.msg)."""

    objective: Literal["NUMBER"] = param(
        "NUMBER", "the best angle has the fewest swaths; LENGTH and COVERAGE are not built"
    )
    mode: Literal["BRUTE_FORCE", "SET_ANGLE"] = param("BRUTE_FORCE", "search for the best angle, or use best_angle")
    best_angle: float = param(0.0, "angle of the swaths with SET_ANGLE", unit="rad", ge=-100.0, le=100.0)
    step_angle: float = param(math.radians(1.0), "step of the search for the best angle", unit="rad", ge=1e-3, le=1.6)


class RouteMode(ParamModel):
    """The order of the swaths of a cell (RouteMode.msg)."""

    mode: RouteName = param("BOUSTROPHEDON", "one after the other; every second one and back; inward; custom_order")
    spiral_n: int = param(4, "number of swaths of a spiral", ge=2, le=1000)
    custom_order: list[int] = param([], "indices of the swaths of a cell with CUSTOM; those not listed follow")

    def order(self, number: int) -> list[int]:
        """Return the order of `number` swaths."""
        match self.mode:
            case "SNAKE":
                return [*range(0, number, 2), *reversed(range(1, number, 2))]
            case "SPIRAL":
                order: list[int] = []
                for first in range(0, number, self.spiral_n):
                    low, high = first, min(first + self.spiral_n, number) - 1
                    while low <= high:
                        order += [low, high] if low < high else [low]
                        low, high = low + 1, high - 1
                return order
            case "CUSTOM":
                listed = list(dict.fromkeys(k for k in self.custom_order if 0 <= k < number))
                return [*listed, *(k for k in range(number) if k not in listed)]
            case _:
                return list(range(number))


class PathMode(ParamModel):
    """The turns between swaths of a base with a turning radius (PathMode.msg); other bases turn in place."""

    mode: Literal["DUBIN", "REEDS_SHEPP"] = param("DUBIN", "curves driven forward, or backward too")
    continuity_mode: Literal["DISCONTINUOUS"] = param("DISCONTINUOUS", "CONTINUOUS curvature is not built")
    turn_point_distance: float = param(0.1, "distance between the points of a turn", unit="m", ge=0.01, le=10.0)


class CoverageParams(ParamModel):
    """What to cover with, and how: names of ComputeCoveragePath.action and of the parameters of the coverage server."""

    operation_width: float = param(
        0.35, "width of the tool, a disc at the center of the robot", unit="m", gt=0.0, le=100.0
    )
    clearance: float = param(
        0.075,
        "distance of the footprint from obstacles, for noise (an addition of navstack)",
        unit="m",
        ge=0.0,
        le=10.0,
    )
    min_turning_radius: float = param(0.0, "of the base; 0: it turns in place", unit="m", ge=0.0, le=100.0)
    generate_headland: bool = param(True, "drive along the border first")
    generate_route: bool = param(True, "order the swaths; without it there are swaths only")
    generate_path: bool = param(True, "connect the swaths; without it there is no path to drive")
    headland_mode: HeadlandMode = param(HeadlandMode(), "the passes along the border")
    swath_mode: SwathMode = param(SwathMode(), "the straight swaths")
    route_mode: RouteMode = param(RouteMode(), "the order of the swaths of a cell")
    path_mode: PathMode = param(PathMode(), "the turns between swaths")
    frame_id: str = param("map", "frame of the polygons")
    min_coverage: float = param(
        0.98, "passes that cover little are left out down to this share (an addition of navstack)", ge=0.0, le=1.0
    )


MODES: Final[dict[str, type[ParamModel]]] = {
    "headland_mode": HeadlandMode,
    "swath_mode": SwathMode,
    "route_mode": RouteMode,
    "path_mode": PathMode,
}


def read_params(values: Mapping[str, Any]) -> CoverageParams:
    """Return the parameters of a mapping.

    Raises InvalidModeError with the key, its value and what is possible.
    """
    _check_keys("coverage", values, CoverageParams)
    made: dict[str, Any] = {}
    for key, value in values.items():
        model = MODES.get(key)
        if model is None or isinstance(value, model):
            made[key] = value
            continue
        if not isinstance(value, Mapping):
            raise InvalidModeError(
                f"{key} is {short_repr(value)}; give its fields: {', '.join(model.model_fields)}", argument=key
            )
        _check_keys(key, value, model)
        made[key] = _validated(key, model, dict(value))
    return _validated("coverage", CoverageParams, made)


def _check_keys(where: str, values: Mapping[str, Any], model: type[ParamModel]) -> None:
    for key in values:
        if key not in model.model_fields:
            near = nearest(str(key), model.model_fields)
            hint = f'did you mean "{near}"?' if near else f"known: {', '.join(model.model_fields)}"
            raise InvalidModeError(f'{where} has no field "{key}"; {hint}', argument=str(key))


def _validated(where: str, model: type[Any], values: dict[str, Any]) -> Any:
    try:
        return model.model_validate(values)
    except ValidationError as exc:
        error = exc.errors(include_url=False, include_context=False)[0]
        name = ".".join([*([] if where == "coverage" else [where]), *(str(part) for part in error["loc"])])
        text = error["msg"][0].lower() + error["msg"][1:]
        raise InvalidModeError(f"{name} is {short_repr(error['input'])}: {text}", argument=name) from None
