"""`navstack ros1`: nodes for a ROS 1 graph."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options, ros1_install, ros1_nodes
from navstack.cli.arguments import map_of
from navstack.cli.output import print_findings, print_warnings, stdout
from navstack.cli.ros1_nodes import NODE, Name, NodeCommand, set_param, start_node
from navstack.cli.scenario_options import ScenarioOptions, SimNodeOptions
from navstack.ros1 import (
    AmclNode,
    FakeLocalization,
    MappingNode,
    check_thresholds,
    load_amcl,
    load_image,
    move_base_node,
    parameters,
    read_mapping_params,
    receive_map,
    serve_map,
    simulate,
    simulate_fleet,
)
from navstack.ros_node import RecordFolder

app = typer.Typer(
    name="ros1",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Nodes for ROS 1 (Debian's packages): move_base, the simulated robot, map_server, amcl, mapping.",
)


@app.command("move_base", cls=NodeCommand, context_settings=NODE)
def move_base(
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
    name: Name = "move_base",
) -> int:
    """Run a node in place of move_base: the action, make_plan, clear_costmaps, costmaps and plans on their topics.

    Parameters come from the node's namespace on the parameter server, as for move_base; `--params` overlays them. Remappings
    follow as for every node: `cmd_vel:=/mobile_base/cmd_vel`. With `--record`, `navstack explain goal FOLDER/latest` explains the
    last goal of the running node. Exit codes: 0 shut down, 2 invalid input.
    """
    start_node(name, context)
    configuration = parameters.load(params, set_, distro=distro)
    print_warnings(configuration)
    move_base_node.run(configuration, None if record is None else RecordFolder(record, record_limit))
    return 0


@app.command("sim", cls=NodeCommand, context_settings=NODE)
@options.with_options(chosen=ScenarioOptions, running=SimNodeOptions)
def sim(
    context: typer.Context,
    chosen: ScenarioOptions,
    running: SimNodeOptions,
    name: Name = "navstack_sim",
) -> int:
    """Run the simulated robot as a node: scan, odom, tf, imu, map, bumpers and the true pose; it follows cmd_vel.

    With `--clock`, /use_sim_time is set. The robot stops without a command for 0.5 s; `initialpose` puts it somewhere else. A
    fleet file gives many robots in one world: the topics and services of each are those below its name, `/robot_1/scan`, and its
    name is the prefix of its frames, `robot_1/odom`; goals, routes and traffic of the file are left to other nodes. Exit codes: 0
    shut down, 2 invalid input.
    """
    running.check()
    fleet = chosen.fleet()
    scenario = chosen.build(goals_needed=False) if fleet is None else None
    if running.clock:
        set_param("/use_sim_time", True)
    start_node(name, context, own_time=running.clock)
    if fleet is not None:
        simulate_fleet(fleet.world(), fleet.scenarios, speed=running.speed, clock=running.clock)
    elif scenario is not None:
        simulate(scenario, speed=running.speed, clock=running.clock)
    return 0


@app.command("map_server", cls=NodeCommand, context_settings=NODE)
def map_server(
    context: typer.Context,
    map_: options.Map,
    resolution: Annotated[
        str | None, typer.Argument(metavar="RESOLUTION", help="For an image instead of a YAML file: m per cell.")
    ] = None,
    name: Name = "map_server",
) -> int:
    """Publish a map (latched), and offer static_map and change_map. Exit codes: 0 shut down, 2 invalid input.

    The old form `IMAGE RESOLUTION` puts the origin at (0, 0); ~negate, ~occupied_thresh and ~free_thresh count for it.
    """
    grid = map_of(map_)[1] if resolution is None else None
    start_node(name, context)
    serve_map(load_image(map_, str(resolution)) if grid is None else grid)
    return 0


@app.command("map_saver", cls=NodeCommand, context_settings=NODE)
def map_saver(
    context: typer.Context,
    occ: Annotated[int, typer.Option("--occ", help="Values from here on are occupied.")] = 65,
    free: Annotated[int, typer.Option("--free", help="Values up to here are free.")] = 25,
    file: Annotated[str, typer.Option("-f", metavar="NAME", help="Files to write: NAME.yaml and NAME.pgm.")] = "map",
    name: Name = "map_saver",
) -> int:
    """Write the map of the topic `map` to files, as map_saver. Exit codes: 0 written, 1 shut down before, 2 invalid input."""
    check_thresholds(occ, free)
    start_node(name, context)
    written = receive_map(file, occ, free)
    for path in written:
        stdout().print(str(path), markup=False, soft_wrap=True)
    return 0 if written else 1


@app.command("amcl", cls=NodeCommand, context_settings=NODE)
def amcl(context: typer.Context, params: options.Params = [], set_: options.Set = [], name: Name = "amcl") -> int:
    """Localize a robot in a map by its scans, as amcl: amcl_pose, particlecloud, map -> odom on /tf.

    Parameters come from the node's namespace on the parameter server, with amcl's names and defaults; the section `amcl` of
    `--params` overlays them (`--set amcl.max_particles=2000`). Exit codes: 0 shut down, 2 invalid input.
    """
    start_node(name, context)
    configuration = load_amcl(params, set_)
    print_findings(configuration.findings)
    AmclNode(configuration).spin()
    return 0


@app.command("fake_localization", cls=NodeCommand, context_settings=NODE)
def fake_localization(context: typer.Context, name: Name = "fake_localization") -> int:
    """Localize a simulated robot by its true pose (base_pose_ground_truth), as fake_localization.

    Parameters: ~odom_frame_id odom, ~base_frame_id base_link, ~global_frame_id map, ~delta_x, ~delta_y, ~delta_yaw 0,
    ~transform_tolerance 0.1 s. Exit codes: 0 shut down, 2 invalid input.
    """
    start_node(name, context)
    FakeLocalization().spin()
    return 0


@app.command("mapping", cls=NodeCommand, context_settings=NODE)
def mapping(context: typer.Context, name: Name = "slam_gmapping") -> int:
    """Make a map from scans and odometry, as gmapping: map, map_metadata, ~entropy, dynamic_map, map -> odom on /tf.

    Parameters, with gmapping's names and defaults: ~base_frame base_link, ~odom_frame odom, ~map_frame map, ~delta 0.05 m,
    ~maxUrange 80 m, ~map_update_interval 5 s, ~transform_publish_period 0.05 s, ~tf_delay, ~throttle_scans 1; ~linearUpdate and
    ~angularUpdate (default 0.3 m and 0.3 rad). Exit codes: 0 shut down, 2 invalid input.
    """
    start_node(name, context)
    MappingNode(read_mapping_params()).spin()
    return 0


ros1_nodes.add_to(app)
ros1_install.add_to(app)
