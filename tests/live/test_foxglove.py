"""A client of Foxglove's protocol sees the session with messages of ROS 2, and takes part."""

from __future__ import annotations

import asyncio
import json
import socket
import struct
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import pytest

from navstack.core import InputError
from navstack.live.foxglove import EPOCH_NS, REPEAT_S, FoxgloveServer
from navstack.live.logged import LoggedSession
from navstack.live.server import Gate, LiveServer, serve
from navstack.live.session import Session
from navstack.live.stage import Options, Stage
from navstack.logs import typestore
from navstack.ros_messages import MessageBuilder
from navstack.ros_messages import messages as msg
from navstack.scenario import Scenario
from tests.replay.test_replay import Maker, record_of, replayed

pytest.importorskip("foxglove")
pytestmark = pytest.mark.slow
STORE = typestore(ros1=False)
BUILD = MessageBuilder(STORE, ros1=False)
LIMIT_S = 240.0
OF_NAV2 = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/odom": "nav_msgs/msg/Odometry",
    "/cmd_vel": "geometry_msgs/msg/Twist",
    "/scan": "sensor_msgs/msg/LaserScan",
    "/global_costmap/costmap": "nav_msgs/msg/OccupancyGrid",
    "/local_costmap/costmap": "nav_msgs/msg/OccupancyGrid",
    "/local_costmap/published_footprint": "geometry_msgs/msg/PolygonStamped",
    "/plan": "nav_msgs/msg/Path",
    "/local_plan": "nav_msgs/msg/Path",
    "/transformed_global_plan": "nav_msgs/msg/Path",
    "/current_goal": "geometry_msgs/msg/PoseStamped",
    "/marker": "visualization_msgs/msg/MarkerArray",
}


class Client:
    """A client of the protocol: it keeps the last message of each topic."""

    def __init__(self, ws: aiohttp.ClientWebSocketResponse) -> None:
        self._ws = ws
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.last: dict[str, Any] = {}
        self.counts: dict[str, int] = {}
        self.stamps: dict[str, int] = {}
        self.texts: list[dict[str, Any]] = []
        self.states: list[tuple[int, int, float]] = []
        """Playback: status, time (ns), speed."""
        self._ids: dict[int, str] = {}
        self._published: dict[tuple[str, str], int] = {}

    async def until(self, condition: Callable[[], Any]) -> Any:
        """Receive until a condition holds; return what it returns."""
        while not (found := condition()):
            self._take(await self._ws.receive(timeout=LIMIT_S))
        return found

    def _take(self, message: aiohttp.WSMessage) -> None:
        if message.type is aiohttp.WSMsgType.TEXT:
            data = json.loads(message.data)
            self.texts.append(data)
            if data["op"] == "serverInfo":
                self.info = data
            elif data["op"] == "advertise":
                self.channels |= {channel["topic"]: channel for channel in data["channels"]}
            return
        assert message.type is aiohttp.WSMsgType.BINARY, message
        opcode = message.data[0]
        if opcode == 1:
            number, stamp = struct.unpack_from("<IQ", message.data, 1)
            topic = self._ids[number]
            self.last[topic] = STORE.deserialize_cdr(message.data[13:], self.channels[topic]["schemaName"])
            self.stamps[topic] = stamp
            self.counts[topic] = self.counts.get(topic, 0) + 1
        elif opcode == 5:
            self.states.append(struct.unpack_from("<BQf", message.data, 1))

    async def subscribe(self, *topics: str) -> None:
        """Subscribe to topics that are advertised."""
        await self.until(lambda: set(topics) <= set(self.channels))
        wanted = [{"id": len(self._ids) + n, "channelId": self.channels[t]["id"]} for n, t in enumerate(topics)]
        self._ids |= {item["id"]: topic for item, topic in zip(wanted, topics, strict=True)}
        await self._ws.send_json({"op": "subscribe", "subscriptions": wanted})

    async def publish(self, topic: str, kind: str, data: bytes, *, encoding: str = "cdr") -> None:
        """Publish a message."""
        number = self._published.get((topic, encoding))
        if number is None:
            number = self._published[topic, encoding] = len(self._published) + 1
            channel = {"id": number, "topic": topic, "encoding": encoding, "schemaName": kind}
            await self._ws.send_json({"op": "advertise", "channels": [channel]})
        await self._ws.send_bytes(struct.pack("<BI", 1, number) + data)

    async def send(self, **message: Any) -> None:
        await self._ws.send_json(message)

    async def send_bytes(self, data: bytes) -> None:
        await self._ws.send_bytes(data)

    def told(self) -> str:
        """The last problem that the server has shown."""
        return next((text["message"] for text in reversed(self.texts) if text["op"] == "status"), "")


