"""amcl as a ROS 1 node: the particle filter behind the topics, services and parameters of amcl."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np

from navstack.core import NavError, ParameterError, Pose2D, Transform2D
from navstack.localization import Amcl
from navstack.parameters import (
    AmclParams,
    Binder,
    DictNode,
    Finding,
    Location,
    Parameter,
    Space,
    load_configuration,
    to_node,
    unwrap_ros2,
)
from navstack.plugins import param
from navstack.ros1 import ros
from navstack.ros1.diagnostics import diagnostic_status
from navstack.ros1.localization_node import ScanNode, WaitingScan
from navstack.ros1.reconfigure import RESTORE, ReconfigureServer, kind_of
from navstack.ros_messages import messages as msg
from navstack.ros_node import OK, WARN

# --- the parameters of the node amcl: those of the filter, and those of its topics ------------------------------------


SECTION: Final = "amcl"
_TOPICS: Final = (
    *("use_map_topic", "first_map_only", "save_pose_rate", "tf_broadcast", "transform_tolerance"),
    *("std_warn_level_x", "std_warn_level_y", "std_warn_level_yaw"),
)


class AmclNodeParams(AmclParams):
    """`~` of the node amcl, with the names and defaults of noetic."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        name: reason for name, reason in AmclParams.NO_EFFECT.items() if name not in _TOPICS
    }

    use_map_topic: bool = param(
        False, "receive the map on the topic map instead of asking the service static_map for it"
    )
    first_map_only: bool = param(False, "later maps of the topic are ignored")
    save_pose_rate: float = param(
        0.5,
        "frequency of writing the pose to ~initial_pose_* and ~initial_cov_*; 0 or less = never",
        unit="Hz",
        le=10.0,
    )
    tf_broadcast: bool = param(True, "publish map -> odom")
    transform_tolerance: float = param(
        0.1, "time by which map -> odom is stamped ahead of its scan", unit="s", ge=0.0, le=2.0
    )
    std_warn_level_x: float = param(0.2, "standard deviation of x that is a warning on /diagnostics", unit="m", ge=0.0)
    std_warn_level_y: float = param(0.2, "standard deviation of y that is a warning on /diagnostics", unit="m", ge=0.0)
    std_warn_level_yaw: float = param(
        0.1, "standard deviation of the heading that is a warning on /diagnostics", unit="rad", ge=0.0
    )


class AmclConfiguration(NamedTuple):
    """The parameters, and what they were read from."""

    params: AmclNodeParams
    tree: Mapping[str, Any]
    """The values as written, below `amcl`."""
    findings: tuple[Finding, ...]
    """Warnings and infos."""


def load_amcl(sources: Sequence[Any] = (), overrides: Sequence[str] = ()) -> AmclConfiguration:
    """Return the parameters of the node's private namespace, overlaid by the section `amcl` of the sources (`--params`).

    Raises ParameterError.
    """
    rospy = ros.rospy()
    tree: Any = rospy.get_param("~", {})
    values = {name: value for name, value in tree.items() if name != SECTION} if isinstance(tree, dict) else {}
    return bind_amcl(values, str(rospy.resolve_name("~")), sources, overrides)


def bind_amcl(
    values: Mapping[str, Any], private: str = "~", sources: Sequence[Any] = (), overrides: Sequence[str] = ()
) -> AmclConfiguration:
    """Return the parameters of these values. Raises ParameterError."""
    node = to_node({SECTION: dict(values)}, Location(f"the parameter server, {private}"))
    assert isinstance(node, DictNode)
    whole = load_configuration([node, *sources], overrides=overrides)
    space = whole.tree.space(SECTION) or Space(SECTION, Location(""), whole.tree)
    findings: list[Finding] = []
    unwrap_ros2(space, findings)
    params = Binder(findings, {}).bind(AmclNodeParams, space)
    errors = [f"{item.location}: {item.message}" for item in findings if item.severity == "error"]
    if params is None or errors:
        raise ParameterError("the parameters of amcl cannot be used:\n" + "\n".join(errors))
    own = {f"{SECTION}/{name}" for name in _TOPICS}
    reported = tuple(item for item in whole.findings if item.key.startswith(f"{SECTION}/") and item.key not in own)
    assert isinstance(params, AmclNodeParams)
    return AmclConfiguration(params, space.as_dict(), reported)


NO_SCAN_S: Final = 15.0
"""Time without a scan that is worth a warning (s)."""
ASK_S: Final = 0.5
"""Time between two calls of static_map (s, wall)."""
DIAGNOSTICS_S: Final = 1.0


