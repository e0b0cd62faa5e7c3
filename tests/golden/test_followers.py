"""Regulated pure pursuit, rotation shim and graceful controller compared with Nav2's own, cycle by cycle.

The data are those of NAVSTACK_GOLDEN_NAV2 (default `../shared/golden_nav2`); jobs and scenes are found by name. The deliberate
differences of navstack (docs/parity/followers.md) are off: `as_nav2`.

Both sides compute in double precision with the same formulas in another order: formulas agree to 1e-12 relative. But Nav2 divides
costs by 253 in float32 (6e-8 relative) before it takes the logarithm, so distances from costs differ by up to 6e-8 / factor: at
a factor of 3 and 0.5 m/s per 0.6 m, commands differ by up to 2e-8 m/s, and times a curvature of 3 by 6e-8 rad/s: 1e-7. Nav2's
smooth control law has distance and angles in float32; with `as_nav2`, navstack rounds in the same places (formulas to 1e-12).

The graceful controller tries targets from far to near and simulates up to 60 poses to each: targets and commands are the same in
all 5580 cycles, to 1e-12.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import ControlError, Footprint, Path, Pose2D, RobotState, Twist2D
from navstack.local_planner import regulated_pure_pursuit as regulation
from navstack.local_planner.goal_checkers import SimpleGoalChecker, SimpleGoalCheckerParams
from navstack.local_planner.graceful import LAW, law
from navstack.local_planner.path_follower import Following
from navstack.plugins import LOCAL_PLANNERS, Approach
from tests.conftest import golden_nav2_files
from tests.golden.nav2_controllers import Scene, nested_params

COMMAND = 1e-7
SAME_TARGET = 1e-5
SMOOTH_LAW = 1e-12
FORMULA = 1e-12
FILES = {file.name: file for file in (*golden_nav2_files("controllers*"), *golden_nav2_files("tables.npz"))}
pytestmark = pytest.mark.skipif(
    not {"controllers.npz", "controllers_jobs.json", "tables.npz"} <= set(FILES),
    reason="no golden data of Nav2: set NAVSTACK_GOLDEN_NAV2 to their folder",
)


@lru_cache(maxsize=4)
def read(name: str) -> dict[str, NDArray[Any]]:
    with np.load(FILES[name]) as data:
        return {key: data[key] for key in data.files}


@lru_cache(maxsize=1)
def all_jobs() -> dict[str, Any]:
    if "controllers_jobs.json" not in FILES:
        return {}
    document: dict[str, Any] = json.loads(FILES["controllers_jobs.json"].read_text(encoding="utf-8"))
    return document


def controller_of(name: str) -> Any:
    """The controller of a job; parameters below `primary_controller` are those of the controller behind the shim."""
    job = all_jobs()[name]
    tree = nested_params(job)
    cls: Any = LOCAL_PLANNERS.get(job["plugin"]).cls
    primary = tree.pop("primary_controller", None)
    if primary is not None:
        kind = LOCAL_PLANNERS.get(primary.pop("plugin")).cls
        tree["sections"] = {"primary_controller": kind.Params(**primary)}
    return cls(cls.Params(**tree), as_nav2=True)


def commands(name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What C++ computed (n, 12) and what navstack does (n, 5): cmd v, cmd w, status, carrot x, y."""
    scene_name, kind = all_jobs()[name]["scene_name"], all_jobs()[name]["kind"]
    log = read("controllers.npz")[f"{name}/log"]
    data = read("controllers.npz")
    scene, footprint = Scene(data, scene_name, "costmap_inflated"), Footprint(data["footprint"])
    assert footprint.inscribed_radius == pytest.approx(data[f"scene/{scene_name}/radii"][0])
    out = np.full((len(log), 5), np.nan)
    controller, checker = controller_of(name), SimpleGoalChecker(SimpleGoalCheckerParams())
    for i, row in enumerate(log.tolist()):
        if kind == "table" and i:
            controller, checker = controller_of(name), SimpleGoalChecker(SimpleGoalCheckerParams())
        x, y, yaw, v, w, first, end = row[:7]
        path = scene.path(int(first), int(end))
        pose, velocity = Pose2D(x, y, yaw), Twist2D(v, 0.0, w)
        near = checker.at_position(Approach(pose, scene.goal, velocity, path.poses, path.length))
        controller.set_plan(Path(scene.plan, "map"), scene.goal) if i == 0 or kind == "table" else None
        fresh = i == 0 or kind == "table"
        now = Following(
            RobotState(pose, velocity), path, scene.goal, scene.costmap, footprint, None, False, near, fresh, fresh
        )
        try:
            plan = controller.follow(now)
            out[i, :3] = plan.command.vx, plan.command.wz, 1.0
        except ControlError:
            out[i, :3] = 0.0, 0.0, -1.0
        if controller.carrot is not None:
            out[i, 3:] = controller.carrot
    return log, out


