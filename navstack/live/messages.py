"""The protocol between server and page: every message as a model. The page reads the JSON schema of these models.

A page sends `Request`s as JSON; the server answers each with an `Answer` of the same `id`. Frames are binary (`frame.py`).
"""

from __future__ import annotations

import json
import re
import struct
import zlib
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from navstack.core import InputError, short_repr
from navstack.sim import Shape

PROTOCOL: Final = 2
"""Version of the protocol: server and page must have the same."""

Finite = Annotated[float, Field(ge=-1e6, le=1e6)]
Time = Annotated[float, Field(ge=0.0, le=1e7)]
Pose = Annotated[list[Finite], Field(min_length=2, max_length=3)]
Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9_][A-Za-z0-9_. -]*$")]


GraphId = Annotated[int, Field(ge=0, le=2**32 - 1)]
GraphIds = Annotated[list[GraphId], Field(max_length=20_000)]


class Message(BaseModel):
    """Base of all messages: strict, no unknown keys, no NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class _Request(Message):
    id: Annotated[int, Field(ge=0, le=2**53)] = 0


class _AboutOne(_Request):
    """About one of two robots (`--versus`)."""

    side: Annotated[int, Field(ge=0, le=1)] = 0


class Hello(_Request):
    """First message of a page."""

    type: Literal["hello"]
    protocol: int


class Layers(_Request):
    """Which layers the page shows, and at most how many frames per second it takes."""

    type: Literal["layers"]
    layers: Annotated[
        list[Literal["global", "local", "scan", "trajectories", "potential", "camera", "tree"]], Field(max_length=7)
    ]
    rate: Annotated[float, Field(ge=1.0, le=60.0)] = 30.0


class Acknowledge(_Request):
    """The page has drawn the frame with this number."""

    type: Literal["ack"]
    frame: Annotated[int, Field(ge=0, le=2**53)]


class Goal(_Request):
    """Drive to this pose now."""

    type: Literal["goal"]
    pose: Pose


class SetQueue(_Request):
    """Replace the queue of goals."""

    type: Literal["queue"]
    goals: Annotated[list[Pose], Field(max_length=200)]
    loop: bool = False


class CancelGoal(_Request):
    """Cancel the goal and empty the queue."""

    type: Literal["cancel"]


class Put(_Request):
    """Add or move an obstacle."""

    type: Literal["put"]
    shape: Shape


class Remove(_Request):
    """Remove an obstacle."""

    type: Literal["remove"]
    name: Annotated[str, Field(min_length=1, max_length=200)]


class Place(_Request):
    """Put the robot somewhere."""

    type: Literal["place"]
    pose: Pose


class Set(_AboutOne):
    """Change parameters, or replace all of them by one of the sets that `sets` lists."""

    type: Literal["set"]
    values: Annotated[dict[Annotated[str, Field(max_length=200)], Any], Field(max_length=50)] = {}
    params: Annotated[str, Field(max_length=500)] | None = None


class DriveByHand(_Request):
    """Drive by hand for a moment; the page repeats this while a key is down."""

    type: Literal["drive"]
    velocity: Annotated[list[Annotated[float, Field(ge=-20.0, le=20.0)]], Field(min_length=3, max_length=3)]
    seconds: Annotated[float, Field(gt=0.0, le=2.0)] = 0.6


class StartStep(_Request):
    """Begin a step of a tour now: `{dock: NAME}`, `{undock: true}`, `{cover: all}`, `{move: 0.5}`; no files."""

    type: Literal["step_now"]
    step: Annotated[dict[Annotated[str, Field(max_length=40)], Any], Field(min_length=1, max_length=20)]


class Graph(_Request):
    """The route graph that is edited."""

    type: Literal["graph"]


class GraphFromMap(_Request):
    """Make the route graph of the free space of the map."""

    type: Literal["graph_from_map"]
    spacing: Annotated[float, Field(ge=0.5, le=100.0)] = 5.0


class AddNode(_Request):
    """Add a node."""

    type: Literal["graph_add_node"]
    x: Finite
    y: Finite


class MoveNode(_Request):
    """Move a node."""

    type: Literal["graph_move_node"]
    node: GraphId
    x: Finite
    y: Finite


class Connect(_Request):
    """Add an edge between two nodes, or one each way."""

    type: Literal["graph_connect"]
    start: GraphId
    end: GraphId
    both_ways: bool = True


class DeleteFromGraph(_Request):
    """Delete nodes with their edges, and edges."""

    type: Literal["graph_delete"]
    nodes: GraphIds = []
    edges: GraphIds = []


class SetEdges(_Request):
    """Set attributes of edges; null removes one."""

    type: Literal["graph_set"]
    edges: GraphIds
    values: Annotated[dict[Annotated[str, Field(max_length=40)], float | bool | str | None], Field(max_length=5)]


class UndoGraph(_Request):
    """Take the last change of the graph back."""

    type: Literal["graph_undo"]


class CheckGraph(_Request):
    """What is wrong with the graph."""

    type: Literal["graph_check"]


class SaveGraph(_Request):
    """Write the graph as GeoJSON, into the folder of the file that it came from."""

    type: Literal["graph_save"]
    name: Name


class DriveToNode(_Request):
    """Drive to a node along the graph."""

    type: Literal["graph_drive"]
    node: GraphId


class Clear(_Request):
    """Reset both costmaps."""

    type: Literal["clear_costmaps"]


class GoOn(_Request):
    """Let a finished run go on."""

    type: Literal["wait"]
    duration: Annotated[float, Field(gt=0.0, le=3600.0)] = 60.0


class SelectRobot(_Request):
    """Show another robot of a fleet; goals are for it from now on."""

    type: Literal["robot"]
    name: Annotated[str, Field(min_length=1, max_length=200)]


class Pause(_Request):
    """Stop or continue the time."""

    type: Literal["pause"]
    paused: bool


class Step(_Request):
    """Pause and simulate one control cycle."""

    type: Literal["step"]


class Speed(_Request):
    """Factor of real time; null is as fast as possible."""

    type: Literal["speed"]
    factor: Annotated[float, Field(ge=0.01, le=1000.0)] | None


class Seek(_Request):
    """Go to a time that has been simulated."""

    type: Literal["seek"]
    time: Time


class Restart(_Request):
    """Begin again without any interaction."""

    type: Literal["restart"]


class ExplainCell(_AboutOne):
    """Why this cell has its cost."""

    type: Literal["explain_cell"]
    x: Finite
    y: Finite
    costmap: Literal["global", "local"] = "global"


class ExplainCommand(_AboutOne):
    """Why this command, who rejected the others; with `sample`, about one trajectory."""

    type: Literal["explain_command"]
    time: Time | None = None
    sample: Annotated[int, Field(ge=0, le=100_000)] | None = None


class ExplainGoal(_AboutOne):
    """What happened to a goal."""

    type: Literal["explain_goal"]
    number: Annotated[int, Field(ge=1, le=1_000_000)]


class ExplainPassage(_AboutOne):
    """Can the robot pass this opening."""

    type: Literal["explain_passage"]
    x: Finite
    y: Finite


class Parameters(_AboutOne):
    """List all parameters."""

    type: Literal["parameters"]


class Sets(_Request):
    """List the parameter sets to switch to: packaged ones, and the user's own files."""

    type: Literal["sets"]


