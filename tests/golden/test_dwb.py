"""DWB compared with Nav2's own, sample by sample.

The data are those of NAVSTACK_GOLDEN_NAV2_W3 (default `../shared/golden_nav2_w3`); jobs and scenes are found by name.

Both sides compute in double precision with the same formulas; C++ may contract a product and a sum (FMA), and its cosine may
differ in the last bit. Two builds of the C++ differ by 2e-16 in twists and 3e-14 in poses: TWIST and POSE leave room for other
machines. Raw scores and totals are float32 there: FLOAT32 is two units in the last place. Which samples are legal, why not, how
many points they have and which one is chosen must be the same; so must the state of the critics after every cycle.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import ControlError, Footprint, Pose2D, RobotState, Twist2D
from navstack.local_planner.critics.rotate_to_goal import RotateToGoalCritic
from navstack.local_planner.dwb.critics import OscillationCritic
from navstack.local_planner.path_follower import Following
from navstack.plugins import LOCAL_PLANNERS, Inflation, LocalPlan, Rollouts
from tests.golden.nav2_controllers import Scene, nested_params
from tests.golden.nav2_w3 import arrays, jobs, needs_data

TWIST = 1e-12
POSE = 1e-9
FLOAT32 = 3e-7
AT_A_LIMIT = 1e-9
"""Samples this close to a limit are legal in one build of the C++ and not in another (README of the data)."""
LARGEST = np.float64(np.finfo(np.float32).max)
"""Products beyond it are infinite in the data."""
PERIOD_S = 0.05
INFLATED = Inflation(0.22, 0.55, 3.0)
"""How the costs of the scenes were inflated."""
JOBS = jobs("dwb")
pytestmark = needs_data


def planner_of(name: str) -> Any:
    """The planner of a job, from Nav2's parameters."""
    job = JOBS[name]
    cls: Any = LOCAL_PLANNERS.get("dwb_core::DWBLocalPlanner").cls
    tree = nested_params(job)
    models = cls.Params.child_models(tree)
    sections = {n: models[n](**tree[n]) for n in models if isinstance(tree.get(n), dict)}
    known = {n: v for n, v in tree.items() if not isinstance(v, dict) and n not in cls.Params.NO_EFFECT}
    planner = cls(cls.Params(sections=sections, **known))
    if "speed_limit" in job:
        planner.set_speed_limit(job["speed_limit"][0], percentage=job["speed_limit"][1])
    return planner


class Cycle(NamedTuple):
    """What navstack did in a row of a job's log."""

    plan: LocalPlan | None
    samples: NDArray[np.float64]
    rollouts: Rollouts
    totals: NDArray[np.float64]
    costs: NDArray[np.float64]
    rejected_by: NDArray[np.int8]
    scales: NDArray[np.float64]
    best: int


class DWBScene(Scene):
    """Costmap, plan and footprint of a job."""

    def __init__(self, job: dict[str, Any]) -> None:
        data, kind = arrays("dwb_scenes"), job["footprint_name"]
        super().__init__(data, job["scene_name"], f"costmap_used_{kind}")
        self.footprint = Footprint(data[f"footprint/{kind}"])

    def run(self, planner: Any, row: list[float], time: float) -> Cycle:
        """One cycle; the part of the plan is that of the log."""
        x, y, yaw, vx, vy, wz = row[:6]
        path = self.path(int(row[6]), int(row[7]))
        state = RobotState(Pose2D(x, y, yaw), Twist2D(vx, vy, wz), time)
        now = Following(state, path, self.goal, self.costmap, self.footprint, INFLATED, False, False, False, False)
        try:
            plan = planner.follow(now)
        except ControlError as exc:
            assert exc.code == 106
            plan = None
        _, rollouts, table, local, _ = planner._last
        return Cycle(
            plan,
            local.samples,
            rollouts,
            table.totals,
            table.costs,
            table.rejected_by,
            table.scales,
            table.best,
        )


class Expected(NamedTuple):
    """A row of a job's arrays; those of samples are None in most cycles of a loop."""

    log: list[float]
    totals: NDArray[np.float32]
    illegal: NDArray[np.uint8]
    scales: NDArray[np.float32]
    osc: NDArray[np.uint8]
    rtg: NDArray[np.uint8]
    twists: NDArray[np.float64] | None
    raw: NDArray[np.float32] | None
    end: NDArray[np.float64] | None
    n_poses: NDArray[np.uint8] | None
    trajectories: list[NDArray[np.float64]] | None


