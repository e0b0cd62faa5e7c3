"""Control nodes of BehaviorTree.CPP and of Nav2.

Sources of the rules: BehaviorTree.CPP 4.10 (src/controls), Nav2 (nav2_behavior_tree/plugins/control). SKIPPED children count as
neither success nor failure; a node whose children are all SKIPPED is SKIPPED.
"""

from __future__ import annotations

from typing import Final

from navstack.behavior_trees.blackboard import Port, inputs
from navstack.behavior_trees.nodes import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Control, Status, node


class _InOrder(Control):
    """Children in order, until one returns `stops`; `else_` if none does. It resumes at the running child."""

    __slots__ = ("at", "skipped", "wakes")

    stops: Status
    else_: Status

    def __init__(self) -> None:
        super().__init__()
        self.at = self.skipped = 0
        self.wakes = False
        """True if the tree is ticked again at once between two children, so that a reactive parent checks its conditions."""

    def halt(self) -> None:
        """Begin again at the first child."""
        self.at = self.skipped = 0
        super().halt()

    def tick(self) -> Status:
        """Tick the children from the current one."""
        children = self.children
        count = len(children)
        if self.status is IDLE:
            self.skipped = 0
        self.status = RUNNING
        while self.at < count:
            child = children[self.at]
            before = child.status
            status = child.execute()
            if status is RUNNING:
                return RUNNING
            if status is self.stops:
                self.stopped()
                return status
            self.at += 1
            if status is SKIPPED:
                self.skipped += 1
            elif self.wakes and before is IDLE and self.at < count and self.tree.wake(self):
                return RUNNING
        all_skipped = self.skipped == count
        self.reset_children()
        self.at = self.skipped = 0
        return SKIPPED if all_skipped else self.else_

    def stopped(self) -> None:
        """Reset after a child decided."""
        self.reset_children()
        self.at = 0


@node("Sequence")
class Sequence(_InOrder):
    """FAILURE at the first child that fails, otherwise SUCCESS."""

    stops, else_ = FAILURE, SUCCESS


@node("Fallback")
class Fallback(_InOrder):
    """SUCCESS at the first child that succeeds, otherwise FAILURE."""

    stops, else_ = SUCCESS, FAILURE


@node("AsyncSequence")
class AsyncSequence(Sequence):
    """A Sequence that lets the tree be ticked between its children."""

    def setup(self) -> None:
        """Wake the tree between children."""
        self.wakes = True


@node("AsyncFallback")
class AsyncFallback(Fallback):
    """A Fallback that lets the tree be ticked between its children."""

    def setup(self) -> None:
        """Wake the tree between children."""
        self.wakes = True


@node("SequenceWithMemory", "SequenceStar")
class SequenceWithMemory(Sequence):
    """A Sequence that goes on at the child that failed; even a halt does not make it begin again."""

    def setup(self) -> None:
        """Wake the tree between children."""
        self.wakes = True

    def halt(self) -> None:
        """Halt the children; the index stays."""
        Control.halt(self)

    def stopped(self) -> None:
        """Reset the failed child and those after it; the index stays."""
        for index in range(self.at, len(self.children)):
            self.halt_child(index)


class _Reactive(Control):
    """All children from the first one in each tick; one runs at a time."""

    stops: Status
    else_: Status

    def tick(self) -> Status:
        """Tick the children until one runs or decides."""
        all_skipped = True
        self.status = RUNNING
        children = self.children
        for index, child in enumerate(children):
            status = child.execute()
            if status is SKIPPED:
                self.halt_child(index)
                continue
            all_skipped = False
            if status is RUNNING:
                for other in children:
                    if other is not child:
                        if other.status is RUNNING:
                            other.halt_node()
                        other.status = IDLE
                return RUNNING
            if status is self.stops:
                self.reset_children()
                return status
        self.reset_children()
        return SKIPPED if all_skipped else self.else_


@node("ReactiveSequence")
class ReactiveSequence(_Reactive):
    """FAILURE at the first child that fails; the conditions before a running child are checked in each tick."""

    stops, else_ = FAILURE, SUCCESS


