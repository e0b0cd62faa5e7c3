"""move_base as a ROS 1 node: the goal manager behind the topics, services and parameters that clients of move_base know."""

from __future__ import annotations

import gc
import math
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from navstack.bringup import build_move_base
from navstack.core import Event, GridGeometry, Listener, NavError, OccupancyGrid, Pose2D, Twist2D, compile_ahead
from navstack.costmap import LayeredCostmap
from navstack.move_base import Mode, MoveBase, ThreadPlanning, TickResult
from navstack.parameters import Configuration
from navstack.replay import sensor_topics
from navstack.ros1 import ros
from navstack.ros1.action import ActionInterface
from navstack.ros1.costmap_topics import CostmapInputs, CostmapTopics
from navstack.ros1.diagnostics import Diagnostics, LoopTimes
from navstack.ros1.live_record import LiveRecord, RecordFolder
from navstack.ros1.node import Inbox, MasterWatch, NodeClock, NodeLog, StillClock, wait_for_clock
from navstack.ros1.plan_topics import CloudTopics, PlanTopics
from navstack.ros1.reconfigure import ReconfigureServers
from navstack.ros1.robot import RECEIVERS, RosRobot
from navstack.ros1.services import Services
from navstack.ros_messages import MessageBuilder, topic_name
from navstack.ros_messages import messages as msg
from navstack.scenario import Scenario, warm_up

POLL_S: Final = 0.1
"""Longest wait for messages (s, wall)."""
QUIET_S: Final = 0.005
"""What can wait is published if no cycle is due within this time (s)."""
MOST_TRANSFORMS: Final = 5_000
"""Messages of /tf that wait for the loop."""
MOST_ODOMETRY: Final = 10
MOST_SENSOR_DATA: Final = 50
"""Messages of a topic that wait for the loop; beyond, the oldest are dropped, as by the queue of costmap_2d."""
MOST_CYCLES: Final = 2
"""Cycles whose publications wait: on a machine that is too slow, no time is quiet."""
SWITCH_S: Final = 0.0005
"""Longest time (s) for which another thread of Python keeps the loop waiting; 5 ms by default."""