Body = Callable[[Callable[[], Awaitable[Client]], LiveServer], Awaitable[None]]


def served(session: Session, body: Body, **options: Any) -> None:
    """Runs `body` with a function that connects clients to a server of the session, without any page."""

    async def main() -> None:
        fixed = options.get("duration_s") is not None
        foxglove = FoxgloveServer("127.0.0.1", 0, session.scenario.configuration, **options)
        server = LiveServer(Stage([session], Options(fixed=fixed)), Gate("127.0.0.1"), foxglove=foxglove)
        stop, address = asyncio.Event(), asyncio.get_running_loop().create_future()
        task = asyncio.create_task(serve(server, "127.0.0.1", 0, ready=address.set_result, stop=stop))
        try:
            async with asyncio.timeout(LIMIT_S), aiohttp.ClientSession() as http:
                await address

                async def connect() -> Client:
                    url = f"ws://127.0.0.1:{foxglove.port}"
                    return Client(await http.ws_connect(url, protocols=["foxglove.sdk.v1"], max_msg_size=0))

                await body(connect, server)
        finally:
            stop.set()
            await task

    with ThreadPoolExecutor(1) as thread:  # the browser of other tests keeps an event loop in the main thread
        thread.submit(asyncio.run, main()).result()


def test_every_topic_has_its_type_and_content_and_a_late_client_gets_it_too(session: Session) -> None:
    session.set_speed(4.0)

    async def body(connect: Callable[[], Awaitable[Client]], server: LiveServer) -> None:
        began = time.monotonic()
        first = await connect()
        await first.subscribe(*OF_NAV2)
        assert {topic: first.channels[topic]["schemaName"] for topic in OF_NAV2} == OF_NAV2
        assert all(c["encoding"] == "cdr" and c["schemaEncoding"] == "ros2msg" for c in first.channels.values())
        await first.until(lambda: set(first.last) == set(OF_NAV2))
        await first.until(lambda: first.last["/odom"].pose.pose.position.x > 0.5)
        grid, told = session.scenario.map, first.last["/map"]
        assert (told.info.height, told.info.width) == grid.data.shape and np.array_equal(told.data, grid.data.ravel())
        costmap = first.last["/local_costmap/costmap"]
        assert costmap.header.frame_id == session.run.move_base.local_costmap.frame
        assert costmap.data.max() == 100 and costmap.info.resolution == pytest.approx(0.05)
        scan = first.last["/scan"]
        assert len(scan.ranges) > 100 and np.isfinite(scan.ranges).any()
        plan = first.last["/plan"].poses
        end = plan[-1].pose.position
        assert (end.x, end.y) == pytest.approx((4.8, 7.45), abs=0.1)
        assert first.last["/current_goal"].pose.position.x == 4.8
        assert len(first.last["/local_plan"].poses) > 5 and len(first.last["/transformed_global_plan"].poses) > 5
        assert len(first.last["/local_costmap/published_footprint"].polygon.points) >= 4
        assert first.last["/cmd_vel"].linear.x > 0.1
        edges = {(t.header.frame_id, t.child_frame_id) for t in first.last["/tf"].transforms}
        robot = session.run.robot
        assert edges == {(robot.map_frame, robot.odom_frame), (robot.odom_frame, robot.base_frame)}
        assert scan.header.frame_id in {t.child_frame_id for t in first.last["/tf_static"].transforms}
        names = [marker.ns for marker in first.last["/marker"].markers]
        assert names[1] == "trajectory"
        assert first.stamps["/odom"] >= EPOCH_NS

        late = await connect()
        await server.in_simulation(lambda: session.pause(True))
        await late.subscribe("/map", "/tf_static", "/global_costmap/costmap", "/plan")
        await late.until(lambda: len(late.last) == 4)
        assert np.array_equal(late.last["/map"].data, grid.data.ravel())
        assert first.counts["/map"] <= 2 + (time.monotonic() - began) / REPEAT_S  # not again with every frame

    served(session, body)


def goal_of(x: float, y: float, frame: str = "map") -> bytes:
    from navstack.core import Pose2D

    return bytes(STORE.serialize_cdr(BUILD.pose_stamped(0, frame, Pose2D(x, y, 0.0)), msg.POSE))