@node("ReactiveFallback")
class ReactiveFallback(_Reactive):
    """SUCCESS at the first child that succeeds, checked in each tick."""

    stops, else_ = SUCCESS, FAILURE


def _threshold(value: int, count: int) -> int:
    """A negative threshold counts from the number of children: -1 is all of them."""
    return max(count + value + 1, 0) if value < 0 else value


@node("Parallel", ports=inputs(success_count=("int", "-1"), failure_count=("int", "1")))
class Parallel(Control):
    """All children at once, until enough of them have succeeded or failed."""

    __slots__ = ("done", "failures", "successes")

    def __init__(self) -> None:
        super().__init__()
        self.done: set[int] = set()
        self.successes = self.failures = 0

    def _clear(self) -> None:
        self.done.clear()
        self.successes = self.failures = 0

    def halt(self) -> None:
        """Forget the counts."""
        self._clear()
        super().halt()

    def tick(self) -> Status:
        """Tick the children that have not ended."""
        children, count = self.children, len(self.children)
        wanted = self.integer("success_count", -1)
        needed, allowed = _threshold(wanted, count), _threshold(self.integer("failure_count", 1), count)
        for name, value in (("success_count", needed), ("failure_count", allowed)):
            if count < value:
                raise self.failure(f"{name} is {value}, but there are {count} children; lower it")
        self.status = RUNNING
        skipped = 0
        for index, child in enumerate(children):
            if index not in self.done:
                status = child.execute()
                if status is SKIPPED:
                    skipped += 1
                elif status is not RUNNING:
                    self.done.add(index)
                    if status is SUCCESS:
                        self.successes += 1
                    else:
                        self.failures += 1
            if self.successes >= needed or (wanted < 0 and self.successes + skipped >= needed):
                self._clear()
                self.reset_children()
                return SUCCESS
            if count - self.failures < needed or self.failures == allowed:
                self._clear()
                self.reset_children()
                return FAILURE
        return SKIPPED if skipped == count else RUNNING


@node("ParallelAll", ports=inputs(max_failures=("int", "1")))
class ParallelAll(Control):
    """All children at once, until every one of them has ended."""

    __slots__ = ("done", "failures")

    def __init__(self) -> None:
        super().__init__()
        self.done: set[int] = set()
        self.failures = 0

    def halt(self) -> None:
        """Forget the counts."""
        self.done.clear()
        self.failures = 0
        super().halt()

    def tick(self) -> Status:
        """Tick the children that have not ended."""
        children, count = self.children, len(self.children)
        limit = _threshold(self.integer("max_failures", 1), count)
        if count < limit:
            raise self.failure(f"max_failures is {limit}, but there are {count} children; lower it")
        self.status = RUNNING
        skipped = 0
        for index, child in enumerate(children):
            if index in self.done:
                continue
            status = child.execute()
            if status is SKIPPED:
                skipped += 1
            elif status is not RUNNING:
                self.done.add(index)
                self.failures += status is FAILURE
        if skipped == count:
            return SKIPPED
        if skipped + len(self.done) >= count:
            self.reset_children()
            self.done.clear()
            result = FAILURE if self.failures >= limit else SUCCESS
            self.failures = 0
            return result
        return RUNNING


@node("IfThenElse")
class IfThenElse(Control):
    """The first child decides once whether the second or the third one runs."""

    CHILDREN = (2, 3)

    __slots__ = ("at",)

    def __init__(self) -> None:
        super().__init__()
        self.at = 0

    def halt(self) -> None:
        """Decide again."""
        self.at = 0
        super().halt()

    def tick(self) -> Status:
        """Tick the condition, then the chosen child."""
        children = self.children
        self.status = RUNNING
        if self.at == 0:
            status = children[0].execute()
            if status is RUNNING:
                return RUNNING
            if status is SUCCESS:
                self.at = 1
            elif status is FAILURE:
                if len(children) != 3:
                    return FAILURE
                self.at = 2
            else:
                raise self.failure("the condition (the first child) was SKIPPED; it must succeed or fail")
        status = children[self.at].execute()
        if status is not RUNNING:
            self.reset_children()
            self.at = 0
        return status


