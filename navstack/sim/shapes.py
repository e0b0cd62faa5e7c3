"""Parameters of what stands and moves in a simulated world beside the map: outlines, and how they move.

These models are for scenario files: `model_dump(mode="json")` gives what `model_validate` reads again.
"""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Literal

import shapely
from pydantic import Field, field_validator, model_validator

from navstack.core.parameters import ParamModel, param

LOW = 0.1
"""Height (m) of what is called low: thresholds, feet of chairs, pallets. A lidar mounted no higher sees it."""

_THICKNESS = 0.05

Point = Annotated[list[float], Field(min_length=2, max_length=2)]
"""[x, y], m."""


class Still(ParamModel):
    """It stays where it is."""

    kind: Literal["still"] = param("still", "how it moves: not at all")


class OnTrack(ParamModel):
    """It follows a line at constant speed, for ever. Its `pose` counts from the track, not from the map."""

    kind: Literal["track"] = param("track", "how it moves: along a line")
    points: list[Point] = param(..., "corners [x, y] of the line, in the map; two at least", unit="m")
    speed: float = param(0.5, "along the line; negative: the other way round", unit="m/s")
    closed: bool = param(False, "true: from the last corner straight to the first; false: there and back")
    begin: float = param(0.0, "how far along the line it starts", unit="m")
    heading: Literal["fixed", "along"] = param(
        "fixed", "fixed: it keeps its direction; along: it faces where it goes (and turns at once at a corner)"
    )
    spin: float = param(0.0, "it turns about its own centre besides", unit="rad/s")

    @field_validator("points")
    @classmethod
    def _a_line(cls, value: list[list[float]]) -> list[list[float]]:
        if sum(math.dist(a, b) for a, b in itertools.pairwise(value)) <= 0.0:
            raise ValueError(f"a track needs two different points [x, y] at least, not {value}")
        return value


class DoorMotion(ParamModel):
    """A door: it opens and closes by a timetable. The shape is given as it is when closed."""

    kind: Literal["door"] = param("door", "how it moves: it opens and closes")
    style: Literal["hinged", "sliding"] = param("hinged", "hinged: turns about a point; sliding: moves aside")
    hinge: Point | None = param(
        None,
        "[x, y] of the point a hinged door turns about, in the map; none: the first point of its segment",
        unit="m",
    )
    angle: float = param(
        1.5707963267948966, "how far a hinged door opens; negative: clockwise", unit="rad", ge=-math.pi, le=math.pi
    )
    slide: Point | None = param(
        None,
        "[x, y] by which a sliding door moves when it opens, in the map; none: by its length, beyond the first point of its "
        "segment",
        unit="m",
    )
    open: list[Annotated[list[float], Field(min_length=2, max_length=2)]] = param(
        [], "list of [from, to]: it begins to open at the first time and to close at the second", unit="s"
    )
    period: float | None = param(None, "the timetable is repeated after so long; none: never", unit="s", gt=0.0)
    moving_time: float = param(2.0, "how long it takes to open or to close", unit="s", ge=0.0)

    @field_validator("open")
    @classmethod
    def _in_order(cls, value: list[list[float]]) -> list[list[float]]:
        for begin, end in value:
            if not 0.0 <= begin < end:
                raise ValueError(
                    f"a door is open [from, to] in s, with from below to and not below 0, not [{begin:g}, {end:g}]"
                )
        return value

    @model_validator(mode="after")
    def _of_its_style(self) -> DoorMotion:
        if self.style == "sliding" and (self.hinge is not None or self.angle != 0.5 * math.pi):
            given = "hinge" if self.hinge is not None else "angle"
            raise ValueError(f"a sliding door has no {given}; take it away, or make the door hinged")
        if self.style == "hinged" and self.slide is not None:
            raise ValueError("a hinged door has no slide; take it away, or write style: sliding")
        return self

    @model_validator(mode="after")
    def _within_the_period(self) -> DoorMotion:
        late = [span for span in self.open if self.period is not None and span[1] > self.period]
        if late:
            raise ValueError(
                f"the door is open until {late[0][1]:g} s of a timetable that is repeated after {self.period:g} s; "
                "end it within the period"
            )
        return self


class PedestrianMotion(ParamModel):
    """Somebody who walks from one goal to the next, keeping off walls, others and the robot (social force).

    Defaults and formulas: D. Helbing, P. Molnár, "Social force model for pedestrian dynamics", Phys. Rev. E 51 (1995).
    """

    kind: Literal["pedestrian"] = param("pedestrian", "how it moves: as somebody who walks")
    goals: list[Point] = param(..., "[x, y] in the map, walked to in turn, for ever; one at least", unit="m")
    speed: float | None = param(
        None,
        "how fast it likes to walk; none: drawn by the seed, 1.34 m/s with a deviation of 0.26",
        unit="m/s",
        gt=0.0,
        le=3.0,
    )
    notices_robot: bool = param(True, "false: walks as if the robot were not there")
    goal_radius: float = param(0.3, "a goal is reached from here", unit="m", gt=0.0)
    pause: float = param(0.0, "how long it stands at each goal", unit="s", ge=0.0)

    @field_validator("goals")
    @classmethod
    def _some(cls, value: list[list[float]]) -> list[list[float]]:
        if not value:
            raise ValueError("a pedestrian needs a goal [x, y] to walk to")
        return value


