"""What every node of a behavior tree is: its status, its ports, and how it is ticked and halted.

A node of your own is a subclass of `Action`, `Condition`, `Decorator` or `Control` with the class attribute `PORTS` and the
method `tick`; register it with `@NODES.register("MyNode")`, or by an entry point in the group `navstack.behavior_tree_nodes`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from enum import IntEnum
from typing import ClassVar, Final, Protocol, TypeVar, cast

from navstack.behavior_trees.blackboard import UNSET, Blackboard, Entry, Input, Output, Port, StampedPose
from navstack.behavior_trees.errors import BehaviorTreeRunError, ScriptError
from navstack.behavior_trees.scripts import Script
from navstack.behavior_trees.servers import Servers
from navstack.core import NavError, Twist2D
from navstack.plugins import Registry


class Status(IntEnum):
    """Result of a tick, with the numbers of BehaviorTree.CPP. A node keeps every status but SKIPPED until it is reset."""

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3
    SKIPPED = 4


IDLE: Final = Status.IDLE
RUNNING: Final = Status.RUNNING
SUCCESS: Final = Status.SUCCESS
FAILURE: Final = Status.FAILURE
SKIPPED: Final = Status.SKIPPED

PRE_CONDITIONS: Final = ("_failureIf", "_successIf", "_skipIf", "_while")
"""Scripts before a tick, in the order in which they are evaluated."""
POST_CONDITIONS: Final = ("_onHalted", "_onFailure", "_onSuccess", "_post")
"""Scripts after a tick or a halt."""


class Record(Protocol):
    """Takes note of what nodes do."""

    def changed(self, item: Node, status: Status) -> None:
        """Note that the result of a node has changed."""
        ...

    def retried(self, item: Node, attempt: int, allowed: int) -> None:
        """Note that a RecoveryNode runs its second child after the failure of the first one."""
        ...


class Context(Protocol):
    """The tree as its nodes see it."""

    now_ns: int
    """Time of the tick (ns)."""
    enums: dict[str, int]
    """Names of constants in scripts and switches."""
    topics: dict[str, object]
    """The last message of each topic."""
    failed: deque[Leaf]
    """Leaves that failed in this tick, in order."""
    servers: Servers
    wraps_around: bool
    """Default of RoundRobin's `wrap_around`."""

    @property
    def trace(self) -> Record:
        """What the nodes did."""
        ...

    def wake(self, item: Node) -> bool:
        """Let the tree be ticked again at once; False if it is of format 3."""
        ...

    def charge(self, item: Node) -> None:
        """Account for one more turn of a loop within a tick."""
        ...

    def offer(self, service: str, handler: Callable[[], None]) -> None:
        """Offer a service."""
        ...

    def robot_pose(self, frame: str = "", base_frame: str = "") -> StampedPose | None:
        """Return the robot's pose, or None."""
        ...

    def smoothed_velocity(self) -> Twist2D:
        """Return the robot's smoothed velocity."""
        ...


class Conditions:
    """The scripts of one node around its ticks."""

    __slots__ = ("board", "failure", "halted", "post", "pre", "success")

    def __init__(self, board: Blackboard, scripts: dict[str, Script]) -> None:
        self.board = board
        self.pre = tuple((name, scripts[name]) for name in PRE_CONDITIONS if name in scripts)
        self.halted = scripts.get("_onHalted")
        self.failure = scripts.get("_onFailure")
        self.success = scripts.get("_onSuccess")
        self.post = scripts.get("_post")

    def before(self, node: Node) -> Status | None:
        """Return the status that a condition decides, or None to tick the node."""
        status = node.status
        for name, script in self.pre:
            if status is IDLE:
                true = script.is_true(self.board)
                if name == "_while":
                    if not true:
                        return SKIPPED
                elif true:
                    return FAILURE if name == "_failureIf" else SUCCESS if name == "_successIf" else SKIPPED
            elif status is RUNNING and name == "_while" and not script.is_true(self.board):
                node.halt_node()
                return SKIPPED
        return None

    def after(self, status: Status) -> None:
        """Run the scripts that follow a SUCCESS or a FAILURE."""
        script = self.success if status is SUCCESS else self.failure
        if script is not None:
            script(self.board)
        if self.post is not None:
            self.post(self.board)


