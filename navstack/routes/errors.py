"""Errors of route graphs. Their codes, 400 to 407, are those of Nav2's ComputeRoute and ComputeAndTrackRoute."""

from __future__ import annotations

from navstack.core import InputError, NavError


class RouteError(NavError):
    """A route cannot be computed or driven."""

    code = 400
    name = "UNKNOWN"


class RouteFrameError(RouteError):
    """The robot's pose is not known in the frame of the graph."""

    code = 401
    name = "TF_ERROR"


class InvalidGraphError(RouteError, InputError):
    """A graph is invalid. `data` has file, line and column, or the number of the feature."""

    code = 402
    name = "NO_VALID_GRAPH"


class IndeterminateNodesError(RouteError):
    """No node of the graph belongs to the start or to the goal."""

    code = 403
    name = "INDETERMINANT_NODES_ON_GRAPH"


class RouteTimeoutError(RouteError):
    """The search ended after `max_iterations`."""

    code = 404
    name = "TIMEOUT"


class NoValidRouteError(RouteError):
    """The graph does not connect start and goal, or only by edges that are closed or blocked."""

    code = 405
    name = "NO_VALID_ROUTE"


class OperationFailedError(RouteError):
    """An operation of the graph failed while a route was driven, or is unknown."""

    code = 406
    name = "OPERATION_FAILED"


class EdgeScorerUseError(RouteError, InputError):
    """An edge scorer needs the poses of start and goal, but the request has only nodes."""

    code = 407
    name = "INVALID_EDGE_SCORER_USE"
