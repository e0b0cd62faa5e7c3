"""Environments on the live page: the same bits as without it, and every episode with its world."""

from __future__ import annotations

import asyncio
import json
import threading
from typing import Any

import aiohttp
import numpy as np
import pytest

from navstack.core import InputError
from navstack.gym import LocalControlEnv, PlannerParamsEnv
from navstack.live import messages

pytestmark = pytest.mark.slow


class Viewer:
    """A page, as fast as possible, that keeps what it gets."""

    def __init__(self, address: str) -> None:
        self.worlds: list[dict[str, Any]] = []
        self.sides: list[dict[str, Any]] = []
        self.answers: list[dict[str, Any]] = []
        self._more = threading.Condition()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._watch(address)), daemon=True)
        self._thread.start()

    def wait_for(self, text: str) -> None:
        """Wait for an event."""
        with self._more:
            assert self._more.wait_for(lambda: any(event.startswith(text) for event in self.events), timeout=60.0)

    def join(self) -> None:
        """Wait until the server has closed the page."""
        self._thread.join(60.0)
        assert not self._thread.is_alive()

    @property
    def events(self) -> list[str]:
        return [event[3] for side in self.sides for event in side.get("events", ())]

    async def _watch(self, address: str) -> None:
        async with (
            aiohttp.ClientSession() as client,
            client.ws_connect(f"{address}socket", headers={"Origin": address.rstrip("/")}) as socket,
        ):
            await socket.send_json({"type": "hello", "protocol": messages.PROTOCOL, "id": 1})
            await socket.send_json({"type": "layers", "id": 2, "layers": ["scan", "local"], "rate": 60})
            asked = False
            async for message in socket:
                if message.type is aiohttp.WSMsgType.TEXT:
                    self.answers.append(json.loads(message.data))
                    continue
                header, _ = messages.decode(message.data)
                if header["type"] == "world":
                    self.worlds.append(header)
                    if not asked:
                        asked = True
                        await socket.send_json({"type": "speed", "id": 3, "factor": None})
                        await socket.send_json(
                            {"type": "explain_cell", "id": 4, "x": 1.3, "y": 3.5, "costmap": "local"}
                        )
                else:
                    with self._more:
                        self.sides += header["sides"]
                        self._more.notify_all()
                    await socket.send_json({"type": "ack", "frame": header["frame"]})


def drive(env: Any, action: list[float], episodes: int = 2) -> tuple[list[bytes], Viewer | None]:
    """Observations and rewards of episodes, each in another level; with a viewer if there is a page."""
    found, viewer = [], None
    for level in range(episodes):
        observation, info = env.reset(seed=level, options={"level": level})
        if viewer is None and env.render_mode == "live":
            viewer = Viewer(env._watch.address)
        if viewer is not None:
            viewer.wait_for(f"episode: {env.levels[level]}")
        while "outcome" not in info:
            observation, reward, _, _, info = env.step(np.array(action, np.float32))
            parts = observation.values() if isinstance(observation, dict) else [observation]
            found.append(b"".join([*(part.tobytes() for part in parts), np.float64(reward).tobytes()]))
        if viewer is not None:
            viewer.wait_for(info["outcome"])
    assert env.render() is None
    return found, viewer


def test_an_agent_without_the_stack() -> None:
    options: dict[str, Any] = {"levels": ["barn", "narrow"], "count": 1, "beams": 30, "max_episode_steps": 15}
    alone, _ = drive(LocalControlEnv(**options), [0.5, 0.1])
    env = LocalControlEnv(render_mode="live", **options)
    watched, viewer = drive(env, [0.5, 0.1])
    assert watched == alone and 16 < len(watched) < 30  # a collision, and the limit
    with pytest.raises(InputError, match="outside"):
        env.reset()
        env.step(np.array([2.0, 0.0], np.float32))
    env.close()
    assert viewer is not None
    viewer.join()
    names = [world["name"] for world in viewer.worlds]
    assert names[:2] == ["world 0", "narrow 0"] and all(world["fixed"] for world in viewer.worlds)
    assert "episode: narrow 0" in viewer.events
    assert any(text.startswith("timeout after 1.5 s, return ") for text in viewer.events), viewer.events
    answers = {answer.get("id"): answer for answer in viewer.answers}
    assert answers[3]["ok"] and not answers[4]["ok"] and "no costmaps here" in answers[4]["text"]
    shown = [side for side in viewer.sides if side.get("shapes")]
    assert len(shown[0]["shapes"]) > 100  # the cylinders
    assert max(side["t"] for side in viewer.sides) >= 1.4
    with pytest.raises(InputError, match="the environment is closed"):
        env.reset()


def test_an_agent_beside_the_stack() -> None:
    options: dict[str, Any] = {
        "levels": "narrow",
        "count": 2,
        "parameters": ["DWAPlannerROS/max_vel_x=0.2:0.5"],
        "max_episode_steps": 3,
    }
    alone, _ = drive(PlannerParamsEnv(**options), [1.0])
    env = PlannerParamsEnv(render_mode="live", **options)
    watched, viewer = drive(env, [1.0])
    assert watched == alone and len(watched) == 6
    env.close()
    env.close()
    assert viewer is not None
    viewer.join()
    assert [world["name"] for world in viewer.worlds] == ["narrow 0", "narrow 2"]
    assert any("local" in side.get("costmaps", {}) for side in viewer.sides)
    assert any(side.get("plans") for side in viewer.sides)
    answers = {answer.get("id"): answer for answer in viewer.answers}
    assert answers[4]["ok"], answers[4]


def test_wrong_arguments_and_ports() -> None:
    with pytest.raises(InputError, match='render_mode is "human"; it must be None, "rgb_array" or "live"'):
        PlannerParamsEnv(levels="narrow", count=1, render_mode="human")
    with pytest.raises(InputError, match=r"port is 70000; it must be a whole number of 0 \.\. 65535"):
        LocalControlEnv(count=1, render_mode="live", port=70000)
    first = LocalControlEnv(count=1, render_mode="live")
    first.reset(seed=0)
    assert first._watch is not None
    port = int(first._watch.address.split(":")[2].strip("/"))
    second = LocalControlEnv(count=1, render_mode="live", port=port)
    with pytest.raises(InputError, match=f"port {port} is in use"):
        second.reset(seed=0)
    first.close()
    second.close()
