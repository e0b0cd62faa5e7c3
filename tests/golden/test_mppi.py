"""MPPI compared with Nav2's own optimizer, stage by stage.

The data are those of NAVSTACK_GOLDEN_NAV2 (default `../shared/golden_nav2`); jobs and scenes are found by name. The deliberate
differences of navstack (docs/parity/mppi.md) are off: `as_nav2`.

Tolerances. Both compute in float32 (24 bits, 6e-8 relative) in another order. Velocities are sums and clips of the same numbers:
1e-6. Points are sums of 56 steps of at most 0.15 m with sine and cosine within 1e-7: 2e-6 m plus the rounding of C++, which
stores absolute positions of up to 10 m with 5e-7 m each, 56 times: 2e-5 m. Scores are means of such numbers times weights of up
to 35: 1e-4 relative. A point within 2e-5 m of the border of a cell may count as in the next one: that is 2 * 2e-5 / 0.05, 0.08 %
of the points and, with 28 points, 2 % of the trajectories, whose costs differ by a few units of a cell's; in the mean far fewer.
Each of these trajectories must have such a point. The weights of the softmax depend on totals / 0.3: 1e-3 of the largest; what
follows from them is compared again from C++'s own totals, to 2e-5.
"""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D, RobotState, Twist2D
from navstack.local_planner import MPPIParams
from navstack.local_planner.mppi.batch import TrajectoryContext
from navstack.local_planner.mppi.optimizer import Optimizer
from navstack.local_planner.mppi.planner import is_safe, make_critics
from navstack.parameters import load_configuration
from navstack.plugins import Inflation
from tests.conftest import golden_nav2_files

VELOCITY = 1e-6
POINT_M = 2e-5
SCORE = 1e-4
CONTROL = 2e-6
CYCLE = 1e-3
BORDER_SHARE = 0.02
FILES = {file.name: file for file in golden_nav2_files("mppi_*")}
pytestmark = pytest.mark.skipif(
    "mppi_steps.npz" not in FILES, reason="no golden data of Nav2: set NAVSTACK_GOLDEN_NAV2 to their folder"
)


@lru_cache(maxsize=4)
def read(name: str) -> dict[str, NDArray[Any]]:
    with np.load(FILES[name]) as data:
        return {key: data[key] for key in data.files}


def jobs(kind: str) -> list[str]:
    if "mppi_jobs.json" not in FILES:
        return []
    return [name for name, job in all_jobs().items() if job["kind"] == kind]


@lru_cache(maxsize=1)
def all_jobs() -> dict[str, Any]:
    document: dict[str, Any] = json.loads(FILES["mppi_jobs.json"].read_text(encoding="utf-8"))
    return document


@lru_cache(maxsize=1)
def params_of(name: str) -> MPPIParams:
    """The parameters of a job, through the loader, as if they were written in a YAML."""
    written = dict(all_jobs()[name]["params"])
    tree: dict[str, Any] = {"base_local_planner": "nav2_mppi_controller::MPPIController"}
    model = written["FollowPath.motion_model"]
    for key, value in written.items():
        *above, last = key.split(".")
        if above[1:2] == ["diff_drive"] and model != "diff_drive":
            continue
        at = tree
        for part in above:
            at = at.setdefault(part, {})
        at[last] = value
    configuration = load_configuration(["turtlebot", tree])
    unread = [
        f for f in configuration.findings if f.key.startswith("FollowPath") and f.rule in ("unknown", "elsewhere")
    ]
    assert unread == []
    params = configuration.local_planner.params
    assert isinstance(params, MPPIParams)
    return params


def optimizer_of(name: str) -> Optimizer:
    params = params_of(name)
    optimizer = Optimizer(params, make_critics(params), as_nav2=True)
    scenes = read("mppi_scenes.npz")
    for axis, key in enumerate(("vx", "vy", "wz")):
        if axis != 1 or optimizer.omni:
            optimizer.noise[axis, :, : params.batch_size] = scenes[f"noise/{key}"].T
    optimizer.draw = lambda attempt: None  # type: ignore[method-assign]
    return optimizer


