"""Parameters of the obstacles of a simulated world that are not on the map: outlines and motions.

Scenario files and records contain these models: `model_validate` reads what `model_dump(mode="json")` writes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Final, Literal, cast, get_args

import shapely
from pydantic import Field, field_validator, model_validator

from navstack.plugins import ParamModel, param

LOW = 0.1
"""Height (m) of low obstacles: thresholds, feet of chairs, pallets. Only a lidar mounted at most this high sees them."""

_THICKNESS = 0.05

Point = Annotated[list[float], Field(min_length=2, max_length=2)]
"""[x, y], m."""


class Still(ParamModel):
    """Does not move."""

    kind: Literal["still"] = param("still", "motion: none")


class OnTrack(ParamModel):
    """Follows a line at constant speed, without end. The shape's `pose` is relative to the track, not to the map."""

    RENAMED: ClassVar[Mapping[str, str]] = {"begin": "start_offset"}

    kind: Literal["track"] = param("track", "motion: along a line")
    points: list[Point] = param(..., "corners [x, y] of the line in the map; at least two", unit="m")
    speed: float = param(0.5, "speed along the line; negative: in the reverse direction", unit="m/s")
    closed: bool = param(False, "true: from the last corner straight to the first; false: back and forth")
    start_offset: float = param(0.0, "position on the line at time 0", unit="m")
    heading: Literal["fixed", "along"] = param(
        "fixed", "fixed: constant yaw; along: faces the direction of motion (and turns instantly at corners)"
    )
    spin: float = param(0.0, "additional rotation about its own center", unit="rad/s")

    @field_validator("points")
    @classmethod
    def _has_length(cls, value: list[list[float]]) -> list[list[float]]:
        if sum(math.dist(a, b) for a, b in itertools.pairwise(value)) <= 0.0:
            raise ValueError(f"points = {value} has no length; give at least two different points [x, y]")
        return value

    @model_validator(mode="before")
    @classmethod
    def _old_names(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        given = cast("dict[str, Any]", values)
        return {cls.RENAMED.get(key, key): value for key, value in given.items()}


class DoorMotion(ParamModel):
    """A door that opens and closes by a timetable. The shape is that of the closed door."""

    kind: Literal["door"] = param("door", "motion: opens and closes")
    style: Literal["hinged", "sliding"] = param("hinged", "hinged: rotates about a point; sliding: moves sideways")
    hinge: Point | None = param(
        None,
        "[x, y] of the hinge in the map; default: the first point of the segment",
        unit="m",
    )
    angle: float = param(
        1.5707963267948966, "opening angle of a hinged door; negative: clockwise", unit="rad", ge=-math.pi, le=math.pi
    )
    slide: Point | None = param(
        None,
        "[x, y] displacement of an open sliding door in the map; default: its length, beyond the first point of the segment",
        unit="m",
    )
    open: list[Annotated[list[float], Field(min_length=2, max_length=2)]] = param(
        [], "list of [from, to]: times at which the door starts to open and to close", unit="s"
    )
    period: float | None = param(None, "period of the timetable; none: it is not repeated", unit="s", gt=0.0)
    moving_time: float = param(2.0, "time to open or to close", unit="s", ge=0.0)

    @field_validator("open")
    @classmethod
    def _in_order(cls, value: list[list[float]]) -> list[list[float]]:
        for begin, end in value:
            if not 0.0 <= begin < end:
                raise ValueError(
                    f"open = [{begin:g}, {end:g}] is not a time span; give [from, to] in s with 0 <= from < to"
                )
        return value

    @model_validator(mode="after")
    def _matches_style(self) -> DoorMotion:
        if self.style == "sliding" and (self.hinge is not None or self.angle != 0.5 * math.pi):
            given = "hinge" if self.hinge is not None else "angle"
            raise ValueError(f"a sliding door has no {given}; remove it, or write style: hinged")
        if self.style == "hinged" and self.slide is not None:
            raise ValueError("a hinged door has no slide; remove it, or write style: sliding")
        return self

    @model_validator(mode="after")
    def _within_the_period(self) -> DoorMotion:
        late = [span for span in self.open if self.period is not None and span[1] > self.period]
        if late:
            raise ValueError(
                f"the door closes at {late[0][1]:g} s, after the period of {self.period:g} s; close it within the period"
            )
        return self


ORCA_PARAMETERS: Final = ("neighbor_distance", "max_neighbors", "time_horizon", "time_horizon_obstacles")
"""Parameters of a pedestrian that only ORCA has."""


class PedestrianMotion(ParamModel):
    """A pedestrian who walks from goal to goal and avoids walls, other pedestrians and the robot.

    Social forces: D. Helbing, P. Molnár, "Social force model for pedestrian dynamics", Phys. Rev. E 51 (1995). ORCA: J. van den
    Berg et al., "Reciprocal n-body collision avoidance", ISRR 2009. Groups: M. Moussaïd et al., PLoS ONE 5 (2010).
    """

    kind: Literal["pedestrian"] = param("pedestrian", "motion: walks")
    goals: list[Point] = param(..., "positions [x, y] in the map, visited in order, repeatedly; at least one", unit="m")
    speed: float | None = param(
        None,
        "desired speed; default: random, mean 1.34 m/s, standard deviation 0.26 m/s",
        unit="m/s",
        gt=0.0,
        le=3.0,
    )
    notices_robot: bool = param(True, "false: ignores the robot")
    goal_radius: float = param(0.3, "distance at which a goal is reached", unit="m", gt=0.0)
    pause: float = param(0.0, "pause at each goal", unit="s", ge=0.0)
    model: Literal["social_force", "orca"] = param(
        "social_force", "social_force: is pushed away; orca: takes a velocity that collides with nobody (ORCA)"
    )
    group: str = param("", "name of the group that it stays with")
    neighbor_distance: float = param(
        10.0, "orca: distance of the centers within which other pedestrians are avoided", unit="m", gt=0.0
    )
    max_neighbors: int = param(10, "orca: number of pedestrians that are avoided: the nearest ones", ge=0)
    time_horizon: float = param(5.0, "orca: time without a collision with others", unit="s", gt=0.0)
    time_horizon_obstacles: float = param(2.0, "orca: time without a collision with walls", unit="s", gt=0.0)

    @model_validator(mode="after")
    def _matches_model(self) -> PedestrianMotion:
        given = [name for name in ORCA_PARAMETERS if getattr(self, name) != type(self).model_fields[name].default]
        if self.model != "orca" and given:
            raise ValueError(f"the social force model has no {given[0]}; remove it, or write model: orca")
        return self

    @field_validator("goals")
    @classmethod
    def _not_empty(cls, value: list[list[float]]) -> list[list[float]]:
        if not value:
            raise ValueError("goals is empty; give a pedestrian at least one goal [x, y]")
        return value


class ReplayMotion(ParamModel):
    """A person whose positions were recorded: walks straight from one to the next, and is absent before and after them.

    In a scenario file, `file` instead of `points` names a CSV file with the columns t, id, x, y (s, m), as the data sets of ETH
    and UCY are published; each person in it becomes a shape, or only `person`.
    """

    kind: Literal["replay"] = param("replay", "motion: walks as recorded")
    points: list[Annotated[list[float], Field(min_length=3, max_length=3)]] = param(
        ..., "positions [t, x, y] in the map in the order of their times, s and m; at least one"
    )

    @field_validator("points")
    @classmethod
    def _in_order(cls, value: list[list[float]]) -> list[list[float]]:
        if not value:
            raise ValueError("points is empty; give at least one position [t, x, y], or a file")
        for (before, _, _), (time, _, _) in itertools.pairwise(value):
            if not before < time:
                raise ValueError(f"points has the time {time:g} s after {before:g} s; sort them, one for each time")
        return value


_AnyMotion = Still | OnTrack | DoorMotion | PedestrianMotion | ReplayMotion
Motion = Annotated[_AnyMotion, Field(discriminator="kind")]
MOTIONS: Final[dict[str, type[ParamModel]]] = {m.model_fields["kind"].default: m for m in get_args(_AnyMotion)}
"""`kind` of a shape's motion -> its model."""


class Shape(ParamModel):
    """A solid obstacle: a disc, a box, a polygon or a straight wall, with a pose, a height and a motion.

    Exactly one of `radius`, `box`, `polygon` and `segment` defines its outline.
    """

    name: str = param("", "name in messages and pictures")
    radius: float | None = param(None, "radius of a disc", unit="m", gt=0.0)
    box: list[float] | None = param(None, "[length, width] of a rectangle; the length is along its x axis", unit="m")
    polygon: list[Point] | None = param(None, "corners [x, y] of a polygon without self-intersections", unit="m")
    segment: list[Point] | None = param(None, "the two ends [x, y] of a straight wall or door", unit="m")
    thickness: float = param(_THICKNESS, "thickness of a segment", unit="m", gt=0.0)
    pose: list[float] = param([0.0, 0.0, 0.0], "[x, y, yaw] or [x, y] of the shape in the map, m and rad")
    height: float | None = param(
        None, "a lidar or sonar mounted higher does not see it; none: always seen", unit="m", gt=0.0
    )
    motion: Motion = param(Still(), "still, track, door, pedestrian or replay, with its parameters")

    @field_validator("box")
    @classmethod
    def _two_lengths(cls, value: list[float] | None) -> list[float] | None:
        if value is not None and (len(value) != 2 or min(value) <= 0.0):
            raise ValueError(f"box = {value} is not [length, width]; give two lengths above 0, in m")
        return value

    @field_validator("segment")
    @classmethod
    def _two_ends(cls, value: list[list[float]] | None) -> list[list[float]] | None:
        if value is not None and (len(value) != 2 or value[0] == value[1]):
            raise ValueError(f"segment = {value} is not a segment; give [[x, y], [x, y]] with two different ends")
        return value

    @field_validator("polygon")
    @classmethod
    def _simple(cls, value: list[list[float]] | None) -> list[list[float]] | None:
        if value is None:
            return None
        if len(value) < 3:
            raise ValueError(f"polygon has {len(value)} corners; give at least three [x, y]")
        made = shapely.Polygon(value)
        if not made.is_valid or made.area <= 0.0:
            raise ValueError(
                "the polygon intersects or touches itself, or has no area; list its corners in order around it"
            )
        return value

    @field_validator("pose")
    @classmethod
    def _pose(cls, value: list[float]) -> list[float]:
        if len(value) not in (2, 3):
            raise ValueError(f"pose = {value} is not a pose; give [x, y, yaw] or [x, y]")
        return [*value, 0.0] if len(value) == 2 else value

    @model_validator(mode="after")
    def _one_outline(self) -> Shape:
        outlines = [name for name in ("radius", "box", "polygon", "segment") if getattr(self, name) is not None]
        if len(outlines) != 1:
            given = f"it has {' and '.join(outlines)}" if outlines else "it has none"
            raise ValueError(f"a shape has exactly one of radius, box, polygon and segment; {given}")
        if self.segment is None and self.thickness != _THICKNESS:
            raise ValueError(
                f"a {outlines[0].replace('radius', 'disc')} has no thickness, only a segment has; remove it"
            )
        if isinstance(self.motion, PedestrianMotion | ReplayMotion) and self.radius is None:
            raise ValueError("a pedestrian is a disc; give it a radius (typically 0.25 m)")
        if isinstance(self.motion, DoorMotion):
            if self.radius is not None:
                raise ValueError("a disc cannot be a door; use a segment, a box or a polygon")
            if self.segment is None and self.motion.style == "hinged" and self.motion.hinge is None:
                raise ValueError("a hinged door that is not a segment has no default hinge; give hinge: [x, y]")
            if self.segment is None and self.motion.style == "sliding" and self.motion.slide is None:
                raise ValueError("a sliding door that is not a segment has no default slide; give slide: [x, y]")
        return self

    @property
    def top(self) -> float:
        """Height for sensors (m): inf if it is always seen."""
        return math.inf if self.height is None else self.height

    def outline(self) -> list[tuple[float, float]]:
        """Returns the corners (m) in the shape's own frame, counter-clockwise; none for a disc."""
        if self.radius is not None:
            return []
        if self.box is not None:
            a, b = 0.5 * self.box[0], 0.5 * self.box[1]
            return [(-a, -b), (a, -b), (a, b), (-a, b)]
        if self.segment is not None:
            (x0, y0), (x1, y1) = self.segment
            half = 0.5 * self.thickness / math.dist(*self.segment)
            nx, ny = -half * (y1 - y0), half * (x1 - x0)
            return [(x0 - nx, y0 - ny), (x1 - nx, y1 - ny), (x1 + nx, y1 + ny), (x0 + nx, y0 + ny)]
        ring = shapely.geometry.polygon.orient(shapely.Polygon(self.polygon)).exterior.coords
        return [(float(x), float(y)) for x, y in list(ring)[:-1]]


def low_disc(x: float, y: float, radius: float) -> Shape:
    """Returns a disc that only bumpers and low lidars detect."""
    return Shape(radius=radius, pose=[x, y, 0.0], height=LOW)
