"""Cases of BehaviorTree.CPP and Nav2 in C++: every shipped tree and every control node and decorator, with scripted leaves."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from navstack.behavior_trees import NODES, BehaviorTree, BehaviorTreeRunError, Node, NoServers, StampedPose, Status
from navstack.behavior_trees.nodes import Action, Condition
from navstack.core import Path, Twist2D
from tests.conftest import SHARED

FOLDER = FilePath(os.environ.get("NAVSTACK_GOLDEN_NAV2_W3", SHARED / "golden_nav2_w3"))
FILES = {"tree": "bt_trees.npz", "unit": "bt_units.npz"}
END = 65535
THREW = 9


@cache
def jobs() -> dict[str, dict[str, Any]]:
    """Return the jobs by name; none where the folder is absent."""
    file = FOLDER / "bt_jobs.json"
    return json.loads(file.read_text()) if file.is_file() else {}


@cache
def arrays(kind: str) -> Mapping[str, Any]:
    return np.load(FOLDER / FILES[kind])


def names(pattern: str) -> list[str]:
    return [name for name in jobs() if name.startswith(pattern)]


def of_job(name: str, key: str) -> Any:
    return arrays(name.split("/")[0])[f"{name}/{key}"]


class Robot(NoServers):
    """The robot of a case: it is where the case says."""

    def __init__(self) -> None:
        self.x = self.speed = 0.0

    def robot_pose(self, frame: str, base_frame: str) -> StampedPose:
        # the stub of the C++ has no parameters global_frame and robot_base_frame, so that without ports the pose is constant
        return StampedPose(self.x if frame and base_frame else 0.0, 0.0)

    def smoothed_velocity(self) -> Twist2D:
        return Twist2D(self.speed)


class Case:
    """One seed of a job: the inputs and the script of the leaves, and the tree that they run in."""

    def __init__(self, name: str, at: int) -> None:
        job = jobs()[name]
        self.name, self.at, self.seed = name, at, job["seeds"][at]
        self.keys = job["keys"]
        self.leaf_ids = job["leaves"]
        self.script = of_job(name, "script")[at]
        self.codes = of_job(name, "codes")[at]
        self.paths = of_job(name, "paths")[at]
        self.events: list[int] = []
        self.made = 0
        self.robot = Robot()
        case = self

        def mock(kind: str) -> type[Node]:
            base = NODES.get(kind).cls if kind in NODES else Action
            parent = Condition if issubclass(base, Condition) else Action

            class Mock(parent):  # type: ignore[valid-type,misc]
                PORTS = base.PORTS

                def setup(self) -> None:
                    self.number_of_ticks = 0
                    self.leaf = case.made
                    case.made += 1
                    assert case.leaf_ids[self.leaf] == f"{kind}:{self.name}"

                def tick(self) -> Status:
                    return case.leaf_ticked(self)

                def halt(self) -> None:
                    if self.status is Status.RUNNING:
                        case.events.append(8 * self.leaf)
                    self.status = Status.IDLE

            return Mock

        kinds = {text.split(":")[0] for text in self.leaf_ids}
        self.path_count = 0
        source = job["xml"] if "xml" in job else str(FOLDER / "behavior_trees" / f"{name.split('/')[1]}.xml")
        first = {"path": Path(np.empty((0, 3))), "goal": self.goal_of(int(of_job(name, "goal")[at][0]))}
        self.tree = BehaviorTree(
            source, servers=self.robot, blackboard=first, nodes={kind: mock(kind) for kind in kinds}
        )
        assert self.made == len(self.leaf_ids)

    @staticmethod
    def goal_of(number: int) -> StampedPose:
        return StampedPose(float(number), 0.0, 0.0, "map", 100.0 + number)

    def leaf_ticked(self, leaf: Any) -> Status:
        script = self.script[leaf.leaf]
        status = Status(int(script[leaf.number_of_ticks % len(script)]))
        leaf.number_of_ticks += 1
        self.events.append(8 * leaf.leaf + status)
        if "error_code_id" in leaf.outputs:
            if status is Status.FAILURE:
                leaf.output("error_code_id").set(int(self.codes[leaf.leaf]))
            elif status is Status.SUCCESS:
                leaf.output("error_code_id").set(0)
        if leaf.type in ("ComputePathToPose", "ComputePathThroughPoses") and status is Status.SUCCESS:
            length, end = (float(value) for value in self.paths[self.path_count % 64])
            height = (length - end) / 2
            path = Path(np.array([(0, 0, 0), (0, height, 0), (0, 0, 0), (end, 0, 0)], np.float64))
            self.path_count += 1
            leaf.output("path").set(path)
        return status

    def value(self, key: str) -> int | None:
        found = self.tree.blackboard.get(key)
        if isinstance(found, StampedPose):
            return int(found.x)
        if isinstance(found, Path):
            return self.path_count
        return None if found is None else int(found)  # type: ignore[call-overload]

    def ticks(self) -> Iterator[tuple[int, list[int], list[tuple[int, int]]]]:
        """Yield of each tick: the status of the root, the events, and the changes of the blackboard (key, value)."""
        goal, x_v, halt, pause, update = (
            of_job(self.name, key)[self.at] for key in ("goal", "x_v", "halt", "pause", "goal_update")
        )
        step = 0.1 if (self.seed // 2) % 2 else 0.01
        tree = self.tree
        before: dict[int, int | None] = dict.fromkeys(range(len(self.keys)))
        before[0] = 0
        for tick in range(len(goal)):
            now = 100.0 + step * tick
            self.events = []
            tree.blackboard["goal"] = self.goal_of(int(goal[tick]))
            self.robot.x, self.robot.speed = (float(value) for value in x_v[tick])
            if update[tick] >= 0:
                tree.publish("goal_update", StampedPose(1000.0 + tick, 0.0, 0.0, "map", float(update[tick])))
            if pause[tick] and tree.services:
                tree.call("pause" if pause[tick] == 1 else "resume")
            if halt[tick]:
                tree.halt()
            try:
                status = int(tree.tick(now))
            except BehaviorTreeRunError:
                status = THREW
            if status != Status.RUNNING:
                self.events.append(END)
                tree.halt()
            changes: list[tuple[int, int]] = []
            for index, key in enumerate(self.keys):
                value = self.value(key)
                if value is not None and value != before[index]:
                    changes.append((index, value))
                before[index] = value
            yield status, self.events, changes

    def expected(self) -> Iterator[tuple[int, list[int], list[tuple[int, int]]]]:
        """Yield the same of C++."""
        counts = of_job(self.name, "event_counts").astype(np.int64)
        events = of_job(self.name, "events").astype(np.int64)
        starts = np.concatenate(([0], np.cumsum(counts)))
        rows = of_job(self.name, "blackboard").astype(np.int64)
        rows = rows[rows[:, 0] == self.at]
        root = of_job(self.name, "root")[self.at]
        width = counts.shape[1]
        for tick in range(width):
            row = self.at * width + tick
            found = [(int(key), int(value)) for _, t, key, value in rows if t == tick]
            yield int(root[tick]), events[starts[row] : starts[row + 1]].tolist(), found
