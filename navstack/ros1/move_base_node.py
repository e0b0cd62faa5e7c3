"""move_base as a ROS 1 node: the goal manager behind the topics, services and parameters that clients of move_base know."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from navstack.core import Event, Listener, Twist2D
from navstack.move_base import MoveBase, ThreadPlanning, TickResult
from navstack.parameters import Configuration
from navstack.replay import sensor_topics
from navstack.ros1 import ros
from navstack.ros1.action import ActionInterface
from navstack.ros1.costmap_topics import CostmapInputs, CostmapTopics
from navstack.ros1.diagnostics import Diagnostics
from navstack.ros1.node import MasterWatch, wait_for_clock
from navstack.ros1.plan_topics import CloudTopics, PlanTopics
from navstack.ros1.reconfigure import ReconfigureServers
from navstack.ros1.services import Services
from navstack.ros_messages import MessageBuilder, topic_name
from navstack.ros_messages import messages as msg
from navstack.ros_node import (
    MOST_ODOMETRY,
    MOST_SENSOR_DATA,
    MOST_TRANSFORMS,
    RECEIVERS,
    NodeClock,
    RecordFolder,
    StackNode,
    layered_costmaps,
)


class MoveBaseNode(StackNode):
    """The node. `rospy.init_node` must have been called."""

    name = "ros1"

    def __init__(self, configuration: Configuration, record: RecordFolder | None = None) -> None:
        rospy = self._rospy = ros.rospy()
        is_simulated = wait_for_clock()
        self.build = MessageBuilder(ros.MessageTypes(), ros1=True)
        self._cmd_vel = rospy.Publisher("cmd_vel", ros.message("geometry_msgs/Twist"), queue_size=1)
        super().__init__(configuration, rospy, NodeClock(ros.now_ns), is_simulated=is_simulated, record=record)
        self.action = ActionInterface(self.clock, self.build, self.inbox)
        self.plans: PlanTopics | None = None
        self.diagnostics: Diagnostics | None = None
        self.costmaps: list[CostmapTopics] = []
        self._subscribe()

    # --- messages -----------------------------------------------------------------------------------------------------

    def _subscribe(self) -> None:
        rospy, robot = self._rospy, self.robot
        tf, odometry = ros.message("tf2_msgs/TFMessage"), ros.message("nav_msgs/Odometry")

        later = self.inbox.poster
        if self._is_simulated:
            # every step of the clock wakes the node
            clock = ros.message("rosgraph_msgs/Clock")
            rospy.Subscriber("/clock", clock, later(self.wake, most=1), queue_size=10, tcp_nodelay=True)
        rospy.Subscriber("/tf_static", tf, later(robot.receive_transforms, static=True), queue_size=100)
        rospy.Subscriber("/tf", tf, later(robot.receive_transforms, static=False, most=MOST_TRANSFORMS), queue_size=100)
        odom = str(getattr(self.configuration.local_planner.params, "odom_topic", "odom"))
        rospy.Subscriber(
            odom, odometry, later(robot.receive_odometry, most=MOST_ODOMETRY), queue_size=1, tcp_nodelay=True
        )
        sensors = sensor_topics(self.configuration).values()
        self.sensor_topics = sorted(sensor.name for sensor in sensors)
        for sensor in sensors:
            kind, method = RECEIVERS[sensor.type]
            receive = later(self.receive_data, getattr(robot, method), sensor.name, most=MOST_SENSOR_DATA)
            message = ros.array_message(kind)
            rospy.Subscriber(sensor.name, message, receive, queue_size=MOST_SENSOR_DATA, tcp_nodelay=True)
        rospy.Subscriber(
            self.map_topic(), ros.message("nav_msgs/OccupancyGrid"), later(self._on_map, most=1), queue_size=1
        )

    def _on_map(self, message: Any) -> None:
        topic = str(self._rospy.resolve_name(self.map_topic()))
        self.use_map(msg.map_of(message, topic, self._rospy.logwarn))

    def publish_command(self, twist: Twist2D) -> None:
        """Publish a velocity."""
        self._cmd_vel.publish(self.build.twist(twist))

    # --- topics and services ------------------------------------------------------------------------------------------

    def listeners(self) -> list[Listener]:
        """Return the node and its action."""
        return [self, self.action]

    def connect(self, move_base: MoveBase, planning: ThreadPlanning) -> None:
        """Create topics and services of the goal manager, and take the goals that wait."""
        self.plans = PlanTopics(self.configuration, self.clock, self.build)
        self.clouds = CloudTopics(self.configuration, planning, self.clock, self.build)
        self.costmaps = [
            CostmapTopics(costmap, self.clock, self.build, self.inbox) for costmap in layered_costmaps(move_base)
        ]
        self._inputs = [CostmapInputs(topics.costmap, self.inbox) for topics in self.costmaps]
        publish_plan = self.plans.publish_plan
        Services(self.configuration, move_base, self.clock, self.build, self.inbox, publish_plan)
        self.action.connect(move_base)
        self.diagnostics = Diagnostics(self.robot, self.times, self.clock, self.build)
        servers = ReconfigureServers(self.configuration, move_base, self.inbox)
        self.watch = MasterWatch(lambda: self.inbox.post(servers.write))

    def publish_tick(self, move_base: MoveBase, tick: TickResult) -> None:
        """Publish costmaps, plans and clouds."""
        for topics, window in zip(self.costmaps, (tick.global_window, tick.local_window), strict=False):
            topics.publish(tick.time, window)
        if self.plans is not None:
            self.plans.publish(move_base, tick)
            self.clouds.publish(move_base, tick)

    def publish_state(self, move_base: MoveBase, now: float) -> None:
        """Publish the status of the goals."""
        self.action.publish(now)

    def publish_rest(self, move_base: MoveBase, now: float) -> None:
        """Publish the diagnostics."""
        if self.diagnostics is not None:
            self.diagnostics.publish(move_base, now)

    def is_stopping(self) -> bool:
        """Return True if the node must end."""
        return ros.is_stopping()

    def shut_down(self, last: Callable[[], None]) -> None:
        """Call `last`, and disconnect."""
        ros.shut_down(last)

    def on_event(self, event: Event) -> None:
        """Log events, and publish goals and recovery behaviors."""
        super().on_event(event)
        if self.plans is not None:
            self.plans.on_event(event, self.move_base)


def run(configuration: Configuration, record: RecordFolder | None = None) -> None:
    """Run the node until it is shut down; `record` is where it keeps the record of its cycles. Raises OutputError."""
    MoveBaseNode(configuration, record).spin()


def topics_of(configuration: Configuration) -> Sequence[str]:
    """Return the topics of sensors that the node subscribes to."""
    return sorted(topic_name(name) for name in sensor_topics(configuration))
