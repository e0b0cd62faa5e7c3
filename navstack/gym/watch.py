"""`render_mode="live"`: the episodes of an environment on the live page, at the pace that the page sets."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any, Final, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Event,
    Footprint,
    FrameTree,
    InputError,
    LaserScan,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
    require,
)
from navstack.gym.levels import Level
from navstack.parameters import Configuration, LidarParams
from navstack.plugins import VelocityLimits
from navstack.scenario import Run, Scenario
from navstack.sim import Shape

T = TypeVar("T")

RENDER_MODES: Final = ("rgb_array", "live")
MAP, BASE = "map", "base_link"


def check_render_mode(render_mode: str | None, port: object) -> None:
    """Raise InputError for an unknown render mode, an invalid port, and a live page without aiohttp."""
    if render_mode not in (None, *RENDER_MODES):
        raise InputError(
            f'render_mode is "{render_mode}"; it must be None, "rgb_array" or "live"', render_mode=render_mode
        )
    if not (isinstance(port, int) and 0 <= port <= 65535):
        raise InputError(f"port is {port!r}; it must be a whole number of 0 .. 65535", port=str(port))
    if render_mode == "live":
        require("aiohttp", 'render_mode="live"')


class Watch:
    """The live page of an environment. It opens with the first episode, and then the environment waits for a viewer."""

    def __init__(self, port: int, shown: Callable[[], tuple[Scenario, Run]]) -> None:
        """`shown` returns the scenario and the run of the current episode; port 0 is any free one."""
        from navstack.live import ServerThread, WatchedSession

        self._port, self._shown = port, shown
        self._session: WatchedSession | None = None
        self._server: ServerThread | None = None
        self._return = 0.0

    def reset(self, reset: Callable[[], T]) -> T:
        """Call a function that begins an episode, between two steps of the page, and show the episode."""
        if self._session is None:
            result = reset()
            self._open()
            return result
        return self._carry_out(partial(self._begin, reset))

    def step(self, step: Callable[[], tuple[Any, float, bool, bool, dict[str, Any]]]) -> tuple[Any, ...]:
        """Call a function that steps the episode when the page's time has come."""
        return step() if self._session is None else self._carry_out(partial(self._stepped, step))

    def seen(self) -> None:
        """Take a sample of the robot after a control cycle."""
        if self._session is not None:
            self._session.history.add(self._session.run)

    def close(self) -> None:
        """End the server."""
        if self._server is not None:
            self._server.stop()
        self._session = self._server = None

    @property
    def address(self) -> str:
        """Of the page; empty before the first episode."""
        return "" if self._server is None else self._server.address

    def _open(self) -> None:
        from navstack.live import Gate, LiveServer, Options, ServerThread, Stage, WatchedSession

        self._session = WatchedSession(*self._shown())
        self._listen()
        stage = Stage([self._session], Options(fixed=True))
        try:
            self._server = ServerThread(LiveServer(stage, Gate("127.0.0.1")), port=self._port)
        except BaseException:
            self._session = None
            raise
        print(f"navstack live: {self._server.address} (the environment goes on when the page is open)", file=sys.stderr)

    def _carry_out(self, action: Callable[[], T]) -> T:
        assert self._session is not None and self._server is not None
        server = self._server
        return self._session.carry_out(action, alive=lambda: server.is_alive)

    def _begin(self, reset: Callable[[], T]) -> T:
        assert self._session is not None
        result = reset()
        self._session.show(*self._shown())
        self._listen()
        return result

    def _listen(self) -> None:
        assert self._session is not None
        session = self._session
        self._return = 0.0
        if session.has_stack:
            session.run.move_base.listeners.append(session.history)
        session.history.on_event(Event(session.time, "info", f"episode: {session.scenario.name}"))
        self.seen()

    def _stepped(self, step: Callable[[], tuple[Any, float, bool, bool, dict[str, Any]]]) -> tuple[Any, ...]:
        assert self._session is not None
        result = step()
        self._return += result[1]
        if result[2] or result[3]:
            text = f"{result[4]['outcome']} after {result[4]['time']:.1f} s, return {self._return:.2f}"
            self._session.history.on_event(Event(self._session.time, "info", text))
        return result


