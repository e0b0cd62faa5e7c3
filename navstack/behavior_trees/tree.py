"""A behavior tree: built from XML, ticked at given times, halted.

Nothing here sleeps, starts a thread or reads a clock: `tick(now)` is a function of the tree, the blackboard, the servers and the
time that it is given.
"""

from __future__ import annotations

import difflib
import os
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

from navstack.behavior_trees import actions, conditions, controls, decorators, leaves
from navstack.behavior_trees.blackboard import (
    ANY,
    TYPES,
    Blackboard,
    Entry,
    Input,
    Output,
    Port,
    StampedPose,
    parse_constant,
)
from navstack.behavior_trees.errors import BehaviorTreeError, BehaviorTreeRunError, ScriptError
from navstack.behavior_trees.nodes import (
    FAILURE,
    IDLE,
    NODES,
    POST_CONDITIONS,
    PRE_CONDITIONS,
    RUNNING,
    SUCCESS,
    Conditions,
    Decorator,
    Leaf,
    Node,
    Status,
)
from navstack.behavior_trees.scripts import Script
from navstack.behavior_trees.servers import NoServers, Servers
from navstack.behavior_trees.trace import Trace
from navstack.behavior_trees.xml_reader import Documents, Element
from navstack.core import Twist2D, UnknownPluginError, data_folder

MAX_NODES: Final = 30_000
"""Most nodes of a tree, with its subtrees."""
MAX_DEPTH: Final = 200
"""Deepest nesting of nodes, with subtrees: each level takes two frames of Python's stack."""
MAX_WORK: Final = 100_000
"""Most ticks of nodes that loops may cause within one tick of the tree."""
NANO: Final = 1_000_000_000

BUILTIN: Final = (actions, conditions, controls, decorators, leaves)
"""Modules whose nodes are registered when they are imported."""
_WRAPPERS: Final = ("Action", "Condition", "Control", "Decorator", "SubTree", "SubTreePlus")
_IGNORED: Final = (
    "name",
    "ID",
    "_description",
    "_fullpath",
    "_uid",
    "_autoremap",
    "__autoremap",
    "__shared_blackboard",
)
_SUBTREES: Final = ("SubTree", "SubTreePlus")
_OLD_DISTROS: Final = ("foxy", "galactic", "humble", "iron", "jazzy", "kilted")
"""Distributions whose RoundRobin always wraps around."""
DISTROS: Final = (*_OLD_DISTROS, "lyrical", "rolling")