@node("WhileDoElse")
class WhileDoElse(Control):
    """The first child decides in each tick whether the second or the third one runs."""

    CHILDREN = (2, 3)

    def tick(self) -> Status:
        """Tick the condition, then the chosen child."""
        children = self.children
        self.status = RUNNING
        condition = children[0].execute()
        if condition is RUNNING:
            return RUNNING
        has_else = len(children) == 3
        if condition is SUCCESS:
            if has_else:
                self.halt_child(2)
            status = children[1].execute()
        elif condition is FAILURE:
            status = FAILURE
            if has_else:
                self.halt_child(1)
                status = children[2].execute()
        else:
            self.reset_children()
            raise self.failure("the condition (the first child) was SKIPPED; it must succeed or fail")
        if status is not RUNNING:
            self.reset_children()
        return status


_EQUAL: Final = 2.0**-23


def same_value(first: str, second: str, enums: dict[str, int]) -> bool:
    """Return True if two texts are equal, or stand for the same number."""
    if first == second:
        return True

    def number(text: str) -> float | None:
        if text in enums:
            return float(enums[text])
        try:
            return float(text)
        except ValueError:
            return None

    a, b = number(first), number(second)
    return a is not None and b is not None and abs(a - b) <= _EQUAL


class Switch(Control):
    """The child whose `case_N` equals `variable`, otherwise the last one."""

    __slots__ = ("running",)

    def __init__(self) -> None:
        super().__init__()
        self.running = -1

    def halt(self) -> None:
        """Forget the running child."""
        self.running = -1
        super().halt()

    def tick(self) -> Status:
        """Tick the child of the case."""
        cases = len(self.children) - 1
        match = cases
        if self.has("variable"):
            variable = self.text("variable")
            for index in range(cases):
                name = f"case_{index + 1}"
                if self.has(name) and same_value(variable, self.text(name), self.tree.enums):
                    match = index
                    break
        if self.running not in (-1, match):
            self.halt_child(self.running)
        status = self.children[match].execute()
        if status is RUNNING:
            self.running = match
            return RUNNING
        self.running = -1
        if status is not SKIPPED:
            self.reset_children()
        return status


for _cases in range(2, 7):
    _switch = type(
        f"Switch{_cases}", (Switch,), {"CHILDREN": (_cases + 1, _cases + 1), "__slots__": (), "__doc__": Switch.__doc__}
    )
    node(f"Switch{_cases}", ports=inputs(variable="string!", **{f"case_{i + 1}": "string!" for i in range(_cases)}))(
        _switch
    )


@node("TryCatch", ports=inputs(catch_on_halt=("bool", "false")))
class TryCatch(Control):
    """A Sequence of all children but the last; if it fails, the last child runs, and the result is FAILURE."""

    CHILDREN = (2, None)

    __slots__ = ("at", "catching", "skipped")

    def __init__(self) -> None:
        super().__init__()
        self.at = self.skipped = 0
        self.catching = False

    def halt(self) -> None:
        """Halt the children; with `catch_on_halt` the last child is ticked once."""
        if self.status is not IDLE and not self.catching and self.flag("catch_on_halt"):
            for index in range(len(self.children) - 1):
                self.halt_child(index)
            if self.children[-1].execute() is RUNNING:
                self.halt_child(len(self.children) - 1)
        self.at = self.skipped = 0
        self.catching = False
        super().halt()

    def tick(self) -> Status:
        """Tick the children, or the last one after a failure."""
        children = self.children
        tries = len(children) - 1
        if self.status is IDLE:
            self.skipped = 0
            self.catching = False
        self.status = RUNNING
        while not self.catching and self.at < tries:
            status = children[self.at].execute()
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                self.reset_children()
                self.at = 0
                self.catching = True
            else:
                self.at += 1
                self.skipped += status is SKIPPED
        if self.catching:
            if children[-1].execute() is RUNNING:
                return RUNNING
            self.reset_children()
            self.at = 0
            self.catching = False
            return FAILURE
        all_skipped = self.skipped == tries
        self.reset_children()
        self.at = self.skipped = 0
        return SKIPPED if all_skipped else SUCCESS