@pytest.mark.parametrize("topic", ["/goal_pose", "/move_base_simple/goal"])
def test_the_robot_drives_to_a_goal_of_a_client(office: Scenario, topic: str) -> None:
    session = Session(office)

    async def body(connect: Callable[[], Awaitable[Client]], server: LiveServer) -> None:
        client = await connect()
        await client.subscribe("/odom", "/current_goal")
        await client.until(lambda: "/odom" in client.last)
        await client.publish(topic, "geometry_msgs/msg/PoseStamped", goal_of(2.4, 7.45))
        await client.until(
            lambda: "/current_goal" in client.last and client.last["/current_goal"].pose.position.x == 2.4
        )
        await server.in_simulation(lambda: session.set_speed(8.0))
        tolerance = 0.15  # that of the goal and of the odometry
        await client.until(lambda: abs(client.last["/odom"].pose.pose.position.x - 2.4) < tolerance)
        assert session.interactions[-1].pose == pytest.approx([2.4, 7.45, 0.0])

    served(session, body)


def test_a_pose_estimate_in_json_puts_the_robot_there(session: Session) -> None:
    async def body(connect: Callable[[], Awaitable[Client]], server: LiveServer) -> None:
        client = await connect()
        await client.subscribe("/odom", "/tf")
        pose = {
            "position": {"x": 3.0, "y": 7.45, "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        }
        text = json.dumps({"header": {"frame_id": "map"}, "pose": {"pose": pose, "covariance": [0.0] * 36}})
        kind = "geometry_msgs/PoseWithCovarianceStamped"
        await client.publish("/initialpose", kind, text.encode(), encoding="json")
        await client.until(lambda: session.run.robot.pose.x > 2.5)

    served(session, body)


def test_what_cannot_be_used_is_said_and_changes_nothing(session: Session) -> None:
    async def body(connect: Callable[[], Awaitable[Client]], server: LiveServer) -> None:
        client = await connect()
        await client.subscribe("/map")
        await client.until(lambda: "/map" in client.last)
        for topic, kind, data, expected in (
            ("/goal_pose", "geometry_msgs/msg/PoseStamped", b"\0\1\0\0xx", "cannot be read"),
            ("/goal_pose", "geometry_msgs/msg/PoseStamped", goal_of(float("nan"), 0.0), "/goal_pose"),
            ("/goal_pose", "geometry_msgs/msg/PoseStamped", goal_of(1.0, 7.0, "moon"), "moon"),
            ("/initialpose", "geometry_msgs/msg/PoseStamped", goal_of(1.0, 7.0), "PoseWithCovarianceStamped"),
            ("/cmd_vel", "geometry_msgs/msg/Twist", b"", "/cmd_vel is not received"),
        ):
            client.texts.clear()
            await client.publish(topic, kind, data)
            assert expected in await client.until(client.told), expected
        assert not session.interactions

    served(session, body)


def test_parameters_are_read_and_changed(session: Session) -> None:
    async def body(connect: Callable[[], Awaitable[Client]], server: LiveServer) -> None:
        client = await connect()
        await client.subscribe("/map")
        await client.until(lambda: "/map" in client.last)
        await client.send(op="getParameters", parameterNames=[], id="all")

        def value(name: str) -> Any:
            sent = [text["parameters"] for text in client.texts if text["op"] == "parameterValues"]
            found = {p["name"]: p["value"] for parameters in sent for p in parameters}
            return found.get(name)

        name = "DWAPlannerROS/sim_time"
        assert await client.until(lambda: value(name)) == 1.0
        await client.send(op="subscribeParameterUpdates", parameterNames=[name])
        await client.send(op="setParameters", parameters=[{"name": name, "value": 2.25, "type": "float64"}])
        await client.until(lambda: value(name) == 2.25)
        assert session.interactions[-1].values == {name: 2.25}
        await client.send(op="setParameters", parameters=[{"name": name, "value": -1.0, "type": "float64"}])
        assert "sim_time" in await client.until(client.told)
        assert len(session.interactions) == 1

    served(session, body)


def test_a_client_from_before_the_stage_gets_the_parameters(session: Session) -> None:
    async def body() -> None:
        foxglove = FoxgloveServer("127.0.0.1", 0, session.scenario.configuration)
        try:
            async with asyncio.timeout(LIMIT_S), aiohttp.ClientSession() as http:
                url = f"ws://127.0.0.1:{foxglove.port}"
                client = Client(await http.ws_connect(url, protocols=["foxglove.sdk.v1"]))
                await client.until(lambda: client.info)
                before = client.info["sessionId"]
                foxglove.show(Stage([session], Options(fixed=False)), lambda: None)
                await client.until(lambda: client.info["sessionId"] != before)
                await client.send(op="getParameters", parameterNames=[], id="all")
                await client.until(
                    lambda: [t for t in client.texts if t["op"] == "parameterValues" and t["parameters"]]
                )
        finally:
            foxglove.stop()

    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, body()).result()


def test_a_rewind_starts_a_new_session_of_foxglove_with_everything(session: Session) -> None:
    async def body(connect: Callable[[], Awaitable[Client]], server: LiveServer) -> None:
        client = await connect()
        await client.subscribe("/map", "/clock")
        await client.until(lambda: client.counts.get("/clock", 0) > 3 and "/map" in client.last)
        before, count = client.info["sessionId"], client.counts["/map"]
        await server.in_simulation(session.restart)
        await client.until(lambda: client.info["sessionId"] != before)
        await client.subscribe("/map", "/clock")
        await client.until(lambda: client.counts["/map"] > count)

    served(session, body)


def control(seek_s: float | None, name: str, *, pause: bool = False, speed: float = 1.0) -> bytes:
    """A request of Foxglove's time line: play or pause, the speed, where to go."""
    seek = 0 if seek_s is None else EPOCH_NS + round(seek_s * 1e9)
    head = struct.pack("<BBfBQI", 3, int(pause), speed, seek_s is not None, seek, len(name))
    return head + name.encode()


async def control_the_time(client: Client, session: Session, *topics: str) -> None:
    """Goes to 2 s, to 1 s, pauses and plays to the end, by the time line of Foxglove; what is shown is of that time."""
    playing, paused, buffering, ended = range(4)
    await client.subscribe("/clock", *topics)
    assert "clientPublish" not in client.info["capabilities"] and "playbackControl" in client.info["capabilities"]
    await client.until(lambda: client.states and client.states[-1][0] == paused)

    async def go_to(at: float) -> None:
        client.last.clear()
        client.states.clear()
        await client.send_bytes(control(at, "go", pause=True))
        wanted = EPOCH_NS + round(at * 1e9)
        await client.until(lambda: (buffering, wanted) in [state[:2] for state in client.states])
        await client.until(lambda: client.states[-1][0] == paused and 0 <= client.states[-1][1] - wanted < 4 * 10**8)
        await client.until(lambda: 0 <= client.stamps.get("/clock", 0) - wanted < 4 * 10**8)

    await go_to(2.0)
    await go_to(1.0)
    await client.until(lambda: set(topics) <= set(client.last))  # after the way back all of it comes again
    await client.send_bytes(control(None, "play", speed=4.0))
    await client.until(lambda: (playing, 4.0) in [(state[0], state[2]) for state in client.states])
    await client.until(lambda: client.states[-1][0] == ended)
    assert session.is_done and session.speed == 4.0
    assert not client.told(), client.told()


def test_the_time_of_a_recorded_run(session: Session) -> None:
    while session.time < 3.0:
        session.step_once()
    session.seek(0.0)
    session.finish_seek()
    session.pause(True)

    async def body(connect: Callable[[], Awaitable[Client]], server: LiveServer) -> None:
        await control_the_time(await connect(), session, "/scan", "/plan", "/current_goal", "/local_costmap/costmap")

    served(session, body, duration_s=3.0)


def test_the_time_of_the_replay_of_a_log(tmp_path: Path) -> None:
    record = record_of(replayed(Maker(tmp_path / "robot.bag").write()))
    session = LoggedSession(record)

    async def body(connect: Callable[[], Awaitable[Client]], server: LiveServer) -> None:
        client = await connect()
        assert set(OF_NAV2) <= set(await client.until(lambda: client.channels))
        await control_the_time(client, session, *(set(OF_NAV2) - {"/clock", "/local_plan"}))
        assert client.last["/odom"].pose.pose.position.x == pytest.approx(record.pose_at(session.time).x, abs=0.05)

    served(session, body, duration_s=float(record.times[-1]))


def test_read_only_takes_no_goals_and_no_parameters(session: Session) -> None:
    async def body(connect: Callable[[], Awaitable[Client]], server: LiveServer) -> None:
        client = await connect()
        await client.subscribe("/map")
        await client.until(lambda: "/map" in client.last)
        assert "clientPublish" not in client.info["capabilities"]
        parameter = {"name": "DWAPlannerROS/sim_time", "value": 2.5, "type": "float64"}
        await client.send(op="setParameters", parameters=[parameter])
        assert "read-only" in await client.until(client.told)
        assert not session.interactions

    served(session, body, read_only=True)


def test_a_port_that_is_taken_and_a_missing_extra_are_one_sentence(
    office: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(InputError, match=r"cannot be served on 127.0.0.1:.*another port with --foxglove"):
            FoxgloveServer("127.0.0.1", taken.getsockname()[1], office.configuration)
    monkeypatch.setitem(__import__("sys").modules, "foxglove", None)
    with pytest.raises(InputError, match=r"needs foxglove-sdk, which is not installed; install the extra `foxglove`"):
        FoxgloveServer("127.0.0.1", 0, office.configuration)
