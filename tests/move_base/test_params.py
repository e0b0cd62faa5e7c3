from __future__ import annotations

import pytest
from pydantic import ValidationError

from navstack.move_base import MoveBaseParams, builtin_recoveries
from navstack.plugins import RECOVERY_BEHAVIORS

DEFAULTS = {
    "base_global_planner": "navfn/NavfnROS",
    "base_local_planner": "base_local_planner/TrajectoryPlannerROS",
    "recovery_behaviors": None,
    "planner_frequency": 0.0,
    "controller_frequency": 20.0,
    "planner_patience": 5.0,
    "controller_patience": 15.0,
    "max_planning_retries": -1,
    "oscillation_timeout": 0.0,
    "oscillation_distance": 0.5,
    "conservative_reset_dist": 3.0,
    "recovery_behavior_enabled": True,
    "clearing_rotation_allowed": True,
    "shutdown_costmaps": False,
    "make_plan_clear_costmap": True,
    "make_plan_add_unreachable_goal": True,
    "clearing_radius": None,
}


def test_the_names_and_effective_defaults_of_ros() -> None:
    added = {"progress_checker_plugins": None, "base_smoother": None, "sections": {}}  # from Nav2
    assert MoveBaseParams().model_dump() == {**DEFAULTS, **added}
    assert "restore_defaults" in MoveBaseParams.NO_EFFECT
    for name, field in MoveBaseParams.model_fields.items():
        assert field.description, name


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("controller_frequency", 0.0),
        ("controller_frequency", 1001.0),
        ("controller_frequency", float("nan")),
        ("planner_frequency", -1.0),
        ("planner_patience", "5"),
        ("max_planning_retries", 1.5),
        ("max_planning_retries", -2),
        ("oscillation_timeout", -1.0),
        ("recovery_behavior_enabled", 1),
        ("recovery_behaviors", "rotate_recovery"),
        ("recovery_behaviors", [{"name": "a"}]),
        ("recovery_behaviors", [{"name": "", "type": "b"}]),
        ("planer_frequency", 1.0),
    ],
)
def test_invalid_values_are_rejected(name: str, value: object) -> None:
    with pytest.raises(ValidationError) as caught:
        MoveBaseParams.model_validate({name: value})
    assert name in str(caught.value)


def test_a_recovery_list_from_yaml() -> None:
    params = MoveBaseParams.model_validate(
        {"recovery_behaviors": [{"name": "spin", "type": "rotate_recovery/RotateRecovery"}], "controller_frequency": 5}
    )
    assert params.recovery_behaviors is not None
    assert params.recovery_behaviors[0].name == "spin"
    assert params.controller_frequency == 5.0


def test_the_builtin_recoveries() -> None:
    found = builtin_recoveries(MoveBaseParams(conservative_reset_dist=2.5), 0.2)
    assert [spec.name for spec, _ in found] == [
        "conservative_reset",
        "rotate_recovery",
        "aggressive_reset",
        "rotate_recovery",
    ]
    assert [given for _, given in found] == [{"reset_distance": 2.5}, {}, {"reset_distance": 0.8}, {}]
    for spec, given in found:
        RECOVERY_BEHAVIORS.get(spec.type).cls.Params.model_validate(given)
    without = builtin_recoveries(MoveBaseParams(clearing_rotation_allowed=False), 0.2)
    assert [spec.name for spec, _ in without] == ["conservative_reset", "aggressive_reset"]
