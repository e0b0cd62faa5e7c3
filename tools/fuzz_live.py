#!/usr/bin/env python
"""Fuzz the server of `navstack live`: wrong messages and broken connections must not disturb the session.

    python tools/fuzz_live.py --messages 100000 --connections 10000 --seed 1

Exits with 1 if the server hangs, shows a traceback, or the session differs afterwards.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import sys
import time
from typing import Any

import aiohttp

from navstack.live import Gate, LiveServer, Options, Session, Stage, messages, serve

TYPES = [key for key in messages.schema()["request"]["discriminator"]["mapping"] if key != "hello"]
VALUES: list[Any] = [
    *(
        None,
        True,
        False,
        0,
        -1,
        1,
        2**53,
        2**80,
        1e308,
        -1e-308,
        0.5,
        "",
        "x",
        "../../etc/passwd",
        "\0",
        "é" * 50,
        "x" * 5000,
    ),
    *([], {}, [1, 2, 3], [[1, 2], [3]], [None], [1e9, 1e9, 1e9], {"a": 1}, [[]] * 50, {"x": {"y": {"z": []}}}),
]
FIELDS = [
    "pose",
    "goals",
    "loop",
    "shape",
    "name",
    "values",
    "params",
    "velocity",
    "seconds",
    "paused",
    "factor",
    "time",
]
FIELDS += [
    "x",
    "y",
    "costmap",
    "sample",
    "number",
    "what",
    "places",
    "layers",
    "rate",
    "frame",
    "protocol",
    "duration",
    "id",
    "node",
    "start",
    "end",
    "both_ways",
    "nodes",
    "edges",
    "step",
    "spacing",
]
PLAIN = [
    {"type": "goal", "pose": [1.0, 7.4]},
    {"type": "put", "shape": {"name": "a", "radius": 0.2, "pose": [3.0, 7.4]}},
    {"type": "set", "values": {"DWAPlannerROS/max_vel_x": 0.4}},
    {"type": "queue", "goals": [[1.0, 7.4]], "loop": True},
    {"type": "save", "what": "scenario", "name": "x"},
    {"type": "explain_cell", "x": 1.0, "y": 7.4},
    {"type": "layers", "layers": ["local"], "rate": 10.0},
    {"type": "graph_add_node", "x": 1.0, "y": 7.4},
    {"type": "graph_move_node", "node": 0, "x": 1.0, "y": 7.4},
    {"type": "graph_connect", "start": 0, "end": 1, "both_ways": True},
    {"type": "graph_delete", "nodes": [0], "edges": [2]},
    {"type": "graph_set", "edges": [2], "values": {"speed_limit": 0.5}},
    {"type": "graph_save", "name": "x"},
    {"type": "graph_drive", "node": 1},
    {"type": "step_now", "step": {"cover": "all"}},
]
BROKEN = ["[" * 20000, '{"type":' * 3000, "nul", "NaN", "[]", "1", '"goal"', "{}", '{"type":"goal","type":1}']
ANSWER_S = 60.0
"""A server that does not answer for this long hangs (s)."""


class Fuzzer:
    """Sends wrong messages to a server, and breaks connections."""

    def __init__(self, address: str, rng: random.Random) -> None:
        self.address, self.rng = address, rng
        self.port = int(address.split(":")[2].split("/")[0])
        self.sent = self.refused = 0

    def text(self) -> str:
        """Returns one message: valid JSON with wrong contents, or no JSON at all. None of them is carried out."""
        rng, kind = self.rng, self.rng.randrange(5)
        if kind == 0:
            return "".join(chr(rng.randrange(1, 0x2FF)) for _ in range(rng.randrange(1, 200)))
        if kind == 1:
            text = json.dumps(rng.choice(PLAIN))
            return text[: rng.randrange(len(text))]
        if kind == 2:
            return rng.choice(
                ["[" * 20000, '{"type":' * 3000, "nul", "NaN", "[]", "1", '"goal"', "{}", '{"type":"goal","type":1}']
            )
        fields = {name: rng.choice(VALUES) for name in rng.sample(FIELDS, rng.randrange(1, 5))}
        message = {"type": rng.choice([*TYPES, "nothing", 5, None]), **fields, "unknown": 1}
        if kind == 4:
            message = {**rng.choice(PLAIN), **fields, "surplus": rng.choice(VALUES)}
        return json.dumps(message)

    async def messages(self, client: aiohttp.ClientSession, count: int) -> None:
        """Sends `count` messages; each must be refused with a reason."""
        socket = await self._connect(client)
        for number in range(count):
            if number % 150 == 149:  # the server limits the rate, and closes after many refused messages
                await socket.close()
                socket = await self._connect(client)
            await socket.send_str(self.text())
            self.sent += 1
            while True:
                reply = await socket.receive(timeout=ANSWER_S)
                if reply.type is aiohttp.WSMsgType.BINARY:
                    continue
                if reply.type is not aiohttp.WSMsgType.TEXT:
                    socket = await self._connect(client)
                    break
                answer = json.loads(reply.data)
                if answer["type"] == "answer":
                    assert not answer["ok"], answer
                    assert answer["text"] and "Traceback" not in answer["text"], answer
                    self.refused += 1
                    break
        await socket.close()

    async def connections(self, count: int) -> None:
        """Opens `count` connections and breaks them at any point."""
        for _ in range(count):
            reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
            head = (
                f"GET /socket HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\nOrigin: http://127.0.0.1:{self.port}\r\n"
                "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
            ).encode()
            kind = self.rng.randrange(5)
            if kind == 0:
                writer.write(head[: self.rng.randrange(len(head))])
            elif kind == 1:
                writer.write(os.urandom(self.rng.randrange(1, 400)))
            else:
                writer.write(head)
                await writer.drain()
                await asyncio.wait_for(reader.read(100), ANSWER_S)
                writer.write(bytes(self.rng.randrange(256) for _ in range(self.rng.randrange(0, 60))))
            try:
                await writer.drain()
                if self.rng.random() < 0.5:
                    writer.transport.abort()
                else:
                    writer.close()
                    await asyncio.wait_for(writer.wait_closed(), ANSWER_S)
            except ConnectionError:
                pass

    async def _connect(self, client: aiohttp.ClientSession) -> aiohttp.ClientWebSocketResponse:
        origin = f"http://127.0.0.1:{self.port}"
        socket = await client.ws_connect(self.address + "socket", headers={"Origin": origin}, autoping=True)
        await socket.send_json({"type": "hello", "protocol": messages.PROTOCOL})
        while (await socket.receive(timeout=ANSWER_S)).type is not aiohttp.WSMsgType.TEXT:
            pass
        return socket


async def _main(arguments: argparse.Namespace) -> int:
    from navstack.core import Pose2D
    from navstack.map_io import load_map, map_path
    from navstack.parameters import load_configuration
    from navstack.scenario import Scenario

    scenario = Scenario(load_map(map_path("office")), load_configuration(["turtlebot"]), Pose2D(0.8, 7.45, 0.0), ())
    session = Session(scenario)
    server = LiveServer(Stage([session], Options()), Gate("127.0.0.1"))
    stop, ready = asyncio.Event(), asyncio.get_running_loop().create_future()
    task = asyncio.create_task(serve(server, "127.0.0.1", 0, ready=ready.set_result, stop=stop))
    fuzzer = Fuzzer(str(await ready), random.Random(arguments.seed))
    draft = server.stage.graph.draft if server.stage is not None else None
    assert draft is not None
    before, started = (session.time, session.cycles, list(session.interactions), draft.version), time.monotonic()
    async with aiohttp.ClientSession() as client:
        await fuzzer.messages(client, arguments.messages)
        print(f"{fuzzer.sent} messages, {fuzzer.refused} refused, {time.monotonic() - started:.1f} s", flush=True)
        await fuzzer.connections(arguments.connections)
        print(f"{arguments.connections} broken connections, {time.monotonic() - started:.1f} s", flush=True)
    stop.set()
    await task
    same = before == (session.time, session.cycles, list(session.interactions), draft.version)
    print("the session is as before" if same else "THE SESSION HAS CHANGED")
    return 0 if same else 1


def main() -> int:
    """Runs the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--connections", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    return asyncio.run(_main(parser.parse_args()))


if __name__ == "__main__":
    sys.exit(main())
