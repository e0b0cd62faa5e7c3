"""Routes on a graph: GeoJSON graphs of nav2_route, edge scorers, shortest routes, their paths, checks, and driving them."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.routes.check import GraphFinding as GraphFinding
    from navstack.routes.check import check_graph as check_graph
    from navstack.routes.edit import GraphDraft as GraphDraft
    from navstack.routes.errors import InvalidGraphError as InvalidGraphError
    from navstack.routes.errors import NoValidRouteError as NoValidRouteError
    from navstack.routes.errors import RouteError as RouteError
    from navstack.routes.errors import RouteFrameError as RouteFrameError
    from navstack.routes.follow import FollowRoute as FollowRoute
    from navstack.routes.follow import RouteFeedback as RouteFeedback
    from navstack.routes.follow import TrackedRoute as TrackedRoute
    from navstack.routes.from_map import graph_from_map as graph_from_map
    from navstack.routes.geojson import graph_text as graph_text
    from navstack.routes.geojson import load_graph as load_graph
    from navstack.routes.geojson import load_points as load_points
    from navstack.routes.geojson import parse_graph as parse_graph
    from navstack.routes.geojson import save_graph as save_graph
    from navstack.routes.graph import MAX_ID_IN_MESSAGES as MAX_ID_IN_MESSAGES
    from navstack.routes.graph import Operation as Operation
    from navstack.routes.graph import RouteGraph as RouteGraph
    from navstack.routes.graph import build_graph as build_graph
    from navstack.routes.parameters import read_operations as read_operations
    from navstack.routes.parameters import read_scorers as read_scorers
    from navstack.routes.planner import RoutePlanner as RoutePlanner
    from navstack.routes.route import PlannedRoute as PlannedRoute
    from navstack.routes.route import Route as Route
    from navstack.routes.route import RouteParams as RouteParams
    from navstack.routes.scorers import DynamicEdgesScorer as DynamicEdgesScorer
    from navstack.routes.scorers import EdgeScorer as EdgeScorer
    from navstack.routes.tracking import RouteOperation as RouteOperation
    from navstack.routes.tracking import TriggerEvent as TriggerEvent
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
