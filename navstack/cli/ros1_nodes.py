"""What the commands of `navstack ros1` share: ROS arguments, the start of a node."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Final

import typer

from navstack.behaviors import parse_angle, parse_length
from navstack.cli.arguments import parse_pose
from navstack.cli.lazy_group import Command
from navstack.cli.terminal import single_keys
from navstack.cli.tour import TourOrder
from navstack.core import InputError, clean_frame
from navstack.ros1 import Tour, TrajectoryPublisher, motion_nodes, ros
from navstack.ros1 import teleop as node
from navstack.scenario import load_places, visit_order

NODE: Final[dict[str, Any]] = {"ignore_unknown_options": True, "allow_extra_args": True}
"""Context of a command that is a node: a negative number is an argument, and ROS arguments are extra arguments."""

PING_S: Final = 2.0
"""Longest wait for the answer of another node (s)."""

Name = Annotated[str, typer.Option("--name", help="Name of the node.")]


class NodeCommand(Command):
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
    ros.escape_log()
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
    _check_master()
    ros.rospy().set_param(name, value)


def _check_master() -> None:
    """Raise InputError if there is no ROS master: rospy would wait for it without end."""
    import os

    uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
    os.environ.setdefault("ROS_MASTER_URI", uri)
    try:
        ros.load("rosgraph").Master("/navstack").getPid()
    except Exception as exc:  # socket errors, errors of XML-RPC
        raise InputError(f"no ROS master at {uri} ({exc}); start roscore, or set ROS_MASTER_URI", uri=uri) from exc


# ----------------------------------------------------------------------------------------------------------------------
# `navstack ros1 linear_move`, `radian_turn`, `teleop`, `initial_pose`, `tour`, `trajectory`: what tutorials rely on.


Service = Annotated[bool, typer.Option("--service", help="Offer the service instead of moving once.")]


class Plane(StrEnum):
    """Plane of the figure of eight."""

    xy = "xy"
    yz = "yz"


def linear_move(
    context: typer.Context,
    distance: Annotated[
        str | None, typer.Argument(metavar="DISTANCE", help="Distance (m), backwards if negative. [default: ~t_dis]")
    ] = None,
    service: Service = False,
    name: Name = "LinearMove",
) -> int:
    """Drive straight by the odometry, or offer the service move_distance (handsfree_msgs/SpecialMove).

    Parameters: ~t_dis 0.2 m, ~tolerance 0.08 m, ~speed_linear 0.1 m/s, ~velocity_pub_rate 10 Hz, ~vel_topic, ~base_frame
    /base_link, ~odom_frame /odom. Exit codes: 0 driven, 1 not, 2 invalid input or no transform.
    """
    wanted = None if distance is None else parse_length(distance)
    start_node(name, context)
    if service:
        motion_nodes.serve_moves()
        return 0
    return motion_nodes.linear_move(wanted)


def radian_turn(
    context: typer.Context,
    angle: Annotated[
        str | None,
        typer.Argument(metavar="ANGLE", help="Angle, clockwise if negative: 90deg, -1.57 (rad). [default: ~t_rad]"),
    ] = None,
    service: Service = False,
    name: Name = "RadianTurn",
) -> int:
    """Turn in place by the odometry, or offer the service turn_radian (handsfree_msgs/SpecialTurn).

    The robot turns the shorter way; with ~direct true by the whole angle. Parameters: ~t_rad pi/2, ~tolerance 0.03 rad,
    ~speed_radian 0.436 rad/s, ~velocity_pub_rate 10 Hz, ~vel_topic, ~base_frame /base_link, ~odom_frame /odom.
    Exit codes: 0 turned, 1 not, 2 invalid input or no transform.
    """
    wanted = None if angle is None else parse_angle(angle)
    start_node(name, context)
    if service:
        motion_nodes.serve_turns()
        return 0
    return motion_nodes.radian_turn(wanted)


def teleop(context: typer.Context, name: Name = "teleop_twist_keyboard") -> int:
    """Drive with the keyboard, with the keys of teleop_twist_keyboard. Ctrl-C ends it and stops the robot.

    Parameters: ~vel_topic, ~speed 0.3 m/s, ~turn 0.6 rad/s. Exit codes: 0 ended, 2 invalid input or no terminal.
    """
    with single_keys() as read:
        start_node(name, context)
        node.Teleop(print).spin(read)
    return 0


def initial_pose(
    context: typer.Context,
    pose: Annotated[str, typer.Argument(metavar="X,Y[,YAW]", help="Pose in the map (m, rad).")],
    frame: Annotated[str, typer.Option("--frame", help="Frame of the pose.")] = "map",
    wait: Annotated[float, typer.Option("--wait", help="Longest wait for a subscriber (s).", min=0.0)] = 10.0,
    name: Name = "initial_pose",
) -> int:
    """Publish the robot's pose on `initialpose`, as RViz's "2D Pose Estimate".

    Exit codes: 0 a node subscribes, 1 no subscriber within the wait, 2 invalid input.
    """
    from navstack.ros1 import initial_pose as node

    where = parse_pose(pose, "X,Y[,YAW]")
    start_node(name, context)
    return 0 if node.publish(where, clean_frame(frame), wait) else 1


def tour(
    context: typer.Context,
    places: Annotated[
        str, typer.Argument(metavar="PLACES.yaml", help="File of named places, or name of a packaged map.")
    ] = "office",
    order: Annotated[
        TourOrder, typer.Option("--order", help="Order of the visits: as given, by name, or shuffled by the seed.")
    ] = TourOrder.given,
    every: Annotated[bool, typer.Option("--all", help="Visit every place of the file instead of its goals.")] = False,
    loops: Annotated[int, typer.Option("--loops", help="How often to drive the tour.", min=1, max=1000)] = 1,
    seed: Annotated[int, typer.Option("--seed", help="Random seed of --order random.", min=0)] = 0,
    frame: Annotated[str, typer.Option("--frame", help="Frame of the places.")] = "map",
    time_limit: Annotated[float, typer.Option("--time-limit", help="Time limit per goal (s).", min=0.1)] = 300.0,
    name: Name = "MultiNav",
) -> int:
    """Drive to places by the action move_base; prints success rate, time and distance after each.

    Parameter: ~rest_time 2 s, the pause between two goals. Exit codes: 0 every place was reached, 1 some were not, 2 invalid
    input or no action server.
    """
    found = load_places(places)
    listed = tuple(found.places) if every else found.goal_names
    names = visit_order(listed, order.value, loops=loops, seed=seed)
    start_node(name, context)
    reached = Tour(frame, time_limit, print).drive([(name, found.places[name]) for name in names])
    return 0 if reached else 1


def trajectory(
    context: typer.Context,
    shape: Annotated[
        str, typer.Argument(metavar="figure_eight|heart|poly_path|FILE", help="Shape, or file of a trajectory.")
    ] = "figure_eight",
    point: Annotated[
        list[str], typer.Option("--point", metavar="X,Y[,Z]", help="Corner of poly_path (m); repeatable.")
    ] = [],
    plane: Annotated[Plane, typer.Option("--plane", help="Plane of the figure of eight.")] = Plane.yz,
    ends: Annotated[bool, typer.Option("--ends", help="Also publish the samples at corners and at the end.")] = False,
    count: Annotated[
        int | None, typer.Option("--count", help="How many to publish. [default: until it is shut down]", min=1)
    ] = None,
    name: Annotated[str, typer.Option("--name", help="Name of the node. [default: anonymous]")] = "",
) -> int:
    """Publish a timed trajectory on `command/trajectory` (MultiDOFJointTrajectory) after 2 s and then every 10 s.

    Parameters: ~dt 0.1 s, ~velocity 2.0 m/s (poly_path), ~inertial_frame map. poly_path begins where `odometry` says the robot
    is. Exit codes: 0 shut down, 2 invalid input.
    """
    points = [_point(text) for text in point]
    anonymous = name or str(ros.load("rosgraph.names").anonymous_name("local_planner"))
    start_node(anonymous, context)
    TrajectoryPublisher(shape, points, plane=plane.value, ends=ends).spin(count)
    return 0


def static_transform_publisher(
    context: typer.Context,
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="X Y Z YAW PITCH ROLL FRAME CHILD PERIOD_MS", help="Or a quaternion: X Y Z QX QY QZ QW .."
        ),
    ],
    name: Name = "static_transform_publisher",
) -> int:
    """Publish a fixed transform (m, rad), as tf's static_transform_publisher; without PERIOD_MS once, on /tf_static.

    Exit codes: 0 shut down, 2 invalid input.
    """
    from navstack.ros1 import static_transform as node

    given = node.parse(words)
    start_node(name, context)
    node.spin(given)
    return 0


def add_to(app: typer.Typer) -> None:
    """Add the commands to `navstack ros1`."""
    for command in (linear_move, radian_turn, teleop, initial_pose, tour, trajectory, static_transform_publisher):
        app.command(command.__name__, cls=NodeCommand, context_settings=NODE)(command)


def _point(text: str) -> list[float]:
    """Return a point of 2 or 3 numbers. Raises InputError."""
    import math

    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (2, 3) or not all(map(math.isfinite, values)):
        raise InputError(f'--point "{text}" is not x,y or x,y,z', argument="--point")
    return [*values, 0.0][:3]