# --- Nav2 --------------------------------------------------------------------------------------------------------------


@node("PipelineSequence")
class PipelineSequence(Control):
    """All children in each tick up to the furthest one that has run, so that the earlier ones go on while a later one runs."""

    __slots__ = ("furthest",)

    def __init__(self) -> None:
        super().__init__()
        self.furthest = 0

    def halt(self) -> None:
        """Begin again."""
        super().halt()
        self.furthest = 0

    def tick(self) -> Status:
        """Tick the children."""
        skipped = 0
        furthest = self.furthest
        for index, child in enumerate(self.children):
            status = child.execute()
            if status is RUNNING:
                if index >= furthest:
                    self.furthest = index
                    return RUNNING
            elif status is FAILURE:
                self.reset_children()
                self.furthest = 0
                return FAILURE
            elif status is SKIPPED:
                skipped += 1
        self.reset_children()
        self.furthest = 0
        return SKIPPED if skipped == len(self.children) else SUCCESS


@node("RecoveryNode", ports=inputs(number_of_retries=("int", "1")))
class RecoveryNode(Control):
    """The first child; if it fails, the second one, then the first one again, up to `number_of_retries` times."""

    CHILDREN = (2, 2)

    __slots__ = ("at", "retries")

    def __init__(self) -> None:
        super().__init__()
        self.at = self.retries = 0

    def halt(self) -> None:
        """Forget the retries."""
        super().halt()
        self.at = self.retries = 0

    def tick(self) -> Status:
        """Tick the current child."""
        allowed = self.integer("number_of_retries", 1)
        main, recovery = self.children
        self.status = RUNNING
        while self.retries <= allowed:
            if self.at == 0:
                status = main.execute()
                if status is RUNNING:
                    return RUNNING
                if status is not FAILURE:
                    self.halt()
                    return status
                if self.retries >= allowed:
                    break
                self.tree.trace.retried(self, self.retries + 1, allowed)
                self.halt_child(0)
                self.at = 1
            else:
                status = recovery.execute()
                if status is RUNNING:
                    return RUNNING
                if status is SKIPPED:  # the retries stay counted, as in Nav2
                    self.at = 0
                    self.halt_child(1)
                    return FAILURE
                if status is FAILURE:
                    break
                self.halt_child(1)
                self.retries += 1
                self.at = 0
                self.tree.charge(self)
        self.halt()
        return FAILURE


@node("RoundRobin", ports=inputs(wrap_around="bool"))
class RoundRobin(Control):
    """The next child each time: SUCCESS of one ends the tick, FAILURE goes on to the next.

    `wrap_around` defaults to false for trees of format 4 and to true for those of format 3, whose Nav2 always wraps around.
    """

    __slots__ = ("at", "failures", "wraps")

    def __init__(self) -> None:
        super().__init__()
        self.at = self.failures = 0
        self.wraps = False

    def setup(self) -> None:
        """Read the port."""
        self.wraps = self.flag("wrap_around", self.tree.wraps_around)

    def halt(self) -> None:
        """Begin again at the first child."""
        super().halt()
        self.at = self.failures = 0

    def tick(self) -> Status:
        """Tick the current child, and the next ones after failures."""
        children, count = self.children, len(self.children)
        self.status = RUNNING
        skipped = 0
        while self.failures + skipped < count:
            status = children[self.at].execute()
            if status is RUNNING:
                return RUNNING
            self.at += 1
            at_end = self.at == count
            if at_end and self.wraps:
                self.at = 0
            if status is SUCCESS:
                if at_end and not self.wraps:
                    break  # as in Nav2, the success of the last child counts as FAILURE
                self.failures = 0
                self.reset_children()
                return SUCCESS
            if status is FAILURE:
                self.failures += 1
            else:
                skipped += 1
            if at_end and not self.wraps:
                break
        all_skipped = skipped == count
        self.halt()
        return SKIPPED if all_skipped else FAILURE