class BehaviorTree:
    """A behavior tree of BehaviorTree.CPP's XML, format 3 or 4, with Nav2's nodes.

    `tree.blackboard["goal"] = StampedPose(3.0, 1.0)`, then `tree.tick(now)` until it no longer returns RUNNING.
    """

    def __init__(
        self,
        source: str | os.PathLike[str],
        *,
        servers: Servers | None = None,
        blackboard: Mapping[str, object] | None = None,
        tree_id: str | None = None,
        enums: Mapping[str, int] | None = None,
        nodes: Mapping[str, type[Node]] | None = None,
        distro: str | None = None,
        packages: Mapping[str, Path] | None = None,
    ) -> None:
        """Build a tree.

        Args:
            source: the path of an XML file, or its text (which contains a `<`).
            servers: the robot and its servers; default: a robot without servers.
            blackboard: first entries.
            tree_id: ID of the main tree; default: that of `main_tree_to_execute`, or the only one.
            enums: names of constants in scripts and switches.
            nodes: further types of nodes by name, which replace registered ones of that name.
            distro: `humble`, .. `rolling`: the release of Nav2 whose rules apply where they differ; default: by the format.
            packages: folders of ROS packages that includes name with `ros_pkg`.

        Raises BehaviorTreeError with file, line, column and the fix.
        """
        if distro is not None and distro not in DISTROS:
            close = difflib.get_close_matches(distro, DISTROS, n=1)
            hint = f'did you mean "{close[0]}"?' if close else f"the distributions are {', '.join(DISTROS)}"
            raise BehaviorTreeError(f'unknown distribution "{distro}"; {hint}', distro=distro)
        self.servers: Servers = servers if servers is not None else NoServers()
        self.enums = dict(enums or {})
        self.blackboard = Blackboard()
        self.now_ns = 0
        """Time of the tick (ns)."""
        self.ticks = 0
        """Number of ticks."""
        self.status = IDLE
        """Result of the last tick."""
        self.nodes: list[Node] = []
        """All nodes, parents first."""
        self.failed: deque[Leaf] = deque(maxlen=100)
        """The last leaves that returned FAILURE in this tick, in order."""
        self.topics: dict[str, object] = {}
        """The last message of each topic: `goal_update`, `planner_selector`, .."""
        self.services: dict[str, list[Callable[[], None]]] = {}
        self.trace = Trace(self)
        self._awake = False
        self._work = MAX_WORK
        for key, value in (blackboard or {}).items():
            self.blackboard[key] = value
        documents = Documents(packages)
        try:
            first = _read(source, documents)
        except RecursionError:
            raise BehaviorTreeError("the includes are nested too deep; include the files in one") from None
        self.name = first.source.name
        """Of the file, for messages."""
        self.format = _format_of(first)
        """3 or 4."""
        self.wraps_around = self.format == 3 if distro is None else distro in _OLD_DISTROS
        builder = _Builder(self, documents.roots, dict(nodes or {}))
        self.root = builder.build(first, tree_id)
        """The node that is ticked."""
        self.id = builder.main_id
        """ID of the main tree."""

    # --- running ------------------------------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        """Time of the last tick (s)."""
        return self.now_ns / NANO

    def tick(self, now: float) -> Status:
        """Tick the tree at `now` (s) and return its status. Raises BehaviorTreeRunError if a node cannot go on.

        Halt the tree after SUCCESS, FAILURE, SKIPPED or an error, as bt_navigator does; the next tick begins anew.
        """
        self.now_ns = round(now * NANO)
        self.ticks += 1
        self.failed.clear()
        self._work = MAX_WORK
        root = self.root
        status = self.status = FAILURE  # if it raises
        try:
            status = root.execute()
            while self._awake and status is RUNNING:
                self._awake = False
                self.charge(root)
                status = root.execute()
        except RecursionError:
            raise BehaviorTreeRunError(f"{self.name}: the tree is too deep for Python's stack; flatten it") from None
        if status is SUCCESS or status is FAILURE:
            root.status = IDLE
        self.status = status
        return status

    def halt(self) -> None:
        """Halt every node: running actions are canceled."""
        self.root.halt_node()
        for item in self.nodes:
            item.halt_node()
        self.root.status = IDLE

    def run(self, times: Iterable[float]) -> Status:
        """Tick at each of the times (s) until the tree ends; halt it and return its status (RUNNING if the times ended)."""
        status = RUNNING
        for now in times:
            status = self.tick(now)
            if status is not RUNNING:
                self.halt()
                break
        return status

    # --- for nodes ----------------------------------------------------------------------------------------------------

    def wake(self, item: Node) -> bool:
        """Let the tree be ticked again at once; return False if it is of format 3, which has no such thing."""
        del item
        if self.format < 4:
            return False
        self._awake = True
        return True

    def charge(self, item: Node) -> None:
        """Account for one more turn of a loop within a tick. Raises BehaviorTreeRunError if there are too many."""
        # Nav2 differs: there such a tick never ends
        self._work -= item.size
        if self._work < 0:
            raise item.failure(
                f"its children end at once again and again: more than {MAX_WORK} ticks of nodes within one tick of the tree; "
                "limit the repetitions, or let a child return RUNNING"
            )

    def offer(self, service: str, handler: Callable[[], None]) -> None:
        """Offer a service."""
        self.services.setdefault(service, []).append(handler)

    def robot_pose(self, frame: str = "", base_frame: str = "") -> StampedPose | None:
        """Return the robot's pose, or None."""
        return self.servers.robot_pose(frame, base_frame)

    def smoothed_velocity(self) -> Twist2D:
        """Return the robot's smoothed velocity."""
        return self.servers.smoothed_velocity()

    # --- from outside -------------------------------------------------------------------------------------------------

    def publish(self, topic: str, message: object) -> None:
        """Send a message on a topic that nodes of the tree listen to."""
        self.topics[topic] = message

    def call(self, service: str) -> None:
        """Call a service that a node of the tree offers. Raises BehaviorTreeRunError for an unknown one."""
        if service not in self.services:
            known = ", ".join(sorted(self.services)) or "none"
            raise BehaviorTreeRunError(
                f'no node of {self.name} offers the service "{service}"; known: {known}', service=service
            )
        for handler in self.services[service]:
            handler()

    def node(self, path: str) -> Node:
        """Return a node by its path, or by the end of its path if that is unique. Raises BehaviorTreeRunError."""
        found = [item for item in self.nodes if item.path == path]
        found = found or [item for item in self.nodes if item.path.endswith(f"/{path}")]
        if len(found) == 1:
            return found[0]
        what = "is not unique" if found else "does not exist"
        close = difflib.get_close_matches(path, [item.path for item in self.nodes], n=1, cutoff=0.0)
        raise BehaviorTreeRunError(f'the node "{path}" {what} in {self.name}; for example: {close[0]}', path=path)

    def explain(self, *, everything: bool = False) -> str:
        """Return what the tree did, as text: see `Trace.text`."""
        return self.trace.text(everything=everything)

    def __repr__(self) -> str:
        return f"BehaviorTree({self.name!r}, {len(self.nodes)} nodes, {self.status.name})"


