"""Every tick of Nav2's trees and nodes as in C++: status, events of the leaves in order, halts, changes of the blackboard."""

from __future__ import annotations

import pytest

from tests.behavior_trees.golden_cases import Case, jobs, names

if not jobs():
    pytest.skip("the golden data of behavior trees are absent", allow_module_level=True)


def check(name: str, at: int) -> None:
    case = Case(name, at)
    for tick, (ours, theirs) in enumerate(zip(case.ticks(), case.expected(), strict=True)):
        assert ours == theirs, f"{name}, seed {case.seed}, tick {tick}: (status, events, blackboard)"


@pytest.mark.parametrize("name", names(""))
def test_first_seed_ticks_as_in_cpp(name: str) -> None:
    check(name, 0)


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize("name", names(""))
def test_all_seeds_tick_as_in_cpp(name: str) -> None:
    for at in range(len(jobs()[name]["seeds"])):
        check(name, at)


def test_a_changed_result_of_a_leaf_is_noticed() -> None:
    name = "tree/navigate_to_pose_w_replanning_and_recovery"
    case = Case(name, 0)
    case.script = case.script.copy()
    case.script[0, 0] = 3
    assert any(ours != theirs for ours, theirs in zip(case.ticks(), case.expected(), strict=True))