@pytest.mark.sampled
@pytest.mark.parametrize("name", [n for n in all_jobs() if not n.startswith("graceful")])
def test_commands_are_those_of_nav2(name: str) -> None:
    log, out = commands(name)
    np.testing.assert_array_equal(out[:, 2], log[:, 9])
    np.testing.assert_allclose(out[:, :2], log[:, 7:9], rtol=0.0, atol=COMMAND)
    known = np.isfinite(log[:, 10])
    np.testing.assert_allclose(out[known, 3:], log[known, 10:12], rtol=0.0, atol=COMMAND)


@pytest.mark.sampled
@pytest.mark.parametrize("name", [n for n in all_jobs() if n.startswith("graceful")])
def test_commands_of_the_graceful_controller_are_those_of_nav2(name: str) -> None:
    log, out = commands(name)
    with np.errstate(invalid="ignore"):
        near = np.abs(out[:, 3:] - log[:, 10:12]).max(axis=1) < SAME_TARGET
    same = near | (np.isnan(out[:, 3]) & np.isnan(log[:, 10]))
    np.testing.assert_array_equal(out[same, 2], log[same, 9])
    np.testing.assert_allclose(out[same, :2], log[same, 7:9], rtol=0.0, atol=SMOOTH_LAW)
    assert same.all(), f"another target in cycles {np.flatnonzero(~same).tolist()}"


def test_formulas_of_pure_pursuit() -> None:
    t = read("tables.npz")
    got = [regulation.curvature_to(x, y) for x, y in t["in/curvature"].tolist()]
    np.testing.assert_allclose(got, t["curvature_out"], rtol=FORMULA, atol=FORMULA)
    got = [regulation.speed_in_curve(v, k, r) for v, k, r in t["in/curvature_constraint"].tolist()]
    np.testing.assert_allclose(got, t["curvature_constraint_out"], rtol=FORMULA)
    inscribed = float(t["cost_constraint_inscribed"][0])
    got = []
    for v, cost, factor, scaling, gain in t["in/cost_constraint"].tolist():
        d = regulation.distance_from_cost(cost, inscribed, factor) if cost not in (0.0, 255.0) else math.inf
        got.append(regulation.speed_near_obstacle(v, d, scaling, gain))
    np.testing.assert_allclose(got, t["cost_constraint_out"], rtol=0.0, atol=COMMAND)
    got = []
    for v, dx, dy, _, least, scaling in t["in/approach"].tolist():
        length = math.hypot(dx, dy)
        got.append(regulation.approach_speed(v, length, length, scaling, least))
    np.testing.assert_allclose(got, t["approach_out"], rtol=1e-9)


def test_the_dynamic_window() -> None:
    t = read("tables.npz")
    limits = regulation.WindowLimits(-0.5, 0.5, -2.5, 2.5, 0.125, 0.125, 0.16, 0.16)
    got = []
    for v, w, regulated, curvature, sign in t["in/dwpp"].tolist():
        window = regulation.dynamic_window(v, w, regulated, limits, sign)
        got.append(regulation.nearest_to_arc(window, curvature, sign))
    np.testing.assert_allclose(got, t["dwpp_out"], rtol=0.0, atol=COMMAND)


def test_the_smooth_control_law() -> None:
    t = read("tables.npz")
    targets = t["in/scl_targets"]
    for number, (k_phi, k_delta, beta, exponent, slowdown, deceleration, v_min, v_max, w_max) in enumerate(
        t["in/scl_params"].tolist()
    ):
        p = np.zeros(1, LAW)
        p["as_nav2"] = True
        names = ("k_phi", "k_delta", "beta", "exponent", "slowdown_radius", "deceleration", "v_min", "v_max", "w_max")
        for name, value in zip(names, (k_phi, k_delta, beta, exponent, slowdown, deceleration, v_min, v_max, w_max)):
            p[name] = value
        got, after = [], []
        for x, y, yaw, cx, cy, cyaw, backward in targets.tolist():
            here = law(x, y, yaw, cx, cy, cyaw, backward != 0.0, p[0])
            got.append((*law(x, y, yaw, 0.0, 0.0, 0.0, backward != 0.0, p[0]), *here))
            after.append(
                (cx + 0.1 * here[0] * math.cos(cyaw), cy + 0.1 * here[0] * math.sin(cyaw), cyaw + 0.1 * here[1])
            )
        np.testing.assert_allclose(got, t["scl_out"][number], rtol=SMOOTH_LAW, atol=SMOOTH_LAW)
        np.testing.assert_allclose(np.array(after)[:, :2], t["scl_next"][number][:, :2], atol=COMMAND)
        turned = np.array(after)[:, 2] - t["scl_next"][number][:, 2]
        np.testing.assert_allclose(np.cos(turned), 1.0, atol=COMMAND)