def _read(source: str | os.PathLike[str], documents: Documents) -> Element:
    if isinstance(source, str) and ("<" in source or not source.strip()):
        return documents.read_text(source, "<text>", Path())
    try:
        return documents.read_file(Path(source))
    except ValueError as exc:  # such as a null character
        raise BehaviorTreeError(f"{source!r:.200}: the behavior tree cannot be read: {exc}") from None


def _format_of(root: Element) -> int:
    text = root.attributes.get("BTCPP_format", "3").strip()
    if text not in ("3", "4"):
        raise root.error(
            f'BTCPP_format is "{text:.20}"; navstack reads the formats 3 and 4', "BTCPP_format", value=text
        )
    return int(text)


def _flag(element: Element, name: str) -> bool:
    text = element.attributes.get(name, "false")
    try:
        return bool(TYPES["bool"].parse(text))
    except ValueError as exc:
        raise element.error(f'{name} is "{text:.40}"; {exc}', name, value=text) from None


def _pointer(text: str) -> str | None:
    """Return the key of `{key}`, otherwise None."""
    text = text.strip(" ")
    return text[1:-1].strip() if len(text) >= 3 and text[0] == "{" and text[-1] == "}" else None


def _suggestion(name: str, known: Sequence[str]) -> str:
    by_lower = {k.lower(): k for k in known}
    close = difflib.get_close_matches(name.lower(), list(by_lower), n=1, cutoff=0.6)
    return f'; did you mean "{by_lower[close[0]]}"?' if close else ""