class Node(ABC):
    """Base class of all nodes."""

    PORTS: ClassVar[tuple[Port, ...]] = ()
    CHILDREN: ClassVar[tuple[int, int | None]] = (0, 0)
    """Fewest and most children; None for no limit."""

    __slots__ = (
        "__dict__",
        "blackboard",
        "children",
        "conditions",
        "counts",
        "index",
        "inputs",
        "label",
        "last",
        "name",
        "outputs",
        "path",
        "size",
        "status",
        "tree",
        "type",
        "where",
    )

    tree: Context
    """The tree that the node belongs to: its time, the servers, the topics."""
    blackboard: Blackboard
    """The blackboard of the node's subtree."""

    def __init__(self) -> None:
        self.status = IDLE
        """Status of the last tick until a reset; SKIPPED is never kept."""
        self.last = IDLE
        """Result of the last tick."""
        self.name = self.type = self.path = self.label = self.where = ""
        self.index = 0
        """Number of the node in the tree, parents first."""
        self.size = 1
        """Number of nodes from this one down."""
        self.children: list[Node] = []
        self.conditions: Conditions | None = None
        self.counts = [0, 0, 0, 0, 0]
        """How often each status was returned; that of IDLE counts halts while RUNNING."""
        self.inputs: dict[str, Input] = {}
        self.outputs: dict[str, Output] = {}

    # --- for subclasses -----------------------------------------------------------------------------------------------

    def setup(self) -> None:  # noqa: B027
        """Prepare the node after its ports and children are connected. May raise BehaviorTreeRunError."""

    @abstractmethod
    def tick(self) -> Status:
        """Do the work of one tick and return its status."""

    def halt(self) -> None:
        """Stop what is running, and reset the node."""
        self.status = IDLE

    def input(self, name: str) -> Input:
        """Return an input port; `.get(default)` reads it."""
        return self.inputs[name]

    def output(self, name: str) -> Output:
        """Return an output port; `.set(value)` writes it."""
        return self.outputs[name]

    def entry(self, key: str) -> Entry:
        """Return an entry of the node's blackboard."""
        return self.blackboard.entry(key)

    def get(self, name: str, default: object = None) -> object:
        """Read an input port."""
        return self.inputs[name].get(default)

    def number(self, name: str, default: float = 0.0) -> float:
        """Read a port of type `double`."""
        value = self.inputs[name].get(default)
        return float(value) if isinstance(value, (int, float)) else default

    def integer(self, name: str, default: int = 0) -> int:
        """Read a port of type `int` or `unsigned`."""
        value = self.inputs[name].get(default)
        return value if isinstance(value, int) else default

    def flag(self, name: str, default: bool = False) -> bool:
        """Read a port of type `bool`."""
        return bool(self.inputs[name].get(default))

    def text(self, name: str, default: str = "") -> str:
        """Read a port of type `string`."""
        value = self.inputs[name].get(default)
        return value if isinstance(value, str) else default

    def has(self, name: str) -> bool:
        """Return True if an input port has a value."""
        return self.inputs[name].get(UNSET) is not UNSET

    def failure(self, message: str, **data: object) -> BehaviorTreeRunError:
        """Return an error of this node, with its position and its path."""
        return BehaviorTreeRunError(f"{self.where}: {self.path}: {message}", path=self.path, **data)

    # --- ticks --------------------------------------------------------------------------------------------------------

    def execute(self) -> Status:
        """Tick the node with its conditions, and keep its status."""
        conditions = self.conditions
        status = self.tick() if conditions is None else self._under(conditions)
        if status is not SKIPPED:
            self.status = status
        self.counts[status] += 1
        if status is not self.last:
            self.last = status
            self.tree.trace.changed(self, status)
        return status

    def _under(self, conditions: Conditions) -> Status:
        try:
            status = conditions.before(self)
            if status is None:
                status = self.tick()
            if status is SUCCESS or status is FAILURE:
                conditions.after(status)
        except ScriptError as exc:
            raise self.failure(f"a script of the node failed: {exc}") from None
        return status

    def halt_node(self) -> None:
        """Halt the node, then run its script `_onHalted`."""
        if self.status is RUNNING:
            self.counts[IDLE] += 1
            self.last = IDLE
            self.tree.trace.changed(self, IDLE)
        self.halt()
        conditions = self.conditions
        if conditions is not None and conditions.halted is not None:
            try:
                conditions.halted(conditions.board)
            except ScriptError as exc:
                raise self.failure(f"the script _onHalted failed: {exc}") from None

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.path or self.name!r}, {self.status.name})"


