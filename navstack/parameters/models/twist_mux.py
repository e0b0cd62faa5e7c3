"""The parameters of the command multiplexer (ROS: twist_mux)."""

from collections.abc import Mapping
from typing import Any, ClassVar, Final

from pydantic import Field, field_validator

from navstack.parameters.models.velocity_smoother import ROS2_NO_EFFECT
from navstack.plugins import ParamModel, param

ALIASES: Final[dict[str, tuple[str, ...]]] = {
    "navigation": ("navi", "nav", "nav_vel", "move_base", "cmd_vel_nav", "input/navi"),
    "motion": ("behavior", "behaviors", "navigation", "navi", "nav", "nav_vel", "move_base", "cmd_vel_nav"),
    "teleop": ("keyboard", "key", "key_vel", "keyop", "joystick", "joy", "joy_vel", "cmd_vel_teleop", "input/teleop"),
}
"""Names of inputs that navstack's own sources use if none has the name of the source, the preferred one first."""


class MuxInputParams(ParamModel):
    """An input of the multiplexer: an entry of `topics`."""

    name: str = Field(description="name of the input", min_length=1)
    topic: str = param("", "topic of the commands in ROS; also accepted as the name of the input")
    timeout: float = param(0.0, "age of its last command after which the input is silent; 0 = never", unit="s", ge=0.0)
    priority: int = param(0, "the input with the highest priority drives the robot", ge=0, le=255)
    short_desc: str = param("", "a description")


class MuxLockParams(ParamModel):
    """A lock: an entry of `locks`. While it is active, inputs of a lower priority are ignored."""

    name: str = Field(description="name of the lock", min_length=1)
    topic: str = param("", "topic of the lock in ROS")
    timeout: float = param(
        0.0, "age of its last message after which the lock counts as active; 0 = never", unit="s", ge=0.0
    )
    priority: int = param(0, "inputs of a lower priority are locked", ge=0, le=255)


def _entry(name: str, priority: int, timeout: float) -> MuxInputParams:
    return MuxInputParams(name=name, topic=f"cmd_vel_{name}", timeout=timeout, priority=priority)


def _default_topics() -> list[MuxInputParams]:
    return [_entry("navigation", 10, 0.0), _entry("motion", 20, 0.5), _entry("teleop", 90, 0.5)]


class TwistMuxParams(ParamModel):
    """Namespace `twist_mux`: which of several sources of commands drives the robot.

    `topics` and `locks` are lists of entries with a `name` (ROS 1), or namespaces with a namespace per name (ROS 2).
    """

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        **ROS2_NO_EFFECT,
        "use_stamped": "navstack's commands have the time of the call",
        "cmd_vel_out": "the output goes to the velocity smoother, the collision monitor or the robot",
        "output_stamped": "navstack's commands have the time of the call",
    }

    topics: list[MuxInputParams] = param(_default_topics(), "the inputs")
    locks: list[MuxLockParams] = param([], "the locks")

    @field_validator("topics", "locks")
    @classmethod
    def _check_names(cls, value: list[Any]) -> list[Any]:
        names = [entry.name for entry in value]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"the name {', '.join(twice)} is used twice; give each entry a unique name")
        return value

    @field_validator("topics")
    @classmethod
    def _check_any(cls, value: list[MuxInputParams]) -> list[MuxInputParams]:
        if not value:
            raise ValueError("topics is empty, so no command reaches the robot; list an input, or remove twist_mux")
        return value

    def input_of(self, source: str) -> MuxInputParams | None:
        """Return the input of a source: that with its name, its topic, or one of its `ALIASES`; None if there is none."""
        for entry in self.topics:
            if entry.name == source:
                return entry
        for wanted in (source, *ALIASES.get(source, ())):
            for entry in self.topics:
                if wanted in (entry.name, entry.topic.strip("/")):
                    return entry
        return None