class _Builder:
    """Makes nodes of elements, and connects their ports."""

    def __init__(self, tree: BehaviorTree, roots: Sequence[Element], own: dict[str, type[Node]]) -> None:
        self.main_id = ""
        self._tree = tree
        self._own = own
        self._trees: dict[str, Element] = {}
        self._models: dict[str, dict[str, str | None]] = {}
        """Ports of subtrees that have a model, with their defaults."""
        self._types: dict[str, type[Node]] = {}
        self._labels: dict[tuple[int, str], int] = {}
        """How often a name occurs below a node so far."""
        for root in roots:
            self._take_models(root)
            for index, element in enumerate(root.named("BehaviorTree")):
                self._take_tree(element, index)

    def _take_models(self, root: Element) -> None:
        for model in root.named("TreeNodesModel"):
            for entry in model.children:
                name = entry.attributes.get("ID")
                if not name:
                    raise entry.error(f"<{entry.tag}> in <TreeNodesModel> has no ID; add one")
                if entry.tag in _SUBTREES:
                    ports = self._models.setdefault(name, {})
                    for port in entry.children:
                        if "name" in port.attributes:
                            ports[port.attributes["name"]] = port.attributes.get("default")

    def _take_tree(self, element: Element, index: int) -> None:
        name = element.attributes.get("ID") or f"BehaviorTree_{index}"
        if name in self._trees:
            other = self._trees[name]
            raise element.error(
                f'the tree "{name}" exists already at {other.where}; give it another ID', "ID", value=name
            )
        if name in self._own or name in NODES:
            raise element.error(f'"{name}" is the name of a node; give the tree another ID', "ID", value=name)
        if len(element.children) != 1:
            count = len(element.children)
            raise element.error(
                f'the tree "{name}" has {count} nodes at its top; it needs exactly one, such as a <Sequence>'
            )
        self._trees[name] = element

    def build(self, first: Element, tree_id: str | None) -> Node:
        wanted = tree_id if tree_id is not None else first.attributes.get("main_tree_to_execute")
        if not self._trees:
            raise first.error('the file has no <BehaviorTree ID="..">; add one')
        if wanted is None:
            here = [e.attributes.get("ID") or "" for e in first.named("BehaviorTree")]
            if len(self._trees) == 1:
                wanted = next(iter(self._trees))
            elif len(here) == 1 and here[0]:
                wanted = here[0]
            else:
                known = ", ".join(self._trees)
                raise first.error(f'the file has several trees ({known:.300}); name one with main_tree_to_execute=".."')
        if wanted not in self._trees:
            known = list(self._trees)
            at = "main_tree_to_execute" if tree_id is None else None
            raise first.error(
                f'there is no tree "{wanted}"{_suggestion(wanted, known) or "; known: " + ", ".join(known)[:300]}',
                at,
                value=wanted,
            )
        self.main_id = wanted
        root = self._node(self._trees[wanted].children[0], None, self._tree.blackboard, "", (wanted,), 1)
        for item in self._tree.nodes:
            item.setup()
        return root

    # --- nodes --------------------------------------------------------------------------------------------------------

    def _type(self, element: Element) -> tuple[str, type[Node]]:
        """Return the name of an element's type of node, and the class."""
        name = element.tag
        if name in _WRAPPERS and name not in _SUBTREES:
            name = element.attributes.get("ID", "")
            if not name:
                raise element.error(f'<{element.tag}> has no ID; write <{element.tag} ID="NameOfTheNode"/>')
        cls = self._types.get(name) or self._own.get(name)
        if cls is None:
            try:
                cls = NODES.get(name).cls
            except UnknownPluginError as exc:
                known = [*self._own, *(n for n, aliases in NODES.names() for n in (n, *aliases))]
                if name in self._trees:
                    hint = f'; it is a tree: write <SubTree ID="{name}"/>'
                else:
                    hint = _suggestion(name, known) or "; register it, or pass nodes={..}"
                raise element.error(f'unknown node "{name}"{hint}', node=name, known=known) from exc
        self._types[name] = cls
        return name, cls

    def _node(
        self, element: Element, parent: Node | None, board: Blackboard, prefix: str, trees: tuple[str, ...], depth: int
    ) -> Node:
        tree = self._tree
        if depth > MAX_DEPTH:
            raise element.error(f"nodes are nested more than {MAX_DEPTH} deep; flatten the tree")
        if len(tree.nodes) >= MAX_NODES:
            raise element.error(f"the tree has more than {MAX_NODES} nodes with its subtrees")
        name, cls = self._type(element)
        try:
            item = cls()
        except Exception as exc:
            raise element.error(f"the node {name} cannot be made: {type(exc).__name__}: {exc}", node=name) from exc
        item.tree, item.blackboard, item.type, item.where = tree, board, name, element.where
        item.name = element.attributes.get("name") or name
        item.label = self._label(item, parent)
        item.path = f"{prefix}/{item.label}" if prefix else item.label
        item.index = len(tree.nodes)
        tree.nodes.append(item)
        if name in _SUBTREES:
            children = [self._subtree(element, item, board, trees, depth)]
        else:
            self._count_children(element, name, cls)
            self._connect(element, item, board)
            children = [self._node(child, item, board, item.path, trees, depth + 1) for child in element.children]
        item.children = children
        item.size = len(tree.nodes) - item.index
        if isinstance(item, Decorator):
            item.child = children[0]
        item.conditions = self._conditions(element, board)
        return item

    def _label(self, item: Node, parent: Node | None) -> str:
        if parent is None:
            return item.name
        count = self._labels[parent.index, item.name] = self._labels.get((parent.index, item.name), 0) + 1
        return item.name if count == 1 else f"{item.name}#{count}"

    @staticmethod
    def _count_children(element: Element, name: str, cls: type[Node]) -> None:
        least, most = cls.CHILDREN
        count = len(element.children)
        if least <= count and (most is None or count <= most):
            return
        if most == 0:
            wanted = "no children"
        elif least == most:
            wanted = f"exactly {least} {'child' if least == 1 else 'children'}"
        else:
            wanted = (
                f"at least {least} {'child' if least == 1 else 'children'}"
                if most is None
                else f"{least} to {most} children"
            )
        raise element.error(f"{name} needs {wanted}, not {count}", node=name, children=count)

    def _conditions(self, element: Element, board: Blackboard) -> Conditions | None:
        scripts: dict[str, Script] = {}
        for name in (*PRE_CONDITIONS, *POST_CONDITIONS):
            source = element.attributes.get(name)
            if source is not None:
                try:
                    scripts[name] = Script(source, self._tree.enums)
                except ScriptError as exc:
                    at = "" if exc.position is None else f" at character {exc.position + 1}"
                    raise element.error(
                        f'the script {name}="{source:.80}" is invalid{at}: {exc}', name, script=source
                    ) from None
        return Conditions(board, scripts) if scripts else None

    # --- ports --------------------------------------------------------------------------------------------------------

    def _connect(self, element: Element, item: Node, board: Blackboard) -> None:
        ports = {port.name: port for port in type(item).PORTS}
        for name in element.attributes:
            if (
                name not in ports
                and name not in _IGNORED
                and name not in PRE_CONDITIONS
                and name not in POST_CONDITIONS
            ):
                self._unknown_attribute(element, item.type, name, list(ports))
        for name, port in ports.items():
            text = element.attributes.get(name)
            if text is None and port.required:
                plain = port.type in ("bool", "int", "unsigned", "double", "string", ANY) and port.direction == "in"
                form = f'{name}=".."' if plain else f'{name}="{{{name}}}"'
                raise element.error(
                    f"{item.type} needs the port {name} ({port.type}); write {form}", node=item.type, port=name
                )
            if text is None:
                text = port.default
            key = None if text is None else name if text.strip(" ") in ("{=}", "=") else _pointer(text)
            if key is not None and not key:
                raise element.error(f'{name}="{text}" names no entry; write {name}="{{key}}"', name, port=name)
            if port.direction != "in":
                target = key if key is not None else text
                item.outputs[name] = Output(port, None if not target else self._entry(element, board, target, port))
            if port.direction != "out":
                item.inputs[name] = self._input(element, board, port, text, key)

    def _input(self, element: Element, board: Blackboard, port: Port, text: str | None, key: str | None) -> Input:
        if key is not None:
            return Input(port, element.where, self._entry(element, board, key, port))
        if text is None:
            return Input(port, element.where)
        try:
            return Input(port, element.where, None, parse_constant(port, text))
        except ValueError as exc:
            raise element.error(
                f'{port.name}="{text:.80}" is not of type {port.type}: {exc}', port.name, port=port.name, value=text
            ) from None

    @staticmethod
    def _entry(element: Element, board: Blackboard, key: str, port: Port) -> Entry:
        if "@" in key[1:]:
            raise element.error(
                f'the key "{key:.80}" has an @ after its first character; remove it', port.name, key=key
            )
        entry = board.entry(key, port.type)
        kinds = {entry.type, port.type}
        loose = {ANY, "string"}
        numbers = {"int", "unsigned", "double", "bool"}
        if len(kinds) == 2 and not kinds & loose and not kinds <= numbers:
            raise element.error(
                f'the entry "{key}" is of type {entry.type} in another port, but {port.name} is of type {port.type}; use another '
                "key for one of them",
                port.name,
                key=key,
            )
        return entry

    @staticmethod
    def _unknown_attribute(element: Element, kind: str, name: str, ports: list[str]) -> None:
        known = [*ports, *PRE_CONDITIONS, *POST_CONDITIONS, "name"]
        hint = _suggestion(name, known)
        if name.startswith("_") and not hint:
            return  # BehaviorTree.CPP ignores them: editors keep notes there
        if not hint:
            hint = f"; its ports are {', '.join(ports)}" if ports else "; it has no ports"
        raise element.error(f'{kind} has no port "{name}"{hint}', name, node=kind, port=name)

    # --- subtrees -----------------------------------------------------------------------------------------------------

    def _subtree(self, element: Element, item: Node, board: Blackboard, trees: tuple[str, ...], depth: int) -> Node:
        name = element.attributes.get("ID")
        if not name:
            raise element.error(f'<{element.tag}> has no ID; write <{element.tag} ID="NameOfTheTree"/>')
        if element.children:
            raise element.error(f'the SubTree "{name}" has children; move them into its <BehaviorTree>')
        if name not in self._trees:
            known = list(self._trees)
            hint = _suggestion(name, known) or f"; known: {', '.join(known)[:300]}"
            raise element.error(f'there is no tree "{name}"{hint}', "ID", value=name)
        if name in trees:
            chain = " -> ".join((*trees, name))
            raise element.error(f"the tree calls itself: {chain:.400}; remove one of the SubTrees", "ID", value=name)
        inner = self._subtree_board(element, name, board)
        return self._node(self._trees[name].children[0], item, inner, item.path, (*trees, name), depth + 1)

    def _subtree_board(self, element: Element, name: str, board: Blackboard) -> Blackboard:
        """Return the blackboard of a subtree, with the remapping of its attributes."""
        given = element.attributes
        old_names = self._tree.format == 3
        if _flag(element, "__shared_blackboard"):
            return board
        inner = Blackboard(board)
        autoremap = _flag(element, "_autoremap") or _flag(element, "__autoremap")
        special = (*_IGNORED, *PRE_CONDITIONS, *POST_CONDITIONS)
        ports = {key: text for key, text in given.items() if key not in special and not key.startswith("_")}
        for key, default in self._models.get(name, {}).items():
            if key not in ports and not autoremap:
                if default is None:
                    raise element.error(f'the SubTree "{name}" needs the port {key}; write {key}="{{{key}}}"', port=key)
                ports[key] = default
        constants: dict[str, str] = {}
        for key, text in ports.items():
            target = key if text.strip(" ") == "{=}" else _pointer(text)
            if target is None and old_names and element.tag == "SubTree":
                target = text  # format 3: the name of the entry without braces
            if target:
                inner.remapping[key] = target
            else:
                constants[key] = text
        for key, text in constants.items():
            inner.entry(key).set(_number_or_text(text))
        inner.autoremap = autoremap
        return inner