class MoveBaseNode:
    """The node. `rospy.init_node` must have been called."""

    def __init__(self, configuration: Configuration, record: RecordFolder | None = None) -> None:
        rospy = self._rospy = ros.rospy()
        self.configuration = configuration
        self._record_folder = record
        self.record: LiveRecord | None = None
        self.inbox = Inbox()
        self._is_simulated = wait_for_clock()
        self.clock = NodeClock(rospy)
        self.build = MessageBuilder(ros.MessageTypes(), ros1=True)
        self._cmd_vel = rospy.Publisher("cmd_vel", ros.message("geometry_msgs/Twist"), queue_size=1)
        self.robot = RosRobot(self.clock, self._publish_command, self._report)
        self.action = ActionInterface(self.clock, self.build, self.inbox)
        self.plans: PlanTopics | None = None
        self.diagnostics: Diagnostics | None = None
        self.costmaps: list[CostmapTopics] = []
        self.move_base: MoveBase | None = None
        self._map: OccupancyGrid | None = None
        self.times = LoopTimes(is_simulated=self._is_simulated)
        self._still = StillClock(rospy)
        self.log = NodeLog(rospy, self._newest_data)
        self._jumps = 0
        self._waiting: list[Callable[[], None]] = []
        """Publications of the last cycles."""
        self._lead = ""
        """Topic of the scans that the cycles follow."""
        self._subscribe()

    # --- messages -----------------------------------------------------------------------------------------------------

    def _subscribe(self) -> None:
        rospy, robot = self._rospy, self.robot
        tf, odometry = ros.message("tf2_msgs/TFMessage"), ros.message("nav_msgs/Odometry")

        later = self.inbox.poster
        if self._is_simulated:
            # every step of the clock wakes the node
            clock = ros.message("rosgraph_msgs/Clock")
            rospy.Subscriber("/clock", clock, later(self._on_clock, most=1), queue_size=10, tcp_nodelay=True)
        rospy.Subscriber("/tf_static", tf, later(robot.receive_transforms, static=True), queue_size=100)
        rospy.Subscriber("/tf", tf, later(robot.receive_transforms, static=False, most=MOST_TRANSFORMS), queue_size=100)
        odom = str(getattr(self.configuration.local_planner.params, "odom_topic", "odom"))
        rospy.Subscriber(
            odom, odometry, later(robot.receive_odometry, most=MOST_ODOMETRY), queue_size=1, tcp_nodelay=True
        )
        sensors = sensor_topics(self.configuration).values()
        self._topics = sorted(sensor.name for sensor in sensors)
        for sensor in sensors:
            kind, method = RECEIVERS[sensor.type]
            receive = later(self._on_data, getattr(robot, method), sensor.name, most=MOST_SENSOR_DATA)
            message = ros.array_message(kind)
            rospy.Subscriber(sensor.name, message, receive, queue_size=MOST_SENSOR_DATA, tcp_nodelay=True)
        rospy.Subscriber(
            self._map_topic(), ros.message("nav_msgs/OccupancyGrid"), later(self._on_map, most=1), queue_size=1
        )

    def _on_clock(self, message: Any) -> None:
        """Nothing to do: the message has woken the node."""

    def _on_data(self, message: Any, receive: Callable[[Any, str], None], topic: str) -> None:
        """Receive sensor data. The cycles follow the scans of the first lidar."""
        receive(message, topic)
        if self.move_base is None or not hasattr(message, "ranges"):
            return
        self._lead = self._lead or topic
        if topic == self._lead:
            self.move_base.follow_scans(self.clock.now())

    def _map_topic(self) -> str:
        for costmap in (self.configuration.global_costmap, self.configuration.local_costmap):
            for layer in costmap.layers:
                if layer.cls.traits(layer.params).has_static_map:
                    return str(getattr(layer.params, "map_topic", "map"))
        return "map"

    def _on_map(self, message: Any) -> None:
        grid = msg.map_of(message, str(self._rospy.resolve_name(self._map_topic())), self._rospy.logwarn)
        self._map = grid
        move_base = self.move_base
        if move_base is None:
            return
        self._rospy.loginfo("received a map of %d x %d cells", grid.data.shape[1], grid.data.shape[0])
        for costmap in (move_base.global_costmap, move_base.local_costmap):
            if isinstance(costmap, LayeredCostmap):
                costmap.set_static_map(grid)
        move_base.costmaps_changed()
        if self.record is not None:
            self.record.set_map(grid, move_base)

    def _publish_command(self, twist: Twist2D) -> None:
        self._cmd_vel.publish(self.build.twist(twist))

    # --- start --------------------------------------------------------------------------------------------------------

    def start(self) -> bool:
        """Wait for transforms and the map, then create the goal manager. Returns False if the node was shut down."""
        self._load_kernels()
        if not self._wait_for(self._missing_transform) or not self._wait_for(self._missing_map):
            return False
        listeners: list[Listener] = [self, self.action]
        if self._record_folder is not None:
            self.record = LiveRecord(*self._record_folder, self.configuration, self._map, self.robot)
            listeners.append(self.record)
        planning = ThreadPlanning(on_answer=self.inbox.wake)
        move_base = self.move_base = build_move_base(
            self.configuration,
            self.robot,
            static_map=self._map,
            listeners=listeners,
            planning=planning,
        )
        self.plans = PlanTopics(self.configuration, self.clock, self.build)
        self.clouds = CloudTopics(self.configuration, planning, self.clock, self.build)
        self.costmaps = [
            CostmapTopics(costmap, self.clock, self.build, self.inbox)
            for costmap in (move_base.global_costmap, move_base.local_costmap)
            if isinstance(costmap, LayeredCostmap)
        ]
        self._inputs = [CostmapInputs(topics.costmap, self.inbox) for topics in self.costmaps]
        publish_plan = self.plans.publish_plan
        Services(self.configuration, move_base, self.clock, self.build, self.inbox, publish_plan)
        self.action.connect(move_base)
        self.diagnostics = Diagnostics(self.robot, self.times, self.clock, self.build)
        servers = ReconfigureServers(self.configuration, move_base, self.inbox)
        self.watch = MasterWatch(lambda: self.inbox.post(servers.write))
        # what exists now lives as long as the node: the garbage collector need not visit it in a cycle
        gc.collect()
        gc.freeze()
        sys.setswitchinterval(SWITCH_S)
        self._rospy.loginfo("navstack is ready")
        return True

    def _load_kernels(self) -> None:
        """Compile or load the kernels by a second of simulated driving: the first cycle of the robot must not wait for that.

        Until then nothing is published and no service is offered, so no client takes the node for ready; goals wait.
        """
        begin = time.perf_counter()
        self._rospy.loginfo("loading the kernels, or compiling them once per machine; goals that arrive now wait")
        compile_ahead(self.configuration.planner_names, self._log_compilation)
        size = 200
        grid = OccupancyGrid(np.zeros((size, size), np.int8), GridGeometry(size, size, 0.05, 0.0, 0.0), raw=True)
        scenario = Scenario(grid, self.configuration, Pose2D(5.0, 5.0), (Pose2D(7.0, 5.0),))
        try:
            warm_up(scenario)
        except NavError as exc:
            self._rospy.logwarn(
                "some kernels are compiled while driving, so the first cycles may be late: %s", exc.message
            )
        self._rospy.loginfo("the kernels are loaded after %.1f s", time.perf_counter() - begin)

    def _log_compilation(self, done: int, total: int) -> None:
        self._rospy.loginfo_throttle(5.0, "compiling kernels, once per machine: %d of %d", done, total)

    def _wait_for(self, missing: Any) -> bool:
        """Receive messages until nothing is missing."""
        while not ros.is_stopping():
            self.inbox.run(POLL_S, self._report, longest_s=math.inf)
            text = missing()
            if not text:
                return True
            self.log.problem(text)
            self.log.finish()
        return False

    def _missing_transform(self) -> str:
        for costmap in (self.configuration.global_costmap, self.configuration.local_costmap):
            frame, base = costmap.params.global_frame, costmap.params.robot_base_frame
            try:
                self.robot.frames.lookup(frame, base)
            except NavError as exc:
                return (
                    f"Timed out waiting for transform from {base} to {frame} to become available before running costmap, "
                    f"tf error: {exc.message}"
                )
        return ""

    def _missing_map(self) -> str:
        wanted = any(
            layer.cls.traits(layer.params).has_static_map
            for costmap in (self.configuration.global_costmap, self.configuration.local_costmap)
            for layer in costmap.layers
        )
        return f"waiting for a map on {self._map_topic()}" if wanted and self._map is None else ""

    # --- run ----------------------------------------------------------------------------------------------------------

    def spin(self) -> None:
        """Run until the node is shut down. Messages are received and cycles run in this thread only."""
        try:
            if not self.start():
                return
            assert self.move_base is not None
            self.inbox.run(0.0, self._report, longest_s=math.inf)  # what arrived while the stack was built
            while not ros.is_stopping():
                self._turn(self.move_base)
        finally:
            # also after an error: the robot must not go on with its last velocity
            ros.shut_down(self._end)

    def _turn(self, move_base: MoveBase) -> None:
        """One turn of the loop: a cycle if it is due, what is published regularly, and the messages that wait."""
        now = self.clock.now()
        self.times.clock(now)
        if self.clock.jumps != self._jumps:
            self._jumps = self.clock.jumps
            self._rospy.logwarn("the clock jumped back; transforms and sensor data before it are discarded")
            self.robot.forget()
        if self._is_simulated and self._still.is_new(now):
            # the base may go on with its last velocity while the simulator stands still
            self._publish_command(Twist2D())
        due = move_base.next_due(-math.inf)  # not "at least now": a late cycle shows
        if now >= due:
            self.times.cycle(now, due)
            self._cycle(move_base, now)
            due = move_base.next_due(-math.inf)
        self.action.publish(now)
        self.log.flush(drives=move_base.last_tick.local_plan is not None)
        if due - self.clock.now() > QUIET_S or len(self._waiting) >= MOST_CYCLES:
            self._publish_rest(move_base, now)
        self.times.mark("publishing")
        idle = self.inbox.run(min(due - self.clock.now(), POLL_S), self._report)
        self.times.mark("messages", idle_s=idle)

    def _end(self) -> None:
        """Abort the goal and stop the robot. ROS differs: move_base sends no velocity, and clients lose their goal."""
        self.log.finish()
        move_base = self.move_base
        if move_base is None:
            return
        try:
            move_base.shutdown()
            self.action.publish(self.clock.now())
        finally:
            self._publish_command(Twist2D())
            if self.record is not None:
                self.record.save(move_base, wait=True)

    def _cycle(self, move_base: MoveBase, now: float) -> None:
        move_base.tick(max(now, move_base.now))
        self.times.mark("cycle")
        tick = move_base.last_tick
        if move_base.state is not Mode.CONTROLLING:
            self.times.rest()
        else:
            self.times.command(tick, self.clock.now())
        if self.record is not None:
            self.record.tick(move_base)
            self.times.mark("record")
        self._waiting.append(lambda: self._publish_tick(move_base, tick))

    def _publish_tick(self, move_base: MoveBase, tick: TickResult) -> None:
        for topics, window in zip(self.costmaps, (tick.global_window, tick.local_window), strict=False):
            topics.publish(tick.time, window)
        if self.plans is not None:
            self.plans.publish(move_base, tick)
            self.clouds.publish(move_base, tick)

    def _publish_rest(self, move_base: MoveBase, now: float) -> None:
        """Publish the costmaps and plans of the last cycles, and the diagnostics."""
        for publish in self._waiting:
            publish()
        self._waiting.clear()
        if self.diagnostics is not None:
            self.diagnostics.publish(move_base, now)

    def _report(self, error: NavError) -> None:
        self.log.problem(error.message)

    def _newest_data(self) -> str:
        """Return the ages of the newest sensor data."""
        now = self.clock.now()
        received = self.robot.received
        ages = [f"{name} {now - received[name]:.2f} s old" for name in sorted(received)]
        ages += [f"none on {name}" for name in self._topics if name not in received]
        return f"newest data: {', '.join(ages)}"

    # --- events -------------------------------------------------------------------------------------------------------

    hears_feedback = False

    def on_event(self, event: Event) -> None:
        """Log events, and publish goals and recovery behaviors."""
        if event.kind in ("warning", "plan_failed", "control_failed", "recovery"):
            self.log.event(event)
        if self.plans is not None:
            self.plans.on_event(event, self.move_base)


def run(configuration: Configuration, record: RecordFolder | None = None) -> None:
    """Run the node until it is shut down; `record` is where it keeps the record of its cycles. Raises OutputError."""
    MoveBaseNode(configuration, record).spin()


def topics_of(configuration: Configuration) -> Sequence[str]:
    """Return the topics of sensors that the node subscribes to."""
    return sorted(topic_name(name) for name in sensor_topics(configuration))
