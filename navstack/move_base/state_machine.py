"""move_base's state machine: `step` is a pure function of the transition table.

`MoveBase` determines the events (conditions such as patience, retries and sensor data) and executes the actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Final

from navstack.core.errors import InternalError
from navstack.move_base.states import IndexRule, Mode, NavEvent, NavState, Transition, Trigger
from navstack.move_base.transition_table import ROWS


def _indexed() -> dict[tuple[Mode, NavEvent, Trigger], Transition]:
    found: dict[tuple[Mode, NavEvent, Trigger], Transition] = {}
    # rows that name a trigger come first: they have priority
    for row in sorted(ROWS, key=lambda r: r.when_trigger is None):
        for trigger in Trigger if row.when_trigger is None else (row.when_trigger,):
            found.setdefault((row.mode, row.event, trigger), row)
    return found


TABLE: Final[Mapping[tuple[Mode, NavEvent, Trigger], Transition]] = MappingProxyType(_indexed())
"""The rows by (mode, event, trigger)."""


@lru_cache(maxsize=4096)
def step(state: NavState, event: NavEvent) -> tuple[NavState, Transition]:
    """Return the state after `event`, and the row with the actions and the outcome.

    Raises InternalError for an event that is illegal in that state.
    """
    row = TABLE.get((state.mode, event, state.trigger))
    if row is None:
        raise InternalError(
            f"{event.name} is illegal in {state.mode.name}; please report this",
            mode=state.mode.name,
            event=event.name,
            trigger=state.trigger.name,
        )
    rule = row.index_rule
    index = state.recovery_index
    if rule is not IndexRule.KEEP:
        index = 0 if rule is IndexRule.RESET else index + 1
    trigger = state.trigger if row.set_trigger is None else row.set_trigger
    if row.to is state.mode and index == state.recovery_index and trigger is state.trigger:
        return state, row
    return NavState(row.to, trigger, index), row
