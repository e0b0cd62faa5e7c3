"""Tasks of a fleet: what is to be done, how it is given to the robots, and what came of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from navstack.core import Pose2D
from navstack.fleet.assignment import Stop, Task
from navstack.plugins import ParamModel, param


class TaskParams(ParamModel):
    """How tasks are given to robots."""

    assignment: Literal["nearest", "auction"] = param(
        "auction", "nearest: each task to the next free robot; auction: queues of the robots by bids"
    )
    objective: Literal["average", "sum", "max"] = param(
        "average",
        "what an auction makes small: the mean time until a task is done, the way of all robots, the longest way",
    )
    attempts: int = param(3, "a task that so many robots have failed has failed", ge=1)
    silence: float = param(5.0, "a robot without a report for this time loses its tasks", unit="s", gt=0.0)
    idle: Literal["home", "stay"] = param("home", "where a robot without a task goes: to its start, or nowhere")


class ChargingParams(ParamModel):
    """When robots charge."""

    threshold: float = param(0.25, "a robot with less charge takes no task and goes to a charger", gt=0.0, lt=1.0)
    resume: float = param(0.9, "charge with which it takes tasks again", gt=0.0, le=1.0)


@dataclass(frozen=True, slots=True)
class Charger:
    """Where one robot at a time can charge."""

    name: str
    stop: Stop
    """Where it is: the pose of a docked robot, or where the robot drives as to a goal."""
    dock: bool = False
    """True for a dock of the docking server, into which the robot docks."""

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        stop = list(self.stop) if isinstance(self.stop, Pose2D) else self.stop
        return {"name": self.name, "stop": stop, "dock": self.dock}


@dataclass(frozen=True, slots=True)
class TaskPlan:
    """The tasks of a fleet, and how they are given to the robots."""

    tasks: tuple[Task, ...]
    params: TaskParams = field(default_factory=TaskParams)
    charging: ChargingParams = field(default_factory=ChargingParams)
    chargers: tuple[Charger, ...] = ()
    """None: robots drive until they are empty."""

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data; `from_dict` inverts it."""
        return {
            "tasks": [task.as_dict() for task in self.tasks],
            "params": self.params.model_dump(mode="json"),
            "charging": self.charging.model_dump(mode="json"),
            "chargers": [charger.as_dict() for charger in self.chargers],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> TaskPlan:
        """Restore a plan. Raises KeyError, TypeError or ValueError."""
        chargers = (
            Charger(
                str(each["name"]),
                each["stop"] if isinstance(each["stop"], int) else Pose2D(*each["stop"]),
                each["dock"],
            )
            for each in data["chargers"]
        )
        return cls(
            tuple(Task.from_dict(task) for task in data["tasks"]),
            TaskParams.model_validate(data["params"]),
            ChargingParams.model_validate(data["charging"]),
            tuple(chargers),
        )


# --- what came of it --------------------------------------------------------------------------------------------------

State = Literal["waiting", "assigned", "running", "returned", "done", "failed"]


@dataclass(slots=True)
class TaskProgress:
    """A task and what has come of it so far. Times in s; None: not yet."""

    task: Task
    state: State = "waiting"
    """`assigned`: in the queue of `robot`; `running`: `robot` drives it; `returned`: waiting again."""
    robot: str = ""
    started: float | None = None
    """When the robot that drives it, or has driven it, set out."""
    ended: float | None = None
    way: float = 0.0
    """Driven for it by the robot that did it (m)."""
    bids: dict[str, float] = field(default_factory=dict[str, float])
    """By which `robot` got it (m); inf: no way."""
    returns: list[str] = field(default_factory=list[str])
    """Each time that a robot did not do it: which, and why."""
    barred: set[str] = field(default_factory=set[str])
    """Robots that have failed it."""
    reason: str = ""
    """Why it failed."""

    @property
    def waiting_s(self) -> float | None:
        """Time from its release until its robot set out."""
        return None if self.started is None else self.started - self.task.release

    @property
    def travel_s(self) -> float | None:
        """Time from the robot's setting out to the end of the task."""
        return None if self.started is None or self.ended is None else self.ended - self.started

    @property
    def completion_s(self) -> float | None:
        """Time from its release to its end."""
        return None if self.state != "done" or self.ended is None else self.ended - self.task.release

    @property
    def is_late(self) -> bool:
        """True if it has a deadline and was not done by then."""
        done = self.completion_s
        return self.task.deadline is not None and (done is None or done > self.task.deadline)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        bids = {name: bid if math.isfinite(bid) else None for name, bid in sorted(self.bids.items())}
        return {
            **self.task.as_dict(),
            "state": self.state,
            "robot": self.robot or None,
            "started_s": self.started,
            "ended_s": self.ended,
            "waiting_s": self.waiting_s,
            "travel_s": self.travel_s,
            "completion_s": self.completion_s,
            "late": self.is_late,
            "way_m": self.way,
            "bids_m": bids,
            "returns": list(self.returns),
            "reason": self.reason or None,
        }


@dataclass(frozen=True, slots=True)
class RobotLoad:
    """What a robot had to do."""

    name: str
    tasks: int
    """Tasks that it did."""
    busy_s: float
    """Time with a task."""
    length_m: float
    """Way in all."""
    charges: int
    charging_s: float
    """Time at chargers and on the way to them."""
    charge: float | None
    """At the end; None without a battery that runs low."""
    energy_wh: float
    """By the model of the battery (`navstack/sim/battery`)."""
    out: str
    """Why it took no tasks any more."""


@dataclass(frozen=True, slots=True)
class TaskReport:
    """The tasks of a run and the figures of the fleet."""

    tasks: tuple[TaskProgress, ...]
    """In the order of the file."""
    robots: tuple[RobotLoad, ...]
    """By name."""
    assignment: str
    horizon_s: float
    """When the last task ended, or the run."""

    def count(self, state: State) -> int:
        """Return the number of tasks in a state."""
        return sum(task.state == state for task in self.tasks)

    @property
    def all_done(self) -> bool:
        """True if every task was done."""
        return self.count("done") == len(self.tasks)

    @property
    def throughput_per_h(self) -> float:
        """Tasks done per hour until the last one ended."""
        return 3600.0 * self.count("done") / self.horizon_s if self.horizon_s > 0.0 else 0.0

    @property
    def utilization(self) -> float:
        """Share of the time until the last task ended that the robots had a task, on average."""
        if not self.robots or self.horizon_s <= 0.0:
            return 0.0
        return sum(robot.busy_s for robot in self.robots) / len(self.robots) / self.horizon_s

    @property
    def late(self) -> int:
        """Number of tasks that were not done by their deadline."""
        return sum(task.is_late for task in self.tasks)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return {
            "assignment": self.assignment,
            "count": len(self.tasks),
            "done": self.count("done"),
            "failed": self.count("failed"),
            "late": self.late,
            "throughput_per_h": self.throughput_per_h,
            "waiting_s": spread(task.waiting_s for task in self.tasks),
            "travel_s": spread(task.travel_s for task in self.tasks if task.state == "done"),
            "completion_s": spread(task.completion_s for task in self.tasks),
            "utilization": self.utilization,
            "fairness": {
                "distance": fairness([robot.length_m for robot in self.robots]),
                "tasks": fairness([robot.tasks for robot in self.robots]),
            },
            "energy_wh": sum(robot.energy_wh for robot in self.robots),
            "robots": [
                {
                    "name": robot.name,
                    "tasks": robot.tasks,
                    "busy_s": robot.busy_s,
                    "length_m": robot.length_m,
                    "charges": robot.charges,
                    "charging_s": robot.charging_s,
                    "charge": robot.charge,
                    "energy_wh": robot.energy_wh,
                    "out": robot.out or None,
                }
                for robot in self.robots
            ],
            "tasks": [task.as_dict() for task in self.tasks],
        }


def fairness(values: Sequence[float]) -> float:
    """Return Jain's index of fairness: 1 if all values are equal, 1/n if one robot has all.

    Jain, Chiu, Hawe, "A Quantitative Measure of Fairness and Discrimination for Resource Allocation in Shared Computer Systems",
    DEC Research Report TR-301, 1984: (sum of x)^2 / (n sum of x^2).
    """
    squares = math.fsum(value * value for value in values)
    return math.fsum(values) ** 2 / (len(values) * squares) if squares > 0.0 else 1.0


def spread(values: Iterable[float | None]) -> dict[str, float | None]:
    """Return mean and 95th percentile of the values that are known."""
    known = [value for value in values if value is not None]
    if not known:
        return {"mean": None, "p95": None}
    return {"mean": float(np.mean(known)), "p95": float(np.percentile(known, 95.0))}