class Leaf(Node):
    """A node without children: it acts or checks something."""

    __slots__ = ("code", "message")

    def __init__(self) -> None:
        super().__init__()
        self.code = 0
        """Error code of the last FAILURE; 0 if the node has none."""
        self.message = ""
        """Reason of the last FAILURE."""

    def execute(self) -> Status:
        """Tick the node, and remember a failure for explanations."""
        try:
            conditions = self.conditions
            status = self.tick() if conditions is None else self._under(conditions)
        except NavError:
            raise
        except ScriptError as exc:
            raise self.failure(f"the script failed: {exc}") from None
        except Exception as exc:
            raise self.failure(f"{type(exc).__name__} in {type(self).__name__}.tick: {exc}") from exc
        if status.__class__ is not Status or status is IDLE:
            raise self.failure(f"{type(self).__name__}.tick returned {status!r:.40}; return a Status other than IDLE")
        if status is not SKIPPED:
            self.status = status
        self.counts[status] += 1
        if status is FAILURE:
            self.tree.failed.append(self)
        if status is not self.last:
            self.last = status
            self.tree.trace.changed(self, status)
        return status


class Action(Leaf):
    """A leaf that acts. While it returns RUNNING it is ticked again; `halt` stops it, then calls `halted`."""

    def halted(self) -> None:
        """Stop what the action does; called if it is halted while RUNNING."""

    def halt(self) -> None:
        """Stop a running action."""
        if self.status is RUNNING:
            self.halted()
        self.status = IDLE


class StatefulAction(Action):
    """An action in three parts: `start` and `go_on` return a status, `halted` stops it."""

    @abstractmethod
    def start(self) -> Status:
        """Begin; called in the first tick."""

    @abstractmethod
    def go_on(self) -> Status:
        """Continue; called in the ticks that follow RUNNING."""

    def tick(self) -> Status:
        """Start or go on."""
        return self.go_on() if self.status is RUNNING else self.start()


class Condition(Leaf):
    """A leaf that checks: SUCCESS or FAILURE."""


class Control(Node):
    """A node with children."""

    CHILDREN = (1, None)

    def halt(self) -> None:
        """Halt the children and reset the node."""
        self.reset_children()
        self.status = IDLE

    def reset_children(self) -> None:
        """Halt the running children and reset all."""
        for child in self.children:
            if child.status is RUNNING:
                child.halt_node()
            child.status = IDLE

    def halt_child(self, index: int) -> None:
        """Halt a child if it is running, and reset it."""
        child = self.children[index]
        if child.status is RUNNING:
            child.halt_node()
        child.status = IDLE


class Decorator(Node):
    """A node with one child."""

    CHILDREN = (1, 1)

    __slots__ = ("child",)

    child: Node

    def execute(self) -> Status:
        """Tick the node; a child that ended is reset."""
        status = Node.execute(self)
        child = self.child
        if child.status is SUCCESS or child.status is FAILURE:
            child.status = IDLE
        return status

    def halt(self) -> None:
        """Halt the child and reset the node."""
        self.reset_child()
        self.status = IDLE

    def reset_child(self) -> None:
        """Halt the child if it is running, and reset it."""
        child = self.child
        if child.status is RUNNING:
            child.halt_node()
        child.status = IDLE


class GoalWatch:
    """Sees when `goal` or `goals` of a node change: those of its ports, otherwise the entries of these names."""

    __slots__ = ("_goal", "_goals", "_seen_goal", "_seen_goals")

    def __init__(self, owner: Node) -> None:
        self._goal = owner.inputs["goal"], owner.entry("goal")
        self._goals = owner.inputs["goals"], owner.entry("goals")
        self._seen_goal: object = None
        self._seen_goals: object = None

    def changed(self) -> bool:
        """Return True if a goal differs from that of the last call, and keep it."""
        goal, goals = _read(*self._goal), _read(*self._goals)
        if goal is self._seen_goal and goals is self._seen_goals:
            return False
        changed = goal != self._seen_goal or goals != self._seen_goals
        self._seen_goal, self._seen_goals = goal, goals
        return changed


def _read(port: Input, entry: Entry) -> object:
    value = port.get()
    return value if value is not None or entry.value is UNSET else entry.value


NODES: Final[Registry[Node]] = Registry("behavior tree node", "navstack.behavior_tree_nodes")
"""The types of nodes by the names of their XML elements."""

N = TypeVar("N", bound=type[Node])


def node(*names: str, ports: Iterable[Port] = ()) -> Callable[[N], N]:
    """Class decorator that registers a built-in node under one or more names, with its ports."""

    def decorate(cls: N) -> N:
        given = tuple(ports)
        if given:
            cls.PORTS = (*cls.PORTS, *given)
        NODES.add(names[0], cast("type[Node]", cls), aliases=tuple(names[1:]))
        return cls

    return decorate