class AmclNode(ScanNode):
    """The node. `rospy.init_node` must have been called."""

    def __init__(self, configuration: AmclConfiguration) -> None:
        params = self._params = configuration.params
        self._first, self._configuration = configuration, configuration
        super().__init__(params.global_frame_id, params.odom_frame_id, params.base_frame_id, params.transform_tolerance)
        self.filter = Amcl(params)
        self._map: Any = None
        self._updates = 0
        self._rejections = 0
        self._heard_at = self.clock.now()
        self._saved_at = self._told_at = 0.0
        rospy, later = ros.rospy(), self.inbox.poster
        empty = ros.message("std_srvs/srv/Empty")
        self._kept = [
            rospy.Service("global_localization", empty, self.inbox.caller(self._on_global_localization)),
            rospy.Service("request_nomotion_update", empty, self.inbox.caller(self._on_update_request)),
            rospy.Service("set_map", ros.message("nav_msgs/srv/SetMap"), self.inbox.caller(self._on_set_map)),
        ]
        self._diagnostics = rospy.Publisher(
            "/diagnostics", ros.message("diagnostic_msgs/DiagnosticArray"), queue_size=1
        )
        self.subscribe()
        self._server = ReconfigureServer("~", _parameters(params), self._present, self._apply, self.inbox)
        self._map_source = str(rospy.resolve_name("map" if params.use_map_topic else "static_map"))
        if params.use_map_topic:
            rospy.Subscriber("map", ros.message("nav_msgs/OccupancyGrid"), later(self._on_map), queue_size=1)
        else:
            threading.Thread(target=self._ask_for_map, name="static_map", daemon=True).start()

    # --- the map ------------------------------------------------------------------------------------------------------

    def _ask_for_map(self) -> None:
        rospy = ros.rospy()
        service = rospy.ServiceProxy("static_map", ros.message("nav_msgs/srv/GetMap"))
        warned = -NO_SCAN_S
        while not ros.is_stopping():
            try:
                answer = service()
            except rospy.ServiceException:
                if time.monotonic() - warned > NO_SCAN_S:
                    warned = time.monotonic()
                    rospy.logwarn("waiting for a map from the service %s", rospy.resolve_name("static_map"))
                ros.STOP.wait(ASK_S)
                continue
            self.inbox.poster(self._set_map)(answer.map)
            return

    def _on_map(self, message: Any) -> None:
        if self._map is None or not self._params.first_map_only:
            self._set_map(message)

    def _set_map(self, message: Any) -> None:
        grid = msg.map_of(message, self._map_source, self._rospy.logwarn)
        if grid.frame != self.map_frame:
            self._rospy.logwarn('the map is in "%s", and global_frame_id is "%s"', grid.frame, self.map_frame)
        self.filter.set_map(grid)
        self._map = grid
        ny, nx = grid.data.shape
        self._rospy.loginfo("received a map of %d x %d cells, %g m per cell", nx, ny, grid.geometry.resolution)

    # --- services and poses -------------------------------------------------------------------------------------------

    def _on_global_localization(self, request: Any) -> Any:
        del request
        self.filter.start_globally()
        return ros.message("std_srvs/srv/EmptyResponse")()

    def _on_update_request(self, request: Any) -> Any:
        del request
        self.filter.request_update()
        return ros.message("std_srvs/srv/EmptyResponse")()

    def _on_set_map(self, request: Any) -> Any:
        """Use a map and a pose; the answer is always success, as in ROS. What cannot be used is logged."""
        for use, value in ((self._set_map, request.map), (self._on_initial_pose, request.initial_pose)):
            try:
                use(value)
            except NavError as exc:
                self.report(exc)
        return ros.message("nav_msgs/srv/SetMapResponse")(success=True)

    def set_pose(self, message: Any) -> None:
        """Restart around a pose. Raises NavError for an invalid pose."""
        pose = msg.pose_of(message.pose.pose)
        full = np.array(message.pose.covariance, np.float64).reshape(6, 6)
        stamp = message.header.stamp
        at = float("inf") if stamp.is_zero() else self.clock.of(stamp)
        self.filter.set_pose(pose, full[np.ix_((0, 1, 5), (0, 1, 5))], at)
        self._rospy.loginfo("initial pose x %.3f, y %.3f, yaw %.3f", *pose)

    # --- scans --------------------------------------------------------------------------------------------------------

    def on_scan(self, message: Any) -> None:
        """Receive a scan, and note when."""
        self._heard_at = self.clock.now()
        super().on_scan(message)

    def process(self, now: float) -> None:
        """Update the filter with the scans whose odometry is known."""
        self.use_waiting_scans()
        if now - self._heard_at > NO_SCAN_S:
            self._heard_at = now
            self._rospy.logwarn("no scan on %s for %g s", self._rospy.resolve_name("scan"), NO_SCAN_S)
        self._save_pose(now)
        self._publish_diagnostics()

    def use_scan(self, waiting: WaitingScan, odometry: Transform2D, sensor: Transform2D) -> None:
        """Update the filter; publish its pose, its particles and map -> odom."""
        estimate = self.filter.update(odometry, waiting.scan, sensor)
        if self.filter.updates != self._updates:
            self._updates = self.filter.updates
            self.poses.publish_particles(self.clock.ns(self.clock.now()), self.filter.possible_poses()[0])
        if estimate is not None:
            self.poses.publish_pose(waiting.stamp_ns, estimate.pose, estimate.covariance)
        last = self.filter.estimate
        if last is not None and self._params.tf_broadcast:
            self.tf.publish(waiting.stamp_ns, last.map_to_odom)

    # --- periodic messages --------------------------------------------------------------------------------------------

    def _save_pose(self, now: float, *, is_last: bool = False) -> None:
        """Write the pose to the parameters of the start, so that a new node begins there."""
        rate, estimate = self._params.save_pose_rate, self.filter.estimate
        if rate <= 0.0 or estimate is None or (now - self._saved_at < 1.0 / rate and not is_last):
            return
        self._saved_at = now
        covariance = estimate.covariance
        names = (
            "initial_pose_x",
            "initial_pose_y",
            "initial_pose_a",
            "initial_cov_xx",
            "initial_cov_yy",
            "initial_cov_aa",
        )
        values = (*estimate.pose, covariance[0, 0], covariance[1, 1], covariance[2, 2])
        for name, value in zip(names, values, strict=True):
            self._rospy.set_param(f"~{name}", float(value))

    def _publish_diagnostics(self) -> None:
        wall, estimate = time.monotonic(), self.filter.estimate
        if wall < self._told_at + DIAGNOSTICS_S:
            return
        self._told_at = wall
        if estimate is None or not self._diagnostics.get_num_connections():
            return
        params = self._params
        spread = np.sqrt(np.diag(estimate.covariance)).tolist()
        limits = (params.std_warn_level_x, params.std_warn_level_y, params.std_warn_level_yaw)
        values: dict[str, Any] = dict(zip(("std_x", "std_y", "std_yaw"), spread, strict=True))
        values |= dict(zip(("std_warn_level_x", "std_warn_level_y", "std_warn_level_yaw"), limits, strict=True))
        is_large = any(value > limit for value, limit in zip(spread, limits, strict=True))
        name = f"{str(self._rospy.get_name()).removeprefix('/')}: Standard deviation"
        message = ros.message("diagnostic_msgs/DiagnosticArray")()
        message.header.stamp = self._rospy.Time.now()
        message.status = [diagnostic_status(WARN if is_large else OK, name, "Too large" if is_large else "OK", values)]
        self._diagnostics.publish(message)

    def end(self) -> None:
        """Keep the last pose for the next start."""
        self._save_pose(self.clock.now(), is_last=True)

    # --- dynamic_reconfigure ------------------------------------------------------------------------------------------

    def _present(self) -> dict[str, Any]:
        return self._params.model_dump()

    def _apply(self, values: Any) -> None:
        """Use other parameters: the filter restarts around its estimate, as in ROS. Raises NavError and changes nothing."""
        changed = {name: value for name, value in values.items() if name != RESTORE}
        tree = self._first.tree if values.get(RESTORE) is True else {**self._configuration.tree, **changed}
        new = bind_amcl(tree)
        estimate = self.filter.estimate
        fresh = Amcl(new.params)
        if self._map is not None:
            fresh.set_map(self._map)
        if estimate is not None:
            fresh.set_pose(Pose2D(*estimate.pose), estimate.covariance, float("inf"))
        self.filter, self._configuration, self._params, self._updates = fresh, new, new.params, 0
        self.tf.ahead_s = new.params.transform_tolerance


def _parameters(params: AmclNodeParams) -> list[Parameter]:
    """Return what dynamic_reconfigure can change: single values, but for the start, which the node writes itself."""
    found = [
        Parameter(name, getattr(params, name), None, info)
        for name, info in type(params).model_fields.items()
        if not name.startswith(("initial_", "random_seed"))
    ]
    return [parameter for parameter in found if kind_of(parameter)]
