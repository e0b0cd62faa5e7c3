"""Carries out interactions in a running simulation. An interaction that cannot be carried out changes nothing."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, assert_never

from navstack.bringup import reconfigure
from navstack.core import Event, InputError, Listener, Twist2D
from navstack.move_base import BusyError, MoveBase
from navstack.parameters import Configuration, load_configuration, value_text
from navstack.record import RunRecorder, SolidNames
from navstack.routes import FollowRoute
from navstack.scenario.goal_sequence import GoalSequence, SentGoal
from navstack.scenario.interactions import (
    Cancel,
    ClearCostmaps,
    Drive,
    Edges,
    GoTo,
    Kidnap,
    PlaceRobot,
    PutShape,
    Queue,
    RemoveShape,
    SetParameters,
    StartStep,
    Teleop,
    Wait,
    pose_from,
)
from navstack.scenario.scenario import MAX_SHAPES, Scenario, too_many_pedestrians
from navstack.scenario.steps import step_text
from navstack.sim import PedestrianMotion, Shape, SimulatedRobot, World


def named_shapes(scenario: Scenario) -> dict[str, Shape]:
    """Returns all obstacles of a scenario by name; those without one are called `obstacle N` and `shape N`."""
    found: dict[str, Shape] = {}
    for number, (x, y, radius) in enumerate(scenario.obstacles, 1):
        found[f"obstacle {number}"] = Shape(radius=radius, pose=[x, y, 0.0])
    for number, shape in enumerate(scenario.shapes, 1):
        found[f"shape {number}" if not shape.name or shape.name in found else shape.name] = shape
    return {name: shape.model_copy(update={"name": name}) for name, shape in found.items()}


class Interventions:
    """Changes goals, obstacles, parameters and the robot of one run."""

    def __init__(
        self,
        scenario: Scenario,
        robot: SimulatedRobot,
        move_base: MoveBase,
        goals: GoalSequence,
        recorder: RunRecorder | None,
        listeners: Sequence[Listener],
        on_sent: Callable[[SentGoal], None],
    ) -> None:
        self.configuration = scenario.configuration
        """The parameters in force."""
        self.shapes = named_shapes(scenario)
        """The obstacles in the world by name."""
        self.world_changed = False
        """True once an obstacle has been added, moved or removed."""
        self.driving_until = 0.0
        """End of driving by hand (s)."""
        self.teleop: Twist2D | None = None
        """The command of teleop that is in force."""
        self._teleop_until = 0.0
        self._teleop_sent = -math.inf
        self._scenario = scenario
        self._robot, self._move_base, self._goals = robot, move_base, goals
        self._recorder, self._listeners, self._on_sent = recorder, listeners, on_sent

    def record_with(self, recorder: RunRecorder) -> None:
        """Passes interventions and changes of the world on to this recorder from now on."""
        self._recorder = recorder
        self._listeners = (recorder, *self._listeners)
        if self.world_changed:
            solids = self._robot.solids
            recorder.identify_solids(solids.discs, solids.corners, solids.first, self.names_of_solids())

    def apply(self, item: Any) -> None:
        """Carries out an interaction now. Raises NavError."""
        match item:
            case GoTo():
                self._goals.finish_ended()
                self._goals.urgent = None
                self._on_sent(self._goals.send(pose_from(item.pose), self._move_base))
                self._note(f"sent the goal {_text(item.pose)}")
            case Queue():
                self._goals.waiting[:] = [pose_from(pose) for pose in item.goals]
                self._goals.loop = item.loop
                self._note(f"set the queue to {_plural(len(item.goals), 'goal')}{', repeated' if item.loop else ''}")
            case Cancel():
                self._goals.waiting.clear()
                self._goals.urgent = None
                for sent in self._goals.under_way:
                    sent.cancel(self._move_base)
                self._note("canceled the goal")
            case PutShape():
                self._put(item.shape)
            case RemoveShape():
                self._remove(item.name)
            case PlaceRobot():
                self._robot.place(pose_from(item.pose))
                self._move_base.clear_costmaps()
                self._note(f"put the robot at {_text(item.pose)}")
            case Kidnap():
                self._robot.place(pose_from(item.pose), inform_localization=False)
                self._note(f"carried the robot to {_text(item.pose)}")
            case SetParameters():
                self._set(item)
            case Drive():
                self._drive(item)
            case Teleop():
                self._teleop(item)
            case ClearCostmaps():
                self._move_base.clear_costmaps()
                self._note("cleared the costmaps")
            case Edges():
                self._adjust_edges(item)
            case StartStep():
                self._goals.finish_ended()
                self._goals.begin_now(item.step, self._move_base)
                self._note(f"began the step: {step_text(item.step)}")
            case Wait():
                pass
            case _:
                assert_never(item)

    def names_of_solids(self) -> SolidNames:
        """Returns the names of the obstacles in the order of `SimulatedRobot.solids`."""
        world = self._robot.world
        solids = self._robot.solids
        return SolidNames(
            tuple(world.name_of("disc", k) for k in range(len(solids.discs))),
            tuple(world.name_of("polygon", k) for k in range(len(solids.circles))),
        )

    def stop_driving(self) -> None:
        """Ends driving by hand when its time is over."""
        if self._robot.by_hand is not None and self._robot.time >= self.driving_until:
            self._robot.drive_by_hand(None)
        if self.teleop is not None and self._robot.time >= self._teleop_until:
            self.teleop, self._teleop_sent = Twist2D(), -math.inf
            self.repeat_teleop()
            self.teleop = None

    def repeat_teleop(self) -> bool:
        """Sends the command of teleop again, before it times out; returns False if none is in force."""
        if self.teleop is None:
            return False
        if self._teleop_sent == self._robot.time:
            return True  # sending is work that is due at once: again and again, the time would not advance
        self._teleop_sent = self._robot.time
        try:
            self._move_base.motions.drive(self.teleop)
        except BusyError:  # a goal was sent: it drives now
            self.teleop = None
        return self.teleop is not None

    def _adjust_edges(self, item: Edges) -> None:
        running = self._move_base.motions.running
        motion = None if running is None else running.motion
        if not isinstance(motion, FollowRoute):
            raise InputError(
                "no route is being driven, so there are no edges to change; send this while a route step runs"
            )
        motion.adjust_edges(item.close, item.open, item.costs)
        if item.reroute:
            motion.request_reroute()
        parts = [
            f"{what} {_plural(len(ids), 'edge')}"
            for what, ids in (("closed", item.close), ("opened", item.open))
            if ids
        ]
        parts += [f"set the cost of {_plural(len(item.costs), 'edge')}"] if item.costs else []
        self._note(", ".join(parts) or "asked for another route")

    def _put(self, shape: Shape) -> None:
        moved = shape.name in self.shapes
        if not moved and len(self.shapes) >= MAX_SHAPES:
            raise InputError(f"the world already has {MAX_SHAPES} obstacles; remove some")
        self._change_world({**self.shapes, shape.name: shape})
        self._note(f'{"moved" if moved else "added"} "{shape.name}"')

    def _remove(self, name: str) -> None:
        if name not in self.shapes:
            known = ", ".join(list(self.shapes)[:20]) or "none"
            raise InputError(f'no obstacle is called "{name}"; obstacles: {known}', name=name)
        self._change_world({other: shape for other, shape in self.shapes.items() if other != name})
        self._note(f'removed "{name}"')

    def _change_world(self, shapes: dict[str, Shape]) -> None:
        problem = too_many_pedestrians(sum(isinstance(s.motion, PedestrianMotion) for s in shapes.values()))
        if problem is not None:
            raise InputError(f"{problem}; remove some")
        robot = self._robot
        if not self.world_changed:
            # the same obstacles, but all with a name
            robot.change_world(self._world(self.shapes))
            self._identify()
        robot.change_world(self._world(shapes))
        self.shapes = shapes
        self.world_changed = True

    def _world(self, shapes: Mapping[str, Shape]) -> World:
        """Return the world with these obstacles and the docks."""
        return World(self._scenario.map, shapes=[*shapes.values(), *self._scenario.dock_shapes])

    def _identify(self) -> None:
        if self._recorder is not None:
            solids = self._robot.solids
            self._recorder.identify_solids(solids.discs, solids.corners, solids.first, self.names_of_solids())

    def _set(self, item: SetParameters) -> None:
        before = self.configuration
        after = load_configuration(
            item.params or [before.tree.as_dict()],
            overrides=[f"{name}={value_text(value)}" for name, value in item.values.items()],
            distro=None if item.params else before.navstack.ros_distro,
        )
        _check_fixed(before, after)
        reconfigure(self._move_base, after)
        self.configuration = after
        names = [*(p if isinstance(p, str) else "all parameters" for p in item.params)]
        names += [f"{name} = {value_text(value)}" for name, value in item.values.items()]
        self._note(f"set {', '.join(names)}")

    def _drive(self, item: Drive) -> None:
        vx, vy, wz = item.velocity
        if vy != 0.0 and self._robot.params.kinematics != "holonomic":
            raise InputError(f"this robot is {self._robot.params.kinematics}: it cannot drive sideways; vy must be 0")
        if self._robot.by_hand is None:
            self._note("drives the robot by hand")
        self._robot.drive_by_hand(Twist2D(vx, vy, wz))
        self.driving_until = item.until

    def _teleop(self, item: Teleop) -> None:
        vx, vy, wz = item.velocity
        if vy != 0.0 and self._robot.params.kinematics != "holonomic":
            raise InputError(f"this robot is {self._robot.params.kinematics}: it cannot drive sideways; vy must be 0")
        self._move_base.motions.drive(Twist2D(vx, vy, wz))
        self.teleop, self._teleop_until = Twist2D(vx, vy, wz), item.until
        self._teleop_sent = self._robot.time
        self._note(f"drives by teleop: vx {vx:.3f}, vy {vy:.3f}, wz {wz:.3f}")

    def _note(self, text: str) -> None:
        event = Event(self._robot.time, "info", f"the user {text}", {})
        for listener in self._listeners:
            listener.on_event(event)


def _check_fixed(before: Configuration, after: Configuration) -> None:
    """Raises InputError for parameters that a run cannot change."""
    if before.navstack.sim != after.navstack.sim:
        raise InputError("navstack/sim describes the simulated robot, which is fixed during a run; start a new one")
    if [(r.name, r.params) for r in before.recoveries] != [(r.name, r.params) for r in after.recoveries]:
        raise InputError("the recovery behaviors are fixed during a run; start a new one with the other parameters")


def _text(pose: Sequence[float]) -> str:
    return f"({', '.join(f'{value:.2f}' for value in pose)})"


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"