def expected_rows(name: str) -> Iterator[Expected]:
    loop = JOBS[name]["kind"] == "loop"
    file = arrays("dwb_loops" if loop else "dwb_tables")
    data = {key.removeprefix(f"{name}/"): v for key, v in file.items() if key.startswith(f"{name}/")}
    counts = data["counts"].astype(np.int64)
    recorded = [i for i in range(len(counts)) if not loop or i % 10 == 0]
    starts, begin = np.concatenate(([0], np.cumsum(counts))), 0
    lengths = data["traj_counts"].astype(np.int64)
    ends = np.concatenate(([0], np.cumsum(lengths)))
    for i, number in enumerate(counts.tolist()):
        rows = slice(starts[i], starts[i + 1])
        optional: list[Any] = [None] * 5
        if i in recorded:
            own = slice(begin, begin + number)
            begin += number
            j = 3 * recorded.index(i)
            parts = [data["traj"][ends[m] : ends[m + 1]] for m in range(j, j + 3)]
            optional = [*(data[key][own] for key in ("twists", "raw", "end", "n_poses")), parts]
        yield Expected(
            data["log"][i].tolist(),
            data["total"][rows],
            data["illegal"][rows],
            data["scales"][i],
            data["osc"][i],
            data["rtg"][i],
            *optional,
        )


def compare(name: str, found: Cycle, wanted: Expected, reasons: list[str], planner: Any) -> None:
    """Everything that the data say about a cycle."""
    number, chosen = int(wanted.log[12]), int(wanted.log[13])
    pairs = paired(found, wanted, planner)
    if pairs is None:  # rounding decides whether some samples exist, and the data do not say which ones
        return
    keep, theirs = pairs
    assert (found.plan is not None) == (wanted.log[11] == 1.0), name
    command = found.plan.command if found.plan is not None else Twist2D()
    if len(keep) == len(found.samples) == number:
        assert found.best == (keep[chosen] if chosen >= 0 else -1), name
        np.testing.assert_allclose(command, wanted.log[8:11], rtol=0, atol=TWIST)
    np.testing.assert_array_equal(found.scales.astype(np.float32), wanted.scales)
    totals, illegal = wanted.totals[theirs], wanted.illegal[theirs]
    rejected_by = found.rejected_by[keep]
    np.testing.assert_array_equal(rejected_by >= 0, illegal > 0)
    texts = [
        f"{planner.critics[by].name}: {planner.critics[by].CODES[int(total)]}" if by >= 0 else ""
        for by, total in zip(rejected_by.tolist(), found.totals[keep].tolist(), strict=True)
    ]
    assert texts == [reasons[k - 1] if k else "" for k in illegal.tolist()]
    legal = illegal == 0
    np.testing.assert_allclose(found.totals[keep][legal], np.minimum(totals[legal], LARGEST), rtol=FLOAT32)
    if wanted.twists is not None:
        compare_samples(found, wanted, keep, theirs)


