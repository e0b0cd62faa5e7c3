"""Checks of a base with a turning radius: each finding, its numbers, its place, and that the fix removes it."""

from __future__ import annotations

import pytest

from navstack.parameters.configuration import check_parameters
from navstack.parameters.findings import Finding

PATH = "given_path/segments=[[2.0, 0.0], [-1.0, 1.0], [1.0, 0.0]]"
"""Forward, back on an arc of 1 m, forward: changes of direction at (2, 0) and (1.16, 0.46)."""
STEERING = {
    "turns-too-tight",
    "planner-turning-radius",
    "recovery-turns-in-place",
    "cannot-reverse",
    "path-under-footprint",
}


def found(params: str, *overrides: str) -> dict[str, Finding]:
    given = params.startswith("car_") and not any(o.startswith("base_global_planner") for o in overrides)
    findings = check_parameters(
        [params], overrides=[*(["base_global_planner=given_path"] if given else []), *overrides]
    )
    return {f.rule: f for f in findings if f.rule in STEERING | {"turn-in-place"}}


@pytest.mark.parametrize("params", ["car_mppi", "car_rpp"])
def test_the_packaged_cars_fit_their_base(params: str) -> None:
    assert found(params, PATH) == {}
    assert [f.rule for f in check_parameters([params]) if f.severity != "info"] == []
    assert found(params, "base_global_planner=smac_hybrid") == {}


def test_a_base_that_turns_in_place_has_none_of_these() -> None:
    for params in ("turtlebot", "omni_mppi", "jackal_mppi"):
        assert found(params) == {}
    # a tricycle whose wheel turns by a quarter turn turns in place
    assert found("turtlebot", "navstack/sim/kinematics=tricycle", "navstack/sim/max_steering_angle=1.570796") == {}


@pytest.mark.parametrize(
    ("params", "overrides", "rule", "parts"),
    [
        (
            "turtlebot",
            ("navstack/sim/kinematics=ackermann",),
            "turns-too-tight",
            ("dwa commands turns in place", "kinematics ackermann) turns on 0.731 m", "mppi", "min_turning_r: 0.74"),
        ),
        (
            "turtlebot_rpp",
            ("navstack/sim/kinematics=tricycle",),
            "turns-too-tight",
            ("set min_turning_r to 0.74 and use_rotate_to_heading to false",),
        ),
        (
            "turtlebot_mppi",
            ("navstack/sim/kinematics=ackermann",),
            "turns-too-tight",
            ("set motion_model: Ackermann with min_turning_r: 0.74",),
        ),
        (
            "car_mppi",
            ("MPPIController/ackermann/min_turning_r=0.5",),
            "turns-too-tight",
            ("mppi commands curves of 0.5 m", "turns on 0.816 m", "set min_turning_r to 0.82"),
        ),
        (
            "car_mppi",
            ("base_global_planner=navfn",),
            "planner-turning-radius",
            ("navfn plans paths with corners", "0.85 m", "given_path"),
        ),
        (
            "car_rpp",
            ("given_path/segments=[[2.0, 0.0], [1.0, -2.0], [1.0, 0.0]]",),
            "planner-turning-radius",
            ("segment 2 of given_path turns on 0.5 m from (2.00, 0.00) on", "0.85 m", "at most 1.17 1/m"),
        ),
        (
            "turtlebot",
            ("navstack/sim/kinematics=ackermann",),
            "recovery-turns-in-place",
            ("rotate_recovery turns in place", "remove it from recovery_behaviors"),
        ),
        (
            "turtlebot_mppi",
            ("navstack/sim/kinematics=ackermann",),
            "recovery-turns-in-place",
            ("set clearing_rotation_allowed to false",),
        ),
        ("car_mppi", (PATH, "MPPIController/vx_min=0.0"), "cannot-reverse", ("at (2.00, 0.00)", "set vx_min of mppi")),
        (
            "car_rpp",
            (PATH, "RegulatedPurePursuitController/allow_reversing=false"),
            "cannot-reverse",
            ("set allow_reversing of regulated_pure_pursuit",),
        ),
        (
            "car_rpp",
            (PATH, "RegulatedPurePursuitController/min_linear_vel=0.0"),
            "cannot-reverse",
            ("heed the warning on allow_reversing of regulated_pure_pursuit",),
        ),
        (
            "car_rpp",
            (PATH, "PathHandler/enforce_path_inversion=false"),
            "path-under-footprint",
            ("at (2.00, 0.00)", "overlap under the footprint of 0.82 x 0.52 m", "enforce_path_inversion to true"),
        ),
        (
            "car_rpp",
            ("given_path/segments=[[2.0, 0.0], [-0.08, 1.0], [1.0, 0.0]]",),
            "path-under-footprint",
            ("the piece of 0.08 m", "inversion_xy_tolerance = 0.1 m", "set the tolerance to 0.04"),
        ),
        (
            "car_rpp",
            ("RegulatedPurePursuitController/use_rotate_to_heading=true",),
            "turn-in-place",
            ("a base with a turning radius of 0.85 m cannot turn in place",),
        ),
    ],
)  # fmt: skip
def test_each_rule_names_the_numbers_and_the_fix(
    params: str, overrides: tuple[str, ...], rule: str, parts: tuple[str, ...]
) -> None:
    findings = found(params, *overrides)
    assert rule in findings, sorted(findings)
    for part in parts:
        assert part in findings[rule].message
    assert findings[rule].severity == ("error" if rule == "turn-in-place" else "warning")


def test_a_shim_around_a_car_controller_is_refused() -> None:
    shim = {
        "base_local_planner": "rotation_shim",
        "RotationShimController": {
            "primary_controller": {
                "plugin": "nav2_mppi_controller::MPPIController",
                "motion_model": "Ackermann",
                "AckermannConstraints": {"min_turning_r": 0.85},
            }
        },
    }
    findings = [f for f in check_parameters(["car_mppi", shim]) if f.rule == "turn-in-place"]
    assert len(findings) == 1 and findings[0].severity == "error"
    assert "0.85 m cannot turn in place; use mppi without the shim" in findings[0].message


def test_the_fix_removes_the_finding() -> None:
    """What the message says to write, written."""
    fixed = (
        "navstack/sim/kinematics=ackermann",
        "RegulatedPurePursuitController/min_turning_r=0.74",
        "RegulatedPurePursuitController/use_rotate_to_heading=false",
        "clearing_rotation_allowed=false",
        "base_global_planner=given_path",
        "given_path/segments=[[2.0, 0.5]]",
    )
    assert found("turtlebot_rpp", *fixed) == {}
