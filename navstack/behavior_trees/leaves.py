"""Leaves of BehaviorTree.CPP: constants, scripts, the blackboard, time."""

from __future__ import annotations

from navstack.behavior_trees.blackboard import TYPES, UNSET, Port, inputs
from navstack.behavior_trees.errors import ScriptError
from navstack.behavior_trees.nodes import (
    FAILURE,
    RUNNING,
    SUCCESS,
    Action,
    Condition,
    Leaf,
    StatefulAction,
    Status,
    node,
)
from navstack.behavior_trees.scripts import Script


@node("AlwaysSuccess")
class AlwaysSuccess(Action):
    """SUCCESS."""

    def tick(self) -> Status:
        """Succeed."""
        return SUCCESS


@node("AlwaysFailure")
class AlwaysFailure(Action):
    """FAILURE."""

    def tick(self) -> Status:
        """Fail."""
        return FAILURE


class _Scripted(Leaf):
    """A leaf with a script in the port `code`, which may be an entry."""

    PORTS = inputs(code="string!")

    __slots__ = ("script",)

    script: Script | None

    def setup(self) -> None:
        """Parse the script if it is a constant."""
        self.script = None
        if self.has("code"):
            self.parsed()

    def parsed(self) -> Script:
        """Return the script."""
        code = self.text("code")
        script = self.script
        if script is None or script.source != code:
            try:
                script = self.script = Script(code, self.tree.enums)
            except ScriptError as exc:
                at = "" if exc.position is None else f" at character {exc.position + 1}"
                raise self.failure(f'the script "{code:.80}" is invalid{at}: {exc}') from None
        return script


@node("Script")
class RunScript(_Scripted):
    """SUCCESS after the script."""

    def tick(self) -> Status:
        """Run the script."""
        self.parsed()(self.blackboard)
        return SUCCESS


@node("ScriptCondition")
class ScriptCondition(_Scripted, Condition):
    """SUCCESS if the script is true, otherwise FAILURE."""

    def tick(self) -> Status:
        """Evaluate the script."""
        return SUCCESS if self.parsed().is_true(self.blackboard) else FAILURE


@node(
    "SetBlackboard",
    ports=(Port("value", "any", required=True), Port("output_key", "any", direction="both", required=True)),
)
class SetBlackboard(Action):
    """Writes `value` (a constant, or another entry) to the entry `output_key`."""

    def tick(self) -> Status:
        """Write the value."""
        port = self.inputs["value"]
        value = port.get(UNSET)
        if value is UNSET:
            if port.entry is not None:
                raise self.failure(f'nothing has been written to the entry "{port.entry.key}" yet')
            return FAILURE
        target = self.outputs["output_key"].entry
        if target is None:
            return FAILURE
        kind = TYPES.get(target.type)
        if kind is None and isinstance(target.value, (int, float)):
            # the entry holds a number, as of a script
            kind = TYPES["int" if isinstance(value, str) and value.strip().lstrip("-").isdigit() else "double"]
        if kind is not None and isinstance(value, str):
            try:
                value = kind.parse(value)
            except ValueError as exc:
                raise self.failure(
                    f'"{value:.80}" cannot be written to "{target.key}" of type {target.type}: {exc}'
                ) from None
        target.set(value)
        return SUCCESS


@node("UnsetBlackboard", ports=inputs(key="string!"))
class UnsetBlackboard(Action):
    """Forgets the value of an entry."""

    def tick(self) -> Status:
        """Forget the value."""
        self.blackboard.unset(self.text("key"))
        return SUCCESS


@node("WasEntryUpdated", ports=inputs(entry="any!"))
class WasEntryUpdated(Action):
    """SUCCESS if the entry has been written since the last tick, otherwise FAILURE."""

    __slots__ = ("seen",)

    def __init__(self) -> None:
        super().__init__()
        self.seen = 0

    def tick(self) -> Status:
        """Compare the number of writes."""
        entry = self.inputs["entry"].entry
        if entry is None or entry.version == self.seen:
            return FAILURE
        self.seen = entry.version
        return SUCCESS


@node("Sleep", ports=inputs(msec="unsigned!"))
class Sleep(StatefulAction):
    """RUNNING for `msec`, then SUCCESS."""

    __slots__ = ("due",)

    def __init__(self) -> None:
        super().__init__()
        self.due = 0

    def start(self) -> Status:
        """Begin to wait."""
        duration = self.integer("msec")
        self.due = self.tree.now_ns + 1_000_000 * duration
        return RUNNING if duration > 0 else SUCCESS

    def go_on(self) -> Status:
        """Wait."""
        return RUNNING if self.tree.now_ns < self.due else SUCCESS
