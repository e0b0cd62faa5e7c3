"""`navstack live` as a process: a recorded run with its time line; wrong input gets one sentence."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from navstack.cli.app import run
from navstack.scenario import load_scenario, run_scenario

pytest.importorskip("aiohttp")

CORRIDOR = "map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[2.8, 7.45, 0.0]]\n"


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """The folder of a run."""
    file = tmp_path / "corridor.yaml"
    file.write_text(CORRIDOR, encoding="utf-8")
    recorder = run_scenario(load_scenario(file)).recorder
    assert recorder is not None
    recorder.save(tmp_path / "run")
    return tmp_path / "run"


@pytest.fixture
def server(recorded: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`navstack live RUN` without a display, and its address."""
    hidden = ("DISPLAY", "WAYLAND_DISPLAY")
    process = subprocess.Popen(
        [sys.executable, "-m", "navstack", "live", str(recorded), "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={name: value for name, value in os.environ.items() if name not in hidden},
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    found = re.search(r"http://\S+", line)
    assert found is not None, process.communicate()
    yield process, found[0]
    if process.poll() is None:
        process.kill()
        process.communicate()


async def conversation(address: str) -> list[dict[str, Any]]:
    """What a page hears: the world, the first frame, the answers, and a frame after going to 4 s."""
    import aiohttp

    from navstack.live.messages import PROTOCOL, decode

    async with aiohttp.ClientSession() as client:
        page = await client.ws_connect(address + "socket", headers={"Origin": address.rstrip("/")})
        await page.send_json({"type": "hello", "protocol": PROTOCOL, "id": 1})
        heard: list[dict[str, Any]] = []
        while True:
            message = await page.receive(timeout=60.0)
            assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY)
            if message.type is aiohttp.WSMsgType.TEXT:
                heard.append(json.loads(message.data))
                continue
            header = decode(message.data)[0]
            heard.append(header)
            if header["type"] != "frame":
                continue
            side = header["sides"][0]
            await page.send_json({"type": "ack", "frame": header["frame"]})
            if header["frame"] == 1:
                await page.send_json({"type": "goal", "pose": [1.0, 7.4], "id": 2})
                await page.send_json({"type": "seek", "time": 4.0, "id": 3})
            elif not side["seeking"] and abs(side["t"] - 4.0) < 0.3:
                return heard


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_a_recorded_run_shows_a_time_line(server: tuple[subprocess.Popen[str], str]) -> None:
    process, address = server
    # in a thread of its own: Playwright leaves a running loop in that of the browser tests
    with ThreadPoolExecutor(1) as pool:
        heard = pool.submit(asyncio.run, conversation(address)).result()
    world = next(message for message in heard if message["type"] == "world")
    assert world["fixed"] and world["name"]
    first = next(message for message in heard if message["type"] == "frame")["sides"][0]
    assert first["paused"] and first["t"] == 0.0 and first["end"] > 5.0
    answers = {message["id"]: message for message in heard if message["type"] == "answer"}
    assert not answers[2]["ok"] and "recorded run" in answers[2]["text"]
    assert answers[3]["ok"]
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60.0)
    assert process.returncode == 0 and "Traceback" not in out + err
    assert "there is no display here; open the address in a browser" in " ".join(err.split())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nowhere"], '"nowhere"'),
        (["RUN", "--versus", "turtlebot"], "--versus needs a scenario or a map, not a recorded run"),
        (
            ["office", "--versus", "turtlebat"],
            '"turtlebat" is not a file, folder or packaged set; did you mean "turtlebot"',
        ),
        (["office", "--speed", "0"], "is not a factor above 0"),
    ],
)
def test_wrong_input_gets_one_sentence(
    arguments: list[str], sentence: str, recorded: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(["live", *(str(recorded) if word == "RUN" else word for word in arguments)]) == 2
    said = " ".join(capfd.readouterr().err.split())
    assert sentence in said and "Traceback" not in said


@pytest.mark.slow
def test_a_used_port_gets_one_sentence(recorded: Path) -> None:
    with socket.socket() as used:
        used.bind(("127.0.0.1", 0))
        used.listen()
        port = used.getsockname()[1]
        command = [sys.executable, "-m", "navstack", "live", str(recorded), "--no-open", "--port", str(port)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    said = " ".join(done.stderr.split())
    assert done.returncode == 2 and f"port {port} is in use" in said and "Traceback" not in said