def _number_or_text(text: str) -> object:
    for kind in ("int", "double"):
        try:
            return TYPES[kind].parse(text)
        except ValueError:
            continue
    return text


def packaged_trees() -> dict[str, Path]:
    """Return the packaged trees by name."""
    folder = data_folder("params") / "behavior_trees"
    return {path.stem: path for path in sorted(folder.glob("*.xml"))}


def find_tree(source: str | os.PathLike[str]) -> str | Path:
    """Return the file of a tree: a path, the name of a packaged tree, or a path whose file is packaged; or the text of a tree.

    So a robot's parameters, which name a file of Nav2's installation, find the packaged tree of that name. Raises
    BehaviorTreeError for an unknown name.
    """
    text = os.fspath(source)
    if "<" in text:
        return text
    try:
        path = Path(text)
        if path.is_file():
            return path
    except (OSError, ValueError) as exc:
        raise BehaviorTreeError(f"{text!r:.200}: the behavior tree cannot be read: {exc}") from None
    known = packaged_trees()
    name = path.name.removesuffix(".xml")
    if name in known:
        return known[name]
    hint = _suggestion(name, list(known)) or f"; the packaged trees are {', '.join(known)}"
    raise BehaviorTreeError(f'there is no behavior tree "{text:.200}"{hint}', file=text)