def compare_samples(found: Cycle, wanted: Expected, keep: NDArray[np.int64], theirs: NDArray[np.int64]) -> None:
    """Twists, raw scores and trajectories of the samples `keep`, which are `theirs` in the data."""
    assert wanted.twists is not None and wanted.end is not None and wanted.raw is not None
    assert wanted.n_poses is not None and wanted.trajectories is not None
    rollouts = found.rollouts
    np.testing.assert_allclose(rollouts.commands[keep], wanted.twists[theirs], rtol=0, atol=TWIST)
    np.testing.assert_array_equal(rollouts.counts[keep], wanted.n_poses[theirs])
    np.testing.assert_allclose(rollouts.poses[keep, rollouts.counts[keep] - 1], wanted.end[theirs], rtol=0, atol=POSE)
    # the data have no scores of illegal samples
    costs = np.where(found.rejected_by[keep, None] >= 0, np.nan, found.costs[keep])
    raw = wanted.raw[theirs]
    np.testing.assert_array_equal(np.isnan(costs), np.isnan(raw))
    np.testing.assert_allclose(np.minimum(costs, LARGEST), np.minimum(raw, LARGEST), rtol=FLOAT32, atol=FLOAT32)
    if len(keep) != len(found.samples) or not len(keep):
        return
    for row, trajectory in zip((keep[0], keep[len(keep) // 2], found.best), wanted.trajectories, strict=True):
        if row >= 0:
            own = rollouts.poses[row, : rollouts.counts[row]]
            np.testing.assert_allclose(own, trajectory, rtol=0, atol=POSE)


def paired(found: Cycle, wanted: Expected, planner: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Indices of the samples that both sides have; None if the data do not have the twists of a cycle with others.

    Samples of one side must be at a limit: the speed limits, 0 (which is inserted where an axis crosses it), the end of an axis.
    """
    number, own = int(wanted.log[12]), found.rollouts.commands
    if len(own) == number:
        return np.arange(number), np.arange(number)
    p = planner.params
    squared = [p.max_speed_xy**2 + 2.0**-23, p.min_speed_xy**2 - 2.0**-23]

    crossing = (own.min(axis=0, initial=0.0) < -TWIST) & (own.max(axis=0, initial=0.0) > TWIST)
    ends = own.max(axis=0, initial=0.0), (p.max_vel_x, p.max_vel_y, p.max_vel_theta)

    def at_a_limit(twist: NDArray[np.float64]) -> bool:
        near = [abs(twist[0] ** 2 + twist[1] ** 2 - v) for v in squared]
        near += np.abs(twist[crossing]).tolist()
        near += [np.abs(twist - end - 1e-5).min() for end in ends]
        return min(near) < AT_A_LIMIT

    if wanted.twists is None:
        assert any(at_a_limit(twist) for twist in own), f"{len(own)} samples, not {number}"
        return None
    pairs, i, j = list[tuple[int, int]](), 0, 0
    while i < len(own) or j < number:
        if i < len(own) and j < number and np.abs(own[i] - wanted.twists[j]).max() <= TWIST:
            pairs.append((i, j))
            i, j = i + 1, j + 1
            continue
        ours = j == number or (i < len(own) and tuple(own[i]) < tuple(wanted.twists[j]))
        assert at_a_limit(own[i] if ours else wanted.twists[j]), (i, j)
        i, j = i + ours, j + (not ours)
    keep, theirs = np.array(pairs, np.int64).reshape(-1, 2).T
    return keep, theirs


def check_states(planner: Any, wanted: Expected) -> None:
    for critic in planner.critics:
        if isinstance(critic, OscillationCritic):
            signs = {0: 0, 1: 1, -1: 2}
            flags = [[signs[s], *only] for s, only in zip(critic.signs, critic.only, strict=True)]
            np.testing.assert_array_equal(np.array(flags, np.int64).ravel(), wanted.osc)
        if isinstance(critic, RotateToGoalCritic):
            assert [critic.near, critic.rotating] == wanted.rtg.astype(bool).tolist()


def run(name: str, only: int | None = None) -> None:
    job = JOBS[name]
    scene, planner = DWBScene(job), planner_of(name)
    for i, wanted in enumerate(expected_rows(name)):
        if only is not None and i >= only:
            return
        if job["kind"] == "table" and i:
            planner = planner_of(name)
        found = scene.run(planner, wanted.log, 100.0 + i * PERIOD_S)
        compare(f"{name}, row {i}", found, wanted, job["reasons"], planner)
        check_states(planner, wanted)
        if job["kind"] == "table" and i < 2:
            compare_grids(name, i, planner, scene)


def compare_grids(name: str, row: int, planner: Any, scene: DWBScene) -> None:
    """The cells of the critics that measure distances."""
    grids = arrays("dwb_tables").get(f"{name}/grids")
    if grids is None:
        return
    for critic in planner.critics:
        values = critic.grid_values()
        if critic.name in JOBS[name]["grids"] and values is not None:
            wanted = grids[row, JOBS[name]["grids"].index(critic.name)].astype(np.int64)
            if wanted.max() < np.iinfo(grids.dtype).max:  # -1: not computed
                np.testing.assert_array_equal(values, wanted)


QUICK = ("bringup/", "rect_footprint", "omni/", "limited_accel/", "grid_", "speed_", "limits_min", "by_time")


@pytest.mark.sampled
@pytest.mark.parametrize("name", [n for n in JOBS if n.startswith(QUICK)])
def test_two_cycles_are_those_of_nav2(name: str) -> None:
    run(name, 2)


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize("name", JOBS)
def test_cycles_are_those_of_nav2(name: str) -> None:
    run(name)


def test_the_data_have_jobs_of_both_kinds() -> None:
    assert {job["kind"] for job in JOBS.values()} == {"table", "loop"}