class ShownRun:
    """An episode without the stack in the form of a `Run`, as far as pages show it."""

    upcoming = ()
    done = False

    def __init__(
        self,
        configuration: Configuration,
        level: Level,
        footprint: Footprint,
        lidar: LidarParams,
        limits: VelocityLimits,
    ) -> None:
        """`lidar`: that of the observation; its ranges are those of `update`."""
        self._level, self._lidar = level, lidar
        spec = level.spec
        grid = level.world.map if spec is None else spec.map()
        self.scenario = Scenario(grid, configuration, level.start, (level.goal,), name=level.name)
        shapes = _discs_of(level) if spec is None else spec.shapes
        frames = FrameTree()
        frames.set_static(BASE, lidar.frame, Transform2D(lidar.x, lidar.y, lidar.yaw))
        self.interventions = SimpleNamespace(
            configuration=configuration, teleop=None, shapes={str(k): shape for k, shape in enumerate(shapes)}
        )
        self.robot = SimpleNamespace(
            time=0.0,
            pose=level.start,
            velocity=Twist2D(),
            clearance=float("nan"),
            collisions=range(0),
            by_hand=None,
            moves=False,
            world=level.world,
            solids=None,
            steering_angle=0.0,
            footprint=footprint,
            params=configuration.navstack.sim,
            frames=frames,
            map_frame=MAP,
            base_frame=BASE,
        )
        robot = self.robot
        robot.state = lambda: RobotState(robot.pose, robot.velocity, robot.time)
        way = np.column_stack((level.path, np.zeros(len(level.path))))
        self._plan: Any = SimpleNamespace(path=SimpleNamespace(poses=way))
        self.move_base = SimpleNamespace(
            command=Twist2D(),
            state=SimpleNamespace(name="DRIVING"),
            recovery=None,
            chain=None,
            goal_pose=level.goal,
            plan=None,
            local_plan=None,
            global_costmap=None,
            local_costmap=SimpleNamespace(frame=MAP, footprint=footprint),
            local_planner=SimpleNamespace(limits=limits, diagnostics=lambda: None),
            motions=SimpleNamespace(running=None),
            last_tick=SimpleNamespace(scans=(), plan=self._plan),
        )
        self.path_length = 0.0
        sent = SimpleNamespace(
            index=0, target=level.goal, handle=SimpleNamespace(status=SimpleNamespace(name="ACTIVE"))
        )
        self.goals = SimpleNamespace(loop=False, waiting=(), under_way=[sent], outcomes=[])

    @property
    def run(self) -> Run:
        """This, as pages take it."""
        return cast(Run, self)

    def update(
        self,
        time: float,
        pose: Pose2D,
        velocity: Twist2D,
        command: Twist2D,
        ranges: NDArray[np.float32],
        *,
        clearance: float,
        collisions: int,
        outcome: str,
    ) -> None:
        """Set what the last step changed; `ranges` (beams,) in m, inf where nothing was hit."""
        robot, lidar, tick = self.robot, self._lidar, self.move_base.last_tick
        self.path_length += robot.pose.distance_to(pose)
        robot.time, robot.pose, robot.velocity, robot.clearance = time, pose, velocity, clearance
        robot.collisions = range(collisions)
        self.move_base.command = command
        tick.plan = self._plan if time == 0.0 else None
        tick.scans = (
            LaserScan(
                ranges, lidar.angle_min, lidar.angle_increment, 0.0, float("inf"), time, lidar.frame, lidar.topic
            ),
        )
        if outcome:
            state = "SUCCEEDED" if outcome == "goal" else "ABORTED"
            ended = SimpleNamespace(goal=self._level.goal, state=state, time_s=time, message=outcome)
            self.goals.under_way, self.goals.outcomes = [], [ended]
            self.move_base.state.name = outcome.upper()


def _discs_of(level: Level) -> list[Shape]:
    return [Shape(radius=r, pose=[x, y]) for x, y, r in level.world.solids_at(0.0).discs.tolist()]