def context_of(name: str, pose: Pose2D, velocity: Twist2D, plan: NDArray[np.float64], motion: Any) -> TrajectoryContext:
    job, scenes = all_jobs()[name], read("mppi_scenes.npz")
    scene, footprint = job["scene"], Footprint(scenes[f"footprint/{job['footprint']}"])
    suffix = "" if not job["inflate"] else "_inflated"
    own = f"{scene}/costmap{suffix}_{job['footprint']}"
    data = scenes[own] if own in scenes else scenes[f"{scene}/costmap{suffix}"]
    x, y, resolution = scenes[f"{scene}/info"].tolist()
    costmap = Costmap(GridGeometry(data.shape[1], data.shape[0], resolution, x, y), data.copy(), "odom")
    length = float(np.hypot(np.diff(plan[:, 0]), np.diff(plan[:, 1])).sum())
    goal = Pose2D(*plan[-1].tolist())
    return TrajectoryContext(
        RobotState(pose, velocity),
        costmap,
        footprint,
        plan,
        goal,
        None,  # type: ignore[arg-type]
        length=length,
        target=goal,
        motion=motion,
        inflation=Inflation(footprint.inscribed_radius, job["inflation_radius"], job["csf"]),
        track_unknown_space=job["track_unknown"],
        exact=False,
    )


class Step:
    """A job of one cycle: what C++ computed, and the optimizer at its beginning."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.gold = {k.partition("/")[2]: v for k, v in read("mppi_steps.npz").items() if k.startswith(f"{name}/")}
        self.optimizer = optimizer_of(name)
        scene = all_jobs()[name]["scene"]
        scenes = read("mppi_scenes.npz")
        x, y, yaw, *speed = scenes[f"{scene}/state"].tolist()
        vx, vy, wz = speed
        o = self.optimizer
        o.controls[:] = scenes[f"{scene}/cs"]
        if not o.omni:
            o.controls[:, 1] = 0.0
        o.history[:] = speed
        if not o.omni:
            o.history[:, 1] = 0.0
        o.last = Twist2D(vx + 0.03, vy, wz - 0.05)
        for v in all_jobs()[name].get("cmd_history", ()):
            o.delayed.append(Twist2D(v, v / 2.0, -v))
        self.pose, self.velocity = Pose2D(x, y, yaw), Twist2D(vx, vy, wz)
        self.context = context_of(name, self.pose, self.velocity, scenes[f"{scene}/plan"], o.motion)
        self.number = o.params.batch_size

    def rolled_out(self) -> NDArray[np.float32]:
        start = self.optimizer.begin(self.velocity)
        self.optimizer.pin(start)
        self.optimizer.roll_out(start, self.pose)
        return start


def close(actual: Any, expected: Any, tolerance: float) -> None:
    """Equal up to `tolerance`, relative for values over 1."""
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance)


def borders(step: Step) -> NDArray[np.bool_]:
    """(K,) trajectories with a point on the border of a cell, within the rounding of C++."""
    g, batch = step.context.costmap.geometry, step.optimizer.batch
    fx = (batch.points[0, :, : step.number].astype(np.float64) + batch.anchor[0] - g.origin_x) / g.resolution
    fy = (batch.points[1, :, : step.number].astype(np.float64) + batch.anchor[1] - g.origin_y) / g.resolution
    near = np.minimum(np.abs(fx - np.rint(fx)), np.abs(fy - np.rint(fy))) < POINT_M / g.resolution
    return near.any(axis=0)


@pytest.fixture(params=jobs("step"))
def step(request: pytest.FixtureRequest) -> Step:
    return Step(request.param)


@pytest.mark.sampled
def test_velocities_and_points(step: Step) -> None:
    """The start, the pinned sequence, what each trajectory reaches, and where it leads."""
    optimizer, gold = step.optimizer, step.gold
    start = step.rolled_out()
    batch = optimizer.batch
    close(start, gold["speed"], VELOCITY)
    close(optimizer.controls, gold["cs_pinned"], VELOCITY)
    rows = len(gold["vx"]) if "vx" in gold else 0
    for axis, key in enumerate(("vx", "vy", "wz")):
        if key in gold:
            close(batch.speeds[axis, :, :rows].T, gold[key], VELOCITY)
        if f"c{key}" in gold:
            sampled = optimizer.sampled[axis, :, :rows] + optimizer.controls[:, axis, None]
            close(sampled.T, gold[f"c{key}"], VELOCITY)
    if rows:
        for axis, key in enumerate(("x", "y")):
            close(batch.points[axis, :, :rows].T.astype(np.float64) + batch.anchor[axis], gold[key], POINT_M)
        close(batch.points[2, :, :rows].T, gold["yaw"], POINT_M)


@pytest.mark.sampled
def test_every_critic_alone_and_all_in_order(step: Step) -> None:
    optimizer, gold, number = step.optimizer, step.gold, step.number
    step.rolled_out()
    batch, context = optimizer.batch, step.context
    context.begin(batch.anchor)
    # of different rounding, a trajectory may count a point in the next cell
    doubtful = borders(step)
    for index, critic in enumerate(optimizer.critics):
        critic.prepare(context)
        batch.all_collided = False
        scores, totals = np.zeros((2, len(optimizer.costs)), np.float32)
        critic.add_scores(batch, scores, totals)
        expected = gold[f"crit_{critic.name}"]
        wrong = ~np.isclose(scores[:number], expected, rtol=SCORE, atol=SCORE)
        assert not (wrong & ~doubtful).any() and wrong.mean() <= BORDER_SHARE, critic.name
        assert batch.all_collided == bool(gold["crit_fail"][index]), critic.name
    length, furthest = gold["facts"][:2]
    assert context.length == pytest.approx(length, abs=1e-5)
    if furthest >= 0:
        assert context.furthest_reached(batch) == int(furthest)
    if len(gold["path_pts_valid"]):
        np.testing.assert_array_equal(context.valid_poses()[: len(gold["path_pts_valid"])], gold["path_pts_valid"] != 0)
    batch.all_collided = False
    optimizer.evaluate(context)
    wrong = ~np.isclose(optimizer.costs[:number], gold["costs"], rtol=SCORE, atol=SCORE)
    assert not (wrong & ~doubtful).any() and wrong.mean() <= BORDER_SHARE
    assert batch.all_collided == bool(gold["facts"][2])


@pytest.mark.sampled
def test_the_update_stage_by_stage(step: Step) -> None:
    """Each stage from what C++ had before it."""
    optimizer, gold, number = step.optimizer, step.gold, step.number
    if gold["facts"][2]:
        pytest.skip("every trajectory collides: there is no update")
    start = step.rolled_out()
    optimizer.costs[:number] = gold["costs"]
    optimizer.add_control_cost()
    close(optimizer.costs[:number], gold["costs_gamma"], SCORE)
    optimizer.costs[:number] = gold["costs_gamma"]
    optimizer.weigh()
    close(optimizer.weights[:number], gold["softmax"], VELOCITY)
    optimizer.weights[:number] = gold["softmax"]
    optimizer.average()
    close(optimizer.controls, gold["cs_weighted"], CONTROL)
    optimizer.controls[:] = gold["cs_weighted"]
    optimizer.smooth()
    close(optimizer.controls, gold["cs_filtered"], CONTROL)
    optimizer.controls[:] = gold["cs_filtered"]
    optimizer.limit(start)
    close(optimizer.controls, gold["cs_out"], VELOCITY)
    optimizer.controls[:] = gold["cs_out"]
    optimizer.trajectory(step.pose)
    trajectory = optimizer.optimal.astype(np.float64)
    trajectory[:, :2] += optimizer.batch.anchor
    close(trajectory, gold["optimal_trajectory"], POINT_M)
    safe = is_safe(step.context, optimizer.optimal, optimizer.params.validator, optimizer.params.model_dt)
    assert safe == (gold["twist"][3] == 0)
    close(optimizer.command(), gold["twist"][:3], VELOCITY)
    optimizer.shift()
    close(optimizer.controls, gold["cs_shifted"], VELOCITY)


@pytest.mark.sampled
def test_a_whole_cycle(step: Step) -> None:
    """From the samples to the command, without C++'s intermediate results."""
    optimizer, gold = step.optimizer, step.gold
    start = optimizer.begin(step.velocity)
    legal = optimizer.optimize(step.context, start, 0)
    assert legal != bool(gold["facts"][2])
    if legal:
        close(optimizer.command(), gold["twist"][:3], CYCLE)
        close(optimizer.controls, gold["cs_out"], CYCLE)


