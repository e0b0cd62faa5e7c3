"""`navstack ros2`: nodes for a ROS 2 graph."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.lazy_group import Command
from navstack.cli.output import print_warnings, stdout
from navstack.cli.scenario_options import ScenarioOptions, SimNodeOptions
from navstack.core import InputError, resolved
from navstack.parameters import load_configuration
from navstack.ros2 import Navigator, RosNode, advise, load, managed_node, simulate, simulate_fleet
from navstack.ros_node import RecordFolder

app = typer.Typer(
    name="ros2",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Nodes for ROS 2 (your sourced installation): the navigator in place of Nav2, the simulated robot.",
)
ROS_ARGS: Final = "--ros-args"
NODE: Final[dict[str, Any]] = {"allow_extra_args": True}

Name = Annotated[str, typer.Option("--name", help="Name of the node.")]


class NodeCommand(Command):
    """A command that is a node: what follows `--ros-args`, up to `--`, is left to rclpy."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments that are not ROS's; those are kept in `ctx.obj`."""
        own: list[str] = []
        of_ros: list[str] = []
        target = own
        for text in args:
            if text == ROS_ARGS:
                target = of_ros
            elif text == "--" and target is of_ros:
                target = own
            else:
                target.append(text)
        rest = super().parse_args(ctx, own)
        ctx.meta["ros"] = of_ros
        return rest


def arguments_of(context: typer.Context) -> list[str]:
    """Return the arguments of ROS."""
    if context.args:
        raise InputError(f"{' '.join(context.args)} is not an option; arguments of ROS follow {ROS_ARGS}")
    return list(context.meta["ros"])


@app.command("navigator", cls=NodeCommand, context_settings=NODE)
def navigator(
    context: typer.Context,
    params: options.Params = [],
    set_: options.Set = [],
    distro: options.Distro = None,
    record: Annotated[
        Path | None,
        typer.Option("--record", metavar="FOLDER", help="Record the cycles there, in pieces for `plot` and `explain`."),
    ] = None,
    record_limit: Annotated[
        float, typer.Option("--record-limit", metavar="MB", help="Delete the oldest pieces beyond this size.", min=1.0)
    ] = 500.0,
    name: Name = "navigator",
) -> int:
    """Run a node in place of Nav2's servers: their actions, topics, services and life cycle.

    `--params` takes files of navstack, of move_base and of Nav2 (nav2_params.yaml); parameters that ROS gives to the node overlay
    them. Names and namespaces as for every node: `--ros-args -r __ns:=/robot1 -r cmd_vel:=base/cmd_vel`. Exit codes: 0 shut
    down, 2 invalid input.
    """
    arguments = arguments_of(context)
    running: list[Navigator] = []
    taken: list[str] = []

    def change(transition: str) -> None:
        taken.append(transition)
        for one in running:
            one.change_state(transition)

    node = RosNode(name, arguments, cls=managed_node(change))
    configuration = load(node, params, set_, distro=distro)
    print_warnings(configuration)
    node.start()
    made = Navigator(configuration, node, None if record is None else RecordFolder(record, record_limit))

    def take_over() -> None:
        running.append(made)
        for transition in taken:  # those that a manager was faster with
            made.change_state(transition)

    node.create(take_over)
    made.spin()
    return 0


@app.command("sim", cls=NodeCommand, context_settings=NODE)
@options.with_options(chosen=ScenarioOptions, running=SimNodeOptions)
def sim(
    context: typer.Context,
    chosen: ScenarioOptions,
    running: SimNodeOptions,
    name: Name = "navstack_sim",
) -> int:
    """Run the simulated robot as a node: scan, odom, tf, imu, battery, map server and amcl; it follows cmd_vel.

    The robot stops without a command for 0.5 s. `initialpose` puts it somewhere else. A fleet file gives many robots in one
    world: the topics and services of each are those below its name, `/robot_1/scan`, `/robot_1/tf`; goals, routes and traffic of
    the file are left to other nodes. Exit codes: 0 shut down, 2 invalid input.
    """
    running.check()
    arguments = arguments_of(context)
    fleet = chosen.fleet()
    scenario = chosen.build(goals_needed=False) if fleet is None else None
    node = RosNode(name, arguments)
    node.start()
    if fleet is not None:
        simulate_fleet(fleet.world(), fleet.scenarios, node, speed=running.speed, clock=running.clock)
    elif scenario is not None:
        simulate(scenario, node, speed=running.speed, clock=running.clock)
    return 0


@app.command("install")
def install(
    folder: Annotated[
        Path | None, typer.Argument(metavar="DIR", help="The src folder of a colcon workspace, or any folder.")
    ] = None,
    params: Annotated[
        list[str],
        typer.Option(
            "--params", metavar="PARAMS", help="Packaged set or YAML file, copied (repeatable); default: turtlebot."
        ),
    ] = [],
    map_: Annotated[
        str, typer.Option("--map", metavar="MAP", help="Packaged map or YAML file, copied with its image.")
    ] = "office",
    force: Annotated[bool, typer.Option("--force", help="Replace a package that navstack wrote before.")] = False,
    launch: Annotated[
        list[Path],
        typer.Option("--launch", metavar="FILE", help="Launch file: print what its nodes must become (repeatable)."),
    ] = [],
) -> int:
    """Write the package navstack_ros2 for colcon: nodes, launch files (Python, XML), RViz 2, your parameters and map.

    Needs no ROS 2 itself. `--launch` takes launch files in Python or XML, such as those of nav2_bringup. Exit codes: 0 written,
    2 invalid input or an existing package.
    """
    if folder is None and not launch:
        raise InputError("nothing to do: name a folder for the package, or a launch file with --launch")
    advice = [(file, advise(file)) for file in launch]
    out = stdout()
    if folder is not None:
        from navstack.map_io import load_map
        from navstack.ros2 import install as write

        chosen = params or ["turtlebot"]
        print_warnings(load_configuration(chosen))
        load_map(map_)
        out.print(escape(str(write(folder, chosen, map_, force=force))), soft_wrap=True, highlight=False)
        workspace = folder.parent if folder.name == "src" else folder
        out.print(
            escape(f"cd {resolved(workspace)} && colcon build && source install/setup.bash"),
            soft_wrap=True,
            highlight=False,
        )
        out.print("ros2 launch navstack_ros2 demo.launch.py", highlight=False)
    for file, lines in advice:
        for line in lines:
            out.print(escape(str(line)), soft_wrap=True, highlight=False)
        if not lines:
            out.print(escape(f"{file}: no node of it has to change"), soft_wrap=True, highlight=False)
    return 0
