"""A node that runs the goal manager: its start, its loop and its end, for any ROS client library.

Messages are received in the threads of the library and processed in the thread of the node, which also runs the cycles. A cycle
comes first; what is published of it waits until no cycle is due.
"""

from __future__ import annotations

import gc
import math
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from navstack.bringup import build_move_base
from navstack.core import (
    Event,
    GridGeometry,
    Listener,
    NavError,
    OccupancyGrid,
    Pose2D,
    Twist2D,
    compile_ahead,
    turn_cost,
)
from navstack.costmap import LayeredCostmap
from navstack.move_base import Mode, MoveBase, ThreadPlanning, TickResult
from navstack.parameters import Configuration
from navstack.ros_node.clock import NodeClock, StillClock
from navstack.ros_node.inbox import Inbox
from navstack.ros_node.live_record import LiveRecord, RecordFolder
from navstack.ros_node.log import Log, NodeLog
from navstack.ros_node.loop_times import LoopTimes
from navstack.ros_node.robot import RosRobot
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


class StackNode(ABC):
    """The node without its topics, services and actions, which a subclass adds."""

    name: str
    """Of the scenario in records."""
    hears_feedback = False
    trees_by_goal = False
    """True if a goal can name its behavior tree."""

    def __init__(
        self,
        configuration: Configuration,
        log: Log,
        clock: NodeClock,
        *,
        is_simulated: bool,
        record: RecordFolder | None = None,
    ) -> None:
        """With `is_simulated`, the clock is that of a simulator. `record` is where the record of the cycles is kept."""
        self.configuration = configuration
        self.clock = clock
        self.inbox = Inbox()
        self.robot = RosRobot(clock, self.publish_command, self.report)
        self.move_base: MoveBase | None = None
        self.record: LiveRecord | None = None
        self.times = LoopTimes(is_simulated=is_simulated)
        self.log = NodeLog(log, self._newest_data)
        self.map: OccupancyGrid | None = None
        self.sensor_topics: list[str] = []
        self._text_log = log
        self._record_folder = record
        self._is_simulated = is_simulated
        self._still = StillClock(log)
        self._jumps = 0
        self._waiting: list[Callable[[], None]] = []
        """Publications of the last cycles."""
        self._lead = ""
        """Topic of the scans that the cycles follow."""

    # --- for subclasses -----------------------------------------------------------------------------------------------

    @abstractmethod
    def publish_command(self, twist: Twist2D) -> None:
        """Send a velocity to the base."""

    @abstractmethod
    def connect(self, move_base: MoveBase, planning: ThreadPlanning) -> None:
        """Create topics, services and actions of the goal manager."""

    @abstractmethod
    def publish_tick(self, move_base: MoveBase, tick: TickResult) -> None:
        """Publish costmaps and plans of a cycle."""

    def publish_state(self, move_base: MoveBase, now: float) -> None:  # noqa: B027
        """Publish the state of the actions; called in each turn of the loop."""

    def publish_rest(self, move_base: MoveBase, now: float) -> None:  # noqa: B027
        """Publish what can wait, such as diagnostics."""

    @abstractmethod
    def is_stopping(self) -> bool:
        """Return True if the node must end."""

    @abstractmethod
    def shut_down(self, last: Callable[[], None]) -> None:
        """Call `last`, which publishes the last messages, and end the node."""

    def listeners(self) -> list[Listener]:
        """Return what hears the events of the goal manager."""
        return [self]

    # --- messages -----------------------------------------------------------------------------------------------------

    def receive_data(self, message: Any, receive: Callable[[Any, str], None], topic: str) -> None:
        """Receive sensor data. The cycles follow the scans of the first lidar."""
        receive(message, topic)
        if self.move_base is None or not hasattr(message, "ranges"):
            return
        self._lead = self._lead or topic
        if topic == self._lead:
            self.move_base.follow_scans(self.clock.now())

    def wake(self, message: Any) -> None:  # noqa: B027
        """Do nothing: the message, a step of the clock, has woken the node."""

    def map_topic(self) -> str:
        """Return the topic of the static map."""
        for costmap in (self.configuration.global_costmap, self.configuration.local_costmap):
            for layer in costmap.layers:
                if layer.cls.traits(layer.params).has_static_map:
                    return str(getattr(layer.params, "map_topic", "map") or "map")
        return "map"

    def use_map(self, grid: OccupancyGrid) -> None:
        """Use a static map from now on."""
        self.map = grid
        move_base = self.move_base
        if move_base is None:
            return
        self._text_log.loginfo("received a map of %d x %d cells", grid.data.shape[1], grid.data.shape[0])
        for costmap in (move_base.global_costmap, move_base.local_costmap):
            if isinstance(costmap, LayeredCostmap):
                costmap.set_static_map(grid)
        move_base.costmaps_changed()
        if self.record is not None:
            self.record.set_map(grid, move_base)

    # --- start --------------------------------------------------------------------------------------------------------

    def start(self) -> bool:
        """Wait for transforms and the map, then create the goal manager. Returns False if the node was shut down."""
        self._load_kernels()
        if not self._wait_for(self._missing_transform) or not self._wait_for(self._missing_map):
            return False
        listeners = self.listeners()
        if self._record_folder is not None:
            folder, robot = self._record_folder, self.robot
            self.record = LiveRecord(*folder, self.configuration, self.map, robot, name=self.name, log=self._text_log)
            listeners.append(self.record)
        planning = ThreadPlanning(on_answer=self.inbox.wake)
        self.move_base = build_move_base(
            self.configuration,
            self.robot,
            static_map=self.map,
            listeners=listeners,
            planning=planning,
            trees_by_goal=self.trees_by_goal,
        )
        for costmap in layered_costmaps(self.move_base):
            # else the first recovery waits for this kernel, with which numba imports scipy.linalg
            turn_cost(costmap.master, costmap.footprint, Pose2D(0.0, 0.0), 0.1)
        self.connect(self.move_base, planning)
        # what exists now lives as long as the node: the garbage collector need not visit it in a cycle
        gc.collect()
        gc.freeze()
        sys.setswitchinterval(SWITCH_S)
        self._text_log.loginfo("navstack is ready")
        return True

    def _load_kernels(self) -> None:
        """Compile or load the kernels by a second of simulated driving: the first cycle of the robot must not wait for that.

        Until then nothing is published and no service is offered, so no client takes the node for ready; goals wait.
        """
        begin, log = time.perf_counter(), self._text_log
        log.loginfo("loading the kernels, or compiling them once per machine; goals that arrive now wait")
        compile_ahead(self.configuration.planner_names, self._log_compilation)
        size = 200
        grid = OccupancyGrid(np.zeros((size, size), np.int8), GridGeometry(size, size, 0.05, 0.0, 0.0), raw=True)
        scenario = Scenario(grid, self.configuration, Pose2D(5.0, 5.0), (Pose2D(7.0, 5.0),))
        try:
            warm_up(scenario)
        except NavError as exc:
            log.logwarn("some kernels are compiled while driving, so the first cycles may be late: %s", exc.message)
        log.loginfo("the kernels are loaded after %.1f s", time.perf_counter() - begin)

    _compilation_logged = -math.inf

    def _log_compilation(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._compilation_logged >= 5.0:
            self._compilation_logged = now
            self._text_log.loginfo("compiling kernels, once per machine: %d of %d", done, total)

    def _wait_for(self, missing: Callable[[], str]) -> bool:
        """Receive messages until nothing is missing."""
        while not self.is_stopping():
            self.inbox.run(POLL_S, self.report, longest_s=math.inf)
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
        return f"waiting for a map on {self.map_topic()}" if wanted and self.map is None else ""

    # --- run ----------------------------------------------------------------------------------------------------------

    def spin(self) -> None:
        """Run until the node is shut down. Messages are processed and cycles run in this thread only."""
        try:
            if not self.start():
                return
            assert self.move_base is not None
            self.inbox.run(0.0, self.report, longest_s=math.inf)  # what arrived while the stack was built
            while not self.is_stopping():
                self.turn(self.move_base)
        finally:
            # also after an error: the robot must not go on with its last velocity
            self.shut_down(self._end)

    def turn(self, move_base: MoveBase) -> None:
        """One turn of the loop: a cycle if it is due, what is published regularly, and the messages that wait."""
        now = self.clock.now()
        self.times.clock(now)
        if self.clock.jumps != self._jumps:
            self._jumps = self.clock.jumps
            self._text_log.logwarn("the clock jumped back; transforms and sensor data before it are discarded")
            self.robot.forget()
        if self._is_simulated and self._still.is_new(now):
            # the base may go on with its last velocity while the simulator stands still
            self.publish_command(Twist2D())
        due = move_base.next_due(-math.inf)  # not "at least now": a late cycle shows
        if now >= due:
            self.times.cycle(now, due)
            self._cycle(move_base, now)
            due = move_base.next_due(-math.inf)
        self.publish_state(move_base, now)
        self.log.flush(drives=move_base.last_tick.local_plan is not None)
        if due - self.clock.now() > QUIET_S or len(self._waiting) >= MOST_CYCLES:
            self._publish_waiting(move_base, now)
        self.times.mark("publishing")
        idle = self.inbox.run(min(due - self.clock.now(), POLL_S), self.report)
        self.times.mark("messages", idle_s=idle)

    def _end(self) -> None:
        """Abort the goal and stop the robot. ROS differs: its nodes send no velocity, and clients lose their goal."""
        self.log.finish()
        move_base = self.move_base
        if move_base is None:
            return
        try:
            move_base.shutdown()
            self.publish_state(move_base, self.clock.now())
        finally:
            self.publish_command(Twist2D())
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
        self._waiting.append(lambda: self.publish_tick(move_base, tick))

    def _publish_waiting(self, move_base: MoveBase, now: float) -> None:
        """Publish the costmaps and plans of the last cycles, and what can wait."""
        for publish in self._waiting:
            publish()
        self._waiting.clear()
        self.publish_rest(move_base, now)

    def report(self, error: NavError) -> None:
        """Log a message that cannot be used."""
        self.log.problem(error.message)

    def _newest_data(self) -> str:
        """Return the ages of the newest sensor data."""
        now = self.clock.now()
        received = self.robot.received
        ages = [f"{name} {now - received[name]:.2f} s old" for name in sorted(received)]
        ages += [f"none on {name}" for name in self.sensor_topics if name not in received]
        return f"newest data: {', '.join(ages)}"

    def on_event(self, event: Event) -> None:
        """Log what an operator should know."""
        if event.kind in ("warning", "plan_failed", "control_failed", "recovery"):
            self.log.event(event)


def layered_costmaps(move_base: MoveBase) -> Sequence[LayeredCostmap]:
    """Return the global and the local costmap, those that have layers."""
    found = (move_base.global_costmap, move_base.local_costmap)
    return [costmap for costmap in found if isinstance(costmap, LayeredCostmap)]
