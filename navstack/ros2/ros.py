"""Access to the user's rclpy and its message packages: a node, its thread, its quality of service, its messages."""

from __future__ import annotations

import array
import copy
import importlib
import os
import signal
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from typing import Any, Final

import numpy as np

from navstack.core import InputError, NavError, NotSupportedError
from navstack.ros_messages import MessageBuilder
from navstack.ros_node import Inbox, line_of

SOURCE: Final = "source ROS 2 first (source /opt/ros/jazzy/setup.bash), with the Python of that distribution"
MESSAGES: Final = "install its package (sudo apt install ros-$ROS_DISTRO-{}) and source ROS 2 again"
FLUSH_S: Final = 0.2
"""Time for the last messages to leave (s, wall)."""
CLOCK_POLL_S: Final = 0.02
WARN_S: Final = 5.0
"""Least time between two warnings of dropped messages of a topic (s, wall)."""
IMPORTANT_TRIES: Final = 3
"""How often a message that no later one replaces is given to the middleware."""
CREATE_S: Final = 60.0
"""Longest wait for the thread of rclpy (s, wall)."""
ORDER: Final = ("humble", "iron", "jazzy", "kilted", "lyrical")
"""Distributions of ROS 2, oldest first."""
_CODES: Final = {
    "float": "f",
    "double": "d",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
}
"""Codes of the module array by type of a field."""


def load(module: str) -> Any:
    """Import a module of ROS 2. Raises NotSupportedError with what to do."""
    try:
        return importlib.import_module(module)
    except ImportError as exc:
        package = module.partition(".")[0]
        if package == "rclpy" or not has_module("rclpy"):
            raise NotSupportedError(f"ROS 2 was not found (no {package}): {SOURCE}", module=module) from exc
        advice = MESSAGES.format(package.replace("_", "-"))
        raise NotSupportedError(f"the package {package} of ROS 2 is missing: {advice}", module=module) from exc


def has_module(name: str) -> bool:
    """Return True if a module can be imported."""
    try:
        importlib.import_module(name)
    except ImportError:
        return False
    return True


def message(name: str) -> Any:
    """Return the class of a message, service or action: `nav_msgs/msg/Path`. Raises NotSupportedError."""
    package, kind, short = name.split("/")
    found = getattr(load(f"{package}.{kind}"), short, None)
    if found is None:
        raise NotSupportedError(f"this distribution of ROS 2 has no {name}", type=name)
    return found


def has_message(name: str) -> bool:
    """Return True if the distribution has a message, service or action."""
    try:
        message(name)
    except NotSupportedError:
        return False
    return True


def constants(cls: Any) -> frozenset[int]:
    """Return the values of the integer constants of a message."""
    values = (getattr(cls, name) for name in dir(type(cls)) if name.isupper() and not name.startswith("_"))
    return frozenset(value for value in values if type(value) is int)


def distro() -> str:
    """Return the distribution: ROS_DISTRO, else by what its messages have."""
    named = os.environ.get("ROS_DISTRO", "")
    if named in ORDER:
        return named
    return "kilted" if has_message("nav_msgs/msg/Goals") else "jazzy"


def is_at_least(name: str) -> bool:
    """Return True for this distribution of ROS 2 and later ones."""
    return ORDER.index(distro()) >= ORDER.index(name)


# --- messages ---------------------------------------------------------------------------------------------------------


class MessageTypes:
    """Builds messages by the names of `MessageBuilder`; numbers and arrays get the types that rclpy serializes."""

    def __init__(self) -> None:
        self.types = self
        self._known: dict[str, Callable[..., Any]] = {}

    def __getitem__(self, name: str) -> Callable[..., Any]:
        found = self._known.get(name)
        if found is None:
            found = self._known[name] = _builder(message(name))
        return found


def _builder(cls: Any) -> Callable[..., Any]:
    converters = {name: _converter(kind) for name, kind in cls.get_fields_and_field_types().items()}
    plain = {name: convert for name, convert in converters.items() if convert is not None}

    def build(**fields: Any) -> Any:
        made = cls()
        for name, value in fields.items():
            convert = plain.get(name)
            setattr(made, name, value if convert is None else convert(value))
        return made

    return build