class Difference(_AboutOne):
    """Show what saving the parameters would change."""

    type: Literal["difference"]


class Stroke(Message):
    """A line that was drawn on the map, with its width (m)."""

    points: Annotated[
        list[Annotated[list[Finite], Field(min_length=2, max_length=2)]], Field(min_length=1, max_length=400)
    ]
    width: Annotated[float, Field(gt=0.0, le=10.0)]


class Save(_AboutOne):
    """Write into the folder of the session: the scenario, the changed parameters, the map, or the goals as places or tour.

    `in_place` writes changed parameters into the user's own files, if they are in that folder.
    """

    type: Literal["save"]
    what: Literal["scenario", "run", "parameters", "places", "tour", "map"]
    name: Name
    places: Annotated[dict[Name, Pose], Field(max_length=200)] = {}
    in_place: bool = False
    erased: Annotated[list[Stroke], Field(max_length=200)] = []
    """What is free in the saved map, which also has the obstacles that stand still."""


Request = Annotated[
    Hello
    | Layers
    | Acknowledge
    | Goal
    | SetQueue
    | CancelGoal
    | Put
    | Remove
    | Place
    | Set
    | DriveByHand
    | StartStep
    | Graph
    | GraphFromMap
    | AddNode
    | MoveNode
    | Connect
    | DeleteFromGraph
    | SetEdges
    | UndoGraph
    | CheckGraph
    | SaveGraph
    | DriveToNode
    | Clear
    | GoOn
    | SelectRobot
    | Pause
    | Step
    | Speed
    | Seek
    | Restart
    | ExplainCell
    | ExplainCommand
    | ExplainGoal
    | ExplainPassage
    | Parameters
    | Sets
    | Difference
    | Save,
    Field(discriminator="type"),
]
_ID: Final = re.compile(r'"id"\s*:\s*(\d{1,15})\b')
_REQUEST: TypeAdapter[Any] = TypeAdapter(Request)

