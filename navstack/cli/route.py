"""`navstack route`: route graphs."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from navstack.bringup import costmap_on_map
from navstack.cli import options
from navstack.cli.arguments import footprint_overrides, map_of, parse_place
from navstack.cli.options import chosen_files, file_in, picture_file
from navstack.cli.output import loading_kernels, print_files, print_json, print_note, stdout, titled_table
from navstack.core import InputError, Pose2D, write_json
from navstack.parameters import load_configuration, read_yaml
from navstack.parameters import plain as plain_values
from navstack.plot import plot_graph
from navstack.routes import RoutePlanner, check_graph, graph_from_map, load_graph, read_scorers, save_graph

if TYPE_CHECKING:
    from collections.abc import Sequence

    from navstack.core import OccupancyGrid
    from navstack.parameters import Configuration
    from navstack.routes import GraphFinding, PlannedRoute, RouteGraph

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Plan, check, draw and make route graphs (GeoJSON of nav2_route).",
)

Graph = Annotated[Path, typer.Argument(metavar="GRAPH.geojson", help="Route graph, in the format of nav2_route.")]
MapOption = Annotated[
    str | None,
    typer.Option("--map", metavar="MAP.yaml", help="map_server YAML file, or name of a packaged map."),
]
Unknown = Annotated[bool, typer.Option("--allow-unknown", help="Unknown space of the map is no obstacle.")]


class RobotOptions(NamedTuple):
    """The robot that drives on the graph."""

    params: options.Params = ["turtlebot"]
    set_: options.Set = []
    footprint: options.Footprint = None

    def load(self) -> Configuration:
        """Load the parameters. Raises ParameterError."""
        return load_configuration(self.params, overrides=[*self.set_, *footprint_overrides(self.footprint)])


@app.command("plan")
@options.with_options(robot=RobotOptions)
def plan(
    graph_file: Graph,
    start: Annotated[
        str, typer.Option("--start", metavar="X,Y[,YAW]|PLACE|NODE", help="Start: a pose, or the id of a node.")
    ],
    goal: Annotated[
        str, typer.Option("--goal", metavar="X,Y[,YAW]|PLACE|NODE", help="Goal: a pose, or the id of a node.")
    ],
    map_: MapOption = None,
    robot: RobotOptions = RobotOptions(),
    route_params: Annotated[
        Path | None,
        typer.Option(
            "--route-params", metavar="FILE", help="YAML with parameters of Nav2's route_server, as in its files."
        ),
    ] = None,
    closed: Annotated[list[int], typer.Option("--close", metavar="EDGE", help="Close this edge (repeatable).")] = [],
    out: Annotated[Path | None, options.both_files("route.png", "route.json")] = None,
    json_: options.Json = False,
) -> None:
    """Plan a route between two poses, or two nodes, of a graph. With a map, poses get nodes that free cells lead to.

    Exit codes: 0 a route was found, 1 the graph does not connect the nodes, 2 invalid input.
    """
    graph = load_graph(graph_file)
    grid = None if map_ is None else map_of(map_)[1]
    a, b = (_end(text, name, map_) for text, name in ((start, "--start"), (goal, "--goal")))
    params, scorers = read_scorers({} if route_params is None else _server_values(route_params))
    costmap = None
    if grid is not None:
        at = (
            a if isinstance(a, Pose2D) else Pose2D(float(graph.xy[graph.node(a), 0]), float(graph.xy[graph.node(a), 1]))
        )
        costmap = costmap_on_map(robot.load(), grid, at).master
    planner = RoutePlanner(graph, params, scorers, costmap=costmap)
    for edge in closed:
        graph.edge(edge)
    if closed:
        planner.dynamic_edges.adjust(closed=closed)
    with loading_kernels(quiet=json_):
        found = planner.plan(a, b)
    ms = min(_planning_ms(planner, a, b) for _ in range(5))
    document = {
        **found.route.as_dict(),
        "length_m": found.route.length_m,
        "whole": {
            "nodes": list(found.whole.node_ids),
            "edges": list(found.whole.edge_ids),
            "route_cost": found.whole.cost,
        },
        "path": found.path.poses.tolist(),
        "frame": graph.frame,
        "nodes_searched": found.iterations,
        "time_ms": ms,
    }
    files = chosen_files(out, {"picture": "route.png", "route": "route.json"}) if out is not None else {}
    if "picture" in files:
        plot_graph(graph, files["picture"], grid=grid, route=found, title=f"{graph_file.stem}: route")
    if files:
        document["files"] = {what: str(file) for what, file in files.items()}
    if "route" in files:
        write_json(files["route"], document)
    if json_:
        print_json(document)
        return
    _print_route(graph_file, found, ms)
    for note in graph.notes:
        print_note(note)
    print_files({what: str(file) for what, file in files.items()})


def _print_route(file: Path, found: PlannedRoute, ms: float) -> None:
    route, graph = found.route, found.route.graph
    table = titled_table(f"route on {file.name}", left=("edge", "from", "to"), right=("length", "cost"))
    nodes = route.node_ids
    for edge, number, cost, a, b in zip(route.edges, route.edge_ids, route.edge_costs, nodes, nodes[1:]):
        table.add_row(str(number), str(a), str(b), f"{graph.lengths[edge]:.2f} m", f"{cost:.4g}")
    if route.edges:
        stdout().print(table)
    left_out = len(found.whole.edges) - len(route.edges)
    print(
        f"{len(nodes)} node{'s' * (len(nodes) != 1)}, {len(route.edges)} edge{'s' * (len(route.edges) != 1)}"
        + (f" ({left_out} left out: the robot or the goal is beside them)" if left_out else "")
        + f", {route.length_m:.2f} m, cost {route.cost:.4g}, {found.iterations} nodes searched in {ms:.2f} ms"
    )


def _planning_ms(planner: RoutePlanner, start: Pose2D | int, goal: Pose2D | int) -> float:
    began = time.perf_counter()
    planner.plan(start, goal)
    return (time.perf_counter() - began) * 1e3


def _end(text: str, argument: str, map_: str | None) -> Pose2D | int:
    """Return a node id, or a pose. Raises InputError."""
    return int(text) if text.strip().isdigit() else parse_place(text, argument, map_)


def _server_values(file: Path) -> dict[str, Any]:
    """Return the parameters of the route server of a YAML file.

    Those of its node, in any namespace, over those of `/**`; the whole file if it names no node.
    """
    read = read_yaml(file, any_key=True)
    errors = [finding for finding in read.findings if finding.severity == "error"]
    if errors:
        raise InputError(f"{errors[0].location}: {errors[0].message}")
    values: Any = plain_values(read.root)
    if not isinstance(values, dict):
        raise InputError(f"{file} is no mapping; write the parameters of route_server below ros__parameters")
    nodes = _nodes_in(values)
    if not nodes:
        values = values.get("route_server", values)
        nodes = [("route_server", values)]
    found = [inner for names in ({"**", "*"}, {"route_server"}) for name, inner in nodes if name in names]
    if not found:
        names = ", ".join(dict.fromkeys(name for name, _ in nodes[:8]))
        raise InputError(f"{file} has no section route_server (it has {names}); add one")
    for inner in found:
        if not isinstance(inner, dict):
            raise InputError(f"{file}: ros__parameters is no mapping; write the parameters of route_server below it")
    return {key: value for inner in found for key, value in inner.items()}


def _nodes_in(values: dict[Any, Any]) -> list[tuple[str, Any]]:
    """Return (name without namespace, parameters) of each node of a file of ROS parameters."""
    found: list[tuple[str, Any]] = []
    for name, inner in values.items():
        if isinstance(inner, dict) and "ros__parameters" in inner:
            found.append((str(name).rsplit("/", 1)[-1], inner["ros__parameters"]))
        elif isinstance(inner, dict):
            found += _nodes_in(inner)
    return found


@app.command("check")
@options.with_options(robot=RobotOptions)
def check(
    graph_file: Graph,
    map_: MapOption = None,
    robot: RobotOptions = RobotOptions(),
    allow_unknown: Unknown = False,
    out: Annotated[Path | None, picture_file("graph.png")] = None,
    json_: options.Json = False,
) -> None:
    """Check a graph: nodes that cannot be reached, one-way traps; with --map edges through walls or too narrow for the footprint.

    Exit codes: 0 no errors, 1 errors, 2 invalid input.
    """
    graph = load_graph(graph_file)
    grid = None if map_ is None else map_of(map_)[1]
    footprint = robot.load().global_costmap.footprint if grid is not None else None
    with loading_kernels(quiet=json_):
        findings = check_graph(graph, grid, footprint, allow_unknown=allow_unknown)
    errors = [finding for finding in findings if finding.severity == "error"]
    if out is not None:
        _draw(graph, grid, errors, out, graph_file.stem)
    if json_:
        document: dict[str, Any] = {"nodes": len(graph), "edges": graph.edge_count}
        document["findings"] = [finding.as_dict() for finding in findings]
        print_json(document | ({"files": {"picture": str(out)}} if out is not None else {}))
    else:
        for finding in findings:
            print(f"{finding.severity} {finding.rule}: {finding.message}")
        warnings = len(findings) - len(errors)
        counts = f"{len(errors)} error{'s' * (len(errors) != 1)}, {warnings} warning{'s' * (warnings != 1)}"
        print(f"{graph_file.name}: {len(graph)} nodes, {graph.edge_count} edges: {counts}")
        if grid is None:
            print_note("--map MAP.yaml checks the edges against the walls and the footprint")
        print_files({"picture": str(out)} if out is not None else {})
    if errors:
        raise typer.Exit(1)


def _draw(graph: RouteGraph, grid: OccupancyGrid | None, errors: Sequence[GraphFinding], out: Path, name: str) -> None:
    edges = {edge for finding in errors for edge in finding.edges}
    nodes = {node for finding in errors for node in finding.nodes}
    plot_graph(graph, out, grid=grid, wrong_edges=edges, wrong_nodes=nodes, title=name)


@app.command("draw")
def draw(
    graph_file: Graph,
    out: Annotated[Path, picture_file("graph.png")],
    map_: MapOption = None,
    _style: options.Style = "screen",
) -> None:
    """Draw a graph, on a map with --map."""
    graph = load_graph(graph_file)
    plot_graph(graph, out, grid=None if map_ is None else map_of(map_)[1], title=graph_file.stem)
    print_files({"picture": str(out)})


@app.command("from-map")
@options.with_options(robot=RobotOptions)
def from_map(
    map_: options.Map,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="FILE|DIR",
            help="Graph to write; in a folder: graph.geojson.",
            callback=file_in("graph.geojson"),
        ),
    ],
    robot: RobotOptions = RobotOptions(),
    clearance: Annotated[
        float | None,
        typer.Option(
            "--clearance",
            metavar="M",
            help="Distance of edges to obstacles (m). [default: circumscribed radius of the footprint]",
            min=0.0,
        ),
    ] = None,
    spacing: Annotated[
        float, typer.Option("--spacing", metavar="M", help="Greatest length of an edge (m).", min=0.1)
    ] = 5.0,
    allow_unknown: Unknown = False,
    json_: options.Json = False,
) -> None:
    """Make a graph from a map: the middle of the free space as straight edges, both ways, with their clearance as metadata.

    Whatever the robot's circle can drive between is connected in the graph.
    """
    path, grid = map_of(map_)
    radius = robot.load().global_costmap.footprint.circumscribed_radius if clearance is None else clearance
    began = time.perf_counter()
    with loading_kernels(quiet=json_):
        graph = graph_from_map(grid, radius, allow_unknown=allow_unknown, spacing=spacing, name=path.stem)
    seconds = time.perf_counter() - began
    save_graph(graph, out)
    least = min(values["clearance"] for values in graph.edge_metadata.values())
    if json_:
        document = {"nodes": len(graph), "edges": graph.edge_count, "clearance_m": radius, "least_clearance_m": least}
        print_json({**document, "time_s": seconds, "files": {"graph": str(out)}})
        return
    kept = f"least clearance {least:.3f} m (wanted: {radius:.3f} m)"
    print(f"{len(graph)} nodes, {graph.edge_count} edges, {kept}, {seconds:.1f} s")
    for note in graph.notes:
        print_note(note)
    print_files({"graph": str(out)})