def _converter(kind: str) -> Callable[[Any], Any] | None:
    """Return what makes a value of one that rclpy takes for a field of this type; None for one that it takes as it is."""
    if kind in ("float", "double"):
        return float
    if kind == "boolean":
        return bool
    if kind in _CODES:
        return int
    if kind.startswith("sequence<"):
        code = _CODES.get(kind[9:-1])
        return None if code is None else _array_of(code)
    base, _, size = kind.partition("[")
    if size and base in _CODES:
        dtype = np.dtype(_CODES[base])
        return lambda value: np.asarray(value, dtype)
    return None


def _array_of(code: str) -> Callable[[Any], array.array[Any]]:
    dtype = np.dtype(code)

    def convert(value: Any) -> array.array[Any]:
        made = array.array(code)
        made.frombytes(np.ascontiguousarray(value, dtype).tobytes())
        return made

    return convert


# --- the node ---------------------------------------------------------------------------------------------------------


class RosLog:
    """The log of a node: the terminal and /rosout, one line per text."""

    def __init__(self, logger: Any) -> None:
        self._logger = logger

    def loginfo(self, text: str, *values: Any) -> None:
        """Log something to know."""
        self._logger.info(line_of(text % values if values else text))

    def logwarn(self, text: str, *values: Any) -> None:
        """Log a warning."""
        self._logger.warning(line_of(text % values if values else text))

    def logerr(self, text: str, *values: Any) -> None:
        """Log an error."""
        self._logger.error(line_of(text % values if values else text))


class Sender:
    """Hands messages to the middleware, which refuses one that it cannot take within 0.1 s, on a machine that is too busy."""

    def __init__(self, log: RosLog) -> None:
        self._log = log
        self._warned: dict[str, float] = {}

    def send(self, what: str, publish: Callable[[], Any], tries: int = 1) -> None:
        """Call `publish` until the middleware takes the message, at most `tries` times, then drop it with a warning.

        Nothing is sent after ROS was shut down.
        """
        refused = load("rclpy.impl.implementation_singleton").rclpy_implementation.RCLError
        cause: Exception | None = None
        for _ in range(tries if load("rclpy").ok() else 0):
            try:
                publish()
                return
            except refused as exc:
                cause = exc
        now = time.monotonic()
        if cause is not None and now - self._warned.get(what, -WARN_S) >= WARN_S:
            self._warned[what] = now
            self._log.logwarn("a message on %s was dropped: %s; the machine is too busy", what, cause)


class Publisher:
    """A publisher that tells how many subscribers it has."""

    def __init__(self, publisher: Any, sender: Sender, tries: int = 1) -> None:
        """`tries`: how often a message is given to the middleware before it is dropped."""
        self._publisher, self._sender, self._tries = publisher, sender, tries
        self._seen = 0
        self.topic = str(publisher.topic_name)

    def publish(self, message: Any) -> None:
        """Publish a message, unless ROS was shut down."""
        self._sender.send(self.topic, lambda: self._publisher.publish(message), self._tries)

    @property
    def is_wanted(self) -> bool:
        """True if a node subscribes."""
        return bool(self._publisher.get_subscription_count())

    def has_new_subscriber(self) -> bool:
        """Return True once for more subscribers than before."""
        count = int(self._publisher.get_subscription_count())
        before, self._seen = self._seen, count
        return count > before


Handler = Callable[[Any], Any]