@node("NonblockingSequence")
class NonblockingSequence(Control):
    """All children in each tick: SUCCESS if all succeed in one tick, FAILURE at the first one that fails."""

    def tick(self) -> Status:
        """Tick the children."""
        all_succeed = True
        for child in self.children:
            status = child.execute()
            if status is FAILURE:
                self.reset_children()
                return FAILURE
            if status is SKIPPED:
                raise self.failure(
                    f"{child.label} was SKIPPED, which NonblockingSequence does not allow; use PipelineSequence"
                )
            all_succeed = all_succeed and status is SUCCESS
        if all_succeed:
            self.reset_children()
            return SUCCESS
        return RUNNING


@node("PersistentSequence", ports=(Port("current_child_idx", "int", direction="both", required=True),))
class PersistentSequence(Control):
    """A Sequence whose index is an entry of the blackboard, so that it outlives a halt."""

    def tick(self) -> Status:
        """Tick the children from the index."""
        children, count = self.children, len(self.children)
        if not self.has("current_child_idx"):
            raise self.failure(
                'current_child_idx has no value; put <Script code="current_child_idx := 0"/> before the node'
            )
        at = self.integer("current_child_idx")
        if at < 0:
            raise self.failure(f"current_child_idx is {at}; write an index of at least 0")
        index = self.outputs["current_child_idx"]
        self.status = RUNNING
        while at < count:
            status = children[at].execute()
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                self.reset_children()
                index.set(0)
                return FAILURE
            at += 1
            index.set(at)
        self.reset_children()
        index.set(0)
        return SUCCESS


_RESUMED: Final = "RESUMED"
_PAUSED: Final = "PAUSED"
_CHILD_OF: Final = {_RESUMED: 0, _PAUSED: 1, "ON_PAUSE": 2, "ON_RESUME": 3}
_NEXT: Final = {
    "PAUSE_REQUESTED": "ON_PAUSE",
    "ON_PAUSE": _PAUSED,
    "RESUME_REQUESTED": "ON_RESUME",
    "ON_RESUME": _RESUMED,
    _PAUSED: _PAUSED,
    _RESUMED: _RESUMED,
}


@node("PauseResumeController", ports=inputs(pause_service_name="string!", resume_service_name="string!"))
class PauseResumeController(Control):
    """The first child, unless a service has paused it: then the second one, with the third and fourth at the changes.

    A call of a service counts at once; the node resumes when it is halted or begins anew.
    """

    CHILDREN = (1, 4)

    __slots__ = ("state",)

    def __init__(self) -> None:
        super().__init__()
        self.state = _RESUMED

    def setup(self) -> None:
        """Offer the services."""
        self.tree.offer(self.text("pause_service_name"), self._pause)
        self.tree.offer(self.text("resume_service_name"), self._resume)

    def _pause(self) -> None:
        if self.state != _PAUSED:
            self.state = "PAUSE_REQUESTED"

    def _resume(self) -> None:
        if self.state == _PAUSED:
            self.state = "RESUME_REQUESTED"

    def halt(self) -> None:
        """Resume."""
        self.state = _RESUMED
        super().halt()

    def tick(self) -> Status:
        """Tick the child of the state."""
        if self.status is IDLE:
            self.state = _RESUMED
        self.status = RUNNING
        if self.state not in _CHILD_OF:
            self.reset_children()
            self.state = _NEXT[self.state]
        index = _CHILD_OF[self.state]
        if index >= len(self.children):
            self.state = _NEXT[self.state]
            return RUNNING
        status = self.children[index].execute()
        if status is RUNNING or status is FAILURE:
            return status
        if self.state == _RESUMED:
            return SUCCESS
        self.state = _NEXT[self.state]
        return RUNNING