READ_ONLY: Final = frozenset(
    {
        *("hello", "layers", "ack", "parameters", "sets", "difference", "graph", "graph_check"),
        *("explain_cell", "explain_command", "explain_goal", "explain_passage"),
    }
)
"""Requests that change nothing: all that a viewer may send."""
TIME: Final = frozenset({"pause", "step", "speed", "seek"})
"""Requests that change the time but not the run."""


class Answer(Message):
    """Answer to a request."""

    type: Literal["answer"] = "answer"
    id: int
    ok: bool
    text: str = ""
    """A sentence or a report for the person; the reason of a refusal."""
    code: int = 0
    """Code of the error, 0 without one."""
    data: Any = None


class Notice(Message):
    """Something that every page should show."""

    type: Literal["notice"] = "notice"
    text: str
    severity: Literal["info", "warning", "error"] = "info"


class Progress(Message):
    """What the server does while nothing moves; an empty text: it is done."""

    type: Literal["progress"] = "progress"
    text: str = ""
    done: int = 0
    total: int = 0
    """0: unknown."""
    seconds: float = 0.0
    """Since when (s)."""


def read_request(text: str | bytes) -> Any:
    """Returns the request in a JSON text. Raises InputError with the reason."""
    try:
        return _REQUEST.validate_json(text)
    except ValidationError as exc:
        error = exc.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(step) for step in error["loc"])
        given = "" if error["type"] in ("missing", "json_invalid") else f" ({short_repr(error['input'])})"
        raise InputError(f"not a request: {where}{given}: {error['msg']}"[:500]) from None
    except RecursionError:
        raise InputError("not a request: nested too deeply") from None


def id_of(text: str) -> int:
    """Returns the id in a text that is not a valid request, 0 if there is none, so that its sender gets the answer."""
    found = _ID.search(text[:10_000])
    return int(found[1]) if found is not None else 0


def schema() -> dict[str, Any]:
    """Returns the JSON schema of all messages, for the page."""
    return {
        "protocol": PROTOCOL,
        "request": _REQUEST.json_schema(),
        "answer": Answer.model_json_schema(),
        "notice": Notice.model_json_schema(),
        "progress": Progress.model_json_schema(),
    }


# ----------------------------------------------------------------------------------------------------------------------
# One message with the state of the session: a JSON header and binary blobs, compressed together.
#
# Layout: one byte, 0 plain or 1 deflated (zlib); then the payload: the length of the header (u32, little endian), the header as
# UTF-8 JSON, and the blobs, one after another. The header's `blobs` lists their lengths; other entries name a blob by its index.


SMALLEST_DEFLATED: Final = 400
"""Shorter payloads are sent as they are (bytes)."""


class Frame:
    """A message under construction."""

    def __init__(self, header: dict[str, Any]) -> None:
        self.header = header
        self._blobs: list[bytes] = []

    def blob(self, data: NDArray[Any] | bytes) -> int:
        """Adds a blob and returns its index."""
        self._blobs.append(data if isinstance(data, bytes) else np.ascontiguousarray(data).tobytes())
        return len(self._blobs) - 1

    def encode(self) -> bytes:
        """Returns the bytes of the message."""
        self.header["blobs"] = [len(blob) for blob in self._blobs]
        header = json.dumps(self.header, separators=(",", ":"), allow_nan=False).encode()
        payload = b"".join((struct.pack("<I", len(header)), header, *self._blobs))
        if len(payload) < SMALLEST_DEFLATED:
            return b"\0" + payload
        return b"\1" + zlib.compress(payload, 1)


def decode(message: bytes) -> tuple[dict[str, Any], list[bytes]]:
    """Returns header and blobs of a message; for tests and other clients."""
    payload = zlib.decompress(message[1:]) if message[0] else message[1:]
    (length,) = struct.unpack_from("<I", payload)
    header: dict[str, Any] = json.loads(payload[4 : 4 + length])
    blobs: list[bytes] = []
    at = 4 + length
    for size in header["blobs"]:
        blobs.append(payload[at : at + size])
        at += size
    return header, blobs