class RosNode:
    """A node of rclpy, whose callbacks run in a thread of their own and post to an inbox."""

    def __init__(self, name: str, arguments: Sequence[str], *, cls: Callable[..., Any] | None = None) -> None:
        """`arguments` are those of the command line after `--ros-args`. `cls` makes the node; default: rclpy's Node.

        Raises InputError for arguments that ROS does not accept.
        """
        rclpy = load("rclpy")
        load("rclpy.executors")
        options = load("rclpy.signals").SignalHandlerOptions.NO
        full = ["navstack", *(("--ros-args", *arguments) if arguments else ())]
        try:
            rclpy.init(args=full, signal_handler_options=options)
            make = cls or load("rclpy.node").Node
            self.handle = make(name, automatically_declare_parameters_from_overrides=True)
        except Exception as exc:  # several classes of rclpy, none of them public
            raise InputError(f"ROS 2 does not accept {' '.join(arguments) or name}: {exc}") from exc
        self.log = RosLog(self.handle.get_logger())
        self.sender = Sender(self.log)
        self.build = MessageBuilder(MessageTypes(), ros1=False)
        self.stop = threading.Event()
        """Set when the process was asked to end."""
        self._executor = _executor()
        self._executor.add_node(self.handle)
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)
        self._kept: list[Any] = []
        self._below = ""

    def start(self) -> None:
        """Receive messages from now on, and end at SIGINT and SIGTERM."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        self._thread.start()

    def _on_signal(self, number: int, frame: Any) -> None:
        del number, frame
        self.stop.set()

    def _spin(self) -> None:
        rclpy = load("rclpy")
        external = load("rclpy.executors").ExternalShutdownException
        while rclpy.ok():
            try:
                self._executor.spin_once(timeout_sec=0.5)
            except external:
                return
            except Exception as exc:  # a message or a request that rclpy cannot read: the node goes on
                if not rclpy.ok():
                    return
                self.log.logerr("a callback failed: %s: %s", type(exc).__name__, exc)

    def create(self, make: Callable[[], Any]) -> Any:
        """Return what `make` creates, in the thread of rclpy if it runs: it must not meet half of an entity."""
        if not self._thread.is_alive() or threading.current_thread() is self._thread:
            return make()
        done: Future[Any] = Future()

        def run() -> None:
            try:
                done.set_result(make())
            except BaseException as exc:  # the caller's thread raises it again
                done.set_exception(exc)

        self.later(run)
        return done.result(CREATE_S)

    def later(self, action: Callable[[], Any]) -> None:
        """Run something in the thread of rclpy: what the action servers of rclpy hold is changed there only."""
        self._executor.create_task(action)

    def is_stopping(self) -> bool:
        """Return True if the node must end."""
        return self.stop.is_set() or not load("rclpy").ok()

    def shut_down(self, last: Callable[[], None]) -> None:
        """Call `last`, which publishes the last messages, give them time to leave, and end the node."""
        rclpy = load("rclpy")
        if rclpy.ok():
            last()
            time.sleep(FLUSH_S)
            rclpy.shutdown()
        if self._thread.is_alive():
            self._thread.join(2.0)

    # --- time ---------------------------------------------------------------------------------------------------------

    def now_ns(self) -> int:
        """Return ROS's time (ns)."""
        return int(self.handle.get_clock().now().nanoseconds)

    @property
    def is_simulated(self) -> bool:
        """True if use_sim_time is set."""
        return bool(self.handle.get_parameter("use_sim_time").value)

    def wait_for_clock(self) -> bool:
        """Wait for the first time on `/clock` if use_sim_time is set, with a warning every 5 s; return whether it is set."""
        if not self.is_simulated:
            return False
        warned = time.monotonic() - 4.0
        while self.now_ns() == 0 and not self.is_stopping():
            if time.monotonic() - warned > 5.0:
                warned = time.monotonic()
                self.log.logwarn("use_sim_time is set: waiting for /clock")
            self.stop.wait(CLOCK_POLL_S)
        return True

    # --- topics and services ------------------------------------------------------------------------------------------

    def below(self, name: str) -> RosNode:
        """Return this node for one robot of several: its topics and services are those below `name`, all but `/clock`.

        `/tf` and `/tf_static`, too, become `name/tf` and `name/tf_static`, to which the launch files of Nav2 remap them.
        """
        part = copy.copy(self)
        part._below = f"{self._below}{name}/"
        return part

    def _named(self, name: str) -> str:
        return name if not self._below or name == "/clock" else self._below + name.lstrip("/")

    def publisher(
        self,
        topic: str,
        kind: str,
        *,
        depth: int = 1,
        latched: bool = False,
        reliable: bool = True,
        important: bool = False,
    ) -> Publisher:
        """Create a publisher; with `latched` late subscribers get the last messages (transient local).

        Messages that are `important`, or latched, are given to a busy middleware more than once.
        """
        cls, profile = message(kind), qos(depth, latched=latched, reliable=reliable)
        made = self.create(lambda: self.handle.create_publisher(cls, self._named(topic), profile))
        return Publisher(made, self.sender, IMPORTANT_TRIES if latched or important else 1)

    def subscribe(
        self,
        topic: str,
        kind: str,
        receive: Callable[[Any], None],
        *,
        depth: int = 1,
        latched: bool = False,
        reliable: bool = True,
    ) -> None:
        """Call `receive` with each message, in the thread of rclpy: a poster of the inbox."""
        cls, profile = message(kind), qos(depth, latched=latched, reliable=reliable)
        self._kept.append(
            self.create(lambda: self.handle.create_subscription(cls, self._named(topic), receive, profile))
        )

    def serve(self, name: str, kind: str, inbox: Inbox, handle: Callable[[Any, Any], None]) -> None:
        """Offer a service: `handle(request, response)` fills the response, in the thread of the node."""

        def answer(request: Any, response: Any) -> Any:
            try:
                inbox.call(lambda: handle(request, response))
            except NavError as exc:
                self.log.logerr("%s: %s", name, exc.message)
            except TimeoutError as exc:
                self.log.logerr("%s: %s", name, exc)
            return response

        self.serve_here(name, kind, answer)

    def serve_here(self, name: str, kind: str, answer: Callable[[Any, Any], Any]) -> None:
        """Offer a service: `answer(request, response)` returns the response, in the thread of rclpy."""
        cls = message(kind)
        self._kept.append(self.create(lambda: self.handle.create_service(cls, self._named(name), answer)))

    def resolved(self, topic: str) -> str:
        """Return the full name of a topic, after namespace and remappings."""
        return str(self.handle.resolve_topic_name(self._named(topic)))


