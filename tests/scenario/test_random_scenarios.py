"""Random scenarios: no exception, no hang, a terminal state for every goal, no success despite a collision.

Thousands of them, and longer ones: `navstack bench random`.
"""

from __future__ import annotations

import pytest

from navstack.scenario.random_scenarios import check_random, random_scenario

SHORT_S = 2.0
FOUR = 50


def test_a_scenario_depends_on_its_number_only() -> None:
    first, second = (random_scenario(7).build() for _ in range(2))
    assert first.as_dict() == second.as_dict()
    assert (first.map.data == second.map.data).all()
    assert check_random(7, time_limit_s=SHORT_S) == check_random(7, time_limit_s=SHORT_S)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 200, FOUR))
def test_no_invariant_is_violated(first: int) -> None:
    checked = [check_random(number, time_limit_s=SHORT_S) for number in range(first, first + FOUR)]
    assert [(c.number, c.faults) for c in checked if c.faults] == []
    # they drive: a fault cannot hide behind scenarios that never begin
    assert sum(c.simulated_s > 0.9 for c in checked) > 0.7 * FOUR
