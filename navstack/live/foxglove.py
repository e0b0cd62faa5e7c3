"""Shows a session in Foxglove (or Lichtblick) with messages of ROS 2, and takes goals from there.

foxglove-sdk serves the WebSocket in threads of its own. Its callbacks only leave something to do, which the thread of the
simulation does between two steps.
"""

from __future__ import annotations

import itertools
import json
import logging
import time
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from navstack.bringup import odometry_frame
from navstack.core import (
    InputError,
    LaserScan,
    NavError,
    PointCloud,
    Pose2D,
    SensorData,
    Transform2D,
    require,
    require_finite_pose,
)
from navstack.costmap import LayeredCostmap
from navstack.live import messages, parameters
from navstack.live.session import Session
from navstack.live.stage import Stage
from navstack.logs import typestore
from navstack.parameters import Configuration
from navstack.replay import EPOCH_NS, sensor_topics
from navstack.ros_messages import MessageBuilder
from navstack.ros_messages import messages as msg

NAME: Final = "navstack live"
POSE_ESTIMATE: Final = "geometry_msgs/msg/PoseWithCovarianceStamped"
RECEIVED: Final = {
    "/goal_pose": (msg.POSE, "goal"),
    "/move_base_simple/goal": (msg.POSE, "goal"),
    "/initialpose": (POSE_ESTIMATE, "place"),
}
"""Topics that clients publish: the type, and the request of the page that does the same."""
COSTMAP_PERIOD_S: Final = 0.5
"""Least time between two costmaps (s, wall): Foxglove takes whole ones only."""
BACKLOG: Final = 4096
"""Messages that wait for a slow client: some seconds of all topics; beyond, the oldest are dropped."""
REPEAT_S: Final = 10.0
"""A message that stays true is sent again after this time (s, wall): that to a slow client may have been dropped."""
MOST_TASKS: Final = 1000
"""Messages of clients that wait for the simulation; beyond, the oldest are dropped."""
SHAPE_COLOR: Final = (0.84, 0.37, 0.0)
DELETE_ALL: Final = 3
"""Action of a marker that removes all markers of its topic."""
TOPICS: Final = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf_static": msg.TRANSFORMS[0],
    "/tf": msg.TRANSFORMS[0],
    "/map": msg.MAP,
    "/odom": msg.ODOMETRY,
    "/cmd_vel": msg.TWIST,
    "/global_costmap/costmap": msg.MAP,
    "/local_costmap/costmap": msg.MAP,
    "/local_costmap/published_footprint": "geometry_msgs/msg/PolygonStamped",
    "/plan": msg.PATH,
    "/local_plan": msg.PATH,
    "/transformed_global_plan": msg.PATH,
    "/current_goal": msg.POSE,
    "/marker": "visualization_msgs/msg/MarkerArray",
}
"""Topics under the names of Nav2, and their types; those of the sensors besides."""


def ns(time_s: float) -> int:
    """Return the time of messages (ns) of a simulated time (s), as `bag export` writes it."""
    return EPOCH_NS + round(time_s * 1e9)


class Topic:
    """A channel, what tells whether there is something new to send, and what makes the message."""

    def __init__(
        self,
        channel: Any,
        version: Callable[[], Hashable],
        build: Callable[[int], Any],
        *,
        period_s: float = 0.0,
    ) -> None:
        """`version` returns another value when there is a new message, and None when there is none to send."""
        self.name, self.kind = str(channel.topic()), str(channel.schema_name())
        self.channel, self.version, self.build = channel, version, build
        self._period, self._sent_at = period_s, -period_s
        self._sent: Hashable = None

    def forget(self) -> None:
        """Send the next message also if it is not new: a subscriber has come."""
        self._sent, self._sent_at = None, -self._period

    def message(self, stamp_ns: int, now: float) -> Any:
        """Return a message if a client wants it and there is a new one, or one to repeat; `now` (s) is wall time."""
        since = now - self._sent_at
        if not self.channel.has_sinks() or since < self._period:
            return None
        version = self.version()
        if version is None or (version == self._sent and since < REPEAT_S):
            return None
        self._sent, self._sent_at = version, now
        return self.build(stamp_ns)