def _executor() -> Any:
    """Return rclpy's executor that waits in C++, where there is one: the other takes four times the processor time."""
    try:
        return importlib.import_module("rclpy.experimental").EventsExecutor()
    except (ImportError, AttributeError):
        return load("rclpy.executors").SingleThreadedExecutor()


def qos(depth: int, *, latched: bool = False, reliable: bool = True) -> Any:
    """Return a profile of the quality of service, which keeps the last `depth` messages."""
    module = load("rclpy.qos")
    return module.QoSProfile(
        depth=depth,
        history=module.HistoryPolicy.KEEP_LAST,
        reliability=module.ReliabilityPolicy.RELIABLE if reliable else module.ReliabilityPolicy.BEST_EFFORT,
        durability=module.DurabilityPolicy.TRANSIENT_LOCAL if latched else module.DurabilityPolicy.VOLATILE,
    )


def overrides_of(node: Any) -> Mapping[str, Any]:
    """Return the parameters that were given to a node: on its command line, in files, by a launch file."""
    own = {"use_sim_time", "start_type_description_service"}
    names = [
        name for name in node.get_parameters_by_prefix("") if name not in own and not name.startswith("qos_overrides")
    ]
    return {name: node.get_parameter(name).value for name in names}


# --- parameters of the helper nodes -----------------------------------------------------------------------------------


def value_of(node: Any, name: str, default: Any, wanted: str) -> Any:
    """Return a parameter of a node, declared with its default. Raises InputError for one of another type."""
    if not node.has_parameter(name):
        node.declare_parameter(name, default)
    value = node.get_parameter(name).value
    if type(value) is not type(default) and not (isinstance(default, float) and type(value) is int):
        raise InputError(f"the parameter {name} is {value!r}, not {wanted}", parameter=name, value=value)
    return float(value) if isinstance(default, float) else value
