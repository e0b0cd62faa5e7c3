"""The route graph that pages edit together: requests to edits, the graph as a page draws it, checks and files."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from navstack.core import InputError, OutputError, ensure_directory, exists, resolved
from navstack.live import messages
from navstack.live.session import Session
from navstack.routes import FollowRoute, GraphDraft, check_graph, graph_from_map, graph_text, load_graph, save_graph

SUFFIX: Final = ".geojson"


class GraphEditor:
    """One graph for all pages of a server."""

    def __init__(self, file: Path | None = None, folder: Path | None = None) -> None:
        """`file` is that of `--graph`: the graph is saved next to it; without one into `folder`, that of `--save-to`.

        Raises InvalidGraphError for a file that cannot be read or edited.
        """
        self.draft = GraphDraft(None if file is None else load_graph(file))
        self.file = file
        self._folder = folder if file is None else file.parent
        self._own: set[Path] = set() if file is None else {resolved(file)}
        """Files that may be replaced: the one of the command line, and those saved in this session."""

    @property
    def folder(self) -> Path | None:
        """Where the graph is saved; None: nowhere."""
        return self._folder

    def data(self) -> dict[str, Any]:
        """Return the graph as a page draws it: nodes [id, x, y], edges [id, start, end, attributes]."""
        draft = self.draft
        return {
            "version": draft.version,
            "name": self.file.stem if self.file is not None else draft.name or "graph",
            "folder": None if self._folder is None else str(self._folder),
            "can_undo": draft.can_undo,
            "nodes": [[number, round(node.x, 4), round(node.y, 4)] for number, node in draft.nodes.items()],
            "edges": [
                [
                    number,
                    edge.start,
                    edge.end,
                    {
                        **{k: v for k, v in edge.metadata.items() if k in ("speed_limit", "penalty", "class")},
                        **({"cost": round(edge.cost, 6)} if edge.cost > 0.0 else {}),
                        **({} if edge.overridable else {"overridable": False}),
                    },
                ]
                for number, edge in draft.edges.items()
            ],
        }

    def edit(self, request: Any, session: Session) -> tuple[str, Any]:
        """Carry out a request that changes the graph; return a sentence and the graph. Raises NavError."""
        draft, text = self.draft, ""
        match request:
            case messages.GraphFromMap():
                grid, radius = session.scenario.map, _radius(session)
                name = str(session.scenario.names.get("map", "")) or "graph"
                draft.replace_by(graph_from_map(grid, radius, spacing=request.spacing, name=Path(name).stem))
                text = f"{len(draft.nodes)} nodes and {len(draft.edges)} edges, {radius:.2f} m from obstacles"
            case messages.AddNode():
                text = f"node {draft.add_node(request.x, request.y)}"
            case messages.MoveNode():
                draft.move_node(request.node, request.x, request.y)
            case messages.Connect():
                draft.connect(request.start, request.end, both_ways=request.both_ways)
            case messages.DeleteFromGraph():
                draft.delete(request.nodes, request.edges)
            case messages.SetEdges():
                draft.set_attributes(request.edges, request.values)
            case messages.UndoGraph():
                draft.undo()
            case _:
                raise InputError(f"{request.type} does not change the graph")
        session.changes += 1  # other pages look at once
        return text, self.data()

    def check(self, session: Session) -> tuple[str, Any]:
        """Return what is wrong with the graph on the map of the session, each with where it is (m)."""
        graph = self.draft.graph()
        findings = check_graph(
            graph, session.scenario.map, session.run.interventions.configuration.global_costmap.footprint
        )
        shown: list[dict[str, Any]] = []
        for finding in findings:
            places = [graph.xy[graph.node(node)] for node in finding.nodes[:1]]
            for edge in finding.edges[:1]:
                k = graph.edge(edge)
                places.append(0.5 * (graph.xy[graph.starts[k]] + graph.xy[graph.ends[k]]))
            shown.append({**asdict(finding), "at": [round(float(v), 3) for v in places[0]] if places else None})
        errors = sum(finding.severity == "error" for finding in findings)
        return (
            f"{len(graph)} nodes, {graph.edge_count} edges: {errors} errors, {len(findings) - errors} warnings",
            shown,
        )

    def save(self, name: str) -> tuple[str, Any]:
        """Write the graph as `name`.geojson. Raises OutputError, and InvalidGraphError for a graph without nodes or edges.

        A file that was there before the session is replaced only if it is that of `--graph`.
        """
        if self._folder is None:
            raise OutputError("nothing can be saved: start navstack live with --graph FILE or --save-to DIR")
        graph = self.draft.graph()
        target = self._folder / f"{name.removesuffix(SUFFIX)}{SUFFIX}"
        if resolved(target).parent != resolved(self._folder):
            raise OutputError(f'"{name}" leads out of {self._folder}; choose another name')
        if exists(target) and resolved(target) not in self._own:
            raise OutputError(f"{target} exists already; choose another name")
        ensure_directory(self._folder)
        save_graph(graph, target)
        self._own.add(resolved(target))
        return f"saved {target}; check it with: navstack route check {target}", str(target)

    def drive_step(self, node: int) -> dict[str, Any]:
        """Return the step that drives to a node along the graph so far. Raises InvalidGraphError."""
        graph = self.draft.graph()
        graph.node(node)
        name = self.file.name if self.file is not None else f"graph{SUFFIX}"
        return {"route": name, "to": node, "graph": graph_text(graph)}


def _radius(session: Session) -> float:
    return session.run.interventions.configuration.global_costmap.footprint.circumscribed_radius


def route_now(session: Session) -> dict[str, Any] | None:
    """Return the route that is being driven, as a page shows it: ids of its edges, the current edge, the next node."""
    running = session.run.move_base.motions.running
    motion = None if running is None else running.motion
    feedback = motion.feedback() if isinstance(motion, FollowRoute) else None
    if feedback is None:
        return None
    return {
        "edges": list(feedback.route.route.edge_ids),
        "edge": feedback.current_edge_id,
        "next": feedback.next_node_id,
        "rerouted": feedback.rerouted,
    }
