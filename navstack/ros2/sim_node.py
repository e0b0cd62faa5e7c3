"""The simulated robot as a ROS 2 node: scan, odometry, tf, clock, IMU, battery, map server and amcl; cmd_vel in.

A Nav2 of its own drives it, as it drives loopback_simulator or a robot in Gazebo.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import BatteryState, Pose2D
from navstack.map_io import load_map
from navstack.ros2 import ros
from navstack.ros2.lifecycle import offer_manager, offer_state
from navstack.ros2.ros import Publisher, RosNode
from navstack.ros_node import (
    START_NS,
    ClockPace,
    Pace,
    SharedWorld,
    SimLoop,
    SimNames,
    WallPace,
    run_fleet,
    with_imus,
)
from navstack.scenario import Scenario
from navstack.sim import World

IMUS: Final = ("imu",)
BATTERY_PERIOD_S: Final = 1.0
EMPTY_AFTER_S: Final = 7200.0
"""Time of operation (s) after which a battery is empty that the parameters do not describe; it is full at the start."""
VOLTAGE: Final = (11.1, 12.6)
"""Of an empty and of a full battery (V)."""
SENSORS: Final = frozenset(("sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Range"))
CHARGING, DISCHARGING = 1, 2
"""power_supply_status of sensor_msgs/BatteryState."""
MAP_SUCCESS, MAP_DOES_NOT_EXIST, MAP_INVALID_DATA = 0, 1, 2
"""Results of nav2_msgs/LoadMap."""


class SimNode(SimLoop):
    """The node."""

    def __init__(
        self, scenario: Scenario, node: RosNode, *, pace: Pace, clock: bool, shared: SharedWorld | None = None
    ) -> None:
        """`clock`: publish `/clock`; `shared`: what it has in common with the other robots of a fleet.

        Parameters: `frame_prefix` before the robot's frames; `localization` (true) false: another node localizes the robot;
        `enable_stamped_cmd_vel`: TwistStamped, by default as in Nav2 of the distribution. Raises InputError for wrong ones.
        """
        self.node = node
        handle = node.handle
        prefix = ros.value_of(handle, "frame_prefix", "", "a text")
        is_localized = ros.value_of(handle, "localization", True, "true or false")
        stamped = ros.value_of(handle, "enable_stamped_cmd_vel", ros.is_at_least("kilted"), "true or false")
        scenario = with_imus(scenario, scenario.configuration.navstack.sim.imus or list(IMUS))
        fixed = (scenario, node.build, pace, node.log)
        super().__init__(*fixed, clock=clock, localization=is_localized, shared=shared)
        own = (self.robot.map_frame, self.robot.odom_frame, self.robot.base_frame)
        self.names = SimNames(own, own, prefix)
        self._battery_due = 0.0
        self._publishers: dict[str, Publisher] = {}
        self._map = node.publisher("map", "nav_msgs/msg/OccupancyGrid", latched=True)
        self._static = node.publisher("/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
        self._pose = node.publisher("amcl_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", latched=True)
        self._particles: Publisher | None = None
        if is_localized and ros.has_message("nav2_msgs/msg/ParticleCloud"):
            self._particles = node.publisher("particle_cloud", "nav2_msgs/msg/ParticleCloud", reliable=False)
        later = self.inbox.poster
        kind = "geometry_msgs/msg/TwistStamped" if stamped else "geometry_msgs/msg/Twist"
        node.subscribe("cmd_vel", kind, later(self.receive_command, most=1))
        if is_localized:
            pose = "geometry_msgs/msg/PoseWithCovarianceStamped"
            node.subscribe("initialpose", pose, later(self.receive_pose, most=1))
        self._serve(is_localized)
        self._grid = dataclasses.replace(scenario.map, frame=self.names.map)
        if clock:
            self.publish_clock(0.0)
        self._static.publish(self.static_transforms())
        self._publish_map()

    def _serve(self, is_localized: bool) -> None:
        node, inbox = self.node, self.inbox
        node.serve("map_server/map", "nav_msgs/srv/GetMap", inbox, self._on_get_map)
        node.serve("reset_positions", "std_srvs/srv/Empty", inbox, self._on_reset)
        if ros.has_message("nav2_msgs/srv/LoadMap"):
            node.serve("map_server/load_map", "nav2_msgs/srv/LoadMap", inbox, self._on_load_map)
        offer_state(node, inbox, "map_server")
        if is_localized:
            offer_state(node, inbox, "amcl")
            offer_manager(node, "lifecycle_manager_localization", lambda: True)
            for name in ("reinitialize_global_localization", "request_nomotion_update"):
                node.serve(name, "std_srvs/srv/Empty", inbox, _nothing)
            if ros.has_message("nav2_msgs/srv/SetInitialPose"):
                node.serve("set_initial_pose", "nav2_msgs/srv/SetInitialPose", inbox, self._on_set_pose)

    def _publish_map(self) -> None:
        self._map.publish(self.build.map(self.ns(self.robot.time), self._grid))

    # --- services -----------------------------------------------------------------------------------------------------

    def _on_get_map(self, request: Any, response: Any) -> None:
        del request
        response.map = self.build.map(self.ns(self.robot.time), self._grid)

    def _on_load_map(self, request: Any, response: Any) -> None:
        """Load a map file and publish it. The simulated world remains: only what the robot knows of it changes."""
        url = str(request.map_url).removeprefix("file://")
        response.result = MAP_INVALID_DATA if Path(url).expanduser().exists() else MAP_DOES_NOT_EXIST
        self._grid = dataclasses.replace(load_map(url), frame=self.names.map)
        self._publish_map()
        response.map = self.build.map(self.ns(self.robot.time), self._grid)
        response.result = MAP_SUCCESS

    def _on_set_pose(self, request: Any, response: Any) -> None:
        del response
        self.receive_pose(request.pose)

    def _on_reset(self, request: Any, response: Any) -> None:
        del request, response
        self.robot.place(self.scenario.start)

    # --- messages out -------------------------------------------------------------------------------------------------

    def publish(self, topic: str, kind: str, message: Any) -> None:
        """Publish a message; sensor data are best effort, as of drivers."""
        found = self._publishers.get(topic)
        if found is None:
            depth = {"/clock": 1, "/tf": 100}.get(topic, 10)
            found = self.node.publisher(topic, kind, depth=depth, reliable=kind not in SENSORS)
            self._publishers[topic] = found
        found.publish(message)

    def publish_pose(self, stamp_ns: int, pose: Pose2D, covariance: NDArray[np.float64] | None) -> None:
        """Publish `amcl_pose` and `particle_cloud`, which has one particle."""
        full = np.zeros((6, 6))
        if covariance is not None:
            full[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
        build, header = self.build, self.build.header(stamp_ns, self.names.map)
        spread = build.of("geometry_msgs/msg/PoseWithCovariance", pose=build.pose(pose), covariance=full.ravel())
        self._pose.publish(build.of("geometry_msgs/msg/PoseWithCovarianceStamped", header=header, pose=spread))
        if self._particles is not None:
            particle = build.of("nav2_msgs/msg/Particle", pose=build.pose(pose), weight=1.0)
            self._particles.publish(build.of("nav2_msgs/msg/ParticleCloud", header=header, particles=[particle]))

    def publish_more(self, stamp_ns: int) -> None:
        """Publish the state of the battery once a second."""
        now = self.robot.time
        if now < self._battery_due:
            return
        self._battery_due = now + BATTERY_PERIOD_S
        charge, seen = max(0.0, 1.0 - now / EMPTY_AFTER_S), self.robot.battery_state
        if seen is None:
            seen = BatteryState(charge, 0.0, VOLTAGE[0] + charge * (VOLTAGE[1] - VOLTAGE[0]))
        battery = self.build.of(
            "sensor_msgs/msg/BatteryState",
            header=self.build.header(stamp_ns, self.names.base),
            voltage=seen.voltage,
            current=seen.current,
            percentage=seen.charge,
            power_supply_status=CHARGING if seen.current > 0.0 else DISCHARGING,
            present=True,
        )
        self.publish("battery_state", "sensor_msgs/msg/BatteryState", battery)

    # --- run ----------------------------------------------------------------------------------------------------------

    def is_stopping(self) -> bool:
        """Return True if the node must end."""
        return self.node.is_stopping()


def simulate(scenario: Scenario, node: RosNode, *, speed: float, clock: bool) -> None:
    """Simulate a robot until the node is shut down. Raises InputError for wrong parameters.

    `speed`: simulated seconds per second. `clock`: publish `/clock`; otherwise ROS's time is kept, and `speed` is 1. If
    use_sim_time is set and `clock` is not, the node waits for the clock of another one.
    """
    made = SimNode(scenario, node, pace=_pace(node, speed, clock), clock=clock)
    node.log.loginfo("the simulated robot is ready")
    try:
        made.run()
    finally:
        node.shut_down(_end)


def simulate_fleet(world: World, robots: Mapping[str, Scenario], node: RosNode, *, speed: float, clock: bool) -> None:
    """As `simulate`, for robots by name in one world; the topics and services of each are those below its name."""
    shared, pace = SharedWorld(world, robots), _pace(node, speed, clock)
    made: dict[str, SimNode] = {}
    for name, scenario in robots.items():
        made[name] = SimNode(scenario, node.below(name), pace=pace, clock=clock and not made, shared=shared)
    node.log.loginfo("the simulated robots %s are ready", ", ".join(made))
    try:
        run_fleet(made)
    finally:
        node.shut_down(_end)


def _nothing(request: Any, response: Any) -> None:
    del request, response


def _end() -> None:
    pass


def _pace(node: RosNode, speed: float, clock: bool) -> Pace:
    if clock:
        return WallPace(speed, START_NS)
    if node.wait_for_clock():
        return ClockPace(node.now_ns)
    return WallPace(1.0, node.now_ns(), stamps_wall_time=True)