Motion = Annotated[Still | OnTrack | DoorMotion | PedestrianMotion, Field(discriminator="kind")]


class Shape(ParamModel):
    """A solid thing in the world: a disc, a box, a polygon or a straight wall, at a pose, with a height and a motion.

    Exactly one of `radius`, `box`, `polygon` and `segment` says what it looks like.
    """

    name: str = param("", "for messages and pictures")
    radius: float | None = param(None, "of a disc", unit="m", gt=0.0)
    box: list[float] | None = param(None, "[length, width] of a rectangle, lengthwise along its heading", unit="m")
    polygon: list[Point] | None = param(None, "corners [x, y] of a polygon that does not cross itself", unit="m")
    segment: list[Point] | None = param(None, "the two ends [x, y] of a straight wall or door", unit="m")
    thickness: float = param(_THICKNESS, "of a segment, which alone has one", unit="m", gt=0.0)
    pose: list[float] = param([0.0, 0.0, 0.0], "[x, y, yaw] of the shape in the map, m and rad; [x, y] will do")
    height: float | None = param(
        None, "a lidar or sonar mounted higher does not see it; none: it is seen from everywhere", unit="m", gt=0.0
    )
    motion: Motion = param(Still(), "still, track, door or pedestrian, and how")

    @field_validator("box")
    @classmethod
    def _two_lengths(cls, value: list[float] | None) -> list[float] | None:
        if value is not None and (len(value) != 2 or min(value) <= 0.0):
            raise ValueError(f"a box is [length, width] in m, both above 0, not {value}")
        return value

    @field_validator("segment")
    @classmethod
    def _two_ends(cls, value: list[list[float]] | None) -> list[list[float]] | None:
        if value is not None and (len(value) != 2 or value[0] == value[1]):
            raise ValueError(f"a segment is [[x, y], [x, y]] with two different ends, not {value}")
        return value

    @field_validator("polygon")
    @classmethod
    def _simple(cls, value: list[list[float]] | None) -> list[list[float]] | None:
        if value is None:
            return None
        if len(value) < 3:
            raise ValueError(f"a polygon has three corners [x, y] at least, not {len(value)}")
        made = shapely.Polygon(value)
        if not made.is_valid or made.area <= 0.0:
            raise ValueError(
                "the polygon crosses or touches itself, or has no area; give its corners in order, once round"
            )
        return value

    @field_validator("pose")
    @classmethod
    def _pose(cls, value: list[float]) -> list[float]:
        if len(value) not in (2, 3):
            raise ValueError(f"a pose is [x, y, yaw] or [x, y], not {value}")
        return [*value, 0.0] if len(value) == 2 else value

    @model_validator(mode="after")
    def _one_look(self) -> Shape:
        looks = [name for name in ("radius", "box", "polygon", "segment") if getattr(self, name) is not None]
        if len(looks) != 1:
            said = f"it has {' and '.join(looks)}" if looks else "it has none of them"
            raise ValueError(f"a shape is given by one of radius, box, polygon and segment; {said}")
        if self.segment is None and self.thickness != _THICKNESS:
            raise ValueError(
                f"only a segment has a thickness; a {looks[0].replace('radius', 'disc')} has none: take it away"
            )
        if isinstance(self.motion, PedestrianMotion) and self.radius is None:
            raise ValueError("a pedestrian is a disc; give it a radius (0.25 m is usual)")
        if isinstance(self.motion, DoorMotion):
            if self.radius is not None:
                raise ValueError("a door is a segment, a box or a polygon; a disc cannot open")
            if self.segment is None and self.motion.style == "hinged" and self.motion.hinge is None:
                raise ValueError("a hinged door that is no segment needs its hinge [x, y]")
            if self.segment is None and self.motion.style == "sliding" and self.motion.slide is None:
                raise ValueError("a sliding door that is no segment needs its slide [x, y]")
        return self

    @property
    def top(self) -> float:
        """Height for sensors: inf when it is seen from everywhere."""
        return math.inf if self.height is None else self.height

    def outline(self) -> list[tuple[float, float]]:
        """Corners (m) in the shape's own frame, counterclockwise; of a disc: none."""
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
    """A disc that only bumpers and low lidars notice."""
    return Shape(radius=radius, pose=[x, y, 0.0], height=LOW)