class FoxgloveServer:
    """Listens from the start; `show` gives it the stage, of which it shows the first robot."""

    def __init__(
        self,
        host: str,
        port: int,
        configuration: Configuration,
        *,
        read_only: bool = False,
        duration_s: float | None = None,
    ) -> None:
        """`configuration` is that of the first robot: its sensors are topics.

        With `read_only`, clients can look only. `duration_s` is that of a recorded run: clients control its time.
        Raises InputError if foxglove-sdk is missing or the port cannot be used.
        """
        foxglove: Any = require("foxglove", "navstack live --foxglove")
        self._sdk: Any = foxglove
        self._web: Any = require("foxglove.websocket", "navstack live --foxglove")
        self._store: Any = typestore(ros1=False)
        self._build = MessageBuilder(self._store, ros1=False)
        logging.getLogger("foxglove").setLevel(logging.CRITICAL)  # a client that leaves without a word is no error
        self._context = foxglove.Context()
        capability = self._web.Capability
        capabilities = [capability.Time, capability.Parameters]
        if not read_only and duration_s is None:
            capabilities.append(capability.ClientPublish)
        self._read_only = read_only
        self._is_recorded = duration_s is not None
        self._stage: Stage | None = None
        self._watched: Callable[[], object] | None = None
        self._topics: dict[str, Topic] = {}
        self._parameters: dict[str, Any] = {}
        self._configuration: Any = None
        self._restarts = -1
        self._time = -1.0
        self._playback: Any = None
        """The last state that clients were told: of a recorded run."""
        self._advertised: dict[tuple[int, int], Any] = {}
        self._tasks: deque[Callable[[], None]] = deque(maxlen=MOST_TASKS)
        """What the callbacks leave to the thread of the simulation."""
        # before any client is there: foxglove-sdk advertises a channel before it takes subscriptions to it
        self._channels = {name: self._channel(name, kind) for name, kind in _topics_of(configuration).items()}
        try:
            self._server: Any = foxglove.start_server(
                name=NAME,
                host=host,
                port=port,
                capabilities=capabilities,
                server_listener=self,
                supported_encodings=["cdr", "json"],
                context=self._context,
                message_backlog_size=BACKLOG,
                playback_time_range=None if duration_s is None else (ns(0.0), ns(duration_s)),
            )
        except RuntimeError as exc:  # foxglove-sdk has no class for this
            text = f"Foxglove cannot be served on {host}:{port} ({exc}); give another port with --foxglove"
            raise InputError(text, port=port) from None
        self.port = int(self._server.port)

    def stop(self) -> None:
        """Disconnect all clients."""
        self._server.stop()

    def show(self, stage: Stage, watched: Callable[[], object]) -> None:
        """Send the topics of a stage from now on; `watched` is called, in any thread, when a client subscribes or has done so.

        Called in the thread of the simulation, as `update`.
        """
        self._stage = stage
        self._topics = {topic.name: topic for topic in self._all_topics(stage.main)}
        self._refresh_parameters()
        self._server.clear_session()  # a client that was here before asks for the parameters again
        self._watched = watched
        if any(channel.has_sinks() for channel in self._channels.values()):
            watched()

    def update(self) -> bool:
        """Do what clients have asked for, and send what is new; return whether a client has asked for anything.

        Errors are shown to the clients.
        """
        tasks = len(self._tasks)
        try:
            for _ in range(tasks):
                self._tasks.popleft()()
            if self._stage is not None:
                self._send(self._stage.main)
        except NavError as error:
            self._tell(error.message)
        except Exception as error:  # a bug must not end the session
            self._tell(f"the session could not be shown ({type(error).__name__}: {error}); please report it")
        return tasks > 0

    # --- out ----------------------------------------------------------------------------------------------------------

    def _send(self, session: Session) -> None:
        if session.restarts != self._restarts:
            if self._restarts >= 0:
                self._server.clear_session()  # clients drop what they have of the time after
            self._restarts = session.restarts
            self._forget_all()
        if session.time != self._time:
            self._time = session.time
            self._server.broadcast_time(ns(session.time))
        stamp, now = ns(session.time), time.monotonic()
        for topic in self._topics.values():
            message = topic.message(stamp, now)
            if message is not None:
                topic.channel.log(bytes(self._store.serialize_cdr(message, topic.kind)), log_time=stamp)
        if session.run.interventions.configuration is not self._configuration:
            self._refresh_parameters()
            self._server.publish_parameter_values(list(self._parameters.values()))
        if self._is_recorded:
            self._send_playback(session)

    def _forget_all(self) -> None:
        for topic in self._topics.values():
            topic.forget()

    def _tell(self, text: str) -> None:
        """Show a problem in Foxglove."""
        self._server.publish_status(text, self._sdk.StatusLevel.Error)

    def _channel(self, name: str, kind: str) -> Any:
        definition, _ = self._store.generate_msgdef(kind, ros_version=2)
        schema = self._sdk.Schema(name=kind, encoding="ros2msg", data=definition.encode())
        return self._sdk.Channel(name, schema=schema, message_encoding="cdr", context=self._context)

    def _all_topics(self, session: Session) -> Iterator[Topic]:
        """Yield what to send on each channel."""

        def topic(
            name: str, version: Callable[[], Hashable], build: Callable[[int], Any], *, period_s: float = 0.0
        ) -> Topic:
            return Topic(self._channels[name], version, build, period_s=period_s)

        build = self._build
        view = _View(session, build)
        cycle = view.cycle
        yield topic("/clock", cycle, lambda stamp: _clock(build, stamp))
        yield topic("/tf_static", lambda: True, view.static_transforms)
        yield topic("/tf", view.moment, view.transforms)
        yield topic("/map", lambda: True, lambda stamp: build.map(stamp, session.scenario.map))
        yield topic("/odom", view.moment, view.odometry)
        yield topic("/cmd_vel", cycle, lambda _: build.twist(session.run.move_base.command))
        for name in ("global_costmap", "local_costmap"):
            updated = partial(view.costmap_time, name)
            yield topic(f"/{name}/costmap", updated, partial(view.costmap, name), period_s=COSTMAP_PERIOD_S)
        yield topic("/local_costmap/published_footprint", view.moment, view.footprint)
        yield topic("/plan", lambda: session.history.plan_count or None, view.plan)
        yield topic("/local_plan", view.local_cycle, view.local_plan)
        yield topic("/transformed_global_plan", view.transformed_cycle, view.transformed_plan)
        yield topic("/current_goal", view.goal, view.goal_pose)
        yield topic("/marker", view.moment, view.markers)
        for name in _sensor_topics(session.scenario.configuration):
            yield topic(f"/{name}", partial(view.reading_stamp, name), partial(view.reading, name))

    def _refresh_parameters(self) -> None:
        assert self._stage is not None
        session, parameter = self._stage.main, self._sdk.Parameter
        self._configuration = session.run.interventions.configuration
        listed = ((p["name"], p["value"]) for p in parameters.parameter_list(session))
        self._parameters = {name: parameter(name, value=value) for name, value in listed if value is not None}

    def _send_playback(self, session: Session, *, again: bool = False) -> None:
        status = self._web.PlaybackStatus
        state = status.Buffering if session.is_seeking else status.Paused if session.paused else status.Playing
        if session.time >= session.end and session.is_done:
            state = status.Ended
        made = self._web.PlaybackState(state, ns(session.time), _factor(session.speed), False, None)
        shown = self._playback
        self._playback = made
        if again or shown is None or (shown.status, shown.playback_speed) != (made.status, made.playback_speed):
            self._server.broadcast_playback_state(made)

    # --- in: called by foxglove-sdk, in threads of its own ---------------------------------------------------------------

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Send what the topic has to a new subscriber."""
        del client
        found = self._topics.get(channel.topic)
        if found is not None:
            self._tasks.append(found.forget)
        if self._watched is not None:
            self._watched()

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Do nothing."""

    def on_client_advertise(self, client: Any, channel: Any) -> None:
        """Remember what a client will publish."""
        self._advertised[client.id, channel.id] = channel

    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        """Forget what a client has published."""
        self._advertised.pop((client.id, client_channel_id), None)

    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        """Receive a message of a client."""
        channel = self._advertised.get((client.id, client_channel_id))
        if channel is not None:
            self._tasks.append(partial(self._receive, channel, data))

    def on_get_parameters(self, client: Any, param_names: list[str], request_id: str | None = None) -> list[Any]:
        """Return parameters: those named, or all."""
        del client, request_id
        known = self._parameters
        return [known[name] for name in param_names if name in known] if param_names else list(known.values())

    def on_set_parameters(self, client: Any, parameters: list[Any], request_id: str | None = None) -> list[Any]:
        """Change parameters in the next step; return those in force, which are sent again when they have changed."""
        values = {item.name: item.get_value() for item in parameters}
        self._tasks.append(partial(self._set, values))
        return self.on_get_parameters(client, list(values), request_id)

    def on_parameters_subscribe(self, param_names: list[str]) -> None:
        """Do nothing: all changes are sent."""

    def on_parameters_unsubscribe(self, param_names: list[str]) -> None:
        """Do nothing."""

    def on_playback_control_request(self, request: Any) -> Any:
        """Control the time of a recorded run in the next step; return what will hold then, or None before there is a run."""
        known = self._playback
        if known is None:
            return None
        self._tasks.append(partial(self._control, request))
        status, seek = self._web.PlaybackStatus, request.seek_time
        state = status.Paused if request.playback_command == self._web.PlaybackCommand.Pause else status.Playing
        if seek is not None:
            state = status.Buffering
        time_ns = known.current_time if seek is None else seek
        speed = request.playback_speed if request.playback_speed > 0.0 else known.playback_speed
        return self._web.PlaybackState(state, time_ns, speed, seek is not None, request.request_id)

    # --- what the callbacks leave, in the thread of the simulation ------------------------------------------------------

    def _request(self, **fields: Any) -> None:
        """Carry out a request as if a page had sent it. Raises NavError."""
        assert self._stage is not None
        request = messages.read_request(json.dumps(fields))
        if self._read_only and request.type not in messages.READ_ONLY:
            raise InputError("this server is read-only: clients can look, but not take part")
        try:
            self._stage.request(request)
        except ValueError as error:
            raise InputError(str(error).strip().partition("\n")[0]) from None

    def _receive(self, channel: Any, data: bytes) -> None:
        if self._stage is None:
            raise InputError("the robot is not ready yet; wait until its topics are there")
        topic = "/" + channel.topic.strip("/")
        if topic not in RECEIVED:
            raise InputError(f"{topic} is not received; publish on {', '.join(RECEIVED)}")
        kind, request = RECEIVED[topic]
        package, _, name = str(channel.schema_name).rpartition("/")
        if f"{package.removesuffix('/msg')}/msg/{name}" != kind:
            raise InputError(f"{topic} takes {kind}, not {channel.schema_name}")
        try:
            message = self._decoded(channel.encoding, data, kind)
            frame, pose = msg.frame_of(message), message.pose.pose if kind == POSE_ESTIMATE else message.pose
            found = require_finite_pose(msg.pose_of(pose), "pose")
        except Exception as error:  # whatever a client sends
            text = error.message if isinstance(error, NavError) else f"{type(error).__name__}: {error}"
            raise InputError(f"a message on {topic} cannot be read: {text}"[:300]) from None
        robot = self._stage.main.run.robot
        if frame not in ("", robot.map_frame):
            found = robot.frames.lookup(robot.map_frame, frame).apply(found)
        self._request(type=request, pose=list(found))

    def _decoded(self, encoding: str, data: bytes, kind: str) -> Any:
        if encoding == "cdr":
            return self._store.deserialize_cdr(data, kind)
        if encoding == "json":
            return json.loads(data, object_hook=lambda fields: SimpleNamespace(**fields))
        raise InputError(f'the encoding "{encoding}" is not cdr or json')

    def _set(self, values: dict[str, Any]) -> None:
        try:
            self._request(type="set", values=values)
        finally:
            known = self._parameters
            self._server.publish_parameter_values([known[name] for name in values if name in known])

    def _control(self, request: Any) -> None:
        assert self._stage is not None
        session, command = self._stage.main, self._web.PlaybackCommand
        if request.seek_time is not None:
            self._request(type="seek", time=max(0.0, 1e-9 * (request.seek_time - EPOCH_NS)))
        self._request(type="pause", paused=request.playback_command == command.Pause)
        if request.playback_speed > 0.0 and request.playback_speed != _factor(session.speed):
            self._request(type="speed", factor=float(request.playback_speed))
        self._send_playback(session, again=True)  # the client was told what it asked for, and now what holds


