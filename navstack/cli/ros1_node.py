"""What the commands of `navstack ros1` share: ROS arguments, the start of a node."""

from __future__ import annotations

from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand

NODE: Final[dict[str, Any]] = {"ignore_unknown_options": True, "allow_extra_args": True}
"""Context of a command that is a node: a negative number is an argument, and ROS arguments are extra arguments."""

PING_S: Final = 2.0
"""Longest wait for the answer of another node (s)."""

Name = Annotated[str, typer.Option("--name", help="Name of the node.")]


class NodeCommand(TyperCommand):
    """A command that is a node: ROS arguments (`cmd_vel:=/base/cmd_vel`, `__ns:=/robot1`, `_frame_id:=map`) are left to rospy.

    roslaunch adds `__name:=` and `__log:=` to every command line; they must not be taken for an optional argument.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments that are not ROS's; those are added to `ctx.args`."""
        with_value = {name for option in self.params if not getattr(option, "is_flag", True) for name in option.opts}
        own: list[str] = []
        of_ros: list[str] = []
        before = ""
        for text in args:
            is_ros = ":=" in text and not text.startswith("-") and before not in with_value
            (of_ros if is_ros else own).append(text)
            before = text
        super().parse_args(ctx, own)
        ctx.args = [*ctx.args, *of_ros]
        return list(ctx.args)


def start_node(name: str, context: typer.Context, *, own_time: bool = False) -> None:
    """Register the node at the master, with the ROS arguments of the command line. Raises InputError without a master.

    With `own_time` the node keeps the wall clock independent of /use_sim_time: it publishes /clock itself.
    """
    import io
    import signal
    import sys

    from navstack.core.errors import InputError
    from navstack.ros1 import ros

    rospy = ros.rospy()
    extra = [text for text in context.args if ":=" not in text]
    if extra:
        raise InputError(f"{' '.join(extra)} is neither an option nor a ROS argument NAME:=VALUE")
    full = _full_name(name, context.args)
    _check_master()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # the log of a node is read while it runs
    sys.argv = ["navstack", *context.args]
    other = _running_node(full)
    if own_time:
        # rospy asks the parameter server only here; other nodes must find /use_sim_time set at any moment
        simulated = ros.load("rospy.impl.simtime")
        simulated._is_use_simtime = lambda: False
    rospy.init_node(name, argv=list(sys.argv), disable_signals=True)
    ros.flush_at_shutdown()
    if other:
        rospy.logwarn(
            "a node named %s was running (%s); ROS has shut it down, and this one takes its place: start one of them only, or "
            "give this one another name (__name:=..)",
            full,
            other,
        )

    def shut_down(number: int, frame: Any) -> None:
        del number, frame
        ros.STOP.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, shut_down)


def _full_name(name: str, arguments: list[str]) -> str:
    """Return the name of the node in its namespace. Raises InputError for one that ROS does not accept."""
    from navstack.core.errors import InputError
    from navstack.ros1 import ros

    names = ros.load("rosgraph.names")
    given = names.load_mappings(arguments)
    base = given.get("__name", name)
    if not names.is_legal_base_name(base):
        raise InputError(f'"{base}" is no name of a node; use letters, digits and _, with a letter first', name=base)
    namespace = names.make_global_ns(given.get("__ns", names.get_ros_namespace()))
    return str(names.ns_join(namespace, base))


def _running_node(name: str) -> str:
    """Return the address of a node that answers under a name; empty without one. Its registration may outlive a node."""
    import socket
    import xmlrpc.client

    from navstack.ros1 import ros

    try:
        uri = str(ros.load("rosgraph").Master("/navstack").lookupNode(name))
    except ros.load("rosgraph").MasterException:
        return ""
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(PING_S)
    try:
        node: Any = xmlrpc.client.ServerProxy(uri)
        return uri if node.getPid("/navstack")[0] == 1 else ""
    except (OSError, xmlrpc.client.Error):
        return ""
    finally:
        socket.setdefaulttimeout(before)


def set_param(name: str, value: Any) -> None:
    """Set a parameter before this process is a node. Raises InputError without a master."""
    from navstack.ros1 import ros

    _check_master()
    ros.rospy().set_param(name, value)


def _check_master() -> None:
    """Raise InputError if there is no ROS master: rospy would wait for it without end."""
    import os

    from navstack.core.errors import InputError
    from navstack.ros1 import ros

    uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
    os.environ.setdefault("ROS_MASTER_URI", uri)
    try:
        ros.load("rosgraph").Master("/navstack").getPid()
    except Exception as exc:  # socket errors, errors of XML-RPC
        raise InputError(f"no ROS master at {uri} ({exc}); start roscore, or set ROS_MASTER_URI", uri=uri) from exc