@pytest.mark.slow
@pytest.mark.parametrize("name", jobs("loop"))
def test_closed_loops_cycle_by_cycle(name: str) -> None:
    """Every cycle from C++'s own state before it."""
    gold = {key.partition("/")[2]: value for key, value in read("mppi_loops.npz").items() if key.startswith(f"{name}/")}
    optimizer = optimizer_of(name)
    plan = read("mppi_scenes.npz")[f"{all_jobs()[name]['scene']}/plan"]
    log = gold["log"]
    for cycle, row in enumerate(log):
        assert row[11] == 0.0, "no fallback in these loops"
        pose, velocity = Pose2D(*row[:3].tolist()), Twist2D(*row[3:6].tolist())
        if cycle:
            optimizer.controls = gold["cs_after"][cycle - 1].copy()
            optimizer.history[1:] = gold["history_after"][cycle - 1]
            optimizer.last = Twist2D(*log[cycle - 1, 8:11].tolist())
        context = context_of(name, pose, velocity, plan[int(row[6]) : int(row[7])], optimizer.motion)
        start = optimizer.begin(velocity)
        assert optimizer.optimize(context, start, 0)
        command = optimizer.command()
        close(command, row[8:11], CYCLE)
        optimizer.finish(command)
        close(optimizer.controls, gold["cs_after"][cycle], CYCLE)
        close(optimizer.history[1:], gold["history_after"][cycle], CYCLE)