def _sensor_topics(configuration: Configuration) -> dict[str, str]:
    """Return the topics of the sensors that the costmaps listen to, and their types."""
    found = sensor_topics(configuration).values()
    return dict(sorted({(sensor.name.strip("/"), sensor.type) for sensor in found}))


def _topics_of(configuration: Configuration) -> dict[str, str]:
    return TOPICS | {f"/{name}": kind for name, kind in _sensor_topics(configuration).items()}


def _factor(speed: float | None) -> float:
    """Return the speed as a factor; as fast as possible is 0."""
    return 0.0 if speed is None else float(speed)


class _View:
    """The messages of a session, by topic; each method takes the stamp (ns)."""

    def __init__(self, session: Session, build: MessageBuilder) -> None:
        self._session, self._build = session, build
        self._odom = odometry_frame(session.scenario.configuration)

    # --- what tells that there is something new -------------------------------------------------------------------------

    def cycle(self) -> Hashable:
        return self._session.restarts, self._session.cycles

    def moment(self) -> Hashable:
        """Also something that a person has done while the time stands still."""
        return self._session.restarts, self._session.cycles, self._session.changes

    def local_cycle(self) -> Hashable:
        local = self._session.run.move_base.local_plan
        return None if local is None or local.trajectory is None else self.cycle()

    def transformed_cycle(self) -> Hashable:
        local = self._session.run.move_base.local_plan
        return None if local is None or local.local_plan is None else self.cycle()

    def goal(self) -> Hashable:
        targets = [tuple(sent.target) for sent in self._session.run.goals.under_way if sent.target is not None]
        return targets[0] if targets else None

    def costmap_time(self, name: str) -> Hashable:
        costmap = getattr(self._session.run.move_base, name)
        return costmap.updated_at if isinstance(costmap, LayeredCostmap) else None

    def reading_stamp(self, topic: str) -> Hashable:
        found = self._session.history.readings.get(topic)
        return None if found is None else (self._session.restarts, found.stamp)

    # --- messages -------------------------------------------------------------------------------------------------------

    def _chain(self) -> list[str]:
        robot = self._session.run.robot
        return list(dict.fromkeys((robot.map_frame, self._odom, robot.base_frame)))

    def transforms(self, stamp: int) -> Any:
        """Return map -> odom -> base."""
        frames, chain = self._session.run.robot.frames, self._chain()
        pairs = itertools.pairwise(chain)
        return self._build.transforms([(stamp, a, b, frames.lookup(a, b), 0.0) for a, b in pairs])

    def static_transforms(self, stamp: int) -> Any:
        robot, chain = self._session.run.robot, self._chain()
        heights = self._session.scenario.configuration.navstack.sim.scan_heights
        items: list[tuple[int, str, str, Transform2D, float]] = []
        for frame in robot.frames.frames():
            if frame in chain:
                continue
            try:
                at = robot.frames.lookup(robot.base_frame, frame)
            except NavError:
                continue  # a log may have frames of something else
            items.append((stamp, robot.base_frame, frame, at, heights.get(frame, 0.0)))
        return self._build.transforms(items)

    def odometry(self, stamp: int) -> Any:
        robot = self._session.run.robot
        state = robot.state()
        return self._build.odometry(stamp, self._odom, robot.base_frame, state.pose, state.velocity)

    def footprint(self, stamp: int) -> Any:
        robot, costmap = self._session.run.robot, self._session.run.move_base.local_costmap
        pose = robot.frames.lookup(costmap.frame, robot.base_frame)
        return self._build.polygon(stamp, costmap.frame, pose.apply_points(costmap.footprint.vertices))

    def costmap(self, name: str, stamp: int) -> Any:
        return self._build.costmap(stamp, getattr(self._session.run.move_base, name).master)

    def plan(self, stamp: int) -> Any:
        _, poses = self._session.history.plans[-1]
        return self._build.path(stamp, self._session.run.move_base.global_costmap.frame, poses)

    def local_plan(self, stamp: int) -> Any:
        return self._build.path(stamp, self._session.run.move_base.local_costmap.frame, self._trajectory())

    def _trajectory(self) -> Any:
        local = self._session.run.move_base.local_plan
        if local is None or local.trajectory is None:
            return np.empty((0, 3))
        return np.asarray(local.trajectory, np.float64)

    def transformed_plan(self, stamp: int) -> Any:
        local = self._session.run.move_base.local_plan
        assert local is not None and local.local_plan is not None
        return self._build.path(stamp, local.local_plan.frame, local.local_plan.poses)

    def goal_pose(self, stamp: int) -> Any:
        frame, goal = self._session.run.move_base.global_costmap.frame, self.goal()
        assert isinstance(goal, tuple)
        return self._build.pose_stamped(stamp, frame, Pose2D(*goal))

    def markers(self, stamp: int) -> Any:
        """Return the trajectory of the command and the outlines of the obstacles that are not in the map."""
        build, session = self._build, self._session
        robot = session.run.robot
        frame = session.run.move_base.local_costmap.frame
        arrays = [build.line_marker(stamp, frame, "trajectory", self._trajectory())]
        outlines = [(shape.name or f"shape {n}", shape.outline()) for n, shape in enumerate(session.shapes, 1)]
        if robot.world.moves:
            world, solids = robot.world, robot.solids
            around = np.linspace(0.0, 2.0 * np.pi, 17)
            ring = np.column_stack((np.cos(around), np.sin(around)))
            discs = enumerate(solids.discs.tolist())
            outlines += [(world.name_of("disc", n), np.array([x, y]) + r * ring) for n, (x, y, r, *_) in discs]
            count = len(solids.circles)
            outlines += [(world.name_of("polygon", n), solids.polygon(n)) for n in range(count)]
        arrays += [
            build.line_marker(stamp, robot.map_frame, name, _closed(np.asarray(line)), rgb=SHAPE_COLOR)
            for name, line in outlines
        ]
        clear = build.line_marker(stamp, robot.map_frame, "", np.empty((0, 2)))
        clear.markers[0].action = DELETE_ALL
        found = [clear.markers[0], *(array.markers[0] for array in arrays if len(array.markers[0].points) > 1)]
        return build.of("visualization_msgs/msg/MarkerArray", markers=found)

    # --- sensors ------------------------------------------------------------------------------------------------------

    def reading(self, topic: str, stamp: int) -> Any:
        del stamp
        data: SensorData = self._session.history.readings[topic]
        at = ns(data.stamp)
        if isinstance(data, LaserScan):
            return self._build.scan(at, data)
        return self._build.cloud(at, data) if isinstance(data, PointCloud) else self._build.range(at, data)


def _closed(points: Any) -> Any:
    return np.concatenate((points, points[:1])) if len(points) else points


def _clock(build: MessageBuilder, stamp: int) -> Any:
    return build.of("rosgraph_msgs/msg/Clock", clock=build.time(stamp))
