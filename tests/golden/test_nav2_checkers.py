"""Goal checkers, progress checkers and the path handler compared with Nav2's on streams of poses: every answer is the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from navstack.core import GridGeometry, InvalidPathError, Path, Pose2D, Transform2D, Twist2D
from navstack.plugins import GOAL_CHECKERS, PATH_HANDLERS, PROGRESS_CHECKERS, Approach
from tests.golden.nav2_w3 import arrays, jobs, needs_data, split, values_of

pytestmark = needs_data
JOBS = jobs("checkers")
POSE = 1e-9
"""Poses are copied; their yaws pass through quaternions in C++."""


def of_kind(kind: str) -> list[str]:
    return sorted(name for name, job in JOBS.items() if job["kind"] == kind)


def make(registry: Any, job: dict[str, Any], plugin: str = "") -> Any:
    cls = registry.get(plugin or job["plugin"]).cls
    return cls(cls.Params(**values_of(job)))


@pytest.mark.parametrize("name", of_kind("goal"))
def test_goal_checker(name: str) -> None:
    job, data = JOBS[name], arrays("checkers")
    plans = split(data["in/goal_plans"], data["in/goal_plan_counts"])
    whole, position = make(GOAL_CHECKERS, job), make(GOAL_CHECKERS, job)
    answers: list[tuple[bool, bool]] = []
    for row in data["in/goal_stream"]:
        plan = plans[int(row[0])]
        path = plan[int(row[1]) :]
        if row[2]:
            whole.reset()
            position.reset()
        length = float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum())
        seen = Approach(Pose2D(*row[3:6]), Pose2D(*plan[-1]), Twist2D(*row[6:9]), path, length)
        answers.append((whole.reached(seen), position.at_position(seen)))
    np.testing.assert_array_equal(answers, data[f"{name}/reached"].astype(bool))
    assert whole.xy_tolerance == data[f"{name}/tolerances"][1]


@pytest.mark.parametrize("name", of_kind("progress"))
def test_progress_checker(name: str) -> None:
    data, checker = arrays("checkers"), make(PROGRESS_CHECKERS, JOBS[name])
    answers: list[bool] = []
    for time, reset, *pose in data["in/progress_stream"].tolist():
        if reset:
            checker.reset()
        answers.append(checker.makes_progress(Pose2D(*pose), time))
    np.testing.assert_array_equal(answers, data[f"{name}/ok"].astype(bool))


@pytest.mark.parametrize("name", of_kind("handler"))
def test_path_handler(name: str) -> None:
    job, data = JOBS[name], arrays("checkers")
    x, y, resolution, nx, ny = job["map"]
    window = GridGeometry(int(nx), int(ny), resolution, x, y)
    plans = split(data["in/handler_plans"], data["in/handler_plan_counts"])
    paths = split(data[f"{name}/path"], data[f"{name}/counts"])
    handler = make(PATH_HANDLERS, job, "nav2_controller::FeasiblePathHandler")
    for i, (new, *pose) in enumerate(data["in/handler_stream"].tolist()):
        if new >= 0:
            handler.set_plan(Path(plans[int(new)], "map"))
        status, poses = 1, np.empty((0, 3))
        try:
            poses = handler.local_path(Pose2D(*pose), Transform2D(), window).poses
        except InvalidPathError:
            status = -1
        assert status == data[f"{name}/status"][i], f"row {i}"
        np.testing.assert_allclose(poses, paths[i], rtol=0.0, atol=POSE, err_msg=f"row {i}")
